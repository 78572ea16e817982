"""What commands do to a craft over times in which its damping acts.

A slow craft that is measured coarsely hardly shows what a command does at once, and regressions of its
accelerations on commands and velocities lose what it shows later: while it turns steadily, the turn follows
the command, so that both explain the same. But damping brakes. An acceleration plus the velocity over a
positive time constant, which is common to all runs of a craft, is what the commands do, at any time scale.
"""

from typing import Callable, Dict, List, NamedTuple, Optional, Sequence

import numpy as np

from ground.checks import blocks, reply
from ground.poses import kinematics, scatter
from ground.reading.recording import Recording
from ground.support.annotations import Array, Indices

FRAMES = (False, True)  # whether headings and positions contradict
FINEST, STEP = 0.125, 1.5  # first tried time constant [shortest averages], and ratio to the next one
MIN_AVERAGES = 10  # averages of a run
LONG = 4.0  # blocks are so many times as long as what they hold is remembered
MIN_BLOCKS = 6  # fewest of which a standard error is estimated


class _Run(NamedTuple):
    """Averages of a run over a time, without what constant wrenches and the floor's slope explain."""

    times: Array  # (n,) [s]
    accelerations: Array  # (n, 3) [m/s^2], [rad/s^2]
    velocities: Array  # (n, 3) [m/s], [rad/s]
    commands: Array  # (n, k)
    before: Array  # (n, k) commands of an earlier time
    after: Array  # (n, k) and of one that is as much later


class Rests(NamedTuple):
    """What commands of several runs of a craft have to explain."""

    rests: Dict[bool, List[reply.Rest]]  # by whether it is twisted, as in reply.rest
    block: float  # length of blocks of time that are hardly correlated [s]


Told = Callable[[Recording], Array]  # rows (m, k) of what a recording's commands tell its craft


def rests(recordings: Sequence[Recording], told: Told, axes: slice = slice(3)) -> Optional[Rests]:
    """Of the motions of recordings; None where they are too short, or where commands answer the motion, as a
    controller's do, more than it answers them. axes: of the accelerations that are judged; the others decide
    neither that nor the blocks."""
    width = min((reply.coarse_width(one.motion) for one in recordings), default=0.0)
    constants = _constants([_averaged(recordings, told, twisted, width) for twisted in FRAMES], width)
    if constants is None:
        return None
    judged = constants[axes]
    shift, block = max(0.5 * width, float(judged.min())), LONG * (width + float(judged.max()))
    frames = {twisted: _averaged(recordings, told, twisted, width, shift) for twisted in FRAMES}
    if not frames[False] or not any(_follow(runs, block, axes) for runs in frames.values()):
        return None
    found = {
        twisted: [reply.Rest(r.times, r.accelerations + r.velocities / constants, r.commands) for r in runs]
        for twisted, runs in frames.items()
    }
    return Rests(found, block)


def _averaged(
    recordings: Sequence[Recording], told: Told, twisted: bool, width: float, shift: float = 0.0
) -> List[_Run]:
    """The averages of those recordings that are long enough."""
    every = [_run(one, told, twisted, width, shift) for one in recordings]
    return [run for run in every if run is not None]


def _run(recording: Recording, told: Told, twisted: bool, width: float, shift: float) -> Optional[_Run]:
    """The averages of a recording over a width [s]; shift: to earlier and later commands [s]."""
    motion, inside = recording.motion, reply.driven(recording, shift)
    if not inside.any():
        return None
    times, commands = motion.times[inside], told(recording)
    moved, nu, psi = reply.seen(motion, inside, twisted)
    level = np.column_stack([np.ones(len(psi)), np.cos(psi), np.sin(psi)])
    at = [recording.held(commands, times - lag) for lag in (0.0, shift, -shift)]
    rows = np.column_stack([times, moved, nu, *at, level])
    means = reply.means(times, rows, width, scatter.interval(motion.times))
    if len(means) < MIN_AVERAGES:
        return None
    base = np.linalg.qr(means[:, -3:])[0]
    left = kinematics.without(means[:, 1:-3], base)
    return _Run(means[:, 0], left[:, :3], left[:, 3:6], *np.split(left[:, 6:], 3, axis=1))


def _constants(frames: Sequence[Sequence[_Run]], width: float) -> Optional[Array]:
    """The time constants (3,) of accelerations [s] of which the commands explain most, with any sign and in
    any of some frames; one for both forces."""
    if not frames[0]:
        return None
    length = max(float(np.ptp(run.times)) for run in frames[0])
    tried = np.geomspace(FINEST * width, length, max(2, int(np.log(length / width / FINEST) / np.log(STEP))))
    shares = np.max([[_shares(runs, constant) for constant in tried] for runs in frames], axis=0)
    return np.asarray(tried[np.argmax(shares, axis=0)][[0, 0, 1]])


def _shares(runs: Sequence[_Run], constant: float) -> List[float]:
    """Shares of forces and turns that commands explain with a time constant [s]."""
    commands = np.concatenate([run.commands for run in runs])
    wanted = np.concatenate([run.accelerations + run.velocities / constant for run in runs])
    left = (kinematics.residuals(commands, wanted) ** 2).sum(axis=0)
    whole = np.maximum((wanted**2).sum(axis=0), 1e-300)
    return [1 - float(left[some].sum() / whole[some].sum()) for some in (slice(0, 2), slice(2, 3))]


def _follow(runs: Sequence[_Run], block: float, axes: slice) -> bool:
    """Whether earlier commands explain the velocities of some axes better than later ones."""
    unexplained = []
    for which in ("before", "after"):
        commands = np.concatenate([getattr(run, which) for run in runs])
        found = np.linalg.lstsq(commands, np.concatenate([run.velocities for run in runs]), rcond=None)[0]
        squares = [(run.velocities - getattr(run, which) @ found) ** 2 for run in runs]
        sums = [s[at, axes].sum(axis=0) for s, r in zip(squares, runs) for at in pieces(r.times, block)]
        unexplained.append(sums)
    if len(unexplained[0]) < MIN_BLOCKS:
        return False
    logs, parts = blocks.logs(np.array(unexplained))
    error = blocks.error_of_sum(parts[1:] - parts[:1])
    return bool(logs[1] - logs[0] > reply.CERTAIN * error[0])


def pieces(times: Array, length: float) -> List[Indices]:
    """Indices of samples with ascending stamps (n,) [s] in blocks of a length [s]."""
    block = ((times - times[0]) / length).astype(int)
    return list(np.split(np.arange(len(block)), np.flatnonzero(np.diff(block)) + 1))
