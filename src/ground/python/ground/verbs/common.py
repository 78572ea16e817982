"""What the verbs of the command line share."""

import argparse
import contextlib
import sys

import numpy as np

from ground import errors
from ground.api import recordings as api
from ground.errors import GroundError
from ground.recordings import readers, settings


class Bags(argparse.Action):
    """Bags on the command line, where a folder stands for the bags inside it."""

    def __call__(self, parser, namespace, values, option_string=None):
        try:
            setattr(namespace, self.dest, readers.listed(values))
        except GroundError as error:
            parser.exit(1, "%s: %s\n" % (parser.prog, error))


def reads_bags(parser):
    parser.add_argument(
        "bags", metavar="BAG", nargs="+", action=Bags, help="recorded run, or folder of them"
    )
    parser.add_argument(
        "--axes",
        help="world_ned x, y, z in the mocap's axes (as recorded, else '%s')" % settings.AXES,
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


def teller(arguments):
    """What tells the progress of an API's function."""
    return lambda text: progress(arguments, text)


def reading(arguments, bags):
    """The recordings in the bags, read when the first one is asked for."""
    return api.reading(bags, arguments.axes, arguments.heading_offset)


def read(arguments):
    """The recordings in the arguments' bags; GroundError when one cannot be read or is given twice.
    Notes different settings."""
    found = list(reading(arguments, arguments.bags))
    api.note_differences(found)
    return found


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
