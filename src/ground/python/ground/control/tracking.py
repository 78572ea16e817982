"""identify tracking: how a recorded craft followed its reference (thesis figures 4.6, 4.7)."""

import argparse
from typing import Dict, Iterator, List, Sequence, Tuple

from ground.analysis import tracks
from ground.control.words import add_picture, draw, effort_lines, metres, refuse_picture
from ground.data import bag_arguments
from ground.models import Room
from ground.reading.recording import Recording
from ground.support import command_line
from ground.support.annotations import Document
from ground.support.headline import formatted


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
    parser.add_argument("--room", metavar="ROOM.yaml", help="room whose walls are drawn (the run's)")
    command_line.add_details(parser)
    add_picture(parser, "path, error, inputs and computing time of the longest drive")
    parser.add_argument("--force", action="store_true", help="overwrite the picture")


def run(arguments: argparse.Namespace) -> Dict[str, object]:
    """Runs the verb; returns what --json prints."""
    refuse_picture(arguments)
    room = Room.load(arguments.room) if arguments.room else None
    runs: List[Document] = []
    drawn: List[Tuple[tracks.Track, Document, Recording]] = []
    for recording in bag_arguments.read(arguments):
        with arguments.work.stage("comparing paths with references"):
            read = tracks.read(recording.path, recording)
        by = {"kind": recording.flown_by.get("controller"), "model": recording.flown_by.get("model")}
        drives = [dict(tracks.numbers(track, arguments.settled), **by) for track in read]
        drawn += [(track, drive, recording) for track, drive in zip(read, drives)]
        runs.append({"run": recording.name, "drives": drives, "changes": len(recording.changes)})
    for line in _lines(runs, len(drawn) > 1):
        command_line.say(arguments, line)
    for name, drive in ((run["run"], drive) for run in runs for drive in run["drives"]):
        command_line.say_details(arguments, [*[name] * (len(drawn) > 1), *effort_lines(drive)])
    result: Dict[str, object] = {"settled": arguments.settled, "runs": runs}

    def figure() -> Dict[str, object]:
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


def _lines(runs: Sequence[Document], as_table: bool) -> Iterator[str]:
    """How well each drive followed its reference, and what to do next."""
    rows = [["run", "controller", "its model", "rms", "at most", "at the end", "saturated"]]
    for name, drive in ((run["run"], drive) for run in runs for drive in run["drives"]):
        driver = drive["kind"] or drive["controller"] or "controller unknown"
        errors, share = [metres(drive[key]) for key in ("rms", "max", "final")], drive["saturated_fraction"]
        saturated = "-" if share is None else "%.1f%%" % (100 * share)
        rows.append([name, driver, drive["model"] or "-", *errors, saturated])
        followed = "%s: %s, %.1f s" % (name, driver, drive["duration"])
        distance = "%s rms, %s at most, %s at the end" % tuple(errors)
        yield from () if as_table else formatted([("Followed", followed), ("Distance", distance)])
    widths = [max(map(len, column)) for column in zip(*rows)]
    yield from ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows] if as_table else []
    changed = ["%s %d times" % (run["run"], run["changes"]) for run in runs if run["changes"]]
    told = "parameters changed while these ran: %s; identify info lists them" % ", ".join(changed)
    yield from formatted(
        [("Next", told if changed else "nothing needed; the program tune searches for better gains")]
    )
