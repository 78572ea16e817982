"""What the verbs of the command line share."""
import argparse
import contextlib
import os
import sys

import numpy as np

from ground import _core, errors, files, origin
from ground.errors import GroundError
from ground.recordings import bags as bag_files, findings, quality, recording as recordings, settings


class Bags(argparse.Action):
    """Bags on the command line, where a folder stands for the bags inside it."""

    def __call__(self, parser, namespace, values, option_string=None):
        try:
            setattr(namespace, self.dest, bag_files.listed(values))
        except GroundError as error:
            parser.exit(1, "%s: %s\n" % (parser.prog, error))


def reads_bags(parser):
    parser.add_argument(
        "bags", metavar="BAG", nargs="+", action=Bags, help="recorded run, or folder of them"
    )
    parser.add_argument(
        "--axes", help="world_ned x, y, z in the mocap's axes (as recorded, else '%s')" % settings.AXES
    )
    parser.add_argument(
        "--heading-offset",
        type=angle,
        metavar="RAD",
        help="measured minus true heading, taken off the measured one [rad] (as recorded, else 0)",
    )


def takes_spans(parser):
    parser.add_argument(
        "--from", dest="start", type=seconds, default=0.0, help="start, on the run's clock [s]"
    )
    parser.add_argument("--to", dest="end", type=seconds, help="end, on the run's clock [s]")
    parser.add_argument(
        "--all",
        action="store_true",
        help="take all that was recorded, not only what info calls usable",
    )


def holds_out(parser):
    parser.add_argument(
        "--holdout",
        metavar="BAG",
        nargs="+",
        action=Bags,
        default=[],
        help="runs to test on, not fitted to",
    )


def tells_progress(parser):
    parser.add_argument(
        "--progress",
        action="store_true",
        help="say on standard error what is being done (always so on a terminal)",
    )


def progress(arguments, text):
    if arguments.progress or (not arguments.json and sys.stderr.isatty()):
        print("... " + text, file=sys.stderr, flush=True)


def positive(text):
    value = float(text)
    if not value > 0 or not np.isfinite(value):
        raise argparse.ArgumentTypeError("%s is not positive" % text)
    return value


def count(text):
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError("%s is not positive" % text)
    return value


def seed(text):
    value = int(text)
    if not 0 <= value < 2**31:
        raise argparse.ArgumentTypeError("%s is not a seed: 0 or more" % text)
    return value


def seconds(text):
    value = float(text)
    if not np.isfinite(value) or value < 0:
        raise argparse.ArgumentTypeError("%s is not a time since the start [s]" % text)
    return value


def angle(text):
    value = float(text)
    if not np.isfinite(value):
        raise argparse.ArgumentTypeError("%s is not an angle [rad]" % text)
    return value


def say(arguments, text=""):
    if not arguments.json:
        print(text)


def read(arguments, bags=None, others=()):
    """The recordings in the bags; GroundError when one cannot be read or is given twice.

    Warns of runs that were recorded with different settings, of these and of `others` (recordings).
    """
    found, bags = [], bags or arguments.bags
    for path in bags:
        found.append(recordings.read_bag(path, arguments.axes, arguments.heading_offset))
        for warning in found[-1].warnings:
            print("%s: %s" % (path, warning), file=sys.stderr)
    names = [r.name for r in found]
    for recording, path in zip(found, bags):
        if names.count(recording.name) > 1:
            recording.name = os.path.splitext(path)[0].strip("./").replace(os.sep, "_")
    if len({r.name for r in found}) < len(found):
        raise GroundError("the same bag is given twice")
    different = settings.differences(list(others) + found)
    if different and different != settings.differences(others):
        print("note: %s" % different, file=sys.stderr)
    return found


def load(path):
    """The _core.Model in a file; what is implausible in it is said on standard error. GroundError
    names file, line and key."""
    try:
        model, warnings = _core.load_model_with_warnings(path)
    except RuntimeError as error:
        raise GroundError(str(error))
    for warning in warnings:
        print("warning: " + warning, file=sys.stderr)
    return model


def load_room(path):
    """The _core.RoomPlan in a file; GroundError names file, line and key."""
    try:
        return _core.load_room(path)
    except RuntimeError as error:
        raise GroundError(str(error))


def room_of(recording):
    """The _core.RoomPlan that was kept with a run; None without one. GroundError says what is wrong
    with it."""
    file = recording.files.get("room")
    if file is None:
        return None
    try:
        return _core.parse_room(file.text, "%s of %s" % (file.name, recording.name))
    except RuntimeError as error:
        raise GroundError(str(error))


def prepare(arguments, model, bags=None, others=()):
    """Every bag (of the arguments, if none are given) read and repaired; `others`: as for read.
    Warns of what the repair of a recording may have got wrong.

    Returns quality.Run and the _core.RunData of the part that is asked for, of each.
    """
    if not model.input_max > 0:
        raise GroundError("the model's input_max is not positive")
    runs = [quality.Run(r) for r in read(arguments, bags, others)]
    for run in runs:
        for finding in findings.grave(run.describe()):
            print("warning: %s: %s" % (run.recording.name, finding), file=sys.stderr)
    note_heading_offset(model, runs)
    return runs, [data(arguments, run, model) for run in runs]


def data(arguments, run, model):
    return run.data(model, arguments.start, arguments.end, arguments.all)


def note_heading_offset(model, runs):
    """Says what a model's heading_offset means for runs whose heading is corrected already."""
    if "heading_offset" not in model.effects:
        return
    corrected = [r.recording for r in runs if any(r.recording.settings.values("heading_offset") or ())]
    if corrected:
        print(
            "note: heading_offset %s is taken off the headings of %s before the model sees them; the "
            "model's effect heading_offset is what is left of it"
            % (
                " then ".join("%g" % v for v in corrected[0].settings.values("heading_offset")),
                ", ".join(r.name for r in corrected),
            ),
            file=sys.stderr,
        )


def held_out(arguments, model, fitted):
    """What prepare gives of the runs given with --holdout; GroundError when one is among those
    `fitted` to (quality.Run)."""
    if not arguments.holdout:
        return [], []
    others = [r.recording for r in fitted]
    prepared, held = prepare(arguments, model, arguments.holdout, others)
    if {r.name for r in held} & {r.name for r in others}:
        raise GroundError("a run is given both to fit to and to hold out")
    return prepared, held


@contextlib.contextmanager
def page(path, numbers):
    """For a block that writes the page `path`: where it cannot, GroundError says that the file
    `numbers` is kept, and how to make the page."""
    try:
        yield
    except (GroundError, OSError) as error:
        raise GroundError(
            "the page could not be written (%s); the numbers are kept in %s: make room, then give the "
            "same command with --force for the page %s" % (errors.sentence(error), numbers, path)
        )


def write_model(arguments, model, error_before, error_after, parameters):
    """Writes a fitted model with where its numbers come from; errors are by kind of runs."""
    provenance = model.provenance
    provenance.date, provenance.command = origin.now(), origin.command()
    provenance.bags = [os.path.basename(b) for b in arguments.bags]
    provenance.error_before, provenance.error_after = error_before, error_after
    provenance.confidence_95 = {name: p["ci95"] for name, p in parameters.items()}
    provenance.not_identified = [name for name, p in parameters.items() if not p["identified"]]
    with files.new_file(arguments.output, arguments.force) as temporary:
        with open(temporary, "w") as file:
            file.write(model.format())
