"""What is odd about a recording, and the repaired poses that the other verbs use."""
from dataclasses import dataclass
from typing import Dict

import numpy as np

from ground import _core
from ground.errors import IdentifyError

BURST = 0.001  # poses closer than this came in one poll [s]
GAP = 0.05  # a longer pause is a gap [s]
MAX_GAP = 0.1  # over a longer one nothing is interpolated, and no window reaches [s]
FLIP_RATE = 40.0  # no craft turns faster [rad/s]


@dataclass
class CleanPoses:
    """Poses in ascending order of time with single-frame errors undone."""

    times: np.ndarray  # (n,) [s]
    eta: np.ndarray  # (n, 3) x, y [m], psi unwrapped [rad]
    repairs: Dict[str, int]  # what was done, how often
    polled: bool  # stamps are arrival times of a poll


def wrap(angle):
    return np.angle(np.exp(1j * np.asarray(angle)))


def clean(recording):
    """Sorts late stamps, drops true duplicates, undoes heading flips and unwraps the heading."""
    times, eta = recording.pose_times, recording.eta
    order = np.argsort(times, kind="stable")
    repairs = {"stamps put in order": int((np.diff(times) < 0).sum())}
    times, eta = times[order], eta[order].copy()
    same = (np.diff(times) == 0) & (np.diff(eta, axis=0) == 0).all(axis=1)
    repairs["duplicates dropped"] = int(same.sum())
    keep = np.concatenate([[True], ~same])
    times, eta = times[keep], eta[keep]
    if len(times) < 10:
        raise IdentifyError("%s: only %d distinct poses" % (recording.name, len(times)))
    polled = bool(np.mean(np.diff(times) < BURST) > 0.05)
    psi, flips = _undo_flips(times, eta[:, 2])
    repairs["heading flips undone"] = flips
    eta[:, 2] = np.unwrap(psi)
    return CleanPoses(times, eta, repairs, polled)


def _undo_flips(times, psi):
    """Single headings of the wrong sign: psi -> -psi for one frame, as mocap software does.

    A frame is a flip when its own heading needs an impossible turn both ways and minus its heading
    does not.
    """
    psi, flips = psi.copy(), 0
    for i in range(1, len(psi) - 1):
        # stamps of a poll say little about short times
        span = max(times[i + 1] - times[i - 1], 0.02)
        middle = psi[i - 1] + 0.5 * wrap(psi[i + 1] - psi[i - 1])
        as_it_is, turned = abs(wrap(psi[i] - middle)), abs(wrap(-psi[i] - middle))
        if as_it_is > FLIP_RATE * span / 2 and turned < 0.5 * as_it_is:
            psi[i] = -psi[i]
            flips += 1
    return psi, flips


def velocities(poses):
    """Smoothed poses and body velocities at the poses' times; see _core.smooth."""
    params = _core.EstimatorParams()
    params.gate = 8.0
    # A fast spin may turn by any angle meanwhile: to bridge a gap would be to guess it.
    params.max_gap = MAX_GAP
    if poses.polled:
        # A stamp off by some milliseconds is a pose off by as much as the craft moves meanwhile.
        params.position_noise, params.heading_noise = 4e-3, 3e-2
    return _core.smooth(poses.times, poses.eta, params)


def usable_span(recording, poses):
    """From the first to the last instant with both commands and poses [s]."""
    start = max(poses.times[0], recording.control_times[0])
    end = min(poses.times[-1], recording.control_times[-1])
    if not end > start:
        raise IdentifyError("%s: commands and poses do not overlap in time" % recording.name)
    return start, end


def describe(recording):
    """What `info` says of a recording, as a dictionary of plain values."""
    poses = clean(recording)
    times = recording.pose_times
    steps, control_steps = np.diff(np.sort(times)), np.diff(recording.control_times)
    start, end = usable_span(recording, poses)
    gaps = [
        {"start": float(t), "length": float(d)}
        for t, d in zip(np.sort(times)[:-1] - times.min(), steps)
        if d > GAP
    ]
    psi = recording.eta[:, 2]
    changes = (np.abs(np.diff(recording.controls[:, :2], axis=0)) > 1e-6).any(axis=1)
    moved = np.hypot(*(poses.eta[:, :2] - poses.eta[0, :2]).T) > 0.01
    return {
        "name": recording.name,
        "source": recording.source,
        "warnings": recording.warnings,
        "duration": float(
            max(times.max(), recording.control_times[-1])
            - min(times.min(), recording.control_times[0])
        ),
        "usable": {"start": float(start), "end": float(end), "duration": float(end - start)},
        "poses": {
            "count": len(times),
            "rate": float((len(times) - 1) / (times.max() - times.min())),
            "median_step": float(np.median(steps)),
            "gaps": gaps,
            "duplicate_stamps": int((steps == 0).sum()),
            "late_stamps": int((np.diff(times) < 0).sum()),
            "bursts": int((steps < BURST).sum()),
            "polled": poses.polled,
            "heading_wraps": int((np.abs(np.diff(psi)) > np.pi).sum()),
            "heading_flips": poses.repairs["heading flips undone"],
            "rest": float(poses.times[np.argmax(moved)] - poses.times[0]) if moved.any() else None,
        },
        "controls": {
            "count": len(recording.control_times),
            "rate": float(
                (len(control_steps)) / (recording.control_times[-1] - recording.control_times[0])
            ),
            "changes": int(changes.sum()),
            "after_poses": float(recording.control_times[0] - times.min()),
            "poses_end_early": float(recording.control_times[-1] - times.max()),
            "levels": [
                float(x) for x in (recording.controls[:, :2].min(), recording.controls[:, :2].max())
            ],
        },
        "repairs": poses.repairs,
    }


def make_run(recording, model, start=None, end=None):
    """The recording as the fit sees it, its clock starting with the usable span.

    `start` and `end` [s] restrict it further, on that clock.
    """
    poses = clean(recording)
    first, last = usable_span(recording, poses)
    motion = velocities(poses)
    low = first + (start or 0.0)
    high = last if end is None else min(last, first + end)
    inside = (poses.times >= low) & (poses.times <= high)
    if inside.sum() < 10:
        raise IdentifyError(
            "%s: only %d poses between %.2f and %.2f s; the usable span is %.2f s long"
            % (recording.name, inside.sum(), low - first, high - first, last - first)
        )
    inputs = np.column_stack(
        [
            recording.control_times - first,
            recording.controls[:, :2] * model.input_max,
            recording.controls[:, 2],
        ]
    )
    return _core.RunData(
        recording.name,
        poses.times[inside] - first,
        motion["eta"][inside],
        motion["nu"][inside],
        inputs,
    )
