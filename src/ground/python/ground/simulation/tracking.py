"""A controller in closed loop with a simulated craft: its tracking error and effort."""

from dataclasses import dataclass, field
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.annotations import Array, Document
from ground.errors import GroundError
from ground.progress import Work
from ground.recordings import tracks
from ground.simulation import gains
from ground.workers import Workers

CONTROLLERS = list(gains.CONTROLLERS)
KINDS = {info.name: info for info in _core.reference_table()}
PLACES = {"origin": ("x", "y"), "end": ("end_x", "end_y")}  # options that set parameters of references
SPREAD = 0.02  # standard deviation of starts, of all states [m, rad, m/s, rad/s]
AFTER_STOP = 3.0  # time after the end of a reference until the craft has to be there [s]
# Numbers of a run that ended before its errors counted
NEVER_SETTLED = dict(rms=np.inf, max=np.inf, final=np.inf, saturated_fraction=1.0, effort=0.0)
# The thesis's references: parameters, and the window in which errors count [s].
REFERENCES: Dict[str, Tuple[Dict[str, Any], Optional[Tuple[float, float]]]] = {
    "circle": (dict(size=2.0, rate_of_turn=0.6), (20.0, 60.0)),
    "line": (dict(speed=0.707, end_x=2.5, end_y=2.5, smooth=False), (0.0, 20.0)),
    "rhodonea": (dict(size=1.5, petals=1.5, rate_of_turn=0.4), (20.0, 60.0)),
    "sinusoid": (dict(speed=0.5, size=1.0, rate_of_turn=0.6), (20.0, 60.0)),
}


Start = Tuple[Array, Array]  # pose x, y [m], psi [rad], and velocity u, v [m/s], r [rad/s]


@dataclass
class Task:
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
    loss: float = 0.0  # share of mocap frames lost


@dataclass
class Tracked:
    """One run. Arrays are over the frames; times since the reference began [s]."""

    times: Array  # (n,)
    eta: Array  # (n, 3) true x, y [m], psi [rad], world_ned
    reference: Array  # (n, 2) x, y [m]
    # (k, 2 + 2 n) time, processor time [s], inputs (of full scale), inputs before they were limited
    decisions: Array
    numbers: Document = field(default_factory=dict)

    @property
    def errors(self) -> Array:
        """Distance from the reference (n,) [m]."""
        return np.asarray(np.hypot(*(self.eta[:, :2] - self.reference).T))

    @property
    def inputs(self) -> Array:
        """Rows of time and inputs (of full scale)."""
        return self.decisions[:, [0, *range(2, self._middle)]]

    @property
    def wanted(self) -> Array:
        """Rows of time and inputs before they were limited (full scale is 1)."""
        return self.decisions[:, [0, *range(self._middle, self.decisions.shape[1])]]

    @property
    def computing(self) -> Array:
        """Rows of time, processor time of a decision [s]."""
        return self.decisions[:, :2]

    @property
    def _middle(self) -> int:
        """Column of the first wanted input."""
        return 1 + self.decisions.shape[1] // 2


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
                "reference %s does not take '%s'; it takes %s" % (kind, name, ", ".join(KINDS[kind].takes))
            )
        setattr(params, name, value)
    return params


def task(kind: str, settled: Optional[float] = None, until: Optional[float] = None, **settings: Any) -> Task:
    """The Task of a reference by its kind, or of a CSV file; the thesis's parameters are the defaults.
    GroundError as from `reference`."""
    if kind.lower().endswith(".csv"):
        kind, settings = "file", dict(settings, file=kind)
    defaults, window = REFERENCES.get(kind, ({}, None))
    reference_params = reference(kind, **{**defaults, **settings})
    if window is None:
        window = (0.0, reference_params.extent() + 2 * AFTER_STOP)
    return Task(
        reference_params,
        window[0] if settled is None else settled,
        window[1] if until is None else until,
    )


def starts(count: int, seed: int, spread: float = SPREAD) -> List[Start]:
    """(pose, velocity) of `count` starts, normally spread about rest at the origin."""
    random = np.random.default_rng(seed)
    return [(s[:3], s[3:]) for s in spread * random.standard_normal((count, 6))]


def anywhere(count: int, seed: int, reach: float) -> List[Start]:
    """(pose, velocity) of `count` starts at rest, within +-reach [m], any heading."""
    random = np.random.default_rng(seed)
    places = random.uniform(-1, 1, (count, 3)) * [reach, reach, np.pi]
    return [(place, np.zeros(3)) for place in places]


def effect_use(kind: str, model: _core.Model) -> Document:
    """How a kind of controller uses the effects of its model: `used` and `unused` ones, and a `remark`
    for users. GroundError when it must not use the model."""
    use = _core.effect_use(kind, model)
    if use["refusal"]:
        raise GroundError(use["refusal"])
    return use


def run(
    truth: _core.Model,
    believed: _core.Model,
    controller: _core.ControllerChoice,
    task: Task,
    start: Optional[Start] = None,
    conditions: Optional[Conditions] = None,
    seed: int = 1,
    rate: float = 50.0,
    max_error: float = 0.0,
) -> Tracked:
    """Tracks a Task once with a _core.ControllerChoice that uses the model `believed`.

    start: pose x, y [m], psi [rad], world_ned, and velocity u, v [m/s], r [rad/s], body. max_error:
    error beyond which the controller stops itself [m], 0: by the reference's size, inf: never.
    Raises GroundError when the motion is not finite, ValueError on bad parameters. A controller
    that stopped itself has infinite errors.
    """
    conditions = conditions or Conditions()
    params = _core.TrackingParams()
    params.reference, params.controller = task.reference, controller
    params.life.rate, params.duration, params.max_error = rate, task.until, max_error
    params.estimate = conditions.noise
    params.start, params.life.lift_time, params.tail = 0.0, 0.5 if conditions.noise else 0.0, 0.0
    mocap = _core.MocapParams()
    mocap.loss = conditions.loss
    mocap.latency = conditions.delay
    if not conditions.noise:
        mocap.rate, mocap.position_noise, mocap.heading_noise = rate, 0.0, 0.0
    pose, velocity = (np.zeros(3), np.zeros(3)) if start is None else start
    try:
        log = _core.track_reference(truth, believed, params, pose, velocity, mocap, seed)
    except RuntimeError as error:
        raise GroundError(str(error))
    if not len(log["references"]):
        raise GroundError("the controller stopped before it drove: %s" % log["stopped"])
    found = _tracked(log, task)
    if log["stopped"]:
        at = log["stopped_at"] - log["references"][0, 0]
        found.numbers.update(rms=np.inf, max=np.inf, stopped=log["stopped"], stopped_at=at)
    return found


def _tracked(log: Document, task: Task) -> Tracked:
    began = log["references"][0, 0]
    truth, decisions = log["truth"], log["decisions"]
    times = truth[:, 0] - began
    kept = times >= -1e-9
    times = times[kept]
    found = Tracked(
        times,
        truth[kept, 1:4],
        task.reference.sample(times),
        np.column_stack([decisions[:, 0] - began, decisions[:, 2], decisions[:, 3:]]),
    )
    found.numbers = _numbers(found, task)
    return found


def _numbers(found: Tracked, task: Task) -> Document:
    errors = found.errors
    counts = found.times >= task.settled - 1e-9
    at_work = found.decisions[:, 0] >= task.settled - 1e-9
    inputs, wanted = found.inputs[:, 1:], found.wanted[:, 1:]
    saturated = found.decisions[tracks.saturated(inputs), 0]
    measured = tracks.summary(errors[counts], inputs[at_work])
    numbers = {
        **{name: NEVER_SETTLED[name] if x is None else x for name, x in measured.items()},
        "final": float(errors[-1]),
        "last_saturation": float(saturated[-1]) if len(saturated) else None,
        "stopped": None,
        **tracks.wanted_summary(wanted[at_work]),
        "compute_ms": tracks.compute_ms(found.computing[:, 1]),
    }
    if task.ends:
        late = found.times >= task.reference.extent() + AFTER_STOP
        numbers["after_stop_max"] = float(errors[late].max()) if late.any() else None
    return numbers


def many(
    truth: _core.Model,
    believed: _core.Model,
    controller: _core.ControllerChoice,
    task: Task,
    starts: Sequence[Start],
    conditions: Optional[Conditions] = None,
    seed: int = 1,
    rate: float = 50.0,
    max_error: float = 0.0,
    work: Optional[Work] = None,
) -> List[Tracked]:
    """The Tracked of every start, each with its own seed; work: told of each."""
    told = work or Work()

    def one(i: int) -> Tracked:
        loop = (truth, believed, controller, task, starts[i], conditions)
        found = run(*loop, seed + i, rate, max_error)
        told.step()
        return found

    with Workers() as team:
        return list(team.map(one, range(len(starts))))


def perturbed(model: _core.Model, factors: Dict[str, float]) -> _core.Model:
    """The model with parameters multiplied by factors, {name: factor}."""
    moved = model.copy()
    for name, factor in factors.items():
        moved.set_value(name, moved.value(name) * factor)
    return moved


def pooled(runs: Sequence[Tracked]) -> Document:
    """Numbers of several runs in one dict: medians, and 5, 50, 95% of the error."""
    numbers = [r.numbers for r in runs]
    result: Document = {
        name: float(np.median([n[name] for n in numbers]))
        for name in ("rms", "max", "final", "saturated_fraction", "effort")
    }
    for name in ("wanted_outside", "wanted_largest"):
        values = [n[name] for n in numbers if n[name] is not None]
        result[name] = float(np.median(values)) if values else None
    last = [n["last_saturation"] for n in numbers if n["last_saturation"] is not None]
    result["last_saturation"] = float(np.median(last)) if last else None
    late = [n["after_stop_max"] for n in numbers if n.get("after_stop_max") is not None]
    if len(late) == len(numbers):
        result["after_stop_max"] = float(np.median(late))
    result["compute_ms"] = tracks.compute_ms(np.concatenate([r.computing[:, 1] for r in runs]))
    errors = [n["rms"] for n in numbers]
    result["rms_quantiles"] = {
        "p05": quantile(errors, 0.05),
        "median": quantile(errors, 0.5),
        "p95": quantile(errors, 0.95),
    }
    result["stopped"] = sum(n["stopped"] is not None for n in numbers)
    result["stops"] = [
        {"run": i + 1, "time": n["stopped_at"], "reason": n["stopped"]}
        for i, n in enumerate(numbers)
        if n["stopped"] is not None
    ]
    return result


def quantile(values: Sequence[float], share: float) -> float:
    """A quantile that is one of the values, so that infinite ones do not matter."""
    return float(np.sort(values)[int(share * (len(values) - 1) + 0.5)])
