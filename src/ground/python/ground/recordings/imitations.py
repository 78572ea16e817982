"""Recordings as a model makes them by the same commands: what is found in these is no mistake of a recording.

A craft may move so that another reading of its channels explains more than the right one: a boat that only
turns by the difference of two propellers moves sideways as if one of them pushed it there.
"""

from dataclasses import replace
from typing import Optional, Sequence

import numpy as np

from ground import _core
from ground.recordings import layouts
from ground.recordings.quality import repaired
from ground.recordings.recording import Recording
from ground.support.errors import GroundError

REPEATED = 3  # imitations of recordings
LAX = 0.5  # chance that some other reading is preferred in an imitation whose channels do not show
WHY = "recordings that the model itself makes with these commands look so, too"


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


def confirmed(
    verdict: layouts.Verdict,
    recordings: Sequence[Recording],
    thrusters: Sequence[layouts.Thruster],
    model: Optional[_core.Model],
) -> layouts.Verdict:
    """The verdict of recordings of a craft; one that leaves open what would also be found in recordings that
    its model makes, if it is known."""
    if model is None or verdict.is_as_recorded:
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
