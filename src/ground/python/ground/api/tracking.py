"""track: a controller in closed loop with a simulated craft."""

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Dict, List, Mapping, Optional, Tuple, Union

import numpy as np

from ground import _core
from ground.annotations import Array, Document, Path
from ground.api.models import Model, ModelLike
from ground.api.values import Row, Shown
from ground.core_types import EffectUse
from ground.errors import GroundError
from ground.progress import Work
from ground.simulation import gains as gain_files
from ground.simulation import tracking
from ground.simulation.tracking import Tracked

if TYPE_CHECKING:
    import pandas

DRIVING = "simulating drives"  # stage; unit: a drive

Gains = Union[Path, Mapping[str, float]]
Start = Tuple[
    Array, Array
]  # pose x, y [m], psi [rad], world_ned; velocity u, v [m/s], r [rad/s], body


@dataclass(frozen=True, repr=False)
class Tracking(Shown):
    """How a controller followed a reference, from one start or several."""

    controller: str
    reference: str
    runs: List[Tracked]  #: a run from each start
    numbers: Dict[
        str, Any
    ]  # medians over the runs: rms, max, final [m], saturated_fraction, effort, ...
    window: Tuple[float, float]  #: start and end of what errors count, since the reference began [s]
    max_error: float  #: error at which a controller stops itself [m]
    caution: str  #: why the craft cannot follow the reference exactly; empty when it can
    remark: str  #: how the controller uses the model's effects; empty when nothing is odd
    effects: Dict[str, List[str]]  #: effects that the controller has used and unused
    gains: Document
    seed: Optional[int]

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
        """Run, time [s] and reason of each that ended early."""
        return list(self.numbers["stops"])

    def to_dict(self) -> Document:
        """Plain values, as `track --json` prints them but for the names of files."""
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

    def to_frame(self) -> "pandas.DataFrame":
        """Every frame of every run: run, t [s] since the reference began, x, y [m], psi [rad],
        x_reference, y_reference, error [m]."""
        import pandas

        rows = [
            np.column_stack(
                [np.full(len(run.times), i), run.times, run.eta, run.reference, run.errors]
            )
            for i, run in enumerate(self.runs, 1)
        ]
        columns = ["run", "t", "x", "y", "psi", "x_reference", "y_reference", "error"]
        return pandas.DataFrame(np.vstack(rows), columns=columns).astype({"run": int})

    def _table(self) -> Tuple[str, Row, List[Row]]:
        title = "%s on %s, %g to %g s" % (self.controller, self.reference, *self.window)
        rows = [
            [
                str(i),
                "%.4f" % run.numbers["rms"],
                "%.4f" % run.numbers["max"],
                "%.1f" % (100 * run.numbers["saturated_fraction"]),
                run.numbers["stopped"] or "",
            ]
            for i, run in enumerate(self.runs, 1)
        ]
        return title, ["run", "rms [m]", "largest [m]", "saturated [%]", "stopped"], list(rows)


def track(
    model: ModelLike,
    reference: str = "circle",
    *,
    controller: str = "TrajectoryTracking",
    gains: Optional[Gains] = None,
    truth: Optional[ModelLike] = None,
    perturb: Optional[Mapping[str, float]] = None,
    noise: bool = False,
    delay: float = 0.0,
    loss: float = 0.0,
    rate: float = 50.0,
    max_error: float = 0.0,
    seed: Optional[int] = None,
    starts: int = 1,
    spread: float = tracking.SPREAD,
    anywhere: Optional[float] = None,
    settled: Optional[float] = None,
    end_time: Optional[float] = None,
    **settings: Any,
) -> Tracking:
    """A controller that follows a reference in closed loop with a simulated craft, without ROS.

    model: the controller's model. reference: its kind, or a CSV file. controller: its kind. gains:
    names and values, or a file of them. truth: the true model of the craft (default: model).
    perturb: factors on parameters of the craft. noise: mocap noise and the estimator; else the
    controller knows the true state. delay: from measurement to command [s]. loss: share of frames
    lost. rate: the controller's [Hz]. max_error: error at which the controller stops itself [m];
    0: by the reference's size, inf: never. seed: for noise and starts (None: one start, at rest at
    the origin). starts: how many; spread: 1 sigma of all their states; anywhere: instead, starts at
    rest up to this far off in x and y [m]. settled, end_time: errors count between these [s].
    settings: parameters of the reference, such as size [m], rate_of_turn [rad/s], petals, speed
    [m/s], x, y, end_x, end_y [m], smooth. GroundError when something does not exist or the motion is
    not finite.

    >>> found = ground.track(model_file, "circle", gains=gains_file, end_time=30, settled=20)
    >>> found.stopped, found.rms < 0.03  # [m]
    (False, True)
    """
    loop = prepare(
        model, reference, controller, gains, truth, perturb, settled, end_time, **settings
    )
    conditions = tracking.Conditions(noise, delay, loss)
    places = starts_of(starts, seed, spread, anywhere)
    return loop.run(places, conditions, seed, rate, max_error)


@dataclass(frozen=True)
class Loop:
    """A craft, a controller and a task, before they run."""

    truth: Model
    believed: Model
    choice: _core.ControllerChoice
    reference: str
    task: tracking.Task
    use: EffectUse  #: tracking.effect_use

    @property
    def remark(self) -> str:
        """How the controller uses the model's effects."""
        return str(self.use["remark"])

    @property
    def caution(self) -> str:
        """Why the craft cannot follow the reference exactly."""
        return str(self.task.reference.infeasibility(self.believed.core))

    def run(
        self,
        starts: List[Start],
        conditions: tracking.Conditions,
        seed: Optional[int] = None,
        rate: float = 50.0,
        max_error: float = 0.0,
        work: Optional[Work] = None,
    ) -> Tracking:
        """Runs from every start; work: told of each."""
        work = work or Work()
        first = 1 if seed is None else seed
        crafts = self.truth.core, self.believed.core
        loop = (*crafts, self.choice, self.task, starts, conditions, first, rate, max_error)
        try:
            with work.stage(DRIVING, len(starts)):
                runs = tracking.many(*loop, work=work)
        except ValueError as error:
            raise GroundError(str(error))
        return Tracking(
            controller=self.choice.kind,
            reference=self.reference,
            runs=runs,
            numbers=tracking.pooled(runs),
            window=(self.task.settled, self.task.until),
            max_error=max_error or self.task.reference.default_max_error(),
            caution=self.caution,
            remark=self.remark,
            effects={"used": self.use["used"], "unused": self.use["unused"]},
            gains=gain_files.get(self.choice),
            seed=seed,
        )


def prepare(
    model: ModelLike,
    reference: str,
    controller: str,
    gains: Optional[Gains] = None,
    truth: Optional[ModelLike] = None,
    perturb: Optional[Mapping[str, float]] = None,
    settled: Optional[float] = None,
    end_time: Optional[float] = None,
    **settings: Any,
) -> Loop:
    """The Loop from the arguments of `track`."""
    believed = Model.of(model)
    moves = believed if truth is None else Model.of(truth)
    try:
        moves = Model(tracking.perturbed(moves.core, dict(perturb or {})), moves.path)
    except ValueError as error:
        raise GroundError("--perturb: %s" % error)
    choice = _choice(controller, gains)
    use = tracking.effect_use(controller, believed.core)
    try:
        task = tracking.task(reference, settled, end_time, **settings)
    except (ValueError, RuntimeError) as error:
        raise GroundError(str(error))
    return Loop(moves, believed, choice, reference, task, use)


def _choice(controller: str, gains: Optional[Gains]) -> _core.ControllerChoice:
    if isinstance(gains, Mapping):
        choice = gain_files.choice(controller)
        gain_files.put(choice, dict(gains))
        return choice
    return gain_files.choice(controller, None if gains is None else os.fspath(gains))


def starts_of(
    count: int,
    seed: Optional[int] = None,
    spread: float = tracking.SPREAD,
    anywhere: Optional[float] = None,
) -> List[Start]:
    """Where and how fast the craft starts: at rest at the origin, or about it."""
    first = 1 if seed is None else seed
    if anywhere:
        return list(tracking.anywhere(count, first, anywhere))
    if count > 1 or seed is not None:
        return list(tracking.starts(count, first, spread))
    return [(np.zeros(3), np.zeros(3))]
