"""Error of the true motion along a recorded flight: what noise of poses and disturbance leave to any model.

It is the project's error (window_error.channel_errors) with hidden_craft as the predictor: in each window the
true
craft moves from its true pose and inner states under the commands that reached it, without a disturbance,
from the initial velocities that fit best.
"""

import numpy as np

import hidden_craft
from ground.analysis import windows
from ground.checks import quality
from ground.simulation.experiments import START

STEPS = 1e-3  # change of an initial velocity for a derivative [m/s], [rad/s]
ITERATIONS = 2  # steps of Gauss and Newton; the motion is nearly linear in the initial velocities


def true_error(case, flown, model):
    """Mean |e|/s, summed over u, v, r. flown: an entry of HiddenLaboratory.flown."""
    run, states, arrived = flown
    repaired = quality.repaired(run)
    data = repaired.data(model)
    cut = windows.cut([data])
    sigma = windows.problem([data], cut).sigma(0)
    began = repaired.zero - START  # start of the data, on the clock of the flight [s]
    lifted = arrived[2][1] > 0
    drive = arrived[2][0][np.argmax(lifted)] if lifted.any() else 0.0
    errors = []
    for window in cut:
        at = slice(window.first, window.last + 1)
        times, measured = began + np.asarray(data.times)[at], np.asarray(data.nu)[at]
        predict = _Prediction(case, states, arrived, drive, times)
        errors.append(np.abs(_best(predict, measured, sigma) - measured) / sigma)
    return float(np.concatenate(errors).mean(axis=0).sum())


class _Prediction:
    """Velocities (n, 3) of the measured rigid body at times (n,) [s], given a change (3,) of the true
    velocities at the first of them."""

    def __init__(self, case, states, arrived, drive, times):
        self.case, self.arrived, self.times = case, arrived, times
        craft = hidden_craft.Craft(case.body, case.effects)
        self.mover = hidden_craft.Mover(craft, (0.0, 0.0, 0.0), drive, hidden_craft.BRAKING)
        row = states[max(0, np.searchsorted(states[:, 0], times[0] + 1e-9) - 1)]
        self._move(row[1:].tolist(), np.array([min(row[0], times[0]), times[0]]))
        self.first = list(self.mover.state)

    def __call__(self, change):
        state = list(self.first)
        state[3:6] = [value + d for value, d in zip(state[3:6], change)]
        rows = self._move(state, self.times)
        motion = hidden_craft.Motion(self.times, rows[:, :3], rows[:, 3:6], rows[:, 6:])
        return hidden_craft.seen_motion(self.case.effects, motion)[0]

    def _move(self, state, times):
        """Pose, velocities and accelerations (n, 9) at times (n,), from a state at the first of them."""
        self.mover.state = state
        edges = np.concatenate([channel[0] for channel in self.arrived])
        count = max(1, int(np.ceil((times[-1] - times[0]) / hidden_craft.COARSE)))
        steps = np.concatenate([times, edges, np.linspace(times[0], times[-1], count)])
        steps = np.unique(steps[(steps >= times[0]) & (steps <= times[-1])])
        held = np.column_stack([hidden_craft.held_at(channel, steps) for channel in self.arrived])
        lengths = np.append(np.diff(steps), 0.0)
        calm = (0.0, 0.0, 0.0)
        rows = np.array(
            [self.mover.step(*now, calm) for now in zip(steps.tolist(), lengths.tolist(), held.tolist())]
        )
        return rows[np.searchsorted(steps, times)]


def _best(predict, measured, sigma):
    """The prediction from the initial velocities that fit best."""
    change = np.zeros(3)
    for _ in range(ITERATIONS):
        found = predict(change)
        slopes = [((predict(change + step) - found) / sigma).ravel() / STEPS for step in STEPS * np.eye(3)]
        left = ((measured - found) / sigma).ravel()
        change = change + np.linalg.lstsq(np.column_stack(slopes), left, rcond=None)[0]
    return predict(change)
