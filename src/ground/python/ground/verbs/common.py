"""Shared by the verbs of the command line."""

import argparse
import contextlib
from typing import Any, Iterator, List, Optional, Sequence

import numpy as np

from ground import errors
from ground.api import recordings as api
from ground.errors import GroundError
from ground.recordings import mapping, readers, run_settings
from ground.recordings.recording import Recording


PAGE = "writing the page"  # stage


class Bags(argparse.Action):
    """Bags on the command line; a folder stands for the bags in it."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: Optional[str] = None,
    ) -> None:
        """Sets the list of bags; exits with status 1 when a folder has none."""
        try:
            setattr(namespace, self.dest, readers.listed(values))
        except GroundError as error:
            parser.exit(1, "%s: %s\n" % (parser.prog, error))


def add_bag_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the bags, and how they are read."""
    parser.add_argument(
        "bags", metavar="BAG", nargs="+", action=Bags, help="recorded run, or folder of them"
    )
    add_reading_arguments(parser)


def add_reading_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds how recordings are read, and settings that replace the recorded ones."""
    parser.add_argument(
        "--axes",
        help="world_ned x, y, z in the mocap's axes (as recorded, else '%s')" % run_settings.AXES,
    )
    parser.add_argument(
        "--heading-offset",
        type=angle,
        metavar="RAD",
        help="measured minus true heading, subtracted from the measured one [rad] (as recorded, else 0)",
    )
    parser.add_argument(
        "--mapping",
        metavar="M.yaml",
        help="topics, fields, units and channels (identify info --write-mapping drafts one)",
    )
    parser.add_argument("--pose-topic", metavar="TOPIC", help="topic of the poses")
    parser.add_argument("--command-topic", metavar="TOPIC", help="topic of the commands")
    parser.add_argument(
        "--body", metavar="NAME", help="child frame, or part of the topic's name, of the craft"
    )


def add_span_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the part of every run that is used."""
    parser.add_argument(
        "--from", dest="start", type=seconds, default=0.0, help="start, on the run's clock [s]"
    )
    parser.add_argument("--to", dest="end", type=seconds, help="end, on the run's clock [s]")
    parser.add_argument(
        "--all",
        action="store_true",
        help="use the whole recording, not only what info calls usable",
    )


def add_holdout_argument(parser: argparse.ArgumentParser) -> None:
    """Adds --holdout."""
    parser.add_argument(
        "--holdout",
        metavar="BAG",
        nargs="+",
        action=Bags,
        default=[],
        help="runs to test on, not fitted to",
    )


def add_misread_argument(parser: argparse.ArgumentParser) -> None:
    """Adds --as-recorded."""
    parser.add_argument(
        "--as-recorded",
        action="store_true",
        help="use recordings that look misread (swapped channels, wrong signs, units or clocks), too",
    )


def positive(text: str) -> float:
    """A finite number above zero."""
    value = float(text)
    if not value > 0 or not np.isfinite(value):
        raise argparse.ArgumentTypeError("%s is not positive" % text)
    return value


def number(text: str) -> float:
    """A finite number."""
    value = float(text)
    if not np.isfinite(value):
        raise argparse.ArgumentTypeError("%s is not finite" % text)
    return value


def count(text: str) -> int:
    """An integer above zero."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError("%s is not positive" % text)
    return value


def seed(text: str) -> int:
    """An integer from 0 to 2^31 - 1."""
    value = int(text)
    if not 0 <= value < 2**31:
        raise argparse.ArgumentTypeError("%s is not a seed: 0 or more" % text)
    return value


def seconds(text: str) -> float:
    """A finite time [s], zero or more."""
    value = float(text)
    if not np.isfinite(value) or value < 0:
        raise argparse.ArgumentTypeError("%s is not a time since the start [s]" % text)
    return value


def angle(text: str) -> float:
    """A finite angle [rad]."""
    value = float(text)
    if not np.isfinite(value):
        raise argparse.ArgumentTypeError("%s is not an angle [rad]" % text)
    return value


def say(arguments: argparse.Namespace, text: str = "") -> None:
    """Prints a line, unless the result is printed as JSON."""
    if not arguments.json:
        print(text, flush=True)  # at once, also into a pipe


def reading(arguments: argparse.Namespace, bags: Sequence[str]) -> Iterator[Recording]:
    """The recordings in the bags, read when the first one is asked for."""
    return api.reading(bags, mapped(arguments), arguments.work)


def mapped(arguments: argparse.Namespace) -> mapping.FieldMapping:
    """The mapping file, with what options say in its place."""
    given = mapping.load(arguments.mapping) if arguments.mapping else mapping.DEFAULT
    return given.with_options(
        arguments.pose_topic,
        arguments.command_topic,
        arguments.body,
        arguments.axes,
        arguments.heading_offset,
    )


def read(arguments: argparse.Namespace) -> List[Recording]:
    """The recordings in the arguments' bags; GroundError when one cannot be read or is given twice.
    Warns of different settings."""
    found = list(reading(arguments, arguments.bags))
    api.note_differences(found)
    return found


@contextlib.contextmanager
def page(path: str, numbers: str) -> Iterator[None]:
    """Wraps a block that writes the page `path`. If it fails, GroundError says that the file `numbers`
    is kept, and how to make the page."""
    try:
        yield
    except (GroundError, OSError) as error:
        raise GroundError(
            "the page could not be written (%s); the numbers are kept in %s: make room, then repeat the "
            "command with --force to write the page %s" % (errors.sentence(error), numbers, path)
        )
