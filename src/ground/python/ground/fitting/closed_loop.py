"""Whether a controller answers the motion of a recording: then disturbances look like effects of commands."""

from typing import TYPE_CHECKING, Iterator, Sequence

import numpy as np

from ground import _core
from ground.analysis import window_error
from ground.support.annotations import Array
from ground.support.errors import Diverged

if TYPE_CHECKING:
    from ground.checks.quality import RepairedRun

# Shares of the time scale: over which coming and past commands are averaged, how old motion is, samples
AHEAD, PAST, OLD, STEP = 0.1, (1e-3, 0.05, 0.1, 0.2, 0.4, 0.8), (0.1, 0.3), 0.05
MAX_SAMPLES, MIN_SAMPLES = 2000, 50  # samples of a run
SHIFTS = 49  # other times that the motion is tried at: fits to open loops are called closed in 1 of 50
MIN_NEW = 0.3  # share of the commands that past ones do not explain, above which the test is skipped


def closed(runs: "Sequence[RepairedRun]", data: Sequence[_core.RunData], model: _core.Model) -> Iterator[str]:
    """Names of the runs whose commands depend on the motion before them. data: of the runs; model: fitted.

    The test: motion explains the coming commands of all runs better than motion of any other time does,
    beside past commands and the motion that the model predicts from them, which are known in an open loop,
    too. Commands that are mostly new are as good as an open loop.
    """
    scale, found = _core.time_scale(model), {}
    for run, one in zip(runs, data):
        times = np.array(one.times)
        step = max(STEP * scale, float(np.ptp(times)) / MAX_SAMPLES)
        at: Array = np.arange(times[0] + scale, times[-1] - AHEAD * scale, step)
        if len(at) < MIN_SAMPLES:
            continue
        try:
            predicted = window_error.recorded(one, model, np.random.default_rng(0))
        except Diverged:  # the model's motion is not finite
            continue
        known = [np.ones(len(at)), _motion(times, np.array(predicted.poses), at, scale)]
        known += [_commands(run, at - b * scale, at - a * scale) for a, b in zip((0.0, *PAST), PAST)]
        base = np.linalg.qr(np.column_stack(known))[0]
        motion = _motion(times, np.array(one.poses), at, scale)
        coming = _commands(run, at, at + AHEAD * scale)
        coming = coming[:, np.ptp(coming, axis=0) > 1e-9]
        if not coming.size or len(at) < 2 * (base.shape[1] + motion.shape[1]):
            continue
        shifts = [0, *np.linspace(0.1 * len(at), 0.9 * len(at), SHIFTS).astype(int)]
        new = coming - base @ (base.T @ coming)
        if np.sum(new**2) > MIN_NEW * np.sum((coming - coming.mean(axis=0)) ** 2):
            continue
        coming = _rest(base, coming)
        found[one.name] = [np.linalg.norm(_rest(base, np.roll(motion, s, axis=0)).T @ coming) for s in shifts]
    now, *others = np.sum(list(found.values()), axis=0) if found else (0.0, 0.0)
    if now > max(others):
        yield from (name for name, shares in found.items() if shares[0] > np.median(shares[1:]))


def _rest(base: Array, columns: Array) -> Array:
    """Orthonormal columns of what a base does not explain."""
    return np.asarray(np.linalg.qr(columns - base @ (base.T @ columns))[0])


def _commands(run: "RepairedRun", begin: Array, end: Array) -> Array:
    """Mean thrust commands between times."""
    middle, width = run.zero + 0.5 * (begin + end), float(end[0] - begin[0])
    return run.recording.averaged(run.recording.thrust, middle, width)


def _motion(times: Array, poses: Array, at: Array, scale: float) -> Array:
    """What a controller may see at some times: heading, place and ways until then, in the body frame."""
    place, heading = poses[:, 0] + 1j * poses[:, 1], np.unwrap(poses[:, 2])
    place = place - place.mean()
    now, psi = np.interp(at, times, place), np.interp(at, times, heading)
    old = [at - share * scale for share in OLD]
    seen = [np.ones(len(at)), now, *(now - np.interp(time, times, place) for time in old)]
    turned = np.column_stack(seen) * np.exp(-1j * psi)[:, None]
    turns = [psi - np.interp(time, times, heading) for time in old]
    return np.column_stack([turned.real, turned.imag, *turns])
