"""Formulas outside the library in the place of effects that imitate them, on crafts of the bench."""

import sys

import pytest
from conftest import ROOT

sys.path.insert(0, str(ROOT / "test" / "bench"))


def grown(kind, seed):
    """A case of the bench and its grown Diagnosis."""
    import hidden_white
    from ground import _core
    from ground.analysis import candidates
    from ground.analysis.diagnosis import Diagnosis

    case = hidden_white.make(kind, seed)
    model = _core.load_model(hidden_white.MODEL)
    runs = hidden_white.recorded(case)[1]
    found = Diagnosis(runs, model, candidates.library(model))
    found.grow()
    return case, found


def test_a_formula_is_likelier_than_the_effect_that_imitates_it():
    from ground.analysis.challengers import challengers

    case, found = grown("white_outside", 3)
    assert case["hidden"] == ["cubic yaw damping"] and found.names == {"quadratic_drag"}
    best = challengers(found)[0]
    assert best.entry["expression"] == {"N": "c1*(r^3)"}
    assert best.replaced == ("quadratic_drag",)
    assert best.lead > 100


def test_a_diagnosis_says_that_a_formula_is_likelier():
    """And that it is not, where the quadratic drag that was found does act."""
    import hidden_white
    from ground.analysis import diagnosis_report
    from ground.analysis.conclusion import conclude
    from ground.reports import words

    seed = list(hidden_white.strengths()).index("quadratic_drag") + 1
    for kind, number, says in (("white_outside", 3, True), ("white_single", seed, False)):
        _, found = grown(kind, number)
        assert found.names == {"quadratic_drag"}
        conclusion = conclude(found)
        report = diagnosis_report.begun(found, conclusion, "craft.yaml")
        report = diagnosis_report.completed(report, found, conclusion)
        sentences = list(words.described(report))
        assert any("N = c1*(r^3)" in sentence for sentence in sentences) == says
        assert bool(report["challengers"]) == says


@pytest.mark.parametrize("kind, seed", [("white_single", 7), ("white_pairs", 5)])
def test_no_formula_replaces_what_acts(kind, seed):
    from ground.analysis.challengers import challengers

    case, found = grown(kind, seed)
    assert found.names == set(case["hidden"])
    assert challengers(found) == []
