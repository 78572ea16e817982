"""Which angles of rudders and turning thrusters are recorded with the wrong sign.

Commands with the recorded angle and commands with the mirrored angle give two moments. The check compares
how well each moment explains the turns while damping acts. Side forces do not decide: a ship that turns
drifts outwards, whatever its rudder does.
"""

from typing import List, NamedTuple, Sequence

import numpy as np

from ground import _core
from ground.checks import blocks, damped, reply
from ground.reading.recording import Recording
from ground.support.annotations import Array

TURN = 2  # the moment's place in a wrench; it alone decides


class WrongSign(NamedTuple):
    """An angle that seems to be recorded with the wrong sign."""

    channel: str
    share: float  # of the turns that the commands explain if it is mirrored
    as_recorded: float  # and as recorded


def find(recordings: Sequence[Recording], model: _core.Model) -> List[WrongSign]:
    """The angles of a model's craft of which recordings show another sign; of several, those that explain
    more if they alone are mirrored."""
    names = [thruster["channel"] for thruster in model.thrusters]
    angles = [i for i, thruster in enumerate(model.thrusters) if thruster["is_angle"]]

    def told(recording: Recording) -> Array:
        """Moments of the commands, as they are and with each angle mirrored, (m, 1 + angles)."""
        inputs = recording.commands_of(names) * model.input_max
        signs = np.ones((1 + len(angles), len(names)))
        signs[range(1, 1 + len(angles)), angles] = -1
        return np.column_stack([model.forces(inputs * sign)[:, TURN] for sign in signs])

    later = damped.rests(recordings, told, slice(TURN, 3))
    if later is None:
        return []
    rests = later.rests[False]
    turns = np.concatenate([rest.accelerations[:, TURN] for rest in rests])
    moments = np.concatenate([rest.commands for rest in rests])
    sizes = np.maximum((moments**2).sum(axis=0), 1e-300)
    factors = np.maximum(moments.T @ turns, 0) / sizes  # a moment turns the craft its own way
    left = [
        ((rest.accelerations[at, TURN, None] - rest.commands[at] * factors) ** 2).sum(axis=0)
        for rest in rests
        for at in damped.pieces(rest.times, later.block)
    ]
    logs, parts = blocks.logs(np.array(left).T[:, :, None])
    clear = logs[0] - logs > reply.CERTAIN * blocks.error_of_sum(parts - parts[:1])
    shares = 1 - np.array(left).sum(axis=0) / max(float((turns**2).sum()), 1e-300)
    return [
        WrongSign(names[i], float(shares[j]), float(shares[0])) for j, i in enumerate(angles, 1) if clear[j]
    ]
