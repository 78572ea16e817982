"""Channels that a missing wrench may act on: axes of the body and the velocity, directions of the room,
points of the room, and thrust."""

from typing import FrozenSet, List, Mapping, NamedTuple

import numpy as np

from ground import _core
from ground.analysis.samples import Scales, inputs
from ground.analysis.scalars import Constant, spread
from ground.support.annotations import Array


class Channel(NamedTuple):
    """Where a function acts: a formula for each channel, with %s for the function, and with names in braces
    for constants."""

    parts: Mapping[str, str]
    words: str  # what acts, with names in braces for constants
    unit: str = "-"
    constants: Mapping[str, Constant] = {}


_AXES = (
    ("X", "u", "m/s", "a force ahead"),
    ("Y", "v", "m/s", "a force to the right"),
    ("N", "r", "rad/s", "a moment to the right"),
)
ON_BODY = [Channel({axis: "%s"}, words) for axis, _, _, words in _AXES]
ALONG = Channel({"X": "%s*u", "Y": "%s*v"}, "a force along the velocity, in proportion to it,", "m/s")
ACROSS = Channel({"X": "%s*v", "Y": "-%s*u"}, "a force across the velocity, in proportion to it,", "m/s")
DAMPING = [
    *(
        Channel({axis: "%s*" + speed}, "%s in proportion to %s" % (words, speed), unit)
        for axis, speed, unit, words in _AXES
    ),
    ALONG,
]


def directions(count: int) -> List[Channel]:
    """Forces in some directions of the room, over half a turn."""
    parts, words = (
        {"X": "%s*cos(psi-{dr})", "Y": "-%s*sin(psi-{dr})"},
        "a force towards {dr} in the room (0 deg: its x, 90 deg: its y)",
    )
    angles = np.arange(count) * np.pi / count
    return [Channel(parts, words, "-", {"dr": Constant(a, "rad", np.pi / 2)}) for a in angles.tolist()]


def angles(model: _core.Model) -> FrozenSet[str]:
    """Names of a model's rudders and of what turns its thrusters."""
    return frozenset(one["name"] for one in model.thrusters if one["is_angle"])


def thrusts(model: _core.Model, text: str = "u_%s") -> List[Channel]:
    """Thrust of each thruster and of all together, times a formula with %s for a thruster's name."""
    names = [name[2:] for name in inputs(model) if name[2:] not in angles(model)]
    each = {"thrust_" + name: "%s*" + text.replace("%s", name) for name in names}
    made = [
        Channel({c: part}, "thrust of %s, times %s," % (name, part[3:]))
        for name, (c, part) in zip(names, each.items())
    ]
    words = "thrust, times %s," % text.replace("u_%s", "command").replace("_%s", "")
    return [*made, Channel(each, words) if len(names) > 1 else made[0]]


def channels(model: _core.Model, scales: Scales) -> List[Channel]:
    """Channels of the body, directions of the room, along and across the velocity, and thrust."""
    direction = "/sqrt(u^2+v^2+%.3g)" % scales.slow**2
    unit = [
        Channel({c: part + direction for c, part in channel.parts.items()}, channel.words.partition(",")[0])
        for channel in (ALONG, ACROSS)
    ]
    *each, every = thrusts(model)
    (first, of_first), *others = every.parts.items()
    against = [
        Channel({first: of_first, c: "-" + part}, "thrust from %s to %s," % (c[7:], first[7:]))
        for c, part in others
    ]
    return [*ON_BODY, *directions(3), ALONG, ACROSS, *unit, every, *against, *each]


def pulls(scales: Scales, x: Array, y: Array) -> List[Channel]:
    """Forces of unit size away from points on the way and around them, everywhere and near them alone. Points
    are a third of the extent apart, 20 at most; a force fades within a sixteenth of it from its point."""
    away, found = "/sqrt((x-{mx})^2+(y-{my})^2+%.3g)" % (scales.extent / 16) ** 2, []
    near = "*exp(-((x-{mx})^2+(y-{my})^2)/{mw}^2)"
    apart, wide = scales.extent / 3, scales.extent / 2
    for a, b in spread(x, y, apart, 20):
        point = {"mx": Constant(a, "m", apart), "my": Constant(b, "m", apart)}
        found += about(away, "-", point)
        found += about(near + away, "-", {**point, "mw": Constant(wide, "m", 0.7 * wide)}, ", within {mw}")
    return found


def about(text: str, unit: str, constants: Mapping[str, Constant], where: str = "") -> List[Channel]:
    """Forces away from the point mx, my and around it, times a formula that is appended. Unit 1/m of the
    formula gives unit -."""
    x, y = "(x-{mx})", "(y-{my})"
    ahead, side = "(%s*cos(psi)+%s*sin(psi))" % (x, y), "(%s*cos(psi)-%s*sin(psi))" % (y, x)
    around = "(%s*sin(psi)-%s*cos(psi))" % (x, y)
    return [
        Channel({"X": "%s*" + X + text, "Y": "%s*" + Y + text}, words + where, unit, constants)
        for X, Y, words in (
            (ahead, side, "a force away from the point ({mx}, {my})"),
            (around, ahead, "a force around the point ({mx}, {my})"),
        )
    ]
