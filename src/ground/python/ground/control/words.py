"""Numbers of drives in words, and their pictures."""

import argparse
import math
from typing import Callable, Dict, Iterator

from ground.support import files
from ground.support.annotations import Document
from ground.support.errors import GroundError


def effort_lines(numbers: Document) -> Iterator[str]:
    """Lines on the inputs of a drive, simulated or recorded; numbers that are None were not
    recorded."""
    if numbers["saturated_fraction"] is not None:
        yield "saturated  %.1f%% of the time" % (100 * numbers["saturated_fraction"])
        yield "effort     %.3f (mean square of the inputs)" % numbers["effort"]
    if numbers["wanted_outside"] is not None:
        wanted = 100 * numbers["wanted_outside"], numbers["wanted_largest"]
        yield "wanted     outside 0..1 for %.1f%% of the time, %.2f at most" % wanted
    if numbers["compute_ms"] is not None:
        yield (
            "computing  %(median).3f ms median, %(p999).3f ms 99.9%%, %(max).3f ms at most, "
            "per decision" % numbers["compute_ms"]
        )


def metres(value: float) -> str:
    """A length in mm below 0.1 m, else in m."""
    if not math.isfinite(value):
        return "not finite"
    return "%.2f mm" % (1e3 * value) if value < 0.1 else "%.3f m" % value


def add_picture(parser: argparse.ArgumentParser, shows: str) -> None:
    """Adds --picture to a verb."""
    help = "page with %s, each of which the page saves as a PNG" % shows
    parser.add_argument("--picture", metavar="FILE.html", help=help)


def refuse_picture(arguments: argparse.Namespace) -> None:
    """GroundError when the picture that was asked for cannot be written."""
    if arguments.picture:
        if not arguments.picture.endswith(".html"):
            raise GroundError("%s: a picture is a page: name a file that ends with .html" % arguments.picture)
        files.refuse_existing(arguments.picture, arguments.force)


def draw(
    arguments: argparse.Namespace, figure: Callable[[], Dict[str, object]], result: Dict[str, object]
) -> None:
    """Writes the picture that was asked for, and its name into the result."""
    if not arguments.picture:
        return
    from ground.reports import page

    page.write_figures(arguments.picture, [figure()], arguments.force)
    result["picture"] = arguments.picture
