"""Small functions of the analysis, each with plain numbers."""

import math
import re

import numpy as np
import pytest
from scipy import stats

from conftest import ROOT, run_data
from conftest import nominal as model
from ground import _core
from ground.analysis import comparison, dictionary, evidence, formula_words, missing_wrench, scalars, tracks
from ground.analysis.samples import Scales, memory
from ground.fitting import identifiability
from ground.models import Parameter


def test_p_values_are_those_of_the_mixture():
    assert evidence.p_value(5.0, 2, 0) == pytest.approx(stats.chi2.sf(5.0, 2))
    assert evidence.p_value(5.0, 1, 1) == pytest.approx(0.5 * stats.chi2.sf(5.0, 1))
    both = 0.5 * stats.chi2.sf(5.0, 1) + 0.25 * stats.chi2.sf(5.0, 2)
    assert evidence.p_value(5.0, 2, 2) == pytest.approx(both)
    one = 0.5 * stats.chi2.sf(5.0, 1) + 0.5 * stats.chi2.sf(5.0, 2)
    assert evidence.p_value(5.0, 2, 1) == pytest.approx(one)
    assert evidence.p_value(0.0, 2, 1) == 1.0 and evidence.p_value(-1.0, 2, 0) == 1.0
    # A simulated parameter that cannot be negative: its ratio is above a value as often.
    draws = np.maximum(np.random.default_rng(1).normal(size=200000), 0) ** 2
    assert evidence.p_value(2.0, 1, 1) == pytest.approx((draws >= 2.0).mean(), rel=0.03)


def pushed(force):
    """The model with a constant force X, Y [N]."""
    truth = model()
    truth.add_effect("body_force_bias")
    for name, value in zip(("x0", "y0"), force):
        truth.set_value("body_force_bias." + name, value)
    return truth


@pytest.mark.parametrize("force", [(0.006, 0.0), (-0.004, 0.003)])
def test_a_constant_force_is_inferred_everywhere(force):
    run = run_data(truth=pushed(force))
    calm = missing_wrench.undisturbed(model(), run)
    assert calm.events == [] and calm.run is run
    missing = missing_wrench.of_wrench(calm, model())
    channels = missing.numbers.channels
    for channel, true in zip("XY", force):
        one = channels[channel]
        assert one.mean == pytest.approx(true, abs=4e-4)
        assert one.rms**2 == pytest.approx(one.mean**2 + one.std**2)
        assert one.sigma == pytest.approx(np.median(missing.sigma[:, "XYN".index(channel)]))
        assert one.unit == "N"
    assert channels["N"].unit == "N m" and missing.numbers.disturbances == []
    assert np.allclose(missing.heading, np.array(run.eta)[:, 2])
    assert np.allclose(missing.position, np.array(run.eta)[:, :2])
    assert (missing.sigma > 0).all() and missing.wrench.shape == (len(run.times), 3)
    places, forces = missing.by_place()
    assert len(places) == len(forces) > 3
    assert np.hypot(*forces.T).max() < 1.2 * np.hypot(*force)
    full = 2 * model().value("k") * model().input_max
    assert [channels[c].full_scale for c in "XYN"] == pytest.approx([full, full, full * model().value("l")])


def test_no_prediction_spans_a_gap():
    run = run_data(duration=6.0, kept=np.r_[:250, 300:600])
    found = comparison.evaluate(run, model())
    rows = {row.seconds: len(row.errors) for row in found.horizons}
    assert rows[4.0] == 0  # no stretch is so long
    assert 0 < rows[1.0] < rows[0.5] < rows[0.1]


def four():
    return _core.load_model(str(ROOT / "cfg" / "hovercraft" / "four_thrusters.yaml"))


@pytest.mark.parametrize("craft", [model, four])
def test_every_symbol_of_a_formula_is_known_or_explained(craft):
    """A user reads p0 or w3_u once in a proposal, and has to find there what it is."""
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


def test_a_formula_without_outer_parentheses_is_the_same_factor():
    values = {"a": 2.0, "b": -3.0, "u": 5.0}
    texts = "(a+b) ((a+b)*u) (a*b) ((a*b)-u) (-a) (a)*(b) u (((a-b))) (a-(b+u)) (abs(a))*(u)"
    for text in texts.split():
        bare = formula_words._bare(text)
        assert eval("7*" + bare, values) == eval("7*" + text, values), (text, bare)
        assert len(bare) <= len(text)
    assert formula_words._bare("((a+b)*u)") == "(a+b)*u"


def test_a_long_wave_may_be_its_variable():
    """A product u v is also a short piece of a wave of u, times v, of which no fit tells the length."""
    wave = next(scalars._sines(scalars.Scalar("u", "m/s"), 1.0, 1, 0.5))
    feature = dictionary.Feature(dictionary.ON_BODY[2], [wave, scalars.Scalar("v", "m/s")])
    straight = [one for one in feature.simpler if one.template == {"N": "(u)*(v)"}]
    assert [one.weight_unit for one in straight] == ["N m/(m/s*m/s)"] and not straight[0].constants


def test_a_direction_in_the_room_is_in_degrees():
    parameters = {"d": (math.pi / 2, "rad", 0.0, 3.0), "c": (0.012, "N", -1.0, 1.0)}
    term = formula_words.FormulaTerm(1, {}, parameters, "a force towards {d} of {c}", {}, ())
    assert (
        formula_words.of_pieces([term], {"d": math.pi / 2, "c": 0.012}) == "a force towards 90 deg of 12 mN"
    )


def test_a_track_counts_what_is_after_its_settling():
    times = np.arange(100) / 10
    eta = np.zeros((100, 3))
    reference = np.where(times < 5, 1.0, 0.1)[:, None] * [1.0, 0.0]
    inputs = np.column_stack([times, np.where(times < 5, 1.0, 0.5), np.full(100, 0.5)])
    wanted = np.column_stack([times, np.where(times < 5, 3.0, 0.5), np.full(100, 0.5)])
    computing = np.column_stack([times, 1e-3 * (1 + np.arange(100))])
    track = tracks.Track(times, eta, reference, inputs, wanted, computing, "", 0.0)
    early, late = tracks.numbers(track), tracks.numbers(track, 5.0)
    assert late["rms"] == pytest.approx(0.1) and late["final"] == pytest.approx(0.1)
    assert early["max"] == pytest.approx(1.0) and late["max"] == pytest.approx(0.1)
    assert early["saturated_fraction"] == 0.5 and late["saturated_fraction"] == 0
    assert early["effort"] == pytest.approx((1 + 0.25 + 0.25 + 0.25) / 4)
    assert late["effort"] == pytest.approx(0.25)
    assert early["wanted_largest"] == 3 and late["wanted_largest"] == 0.5
    assert early["wanted_outside"] == 0.5 and late["wanted_outside"] == 0
    assert late["compute_ms"]["max"] == pytest.approx(100)
    assert late["compute_ms"]["median"] == pytest.approx(50.5)


def fit_of(values, deviations, correlation):
    parameters = {
        name: Parameter(name, "", value, value, (value - 2 * d, value + 2 * d), d, False, True)
        for (name, value), d in zip(values.items(), deviations)
    }
    return identifiability.WindowEstimates(None, parameters, np.array(correlation), 10.0)


def test_only_ratio_or_product_of_a_weak_pair_is_known():
    high = [[1, 0.99], [0.99, 1]]
    (weak,) = identifiability.weak_directions(fit_of({"k": 2.0, "m": 4.0}, [0.4, 0.8], high))
    assert weak["known_as"] == "k/m" and weak["parameters"] == ["k", "m"]
    assert weak["deviation"] == pytest.approx(0.2 * np.sqrt(2 * 0.01))
    assert weak["deviations"] == pytest.approx([0.2, 0.2])
    assert weak["strength"] == pytest.approx(1 / np.sqrt(0.02))
    low = [[1, -0.99], [-0.99, 1]]
    (weak,) = identifiability.weak_directions(fit_of({"k": 2.0, "m": 4.0}, [0.4, 0.8], low))
    assert weak["known_as"] == "k*m"
    draws = np.random.default_rng(1).multivariate_normal([2, 4], [[1e-4, -1.98e-4], [-1.98e-4, 4e-4]], 20000)
    product = draws.prod(axis=1)  # of a fortieth of the doubt: there, logarithms are linear
    assert product.std() / product.mean() == pytest.approx(weak["deviation"] / 40, rel=0.05)
    # A negative value turns the sense of the correlation round.
    (weak,) = identifiability.weak_directions(fit_of({"k": -2.0, "m": 4.0}, [0.4, 0.8], low))
    assert weak["known_as"] == "k/m"
    assert not identifiability.weak_directions(fit_of({"k": 2, "m": 4}, [0.4, 0.8], np.eye(2)))
    assert not identifiability.weak_directions(fit_of({"k": 2, "m": 4}, [0.02, 0.04], high))
