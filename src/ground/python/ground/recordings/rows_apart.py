"""Headings of a table that stand in rows of their own, as of a receiver and a compass that log by turns."""

import numpy as np

from ground.recordings import scatter
from ground.support.annotations import Array

FEW = 0.5  # share of the rarer of both with less of which in rows together they stand apart
GAP = 3.0  # a heading is interpolated over at most so many usual intervals


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
    wanted = times[placed]
    found = np.column_stack([np.interp(wanted, at, column) for column in known.T])
    if known.shape[1] > 1:
        found = found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-300)
    after = np.clip(np.searchsorted(at, wanted), 1, len(at) - 1)
    longest = GAP * max(scatter.interval(at), scatter.interval(np.sort(wanted)))
    outside = (wanted < at[0]) | (wanted > at[-1]) | (at[after] - at[after - 1] > longest)
    found[outside] = np.nan
    filled = np.full_like(rotation, np.nan)
    filled[placed] = found
    return filled
