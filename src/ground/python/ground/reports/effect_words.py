"""Values of effects in sentences: what an effect does to the craft, how much, and to which side."""

import math
import re
from dataclasses import dataclass
from typing import Callable, Dict, Iterable, Mapping, NamedTuple, Sequence, Tuple, Union

from ground.effect_library import candidates
from ground.effect_library.parameters import FittedParameter
from ground.reports.words import listed, two_digits


class Estimate(NamedTuple):
    """A value of a parameter with the ends of its 95% interval."""

    value: float
    low: float
    high: float
    unit: str

    @classmethod
    def of(cls, value: float, interval: Tuple[float, float], unit: str, identified: bool) -> "Estimate":
        """An estimate; one that is not identified may be anything."""
        return cls(value, *(interval if identified else (-math.inf, math.inf)), unit)

    def contains(self, value: float) -> bool:
        """Whether the interval contains a value."""
        return self.low <= value <= self.high


@dataclass(frozen=True)
class Clause:
    """What one parameter does. In the text, {} is its size in `unit` (default: its own), {NAME} the value of
    another parameter, and [a|b] becomes a where the value is above the neutral one, else b."""

    parameter: str
    text: str
    unit: str = ""
    size: Callable[[float], float] = abs
    neutral: float = 0.0  # value at which it does nothing


@dataclass(frozen=True)
class Clauses:
    """What each parameter does, after common words."""

    lead: str
    clauses: Sequence[Clause]


@dataclass(frozen=True)
class Vector:
    """An effect that is a vector in the room, with its components along x and y. In the text, {} is its
    length."""

    first: str
    second: str
    text: str
    unit: str
    size: Callable[[float], float] = abs


@dataclass(frozen=True)
class Map:
    """An effect with a value at each of many places: common words, then texts for the largest and for the
    smallest of them, with the value and the place."""

    lead: str
    texts: Tuple[str, str]


Words = Union[Clauses, Vector, Map]


def _halfway(power: float) -> float:
    """Relative change of the thrust at half of the full input by the power of a curve."""
    return abs(math.pow(0.5, power - 1) - 1)


def _inverse(value: float) -> float:
    """1 over a value."""
    return 1 / value


def _clauses(*words: Union[str, Clause]) -> Clauses:
    """Clauses, perhaps after common words."""
    lead = "".join(word for word in words if isinstance(word, str))
    return Clauses(lead, [word for word in words if isinstance(word, Clause)])


# Effects of the library by name; an effect of one thruster without its name, for which THRUSTER stands
EFFECTS: Dict[str, Words] = {
    "wind": Vector("wx", "wy", "it blows at {}", "m/s"),
    "current": Vector("wx", "wy", "it flows at {}", "m/s"),
    "floor_tilt": Vector("sx", "sy", "it descends by {}", "deg", math.atan),
    "floor_friction_map": Map("the damping is ", ("up to {} larger at {}", "up to {} smaller at {}")),
    "added_mass": _clauses(
        "the craft accelerates as if it were ",
        Clause("mx", "{} heavier ahead"),
        Clause("my", "{} heavier sideways"),
    ),
    "com_offset": _clauses(
        "the centre of mass is ",
        Clause("xg", "{} [ahead of|behind] the origin"),
        Clause("yg", "{} to the [right|left] of the origin"),
    ),
    "marker_offset": _clauses(
        "the tracked point is ",
        Clause("dx", "{} [ahead of|behind] the origin"),
        Clause("dy", "{} to the [right|left] of the origin"),
    ),
    "heading_offset": _clauses(
        Clause("psi0", "the measured heading is {} too far to the [right|left]", "deg")
    ),
    "thrust_asymmetry": _clauses(
        Clause("a", "the left side pushes {} [more|less] and the right side pushes {} [less|more]", "%")
    ),
    "thruster_gain": _clauses(Clause("a", "THRUSTER pushes {} [more|less] than in the model", "%")),
    "thruster_tilt": _clauses(
        Clause("angle", "THRUSTER is turned {} to the [right|left], seen from above", "deg")
    ),
    "thrust_misalignment": _clauses(Clause("angle", "the thrust is turned {} to the [right|left]", "deg")),
    "thrust_curve": _clauses(
        Clause("p", "at half of the full input the thrust is {} [smaller|larger]", "%", _halfway, 1)
    ),
    "reverse_loss": _clauses(Clause("a", "the reverse thrust is {} [smaller|larger]", "%")),
    "propeller_loss": _clauses(
        Clause("b", "at full revolutions the thrust [falls|rises] by {} per m/s ahead", "%"),
    ),
    "thrust_speed_loss": _clauses(Clause("c", "the thrust [falls|rises] by {} per m/s along it", "%")),
    "thrust_sway_moment": _clauses(
        Clause("c", "1 N of thrust at 1 m/s to the right turns the craft to the [right|left] with {}", "N m")
    ),
    "differential_side_force": _clauses(
        Clause(
            "c",
            "thrust that turns the craft to the right also pushes the craft to the [right|left], with {} of "
            "the difference of the thrusts",
            "%",
        )
    ),
    "battery_sag": _clauses(Clause("tau", "the thrust falls to 37% within {} of a drive", neutral=math.inf)),
    "battery_voltage": _clauses(
        Clause("p", "a 10% lower voltage gives {} less thrust", "%", lambda p: 1 - math.pow(0.9, p))
    ),
    "supply_sag": _clauses(
        Clause("part", "full load takes {} of every input, with a time constant of {time}", "%")
    ),
    "thrust_droop": _clauses(
        Clause("part", "a thruster at full input loses {} of it, with a time constant of {time}", "%")
    ),
    "supply_droop": _clauses(
        Clause("s", "each other thruster at full input takes {} of the thrust", "%", lambda s: s / (1 + s))
    ),
    "motor_lag": _clauses(Clause("tau", "the thrust completes 63% of a change within {}")),
    "motor_rise_fall": _clauses(
        "the thrust completes 63% ",
        Clause("rise", "of a rise within {}"),
        Clause("fall", "of a fall within {}"),
    ),
    "motor_rate": _clauses(Clause("rate", "a change of an input by 1 takes {}", "s", _inverse, math.inf)),
    "valve_lag": _clauses(
        "the valves ",
        Clause("open", "open by 63% within {}"),
        Clause("close", "close by 63% within {}"),
    ),
    "input_delay": _clauses(Clause("delay", "the thrust follows its command by {}")),
    "angle_lag": _clauses(Clause("tau", "THRUSTER completes 63% of a turn within {}")),
    "angle_rate": _clauses(Clause("rate", "THRUSTER turns at most at {}", "deg/s", neutral=math.inf)),
    "angle_gain": _clauses(Clause("a", "THRUSTER turns {} [farther|less far] than commanded", "%")),
    "angle_offset": _clauses(
        Clause("angle", "the angle of THRUSTER is {} [above|below] the commanded angle", "deg")
    ),
    "dead_band": _clauses(Clause("width", "THRUSTER does not act on inputs of up to {}")),
    "foil_gain": _clauses(Clause("a", "the force of THRUSTER is {} [larger|smaller] than in the model", "%")),
    "foil_inflow": _clauses(
        Clause("speed", "{} [more|less] of the square of the craft's own speed reaches THRUSTER", "%"),
        Clause("sway", "{} [more|less] of the craft's drift reaches THRUSTER", "%"),
    ),
    "foil_side": _clauses(
        Clause(
            "a",
            "THRUSTER meets {} [more|less] of a flow from the left and {} [less|more] of one from the right",
            "%",
        ),
    ),
    "quadratic_drag": _clauses(
        "the drag is ",
        Clause("cx", "{} at 1 m/s ahead", "N"),
        Clause("cy", "{} at 1 m/s sideways", "N"),
        Clause("cr", "{} at a turn of 1 rad/s", "N m"),
    ),
    "momentum_drag": _clauses(Clause("q", "at full lift and 1 m/s the drag is {}", "N")),
    "sway_yaw_damping": _clauses(
        Clause("yr", "a turn to the right at 1 rad/s pushes the craft to the [left|right] with {}", "N"),
        Clause("nv", "a drift to the right at 1 m/s turns the craft to the [left|right] with {}", "N m"),
    ),
    "coulomb_friction": _clauses(
        "the floor brakes ",
        Clause("f", "a motion with {}"),
        Clause("n", "a turn with {}"),
    ),
    "skirt_friction": _clauses(
        "without lift the floor brakes ",
        Clause("f0", "a motion with {}"),
        Clause("n0", "a turn with {}"),
    ),
    "directional_yaw_damping": _clauses(
        Clause("na", "yaw damping is {} [larger|smaller] to the right and {} [smaller|larger] to the left")
    ),
    "body_force_bias": _clauses(
        "the craft is pushed ",
        Clause("x0", "[ahead|back] with {}"),
        Clause("y0", "to the [right|left] with {}"),
    ),
    "yaw_bias": _clauses(Clause("n0", "a moment of {} turns the craft to the [right|left]")),
    "surge_resistance": _clauses(Clause("xuu", "the resistance at 1 m/s ahead is {}", "N")),
    "drift_resistance": _clauses(
        "the craft is pushed ",
        Clause("xvv", "[back|ahead] with {} by a drift of 1 m/s", "N"),
        Clause("xrr", "[back|ahead] with {} by a turn at 1 rad/s", "N"),
        Clause("xvr", "[back|ahead] with {} more where both are to the same side", "N"),
    ),
    "hull_lift": _clauses(
        "at 1 m/s ahead, ",
        Clause("yv", "a drift of 1 m/s to the right pushes the craft to the [left|right] with {}", "N"),
        Clause("nv", "a drift of 1 m/s to the right turns the craft to the [left|right] with {}", "N m"),
        Clause("yr", "a turn of 1 rad/s to the right pushes the craft to the [left|right] with {}", "N"),
        Clause("nr", "a turn of 1 rad/s to the right turns the craft to the [left|right] with {}", "N m"),
    ),
    "hull_nonlinear": _clauses(
        "at V = v = 1 m/s and r = 1 rad/s, ",
        Clause("xvvvv", "v^4/V^2 pushes the craft [ahead|back] with {}", "N"),
        *(
            Clause(side + name, "%s/V %s the craft to the [left|right] with {}" % (term, does), unit)
            for side, does, unit in (("y", "pushes", "N"), ("n", "turns", "N m"))
            for name, term in (("vvv", "v^3"), ("vvr", "v^2 r"), ("vrr", "v r^2"), ("rrr", "r^3"))
        ),
    ),
    "cross_flow_drag": _clauses(
        "at 1 m/s sideways the drag is ",
        Clause("fore", "{} on the fore half", "N"),
        Clause("aft", "{} on the aft half", "N"),
    ),
}  # fmt: skip


def sentence(effect: str, estimates: Mapping[str, Estimate]) -> str:
    """What an effect of the library does with its values: "the left side pushes 8% less and the right side 8%
    more". A parameter whose interval contains the value at which it does nothing is left out. Empty where no
    parameter remains, and for effects that are not of the library."""
    kind = kind_of(effect)
    words = EFFECTS.get(kind)
    if words is None:
        return ""
    if isinstance(words, Vector):
        return _vector(words, estimates)
    if isinstance(words, Map):
        return _map(words, kind, estimates)
    told = [
        _clause(clause, estimates)
        for clause in words.clauses
        if clause.parameter in estimates and not estimates[clause.parameter].contains(clause.neutral)
    ]
    return (words.lead + listed(told)).replace("THRUSTER", effect[len(kind) + 1 :]) if told else ""


def of_fit(effect: str, rows: Iterable[FittedParameter]) -> str:
    """The sentence of an effect with the parameters of a fit."""
    own = {}
    for p in rows:
        its, _, name = p["name"].partition(".")
        if its == effect:
            own[name] = Estimate.of(p["value"], p["ci95"], p["unit"], p["identified"])
    return sentence(effect, own)


def kind_of(effect: str) -> str:
    """The name of an effect without the name of the thruster that it acts on."""
    kinds = (kind for kind in EFFECTS if effect == kind or effect.startswith(kind + "_"))
    return max(kinds, key=len, default=effect)


def with_unit(size: float, unit: str) -> str:
    """A size with its unit, in two digits: "8%", "5.7 deg", "4.2 mN"."""
    if unit == "%":
        return two_digits(100 * size) + "%"
    if unit.startswith("deg"):
        return "%s %s" % (two_digits(math.degrees(size)), unit)
    if 0 < size < 0.1 and (unit in ("s", "m", "kg") or unit.startswith("N")):
        size, unit = 1e3 * size, "g" if unit == "kg" else "m" + unit
    return ("%s %s" % (two_digits(size), unit)).rstrip(" -")


def _clause(clause: Clause, estimates: Mapping[str, Estimate]) -> str:
    own = estimates[clause.parameter]
    side = 1 if own.value > clause.neutral else 2
    told = re.sub(r"\[([^|]*)\|([^]]*)\]", lambda found: found.group(side), clause.text)
    others = {name: with_unit(abs(one.value), one.unit) for name, one in estimates.items()}
    size = with_unit(clause.size(own.value), clause.unit or own.unit)
    return re.sub(r"\{(\w*)\}", lambda found: others[found.group(1)] if found.group(1) else size, told)


def _vector(words: Vector, estimates: Mapping[str, Estimate]) -> str:
    """Length and direction: "it blows at 0.17 m/s towards -140 deg (95%: 8 deg either way; 0: the room's x,
    90: its y)"."""
    if not {words.first, words.second} <= set(estimates):
        return ""
    first, second = estimates[words.first], estimates[words.second]
    x, y = first.value, second.value
    size = math.hypot(x, y)
    if first.contains(0) and second.contains(0):
        return ""
    told = words.text.replace("{}", with_unit(words.size(size), words.unit))
    # half the interval across the vector, without the correlation of its components
    across = math.hypot(y * (first.high - first.low), x * (second.high - second.low)) / size / 2
    either_way = math.degrees(across / size)
    if not either_way < 90:
        return told + " in a direction that these runs do not determine"
    angle = round(math.degrees(math.atan2(y, x))) or 0  # no "-0"
    return "%s towards %d deg (95%%: %s deg either way; 0: the room's x, 90: its y)" % (
        told, angle, two_digits(either_way),
    )  # fmt: skip


def _map(words: Map, kind: str, estimates: Mapping[str, Estimate]) -> str:
    """The places of the largest and the smallest value."""
    places = {p["name"]: p["doc"].rpartition(" at ")[2] for p in candidates.effects()[kind]["parameters"]}
    acting = {name: one for name, one in estimates.items() if name in places and not one.contains(0)}
    told = []
    for text, sign in zip(words.texts, (1, -1)):
        name = max(acting, key=lambda name: sign * acting[name].value, default="")
        if name and sign * acting[name].value > 0:
            told.append(text.format(with_unit(abs(acting[name].value), acting[name].unit), places[name]))
    return words.lead + listed(told) if told else ""
