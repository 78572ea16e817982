"""Channels that a missing wrench may act on: axes of the body and the velocity, directions of the room,
points of the room, and thrust."""

from dataclasses import dataclass, field
from typing import FrozenSet, List, Mapping, Optional

import numpy as np

from ground import _core
from ground.analysis.samples import Scales, inputs
from ground.analysis.scalars import COMMAND, PLACE, VELOCITY, Constant, Memory, spread
from ground.support.annotations import Array

ROOM = 3  # directions of the room, half a turn together
POINTS = 20  # where a force may point to, on the way of the craft
APART = 3.0  # extent over the distance between these points
FELT = 16.0  # extent over the distance from a point within which a force towards it fades


@dataclass(frozen=True)
class Channel:
    """Where a function acts: a formula for each channel, with %s for the function, and with names in braces
    for constants."""

    parts: Mapping[str, str]
    words: str  # what acts, with names in braces for constants
    unit: str = "-"
    arguments: FrozenSet[str] = frozenset()
    constants: Mapping[str, Constant] = field(default_factory=dict)
    memory: Memory = Memory()


BODY = {"X": "a force ahead", "Y": "a force to the side", "N": "a moment"}
ON_BODY = [Channel({c: "%s"}, words) for c, words in BODY.items()]
_MOVING, _COMMAND = frozenset([VELOCITY]), frozenset([COMMAND])
ALONG = Channel(
    {"X": "%s*u", "Y": "%s*v"}, "a force along the velocity, in proportion to it,", "m/s", _MOVING
)
ACROSS = Channel(
    {"X": "%s*v", "Y": "-%s*u"}, "a force across the velocity, in proportion to it,", "m/s", _MOVING
)
DAMPING = [
    *(
        Channel({c: "%s*" + speed}, "%s in proportion to %s" % (BODY[c], speed), unit, _MOVING)
        for c, speed, unit in zip("XYN", "uvr", ("m/s", "m/s", "rad/s"))
    ),
    ALONG,
]


def directions(count: int, over: float) -> List[Channel]:
    """Forces in some directions of the room, over an angle."""
    return [
        Channel(
            {"X": "%s*cos(psi-{dr})", "Y": "-%s*sin(psi-{dr})"}, "a force in the direction {dr} of the room",
            "-", frozenset(), {"dr": Constant(i * over / count, "rad", np.pi / 2)},
        )
        for i in range(count)
    ]  # fmt: skip


def angles(model: _core.Model) -> FrozenSet[str]:
    """Names of a model's rudders and of what turns its thrusters."""
    return frozenset(one["name"] for one in model.thrusters if one["is_angle"])


def thrusts(
    model: _core.Model,
    text: str = "u_%s",
    argument: str = COMMAND,
    memory: Optional[Memory] = None,
) -> List[Channel]:
    """Thrust of each thruster and of all together, times a formula with %s for a thruster's name."""
    kept, made = memory or Memory(), []
    names = [name[2:] for name in inputs(model) if name[2:] not in angles(model)]
    each = {name: "%s*" + text.replace("%s", name) for name in names}
    for some in [*([name] for name in each), list(each)]:
        words = "thrust of %s, times %s," % (some[0], each[some[0]][3:])
        if len(some) > 1:
            words = "thrust, times %s," % text.replace("u_%s", "command").replace("_%s", "")
        own = {s: rate for s, rate in kept.rates.items() if any(s in each[name] for name in some)}
        parts = {"thrust_" + name: each[name] for name in some}
        made.append(Channel(parts, words, "-", frozenset([argument]), {}, Memory(own, kept.times)))
    return made


def channels(model: _core.Model, scales: Scales) -> List[Channel]:
    """Channels of the body, directions of the room, along and across the velocity, and thrust."""
    direction = "/sqrt(u^2+v^2+%.3g)" % (0.15 * scales.speed) ** 2
    unit = [
        Channel({c: part + direction for c, part in channel.parts.items()}, words, "-", _MOVING)
        for channel, words in ((ALONG, "a force along the velocity"), (ACROSS, "a force across the velocity"))
    ]
    *each, every = thrusts(model)
    (first, of_first), *others = every.parts.items()
    against = [
        Channel({first: of_first, c: "-%s" % f}, "thrust from %s to %s," % (c[7:], first[7:]), "-", _COMMAND)
        for c, f in others
    ]
    return [*ON_BODY, *directions(ROOM, np.pi), ALONG, ACROSS, *unit, every, *against, *each]


def pulls(scales: Scales, x: Array, y: Array) -> List[Channel]:
    """Forces of unit size away from points on the way and around them, everywhere and near them alone."""
    away, found = "/sqrt((x-{mx})^2+(y-{my})^2+%.3g)" % (scales.extent / FELT) ** 2, []
    near = "*exp(-((x-{mx})^2+(y-{my})^2)/{mw}^2)"
    apart, wide = scales.extent / APART, scales.extent / 2
    for a, b in spread(np.column_stack([x, y]), apart, POINTS):
        point = {"mx": Constant(float(a), "m", apart), "my": Constant(float(b), "m", apart)}
        width = {"mw": Constant(wide, "m", 0.7 * wide)}
        found += about(away, "-", point)
        found += about(near + away, "-", {**point, **width}, ", within {mw}")
    return found


def about(text: str, unit: str, constants: Mapping[str, Constant], where: str = "") -> List[Channel]:
    """Forces away from the point mx, my and around it, times a formula that is appended. Unit 1/m of the
    formula gives unit -."""
    x, y = "(x-{mx})", "(y-{my})"
    axes = {"X": "(%s*cos(psi)+%s*sin(psi))" % (x, y), "Y": "(%s*cos(psi)-%s*sin(psi))" % (y, x)}
    around = {"X": "(%s*sin(psi)-%s*cos(psi))" % (x, y), "Y": axes["X"]}
    return [
        Channel(
            {c: "%s*" + form + text for c, form in forms.items()}, words % where, unit,
            frozenset([PLACE]), constants,
        )
        for forms, words in (
            (axes, "a force away from the point ({mx}, {my})%s"),
            (around, "a force around the point ({mx}, {my})%s"),
        )
    ]  # fmt: skip
