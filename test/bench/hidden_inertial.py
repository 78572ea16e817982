"""Gyro and accelerometer of a hidden craft: a usual MEMS sensor, mounted as such are."""

import numpy as np

from ground.poses.inertial import InertialSamples

RATE = 200.0  # of samples [Hz]
DELAY = 0.005  # from a sample to its stamp [s]
TURN_NOISE = np.radians(0.1)  # standard deviation of a sample [rad/s]
PUSH_NOISE = 0.05  # the same [m/s^2]
TURN_STEP, PUSH_STEP = np.radians(1 / 16.4), 9.80665 / 2048  # resolution [rad/s], [m/s^2]
TURN_BIAS, PUSH_BIAS = np.radians(0.5), 0.1  # standard deviations from run to run [rad/s], [m/s^2]
MOUNTING = np.radians(2.0)  # standard deviation of the angle [rad]
PLACE = 0.02  # standard deviation of the distance from the centre, each way [m]


def measured(random, motion, end):
    """Samples of a run of a craft (hidden_craft.Motion) until `end` [s], in units of their resolution."""
    taken = np.arange(motion.times[0], end, 1 / RATE) + random.uniform(0, 1 / RATE)
    taken = taken[taken < motion.times[-1]]
    u, v, r = (np.interp(taken, motion.times, motion.nu[:, c]) for c in range(3))
    after = np.clip(np.searchsorted(motion.times, taken, side="right") - 1, 0, len(motion.times) - 1)
    du, dv, dr = motion.nu_dot[after].T
    px, py = PLACE * random.normal(size=2)
    force = np.column_stack([du - v * r - dr * py - r * r * px, dv + u * r + dr * px - r * r * py])
    angle = MOUNTING * random.normal()
    turned = force @ np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turn = r + TURN_BIAS * random.normal() + TURN_NOISE * random.normal(size=len(r))
    push = turned + PUSH_BIAS * random.normal(size=2) + PUSH_NOISE * random.normal(size=turned.shape)
    return taken + DELAY, np.round(turn / TURN_STEP), np.round(push / PUSH_STEP)


def samples(random, motion, end, origin):
    """The InertialSamples of a run whose clock is 0 at `origin` [s]."""
    stamps, turn, push = measured(random, motion, end)
    return InertialSamples(origin + stamps, turn, push, "hidden_inertial")
