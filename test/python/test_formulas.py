"""Experiments, comparisons, and curves of thrust, each with plain numbers."""

import numpy as np
import pytest

from conftest import MODEL, ROOT, run_data
from ground import _core
from ground.analysis import comparison
from ground.fitting import thrust_bench, thrust_curve
from ground.simulation.designs import designs


def model():
    return _core.load_model(str(MODEL))


def four():
    return _core.load_model(str(ROOT / "cfg" / "hovercraft" / "four_thrusters.yaml"))


# --- experiments


def test_a_design_plays_the_levels_that_it_names():
    for design in designs():
        rows = design.rows(8.0)
        assert rows[0, 0] == 0 and rows[-1, 0] <= 8.0 and (np.diff(rows[:, 0]) >= 0).all()
        assert 0 <= rows[:, 1:].min() < rows[:, 1:].max() <= 1 and design.lift in (1.0, 0.6)
        if "levels" in design.options:
            assert set(np.unique(rows[:, 1:])) <= {0.0, *design.options["levels"]}


# --- comparisons


def test_no_prediction_spans_a_gap():
    run = run_data(duration=6.0, kept=np.r_[:250, 300:600])
    found = comparison.evaluate(run, model())
    rows = {row["seconds"]: len(row["errors"]) for row in found.horizons}
    assert rows[4.0] == 0  # no stretch is so long
    assert 0 < rows[1.0] < rows[0.5] < rows[0.1]


# --- curves of thrust

INPUTS = np.repeat(np.linspace(0.05, 1, 20), 2)
WORKING = np.tile([1.0, 2.0], 20)


@pytest.mark.parametrize(
    "fit,force",
    [
        (thrust_curve.linear, lambda w: 0.3 * w),
        (thrust_curve.power, lambda w: 0.3 * w**1.7),
        (thrust_curve.power, lambda w: 0.3 * w**0.5),
        (thrust_curve.polynomial(1), lambda w: 0.4 * np.maximum(0, w - 0.21)),
        (thrust_curve.polynomial(2), lambda w: 0.1 * w + 0.3 * w**2),
        (thrust_curve.polynomial(3), lambda w: 0.3 * w - 0.2 * w**2 + 0.2 * w**3),
    ],
)
def test_a_curve_that_is_measured_exactly_is_found(fit, force):
    found = fit(INPUTS, WORKING, WORKING * force(INPUTS))
    assert np.allclose(found.force(INPUTS), force(INPUTS), atol=1e-6)
    assert found.largest == 1.0 and found.full == pytest.approx(force(np.array([1.0]))[0], abs=1e-6)
    scaled = fit(INPUTS, WORKING, 5 * WORKING * force(INPUTS))
    assert np.allclose(scaled.force(INPUTS), 5 * force(INPUTS), atol=1e-5)


def bench(gains, force, noise=0.0, levels=11, repeat=2, seed=1):
    random = np.random.default_rng(seed)
    rows = []
    for w in np.linspace(0.1, 1, levels):
        for number in range(repeat):
            for j, gain in enumerate(gains):
                at = np.eye(len(gains))[j]
                rows.append((w, at, number, gain * force(w) * (1 + noise * random.normal())))
    inputs, together, repetition, forces = (np.array(column) for column in zip(*rows))
    return thrust_bench.Bench(inputs, together, repetition, forces)


def test_gains_of_thrusters_have_the_mean_1():
    names = ["a", "b", "c"]
    found = thrust_bench.fit(bench([1.1, 1.0, 0.9], lambda w: 0.2 * w, 0.002), names)
    assert found.gains == pytest.approx([1.1, 1.0, 0.9], abs=0.005)
    assert found.gains.mean() == pytest.approx(1) and found.p_value < 1e-6
    assert found.values["k"] == pytest.approx(0.2, rel=0.005) and set(found.values) == {"k", "a", "b", "c"}
    same = thrust_bench.fit(bench([1.0, 1.0, 1.0], lambda w: 0.2 * w, 0.02), names)
    assert (same.gains == 1).all() and same.p_value > 0.01 and set(same.values) == {"k"}
    one = thrust_bench.fit(bench([1.0], lambda w: 0.2 * w, 0.02), names[:1])
    assert one.p_value is None
    for name, (low, high) in found.intervals.items():
        assert low < found.values[name] < high and high - low < 0.02


# --- formulas of what has no name


@pytest.mark.parametrize("craft", [model, four])
def test_every_symbol_of_a_formula_is_known_or_explained(craft):
    """A user reads p0 or w3_u once in a proposal, and has to find there what it is."""
    import re

    from ground.analysis import dictionary, formula_words
    from ground.analysis.samples import Scales, memory

    plain = {"u", "v", "r", "x", "y", "psi", "t", "lift", "command", "pi"}
    functions = {"sin", "cos", "tanh", "exp", "sqrt", "abs", "sign", "mN", "N", "per", "m", "s", "rad"}
    scales = Scales((0.1, 0.2), 1.0, 0.5, 3.0, 10.0, 1.0)
    states, explained = memory(craft(), 1.0), 0
    for feature in dictionary.dictionary(craft(), scales):
        own = {name: name + "_1" for name in feature.constants}
        own_states = states.of(str(feature.template))
        text = formula_words.of_feature(feature, "c1", own, own_states)
        text = re.sub(r"\{\w+\}|<\w+>", "1", text)
        told = set(re.findall(r"(?:where|and) (\w+) is the", text))
        formulas = re.findall(r"times (\S+),|\(= 1 (.*?)(?:, where|\)$)", text)
        for word in re.findall(r"(?<![\w.])[A-Za-z]\w*", " ".join(map(" ".join, formulas))):
            assert word in plain | functions | told or word.startswith("u_"), (word, text)
        explained += len(told)
    assert explained > 20
