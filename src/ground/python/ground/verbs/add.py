"""identify add: adds a physical effect to a model and refits it, with the error before and after."""

import argparse
from typing import Iterator

from ground import files
from ground.annotations import Document
from ground.api import adding
from ground.verbs import common


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the verb's arguments."""
    parser.add_argument(
        "effect",
        metavar="EFFECT",
        help="name of an effect of the library, or a YAML file with one effect as model files have it",
    )
    common.add_bag_arguments(parser)
    common.add_span_arguments(parser)
    parser.add_argument("--model", metavar="M.yaml", required=True, help="model that it is added to")
    parser.add_argument("-o", "--output", metavar="N.yaml", required=True)
    common.add_holdout_argument(parser)
    common.add_misread_argument(parser)
    parser.add_argument("--force", action="store_true", help="overwrite the model file")


def run(arguments: argparse.Namespace) -> Document:
    """Runs the verb; returns what --json prints."""
    files.refuse_existing(arguments.output, arguments.force)
    found = adding.add(
        arguments.model,
        arguments.effect,
        common.reading(arguments, arguments.bags),
        holdout=common.reading(arguments, arguments.holdout),
        start=arguments.start,
        end=arguments.end,
        everything=arguments.all,
        as_recorded=arguments.as_recorded,
        progress=arguments.work,
    )
    found.save(arguments.output, arguments.force)
    for line in _lines(arguments, found):
        common.say(arguments, line)
    return {"model": arguments.output, **found.to_dict()}


def _lines(arguments: argparse.Namespace, found: adding.Addition) -> Iterator[str]:
    yield "%-28s %12s %12s   %s" % ("parameter", "without", "with", "95% interval")
    for name, p in found.parameters.items():
        was = found.parameters_before.get(name)
        yield "%-28s %12s %12.4g   %s" % (
            name,
            "" if was is None else "%.4g" % was.value,
            p.value,
            "%s %s" % (p.interval, p.unit) if p.identified else p.interval,
        )
    words = {
        "fit": "the runs fitted to",
        "heldout": "held out: " + found.folds,
        "holdout": "the runs given with --holdout",
    }
    yield ""
    yield "%-48s %8s %8s %8s %8s" % ("error over windows of 1.5 s", "u", "v", "r", "all")
    for name, pair in found.error.items():
        yield words[name]
        yield _row("before", pair.before)
        yield _row("after", pair.after)
        yield "  %-46s %35s" % ("", "%+.0f%%" % (100 * pair.change))
    yield _row("noise of the poses alone", found.noise_floor, "")
    yield "written to %s" % arguments.output
    yield found.verdict.sentence


def _row(name: str, errors: adding.ChannelErrors, indent: str = "  ") -> str:
    numbers = errors.u, errors.v, errors.r, errors.error
    return "%-48s %8.3f %8.3f %8.3f %8.3f" % (indent + name, *numbers)
