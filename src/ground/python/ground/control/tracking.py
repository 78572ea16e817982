"""identify tracking: how a recorded craft followed its reference (thesis figures 4.6, 4.7)."""

import argparse
from typing import Iterator, List, Optional, Sequence, Tuple

from ground import command_line, files
from ground.data import bag_arguments
from ground.annotations import Document
from ground.control.words import effort_lines, metres
from ground.models import Room
from ground.recordings import tracks
from ground.recordings.recording import Recording

FOLLOWING = "comparing paths with references"  # stage; unit: a recording


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the verb's arguments."""
    bag_arguments.add_bag_arguments(parser)
    parser.add_argument(
        "--settled",
        type=command_line.seconds,
        default=0.0,
        metavar="S",
        help="time after the start of the reference from which errors count [s] (%(default)g)",
    )
    parser.add_argument("--room", metavar="ROOM.yaml", help="room whose walls are drawn (that of the run)")
    parser.add_argument(
        "--picture",
        metavar="FILE.png",
        help="path, error, inputs and computing time of the longest drive; FILE.html: a page, which "
        "needs no Chromium",
    )
    parser.add_argument("--force", action="store_true", help="overwrite the picture")


def run(arguments: argparse.Namespace) -> Document:
    """Runs the verb; returns what --json prints."""
    if arguments.picture:
        files.refuse_existing(arguments.picture, arguments.force)
    room = Room.load(arguments.room) if arguments.room else None
    runs: List[Document] = []
    longest: Optional[Tuple[tracks.Track, Document, Recording]] = None
    recordings = bag_arguments.read(arguments)
    for recording in recordings:
        drives = []
        with arguments.work.stage(FOLLOWING):
            read = list(tracks.read(recording.path, recording))
        for track in read:
            numbers = tracks.numbers(track, arguments.settled)
            numbers["kind"] = recording.flown_by.get("controller")
            drives.append(numbers)
            if longest is None or numbers["duration"] > longest[1]["duration"]:
                longest = track, numbers, recording
        changes = len(recording.changes)
        runs.append({"run": recording.name, "drives": drives, "changes": changes})
        for line in _lines(recording.name, drives, changes):
            command_line.say(arguments, line)
    result: Document = {"settled": arguments.settled, "runs": runs}
    if arguments.picture and longest:
        from ground.reports import picture, tracking_figures

        track, numbers, recording = longest
        name = ", ".join(filter(None, (recording.name, numbers["kind"] or track.controller)))
        caption = tracking_figures.caption(name, numbers)
        counts = arguments.settled, track.times[-1]
        room = room or Room.of_recording(recording)
        shown = tracking_figures.driven(track, caption, counts, room.core if room else None)
        with arguments.work.stage("drawing the picture"):
            picture.write(arguments.picture, [shown], arguments.force)
        result["picture"] = arguments.picture
        command_line.say(arguments, "written to %s" % arguments.picture)
    return result


def _lines(name: str, drives: Sequence[Document], changes: int) -> Iterator[str]:
    for drive in drives:
        yield "%s: %s, %.1f s" % (
            name,
            drive["kind"] or drive["controller"] or "controller unknown",
            drive["duration"],
        )
        yield "error      %s rms, %s at most, %s at the end" % tuple(
            metres(drive[n]) for n in ("rms", "max", "final")
        )
        yield from effort_lines(drive)
    if changes:
        yield "parameters changed %d times while it ran: identify info lists them" % changes
