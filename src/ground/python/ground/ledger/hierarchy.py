"""Runs within days within crafts: one normal-normal model of the estimates of all runs.

Run r of craft c on day d has the estimate y_r = m_c + d_d + e_r + error, where the error has the run's own
information matrix J_r, d_d and e_r are independent normal for each parameter, and m_c is the craft's mean.
The variances of days and runs are by restricted maximum likelihood (Patterson and Thompson 1971;
Harville 1977). J_r may be singular: only J_r and (1 + J_r T)^-1 J_r are used, never an inverse of J_r, so
that a run weighs as much as it knows, also in combinations of parameters.
"""

from dataclasses import dataclass
from typing import Tuple

import numpy as np
from scipy import optimize

from ground.support.annotations import Array, Indices

MIN_VARIANCE, MAX_VARIANCE = 1e-10, 1e2  # of variances, in squares of the parameters' scale
RIDGE = 1e-8  # information about means that no run tells anything of
WORTH = 1e-3  # gain of log-likelihood below which the search ends


@dataclass(frozen=True)
class Runs:
    """Estimates of runs of one type."""

    y: Array  #: (n, p) coordinates over scale
    information: Array  #: (n, p, p)
    craft: Indices  #: (n,) 0..
    day: Indices  #: (n,) 0.., of a craft: no day has two crafts

    @property
    def repeated(self) -> bool:
        """Whether some day has more than one run and some craft more than one day, so that days can be told
        from runs."""
        days = len(set(self.day.tolist())) > len(set(self.craft.tolist()))
        return days and bool(np.bincount(self.day).max(initial=0) > 1)


@dataclass(frozen=True)
class Levels:
    """What a hierarchical fit found."""

    run: Array  #: (p,) variance between runs of a day
    day: Array  #: (p,) variance between days of a craft
    mean: Array  #: (crafts, p)
    covariance: Array  #: (crafts, p, p) of the means


def fit(runs: Runs) -> Levels:
    """The restricted maximum likelihood estimate."""
    p = runs.y.shape[1]
    days = p if runs.repeated else 0
    start = np.full(p + days, np.log(1e-4))

    def loss(logs: Array) -> float:
        return _solved(runs, *_variances(logs, p))[0]

    found = optimize.minimize(
        loss,
        start,
        method="L-BFGS-B",
        bounds=[(np.log(MIN_VARIANCE), np.log(MAX_VARIANCE))] * len(start),
        options={"ftol": WORTH / (1 + abs(loss(start))), "maxiter": 40},
    )
    run, day = _variances(found.x, p)
    _, mean, covariance = _solved(runs, run, day)
    return Levels(run, day, mean, covariance)


def _variances(logs: Array, p: int) -> Tuple[Array, Array]:
    """Variances of runs and days; those at the bound are zero."""
    values = np.exp(np.append(logs, np.full(2 * p - len(logs), -np.inf)))
    values[values < 2 * MIN_VARIANCE] = 0.0
    return values[:p], values[p:]


def _solved(runs: Runs, run: Array, day: Array) -> Tuple[float, Array, Array]:
    """-2 log restricted likelihood (but for a constant), means of the crafts, and their covariances."""
    p, crafts, days = len(run), runs.craft.max() + 1, runs.day.max() + 1
    inner = np.eye(p) + runs.information * run  # 1 + J T
    weight = np.linalg.solve(inner, runs.information)
    weight = 0.5 * (weight + np.swapaxes(weight, 1, 2))
    loss = np.linalg.slogdet(inner)[1].sum()
    score = np.einsum("nij,nj->ni", weight, runs.y)
    total = np.einsum("ni,ni->", score, runs.y)
    by_day, day_score = np.zeros((days, p, p)), np.zeros((days, p))
    np.add.at(by_day, runs.day, weight)
    np.add.at(day_score, runs.day, score)
    craft_of = np.zeros(days, int)
    craft_of[runs.day] = runs.craft
    if day.any():  # integrates the days out
        outer = np.eye(p) + by_day * day  # 1 + S D
        loss += np.linalg.slogdet(outer)[1].sum()
        kept = np.linalg.solve(outer, np.concatenate([by_day, day_score[:, :, None]], axis=2))
        total -= np.einsum("di,i,di->", day_score, day, kept[:, :, p])
        by_day, day_score = kept[:, :, :p], kept[:, :, p]
    normal, right = np.zeros((crafts, p, p)), np.zeros((crafts, p))
    np.add.at(normal, craft_of, by_day)
    np.add.at(right, craft_of, day_score)
    normal = 0.5 * (normal + np.swapaxes(normal, 1, 2)) + RIDGE * np.eye(p)
    mean = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
    loss += np.linalg.slogdet(normal)[1].sum() + total - np.einsum("ci,ci->", right, mean)
    return float(loss), mean, np.linalg.inv(normal)


def one_by_one(runs: Runs, levels: Levels) -> Tuple[Array, Array]:
    """What each run tells about each parameter when the others are as they usually are: values (n, p) and
    their information (n, p), without the scatter of that parameter itself.

    The others have the craft's mean and the variances of the fit; so what is known only in combination
    counts as far as the rest of the combination holds still."""
    count, p = runs.y.shape
    values, known = np.empty((count, p)), np.empty((count, p))
    mean = levels.mean[runs.craft]
    for i in range(p):
        others = levels.run + levels.day
        others[i] = 0.0
        weight = np.linalg.solve(np.eye(p) + runs.information * others, runs.information)
        known[:, i] = np.maximum(weight[:, i, i], 0.0)
        score = np.einsum("nj,nj->n", weight[:, i], runs.y - mean)
        values[:, i] = mean[:, i] + score / np.maximum(known[:, i], 1e-12)
    return values, known
