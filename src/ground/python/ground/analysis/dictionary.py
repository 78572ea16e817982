"""Functions of everything recorded that a missing wrench may be: one dictionary for tests, for the
ceiling and for names.

Each Feature is a wrench by formulas as model files have them, so that it can be added to a model. Features of
the same arguments and of the same form make a Family. Constants (wave numbers, centres, times of
memory) follow from where and how the craft moved.
"""

import re
from dataclasses import dataclass, field, replace
from typing import Dict, FrozenSet, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import channels, scalars
from ground.analysis.channels import ACROSS, ALONG, DAMPING, ON_BODY, Channel
from ground.analysis.samples import Samples, Scales, evaluated, inputs, namespace
from ground.analysis.scalars import (
    COMMAND,
    FAR,
    HEADING,
    ONE,
    PAST,
    PLACE,
    TIME,
    VELOCITY,
    Constant,
    Memory,
    Scalar,
    filled,
    product_of_units,
)  # fmt: skip
from ground.support.annotations import Array

FIELDS = {"wide": (1.0, 24), "middle": (0.4, 40), "fine": (0.15, 40)}  # lengths over the extent, waves
CHANNELS = ("X", "Y", "N")
CONSTANT = re.compile(r"\{\w+\}|(?<=[a-z])\d+")  # in a formula; or the number in a state's name
POWER = re.compile(r"(\w+)\^([23])")


@dataclass(frozen=True)
class Family:
    """Features of the same form."""

    name: str
    arguments: FrozenSet[str]
    named: bool  # whether its formulas mean something by themselves
    whole: bool = True  # whether it is tested as a whole, too


@dataclass(frozen=True)
class Feature:
    """A wrench of size one, as formulas of a model file."""

    parts: Mapping[str, str]  # formula of each channel: X, Y, N, thrust_<thruster>
    unit: str  # of the formulas' values
    family: Family
    # the formulas with names in braces for constants that may be fitted, and these constants
    template: Mapping[str, str] = field(default_factory=dict)
    constants: Mapping[str, Constant] = field(default_factory=dict)
    memory: Memory = Memory()
    acts: str = "a force"  # what acts, and the function along it, with names in braces for constants
    function: str = "1"
    simpler: Tuple["Feature", ...] = ()  # the same without one of its factors

    def at(self, values: Mapping[str, float]) -> "Feature":
        """The same with other values of some constants."""
        moved = {n: c._replace(value=values.get(n, c.value)) for n, c in self.constants.items()}
        parts = {channel: filled(text, moved) for channel, text in self.template.items()}
        simpler = tuple(one.at(values) for one in self.simpler)
        return replace(self, parts=parts, constants=moved, simpler=simpler)

    @property
    def weight_unit(self) -> str:
        """Unit of the factor that makes it a wrench."""
        unit = "N m" if set(self.parts) == {"N"} else "N"
        return unit if self.unit == "-" else "%s/(%s)" % (unit, self.unit)


def product(channel: Channel, factors: Sequence[Scalar], family: Optional[Family] = None) -> Feature:
    """The product of scalars on a channel. Without a family it is one of the screen, and has simpler ones."""
    some = [scalar for scalar in factors if scalar is not ONE]
    text = "*".join("(%s)" % scalar.text for scalar in some) or "1"
    constants, memory = dict(channel.constants), channel.memory
    for scalar in some:
        constants.update(scalar.constants)
        memory = memory + scalar.memory
    template = {name: part % text for name, part in channel.parts.items()}
    unit = product_of_units([*(scalar.unit for scalar in some), channel.unit])
    parts = {name: filled(part, constants) for name, part in template.items()}
    if family:
        return Feature(parts, unit, family, template, constants, memory, channel.words, text)
    family = Family("products", arguments_of([channel], some) or frozenset([HEADING]), True, False)
    fewer = [[scalar] for scalar in some] if len(some) > 1 else [[]] * len(some)
    simpler = tuple(product(channel, left) for left in fewer)
    return Feature(parts, unit, family, template, constants, memory, channel.words, text, simpler)


def arguments_of(acting: Sequence[Channel], factors: Sequence[Scalar]) -> FrozenSet[str]:
    """What products of channels and scalars depend on; the past alone if it is among them."""
    every: FrozenSet[str] = frozenset()
    every = every.union(*(one.arguments for one in acting), *(one.arguments for one in factors))
    return frozenset([PAST]) if PAST in every else every


def dictionary(model: _core.Model, scales: Scales) -> List[Feature]:
    """All Features for a model's craft and how it moved."""
    made: List[Feature] = []
    for table, is_named in ((_families(model, scales), True), (_fields(scales), False)):
        for name, acting, factors in table:
            arguments = arguments_of(acting, factors) or frozenset([HEADING])
            family = Family(name, arguments, is_named)
            made += [product(channel, [scalar], family) for channel in acting for scalar in factors]
    return made


class _Row(NamedTuple):
    """A family: each of some functions on each of some channels."""

    name: str
    acting: Sequence[Channel]
    factors: Sequence[Scalar]


def _families(model: _core.Model, scales: Scales) -> Iterator[_Row]:
    """Families whose formulas mean something by themselves."""
    X, Y, N = ON_BODY
    room, thrust = channels.directions(2, np.pi), channels.thrusts(model)
    (cx, cy), far = scales.centre, FAR * scales.extent
    turns, velocities, commands = scalars.turns(), scalars.velocities(), scalars.commands(model)
    yield _Row("moment by heading", [N], turns)
    yield _Row("force by heading", [X, Y], turns)
    yield _Row("force fixed in the room", room, [ONE])
    yield _Row("thrust by heading", thrust, turns[:4])
    yield _Row("damping by heading", DAMPING, turns[:4])
    yield _Row("velocity in the room", room, scalars.in_room(scales))
    centre = {"x0": Constant(cx, "m", far), "y0": Constant(cy, "m", far)}
    point = {"mx": centre["x0"], "my": centre["y0"]}
    radius = "sqrt((x-{mx})^2+(y-{my})^2+%.3g)" % (0.05 * scales.extent) ** 2
    x, y = "(x-{x0})", "(y-{y0})"
    squares = [("%s*%s" % pair, "m^2") for pair in ((x, x), (x, y), (y, y))]
    places = scalars.of([PLACE], [(x, "m"), (y, "m"), *squares], centre)
    yield _Row("force by place", room, places)
    for text, unit in (("", "m"), ("*" + radius, "m^2"), ("/" + radius, "-")):
        yield _Row("force about a point " + unit, channels.about(text, unit, point), [ONE])
    yield _Row("moment by place", [N], places)
    yield _Row("thrust by place", thrust, places)
    yield _Row("damping by place", DAMPING, places)
    yield _Row("velocity", ON_BODY, velocities)
    speed = "sqrt(u^2+v^2)"
    faster = scalars.of(
        [VELOCITY], [("r", "rad/s"), ("abs(r)", "rad/s"), (speed, "m/s"), ("u^2+v^2", "m^2/s^2")]
    )
    yield _Row("along and across the velocity", [ALONG, ACROSS], [ONE, *faster])
    yield _Row("direction of motion", ON_BODY, scalars.signs(scales))
    yield _Row("command", ON_BODY, commands)
    speeds = [
        *velocities[:3],
        *scalars.of([VELOCITY], [(speed, "m/s"), ("u^2", "m^2/s^2"), ("v^2", "m^2/s^2")]),
    ]
    yield _Row("thrust by velocity", thrust, speeds)
    total = scalars.total(model)
    told = [
        replace(s, text="%s*%s" % (total, s.text), arguments=frozenset([COMMAND, VELOCITY])) for s in speeds
    ]
    yield _Row("thrust and velocity", [Y, N], told)
    yield _Row("lift and velocity", DAMPING, scalars.of([COMMAND], [("lift", "-")]))
    fades = [("cos(%.4g*t)" % (k * np.pi / scales.duration), "-") for k in range(1, 6)]
    times = scalars.of([TIME], [("t", "s"), ("t^2", "s^2"), *fades])
    yield _Row("time", ON_BODY, times)
    yield _Row("force in the room by time", room, times[:1])
    yield _Row("thrust by time", thrust, times[:5])
    yield _Row("damping by time", DAMPING, times[:2])
    yield from _of_the_past(model, scales)


def _of_the_past(model: _core.Model, scales: Scales) -> Iterator[_Row]:
    names, total = [name[2:] for name in inputs(model)], scalars.total(model)
    past = frozenset([PAST])
    late: List[Channel] = []
    for i in range(len(scales.memories)):
        memory = Memory.mean(scales, "p", i, {"_" + name: "u_" + name for name in names})
        for form in ("({0}-u_%s)", "({0}-u_%s)*u_%s", "abs({0}-u_%s)*({0}-u_%s)"):
            late += channels.thrusts(model, form.format("p%d_%%s" % i), PAST, memory)
    yield _Row("thrust by past commands", late, [ONE])
    drawn = scalars.means(scales, "q", {"": total})
    yield _Row("thrust by the past sum of commands", channels.thrusts(model)[-1:], drawn)
    yield _Row("wrench by the past sum of commands", ON_BODY[1:], [scalars.less(q, total) for q in drawn])
    filling = [scalars.less(mean, "lift") for mean in scalars.means(scales, "l", {"": "lift"})]
    yield _Row("damping by past lift", [ALONG], filling)
    used = Memory({"used": total}, {})
    spent = [Scalar("exp(-used/%g)" % some, "-", past, {}, used) for some in scales.spent]
    yield _Row("thrust by what was used", channels.thrusts(model)[-1:], spent)
    for channel, name, unit in zip(ON_BODY, "uvr", ("m/s", "m/s", "rad/s")):
        means = scalars.means(scales, "w", {"_" + name: name}, unit)
        yield _Row("past velocity " + name, [channel], [scalars.less(w, name) for w in means])
    waking = []
    for i in range(len(scales.memories)):
        parts = {"X": "%%s*(w%d_u-u)" % i, "Y": "%%s*(w%d_v-v)" % i}
        memory = Memory.mean(scales, "w", i, {"_u": "u", "_v": "v"})
        waking.append(
            Channel(parts, "a force along the past velocity less the present one", "m/s", past, {}, memory)
        )
    yield _Row("past velocity", waking, [ONE])
    squared = scalars.means(scales, "s", {"": "u^2+v^2"}, "m^2/s^2")
    yield _Row("damping by past speed", DAMPING[2:], squared)
    yield _Row("swinging load", list(_swings(scales)), [ONE])


def _swings(scales: Scales) -> Iterator[Channel]:
    """Forces of loads that swing below the craft, by their deflection and by its rate."""
    for i, frequency in enumerate(scales.swings):
        omega, rates = 2 * np.pi * frequency, {}
        times = {"w_a%d" % i: Constant(omega, "rad/s", 0.0), "g_a%d" % i: Constant(0.2 * omega, "1/s", 0.0)}
        for axis, speed in (("x", "(u*cos(psi)-v*sin(psi))"), ("y", "(u*sin(psi)+v*cos(psi))")):
            a, b = "a%d%s" % (i, axis), "b%d%s" % (i, axis)
            rates.update({a: b, b: "{w_a%d}^2*(%s-%s)-{g_a%d}*%s" % (i, speed, a, i, b)})
        for kind, unit, what in (("a", "m/s", "deflection"), ("b", "m/s^2", "rate")):
            x, y = "%s%dx" % (kind, i), "%s%dy" % (kind, i)
            parts = {
                "X": "%%s*(%s*cos(psi)+%s*sin(psi))" % (x, y),
                "Y": "%%s*(%s*cos(psi)-%s*sin(psi))" % (y, x),
            }
            words = "a force along the %s of a load that swings at {w_a%d}" % (what, i)
            yield Channel(parts, words, unit, frozenset([PAST]), {}, Memory(rates, times))


def _fields(scales: Scales) -> Iterator[_Row]:
    """Families of random waves over the floor, which mean nothing by themselves."""
    random, room = np.random.default_rng(5), channels.directions(2, np.pi)
    for name, (length, count) in FIELDS.items():
        vectors = random.normal(size=(count, 2)) / (length * scales.extent)
        phases = random.uniform(0, 2 * np.pi, count)
        texts = ["cos(%.5g*x+(%.5g)*y+(%.4g))" % (a, b, p) for (a, b), p in zip(vectors, phases)]
        waves = scalars.of([PLACE], [(text, "-") for text in texts])
        yield _Row("%s field of force" % name, room, waves)
        if name != "fine":
            yield _Row("%s field of moment" % name, ON_BODY[2:], waves)
            yield _Row("%s field of damping" % name, [ALONG], waves)


def wrenches(features: Sequence[Feature], model: _core.Model, sampled: Samples) -> Array:
    """Wrenches (n, 3, features) of features at a run's samples, in their own units: X, Y, N in the
    body's frame."""
    known = namespace(sampled)
    push = _directions(model, sampled)
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


def followed(model: _core.Model, sampled: Samples) -> Array:
    """Wrenches (n, 3, k) that a change of the nominal parameters has as well: of the thrusters, of
    the damping. A change of the yaw inertia scales all moments, so that moments count by themselves."""
    v = sampled.values
    thrust = np.zeros((len(v["u"]), 3))
    for channel, direction in _directions(model, sampled).items():
        thrust += v["u_" + channel[len("thrust_") :]][:, None] * direction
    none = np.zeros_like(v["u"])
    columns = [
        np.column_stack([thrust[:, 0], thrust[:, 1], none]),
        np.column_stack([none, none, thrust[:, 2]]),
        np.column_stack([v["u"], none, none]),
        np.column_stack([none, v["v"], none]),
        np.column_stack([none, none, v["r"]]),
    ]
    return np.stack(columns, axis=2)


def _directions(model: _core.Model, sampled: Samples) -> Dict[str, Array]:
    """Wrench (n or 1, 3) of a thrust of 1 N of each thruster, by the name of its channel in formulas: at the
    samples where angles turn thrusters or their streams."""
    names, angles = inputs(model), channels.angles(model)
    held = np.column_stack(
        [sampled.values[name] if name[2:] in angles else 0 * sampled.times for name in names]
    )
    found = {}
    for number, name in enumerate(names):
        if name[2:] in angles:
            continue
        alone = held if angles else np.zeros((1, len(names)))
        alone[:, number] = 1.0
        rows = np.array(model.forces(alone), float)
        alone[:, number] = 0.0
        size = np.maximum(np.hypot(rows[:, :1], rows[:, 1:2]), 1e-12)
        found["thrust_" + name[2:]] = rows / size * np.array([1.0, 1.0, model.value("l")])
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
