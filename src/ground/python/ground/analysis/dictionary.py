"""Functions of everything recorded that a missing wrench may be: one dictionary for tests, for the
ceiling and for names.

Each Feature is a wrench by formulas as model files have them, so that it can be added to a model. Features of
the same arguments and of the same form make a family. Constants (wave numbers, centres, times of
memory) follow from where and how the craft moved.
"""

import re
from dataclasses import dataclass, replace
from typing import Any, Dict, FrozenSet, Iterator, List, Mapping, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import channels, scalars
from ground.analysis.channels import ACROSS, ALONG, DAMPING, ON_BODY, Channel
from ground.analysis.samples import IN_ROOM, MEMORIES, SWINGS, Samples, Scales, evaluated, inputs, total
from ground.analysis.scalars import ONE, Constant, Scalar, arguments, filled, means, of, product_of_units
from ground.support.annotations import Array


@dataclass(frozen=True)
class Feature:
    """A wrench of size one: the product of functions on a channel. The screen's have no family."""

    channel: Channel
    factors: Sequence[Scalar] = ()
    family: str = ""  # features of the same form
    is_named: bool = True  # whether its formulas mean something by themselves

    @property
    def constants(self) -> Dict[str, Constant]:
        """The constants of the formulas, which may be fitted."""
        every = [self.channel.constants, *(scalar.constants for scalar in self.factors)]
        return {n: c for constants in every for n, c in constants.items()}

    @property
    def function(self) -> str:
        """What acts on the channel, with names in braces for constants."""
        return "*".join("(%s)" % scalar.text for scalar in self.factors) or "1"

    @property
    def template(self) -> Dict[str, str]:
        """The formulas with names in braces for constants."""
        return {channel: part % self.function for channel, part in self.channel.parts.items()}

    @property
    def parts(self) -> Dict[str, str]:
        """Formula of each channel: X, Y, N, thrust_<thruster>."""
        return {channel: filled(text, self.constants) for channel, text in self.template.items()}

    @property
    def label(self) -> str:
        """The feature in words of its formulas."""
        return ", ".join("%s: %s" % part for part in self.parts.items())

    @property
    def unit(self) -> str:
        """Unit of the formulas' values."""
        return product_of_units([*(scalar.unit for scalar in self.factors), self.channel.unit])

    @property
    def weight_unit(self) -> str:
        """Unit of the factor that makes it a wrench."""
        unit = "N m" if set(self.channel.parts) == {"N"} else "N"
        return unit if self.unit == "-" else "%s/(%s)" % (unit, self.unit)

    @property
    def arguments(self) -> FrozenSet[str]:
        """What it depends on: the heading if it has a direction in the room alone."""
        on = frozenset().union(*map(arguments, self.channel.parts.values()))
        on = (on - {"heading"}) | arguments(self.function)
        return frozenset(["past"]) if "past" in on else on or frozenset(["heading"])

    @property
    def simpler(self) -> List["Feature"]:
        """The features of the screen without one of the factors, or with the variable of a wave in its
        place."""
        if self.family or not self.factors:
            return []
        fewer = [[factor] for factor in self.factors] if len(self.factors) > 1 else [[]]
        for i, factor in enumerate(self.factors):
            fewer += [[*self.factors[:i], variable, *self.factors[i + 1 :]] for variable in factor.long]
        return [Feature(self.channel, factors) for factors in fewer]

    @property
    def dependence(self) -> str:
        """What it has in common with those that differ in their constants, or in how their formulas are
        written."""
        parts = []
        for channel, text in sorted(self.template.items()):
            text = re.sub(r"\{\w+\}|(?<=[a-z])\d+", "", text)  # constants, or the number in a state's name
            text = re.sub(r"(\w+)\^([23])", lambda found: "*".join([found[1]] * int(found[2])), text)
            factors = sorted(f for f in re.sub("[()]", "", text).split("*") if f)
            parts.append("%s: %s" % (channel, "*".join(factors)))
        return ", ".join(parts)

    def at(self, values: Mapping[str, float]) -> "Feature":
        """The same with other values of some constants."""

        def moved(one: Any) -> Any:
            constants = {n: c._replace(value=values.get(n, c.value)) for n, c in one.constants.items()}
            return one._replace(constants=constants)

        return replace(self, channel=moved(self.channel), factors=[moved(one) for one in self.factors])


Row = Tuple[str, Sequence[Channel], Sequence[Scalar]]  # a family: each function on each channel


def dictionary(model: _core.Model, scales: Scales) -> List[Feature]:
    """All Features for a model's craft and how it moved."""
    tables = ((_families(model, scales), True), (_of_the_past(model, scales), True), (_fields(scales), False))
    return [
        Feature(channel, [scalar] if scalar is not ONE else [], name, is_named)
        for table, is_named in tables
        for name, acting, factors in table
        for channel in acting
        for scalar in factors
    ]


def _families(model: _core.Model, scales: Scales) -> Iterator[Row]:
    """Families whose formulas mean something by themselves."""
    X, Y, N = ON_BODY
    room, thrust = channels.directions(2), channels.thrusts(model)
    (cx, cy), far = scales.centre, scales.far
    turns, velocities = scalars.turns(), scalars.velocities()
    yield "moment by heading", [N], turns
    yield "force by heading", [X, Y], turns
    yield "force fixed in the room", room, [ONE]
    yield "thrust by heading", thrust, turns[:4]
    yield "damping by heading", DAMPING, turns[:4]
    yield "velocity in the room", room, scalars.in_room(scales)
    centre = {"x0": Constant(cx, "m", far), "y0": Constant(cy, "m", far)}
    point = {"mx": centre["x0"], "my": centre["y0"]}
    radius = "sqrt((x-{mx})^2+(y-{my})^2+%.3g)" % (0.05 * scales.extent) ** 2
    places = "a m b m a*a m^2 a*b m^2 b*b m^2".replace("a", "(x-{x0})").replace("b", "(y-{y0})")
    by_place = of(places, centre)
    yield "force by place", room, by_place
    for text, unit in (("", "m"), ("*" + radius, "m^2"), ("/" + radius, "-")):
        yield "force about a point " + unit, channels.about(text, unit, point), [ONE]
    yield "moment by place", [N], by_place
    yield "thrust by place", thrust, by_place
    yield "damping by place", DAMPING, by_place
    yield "velocity", ON_BODY, velocities
    faster = of("r rad/s abs(r) rad/s sqrt(u^2+v^2) m/s u^2+v^2 m^2/s^2")
    yield "along and across the velocity", [ALONG, ACROSS], [ONE, *faster]
    yield "direction of motion", ON_BODY, scalars.signs(scales)
    yield "command", ON_BODY, scalars.commands(model)
    speeds = of("u m/s v m/s r rad/s sqrt(u^2+v^2) m/s u^2 m^2/s^2 v^2 m^2/s^2")
    yield "thrust by velocity", thrust, speeds
    yield "thrust and velocity", [Y, N], [s._replace(text="%s*%s" % (total(model), s.text)) for s in speeds]
    yield "lift and velocity", DAMPING, [Scalar("lift")]
    fades = [Scalar("cos(%.4g*t)" % (k * np.pi / scales.duration)) for k in range(1, 6)]
    times = [*of("t s t^2 s^2"), *fades]
    yield "time", ON_BODY, times
    yield "force in the room by time", room, times[:1]
    yield "thrust by time", thrust, times[:5]
    yield "damping by time", DAMPING, times[:2]


def _of_the_past(model: _core.Model, scales: Scales) -> Iterator[Row]:
    """Families of states of formulas (ground.analysis.samples)."""
    thrust, each = channels.thrusts(model), range(len(MEMORIES))
    forms = ("(p-u_%s)", "(p-u_%s)*u_%s", "abs(p-u_%s)*(p-u_%s)")
    late = [form.replace("p", "p%d_%%s" % i) for i in each for form in forms]
    yield "thrust by past commands", [c for form in late for c in channels.thrusts(model, form)], [ONE]
    yield "thrust by the past sum of commands", thrust[-1:], means("q")
    yield "wrench by the past sum of commands", ON_BODY[1:], means("q", less=total(model))
    yield "damping by past lift", [ALONG], means("l", less="lift")
    # full input over such times is used until something is spent
    spent = [Scalar("exp(-used/%g)" % (time * scales.time_scale)) for time in (1.0, 3.0, 10.0)]
    yield "thrust by what was used", thrust[-1:], spent
    for channel, name, unit in zip(ON_BODY, "uvr", ("m/s", "m/s", "rad/s")):
        yield "past velocity " + name, [channel], means("w_" + name, unit, name)
    words = "a force along the past velocity less the present one"
    waking = [Channel({"X": "%%s*(w%d_u-u)" % i, "Y": "%%s*(w%d_v-v)" % i}, words, "m/s") for i in each]
    yield "past velocity", waking, [ONE]
    yield "damping by past speed", DAMPING[2:], means("s", "m^2/s^2")
    swings = []
    for i in range(len(SWINGS)):
        for kind, unit, what in (("a", "m/s", "deflection"), ("b", "m/s^2", "rate")):
            x, y = ("%s%d%s" % (kind, i, axis) for axis in IN_ROOM)
            parts = {
                "X": "%%s*(%s*cos(psi)+%s*sin(psi))" % (x, y),
                "Y": "%%s*(%s*cos(psi)-%s*sin(psi))" % (y, x),
            }
            words = "a force along the %s of a load that swings at {w_a%d}" % (what, i)
            swings.append(Channel(parts, words, unit))
    yield "swinging load", swings, [ONE]


def _fields(scales: Scales) -> Iterator[Row]:
    """Families of random waves over the floor, which mean nothing by themselves."""
    random, room = np.random.default_rng(5), channels.directions(2)
    # lengths over the extent of the motion, and how many waves
    for name, length, count in (("wide", 1.0, 24), ("middle", 0.4, 40), ("fine", 0.15, 40)):
        vectors = random.normal(size=(count, 2)) / (length * scales.extent)
        phases = random.uniform(0, 2 * np.pi, count)
        texts = ["cos(%.5g*x+(%.5g)*y+(%.4g))" % (a, b, p) for (a, b), p in zip(vectors, phases)]
        waves = [Scalar(text) for text in texts]
        yield "%s field of force" % name, room, waves
        if name != "fine":
            yield "%s field of moment" % name, ON_BODY[2:], waves
            yield "%s field of damping" % name, [ALONG], waves


def wrenches(features: Sequence[Feature], model: _core.Model, sampled: Samples) -> Array:
    """Wrenches (n, 3, features) of features at a run's samples, in their own units: X, Y, N in the
    body frame."""
    acting = {**_directions(model, sampled), **dict(zip("XYN", np.eye(3)[:, None]))}
    result = np.zeros((len(sampled.times), 3, len(features)))
    done: Dict[str, Array] = {}
    for j, feature in enumerate(features):
        for channel, formula in feature.parts.items():
            if formula not in done:
                done[formula] = evaluated(formula, sampled.values)
            result[:, :, j] += done[formula][:, None] * acting[channel]
    return result


def followed(model: _core.Model, sampled: Samples) -> Array:
    """Wrenches (n, 3, k) that a change of the nominal parameters has as well: of the thrusters, of
    the damping. A change of the yaw inertia scales all moments, so that moments count by themselves."""
    thrusts = {"thrust_" + name[2:]: "%s*" + name for name in inputs(model)}
    thrusts = {c: part for c, part in thrusts.items() if c in _directions(model, sampled)}
    found = wrenches([Feature(Channel(thrusts, "")), *map(Feature, DAMPING[:3])], model, sampled)
    force, moment = found[:, :, :1] * np.array([[1], [1], [0]]), found[:, :, :1] * np.array([[0], [0], [1]])
    return np.concatenate([force, moment, found[:, :, 1:]], axis=2)


def _directions(model: _core.Model, sampled: Samples) -> Dict[str, Array]:
    """Wrench (n or 1, 3) of a thrust of 1 N of each thruster, by the name of its channel in formulas: at the
    samples where angles turn thrusters or their streams."""
    names, angles = inputs(model), channels.angles(model)
    turned = [name[2:] in angles for name in names]
    held = np.column_stack([sampled.values[name] * turn for name, turn in zip(names, turned)])
    held, found = held if angles else held[:1], {}
    for name, turn, own in zip(names, turned, np.eye(len(names))):
        if not turn:
            rows = np.array(model.forces(held + own), float)
            size = np.maximum(np.hypot(rows[:, :1], rows[:, 1:2]), 1e-12)
            found["thrust_" + name[2:]] = rows / size * np.array([1.0, 1.0, model.value("l")])
    return found
