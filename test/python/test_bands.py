"""Prediction bands have the stated coverage on runs that the model was not fitted to."""

import dataclasses

import numpy as np
import pytest

import hidden_cases
from conftest import slow
from ground.analysis import bands, folds, window_error, windows
from ground.analysis.horizon import Starts
from ground.analysis.likelihood import Likelihood
from ground.reading.recording import POSE, VELOCITY

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
    return {(row.horizon, row.channel): row.coverage for row in bands.coverage(found)}


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
