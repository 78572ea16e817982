"""Parts of long recordings in which the craft moves most: as much as a search for effects needs.

A search simulates all runs thousands of times. What that costs is the number of steps, which end at poses
and at changes of a command, times the number of channels. Up to what COST says all of a recording is used:
that are five minutes of a craft with two thrusters that is measured and commanded 50 times a second,
in which effects that matter have shown long before. Of more, each run keeps parts between gaps. A craft that
rests, or keeps its heading, does not show an offset of the tracked point, or drag: so parts with the largest
velocities are kept.
"""

from typing import List, Sequence

import numpy as np

from ground import _core
from ground.analysis.thinning import at_samples, thinned
from ground.support.annotations import Array

COST = 60_000  # steps times channels that a search may simulate


def spread(runs: Sequence[_core.RunData]) -> List[_core.RunData]:
    """The runs (_core.RunData), or parts of each if they are long together."""
    share = COST / max(1, sum(_cost(run) for run in runs))
    if share >= 1:
        return list(runs)
    usual = np.sqrt(np.mean(np.concatenate([np.array(run.nu) for run in runs]) ** 2, axis=0))
    return [_parts(run, share, usual) for run in runs]


def duration(runs: Sequence[_core.RunData]) -> float:
    """Time in which runs were measured, without gaps [s]."""
    steps = [(np.diff(np.array(run.times)), run.scales.max_gap) for run in runs]
    return float(sum(step[step <= gap].sum() for step, gap in steps))


def _cost(run: _core.RunData) -> int:
    inputs = np.array(run.inputs)
    acting = inputs[(inputs[:, 0] >= run.times[0]) & (inputs[:, 0] <= run.times[-1]), 1:]
    changes = int((np.diff(acting, axis=0) != 0).any(axis=1).sum())
    return (len(thinned(run).times) + changes) * (inputs.shape[1] - 2)


def _parts(run: _core.RunData, share: float, usual: Array) -> _core.RunData:
    """The parts of a run, about that share of it, in which velocities are the largest beside `usual` ones."""
    times = np.array(run.times)
    # the part that a pose is in: each is long enough for a window
    number = ((times - times[0]) / (1.1 * run.scales.window)).astype(int)
    count = int(number[-1])  # the last one is shorter
    wanted = max(1, round(share * count))
    if wanted >= count:
        return run
    motion = ((np.array(run.nu) / np.maximum(usual, 1e-300)) ** 2).sum(axis=1)
    moved = np.bincount(number, motion)[:count]
    return at_samples(run, np.isin(number, np.argsort(-moved, kind="stable")[:wanted]))
