"""Effects added to a model on trial, and the evidence for each."""

import math
from dataclasses import dataclass, replace
from typing import Iterable, List, Optional, Sequence

import numpy as np

from ground import _core
from ground.analysis.distributions import chi_squared_above
from ground.analysis.horizon import PredictionChange
from ground.effect_library import candidates
from ground.effect_library.parameters import FittedParameter


@dataclass(frozen=True)
class Trial:
    """An effect added to a model on trial."""

    name: str
    parameters: Sequence[FittedParameter]  # the effect's: name, unit, value, ci95, identified
    p_value: float  # not corrected for the number of effects tried
    delta_bic: float
    equal: bool = False  # whether the data cannot distinguish it from the best one


@dataclass(frozen=True)
class Dropped:
    """An effect that the likelihood prefers and that was not added."""

    trial: Trial
    why: str
    change: Optional[PredictionChange] = None  # of predicted poses, where it is too small to matter


def trial(
    name: str, model: _core.Model, parameters: Sequence[FittedParameter], gain: float, samples: int
) -> Trial:
    """A Trial. model: any with the effect; gain: log-likelihood ratio 2 (L1 - L0) against the model without;
    samples: number of samples of the data."""
    described = candidates.parameters_of(model, name)
    on_bound = sum(p.neutral in (p.lower, p.upper) for p in described)
    bic = float(len(described) * np.log(samples) - gain)
    return Trial(name, parameters, p_value(gain, len(described), on_bound), bic)


def ranked(trials: Iterable[Trial], first: Sequence[str]) -> List[Trial]:
    """Trials, best first; first: the group of effects chosen first."""
    marked = [replace(t, equal=t.name in first) for t in trials]
    return sorted(marked, key=lambda t: (t.name not in first[:1], t.delta_bic))


def p_value(gain: float, free: int, on_bound: int) -> float:
    """Probability of a log-likelihood ratio 2 (L1 - L0) of at least `gain` without the effect.
    `on_bound` of the `free` parameters have their neutral value at a bound. Each of those stays
    there half of the time, so that the ratio has a mixture distribution (Self and Liang 1987;
    binomial weights, exact for independent estimates)."""
    if not gain > 0:
        return 1.0
    counts = range(free - on_bound, free + 1)
    weighed = (
        math.comb(on_bound, moved) * chi_squared_above(gain, count)
        for moved, count in enumerate(counts)
        if count
    )
    return float(sum(weighed) / 2**on_bound)
