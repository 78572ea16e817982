"""Errors of what is judged from samples that are correlated in time, by sums over blocks of time."""

from typing import Tuple

import numpy as np

from ground.support.annotations import Array


def error_of_sum(parts: Array) -> Array:
    """Standard errors (h,) of sums of parts (h, B) of mean 0, of which neighbours may be correlated."""
    neighbours = np.maximum((parts[:, 1:] * parts[:, :-1]).sum(axis=1), 0)
    count = parts.shape[1]
    return np.asarray(np.sqrt(count / (count - 1) * ((parts**2).sum(axis=1) + neighbours)))


def logs(unexplained: Array) -> Tuple[Array, Array]:
    """Logs (h,) of unexplained accelerations (h, B, 3), and the influence of each block on them (h, B)."""
    sums = np.maximum(unexplained.sum(axis=1), 1e-300)
    parts = 0.5 * (unexplained / sums[:, None, :]).mean(axis=-1)
    return 0.5 * np.log(sums).mean(axis=-1), parts
