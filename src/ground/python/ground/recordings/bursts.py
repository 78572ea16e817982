"""Poses that overtook each other: a network that held frames up may deliver them in another order.

All frames of a burst have nearly the same stamp, so that stamps do not tell their order. The motion does:
a craft goes on in one direction while a burst lasts, and turns on. No order is taken that makes the path
rougher: a mocap may flip headings.
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
        told = places[start - AROUND : end + AROUND]
        found = min((_sorted(told, n) for n in (2, 4)), key=lambda o: _roughness(told[o]))
        before, after = _roughness(told), _roughness(told[found])
        rougher = _roughness(told[found, :2]) > _roughness(told[:, :2])
        if after < LEFT * before and before - after > GAIN and not rougher:
            order[start - AROUND : end + AROUND] = start - AROUND + found
    return order, int((order != np.arange(len(times))).sum())


def _sorted(places: Array, columns: int) -> Indices:
    """Indices that sort the places of a burst along its way, by the first columns; as they are where
    they do not reach far enough."""
    told = places[:, :columns]
    way = told[-AROUND:].mean(axis=0) - told[:AROUND].mean(axis=0)
    order = np.arange(len(told))
    if np.linalg.norm(way) > FARTHEST:
        order[AROUND:-AROUND] = AROUND + np.argsort(told[AROUND:-AROUND] @ way, kind="stable")
    return order


def _roughness(places: Array) -> float:
    """Sum of the squared second differences of places in a row, in noises."""
    return float((np.diff(places, 2, axis=0) ** 2).sum())
