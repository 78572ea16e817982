"""Poses that overtook each other: a network that held frames up may deliver them in another order.

All frames of a burst have nearly the same stamp, so that stamps do not tell their order. The motion does:
a craft goes on in one direction while a burst lasts, and turns on. No order is taken that makes the path
rougher: a mocap may flip headings.
"""

from typing import Tuple

import numpy as np

from ground.annotations import Array, Indices
from ground.recordings.frame_clock import HEADING_NOISE, POSITION_NOISE

APART = 1e-3  # stamps of a burst are not further apart [s]
AROUND = 2  # poses before and after a burst that give its direction
MIN_WAY = 20.0  # shortest way along which a burst is sorted [standard deviations]
MIN_GAIN = 50.0  # least fall of the roughness for a new order
MAX_RATIO = 0.5  # largest roughness of a new order, relative to the old one


def in_order(times: Array, eta: Array) -> Tuple[Indices, int]:
    """Indices that put poses eta (n, 3), with stamps (n,) [s] not descending, into the order in which
    they were measured; how many poses move."""
    heading = np.column_stack([np.cos(eta[:, 2]), np.sin(eta[:, 2])])
    places = np.column_stack([eta[:, :2] / POSITION_NOISE, heading / HEADING_NOISE])
    order = np.arange(len(times))
    close = np.diff(times) < APART
    starts = np.flatnonzero(close & ~np.append(False, close[:-1]))
    ends = np.flatnonzero(close & ~np.append(close[1:], False)) + 2
    for start, end in zip(starts, ends):
        if start < AROUND or end + AROUND > len(times):
            continue
        burst = places[start - AROUND : end + AROUND]
        found = min((_sorted(burst, n) for n in (2, 4)), key=lambda o: _roughness(burst[o]))
        before, after = _roughness(burst), _roughness(burst[found])
        rougher = _roughness(burst[found, :2]) > _roughness(burst[:, :2])
        if after < MAX_RATIO * before and before - after > MIN_GAIN and not rougher:
            order[start - AROUND : end + AROUND] = start - AROUND + found
    return order, int((order != np.arange(len(times))).sum())


def _sorted(places: Array, columns: int) -> Indices:
    """Indices that sort the places of a burst along its way, by the first columns; unchanged if
    the way is too short."""
    burst = places[:, :columns]
    way = burst[-AROUND:].mean(axis=0) - burst[:AROUND].mean(axis=0)
    order = np.arange(len(burst))
    if np.linalg.norm(way) > MIN_WAY:
        order[AROUND:-AROUND] = AROUND + np.argsort(burst[AROUND:-AROUND] @ way, kind="stable")
    return order


def _roughness(places: Array) -> float:
    """Sum of the squared second differences of consecutive places [variances of the noise]."""
    return float((np.diff(places, 2, axis=0) ** 2).sum())
