"""Functions of everything recorded that a missing wrench may be: one dictionary for tests, for the
ceiling and for names.

Each Feature is a wrench by formulas as model files have them, so that it can be added to a model. Features of
the same arguments and of the same form make a Family. Constants (wave numbers, centres, times of
memory) follow from where and how the craft moved.
"""

import itertools
import re
from dataclasses import dataclass, field, replace
from typing import Dict, FrozenSet, Iterator, List, Mapping, NamedTuple, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis.samples import MEMORIES, SWINGS, Samples, Scales, evaluated, inputs, namespace
from ground.annotations import Array

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


class Channel(NamedTuple):
    """Where a function acts: a formula for each channel, with %s for the function, and with names in braces
    for constants."""

    parts: Mapping[str, str]
    unit: str = "-"
    arguments: FrozenSet[str] = frozenset()
    constants: Mapping[str, Constant] = {}


_Scalar = Tuple[str, str]  # formula and unit
# Formula of each channel, the unit of its values, and the rates of its states
_Entry = Tuple[Mapping[str, str], str, Mapping[str, str]]

BODY = {c: Channel({c: "%s"}) for c in CHANNELS}
# Forces along the room's x and along its y
ROOM = [Channel({"X": "%s*cos(psi)", "Y": "-%s*sin(psi)"}), Channel({"X": "%s*sin(psi)", "Y": "%s*cos(psi)"})]
ALONG = Channel({"X": "%s*u", "Y": "%s*v"}, "m/s")  # along the velocity, in proportion to it
DAMPING = [
    *(Channel({c: "%s*" + speed}, unit) for c, speed, unit in zip("XYN", "uvr", ("m/s", "m/s", "rad/s"))),
    ALONG,
]


def _acting(channels: Sequence[Channel], scalars: Sequence[_Scalar]) -> List[_Entry]:
    """Functions that act on each of some channels."""
    return [
        (
            {c: part % (f if part == "%s" else "(%s)" % f) for c, part in channel.parts.items()},
            product_of_units([unit, channel.unit]),
            {},
        )
        for channel in channels
        for f, unit in scalars
    ]


def _room(along: str, across: str, unit: str) -> _Entry:
    """A force with components along the room's x and y."""
    parts = {"X": "(%s)*cos(psi)+(%s)*sin(psi)", "Y": "(%s)*cos(psi)+-(%s)*sin(psi)"}
    return {"X": parts["X"] % (along, across), "Y": parts["Y"] % (across, along)}, unit, {}


def dictionary(model: _core.Model, scales: Scales) -> List[Feature]:
    """All Features for a model's craft and how it moved."""
    (cx, cy), far = scales.centre, FAR * scales.extent
    constants = {**PHASES, "x0": Constant(cx, "m", far), "y0": Constant(cy, "m", far)}
    made: List[Feature] = []
    for families, is_named in ((_families(model, scales), True), (_fields(scales), False)):
        for name, arguments, entries in families:
            family = Family(name, frozenset(arguments.split()), is_named)
            for template, unit, states in entries:
                text = " ".join(template.values())
                own = {name: c for name, c in constants.items() if "{%s}" % name in text}
                made.append(Feature.of(template, unit, family, states, own))
    return made


def _families(model: _core.Model, scales: Scales) -> Iterator[Tuple[str, str, List[_Entry]]]:
    """Name, arguments and features of each family whose formulas mean something by themselves."""
    X, Y, N = BODY.values()
    each = {"thrust_" + name[2:]: "%s*" + name for name in inputs(model)}
    # thrust that changes by a factor: of each thruster, and of all together
    thrusts = [*(Channel({c: f}) for c, f in each.items()), Channel(each)]
    turns = [(text, "-") for text in turns_of_heading()]
    yield "moment by heading", "heading", _acting([N], turns)
    yield "force by heading", "heading", _acting([X, Y], turns)
    yield "force fixed in the room", "heading", _acting(ROOM, [("1", "-")])
    yield "thrust by heading", "heading command", _acting(thrusts, turns[:4])
    yield "damping by heading", "heading velocity", _acting(DAMPING, turns[:4])
    slow, velocities = (0.15 * scales.speed) ** 2, []
    for q in ("(u*cos(psi)-v*sin(psi))", "(u*sin(psi)+v*cos(psi))"):
        velocities += [(q, "m/s"), ("abs%s*%s" % (q, q), "m^2/s^2"), (q + "^2", "m^2/s^2")]
        velocities.append(("%s/sqrt(%s^2+%.3g)" % (q, q, slow), "-"))
    yield "velocity in the room", "heading velocity", _acting(ROOM, velocities)
    x, y = "(x-{x0})", "(y-{y0})"
    places = [(x, "m"), (y, "m")] + [("%s*%s" % pair, "m^2") for pair in ((x, x), (x, y), (y, y))]
    radius = "sqrt(%s^2+%s^2+%.3g)" % (x, y, (0.05 * scales.extent) ** 2)
    away = [_room(x, y, "m"), _room("-" + y, x, "m")]
    away.append(_room("%s*%s" % (radius, x), "%s*%s" % (radius, y), "m^2"))
    away.append(_room("%s/%s" % (x, radius), "%s/%s" % (y, radius), "-"))
    yield "force by place", "place", _acting(ROOM, places) + away
    yield "moment by place", "place", _acting([N], places)
    yield "thrust by place", "place command", _acting(thrusts, places)
    yield "damping by place", "place velocity", _acting(DAMPING, places)
    velocity, speed = of_velocity(), "sqrt(u^2+v^2)"
    along = _acting([ALONG], [(speed, "m/s"), ("u^2+v^2", "m^2/s^2")])
    turned = [("r", "rad/s"), ("abs(r)", "rad/s"), ("-" + speed, "m/s")]
    across = Channel({"X": "-%s*v", "Y": "%s*u"}, "m/s")
    straight: _Entry = ({"X": "u", "Y": "v"}, "m/s", {})
    moving = [straight, *along, *_acting([across], turned)]
    yield "velocity", "velocity", _acting([X, Y, N], velocity) + moving
    yield "direction of motion", "velocity", _acting([X, Y, N], signs(scales))
    yield "command", "command", _acting([X, Y, N], [(f, "-") for f in command_formulas(model)])
    speeds = velocity[:3] + [(speed, "m/s"), ("u^2", "m^2/s^2"), ("v^2", "m^2/s^2")]
    yield "thrust by velocity", "command velocity", _acting(thrusts, speeds)
    aside = [("(%s)*%s" % ("+".join(inputs(model)), f), u) for f, u in speeds]
    yield "thrust and velocity", "command velocity", _acting([Y, N], aside)
    yield "lift and velocity", "command velocity", _acting(DAMPING, [("lift", "-")])
    fades = [("cos(%.4g*t)" % (k * np.pi / scales.duration), "-") for k in range(1, 6)]
    times = [("t", "s"), ("t^2", "s^2"), *fades]
    yield "time", "time", _acting([X, Y, N], times) + _acting(ROOM, times[:1])
    yield "thrust by time", "time command", _acting(thrusts, times[:5])
    yield "damping by time", "time velocity", _acting(DAMPING, times[:2])
    yield "past commands", "past", list(_of_past_commands(model))
    yield "past velocity", "past", list(_of_past_velocity())
    yield "swinging load", "past", list(_of_swings())


def _fields(scales: Scales) -> Iterator[Tuple[str, str, List[_Entry]]]:
    """Families of random waves over the floor, which mean nothing by themselves."""
    random = np.random.default_rng(5)
    for name, (length, count) in FIELDS.items():
        vectors = random.normal(size=(count, 2)) / (length * scales.extent)
        phases = random.uniform(0, 2 * np.pi, count)
        waves = [("cos(%.5g*x+(%.5g)*y+(%.4g))" % (a, b, p), "-") for (a, b), p in zip(vectors, phases)]
        yield "%s field of force" % name, "place", _acting(ROOM, waves)
        if name != "fine":
            yield "%s field of moment" % name, "place", _acting([BODY["N"]], waves)
            yield "%s field of damping" % name, "place velocity", _acting([ALONG], waves)


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


def signs(scales: Scales) -> List[_Scalar]:
    """Directions of the motion: what dry friction depends on."""
    slow, slow_turn = 0.15 * scales.speed, 0.15 * scales.turn
    speed = "sqrt(u^2+v^2+%.3g)" % slow**2
    signs = [("u/" + speed, "-"), ("v/" + speed, "-")]
    for name, least in (("u", slow), ("v", slow), ("r", slow_turn)):
        signs.append(("%s/sqrt(%s^2+%.3g)" % (name, name, least**2), "-"))
    return signs


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
            each = {"thrust_" + n: formula % {"p": own[n], "u": "u_" + n} for n in names}
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


def spread(points: Array, apart: float, most: int) -> Array:
    """Some of the points (n, k), the farthest from the others first, until all are near one."""
    chosen = [points[len(points) // 2]]
    nearest = ((points - chosen[0]) ** 2).sum(axis=1)
    while len(chosen) < most and nearest.max() > apart**2:
        chosen.append(points[int(np.argmax(nearest))])
        nearest = np.minimum(nearest, ((points - chosen[-1]) ** 2).sum(axis=1))
    return np.array(chosen)
