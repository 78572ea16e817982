"""Every path to `missing`, to an effect that helps and to improved.yaml goes through the one judge: where it
vetoes, nothing is found, and where it is not asked, nothing can be."""

from unittest import mock

import pytest

import ground
from conftest import MODEL
from ground.analysis import judge
from test_simulation_search import LIFT, grown, runs_of

VETO = judge.Comparison("worse", -1.0, 0.1, 1.0, 0.1)
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
