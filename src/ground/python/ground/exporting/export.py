"""export: a model as code of another language."""

import argparse

from ground.equations import written
from ground.models import Model
from ground.support import command_line
from ground.support.annotations import Document


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of identify export."""
    parser.add_argument("source", metavar="MODEL.yaml", help="model to export")
    command_line.add_output(parser, "FILE", "file to write; .py and .h or .c say what it is")
    parser.add_argument(
        "--to",
        choices=list(written.TARGETS),
        help="what it is written as (by the end of FILE: numpy for .py, c for .h and .c)",
    )


def run(arguments: argparse.Namespace) -> Document:
    """Runs identify export; returns what --json prints."""
    found = Model.load(arguments.source).export(arguments.output, arguments.to, arguments.force)
    command_line.say(arguments, str(found))
    return found.to_dict()
