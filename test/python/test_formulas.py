"""Experiments, comparisons, and curves of thrust, each with plain numbers."""

import numpy as np
import pytest

from conftest import MODEL, ROOT, run_data
from ground import _core
from ground.analysis import comparison


def model():
    return _core.load_model(str(MODEL))


def four():
    return _core.load_model(str(ROOT / "cfg" / "hovercraft" / "four_thrusters.yaml"))


# --- experiments


# --- comparisons


def test_no_prediction_spans_a_gap():
    run = run_data(duration=6.0, kept=np.r_[:250, 300:600])
    found = comparison.evaluate(run, model())
    rows = {row["seconds"]: len(row["errors"]) for row in found.horizons}
    assert rows[4.0] == 0  # no stretch is so long
    assert 0 < rows[1.0] < rows[0.5] < rows[0.1]


# --- curves of thrust


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
