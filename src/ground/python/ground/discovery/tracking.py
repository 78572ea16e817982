"""Which of two models tracks a reference better, by flights along it.

Noise and disturbance differ from flight to flight, so that the smaller of two errors says little where both
are small. Errors are therefore compared part by part of the reference: the spread of their ratio shows what
chance does. With log ratios, a part with large errors counts no more than others.
"""

from typing import List, Optional, Sequence

import numpy as np

from ground.annotations import Array

SETTLING = 6.0  # time after which errors count [s]
PARTS = 9  # parts of the reference, long enough to be nearly independent
CLEAR = 2.5  # least mean of the log ratio by which a model is better, in its standard errors


def in_parts(times: Array, distances: Array) -> List[float]:
    """Root mean square distances from a reference in PARTS parts of equal time [m]; empty where a part has
    none. times: (n,) since the reference began [s]; distances: (n,) [m]."""
    if not len(times) or times[-1] <= SETTLING:
        return []
    edges = np.linspace(SETTLING, times[-1], PARTS + 1)
    part = np.minimum(np.searchsorted(edges, times, side="right") - 1, PARTS - 1)
    counts = [np.count_nonzero(part == i) for i in range(PARTS)]
    if not all(counts):
        return []
    return [float(np.sqrt((distances[part == i] ** 2).mean())) for i in range(PARTS)]


def overall(flights: Sequence[Sequence[float]]) -> Optional[float]:
    """Root mean square error of some flights [m], by their errors in parts; None without a part."""
    squares = np.square([error for parts in flights for error in parts])
    return float(np.sqrt(squares.mean())) if len(squares) else None


def evidence(before: Sequence[Sequence[float]], after: Sequence[Sequence[float]]) -> float:
    """By how many standard errors the errors of flights are smaller after a change than before; errors in
    parts of each flight (flights, PARTS) [m]."""
    squares = [np.square(flights).mean(axis=0) for flights in (before, after)]
    gains = 0.5 * np.log(squares[0] / squares[1])
    error = gains.std(ddof=1) / np.sqrt(PARTS)
    return float(gains.mean() / max(error, 1e-12))
