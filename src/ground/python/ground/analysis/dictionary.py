"""Functions of everything recorded that a missing wrench may be: one dictionary for tests, for the
ceiling and for names.

Each Feature is a wrench by formulas as model files have them, so that it can be added to a model. Features of
the same arguments and of the same form make a Family. Constants (wave numbers, centres, times of
memory) follow from where and how the craft moved.

Arguments are predetermined: the pose is the measured one; velocities are simulated for RESTART
seconds from the filter's state, because filtered ones contain the disturbance; the past is
filtered causally from commands that reach the thrusters and from these velocities. Nothing looks ahead.
"""

import itertools
import re
from dataclasses import dataclass, field, replace
from typing import (
    Any,
    Callable,
    Dict,
    FrozenSet,
    Iterator,
    List,
    Mapping,
    NamedTuple,
    Sequence,
    Tuple,
)

import numpy as np

from ground import _core
from ground.analysis.likelihood import Fit, Likelihood
from ground.annotations import Array
from ground.recordings import repair

RESTART = 0.25  # time that velocities are simulated from a filtered state [s]
HOPS = 3  # restarts in that time
MEMORIES = (0.05, 0.15, 0.5, 1.5, 4.0)  # time constants of the past [s]
SWINGS = (0.5, 0.8, 1.3, 2.0)  # frequencies of what may swing on the craft [Hz]
TURNS = (1, 2, 3, 4)  # harmonics of the heading
FIELDS = {"wide": (1.0, 24), "middle": (0.4, 40), "fine": (0.15, 40)}  # lengths over the extent, waves
CROSSED = 0.25  # time in which the craft crosses the shortest wavelength [s]
FAR = 100.0  # of the extent: distance of a point of the room that a force may depend on
CHANNELS = ("X", "Y", "N")
CONSTANT = re.compile(r"\{\w+\}|(?<=[a-z])\d+")  # in a formula; or the number in a state's name
POWER = re.compile(r"(\w+)\^([23])")
HEADING, PLACE, VELOCITY = "heading", "place", "velocity"
COMMAND, PAST, TIME = "command", "past", "time"
ARGUMENTS = (HEADING, PLACE, VELOCITY, COMMAND, PAST, TIME)


class Constant(NamedTuple):
    """A constant of a formula."""

    value: float
    unit: str
    reach: float  # how far from the value it may be


# Phases of sines that are tested; {name: value}
PHASES = {"p0": Constant(0.0, "rad", np.pi), "p1": Constant(np.pi / 2, "rad", np.pi)}


@dataclass(frozen=True)
class Feature:
    """A wrench of size one, as formulas of a model file."""

    parts: Mapping[str, str]  # formula of each channel: X, Y, N, thrust_<thruster>
    unit: str  # of the formulas' values
    family: "Family"
    states: Mapping[str, str] = field(default_factory=dict)  # formulas of the rates of its states
    # the formulas with names in braces for constants that may be fitted, and these constants
    template: Mapping[str, str] = field(default_factory=dict)
    constants: Mapping[str, Constant] = field(default_factory=dict)
    simpler: Tuple["Feature", ...] = ()  # the same without one of its factors

    @staticmethod
    def of(
        template: Mapping[str, str],
        unit: str,
        family: "Family",
        states: Mapping[str, str],
        constants: Mapping[str, Constant],
    ) -> "Feature":
        """The Feature of formulas with names in braces for constants."""
        parts = {channel: filled(text, constants) for channel, text in template.items()}
        return Feature(parts, unit, family, states, template, constants)

    def at(self, values: Mapping[str, float]) -> "Feature":
        """The same with other values of some constants."""
        moved = {n: c._replace(value=values.get(n, c.value)) for n, c in self.constants.items()}
        made = Feature.of(self.template, self.unit, self.family, self.states, moved)
        return replace(made, simpler=tuple(one.at(values) for one in self.simpler))

    @property
    def weight_unit(self) -> str:
        """Unit of the factor that makes it a wrench."""
        unit = "N m" if set(self.parts) == {"N"} else "N"
        return unit if self.unit == "-" else "%s/(%s)" % (unit, self.unit)


@dataclass(frozen=True)
class Family:
    """Features of the same form."""

    name: str
    arguments: FrozenSet[str]
    named: bool  # whether its formulas mean something by themselves
    whole: bool = True  # whether it is tested as a whole, too


@dataclass(frozen=True)
class Samples:
    """What the formulas of a run depend on: arrays (n,) by name."""

    values: Dict[str, Array]
    times: Array
    states: Dict[str, Array]  # values of the states of formulas


@dataclass(frozen=True)
class Scales:
    """How far and fast the craft moved in all runs."""

    centre: Tuple[float, float]  # of its places [m]
    extent: float  # half of the larger side of the box around them [m]
    speed: float  # root mean square of u and v [m/s]
    turn: float  # of r [rad/s]
    duration: float  # [s]

    @staticmethod
    def of(sampled: Sequence[Samples]) -> "Scales":
        """The Scales of all runs."""

        def every(name: str) -> Array:
            return np.concatenate([s.values[name] for s in sampled])

        x, y = every("x"), every("y")
        lows, highs = (x.min(), y.min()), (x.max(), y.max())
        speed = np.sqrt((every("u") ** 2 + every("v") ** 2).mean() / 2)
        return Scales(
            (float(lows[0] + highs[0]) / 2, float(lows[1] + highs[1]) / 2),
            float(max(highs[0] - lows[0], highs[1] - lows[1], 1e-6)) / 2,
            float(max(speed, 1e-9)),
            float(max(np.sqrt((every("r") ** 2).mean()), 1e-9)),
            float(max(every("t").max(), 1e-3)),
        )


def samples(likelihood: Likelihood, fit: Fit, run: int) -> Samples:
    """The Samples of a run under a fitted model."""
    data, model = likelihood.runs[run], fit.model
    times = np.array(data.times)
    poses = np.array(data.poses) if len(data.poses) else np.array(data.eta)
    nu = _velocities(likelihood, fit, run)
    commands = _reaching(data, model, times)
    values = {
        "x": poses[:, 0],
        "y": poses[:, 1],
        "psi": np.array(repair.wrap(poses[:, 2])),
        "u": nu[:, 0],
        "v": nu[:, 1],
        "r": nu[:, 2],
        **dict(zip(inputs(model), commands.T)),
        "lift": commands[:, -1],
        "t": np.array(data.t),
    }
    return samples_of(model, values, times)


def samples_of(model: _core.Model, values: Dict[str, Array], times: Array) -> Samples:
    """Samples with the values of the states of formulas."""
    return Samples(values, times, _states(model, values, times))


def _velocities(likelihood: Likelihood, fit: Fit, run: int) -> Array:
    """Velocities (n, 3), each simulated without correction for at least RESTART / HOPS * (HOPS -
    1) seconds."""
    data = likelihood.runs[run]
    left = likelihood.residuals(fit.point, run)
    states, constants, times = left["states"], left["constants"], np.array(data.times)
    known = np.array(data.wrench) if len(data.wrench) else np.zeros((len(times), 3))
    nu, step = np.array(states[:, 3:]), float(np.median(np.diff(times)))
    reach = max(2, int(round(RESTART / step)))
    hop = max(1, reach // HOPS)
    for first in range(0, len(times) - reach, hop):
        last = min(len(times) - 1, first + reach)
        if times[last] - times[first] > 2 * reach * step:
            continue  # there is a gap
        span = slice(first, last + 1)
        wrench = known[span] + constants[first, :3]
        try:
            motion = _core.simulate(
                fit.model, data.inputs, times[span], states[first, :3], states[first, 3:], data.drives, wrench
            )
        except RuntimeError:
            continue
        nu[last - hop + 1 : last + 1] = motion["nu"][-hop:]
    return nu


def _reaching(run: _core.RunData, model: _core.Model, times: Array) -> Array:
    """Mean inputs of the thrusters and lift, as they reach the craft, from each sample to the next
    (n, inputs +
    1)."""
    rows = np.array(run.inputs)
    at, values = rows[:, 0], rows[:, 1:]
    if "input_delay" in model.effects:
        at = at + model.value("input_delay.delay")
    whole = np.vstack([np.zeros(values.shape[1]), np.cumsum(values[:-1] * np.diff(at)[:, None], axis=0)])

    def integral(t: Array) -> Array:
        i = np.clip(np.searchsorted(at, t, side="right") - 1, 0, len(at) - 1)
        return np.where((t >= at[0])[:, None], whole[i] + values[i] * (t - at[i])[:, None], 0.0)

    edges = np.append(times, times[-1] + np.median(np.diff(times)))
    means = np.diff(integral(edges), axis=0) / np.maximum(np.diff(edges), 1e-9)[:, None]
    if "motor_lag" in model.effects:
        means[:, :-1] = past(times, means[:, :-1], model.value("motor_lag.tau"))
    return np.asarray(means)


def past(times: Array, values: Array, memory: float) -> Array:
    """Mean of the values (n, k) before each sample, with weights that decay over `memory` [s]."""
    result, state = np.empty_like(values), np.zeros(values.shape[1])
    keep = np.exp(-np.diff(times, append=times[-1]) / max(memory, 1e-6))
    for i, value in enumerate(values):
        result[i] = state
        state = value + (state - value) * keep[i]
    return result


def swinging(times: Array, values: Array, frequency: float) -> Tuple[Array, Array]:
    """Deflection and its rate, both (n, k), of a lightly damped pendulum that follows the values (n, k)."""
    omega, damping = 2 * np.pi * frequency, 0.1
    deflection, rate = np.zeros_like(values), np.zeros_like(values)
    d, w = np.zeros(values.shape[1]), np.zeros(values.shape[1])
    for i, value in enumerate(values):
        deflection[i], rate[i] = d, w
        h = times[i + 1] - times[i] if i + 1 < len(times) else 0.0
        w = w + h * (omega**2 * (value - d) - 2 * damping * omega * w)
        d = d + h * w
    return deflection, rate


def inputs(model: _core.Model) -> List[str]:
    """Names of the inputs of a model's thrusters in formulas."""
    if model.is_pair:
        return ["u_L", "u_R"]
    return ["u_" + thruster["name"] for thruster in model.thrusters]


def dictionary(model: _core.Model, scales: Scales) -> List[Feature]:
    """All Features for a model's craft and how it moved."""
    (cx, cy), far = scales.centre, FAR * scales.extent
    constants = {**PHASES, "x0": Constant(cx, "m", far), "y0": Constant(cy, "m", far)}
    made: List[Feature] = []
    for family, entries in _families(model, scales):
        for template, unit, states in entries:
            text = " ".join(template.values())
            own = {name: c for name, c in constants.items() if "{%s}" % name in text}
            made.append(Feature.of(template, unit, family, states, own))
    return made


_Make = Callable[..., "_Group"]
# Parts of a feature, the unit of its values, and its states
_Entry = Tuple[Dict[str, str], str, Dict[str, str]]
_Scalar = Tuple[str, str]  # formula and unit
_Group = Tuple[Family, List[_Entry]]


def _body(scalars: Sequence[_Scalar], channels: Sequence[str] = CHANNELS) -> List[_Entry]:
    return [({c: f}, unit, {}) for c in channels for f, unit in scalars]


def _room(along: str, across: str, unit: str) -> _Entry:
    """A force with components along the room's x and y."""
    X = "+".join(p for p in (along and "(%s)*cos(psi)" % along, across and "(%s)*sin(psi)" % across) if p)
    Y = "+".join(p for p in (across and "(%s)*cos(psi)" % across, along and "-(%s)*sin(psi)" % along) if p)
    return {"X": X, "Y": Y}, unit, {}


def _both(scalars: Sequence[_Scalar]) -> List[_Entry]:
    """Forces along the room's x and along its y."""
    return [_room(f, "", u) for f, u in scalars] + [_room("", f, u) for f, u in scalars]


def _thrusts(model: _core.Model, scalars: Sequence[_Scalar]) -> List[_Entry]:
    """Thrust that changes by a factor: of each thruster, and of all together."""
    names = [name[2:] for name in inputs(model)]
    entries: List[_Entry] = []
    for formula, unit in scalars:
        each = {"thrust_" + n: "(%s)*u_%s" % (formula, n) for n in names}
        entries += [({channel: f}, unit, {}) for channel, f in each.items()]
        entries.append((each, unit, {}))
    return entries


def _families(model: _core.Model, scales: Scales) -> Iterator[_Group]:
    def family(
        name: str, arguments: Sequence[str], entries: List[_Entry], named: bool = True
    ) -> _Group:
        return Family(name, frozenset(arguments), named), entries

    turns = [(text, "-") for text in turns_of_heading()]
    velocity = of_velocity()
    yield family("moment by heading", [HEADING], _body(turns, "N"))
    yield family("force by heading", [HEADING], _body(turns, "XY"))
    yield family("force fixed in the room", [HEADING], _both([("1", "-")]))
    yield family("thrust by heading", [HEADING, COMMAND], _thrusts(model, turns[:4]))
    yield family("damping by heading", [HEADING, VELOCITY], _dampings(turns[:4]))
    yield family("velocity in the room", [HEADING, VELOCITY], _of_room_velocity(scales))
    yield from _of_place(model, scales, family)
    yield family("velocity", [VELOCITY], _body(velocity) + _across())
    yield family("direction of motion", [VELOCITY], _body(signs(scales)))
    commands = [(formula, "-") for formula in command_formulas(model)]
    yield family("command", [COMMAND], _body(commands))
    speeds = velocity[:3] + [("sqrt(u^2+v^2)", "m/s"), ("u^2", "m^2/s^2"), ("v^2", "m^2/s^2")]
    yield family("thrust by velocity", [COMMAND, VELOCITY], _thrusts(model, speeds))
    total = "(%s)" % "+".join(inputs(model))
    aside = [("%s*%s" % (total, f), u) for f, u in speeds]
    yield family("thrust and velocity", [COMMAND, VELOCITY], _body(aside, "YN"))
    yield family("lift and velocity", [COMMAND, VELOCITY], _dampings([("lift", "-")]))
    fades = [("cos(%.4g*t)" % (k * np.pi / scales.duration), "-") for k in range(1, 6)]
    times = [("t", "s"), ("t^2", "s^2")] + fades
    yield family("time", [TIME], _body(times) + _both([("t", "s")]))
    yield family("thrust by time", [TIME, COMMAND], _thrusts(model, times[:5]))
    yield family("damping by time", [TIME, VELOCITY], _dampings(times[:2]))
    yield family("past commands", [PAST], list(_of_past_commands(model)))
    yield family("past velocity", [PAST], list(_of_past_velocity()))
    yield family("swinging load", [PAST], list(_of_swings()))


def turns_of_heading() -> List[str]:
    """Formulas of each harmonic of the heading, with both phases."""
    return ["sin(%spsi+{%s})" % ("" if k == 1 else "%d*" % k, p) for k in TURNS for p in PHASES]


def of_velocity() -> List[_Scalar]:
    """Functions of the velocities and their units."""
    square, mixed, turn = "m^2/s^2", "m/s^2", "rad^2/s^2"
    speed = "sqrt(u^2+v^2)"
    return [
        ("u", "m/s"), ("v", "m/s"), ("r", "rad/s"),
        ("u^2", square), ("v^2", square), ("r^2", turn), ("u*v", square), ("u*r", mixed), ("v*r", mixed),
        ("abs(u)*u", square), ("abs(v)*v", square), ("abs(r)*r", turn), ("abs(r)", "rad/s"),
        (speed + "*u", square), (speed + "*v", square), (speed + "*r", mixed), (speed, "m/s"),
        ("abs(r)*u", mixed), ("abs(r)*v", mixed), ("abs(u)*v", square), ("abs(v)*u", square),
        ("u^3", "m^3/s^3"), ("v^3", "m^3/s^3"), ("r^3", "rad^3/s^3"),
        ("u^2*v", "m^3/s^3"), ("v^2*u", "m^3/s^3"),
    ]  # fmt: skip


def _across() -> List[_Entry]:
    """Forces along and across the velocity."""
    speed = "sqrt(u^2+v^2)"
    entries: List[_Entry] = [
        ({"X": "-r*v", "Y": "r*u"}, "m/s^2", {}),
        ({"X": "-abs(r)*v", "Y": "abs(r)*u"}, "m/s^2", {}),
        ({"X": "%s*v" % speed, "Y": "-%s*u" % speed}, "m^2/s^2", {}),
    ]
    for power, unit in (("", "m/s"), (speed + "*", "m^2/s^2"), ("(u^2+v^2)*", "m^3/s^3")):
        entries.append(({"X": power + "u", "Y": power + "v"}, unit, {}))
    return entries


def signs(scales: Scales) -> List[_Scalar]:
    """Directions of the motion: what dry friction depends on."""
    slow, slow_turn = 0.15 * scales.speed, 0.15 * scales.turn
    speed = "sqrt(u^2+v^2+%.3g)" % slow**2
    signs = [("u/" + speed, "-"), ("v/" + speed, "-")]
    for name, least in (("u", slow), ("v", slow), ("r", slow_turn)):
        signs.append(("%s/sqrt(%s^2+%.3g)" % (name, name, least**2), "-"))
    return signs


def _dampings(factors: Sequence[_Scalar]) -> List[_Entry]:
    """Damping of each velocity that depends on something."""
    entries: List[_Entry] = []
    for formula, unit in factors:
        times = "" if unit == "-" else "*" + unit
        for channel, velocity, own in (("X", "u", "m/s"), ("Y", "v", "m/s"), ("N", "r", "rad/s")):
            entries.append(({channel: "(%s)*%s" % (formula, velocity)}, own + times, {}))
        entries.append(({"X": "(%s)*u" % formula, "Y": "(%s)*v" % formula}, "m/s" + times, {}))
    return entries


def _of_room_velocity(scales: Scales) -> List[_Entry]:
    along, across = "(u*cos(psi)-v*sin(psi))", "(u*sin(psi)+v*cos(psi))"
    slow = (0.15 * scales.speed) ** 2
    entries: List[_Entry] = []
    for q in (along, across):
        entries += _both([(q, "m/s"), ("abs%s*%s" % (q, q), "m^2/s^2")])
        entries += _both([("%s/sqrt(%s^2+%.3g)" % (q, q, slow), "-"), (q + "^2", "m^2/s^2")])
    return entries


def _of_place(model: _core.Model, scales: Scales, family: _Make) -> Iterator[_Group]:
    random = np.random.default_rng(5)
    extent = scales.extent
    x, y = "(x-{x0})", "(y-{y0})"
    flat = [(x, "m"), (y, "m")]
    bowl = [("%s*%s" % pair, "m^2") for pair in ((x, x), (x, y), (y, y))]
    radius = "sqrt(%s^2+%s^2+%.3g)" % (x, y, (0.05 * extent) ** 2)
    yield family(
        "force by place",
        [PLACE],
        _both(flat + bowl)
        + [_room(x, y, "m"), _room("-" + y, x, "m")]
        + [_room("%s*%s" % (radius, x), "%s*%s" % (radius, y), "m^2")]
        + [_room("%s/%s" % (x, radius), "%s/%s" % (y, radius), "-")],
    )
    yield family("moment by place", [PLACE], _body(flat + bowl, "N"))
    yield family("thrust by place", [PLACE, COMMAND], _thrusts(model, flat + bowl))
    yield family("damping by place", [PLACE, VELOCITY], _dampings(flat + bowl))
    fields: Dict[str, List[_Scalar]] = {}
    for name, (length, count) in FIELDS.items():
        vectors = random.normal(size=(count, 2)) / (length * extent)
        phases = random.uniform(0, 2 * np.pi, count)
        fields[name] = [
            ("cos(%.5g*x+(%.5g)*y+(%.4g))" % (a, b, p), "-") for (a, b), p in zip(vectors, phases)
        ]
    for name, waves in fields.items():
        yield family("%s field of force" % name, [PLACE], _both(waves), False)
        if name != "fine":
            yield family("%s field of moment" % name, [PLACE], _body(waves, "N"), False)
            patches: List[_Entry] = [({"X": "%s*u" % f, "Y": "%s*v" % f}, "m/s", {}) for f, _ in waves]
            yield family("%s field of damping" % name, [PLACE, VELOCITY], patches, False)


def command_formulas(model: _core.Model) -> List[str]:
    """Functions of the inputs of thrusters and of the lift."""
    names = inputs(model)
    pairs = ["%s*%s" % pair for pair in itertools.combinations_with_replacement(names, 2)]
    cubes = [name + "^3" for name in names]
    lifted = ["lift"] + ["lift*" + name for name in names]
    return names + pairs[: 3 * len(names)] + cubes + lifted


def _of_past_commands(model: _core.Model) -> Iterator[_Entry]:
    names = [name[2:] for name in inputs(model)]
    total = "(%s)" % "+".join("u_" + n for n in names)
    for i, memory in enumerate(MEMORIES):
        own = {n: "p%d_%s" % (i, n) for n in names}
        rates = {own[n]: "(u_%s-%s)/%g" % (n, own[n], memory) for n in names}
        for formula in ("(%(p)s-%(u)s)", "(%(p)s-%(u)s)*%(u)s", "abs(%(p)s-%(u)s)*(%(p)s-%(u)s)"):
            each = {
                "thrust_" + n: formula % {"p": own[n], "u": "u_" + n} for n in names
            }
            for n in names:
                channel = "thrust_" + n
                yield {channel: each[channel]}, "-", {own[n]: rates[own[n]]}
            yield each, "-", rates
        drawn = "q%d" % i
        rate = {drawn: "(%s-%s)/%g" % (total, drawn, memory)}
        yield {"thrust_" + n: "%s*u_%s" % (drawn, n) for n in names}, "-", rate
        for channel in "YN":
            yield {channel: "%s-%s" % (drawn, total)}, "-", rate
        filled = {"l%d" % i: "(lift-l%d)/%g" % (i, memory)}
        yield {"X": "(l%d-lift)*u" % i, "Y": "(l%d-lift)*v" % i}, "m/s", filled
    used = {"used": total}
    for spent in (1.0, 3.0, 10.0):
        yield {"thrust_" + n: "exp(-used/%g)*u_%s" % (spent, n) for n in names}, "-", used


def _of_past_velocity() -> Iterator[_Entry]:
    for i, memory in enumerate(MEMORIES):
        for channel, name, unit in (("X", "u", "m/s"), ("Y", "v", "m/s"), ("N", "r", "rad/s")):
            state = "w%d_%s" % (i, name)
            yield {channel: "%s-%s" % (state, name)}, unit, {state: "(%s-%s)/%g" % (name, state, memory)}
        both = {"w%d_%s" % (i, n): "(%s-w%d_%s)/%g" % (n, i, n, memory) for n in "uv"}
        yield {"X": "w%d_u-u" % i, "Y": "w%d_v-v" % i}, "m/s", both
        state = "s%d" % i
        rate = {state: "(u^2+v^2-%s)/%g" % (state, memory)}
        for parts in ({"X": "%s*u" % state, "Y": "%s*v" % state}, {"N": "%s*r" % state}):
            yield parts, "m^3/s^3", rate


def _of_swings() -> Iterator[_Entry]:
    for i, frequency in enumerate(SWINGS):
        omega = 2 * np.pi * frequency
        for kind, unit in (("a", "m/s"), ("b", "m/s^2")):
            states = {}
            for axis, speed in (("x", "(u*cos(psi)-v*sin(psi))"), ("y", "(u*sin(psi)+v*cos(psi))")):
                a, b = "a%d%s" % (i, axis), "b%d%s" % (i, axis)
                states[a] = b
                states[b] = "%.5g*(%s-%s)-%.4g*%s" % (omega**2, speed, a, 0.2 * omega, b)
            parts, _, _ = _room("%s%dx" % (kind, i), "%s%dy" % (kind, i), unit)
            yield parts, unit, states


def wrenches(features: Sequence[Feature], model: _core.Model, sampled: Samples) -> Array:
    """Wrenches (n, 3, features) of features at a run's samples, in their own units: X, Y, N in the
    body's frame."""
    known = namespace(sampled)
    push = _directions(model)
    result = np.zeros((len(sampled.times), 3, len(features)))
    done: Dict[str, Array] = {}
    for j, feature in enumerate(features):
        for channel, formula in feature.parts.items():
            if formula not in done:
                done[formula] = evaluated(formula, known)
            if channel in CHANNELS:
                result[:, CHANNELS.index(channel), j] += done[formula]
            else:
                result[:, :, j] += done[formula][:, None] * push[channel]
    return result


def namespace(sampled: Samples) -> Mapping[str, Any]:
    """What formulas may name, at a run's samples."""
    known: Dict[str, Any] = {**sampled.values, **sampled.states}
    known.update(sin=np.sin, cos=np.cos, abs=np.abs, sqrt=np.sqrt, exp=np.exp)
    return known


def evaluated(formula: str, known: Mapping[str, Any]) -> Array:
    """Values (n,) of a formula of the dictionary, never of a user's."""
    value = eval(formula.replace("^", "**"), {"__builtins__": {}}, known)
    return np.asarray(np.broadcast_to(np.asarray(value, float), known["t"].shape))


def filled(template: str, constants: Mapping[str, Constant]) -> str:
    """A formula with the values of its constants."""
    values = {name: "%.6g" % c.value for name, c in constants.items()}
    return template.format(**{n: "(%s)" % v if v[0] == "-" else v for n, v in values.items()})


def product_of_units(units: Sequence[str]) -> str:
    """Unit of a product."""
    return "*".join(unit for unit in units if unit != "-") or "-"


def followed(model: _core.Model, sampled: Samples) -> Array:
    """Wrenches (n, 3, k) that a change of the nominal parameters has as well: of the thrusters, of
    the damping. A change of the yaw inertia scales all moments, so that moments count by themselves."""
    v = sampled.values
    push = _directions(model)
    thrust = np.zeros((len(v["u"]), 3))
    for name in inputs(model):
        thrust += v[name][:, None] * push["thrust_" + name[2:]]
    none = np.zeros_like(v["u"])
    columns = [
        np.column_stack([thrust[:, 0], thrust[:, 1], none]),
        np.column_stack([none, none, thrust[:, 2]]),
        np.column_stack([v["u"], none, none]),
        np.column_stack([none, v["v"], none]),
        np.column_stack([none, none, v["r"]]),
    ]
    return np.stack(columns, axis=2)


def _directions(model: _core.Model) -> Dict[str, Array]:
    """Wrench of a thrust of 1 N of each thruster, by the name of its channel in formulas."""
    rows = np.array(model.forces(np.eye(len(inputs(model)))), float)
    size = np.maximum(np.hypot(rows[:, 0], rows[:, 1]), 1e-12)
    rows = rows / size[:, None] * np.array([1.0, 1.0, model.value("l")])
    return {"thrust_" + name[2:]: row for name, row in zip(inputs(model), rows)}


def _states(model: _core.Model, v: Mapping[str, Array], times: Array) -> Dict[str, Array]:
    """Values of the states of formulas, by name."""
    names = inputs(model)
    commands = np.column_stack([v[name] for name in names])
    total = commands.sum(axis=1)
    speeds = np.column_stack([v["u"], v["v"], v["r"], v["u"] ** 2 + v["v"] ** 2])
    found: Dict[str, Array] = {}
    for i, memory in enumerate(MEMORIES):
        columns = np.column_stack([commands, total, v["lift"], speeds])
        means = past(times, columns, memory).T
        labels = ["p%d_%s" % (i, name[2:]) for name in names] + ["q%d" % i, "l%d" % i]
        labels += ["w%d_%s" % (i, name) for name in "uvr"] + ["s%d" % i]
        found.update(zip(labels, means))
    c, s = np.cos(v["psi"]), np.sin(v["psi"])
    room = np.column_stack([c * v["u"] - s * v["v"], s * v["u"] + c * v["v"]])
    for i, frequency in enumerate(SWINGS):
        for kind, values in zip("ab", swinging(times, room, frequency)):
            found.update({"%s%d%s" % (kind, i, axis): values[:, j] for j, axis in enumerate("xy")})
    steps = np.diff(times, prepend=times[0])
    found["used"] = np.cumsum(total * steps)
    return found


def dependence(feature: Feature) -> str:
    """What a feature has in common with those that differ in their constants, or in how their formulas
    are written."""
    parts = []
    for channel, text in sorted(feature.template.items()):
        text = CONSTANT.sub("", text)
        text = POWER.sub(lambda found: "*".join([found.group(1)] * int(found.group(2))), text)
        factors = sorted(f for f in re.sub("[()]", "", text).split("*") if f)
        parts.append("%s: %s" % (channel, "*".join(factors)))
    return ", ".join(parts)


def squared_distances(points: Array, to: Array) -> Array:
    """Squared distances (n,) of points (n, k) to one."""
    return np.asarray(((points - to) ** 2).sum(axis=1))


def spread(
    points: Array, apart: float, most: int, squared: Callable[[Array, Array], Array] = squared_distances
) -> Array:
    """Some of the points (n, k), the farthest from the others first, until all are near one."""
    chosen = [points[len(points) // 2]]
    nearest = squared(points, chosen[0])
    while len(chosen) < most and nearest.max() > apart**2:
        chosen.append(points[int(np.argmax(nearest))])
        nearest = np.minimum(nearest, squared(points, chosen[-1]))
    return np.array(chosen)
