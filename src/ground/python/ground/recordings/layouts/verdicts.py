"""Which hypotheses recordings support, and which they cannot distinguish."""

import functools
import math
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, List, Optional, Sequence, Tuple

import numpy as np

from ground.annotations import Array, Document
from ground.recordings.layouts import evidence, hypotheses
from ground.recordings.layouts.hypotheses import Class, Hypothesis, Thruster

if TYPE_CHECKING:
    from ground.recordings.quality import Run
    from ground.recordings.recording import Recording

CHANCE = 0.01  # that any wrong class is preferred to the right one, over all of them
MISALIGNED = 0.5  # largest angle of a force that may be the craft's own [rad]
ROUNDED = 0.1  # a heading's offset that is nearer to a quarter turn is one [rad]
ROUND_ERRORS = 3.0  # so is one that is nearer than so many of its standard errors
MAX_LISTED = 20  # hypotheses that are listed as undecided
MAX_NAMED = 4  # hypotheses of a class that are named
SAME_COST = 2  # additional cost up to which they are
IDLE = 0.1  # a channel whose commands vary by less, relative to the liveliest one, hardly changes
TOGETHER = 0.95  # correlation of channels that change together


@dataclass(frozen=True)
class Found:
    """A hypothesis, with what commands explain under it."""

    hypothesis: Hypothesis
    force: float  #: share of the forces that the commands explain
    turn: float  #: share of the turns
    ratio: float  #: of the accelerations that it leaves unexplained to those of the best one
    ratio95: Tuple[float, float]  #: interval of that ratio


@dataclass(frozen=True)
class Verdict:
    """Which hypotheses recordings support."""

    recorded: Found  #: channels by their names, heading as it is
    best: Found
    same: List[Hypothesis]  #: under which the motion is exactly that of the best one
    undecided: List[Found]  #: others that the recordings do not refute, the likeliest ones
    open_share: float  #: share of all classes of hypotheses that are not refuted
    why: str  #: why not; empty where there are none

    @property
    def is_as_recorded(self) -> bool:
        """Whether the recordings do not refute the recorded channels and heading."""
        return self.best.hypothesis == self.recorded.hypothesis

    def describe(self) -> Document:
        """As plain values."""
        return asdict(self)


def judge(recordings: Sequence["Recording"], thrusters: Sequence[Thruster]) -> Verdict:
    """The Verdict of recordings on a craft's thrusters, whose names are those of the channels.

    GroundError when a recording has no such channel or the commands change too little.
    """
    return of_runs([recording.repaired for recording in recordings], thrusters)


def of_runs(runs: Sequence["Run"], thrusters: Sequence[Thruster]) -> Verdict:
    """The same of repaired recordings.

    GroundError when a recording has no such channel or the commands change too little.
    """
    names = [thruster.name for thruster in thrusters]
    gathered = evidence.gathered(runs, _classes(tuple(thrusters)), names)
    limit = _limit(gathered)
    logs, errors = gathered.log_ratios(0)
    likeliest = int(np.argmin(logs))
    logs, errors = gathered.log_ratios(likeliest)
    open_still = [int(i) for i in np.flatnonzero(logs <= limit * errors)]
    groups = gathered.classes  # the first one is that of what is recorded, and alone costs nothing
    best = min(open_still, key=lambda i: (groups[i].first.cost(names), float(logs[i])))
    others = sorted(set(open_still) - {best}, key=lambda i: float(logs[i]))
    turned = _turned(gathered, best, thrusters, limit)
    most = groups[best].first.cost(names) + SAME_COST
    same = [h for h in groups[best].members[1:MAX_NAMED] if h.cost(names) <= most]
    ratios = gathered.log_ratios(best)
    kept = _found(gathered, best, ratios)
    return Verdict(
        replace(_found(gathered, 0, ratios), hypothesis=hypotheses.recorded(thrusters)),
        replace(kept, hypothesis=turned) if turned else kept,
        [] if turned else same,
        [_found(gathered, i, ratios) for i in others[:MAX_LISTED]],
        len(open_still) / len(groups),
        _why(gathered, best, others, names),
    )


@functools.lru_cache(maxsize=8)
def _classes(thrusters: Tuple[Thruster, ...]) -> List[Class]:
    return hypotheses.classes(thrusters)


def _limit(found: evidence.Evidence) -> float:
    """Standard errors by which a class is worse than the likeliest one if it is wrong."""
    from scipy.special import stdtrit  # slow to load

    return float(stdtrit(found.blocks - 1, 1 - CHANCE / found.tried))


def _found(found: evidence.Evidence, index: int, ratios: Tuple[Array, Array]) -> Found:
    """A class; ratios: Evidence.log_ratios to the best one."""
    log, error = (float(values[index]) for values in ratios)
    force, turn = found.shares(index)
    interval = math.exp(log - 1.96 * error), math.exp(log + 1.96 * error)
    return Found(found.classes[index].first, force, turn, math.exp(log), interval)


def _turned(
    found: evidence.Evidence, index: int, thrusters: Sequence[Thruster], limit: float
) -> Optional[Hypothesis]:
    """The first hypothesis of a class with the heading's offset as the forces have it; None where it is
    near the quarter turn, or no more likely."""
    first = found.classes[index].first
    angle, error = found.angle(index)
    offset = math.remainder(first.heading_offset + angle, 2 * math.pi)
    other = replace(first, heading_offset=offset)
    if first.heading_offset:
        return other if abs(angle) > max(ROUNDED, ROUND_ERRORS * error) else None
    log, uncertain = found.log_ratio_of(Class((other,), other.effects(thrusters)), index)
    certain = abs(angle) - limit * error > MISALIGNED and -log > limit * uncertain
    return other if certain else None


def _why(
    found: evidence.Evidence, best: int, others: Sequence[int], names: Sequence[str]
) -> str:
    """Why some classes are not distinguished from the best one."""
    if not others:
        return ""
    sizes = found.moments[found.classes[best].twisted].sizes.sum(axis=0)
    spread = np.sqrt(np.diag(sizes))
    own = found.classes[best].effects
    differ = np.any([np.abs(found.classes[i].effects - own).max(axis=1) > 1e-6 for i in others], axis=0)
    idle = [n for n, s, d in zip(names, spread, differ) if d and s < IDLE * spread.max()]
    if idle:
        return "%s hardly changes" % " and ".join(idle)
    correlation = sizes / np.maximum(np.outer(spread, spread), 1e-300)
    pairs = [
        (names[i], names[j], correlation[i, j])
        for i in range(len(names))
        for j in range(i)
        if differ[i] and differ[j] and abs(correlation[i, j]) > TOGETHER
    ]
    if pairs:
        return "%s and %s always change together (correlation %.2f)" % pairs[0]
    return "their accelerations differ by less than disturbances and noise over so short a recording"
