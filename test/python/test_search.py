"""The search for effects under a random disturbance, on crafts of the hidden-effect bench."""

import functools

import pytest

from conftest import slow


@functools.lru_cache(maxsize=None)
def diagnosed(kind, seed):
    """A case of the bench, its Diagnosis and Conclusion."""
    import hidden_cases
    from ground.analysis import diagnosis
    from ground.analysis.verdict import conclude
    from ground.effect_library import candidates

    case = hidden_cases.make(kind, seed)
    fitted, held = hidden_cases.record(case)
    model = hidden_cases.given_model(case)
    found = diagnosis.StepwiseDiagnosis(fitted, model, candidates.library(model))
    found.grow()
    return case, found, conclude(found, held)


def names(found):
    return sorted(c.name for c in found.chosen)


def test_a_random_wrench_is_not_taken_for_an_effect():
    case, found, conclusion = diagnosed("disturbed_null", 4)
    assert names(found) == []
    assert conclusion.verdict in ("complete", "varies", "undecided")
    full = 2 * case.body["k"]
    assert 0.3 * case.level < found.fit.levels["sigma_X"] / full < 5 * case.level


def test_an_effect_is_found_in_a_disturbance_with_its_size():
    case, found, conclusion = diagnosed("disturbed_single", 8)
    (hidden,) = case.hidden
    assert names(found) == [hidden] and conclusion.verdict == "missing"
    assert conclusion.heldout[-1] < conclusion.heldout[0]
    values = {p["name"]: p for p in conclusion.after.parameters}
    for name, true in case.effects[hidden].items():
        p = values["%s.%s" % (hidden, name)]
        assert abs(p["value"] - true) < 4 * p["deviation"], name


@slow
def test_a_delay_and_a_lag_are_found_together():
    # With a delay in the model, a lag is a longer delay to first order: score tests do not see it.
    case, found, _ = diagnosed("twins", 2)
    assert case.hidden == ["input_delay", "motor_lag"]
    assert names(found) == case.hidden


@slow
def test_a_trim_that_differs_between_runs_is_reported_and_an_effect_beside_it_found():
    case, found, conclusion = diagnosed("trim_single", 7)
    assert names(found) == case.hidden
    assert "yaw moment" in [v.parameter for v in conclusion.varies]


@slow
@pytest.mark.parametrize("seed", [5017, 5014])
def test_a_trim_of_the_runs_held_out_does_not_refuse_an_effect(seed):
    # Unknown trims of the held-out runs would refuse the first effect, those of folds the second.
    case, found, conclusion = diagnosed("trim_single", seed)
    assert names(found) == case.hidden
    assert conclusion.heldout[-1] < 0.8 * conclusion.heldout[0]


@pytest.mark.parametrize(
    "kind, seed, expected",
    [
        ("trim", 1, ["yaw moment"]),
        ("trim", 5, ["side force"]),  # the disturbance of some runs is slow
        ("disturbed_null", 6, []),  # slow in all runs
    ],
)
def test_differences_between_runs_are_distinguished_from_a_slow_disturbance(kind, seed, expected):
    import hidden_cases
    from ground.analysis import run_differences, window_error
    from ground.analysis.likelihood import Likelihood

    case = hidden_cases.make(kind, seed)
    fitted, _ = hidden_cases.record(case)
    model = hidden_cases.given_model(case)
    likelihood = Likelihood(fitted, model)
    fit = likelihood.fit(model, window_error.free_parameters(model))
    found = run_differences.differences(likelihood, fit)
    assert [kind.parameter for kind in found] == expected


@slow
def test_a_force_that_all_runs_have_does_not_differ_between_them():
    case, found, conclusion = diagnosed("triples", 8)
    assert "yaw_bias" in case.hidden and "yaw_bias" in names(found)
    assert not any(v.parameter == "yaw moment" for v in conclusion.varies)


@slow
def test_memory_is_found_and_no_effect_is_chosen_for_it():
    case, found, conclusion = diagnosed("history", 10)
    assert list(case.effects) == ["warm_up"]
    assert conclusion.verdict == "memory" and names(found) == []
    assert "the past" in conclusion.formula.means
    assert conclusion.formula.fit.log_posterior > found.fit.log_posterior + 50


HAS_NAME = [(1, "spin_up", "motor_rise_fall"), (7, "thrust_droop", "thrust_droop")]


@slow
@pytest.mark.parametrize("seed, kind, name", HAS_NAME)
def test_memory_that_has_a_name_is_named(seed, kind, name):
    case, found, conclusion = diagnosed("history", seed)
    assert list(case.effects) == [kind] and names(found) == [name]
    assert conclusion.verdict == "missing"
