"""Share of a model's squared error that repeats where the commands repeat.

Where commands repeat, an error that depends on the commands repeats, too; a random wrench does not.
With e and e' the errors of two such windows, the mean of e e' is therefore the part of the mean of
e^2 that a missing effect could explain. It is an upper bound for effects that depend on the commands
alone. An error that also depends on place or heading need not repeat.
"""

from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import residuals
from ground.analysis.unfinished import can_be_kept
from ground.annotations import Array
from ground.errors import GroundError
from ground.recordings import windows

STEP = 0.01  # sampling step at which commands are compared [s]
BEFORE = 0.3  # time before a window whose commands are compared, too [s]
# Largest mean squared difference of repeated commands, relative to their variance: edges jitter.
MAX_DIFFERENCE = 0.15
MIN_VARIANCE = 1e-3  # commands that vary less repeat everywhere
MAX_REPETITIONS = 3  # largest number of repetitions of a window
MIN_WINDOWS = 8  # windows with a repetition that an estimate needs
SLACK = 0.02  # tolerance for poses that fall on other instants of the commands [s]


Repetition = Tuple[_core.Window, float]  # window, and by how much it is later [s]


@can_be_kept
@dataclass(frozen=True)
class Repeats:
    """How much of the squared error repeats; errors are relative to each run's standard deviations."""

    share: float  # part that repeats; may be below 0 by chance
    deviation: float  # standard error of the share
    windows: int  # number of windows with a repetition


def repeats(
    runs: Sequence[_core.RunData], cut: Sequence[_core.Window], model: _core.Model
) -> Optional[Repeats]:
    """The Repeats of a model's error over windows of runs (_core.RunData); None where commands
    do not repeat often enough."""
    repeated = [(window, _repetitions(runs, window)) for window in cut]
    repeated = [(window, found) for window, found in repeated if found]
    if len(repeated) < MIN_WINDOWS:
        return None
    sums = np.array([_products(runs, model, window, found) for window, found in repeated])
    alike, whole = sums.sum(axis=0)
    # The standard error by leaving out one window each (jackknife).
    shares = (alike - sums[:, 0]) / (whole - sums[:, 1])
    count = len(shares)
    deviation = np.sqrt((count - 1) / count * ((shares - shares.mean()) ** 2).sum())
    return Repeats(float(alike / whole), float(deviation), count)


def _products(
    runs: Sequence[_core.RunData],
    model: _core.Model,
    window: _core.Window,
    found: Sequence[Repetition],
) -> Tuple[float, float]:
    """Sums over samples of e e', and of (e^2 + e'^2)/2, of a window and its repetitions."""
    first, *others = _errors(runs, [window] + [other for other, _ in found], model)
    times, alike, whole = _times(runs, window), 0.0, 0.0
    for (other, lag), second in zip(found, others):
        again = _times(runs, other) - lag
        inside = (times >= again[0]) & (times <= again[-1])
        e = first[inside]
        e_again = np.column_stack([np.interp(times[inside], again, c) for c in second.T])
        alike += (e * e_again).sum()
        whole += 0.5 * ((e**2).sum() + (e_again**2).sum())
    return alike, whole


def _repetitions(runs: Sequence[_core.RunData], window: _core.Window) -> List[Repetition]:
    """Windows that repeat the commands of a window, and by how much they are later [s]."""
    run, times = runs[window.run], _times(runs, window)
    wanted = residuals.held(run, np.arange(times[0] - BEFORE, times[-1], STEP))
    spread = wanted.var(axis=0).sum()
    if spread < MIN_VARIANCE:
        return []
    found = []
    for index, other in enumerate(runs):
        clock = np.arange(other.times[0] - BEFORE, other.times[-1], STEP)
        if len(clock) < len(wanted):
            continue
        lags = clock[: len(clock) - len(wanted) + 1] + BEFORE - times[0]
        unlike = _unlike(residuals.held(other, clock), wanted)
        if index == window.run:
            unlike[np.abs(lags) < times[-1] - times[0] + BEFORE] = np.inf
        while unlike.min() < MAX_DIFFERENCE * spread:
            best = int(np.argmin(unlike))
            start = times[0] + lags[best]
            end = start + times[-1] - times[0]
            again = windows.cut_part(other, index, start - SLACK, end + SLACK, end - start - SLACK)
            if again:
                found.append((unlike[best], again[0], lags[best]))
            unlike[np.abs(lags - lags[best]) < end - start] = np.inf
    found.sort(key=lambda f: float(f[0]))
    return [(again, lag) for _, again, lag in found[:MAX_REPETITIONS]]


def _unlike(commands: Array, wanted: Array) -> Array:
    """Mean squared difference between the wanted commands and those from each sample on."""
    count = len(wanted)
    total = np.zeros(len(commands) - count + 1)
    for a, b in zip(commands.T, wanted.T):
        squares = np.concatenate([[0.0], np.cumsum(a**2)])
        total += squares[count:] - squares[:-count] - 2 * np.correlate(a, b) + (b**2).sum()
    return np.maximum(0.0, total / count)


def _times(runs: Sequence[_core.RunData], window: _core.Window) -> Array:
    return np.array(runs[window.run].times[window.first : window.last + 1])


def _errors(
    runs: Sequence[_core.RunData], cut: Sequence[_core.Window], model: _core.Model
) -> List[Array]:
    """Error of u, v, r over the run's standard deviation, (n, 3) of each window."""
    problem = windows.problem(runs, cut)
    try:
        motions = problem.simulate(model)["nu"]
    except RuntimeError as failure:
        raise GroundError(str(failure))
    return [
        (motion - np.array(runs[w.run].nu)[w.first : w.last + 1]) / problem.sigma(w.run)
        for w, motion in zip(cut, motions)
    ]
