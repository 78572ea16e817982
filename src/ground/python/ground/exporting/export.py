"""export: a model as code of another language; a run and what models predict of it as an MCAP file."""

import argparse
import os
from typing import TYPE_CHECKING, Dict, List, Union

from ground.data import bag_arguments
from ground.equations import written
from ground.models import Model, ModelLike
from ground.support import command_line
from ground.support.errors import GroundError
from ground.support.public import public

if TYPE_CHECKING:
    from ground.exporting.recorded import ExportedRun


FORM = "identify export MODEL -o FILE.py (or .h, .c), or identify export RUN --mcap FILE.mcap"


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of identify export."""
    parser.set_defaults(form=FORM)
    parser.add_argument("source", metavar="MODEL|RUN", help="model to export; with --mcap: recorded run")
    parser.add_argument(
        "against",
        nargs="*",
        metavar="DIAGNOSIS",
        help="with --mcap: folder of a diagnosis, for its given and its proposed model, or model files",
    )
    parser.add_argument("-o", "--output", metavar="FILE", help="file to write; .py, .h or .c sets the format")
    parser.add_argument(
        "--to",
        choices=list(written.TARGETS),
        help="format (by the extension of FILE: numpy for .py, c for .h and .c)",
    )
    group = parser.add_argument_group("a run for Foxglove, Lichtblick, PlotJuggler and rerun")
    group.add_argument("--mcap", metavar="FILE", help="file to write the run to")
    group.add_argument(
        "--horizon",
        type=command_line.positive,
        metavar="S",
        help="prediction horizon (chosen for the craft) [s]",
    )
    bag_arguments.add_reading_arguments(group)
    parser.add_argument("--force", action="store_true", help="overwrite existing files")


def run(arguments: argparse.Namespace) -> Dict[str, object]:
    """Runs identify export; returns what --json prints."""
    if bool(arguments.mcap) == bool(arguments.output):
        arguments.refuse("a model needs -o FILE, a run needs --mcap FILE: " + FORM)
    if arguments.output and arguments.against:
        arguments.refuse("%s needs --mcap FILE" % arguments.against[0])
    found: Union[written.ExportedModel, "ExportedRun"] = (
        _run(arguments) if arguments.mcap else _model(arguments)
    )
    command_line.say(arguments, str(found))
    return found.to_dict()


def _model(arguments: argparse.Namespace) -> written.ExportedModel:
    """A model as code."""
    return Model.load(arguments.source).export(arguments.output, arguments.to, arguments.force)


def _run(arguments: argparse.Namespace) -> "ExportedRun":
    """A run as an MCAP file."""
    runs = list(bag_arguments.reading(arguments, [arguments.source]))
    if len(runs) != 1:
        raise GroundError("%s contains %d runs; export needs one" % (arguments.source, len(runs)))
    models = [model for path in arguments.against for model in _models(path)]
    made: ExportedRun = public("to_mcap")(runs[0], arguments.mcap, models, arguments.horizon, arguments.force)
    return made


def _models(path: str) -> List[ModelLike]:
    """The given and the proposed model of a diagnosis, or a model file."""
    if not os.path.isdir(path):
        return [path]
    found = public("Diagnosis").load(path)
    given = str(found.report["model"])
    if not os.path.isfile(given):
        text = "%s: its model %s no longer exists; give model files instead of the diagnosis"
        raise GroundError(text % (path, given))
    return [given, found.improved] if found.effects else [given]
