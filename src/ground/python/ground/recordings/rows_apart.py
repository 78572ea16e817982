"""Numbers of one pose that stand in rows of their own: as a log writes a row for each value, or a receiver and a
compass by turns."""

from typing import List

import numpy as np

from ground.recordings import scatter
from ground.support.annotations import Array

FEW = 0.5  # share of the rarer of both with less of which in rows together they stand apart
GAP = 3.0  # a heading is interpolated over at most so many usual intervals
ONE_SAMPLE = 0.1  # rows of one sample lie closer than this share of the time between two values of a number


def are_apart(numbers: Array) -> bool:
    """Whether the numbers (n, k) of a pose hardly ever stand in one row; NaN: not there."""
    there = np.isfinite(numbers)
    return bool(there.all(axis=1).sum() < FEW * there.sum(axis=0).min())


def samples(numbers: Array, times: Array, notes: List[str]) -> Array:
    """Numbers (n, k) of which all of one sample stand in its first row, and the other rows are NaN; times (n,)
    [s]. Rows of one sample follow each other closely, and none repeats a number. notes: told of it."""
    there = np.isfinite(numbers) & np.isfinite(times)[:, None]
    found, filled = np.full_like(numbers, np.nan), np.zeros_like(there)
    spans = [scatter.interval(np.sort(times[one])) for one in there.T if one.sum() > 1]
    room, begin = ONE_SAMPLE * min(spans, default=0.0), -1
    rows = np.flatnonzero(there.any(axis=1))
    for row in rows[np.argsort(times[rows], kind="stable")]:
        if begin < 0 or times[row] - times[begin] > room or (filled[begin] & there[row]).any():
            begin = row
        found[begin, there[row]] = numbers[row, there[row]]
        filled[begin] |= there[row]
    count = int(filled.any(axis=1).sum())
    if count < len(rows):
        text = "numbers of one pose stand in rows of their own: %d rows within %.2g ms each are %d poses"
        notes.append(text % (len(rows), 1e3 * room, count))
    return found


def places(position: Array, times: Array) -> Array:
    """Positions (n, d) of which no two numbers stand in one row: they are interpolated in time at the rows of the
    most frequent number, and the other rows are NaN; others as they are. times (n,) [s]."""
    if not are_apart(position):
        return position
    there, found = np.isfinite(position) & np.isfinite(times)[:, None], np.full_like(position, np.nan)
    rows = there[:, there.sum(axis=0).argmax()]
    for column, values, given in zip(found.T, position.T, there.T):
        if given.sum() > 1:
            order = np.argsort(times[given], kind="stable")
            column[rows] = _interpolated(times[rows], times[given][order], values[given][order][:, None])[:, 0]
    return found


def _interpolated(wanted: Array, at: Array, known: Array) -> Array:
    """Rows known (m, k) at ascending times (m,), linear in time at other times (n,) [s]; NaN before the first, after
    the last, and over gaps."""
    found = np.column_stack([np.interp(wanted, at, column) for column in known.T])
    after = np.clip(np.searchsorted(at, wanted), 1, len(at) - 1)
    longest = GAP * max(scatter.interval(at), scatter.interval(np.sort(wanted)))
    found[(wanted < at[0]) | (wanted > at[-1]) | (at[after] - at[after - 1] > longest)] = np.nan
    return found


def together(position: Array, rotation: Array, times: Array, turn: float) -> Array:
    """Rotations (n, k) with those at the rows of positions (n, d), interpolated in time between their own
    rows; the same where most stand in the rows of positions anyway. times (n,) [s]; rotation: headings,
    of which a whole turn is `turn`, or quaternions. Not a number where it is not known."""
    placed, turned = (np.isfinite(rows).all(axis=1) & np.isfinite(times) for rows in (position, rotation))
    if min(placed.sum(), turned.sum()) < 2 or (placed & turned).sum() >= FEW * min(
        placed.sum(), turned.sum()
    ):
        return rotation
    order = np.argsort(times[turned], kind="stable")
    at, known = times[turned][order], rotation[turned][order]
    if known.shape[1] == 1:
        known = np.unwrap(known, period=turn, axis=0)
    else:  # a quaternion and its negative are the same rotation
        along = np.sign((known[1:] * known[:-1]).sum(axis=1))
        known = known * np.cumprod(np.append(1.0, np.where(along == 0, 1.0, along)))[:, None]
    found = _interpolated(times[placed], at, known)
    if known.shape[1] > 1:
        found = found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-300)
    filled = np.full_like(rotation, np.nan)
    filled[placed] = found
    return filled
