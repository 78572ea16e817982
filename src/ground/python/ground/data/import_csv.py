"""identify import: CSV exports to a bag."""

import argparse

from ground.recordings import csv_exports
from ground.support import command_line, files
from ground.support.annotations import Document


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the verb's arguments."""
    parser.add_argument("controls", metavar="CONTROLS.csv", help="left, right, lift as field.point.x, y, z")
    parser.add_argument("pose", metavar="POSE.csv", help="x, y [m], psi [rad] as field.point.x, y, z")
    parser.add_argument("-o", "--output", metavar="RUN.bag", required=True)
    parser.add_argument("--force", action="store_true", help="overwrite the bag")


def run(arguments: argparse.Namespace) -> Document:
    """Runs the verb; returns what --json prints."""
    files.refuse_existing(arguments.output, arguments.force)
    counts = csv_exports.write_bag(
        arguments.controls, arguments.pose, arguments.output, arguments.force, arguments.work
    )
    command_line.say(
        arguments, "%s: %d poses, %d commands" % (arguments.output, counts["pose"], counts["controls"])
    )
    return {"bag": arguments.output, "messages": counts}
