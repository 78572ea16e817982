"""Which physical effect is missing in a model.

A search (ground.analysis.search) finds the set of effects under which the recorded poses are
likeliest; a random disturbance is part of the model. Each effect also has to raise the likelihood
of held-out data (ground.analysis.folds), must not raise the error there, and has to be large
enough to matter. The last step measures what the grown model leaves (ground.analysis.ceiling).
"""

from dataclasses import dataclass, replace
from typing import Callable, Dict, FrozenSet, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import (
    ceiling,
    evidence,
    excerpts,
    folds,
    horizon,
    naming,
    run_differences,
    window_error,
)
from ground.analysis.distributions import LEVEL, chi_squared_limit
from ground.analysis.evidence import Dropped
from ground.analysis.judge import PairedComparison, Tested, compared
from ground.analysis.likelihood import COARSE, Likelihood, LikelihoodFit, RunDifference
from ground.analysis.score_tests import UNSEEN
from ground.analysis.search import LookAlike, Search
from ground.analysis.simulation_search import SimulationSearch
from ground.effect_library.candidates import Candidate
from ground.support.annotations import Array
from ground.support.errors import Diverged
from ground.support.progress import Work
from ground.support.workers import Workers

# Multiple of the significant log-likelihood ratio from which an effect is seen even if a quarter of the poses
# only were independent.
GLARING = 4.0
EXPLAINED = 1.15  # ratio of error to noise floor below which a model explains the data
SLIGHT = "it is too small to matter"


@dataclass(frozen=True)
class Step:
    """An effect that was added."""

    added: str
    fit: folds.Judged  # the model with the effect, fitted and judged
    group: Tuple[str, ...]  # effects that the data cannot distinguish from it, itself first
    rest: LikelihoodFit  # the fit of the grown model without the effect
    p_value: float  # of the test that the effect does nothing, given the other effects
    confirmed: PairedComparison  # the grown model with it and without it, on parts of the runs held out


class StepwiseDiagnosis:
    """A model compared with runs, and grown by the missing effects.

    runs: _core.RunData to fit to, of which long ones are used in parts (ground.analysis.excerpts);
    candidates: effects to try; threads: 0 for all cores; work: told of what is done; matters: least change of
    predicted position [mm] and heading [deg] that matters, (2,), by default horizon.what_matters; tested:
    called with it when more is known of single effects (trials, prediction_with).
    """

    def __init__(
        self,
        runs: Sequence[_core.RunData],
        model: _core.Model,
        candidates: List[Candidate],
        threads: int = 0,
        work: Optional[Work] = None,
        matters: Optional[Array] = None,
        tested: Callable[["StepwiseDiagnosis"], None] = lambda found: None,
    ) -> None:
        self.all_runs, self.tested_one = runs, tested
        self.runs = runs = excerpts.spread(runs)
        self.given = model
        self.candidates = candidates
        self.matters = horizon.what_matters(runs) if matters is None else matters
        self.work = work or Work()
        # A fit alone uses all cores; fits beside each other share them.
        self.threads = 1 if threads else 0
        self.each = Workers(count=threads).map
        self.fitter = window_error.WindowFitter(runs, threads=1)
        self.fitter.check()
        self.cut = self.fitter.windows
        self.prediction_time = horizon.horizon(runs, model)  # over which poses are predicted [s]
        self.starts = horizon.Starts.of(runs, self.prediction_time)
        self.chosen: List[Candidate] = []  # in the order of their choice
        self.steps: List[Step] = []
        self.dropped: List[Dropped] = []
        # By the LikelihoodFit of a set of effects, because a set may be fitted again
        self.fuller: Dict[LikelihoodFit, LikelihoodFit] = {}  # with an effect that is too small to matter
        self.ceilings: Dict[LikelihoodFit, ceiling.Ceiling] = {}  # slight effects included
        self.floors: Dict[LikelihoodFit, float] = {}  # noise floors
        self.formulas: Dict[LikelihoodFit, Optional[naming.Formula]] = {}
        self.judged: Dict[LikelihoodFit, folds.Judged] = {}
        self.tried: List[evidence.Trial] = []  # each effect added to the nominal model, best first
        with self.work.stage("fitting the model as it is"):
            # everything that may differ between runs does
            self.varied = Likelihood(runs, model, threads=self.threads)
            self.samples = 3 * sum(len(run.times) for run in self.varied.runs)  # that the likelihood is of
            fit = self.varied.fit(model, window_error.free_parameters(model), least_gain=COARSE)
            self.bare = run_differences.differences(self.varied, fit)  # beside the model as it is
            self._begin(self.bare, fit)

    def _begin(self, differences: Mapping[RunDifference, float], near: LikelihoodFit) -> None:
        """Starts a search in which the differences between runs are random effects."""
        self.differences = differences
        levels = [kind.level for kind in differences]
        self.likelihood = Likelihood(self.runs, self.given, levels, self.threads)
        self.folds = folds.Folds(self.runs, self.likelihood, self.cut, self.starts, self.each)
        self.search = Search(
            self.likelihood,
            self.given,
            {candidate.name: candidate for candidate in self.candidates},
            self.each,
            self.work,
            lambda better, current: self._refuted(better, current, whole=False) is None,
            lambda: self.tested_one(self),
        )
        self.search.nominal(near)
        self.nominal = self.judge(frozenset())
        if not np.isfinite(self.nominal.heldout).all():
            raise Diverged("the motion of the given model, fitted to a part of the runs, is not finite")

    @property
    def is_excerpt(self) -> bool:
        """Whether effects are searched for in parts of the runs."""
        return any(part is not run for part, run in zip(self.runs, self.all_runs))

    @property
    def names(self) -> FrozenSet[str]:
        """The set of effects that were chosen."""
        return frozenset(c.name for c in self.chosen)

    @property
    def fit(self) -> LikelihoodFit:
        """LikelihoodFit of the grown model."""
        return self.search.fits[self.names]

    @property
    def model(self) -> _core.Model:
        """The grown model."""
        return self.fit.model

    @property
    def best(self) -> folds.Judged:
        """folds.Judged of the grown model."""
        return self.judge(self.names)

    def ceiling_of(self, found: Optional[FrozenSet[str]] = None) -> ceiling.Ceiling:
        """ceiling.Ceiling of a set of effects that was fitted (default: of the grown model), with an
        effect that is too small to matter."""
        names = self.names if found is None else found
        fit, before = self.search.fits[names], self.search.fits[frozenset()].model
        fit = self.fuller.get(fit, fit)
        if fit not in self.ceilings:
            share = self.noise_floor(names) / float(self.judge(names).error.sum())
            bound = max(0.0, 1 - share**2) if self.explains(names) else None
            self.ceilings[fit] = ceiling.ceiling(self.likelihood, fit, self.runs, self.cut, before, bound)
        return self.ceilings[fit]

    def explains(self, names: FrozenSet[str]) -> bool:
        """Whether the noise of the poses explains nearly all of the error of a set that was fitted."""
        return float(self.judge(names).error.sum()) < EXPLAINED * self.noise_floor(names)

    def noise_floor(self, names: FrozenSet[str]) -> float:
        """Error that the noise of the poses alone would leave if a fitted set of effects were true: the mean
        of five simulations."""
        fit = self.search.fits[names]
        if fit not in self.floors:
            floors = [window_error.noise_floor(self.runs, fit.model, seed).sum() for seed in range(5)]
            self.floors[fit] = float(np.mean(floors))
        return self.floors[fit]

    def formula_of(
        self, names: FrozenSet[str], shows: Callable[[naming.Formula], bool] = lambda made: True
    ) -> Optional[naming.Formula]:
        """naming.Formula of what a set of effects that was fitted leaves; None if nothing has one. shows:
        whether one is worth its simplest form."""
        fit = self.search.fits[names]
        if fit not in self.formulas:
            found, self.formulas[fit] = self.ceiling_of(names).found, None
            if found is not None:
                self.formulas[fit] = naming.formula(self.likelihood, fit, found.regression, shows=shows)
        return self.formulas[fit]

    def judge(self, names: FrozenSet[str]) -> folds.Judged:
        """folds.Judged of a set of effects that was fitted."""
        fit = self.search.fits[names]
        if fit not in self.judged:
            self.judged[fit] = self.folds.judge(fit)
        return self.judged[fit]

    def grow(self) -> None:
        """Adds the effects that earn their place. Units of progress are sets that are refitted, then
        effects."""
        with self.work.stage("searching for missing effects"):
            self.tested_one(self)
            found = self._simplest(self._likeliest_set())
        self.tried = self.trials()
        for better in self.search.refused(found):
            why = self._refuted(better, found)
            if why:
                for name in sorted(better - found):
                    self._leave_out(better, name, why)
        with self.work.stage("testing effects on held-out data"):
            found = self._without_refuted(found)
        with self.work.stage("testing whether effects imitate what has no name"):
            found = self._without_stand_ins(found)
        with self.work.stage("ordering the effects", len(found)):
            self._order(found)
        with self.work.stage("looking for effects that could replace them", len(found)):
            self._mark_equals()

    def _likeliest_set(self) -> FrozenSet[str]:
        """The likeliest set of effects. Differences between runs are tested again with it, three times at
        most: a missing effect may have imitated or hidden them."""
        found = self.search.run()
        for _ in range(3):
            # Refused sets count, too: they may have been refused only because held-out runs were
            # predicted without the difference.
            likeliest = max([found, *self.search.refused(found)], key=self.search.value)
            fit = self.search.fits[likeliest]
            differences = run_differences.differences(self.varied, fit) if likeliest else self.bare
            if differences.keys() == self.differences.keys():
                self.differences = differences
                return found
            names = [kind.parameter for kind in differences]
            self.work.note("differs between runs: %s" % (", ".join(names) or "nothing"))
            self._begin(differences, self.search.nominal())
            found = self.search.run(near=fit)
        return found

    def _simplest(self, found: FrozenSet[str]) -> FrozenSet[str]:
        """The set with an effect in the place of one that contains it, where the difference does not matter:
        clocks that err by different times make a lag that rises and falls in different times likelier."""
        for name in sorted(found):
            inner = self.search.candidates[name].contains
            if inner in self.search.candidates:
                rest, fits = self.search.without(found, name), self.search.fits
                simpler = rest if inner in rest else self.search.beside(rest, inner)
                if simpler and not self.matter(fits[simpler].model, fits[found].model):
                    found = simpler
        return found

    # Which of the effects found are kept

    def _without_refuted(self, found: FrozenSet[str]) -> FrozenSet[str]:
        """The set without effects that held-out data refute or that do not matter."""
        while found:
            objections: Dict[str, str] = {}
            for name, rest in zip(sorted(found), self.search.without_each(found, sorted(found))):
                why, fits = self._refuted(found, rest), self.search.fits
                # on long runs the likelihood detects a millisecond of network latency as a delay
                if why or not self.matter(fits[rest].model, fits[found].model):
                    objections[name] = why or SLIGHT
                self.work.step()
            if not objections:
                return found
            name = min(objections, key=lambda name: self.search.ratio(found, found - {name}))
            found = self._leave_out(found, name, objections[name])
        return found

    def _refuted(self, found: FrozenSet[str], rest: FrozenSet[str], whole: bool = True) -> Optional[str]:
        """Reason why held-out data contradict a set and favour a smaller one; None if they do not. Effects
        that are likely or glaring need no proof: they are then said to be seen, and not confirmed. whole: the
        larger set is what is found, and no step on the way, which may predict worse than what it leads to."""
        judged = self.confirmed(found, rest)
        if whole and judged.is_worse:
            return "it makes predictions of held-out runs worse"
        enough = GLARING * sum(self.search.threshold(name) for name in found - rest)
        if judged.is_likely or self.search.ratio(found, rest) >= enough:
            return None
        return "it does not improve predictions of held-out runs"

    def confirmed(self, found: FrozenSet[str], rest: FrozenSet[str]) -> PairedComparison:
        """A set compared with a smaller one on parts of the runs that neither was fitted to. What matters
        does not count: of many effects some would be vetoed by chance."""
        larger, smaller = (self.folds.test(self.search.fits[names])[0] for names in (found, rest))
        return compared(larger, smaller, np.full(2, np.inf))

    def compared(self, larger: Tested, smaller: Tested) -> PairedComparison:
        """The PairedComparison of two hypotheses, by what matters here."""
        return compared(larger, smaller, self.matters)

    def _change(self, before: _core.Model, after: _core.Model) -> horizon.PredictionChange:
        """By how much the poses differ that two models predict."""
        return horizon.change(self.runs, self.starts.windows, self.prediction_time, (before, after))

    def matter(self, before: _core.Model, after: _core.Model) -> bool:
        """Whether the poses that two models predict differ by what matters."""
        change = self._change(before, after)
        return bool(change.position_mm >= self.matters[0] or change.heading_deg >= self.matters[1])

    def _leave_out(self, found: FrozenSet[str], name: str, why: str) -> FrozenSet[str]:
        """The set without an effect; keeps why. An effect may be refused several times: the last reason
        counts."""
        rest, change = self.search.without(found, name), None
        if why == SLIGHT:
            larger, smaller = self.search.fits[found], self.search.fits[rest]
            change, self.fuller[smaller] = self._change(smaller.model, larger.model), larger
        self.dropped = [d for d in self.dropped if d.trial.name != name]
        self.dropped.append(Dropped(self.trial_in(found, name), why, change))
        self.work.note("%s is left out: %s" % (name, why))
        return rest

    def _without_stand_ins(self, found: FrozenSet[str]) -> FrozenSet[str]:
        """The set without effects that only imitate what has no name: those that do nothing beside a
        formula for it, or all, if a formula alone is likelier than they are."""
        if not found or not self.ceiling_of(found).said:
            return found
        named = self.formula_of(found)
        if named is None:
            alone, best = self.formula_of(frozenset()), self.search.fits[found].log_posterior
            if alone is None or 2 * (alone.fit.log_posterior - best) < chi_squared_limit(LEVEL, 1):
                return found
            for name in sorted(found):
                why = "a formula without it is likelier (%s)" % alone.means
                found = self._leave_out(found, name, why)
            return found
        rest, fit = found, named.fit
        for name in sorted(found, key=lambda n: self.search.ratio(found, found - {n})):
            if not self.search.may_go(fit, name):
                continue
            model = fit.model.copy()
            model.remove_effect(name)
            free = tuple(p for p in fit.free if p.split(".")[0] != name)
            try:
                without = self.likelihood.fit(model, free, near=fit)
            except Diverged:  # the motion is not finite without it
                continue
            if 2 * (fit.log_posterior - without.log_posterior) < self.search.threshold(name):
                rest = self._leave_out(rest, name, "it imitates what has no name (%s)" % named.means)
                fit = without
        return rest

    def _order(self, found: FrozenSet[str]) -> None:
        """Orders the effects into steps, from the last to the first: the effect that the set can
        best do without comes last. A forward order would put too early an effect that
        matters only beside another one."""
        path: List[str] = []
        current = found
        while current:
            name = min(sorted(current), key=self.search.fits[current].ratio_without)
            path.insert(0, name)
            current = self.search.without(current, name)
        self.chosen = [self.search.candidates[name] for name in path]
        for i, name in enumerate(path):
            judged, rest = self.judge(frozenset(path[: i + 1])), self.search.without(found, name)
            chance, confirmed = self.trial_in(found, name).p_value, self.confirmed(found, rest)
            self.steps.append(Step(name, judged, (name,), self.search.fits[rest], chance, confirmed))
            self.work.step()
            self.work.note("%s: error on held-out runs %.3f" % (name, float(judged.heldout.sum())))

    def _mark_equals(self) -> None:
        """Groups each chosen effect with those that the data cannot distinguish from it."""
        for i, step in enumerate(self.steps):
            self.steps[i] = replace(step, group=(step.added, *self.search.rivals(self.names, step.added)))
            self.work.step()
        self.tried = evidence.ranked(self.tried, self.steps[0].group if self.steps else ())

    # In the place of what the likelihood prefers

    def grow_by_simulation(self, why: str) -> bool:
        """Replaces the effects that were found by those that lower the simulation error on held-out data;
        whether there are any. why: they are replaced."""

        def helps(larger: window_error.WindowFit, smaller: window_error.WindowFit) -> PairedComparison:
            return self.compared(*(self.tested(self.fitter, one) for one in (larger, smaller)))

        search = SimulationSearch(
            self.fitter, self.given, self.candidates, helps, self.matter, self.each, self.work
        )
        steps, fits = [], {}
        with self.work.stage("searching by simulation error", len(self.candidates)):
            try:
                added = search.run()
                whole = frozenset(added)
                for i, name in enumerate(added):
                    names, rest = frozenset(added[: i + 1]), whole - {name}
                    fits[names] = self._beside(search.fit(names))
                    judged = self.folds.judge_simulated(fits[names], search.fit(names))
                    chance = search.chance(whole, rest)
                    confirmed = helps(search.fit(whole), search.fit(rest))
                    without = self._beside(search.fit(rest))
                    steps.append(Step(name, judged, (name,), without, chance, confirmed))
            except Diverged:  # a motion is not finite
                return False
        if not added:
            return False
        self.dropped = [dropped for dropped in self.dropped if dropped.trial.name not in added]
        for name in sorted(self.names.difference(added)):
            self._leave_out(self.names, name, why)
        self.tried = evidence.ranked(self.tried, added[:1])
        self.steps, self.chosen = steps, [self.search.candidates[name] for name in added]
        self.search.fits.update(fits)
        self.judged.update(zip(fits.values(), [step.fit for step in steps]))
        return True

    def tested(self, fitter: window_error.WindowFitter, found: window_error.WindowFit) -> Tested:
        """What a model predicts that was fitted by simulation error, each part by a fit to the others."""
        models = fitter.models_at(found, self.starts.windows)
        return Tested(self.starts.errors(self.runs, models), self.folds.start_of)

    def withdraw(self, why: str) -> None:
        """Takes all effects out of the grown model."""
        for name in sorted(self.names):
            self._leave_out(self.names, name, why)
        self.chosen, self.steps = [], []

    def _beside(self, fitted: window_error.WindowFit) -> LikelihoodFit:
        """The likeliest levels beside a model that was fitted by simulation error."""
        return self.likelihood.fit(fitted.model, (), near=self.search.fits[frozenset()])

    # Single effects added to the nominal model

    def trials(self) -> List[evidence.Trial]:
        """Trials of all effects, each added to the nominal model, best first."""
        tests, found = self.search.test_beside(frozenset()), []
        for candidate in self.candidates:
            name, names = candidate.name, frozenset([candidate.name])
            if names in self.search.fits:
                found.append(self.trial_in(names, name))
            else:
                gain, step = tests.test((name,))
                model = candidate.neutral(self.nominal.model)
                parameters = tests.estimates(model, name, step)
                found.append(evidence.trial(name, model, parameters, gain, self.samples))
        return sorted(found, key=lambda t: t.delta_bic)

    def trial_in(self, found: FrozenSet[str], name: str) -> evidence.Trial:
        """The Trial of an effect of a fitted set against the set without it."""
        fit, gain = self.search.fits[found], self.search.ratio(found, found - {name})
        parameters = [p for p in fit.parameters if p["name"].split(".")[0] == name]
        return evidence.trial(name, fit.model, parameters, gain, self.samples)

    def prediction_with(self, trial: evidence.Trial) -> Optional[horizon.PoseError]:
        """How far predicted poses are off of the nominal model with a Trial's effect, on the runs fitted to;
        None if it was not refitted, or runs are too short."""
        fit = self.search.fits.get(frozenset([trial.name]))
        return self.prediction_of(fit.model) if fit else None

    def prediction_of(self, model: _core.Model) -> Optional[horizon.PoseError]:
        """How far predicted poses of a model are off on the runs fitted to; None if runs are too short."""
        count = len(self.starts.windows)
        return horizon.PoseError.of(self.starts.errors(self.runs, [model] * count)) if count else None

    def judged_of(self, trial: evidence.Trial) -> Optional[folds.Judged]:
        """folds.Judged of the nominal model with a Trial's effect; None if it was not refitted."""
        names = frozenset([trial.name])
        return self.judge(names) if names in self.search.fits else None

    # Effects that these runs cannot show

    def unseen(self) -> List[LookAlike]:
        """Effects that are neither in the grown model nor in a group, and that these runs could
        not show."""
        found = self.each(lambda name: self.search.look_alike(self.names, name), self.hidden_names())
        return [f for f in found if f]

    def hidden_names(self) -> List[str]:
        """Effects in no group that to first order equal a change of the grown model's parameters."""
        known = self.names.union(*(step.group for step in self.steps))
        tests = self.search.test_beside(self.names)
        return [n for n in tests.columns if n not in known and tests.seen(n) < UNSEEN]
