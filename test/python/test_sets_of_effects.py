"""Which sets of effects a search keeps, on made-up likelihoods."""
import itertools
import types

import numpy as np
import pytest
from conftest import MODEL

from ground import _core
from ground.analysis import candidates, refits, search
from ground.analysis.criteria import Criteria
from ground.analysis.distributions import chi_squared_limit

NAMES = ("thrust_asymmetry", "quadratic_drag", "yaw_bias", "coulomb_friction", "momentum_drag")


def model():
    return _core.load_model(str(MODEL))


def size(name):
    return len(candidates.parameters_of(candidates.of_library(name).add(model()), name))


class Likelihoods:
    """Twice the log-likelihood that sets of effects gain over the model as it is: the gain of each effect,
    and of pairs what they gain more or less together."""

    def __init__(self, gains, pairs=()):
        self.gains = gains
        self.pairs = {frozenset(pair): more for pair, more in dict(pairs).items()}
        self.fitted = []

    def ratio(self, names):
        alone = sum(self.gains[name] for name in names)
        return alone + sum(more for pair, more in self.pairs.items() if pair <= frozenset(names))

    def fit_of(self, names):
        """What a search needs of the fit of a set."""
        names = frozenset(names)
        extended = model()
        for name in sorted(names):
            extended = candidates.of_library(name).add(extended)
        return types.SimpleNamespace(
            names=names,
            model=extended,
            free=tuple(sorted(names)),
            log_posterior=0.5 * self.ratio(names),
            ratio_without=lambda name: self.ratio(names) - self.ratio(names - {name}),
        )

    varying = ()

    def fit(self, given, free, near=None):
        """As Likelihood.fit."""
        return self.fit_of(set(given.effects) & set(self.gains))


class Scores:
    """Score tests that foresee the gains exactly."""

    def __init__(self, likelihoods, beside, hidden=()):
        self.likelihoods, self.beside, self._hidden = likelihoods, frozenset(beside), hidden
        self.columns = {n: [0] for n in likelihoods.gains if n not in self.beside}

    def test(self, names):
        gain = self.likelihoods.ratio(self.beside | set(names)) - self.likelihoods.ratio(self.beside)
        return max(0.0, gain), {}

    def hidden(self, name):
        return name in self._hidden

    def seen(self, name):
        return 0.0 if name in self._hidden else 1.0


def searched(monkeypatch, gains, pairs=(), hidden=(), **options):
    likelihoods = Likelihoods(gains, pairs)

    class Extension:
        def __init__(self, fitting, current, base, tests):
            self.current = current

        def __call__(self, added):
            likelihoods.fitted.append(self.current | set(added))
            return likelihoods.fit_of(self.current | set(added))

    class Reduction:
        def __init__(self, fitting, current, base, nominal):
            self.current = current

        def __call__(self, name):
            return likelihoods.fit_of(self.current - {name})

    monkeypatch.setattr(search, "Extension", Extension)
    monkeypatch.setattr(search, "Reduction", Reduction)
    monkeypatch.setattr(
        search, "ScoreTests", lambda like, fit, rest: Scores(likelihoods, fit.names, hidden)
    )
    known = {name: candidates.of_library(name) for name in gains}
    fitting = refits.Fitting(likelihoods, model(), lambda m: (), known, Criteria())
    return search.Search(fitting, **options), likelihoods


def threshold(name, count):
    return chi_squared_limit(0.01 / count, size(name))


def best_of(likelihoods):
    """The best set of all, by their likelihoods minus the thresholds."""
    names = list(likelihoods.gains)
    sets = [frozenset(s) for n in range(len(names) + 1) for s in itertools.combinations(names, n)]
    return max(sets, key=lambda s: likelihoods.ratio(s) - sum(threshold(n, len(names)) for n in s))


@pytest.mark.parametrize("seed", range(6))
def test_the_search_finds_the_best_of_all_sets(monkeypatch, seed):
    random = np.random.default_rng(seed)
    gains = dict(zip(NAMES, random.choice([0.0, 3.0, 25.0, 60.0, 200.0], 5)))
    found, likelihoods = searched(monkeypatch, gains)
    chosen = found.run()
    assert chosen == best_of(likelihoods)
    assert found.value(chosen) == pytest.approx(
        likelihoods.ratio(chosen) - sum(threshold(n, 5) for n in chosen)
    )
    assert found.ratio(chosen, frozenset()) == pytest.approx(likelihoods.ratio(chosen))


def test_an_effect_just_above_its_threshold_is_found_and_one_below_is_not(monkeypatch):
    limit = threshold("yaw_bias", 2)
    for gain, chosen in ((limit + 0.1, {"yaw_bias"}), (limit - 0.1, set())):
        found, _ = searched(monkeypatch, {"yaw_bias": gain, "quadratic_drag": 0.0})
        assert found.run() == chosen


def test_two_effects_that_only_show_together_are_found(monkeypatch):
    pair = ("quadratic_drag", "coulomb_friction")
    found, _ = searched(monkeypatch, dict.fromkeys(NAMES, 0.0), {pair: 200.0})
    assert found.run() == set(pair)


def test_an_effect_that_others_replace_is_taken_out_again(monkeypatch):
    """A third effect imitates two others: it is found first, and goes when both are there."""
    gains = {"momentum_drag": 150.0, "quadratic_drag": 100.0, "coulomb_friction": 90.0}
    pairs = {("momentum_drag", "quadratic_drag"): -80.0, ("momentum_drag", "coulomb_friction"): -69.0}
    found, likelihoods = searched(monkeypatch, gains, pairs)
    assert found.run() == {"quadratic_drag", "coulomb_friction"} == best_of(likelihoods)


def test_an_effect_is_swapped_for_a_likelier_one(monkeypatch):
    gains = {"momentum_drag": 150.0, "quadratic_drag": 149.0, "yaw_bias": 100.0}
    pairs = {("momentum_drag", "quadratic_drag"): -180.0, ("quadratic_drag", "yaw_bias"): 30.0}
    current = frozenset(["momentum_drag", "yaw_bias"])
    for swapped, expected in (
        (None, {"quadratic_drag", "yaw_bias"}),
        ({"momentum_drag": ["quadratic_drag"]}, {"quadratic_drag", "yaw_bias"}),
        ({"momentum_drag": ["yaw_bias"]}, current),
        ({}, current),
    ):
        found, likelihoods = searched(monkeypatch, gains, pairs, swapped=swapped)
        found.nominal()
        found.fits[current] = likelihoods.fit_of(current)
        assert found._swap(current) == expected
        assert found._swap(current) == current  # it is tried once
    found, _ = searched(monkeypatch, gains, pairs)
    assert found.run() == {"quadratic_drag", "yaw_bias"} == best_of(likelihoods)


def test_sets_that_held_out_data_refute_are_not_taken_but_remembered(monkeypatch):
    gains = {"momentum_drag": 150.0, "quadratic_drag": 100.0}
    found, _ = searched(
        monkeypatch, gains, holds=lambda better, current: "momentum_drag" not in better
    )
    assert found.run() == {"quadratic_drag"}
    assert frozenset(["momentum_drag"]) in found.refused(frozenset())
    assert frozenset(NAMES[:1]) not in found.refused(frozenset(NAMES))


def test_a_search_begins_near_a_given_fit(monkeypatch):
    gains = dict.fromkeys(NAMES, 0.0)
    gains["yaw_bias"] = 100.0
    found, likelihoods = searched(monkeypatch, gains)
    near = likelihoods.fit_of(["yaw_bias", "quadratic_drag"])
    assert found.run(near) == {"yaw_bias"}
    assert frozenset(["yaw_bias", "quadratic_drag"]) in found.fits


def test_rivals_are_what_data_hardly_distinguish(monkeypatch):
    gains = {"momentum_drag": 150.0, "quadratic_drag": 146.0, "coulomb_friction": 130.0, "yaw_bias": 1.0}
    pairs = {p: -140.0 for p in itertools.combinations(list(gains)[:3], 2)}
    found, likelihoods = searched(monkeypatch, gains, pairs)
    chosen = found.run()
    (name,) = chosen
    behind = {
        n: found.value(chosen) - (likelihoods.ratio([n]) - threshold(n, 4))
        for n in list(gains)[:3]
        if n != name
    }
    assert found.rivals(chosen, name) == [n for n in sorted(behind, key=behind.get) if behind[n] < 7.0]
    assert set(found.rivals(chosen, name, 1e3)) == set(behind)
    assert found.rivals(chosen, name, min(behind.values())) == []
