"""What numbers are probably measured in: evidence for drafts of mappings and for suspicions."""

from typing import Optional, Tuple

import numpy as np

from ground.annotations import Array

FASTEST = 15.0  # that a craft in a room goes [m/s]
MILLIMETRES = 150.0  # speeds in "m/s" from which on positions are in millimetres rather than centimetres
SLOWEST = 2e-3  # that a craft goes which moves at all [m/s]
SPEED_STEP = 0.1  # over which speeds are taken [s]
TURN = 60.0  # faster turns are those of degrees [rad/s]
# Axes by the vertical one of the mocap's, up and down.
VERTICAL = (
    ("y, -z, -x", "y, z, x"),
    ("x, z, -y", "x, -z, y"),
    ("x, -y, -z", "x, y, z"),
)


def speed(times: Array, positions: Array) -> float:
    """The speed that is exceeded 5% of the time, per second of times (n,) and in the unit of positions
    (n, k)."""
    order = np.argsort(times, kind="stable")
    times, positions = times[order], positions[order]
    ahead = np.searchsorted(times, times + SPEED_STEP)
    inside = ahead < len(times)
    if not inside.any():
        return 0.0
    step = positions[ahead[inside]] - positions[inside]
    apart = times[ahead[inside]] - times[inside]
    return float(np.quantile(np.linalg.norm(step, axis=1) / apart, 0.95))


def length_unit(times: Array, positions: Array) -> Tuple[Optional[str], float]:
    """The unit that positions (n, k) are probably in where that is not the metre, and their speed."""
    fast = speed(times, positions)
    if fast < FASTEST:
        return None, fast
    return ("mm" if fast > MILLIMETRES else "cm"), fast


def command_unit(values: Array) -> Optional[str]:
    """The unit that commands are probably in where they are not normalised; None where no unit of
    mappings fits."""
    low, high = float(values.min()), float(values.max())
    if 800 <= low and high <= 2200:
        return "microseconds"
    if high > 10 and -100 <= low and high <= 100:
        return "percent"
    return "normalised" if -1 <= low and high <= 1 else None


def in_degrees(times: Array, headings: Array) -> bool:
    """Whether headings (n,) are probably in degrees."""
    if np.abs(headings).max() <= 2 * np.pi:
        return False
    steps = np.abs(np.diff(headings))
    if np.abs(headings).max() < 361 and (np.abs(steps - 360) < 60).any():
        return True
    # Radians that nobody has wrapped turn without jumps, and slower.
    return speed(times, headings[:, None]) > TURN
