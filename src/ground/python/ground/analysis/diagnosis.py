"""Which physical effect is missing in a model.

A search (ground.analysis.search) finds the set of effects under which the recorded poses are
likeliest; a random disturbance is part of the model. Each effect also has to raise the likelihood
of held-out data (ground.analysis.held_out), must not raise the error there, and has to be large
enough to matter. The last step measures what the grown model leaves (ground.analysis.ceiling).
"""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Dict, FrozenSet, List, Optional, Sequence, Tuple

from ground import _core
from ground.analysis import (
    ceiling,
    held_out,
    horizon,
    look_alikes,
    memory,
    naming,
    stages,
    study,
    trials,
    varying,
)
from ground.analysis.candidates import Candidate
from ground.analysis.criteria import Criteria
from ground.analysis.likelihood import Fit, Likelihood
from ground.analysis.refits import Fitting
from ground.analysis.score_tests import UNSEEN, ScoreTests
from ground.analysis.search import Search
from ground.analysis.trials import Dropped
from ground.annotations import Document, Each
from ground.progress import Work

# An effect matters if it moves the predicted pose at the horizon by this multiple of the noise of a
# pose: one that the eye sees in the poses without statistics (Rose's criterion). More data make an
# effect more certain, not larger. For a palm-sized hovercraft a delay of 1.4 ms reaches it.
MIN_CHANGE = 5.0
# Multiple of the significant log-likelihood ratio from which an effect is certain even if a quarter of the
# poses only were independent.
CERTAIN = 4.0
MIN_SHARE_RAISED = 0.75  # share of the held-out parts that memory has to make likelier
WAITING_THREADS = 4  # threads that submit work to the pool and wait for it
MAX_REPEATS = 3  # repetitions of the search because other differences between runs were found


@dataclass(frozen=True)
class Step:
    """An effect that was added."""

    added: str
    fit: held_out.Judged  # the model with the effect, fitted and judged
    group: Tuple[str, ...]  # effects that the data cannot distinguish from it, itself first


class Diagnosis:
    """A model compared with runs, and grown by the missing effects.

    runs: _core.RunData to fit to; candidates: effects to try; budget: how many of them are
    refitted in a step, best by score test first (None: as Criteria say); threads: 0 for all
    cores; work: told of what is done; most: largest number of windows over which the error is taken;
    each: maps pieces of work, which can be pickled, over items (None: in the threads).
    """

    def __init__(
        self,
        runs: Sequence[_core.RunData],
        model: _core.Model,
        candidates: List[Candidate],
        budget: Optional[int] = None,
        threads: int = 0,
        work: Optional[Work] = None,
        most: float = study.MAX_WINDOWS,
        each: Optional[Each] = None,
    ) -> None:
        self.runs = runs
        self.given = model
        self.candidates = candidates
        self.budget = budget
        self.work = work or Work()
        # A fit alone uses all cores; fits beside each other share them.
        self.threads = 1 if threads else 0
        count = threads or len(os.sched_getaffinity(0))
        self.pool = ThreadPoolExecutor(count)
        # A thread of the pool that waited for the pool would block it.
        self.waiting = ThreadPoolExecutor(WAITING_THREADS if count > 1 else 1)
        self.each: Each = each or self.pool.map
        # The same for pieces of work that map over others themselves, and for these.
        self.each_of_many: Each = each or self.waiting.map
        self.inside: Each = map
        if each is None:
            self.inside = self.pool.map
        self.study = study.Study(runs, threads=1, most=most)
        self.cut = self.study.windows
        self.samples = 3 * sum(len(run.times) for run in runs)
        self.chosen: List[Candidate] = []  # in the order of their choice
        self.steps: List[Step] = []
        self.dropped: List[Dropped] = []
        # effect that the likelihood prefers and that is too small to matter
        self.slight: Optional[trials.Trial] = None
        self.slight_sets: Tuple[FrozenSet[str], ...] = ()  # the sets with and without it
        self.tried: List[trials.Trial] = []  # each effect added to the nominal model, best first
        self.memory: Optional[memory.Memory] = None  # added to the grown model
        self.ceilings: Dict[FrozenSet[str], ceiling.Ceiling] = {}  # by set of effects, slight ones too
        self.formulas: Dict[FrozenSet[str], Optional[naming.Formula]] = {}  # by set of effects
        with self.work.stage(stages.FITTING):
            # everything that may differ between runs does
            self.varied = Likelihood(runs, model, threads=self.threads)
            fit = self.varied.fit(model, study.free_parameters(model))
            self._begin(varying.differences(self.varied, fit), fit)

    def _begin(self, differences: Sequence[varying.Difference], near: Fit) -> None:
        """Starts a search in which the differences between runs are random effects."""
        self.differences = differences
        levels = [d.kind.level for d in differences]
        self.likelihood = Likelihood(self.runs, self.given, levels, self.threads)
        self.folds = held_out.Folds(self.runs, self.likelihood, self.given, self.cut, self.each)
        self.study.part_of = self.folds.fold_of
        fitting = Fitting(
            self.likelihood,
            self.given,
            study.free_parameters,
            {candidate.name: candidate for candidate in self.candidates},
            Criteria() if self.budget is None else Criteria(refitted=self.budget),
        )
        self.search = Search(
            fitting,
            self.each,
            self.work,
            lambda better, current: self._refuted(better, current) is None,
        )
        self.judged: Dict[FrozenSet[str], held_out.Judged] = {}  # by set of effects
        self.search.nominal(near)
        self.nominal = self.judge(frozenset())

    @cached_property
    def prediction_time(self) -> float:
        """Time over which poses are predicted with any of the models [s]."""
        return horizon.horizon(self.runs, self.given)

    @cached_property
    def starts(self) -> List[_core.Window]:
        """Where these predictions start (horizon.starts)."""
        return horizon.starts(self.runs, self.prediction_time)

    @property
    def names(self) -> FrozenSet[str]:
        """The set of effects that were chosen."""
        return frozenset(c.name for c in self.chosen)

    @property
    def fit(self) -> Fit:
        """likelihood.Fit of the grown model."""
        return self.search.fits[self.names]

    @property
    def model(self) -> _core.Model:
        """The grown model."""
        return self.fit.model

    @property
    def best(self) -> held_out.Judged:
        """held_out.Judged of the grown model."""
        return self.judged[self.names]

    def ceiling_of(self, found: Optional[FrozenSet[str]] = None) -> ceiling.Ceiling:
        """ceiling.Ceiling of a set of effects that was fitted (default: of the grown model), with an
        effect that is too small to matter."""
        names = self.names if found is None else found
        fullest = names
        if self.slight and self.slight_sets[1] == names:
            fullest = self.slight_sets[0]
        if fullest not in self.ceilings:
            fit, before = self.search.fits[fullest], self.search.fits[frozenset()].model
            self.ceilings[fullest] = ceiling.ceiling(self.likelihood, fit, self.runs, self.cut, before)
        return self.ceilings[fullest]

    def formula_of(self, names: FrozenSet[str]) -> Optional[naming.Formula]:
        """naming.Formula of what a set of effects that was fitted leaves; None if nothing has one."""
        if names not in self.formulas:
            left = self.ceiling_of(names)
            self.formulas[names] = None
            if left.found is not None:
                fit, regression = self.search.fits[names], left.found.regression
                self.formulas[names] = naming.formula(self.likelihood, fit, regression)
        return self.formulas[names]

    def judge(self, names: FrozenSet[str]) -> held_out.Judged:
        """held_out.Judged of a set of effects that was fitted."""
        if names not in self.judged:
            self.judged[names] = self.folds.judge(self.search.fits[names])
        return self.judged[names]

    def grow(self) -> None:
        """Adds the effects that earn their place."""
        with self.work.stage(stages.SEARCHING):
            found = self._likeliest_set()
        self.tried = self._trials()
        for better in self.search.refused(found):
            for name in sorted(better - found):
                why = self._refuted(better, found)
                if why:
                    self._drop(better, name, why)
        with self.work.stage(stages.TESTING):
            found = self._without_refuted(found)
        with self.work.stage(stages.REMEMBERING):
            found = self._without_stand_ins(self._with_memory(found))
        with self.work.stage(stages.ORDERING, len(found)):
            self._order(found)
        with self.work.stage(stages.RIVALS, len(found)):
            self._mark_equals()

    def _likeliest_set(self) -> FrozenSet[str]:
        """The likeliest set of effects. Differences between runs are tested again with it: a
        missing effect may have imitated or hidden them."""
        found = self.search.run()
        for _ in range(MAX_REPEATS):
            # Refused sets count, too: they may have been refused only because held-out runs were
            # predicted without the difference.
            likeliest = max([found, *self.search.refused(found)], key=self.search.value)
            fit = self.search.fits[likeliest]
            differences = varying.differences(self.varied, fit)
            same = {d.kind for d in differences} == {d.kind for d in self.differences}
            if same:
                self.differences = differences
                return found
            names = [d.kind.parameter for d in differences]
            self.work.note("differs between runs: %s" % (", ".join(names) or "nothing"))
            self._begin(differences, self.search.nominal())
            found = self.search.run(near=fit)
        return found

    # Which of the effects found are kept

    def _without_refuted(self, found: FrozenSet[str]) -> FrozenSet[str]:
        """The set without effects that held-out data refute or that do not matter."""
        while found:
            names = sorted(found)
            self.judge(found)
            self.search.without_each(found, names)
            objections = list(
                self.waiting.map(lambda name, found=found: self._objection(found, name), names)
            )
            refused = [(name, why) for name, why in zip(names, objections) if why]
            if not refused:
                return found
            name, why = min(refused, key=lambda r: self.search.ratio(found, found - {r[0]}))
            self._drop(found, name, why)
            found = found - {name}
        return found

    def _objection(self, found: FrozenSet[str], name: str) -> Optional[str]:
        """Reason to leave an effect out of a set; None without one."""
        rest = self.search.without(found, name)
        why = self._refuted(found, rest)
        self.work.step()
        return why if why or self._matters(found, rest) else "slight"

    def _refuted(self, found: FrozenSet[str], rest: FrozenSet[str]) -> Optional[str]:
        """Reason why held-out data speak against a set and for a smaller one; None if they do not.
        Effects that are certain without them need not be confirmed by them."""
        verdict = self.confirmed(found, rest).verdict
        if verdict == held_out.WORSE:
            return "it makes predictions of runs that it was not fitted to worse"
        enough = CERTAIN * sum(self.search.threshold(name) for name in found - rest)
        if verdict == held_out.BETTER or self.search.ratio(found, rest) >= enough:
            return None
        return "it does not make runs that it was not fitted to likelier"

    def confirmed(self, found: FrozenSet[str], rest: FrozenSet[str]) -> held_out.Comparison:
        """A set compared with a smaller one on parts of the runs that neither was fitted to."""
        return held_out.compared(self.judge(found).tested, self.judge(rest).tested)

    def _matters(self, found: FrozenSet[str], rest: FrozenSet[str]) -> bool:
        """Whether an effect changes predicted poses by more than their noise hides. On long runs the
        likelihood detects a millisecond of network latency as a delay."""
        return self._larger(self.search.fits[found], self.search.fits[rest])

    def _larger(self, with_it: Fit, without: Fit) -> bool:
        """Whether a Fit changes predicted poses by more than their noise hides."""
        return self._change(with_it, without).relative >= MIN_CHANGE

    def _change(self, with_it: Fit, without: Fit) -> horizon.Change:
        """By how much a Fit changes predicted poses."""
        models = (without.model, with_it.model)
        return horizon.change(self.runs, self.starts, self.prediction_time, models)

    def _drop(self, found: FrozenSet[str], name: str, why: str) -> None:
        self.search.without(found, name)
        trial = self.trial_in(found, name)
        if why == "slight":
            fits = self.search.fits
            self.slight = replace(trial, change=self._change(fits[found], fits[found - {name}]))
            self.slight_sets = found, found - {name}
        else:
            # An effect may be refused several times, in different sets: the last reason counts.
            self.dropped = [d for d in self.dropped if d.trial.name != name]
            self.dropped.append(Dropped(trial, why))
        reason = "it is too small to matter" if why == "slight" else why
        self.work.note("%s is left out: %s" % (name, reason))

    def _with_memory(self, found: FrozenSet[str]) -> FrozenSet[str]:
        """Searches for memory; the set without effects that only imitated it."""
        fit, left = self.search.fits[found], self.ceiling_of(found)
        if not left.may_remember:
            return found
        remembered = memory.find(self.likelihood, fit)
        if remembered is None:
            return found
        why = "it imitates a dependence on the past (%s)" % remembered.kind.name
        rest, fit, stand_ins = self._without_imitators(found, remembered.fit, why)
        remembered = replace(remembered, fit=fit)
        # A single part may differ from all others, for example in its lift.
        share = held_out.share_raised(self.folds.judge(remembered.fit), self.judge(rest))
        if share < MIN_SHARE_RAISED or not self._larger(remembered.fit, self.search.fits[rest]):
            return found
        self.work.note("%s: %s" % (remembered.kind.name, remembered.means))
        self.memory, self.dropped = remembered, self.dropped + stand_ins
        # Others may have been of use only beside those, or beside the memory.
        return self._without_refuted(rest) if stand_ins else rest

    def _without_stand_ins(self, found: FrozenSet[str]) -> FrozenSet[str]:
        """The set without effects that only imitate what has no name: those that do nothing beside a
        formula for it."""
        left = self.ceiling_of(found)
        if not found or self.memory is not None or not left.said or left.found is None:
            return found
        named = self.formula_of(found)
        if named is None:
            return found
        why = "it imitates what has no name (%s)" % named.means
        rest, _, imitators = self._without_imitators(found, named.fit, why)
        self.dropped += imitators
        return rest

    def _without_imitators(
        self, found: FrozenSet[str], fit: Fit, why: str
    ) -> Tuple[FrozenSet[str], Fit, List[Dropped]]:
        """A set without effects that do nothing beside what else a Fit has, that Fit without them, and
        these effects."""
        rest, imitators = found, []
        for name in sorted(found, key=lambda n: self.search.ratio(found, found - {n})):
            if not self.search.may_go(fit, name):
                continue
            model = fit.model.copy()
            model.remove_effect(name)
            free = tuple(p for p in fit.free if p.split(".")[0] != name)
            without = self.likelihood.fit(model, free, near=fit)
            if 2 * (fit.log_posterior - without.log_posterior) < self.search.threshold(name):
                smaller = self.search.without(rest, name)
                imitators.append(Dropped(self.trial_in(rest, name), why))
                rest, fit = smaller, without
        return rest, fit, imitators

    def _order(self, found: FrozenSet[str]) -> None:
        """Orders the effects into steps, from the last to the first: the effect that the set can
        best do without comes last. A forward order would put too early an effect that
        matters only beside another one."""
        path: List[str] = []
        current = found
        while current:
            fit = self.search.fits[current]
            name = min(sorted(current), key=fit.ratio_without)
            path.insert(0, name)
            current = self.search.without(current, name)
        for name in path:
            self.chosen.append(self.search.candidates[name])
            judged = self.judge(self.names)
            self.steps.append(Step(name, judged, (name,)))
            self.work.step()
            self.work.note("%s: error on held-out runs %.3f" % (name, float(judged.heldout.sum())))

    def _mark_equals(self) -> None:
        """Groups each chosen effect with those that the data cannot distinguish from it."""
        def rivals_of(step: Step) -> List[str]:
            found = self.search.rivals(self.names, step.added)
            self.work.step()
            return found

        rivals = self.waiting.map(rivals_of, self.steps)
        self.steps = [
            replace(step, group=(step.added, *names)) for step, names in zip(self.steps, rivals)
        ]
        first = self.steps[0].group if self.steps else ()
        refitted = [t.name for t in self.tried if t.refitted]
        values = {name: self.search.value(frozenset([name])) for name in refitted}
        self.tried = trials.ranked(self.tried, first, values)

    # Single effects added to the nominal model

    def _trials(self) -> List[trials.Trial]:
        """Trials of all effects, each added to the nominal model, best first."""
        tests = self.search.test_beside(frozenset())
        found = [self._trial(c, tests) for c in self.candidates]
        if self.budget is not None:
            found = [t for t in found if t.refitted] or found
            found = sorted(found, key=lambda t: -t.gain)[: self.budget]
        return sorted(found, key=lambda t: t.delta_bic)

    def _trial(self, candidate: Candidate, tests: ScoreTests) -> trials.Trial:
        name, names = candidate.name, frozenset([candidate.name])
        if names in self.search.fits:
            return self.trial_in(names, name)
        gain, step = tests.test((name,))
        model = candidate.neutral(self.search.fits[frozenset()].model)
        parameters = tests.estimates(model, name, step)
        return self._as_trial(name, model, parameters, gain, tests.seen(name) > UNSEEN, False)

    def trial_in(self, found: FrozenSet[str], name: str) -> trials.Trial:
        """The Trial of an effect of a fitted set against the set without it."""
        fit = self.search.fits[found]
        parameters = [p for p in fit.parameters if p["name"].split(".")[0] == name]
        seen = any(p["identified"] for p in parameters)
        return self._as_trial(
            name, fit.model, parameters, self.search.ratio(found, found - {name}), seen, True
        )

    def _as_trial(
        self,
        name: str,
        model: _core.Model,
        parameters: Sequence[Document],
        gain: float,
        seen: bool,
        refitted: bool,
    ) -> trials.Trial:
        tried = len(self.candidates)
        return trials.trial(name, model, parameters, gain, seen, refitted, tried, self.samples)

    def judged_of(self, trial: trials.Trial) -> Optional[held_out.Judged]:
        """held_out.Judged of the nominal model with a Trial's effect; None if it was not refitted."""
        names = frozenset([trial.name])
        return self.judge(names) if names in self.search.fits else None

    # Effects that these runs cannot show

    def unseen(self) -> List[look_alikes.LookAlike]:
        """Effects that are neither in the grown model nor in a group, and that these runs could
        not show: a list of look_alikes.LookAlikes."""
        found = self.pool.map(
            lambda name: look_alikes.look_alike(self.search, self.names, name), self.hidden_names()
        )
        return [f for f in found if f]

    def hidden_names(self) -> List[str]:
        """Effects in no group that to first order equal a change of the grown model's parameters."""
        known = self.names.union(*(step.group for step in self.steps))
        return look_alikes.names(self.search, self.names, known)
