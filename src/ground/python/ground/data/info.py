"""identify info: contents, oddities and repairs of recordings."""

import argparse
import os
from typing import List

from ground.data import bag_arguments
from ground.data import measured as api
from ground.models import Model
from ground.recordings import drafts, findings, layouts, mapping, readers
from ground.support import command_line, files
from ground.support.annotations import Document
from ground.support.errors import GroundError


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the verb's arguments."""
    bag_arguments.add_bag_arguments(parser)
    parser.add_argument(
        "--write-mapping",
        metavar="M.yaml",
        dest="output",
        help="draft a mapping file for the first recording, with what it has and why, in place of info",
    )
    parser.add_argument(
        "--model",
        metavar="MODEL.yaml",
        help="a model of the craft: which channel drives which of its thrusters is judged by the motion",
    )
    parser.add_argument("--force", action="store_true", help="overwrite the mapping file")


def run(arguments: argparse.Namespace) -> List[Document]:
    """Runs the verb; returns what --json prints."""
    if arguments.output:
        return _write_mapping(arguments)
    model = Model.load(arguments.model).core if arguments.model else None
    recordings = list(bag_arguments.read(arguments))
    if model:
        recordings = [recording.with_lift_of(model) for recording in recordings]
    described = findings.describe(api.repaired(recordings, arguments.work))
    for d in described:
        command_line.say(arguments, d["name"])
        for name, value in findings.facts(d):
            command_line.say(arguments, "  %-11s %s" % (name, value))
        for finding in findings.findings(d):
            command_line.say(arguments, "  - %s" % finding)
    if model:
        with arguments.work.stage("judging which channel drives which thruster"):
            verdict = layouts.judge(recordings, layouts.thrusters_of(model))
        command_line.say(arguments, layouts.sentence(verdict))
        described = [dict(d, layout=verdict.describe()) for d in described]
    return described


def _write_mapping(arguments: argparse.Namespace) -> List[Document]:
    """Drafts a mapping file."""
    path, output = arguments.bags[0], arguments.output
    files.refuse_existing(output, arguments.force)
    with arguments.work.stage("drafting"):
        path = readers.to_draft(readers.listed([path])[0])
        with readers.opened(path) as source:
            text = drafts.draft(source, os.path.isdir(path))
    with files.new_file(output, arguments.force) as temporary:
        with open(temporary, "w", encoding="utf-8") as file:
            file.write(text)
    try:
        mapping.load(output)
        command_line.say(arguments, "%s: look through it, then give --mapping %s" % (output, output))
    except GroundError as error:
        command_line.say(arguments, "%s: a draft to complete (%s)" % (output, error))
    return [{"mapping": output, "drafted_from": path}]
