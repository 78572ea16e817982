"""How well a model can predict at all: bands that hold 90% of what may come, and how many they did hold.

A model and the random disturbance beside it (ground.analysis.likelihood) predict a run from many of its
samples on, each from what the poses up to there say, without any later pose. The bands are quantiles of
motions that the core draws (GreyBox::forecast). They are checked on runs that neither the model nor its
expected loudness was fitted to. Nothing is calibrated on these runs: how strongly a new run is disturbed
is weighed by the prior and by the run's own poses before each start.
"""
from dataclasses import dataclass
from typing import Any, Tuple

import numpy as np
from scipy import stats

from ground import _core
from ground.analysis.likelihood import CAP, call
from ground.errors import IdentifyError
from ground.recordings import repair, windows

PART = 0.9  # of the possible motions that a band holds
HORIZONS = (0.5, windows.WINDOW, 4.0)  # that the bands are checked at [s]
CHANNELS = ("x", "y", "psi", "u", "v", "r")
UNITS = ("m", "m", "rad", "m/s", "m/s", "rad/s")
POSE = CHANNELS[:3]  # measured; the others are smoothed from these
SHORT = HORIZONS[0]  # between starts; only from the start of a window on the horizon is the longest [s]
# Of 19, 39, 59 ... draws and the truth, the ranks that end the band are whole numbers.
DRAWS = 59
LATE = 0.05  # by which the sample at a horizon may miss it [s]


@dataclass(frozen=True)
class Prediction:
    """From one start on, a row a sample; the columns of (n, 6) are CHANNELS, in UNITS, as measured."""

    times: np.ndarray  # (n,) on the run's clock, the start's first [s]
    mean: np.ndarray  # (n, 6)
    deviation: np.ndarray  # (n, 6) standard deviation
    low: np.ndarray  # (n, 6) ends of the band
    high: np.ndarray  # (n, 6)
    measured: np.ndarray  # (n, 6) x, y, psi (unwrapped) as measured, u, v, r smoothed

    def sample(self, horizon):
        """Row at a horizon [s]; None where the prediction ends before."""
        at = int(np.searchsorted(self.times, self.times[0] + horizon, side="right")) - 1
        return at if self.times[at] - self.times[0] > horizon - LATE else None


@dataclass(frozen=True)
class Bands:
    """Predictions of one run by a model that was not fitted to it.

    Of a single run each quarter is predicted by a fit to the others; only the end of a long horizon may
    lie in a quarter that was fitted to.
    """

    run: Any  # _core.RunData
    predictions: Tuple[Prediction, ...]  # by their starts

    def tiled(self, horizon):
        """Predictions that follow each other, each cut off at a horizon [s]: a list of times (n,) [s],
        low (n, 6) and high (n, 6)."""
        tiles, end = [], -np.inf
        for one in self.predictions:
            is_short = one.times[-1] - one.times[0] < SHORT + LATE
            if one.times[0] < end - LATE or (is_short and horizon > SHORT):
                continue
            inside = one.times <= one.times[0] + horizon
            tiles.append((one.times[inside], one.low[inside], one.high[inside]))
            end = one.times[inside][-1]
        return tiles

    def at(self, horizon):
        """At a horizon [s]: standard deviations (k, 6), and whether the band holds what was measured."""
        deviation, held = np.zeros((0, 6)), np.zeros((0, 6), bool)
        for prediction in self.predictions:
            row = prediction.sample(horizon)
            if row is not None:
                measured = prediction.measured[row]
                within = (prediction.low[row] <= measured) & (measured <= prediction.high[row])
                deviation = np.vstack([deviation, prediction.deviation[row]])
                held = np.vstack([held, within])
        return deviation, held


def of_folds(folds, fit):
    """Bands of the runs (of a held_out.Folds) that a likelihood.Fit was fitted to, each by a refit
    without it. The levels stay those of the fit, but the loudness expected is that of the other runs."""
    models, runs = folds.models(fit), folds.runs
    if len(runs) == 1:
        edges = [part[0].times[0] for part in folds.parts[1:]]
        parts = [
            (runs[0], other, [w for w in folds.cut if np.searchsorted(edges, _time(runs[0], w)) == i])
            for i, other in enumerate(models)
        ]
        found = list(folds.each(lambda part: _predict(*part, _loudness(fit)), parts))
        predictions = sorted((p for b in found for p in b.predictions), key=lambda p: p.times[0])
        return [Bands(runs[0], tuple(predictions))]

    def one(i):
        cut = [w for w in folds.cut if w.run == i]
        return _predict(runs[i], models[i % folds.count], cut, _loudness(fit, i % folds.count, folds.count))

    return list(folds.each(one, range(len(runs))))


def of_others(runs, fit, most, each=map):
    """Bands of runs (_core.RunData) that a likelihood.Fit was not fitted to, at most about so many
    windows of them."""
    cut = windows.spread(windows.cut(runs), most)
    return list(
        each(
            lambda i: _predict(runs[i], fit, [w for w in cut if w.run == i], _loudness(fit)),
            range(len(runs)),
        )
    )


def _loudness(fit, fold=None, count=1):
    """The loudness to expect of a new run: the mean over runs that were fitted to, outside a fold."""
    known = [value for i, value in enumerate(fit.loudness) if i % count != fold]
    return float(np.mean(known)) if known else 0.0


def _time(run, window):
    return run.times[window.first]


def _predict(run, fit, cut, loudness):
    """Bands of a run from the starts that windows of it give; without predictions where a motion that
    was drawn is not finite."""
    times = np.array(run.times)
    starts, horizons = _starts(times, cut)
    box = call(_core.GreyBox, [run], fit.model)
    try:
        found = call(
            box.forecast,
            _core.GreyBoxPoint(fit.model, fit.levels, [loudness]),
            0,
            starts,
            horizons,
            unknown_loudness=True,
            part=PART,
            draws=DRAWS,
            velocity_noise=_smoothed_noise(run),
            cap=CAP,
        )
    except IdentifyError:
        return Bands(run, ())
    measured = _measured(run)
    predictions = []
    for one in found:
        rows = slice(one["first"], one["first"] + len(one["mean"]))
        truth = measured[rows].copy()
        # The filter may count turns otherwise.
        truth[:, 2] += 2 * np.pi * np.round((one["mean"][0, 2] - truth[0, 2]) / (2 * np.pi))
        predictions.append(
            Prediction(
                times[rows], one["mean"], one["deviation"], one["low"], one["high"], truth
            )
        )
    return Bands(run, tuple(predictions))


def _starts(times, cut):
    """Samples to predict from, and horizons [s]: the longest from the start of each window on, a short
    one every SHORT seconds between. A stretch's first poses only tell the filter the motion."""
    found = {}
    for window in cut:
        first, last = window.first, window.last
        begins = first == 0 or times[first] - times[first - 1] > repair.MAX_GAP
        if not begins:
            found[first] = HORIZONS[-1]
        for k in range(1, 1 + int((times[last] - times[first] - LATE) / SHORT)):
            at = int(np.searchsorted(times, times[first] + k * SHORT))
            rest = times[last] - times[at]
            found.setdefault(at, rest if begins and k == 1 else SHORT)
    starts = sorted(found)
    return starts, [found[start] for start in starts]


def _measured(run):
    """(n, 6) of CHANNELS; headings as measured, turns counted as in the smoothed ones."""
    eta, poses = np.array(run.eta), np.array(run.poses)
    if len(poses):
        eta = np.column_stack([poses[:, :2], eta[:, 2] + repair.wrap(poses[:, 2] - eta[:, 2])])
    return np.column_stack([eta, np.array(run.nu)])


def _smoothed_noise(run):
    """Standard deviations (3,) of what the smoothed velocities have of the poses' noise: the smoother is
    run on the run's smoothed poses with and without new noise."""
    times, eta, noise = np.array(run.times), np.array(run.eta), np.array(run.noise)
    noisy = eta + noise * np.random.default_rng(1).normal(size=eta.shape)
    levels = noise[0], noise[2]
    with_it, without = (repair.smooth(times, poses, levels)["nu"] for poses in (noisy, eta))
    return np.std(with_it - without, axis=0)


def coverage(bands):
    """How many measurements the bands of runs hold: a list of dictionaries, one for each horizon and
    channel, of horizon [s], channel, unit, coverage, ci95, sd (median of the predictions' standard
    deviations) and predictions.

    Predictions overlap and those of a run have much in common: ci95 takes only runs as independent
    (ratio estimator with Student's t); it is None for one run. Horizons that no run reaches are left
    out.
    """
    rows = []
    for horizon in HORIZONS:
        found = [one for one in (b.at(horizon) for b in bands) if len(one[0])]
        if not found:
            continue
        deviation = np.median(np.vstack([d for d, _ in found]), axis=0)
        held = np.array([h.sum(axis=0) for _, h in found])
        counts = np.array([len(h) for _, h in found])
        share = held.sum(axis=0) / counts.sum()
        half = _half_width(held - counts[:, None] * share, counts)
        for i, channel in enumerate(CHANNELS):
            rows.append(
                {
                    "horizon": horizon,
                    "channel": channel,
                    "unit": UNITS[i],
                    "coverage": float(share[i]),
                    "ci95": None
                    if half is None
                    else [max(0.0, float(share[i] - half[i])), min(1.0, float(share[i] + half[i]))],
                    "sd": float(deviation[i]),
                    "predictions": int(counts.sum()),
                }
            )
    return rows


def _half_width(off, counts):
    """Half of the 95% interval of shares whose clusters (rows) are off the mean by so many."""
    clusters = len(counts)
    if clusters < 2:
        return None
    error = np.sqrt(clusters / (clusters - 1) * (off**2).sum(axis=0)) / counts.sum()
    return stats.t.ppf(0.975, clusters - 1) * error
