"""identify tracking: how a recorded craft followed its reference (thesis figures 4.6, 4.7)."""

import argparse
from typing import Iterator, List, Tuple

from ground.control.words import add_picture, draw, effort_lines, metres, refuse_picture
from ground.data import bag_arguments
from ground.models import Room
from ground.recordings import tracks
from ground.recordings.recording import Recording
from ground.support import command_line
from ground.support.annotations import Document
from ground.support.headline import Line, formatted

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
    command_line.add_details(parser)
    add_picture(parser, "path, error, inputs and computing time of the longest drive")
    parser.add_argument("--force", action="store_true", help="overwrite the picture")


def run(arguments: argparse.Namespace) -> Document:
    """Runs the verb; returns what --json prints."""
    refuse_picture(arguments)
    room = Room.load(arguments.room) if arguments.room else None
    runs: List[Document] = []
    drawn: List[Tuple[tracks.Track, Document, Recording]] = []
    for recording in bag_arguments.read(arguments):
        with arguments.work.stage(FOLLOWING):
            read = tracks.read(recording.path, recording)
        kind = recording.flown_by.get("controller")
        drives = [dict(tracks.numbers(track, arguments.settled), kind=kind) for track in read]
        drawn += [(track, drive, recording) for track, drive in zip(read, drives)]
        runs.append({"run": recording.name, "drives": drives, "changes": len(recording.changes)})
        for line in formatted(_headline(runs[-1])):
            command_line.say(arguments, line)
        for drive in drives:
            command_line.say_details(arguments, effort_lines(drive))
    result: Document = {"settled": arguments.settled, "runs": runs}

    def figure() -> Document:
        from ground.reports import tracking_figures

        track, numbers, recording = max(drawn, key=lambda one: float(one[1]["duration"]))
        name = ", ".join(filter(None, (recording.name, numbers["kind"] or track.controller)))
        counts, walls = (arguments.settled, track.times[-1]), room or Room.of_recording(recording)
        text = tracking_figures.caption(name, numbers)
        return tracking_figures.driven(track, text, counts, walls.core if walls else None)

    draw(arguments, figure, result)
    if arguments.picture:
        for line in formatted([("Picture", arguments.picture)]):
            command_line.say(arguments, line)
    return result


def _headline(run: Document) -> Iterator[Line]:
    """The first lines on a run: how well each of its drives followed the reference."""
    for drive in run["drives"]:
        driver = drive["kind"] or drive["controller"] or "controller unknown"
        yield "Followed", "%s: %s, %.1f s" % (run["run"], driver, drive["duration"])
        errors = tuple(metres(drive[name]) for name in ("rms", "max", "final"))
        yield "Distance", "%s rms, %s at most, %s at the end" % errors
    changed = "parameters changed %d times while it ran: identify info lists them" % run["changes"]
    yield "Next", changed if run["changes"] else "nothing needed"
