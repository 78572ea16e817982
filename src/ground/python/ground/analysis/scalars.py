"""Functions of what was recorded, of which the features of a regression are made: of heading, place,
velocity, commands, the past and time.

Their constants follow from where and how fast the craft moved.
"""

import itertools
from dataclasses import dataclass, field, replace
from typing import Dict, FrozenSet, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis.samples import Samples, Scales, inputs
from ground.support.annotations import Array

HEADING, PLACE, VELOCITY = "heading", "place", "velocity"
COMMAND, PAST, TIME = "command", "past", "time"
ARGUMENTS = (HEADING, PLACE, VELOCITY, COMMAND, PAST, TIME)
TURNS = (1, 2, 3, 4)  # harmonics of the heading
CROSSED = 0.25  # time in which the craft crosses the shortest wavelength [time scales]
FAR = 100.0  # largest distance of a point that a force may depend on, over the extent of the motion
WAVES = 6000  # wave vectors
HALF_WAVES = 8  # most half waves of the time in the longest run
FEW_WAVES = 3  # most half waves of a velocity or a command
MOST_OF = 3.5  # standard deviations that hold most of the values
BELLS = 150  # centres of bells of one size
STEPS = (0.1, 0.25, 0.5, 0.75, 0.9)  # quantiles of a variable at which a step may be
SHARP = 0.15  # width of a step, in standard deviations of its variable
NUMBER = "%.6g"  # a constant in a formula
REACH = 2.0  # longest part of the extent, or of the time, that a bell covers: 1 / REACH


class Constant(NamedTuple):
    """A constant of a formula."""

    value: float
    unit: str
    reach: float  # how far from the value it may be


# Phases of sines that are tested; {name: value}
PHASES = {"p0": Constant(0.0, "rad", np.pi), "p1": Constant(np.pi / 2, "rad", np.pi)}


@dataclass(frozen=True)
class Memory:
    """States of formulas: formulas of their rates, with names in braces for their constants of time."""

    rates: Mapping[str, str] = field(default_factory=dict)
    times: Mapping[str, Constant] = field(default_factory=dict)

    def filled(self) -> Dict[str, str]:
        """The rates with the values of the constants."""
        return {name: filled(rate, self.times) for name, rate in self.rates.items()}

    def __add__(self, other: "Memory") -> "Memory":
        return Memory({**self.rates, **other.rates}, {**self.times, **other.times})

    @staticmethod
    def mean(scales: Scales, kind: str, i: int, of: Mapping[str, str]) -> "Memory":
        """States that are means of formulas over the past, for the i-th of the scales' memories. of: formula
        by the end of the state's name."""
        time = "tau_%s%d" % (kind, i)
        rates = {
            "%s%d%s" % (kind, i, end): "((%s)-%s%d%s)/{%s}" % (text, kind, i, end, time)
            for end, text in of.items()
        }
        return Memory(rates, {time: Constant(scales.memories[i], "s", 0.0)})


@dataclass(frozen=True)
class Scalar:
    """A function of what was recorded. text: a formula, with names in braces for its constants."""

    text: str
    unit: str
    arguments: FrozenSet[str]
    constants: Mapping[str, Constant] = field(default_factory=dict)
    memory: Memory = Memory()


def filled(template: str, constants: Mapping[str, Constant]) -> str:
    """A formula with the values of its constants."""
    values = {name: NUMBER % c.value for name, c in constants.items()}
    return template.format(**{n: "(%s)" % v if v[0] == "-" else v for n, v in values.items()})


def written(constant: Constant) -> float:
    """The value of a constant as formulas have it."""
    return float(NUMBER % constant.value)


def product_of_units(units: Sequence[str]) -> str:
    """Unit of a product."""
    return "*".join(unit for unit in units if unit != "-") or "-"


def spread(points: Array, apart: float, most: int) -> Array:
    """Some of the points (n, k), the farthest from the others first, until all are near one."""
    chosen = [points[len(points) // 2]]
    nearest = ((points - chosen[0]) ** 2).sum(axis=1)
    while len(chosen) < most and nearest.max() > apart**2:
        chosen.append(points[int(np.argmax(nearest))])
        nearest = np.minimum(nearest, ((points - chosen[-1]) ** 2).sum(axis=1))
    return np.array(chosen)


def of(
    arguments: Sequence[str],
    scalars: Sequence[Tuple[str, str]],
    constants: Optional[Mapping[str, Constant]] = None,
) -> List[Scalar]:
    """Scalars of formulas and units, with those of the constants that each has."""
    made = []
    for text, unit in scalars:
        own = {n: c for n, c in (constants or {}).items() if "{%s}" % n in text}
        made.append(Scalar(text, unit, frozenset(arguments), own))
    return made


ONE = Scalar("1", "-", frozenset())


def turns() -> List[Scalar]:
    """Functions of the heading that repeat with a turn or a part of it."""
    texts = ["sin(%spsi+{%s})" % ("" if k == 1 else "%d*" % k, p) for k in TURNS for p in PHASES]
    return of([HEADING], [(text, "-") for text in texts], PHASES)


def velocities() -> List[Scalar]:
    """Functions of the velocities."""
    square, mixed, turn = "m^2/s^2", "m/s^2", "rad^2/s^2"
    speed = "sqrt(u^2+v^2)"
    return of([VELOCITY], [
        ("u", "m/s"), ("v", "m/s"), ("r", "rad/s"),
        ("u^2", square), ("v^2", square), ("r^2", turn), ("u*v", square), ("u*r", mixed), ("v*r", mixed),
        ("abs(u)*u", square), ("abs(v)*v", square), ("abs(r)*r", turn), ("abs(r)", "rad/s"),
        (speed + "*u", square), (speed + "*v", square), (speed + "*r", mixed), (speed, "m/s"),
        ("abs(r)*u", mixed), ("abs(r)*v", mixed), ("abs(u)*v", square), ("abs(v)*u", square),
        ("u^3", "m^3/s^3"), ("v^3", "m^3/s^3"), ("r^3", "rad^3/s^3"),
        ("u^2*v", "m^3/s^3"), ("v^2*u", "m^3/s^3"),
    ])  # fmt: skip


def signs(scales: Scales) -> List[Scalar]:
    """Directions of the motion: what dry friction depends on."""
    slow, slow_turn = 0.15 * scales.speed, 0.15 * scales.turn
    speed = "sqrt(u^2+v^2+%.3g)" % slow**2
    signs = [("u/" + speed, "-"), ("v/" + speed, "-")]
    for name, least in (("u", slow), ("v", slow), ("r", slow_turn)):
        signs.append(("%s/sqrt(%s^2+%.3g)" % (name, name, least**2), "-"))
    return of([VELOCITY], signs)


def commands(model: _core.Model) -> List[Scalar]:
    """Functions of the inputs of thrusters and of the lift."""
    names = inputs(model)
    pairs = ["%s*%s" % pair for pair in itertools.combinations_with_replacement(names, 2)]
    cubes = [name + "^3" for name in names]
    lifted = ["lift"] + ["lift*" + name for name in names]
    return of([COMMAND], [(f, "-") for f in names + pairs[: 3 * len(names)] + cubes + lifted])


def few(model: _core.Model, scales: Scales) -> List[Scalar]:
    """Scalars that all others are multiplied with."""
    names = inputs(model)
    speeds = [("u", "m/s"), ("v", "m/s"), ("r", "rad/s"), ("abs(r)", "rad/s"), ("sqrt(u^2+v^2)", "m/s")]
    told = [(name, "-") for name in names] + [("lift", "-"), ("(%s)" % "+".join(names), "-")]
    told += [("abs%s" % difference, "-") for difference in _from_mean(model)]
    (cx, cy), far = scales.centre, FAR * scales.extent
    middle = {"x1": Constant(cx, "m", far), "y1": Constant(cy, "m", far)}
    return [
        ONE,
        *turns(),
        *of([VELOCITY], speeds),
        *signs(scales),
        *_course(scales),
        *of([COMMAND], told),
        *_of_time(scales),
        *of([PLACE], [("(x-{x1})", "m"), ("(y-{y1})", "m")], middle),
        *means(scales, "q", {"": total(model)}),
    ]


def _of_time(scales: Scales) -> List[Scalar]:
    shifted = {"t2": Constant(scales.duration / 2, "s", scales.duration)}
    return of([TIME], [("t", "s"), ("t^2", "s^2"), ("(t-{t2})", "s")], shifted)


def total(model: _core.Model) -> str:
    """Formula of the sum of the inputs of thrusters."""
    return "(%s)" % "+".join(inputs(model))


def means(scales: Scales, kind: str, of: Mapping[str, str], unit: str = "-") -> List[Scalar]:
    """Means of formulas over the past, with each of the scales' memories. of: formula by the end of the
    mean's name."""
    return [
        Scalar(name, unit, frozenset([PAST]), {}, memory)
        for i in range(len(scales.memories))
        for end, text in of.items()
        for memory in [Memory.mean(scales, kind, i, {end: text})]
        for name in memory.rates
    ]


def less(scalar: Scalar, text: str) -> Scalar:
    """A scalar less a formula of the same unit."""
    return replace(scalar, text="(%s-%s)" % (scalar.text, text))


def of_motion(model: _core.Model, scales: Scales, sampled: Sequence[Samples]) -> List[Scalar]:
    """Scalars that are multiplied with a few, other than those of the place."""
    names = ["u", "v", "r", *inputs(model)]
    every = {name: np.concatenate([s.values[name] for s in sampled]) for name in names}
    least = (0.15 * scales.speed) ** 2
    return [
        ONE,
        *turns(),
        *velocities(),
        *signs(scales),
        *of([VELOCITY], [("%s/(u^2+v^2+%.3g)" % (f, least), "-") for f in ("u*v", "(u^2-v^2)")]),
        *in_room(scales),
        *_steps(_variables(every), VELOCITY),
        *_steps(_amounts(model, every), COMMAND),
        *_waves_of(_variables(every), VELOCITY),
        *_waves_of(_amounts(model, every), COMMAND),
        *commands(model),
        *of([COMMAND], [(f, "-") for f in _differences(model)]),
        *_of_time(scales),
        *_waves_of_time(scales),
        *means(scales, "q", {"": total(model)}),
        *means(scales, "w", {"_u": "u", "_v": "v"}, "m/s"),
        *means(scales, "w", {"_r": "r"}, "rad/s"),
        *_bells_of_time(scales),
    ]


def of_place(scales: Scales, x: Array, y: Array) -> List[Scalar]:
    """Scalars of the place that are multiplied with a few."""
    return [*_bells_of_place(scales, x, y), *_angles_of_place(scales, x, y)]


def _differences(model: _core.Model) -> List[str]:
    """Functions of the difference of each thruster's input from their mean."""
    forms = ("abs(%s)", "%s^2", "%s*abs(%s)", "%s^3", "%s/sqrt(abs(%s)+0.01)")
    return [form.replace("%s", d) for d in _from_mean(model) for form in forms]


def _from_mean(model: _core.Model) -> List[str]:
    """Differences of the inputs of thrusters from their mean; one for a pair."""
    names = inputs(model)
    mean = "(%s)/%d" % ("+".join(names), len(names))
    return ["(%s-%s)" % (name, mean) for name in (names if len(names) > 2 else names[:1])]


IN_ROOM = "(u*cos(psi+{d0})-v*sin(psi+{d0}))"  # velocity along a direction of the room


def _course(scales: Scales, directions: Sequence[float] = (0.0, np.pi / 2)) -> List[Scalar]:
    """Cosines of the angle between the velocity and directions of the room."""
    text = "%s/sqrt(u^2+v^2+%.3g)" % (IN_ROOM, (0.15 * scales.speed) ** 2)
    return [
        Scalar(text, "-", frozenset([VELOCITY, HEADING]), {"d0": Constant(direction, "rad", np.pi)})
        for direction in directions
    ]


def in_room(scales: Scales) -> List[Scalar]:
    """Functions of the velocity along directions of the room, and of the course."""
    least = (0.15 * scales.speed) ** 2
    w = IN_ROOM
    forms = [
        (w, "m/s"), ("abs(%s)" % w, "m/s"), ("%s*abs(%s)" % (w, w), "m^2/s^2"), ("%s^3" % w, "m^3/s^3"),
        ("%s/sqrt(%s^2+%.3g)" % (w, w, least), "-"), ("%s^2/(u^2+v^2+%.3g)" % (w, least), "-"),
    ]  # fmt: skip
    directions = [0.0, np.pi / 4, np.pi / 2, 3 * np.pi / 4]
    found = _course(scales, directions)
    for direction in directions:
        constants = {"d0": Constant(direction, "rad", np.pi)}
        found += of([VELOCITY, HEADING], forms, constants)
    return found


def _angles_of_place(scales: Scales, x: Array, y: Array) -> List[Scalar]:
    """Functions of the direction in which a point of the room lies."""
    a, b, found = "(x-{x0})", "(y-{y0})", []
    width = scales.extent / 4
    apart = "(%s^2+%s^2+%.3g)" % (a, b, (width / 4) ** 2)
    forms = [
        ("%s/sqrt%s" % (a, apart), "-"), ("%s/sqrt%s" % (b, apart), "-"),
        ("(%s^2-%s^2)/%s" % (a, b, apart), "-"), ("%s*%s/%s" % (a, b, apart), "-"),
        ("%s*(%s^2-3*%s^2)/%s^1.5" % (a, a, b, apart), "-"),
        ("%s*(3*%s^2-%s^2)/%s^1.5" % (b, a, b, apart), "-"),
        ("sqrt%s" % apart, "m"),
    ]  # fmt: skip
    for cx, cy in spread(np.column_stack([x, y]), width, BELLS // 3):
        constants = {"x0": Constant(float(cx), "m", width), "y0": Constant(float(cy), "m", width)}
        found += of([PLACE], forms, constants)
    return found


_Variables = Dict[str, Tuple[Array, str]]  # values and unit by formula


def _variables(every: Mapping[str, Array]) -> _Variables:
    """Velocities, speeds and slip."""
    speed = np.hypot(every["u"], every["v"])
    slow = 0.15 * float(np.sqrt((speed**2).mean()))
    slip = "v/sqrt(u^2+v^2+%.3g)" % slow**2
    return {
        "u": (every["u"], "m/s"), "v": (every["v"], "m/s"), "r": (every["r"], "rad/s"),
        "abs(u)": (abs(every["u"]), "m/s"), "abs(v)": (abs(every["v"]), "m/s"),
        "abs(r)": (abs(every["r"]), "rad/s"), "sqrt(u^2+v^2)": (speed, "m/s"),
        "abs(%s)" % slip: (abs(every["v"]) / np.hypot(speed, slow), "-"),
    }  # fmt: skip


def _amounts(model: _core.Model, every: Mapping[str, Array]) -> _Variables:
    """Inputs of thrusters, their sum, and their differences from their mean."""
    names = inputs(model)
    total = sum(every[name] for name in names)
    found = {name: (every[name], "-") for name in names}
    found["(%s)" % "+".join(names)] = (np.asarray(total), "-")
    for name, text in zip(names, _from_mean(model)):
        found[text] = (np.asarray(every[name] - total / len(names)), "-")
    return found


def _steps(variables: _Variables, argument: str) -> List[Scalar]:
    """Steps from 0 to 1 where a variable exceeds a limit."""
    found = []
    for text, (values, unit) in variables.items():
        width = SHARP * float(values.std())
        for limit in sorted(set(np.quantile(values, STEPS).tolist())) if width > 0 else []:
            away = "(%s-{s0})" % text
            constants = {
                "s0": Constant(float(limit), unit, 2 * width / SHARP),
                "s1": Constant(width, unit, 0.9 * width),
            }
            step = "(1+%s/sqrt(%s^2+{s1}^2))/2" % (away, away)
            found.append(Scalar(step, "-", frozenset([argument]), constants))
    return found


def _waves_of_time(scales: Scales) -> List[Scalar]:
    half = np.pi / scales.duration  # half a wave in the longest run [rad/s]
    return [
        Scalar("sin({wt}*t+{pt})", "-", frozenset([TIME]), {
            "wt": Constant(k * half, "rad/s", half), "pt": phase,
        })
        for k in range(1, HALF_WAVES + 1)
        for phase in PHASES.values()
    ]  # fmt: skip


def _waves_of(variables: _Variables, argument: str) -> List[Scalar]:
    """Waves of variables: up to a few half waves over most of the values."""
    found = []
    for text, (values, unit) in variables.items():
        half = np.pi / (MOST_OF * float(values.std())) if values.std() > 0 else 0.0
        per_unit = "rad" if unit == "-" else "rad/(%s)" % unit
        for k, phase in itertools.product(range(1, FEW_WAVES + 1) if half else [], PHASES.values()):
            constants = {"kq": Constant(k * half, per_unit, half / 2), "pq": phase}
            found.append(Scalar("sin({kq}*%s+{pq})" % text, "-", frozenset([argument]), constants))
    return found


def _bells_of_time(scales: Scales) -> List[Scalar]:
    found, width = [], max(CROSSED * scales.time_scale, scales.duration / BELLS)
    while width < scales.duration / REACH:
        for centre in np.arange(0, scales.duration, width):
            constants = {"t0": Constant(float(centre), "s", width), "t1": Constant(width, "s", 0.7 * width)}
            found.append(Scalar("exp(-((t-{t0})/{t1})^2)", "-", frozenset([TIME]), constants))
        width *= 2
    return found


def _bells_of_place(scales: Scales, x: Array, y: Array) -> List[Scalar]:
    found, places = [], np.column_stack([x, y])
    width = max(CROSSED * scales.time_scale * scales.speed, scales.extent / BELLS)
    while width < scales.extent / REACH:
        for cx, cy in spread(places, width, BELLS):
            constants = {
                "x0": Constant(float(cx), "m", width),
                "y0": Constant(float(cy), "m", width),
                "w0": Constant(float(width), "m", 0.7 * width),
            }
            found.append(Scalar("exp(-((x-{x0})^2+(y-{y0})^2)/{w0}^2)", "-", frozenset([PLACE]), constants))
        width *= 2
    return found


def waves(scales: Scales, x: Array, y: Array) -> List[Scalar]:
    """Waves in the plane: so many that each other one is near one of them, the longest first."""
    cell = 1.2 / max(float(np.hypot(x.std(), y.std())), 1e-6)  # waves that are nearer look alike [rad/m]
    most = 2 * np.pi / max(CROSSED * scales.time_scale * scales.speed, 1e-9)
    reach = int(min(most / cell, np.sqrt(2 * WAVES / np.pi) + 2))  # WAVES are in a half disc of this radius
    side = np.arange(-reach, reach + 1)
    pairs = [(i, j) for i, j in itertools.product(side, side) if (i, j) > (0, 0)]
    grid = cell * np.array(pairs, float).reshape(-1, 2)
    size, arguments, found = np.hypot(*grid.T), frozenset([PLACE]), []
    order = np.argsort(size, kind="stable")
    for kx, ky in grid[order[size[order] <= most][:WAVES]].tolist():
        vector = {"kx": Constant(kx, "rad/m", cell), "ky": Constant(ky, "rad/m", cell)}
        for phase in PHASES.values():
            found.append(Scalar("sin({kx}*x+{ky}*y+{p2})", "-", arguments, {**vector, "p2": phase}))
    return found
