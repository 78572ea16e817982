"""Random wrenches of given levels, for artificial recordings."""

from typing import Mapping

import numpy as np

from ground import _core
from ground.annotations import Array, Random


def wrench_of(run: _core.RunData, levels: Mapping[str, float], random: Random) -> Array:
    """An Ornstein-Uhlenbeck and white wrench (n, 3) of some levels at a run's samples [N], [N m]."""
    steps = np.diff(np.array(run.times), append=run.times[-1] + 1e-3)
    steps = np.maximum(steps, 1e-4)
    wrench = np.empty((len(steps), 3))
    for i, channel in enumerate("XYN"):
        sigma, time = levels["sigma_" + channel], levels["time_" + channel]
        slow = sigma * random.normal()
        drawn, white = random.normal(size=(2, len(steps)))
        left = np.exp(-steps / time)
        pushes = sigma * np.sqrt(1 - left**2) * drawn
        values = []
        for share, push in zip(left.tolist(), pushes.tolist()):
            values.append(slow)
            slow = share * slow + push
        wrench[:, i] = values + levels["white_" + channel] / np.sqrt(steps) * white
    return wrench
