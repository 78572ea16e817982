"""What drifts and what jumps, of one parameter of one craft over its runs.

Runs in their order have values with known variances, a scatter from run to run and from day to day. A
change is a line over the number of the run, or a step between two runs. Each is tested by the ratio of
likelihoods with the two scatters fitted anew on both sides (on a grid). Its distribution without a change
is simulated with the same numbers of runs and days: so it allows for the search over all steps, for the
scatters that are estimated, and for few runs. Its tail is exponential beyond the simulated quantiles.
Several changes are found one after the other (binary segmentation: Vostrikova 1981).
"""

from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

import numpy as np
from scipy import linalg

from ground.support.annotations import Array, Indices, Random

GRID = (0.0, 0.12, 0.25, 0.4, 0.55, 0.75, 1.0, 1.4)  # scatters that are tried, in deviations of the values
MIN_RUNS = 3  # runs on each side of a step
MAX_CHANGES = 5  # changes of one parameter
SIMULATED = 800  # histories without a change
TAIL = 0.1  # share of them that the tail is fitted to
WORTH = 7.0  # least ratio (twice the logarithm) that is worth simulating
UNKNOWN = 1e6  # variance over the best run's variance from which a run is not informative
OUTLIER = 4.0  # standard deviations from the neighbours beyond which a value is drawn back
NEIGHBOURS = 7  # runs
DRIFT, JUMP = "drift", "jump"


@dataclass(frozen=True)
class Series:
    """Values of a parameter of a craft, in the order of the runs that tell something about it."""

    values: Array  #: (n,)
    variance: Array  #: (n,) of the runs' own errors
    day: Indices  #: (n,)

    @property
    def count(self) -> int:
        """Number of runs."""
        return len(self.values)

    @property
    def base(self) -> Array:
        """The regressors (n, 1 or 2) without a change: the mean and, with MIN_RUNS days of several runs, the
        number of the run on its day, because a battery fades and is charged again."""
        within = np.array([np.sum(self.day[:i] == day) for i, day in enumerate(self.day)], float)
        if np.sum(np.bincount(self.day) > 1) < MIN_RUNS:
            return np.ones((self.count, 1))
        return np.column_stack([np.ones(self.count), within - within.mean()])


@dataclass(frozen=True)
class ParameterChange:
    """A change of a parameter."""

    kind: str  #: DRIFT or JUMP
    at: int  #: a jump: number of the first run after it
    size: float  #: of the jump, or of the drift from the first to the last run
    low: float  #: 95% interval
    high: float
    chance: float  #: probability of as much evidence by chance, before correction for other tests


_Found = Tuple[str, int, float]  # kind, at, chance


@dataclass(frozen=True)
class _Whitened:
    """Values and regressors with the covariance of a point of the grid taken out."""

    inverse: Array  # (n, n) of the Cholesky factor
    logdet: float

    def against(self, base: Array, regressors: Array) -> Tuple[Array, Array]:
        """An orthonormal basis (n, q) of the base, and the regressors without their parts in it."""
        basis = np.linalg.qr(self.inverse @ base)[0]
        tried = self.inverse @ regressors
        return basis, tried - basis @ (basis.T @ tried)


def informative(variance: Array) -> Indices:
    """The runs that tell anything about a parameter, beside the best one."""
    known = np.isfinite(variance) & (variance > 0)
    if not known.any():
        return np.zeros(0, int)
    return np.flatnonzero(known & (variance < UNKNOWN * variance[known].min()))


def smoothed(series: Series) -> Series:
    """The same with values that are far from all their neighbours drawn back to where they count once."""
    n, half = series.count, NEIGHBOURS // 2
    middle = np.array([np.median(series.values[max(0, i - half) : i + half + 1]) for i in range(n)])
    away = series.values - middle
    usual = np.sqrt((1.4826 * np.median(np.abs(away))) ** 2 + series.variance)
    return Series(middle + np.clip(away, -OUTLIER * usual, OUTLIER * usual), series.variance, series.day)


def find(given: Series, level: float, seed: int = 1) -> List[ParameterChange]:
    """The changes with a chance below `level`, in the order of the runs; less than 2 MIN_RUNS have none."""
    if given.count < 2 * MIN_RUNS:
        return []
    series, random = smoothed(given), np.random.default_rng(seed)
    line = np.linspace(-0.5, 0.5, series.count)[:, None]
    base = series.base
    found: List[_Found] = []
    while len(found) < MAX_CHANGES:
        steps = _steps(series.count, [at for kind, at, _ in found if kind == JUMP])
        tried = [(JUMP, _columns(series.count, steps), steps)] if len(steps) else []
        if all(kind != DRIFT for kind, _, _ in found):
            tried.append((DRIFT, line, np.zeros(1, int)))
        best = _best(series, base, tried, level, random)
        if best is None:
            break
        found.append(best)
        base = np.column_stack([base, column(series.count, best)])
    kept = _needed(series, found)
    return sorted((_sized(series, kept, one, random) for one in kept), key=lambda change: change.at)


def _best(
    series: Series, base: Array, tried: Sequence[Tuple[str, Array, Indices]], level: float, random: Random
) -> Optional[_Found]:
    """The likeliest of the kinds of change whose evidence is beyond chance."""
    grid = _grid(series, base)
    candidates = []
    for kind, regressors, at in tried:
        ratios, null = _ratios(series, base, regressors, grid, series.values[:, None])
        best = int(np.argmax(ratios[:, 0]))
        if ratios[best, 0] < WORTH:
            continue
        simulated = random.standard_normal((series.count, SIMULATED))
        artificial = np.linalg.solve(grid[null].inverse, simulated)
        chance = _chance(ratios[best, 0], _ratios(series, base, regressors, grid, artificial)[0].max(axis=0))
        if chance < level:  # where it jumps was fitted as well, and costs as two numbers
            fair = ratios[best, 0] - (2 * np.log(series.count) if kind == JUMP else 0.0)
            candidates.append((fair, (kind, int(at[best]), chance)))
    return max(candidates)[1] if candidates else None


def _steps(count: int, others: Sequence[int]) -> Indices:
    """First runs after a possible step, MIN_RUNS from the ends and from other steps."""
    edges = [0, *others, count]
    return np.array([at for at in range(count) if all(abs(at - e) >= MIN_RUNS for e in edges)], int)


def _columns(count: int, steps: Indices) -> Array:
    return np.asarray(np.arange(count)[:, None] >= steps, float)


def column(count: int, found: _Found) -> Array:
    """The regressor (count,) of a change: kind, at, chance."""
    kind, at, _ = found
    return np.linspace(0.0, 1.0, count) if kind == DRIFT else np.asarray(np.arange(count) >= at, float)


def curve(series: Series, found: Sequence[ParameterChange]) -> Array:
    """The mean (n,) of the values with changes."""
    parts = [column(series.count, (one.kind, one.at, one.chance)) * one.size for one in found]
    changed = np.sum(parts, axis=0) if parts else np.zeros(series.count)
    left = smoothed(series).values - changed
    usual = (1.4826 * np.median(np.abs(left - np.median(left)))) ** 2
    weights = 1 / np.sqrt(series.variance + max(usual, 1e-12))
    fitted = np.linalg.lstsq(series.base * weights[:, None], left * weights, rcond=None)[0]
    return np.asarray(fitted[0] + changed)


def _grid(series: Series, base: Array) -> List[_Whitened]:
    """Covariances of the values for scatters of runs and of days."""
    weight = 1 / np.sqrt(series.variance + np.median(series.variance))
    left = (
        series.values - base @ np.linalg.lstsq(base * weight[:, None], series.values * weight, rcond=None)[0]
    )
    scale = float(np.sqrt(np.mean((left * weight) ** 2) / np.mean(weight**2)))
    same = np.asarray(series.day[:, None] == series.day, float)
    days = GRID if np.bincount(series.day).max() > 1 else GRID[:1]
    found = []
    for run in GRID:
        for day in days:
            matrix = np.diag(series.variance + (run * scale) ** 2) + (day * scale) ** 2 * same
            factor = linalg.cholesky(matrix, lower=True)
            inverse = linalg.solve_triangular(factor, np.eye(series.count), lower=True)
            found.append(_Whitened(inverse, 2 * float(np.log(np.diag(factor)).sum())))
    return found


def _ratios(
    series: Series, base: Array, regressors: Array, grid: Sequence[_Whitened], values: Array
) -> Tuple[Array, int]:
    """Twice the log-likelihood ratio of each regressor (k, m) for columns of values (n, m), and the number of
    the point of the grid that is likeliest without any, for the first column."""
    least = np.full(values.shape[1], np.inf)  # -2 log likelihood
    with_each = np.full((regressors.shape[1], values.shape[1]), np.inf)
    null, lowest = 0, np.inf
    for number, point in enumerate(grid):
        basis, tried = point.against(base, regressors)
        white = point.inverse @ values
        white -= basis @ (basis.T @ white)
        loss = point.logdet + np.einsum("nm,nm->m", white, white)
        gain = (tried.T @ white) ** 2 / np.maximum(np.einsum("nk,nk->k", tried, tried), 1e-12)[:, None]
        np.minimum(least, loss, out=least)
        np.minimum(with_each, loss - gain, out=with_each)
        if loss[0] < lowest:
            null, lowest = number, float(loss[0])
    return least - with_each, null


def _chance(ratio: float, simulated: Array) -> float:
    """The share of simulated ratios that are as large; an exponential tail where few are."""
    limit = float(np.quantile(simulated, 1 - TAIL))
    if ratio <= limit:
        return float(np.mean(simulated >= ratio))
    beyond = simulated[simulated > limit] - limit
    return TAIL * float(np.exp(-(ratio - limit) / beyond.mean()))


def _needed(series: Series, found: Sequence[_Found]) -> List[_Found]:
    """The changes without those that later ones make needless."""
    kept = list(found)
    for one in found[:-1]:
        others = [other for other in kept if other is not one]
        base = np.column_stack([series.base, *(column(series.count, o) for o in others)])
        tried = column(series.count, one)[:, None]
        if _ratios(series, base, tried, _grid(series, base), series.values[:, None])[0][0, 0] < WORTH:
            kept = others
    return kept


def _sized(series: Series, all_found: Sequence[_Found], one: _Found, random: Random) -> ParameterChange:
    """A change with the interval of its profile likelihood, at the ratio that chance exceeds in 5%."""
    others = [column(series.count, other) for other in all_found if other is not one]
    base, own = np.column_stack([series.base, *others]), column(series.count, one)[:, None]
    grid = _grid(series, np.column_stack([base, own]))
    fits: List[Tuple[float, float, float]] = []
    for point in grid:
        basis, tried = point.against(base, own)
        white = point.inverse @ series.values
        white -= basis @ (basis.T @ white)
        information = float(tried[:, 0] @ tried[:, 0])
        size = float(tried[:, 0] @ white) / information
        fits.append((point.logdet + float(white @ white) - size**2 * information, size, information))
    losses, sizes, knowledge = (np.array(row) for row in zip(*fits))
    likeliest = int(np.argmin(losses))
    artificial = np.linalg.solve(grid[likeliest].inverse, random.standard_normal((series.count, SIMULATED)))
    limit = float(np.quantile(_ratios(series, base, own, grid, artificial)[0], 0.95))
    left = limit - (losses - losses.min())
    reach = np.sqrt(np.maximum(left, 0) / knowledge)
    inside = left >= 0  # the union of the intervals of all likely scatters
    return ParameterChange(
        one[0],
        one[1],
        float(sizes[likeliest]),
        float((sizes - reach)[inside].min()),
        float((sizes + reach)[inside].max()),
        one[2],
    )
