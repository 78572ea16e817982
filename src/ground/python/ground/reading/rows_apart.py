"""Numbers of one pose that stand in rows of their own: of logs with a row for each value, or of a compass."""

from typing import Tuple

import numpy as np

from ground.poses import scatter
from ground.support.annotations import Array

FEW = 0.5  # share of the rarest number with less of which in whole rows numbers stand apart
GAP = 3.0  # a number is interpolated over at most so many usual intervals
ONE_SAMPLE = 0.1  # numbers of one sample are nearer than this share of the usual interval


def are_apart(numbers: Array) -> bool:
    """Whether numbers (n, k) hardly ever stand in one row; NaN: it has none."""
    there = np.isfinite(numbers)
    return bool(there.all(axis=1).sum() < FEW * there.sum(axis=0).min())


def joined(numbers: Array, times: Array) -> Array:
    """Numbers (n, k) that stand apart at the rows of the most frequent, else as they are. times (n,) [s]."""
    if not are_apart(numbers):
        return numbers
    there, found = np.isfinite(numbers) & np.isfinite(times)[:, None], np.full_like(numbers, np.nan)
    rows = there[:, there.sum(axis=0).argmax()]
    for number, given in enumerate(there.T):
        order = np.flatnonzero(given)[np.argsort(times[given], kind="stable")]
        found[rows, number] = _at(times[rows], times[order], numbers[order, number : number + 1])[:, 0]
    return found


def together(position: Array, rotation: Array, times: Array, turn: float) -> Tuple[Array, Array]:
    """Positions (n, d) and rotations (n, k) that stand apart at the rows of positions, else as they are; NaN
    where unknown. times (n,) [s]; rotation: headings, of which a whole turn is `turn`, or quaternions."""
    position, rotation = joined(position, times), joined(rotation, times)
    placed, turned = (np.isfinite(rows).all(axis=1) & np.isfinite(times) for rows in (position, rotation))
    fewer = min(placed.sum(), turned.sum())
    if fewer < 2 or (placed & turned).sum() >= FEW * fewer:
        return position, rotation
    order = np.argsort(times[turned], kind="stable")
    known = rotation[turned][order]
    if known.shape[1] == 1:
        known = np.unwrap(known, period=turn, axis=0)
    else:  # a quaternion and its negative are the same rotation
        along = np.sign((known[1:] * known[:-1]).sum(axis=1))
        known = known * np.cumprod(np.append(1.0, np.where(along == 0, 1.0, along)))[:, None]
    found = _at(times[placed], times[turned][order], known)
    length = np.linalg.norm(found, axis=1, keepdims=True)
    found = (
        found / np.maximum(length, 1e-300) if known.shape[1] > 1 else found - turn * np.round(found / turn)
    )
    filled = np.full_like(rotation, np.nan)
    filled[placed] = found
    return position, filled


def _at(wanted: Array, at: Array, known: Array) -> Array:
    """Rows (m, k) of ascending times (m,) at other times (n,) [s]: of the same sample, or interpolated; NaN
    outside and in gaps."""
    found = np.column_stack([np.interp(wanted, at, column) for column in known.T])
    after = np.clip(np.searchsorted(at, wanted), 1, len(at) - 1)
    usual = max(scatter.interval(at), scatter.interval(np.sort(wanted)))
    outside = (wanted < at[0]) | (wanted > at[-1]) | (at[after] - at[after - 1] > GAP * usual)
    found[outside] = np.nan
    nearest = after - (wanted - at[after - 1] < at[after] - wanted)
    same = np.abs(at[nearest] - wanted) < ONE_SAMPLE * usual
    found[same] = known[nearest[same]]
    return found
