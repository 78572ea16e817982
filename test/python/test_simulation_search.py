"""The search by simulation error, and the one judge through which every answer goes."""

from unittest import mock

import numpy as np
import pytest

import ground
from conftest import MODEL, schema, slow
from ground.analysis import diagnosis, judge
from ground.analysis.verdict import conclude
from ground.data.measured import measured
from ground.diagnosing import answer, reporting
from ground.effect_library import candidates
from ground.fitting.fit import FitOptions
from ground.support import records
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


def grown(runs):
    """A diagnosis as it turns to the search by simulation error: that by likelihood has ended."""
    found = diagnosis.StepwiseDiagnosis(runs, boat().core, tried())
    found.grow()
    return found


@pytest.fixture(scope="module")
def found():
    """A diagnosis by simulation error of boats with a hidden lift, which their likelihood shows as well."""
    by_both = grown(runs_of(30, hull_lift=LIFT))
    by_likelihood = by_both.model
    assert by_both.grow_by_simulation("")
    assert by_both.model is not by_likelihood
    return by_both


def test_it_adds_what_is_hidden_and_nothing_else(found):
    assert sorted(found.names) == ["hull_lift"]
    for step in found.steps:
        assert step.p_value < 1e-3 and step.confirmed.rise < 0
        assert step.fit.heldout.sum() < 0.7 * found.nominal.heldout.sum()
    nothing = grown(runs_of(20))
    assert not nothing.grow_by_simulation("") and not nothing.names


@slow
def test_an_effect_that_the_likelihood_refused_and_it_finds_is_not_refused():
    worse = judge.PairedComparison("worse", -1.0, 0.1, 1.0, 0.1)
    with mock.patch.object(diagnosis, "compared", return_value=worse):
        found = grown(runs_of(10, hull_lift=LIFT))
    assert "hull_lift" in [dropped.trial.name for dropped in found.dropped] and not found.names
    assert found.grow_by_simulation("") and sorted(found.names) == ["hull_lift"]
    assert not found.names & {dropped.trial.name for dropped in found.dropped}


def test_a_diagnosis_by_it_has_its_model_errors_and_words(found):
    conclusion = conclude(found)
    contents = reporting.begun(found, conclusion, "boat")
    contents, _ = reporting.completed(contents, found, conclusion)
    report = plain(records.plain(contents))
    schema("diagnosis").validate(report)
    assert report["verdict"] == "missing" and report["improved"]["by"] == "simulation"
    assert report["improved"]["effects"] == ["hull_lift"]
    assert report["steps"][0]["error"]["heldout"] < 0.7 * report["nominal"]["error"]["heldout"]
    error = report["prediction"]["errors"]
    assert error["improved"]["position_mm"] < 0.7 * error["refitted"]["position_mm"]
    values = {name: p["value"] for name, p in report["improved"]["parameters"].items()}
    # all masses of this model are fitted, so that only ratios to them are known
    assert values["hull_lift.yv"] / values["k"] == pytest.approx(LIFT["yv"] / 35, rel=0.1)
    assert any("by simulation error" in line for _, line in answer.lines(contents))
    assert np.all([0.7 < row["coverage"] <= 1 for row in report["bands"]])


# --- every answer goes through the one judge


VETO = judge.PairedComparison("worse", -1.0, 0.1, 1.0, 0.1)
PLACES = ("ground.analysis.judge.compared", "ground.analysis.diagnosis.compared")


@pytest.fixture
def vetoed():
    with mock.patch(PLACES[0], return_value=VETO), mock.patch(PLACES[1], return_value=VETO):
        yield


def flown(**hidden):
    """Two runs of a craft with an effect that its model does not have, and the model."""
    given = ground.Model.load(MODEL)
    true = given
    for name, effect in hidden.items():
        true = true + (effect if isinstance(effect, ground.Effect) else ground.Effect(name, **effect))
    runs = [ground.simulate(true, seed=seed, duration=8, name="run%d" % seed) for seed in (1, 2)]
    return given, runs


def test_an_effect_of_the_likelihood_is_judged(vetoed):
    given, runs = flown(motor_lag={"tau": 0.06})
    found = ground.diagnose(given, runs, only=["motor_lag"])
    assert found.verdict != "missing" and not found.effects and not found.improved.effects


def test_an_effect_of_the_simulation_error_is_judged(vetoed):
    found = grown(runs_of(30, hull_lift=LIFT))
    assert not found.grow_by_simulation("")
    names = sorted(found.names)
    for why in ("first", "then"):  # what is withdrawn is told once, by the last reason
        found.withdraw(why)
    assert not found.names and not found.steps
    told = [dropped.trial.name for dropped in found.dropped]
    assert set(names) <= set(told) and len(told) == len(set(told))


def test_a_formula_is_judged(vetoed):
    waves = ground.Effect("washboard", X="a*sin(2*pi*x/0.3)", a=(0.012, "N"))
    found = ground.diagnose(*flown(washboard=waves), only=["wind"])
    assert found.proposal is None and not found.improved.effects


def test_an_added_effect_is_judged(vetoed):
    given, runs = flown(motor_lag={"tau": 0.06})
    added = ground.add(given, "motor_lag", runs)
    assert added.error["heldout"].change < 0 and not added.verdict.helps
