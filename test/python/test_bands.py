"""Prediction bands have the stated coverage on runs that the model was not fitted to."""

import dataclasses

import numpy as np
import pytest

import hidden_cases
from conftest import slow
from ground import _core
from ground.analysis import bands, folds, window_error
from ground.analysis.horizon import Starts
from ground.analysis.likelihood import Likelihood
from ground.diagnosing import words
from ground.recordings import windows
from ground.recordings.recording import POSE, VELOCITY
from ground.reports import figures

SEEDS = range(6)


def fitted(seed):
    """Fitted and other runs of a disturbed craft, and the fit."""
    case = hidden_cases.make("disturbed_null", seed)
    runs, others = hidden_cases.record(case)
    model = hidden_cases.given_model(case)
    return runs, others, Likelihood(runs, model).fit(model, window_error.NOMINAL)


@pytest.fixture(scope="module")
def cases():
    return [fitted(seed) for seed in SEEDS]


def shares(found):
    """Coverage by horizon and channel."""
    return {(row["horizon"], row["channel"]): row["coverage"] for row in bands.coverage(found)}


def of_folds(case):
    runs, _, fit = case
    split = folds.Folds(runs, Likelihood(runs, fit.model), windows.cut(runs), Starts.of(runs, 1.0))
    return bands.of_folds(split, fit)


@slow
def test_held_out_runs_are_covered(cases):
    found = [band for case in cases for band in of_folds(case)]
    share = shares(found)
    assert set(share) == {(h, c) for h in (0.5, 1.5, 4.0) for c in (*POSE, *VELOCITY)}
    for horizon in (1.5 * part for part in bands.HORIZONS):
        poses = [share[horizon, channel] for channel in POSE]
        assert 0.84 < np.mean(poses) < 0.96, horizon
        assert all(0.75 < share[horizon, channel] for channel in (*POSE, *VELOCITY)), share


def test_without_the_disturbance_nothing_is_covered(cases):
    found, calm = [], []
    for _, others, fit in cases:
        levels = {
            name: 1e-6 * value if name.split("_")[0] in ("sigma", "white") else value
            for name, value in fit.levels.items()
        }
        found += bands.of_others(others, fit, 160)
        calm += bands.of_others(others, dataclasses.replace(fit, levels=levels), 160)
    share, without = shares(found), shares(calm)
    for horizon in (1.5 * part for part in bands.HORIZONS):
        poses = [(horizon, channel) for channel in POSE]
        assert np.mean([without[p] for p in poses]) < np.mean([share[p] for p in poses]) - 0.25
    assert np.mean([share[p] for p in share]) > 0.8


def test_a_single_run_is_predicted_by_its_other_quarters(cases):
    runs, _, fit = cases[0]
    alone = runs[:1]
    near = dataclasses.replace(fit, loudness=())
    fit = Likelihood(alone, fit.model).fit(fit.model, fit.free, near=near)
    whole = Likelihood(alone, fit.model)
    split = folds.Folds(alone, whole, windows.cut(alone), Starts.of(alone, 1.0))
    (found,) = bands.of_folds(split, fit)
    starts = [p.times[0] for p in found.predictions]
    assert starts == sorted(starts) and len(set(starts)) == len(starts)
    assert starts[0] < alone[0].times[0] + 1 and starts[-1] > alone[0].times[-1] - 2


def test_predictions_follow_each_other_and_end_at_gaps(cases):
    run = cases[1][0][0]
    times = np.array(run.times)
    kept = (times < times[0] + 3.2) | (times > times[0] + 3.6)
    cut = _core.RunData(
        run.name,
        times[kept],
        np.array(run.eta)[kept],
        np.array(run.nu)[kept],
        np.array(run.inputs),
        np.array(run.poses)[kept],
        np.array(run.noise),
        run.drives,
    )
    (found,) = bands.of_others([cut], cases[1][2], 160)
    assert found.predictions
    for one in found.predictions:
        assert np.diff(one.times).max(initial=0) < 0.1
        assert (one.low <= one.high).all()
    for horizon in (1.5 * part for part in bands.HORIZONS):
        tiles = found.tiled(horizon)
        assert max(t[-1] - t[0] for t, _, _ in tiles) <= horizon
        ends = [t[-1] for t, _, _ in tiles]
        assert all(t[0] > end - 1.5 * bands.TOLERANCE for (t, _, _), end in zip(tiles[1:], ends))


def test_the_plot_shows_bands_below_all_curves(cases):
    from ground.reports import inspection

    runs, _, fit = cases[0]
    found = of_folds(cases[0])[0]
    drawn = figures.motion([inspection.inspect(runs[0], fit.model, "model")], found)
    traces = [t for t in drawn["data"] if t.get("name") == "90% band"]
    assert len(traces) == 3 and drawn["data"][:3] == traces
    (said,) = words.bands({"bands": bands.coverage([found])})
    assert "90% prediction bands contain" in said
    assert not list(words.bands({"bands": []}))
