"""Choices of a diagnosis beside the numbers at which they turn, with likelihoods that are given."""
import contextlib
import dataclasses
import types

import numpy as np
import pytest
from conftest import ROOT
from scipy import optimize
from test_sets_of_effects import NAMES, searched, size, threshold
from test_statistics import Expected, model, random_scores, scores_of

from ground import _core
from ground.analysis import (
    candidates,
    conclusion,
    failure,
    identifiability,
    look_alikes,
    memory,
    next_experiment,
    own_stop,
    stages,
    thinning,
    trials,
)
from ground.analysis.criteria import Criteria
from ground.analysis.distributions import chi_squared_above, chi_squared_limit
from ground.errors import GroundError
from ground.simulation import experiments

EMPTY = frozenset()
MANY = [
    name
    for name, effect in candidates.effects().items()
    if not effect["opt_in"] and size(name) == 1 and name + ".psi0" not in candidates.STARTS
][:8]  # eight effects that have one parameter


def singles(proposals):
    return [proposal for proposal in proposals if len(proposal) == 1]


# --- which sets are refitted


def test_the_four_most_promising_effects_are_refitted(monkeypatch):
    gains = {name: 50.0 - i for i, name in enumerate(MANY)}
    found, _ = searched(monkeypatch, gains)
    found.nominal()
    assert singles(found._proposals(EMPTY)) == [(name,) for name in MANY[:4]]
    del gains[MANY[1]], gains[MANY[3]], gains[MANY[4]], gains[MANY[5]], gains[MANY[6]]
    few, _ = searched(monkeypatch, gains)
    few.nominal()
    assert singles(few._proposals(EMPTY)) == [(MANY[0],), (MANY[2],), (MANY[7],)]


def test_a_refit_needs_a_gain_of_three_for_each_parameter(monkeypatch):
    several = next(n for n in NAMES if size(n) > 1)
    for name in (MANY[0], several):
        for gain, proposed in ((3.1, True), (2.9, False)):
            found, _ = searched(monkeypatch, {name: gain * size(name)})
            found.nominal()
            assert found._proposals(EMPTY) == [(name,)] * proposed


def test_the_two_best_pairs_that_gain_together_are_refitted(monkeypatch):
    pairs = {(MANY[2 * i], MANY[2 * i + 1]): 100.0 - i for i in range(4)}
    found, _ = searched(monkeypatch, dict.fromkeys(MANY, 0.0), pairs)
    found.nominal()
    assert found._proposals(EMPTY) == list(pairs)[:2]
    # A pair has to gain half of a threshold more than its better effect, each parameter costs one.
    name, other = MANY[:2]
    needed = threshold(name, 2) / 2
    for better in (name, other):
        alone = {name: 0.0, other: 0.0, better: 30.0}
        for more, proposed in ((needed + 1.1, True), (needed + 0.9, False)):
            found, _ = searched(monkeypatch, alone, {(name, other): more})
            found.nominal()
            assert ((name, other) in found._proposals(EMPTY)) == proposed
            assert ((better,) in found._proposals(EMPTY))


def test_a_pair_gains_more_than_the_best_effect_alone(monkeypatch):
    pair = MANY[2], MANY[3]
    for together, proposed in ((31.5, True), (30.5, False)):  # each parameter of both costs one
        gains = {MANY[0]: 30.0, MANY[1]: 5.0, MANY[2]: 0.0, MANY[3]: 0.0}
        found, _ = searched(monkeypatch, gains, {pair: together})
        found.nominal()
        assert (pair in found._proposals(EMPTY)) == proposed


def test_what_may_be_the_best_gains_three_tenths_of_the_largest(monkeypatch):
    first, rest = MANY[0], MANY[1:4]
    gains = dict(zip([first, *rest], (300.0, 100.0, 30.1, 29.9)))
    found, _ = searched(monkeypatch, gains)
    found.run()
    proposals = [(n,) for n in rest]
    assert found._promising_first(frozenset([first]), proposals) == [proposals[:2], proposals[2:]]


def test_effects_are_tested_for_removal_below_ten_thresholds(monkeypatch):
    found, likelihoods = searched(monkeypatch, {MANY[0]: 0.0, MANY[1]: 0.0})
    limit = threshold(MANY[0], 2)
    for times, may in ((9.9, True), (10.1, False)):
        likelihoods.gains[MANY[0]] = times * limit
        assert found.may_go(likelihoods.fit_of([MANY[0]]), MANY[0]) == may


def test_rivals_gain_at_least_four_tenths_and_there_are_three(monkeypatch):
    current = frozenset(MANY[:1])
    for gains, tried in (
        ((100.0, 90.0, 80.0, 70.0, 60.0), 3),
        ((100.0, 90.0, 40.1, 39.9), 2),
        ((5.0, 3.1, 2.9), 1),
    ):
        pairs = {}
        found, likelihoods = searched(monkeypatch, dict(zip(MANY, gains)), pairs)
        found.nominal()
        found.fits[current] = likelihoods.fit_of(current)
        assert found.swaps(current, MANY[0]) == [frozenset([n]) for n in MANY[1 : 1 + tried]]


def test_a_rival_is_excluded_by_a_ratio_of_seven(monkeypatch):
    for behind, names in ((6.9, MANY[1:2]), (7.1, [])):
        found, likelihoods = searched(monkeypatch, {MANY[0]: 100.0, MANY[1]: 100.0 - behind})
        found.nominal()
        current = frozenset(MANY[:1])
        found.fits[current] = likelihoods.fit_of(current)
        assert found.rivals(current, MANY[0]) == names


def test_the_level_of_a_search_is_a_hundredth():
    usual = Criteria()
    assert chi_squared_limit(usual.level, 1) == pytest.approx(6.635, abs=1e-3)
    assert chi_squared_above(usual.exclusion, 1) < 0.0085  # 2.6 standard deviations
    assert all(0 < part <= 1 for part in usual.steps) and max(usual.steps) == 1.0
    assert list(usual.steps) == sorted(usual.steps, reverse=True)
    assert max(abs(part) for part in usual.sizes) == 0.5 and min(usual.sizes) < 0 < max(usual.sizes)
    assert usual.max_far_error < 1


def test_effects_to_come_are_those_above_their_thresholds(monkeypatch):
    first, second = MANY[:2]
    limit = threshold(first, 2)
    for off, count in (((0.5, 0.5), 2), ((0.5, -0.5), 1), ((-0.5, -0.5), 0)):
        gains = {first: limit + off[0], second: limit + off[1]}
        found, _ = searched(monkeypatch, gains)
        found.nominal()
        assert found._coming(EMPTY) == count


# --- score tests


def test_score_tests_do_not_depend_on_the_units_of_parameters():
    A, blocks, scale = random_scores()
    plain = scores_of(A, blocks, scale)
    for factor in (1e-6, 1e3):
        unit = np.full(5, factor)
        other = scores_of(A / unit / unit[:, None], blocks / unit, scale / unit)
        for name in "ab":
            assert other.seen(name) == pytest.approx(plain.seen(name))
            assert other.hidden(name) == plain.hidden(name)
            assert other.test([name])[0] == pytest.approx(plain.test([name])[0])
            assert other.test([name])[1] == pytest.approx(plain.test([name])[1])
        extended = candidates.of_library("body_force_bias").neutral(model())
        described = candidates.parameters_of(extended, "body_force_bias")
        for tests in (plain, other):
            tests.names = ["a.p"] + [p["name"] for p in described]
            tests.columns = {"a": [0], "body_force_bias": [1, 2]}
        one, two = (t.estimates(extended, "body_force_bias", {}) for t in (plain, other))
        assert [p["deviation"] for p in two] == pytest.approx([p["deviation"] for p in one])
        assert all(p["identified"] for p in one + two)
        plain = scores_of(A, blocks, scale)


# --- look-alikes


class Similar:
    """What look_alike needs of a Search: fits whose log-posterior is that of a size."""

    def __init__(self, log_posterior, fails=()):
        self.base = types.SimpleNamespace(model=model(), free=("k", "X_u"), log_posterior=10.0)
        self.fits, self.tried = {EMPTY: self.base}, []
        self.candidates = {"yaw_bias": candidates.of_library("yaw_bias")}
        self.likelihood, self.of, self.fails = self, log_posterior, fails

    def test_beside(self, chosen):
        return types.SimpleNamespace(
            columns=["yaw_bias", "seen", "known", "unseen"],
            seen={"yaw_bias": 0.0029, "seen": 0.0031, "known": 0.0, "unseen": 0.0}.get,
            in_place=lambda name, part: {"yaw_bias.n0": 1e-4 * part, "k": -0.02 * part},
        )

    def fit(self, given, free, near, levels=True):
        assert near is self.base and not levels
        part = given.value("yaw_bias.n0") / 1e-4
        assert given.value("k") == pytest.approx(self.base.model.value("k") - 0.02 * part)
        self.tried.append(round(part, 3))
        if self.tried[-1] in self.fails:
            raise GroundError("diverges")
        return types.SimpleNamespace(model=given, log_posterior=self.of(part))


def test_effects_that_leave_less_than_three_thousandths_are_unseen():
    assert look_alikes.names(Similar(None), EMPTY, ["known"]) == ["yaw_bias", "unseen"]


def test_a_look_alike_loses_less_than_a_tenth():
    for loss, found in ((0.09, True), (0.11, False)):
        search = Similar(lambda part, loss=loss: 10.0 - loss)
        alike = look_alikes.look_alike(search, EMPTY, "yaw_bias")
        assert (alike is not None) == found
    # Sizes of both signs are tried, the largest first, down to a tenth.
    tried = search.tried
    assert tried[0] == 1.0 and tried == sorted(tried[:4], reverse=True) + [-t for t in tried[:4]]
    assert min(tried[:4]) == 0.1 and len(set(tried)) == 8


def test_a_look_alike_is_the_largest_that_can_be_fitted():
    search = Similar(lambda part: 10.0 - 10 * max(0.0, part), fails=(1.0, -1.0))
    found = look_alikes.look_alike(search, EMPTY, "yaw_bias")
    assert search.tried[-1] == -0.5 and found.fit.model.value("yaw_bias.n0") == pytest.approx(-0.5e-4)
    assert found.name == "yaw_bias" and found.moved == ("k",)
    assert look_alikes.look_alike(Similar(lambda part: 0.0, (1.0,)), EMPTY, "yaw_bias") is None


def test_a_parameter_has_moved_by_a_twentieth_of_the_larger_value():
    craft = model()
    fit = types.SimpleNamespace(model=craft, free=("k",))
    for factor, moved in ((1.0525, ()), (1.0528, ("k",)), (0.9501, ()), (0.9499, ("k",)), (1.0, ())):
        other = craft.copy()
        other.set_value("k", factor * craft.value("k"))
        assert look_alikes._moved(fit, other) == moved, factor


# --- memory


class Remembering:
    """What memory.find needs of a likelihood: fits of given log-posteriors."""

    def __init__(self, log_posteriors):
        self.left, self.asked = list(log_posteriors), []

    def fit(self, start, free, near=None):
        self.asked.append((start, free))
        found = self.left.pop(0)
        if found is None:
            raise GroundError("diverges")
        return types.SimpleNamespace(model=start, free=free, log_posterior=found)


def remembered(monkeypatch, gains, *log_posteriors):
    """memory.find with score tests of these gains (else 0)."""

    def in_parts(likelihood, fit, tried):
        names = [c.name for c in tried]
        for part in (names[:3], names[3:]):
            yield types.SimpleNamespace(
                columns=part, test=lambda one: (gains.get(one[0], 0.0), {one[0] + ".c": 0.007})
            )

    monkeypatch.setattr(memory.score_tests, "in_parts", in_parts)
    likelihood = Remembering(log_posteriors)
    fit = types.SimpleNamespace(model=model(), free=("k",), log_posterior=100.0)
    return memory.find(likelihood, fit), likelihood


def test_memory_needs_a_ratio_of_twenty_before_and_after_the_refit(monkeypatch):
    name = "spin_up_20_60"
    for gain, after, found in (
        (20.5, 110.1, True), (19.5, 200.0, False), (40.0, 109.9, False), (40.0, 110.1, True),
    ):  # fmt: skip
        one, likelihood = remembered(monkeypatch, {name: gain, "wake_300": 12.0}, 105.0, after)
        assert (one is not None) == found
    assert one.kind.name == "spin_up" and one.fit.log_posterior == 110.1
    count = sum(len(kind.tried) for kind in memory.kinds_of(model()))
    assert one.p_value == pytest.approx(count * chi_squared_above(40.0, 1))
    assert count * chi_squared_above(memory.MIN_RATIO, 1) < 1.5e-4
    (start, free), (again, constants) = likelihood.asked
    assert start.value("spin_up.c") == 0.007
    assert (start.value("spin_up.rise"), start.value("spin_up.fall")) == (0.02, 0.06)
    assert free == ("k", "spin_up.c") and constants == free + ("spin_up.rise", "spin_up.fall")
    assert remembered(monkeypatch, {name: 40.0}, None)[0] is None
    assert remembered(monkeypatch, {name: 40.0}, 105.0, None)[0] is None


def test_kinds_that_a_model_has_are_not_tried_again(monkeypatch):
    craft = model()
    kind = {kind.name: kind for kind in memory.kinds_of(craft)}["wake"]
    has = candidates.from_entry(kind.entry((0.3,)), "wake", craft).neutral(craft)
    tried = []
    monkeypatch.setattr(
        memory.score_tests, "in_parts", lambda likelihood, fit, some: tried.extend(some) or iter(())
    )
    with contextlib.suppress(ValueError):  # there is no best of no candidates
        memory.find(None, types.SimpleNamespace(model=has, free=()))
    assert tried and not any("wake" in candidate.name for candidate in tried)


def test_kinds_of_memory_can_be_fitted_from_what_is_tried():
    """A typical one is a sixth of a thruster's force, and may grow or fall; what is tried is far from the
    limits, and motors may be as quick as half a step of 10 ms."""
    full = model().value("k")
    for kind in memory.kinds_of(model()):
        assert 0.1 * full < kind.scale < 0.3 * full, kind.name
        for values in kind.tried:
            parameters = kind.entry(values)["parameters"]
            size = parameters.pop("c")
            assert size["lower"] == -size["upper"] and size["upper"] > 1e3 * size["scale"]
            assert size["scale"] == kind.scale and size["value"] == size["neutral"] == 0
            assert list(parameters) == [constant.name for constant in kind.constants]
            for one, value in zip(parameters.values(), values):
                assert 3 * one["lower"] < value < one["upper"] / 3
        assert len(set(kind.tried)) == len(kind.tried) > 0
        for constant in kind.constants:
            assert constant.lower <= 0.02, kind.name
            if constant.name in ("rise", "fall"):
                assert constant.lower == 0.005


def test_tried_lags_leave_no_holes():
    """Lags of the thrust up to 0.3 s are within 50 ms of a tried one."""
    lags = np.array(failure.COMMAND_LAGS)
    assert (lags[0], lags[-1]) == (0.0, 0.3) and (np.diff(lags) > 0).all() and np.diff(lags).max() < 0.101
    assert len(set(np.round(np.diff(lags), 6))) > 1  # short ones are closer


def test_play_is_taken_up_within_a_step_and_kept(monkeypatch):
    """The output of a play follows its input at a distance of half its width, and stays while the input
    turns within it."""
    kind = {kind.name: kind for kind in memory.kinds_of(model())}["thrust_backlash"]
    half = 0.1
    craft = kind.at((half,), model()).neutral(model())
    craft.set_value(craft.effects[-1] + ".c", model().value("k"))
    plain = model()
    rows = np.array([[0.0, 0.5, 0.5, 1], [1.0, 0.8, 0.8, 1], [2.0, 0.7, 0.7, 1], [3.0, 0.5, 0.5, 1]])
    times = np.arange(400) / 100
    driven = []
    for one in (craft, plain):
        u = np.array(_core.simulate(one, rows, times, np.zeros(3), np.zeros(3))["nu"])[:, 0]
        force = plain.value("m") * np.gradient(u, times) + plain.value("X_u") * u
        driven.append(force / (2 * plain.value("k")))
    at = np.searchsorted(times, [0.5, 1.5, 2.5, 3.5])
    assert driven[1][at] == pytest.approx([0.5, 0.8, 0.7, 0.5], abs=2e-3)
    assert driven[0][at] == pytest.approx([0.4, 0.7, 0.7, 0.6], abs=4e-3)


# --- conclusions


def test_parts_of_the_data_may_prefer_a_rival_that_is_not_far_behind(monkeypatch):
    """By a log-likelihood ratio of 35, five times the one that excludes a rival."""
    gains = dict(zip(MANY, (200.0, 200.0 - 34, 200.0 - 36)))
    search, likelihoods = searched(monkeypatch, gains)
    search.nominal()
    names = frozenset(MANY[:1])
    search.fits[names] = likelihoods.fit_of(names)
    asked = []

    def nested(choice, each):
        asked.append((choice, each))
        return np.array([1.0, 2.0, 3.0])

    found = types.SimpleNamespace(
        search=search, chosen=["effect"], names=names, fit="grown", inside="inside",
        each_of_many="many", folds=types.SimpleNamespace(nested=nested),
    )  # fmt: skip
    assert conclusion._nested(found) == 6.0
    ((choice, each),) = asked
    assert choice.swapped == {MANY[0]: [MANY[1]]} and (choice.each, each) == ("inside", "many")
    assert choice.fitting.known == search.fits and choice.found == "grown"
    assert choice.nominal is search.fits[EMPTY]


def test_a_choice_begins_with_what_was_found_for_all_runs(monkeypatch):
    """Without the loudness of each run, because the runs are others."""
    @dataclasses.dataclass
    class Found:
        name: str
        loudness: tuple = (1.0, 2.0)

    @dataclasses.dataclass
    class Fitting:
        likelihood: object = "of all"

    asked = []

    class Search:
        def __init__(self, fitting, each, swapped):
            asked.append((fitting.likelihood, each, swapped))
            self.fits = {frozenset("a"): "the fit"}

        def nominal(self, near):
            asked.append(near)

        def run(self, near):
            asked.append(near)
            return frozenset("a")

    monkeypatch.setattr(conclusion, "Search", Search)
    choice = conclusion._Choice(Fitting(), Found("grown"), Found("nominal"), {"a": ["b"]}, map)
    assert choice("of a part") == "the fit"
    assert asked == [("of a part", map, {"a": ["b"]}), Found("nominal", ()), Found("grown", ())]


@pytest.mark.parametrize("error,explained", [(11.49, True), (11.51, False)])
def test_a_model_explains_errors_up_to_a_seventh_above_the_noise(monkeypatch, error, explained):
    """The floor is the mean of five simulations."""
    floors = {"run": [8.0, 9.0, 10.0, 11.0, 12.0], "held": [7.0]}
    asked = []

    def floor(runs, craft, seed=0):
        asked.append(seed)
        return np.array([floors[runs][seed], 0, 0])

    monkeypatch.setattr(conclusion.study, "noise_floor", floor)
    agrees = types.SimpleNamespace(holds=True)
    monkeypatch.setattr(conclusion, "agreement", lambda *of: agrees)
    monkeypatch.setattr(conclusion, "second_opinion", lambda runs, craft: "opinion")
    monkeypatch.setattr(conclusion, "_varies", lambda found: [])
    monkeypatch.setattr(conclusion, "_steps", lambda found, heldout: [])
    monkeypatch.setattr(conclusion.baseline, "refits", lambda found, heldout: ())
    monkeypatch.setattr(conclusion.judgement, "judgements", lambda found, heldout: {})
    said = []
    monkeypatch.setattr(conclusion, "_verdict", lambda *of: said.append(of[1:]) or "said")
    found = types.SimpleNamespace(
        pool=types.SimpleNamespace(map=map), runs="run", fit=None, memory=None,
        best=types.SimpleNamespace(error=np.array([error, 0, 0]), model=None),
        likelihood=types.SimpleNamespace(intervals=lambda fit: []), ceiling_of=lambda: "left",
        cut=None, model=None, work=types.SimpleNamespace(stage=lambda what: contextlib.nullcontext()),
    )  # fmt: skip
    done = conclusion.conclude(found)
    assert said == [(explained, [], "left", agrees, "opinion")] and done.verdict == "said"
    assert sorted(asked) == [0, 1, 2, 3, 4] and done.noise_floor == done.heldout_floor == 10.0
    assert conclusion.conclude(found, (), True).verdict == "misread"
    monkeypatch.setattr(conclusion.study, "noise_floor", lambda runs, craft, seed=0: np.array([
        floors[runs][seed if runs == "run" else 0], 0, 0]))  # fmt: skip
    assert conclusion.conclude(found, "held").heldout_floor == 7.0


# --- weights of trials


def test_weights_are_likelihoods_that_sum_to_one():
    made = [
        trials.trial(name, candidates.of_library(name).add(model()), [], gain, True, True, 8, 500)
        for name, gain in zip(MANY, (30.0, 26.0, 10.0))
    ]
    values = {made[0].name: 30.0, made[1].name: 26.0}
    found = {t.name: t for t in trials.ranked(made, [made[0].name], values)}
    assert found[made[0].name].inclusion == pytest.approx(1 / (1 + np.exp(-2)))
    assert found[made[1].name].inclusion == pytest.approx(np.exp(-2) / (1 + np.exp(-2)))
    assert found[made[2].name].inclusion == 0 and [t.equal for t in found.values()] == [True, False, False]
    worse = {name: value - 1e4 for name, value in values.items()}
    again = {t.name: t for t in trials.ranked(made, [], worse)}
    assert again[made[0].name].inclusion == pytest.approx(found[made[0].name].inclusion)
    for one, gain in zip(made, (30.0, 26.0, 10.0)):
        assert one.chance == pytest.approx(min(1.0, 8 * one.p_value))
        assert one.delta_bic == pytest.approx(np.log(500) - gain)


# --- thinning


def thin(rate, count=400, noise=1.0):
    times = np.arange(count) / rate
    poses = np.random.default_rng(1).normal(size=(count, 3))
    run = _core.RunData("r", times, poses, 2 * poses, np.array([[0.0, 0, 0, 1]]), poses, np.ones(3))
    return run, thinning.thinned(run)


@pytest.mark.parametrize(
    "rate,count", [(50, 1), (99, 1), (98.1, 1), (99.9, 2), (100, 2), (120, 2), (149, 3), (200, 4), (240, 4)]
)
def test_thinned_recordings_have_fifty_poses_a_second(rate, count):
    run, found = thin(rate)
    counts = int(1.02 * rate / 50)
    assert len(found.times) == int(np.ceil(400 / counts))
    if counts == 1:
        assert found is run
    else:
        assert np.allclose(np.array(found.noise), 1 / np.sqrt(counts))
        whole = 400 // counts * counts
        for name in ("eta", "nu", "poses"):
            plain = np.array(getattr(run, name))[:whole].reshape(-1, counts, 3).mean(axis=1)
            assert np.allclose(np.array(getattr(found, name))[: len(plain)], plain)


def test_means_do_not_span_pauses():
    for pause, apart in ((1.4, False), (1.6, True)):
        times = np.arange(40) / 100
        times[21:] += (pause - 1) / 100
        groups = thinning._groups(times, 0.01, 2)
        assert (21 in groups) == apart and (20 in groups)


# --- parameters that are known together only


def covariance(a, b, correlation, values=(2.0, 3.0), identified=(True, True)):
    parameters = [
        dict(name=n, value=v, deviation=abs(v) * d, identified=i, at_bound=False)
        for n, v, d, i in zip("ab", values, (a, b), identified)
    ]
    return {"parameters": parameters, "correlation": np.array([[1, correlation], [correlation, 1]])}


def test_pairs_are_named_that_are_known_better_together():
    (weak,) = identifiability.weak_directions(covariance(0.1, 0.1, 0.95))
    assert weak["known_as"] == "a/b" and weak["parameters"] == ["a", "b"]
    known = np.sqrt(0.1**2 + 0.1**2 - 2 * 0.95 * 0.01)
    assert weak["deviation"] == pytest.approx(known) and weak["deviations"] == pytest.approx([0.1, 0.1])
    assert weak["strength"] == pytest.approx(0.1 / known)
    for values, sign in (((2.0, -3.0), -1), ((-2.0, -3.0), 1)):
        (weak,) = identifiability.weak_directions(covariance(0.1, 0.1, sign * 0.95, values))
        assert weak["known_as"] == "a/b"
    (weak,) = identifiability.weak_directions(covariance(0.1, 0.1, -0.95))
    assert weak["known_as"] == "a + b"
    assert identifiability.weak_directions(covariance(0.1, 0.1, 0.95, identified=(True, False))) == []
    assert identifiability.weak_directions(covariance(0.1, np.inf, 0.95)) == []


def test_well_known_parameters_and_weak_combinations_are_not_named():
    for better, named in ((0.029, False), (0.031, True)):
        assert bool(identifiability.weak_directions(covariance(better, better, 0.99))) == named
    # known together to half of the better one: 2 (1 - r) = 1/4
    for correlation, named in ((0.874, False), (0.876, True)):
        assert bool(identifiability.weak_directions(covariance(0.1, 0.1, correlation))) == named


def test_weak_parameters_are_told_with_their_deviations():
    fit = covariance(0.1, 0.2, 0.97)
    fit["parameters"][1]["at_bound"] = True
    fit["parameters"] += [dict(name="c", value=1.0, deviation=0.5, identified=False, at_bound=True)]
    fit["correlation"] = np.pad(fit["correlation"], (0, 1))
    fit["parameters"][1]["deviation"] = 3.0 * 0.1
    known = 100 * np.sqrt(2 * 0.01 * (1 - 0.97))
    assert list(identifiability.sentences(fit)) == [
        "b is at its bound; the data prefer a value beyond it",
        "a and b are only known as a/b: this to ±%.2g%%, a to ±10%% and b to ±10%% (one standard deviation); "
        "fix one of them, or record inputs that distinguish them" % known,
    ]
    for a, b, said in ((0.099, 0.1, "a to ±9.9% and b to ±10%"), (0.1, 0.099, "a to ±10% and b to ±9.9%")):
        (sentence,) = identifiability.sentences(covariance(a, b, 0.97))
        assert said + " (one" in sentence


def test_of_two_parameters_the_better_one_decides():
    """A combination is told only if it is known better than either."""
    assert identifiability.weak_directions(covariance(0.02, 0.031, 0.99)) == []
    assert identifiability.weak_directions(covariance(0.04, 0.06, 0.95)) == []
    assert identifiability.weak_directions(covariance(0.04, 0.041, 0.95)) != []


def test_a_plan_is_at_most_until_the_effects_are_known(monkeypatch):
    class Certain(Expected):
        def __init__(self):
            super().__init__()
            self.at_most, self.work, self.grew, self.said = {}, self, [], []

        def expect(self, what, units, seconds=0.0, at_most=False, scaled=True):
            super().expect(what, units)
            self.at_most[what] = at_most

        def more(self, count, at_most=False):
            super().more(count)
            self.grew.append(at_most)

        def note(self, text):
            self.said.append(text)

        def step(self, units=1):
            pass

    told = Certain()
    plan = stages.Plan(told)
    plan.begin()
    certain = {stages.FITTING, stages.LEAVING, stages.ERRORS}
    assert {what for what, most in told.at_most.items() if not most} == certain
    assert told.units[stages.REMEMBERING] == 1 and told.units[stages.SEARCHING] == 21
    assert told.units[stages.TESTING] == 4 and told.units[stages.ORDERING] == 2
    gains = {MANY[0]: 300.0, MANY[1]: 200.0, MANY[2]: 1.0, MANY[3]: 0.0}
    found, _ = searched(monkeypatch, gains, plan=plan)
    assert found.run() == frozenset(MANY[:2])
    assert told.said[-1] == "with " + ", ".join(sorted(MANY[:2]))
    assert found._coming(EMPTY) == 2 and found._coming(frozenset(MANY[:1])) == 1
    assert told.units[stages.ORDERING] == 2 and all(
        most for what, most in told.at_most.items() if what not in certain
    )
    # Sets to refit in the first round, as many for each effect to come, and three for two effects' swaps.
    assert told.added >= 3 * 2 + 3 + 1 and all(told.grew)
    plan.found(2)
    assert not any(told.at_most[w] for w in (stages.TESTING, stages.ORDERING, stages.REPEATING))


def test_stages_of_a_longer_recording_take_longer():
    plans = {}
    for samples in (7000, 21000):
        told = Expected()
        plan = stages.Plan(told, samples)
        plan.begin()
        plan.round(5, 1, 2)
        plans[samples] = told
    short, long = plans.values()
    assert short.units == long.units
    for what, seconds in short.seconds.items():
        assert long.seconds[what] == pytest.approx(3 * seconds) and seconds > 0
    # A repetition searches all parts once more: rounds for each effect and one without any.
    rounds = short.seconds[stages.REPEATING] / short.seconds[stages.SEARCHING]
    assert rounds == pytest.approx(short.units[stages.SEARCHING] / 3 * (3 + 1))
    assert short.units[stages.REPEATING] == 1
    none = Expected()
    stages.Plan(none).found(0)
    assert none.units[stages.REPEATING] == 1 and none.seconds[stages.REPEATING] == 0


# --- experiments, and a craft that stops


def test_a_run_of_an_experiment_has_the_inputs_of_its_craft():
    craft = _core.load_model(str(ROOT / "cfg" / "hovercraft" / "mvwt.yaml"))
    assert craft.input_max == 4.5
    schedule = next(next_experiment.choices()).schedule()
    run = next_experiment._run(craft, schedule, np.full(3, 1e-4))
    assert np.array_equal(np.array(run.inputs)[:, 1:3], 4.5 * schedule.rows[:, 1:3])
    assert np.array_equal(np.array(run.inputs)[:, [0, 3]], schedule.rows[:, [0, 3]])


def test_an_experiment_in_a_room_is_the_same_each_time():
    experiment = next(next_experiment.choices())
    first, again = (experiment.schedule_in(_core.RoomPlan(), model()) for _ in range(2))
    assert np.array_equal(first.rows, again.rows) and first.end == again.end
    assert next_experiment.schedule_of(experiment.arguments(), model()).end == first.end
    assert first.rows[:, 1:3].min() >= 0 and first.rows[:, 1:3].max() <= 1
    lifted = first.rows[first.rows[:, 3] > 0, 0]
    assert 16 <= np.ptp(lifted) < 18  # with the braking at its end


def test_an_experiment_in_a_room_is_that_of_the_excitation(monkeypatch):
    """It lasts until the last frame."""
    asked = []

    def excite(craft, truth, params, eta, nu, mocap, seed):
        asked.append((craft, truth, params, [*eta, *nu]))
        return {"commands": np.zeros((4, 4)), "frames": np.array([[0.0, 1], [0.5, 1], [2.25, 1]])}

    monkeypatch.setattr(next_experiment._core, "excite", excite)
    place, craft = _core.RoomPlan(), model()
    for experiment in list(next_experiment.choices())[::5]:
        schedule = experiment.schedule_in(place, craft)
        assert schedule.end == 2.25 and np.array_equal(schedule.rows, np.zeros((4, 4)))
        one, truth, params, still = asked.pop()
        assert one is truth is craft and still == [0] * 6
        assert params.duration == 16.0 and params.life.lift == experiment.lift
        assert (params.start, params.tail) == (experiments.LEAD, experiments.TAIL)
        assert np.array_equal(params.room.corners, place.corners)

    def fails(*_):
        raise RuntimeError("the motion is not finite")

    monkeypatch.setattr(next_experiment._core, "excite", fails)
    with pytest.raises(GroundError, match="^the motion is not finite$"):
        experiment.schedule_in(place, craft)


def test_an_experiment_needs_a_motion_that_stays_finite():
    schedule, noise = next(next_experiment.choices()).schedule(), np.full(3, 1e-4)
    unstable = model()
    unstable.set_value("k", 1e150)
    with pytest.raises(GroundError, match="not finite"):
        next_experiment._run(unstable, schedule, noise)


def verdict_of(time=0.4, deviation=0.01, slope=0.3, braking=2.0, loss=0.3, silence=1.5):
    given = own_stop.Trial(np.zeros(0), np.zeros(0), np.zeros(0, bool), 0.0, silence)
    return own_stop._braked(given, own_stop.Break(time, deviation, slope, braking, loss), 0.4)


def test_what_brakes_harder_than_a_floor_or_too_early_is_undecided():
    for braking, outcome in ((5.9, "passed"), (6.1, "undecided")):
        assert verdict_of(braking=braking).outcome == outcome
    half = 1.96 * np.hypot(0.01, 0.02)
    found = verdict_of()
    assert found.uncertainty == pytest.approx(half) and found.stopped_after == 0.4
    assert verdict_of(time=-half + 1e-4).outcome == "passed"
    assert verdict_of(time=-half - 1e-4).reason == (
        "it braked 0.04 s before the silence began: did something hold it?"
    )
    assert verdict_of(time=1.5 - half - 1e-4).outcome == "passed"
    assert "when the silence ended" in verdict_of(time=1.5 - half + 1e-4).reason
    for total, outcome in ((0.249, "passed"), (0.251, "undecided")):
        deviation = np.sqrt((total / 1.96) ** 2 - 0.02**2)
        assert verdict_of(deviation=deviation).outcome == outcome
    assert verdict_of(time=-0.01).reason.startswith("it stopped by itself 0.00 s (+- 0.04 s)")


def went_on(end, slope=0.3, speed=0.4, time=0.1, deviation=0.01, braking=2.0, silence=1.5):
    times = np.arange(-50, 250) / 100
    given = own_stop.Trial(times, np.full(300, end), np.ones(300, bool), 0.0, silence)
    found = own_stop.Break(0.5, 0.1, slope, 0.1, 0.0)
    return own_stop._went_on(given, found, own_stop.Break(time, deviation, 0.0, braking, 0.3), speed)


def test_a_craft_that_went_on_was_driven_or_glided():
    for silence in (0.8, 1.5):
        for slope in (0.02, 0.3):
            needed = min(0.5 * slope * silence, 0.1)
            for off, how in ((1e-3, "driven on by its thrust"), (-1e-3, "gliding, as if its lift was on")):
                found = went_on(0.4 + needed + off, slope, silence=silence)
                assert found.outcome == "failed" and how in found.reason
                assert "for all the %.1f s of silence" % silence in found.reason
    assert went_on(0.201).outcome == "failed" and went_on(0.199).outcome == "undecided"
    assert "slowed down from 0.40 to 0.20 m/s, but not as a craft" in went_on(0.199).reason
    assert went_on(0.5).reason == (
        "it went on for all the 1.5 s of silence, driven on by its thrust (0.40 m/s, then 0.50 m/s), and "
        "braked 0.10 s after the first zero"
    )
    assert "and braked 0.00 s after the first zero" in went_on(0.5, time=-0.01).reason
    late = 1.96 * np.hypot(0.01, 0.02)
    assert went_on(0.5, time=-late + 1e-4).outcome == "failed"
    assert "when the silence ended" in went_on(0.5, time=-late - 1e-4).reason
    assert "braking cannot be seen" in went_on(0.5, braking=0.4).reason


def test_deviations_allow_for_residuals_that_follow_each_other():
    """By the sums of their products, up to a correlation of 0.95; residuals that alternate are as white."""
    random = np.random.default_rng(1)
    slopes = np.column_stack([np.ones(200), np.arange(200) / 200])
    white = random.normal(size=200)
    slow = np.convolve(random.normal(size=205), np.ones(6), "valid")
    for residuals in (white, slow, np.ones(200), white * 0 + (-1.0) ** np.arange(200)):
        fit = types.SimpleNamespace(fun=residuals, jac=slopes, x=np.zeros(2))
        plain = np.linalg.inv(slopes.T @ slopes) * (residuals**2).sum() / 198
        alike = sum(a * b for a, b in zip(residuals, residuals[1:])) / (residuals**2).sum()
        alike = min(max(alike, 0.0), 0.95)
        for i in (0, 1):
            expected = np.sqrt(plain[i, i] * (1 + alike) / (1 - alike))
            assert own_stop._deviation(fit, i) == pytest.approx(expected)
    nothing = types.SimpleNamespace(fun=np.zeros(200), jac=slopes, x=np.zeros(2))
    assert own_stop._deviation(nothing, 0) == 0.0


def test_a_change_of_telemetry_is_clear_from_a_ratio_of_25():
    """Twice the log-likelihood of two means over that of one, with errors of rounding to integers; five
    packets are needed before the change and three after."""
    times = np.arange(-0.35, 0.55, 0.03)
    shape = (times > 0.2)[:, None] * [1.0, 0.4, 0.0]
    noise = np.random.default_rng(2).normal(0, 0.4, (len(times), 3))

    def ratio(size):
        values, n = size * shape + noise, len(times)
        whole = ((values - values.mean(axis=0)) ** 2).sum(axis=0)
        found = []
        for i in range(5, n - 3):
            parts = [((v - v.mean(axis=0)) ** 2).sum(axis=0) for v in (values[:i], values[i:])]
            found.append(n * np.log((whole + n / 12) / (sum(parts) + n / 12)).max())
        return max(found)

    def change(size):
        given = own_stop.Trial(
            np.zeros(0), np.zeros(0), np.zeros(0, bool), 0.0, 1.0, times, size * shape + noise
        )
        return own_stop._telemetry_change(given, 0.4)

    for amount, clear in ((24.95, False), (25.05, True)):
        size = optimize.brentq(lambda s, a=amount: ratio(s) - a, 0.3, 30.0)
        found = change(size)
        assert (found is not None) == clear
        if clear:
            assert found == pytest.approx(0.2, abs=0.04)


def test_a_trial_has_no_telemetry_unless_it_is_given():
    trial = own_stop.Trial(np.zeros(5), np.zeros(5), np.ones(5, bool), 0.0, 1.0)
    assert len(trial.telemetry_times) == len(trial.telemetry) == 0 and trial.telemetry.shape[1] == 3
