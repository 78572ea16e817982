"""Functions of what was recorded, of which the features of a regression are made: of heading, place,
velocity, commands, the past and time.

Their constants follow from where and how fast the craft moved.
"""

import itertools
import re
from typing import FrozenSet, Iterator, List, Mapping, NamedTuple, Optional, Sequence

import numpy as np

from ground import _core
from ground.analysis.samples import MEMORIES, SHARP, Scales, evaluated, inputs, total
from ground.support.annotations import Array

# What a function may depend on, by the names in its formula
ARGUMENTS = {
    "heading": "psi", "place": "[xy]", "velocity": "[uvr]", "command": r"u_\w+|lift",
    "past": r"[pqlwsab]\d\w*|used", "time": "t",
}  # fmt: skip
WAVES = 6000  # wave vectors
BELLS = 150  # centres of bells of one size


class Constant(NamedTuple):
    """A constant of a formula."""

    value: float
    unit: str
    reach: float  # how far from the value it may be


# Phases of sines that are tested; {name: value}
PHASES = {"p0": Constant(0.0, "rad", np.pi), "p1": Constant(np.pi / 2, "rad", np.pi)}


class Scalar(NamedTuple):
    """A function of what was recorded. text: a formula, with names in braces for its constants; long: of a
    wave, its variable, to which a long one is proportional."""

    text: str
    unit: str = "-"
    constants: Mapping[str, Constant] = {}
    long: Sequence["Scalar"] = ()


ONE = Scalar("1")
SLIDING = "(u*cos(psi+{d0})-v*sin(psi+{d0}))"  # velocity along a direction of the room


def filled(template: str, constants: Mapping[str, Constant]) -> str:
    """A formula with the values of its constants."""
    values = {name: "%.6g" % c.value for name, c in constants.items()}
    return template.format(**{n: "(%s)" % v if v[0] == "-" else v for n, v in values.items()})


def arguments(text: str) -> FrozenSet[str]:
    """What a formula depends on; the past alone if it is among it."""
    words = re.findall(r"(?<!\w)[a-z]\w*", re.sub(r"\{\w+\}", "", text))
    found = [name for name, names in ARGUMENTS.items() if any(re.fullmatch(names, word) for word in words)]
    return frozenset(["past"] if "past" in found else found)


def product_of_units(units: Sequence[str]) -> str:
    """Unit of a product."""
    return "*".join(unit for unit in units if unit != "-") or "-"


def spread(x: Array, y: Array, apart: float, most: int) -> List[List[float]]:
    """Some of the points (n,), the farthest from the others first, until all are near one."""
    points = np.column_stack([x, y])
    chosen = [points[len(points) // 2]]
    nearest = ((points - chosen[0]) ** 2).sum(axis=1)
    while len(chosen) < most and nearest.max() > apart**2:
        chosen.append(points[int(np.argmax(nearest))])
        nearest = np.minimum(nearest, ((points - chosen[-1]) ** 2).sum(axis=1))
    return np.array(chosen).tolist()  # type: ignore[no-any-return]


def of(texts: str, constants: Optional[Mapping[str, Constant]] = None) -> List[Scalar]:
    """Scalars of formulas, each followed by its unit, with the constants that each has and their units."""
    words = texts.split()
    return [
        Scalar(text, unit, {n: c for n, c in (constants or {}).items() if "{%s}" % n in text})
        for text, unit in zip(words[::2], words[1::2])
    ]


def turns() -> List[Scalar]:
    """Functions of the heading that repeat with a turn or a part of it."""
    return [
        s for k in ("", "2*", "3*", "4*") for p in PHASES for s in of("sin(%spsi+{%s}) -" % (k, p), PHASES)
    ]


def velocities() -> List[Scalar]:
    """Functions of the velocities."""
    return of(
        """u m/s v m/s r rad/s u^2 m^2/s^2 v^2 m^2/s^2 r^2 rad^2/s^2 u*v m^2/s^2 u*r m/s^2 v*r m/s^2
        abs(u)*u m^2/s^2 abs(v)*v m^2/s^2 abs(r)*r rad^2/s^2 abs(r) rad/s sqrt(u^2+v^2)*u m^2/s^2
        sqrt(u^2+v^2)*v m^2/s^2 sqrt(u^2+v^2)*r m/s^2 sqrt(u^2+v^2) m/s abs(r)*u m/s^2 abs(r)*v m/s^2
        abs(u)*v m^2/s^2 abs(v)*u m^2/s^2 u^3 m^3/s^3 v^3 m^3/s^3 r^3 rad^3/s^3 u^2*v m^3/s^3 v^2*u m^3/s^3"""
    )


def signs(scales: Scales) -> List[Scalar]:
    """Directions of the motion: what dry friction depends on."""
    slow, slow_turn = scales.slow**2, (SHARP * scales.turn) ** 2
    text = "u/sqrt(u^2+v^2+s) - v/sqrt(u^2+v^2+s) - u/sqrt(u^2+s) - v/sqrt(v^2+s)".replace(
        "+s", "+%.3g" % slow
    )
    return of("%s - r/sqrt(r^2+%.3g) -" % (text, slow_turn))


def commands(model: _core.Model) -> List[Scalar]:
    """Functions of the inputs of thrusters and of the lift."""
    names = inputs(model)
    pairs = ["%s*%s" % pair for pair in itertools.combinations_with_replacement(names, 2)]
    lifted = ["lift", *("lift*" + name for name in names)]
    cubes = [name + "^3" for name in names]
    return [Scalar(text) for text in [*names, *pairs[: 3 * len(names)], *cubes, *lifted]]


def few(model: _core.Model, scales: Scales) -> List[Scalar]:
    """Scalars that all others are multiplied with."""
    (cx, cy), far = scales.centre, scales.far
    middle = {"x1": Constant(cx, "m", far), "y1": Constant(cy, "m", far)}
    differences = ["abs" + difference for difference in _from_mean(model)]
    return [
        ONE,
        *turns(),
        *of("u m/s v m/s r rad/s abs(r) rad/s sqrt(u^2+v^2) m/s"),
        *signs(scales),
        *_course(scales, [0.0, np.pi / 2]),
        *(Scalar(text) for text in [*inputs(model), "lift", total(model), *differences]),
        *_of_time(scales),
        *of("(x-{x1}) m (y-{y1}) m", middle),
        *means("q"),
    ]


def _of_time(scales: Scales) -> List[Scalar]:
    return of("t s t^2 s^2 (t-{t2}) s", {"t2": Constant(scales.duration / 2, "s", scales.duration)})


def means(kind: str, unit: str = "-", less: str = "") -> List[Scalar]:
    """Means over the past, with each memory: kind is the state's name, with the memory's number after its
    first letter; less: what is subtracted."""
    names = [kind[0] + str(i) + kind[1:] for i in range(len(MEMORIES))]
    return [Scalar("(%s-%s)" % (name, less) if less else name, unit) for name in names]


def of_motion(model: _core.Model, scales: Scales, every: Mapping[str, Array]) -> List[Scalar]:
    """Scalars that are multiplied with a few, other than scalars of the place. every: values by name."""
    slow, differences = "+%.3g" % scales.slow**2, _from_mean(model)
    slip = "abs(v/sqrt(u^2+v^2%s)) -" % slow
    variables = of("u m/s v m/s r rad/s abs(u) m/s abs(v) m/s abs(r) rad/s sqrt(u^2+v^2) m/s " + slip)
    variables += [Scalar(text) for text in [*inputs(model), total(model), *differences]]
    known = [(variable, evaluated(variable.text, every)) for variable in variables]
    varying = [(variable, values, float(values.std())) for variable, values in known if values.std() > 0]
    forms = ("abs(%s)", "%s^2", "%s*abs(%s)", "%s^3", "%s/sqrt(abs(%s)+0.01)")
    half = np.pi / scales.duration  # half a wave in the longest run [rad/s]
    return [
        ONE,
        *turns(),
        *velocities(),
        *signs(scales),
        *of("u*v/(u^2+v^2+s) - (u^2-v^2)/(u^2+v^2+s) -".replace("+s", slow)),
        *in_room(scales),
        *(step for variable, values, deviation in varying for step in _steps(variable, values, deviation)),
        # up to a few half waves over most of the values
        # 3.5 standard deviations hold most of the values; three half waves of them, and eight of the time
        *(wave for v, _, deviation in varying for wave in _sines(v, np.pi / (3.5 * deviation), 3, 0.5)),
        *commands(model),
        *(Scalar(form.replace("%s", difference)) for difference in differences for form in forms),
        *_of_time(scales),
        *_sines(Scalar("t", "s"), half, 8, 1.0, "wt", "pt"),
        *means("q"),
        *(mean for pair in zip(means("w_u", "m/s"), means("w_v", "m/s")) for mean in pair),
        *means("w_r", "rad/s"),
        *_bells_of_time(scales),
    ]


def _from_mean(model: _core.Model) -> List[str]:
    """Differences of the inputs of thrusters from their mean; one for a pair."""
    names = inputs(model)
    return [
        "(%s-%s/%d)" % (name, total(model), len(names)) for name in names[: None if len(names) > 2 else 1]
    ]


def _course(scales: Scales, directions: Sequence[float]) -> List[Scalar]:
    """Cosines of the angle between the velocity and directions of the room."""
    text = "%s/sqrt(u^2+v^2+%.3g)" % (SLIDING, scales.slow**2)
    return [Scalar(text, "-", {"d0": Constant(direction, "rad", np.pi)}) for direction in directions]


def in_room(scales: Scales) -> List[Scalar]:
    """Functions of the velocity along directions of the room, and of the course."""
    forms = "w m/s abs(w) m/s w*abs(w) m^2/s^2 w^3 m^3/s^3 w/sqrt(w^2+least) - w^2/(u^2+v^2+least) -"
    text = forms.replace("least", "%.3g" % scales.slow**2).replace("w", SLIDING)
    directions = [0.0, np.pi / 4, np.pi / 2, 3 * np.pi / 4]
    found = _course(scales, directions)
    for direction in directions:
        found += of(text, {"d0": Constant(direction, "rad", np.pi)})
    return found


def of_place(scales: Scales, x: Array, y: Array) -> List[Scalar]:
    """Scalars of the place that are multiplied with a few: bells, and functions of the direction in which a
    point of the room lies."""
    width = scales.extent / 4
    forms = (
        "a/sqrtR - b/sqrtR - (a^2-b^2)/R - a*b/R - a*(a^2-3*b^2)/R^1.5 - b*(3*a^2-b^2)/R^1.5 - sqrtR m"
        .replace("R", "(a^2+b^2+%.3g)" % (width / 4) ** 2)
        .replace("a", "(x-{x0})").replace("b", "(y-{y0})")
    )  # fmt: skip
    found = _bells_of_place(scales, x, y)
    for cx, cy in spread(x, y, width, BELLS // 3):
        found += of(forms, {"x0": Constant(cx, "m", width), "y0": Constant(cy, "m", width)})
    return found


def _steps(variable: Scalar, values: Array, deviation: float) -> Iterator[Scalar]:
    """Steps from 0 to 1 where a variable exceeds a limit, a quantile of its values."""
    away, width = "(%s-{s0})" % variable.text, SHARP * deviation
    for limit in sorted(set(np.quantile(values, (0.1, 0.25, 0.5, 0.75, 0.9)).tolist())):
        s0, s1 = Constant(limit, variable.unit, 2 * deviation), Constant(width, variable.unit, 0.9 * width)
        yield Scalar("(1+%s/sqrt(%s^2+{s1}^2))/2" % (away, away), "-", {"s0": s0, "s1": s1})


def _sines(
    variable: Scalar, half: float, most: int, reach: float, number: str = "kq", shift: str = "pq"
) -> Iterator[Scalar]:
    """Waves of a variable, up to the most half waves. half: wave number of one; reach: over it; number,
    shift: names of its constants."""
    unit = {"-": "rad", "s": "rad/s"}.get(variable.unit, "rad/(%s)" % variable.unit)
    for k, phase in itertools.product(range(1, most + 1), PHASES.values()):
        constants = {number: Constant(k * half, unit, reach * half), shift: phase}
        yield Scalar("sin({%s}*%s+{%s})" % (number, variable.text, shift), "-", constants, [variable])


def _widths(scales: Scales, extent: float, least: float) -> Iterator[float]:
    """Widths of bells, from the least one to half of an extent."""
    width = max(scales.crossed * least, extent / BELLS)
    while width < extent / 2:
        yield width
        width *= 2


def _bells_of_time(scales: Scales) -> List[Scalar]:
    return [
        Scalar("exp(-((t-{t0})/{t1})^2)", "-", {
            "t0": Constant(centre, "s", width), "t1": Constant(width, "s", 0.7 * width),
        })
        for width in _widths(scales, scales.duration, 1.0)
        for centre in np.arange(0, scales.duration, width).tolist()
    ]  # fmt: skip


def _bells_of_place(scales: Scales, x: Array, y: Array) -> List[Scalar]:
    return [
        Scalar("exp(-((x-{x0})^2+(y-{y0})^2)/{w0}^2)", "-", {
            "x0": Constant(cx, "m", width), "y0": Constant(cy, "m", width),
            "w0": Constant(width, "m", 0.7 * width),
        })
        for width in _widths(scales, scales.extent, scales.speed)
        for cx, cy in spread(x, y, width, BELLS)
    ]  # fmt: skip


def waves(scales: Scales, x: Array, y: Array) -> List[Scalar]:
    """Waves in the plane: so many that each other one is near one of them, the longest first."""
    cell = 1.2 / max(float(np.hypot(x.std(), y.std())), 1e-6)  # nearer waves are not distinguished [rad/m]
    most = 2 * np.pi / max(scales.crossed * scales.speed, 1e-9)
    reach = int(min(most / cell, np.sqrt(2 * WAVES / np.pi) + 2))  # WAVES are in a half disc of this radius
    side = np.arange(-reach, reach + 1)
    grid = cell * np.array([pair for pair in itertools.product(side, side) if pair > (0, 0)]).reshape(-1, 2)
    size = np.hypot(*grid.T)
    order = np.argsort(size, kind="stable")
    return [
        Scalar("sin({kx}*x+{ky}*y+{p2})", "-", {
            "kx": Constant(kx, "rad/m", cell), "ky": Constant(ky, "rad/m", cell), "p2": phase,
        })
        for kx, ky in grid[order[size[order] <= most][:WAVES]].tolist()
        for phase in PHASES.values()
    ]  # fmt: skip
