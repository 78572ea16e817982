"""track: a controller in closed loop with a simulated craft."""

import argparse
import os
from dataclasses import dataclass, make_dataclass
from typing import TYPE_CHECKING, Any, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np

from ground.analysis.tracks import Track
from ground.control.words import add_picture, draw, effort_lines, metres, refuse_picture
from ground.models import Model, ModelLike
from ground.reports import result_folder
from ground.simulation import gains as gain_files
from ground.simulation import laws, listing, tracking
from ground.support import command_line, files
from ground.support.annotations import Document, Path, Setting
from ground.support.command_line import count, option, positive, seconds, seed
from ground.support.docstrings import internal
from ground.support.errors import GroundError, OptionError, core_errors
from ground.support.headline import Line
from ground.support.progress import Progress, Work
from ground.support.results import Plotted, Shown

if TYPE_CHECKING:
    import pandas

SCHEMA = "ground/tracking/1"
# Arrays of a Track and their columns; 0: one for each thruster, and the time
COLUMNS = {"times": 1, "eta": 3, "reference": 2, "inputs": 0, "wanted": 0, "computing": 2}
MAX_STOPS = 5  # stops that are printed
DETAILS = (
    "\n"
    + listing.references()
    + "\n"
    + listing.controllers(gain_files.CONTROLLERS)
    + """
Errors [m] count from --settled to --end-time (20 to 60 s; a line and a file:
all of it). Without --noise the controller knows the true state at its rate;
with it, mocap_state estimates the state from a mocap of 100 Hz with noise of
0.3 mm and 5 mrad. --delay is the time from measurement to command. The craft
starts at rest at the origin; with --seed near it, and with --starts N from N
places, and medians are printed. As on the floor, a controller stops when the
error has been larger than --max-error for a second, or when the craft never
arrives; its errors then count as infinite.
"""
)


@dataclass(frozen=True, repr=False)
class Tracking(Shown, Plotted):
    """How a controller followed a reference, from one start or several.

    >>> found = ground.track(model_file, "circle", gains=gains_file, end_time=30, settled=20)
    >>> found.save("tracking.json")
    'tracking.json'
    >>> ground.load("tracking.json").rms == found.rms
    True
    """

    controller: str  #: kind of the controller
    reference: str  #: kind of the reference, or its file
    runs: List[Track]  #: one run per start
    #: medians over the runs: rms, max, final, after_stop_max [m], saturated_fraction, effort,
    #: wanted_outside, wanted_largest, compute_ms (median, p999, max), rms_quantiles (p05, p95); stopped
    #: (number of runs) and stops
    numbers: Dict[str, Any]
    window: Tuple[float, float]  #: start and end of the time in which errors count [s]
    max_error: float  #: error at which the controller stops itself [m]
    caution: str  #: why the craft cannot follow the reference exactly; empty when it can
    remark: str  #: how the controller uses the model's effects; empty when nothing is unusual
    effects: Dict[str, List[str]]  #: effects that the controller uses (used) and does not (unused)
    gains: Dict[str, Setting]  #: parameters of the controller, by name
    seed: Optional[int]  #: seed of noise and starts
    noise: Optional[bool] = None  #: whether the mocap had noise; None: not recorded

    @property
    def rms(self) -> float:
        """Root mean square of the distance from the reference, median over the runs [m]."""
        return float(self.numbers["rms"])

    @property
    def stopped(self) -> bool:
        """Whether the controller stopped itself in every run."""
        return int(self.numbers["stopped"]) == len(self.runs)

    @property
    def stops(self) -> List[Document]:
        """Runs that ended early: run, time [s] and reason."""
        return list(self.numbers["stops"])

    def to_dict(self) -> Dict[str, object]:
        """The result as plain values, as `track --json` prints them, without file names."""
        return {
            "seed": self.seed,
            "starts": len(self.runs),
            "window": list(self.window),
            "max_error": self.max_error,
            "caution": self.caution or None,
            "effects": self.effects,
            "gains": self.gains,
            **self.numbers,
        }

    def save(self, path: Path, force: bool = False) -> str:
        """Writes a JSON file, which `load` reads."""
        place = os.fspath(path)
        runs = [{k: v.tolist() if k in COLUMNS else v for k, v in vars(run).items()} for run in self.runs]
        files.write_json(place, {"schema": SCHEMA, **vars(self), "runs": runs}, force)
        return place

    @classmethod
    @internal
    def load(cls, path: Path) -> "Tracking":
        """The result that `save` wrote. GroundError when it cannot be read."""
        folder, name = os.path.split(os.path.abspath(os.fspath(path)))
        document = result_folder.read(folder, name, SCHEMA)
        del document["schema"]
        runs = []
        for run in document["runs"]:
            width = len(run["inputs"][0]) if run["inputs"] else 3
            rows = {k: np.array(run[k], float).reshape(-1, count or width) for k, count in COLUMNS.items()}
            rows["times"] = rows["times"][:, 0]
            run.update(rows, numbers=_endless(run["numbers"]))
            runs.append(Track(**run))
        document.update(runs=runs, numbers=_endless(document["numbers"]), window=tuple(document["window"]))
        document["max_error"] = np.inf if document["max_error"] is None else document["max_error"]
        return cls(**document)

    def to_frame(self) -> "pandas.DataFrame":
        """One row per frame of each run: run, t [s] since the reference began, x, y [m], psi [rad],
        x_reference, y_reference, error [m]."""
        import pandas

        rows = [
            np.column_stack([np.full(len(run.times), i), run.times, run.eta, run.reference, run.errors])
            for i, run in enumerate(self.runs, 1)
        ]
        columns = ["run", "t", "x", "y", "psi", "x_reference", "y_reference", "error"]
        return pandas.DataFrame(np.vstack(rows), columns=columns).astype({"run": int})

    def headline(self, written: str = "") -> List[Line]:
        """First lines of the report: how well the controller follows, and what to do next."""
        numbers, many = self.numbers, len(self.runs) > 1
        starts = ", medians of %d starts" % len(self.runs) if many else ""
        error = "%s rms, %s at most" % (metres(numbers["rms"]), metres(numbers["max"]))
        if many:
            ends = tuple(metres(numbers["rms_quantiles"][q]) for q in ("p05", "p95"))
            error += " (%s to %s rms from 5 to 95%% of the starts)" % ends
        if self.noise is False:
            error += ", without noise of the mocap"
        if not np.isfinite(numbers["rms"]):
            error = "not known, because %d of %d runs ended early" % (numbers["stopped"], len(self.runs))
        followed = "%s on %s, %g to %g s%s" % (self.controller, self.reference, *self.window, starts)
        return [
            ("Followed", followed),
            ("Distance", error),
            *[("Controller", self.remark)] * bool(self.remark),
            ("Next", self._next()),
            *[("Picture", written)] * bool(written),
        ]

    def _next(self) -> str:
        """What to do next."""
        if self.numbers["stopped"]:
            stop = self.stops[0]
            ended = "%d of %d runs ended early, the first at %.2f s: %s"
            ended %= (self.numbers["stopped"], len(self.runs), stop["time"], stop["reason"])
            if self.caution:
                return "choose an easier reference: %s; %s" % (self.caution, ended)
            return ended + (
                "; give other gains (of a craft that comes with ground, such as tiny_whoover, or from the "
                "program tune) or an easier reference"
            )
        if self.caution:
            return "choose an easier reference, or accept the error: " + self.caution
        return "nothing needed; sim_tracking.launch runs the same controller with all nodes"

    def details(self) -> Iterator[str]:
        """Lines of text: inputs, computing time, and runs that ended early."""
        numbers = self.numbers
        if numbers.get("after_stop_max") is not None:
            after = metres(numbers["after_stop_max"]), tracking.AFTER_STOP
            yield "after stop %s at most, from %g s after the end on" % after
        yield from effort_lines(numbers)
        for stop in self.stops[:MAX_STOPS]:
            yield "stopped    run %(run)d at %(time).2f s: %(reason)s" % stop
        if len(self.stops) > MAX_STOPS:
            yield "           and %d more" % (len(self.stops) - MAX_STOPS)


def _endless(numbers: Document) -> Document:
    """Numbers from JSON, which has null for the infinite errors of a controller that stopped."""
    found = {k: np.inf if v is None and k in ("rms", "max", "final") else v for k, v in numbers.items()}
    for name, value in found.get("rms_quantiles", {}).items():
        found["rms_quantiles"][name] = np.inf if value is None else value
    return found


def _factor(text: str) -> Tuple[str, float]:
    name, separator, factor = text.partition("=")
    try:
        value = float(factor)
    except ValueError:
        value = np.nan
    if not separator or not np.isfinite(value):
        raise argparse.ArgumentTypeError("'%s' is not NAME=FACTOR" % text)
    return name, value


@dataclass(frozen=True)
class _TrackOptions:
    """A controller, a craft, and the conditions of the loop."""

    controller: Union[str, laws.Law] = option(
        "TrajectoryTracking", "control law (%(default)s)", choices=list(gain_files.CONTROLLERS)
    )
    truth: Optional[ModelLike] = option(None, "true model of the craft (--model)", metavar="T.yaml")
    gains: Optional[gain_files.Gains] = option(
        None, "gains: a file that tune writes, or included ones such as tiny_whoover", metavar="G.yaml"
    )
    perturb: Union[Mapping[str, float], Sequence[Tuple[str, float]]] = option(
        (),
        "parameters of the craft to multiply: k=0.85 I_z=1.15",
        type=_factor,
        nargs="+",
        metavar="NAME=FACTOR",
    )
    noise: bool = option(False, "mocap noise, and the estimator")
    delay: float = option(0.0, "time from measurement to command [s]", type=seconds, metavar="S")
    rate: float = option(50.0, "decisions per second (%(default)g)", type=positive, metavar="HZ")
    seed: Optional[int] = option(None, "seed of noise and start (without: starts at the origin)", type=seed)
    smooth: bool = option(False, "line, waypoints: start and stop gently")
    settled: Optional[float] = option(None, "time from which errors count [s]", type=seconds, metavar="S")
    end_time: Optional[float] = option(None, "time to which errors count [s]", type=positive, metavar="S")
    max_error: float = option(
        0.0,
        "error at which it stops, inf for never (a quarter of the reference's half-width, 0.05 to 0.5)",
        type=command_line.above_zero,
        metavar="M",
    )
    starts: int = option(1, "number of starts near the origin (%(default)s)", type=count, metavar="N")


#: What is tracked: _TrackOptions, and parameters of references.
TrackOptions = make_dataclass(
    "TrackOptions",
    list(listing.reference_fields()),
    bases=(_TrackOptions,),
    namespace={"__module__": __name__},
    frozen=True,
)


@command_line.takes(TrackOptions)
def track(
    model: ModelLike,
    reference: str = "circle",
    *,
    progress: Progress = None,
    options: _TrackOptions,
    **settings: Any,
) -> Tracking:
    """Follows a reference with a controller, in closed loop with a simulated craft and without ROS.

    A `controller` of your own is a function of a measured state (eta, nu), the reference (p, p_dot, p_ddot,
    p_dddot) and the time since it began [s], and gives the inputs of the thrusters, 0..1.

    Parameters
    ----------
    model : Model or path
        The model that the controller uses.
    reference : str or path, default 'circle'
        Kind of the reference, or path of a CSV file.
    **settings
        Further parameters of the reference, such as x, y, end_x, end_y [m].

    Raises
    ------
    GroundError
        When an option or a file does not exist, the motion is not finite, or your own function fails.

    Examples
    --------
    >>> found = ground.track(model_file, "circle", gains=gains_file, end_time=30, settled=20)
    >>> found.stopped, found.rms < 0.03  # [m]
    (False, True)
    """
    own = options.controller if callable(options.controller) else None
    if own and options.gains is not None:
        raise OptionError("{0} are not for a function: leave them out", "gains")
    believed = Model.of(model)
    moves = believed if options.truth is None else Model.of(options.truth)
    try:
        truth = tracking.perturbed(moves.core, dict(options.perturb))
    except (TypeError, ValueError) as error:
        raise OptionError("{0}: {why}", "perturb", why=error)
    use = tracking.EffectUse([], [])
    if own:
        choice: tracking.Controller = laws.CheckedLaw(own, truth)
    else:
        choice = gain_files.choice(str(options.controller), options.gains)
        use = tracking.effect_use(choice.kind, believed.core)
    work, first = Work.of(progress), 1 if options.seed is None else options.seed
    places = [(np.zeros(3), np.zeros(3))]
    if options.starts > 1 or options.seed is not None:
        places = tracking.starts(options.starts, first)
    conditions = tracking.Conditions(options.noise, options.delay)
    with core_errors():
        given = {**command_line.given(options, ["smooth"]), **listing.reference_settings(options), **settings}
        task = tracking.task(reference, options.settled, options.end_time, **given)
        loop = (truth, believed.core, choice, task, places, conditions, first, work)
        with work.stage("simulating drives", len(places)):
            runs = tracking.many(*loop, rate=options.rate, max_error=options.max_error)
    return Tracking(
        controller=choice.kind,
        reference=reference,
        runs=runs,
        numbers=tracking.pooled(runs),
        window=(task.settled, task.until),
        max_error=options.max_error or task.reference.default_max_error(),
        caution=str(task.reference.infeasibility(believed.core)),
        remark=use.remark,
        effects={"used": use.used, "unused": use.unused},
        gains=dict(choice.values),
        seed=options.seed,
        noise=options.noise,
    )


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of track."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = DETAILS
    command_line.add_model(parser, "the controller's model")
    parser.add_argument("--reference", default="circle", metavar="KIND", help="see below (%(default)s)")
    command_line.add_options(parser, TrackOptions)
    command_line.add_details(parser)
    add_picture(parser, "path, error and inputs of the run")
    parser.add_argument("--force", action="store_true", help="overwrite the picture")


def run(arguments: argparse.Namespace) -> Dict[str, object]:
    """Runs track; returns what --json prints. GroundError when the controller stopped."""
    refuse_picture(arguments)
    options: _TrackOptions = command_line.options(arguments, TrackOptions)
    found = track(arguments.model, arguments.reference, options=options, progress=arguments.work)
    result = {
        "controller": arguments.controller,
        "model": arguments.model,
        "truth": arguments.truth or arguments.model,
        "reference": arguments.reference,
        **found.to_dict(),
    }

    def figure() -> Dict[str, object]:
        from ground.reports import tracking_figures

        name = "%s, %s" % (found.controller, found.reference)
        caption = tracking_figures.caption(name, found.runs[0].numbers)
        return tracking_figures.driven(found.runs[0], caption, found.window)

    draw(arguments, figure, result)
    command_line.say_result(arguments, found, arguments.picture or "")
    if found.stopped:
        raise GroundError("the controller stopped: at %(time).2f s: %(reason)s" % found.stops[0])
    return result
