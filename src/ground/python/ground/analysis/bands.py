"""Prediction bands of a model and its random disturbance, and their coverage on held-out runs.

The stochastic model (ground.analysis.likelihood) predicts a run from many of its samples. Each
prediction uses only the poses up to its start. Bands are quantiles of motions that the core draws
(GreyBox::forecast).

Coverage is counted on runs that nothing was calibrated on. The strength of the disturbance in a new
run is unknown. The forecast integrates over it, with a prior about the mean of the other runs and
the likelihood of the run's own poses up to each start. Parameters are drawn with the covariance that
their information gives. This widens the bands by 2% on the recordings of 2019, and threefold on a
few calm seconds.
"""

from dataclasses import dataclass
from typing import Dict, List, Sequence, Tuple, Union

import numpy as np

from ground import _core
from ground.analysis import windows
from ground.analysis.folds import Folds
from ground.analysis.likelihood import CAP, LikelihoodFit, call
from ground.poses import angles, repair
from ground.reading.recording import POSE, VELOCITY
from ground.support.annotations import Array, Each, Flags
from ground.support.errors import Diverged

_Task = Tuple[int, LikelihoodFit, Sequence[_core.Window], Sequence[float]]
PART = 0.9  # probability that a band holds the measurement
HORIZONS = (1 / 3, 1.0, 8 / 3)  # horizons at which coverage is counted [windows]
TOLERANCE = 1 / 30  # longest time from the last sample to the horizon [windows]


@dataclass(frozen=True)
class BandedPrediction:
    """A prediction from one start: a row for each sample of x, y [m], psi [rad], u, v [m/s], r [rad/s]."""

    times: Array  # (n,) on the run's clock; the first is the start [s]
    low: Array  # (n, 6) ends of the band
    high: Array  # (n, 6)
    measured: Array  # (n, 6) x, y, psi (unwrapped) as measured; u, v, r smoothed


@dataclass(frozen=True)
class Bands:
    """Predictions of one run by a model that was not fitted to it."""

    run: _core.RunData
    predictions: Sequence[BandedPrediction]  # in the order of their starts

    @property
    def unit(self) -> float:
        """Length of a window [s]."""
        return float(self.run.scales.window)

    def tiled(self, horizon: float) -> List[Tuple[Array, Array, Array]]:
        """Predictions that follow each other, each cut off at a horizon [s].

        Returns a list of times (n,) [s], low (n, 6) and high (n, 6).
        """
        tiles, end = [], -np.inf
        for one in self.predictions:
            if one.times[0] < end - TOLERANCE * self.unit:
                continue
            inside = one.times <= one.times[0] + horizon
            tiles.append((one.times[inside], one.low[inside], one.high[inside]))
            end = one.times[inside][-1]
        return tiles

    def at(self, horizon: float) -> Flags:
        """Whether the bands hold the measurements at a horizon [s], (k, 6)."""
        held = []
        for one in self.predictions:
            times = one.times - one.times[0]
            row = int(np.searchsorted(times, horizon, side="right")) - 1
            if times[row] > horizon - TOLERANCE * self.unit:
                held.append((one.low[row] <= one.measured[row]) & (one.measured[row] <= one.high[row]))
        return np.array(held, bool).reshape(-1, 6)


def of_folds(split: Folds, fit: LikelihoodFit, others: Sequence[LikelihoodFit] = ()) -> List[Bands]:
    """Bands of the runs that a LikelihoodFit was fitted to, each predicted by a refit without that run.

    split: Folds of these runs; others: the refits, if they are known. The levels of the fit are kept; the
    expected loudness is the loudness of the other runs. Each quarter of a single run is predicted by a fit to
    the others; the end of a long horizon may lie in a quarter that was fitted to."""
    tasks = []
    for fold, other in enumerate(others or split.models(fit)):
        alone = len(split.runs) == 1
        loudness = [v for k, v in enumerate(fit.loudness) if alone or k % split.count != fold]
        for i in range(len(split.runs)):
            cut = [w for w, f in zip(split.cut, split.fold_of) if w.run == i and f == fold]
            if cut:
                tasks.append((i, other, cut, loudness))
    return _bands(split.runs, tasks, split.each)


def of_others(
    runs: Sequence[_core.RunData], fit: LikelihoodFit, most: float, each: Each = map
) -> List[Bands]:
    """Bands of runs (_core.RunData) that a LikelihoodFit was not fitted to.

    most: approximate number of windows in which predictions start, spread evenly over the runs;
    each: maps a function over items, in parallel if it can.
    """
    cut = windows.spread(windows.cut(runs), most)
    tasks = [(i, fit, [w for w in cut if w.run == i], fit.loudness) for i in range(len(runs))]
    return _bands(runs, tasks, each)


def _bands(runs: Sequence[_core.RunData], tasks: Sequence[_Task], each: Each) -> List[Bands]:
    """Bands of runs by the predictions of tasks: number of a run, fit, windows, loudness of other runs."""
    found: List[List[BandedPrediction]] = [[] for _ in runs]
    for (i, *_), predictions in zip(tasks, each(lambda task: _predict(runs[task[0]], *task[1:]), tasks)):
        found[i] += predictions
    return [Bands(run, sorted(some, key=lambda one: float(one.times[0]))) for run, some in zip(runs, found)]


def _predict(
    run: _core.RunData, fit: LikelihoodFit, cut: Sequence[_core.Window], loudness: Sequence[float]
) -> List[BandedPrediction]:
    """Predictions of a run from starts in its windows; none if a motion is not finite."""
    times, measured = np.array(run.times), _measured(run)
    try:
        found = call(
            call(_core.GreyBox, [run], fit.model).forecast,
            _core.GreyBoxPoint(fit.model, fit.levels, [float(np.mean(loudness or [0.0]))]),
            0,
            *_starts(run, cut),
            unknown_scale=True,
            free=list(fit.free),
            information=fit.information,
            scale=list(fit.scale),
            part=PART,
            draws=59,  # 5% of 60 is whole, so that quantiles are order statistics
            velocity_noise=_smoothed_noise(run),
            cap=CAP,
        )
    except Diverged:
        return []
    predictions = []
    for one in found:
        rows = slice(one["first"], one["first"] + len(one["mean"]))
        truth = measured[rows].copy()
        # The filter's heading may differ by whole turns.
        truth[:, 2] += 2 * np.pi * np.round((one["mean"][0, 2] - truth[0, 2]) / (2 * np.pi))
        predictions.append(BandedPrediction(times[rows], one["low"], one["high"], truth))
    return predictions


def _starts(run: _core.RunData, cut: Sequence[_core.Window]) -> Tuple[List[int], List[float]]:
    """Samples to predict from, one in each window, and horizons [s]. None starts at a stretch's first pose:
    the filter first has to learn the motion, for the shortest horizon."""
    times, unit = np.array(run.times), run.scales.window
    starts, horizons = [], []
    for window in sorted(cut, key=lambda w: int(w.first)):
        first, last = window.first, window.last
        if first == 0 or times[first] - times[first - 1] > run.scales.max_gap:
            starts.append(int(np.searchsorted(times, times[first] + HORIZONS[0] * unit)))
            horizons.append(times[last] - times[starts[-1]])
        else:
            starts.append(first)
            horizons.append(HORIZONS[-1] * unit)
    return starts, horizons


def _measured(run: _core.RunData) -> Array:
    """(n, 6) as Prediction.measured; headings are unwrapped as the smoothed ones are."""
    eta, poses = np.array(run.eta), np.array(run.poses)
    if len(poses):
        eta = np.column_stack([poses[:, :2], eta[:, 2] + angles.wrap(poses[:, 2] - eta[:, 2])])
    return np.column_stack([eta, np.array(run.nu)])


def _smoothed_noise(run: _core.RunData) -> Array:
    """Standard deviations (3,) of the noise that smoothing leaves in u, v [m/s], r [rad/s]: by how
    much the velocities change when new noise is added to the smoothed poses."""
    eta, noise = np.array(run.eta), np.array(run.noise)
    noisy = eta + noise * np.random.default_rng(1).normal(size=eta.shape)
    with_it, without = (repair.again(run, poses)["nu"] for poses in (noisy, eta))
    return np.asarray(np.std(with_it - without, axis=0))


def coverage(bands: Sequence[Bands]) -> List[Dict[str, Union[float, str]]]:
    """Share of the measurements that the Bands of runs hold.

    Returns a list of dictionaries, one for each horizon and channel: horizon [s], channel, coverage,
    predictions (their number). Horizons that no run reaches are left out.
    """
    rows = []
    for horizon in [part * bands[0].unit for part in HORIZONS] if bands else []:
        held = np.vstack([b.at(horizon) for b in bands])
        rows += [
            {"horizon": horizon, "channel": channel, "coverage": share, "predictions": len(held)}
            for channel, share in zip((*POSE, *VELOCITY), held.mean(axis=0).tolist() if len(held) else ())
        ]
    return rows
