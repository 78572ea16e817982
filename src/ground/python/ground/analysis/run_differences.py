"""Differences between runs: a constant wrench on a channel, or the thrust.

Each is a random effect, normally distributed over the runs, that a likelihood includes or not
(Likelihood.varying). The test for it includes forces that are the same in all runs, because a force
that all runs share is not a difference.
"""

from dataclasses import replace
from typing import Dict, Mapping

import numpy as np

from ground.analysis.distributions import chi_squared_above
from ground.analysis.likelihood import ABSENT, COARSE, KINDS, Likelihood, LikelihoodFit, RunDifference
from ground.analysis.window_error import WRENCH, with_wrench

# Probability of a false finding. It is low, because a disturbance whose correlation time changes
# looks like a difference.
DIFFERENCE_LEVEL = 1e-4
SLOWEST = 0.3  # longest correlation time of a random wrench, in durations of a run; a slower one
# is a difference between runs


def differences(likelihood: Likelihood, fit: LikelihoodFit) -> Dict[RunDifference, float]:
    """The Kinds that differ between runs beside a LikelihoodFit, with their p-values. likelihood: with all
    random effects."""
    if len(likelihood.runs) < 2:
        return {}
    model = with_wrench(fit.model)
    free = list(dict.fromkeys([*fit.free, *WRENCH]))
    full = likelihood.fit(model, free, near=_with_all(likelihood, fit), least_gain=COARSE)
    # a slower random wrench would replace a constant one
    slowest = SLOWEST * float(np.median([run.times[-1] - run.times[0] for run in likelihood.runs]))
    slow = {k.time: slowest for k in KINDS if k.time and full.levels[k.time] > slowest}
    if slow:
        full = likelihood.fit(model, free, near=_with_all(likelihood, full), held=slow)
    is_zero = (np.abs(full.trims) <= full.trims_sigma).all(axis=0)
    chances = {
        kind: len(KINDS) * _chance_without(likelihood, full, kind, slow, slowest)
        for kind, zero in zip(KINDS, is_zero)
        if not zero
    }
    return {kind: chance for kind, chance in chances.items() if chance < DIFFERENCE_LEVEL}


def _with_all(likelihood: Likelihood, fit: LikelihoodFit) -> LikelihoodFit:
    """A LikelihoodFit whose levels of differences are large enough for a search to start from."""
    usual = likelihood.box.start(fit.model).levels
    levels = {k.level: max(usual[k.level], fit.levels[k.level]) for k in KINDS}
    return replace(fit, levels={**fit.levels, **levels})


def _chance_without(
    likelihood: Likelihood, fit: LikelihoodFit, kind: RunDifference, slow: Mapping[str, float], slowest: float
) -> float:
    """p-value of the likelihood ratio between a fit and one in which a kind does not differ
    between runs, all other levels refitted. Without a difference the ratio is zero half of the
    time, else chi squared with one degree of freedom (Self and Liang 1987). `slow`: times that
    are held; the time of this kind is held, too, where it gets longer than `slowest`."""
    held = {**slow, kind.level: ABSENT * fit.levels[kind.level]}
    other = likelihood.fit(fit.model, fit.free, near=fit, held=held)
    if kind.time and other.levels[kind.time] > slowest:
        other = likelihood.fit(fit.model, fit.free, near=fit, held={**held, kind.time: slowest})
    gain = 2 * float(fit.by_run.sum() - other.by_run.sum())
    return 0.5 * chi_squared_above(gain, 1) if gain > 0 else 1.0
