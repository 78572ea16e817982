"""Random pushes of given levels, for artificial recordings."""

from dataclasses import dataclass
from typing import Mapping

import numpy as np

from ground import _core
from ground.annotations import Array, Random


@dataclass(frozen=True)
class Pushes:
    """What acts beside the model at a run's samples, each row until the next."""

    wrench: Array  # (n, 3) X, Y [N], N [N m], body
    room: Array  # (n, 2) force [N] along the axes x, y of the room


def of_levels(run: _core.RunData, levels: Mapping[str, float], random: Random) -> Pushes:
    """Pushes of some levels of the likelihood: Ornstein-Uhlenbeck and white noise."""
    steps = np.diff(np.array(run.times), append=run.times[-1] + 1e-3)
    steps = np.maximum(steps, 1e-4)
    wrench = np.empty((len(steps), 3))
    for i, channel in enumerate("XYN"):
        slow = _slow(steps, levels["sigma_" + channel], levels["time_" + channel], random)
        white = levels["white_" + channel] / np.sqrt(steps) * random.normal(size=len(steps))
        wrench[:, i] = slow + white
    room = [_slow(steps, levels["sigma_room"], levels["time_room"], random) for _ in "xy"]
    return Pushes(wrench, np.column_stack(room))


def _slow(steps: Array, sigma: float, time: float, random: Random) -> Array:
    """An Ornstein-Uhlenbeck process of a deviation and correlation time [s] before each step [s]."""
    left = np.exp(-steps / time)
    fresh = sigma * np.sqrt(1 - left**2) * random.normal(size=len(steps))
    value, values = float(sigma * random.normal()), np.empty(len(steps))
    for i, (share, push) in enumerate(zip(left.tolist(), fresh.tolist())):
        values[i] = value
        value = share * value + push
    return values
