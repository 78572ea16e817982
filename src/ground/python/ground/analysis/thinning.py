"""Recordings at a lower rate: neighbouring poses averaged.

What moves the craft changes within tens of milliseconds, and a motion capture's noise is
independent from frame to frame: the mean of two poses within 10 ms says what both say, at half
the work. At full thrust it is off by a fifth of the noise of heading at most, as by a delay of
0.05 ms.
"""

from typing import List

import numpy as np

from ground import _core
from ground.annotations import Array

RATE = 50.0  # that is kept at least [Hz]
UNEVEN = 1.5  # of the usual step: a longer one is within no group


def thinned(run: _core.RunData) -> _core.RunData:
    """A _core.RunData whose samples are means of as many as its rate allows; the same run where
    that is one. Its noise is that of the means."""
    times = np.array(run.times)
    step = np.median(np.diff(times)) if len(times) > 1 else 1.0
    count = int(1 / (RATE * step)) if step > 0 else 1
    if count < 2:
        return run
    groups = np.array(_groups(times, step, count))

    def mean(values: Array) -> Array:
        return np.asarray(np.add.reduceat(np.array(values), groups, axis=0) / sizes[:, None])

    sizes = np.diff(np.append(groups, len(times)))
    poses = mean(run.poses) if len(run.poses) else np.array(run.poses)
    noise = np.array(run.noise) / np.sqrt(count)
    stamps = mean(times[:, None])[:, 0]
    return _core.RunData(
        run.name,
        stamps,
        mean(run.eta),
        mean(run.nu),
        np.array(run.inputs),
        poses,
        noise,
        run.drives,
    )


def _groups(times: Array, step: float, count: int) -> List[int]:
    """First samples of groups of at most `count` that follow each other closely."""
    firsts = [0]
    for i in range(1, len(times)):
        if i - firsts[-1] == count or times[i] - times[i - 1] > UNEVEN * step:
            firsts.append(i)
    return firsts
