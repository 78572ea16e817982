"""Which sets of effects a search and a diagnosis keep: their rules on made-up likelihoods."""
import dataclasses
import itertools
import types

import numpy as np
import pytest
from conftest import MODEL

from ground import _core
from ground.analysis import (
    candidates,
    conclusion,
    diagnosis,
    diagnosis_report,
    held_out,
    horizon,
    refits,
    search,
    stages,
    trials,
    varying,
)
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


def test_thresholds_grow_with_parameters_and_effects(monkeypatch):
    found, _ = searched(monkeypatch, dict.fromkeys(NAMES, 0.0))
    for name in NAMES:
        assert found.threshold(name) == pytest.approx(threshold(name, 5))
    few, _ = searched(monkeypatch, {"yaw_bias": 0.0})
    assert few.threshold("yaw_bias") < found.threshold("yaw_bias")


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


def test_promising_proposals_are_refitted_first(monkeypatch):
    gains = {"yaw_bias": 300.0, "momentum_drag": 100.0, "quadratic_drag": 31.0, "coulomb_friction": 20.0}
    found, likelihoods = searched(monkeypatch, gains)
    found.run()
    assert found._promising_first(frozenset(), [("a",), ("b",)]) == [[("a",), ("b",)]]
    beside = frozenset(["yaw_bias"])
    first, others = found._promising_first(beside, [(n,) for n in list(gains)[1:]])
    assert first == [("momentum_drag",), ("quadratic_drag",)] and others == [("coulomb_friction",)]
    assert found._coming(beside) == sum(gains[n] > threshold(n, 4) for n in list(gains)[1:])


def test_hidden_effects_are_proposed_beside_others_only(monkeypatch):
    gains = {"yaw_bias": 300.0, "momentum_drag": 0.0, "quadratic_drag": 0.0}
    found, _ = searched(monkeypatch, gains, hidden=("momentum_drag",))
    found.run()
    assert ("momentum_drag",) not in found._proposals(frozenset())
    assert ("momentum_drag",) in found._proposals(frozenset(["yaw_bias"]))


# --- fits of extended sets


def fitting(ratio_of, known=None, fails=()):
    """A Fitting whose log-likelihoods are those of a function of the model."""
    from ground.errors import GroundError

    class Like:
        started = []

        def fit(self, given, free, near=None):
            self.started.append(given)
            if any(name in given.effects for name in fails):
                raise GroundError("it diverges")
            return types.SimpleNamespace(model=given, free=free, log_posterior=ratio_of(given))

    all_of = {name: candidates.of_library(name) for name in NAMES}
    return refits.Fitting(Like(), model(), lambda m: tuple(m.effects), all_of, Criteria(), known or {})


class Step:
    """A score test whose step is given."""

    def __init__(self, step, is_hidden=False):
        self.step, self.is_hidden = step, is_hidden

    def test(self, names):
        return 1.0, self.step

    def hidden(self, name):
        return self.is_hidden

    def in_place(self, name, part):
        return {"yaw_bias.n0": 1e-3 * part}


def extended(given, tests, base=0.0, added=("yaw_bias",), current=("quadratic_drag",)):
    start = candidates.of_library("quadratic_drag").neutral(model())
    fit = types.SimpleNamespace(model=start, free=(), log_posterior=base)
    return refits.Extension(given, frozenset(current), fit, tests)(added)


def test_the_best_of_several_starts_is_kept():
    given = fitting(lambda m: -abs(m.value("yaw_bias.n0") - 1e-4))  # best at a tenth of the step
    found = extended(given, Step({"yaw_bias.n0": 1e-3}))
    assert found.model.value("yaw_bias.n0") == pytest.approx(1e-4)
    tried = [m.value("yaw_bias.n0") for m in given.likelihood.started]
    assert tried == pytest.approx([1e-3, 3e-4, 1e-4])
    given.likelihood.started.clear()
    second = fitting(lambda m: 2.0 if m.value("yaw_bias.n0") == pytest.approx(3e-4) else -1.0)
    second.likelihood.started.clear()
    extended(second, Step({"yaw_bias.n0": 1e-3}))
    assert len(second.likelihood.started) == 2
    good = fitting(lambda m: 2.0)
    good.likelihood.started.clear()
    extended(good, Step({"yaw_bias.n0": 1e-3}))
    assert len(good.likelihood.started) == 1  # the first is likelier than without the effect


def test_an_effect_that_the_test_does_not_see_starts_at_some_sizes():
    given = fitting(lambda m: -abs(m.value("yaw_bias.n0") + 2e-4))
    given.likelihood.started.clear()
    found = extended(given, Step({}, True))
    tried = sorted(m.value("yaw_bias.n0") for m in given.likelihood.started)
    assert tried == pytest.approx([-2e-4, 0.0, 2e-4, 5e-4])
    assert found.model.value("yaw_bias.n0") == pytest.approx(-2e-4)


def far(monkeypatch, errors, current=()):
    """Where the fits of a single effect start from, given the errors of quick fits from its own starts in
    turn (None: they fail); and what the quick fits were asked."""
    asked, left, name = [], list(errors), "heading_offset"

    class Quick:
        def fit(self, start, free, threads):
            asked.append((start, free, threads))
            error = left.pop(0)
            if error is None:
                raise RuntimeError("it diverges")
            found = start.copy()
            found.set_value("k", 2.0)  # other parameters are far from the right ones, too
            return {"objective": error, "model": found}

    def spread(cut, most):
        asked.append(most)
        return cut

    monkeypatch.setattr(refits.windows, "problem", lambda runs, cut: Quick())
    monkeypatch.setattr(refits.windows, "cut", lambda runs: runs)
    monkeypatch.setattr(refits.windows, "spread", spread)
    given = fitting(lambda m: -m.value("heading_offset.psi0") if name in m.effects else 0.0)
    known = {**given.candidates, name: candidates.of_library(name)}
    given = dataclasses.replace(given, candidates=known)
    given.likelihood.started, given.likelihood.runs = [], ["run"]
    fit = types.SimpleNamespace(model=model(), free=(), log_posterior=0.0)
    found = refits.Extension(given, frozenset(current), fit, Step({}))((name,))
    return found, given.likelihood.started, asked


def test_single_effects_start_far_off_as_well(monkeypatch):
    """From what a quick fit, by simulation error, makes better by a fiftieth than from neutral values."""
    found, started, asked = far(monkeypatch, [10.0, 9.7, None, 9.9])
    angles = [round(m.value("heading_offset.psi0"), 3) for m in started]
    starts = list(candidates.of_library("heading_offset").starts(model()))
    expected = [round(starts[i].value("heading_offset.psi0"), 3) for i in (0, 1)]
    assert angles == expected and started[1].value("k") == 2.0
    assert found.model.value("heading_offset.psi0") == min(m.value("heading_offset.psi0") for m in started)
    assert asked[0] == 40 and len(asked) == 1 + 4  # on forty windows
    assert all("heading_offset" in free for _, free, _ in asked[1:])
    assert all(threads == 1 for _, _, threads in asked[1:])  # such fits run beside each other
    for second, at in ((9.79, 1), (9.81, 0)):  # else from where that fit has come from neutral values
        _, started, _ = far(monkeypatch, [10.0, second, 10.0, 10.0])
        angle = starts[at].value("heading_offset.psi0")
        assert len(started) == 2 and started[1].value("heading_offset.psi0") == angle
    assert len(far(monkeypatch, [None, 10.0, None, 3.0])[1]) == 1 + 2  # any is better than none
    monkeypatch.setattr(refits.Extension, "_is_far_off", lambda self: False)
    _, started, asked = far(monkeypatch, [], current=["yaw_bias"])
    assert len(started) == 1 and asked == []  # beside others it starts near them


def test_a_fit_that_diverges_everywhere_is_none():
    assert extended(fitting(lambda m: 0.0, fails=("yaw_bias",)), Step({"yaw_bias.n0": 1e-3})) is None


def test_a_known_fit_is_where_the_next_begins():
    @dataclasses.dataclass(frozen=True)
    class Known:
        model: object
        loudness: tuple = (1.0,)

    both = candidates.of_library("yaw_bias").add(candidates.of_library("quadratic_drag").add(model()))
    both.set_value("yaw_bias.n0", 7e-4)
    names = frozenset(["yaw_bias", "quadratic_drag"])
    given = fitting(lambda m: 5.0, {names: Known(both)})
    given.likelihood.started.clear()
    found = extended(given, Step({"yaw_bias.n0": 1e-3}))
    assert found.model.value("yaw_bias.n0") == 7e-4 and len(given.likelihood.started) == 1
    assert given.from_known(frozenset(["yaw_bias"])) is None


def test_a_set_without_an_effect_begins_at_the_others_values():
    base = candidates.of_library("yaw_bias").add(candidates.of_library("quadratic_drag").add(model()))
    for parameter in candidates.parameters_of(base, "quadratic_drag"):
        base.set_value(parameter["name"], parameter["scale"])
    fit = types.SimpleNamespace(model=base, log_posterior=0.0)
    nominal = types.SimpleNamespace(model=model())
    given = fitting(lambda m: 1.0)
    found = refits.Reduction(given, frozenset(["yaw_bias", "quadratic_drag"]), fit, nominal)("yaw_bias")
    assert list(found.model.effects) == ["quadratic_drag"]
    for name, value in candidates.values(found.model).items():
        assert value == base.value(name)


def test_angles_are_searched_from_all_sides():
    given = fitting(lambda m: 0.0)
    assert not given.has_starts("yaw_bias")
    offset = candidates.of_library("heading_offset")
    starts = list(offset.starts(model()))
    angles = sorted(s.value("heading_offset.psi0") for s in starts)
    assert angles == pytest.approx([-np.pi / 2, 0, np.pi / 2, np.pi])
    turned = starts[1]
    assert [m.value("heading_offset.psi0") for m in candidates.turned(turned, ["heading_offset.psi0"])] == [
        turned.value("heading_offset.psi0")
    ]
    assert len(list(candidates.turned(starts[0], ["k"]))) == 1


# --- what a diagnosis keeps


def found_of(gains, errors, size=100.0, likelihoods=None):
    """A Diagnosis of made-up fits; errors: on held-out data by set; likelihoods: of blocks by set."""
    from concurrent.futures import ThreadPoolExecutor

    from ground.progress import Work

    made = diagnosis.Diagnosis.__new__(diagnosis.Diagnosis)
    ratios = Likelihoods(gains)
    sets = [frozenset(s) for n in range(len(gains) + 1) for s in itertools.combinations(gains, n)]
    fits = {names: ratios.fit_of(names) for names in sets}
    made.search = types.SimpleNamespace(
        fits=fits,
        candidates={n: candidates.of_library(n) for n in gains},
        without=lambda names, name: names - {name},
        without_each=lambda names, some: [names - {n} for n in some],
        ratio=lambda a, b: 2 * (fits[a].log_posterior - fits[b].log_posterior),
        threshold=lambda name: 10.0,
    )
    for names, fit in fits.items():
        fit.parameters = [dict(name=n + ".p", identified=True) for n in names]
    made.candidates = [candidates.of_library(n) for n in gains]
    made.samples, made.work = 100, Work()
    made.plan = stages.Plan(made.work)
    made.chosen, made.steps, made.dropped, made.judged = [], [], [], {}
    made.slight, made.slight_sets = None, ()
    made.waiting = ThreadPoolExecutor(1)
    made._change = lambda a, b: horizon.Change(1.0, size, 0.0, size)
    blocks = likelihoods or (lambda names: ratios.ratio(names) / 10 * np.linspace(0.9, 1.1, 10))
    for names in sets:
        likelihood = (np.array(blocks(names), float),)
        by_window = errors(names) * np.linspace(0.9, 1.1, 10)
        made.judged[names] = types.SimpleNamespace(
            likelihood=likelihood, heldout=np.array([errors(names), 0.0, 0.0]),
            tested=held_out.Tested(by_window, np.zeros(10, int), likelihood),
        )  # fmt: skip
    return made


def test_effects_that_hold_are_kept():
    made = found_of({"yaw_bias": 100.0, "quadratic_drag": 60.0}, lambda names: 3.0 - len(names))
    both = frozenset(["yaw_bias", "quadratic_drag"])
    assert made._without_refuted(both) == both and made.dropped == [] and made.slight is None
    made._order(both)
    assert [step.added for step in made.steps] == ["yaw_bias", "quadratic_drag"]  # the strongest first
    assert [c.name for c in made.chosen] == ["yaw_bias", "quadratic_drag"] and made.names == both


def test_effects_that_held_out_data_refute_are_dropped_with_the_reason():
    gains = {"yaw_bias": 100.0, "quadratic_drag": 60.0}
    both = frozenset(gains)
    worse = found_of(gains, lambda names: 3.0 - ("yaw_bias" in names) + 0.1 * ("quadratic_drag" in names))
    assert worse._without_refuted(both) == {"yaw_bias"}
    (dropped,) = worse.dropped
    assert dropped.trial.name == "quadratic_drag" and "worse" in dropped.why
    weak = {"yaw_bias": 20.0, "quadratic_drag": 30.0}
    same = found_of(
        weak, lambda names: 3.0 - len(names),
        likelihoods=lambda names: 5.0 * ("yaw_bias" in names) * np.linspace(0.9, 1.1, 10),
    )  # fmt: skip
    assert same._without_refuted(both) == {"yaw_bias"} and "likelier" in same.dropped[0].why


@pytest.mark.parametrize("ratio, kept", [(20.0, False), (200.0, True)])
def test_an_effect_that_is_certain_need_not_be_confirmed_by_held_out_data(ratio, kept):
    one = frozenset(["yaw_bias"])
    made = found_of(
        {"yaw_bias": ratio}, lambda names: 3.0 + 0.001 * len(names),
        likelihoods=lambda names: len(names) * np.array([9.0, -8.0, 7.0, -6.0, 1.0, -2.0]),
    )  # fmt: skip
    made.judged[one].tested.by_window[:] += 0.3 * np.cos(np.arange(10))  # the sign of the sum says nothing
    assert (made._without_refuted(one) == one) == kept
    assert made.confirmed(one, frozenset()).verdict == held_out.UNDECIDED


def test_an_effect_matters_by_its_change_of_predicted_poses():
    gains, errors = {"yaw_bias": 20.0}, lambda names: 3.0 - len(names)
    one = frozenset(gains)
    for size, kept in ((20.0, True), (1.0, False)):
        made = found_of(gains, errors, size)
        assert (made._without_refuted(one) == one) == kept
        if not kept:
            assert made.slight.name == "yaw_bias" and made.slight.change.relative == size
            assert made.slight_sets == (one, frozenset()) and made.dropped == []


def test_the_weakest_of_several_refuted_effects_goes_first():
    gains = {"yaw_bias": 100.0, "quadratic_drag": 60.0, "momentum_drag": 80.0}
    made = found_of(gains, lambda names: 3.0 + len(names))
    told = []
    made.plan.tested = lambda left, refused: told.append((left, refused))
    assert made._without_refuted(frozenset(gains)) == frozenset()
    assert told == [(3, 3), (2, 2), (1, 1)]  # what is left is tested again
    assert [d.trial.name for d in made.dropped] == ["quadratic_drag", "momentum_drag", "yaw_bias"]
    made._drop(frozenset(["yaw_bias"]), "yaw_bias", "again")
    assert [d.why for d in made.dropped if d.trial.name == "yaw_bias"] == ["again"]


def test_effects_that_are_as_good_are_grouped():
    gains = {"yaw_bias": 100.0, "quadratic_drag": 60.0}
    made = found_of(gains, lambda names: 3.0 - len(names))
    made._order(frozenset(gains))
    made.search.rivals = lambda names, name: {"yaw_bias": ["momentum_drag"]}.get(name, [])
    made.search.value = lambda names: sum(gains[n] for n in names)
    made.tried = [
        trials.trial(n, candidates.of_library(n).add(model()), (), g, True, True, 2, 100)
        for n, g in gains.items()
    ]
    steps = []
    made.work.step = lambda: steps.append(1)
    made._mark_equals()
    assert len(steps) == 2  # one for each effect
    assert [step.group for step in made.steps] == [("yaw_bias", "momentum_drag"), ("quadratic_drag",)]
    assert [t.name for t in made.tried if t.equal] == ["yaw_bias"]
    assert made.tried[0].name == "yaw_bias" and sum(t.inclusion for t in made.tried) == pytest.approx(1)


# --- the conclusion


def test_differences_between_runs_are_given_by_run():
    trims = [
        dict(wrench=[0.1, 0.2, 0.3], thrust=0.01), dict(wrench=[0.3, 0.2, 0.1], thrust=0.05),
        dict(wrench=[0.2, 0.2, 0.2], thrust=0.03),
    ]  # fmt: skip
    differences = [varying.Difference(varying.KINDS[0], 1e-6), varying.Difference(varying.KINDS[3], 1e-5)]
    made = types.SimpleNamespace(fit=types.SimpleNamespace(trims=trims), differences=differences)
    force, thrust = conclusion._varies(made)
    assert force["parameter"] == "surge force" and force["by_run"] == [0.1, 0.3, 0.2]
    assert force["deviation"] == pytest.approx(0.1) and force["p_value"] == 1e-6 and force["unit"] == "N"
    assert thrust["parameter"] == "thrust" and thrust["by_run"] == [0.01, 0.05, 0.03]
    assert thrust["deviation"] == pytest.approx(0.02)


# --- the report


def estimate(name, value=1.0):
    return dict(name=name, value=value, unit="N", ci95=(0.5, 1.5), identified=True, deviation=0.25)


def test_parameters_are_reported_without_the_name_of_their_effect():
    found = diagnosis_report._parameters([estimate("lag.tau"), estimate("lag.k", 2.0)], "lag.")
    assert found == {
        "tau": {"value": 1.0, "unit": "N", "ci95": [0.5, 1.5], "identified": True},
        "k": {"value": 2.0, "unit": "N", "ci95": [0.5, 1.5], "identified": True},
    }
    assert set(diagnosis_report._parameters([estimate("k")])) == {"k"}


def test_errors_are_sums_over_the_channels():
    fit = types.SimpleNamespace(error=np.array([1.0, 2.0, 3.0]), heldout=np.array([2.0, 3.0, 4.0]))
    assert diagnosis_report._errors(fit) == {"fit": 6.0, "heldout": 9.0, "by": "cross-validation"}
    assert diagnosis_report._errors(fit, 0.0) == {"fit": 6.0, "heldout": 0.0, "by": "cross-validation"}
    assert diagnosis_report._errors(None) == {"fit": None, "heldout": None, "by": "cross-validation"}


def test_levels_are_reported_by_channel():
    kinds = ("sigma", "time", "white", "trim")
    levels = {"%s_%s" % (k, c): 10 * i + j for i, k in enumerate(kinds) for j, c in enumerate("XYN")}
    levels.update(thrust=0.1, position=1e-4, heading=1e-3, sigma_room=0.5, time_room=2.0)
    found = diagnosis_report._disturbance(types.SimpleNamespace(levels=levels))
    for i, kind in enumerate(kinds):
        assert [found[kind][c] for c in "XYN"] == [10 * i, 10 * i + 1, 10 * i + 2]
    assert found["trim"]["thrust"] == 0.1 and found["room"] == {"sigma": 0.5, "time": 2.0}
    assert found["noise"] == {"position": 1e-4, "heading": 1e-3}


def test_a_proposal_is_listed_as_an_effect():
    proposal = {"name": "p", "expression": {"X": "c*u"}, "parameters": {}, "share": 0.3, "error": 1}
    entry = {"name": "p", "expression": {"X": "c*u"}, "parameters": {}}
    assert diagnosis_report.effect_entry(proposal) == entry


def test_candidates_are_ranked_with_errors_of_the_best_only():
    tried = [
        trials.trial(n, candidates.of_library(n).add(model()), [estimate(n + ".p")], g, True, True, 5, 100)
        for n, g in zip(NAMES, (90.0, 50.0, 40.0, 30.0, 20.0))
    ]
    tried[1] = trials.replace(tried[1], equal=True)
    judged = types.SimpleNamespace(error=np.ones(3), heldout=np.ones(3))
    made = types.SimpleNamespace(
        tried=tried,
        chosen=[candidates.of_library(NAMES[4])],
        steps=[types.SimpleNamespace(added=NAMES[4], group=(NAMES[4], NAMES[0]))],
        judged_of=lambda trial: judged,
    )
    alike = [types.SimpleNamespace(name=NAMES[2], moved=("k", "X_u"))]
    rows = diagnosis_report._candidates(made, alike, False)
    assert [row["effect"] for row in rows] == list(NAMES) and [row["rank"] for row in rows] == [1, 2, 3, 4, 5]
    assert [row["error"]["fit"] for row in rows] == [3.0, 3.0, 3.0, None, 3.0]
    assert [row["selected"] for row in rows] == [False] * 4 + [True]
    assert rows[1]["group"] == [NAMES[1]] and rows[4]["group"] == [NAMES[4], NAMES[0]]
    assert rows[2]["group"] == [NAMES[2], "k", "X_u"]
    assert [row["seen"] for row in rows] == [True, True, False, True, True]
    assert rows[0]["parameters"]["p"]["value"] == 1.0
    whole = diagnosis_report._candidates(made, alike, True)
    assert all(row["error"]["fit"] == 3.0 for row in whole)
