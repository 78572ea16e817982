"""What of a model's error repeats where the commands repeat.

Where a run plays commands that were played before, what any function of the commands could explain
is the same again, and a random wrench is not. With e and e' the errors of two such windows, e e'
in place of e^2 is therefore, in the mean, the part of the squared error that commands and model
leave for an effect to explain: an upper bound for effects that depend on the commands alone. What
depends on the place or the heading, too, need not repeat.
"""

from dataclasses import dataclass

import numpy as np

from ground.analysis.unfinished import can_be_kept
from ground.errors import IdentifyError
from ground.recordings import windows

STEP = 0.01  # of the clock on which commands are compared [s]
BEFORE = 0.3  # commands before a window count as well [s]
SAME = 0.15  # mean squared difference of the same commands, of the variance of one: edges jitter
MOVING = 1e-3  # variance of commands that change
MOST = 3  # repetitions that are looked at, of each window
LEAST = 8  # windows with a repetition that an estimate needs


@can_be_kept
@dataclass(frozen=True)
class Repeats:
    """Of the squared error, relative to each run's standard deviations of u, v and r."""

    share: float  # that repeats; below 0 by chance
    deviation: float  # its standard error
    windows: int  # that have a repetition


def repeats(runs, cut, model):
    """The Repeats of a model's error over windows of runs (_core.RunData); None where commands
    do not repeat often enough to tell."""
    pairs = [(w, other, lag) for w in cut for other, lag in _repetitions(runs, w)]
    if len({id(w) for w, _, _ in pairs}) < LEAST:
        return None
    errors = _errors(runs, [w for pair in pairs for w in pair[:2]], model)
    alike, whole = {}, {}  # sums over samples, by window
    for i, (window, other, lag) in enumerate(pairs):
        times = _times(runs, window)
        again = _times(runs, other) - lag
        inside = (times >= again[0]) & (times <= again[-1])
        first = errors[2 * i][inside]
        second = np.column_stack([np.interp(times[inside], again, e) for e in errors[2 * i + 1].T])
        alike[id(window)] = alike.get(id(window), 0.0) + (first * second).sum()
        both = 0.5 * ((first**2).sum() + (second**2).sum())
        whole[id(window)] = whole.get(id(window), 0.0) + both
    alike, whole = np.array(list(alike.values())), np.array(list(whole.values()))
    share = alike.sum() / whole.sum()
    left_out = (alike.sum() - alike) / (whole.sum() - whole)  # one window each (jackknife)
    count = len(alike)
    deviation = np.sqrt((count - 1) / count * ((left_out - left_out.mean()) ** 2).sum())
    return Repeats(float(share), float(deviation), count)


def _repetitions(runs, window):
    """Windows in which the commands of one are played again, and how much later [s]."""
    run, times = runs[window.run], _times(runs, window)
    wanted = _commands(run, np.arange(times[0] - BEFORE, times[-1], STEP))
    spread = wanted.var(axis=0).sum()
    if spread < MOVING:
        return []
    found = []
    for index, other in enumerate(runs):
        clock = np.arange(other.times[0] - BEFORE, other.times[-1], STEP)
        if len(clock) < len(wanted):
            continue
        lags = clock[: len(clock) - len(wanted) + 1] + BEFORE - times[0]
        unlike = _unlike(_commands(other, clock), wanted)
        if index == window.run:
            unlike[np.abs(lags) < times[-1] - times[0] + BEFORE] = np.inf
        while len(unlike):
            best = int(np.argmin(unlike))
            if not unlike[best] < SAME * spread:
                break
            start = times[0] + lags[best]
            end = start + times[-1] - times[0]
            # a sample more: poses do not fall on the same instants of the commands
            again = windows.cut_part(
                other, index, start - 0.02, end + 0.02, times[-1] - times[0] - 0.02
            )
            if again:
                found.append((unlike[best], again[0], lags[best]))
            unlike[np.abs(lags - lags[best]) < end - start] = np.inf
    found.sort(key=lambda f: f[0])
    return [(again, lag) for _, again, lag in found[:MOST]]


def _unlike(commands, wanted):
    """Mean squared difference of the wanted commands to those that begin at each sample."""
    count = len(wanted)
    total = np.zeros(len(commands) - count + 1)
    for a, b in zip(commands.T, wanted.T):
        squares = np.concatenate([[0.0], np.cumsum(a**2)])
        total += squares[count:] - squares[:-count] - 2 * np.correlate(a, b) + (b**2).sum()
    return np.maximum(0.0, total / count)


def _commands(run, clock):
    """Left, right and lift (n, 3) that hold at times [s]; off before the first command."""
    inputs = np.array(run.inputs)
    at = np.searchsorted(inputs[:, 0], clock, side="right") - 1
    return np.where(at[:, None] < 0, 0.0, inputs[np.maximum(at, 0), 1:4])


def _times(runs, window):
    return np.array(runs[window.run].times[window.first : window.last + 1])


def _errors(runs, cut, model):
    """Error of u, v, r over the run's standard deviation, (n, 3) of each window."""
    problem = windows.problem(runs, cut)
    try:
        motions = problem.simulate(model)["nu"]
    except RuntimeError as failure:
        raise IdentifyError(str(failure))
    return [
        (motion - np.array(runs[w.run].nu)[w.first : w.last + 1]) / problem.sigma(w.run)
        for w, motion in zip(cut, motions)
    ]
