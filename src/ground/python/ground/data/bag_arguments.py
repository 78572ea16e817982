"""Arguments of command lines for recordings: which ones, how they are read, and which part is used."""

import argparse
import os
import re
import shlex
from dataclasses import dataclass, fields
from typing import Any, Callable, Dict, Iterator, List, Sequence, Tuple, Type

from ground.data import measured as api
from ground.data import read as reader
from ground.data.measured import Part as Part
from ground.reading.mapping import FieldMapping
from ground.reading.recording import Recording
from ground.support import command_line, files
from ground.support.annotations import Document
from ground.support.command_line import option
from ground.support.errors import GroundError
from ground.support.results import Shown


@dataclass(frozen=True)
class AsRecorded:
    """Whether recordings are used that look misread."""

    as_recorded: bool = option(
        False, "also use recordings that look misread (swapped channels, wrong signs, units or clocks)"
    )


def add_bag_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the bags, and how they are read."""
    parser.add_argument("bags", metavar="BAG", nargs="+", help="recorded run, or folder of runs")
    add_reading_arguments(parser)


def add_reading_arguments(parser: "argparse._ActionsContainer") -> None:
    """Adds how recordings are read, and settings that replace the recorded ones."""
    command_line.add_options(parser, reader.ReadingOptions)
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
    parser.add_argument("--holdout", metavar="BAG", nargs="+", default=[], help="runs for testing only")


def mapping_of(arguments: argparse.Namespace) -> FieldMapping:
    """The FieldMapping that the arguments of add_reading_arguments say."""
    return command_line.options(arguments, reader.ReadingOptions).field_mapping()


def reading_options(arguments: argparse.Namespace) -> Document:
    """The options of ground.read that the arguments say, with absolute paths."""
    found = vars(command_line.options(arguments, reader.ReadingOptions))
    found = {name: value for name, value in found.items() if value not in (None, ())}
    if "mapping" in found:
        found["mapping"] = os.path.abspath(found["mapping"])
    if "types" in found:
        found["types"] = [os.path.abspath(path) for path in found["types"]]
    return found


def _options_typed(arguments: argparse.Namespace) -> Iterator[str]:
    """The options of add_reading_arguments, as a command line gives them."""
    for one in fields(reader.ReadingOptions):
        value = getattr(arguments, one.name)
        if value not in (None, ()):
            yield "--" + one.name.replace("_", "-")
            yield from map(str, value if isinstance(value, (list, tuple)) else [value])
    if arguments.leave_out:
        yield "--leave-out"
        yield from ("%s=%r,%r" % (name, *span) for name, span in arguments.leave_out)


def typed(arguments: argparse.Namespace) -> List[str]:
    """The recordings, those to hold out, and the options to read them, as a command line gives them."""
    held_out = getattr(arguments, "holdout", [])
    as_recorded = ["--as-recorded"] * getattr(arguments, "as_recorded", False)
    return [
        *arguments.bags,
        *["--holdout"] * bool(held_out),
        *held_out,
        *_options_typed(arguments),
        *as_recorded,
    ]


def with_bags(arguments: argparse.Namespace, line: str) -> str:
    """A line of a result, with what `typed` gives for BAGS in its command; OTHER_BAGS remain, to be read with
    the same options."""
    read = {"BAGS": typed(arguments), "OTHER_BAGS": ["OTHER_BAGS", *_options_typed(arguments)]}
    return re.sub(r"\b(OTHER_)?BAGS\b", lambda found: " ".join(map(shlex.quote, read[found.group()])), line)


def say_result(arguments: argparse.Namespace, found: Shown, written: str) -> None:
    """Prints a result that was written to a file or folder, with commands that read the same recordings."""
    for line in found.lines(written):
        command_line.say(arguments, with_bags(arguments, line))
    command_line.say_details(arguments, found.details())


def reading(arguments: argparse.Namespace, bags: Sequence[str]) -> Iterator[Recording]:
    """The recordings in the bags, read when the first one is asked for; of runs to hold out, after the
    others. GroundError where a span is to be left out of a run that is not among them."""
    given, named = mapping_of(arguments), {name for name, _ in arguments.leave_out}
    met = vars(arguments).setdefault("runs_met", set())
    for run in reader.reading(bags, given, arguments.work, _folder(arguments)):
        met.add(run.name)
        if run.mapping:
            vars(arguments).setdefault("drafted", {})[run.name] = run.mapping
        spans = [span for name, span in arguments.leave_out if name == run.name]
        yield run.without(*spans) if spans else run
    held_out = getattr(arguments, "holdout", None)
    if named - met and (not held_out or bags is held_out):
        raise GroundError(
            "--leave-out: there is no run %s; runs: %s"
            % (" and no run ".join(sorted(named - met)), ", ".join(sorted(met)))
        )


def _folder(arguments: argparse.Namespace) -> str:
    """The folder of the result of a verb; empty where it writes none."""
    output = getattr(arguments, "output", None) or ""
    is_file = bool(os.path.splitext(output)[1]) and not os.path.isdir(output)
    return os.path.dirname(output) or "." if is_file else output


def store_drafts(arguments: argparse.Namespace) -> None:
    """Writes the drafted mappings of a verb's runs into the folder of its result, if it has one. Only with
    --force does it replace a file, which may have been edited."""
    folder, force = _folder(arguments), getattr(arguments, "force", False)
    for name, text in getattr(arguments, "drafted", {}).items() if folder else ():
        path = os.path.join(folder, name + reader.DRAFT)
        if force or not os.path.exists(path):
            files.write_text(path, text, force)


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
    say_result(arguments, found, arguments.output)
    if "mat" in arguments:
        command_line.write_mat(arguments, found)
    return {"model": arguments.output, **found.to_dict()}
