"""Thresholds of a search for missing effects; see ground.analysis.search."""

from dataclasses import dataclass
from typing import Tuple


@dataclass(frozen=True)
class Criteria:
    """Thresholds of a search."""

    level: float = 0.01  # probability of choosing an effect although none is missing
    refitted: int = 4  # effects that are refitted in a step, best by score test first
    pairs: int = 2  # pairs that are refitted in a step
    # least expected gain of what may be the best addition, relative to the largest expected gain
    min_best_gain: float = 0.3
    min_gain: float = 3.0  # expected gain per parameter that a refit needs
    steps: Tuple[float, ...] = (
        1.0,
        0.3,
        0.1,
    )  # parts of the score test's step that refits start from
    sizes: Tuple[float, ...] = (
        0.5,
        0.2,
        -0.2,
    )  # start values of an effect that score tests cannot see, relative to the typical size
    windows: int = 40  # windows on which far starts are tried by simulation error
    max_far_error: float = 0.98  # largest error from a far start, relative to the neutral one, for a fit
    # An effect is tested for removal if its Wald ratio is below this multiple of its threshold. The
    # Wald ratio is far too large where levels would change with the removal.
    wald_margin: float = 10.0
    rivals: int = 3  # effects that are tried in the place of a chosen one
    min_rival_gain: float = 0.4  # least expected gain of a rival, relative to the chosen effect's
    # Log-likelihood ratio from which a rival is excluded. If the rival were true, so large a ratio
    # would have a probability of at most 0.4% (its root is the least number of standard deviations).
    exclusion: float = 7.0


USUAL = Criteria()
