"""The judge of every answer: the poses that it predicts, on data that influenced nothing.

Hypotheses - a model with an effect or a formula and the model without it, one way of fitting and another -
predict the same poses at the horizon that suits the craft, each part of the runs by a fit to the others.

*Veto*: the larger one predicts poses worse, both components together by more than DEVIATIONS standard
errors, or one of positions and headings by more than one and by more than what matters, where the user gives
it and the other does not fall by as much. *Proof*: it predicts them better by more than DEVIATIONS standard
errors, or makes the held-out innovations likelier by as much. Neither: nothing is decided.

Standard errors are by blocks of time or by parts of the runs, whichever is larger: neighbouring
predictions are alike, and a run may be special.
"""

from dataclasses import dataclass
from typing import Sequence, Tuple

import numpy as np

from ground.analysis.horizon import PoseError
from ground.support.annotations import Array, Indices

DEVIATIONS = 2.0  # standard errors of a veto and of a proof


@dataclass(frozen=True)
class Tested:
    """What a hypothesis predicts of data that it was not fitted to."""

    poses: Array  # (starts, 2) errors of position [mm] and heading [deg] at the horizon
    part_of: Indices  # (starts,) part of the data that each is in
    likelihood: Tuple[Array, ...] = ()  # for each part: log-likelihood of its blocks; empty: not known

    @property
    def error(self) -> PoseError:
        """Root mean square of the errors."""
        return PoseError(*_rms(self.poses).tolist())


@dataclass(frozen=True)
class PairedComparison:
    """Paired comparison of two hypotheses on held-out data: of the larger one, and of the smaller one."""

    verdict: str  # better, undecided or worse with the larger one
    gain: float  # rise of the log-likelihood; not a number where it is not known
    gain_error: float  # its standard error
    rise: float  # relative rise of the squared errors of position and heading; see _rise
    rise_error: float  # its standard error

    @property
    def is_worse(self) -> bool:
        """Whether the larger hypothesis is vetoed."""
        return self.verdict == "worse"

    @property
    def is_better(self) -> bool:
        """Whether the larger hypothesis is proved."""
        return self.verdict == "better"

    @property
    def is_likely(self) -> bool:
        """Whether the larger hypothesis is better by more than a standard error: proved or not."""
        return self.gain > self.gain_error or -self.rise > self.rise_error


def compared(larger: Tested, smaller: Tested, matters: Array) -> PairedComparison:
    """The PairedComparison of two hypotheses. matters: least change of position [mm] and heading [deg] that
    matters, (2,)."""
    gain, gain_error = _gain(larger, smaller)
    rise, rise_error, deviations = _rise(larger.poses, smaller.poses, larger.part_of)
    falls = bool((_rms(larger.poses) + matters < _rms(smaller.poses)).any())  # either may be infinite
    is_large = not falls and any(_rises(larger, smaller, c, matters[c]) for c in range(len(matters)))
    verdict = "undecided"
    if rise > 0 and (is_large or deviations > DEVIATIONS):
        verdict = "worse"
    elif (rise < 0 and -deviations > DEVIATIONS) or gain > DEVIATIONS * gain_error:
        verdict = "better"
    return PairedComparison(verdict, gain, gain_error, rise, rise_error)


def _rms(poses: Array) -> Array:
    """Root mean square of errors (starts, k), (k,)."""
    return np.asarray(np.sqrt((poses**2).sum(axis=0) / max(1, len(poses))))


def _rises(larger: Tested, smaller: Tested, component: int, matters: float) -> bool:
    """Whether errors of position or heading rise by more than chance and than what matters."""
    a, b = (one.poses[:, [component]] for one in (larger, smaller))
    rise, error, deviations = _rise(a, b, larger.part_of)
    return rise > error and deviations > 1 and bool(_rms(a) > _rms(b) + matters)


def _gain(larger: Tested, smaller: Tested) -> Tuple[float, float]:
    """Rise of the log-likelihood, and its standard error."""
    if not larger.likelihood or not smaller.likelihood:
        return np.nan, np.inf
    sums = [float(np.concatenate(one.likelihood).sum()) for one in (larger, smaller)]
    if not np.isfinite(sums).all():  # the motion is not finite with one of them, or with both
        return (sums[0] - sums[1] if sums[0] != sums[1] else -np.inf), 0.0
    return sums[0] - sums[1], _error_of_sum([b - w for b, w in zip(larger.likelihood, smaller.likelihood)])


def _rise(larger: Array, smaller: Array, part_of: Indices) -> Tuple[float, float, float]:
    """Relative rise of the squared errors (starts, k); its standard error, as of a ratio of means (Cochran
    1977, section 6.4), of the smaller over the larger mean, so that hypotheses may change places; and how
    many standard errors the rise of blocks of three successive starts, which overlap, is above zero, each
    relative to what both leave in it: few blocks with large errors do not decide."""
    if not len(larger):
        return 0.0, np.inf, 0.0
    if not np.isfinite(larger).all() or not np.isfinite(smaller).all():
        return (-np.inf, 0.0, -np.inf) if np.isfinite(larger).all() else (np.inf, 0.0, np.inf)
    scale = np.maximum(_rms(larger) * _rms(smaller), 1e-12)
    parts = [np.flatnonzero(part_of == part) for part in np.unique(part_of)]
    blocks = [
        [np.add.reduceat((poses[at] ** 2 / scale).sum(axis=1), np.arange(0, len(at), 3)) for at in parts]
        for poses in (larger, smaller)
    ]
    a, b = (float(np.concatenate(found).sum()) for found in blocks)
    ratio = a / max(b, 1e-300)
    off = [(p - ratio * q) / (max(ratio, 1.0) * b) for p, q in zip(*blocks)]
    rises = [(p - q) / np.maximum(p + q, 1e-300) for p, q in zip(*blocks)]
    deviations = float(np.concatenate(rises).sum()) / max(_error_of_sum(rises), 1e-300)
    return ratio - 1, _error_of_sum(off), deviations


def _error_of_sum(parts: Sequence[Array]) -> float:
    """Standard error of the sum of values in parts of data, of which three or more show how much they differ;
    infinite where it is not known."""
    sums = [np.concatenate(parts), np.array([part.sum() for part in parts])][: 1 + (len(parts) > 2)]
    if len(sums[0]) < 2:
        return np.inf
    return max(float(values.std(ddof=1) * np.sqrt(len(values))) for values in sums)
