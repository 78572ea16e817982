"""Ways in which commands and headings may be meant, and what each channel does to the measured body."""

import itertools
import math
from dataclasses import dataclass
from typing import Dict, Iterator, List, Sequence, Tuple

import numpy as np

from ground import _core
from ground.annotations import Array

TURNS = (0.0, math.pi / 2, math.pi, -math.pi / 2)  # measured minus true heading [rad]
FRAMES = ((1, False), (-1, True), (-1, False), (1, True))  # sign of the heading, mirrored positions
MAX_PERMUTED = 5  # thrusters whose channels are tried in every order; of more, exchanged pairs
MAX_SIGNED = 4  # thrusters of which any may be inverted; of more, one
# Costs order hypotheses of one class, and those that data cannot distinguish: the cheapest is named first.
EXCHANGED = 1  # for each channel at another thruster
CHANGED_SIGN = 2  # for each inverted or dead channel
TURNED = 1  # for a heading that is off
OTHER_FRAME = 3  # for a heading of the wrong sign or mirrored positions
UPSIDE_DOWN = 4  # for both
SAME = 6  # digits to which the effects of one class agree


@dataclass(frozen=True)
class Thruster:
    """Where a thruster is and pushes, in the body's frame: x forward, y to the right."""

    name: str
    x: float  #: [m]
    y: float  #: [m]
    direction: float  #: direction of the force, from forward to the right [rad]

    @property
    def effect(self) -> Tuple[float, float, float]:
        """Force forward and to the right, and yaw moment [m], of a unit of thrust."""
        forward, right = math.cos(self.direction), math.sin(self.direction)
        return forward, right, self.x * right - self.y * forward


@dataclass(frozen=True)
class Hypothesis:
    """A way to read the commands and the poses of recordings."""

    channels: Tuple[str, ...]  #: channel of each thruster
    signs: Tuple[int, ...]  #: of each thruster's channel; -1: inverted, 0: it does not act
    heading_offset: float = 0.0  #: measured minus true heading that remains [rad]
    heading_sign: int = 1  #: -1: the measured heading is positive the other way round
    mirrored: bool = False  #: whether one axis of the positions points the other way

    @property
    def twisted(self) -> bool:
        """Whether headings and positions contradict each other, which turns measured forces."""
        return (self.heading_sign < 0) != self.mirrored

    @property
    def upside_down(self) -> bool:
        """Whether the vertical axis points the other way, which mirrors positions and headings."""
        return self.heading_sign < 0 and self.mirrored

    def cost(self, names: Sequence[str]) -> int:
        """How much it supposes to be other than recorded."""
        frame = UPSIDE_DOWN if self.upside_down else OTHER_FRAME if self.twisted else 0
        exchanged = sum(a != b for a, b in zip(self.channels, names))
        signs = CHANGED_SIGN * sum(sign != 1 for sign in self.signs)
        if set(self.signs) == {-1}:  # another convention, for all of them
            signs = CHANGED_SIGN + EXCHANGED * (len(names) - 1)
        turned = TURNED * (self.heading_offset != 0)
        return EXCHANGED * exchanged + signs + turned + frame

    def effects(self, thrusters: Sequence[Thruster], offset: float = 0.0) -> Array:
        """Force along and across the measured body's x axis, and yaw moment, that a unit of each channel
        causes; (n, 3) in the order of the thrusters' own channels. offset: additional one of the heading
        [rad]."""
        names = [thruster.name for thruster in thrusters]
        order = [self.channels.index(name) for name in names]
        rows = np.array([thruster.effect for thruster in thrusters]) * np.array(self.signs)[:, None]
        c, s = math.cos(self.heading_offset + offset), math.sin(self.heading_offset + offset)
        force = rows[:, :2] @ np.array([[c, -s], [s, c]])
        found = np.column_stack([force, rows[:, 2]])[order]
        # A frame of which both are mirrored, or only the positions, sees the mirror image.
        return np.asarray(found * [1, -1, -1]) if self.mirrored else found


@dataclass(frozen=True)
class Class:
    """Hypotheses under which each channel does the same to the measured body, the cheapest first."""

    members: Tuple[Hypothesis, ...]
    effects: Array  # (n, 3) of the channels; forces and moments each have a free factor

    @property
    def first(self) -> Hypothesis:
        """The hypothesis that supposes least."""
        return self.members[0]

    @property
    def twisted(self) -> bool:
        """Whether headings and positions contradict each other."""
        return self.first.twisted


def thrusters_of(model: _core.Model) -> List[Thruster]:
    """A model's thrusters by the names of their channels, seen by the heading that the model has."""
    turn = model.value("heading_offset.psi0") if "heading_offset" in model.effects else 0.0
    if model.is_pair:
        lever = model.value("l")
        thrusters = [Thruster("left", 0.0, -lever, 0.0), Thruster("right", 0.0, lever, 0.0)]
    else:
        thrusters = [
            Thruster(one["channel"], x, y, math.radians(one["direction"]))
            for one in model.thrusters
            for x, y in [one["position"]]
        ]
    c, s = math.cos(turn), math.sin(turn)
    return [
        Thruster(t.name, c * t.x + s * t.y, c * t.y - s * t.x, t.direction - turn)
        for t in thrusters
    ]


def recorded(thrusters: Sequence[Thruster]) -> Hypothesis:
    """The Hypothesis that all is as its names say."""
    return Hypothesis(tuple(thruster.name for thruster in thrusters), (1,) * len(thrusters))


def classes(thrusters: Sequence[Thruster]) -> List[Class]:
    """All hypotheses for a craft, in classes; the first one has that of what is recorded."""
    names = [thruster.name for thruster in thrusters]
    found: List[Hypothesis] = [
        Hypothesis(order, signs, turn, sign, mirrored)
        for order in _orders(names)
        for signs in _signs(len(names))
        for turn in TURNS
        for sign, mirrored in FRAMES
    ]
    effects = np.array([hypothesis.effects(thrusters) for hypothesis in found])
    keys = np.round(_normalised(effects), SAME) + 0.0  # no -0
    members: Dict[Tuple[bool, bytes], List[int]] = {}
    for i, hypothesis in enumerate(found):
        members.setdefault((hypothesis.twisted, keys[i].tobytes()), []).append(i)
    grouped = [
        Class(tuple(sorted((found[i] for i in own), key=lambda h: h.cost(names))), effects[own[0]])
        for own in members.values()
    ]
    return sorted(grouped, key=lambda group: group.first.cost(names))


def _normalised(effects: Array) -> Array:
    """Effects (k, n, 3) with forces and with moments of norm 1."""
    norms = np.linalg.norm(effects.reshape(len(effects), -1, 3), axis=1)
    force, moment = np.hypot(norms[:, 0], norms[:, 1]), norms[:, 2]
    scale = np.column_stack([force, force, moment])
    return np.asarray(effects / np.where(scale > 1e-12, scale, 1)[:, None, :])


def _orders(names: Sequence[str]) -> Iterator[Tuple[str, ...]]:
    if len(names) <= MAX_PERMUTED:
        yield from itertools.permutations(names)
        return
    yield tuple(names)
    for a, b in itertools.combinations(range(len(names)), 2):
        order = list(names)
        order[a], order[b] = order[b], order[a]
        yield tuple(order)


def _signs(count: int) -> Iterator[Tuple[int, ...]]:
    """Signs of all channels: inverted ones, or a dead one."""
    if count <= MAX_SIGNED:
        yield from itertools.product((1, -1), repeat=count)
    else:
        yield (1,) * count
        yield from (tuple(-1 if i == j else 1 for j in range(count)) for i in range(count))
    if count > 1:
        yield from (tuple(0 if i == j else 1 for j in range(count)) for i in range(count))
