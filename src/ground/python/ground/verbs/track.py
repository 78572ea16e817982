"""track: a controller in closed loop with a simulated craft."""

import argparse
from typing import Callable, Dict, Iterator, Tuple

import numpy as np

from ground import _core, files
from ground.annotations import Document
from ground.api import tracking as api
from ground.errors import GroundError
from ground.simulation import tracking
from ground.simulation.tracking import PLACES
from ground.verbs import common, listing


DETAILS = "\n" + listing.references() + "\n" + listing.controllers(tracking.CONTROLLERS) + """
Errors [m] count from --settled to --end-time (20 to 60 s; a line and a file: all of it). Without
--noise the controller knows the true state at its rate; with it, mocap_state estimates the state from
a mocap of 100 Hz with noise of 0.3 mm and 5 mrad. --delay is the time from measurement to command.
The craft starts at rest at the origin; with --seed near it, and with --starts N from N places, and
medians are printed. As on the floor, a controller stops when the error has been larger than
--max-error for a second, or when the craft never arrives; its errors then count as infinite.
"""

MAX_STOPS = 5  # stops that are printed

# options that set a parameter of the reference
NUMBERS: Dict[str, Callable[[str], float]] = {
    "size": common.positive,
    "rate_of_turn": float,
    "petals": float,
    "speed": common.positive,
}


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the verb's arguments."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = DETAILS
    _add_loop_arguments(parser)
    parser.add_argument("--reference", default="circle", metavar="KIND", help="see below (%(default)s)")
    for parameter in _core.reference_parameters():
        if parameter.name in NUMBERS:
            option = "--" + parameter.name.replace("_", "-")
            kind = NUMBERS[parameter.name]
            parser.add_argument(option, type=kind, **listing.option(parameter, None))
    for name in PLACES:
        parser.add_argument("--" + name, type=float, nargs=2, metavar=("X", "Y"))
    parser.add_argument("--smooth", action="store_true", help="line, waypoints: start and stop gently")
    parser.add_argument("--settled", type=common.seconds, metavar="S")
    parser.add_argument("--end-time", type=common.positive, metavar="S")
    parser.add_argument(
        "--max-error",
        type=_bound,
        default=0.0,
        metavar="M",
        help="error at which it stops, inf for never (a quarter of the reference's half-width, "
        "0.05 to 0.5)",
    )
    parser.add_argument("--starts", type=common.count, default=1, metavar="N")
    parser.add_argument(
        "--spread",
        type=common.positive,
        default=tracking.SPREAD,
        help="1 sigma of all states of N starts about rest at the origin (%(default)s)",
    )
    parser.add_argument(
        "--anywhere",
        type=common.positive,
        metavar="M",
        help="start at rest up to M metres off in x and y, any heading",
    )
    parser.add_argument(
        "--picture",
        metavar="FILE.png",
        help="path, error and inputs of the run; FILE.html: a page, which needs no Chromium",
    )
    parser.add_argument("--force", action="store_true", help="overwrite the picture")


def _add_loop_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds controller, craft, and conditions of the loop."""
    parser.add_argument("--controller", choices=tracking.CONTROLLERS, default="TrajectoryTracking")
    parser.add_argument("--model", required=True, metavar="M.yaml", help="the controller's model")
    parser.add_argument("--truth", metavar="T.yaml", help="true model of the craft (--model)")
    parser.add_argument("--gains", metavar="G.yaml", help="gains of the controller, as tune writes them")
    parser.add_argument(
        "--perturb",
        type=_factor,
        nargs="+",
        default=[],
        metavar="NAME=FACTOR",
        help="parameters of the craft to multiply: k=0.85 I_z=1.15",
    )
    parser.add_argument("--noise", action="store_true", help="mocap noise, and the estimator")
    parser.add_argument(
        "--delay", type=common.seconds, default=0.0, metavar="S", help="time from measurement to command [s]"
    )
    parser.add_argument("--loss", type=_share, default=0.0, help="share of frames lost, 0..1")
    parser.add_argument("--rate", type=common.positive, default=50.0, metavar="HZ", help="(50)")
    parser.add_argument("--seed", type=common.seed, help="for noise and start (start: the origin)")


def run(arguments: argparse.Namespace) -> Document:
    """Runs the verb; returns what --json prints. GroundError when the controller stopped."""
    if arguments.picture:
        files.refuse_existing(arguments.picture, arguments.force)
    loop = api.prepare(
        arguments.model,
        arguments.reference,
        arguments.controller,
        arguments.gains,
        arguments.truth,
        dict(arguments.perturb),
        arguments.settled,
        arguments.end_time,
        **_settings(arguments),
    )
    if loop.remark:
        common.say(arguments, "model      %s" % loop.remark)
    if loop.caution:
        common.say(arguments, "note: %s" % loop.caution)
    found = loop.run(
        api.starts_of(arguments.starts, arguments.seed, arguments.spread, arguments.anywhere),
        tracking.Conditions(arguments.noise, arguments.delay, arguments.loss),
        arguments.seed,
        arguments.rate,
        arguments.max_error,
        arguments.work,
    )
    result = {
        "controller": arguments.controller,
        "model": arguments.model,
        "truth": arguments.truth or arguments.model,
        "reference": arguments.reference,
        **found.to_dict(),
    }
    if arguments.picture:
        with arguments.work.stage("drawing the picture"):
            _draw(arguments, found)
        result["picture"] = arguments.picture
    _say(arguments, result)
    if found.stopped:
        raise GroundError("the controller stopped: %s" % _stop(found.stops[0]))
    return result


def _draw(arguments: argparse.Namespace, found: api.Tracking) -> None:
    """Draws the first run."""
    from ground.reports import picture, tracking_figures

    name = "%s, %s" % (found.controller, found.reference)
    caption = tracking_figures.caption(name, found.runs[0].numbers)
    shown = tracking_figures.driven(found.runs[0], caption, found.window)
    picture.write(arguments.picture, [shown], arguments.force)


def _settings(arguments: argparse.Namespace) -> Document:
    """Parameters of the reference that were given."""
    settings = {n: getattr(arguments, n) for n in NUMBERS if getattr(arguments, n) is not None}
    for name, places in PLACES.items():
        settings.update(zip(places, getattr(arguments, name) or ()))
    if arguments.smooth:
        settings["smooth"] = True
    return settings


def _say(arguments: argparse.Namespace, result: Document) -> None:

    def say(text: str) -> None:
        common.say(arguments, text)

    many = result["starts"] > 1
    say(
        "%s on %s, %g to %g s%s"
        % (
            result["controller"],
            result["reference"],
            result["window"][0],
            result["window"][1],
            ", medians of %d starts" % result["starts"] if many else "",
        )
    )
    say("error      %s rms, %s at most" % (metres(result["rms"]), metres(result["max"])))
    if many:
        q = result["rms_quantiles"]
        say(
            "           5 to 95%% of the starts: %s to %s rms"
            % (metres(q["p05"]), metres(q["p95"]))
        )
    if result.get("after_stop_max") is not None:
        say(
            "after stop %s at most, from %g s after the end on"
            % (metres(result["after_stop_max"]), tracking.AFTER_STOP)
        )
    for line in effort_lines(result):
        say(line)
    if result["stopped"]:
        say("stopped    %d of %d runs ended early" % (result["stopped"], result["starts"]))
    for stop in result["stops"][:MAX_STOPS]:
        say("           run %d %s" % (stop["run"], _stop(stop)))
    if len(result["stops"]) > MAX_STOPS:
        say("           and %d more" % (len(result["stops"]) - MAX_STOPS))


def effort_lines(numbers: Document) -> Iterator[str]:
    """Lines on the inputs of a drive, simulated or recorded; numbers that are None were not
    recorded."""
    if numbers["saturated_fraction"] is not None:
        yield "saturated  %.1f%% of the time" % (100 * numbers["saturated_fraction"])
        yield "effort     %.3f (mean square of the inputs)" % numbers["effort"]
    if numbers["wanted_outside"] is not None:
        yield "wanted     outside 0..1 for %.1f%% of the time, %.2f at most" % (
            100 * numbers["wanted_outside"],
            numbers["wanted_largest"],
        )
    if numbers["compute_ms"] is not None:
        yield (
            "computing  %(median).3f ms median, %(p999).3f ms 99.9%%, %(max).3f ms at most, "
            "per decision" % numbers["compute_ms"]
        )


def _stop(stop: Document) -> str:
    return "at %.2f s: %s" % (stop["time"], stop["reason"])


def metres(value: float) -> str:
    """A length in mm below 0.1 m, else in m."""
    return "%.2f mm" % (1e3 * value) if value < 0.1 else "%.3f m" % value


def _factor(text: str) -> Tuple[str, float]:
    name, separator, factor = text.partition("=")
    try:
        value = float(factor)
    except ValueError:
        value = np.nan
    if not separator or not np.isfinite(value):
        raise argparse.ArgumentTypeError("'%s' is not NAME=FACTOR" % text)
    return name, value


def _bound(text: str) -> float:
    value = float(text)
    if not value > 0:
        raise argparse.ArgumentTypeError("%s is not positive" % text)
    return value


def _share(text: str) -> float:
    value = float(text)
    if not 0 <= value < 1:
        raise argparse.ArgumentTypeError("%s is not between 0 and 1" % text)
    return value
