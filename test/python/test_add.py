"""identify add as a user runs it."""

import json

import numpy as np
import pytest

from conftest import MODEL, identify, json_of, succeeds, with_effect, write_bag
from ground.analysis import distributions


@pytest.fixture
def lagging(tmp_path):
    """Bags of a craft whose motors lag by 60 ms."""
    truth = with_effect(tmp_path / "truth.yaml", "{name: motor_lag, tau: 0.06}")
    return [write_bag(tmp_path / ("run%d.bag" % s), seed=s, model=truth) for s in (1, 40, 90)]


def test_the_error_falls_to_the_noise(tmp_path, lagging):
    out = tmp_path / "better.yaml"
    report = json_of("add", "motor_lag", *lagging[:2], "--model", MODEL, "-o", out, "--holdout", lagging[2])
    tau = report["parameters"]["motor_lag.tau"]
    assert tau["value"] == pytest.approx(0.06, abs=0.002)
    assert report["verdict"]["helps"] is True
    floor = report["noise_floor"]
    tested = report["error"]["holdout"]
    assert "%+.0f%%" % (100 * (tested["after"] / tested["before"] - 1)) in report["verdict"]["reason"]
    for kind in ("fit", "heldout", "holdout"):
        error = report["error"][kind]
        assert error["before"] > 3 * error["after"], kind
        # The noise floor is computed from the fitted runs; it differs for others.
        assert error["after"] == pytest.approx(floor, rel=0.4 if kind == "holdout" else 0.15), kind
    # The model file names its data and can be loaded.
    from ground import _core

    model = _core.load_model(str(out))
    assert model.effects == ["motor_lag"]
    assert model.provenance.bags == ["run1.bag", "run40.bag"]
    assert model.provenance.error_after["heldout"] == error_of(report, "heldout")
    extra = ["--model", out, "-o", tmp_path / "x.yaml", "--details"]
    text = identify("add", "input_delay", *lagging, *extra).stdout
    assert "noise floor" in text and "each run by a fit to the others" in text


def test_a_model_that_is_not_better_is_named_so(tmp_path, lagging):
    out = tmp_path / "wrong.yaml"
    printed = identify("add", "wind", *lagging, "--model", MODEL, "-o", out).stdout
    saved = " ".join(printed.split()).split("Model with it:")[1].split("Next:")[0]
    assert "no - wind" in printed and "wrong.yaml (not better)" in saved


def test_help_names_the_effects():
    import ground

    for verb in ("add", "diagnose"):
        shown = " ".join(identify(verb, "--help").stdout.split())
        assert all(effect.name in shown for effect in ground.effects())


@pytest.mark.parametrize("seed", range(40))
def test_no_interval_of_a_change_goes_below_a_total_fall(seed):
    """Errors of few windows scatter: the interval must stay where an error can be, and contain the change."""
    random = np.random.default_rng(seed)
    count = random.integers(2, 12)
    before = random.lognormal(0, random.uniform(0.1, 1.5), count)
    after = random.uniform(0.001, 2) * random.lognormal(0, random.uniform(0.1, 1.5), count)
    sizes, runs = random.uniform(0.2, 1, count), random.integers(0, 3, count)
    low, high = distributions.ratio_of_means(after, before, sizes, runs)
    assert 0 <= low <= (sizes @ after) / (sizes @ before) <= high


def test_runs_that_differ_widen_the_interval_of_a_change():
    """The effect halves the error of six runs of twelve, and does nothing in the others."""
    random, runs = np.random.default_rng(4), np.repeat(np.arange(12), 20)
    before = random.lognormal(0, 0.1, len(runs))
    after = before * np.where(runs < 6, 0.5, 1.0)
    low, high = distributions.ratio_of_means(after, before, np.ones(len(runs)), runs)
    assert low < 0.65 and high > 0.85


def error_of(report, kind):
    return pytest.approx(report["error"][kind]["after"])


def test_an_absent_effect_does_not_lower_the_error(tmp_path, lagging):
    truth = with_effect(tmp_path / "lag.yaml", "{name: motor_lag, tau: 0.06}")
    out = tmp_path / "x.yaml"
    result = identify("add", "floor_tilt", *lagging, "--model", truth, "-o", out, "--json")
    report = json.loads(result.stdout)
    held = report["error"]["heldout"]
    assert held["after"] == pytest.approx(held["before"], rel=0.02)
    for name in ("sx", "sy"):
        low, high = report["parameters"]["floor_tilt." + name]["ci95"]
        assert low < 0.002 and high > -0.002
    assert report["verdict"]["helps"] is False
    said = identify("add", "floor_tilt", *lagging, "--model", truth, "-o", out, "--force")
    assert "Does it help:          no" in said.stdout and "keep the model without it" in said.stdout


def test_an_effect_that_is_not_identifiable_does_not_help(tmp_path):
    bag, effect = write_bag(tmp_path / "run.bag", duration=10), tmp_path / "nothing.yaml"
    effect.write_text(
        "{name: nothing, expression: {Y: '0*a*x'}, "
        "parameters: {a: {value: 0.1, unit: N, lower: -1, upper: 1}}}"
    )
    result = succeeds("add", effect, bag, "--model", MODEL, "-o", tmp_path / "x.yaml")
    assert "Does it help:          no" in result.stdout and "cannot be identified" in result.stdout


def test_parameters_that_are_only_known_together_help(tmp_path):
    """A long wave times a size: the motion shows their product alone."""
    moment = "{name: own, expression: {N: %s}, parameters: {c: {value: %s, unit: N m s/m}%s}}"
    truth = with_effect(tmp_path / "truth.yaml", moment % ('"c*u*v*0.17"', "2.4e-3", ""))
    bags = [write_bag(tmp_path / ("run%d.bag" % s), seed=s, model=truth, duration=8.0) for s in (1, 2)]
    k = ", k: {value: 0.17, neutral: 0.17, unit: rad s/m, lower: 0, upper: 1.4}"
    (tmp_path / "wave.yaml").write_text(moment % ('"c*sin(k*u)*v"', "0", k))
    found = json_of("add", tmp_path / "wave.yaml", *bags, "--model", MODEL, "-o", tmp_path / "better.yaml")
    assert found["verdict"]["helps"], found["verdict"]
    assert found["error"]["heldout"]["after"] < 0.5 * found["error"]["heldout"]["before"]


def test_a_heading_offset_is_found_from_zero(tmp_path):
    truth = with_effect(tmp_path / "truth.yaml", "{name: heading_offset, psi0: 2.6}")
    bag = write_bag(tmp_path / "run.bag", model=truth)
    out = tmp_path / "x.yaml"
    report = json_of("add", "heading_offset", bag, "--model", MODEL, "-o", out)
    assert report["parameters"]["heading_offset.psi0"]["value"] == pytest.approx(2.6, abs=0.01)
    held = report["error"]["heldout"]
    assert held["after"] < 0.1 * held["before"]


def test_an_expression_effect_from_a_file(tmp_path):
    washboard = (
        "{name: waves, expression: {Y: 'a*sin(6*x)'}, "
        "parameters: {a: {value: %g, unit: N, lower: -1, upper: 1}}}"
    )
    truth = with_effect(tmp_path / "truth.yaml", washboard % 0.03)
    bag = write_bag(tmp_path / "run.bag", model=truth)
    effect = tmp_path / "waves.yaml"
    effect.write_text(washboard % 0)
    out = tmp_path / "x.yaml"
    report = json_of("add", effect, bag, "--model", MODEL, "-o", out)
    assert report["effect"] == "waves"
    assert report["parameters"]["waves.a"]["value"] == pytest.approx(0.03, rel=0.05)


def test_bad_input_is_refused_with_a_reason(tmp_path, lagging):
    out = tmp_path / "x.yaml"
    bag = lagging[0]
    bad = tmp_path / "bad.yaml"
    bad.write_text("{name: waves, expression: {Y: 'a*sin('}, parameters: {a: {value: 0, unit: N}}}")
    out_of_place = tmp_path / "list.yaml"
    out_of_place.write_text("[1, 2]")
    for arguments, words in (
        (["wobble", bag, "--model", MODEL], ["wobble"]),
        ([tmp_path / "none.yaml", bag, "--model", MODEL], ["none.yaml", "cannot be read"]),
        ([out_of_place, bag, "--model", MODEL], ["list.yaml", "must be one effect"]),
        ([bad, bag, "--model", MODEL], ["bad.yaml"]),
        (["motor_lag", bag, "--model", MODEL, "--holdout", bag], ["both for the fit and as holdout"]),
        (["motor_lag", bag, "--model", MODEL, "--to", "1.4"], ["too short"]),
    ):
        result = identify("add", *arguments, "-o", out)
        assert result.returncode == 1, result.stdout
        assert len(result.stderr.strip().splitlines()) == 1, result.stderr
        for word in words:
            assert word in result.stderr, result.stderr
    assert not out.exists()
    out.write_text("mine")
    assert identify("add", "motor_lag", bag, "--model", MODEL, "-o", out).returncode == 1
    assert out.read_text() == "mine"


def test_a_true_effect_that_a_push_hides_is_not_denied():
    import ground

    craft = ground.Model.load(MODEL)
    truth = craft.with_effect("floor_tilt", sx=0.0035, sy=-0.002)
    answers = []
    for first in (0, 2, 4, 6):
        runs = [
            ground.simulate(
                truth, "multilevel-prbs", duration=20, disturbance=[0.02, 0.5], seed=s, name=str(s)
            )
            for s in (first, first + 1)
        ]
        answers.append(str(ground.add(craft, "floor_tilt", runs)))
    assert any("not clear" in answer for answer in answers)
    assert not any("keep the model without" in answer for answer in answers)
