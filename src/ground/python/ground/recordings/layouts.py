"""How the channels of recordings belong to the thrusters of a craft, and how its heading is measured.

Every order of the channels, with inverted ones and a heading off by quarter turns, is a hypothesis. The
right one explains most of the accelerations by the commands. Hypotheses that explain as much cannot be
distinguished by these data.
"""

import itertools
import math
from dataclasses import asdict, dataclass
from typing import Iterator, List, Sequence, Tuple

import numpy as np

from ground import _core
from ground.annotations import Array, Document
from ground.errors import GroundError
from ground.recordings import reply
from ground.recordings.recording import Recording

TURNS = (0.0, math.pi / 2, math.pi, -math.pi / 2)  # measured minus true heading [rad]
MAX_PERMUTED = 6  # thrusters whose channels are tried in every order; of more, exchanged pairs
MAX_SIGNED = 4  # thrusters of which any may be inverted; of more, one
INVERTED = 2  # distance of a hypothesis for each inverted channel; 1 for each exchanged one
NEAR = 1  # additional distance up to which hypotheses are named beside the best one
ALIKE = 0.02  # shares that differ by less are the same


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
    """A way to read the commands and the heading of recordings."""

    channels: Tuple[str, ...]  #: channel of each thruster
    signs: Tuple[int, ...]  #: -1: the channel is inverted
    heading_offset: float  #: measured minus true heading that remains [rad]
    force: float  #: share of the forces that the commands explain so
    turn: float  #: share of the turns

    @property
    def share(self) -> float:
        """Mean of both shares."""
        return 0.5 * (self.force + self.turn)


@dataclass(frozen=True)
class Verdict:
    """Best and equally good hypotheses for recordings."""

    recorded: Hypothesis  #: channels by their names, heading as it is
    best: Hypothesis
    alike: List[Hypothesis]  #: hypotheses as simple that explain as much

    @property
    def is_as_recorded(self) -> bool:
        """Whether no hypothesis explains more than the recorded channels and heading."""
        return self.best.share - self.recorded.share < ALIKE

    def describe(self) -> Document:
        """As plain values."""
        return asdict(self)

    def sentence(self, thrusters: Sequence[Thruster]) -> str:
        """The verdict in words, with its evidence."""
        text = "%s: the commands explain %.0f%% of the forces and %.0f%% of the turns" % (
            _words(self.best, thrusters),
            100 * self.best.force,
            100 * self.best.turn,
        )
        if not self.is_as_recorded:
            text += " then, %.0f%% and %.0f%% as they are" % (
                100 * self.recorded.force,
                100 * self.recorded.turn,
            )
        if self.alike:
            others = "; or ".join(_words(one, thrusters) for one in self.alike)
            text += "; these data cannot distinguish it from: %s" % others
        return text


def thrusters_of(model: _core.Model) -> List[Thruster]:
    """A model's thrusters, by the names of their channels."""
    if model.is_pair:
        lever = model.value("l")
        return [Thruster("left", 0.0, -lever, 0.0), Thruster("right", 0.0, lever, 0.0)]
    return [
        Thruster(one["channel"], *one["position"], math.radians(one["direction"]))
        for one in model.thrusters
    ]


def _words(hypothesis: Hypothesis, thrusters: Sequence[Thruster]) -> str:
    moved = [
        "%s is driven by %s" % (thruster.name, channel)
        for thruster, channel in zip(thrusters, hypothesis.channels)
        if thruster.name != channel
    ]
    moved += [
        "%s is inverted" % channel
        for channel, sign in zip(hypothesis.channels, hypothesis.signs)
        if sign < 0
    ]
    if hypothesis.heading_offset:
        moved.append("the heading is off (--heading-offset %.2f)" % hypothesis.heading_offset)
    return ", ".join(moved) or "channels and heading fit as they are"


def judge(recordings: Sequence[Recording], thrusters: Sequence[Thruster]) -> Verdict:
    """The Verdict of recordings on a craft's thrusters, whose names are those of the channels.

    GroundError when a recording has no such channel or the commands change too little.
    """
    names = [thruster.name for thruster in thrusters]
    products, sizes, total = _moments(recordings, names)
    effects = np.array([thruster.effect for thruster in thrusters])
    found: List[Hypothesis] = []
    for order in _orders(len(names)):
        # row i of the effects belongs to the channel order[i]
        P, S = products[list(order)], sizes[np.ix_(order, order)]
        channels = tuple(names[i] for i in order)
        for signs in _signs(len(names)):
            signed = effects * np.array(signs)[:, None]
            turn = _explained(signed[:, 2], P[:, 2], S) / total[1]
            found += [
                Hypothesis(channels, signs, offset, _force(signed, offset, P, S) / total[0], turn)
                for offset in TURNS
            ]
    recorded = found[0]
    ranked = sorted(found, key=lambda h: (-round(h.share / ALIKE), _distance(h, names)))
    best = recorded if ranked[0].share - recorded.share < ALIKE else ranked[0]
    most = _distance(best, names) + NEAR
    alike = [
        h
        for h in ranked
        if h is not best and best.share - h.share < ALIKE and _distance(h, names) <= most
    ]
    return Verdict(recorded, best, alike)


def _orders(count: int) -> Iterator[Tuple[int, ...]]:
    if count <= MAX_PERMUTED:
        yield from itertools.permutations(range(count))
        return
    yield tuple(range(count))
    for a, b in itertools.combinations(range(count), 2):
        order = list(range(count))
        order[a], order[b] = b, a
        yield tuple(order)


def _signs(count: int) -> Iterator[Tuple[int, ...]]:
    if count <= MAX_SIGNED:
        yield from itertools.product((1, -1), repeat=count)
        return
    yield (1,) * count
    for i in range(count):
        yield tuple(-1 if i == j else 1 for j in range(count))


def _distance(hypothesis: Hypothesis, names: Sequence[str]) -> int:
    """Number of changes in a hypothesis: exchanged and inverted channels, and the heading."""
    moved = sum(a != b for a, b in zip(hypothesis.channels, names))
    inverted = INVERTED * hypothesis.signs.count(-1)
    return moved + inverted + (hypothesis.heading_offset != 0)


def _moments(
    recordings: Sequence[Recording], names: Sequence[str]
) -> Tuple[Array, Array, Tuple[float, float]]:
    """Products of the commands with force and turn (n, 3), of the commands with each other (n, n), and
    the sums of squares of force and of turn, without what the velocities explain."""
    products, sizes = np.zeros((len(names), 3)), np.zeros((len(names), len(names)))
    force = turn = 0.0
    for recording in recordings:
        run = recording.repaired
        found = reply.rest(recording, run.motion, run.reply["lag"] if run.reply else None, names)
        products += found.commands.T @ found.accelerations
        sizes += found.commands.T @ found.commands
        force += float((found.accelerations[:, :2] ** 2).sum())
        turn += float((found.accelerations[:, 2] ** 2).sum())
    if not (force > 0 and turn > 0 and np.trace(sizes) > 0):
        raise GroundError("the commands change too little to distinguish the thrusters")
    return products, sizes, (force, turn)


def _explained(effect: Array, products: Array, sizes: Array) -> float:
    """Fall of the sum of squares by commands of fixed effects with one factor that is not negative."""
    size, product = float(effect @ sizes @ effect), float(effect @ products)
    return product**2 / size if size > 0 and product > 0 else 0.0


def _force(effects: Array, offset: float, products: Array, sizes: Array) -> float:
    """The same of the force, in the frame of a body whose measured heading is off."""
    c, s = math.cos(offset), math.sin(offset)
    x = c * effects[:, 0] + s * effects[:, 1]
    y = -s * effects[:, 0] + c * effects[:, 1]
    size = float(x @ sizes @ x + y @ sizes @ y)
    product = float(x @ products[:, 0] + y @ products[:, 1])
    return product**2 / size if size > 0 and product > 0 else 0.0
