"""A second opinion on what a model leaves: accelerations regressed on what was measured.

It shares neither likelihood nor filter with the diagnosis. The missing wrench is measured in the
weak form (Messenger and Bortz 2021): poses integrated against a smooth test function over short
windows, minus the same integral of the model's acceleration along the measured motion.

A push changes the velocity and the place of the craft, so that measured states seem to explain it.
Features are therefore functions of states that the model predicts from before the window, and stand
beside the wrench that was missing before (Granger 1969): what a push of any spectrum, fixed in the
craft or in the room, has done to the states is a function of that.
"""

import itertools
from dataclasses import dataclass
from typing import Any, Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import failure, residuals, study
from ground.analysis.likelihood import call
from ground.analysis.thinning import thinned
from ground.annotations import Array, Indices
from ground.errors import GroundError
from ground.recordings import repair

ARGUMENTS = ("heading", "place", "velocity", "command", "past", "time")
NAMES = {
    "heading": "the heading",
    "place": "the place",
    "velocity": "the velocities",
    "command": "the commands",
    "past": "the past",
    "time": "the time since the start",
}
HALF = 0.15  # half of the length of a window [s]
STEP = 0.05  # between centres of windows [s]
LEAD = 0.06  # from the state that features are predicted from to the window [s]
BLOCK = 0.6  # length of the blocks of which chance turns the sign [s]
TURNS = 1999  # number of draws of chance
LEVEL = 0.01  # probability that something is said where nothing is missing
MAX_P = LEVEL / len(ARGUMENTS)  # largest p-value of an argument that is said
MIN_SHARE = 0.1  # least share that is said
MIN_GAIN = 2.3  # least gain on runs not fitted to, in its standard deviations
TRIED = 5  # strongest parts that are tried on runs not fitted to
PAST = 0.9  # memory must be clearer by its inverse, because much looks like it
MAX_PARTS = 4  # largest number of parts that are found one after the other
MIN_WINDOWS = 60  # of all runs together
LATE = 1e-3  # delay of the commands that may be wrong [s]
CHANGE = 1e-3  # relative change of parameters for derivatives
GRID = 0.005  # between samples of the commands [s]
# Time constants of what was missing before [s]. More of them would fit what comes after, too.
PUSHES = (0.5, 6.0)
TIME = 4.0  # typical half of a run [s]
PERIODS = (0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0)  # of what repeats in time [s]
MIN_NEW = 0.02  # least part of a function that the nuisances do not explain
MOST = 4.0  # largest residual, in robust standard deviations
PASTS = (0.05, 0.2, 0.6, 2.0)  # time constants of the past [s]
WAVES = (0.8, 6.7)  # least and largest number of waves over the floor [1/m] ...
MAX_WAVES = 40  # ... and of those tried


@dataclass(frozen=True)
class Opinion:
    """What the accelerations that a model does not explain depend on."""

    arguments: Dict[str, Tuple[float, float]]  # share of the missing wrench, p-value
    share: float  # of all that is said, on runs that it was not fitted to
    interval: Tuple[float, float]  # 95% interval of the share
    says: Tuple[str, ...]  # arguments, strongest first; empty: nothing is missing


class _Part(NamedTuple):
    """A few functions of the same arguments."""

    arguments: Tuple[str, ...]
    columns: Array  # (n, 3, m) wrenches


class _Windows(NamedTuple):
    """The windows of one or more runs."""

    wrench: Array  # (n, 3) missing wrench, in parts of full thrust
    own: Array  # (n, 3, m) changes of it by the model's parameters; the last one by its thrust
    before: Array  # (n, 3, k) the wrench that was missing before
    parts: List[_Part]
    noise: Array  # (n, 3) variance that the poses' noise leaves
    block: Indices  # (n,)
    fold: Indices  # (n,)


class _Span(NamedTuple):
    """Where the windows of a run are."""

    rows: Indices  # (n, samples) of each window
    centre: Indices  # (n,)
    start: Indices  # (n,) where features are predicted from
    second: Array  # (n, samples) weights of poses: their sum is the mean second derivative
    between: Array  # (n, samples - 1) weights of what is constant between samples; their sum is 1
    at: Array  # (n, samples) weights of samples; their sum is 1


class _Scales(NamedTuple):
    """What is usual in all runs together."""

    middle: Array  # (2,) of the places
    size: float  # their standard deviation [m]
    speeds: Array  # (3,) root mean square of the velocities


def second_opinion(runs: Sequence[_core.RunData], model: _core.Model) -> Opinion:
    """What the accelerations of runs depend on that a fitted model does not explain.

    Raises GroundError when the runs have too few windows without a gap.
    """
    thin = [thinned(run) for run in runs]
    spans = [_span(run) for run in thin]
    scales = _scales(thin)
    found = [
        _windows(run, span, model, number, scales)
        for number, (run, span) in enumerate(zip(thin, spans))
        if span is not None
    ]
    if sum(len(f.wrench) for f in found) < MIN_WINDOWS:
        raise GroundError("the runs are too short for a second opinion")
    return _judged(_together(found))


def _scales(runs: Sequence[_core.RunData]) -> _Scales:
    place = np.concatenate([np.array(run.eta)[:, :2] for run in runs])
    nu = np.concatenate([np.array(run.nu) for run in runs])
    speeds = np.maximum(1e-6, np.sqrt((nu**2).mean(axis=0)))
    return _Scales(place.mean(axis=0), max(1e-3, float(place.std())), speeds)


# --- The missing wrench


def _span(run: _core.RunData) -> Optional[_Span]:
    """Windows of a run that have no gap; None without any."""
    times = np.array(run.times)
    if len(times) < 3:
        return None
    step = float(np.median(np.diff(times)))
    half = max(3, int(round(HALF / step)))
    lead = half + max(1, int(round(LEAD / step)))
    centre = np.arange(lead, len(times) - half, max(1, int(round(STEP / step))))
    length = times[centre + half] - times[centre - lead]
    centre = centre[length < (half + lead) * step + repair.MAX_GAP / 2]
    if not len(centre):
        return None
    rows = centre[:, None] + np.arange(-half, half + 1)
    s = (times[rows] - times[centre][:, None]) / (half * step)
    inside, cell = np.clip(1 - s**2, 0, None), np.gradient(s, axis=1)
    at = inside**4 * cell
    middle = (s[:, 1:] + s[:, :-1]) / 2
    between = np.clip(1 - middle**2, 0, None) ** 4 * np.diff(s, axis=1)
    # The second derivative of the test function (1 - s^2)^4, corrected to be exact for parabolas.
    second = (48 * s**2 * inside**2 - 8 * inside**3) * cell
    second *= 2 / (second * s**2).sum(axis=1, keepdims=True)
    powers = s[:, None] ** np.arange(3)[:, None]
    wrong = np.array([0.0, 0.0, 2.0]) - np.einsum("nat,nt->na", powers, second)
    products = np.einsum("nat,nt,nbt->nab", powers, at, powers)
    correction = np.linalg.solve(products, wrong[..., None])[..., 0]
    second += at * np.einsum("na,nat->nt", correction, powers)
    return _Span(
        rows,
        centre,
        centre - lead,
        second / (half * step) ** 2,
        between / between.sum(axis=1, keepdims=True),
        at / at.sum(axis=1, keepdims=True),
    )


def _windows(
    run: _core.RunData,
    span: _Span,
    model: _core.Model,
    number: int,
    scales: _Scales,
) -> _Windows:
    """The windows of a run, which has a number."""
    times, poses = np.array(run.times), np.array(run.poses if len(run.poses) else run.eta)
    heading = np.array(run.eta)[span.centre, 2]
    masses = [model.value("m"), model.value("m"), model.value("I_z")]
    inertia = np.array(masses) / failure.full_scale(model)

    def by_model(given: _core.Model) -> Array:
        accelerations = _accelerations(run, given)
        mean = np.einsum("nt,ntc->nc", span.between, accelerations[span.rows[:, :-1]])
        return _in_body(mean, heading) * inertia

    def measured() -> Array:
        relative = poses[span.rows] - poses[span.centre][:, None]
        return _in_body(np.einsum("nt,ntc->nc", span.second, relative), heading) * inertia

    def changes() -> Iterator[Array]:
        predicted = _predicted(run, span, model)[0]
        for changed, late, step in _changed(model):
            moved = _predicted(run, span, changed, late)[0] - predicted
            yield _in_body(np.einsum("nt,ntc->nc", span.second, moved), heading) * inertia / step

    wrench = measured() - by_model(model)
    level = np.array(run.noise) if len(run.noise) else np.zeros(3)
    at = times[span.centre]
    features = _Features(run, span, model, scales)
    return _Windows(
        wrench,
        np.stack(list(changes()), axis=2),
        _earlier(at, wrench, heading, features.heading),
        features.parts(),
        (span.second**2).sum(axis=1)[:, None] * (level * inertia) ** 2,
        1000 * number + ((at - at[0]) / BLOCK).astype(int),
        np.full(len(at), number),
    )


def _accelerations(run: _core.RunData, model: _core.Model) -> Array:
    """Mean acceleration (n - 1, 3) in the room, and in heading, by a model from each measured
    state to the next sample."""
    times, nu = np.array(run.times), np.array(run.nu)
    steps = [_core.Window(0, i, i + 1) for i in range(len(times) - 1)]
    found = call(_core.predict, model, run, steps, nu[:-1])
    eta, nu = np.array(found["eta"]), np.array(found["nu"])  # (n - 1, 2, 3)
    c, s = np.cos(eta[..., 2]), np.sin(eta[..., 2])
    rates = np.stack(
        [c * nu[..., 0] - s * nu[..., 1], s * nu[..., 0] + c * nu[..., 1], nu[..., 2]], 2
    )
    return np.asarray((rates[:, 1] - rates[:, 0]) / np.diff(times)[:, None])


def _in_body(vectors: Array, heading: Array) -> Array:
    """Turns vectors (n, 3) of the room into the body's frame."""
    c, s = np.cos(heading), np.sin(heading)
    x, y = vectors[:, 0], vectors[:, 1]
    return np.column_stack([c * x + s * y, c * y - s * x, vectors[:, 2]])


def _predicted(
    run: _core.RunData, span: _Span, model: _core.Model, late: float = 0.0
) -> Tuple[Array, Array]:
    """Poses and velocities (n, samples, 3) in the windows, by a model from before each window. late:
    delay of the commands beside the model's [s]."""
    if late:
        inputs = np.array(run.inputs)
        inputs[:, 0] += late
        eta, nu = np.array(run.eta), np.array(run.nu)
        run = _core.RunData(run.name, run.times, eta, nu, inputs, run.poses, run.noise, run.drives)
    count = int(span.rows[0, -1] - span.start[0])
    pieces = [_core.Window(0, int(i), int(i) + count) for i in span.start]
    found = call(_core.predict, model, run, pieces, np.array(run.nu)[span.start])
    inside = slice(-span.rows.shape[1], None)
    return np.array(found["eta"])[:, inside], np.array(found["nu"])[:, inside]


def _changed(model: _core.Model) -> Iterator[Tuple[_core.Model, float, float]]:
    """Models with one free parameter, or the delay of the commands, changed by a step each: model,
    delay, step; the thrust comes last."""
    yield model, LATE, LATE
    described = {p["name"]: p for p in model.parameters()}
    for name in sorted(study.free_parameters(model), key=lambda name: name == "k"):
        value = model.value(name)
        if not np.isfinite(value):
            continue
        step = CHANGE * (abs(value) or described[name]["scale"] or 1e-3)
        step = step if value + step <= described[name]["upper"] else -step
        changed = model.copy()
        changed.set_value(name, value + step)
        yield changed, 0.0, step


def _earlier(times: Array, wrench: Array, heading: Array, predicted: Array) -> Array:
    """What was missing before each window, (n, 3, k): at last, and means over some pasts, that have
    turned with the craft and that have not."""
    in_room = _in_body(wrench, -heading)
    last = np.searchsorted(times, times - 2 * HALF + 1e-6) - 1  # the last window that has ended
    columns = []
    for past in (None, *PUSHES):
        for values, turns in ((wrench, False), (in_room, True)):
            kept = values if past is None else _sums(times, values, past)
            kept = np.where(last[:, None] >= 0, kept[np.maximum(last, 0)], 0.0)
            columns.append(_in_body(kept, predicted) if turns else kept)
    found = np.stack(columns, axis=2)
    found[:, 2, 1::2] = 0  # a moment is the same in both
    return np.asarray(found)


def _sums(times: Array, values: Array, past: float) -> Array:
    """Sum of all values up to each time, with weights that fade with a time constant (n, m)."""
    found, total = np.empty_like(values), np.zeros(values.shape[1])
    fades = np.exp(-np.diff(times, prepend=times[0]) / past)
    for i, value in enumerate(values):
        total = fades[i] * total + value
        found[i] = total
    return found


# --- What it may depend on


class _Features:
    """Functions that the missing wrench of a run may be, as means over its windows. They take
    states that the model predicts from before each window; only what was before is measured."""

    def __init__(
        self, run: _core.RunData, span: _Span, model: _core.Model, scales: _Scales
    ) -> None:
        times = np.array(run.times)
        eta, nu = (values[:, ::2] for values in _predicted(run, span, model))
        self.weight = span.at[:, ::2] / span.at[:, ::2].sum(axis=1, keepdims=True)
        self.heading = eta[:, eta.shape[1] // 2, 2]
        self.c, self.s = np.cos(eta[..., 2]), np.sin(eta[..., 2])
        self.u, self.v, self.r = np.moveaxis(nu / scales.speeds, 2, 0)
        self.x, self.y = np.moveaxis(eta[..., :2] - scales.middle, 2, 0)
        self.size = scales.size
        self.t = times[span.rows[:, ::2]] - times[0]
        grid = np.arange(times[0] - 3, times[-1] + GRID, GRID)
        commands = _actuated(run, model, grid)
        at = np.clip(((times[span.rows[:, ::2]] - grid[0]) / GRID).astype(int), 0, len(grid) - 1)
        self.commands = np.moveaxis(commands[at], 2, 0)
        thrust = model.forces(commands[:, :-1]) / failure.full_scale(model)
        self.ahead, self.moment = thrust[at][..., 0], thrust[at][..., 2]
        self.pasts = {past: np.moveaxis(_faded(commands, GRID / past)[at], 2, 0) for past in PASTS}
        self.speeds = _speeds(run, span.start, scales.speeds)

    def parts(self) -> List[_Part]:
        """All of them."""
        found = [*self._of_heading(), *self._of_place(), *self._of_velocity()]
        return found + [*self._of_command(), *self._of_past(), *self._of_time()]

    def _mean(self, values: Array) -> Array:
        return np.asarray((np.broadcast_to(values, self.weight.shape) * self.weight).sum(axis=1))

    def _body(self, what: str, values: Sequence[Array], channels: str = "XYN") -> _Part:
        """Values (n, points), each in each of some channels."""
        means = np.stack([self._mean(value) for value in values], axis=1)
        chosen = np.eye(3)[["XYN".index(channel) for channel in channels]]
        columns = np.einsum("nj,kc->ncjk", means, chosen).reshape(len(means), 3, -1)
        return _Part(tuple(what.split()), columns)

    def _room(self, what: str, vectors: Sequence[Tuple[Array, Array]]) -> _Part:
        """Forces along x and y of the room."""
        wrenches = [(self.c * x + self.s * y, self.c * y - self.s * x, 0.0) for x, y in vectors]
        return self._wrenches(what, wrenches)

    def _fields(self, what: str, values: Sequence[Array]) -> _Part:
        """Values as forces along x and along y of the room."""
        return self._room(what, [v for f in values for v in ((f, 0.0 * f), (0.0 * f, f))])

    def _wrenches(self, what: str, wrenches: Sequence[Sequence[Any]]) -> _Part:
        columns = [np.stack([self._mean(w) for w in wrench], axis=1) for wrench in wrenches]
        return _Part(tuple(what.split()), np.stack(columns, axis=2))

    def _of_heading(self) -> Iterator[_Part]:
        c2, s2 = self.c**2 - self.s**2, 2 * self.c * self.s
        for first, second in ((self.c, self.s), (c2, s2)):
            yield self._body("heading", [first, second], "N")
            yield self._body("heading", [first, second], "XY")
        one = np.ones_like(self.c)
        yield self._room("heading", [(one, 0 * one), (0 * one, one)])
        x, y = self.c * self.u - self.s * self.v, self.s * self.u + self.c * self.v
        yield self._room("heading velocity", [(x, 0 * y), (0 * x, y), (y, x)])

    def _of_place(self) -> Iterator[_Part]:
        x, y = self.x / self.size, self.y / self.size
        yield self._fields("place", [x, y])
        yield self._room("place", [(x, y)])
        yield self._body("place", [x, y, x**2 + y**2], "N")
        yield self._fields("place", [x**2, x * y, y**2])
        far = np.hypot(x, y)
        yield self._room("place", [(x * far, y * far), (x * far**2, y * far**2)])
        apart = max(0.1 / self.size, (WAVES[1] - WAVES[0]) / MAX_WAVES)  # seen as different
        for wave in np.arange(WAVES[0], WAVES[1], apart):
            for place in (self.x, self.y):
                at = 2 * np.pi * place * wave
                yield self._fields("place", [np.sin(at), np.cos(at)])
        bumps = [np.exp(-2 * ((x - a) ** 2 + (y - b) ** 2)) for a in (-1, 0, 1) for b in (-1, 0, 1)]
        yield self._fields("place", bumps)
        yield self._body("place", bumps, "N")
        none = np.zeros_like(x)
        yield self._wrenches("place velocity", [(b * self.u, b * self.v, none) for b in bumps])
        yield self._wrenches("place velocity", [(none, none, b * self.r) for b in bumps])
        yield self._wrenches(
            "place command", [(b * self.ahead, none, b * self.moment) for b in bumps]
        )

    def _of_velocity(self) -> Iterator[_Part]:
        u, v, r = self.u, self.v, self.r
        speed, none = np.hypot(u, v), np.zeros_like(u)
        yield self._body("velocity", [u, v, r])
        yield self._body("velocity", [u * abs(u), v * abs(v), r * abs(r)])
        yield self._wrenches("velocity", [(speed * u, speed * v, none), (none, none, abs(r) * r)])
        slow = [w / np.hypot(w, 0.03) for w in (u, v, r)]
        along = [w / np.hypot(speed, 0.03) for w in (u, v)]
        yield self._wrenches("velocity", [(*along, none), (none, none, slow[2])])
        yield self._body("velocity", slow)
        yield self._body("velocity", [u**3, v**3, r**3])
        yield self._body("velocity", [u * v, u * r, v * r])
        yield self._body("velocity", [u**2, v**2, r**2])
        yield self._body("velocity", [abs(u), abs(v), abs(r)])
        ways = (u, v, r, speed, abs(v), abs(r))
        pushed = [(self.ahead * w, none, self.moment * w) for w in ways]
        yield self._wrenches("velocity command", pushed)
        yield self._body("velocity command", [self.ahead * w for w in (u, v, r)], "YN")
        yield self._body("velocity command", [self.moment * w for w in (u, v, r)], "XY")

    def _of_command(self) -> Iterator[_Part]:
        inputs, lift = self.commands[:-1], self.commands[-1]
        yield self._body("command", [*inputs])
        yield self._body("command", [a * b for a, b in itertools.combinations(inputs, 2)])
        yield self._body("command", [*inputs**2])
        yield self._body("command", [*inputs**3])
        none = np.zeros_like(lift)
        yield self._wrenches("velocity command", [(lift * self.u, lift * self.v, none)])
        yield self._wrenches("command", [(lift * self.ahead, none, lift * self.moment)])

    def _of_past(self) -> Iterator[_Part]:
        none = np.zeros_like(self.u)
        for commands in self.pasts.values():
            later = commands[:-1] - self.commands[:-1]
            yield self._body("past", [*later], "XN")
            yield self._body("past", [*later * self.commands[:-1]], "XN")
            yield self._body("past", [*later, *abs(later)], "Y")
        for speed in self.speeds:
            by_speed = [
                (self.ahead, none, self.moment),
                (self.u, self.v, none),
                (none, none, self.r),
            ]
            yield self._wrenches("past", [[speed[:, None] * w for w in b] for b in by_speed])

    def _of_time(self) -> Iterator[_Part]:
        t, none = self.t / TIME - 1, np.zeros_like(self.t)
        yield self._body("time", [t, t**2])
        yield self._body("time", [t], "X")
        yield self._body("time", [t], "Y")
        yield self._body("time", [t], "N")
        for w in (t, t**2):
            yield self._wrenches("time", [(w * self.ahead, none, w * self.moment)])
            yield self._wrenches("time", [(w * self.u, w * self.v, none), (none, none, w * self.r)])
        for period in PERIODS:
            at = 2 * np.pi * self.t / period
            yield self._body("time", [np.sin(at), np.cos(at)])


def _actuated(run: _core.RunData, model: _core.Model, grid: Array) -> Array:
    """Inputs of thrusters and lift (n, thrusters + 1) as the model's delay and lag pass them on."""
    delay = model.value("input_delay.delay") if "input_delay" in model.effects else 0.0
    commands = residuals.held(run, grid - delay)
    lag = model.value("motor_lag.tau") if "motor_lag" in model.effects else 0.0
    return _faded(commands, GRID / lag) if lag > 0 else commands


def _faded(values: Array, rate: float) -> Array:
    """Means of held values before each sample, with weights that fade (n, m)."""
    from scipy import signal  # slow to load

    keep = np.exp(-rate)
    return np.asarray(signal.lfilter([0.0, 1 - keep], [1.0, -keep], values, axis=0))


def _speeds(run: _core.RunData, start: Indices, scale: Array) -> List[Array]:
    """Mean speeds (n,) over some pasts, up to samples of a run."""
    nu = np.array(run.nu) / scale
    step = float(np.median(np.diff(np.array(run.times))))
    speed = np.hypot(nu[:, 0], nu[:, 1])[:, None]
    return [_faded(speed, step / past)[start, 0] for past in PASTS[1:]]


# --- The judgement


def _together(found: Sequence[_Windows]) -> _Windows:
    """Windows of all runs; the thrust may differ from run to run."""
    number = np.concatenate([f.fold for f in found])
    own = np.concatenate([f.own for f in found])
    thrust = own[:, :, -1:] * (number[:, None] == np.unique(number)[1:])[:, None, :]
    constant = np.ones_like(own[:, :, :1])
    fold = number
    if len(found) == 1:  # quarters of its time
        fold = np.arange(len(number)) * 4 // len(number)
    return _Windows(
        np.concatenate([f.wrench for f in found]),
        np.concatenate([own, thrust, constant], axis=2),
        np.concatenate([f.before for f in found]),
        [
            _Part(parts[0].arguments, np.concatenate([p.columns for p in parts]))
            for parts in zip(*(f.parts for f in found))
        ],
        np.concatenate([f.noise for f in found]),
        np.concatenate([f.block for f in found]),
        fold,
    )


class _Regression:
    """A wrench (n, 3) beside nuisances (n, 3, m), whose weights differ between channels."""

    def __init__(self, wrench: Array, nuisances: Sequence[Array]) -> None:
        self._bases = []
        together = np.concatenate(nuisances, axis=2)
        for channel in range(3):
            self._bases.append(_basis(together[:, channel]))
        rest = self.beside(wrench[:, :, None])[:, :, 0]
        self.scale = 1.4826 * np.median(abs(rest), axis=0) + 1e-12
        self.rest = np.clip(rest / self.scale, -MOST, MOST)

    def beside(self, columns: Array) -> Array:
        """Columns (n, 3, m) without what the nuisances explain of them."""
        left = [
            columns[:, i] - basis @ (basis.T @ columns[:, i]) for i, basis in enumerate(self._bases)
        ]
        return np.stack(left, axis=1)


def _basis(columns: Array) -> Array:
    """Orthonormal columns that span those given."""
    size = np.sqrt((columns**2).mean(axis=0))
    used = columns[:, size > 1e-12 * size.max(initial=1e-300)]
    used = used / np.sqrt((used**2).sum(axis=0))
    left, values, _ = np.linalg.svd(used, full_matrices=False)
    return np.asarray(left[:, values > 1e-6])


def _whitened(columns: Array) -> Array:
    """Orthonormal combinations of columns (n, 3, m), without those that hardly vary."""
    flat = columns.reshape(-1, columns.shape[2])
    flat = flat / np.maximum(1e-300, np.sqrt((flat**2).sum(axis=0)))
    values, vectors = np.linalg.eigh(flat.T @ flat)
    used = values > 0.01
    return np.asarray(
        (flat @ (vectors[:, used] / np.sqrt(values[used]))).reshape(*columns.shape[:2], -1)
    )


def _tested(regression: _Regression, data: _Windows) -> Array:
    """Statistics of the parts for the data, and for draws of chance (1 + TURNS, parts): each about
    normal by chance."""
    blocks, at = np.unique(data.block, return_inverse=True)
    random = np.random.default_rng(1)
    signs = np.vstack([np.ones(len(blocks)), random.choice([-1.0, 1.0], (TURNS, len(blocks)))])
    scores, owners = [], []
    for number, part in enumerate(data.parts):
        left = regression.beside(part.columns)
        size = np.sqrt((left**2).sum(axis=(0, 1)))
        whole = np.sqrt((part.columns**2).sum(axis=(0, 1)))
        left = left[:, :, size > MIN_NEW * whole]
        if left.shape[2]:
            scores.append(_whitened(left / regression.scale[:, None]))
            owners.append(np.full(scores[-1].shape[2], number))
    columns, owner = np.concatenate(scores, axis=2), np.concatenate(owners)
    products = np.einsum("ncm,nc->nm", columns, regression.rest)
    sums = np.zeros((len(blocks), columns.shape[2]))
    np.add.at(sums, at, products)
    squares = (signs @ sums) ** 2
    found = squares @ (owner[:, None] == np.arange(len(data.parts)))
    roots = np.cbrt(found)  # of sums of squares: about normal (Wilson and Hilferty 1931)
    mean, spread = roots[1:].mean(axis=0), roots[1:].std(axis=0)
    return np.asarray((roots - mean) / np.maximum(spread, 1e-12))


def _judged(data: _Windows) -> Opinion:
    """Looks for parts one after the other, each beside those before. Each has to predict the wrench
    of runs that it was not fitted to better than what was missing before does."""
    chosen: List[_Part] = []
    p_values: Dict[str, float] = {}
    while True:
        nuisances = [data.own, data.before, *(part.columns for part in chosen)]
        found = _tested(_Regression(data.wrench, nuisances), data)
        p_now = {}
        for argument in ARGUMENTS:
            of = [i for i, part in enumerate(data.parts) if argument in part.arguments]
            highest = found[:, of].max(axis=1)
            p_now[argument] = float((highest >= highest[0] - 1e-9).mean())
            if not any(argument in part.arguments for part in chosen):
                p_values[argument] = p_now[argument]
        if len(chosen) == MAX_PARTS or min(p_now.values()) >= MAX_P:
            break
        clear = [min(p_now[a] for a in part.arguments) < MAX_P for part in data.parts]
        past = [PAST if "past" in part.arguments else 1.0 for part in data.parts]
        best = _best(data, chosen, np.where(clear, found[0] * past, 0.0))
        if best is None:
            break
        chosen.append(best)
    return _opinion(data, chosen, p_values)


def _opinion(data: _Windows, chosen: List[_Part], p_values: Dict[str, float]) -> Opinion:
    share, deviation = _share(data, chosen)
    arguments = {}
    for argument in ARGUMENTS:
        without = [part for part in chosen if argument not in part.arguments]
        lost = share - _share(data, without)[0] if len(without) < len(chosen) else 0.0
        of_chosen = len(without) < len(chosen)
        p = p_values[argument] if of_chosen else max(MAX_P, p_values[argument])
        arguments[argument] = (max(0.0, lost), p)
    said = [a for a in ARGUMENTS if any(a in part.arguments for part in chosen)]
    low, high = share - 1.96 * deviation, min(1.0, share + 1.96 * deviation)
    said.sort(key=lambda argument: -arguments[argument][0])
    clear = [argument for argument in said if arguments[argument][0] >= MIN_SHARE]
    if share < MIN_SHARE or low <= 0:
        said = clear = []
    return Opinion(arguments, share, (low, high), tuple(clear or said[:1]))


def _best(data: _Windows, chosen: Sequence[_Part], strengths: Array) -> Optional[_Part]:
    """Among the strongest parts beside others, the one that lowers the error most on runs that it was
    not fitted to; None if none does."""
    without = (_held_out(data, chosen)[0] ** 2).sum(axis=1)
    best, most = None, 0.0
    for i in np.argsort(-strengths)[:TRIED]:
        part = data.parts[i]
        error = (_held_out(data, [*chosen, part])[0] ** 2).sum(axis=1)
        gains = _by_block(data, without - error)
        gain = float(gains.sum()) * (PAST if "past" in part.arguments else 1.0)
        if strengths[i] > 0 and gain > most and gains.sum() > MIN_GAIN * np.sqrt((gains**2).sum()):
            best, most = part, gain
    return best


def _by_block(data: _Windows, values: Array) -> Array:
    return np.bincount(np.unique(data.block, return_inverse=True)[1], values).astype(float)


def _held_out(data: _Windows, chosen: Sequence[_Part]) -> Tuple[Array, Array]:
    """Errors (n, 3) of predictions of the missing wrench, beside what was missing before, and what is
    explained by parts alone: each run's by a regression on the others, in robust deviations."""
    whole = _Regression(data.wrench, [data.own])
    wrench = whole.beside(data.wrench[:, :, None]) / whole.scale[:, None]
    columns = np.concatenate(
        [wrench, *(part.columns / whole.scale[:, None] for part in chosen)], axis=2
    )
    columns[:, :, 1:] = whole.beside(columns[:, :, 1:])
    before = whole.beside(data.before)
    error, explained = np.empty(wrench.shape[:2]), np.zeros(wrench.shape[:2])
    for fold in np.unique(data.fold):
        out = data.fold == fold
        left, away = np.empty_like(columns[~out]), np.empty_like(columns[out])
        for channel in range(3):
            own = before[:, channel]
            weights = np.linalg.lstsq(own[~out], columns[~out, channel], rcond=1e-6)[0]
            left[:, channel] = columns[~out, channel] - own[~out] @ weights
            away[:, channel] = columns[out, channel] - own[out] @ weights
        weights = _weights(np.clip(left[..., 0], -MOST, MOST), left[..., 1:], data.block[~out])
        error[out] = np.clip(away[..., 0] - away[..., 1:] @ weights, -2 * MOST, 2 * MOST)
        explained[out] = columns[out][..., 1:] @ weights
    return error, explained


def _weights(target: Array, columns: Array, block: Indices) -> Array:
    """Weights of columns (n, 3, m) by least squares, shrunk by how uncertain they are (James and
    Stein)."""
    if not columns.shape[2]:
        return np.zeros(0)
    flat = columns.reshape(-1, columns.shape[2])
    size = np.maximum(1e-300, np.sqrt((flat**2).sum(axis=0)))
    values, vectors = np.linalg.eigh((flat / size).T @ (flat / size))
    turn = (vectors / np.sqrt(np.maximum(values, 1e-300)))[:, values > 0.01] / size[:, None]
    products = np.einsum("ncm,nc->nm", columns @ turn, target)
    sums = np.zeros((len(np.unique(block)), products.shape[1]))
    np.add.at(sums, np.unique(block, return_inverse=True)[1], products)
    score = sums.sum(axis=0)
    chance = ((sums - sums.mean(axis=0)) ** 2).sum()
    return np.asarray(turn @ (score * max(0.0, 1 - chance / max(1e-300, (score**2).sum()))))


def _share(data: _Windows, chosen: Sequence[_Part]) -> Tuple[float, float]:
    """Share of the missing wrench, beyond the poses' noise, that parts explain on runs that they were
    not fitted to, and its standard deviation by a jackknife over blocks."""
    if not chosen:
        return 0.0, 0.0
    _, explained = _held_out(data, chosen)
    whole = _Regression(data.wrench, [data.own])
    noise = np.minimum(1.0, data.noise / whole.scale**2)
    gain = whole.rest**2 - (whole.rest - explained) ** 2
    sums = np.stack([_by_block(data, v.sum(axis=1)) for v in (whole.rest**2, gain, noise)])

    def share(total: Array) -> Array:
        return np.asarray(total[1] / np.maximum(total[0] - total[2], 0.1 * total[0]))

    every = sums.sum(axis=1)
    others = share(every[:, None] - sums)
    deviation = np.sqrt((len(others) - 1) * others.var())
    return min(1.0, float(share(every))), float(deviation)


def words(opinion: Opinion) -> str:
    """The opinion in a sentence."""
    asked = "A regression of the measured accelerations, which uses no likelihood,"
    if not opinion.says:
        return asked + " finds nothing that the model does not explain."
    names = [NAMES[argument] for argument in opinion.says]
    listed = " and ".join([", ".join(names[:-1])] * (len(names) > 1) + names[-1:])
    low, high = opinion.interval
    return (
        asked
        + " finds an acceleration that depends on %s and that the model does not explain: %.0f%% of "
        "what is unexplained (95%% interval %.0f to %.0f%%)."
    ) % (listed, 100 * opinion.share, 100 * max(0.0, low), 100 * high)
