"""Differences between runs: a constant wrench on a channel, or the thrust.

Each is a random effect, normally distributed over the runs, that a likelihood includes or not
(Likelihood.varying). The test for it includes forces that are the same in all runs, because a force
that all runs share is not a difference.
"""

from dataclasses import dataclass, replace
from typing import Mapping, Tuple

import numpy as np

from ground.analysis import candidates
from ground.analysis.distributions import chi_squared_above
from ground.analysis.likelihood import ABSENT, Fit, Likelihood

# Probability of a false finding. It is low, because a disturbance whose correlation time changes
# looks like a difference.
LEVEL = 1e-4
SLOWEST = 0.3  # longest correlation time of a random wrench, in durations of a run; a slower one
# is a difference between runs
SHARED = ("body_force_bias", "yaw_bias")  # effects that are the same in all runs


@dataclass(frozen=True)
class Kind:
    """A wrench on a channel, or the thrust, that may differ from run to run."""

    parameter: str
    unit: str
    level: str  # name of its level in DisturbanceLevels
    time: str  # name of the correlation time of the random wrench on the same channel, or ""


KINDS = (
    Kind("surge force", "N", "trim_X", "time_X"),
    Kind("side force", "N", "trim_Y", "time_Y"),
    Kind("yaw moment", "N m", "trim_N", "time_N"),
    Kind("thrust", "-", "thrust", ""),
)


@dataclass(frozen=True)
class Difference:
    """Something that differs between runs."""

    kind: Kind
    p_value: float


def differences(likelihood: Likelihood, fit: Fit) -> Tuple[Difference, ...]:
    """The significant Differences between runs beside a Fit. likelihood: with all random effects."""
    if len(likelihood.runs) < 2:
        return ()
    model = fit.model
    for effect in SHARED:
        if effect not in model.effects:
            model = candidates.of_library(effect).neutral(model)
    shared = [p["name"] for p in model.parameters() if p["name"].split(".")[0] in SHARED]
    free = tuple(fit.free) + tuple(name for name in shared if name not in fit.free)
    full = likelihood.fit(model, free, near=with_all(likelihood, fit))
    slowest = SLOWEST * float(np.median([run.times[-1] - run.times[0] for run in likelihood.runs]))
    slow = {k.time: slowest for k in KINDS if k.time and full.levels[k.time] > slowest}
    if slow:
        full = likelihood.fit(model, free, near=with_all(likelihood, full), held=slow)
    sizes = np.array([[*trim["wrench"], trim["thrust"]] for trim in full.trims])
    doubts = np.array([[*trim["wrench_sigma"], trim["thrust_sigma"]] for trim in full.trims])
    found = []
    for i, kind in enumerate(KINDS):
        if not (np.abs(sizes[:, i]) > doubts[:, i]).any():
            continue  # zero in all runs
        chance = len(KINDS) * _chance_without(likelihood, full, kind, slow, slowest)
        if chance < LEVEL:
            found.append(Difference(kind, chance))
    return tuple(found)


def with_all(likelihood: Likelihood, fit: Fit) -> Fit:
    """A Fit whose levels of differences are large enough for a search to start from."""
    usual = likelihood.box.start(fit.model).levels
    levels = {k.level: max(usual[k.level], fit.levels[k.level]) for k in KINDS}
    return replace(fit, levels={**fit.levels, **levels})


def _chance_without(
    likelihood: Likelihood, fit: Fit, kind: Kind, slow: Mapping[str, float], slowest: float
) -> float:
    """p-value of the likelihood ratio between a fit and one in which a kind does not differ
    between runs, all other levels refitted. Without a difference the ratio is zero half of the
    time, else chi squared with one degree of freedom (Self and Liang 1987). A random wrench slower
    than `slowest` would replace a constant one; its time is held at `slowest`. `slow`: times that
    are held there already."""

    def ratio(held: Mapping[str, float]) -> Tuple[float, Fit]:
        other = likelihood.fit(fit.model, fit.free, near=fit, held={**slow, **held})
        return 2 * float(np.sum(fit.by_run) - np.sum(other.by_run)), other

    held = {kind.level: ABSENT * fit.levels[kind.level]}
    gain, other = ratio(held)
    if kind.time and other.levels[kind.time] > slowest:
        gain, _ = ratio({**held, kind.time: slowest})
    return 0.5 * chi_squared_above(gain, 1) if gain > 0 else 1.0
