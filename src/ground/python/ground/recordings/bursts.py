"""Poses that overtook each other: a network that held frames up may deliver them in another order.

All frames of a burst have nearly the same stamp, so that stamps do not tell their order. The motion does:
a craft goes on in one direction while a burst lasts.
"""

from typing import Tuple

import numpy as np

from ground.annotations import Array, Indices

APART = 1e-3  # stamps of a burst are not further apart [s]
AROUND = 2  # poses before and after a burst that tell the direction
NOISE = (4e-4, 6e-3)  # of a pose [m], [rad]
FARTHEST = 20.0  # noises that a burst has to reach over for its order to be told
GAIN = 50.0  # of the squared second differences, in noises, that a new order has to bring
LEFT = 0.5  # of them that may be left by it


def in_order(times: Array, eta: Array) -> Tuple[Indices, int]:
    """Indices that put poses eta (n, 3), with stamps (n,) [s] not descending, into the order in which
    they were measured; how many poses move."""
    position, heading = NOISE
    places = np.column_stack(
        [eta[:, :2] / position, np.cos(eta[:, 2]) / heading, np.sin(eta[:, 2]) / heading]
    )
    order = np.arange(len(times))
    close = np.diff(times) < APART
    starts = np.flatnonzero(close & ~np.append(False, close[:-1]))
    ends = np.flatnonzero(close & ~np.append(close[1:], False)) + 2
    for start, end in zip(starts, ends):
        if start < AROUND or end + AROUND > len(times):
            continue
        before, after = places[start - AROUND : start], places[end : end + AROUND]
        way = after.mean(axis=0) - before.mean(axis=0)
        burst = places[start:end]
        sorted_ones = np.argsort(burst @ way, kind="stable")
        if np.linalg.norm(way) < FARTHEST or (np.diff(sorted_ones) == 1).all():
            continue
        found = _roughness(before, burst[sorted_ones], after)
        as_stamped = _roughness(before, burst, after)
        if found < LEFT * as_stamped and as_stamped - found > GAIN:
            order[start:end] = start + sorted_ones
    return order, int((order != np.arange(len(times))).sum())


def _roughness(before: Array, burst: Array, after: Array) -> float:
    """Sum of the squared second differences of poses in a row, in noises."""
    return float((np.diff(np.vstack([before, burst, after]), 2, axis=0) ** 2).sum())
