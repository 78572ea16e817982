"""Recordings as a model makes them by the same commands: what is found in these is no mistake of a recording.

A craft may move so that another reading of its channels explains more than the right one: a boat that only
turns by the difference of two propellers moves sideways as if one of them pushed it there.
"""

from dataclasses import replace
from typing import List, Optional, Sequence

import numpy as np

from ground import _core
from ground.checks import layouts, reply
from ground.checks.quality import repaired
from ground.poses import kinematics
from ground.reading.recording import Recording
from ground.support.annotations import Array
from ground.support.errors import GroundError

REPEATED = 3  # imitations of recordings
PAIR = """
schema: ground/model/1
name: a pair
body: {m: 1.0, l: 1.0, k: %r, I_z: %r, X_u: %r, Y_v: %r, N_r: %r, input_max: 1.0}
effects: []
"""
IDLE = 0.1  # least change of the sum, over the change of the difference
MIN_AVERAGES = 20  # averages that a rough model follows from
LAX = 0.5  # chance that some other reading is preferred in an imitation whose channels do not show
WHY = "recordings simulated with these commands look the same"


def imitation(recording: Recording, model: _core.Model, seed: int) -> Optional[Recording]:
    """A recording by the same commands, of the motion that a model has, with the same noise of the poses;
    None where that motion is not finite. Raises GroundError when the recording has other channels."""
    motion, random = recording.motion, np.random.default_rng(seed)
    *thrusters, lift = model.channels
    commands = recording.commands_of(thrusters) * model.input_max
    lifts = recording.commands_of([lift]) if lift in recording.channels else np.ones((len(commands), 1))
    rows = np.column_stack([recording.control_times, commands, lifts])
    noise = np.array(motion.noise)[[0, 0, 1]]
    run = repaired(recording)
    drives = [start + run.zero for start in run.drives]
    try:
        moved = _core.simulate(
            model, rows, motion.times, motion.eta[0], motion.nu[0], drives, payload=recording.payload
        )["eta"]
    except RuntimeError:
        return None
    poses = moved + noise * random.normal(size=moved.shape)
    return replace(recording, pose_times=motion.times, eta=poses, clock_offset=0.0, inertial=None)


def rough(recordings: Sequence[Recording]) -> Optional[_core.Model]:
    """A pair of thrusters of mass 1 kg that moves about as recordings of a craft without a model do: forces
    by the sum and moments by the difference of its inputs, and linear damping, by regressions. None where
    that is no such craft: where a thruster does the opposite, or commands change too little."""
    parts = [_means(recording) for recording in recordings]
    rows = np.vstack([part for part in parts if part is not None] or [np.empty((0, 8))])
    if len(rows) < MIN_AVERAGES:
        return None
    (X, Y, N), (u, v, r), (left, right) = rows[:, :3].T, rows[:, 3:6].T, rows[:, 6:].T

    def regressed(acceleration: Array, *columns: Array) -> List[float]:
        solution = np.linalg.lstsq(np.column_stack(columns), acceleration, rcond=None)[0]
        return [float(value) for value in solution]

    one = np.ones(len(rows))
    push, surge, _ = regressed(X, left + right, u, one)
    turn, yaw, _ = regressed(N, left - right, r, one)
    if (left + right).std() < IDLE * (left - right).std():  # only the speed that it holds shows the push
        surge = yaw
        push = -surge * u.mean() / max((left + right).mean(), 1e-9)
    sway, _ = regressed(Y, v, one)
    if not (push > 0 and turn > 0):
        return None
    inertia = push / turn
    body = (push, inertia, *(max(0.0, damping) for damping in (-surge, -sway, -inertia * yaw)))
    model = _core.Model.__new__(_core.Model)
    model.__setstate__(PAIR % body)
    return model


def _means(recording: Recording) -> Optional[Array]:
    """Accelerations, velocities and inputs of a pair (n, 8), averaged over the coarse time of a recording."""
    motion, inside = recording.motion, reply.driven(recording)
    if not inside.any():
        return None
    times = motion.times[inside]
    commands = reply.commands_at(
        recording, recording.commands_of(["left", "right"]), times - reply.lag_of(recording)
    )
    rows = np.column_stack([kinematics.accelerations(motion)[inside], motion.nu[inside], commands])
    return reply.coarse(motion, times, rows)


def confirmed(
    verdict: layouts.LayoutVerdict,
    recordings: Sequence[Recording],
    thrusters: Sequence[layouts.Thruster],
    model: Optional[_core.Model],
) -> layouts.LayoutVerdict:
    """The verdict of recordings of a craft. A hypothesis stays open if imitations would show it, too: these
    are recordings that the craft's model makes, or the model of a pair of thrusters that moves like it."""
    if verdict.is_as_recorded:
        return verdict
    model = rough(recordings) if model is None else model
    if model is None:
        return verdict
    for seed in range(REPEATED):
        made = [one for one in (imitation(recording, model, seed) for recording in recordings) if one]
        if len(made) == len(recordings) and not _looks_recorded(made, thrusters):
            others = [verdict.best, *verdict.undecided]
            return replace(verdict, best=verdict.recorded, same=[], undecided=others, why=WHY)
    return verdict


def _looks_recorded(made: Sequence[Recording], thrusters: Sequence[layouts.Thruster]) -> bool:
    """Whether imitations do not suggest another reading."""
    try:
        return layouts.judge(made, thrusters, LAX).is_as_recorded
    except GroundError:  # their commands change too little
        return True
