"""identify info: contents, oddities and repairs of recordings."""

import argparse
from typing import List

from ground.annotations import Document
from ground.recordings import findings, quality
from ground.verbs import common

NAME = "info"
SUMMARY = "contents and oddities of recordings, and their usable parts"


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the verb's arguments."""
    common.add_bag_arguments(parser)


def run(arguments: argparse.Namespace) -> List[Document]:
    """Runs the verb; returns what --json prints."""
    described = quality.describe([r.repaired for r in common.read(arguments)])
    for d in described:
        common.say(arguments, d["name"])
        for name, value in findings.facts(d):
            common.say(arguments, "  %-11s %s" % (name, value))
        for finding in findings.findings(d):
            common.say(arguments, "  - %s" % finding)
    return described
