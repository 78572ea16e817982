"""identify info: contents, oddities and repairs of recordings."""

import argparse
import math
import os
import shlex
from typing import Dict, Iterator, List, Sequence

from ground.checks import findings, imitations, layouts, suspicions
from ground.data import bag_arguments
from ground.data import measured as api
from ground.draft import drafts
from ground.models import Model
from ground.reading import mapping, readers, recorded_files
from ground.reading.gathered import CAME_LATE
from ground.support import command_line, files
from ground.support.annotations import Document
from ground.support.errors import GroundError
from ground.support.headline import Line, formatted


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the verb's arguments."""
    bag_arguments.add_bag_arguments(parser)
    parser.add_argument(
        "--write-mapping",
        metavar="M.yaml",
        dest="output",
        help="draft a mapping file for the first recording, with the evidence, instead of the report",
    )
    parser.add_argument(
        "--model",
        metavar="MODEL.yaml",
        help="model of the craft: find from the motion which channel drives which of its thrusters",
    )
    parser.add_argument("--force", action="store_true", help="overwrite the mapping file")


def run(arguments: argparse.Namespace) -> List[Dict[str, object]]:
    """Runs the verb; returns what --json prints."""
    if arguments.output:
        return _write_mapping(arguments)
    model = Model.load(arguments.model).core if arguments.model else None
    recordings = list(bag_arguments.read(arguments))
    if model:
        recordings = [recording.with_lift_of(model) for recording in recordings]
    runs = api.repaired(recordings, arguments.work)
    recordings = [run.recording for run in runs]
    mappings = {recording.name: recording.mapping for recording in recordings}
    doubts = suspicions.about(recordings, model)
    described = findings.describe(runs, doubts)
    of_all = [one.sentence for one in doubts if len(one.runs) > 1]
    read = [*arguments.bags, *(["--mapping", arguments.mapping] if arguments.mapping else [])]
    for line in formatted(_headline(described, of_all, read)):
        command_line.say(arguments, line)
    for d in described:
        command_line.say(arguments)
        command_line.say(arguments, d["name"])
        for name, value in findings.facts(d):
            command_line.say(arguments, "  %-11s %s" % (name, value))
        for finding in findings.findings(d):
            command_line.say(arguments, "  - %s" % finding)
        for line in mappings.get(d["name"], "").splitlines():
            command_line.say(arguments, "  | " + line)
    angles = [str(one["channel"]) for one in model.thrusters if one["is_angle"]] if model else []
    if angles:
        text = "which channel drives which thruster is not judged: a thruster's effect changes with %s"
        command_line.say(arguments, text % ", ".join(angles))
    elif model:
        with arguments.work.stage("judging which channel drives which thruster"):
            thrusters = layouts.thrusters_of(model)
            verdict = layouts.judge(recordings, thrusters)
            verdict = imitations.confirmed(verdict, recordings, thrusters, model)
        command_line.say(arguments, layouts.sentence(verdict))
        described = [dict(d, layout=verdict.describe()) for d in described]
    return described


def _headline(described: Sequence[Document], of_all: Sequence[str], read: Sequence[str]) -> Iterator[Line]:
    """The first lines: how much is usable, how good the poses are, and what to do next; of_all: sentences on
    what several recordings look like together; read: the arguments that name them."""
    usable = sum(float(d["usable"]["duration"]) for d in described)
    whole = sum(float(d["duration"]) for d in described)
    odd = {d["name"]: [*findings.grave(d), *(w for w in d["warnings"] if CAME_LATE in w)] for d in described}
    doubtful = [name for name, sentences in odd.items() if sentences]
    count = "%d recording%s" % (len(described), "" if len(described) == 1 else "s")
    yield "Usable", "%.1f of %.1f s in %s." % (usable, whole, count)
    position, heading = (
        max(float(d["poses"]["noise"][k]) for d in described) for k in ("position", "heading")
    )
    rate = min(float(d["poses"]["rate"]) for d in described)
    yield (
        "Poses",
        "%.4g Hz or more; noise up to %.2g mm, %.2g deg" % (rate, 1e3 * position, math.degrees(heading)),
    )
    if of_all:
        yield "Next", "look at " + of_all[0]
    elif doubtful:
        yield "Next", "look at %s: %s" % (", ".join(doubtful), odd[doubtful[0]][0])
    else:
        fits = "rosrun ground identify fit %s --model MODEL -o fitted.yaml"
        yield "Next", "nothing to correct; fit a model:\n" + fits % " ".join(map(shlex.quote, read))


def _from(mapping_file: str, path: str) -> str:
    """A path as a mapping file beside it names it."""
    folder = os.path.dirname(os.path.abspath(mapping_file))
    return path if os.path.isabs(path) else os.path.relpath(path, folder)


def _write_mapping(arguments: argparse.Namespace) -> List[Dict[str, object]]:
    """Drafts a mapping file."""
    path, output = arguments.bags[0], arguments.output
    files.refuse_existing(output, arguments.force)
    with arguments.work.stage("drafting"):
        path = recorded_files.to_draft(recorded_files.listed([path])[0])
        types = bag_arguments.mapping_of(arguments).types
        with readers.opened(path, types) as source:
            text = drafts.draft(source, os.path.isdir(path), [_from(output, one) for one in types])
    files.write_text(output, text, arguments.force)
    try:
        mapping.load(output)
        command_line.say(arguments, "%s: look through it, then give --mapping %s" % (output, output))
    except GroundError as error:
        command_line.say(arguments, "%s: a draft to complete (%s)" % (output, error))
    return [{"mapping": output, "drafted_from": path}]
