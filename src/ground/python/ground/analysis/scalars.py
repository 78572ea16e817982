"""Functions of what was recorded that are multiplied in the screen (ground.analysis.screening): of heading,
place, velocity, commands, the past and time.

Their constants follow from where and how fast the craft moved.
"""

import itertools
from dataclasses import dataclass, field
from typing import Dict, FrozenSet, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import dictionary
from ground.analysis.dictionary import (
    COMMAND, CROSSED, FAR, HEADING, PAST, PHASES, PLACE, TIME, VELOCITY, Channel, Constant,
)  # fmt: skip
from ground.analysis.samples import MEMORIES, Samples, Scales, inputs
from ground.annotations import Array

WAVES = 6000  # wave vectors
HALF_WAVES = 8  # most half waves of the time in the longest run
FEW_WAVES = 3  # most half waves of a velocity or a command
MOST_OF = 3.5  # standard deviations that hold most of the values
BELLS = 150  # centres of bells of one size
STEPS = (0.1, 0.25, 0.5, 0.75, 0.9)  # quantiles of a variable at which a step may be
SHARP = 0.15  # width of a step, in standard deviations of its variable
ROOM = 3  # directions of the room, half a turn together
POINTS = 20  # where a force may point to, on the way of the craft
APART = 3.0  # extent over the distance between these points
FELT = 16.0  # extent over the distance from a point within which a force towards it fades
PULL_DISTANCE = "sqrt((x-{mx})^2+(y-{my})^2+%.3g)"
REACH = 2.0  # longest part of the extent, or of the time, that a bell covers: 1 / REACH


@dataclass(frozen=True)
class Scalar:
    """A function of what was recorded. text: a formula, with names in braces for its constants."""

    text: str
    unit: str
    arguments: FrozenSet[str]
    constants: Mapping[str, Constant] = field(default_factory=dict)
    states: Mapping[str, str] = field(default_factory=dict)


def _of(
    arguments: Sequence[str],
    scalars: Sequence[Tuple[str, str]],
    constants: Optional[Mapping[str, Constant]] = None,
) -> List[Scalar]:
    made = []
    for text, unit in scalars:
        own = {n: c for n, c in (constants or {}).items() if "{%s}" % n in text}
        made.append(Scalar(text, unit, frozenset(arguments), own))
    return made


ONE = Scalar("1", "-", frozenset())


def turns() -> List[Scalar]:
    """Functions of the heading that repeat with a turn or a part of it."""
    return _of([HEADING], [(text, "-") for text in dictionary.turns_of_heading()], PHASES)


def few(model: _core.Model, scales: Scales) -> List[Scalar]:
    """Scalars that all others are multiplied with."""
    names = inputs(model)
    speeds = [("u", "m/s"), ("v", "m/s"), ("r", "rad/s"), ("abs(r)", "rad/s"), ("sqrt(u^2+v^2)", "m/s")]
    commands = [(name, "-") for name in names] + [("lift", "-"), ("(%s)" % "+".join(names), "-")]
    commands += [("abs%s" % difference, "-") for difference in _from_mean(model)]
    (cx, cy), far = scales.centre, FAR * scales.extent
    middle = {"x1": Constant(cx, "m", far), "y1": Constant(cy, "m", far)}
    return [
        ONE,
        *turns(),
        *_of([VELOCITY], speeds + dictionary.signs(scales)),
        *_course(scales),
        *_of([COMMAND], commands),
        *_of_time(scales),
        *_of([PLACE], [("(x-{x1})", "m"), ("(y-{y1})", "m")], middle),
        *_past_commands(model),
    ]


def _of_time(scales: Scales) -> List[Scalar]:
    shifted = {"t2": Constant(scales.duration / 2, "s", scales.duration)}
    return _of([TIME], [("t", "s"), ("t^2", "s^2"), ("(t-{t2})", "s")], shifted)


def _past_commands(model: _core.Model) -> List[Scalar]:
    total = "+".join(inputs(model))
    return [
        Scalar("q%d" % i, "-", frozenset([PAST]), {}, {"q%d" % i: "((%s)-q%d)/%g" % (total, i, memory)})
        for i, memory in enumerate(MEMORIES)
    ]


def of_motion(model: _core.Model, scales: Scales, sampled: Sequence[Samples]) -> List[Scalar]:
    """Scalars that are multiplied with a few, other than those of the place."""
    names = ["u", "v", "r", *inputs(model)]
    every = {name: np.concatenate([s.values[name] for s in sampled]) for name in names}
    commands = [(f, "-") for f in dictionary.command_formulas(model) + _differences(model)]
    least = (0.15 * scales.speed) ** 2
    return [
        ONE,
        *turns(),
        *_of([VELOCITY], dictionary.of_velocity() + dictionary.signs(scales)),
        *_of([VELOCITY], [("%s/(u^2+v^2+%.3g)" % (f, least), "-") for f in ("u*v", "(u^2-v^2)")]),
        *_of_velocity_in_room(scales),
        *_steps(_variables(every), VELOCITY),
        *_steps(_amounts(model, every), COMMAND),
        *_waves_of(_variables(every), VELOCITY),
        *_waves_of(_amounts(model, every), COMMAND),
        *_of([COMMAND], commands),
        *_of_time(scales),
        *_waves_of_time(scales),
        *_past_commands(model),
        *_past_velocity(),
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


def _of_velocity_in_room(scales: Scales) -> List[Scalar]:
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
        found += _of([VELOCITY, HEADING], forms, constants)
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
    for cx, cy in dictionary.spread(np.column_stack([x, y]), width, BELLS // 3):
        constants = {"x0": Constant(float(cx), "m", width), "y0": Constant(float(cy), "m", width)}
        found += _of([PLACE], forms, constants)
    return found


def _past_velocity() -> List[Scalar]:
    return [
        Scalar(name, unit, frozenset([PAST]), {}, {name: "(%s-%s)/%g" % (n, name, memory)})
        for i, memory in enumerate(MEMORIES)
        for n, unit in (("u", "m/s"), ("v", "m/s"), ("r", "rad/s"))
        for name in ["w%d_%s" % (i, n)]
    ]


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
    found, width = [], max(CROSSED, scales.duration / BELLS)
    while width < scales.duration / REACH:
        for centre in np.arange(0, scales.duration, width):
            constants = {"t0": Constant(float(centre), "s", width), "t1": Constant(width, "s", 0.7 * width)}
            found.append(Scalar("exp(-((t-{t0})/{t1})^2)", "-", frozenset([TIME]), constants))
        width *= 2
    return found


def _bells_of_place(scales: Scales, x: Array, y: Array) -> List[Scalar]:
    found, places = [], np.column_stack([x, y])
    width = max(CROSSED * scales.speed, scales.extent / BELLS)
    while width < scales.extent / REACH:
        for cx, cy in dictionary.spread(places, width, BELLS):
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
    most = 2 * np.pi / max(CROSSED * scales.speed, 1e-9)
    reach = int(min(most / cell, np.sqrt(2 * WAVES / np.pi) + 2))  # WAVES are in a half disc of this radius
    side = np.arange(-reach, reach + 1)
    grid = [(i * cell, j * cell) for i, j in itertools.product(side, side) if (i, j) > (0, 0)]
    grid = sorted((k for k in grid if np.hypot(*k) <= most), key=lambda k: float(np.hypot(*k)))[:WAVES]
    return [
        Scalar("sin({kx}*x+{ky}*y+{p2})", "-", frozenset([PLACE]), {
            "kx": Constant(kx, "rad/m", cell), "ky": Constant(ky, "rad/m", cell), "p2": phase,
        })
        for kx, ky in grid
        for phase in PHASES.values()
    ]  # fmt: skip


def channels(model: _core.Model, scales: Scales) -> List[Channel]:
    """Channels of the body, directions of the room, along and across the velocity, and thrust."""
    none: FrozenSet[str] = frozenset()
    moving = frozenset([VELOCITY])
    direction = "/sqrt(u^2+v^2+%.3g)" % (0.15 * scales.speed) ** 2
    thrusts = {"thrust_" + name[2:]: name + "*%s" for name in inputs(model)}
    channels = [Channel({c: "%s"}, "-", none) for c in dictionary.CHANNELS]
    channels += [
        *(
            Channel({"X": "%s*cos(psi-{dr})", "Y": "-%s*sin(psi-{dr})"}, "-", none, {"dr": direction})
            for direction in (Constant(i * np.pi / ROOM, "rad", np.pi / 2) for i in range(ROOM))
        ),
        Channel({"X": "%s*u", "Y": "%s*v"}, "m/s", moving),
        Channel({"X": "%s*v", "Y": "-%s*u"}, "m/s", moving),
        Channel({"X": "%s*u" + direction, "Y": "%s*v" + direction}, "-", moving),
        Channel({"X": "%s*v" + direction, "Y": "-%s*u" + direction}, "-", moving),
        Channel(thrusts, "-", frozenset([COMMAND])),
    ]
    (first, of_first), *others = thrusts.items()
    channels += [Channel({first: of_first, c: "-(%s)" % f}, "-", frozenset([COMMAND])) for c, f in others]
    return channels + [Channel({c: f}, "-", frozenset([COMMAND])) for c, f in thrusts.items()]


def pulls(scales: Scales, x: Array, y: Array) -> List[Channel]:
    """Forces of unit size away from points on the way and around them, everywhere and near them alone."""
    away, found = PULL_DISTANCE % (scales.extent / FELT) ** 2, []
    near = "exp(-((x-{mx})^2+(y-{my})^2)/{mw}^2)"
    axes = {"X": "((x-{mx})*cos(psi)+(y-{my})*sin(psi))", "Y": "((y-{my})*cos(psi)-(x-{mx})*sin(psi))"}
    around = {"X": "((x-{mx})*sin(psi)-(y-{my})*cos(psi))", "Y": axes["X"]}
    apart, wide = scales.extent / APART, scales.extent / 2
    for a, b in dictionary.spread(np.column_stack([x, y]), apart, POINTS):
        point = {"mx": Constant(float(a), "m", apart), "my": Constant(float(b), "m", apart)}
        width = {"mw": Constant(wide, "m", 0.7 * wide)}
        for form in (axes, around):
            unit = {c: "%%s*%s/%s" % (text, away) for c, text in form.items()}
            found.append(Channel(unit, "-", frozenset([PLACE]), point))
            bell = {c: "%%s*%s*%s/%s" % (near, text, away) for c, text in form.items()}
            found.append(Channel(bell, "-", frozenset([PLACE]), {**point, **width}))
    return found
