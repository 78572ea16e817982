"""The search by simulation error, which a diagnosis turns to where the likelihood misleads."""

import numpy as np
import pytest

from conftest import schema
from ground.analysis import candidates, diagnosis, window_error
from ground.analysis.verdict import conclude
from ground.data.measured import measured
from ground.diagnosing import answer, document
from ground.fitting.fit import FitOptions
from ground.support.files import plain
from ground.support.progress import Work
from test_hulls import boat, recorded

TRIED = ("hull_lift", "surge_resistance", "motor_lag")
LIFT = dict(yv=-20.0, yr=-5.0, nv=-8.0, nr=-2.0)


def runs_of(seed, **hidden):
    """Runs of a boat, as they are analysed."""
    made = [recorded(boat(**hidden), seed + i, seconds=20) for i in range(5)]
    return measured(made, boat(), FitOptions(), Work()).data


def tried():
    return [c for c in candidates.library(boat().core) if c.name in TRIED]


@pytest.mark.parametrize("hidden, seed", [({}, 20), ({"hull_lift": LIFT}, 10)], ids=["nothing", "lift"])
def test_it_adds_what_is_hidden_and_nothing_else(hidden, seed):
    found = diagnosis.Diagnosis(runs_of(seed, **hidden), boat().core, tried())
    before = found.nominal
    assert found.grow_by_simulation() == bool(hidden)
    assert sorted(found.names) == list(hidden)
    for step in found.steps:
        assert step.p_value < 1e-3 and step.confirmed.rise < 0
        assert step.fit.heldout.sum() < 0.7 * before.heldout.sum()


def test_a_diagnosis_by_it_has_its_model_errors_and_words():
    runs = runs_of(30, hull_lift=LIFT)
    found = diagnosis.Diagnosis(runs, boat().core, tried())
    assert found.grow_by_simulation()
    conclusion = conclude(found)
    report = document.begun(found, conclusion, "boat")
    report = plain(document.completed(report, found, conclusion))
    schema("diagnosis").validate(report)
    assert report["verdict"] == "missing" and report["improved"]["by"] == "simulation"
    assert report["improved"]["effects"] == ["hull_lift"]
    assert report["steps"][0]["error"]["heldout"] < 0.7 * report["nominal"]["error"]["heldout"]
    error = report["prediction"]["errors"]
    assert error["improved"]["position_mm"] < 0.7 * error["refitted"]["position_mm"]
    values = {name: p["value"] for name, p in report["improved"]["parameters"].items()}
    # all masses of this model are fitted, so that only ratios to them are known
    assert values["hull_lift.yv"] / values["k"] == pytest.approx(LIFT["yv"] / 35, rel=0.1)
    assert any("by simulation error" in line for _, line in answer.lines(report))
    assert np.all([0.7 < row["coverage"] <= 1 for row in report["bands"]])


def test_a_run_whose_thrust_seems_turned_round_is_one_that_hardly_pushes():
    core = boat().core
    turned = window_error.trimmed(core, np.array([0.0, 0.0, 0.0, -1.5]))
    assert 0 < turned.value("k") < 0.01 * core.value("k")
