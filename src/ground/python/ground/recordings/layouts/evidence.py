"""How much of the accelerations hypotheses leave unexplained, block of time by block of time.

Accelerations and commands are compared without what velocities, a constant wrench and the slope of the floor
explain. The log of the unexplained acceleration (root mean square, geometric mean of both forces and the
yaw moment) is a log-likelihood per sample. Residuals are correlated in time, so the error of a
difference comes from the scatter of its blocks and the correlation of neighbours (Vuong 1989; Newey and
West 1987).
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Dict, Iterator, List, Sequence, Tuple

import numpy as np

from ground.annotations import Array
from ground.errors import GroundError
from ground.recordings import reply
from ground.recordings.layouts.hypotheses import Class

if TYPE_CHECKING:
    from ground.recordings.quality import Run

BLOCK = 0.5  # length of the blocks [s]
MAX_BLOCKS = 400  # most blocks into which all recordings together are cut
MIN_BLOCKS = 6  # blocks that an error can be determined from
MAX_COMPARED = 1000  # classes that are compared by blocks; others explain less in all


@dataclass(frozen=True)
class Moments:
    """Products of commands C (n channels) and accelerations A (3) in each of B blocks."""

    products: Array  # (B, n, 3) C^T A
    sizes: Array  # (B, n, n) C^T C
    totals: Array  # (B, 3) sums of A^2
    samples: int

    def unexplained(self, effects: Array) -> Array:
        """Sums of squares in each block that effects (h, n, 3) leave, (h, B, 3). Forces share a factor that
        is not negative, moments have another one."""
        p = np.einsum("hnc,bnc->hbc", effects, self.products)
        s = np.einsum("hnc,bnm,hmc->hbc", effects, self.sizes, effects, optimize=True)
        weights = 1 / self._noise()
        factors = np.zeros((len(effects), 1, 3))
        for some in (slice(0, 2), slice(2, 3)):
            size = (s[..., some] * weights[some]).sum(axis=(1, 2))
            product = np.maximum((p[..., some] * weights[some]).sum(axis=(1, 2)), 0)
            factors[:, 0, some] = (product / np.where(size > 0, size, np.inf))[:, None]
        return np.asarray(self.totals - 2 * factors * p + factors**2 * s)

    def together(self) -> "Moments":
        """The same of one block."""
        products, sizes, totals = (
            blocks.sum(axis=0, keepdims=True) for blocks in (self.products, self.sizes, self.totals)
        )
        return Moments(products, sizes, totals, self.samples)

    def _noise(self) -> Array:
        """Variances (3,) of what no linear function of the commands explains."""
        P, S, t = self.products.sum(axis=0), self.sizes.sum(axis=0), self.totals.sum(axis=0)
        left = t - (P * (np.linalg.pinv(S, rcond=1e-6) @ P)).sum(axis=0)
        return np.asarray(np.maximum(left, 1e-6 * t + 1e-300) / self.samples)


@dataclass(frozen=True)
class Evidence:
    """What recordings say about the Classes of hypotheses for a craft."""

    classes: Sequence[Class]
    tried: int  # number of classes, with those that are left out because they explain far less
    unexplained: Array  # (h, B, 3) sums of squares, as Moments.unexplained
    totals: Dict[bool, Array]  # (3,) sums of squares, by whether headings and positions contradict
    moments: Dict[bool, Moments]

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return self.unexplained.shape[1]

    def shares(self, index: int) -> Tuple[float, float]:
        """Shares of the forces and of the turns that the commands explain under a class."""
        total = self.totals[self.classes[index].twisted]
        left = self.unexplained[index].sum(axis=0)
        return float(1 - left[:2].sum() / total[:2].sum()), float(1 - left[2] / total[2])

    def log_ratios(self, index: int) -> Tuple[Array, Array]:
        """Logs of the ratios of unexplained accelerations, of each class to one: (h,), and their standard
        errors."""
        return self._log_ratios(self.unexplained, index)

    def log_ratio_of(self, other: Class, index: int) -> Tuple[float, float]:
        """The same of another Class."""
        left = self.moments[other.twisted].unexplained(other.effects[None])
        log, error = self._log_ratios(left, index)
        return float(log[0]), float(error[0])

    def _log_ratios(self, unexplained: Array, index: int) -> Tuple[Array, Array]:
        one, own_parts = _logs(self.unexplained[index : index + 1])
        every, parts = _logs(unexplained)
        return every - one, _error_of_sum(parts - own_parts)

    def angle(self, index: int) -> Tuple[float, float]:
        """Angle [rad] by which the measured forces are turned from those of a class, to which the
        heading's offset has to be raised, and its standard error."""
        group = self.classes[index]
        moments = self.moments[group.twisted]
        E = group.effects
        along = np.einsum("nc,bnc->b", E[:, :2], moments.products[..., :2])
        across = np.einsum("n,bn->b", E[:, 1], moments.products[..., 0])
        across = across - np.einsum("n,bn->b", E[:, 0], moments.products[..., 1])
        if group.first.mirrored:
            across = -across
        total = complex(along.sum(), across.sum())
        parts = ((along + 1j * across) / total).imag  # influence of each block on the angle
        return float(np.angle(total)), float(_error_of_sum(parts[None])[0])


def _error_of_sum(parts: Array) -> Array:
    """Standard errors (h,) of sums of parts (h, B) of mean 0, of which neighbours may be correlated."""
    squares = (parts**2).sum(axis=1)
    neighbours = (parts[:, 1:] * parts[:, :-1]).sum(axis=1)
    count = parts.shape[1]
    return np.asarray(np.sqrt(count / (count - 1) * (squares + np.maximum(neighbours, 0))))


def _logs(unexplained: Array) -> Tuple[Array, Array]:
    """Logs (h,) of unexplained accelerations, and the influence of each block on them (h, B)."""
    sums = np.maximum(unexplained.sum(axis=1), 1e-300)
    parts = 0.5 * (unexplained / sums[:, None, :]).mean(axis=-1)
    return 0.5 * np.log(sums).mean(axis=-1), parts


def gathered(
    runs: Sequence["Run"], classes: Sequence[Class], names: Sequence[str]
) -> Evidence:
    """The Evidence of runs. GroundError when one has no such channels, or the commands change too
    little."""
    moments = {twisted: _moments(runs, names, twisted) for twisted in (False, True)}
    kept = _screened(classes, moments)
    totals = {twisted: own.totals.sum(axis=0) for twisted, own in moments.items()}
    return Evidence(kept, len(classes), _unexplained(kept, moments), totals, moments)


def _screened(classes: Sequence[Class], moments: Dict[bool, Moments]) -> List[Class]:
    """The first class and, of very many, those that leave least unexplained in all."""
    if len(classes) <= MAX_COMPARED:
        return list(classes)
    whole = {twisted: own.together() for twisted, own in moments.items()}
    logs, _ = _logs(_unexplained(classes, whole))
    least = set(np.argsort(logs)[:MAX_COMPARED].tolist()) | {0}
    return [classes[i] for i in sorted(least)]


def _unexplained(classes: Sequence[Class], moments: Dict[bool, Moments]) -> Array:
    """Moments.unexplained of classes, each by the moments of its frame."""
    found = np.empty((len(classes), len(moments[False].totals), 3))
    for twisted, own in moments.items():
        rows = [i for i, group in enumerate(classes) if group.twisted == twisted]
        if rows:
            found[rows] = own.unexplained(np.array([classes[i].effects for i in rows]))
    return found


def _moments(runs: Sequence["Run"], names: Sequence[str], twisted: bool) -> Moments:
    products, sizes, totals, samples = [], [], [], 0
    for run in runs:
        lag = reply.USUAL_LAG if run.reply is None else float(run.reply["lag"])
        rest = reply.rest(run.recording, run.motion, lag, names, twisted)
        samples += len(rest.times)
        for inside in _blocks(rest.times, max(1, MAX_BLOCKS // len(runs))):
            A, C = rest.accelerations[inside], rest.commands[inside]
            products.append(C.T @ A)
            sizes.append(C.T @ C)
            totals.append((A**2).sum(axis=0))
    found = Moments(np.array(products), np.array(sizes), np.array(totals), samples)
    moves = len(totals) and (found.totals.sum(axis=0) > 0).all()
    if len(totals) < MIN_BLOCKS or not moves or not np.trace(found.sizes.sum(axis=0)) > 1e-9 * samples:
        raise GroundError("the commands change too little to distinguish the thrusters")
    return found


def _blocks(times: Array, most: int) -> Iterator[slice]:
    """The samples of each block; most: their largest number, beyond which blocks are longer."""
    if len(times) < 2:
        return
    length = max(BLOCK, (times[-1] - times[0]) / most)
    edges = np.searchsorted(times, np.arange(times[0], times[-1] + length, length))
    for first, last in zip(edges, np.append(edges[1:], len(times))):
        if last > first:
            yield slice(int(first), int(last))
