"""Which channel of recordings drives which thruster, and how their heading is measured, judged by motion.

Every order of the channels, with inverted or dead ones and with a heading of another sign or zero, is a
hypothesis. Hypotheses under which each channel does the same to the measured body cannot be distinguished by
any motion: they are one class. The right class leaves the least of the accelerations unexplained: the log of
the unexplained acceleration (geometric mean of both forces and the yaw moment) is a log-likelihood per
sample. Residuals are correlated in time, so the error of a difference comes from blocks of time and the
correlation of neighbours (Vuong 1989; Newey and West 1987). The file is longer than 400 lines, because the
judgement and its words share the hypotheses.
"""

import functools
import itertools
import math
from dataclasses import asdict, dataclass, replace
from typing import Dict, Iterator, List, Sequence, Tuple

import numpy as np

from ground import _core
from ground.checks import blocks, damped, reply
from ground.reading import units
from ground.reading.recording import Recording
from ground.reading.run_settings import Settings
from ground.support.annotations import Array
from ground.support.errors import GroundError

QUARTERS = (0.0, math.pi / 2, math.pi, -math.pi / 2)  # tried offsets of the heading [rad]
FRAMES = ((1, False), (-1, True), (-1, False), (1, True))  # sign of the heading, mirrored positions
MAX_PERMUTED = 5  # thrusters whose channels are tried in every order; of more, exchanged pairs
MAX_SIGNED = 4  # thrusters of which any may be inverted; of more, one
SAME = 6  # digits to which the effects of one class agree
BLOCK, MAX_BLOCKS = 0.7, 200  # length of the blocks [turn times], and their largest number
CHANCE = 0.01  # that any wrong class is preferred to the right one, over all of them
MISALIGNED = 0.5  # largest angle of a force that may be the craft's own [rad]
ROUNDED = 0.1  # a heading's offset that is nearer to a quarter turn is one [rad]
MAX_LISTED, MAX_NAMED = 20, 3  # undecided hypotheses that are kept, and that are named
LITTLE = 0.02  # share of forces or turns that commands explain, below which they support no hypothesis
HARDLY = 0.3  # share of all classes; where more are open, none is named
NOTHING = 1e-9  # share of the largest effect below which channels cancel each other
IDLE, TOGETHER = 0.1, 0.95  # relative spread of a channel that hardly changes; correlation of two as one
AS_RECORDED = "channels and heading are as recorded"
CHANNELS, POSES = "under commands.channels in a mapping", "under poses in a mapping"
MIRRORED = "a minus before one of position's fields " + POSES
AS_MEASURED = Settings()
GRAVEST = ("swap", "mirror", "yaw", "upside_down", "invert", "dead", "offset")
OTHER_SIGN = "toggle heading: {sign: -1} " + POSES


@dataclass(frozen=True)
class Thruster:
    """Where a thruster is and pushes, in the body frame: x forward, y to the right."""

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
    signs: Tuple[int, ...]  #: sign of each thruster's channel; -1: inverted, 0: it does not act
    heading_offset: float = 0.0  #: measured minus true heading that remains [rad]
    heading_sign: int = 1  #: -1: the measured heading is positive the other way round
    mirrored: bool = False  #: whether one axis of the positions points the other way

    @property
    def twisted(self) -> bool:
        """Whether headings and positions contradict each other, which turns measured forces."""
        return (self.heading_sign < 0) != self.mirrored

    def cost(self, names: Sequence[str]) -> int:
        """How much it supposes to be other than recorded; of a class, the cheapest is named first."""
        frame = 3 if self.twisted else 4 if self.mirrored else 0
        signs = 2 * sum(sign != 1 for sign in self.signs)
        if set(self.signs) == {-1}:  # another convention, for all of them
            signs = 1 + len(names)
        exchanged = sum(a != b for a, b in zip(self.channels, names))
        return exchanged + signs + (self.heading_offset != 0) + frame

    def effects(self, thrusters: Sequence[Thruster]) -> Array:
        """Force along and across the measured body's x axis, and yaw moment, that a unit of each channel
        causes; (n, 3) in the order of the thrusters' own channels."""
        order = [self.channels.index(thruster.name) for thruster in thrusters]
        rows = np.array([thruster.effect for thruster in thrusters]) * np.array(self.signs)[:, None]
        c, s = math.cos(self.heading_offset), math.sin(self.heading_offset)
        found = np.column_stack([rows[:, :2] @ np.array([[c, -s], [s, c]]), rows[:, 2]])[order]
        # A frame of which both are mirrored, or only the positions, sees the mirror image.
        return np.asarray(found * [1, -1, -1]) if self.mirrored else found


Class = Tuple[Hypothesis, ...]  # hypotheses with the same effects, the cheapest first


@dataclass(frozen=True)
class LayoutFit:
    """A hypothesis, with what commands explain under it."""

    hypothesis: Hypothesis
    force: float  #: share of the forces that the commands explain
    turn: float  #: share of the turns
    ratio: float  #: of the accelerations that it leaves unexplained, to the same of the best hypothesis
    ratio95: Tuple[float, float]  #: interval of that ratio


@dataclass(frozen=True)
class LayoutVerdict:
    """Which hypotheses recordings support."""

    recorded: LayoutFit  #: channels by their names, heading as it is
    best: LayoutFit
    same: List[Hypothesis]  #: that predict exactly the motion of the best one
    undecided: List[LayoutFit]  #: others that the recordings do not refute, the likeliest ones
    open_share: float  #: share of all classes of hypotheses that are not refuted
    why: str  #: why not; empty where there are none

    @property
    def is_as_recorded(self) -> bool:
        """Whether the recordings do not refute the recorded channels and heading."""
        return self.best.hypothesis == self.recorded.hypothesis

    @property
    def is_unexplained(self) -> bool:
        """Whether commands explain too little of forces or turns to support what is recorded."""
        explained = min(self.best.force, self.best.turn)
        return self.is_as_recorded and bool(self.undecided) and explained < LITTLE

    @property
    def is_open(self) -> bool:
        """Whether the recordings leave open what channels and heading are."""
        return self.is_unexplained or (bool(self.undecided) and self.open_share > HARDLY)

    def describe(self) -> Dict[str, object]:
        """As plain values."""
        return asdict(self)


def thrusters_of(model: _core.Model) -> List[Thruster]:
    """A model's thrusters by the names of their channels, seen by the heading that the model has."""
    turn = model.value("heading_offset.psi0") if "heading_offset" in model.effects else 0.0
    c, s = math.cos(turn), math.sin(turn)
    found = []
    for one in model.thrusters:
        (x, y), direction = one["position"], math.radians(one["direction"]) - turn
        found.append(Thruster(one["channel"], c * x + s * y, c * y - s * x, direction))
    return found


def _orders(names: Sequence[str]) -> Iterator[Tuple[str, ...]]:
    if len(names) <= MAX_PERMUTED:
        yield from itertools.permutations(names)
        return
    yield tuple(names)
    for a, b in itertools.combinations(names, 2):
        yield tuple({a: b, b: a}.get(name, name) for name in names)


def _signs(count: int) -> Iterator[Tuple[int, ...]]:
    """Signs of all channels: inverted ones, or a dead one."""
    yield from itertools.product((1, -1), repeat=count) if count <= MAX_SIGNED else [(1,) * count]
    for sign in ((0,) if count <= MAX_SIGNED else (-1, 0))[: 2 * (count > 1)]:
        yield from (tuple(sign if i == j else 1 for j in range(count)) for i in range(count))


@functools.lru_cache(maxsize=8)
def classes(thrusters: Tuple[Thruster, ...]) -> List[Class]:
    """All hypotheses for a craft, in classes. The first class has the hypothesis as recorded."""
    names = [thruster.name for thruster in thrusters]
    found: Dict[Tuple[bool, bytes], List[Hypothesis]] = {}
    for order, signs, turn, frame in itertools.product(_orders(names), _signs(len(names)), QUARTERS, FRAMES):
        one = Hypothesis(order, signs, turn, *frame)
        effects = one.effects(thrusters)  # forces and moments each have a free factor
        force, moment = (max(float(np.linalg.norm(e)), 1e-12) for e in (effects[:, :2], effects[:, 2]))
        scaled = effects / np.array([force, force, moment])
        found.setdefault((one.twisted, (np.round(scaled, SAME) + 0.0).tobytes()), []).append(one)
    grouped = [tuple(sorted(own, key=lambda h: h.cost(names))) for own in found.values()]
    return sorted(grouped, key=lambda group: group[0].cost(names))


@functools.lru_cache(maxsize=8)
def _effects(thrusters: Tuple[Thruster, ...]) -> Array:
    """Effects (h, n, 3) of the first hypothesis of each class."""
    return np.array([group[0].effects(thrusters) for group in classes(thrusters)])


@dataclass(frozen=True)
class _Moments:
    """Products of commands C (n channels) and accelerations A (3) in each of B blocks."""

    products: Array  # (B, n, 3) C^T A
    sizes: Array  # (B, n, n) C^T C
    totals: Array  # (B, 3) sums of A^2

    @classmethod
    def of(cls, rests: Sequence[reply.Rest], block: float) -> "_Moments":
        """Of what commands of recordings have to explain; block: least length of blocks [s]. GroundError when
        the commands change too little."""
        parts = []
        for rest in rests:
            length = max(block, len(rests) * float(np.ptp(rest.times)) / MAX_BLOCKS)
            for at in damped.pieces(rest.times, length):
                A, C = rest.accelerations[at], rest.commands[at]
                parts.append((C.T @ A, C.T @ C, (A**2).sum(axis=0)))
        found = cls(*(np.array(sums) for sums in zip(*parts))) if parts else None
        if (
            found is None
            or len(parts) < damped.MIN_BLOCKS
            or not (found.totals.sum(axis=0) > 0).all()
            or not (np.trace(found.sizes.sum(axis=0)) > 1e-9)
        ):
            raise GroundError("the commands change too little to distinguish the thrusters")
        return found

    def unexplained(self, effects: Array) -> Array:
        """Sums of squares in each block that effects (h, n, 3) leave, (h, B, 3). Forces share a factor that
        is not negative, moments have another one."""
        P, S, t = self.products.sum(axis=0), self.sizes.sum(axis=0), self.totals.sum(axis=0)
        noise = t - (P * (np.linalg.pinv(S, rcond=1e-6) @ P)).sum(axis=0)  # what no linear function explains
        weights = 1 / np.maximum(noise, 1e-6 * t)
        p = np.einsum("hnc,bnc->hbc", effects, self.products)
        s = np.einsum("hnc,bnm,hmc->hbc", effects, self.sizes, effects, optimize=True)
        largest = (effects**2).sum(axis=1) * np.trace(S)  # that an effect has if all channels act together
        factors = np.zeros((len(effects), 1, 3))
        for some in (slice(0, 2), slice(2, 3)):
            size = (s[..., some] * weights[some]).sum(axis=(1, 2))
            product = np.maximum((p[..., some] * weights[some]).sum(axis=(1, 2)), 0)
            acts = size > NOTHING * (largest[:, some] * weights[some]).sum(axis=1)
            factors[:, 0, some] = (product / np.where(acts, size, np.inf))[:, None]
        return np.asarray(self.totals - 2 * factors * p + factors**2 * s)


@dataclass(frozen=True)
class _Evidence:
    """What recordings say about the classes of hypotheses for a craft."""

    thrusters: Sequence[Thruster]
    classes: Sequence[Class]
    moments: Dict[bool, _Moments]  # by whether headings and positions contradict
    chance: float  # that any wrong class is preferred to the right one, over all of them
    unexplained: Array  # (h, B, 3)

    @classmethod
    def of(cls, thrusters: Sequence[Thruster], moments: Dict[bool, _Moments], chance: float) -> "_Evidence":
        """Of moments of a craft's motions, by whether headings and positions contradict."""
        groups = classes(tuple(thrusters))  # the first is as recorded, and alone costs nothing
        found = cls(thrusters, groups, moments, chance, np.empty(0))
        firsts = [group[0] for group in groups]
        return replace(found, unexplained=found.left(firsts, _effects(tuple(thrusters))))

    @property
    def limit(self) -> float:
        """Standard errors by which a class is worse than the likeliest one if it is wrong."""
        from scipy.special import stdtrit  # slow to load

        return float(stdtrit(self.unexplained.shape[1] - 1, 1 - self.chance / len(self.classes)))

    def not_refuted(self, alive: bool = False) -> List[int]:
        """Indices of the classes that are not clearly worse than the likeliest one; alive: of those in which
        every thruster acts."""
        weights = [np.inf if alive and 0 in group[0].signs else 0.0 for group in self.classes]
        likeliest = int(np.argmin(blocks.logs(self.unexplained)[0] + weights))
        logs, errors = self.log_ratios(self.unexplained, likeliest)
        return [int(i) for i in np.flatnonzero(logs <= self.limit * errors)]

    def left(self, some: Sequence[Hypothesis], effects: Array) -> Array:
        """_Moments.unexplained of hypotheses with effects (h, n, 3), each by the moments of its frame."""
        found = np.empty((len(some), len(self.moments[False].totals), 3))
        for twisted, moments in self.moments.items():
            rows = [i for i, one in enumerate(some) if one.twisted == twisted]
            if rows:
                found[rows] = moments.unexplained(effects[rows])
        return found

    def log_ratios(self, left: Array, index: int) -> Tuple[Array, Array]:
        """Logs of the ratios of unexplained accelerations, relative to the class `index`: (h,), and their
        standard errors."""
        logs, parts = blocks.logs(left)
        one, own = blocks.logs(self.unexplained[index : index + 1])
        return logs - one, blocks.error_of_sum(parts - own)

    def found(self, index: int, best: int) -> LayoutFit:
        """A class compared with the best one."""
        first, left = self.classes[index][0], self.unexplained[index : index + 1]
        logs, errors = self.log_ratios(left, best)
        total, unexplained = self.moments[first.twisted].totals.sum(axis=0), left[0].sum(axis=0)
        low, middle, high = np.exp(logs[0] + errors[0] * np.array([-1.96, 0, 1.96])).tolist()
        force, turn = 1 - unexplained[:2].sum() / total[:2].sum(), 1 - unexplained[2] / total[2]
        return LayoutFit(first, float(force), float(turn), middle, (low, high))

    def turned(self, index: int, limit: float) -> List[Hypothesis]:
        """The first hypothesis of a class with the heading's offset as the forces have it; none where it is
        near the quarter turn, or no more likely."""
        first = self.classes[index][0]
        moments, E = self.moments[first.twisted], first.effects(self.thrusters)
        forces = moments.products[..., 0] - 1j * moments.products[..., 1]
        parts = forces @ (E[:, 0] + 1j * E[:, 1])  # real part: along; imaginary part: across
        parts = parts.conj() if first.mirrored else parts
        angle = float(np.angle(parts.sum()))
        error = float(blocks.error_of_sum((parts / parts.sum()).imag[None])[0])
        other = replace(first, heading_offset=math.remainder(first.heading_offset + angle, 2 * math.pi))
        if first.heading_offset:
            return [other] if abs(angle) > max(ROUNDED, 3 * error) else []
        left = self.left([other], other.effects(self.thrusters)[None])
        logs, errors = self.log_ratios(left, index)
        certain = abs(angle) - limit * error > MISALIGNED and -logs[0] > limit * errors[0]
        return [other] if certain else []

    def why(self, best: int, others: Sequence[int]) -> str:
        """Why some classes are not distinguished from the best one."""
        if not others:
            return ""
        names = [thruster.name for thruster in self.thrusters]
        sizes = self.moments[self.classes[best][0].twisted].sizes.sum(axis=0)
        spread = np.sqrt(np.diag(sizes))
        own, *rest = (self.classes[i][0].effects(self.thrusters) for i in (best, *others))
        differ = np.any([np.abs(other - own).max(axis=1) > 1e-6 for other in rest], axis=0)
        idle = [n for n, s, d in zip(names, spread, differ) if d and s < IDLE * spread.max()]
        if idle:
            return "%s hardly changes" % " and ".join(idle)
        correlation = sizes / np.maximum(np.outer(spread, spread), 1e-300)
        for i, j in itertools.combinations(np.flatnonzero(differ), 2):
            if abs(correlation[i, j]) > TOGETHER:
                pair = (names[j], names[i], correlation[i, j])
                return "%s and %s always change together (correlation %.2f)" % pair
        return "their accelerations differ by less than disturbances and noise over so short a recording"


def judge(
    recordings: Sequence[Recording], thrusters: Sequence[Thruster], chance: float = CHANCE
) -> LayoutVerdict:
    """The LayoutVerdict of recordings on a craft's thrusters, which have the names of the channels. It
    follows from what commands do at once. If that leaves other ways to read them, it follows from what they
    do while damping acts. chance: that any wrong way to read them is preferred to the right one.

    GroundError when a recording has no such channel or the commands change too little.
    """
    names = [thruster.name for thruster in thrusters]
    block = BLOCK * max((reply.turn_time(recording.motion) for recording in recordings), default=0.0)
    at_once = {}
    for twisted in (False, True):
        every = [reply.rest(recording, names, twisted) for recording in recordings]
        at_once[twisted] = _Moments.of([rest for rest in every if rest is not None], block)
    first = _Evidence.of(thrusters, at_once, chance)
    open_first = first.not_refuted()
    if len(open_first) > 1:
        later = damped.rests(recordings, lambda recording: recording.commands_of(names))
        if later is not None:
            moments = {twisted: _Moments.of(own, later.block) for twisted, own in later.rests.items()}
            slow = _Evidence.of(thrusters, moments, chance)
            # That a thruster does nothing shows at once: later, a constant push looks like it.
            both = sorted(set(open_first) & set(slow.not_refuted(alive=True)))
            logs = blocks.logs(slow.unexplained)[0]
            better = [i for i in both if 0 in both or logs[i] < logs[0]]
            if 0 < len(better) < len(open_first):
                return _verdict(slow, better)
    return _verdict(first, open_first)


def _verdict(evidence: _Evidence, open_still: Sequence[int]) -> LayoutVerdict:
    """The verdict by evidence, where some classes are open."""
    groups, names = evidence.classes, [thruster.name for thruster in evidence.thrusters]
    firsts = [group[0] for group in groups]
    logs = blocks.logs(evidence.unexplained)[0]
    best = min(open_still, key=lambda i: (firsts[i].cost(names), float(logs[i])))
    others = sorted(set(open_still) - {best}, key=lambda i: float(logs[i]))
    turned = evidence.turned(best, evidence.limit)
    same = [h for h in groups[best][1:4] if h.cost(names) <= firsts[best].cost(names) + 2]
    kept = evidence.found(best, best)
    return LayoutVerdict(
        evidence.found(0, best),
        replace(kept, hypothesis=turned[0]) if turned else kept,
        [] if turned else same,
        [evidence.found(i, best) for i in others[:MAX_LISTED]],
        len(open_still) / len(groups),
        evidence.why(best, others),
    )


def kind(one: Hypothesis, names: Sequence[str]) -> str:
    """The gravest mistake that a hypothesis supposes, in a word; empty: none."""
    return min((kind for kind, _, _ in _mistakes(one, names)), key=GRAVEST.index, default="")


def suppositions(one: Hypothesis, names: Sequence[str], seem: bool = False) -> str:
    """What a hypothesis supposes, in words; seem: as a suspicion."""
    return listed([words for _, words, _ in _mistakes(one, names, seem)]) or AS_RECORDED


def remedies(one: Hypothesis, names: Sequence[str], measured: Settings) -> str:
    """The options and keys of a mapping that mend what a hypothesis supposes; measured: the settings of
    the poses."""
    return " and ".join(filter(None, (r for _, _, r in _mistakes(one, names, measured=measured))))


def _mistakes(
    one: Hypothesis, names: Sequence[str], seem: bool = False, measured: Settings = AS_MEASURED
) -> Iterator[Tuple[str, str, str]]:
    """The mistakes that a hypothesis supposes: kind, words, and what mends it."""
    is_, are = ("seems to be", "seem to be") if seem else ("is", "are")
    driven = dict(zip(names, one.channels))
    moved = [(a, b) for a, b in driven.items() if a != b]
    pairs = [(a, b) for a, b in moved if driven[b] == a and names.index(a) < names.index(b)]
    exchange = ", and ".join("%s and %s" % pair for pair in pairs)
    for pair in pairs:
        remedy = "swap the names %s %s" % (exchange, CHANNELS) if pair == pairs[0] else ""
        yield "swap", "%s and %s %s swapped" % (*pair, are), remedy
    for a, b in ((a, b) for a, b in moved if driven[b] != a):  # of a longer cycle
        yield "swap", "%s %s driven by %s" % (a, is_, b), "give %s the field of %s %s" % (a, b, CHANNELS)
    for name, channel, sign in zip(names, one.channels, one.signs):
        if sign == 0:
            remedy = "check whether the motor of %s turns, and whether %s has the right field %s"
            words = "%s %s" % (channel, "seems to do nothing" if seem else "does nothing")
            yield "dead", words, remedy % (name, channel, CHANNELS)
    inverted = [c for c, sign in zip(one.channels, one.signs) if sign < 0]
    if inverted:
        which = listed(inverted)
        if len(inverted) == len(names) > 1:
            which = "both thrusters" if len(names) == 2 else "all thrusters"
        remedy = "swap the values off and full of %s %s" % (which, CHANNELS)
        yield "invert", "%s %s inverted" % (which, is_ if len(inverted) == 1 else are), remedy
    before = measured.changes[0]
    if one.mirrored and not one.twisted:
        in_axes = '--axes "%s"' % units.upside_down(before.axes)
        remedy = in_axes if "axes" in measured.taken else "%s and %s" % (OTHER_SIGN, MIRRORED)
        yield "upside_down", "the mocap's vertical axis %s upside down" % is_, remedy
    elif one.mirrored:
        yield "mirror", "the positions %s mirrored" % are, MIRRORED
    elif one.twisted:
        yield "yaw", "the heading %s of the wrong sign" % is_, OTHER_SIGN
    if one.heading_offset:
        turned = {QUARTERS[1]: "a quarter turn", QUARTERS[2]: "half a turn"}
        size = turned.get(abs(one.heading_offset)) or "%.0f degrees" % math.degrees(one.heading_offset)
        offset = one.heading_sign * before.heading_offset + one.heading_offset
        remedy = "--heading-offset %.2f" % math.remainder(offset, 2 * math.pi)
        yield "offset", "the heading %s off by %s" % (is_, size), remedy


def evidence(verdict: LayoutVerdict) -> str:
    """What speaks for a verdict's best hypothesis."""
    best, as_is = verdict.best, verdict.recorded
    shares = 100 * best.force, 100 * best.turn
    if verdict.is_as_recorded:
        return "the commands explain %.0f%% of the forces and %.0f%% of the turns" % shares
    return (
        "the commands would then explain %.0f%% of the forces and %.0f%% of the turns; as recorded they "
        "explain %.0f%% and %.0f%%, and leave %.2f times as much unexplained (95%%: %.2f to %.2f)"
        % (*shares, 100 * as_is.force, 100 * as_is.turn, as_is.ratio, *as_is.ratio95)
    )


def sentence(verdict: LayoutVerdict) -> str:
    """A verdict with its evidence, what is the same to any motion, and what cannot be decided."""
    names = verdict.recorded.hypothesis.channels
    what = suppositions(verdict.best.hypothesis, names, True)
    if verdict.is_unexplained:
        what = "whether channels and heading are as recorded is undecided"
    parts = ["%s: %s" % (what, evidence(verdict))]
    if verdict.same and not verdict.is_as_recorded:
        same = "; or ".join(suppositions(one, names) for one in verdict.same)
        parts.append("indistinguishable in any motion: " + same)
    open_still = [suppositions(found.hypothesis, names) for found in verdict.undecided]
    if open_still and verdict.open_share > HARDLY:
        parts.append("the recordings do not decide which channel drives which thruster: %s" % verdict.why)
    elif open_still:
        others = ["another"] if len(open_still) > MAX_NAMED else []
        named = "; or ".join(open_still[:MAX_NAMED] + others)
        parts.append("it cannot be decided whether %s, because %s" % (named, verdict.why))
    return "; ".join(parts)


def listed(names: Sequence[str]) -> str:
    """ "a", "a and b", "a, b and c"."""
    return " and ".join([", ".join(names[:-1])] * (len(names) > 1) + list(names[-1:]))
