"""What numbers are probably measured in: evidence for drafts of mappings, suspicions and errors."""

from typing import Optional, Tuple

import numpy as np

from ground import _core
from ground.reading.mapping import LENGTHS
from ground.support.annotations import Array
from ground.support.errors import GroundError

FASTEST = 15.0  # that a craft in a room goes [m/s]
HASTY = 3.0  # the same of one whose poses are as noisy as in another unit
CLEARLY = 2.0  # typical deviations by which the metre has to be less likely then
ALIKE = 1.7  # typical deviations within which units are as likely, as cm and inches are
TYPICAL_SPEED = 0.6  # speed of a miniature hovercraft [m/s]
TYPICAL_NOISE = 3e-4  # standard deviation of a mocap [m]
SPEED_STEP = 0.1  # over which speeds are taken [s]
TURN = 60.0  # faster turns are turns in degrees [rad/s]
TURNED_ONCE = 2 * np.pi + 0.01  # with rounding [rad]
# Axes by the vertical one of the mocap's, up and down.
VERTICAL = (("y, -z, -x", "y, z, x"), ("x, z, -y", "x, -z, y"), ("x, -y, -z", "x, y, z"))


def speed(times: Array, positions: Array, step_time: float = SPEED_STEP) -> float:
    """The speed that is exceeded 5% of the time, per second of times (n,) and in the unit of positions
    (n, k), over steps of some time [s]."""
    order = np.argsort(times, kind="stable")
    times, positions = times[order], positions[order]
    ahead = np.searchsorted(times, times + step_time, side="right")
    inside = ahead < len(times)
    if not inside.any():
        return 0.0
    step = positions[ahead[inside]] - positions[inside]
    apart = times[ahead[inside]] - times[inside]
    return float(np.quantile(np.linalg.norm(step, axis=1) / apart, 0.95))


def length_units(
    times: Array, positions: Array, noise: Optional[float] = None
) -> Tuple[Tuple[str, ...], float]:
    """The units that positions (n, k) are probably in where that is not the metre, the most probable first,
    and their speed; by their noise as well where it is known."""
    # over a time in which noise is no speed that no craft has
    fast = speed(times, positions, max(SPEED_STEP, 20 * (noise or 0.0) / HASTY))
    noisy = noise is not None and noise > 0

    def unlikely(unit: str) -> float:
        off = abs(np.log(LENGTHS[unit] * fast / TYPICAL_SPEED)) / np.log(2.5)
        if noise is not None and noise > 0:
            off += abs(np.log(LENGTHS[unit] * noise / TYPICAL_NOISE)) / np.log(4)
        return float(off)

    if fast < (HASTY if noisy else FASTEST):
        return (), fast
    ranked = sorted(LENGTHS, key=unlikely)
    least = unlikely(ranked[0])
    if ranked[0] == "m" or (fast < FASTEST and unlikely("m") - least < CLEARLY):
        return (), fast
    return tuple(unit for unit in ranked if unlikely(unit) - least < ALIKE), fast


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
    if min(np.abs(headings).max(), np.ptp(headings)) <= TURNED_ONCE:
        return False
    # Unwrapped radians have no jumps and change more slowly.
    return wraps(headings, 360.0) or speed(times, headings[:, None]) > TURN


def require_radians(where: str, times: Array, headings: Array, field: str = "NAME") -> None:
    """GroundError where headings (n,) of a field are probably in degrees. where: begins the message."""
    known = np.isfinite(times) & np.isfinite(headings)
    times, headings = times[known], headings[known]
    if len(times) > 1 and in_degrees(times, headings):
        raise GroundError(
            "%s: headings reach %.0f and change by up to %.1f from pose to pose: they seem to be in "
            "degrees, but radians are needed; heading: {field: %s, unit: deg} under poses in a "
            "mapping turns them into radians"
            % (where, np.abs(headings).max(), np.abs(np.diff(headings)).max(), field)
        )


def wraps(headings: Array, turn: float) -> bool:
    """Whether headings within a turn step by a turn in their unit, as in no other unit of angles."""
    steps = np.abs(np.diff(headings))
    return bool(np.ptp(headings) <= 1.001 * turn and (np.abs(steps - turn) < turn / 6).any())


def likely_axes(rows: Array) -> Tuple[str, float]:
    """The axes that most poses fit, rows of position and quaternion (n, 7), and the share of those; of equal
    ones those whose vertical moves least."""
    shares = np.array([_upright(rows, pair[0]) for pair in VERTICAL])
    best = int(np.lexsort([np.ptp(rows[:, :3], axis=0), -shares])[0])
    is_up = np.median(rows[:, best]) >= 0
    return VERTICAL[best][0 if is_up else 1], float(shares[best])


def _upright(rows: Array, axes: str) -> float:
    """Share of poses that fit axes."""
    mapping = _core.AxisMapping(axes, 0.0)
    return float(np.isfinite(mapping.to_planar_rows(rows[:, :3].copy(), rows[:, 3:].copy())[:, 0]).mean())


def upside_down(axes: str) -> str:
    """Axes with the vertical one, and one that makes the frame right-handed again, the other way."""
    x, *others = (word.strip() for word in axes.split(","))
    return ", ".join([x, *(word[1:] if word.startswith("-") else "-" + word.lstrip("+") for word in others)])
