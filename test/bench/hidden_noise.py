"""Disturbance and pose measurement of the hidden-effect bench."""

import numpy as np
from scipy import signal

RATE = 120.0  # frames of the motion capture [Hz]
NOISE = np.array([3e-4, 3e-4, 5e-3])  # standard deviation of a pose [m], [m], [rad]
STEP = np.array([5e-4, 5e-4, 5e-3])  # resolution of quantised poses [m], [m], [rad]
SPIKE_SHARE, SPIKE_SIZE = 0.005, 15.0  # share of frames with a spike; its deviation in NOISE


def ornstein_uhlenbeck(random, count, step, time):
    """Samples (count,) every `step` [s] of a process of unit deviation and correlation time [s]."""
    keep = np.exp(-step / time)
    steps = np.sqrt(1 - keep**2) * random.normal(size=count)
    steps[0] = random.normal()
    return signal.lfilter([1.0], [1.0, -keep], steps)


def wrench(random, count, step, push):
    """Disturbance (count, 3) in the body's frame [N, N, N m], constant over each `step` [s].

    push: `sigma` (3) [N, N, N m] and `time` (3) [s] of its Ornstein-Uhlenbeck part, `white` (3)
    [N sqrt(s), N m sqrt(s)], constant `trim` (3) [N, N, N m]. If it has a part `room`, likewise for x, y,
    forces in the room's frame [N] are appended (count, 5).
    """
    columns = []
    for sigma, time, white, trim in zip(push["sigma"], push["time"], push["white"], push["trim"]):
        slow = sigma * ornstein_uhlenbeck(random, count, step, time)
        columns.append(trim + slow + white / np.sqrt(step) * random.normal(size=count))
    body = np.column_stack(columns)
    return np.hstack([body, wrench(random, count, step, push["room"])]) if "room" in push else body


def frames(random, end, mocap):
    """Times of the frames and their stamps [s], both (n,), from 0 to `end` [s]."""
    taken = np.arange(0, end, 1 / RATE)
    stamps = taken + mocap["jitter"] * random.normal(size=len(taken))
    return taken, np.maximum.accumulate(stamps)


def measured(random, poses, mocap):
    """Poses (n, 3) as the motion capture measures them; heading in -pi..pi.

    mocap: `kind` (white, coloured, heavy, spikes, quantised), `level` of the noise relative to NOISE,
    correlation `time` [s] of coloured noise, `step` of quantised poses relative to STEP, and what `smoothed`
    takes.
    """
    shape, kind, scale = poses.shape, mocap["kind"], mocap["level"] * NOISE
    if kind == "coloured":
        columns = [ornstein_uhlenbeck(random, shape[0], 1 / RATE, mocap["time"]) for _ in range(3)]
        noise = np.column_stack(columns)
    elif kind == "heavy":
        noise = random.standard_t(3, size=shape) / np.sqrt(3)
    else:
        noise = random.normal(size=shape)
    if kind == "spikes":
        off = random.uniform(size=shape[0]) < SPIKE_SHARE
        noise[off] += SPIKE_SIZE * random.normal(size=(off.sum(), 3))
    noisy = smoothed(poses + scale * noise, mocap)
    if kind == "quantised":
        step = mocap.get("step", 1.0) * STEP
        noisy = step * np.round(noisy / step)
    noisy[:, 2] = np.angle(np.exp(1j * noisy[:, 2]))
    return noisy


def smoothed(values, mocap):
    """Values of frames (n, k) after the low-pass of the motion capture, of second order (Butterworth):
    `cutoff` [Hz], None for none; `both`: forward and backward, so that nothing is late."""
    if not mocap.get("cutoff"):
        return values
    sections = signal.butter(2, mocap["cutoff"], fs=RATE, output="sos")
    if mocap["both"]:
        return signal.sosfiltfilt(sections, values, axis=0)
    begun = signal.sosfilt_zi(sections)[:, :, None] * values[0]
    return signal.sosfilt(sections, values, axis=0, zi=begun)[0]
