"""A controller in closed loop with a simulated craft: its tracking error and effort."""

from dataclasses import dataclass, replace
from typing import Any, Dict, List, Optional, Sequence, Tuple, Union

import numpy as np

from ground import _core
from ground.analysis import tracks
from ground.analysis.tracks import Track
from ground.simulation.experiments import DriveLog, logged
from ground.simulation.laws import CheckedLaw
from ground.support.annotations import Array
from ground.support.errors import GroundError, core_error
from ground.support.progress import Work
from ground.support.workers import Workers

KINDS = {info.name: info for info in _core.reference_table()}
SPREAD = 0.02  # standard deviation of starts, of all states [m, rad, m/s, rad/s]
AFTER_STOP = 3.0  # time after the end of a reference until the craft has to be there [s]
# Numbers of a run that ended before its errors counted
NEVER_SETTLED = dict(rms=np.inf, max=np.inf, saturated_fraction=1.0, effort=0.0)
POOLED = ("rms", "max", "final", "saturated_fraction", "effort", "wanted_outside", "wanted_largest")
SHARES = {"p05": 0.05, "median": 0.5, "p95": 0.95}
# The thesis's references: parameters, and the window in which errors count [s].
REFERENCES: Dict[str, Tuple[Dict[str, float], Optional[Tuple[float, float]]]] = {
    "circle": (dict(size=2.0, rate_of_turn=0.6), (20.0, 60.0)),
    "line": (dict(speed=0.707, end_x=2.5, end_y=2.5, smooth=False), (0.0, 20.0)),
    "rhodonea": (dict(size=1.5, petals=1.5, rate_of_turn=0.4), (20.0, 60.0)),
    "sinusoid": (dict(speed=0.5, size=1.0, rate_of_turn=0.6), (20.0, 60.0)),
}


Controller = Union[_core.ControllerChoice, CheckedLaw]
Start = Tuple[Array, Array]  # pose x, y [m], psi [rad], and velocity u, v [m/s], r [rad/s]


@dataclass
class TrackingTask:
    """A reference and the window in which errors count, [s] since the reference began."""

    reference: _core.ReferenceParams
    settled: float
    until: float

    @property
    def ends(self) -> bool:
        """Whether the reference comes to a stop."""
        return KINDS[self.reference.kind].ends


@dataclass
class Conditions:
    """Conditions of the loop."""

    noise: bool = False  # whether the state is estimated from a noisy mocap; else it is the true one
    delay: float = 0.0  # time from measurement to command [s]
    # how long the battery lasts at full power [s], 0 without one, and its charge at the start
    battery: Tuple[float, float] = (0.0, 1.0)


def reference(kind: str, **settings: Any) -> _core.ReferenceParams:
    """The _core.ReferenceParams of a kind with these parameters (_core.reference_parameters);
    GroundError when there is no such kind or it does not take one of them."""
    if kind not in KINDS:
        raise GroundError(
            "the reference must be one of %s, or a .csv file, not '%s'"
            % (", ".join(name for name in KINDS if name != "file"), kind)
        )
    params = _core.ReferenceParams()
    params.kind = kind
    for name, value in settings.items():
        if name not in KINDS[kind].takes:
            raise GroundError(
                "reference %s has no parameter '%s'; it has %s" % (kind, name, ", ".join(KINDS[kind].takes))
            )
        setattr(params, name, value)
    return params


def task(
    kind: str, settled: Optional[float] = None, until: Optional[float] = None, **settings: Any
) -> TrackingTask:
    """The TrackingTask of a reference by its kind, or of a CSV file; the thesis's parameters are the
    defaults. GroundError as from `reference`."""
    if kind.lower().endswith(".csv"):
        kind, settings = "file", dict(settings, file=kind)
    defaults, window = REFERENCES.get(kind, ({}, None))
    reference_params = reference(kind, **{**defaults, **settings})
    if window is None:
        window = (0.0, reference_params.extent() + 2 * AFTER_STOP)
    until = window[1] if until is None else until
    settled = min(window[0], until / 2) if settled is None else settled
    if settled >= until:
        raise GroundError("errors count from %g to %g s: end_time must be after settled" % (settled, until))
    return TrackingTask(reference_params, settled, until)


def starts(count: int, seed: int, spread: float = SPREAD) -> List[Start]:
    """(pose, velocity) of `count` starts, normally spread about rest at the origin."""
    random = np.random.default_rng(seed)
    return [(s[:3], s[3:]) for s in spread * random.standard_normal((count, 6))]


@dataclass(frozen=True)
class EffectUse:
    """How a controller uses the effects of its model."""

    used: List[str]
    unused: List[str]
    remark: str = ""  # for users


def effect_use(kind: str, model: _core.Model) -> EffectUse:
    """The EffectUse of a kind of controller; GroundError when it must not use the model."""
    use = _core.effect_use(kind, model)
    if use["refusal"]:
        raise GroundError(use["refusal"])
    return EffectUse(use["used"], use["unused"], use["remark"])


def run(
    truth: _core.Model,
    believed: _core.Model,
    controller: Controller,
    task: TrackingTask,
    start: Optional[Start] = None,
    conditions: Optional[Conditions] = None,
    seed: int = 1,
    rate: float = 50.0,
    max_error: float = 0.0,
) -> Track:
    """Tracks a TrackingTask once with a _core.ControllerChoice that uses the model `believed`, or with a law.

    start: pose x, y [m], psi [rad], world_ned, and velocity u, v [m/s], r [rad/s], body. max_error:
    error beyond which the controller stops itself [m], 0: by the reference's size, inf: never.
    Raises GroundError when the motion is not finite, ValueError on bad parameters. A controller
    that stopped itself has infinite errors.
    """
    conditions = conditions or Conditions()
    params = _core.TrackingParams()
    params.reference = task.reference
    if isinstance(controller, CheckedLaw):
        params.law = controller
    else:
        params.controller = controller
    params.life.rate, params.duration, params.max_error = rate, task.until, max_error
    params.estimate = conditions.noise
    params.start, params.life.lift_time, params.tail = 0.0, 0.5 if conditions.noise else 0.0, 0.0
    mocap = _core.MocapParams()
    mocap.latency = conditions.delay
    if not conditions.noise:
        mocap.rate, mocap.position_noise, mocap.heading_noise = rate, 0.0, 0.0
    pose, velocity = (np.zeros(3), np.zeros(3)) if start is None else start
    try:
        log = logged(
            _core.track_reference(
                truth, believed, params, pose, velocity, mocap, seed, battery=conditions.battery
            )
        )
    except RuntimeError as error:
        raise core_error(error)
    finally:
        if isinstance(controller, CheckedLaw) and controller.failure:
            raise controller.failure
    if not len(log.references):
        raise GroundError("the controller stopped before it drove: %s" % log.stopped)
    found = _track(log, task)
    return replace(found, numbers=_numbers(found, task, log))


def _track(log: DriveLog, task: TrackingTask) -> Track:
    began = log.references[0, 0]
    truth, decisions = log.truth, log.decisions
    times = truth[:, 0] - began
    kept = times >= -tracks.ROUNDING
    when, middle = decisions[:, 0] - began, (3 + decisions.shape[1]) // 2
    return Track(
        times[kept],
        truth[kept, 1:4],
        task.reference.sample(times[kept]),
        np.column_stack([when, decisions[:, 3:middle]]),
        np.column_stack([when, decisions[:, middle:]]),
        np.column_stack([when, decisions[:, 2]]),
    )


def _numbers(found: Track, task: TrackingTask, log: DriveLog) -> Dict[str, object]:
    measured = tracks.summary(found, task.settled)
    numbers = {n: NEVER_SETTLED.get(n) if value is None else value for n, value in measured.items()}
    numbers.update(final=float(found.errors[-1]), stopped=None)
    if task.ends:
        late = found.times >= task.reference.extent() + AFTER_STOP
        numbers["after_stop_max"] = float(found.errors[late].max()) if late.any() else None
    if log.stopped:
        at = log.stopped_at - log.references[0, 0]
        numbers.update(rms=np.inf, max=np.inf, stopped=log.stopped, stopped_at=at)
    return numbers


def many(
    truth: _core.Model,
    believed: _core.Model,
    controller: Controller,
    task: TrackingTask,
    starts: Sequence[Start],
    conditions: Optional[Conditions] = None,
    seed: int = 1,
    work: Optional[Work] = None,
    **options: float,
) -> List[Track]:
    """The Track of every start, each with its own seed; options: of `run`; work: told of each. A
    law flies one start after the other, because it may have a memory."""
    told = work or Work()

    def one(i: int) -> Track:
        found = run(truth, believed, controller, task, starts[i], conditions, seed + i, **options)
        told.step()
        return found

    team = Workers(count=1 if isinstance(controller, CheckedLaw) else None)
    return list(team.map(one, range(len(starts))))


def perturbed(model: _core.Model, factors: Dict[str, float]) -> _core.Model:
    """The model with parameters multiplied by factors, {name: factor}."""
    moved = model.copy()
    for name, factor in factors.items():
        moved.set_value(name, moved.value(name) * factor)
    return moved


def pooled(runs: Sequence[Track]) -> Dict[str, object]:
    """Numbers of several runs in one dict: medians, and 5, 50, 95% of the error."""
    numbers = [r.numbers for r in runs]

    def median(name: str) -> Optional[float]:
        values = [n[name] for n in numbers if n.get(name) is not None]
        return float(np.median(values)) if values else None

    has_ended = all(n.get("after_stop_max") is not None for n in numbers)
    stops = [(i, n) for i, n in enumerate(numbers, 1) if n["stopped"] is not None]
    return {
        **{name: median(name) for name in [*POOLED, *["after_stop_max"] * has_ended]},
        "compute_ms": tracks.compute_ms(np.concatenate([r.computing[:, 1] for r in runs])),
        "rms_quantiles": quantiles([n["rms"] for n in numbers]),
        "stopped": len(stops),
        "stops": [{"run": i, "time": n["stopped_at"], "reason": n["stopped"]} for i, n in stops],
    }


def quantiles(values: Sequence[float]) -> Dict[str, float]:
    """5, 50 and 95% of values, each of them one of the values, so that infinite ones do not matter."""
    ordered, most = np.sort(values), len(values) - 1
    return {name: float(ordered[int(share * most + 0.5)]) for name, share in SHARES.items()}
