"""Arguments of command lines for recordings: which ones, how they are read, and which part is used."""

import argparse
import inspect
import os
from dataclasses import dataclass
from typing import Any, Callable, Dict, Iterator, List, Sequence, Tuple, Type

from ground.data import measured as api
from ground.data import read as reader
from ground.data.measured import Part as Part
from ground.reading import mapping, run_settings
from ground.reading.recording import Recording
from ground.support import command_line, files
from ground.support.annotations import Document
from ground.support.command_line import number, option, positive
from ground.support.errors import GroundError


@dataclass(frozen=True)
class AsRecorded:
    """Whether recordings are used that look misread."""

    as_recorded: bool = option(
        False, "use recordings that look misread (swapped channels, wrong signs, units or clocks), too"
    )


def add_bag_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the bags, and how they are read."""
    parser.add_argument("bags", metavar="BAG", nargs="+", help="recorded run, or folder of them")
    add_reading_arguments(parser)


def add_reading_arguments(parser: "argparse._ActionsContainer") -> None:
    """Adds how recordings are read, and settings that replace the recorded ones."""
    parser.add_argument(
        "--axes", help="world_ned x, y, z in the mocap's axes (as recorded, else '%s')" % run_settings.AXES
    )
    parser.add_argument(
        "--heading-offset",
        type=number,
        metavar="RAD",
        help="measured minus true heading, subtracted from the measured one [rad] (as recorded, else 0)",
    )
    parser.add_argument(
        "--mapping",
        metavar="M.yaml",
        help="topics, fields, units and channels (identify info --write-mapping drafts one)",
    )
    parser.add_argument(
        "--types",
        metavar="PATH",
        nargs="+",
        default=(),
        help=".msg files, or folders of them, for types of messages that a bag does not define",
    )
    parser.add_argument("--pose-topic", metavar="TOPIC", help="topic of the poses")
    parser.add_argument("--command-topic", metavar="TOPIC", help="topic of the commands")
    parser.add_argument(
        "--namespace", metavar="NAME", help="of the craft's topics, where a bag has several crafts"
    )
    parser.add_argument(
        "--body", metavar="NAME", help="child frame, or part of the topic's name, of the craft"
    )
    parser.add_argument(
        "--noise",
        type=positive,
        nargs=2,
        metavar=("M", "RAD"),
        help="standard deviations of positions [m] and headings [rad] (of the scatter of the poses)",
    )
    parser.add_argument(
        "--frame-rate",
        type=positive,
        metavar="HZ",
        help="of the mocap's camera, if the stamps are late [Hz] (of stamps and motion)",
    )
    parser.add_argument(
        "--stamps",
        choices=["unpadded"],
        help="nanoseconds after the point of the stamps in a table have no leading zeros: restore them",
    )
    parser.add_argument(
        "--leave-out",
        type=_span,
        metavar="RUN=FROM,TO",
        nargs="+",
        default=(),
        help="spans of runs, on their clocks [s], whose poses are not used",
    )


def _span(text: str) -> Tuple[str, Tuple[float, float]]:
    """RUN=FROM,TO."""
    name, _, times = text.rpartition("=")
    try:
        start, end = map(float, times.split(","))
    except ValueError:
        start, end = 0.0, 0.0
    if not (name and start < end):
        raise argparse.ArgumentTypeError("'%s' is not RUN=FROM,TO with FROM before TO [s]" % text)
    return name, (start, end)


def add_holdout_argument(parser: argparse.ArgumentParser) -> None:
    """Adds --holdout."""
    parser.add_argument(
        "--holdout", metavar="BAG", nargs="+", default=[], help="runs to test on, not fitted to"
    )


def mapping_of(arguments: argparse.Namespace) -> mapping.FieldMapping:
    """The FieldMapping that the arguments of add_reading_arguments say."""
    given = mapping.load(arguments.mapping) if arguments.mapping else mapping.DEFAULT
    names = inspect.signature(given.with_options).parameters
    return given.with_options(**{name: getattr(arguments, name) for name in names})


def reading_options(arguments: argparse.Namespace) -> Document:
    """The options of ground.read that the arguments say, with absolute paths."""
    names = [name for name in inspect.signature(reader.read).parameters if name != "bags"]
    found = {name: getattr(arguments, name) for name in names if getattr(arguments, name) not in (None, ())}
    if "mapping" in found:
        found["mapping"] = os.path.abspath(found["mapping"])
    if "types" in found:
        found["types"] = [os.path.abspath(path) for path in found["types"]]
    return found


def reading(arguments: argparse.Namespace, bags: Sequence[str]) -> Iterator[Recording]:
    """The recordings in the bags, read when the first one is asked for; of runs to hold out, after the
    others. GroundError where a span is to be left out of a run that is not among them."""
    given, named = mapping_of(arguments), {name for name, _ in arguments.leave_out}
    met = vars(arguments).setdefault("runs_met", set())
    for run in reader.reading(bags, given, arguments.work):
        met.add(run.name)
        spans = [span for name, span in arguments.leave_out if name == run.name]
        yield run.without(*spans) if spans else run
    held_out = getattr(arguments, "holdout", None)
    if named - met and (not held_out or bags is held_out):
        raise GroundError(
            "--leave-out: there is no run %s; runs: %s"
            % (" and no run ".join(sorted(named - met)), ", ".join(sorted(met)))
        )


def read(arguments: argparse.Namespace) -> List[Recording]:
    """The recordings in the arguments' bags; GroundError when one cannot be read or is given twice.
    Warns of different settings."""
    found = list(reading(arguments, arguments.bags))
    api.note_differences(found)
    return found


def configure_fit(parser: argparse.ArgumentParser, model: str, output: str, kind: Type[Any]) -> None:
    """Adds the arguments of a verb that fits to recordings and writes a model. model: help on --model;
    output: metavar of --output; kind: of its options."""
    add_bag_arguments(parser)
    command_line.add_model(parser, model)
    command_line.add_output(parser, output)
    add_holdout_argument(parser)
    command_line.add_options(parser, kind)
    command_line.add_details(parser)


def run_fit(
    arguments: argparse.Namespace, fit: Callable[..., Any], kind: Type[Any], *given: str
) -> Dict[str, object]:
    """Runs such a verb; given: what `fit` takes between model and recordings."""
    files.refuse_existing(arguments.output, arguments.force)
    found = fit(
        arguments.model,
        *given,
        reading(arguments, arguments.bags),
        holdout=reading(arguments, arguments.holdout),
        options=command_line.options(arguments, kind),
        progress=arguments.work,
    )
    found.save(arguments.output, arguments.force)
    command_line.say_result(arguments, found, arguments.output)
    if "mat" in arguments:
        command_line.write_mat(arguments, found)
    return {"model": arguments.output, **found.to_dict()}
