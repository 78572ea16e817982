"""The fixed part of the hidden-effect bench: every effect once, nothing, and what no library holds."""
import concurrent.futures
import pathlib
import sys

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "bench"))


@pytest.fixture(scope="module")
def results():
    """What the bench finds for one seed of each kind of case."""
    import hidden
    import hidden_cases

    shared = {"seed": 1, "noise": 1.0, "excitation": "varied", "strength": "moderate"}
    cases = [
        dict(shared, factor=1.0, kind="single", hidden=[effect])
        for effect in hidden_cases.STRENGTHS
    ]
    cases += [dict(shared, factor=0, kind="nothing", hidden=[], seed=seed) for seed in range(1, 7)]
    cases += [
        dict(shared, factor=1.0, kind="outside", hidden=[name]) for name in hidden_cases.OUTSIDE
    ]
    for seed in (2, 3):
        cases += hidden.ambiguous_cases(dict(shared, seed=seed))
    with concurrent.futures.ProcessPoolExecutor() as pool:
        found = list(pool.map(hidden.run_case, cases))
    assert not [r for r in found if "failed" in r]
    return found


def of(results, kind):
    return [r for r in results if r["kind"] == kind]


def test_every_effect_is_found_first(results):
    single = of(results, "single")
    assert len(single) == 23
    missed = [r["hidden"] for r in single if r["ranked"][0] != r["hidden"][0]]
    assert len(missed) <= 1, missed


def test_with_the_effect_the_error_is_that_of_the_truth(results):
    for r in of(results, "single"):
        assert r["improved"] <= 1.05 * r["truth"], r["hidden"]


def test_intervals_hold_the_truth(results):
    inside = [i for r in of(results, "single") for i in r["inside"]]
    assert len(inside) > 25
    assert sum(inside) >= 0.85 * len(inside)


def test_nothing_is_found_where_nothing_is_hidden(results):
    assert [r["verdict"] for r in of(results, "nothing")] == ["complete"] * 6


def test_what_runs_cannot_tell_apart_an_experiment_can(results):
    ambiguous = of(results, "ambiguous")
    grouped = [r for r in ambiguous if len(r["before"]["group"]) > 1]
    assert len(grouped) >= 4
    for r in ambiguous:
        assert len(r["after" if r in grouped else "before"]["group"]) == 1, r
        assert r["after" if r in grouped else "before"]["chosen"] == r["hidden"], r


def test_what_is_not_in_the_library_stays_unexplained(results):
    from hidden_cases import OUTSIDE

    for r in of(results, "outside"):
        assert r["verdict"] == "unexplained", r["hidden"]
        assert OUTSIDE[r["hidden"][0]][2] & set(r["where"][:2]), r
