"""Long recordings are searched for effects in parts, which show the same as the whole."""

import numpy as np
import pytest

from conftest import ROOT, slow
from ground import _core
from ground.analysis import excerpts, windows
from ground.analysis.diagnosis import StepwiseDiagnosis
from ground.analysis.verdict import conclude
from ground.checks import quality
from ground.effect_library import candidates
from ground.models import Model
from ground.reading.recording import Recording

FREE_FLYER = ROOT / "cfg" / "craft" / "free_flyer.yaml"
VALVES = 8
CHANNELS = (*("valve_%d" % (i + 1) for i in range(VALVES)), "bearings")
NOISE = np.array([1.5e-5, 1.5e-5, 1e-4])  # m, m, rad
RATE = 60  # of the poses [Hz]
PERIOD = 0.5  # of the pulses [s]
TRIED = ("marker_offset", "floor_tilt", "valve_lag", "quadratic_drag")


def free_flyer(effects=()):
    """The craft without effects, or with some of a value for each parameter."""
    model = Model.load(FREE_FLYER).core
    for name in list(model.effects):
        model.remove_effect(name)
    for name, values in dict(effects).items():
        model = candidates.of_library(name).neutral(model)
        for parameter, value in values.items():
            model.set_value("%s.%s" % (name, parameter), value)
    return model


def pulses(duration, random):
    """Rows of time, eight valves and bearings, by pulse width."""
    edges = np.arange(0, duration, PERIOD)
    width = random.choice([0.0, 0.1, 0.25, 0.4], (len(edges), VALVES))
    times = np.unique(np.concatenate([edges, (edges[:, None] + width).ravel()]).round(6))
    begun = np.searchsorted(edges, times + 1e-9, side="right") - 1
    is_open = (times - edges[begun])[:, None] < width[begun] - 1e-9
    return np.column_stack([times, is_open, np.ones(len(times))]).astype(float)


def flown(model, duration, seed):
    """A run of a craft as it is read (_core.RunData)."""
    random = np.random.default_rng(seed)
    rows, times = pulses(duration, random), np.arange(int(duration * RATE)) / RATE
    eta = _core.simulate(model, rows, times, np.zeros(3), np.zeros(3))["eta"]
    eta = eta + NOISE * random.normal(size=eta.shape)
    run = Recording("run%d" % seed, times, eta, rows[:, 0], rows[:, 1:], "made up", channels=CHANNELS)
    return quality.repaired(run).data(free_flyer())


@pytest.fixture(scope="module")
def long_runs():
    truth = free_flyer({"marker_offset": {"dx": 0.03}, "floor_tilt": {"sy": 2e-4}})
    return [flown(truth, 200, seed) for seed in (1, 2)]


def test_short_runs_are_used_as_they_are():
    runs = [flown(free_flyer(), 60, seed=1)]
    assert excerpts.spread(runs)[0] is runs[0]


def test_all_of_long_runs_take_part_and_no_more_than_needed(long_runs):
    parts = excerpts.spread(long_runs)
    assert excerpts.duration(parts) < 0.5 * excerpts.duration(long_runs)
    for part, run in zip(parts, long_runs):
        assert set(part.times) < set(run.times)
        cut = windows.cut([part])
        assert len(cut) > 0 and part.name == run.name
        assert np.std(part.nu, axis=0)[2] > 0.9 * np.std(run.nu, axis=0)[2]  # it did not rest


@slow
def test_a_free_flyer_is_diagnosed_by_parts_of_its_runs(long_runs):
    given = free_flyer()
    tried = [c for c in candidates.library(given) if c.name in TRIED]
    found = StepwiseDiagnosis(long_runs, given, tried)
    found.grow()
    concluded = conclude(found)
    assert found.is_excerpt and found.names == {"marker_offset", "floor_tilt"}
    of_all = {p["name"]: p for p in concluded.after.parameters}
    for name, true in {"marker_offset.dx": 0.03, "floor_tilt.sy": 2e-4, "k": given.value("k")}.items():
        low, high = of_all[name]["ci95"]
        assert low - 0.5 * (high - low) < true < high + 0.5 * (high - low), name
    in_parts = {p["name"]: p for p in found.fit.parameters}
    assert of_all["k"]["deviation"] < in_parts["k"]["deviation"]
