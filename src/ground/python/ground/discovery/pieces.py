"""Pieces of a few seconds that excitations are put together from."""

from dataclasses import dataclass
from typing import List, Sequence, Tuple

import numpy as np

from ground import _core
from ground.simulation.designs import designs
from ground.support.annotations import Array

SECONDS = 4.0  # length of a piece [s]
REACH = 0.55  # way from home at which a burst is expected to end, as share of the room's clearance
STOPPING = 0.5  # time for which a craft moves on while it turns back [s]
RETURN = 1.2  # time that a return is expected to take [s]
RATE = 100.0  # poses per second of an expected motion [Hz]

Motion = Tuple[_core.RunData, float]  # an expected motion, and the time that it takes [s]


@dataclass(frozen=True)
class Piece:
    """Inputs of a few seconds."""

    words: str
    rows: Array  # (n, 2 + thrusters) time [s], inputs of the thrusters (of full scale), lift


def pieces(model: _core.Model, seed: int) -> List[Piece]:
    """All Pieces that the thrusters of a model can play; seed: of their random parts."""
    found = []
    for design in designs():
        try:
            rows = design.rows(SECONDS, model, seed)
        except ValueError:
            continue  # a design for other thrusters
        rows = rows[rows[:, 0] < SECONDS - 1e-9]
        found.append(Piece(design.words, np.column_stack([rows, np.full(len(rows), design.lift)])))
    return found


def joined(chosen: Sequence[Piece], lift_time: float) -> Array:
    """Rows of an experiment of several Pieces one after the other, after `lift_time` [s] of lift
    alone and until everything is off."""
    width = chosen[0].rows.shape[1]
    alone = np.zeros((1, width))
    alone[0, -1] = 1.0
    parts, start = [alone], lift_time
    for piece in chosen:
        parts.append(piece.rows + np.append(start, np.zeros(width - 1)))
        start += SECONDS
    off = np.zeros((1, width))
    off[0, 0] = start
    return np.vstack([*parts, off])


def motion(piece: Piece, model: _core.Model, room: _core.RoomPlan, noise: Array) -> Motion:
    """The motion that a model expects of a Piece, played in bursts that begin at home, as
    _core.RunData, and the time that it takes with its returns [s]. noise: of the poses (3,) [m],
    [m], [rad]. Raises GroundError when the motion is not finite."""
    reach = REACH * room.clearance(room.home)
    home = np.array([*room.home, 0.0])
    played, began = 0.0, 0.0  # inputs so far [s]; clock of the flight [s]
    times, eta, nu, inputs = [], [], [], []
    while played < SECONDS - 0.1:
        rows = _from(piece.rows, played)
        at = np.arange(0, SECONDS - played, 1 / RATE)
        scaled = rows.copy()
        scaled[:, 1:-1] *= model.input_max
        try:
            found = _core.simulate(model, scaled, at, home, np.zeros(3))
        except RuntimeError:  # its motion is not finite
            break
        kept = max(10, _inside(found["eta"], found["nu"], home, reach))
        times.append(began + at[:kept])
        eta.append(found["eta"][:kept])
        nu.append(found["nu"][:kept])
        scaled[:, 0] += began
        inputs.append(scaled[scaled[:, 0] < times[-1][-1]])
        played += at[min(kept, len(at)) - 1] + 1 / RATE
        began = times[-1][-1] + RETURN
    return _run(piece.words, (times, eta, nu, inputs), noise, [0.0]), began


def together(motions: Sequence[Motion]) -> _core.RunData:
    """Motions one after the other, each with its own drive, as one _core.RunData. motions: as `motion`
    returns them."""
    start, drives = 0.0, []
    times, eta, nu, inputs = [], [], [], []
    for run, seconds in motions:
        rows = np.array(run.inputs)
        rows[:, 0] += start
        times.append(np.array(run.times) + start)
        eta.append(np.array(run.eta))
        nu.append(np.array(run.nu))
        inputs.append(rows)
        drives.append(start)
        start += seconds
    noise = np.array(motions[0][0].noise)
    return _run("all pieces", (times, eta, nu, inputs), noise, drives)


def _run(name: str, parts: Sequence[Sequence[Array]], noise: Array, drives: Sequence[float]) -> _core.RunData:
    """_core.RunData of parts of times, poses, velocities and inputs; poses have no noise added."""
    times, eta, nu, inputs = (np.concatenate(part) for part in parts)
    return _core.RunData(name, times, eta, nu, inputs, eta, noise, drives)


def _from(rows: Array, start: float) -> Array:
    """Rows from a time on, with the time since then."""
    first = max(0, int(np.searchsorted(rows[:, 0], start + 1e-9, side="right")) - 1)
    left = rows[first:].copy()
    left[:, 0] = np.maximum(0.0, left[:, 0] - start)
    return left


def _inside(eta: Array, nu: Array, home: Array, reach: float) -> int:
    """Number of samples until the craft would have to turn back."""
    c, s = np.cos(eta[:, 2]), np.sin(eta[:, 2])
    moving = np.column_stack([c * nu[:, 0] - s * nu[:, 1], s * nu[:, 0] + c * nu[:, 1]])
    away = np.linalg.norm(eta[:, :2] + STOPPING * moving - home[:2], axis=1)
    out = np.flatnonzero(away > reach)
    return int(out[0]) if len(out) else len(eta)
