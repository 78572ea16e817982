"""Which physical effect a model lacks.

A set of effects is sought by which the recorded poses are likeliest, a random disturbance being
part of the model (ground.analysis.search). Each effect has to raise the likelihood of what it
was not fitted to as well (ground.analysis.held_out), must not raise the error there, and has to
be large enough to matter. What the grown model leaves is looked at last
(ground.analysis.remains).
"""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any, List

import numpy as np
from scipy import stats

from ground.analysis import bands, budget, candidates as effects, held_out, memory, remains
from ground.analysis import study, varying
from ground.analysis.likelihood import Likelihood
from ground.analysis.score_tests import UNSEEN, stepped
from ground.analysis.search import Criteria, Search
from ground.analysis.unfinished import Unfinished
from ground.errors import IdentifyError
from ground.recordings import windows

EXPLAINED = 1.15  # of the noise floor: a model with such an error explains the data
# An effect that the likelihood sees matters from one of these sizes on; more data make it more
# certain, not larger. Its change of the motion, in parts of what the poses' noise leaves ...
MIN_INFLUENCE = 0.3
# ... and the part of the poses' noise power that it accounts for: 0.06 for a delay of 1 ms in a
# PRBS, 0.14 for a force of 1% of full thrust.
MIN_NOISE_POWER = 0.08
SIZES = (1.0, 0.5, 0.25, 0.1, -1.0, -0.5, -0.25, -0.1)  # of an effect's typical one
SETTLED = 0.1  # log-likelihood by which models with and without may differ and do the same
MOVED = 0.05  # of its value: a parameter that takes over what an effect does
REFUSED = "it raises the error on the runs held out"
MOST = 0.75  # least share of the held-out parts that memory has to make likelier
ROUNDS = 3  # most searches: each one is repeated when what differs between runs has changed
FLOORS = 5  # simulations that the noise floor is the mean of


@dataclass
class Trial:
    """An effect beside the nominal model."""

    name: str
    model: Any  # _core.Model; refitted, or moved by one step of the score test
    parameters: List[dict]  # of the effect: name, unit, value, ci95, identified
    gain: float  # log-likelihood ratio 2 (L1 - L0) against the model without
    p_value: float  # of this effect alone
    chance: float  # the same, corrected for the number of effects tried
    delta_bic: float
    seen: bool  # whether it does anything that the model without cannot take over
    refitted: bool
    equal: bool = False  # to the best one, as far as the data tell
    inclusion: float = 0.0
    fit: Any = None  # held_out.Judged
    influence: float = None  # change of the motion by it, in parts of what the poses' noise leaves


@dataclass
class Dropped:
    """An effect that the likelihood asks for and that was not added."""

    trial: Trial
    why: str


@dataclass
class Conclusion:
    """What a diagnosis comes to."""

    verdict: str  # complete, missing, varies, memory or unexplained
    improved: Any  # _core.Model, refitted
    parameters: List[dict]  # of the improved model: name, unit, value, ci95, ...
    noise_floor: float
    heldout: List[float]  # error on held-out runs: nominal, then after each step
    nested: float  # the last of these by folds in which the choice was made again
    heldout_floor: float  # noise floor of the runs that those are of
    varies: List[dict] = field(default_factory=list)  # what differs between runs
    memory: Any = None  # memory.Memory
    history: Any = None  # remains.Remains
    state: Any = None  # remains.Remains
    budget: Any = None  # budget.Budget
    bands: Any = ()  # bands.Bands of the grown model, one of each run held out


class Diagnosis:
    """A model held against runs, grown by the effects that it lacks.

    runs: _core.RunData to fit to; candidates: effects to try; budget: how many of them are
    refitted in a step, best by score test first (None: as Criteria say); threads: 0 for all
    cores; progress: called with a sentence now and then; kept: Unfinished, of this very work;
    most: windows of the error.
    """

    def __init__(
        self,
        runs,
        model,
        candidates,
        budget=None,
        threads=0,
        progress=None,
        kept=None,
        most=study.MAX_WINDOWS,
    ):
        self.runs = runs
        self.given = model
        self.candidates = candidates
        self.budget = budget
        self.say = progress or (lambda text: None)
        self.kept = kept or Unfinished()
        self.pool = ThreadPoolExecutor(threads or os.cpu_count())
        self.study = study.Study(runs, threads=1, most=most)
        self.cut = self.study.windows
        self.samples = 3 * sum(len(run.times) for run in runs)
        self.chosen = []  # Candidates, in the order of their choice
        self.steps = []
        self.dropped = []
        self.slight = None  # Trial that the poses prefer and that is too small to matter
        self.slight_sets = None  # of effects, with it and without
        self.tried = []
        self.memory = None  # memory.Memory beside the grown model
        self.say("fitting %s as it is" % model.name)
        self.varied = Likelihood(runs, model)  # with all that may differ between runs
        fit = self.varied.fit(model, study.free_parameters(model))
        self._begin(varying.differences(self.varied, fit), fit)

    def _begin(self, differences, near):
        """Starts a search that has what differs between runs as random effects."""
        self.differences = differences
        levels = [d.kind.level for d in differences]
        self.likelihood = Likelihood(self.runs, self.given, levels)
        self.folds = held_out.Folds(self.runs, self.likelihood, self.given, self.cut, self.pool.map)
        self.search = Search(
            self.likelihood,
            self.given,
            study.free_parameters,
            self.candidates,
            Criteria() if self.budget is None else Criteria(refitted=self.budget),
            self.pool.map,
            self.say,
            self.kept,
            lambda better, current: self._refuted(better, current) is None,
        )
        self.judged = {}  # by set of effects
        self.search.nominal(near)
        self.nominal = self.judge(frozenset())

    @property
    def names(self):
        """The set of effects that were chosen."""
        return frozenset(c.name for c in self.chosen)

    @property
    def fit(self):
        """likelihood.Fit of the grown model."""
        return self.search.fits[self.names]

    @property
    def model(self):
        return self.fit.model

    @property
    def best(self):
        """held_out.Judged of the grown model."""
        return self.judged[self.names]

    def judge(self, names):
        """held_out.Judged of a set of effects that was fitted."""
        if names not in self.judged:
            fit = self.search.fits[names]
            what = ("judged", sorted(self.likelihood.varying), sorted(names), fit.model.format())
            self.judged[names] = self.kept.result(what, lambda: self.folds.judge(fit))
        return self.judged[names]

    def grow(self):
        """Adds the effects that earn their place."""
        found = self._found()
        self.tried = [self._trials()]
        for better in self.search.refused(found):
            for name in sorted(better - found):
                self._drop(better, name, self._refuted(better, found))
        found = self._deserving(found)
        found = self._remembering(found)
        self._order(found)
        self._mark_equals()

    def _found(self):
        """The likeliest set of effects. What differs between runs is tested again beside it: a
        missing effect may have looked like it, or hidden it."""
        found = self.search.run()
        for _ in range(ROUNDS):
            fit = self.search.fits[found]
            differences = varying.differences(self.varied, fit)
            same = {d.kind for d in differences} == {d.kind for d in self.differences}
            if same:
                self.differences = differences
                return found
            names = [d.kind.parameter for d in differences]
            self.say("between runs differs: %s" % (", ".join(names) or "nothing"))
            self._begin(differences, self.search.nominal())
            found = self.search.run(near=fit)
        return found

    # --- Which of the effects found earn their place

    def _deserving(self, found):
        """The set without effects that do not hold on what they were not fitted to, or do not
        matter."""
        while found:
            worst = None
            for name in sorted(found):
                why = self._objection(found, name)
                ratio = self.search.ratio(found, found - {name})
                if why and (worst is None or ratio < worst[0]):
                    worst = ratio, name, why
            if worst is None:
                return found
            _, name, why = worst
            self._drop(found, name, why)
            found = found - {name}
        return found

    def _objection(self, found, name):
        """What speaks against an effect of a set; None if nothing does."""
        rest = self.search.without(found, name)
        why = self._refuted(found, rest)
        return why if why or self._matters(found, rest) else "slight"

    def _refuted(self, found, rest):
        """What runs that they were not fitted to say against a set in the place of a smaller one."""
        with_it, without = self.judge(found), self.judge(rest)
        gain, error = held_out.gain(with_it, without)
        if not gain > error:
            return "it does not make runs that it was not fitted to likelier"
        if with_it.heldout.sum() > without.heldout.sum():
            return "it raises the error on runs that it was not fitted to"
        return None

    def _matters(self, found, rest):
        """Whether an effect changes the motion by what is not lost in the noise of the poses. The
        likelihood of long runs sees a millisecond of a network as a delay."""
        return self._larger(self.search.fits[found], self.search.fits[rest])

    def _larger(self, with_it, without):
        """The same of two Fits."""
        ratio = 2 * (with_it.log_posterior - without.log_posterior)
        return (
            ratio >= MIN_NOISE_POWER * self.samples
            or self._influence(with_it, without) >= MIN_INFLUENCE
        )

    def _influence(self, with_it, without):
        a, b = without.model, with_it.model
        change = study.change(self.runs, self.cut, a, b).sum()
        return float(change / study.noise_floor(self.runs, b).sum())

    def _drop(self, found, name, why):
        self.search.without(found, name)
        trial = self._trial_in(found, name)
        if why == "slight":
            trial.influence = self._influence(
                self.search.fits[found], self.search.fits[found - {name}]
            )
            self.slight, self.slight_sets = trial, (found, found - {name})
        else:
            self.dropped.append(Dropped(trial, why))
        told = "it is too small to matter" if why == "slight" else why
        self.say("%s is left out: %s" % (name, told))

    def _remembering(self, found):
        """The set without effects that only stood for what depends on the past, which is sought
        here."""
        self.say("does the past matter?")
        fit = self.search.fits[found]
        remembered = memory.find(self.likelihood, fit)
        if remembered is None:
            return found
        rest, stand_ins = found, []
        for name in sorted(found, key=lambda n: self.search.ratio(found, found - {n})):
            with_it = remembered.fit
            model = with_it.model.copy()
            model.remove_effect(name)
            free = tuple(p for p in with_it.free if p.split(".")[0] != name)
            without = self.likelihood.fit(model, free, near=with_it)
            if 2 * (with_it.log_posterior - without.log_posterior) < self.search.threshold(name):
                why = "it stands for what depends on the past (%s)" % remembered.kind.name
                smaller = self.search.without(rest, name)
                stand_ins.append(Dropped(self._trial_in(rest, name), why))
                rest, remembered = smaller, replace(remembered, fit=without)
        # One part alone may hold what the others cannot tell, such as a lift of its own.
        share = held_out.share_raised(self.folds.judge(remembered.fit), self.judge(rest))
        if share < MOST or not self._larger(remembered.fit, self.search.fits[rest]):
            return found
        self.say("%s: %s" % (remembered.kind.name, remembered.means))
        self.memory, self.dropped = remembered, self.dropped + stand_ins
        return rest

    def _order(self, found):
        """The steps by which the error falls: what score tests find most promising first."""
        path, current = [], frozenset()
        while current != found:
            tests = self.search.test_beside(current)
            rest = sorted(found - current, key=lambda n: -tests.test((n,))[0])
            grown = ((name, self.search.fitted(current, name)) for name in rest)
            name, current = next((pair for pair in grown if pair[1]), (None, None))
            if name is None:
                break
            path.append(name)
        for name in path:
            self.chosen.append(next(c for c in self.candidates if c.name == name))
            judged = self.judge(self.names)
            self.steps.append({"added": name, "fit": judged, "group": [name]})
            self.say("%s: error on held-out runs %.3f" % (name, float(judged.heldout.sum())))

    def _mark_equals(self):
        """Groups of effects that the data cannot tell from a chosen one."""
        for step in self.steps:
            step["group"] += self.search.rivals(self.names, step["added"])
        first = self.steps[0]["group"] if self.steps else []
        values = {}
        for trial in self.tried[0]:
            trial.equal = trial.name in first
            if trial.refitted:
                values[trial.name] = self.search.value(frozenset([trial.name]))
        best = max(values.values(), default=0.0)
        weights = {n: np.exp(min(0.0, v - best) / 2) for n, v in values.items()}
        for trial in self.tried[0]:
            trial.inclusion = float(
                weights.get(trial.name, 0.0) / max(1e-300, sum(weights.values()))
            )
        self.tried[0].sort(key=lambda t: (t.name not in first[:1], t.delta_bic))

    # --- Effects beside the nominal model

    def _trials(self):
        """Trials of all effects beside the nominal model, best first."""
        tests = self.search.test_beside(frozenset())
        trials = [self._trial(c, tests) for c in self.candidates]
        if self.budget is not None:
            trials = [t for t in trials if t.refitted] or trials
            trials = sorted(trials, key=lambda t: -t.gain)[: self.budget]
        return sorted(trials, key=lambda t: t.delta_bic)

    def _trial(self, candidate, tests):
        name, names = candidate.name, frozenset([candidate.name])
        if names in self.search.fits:
            return self._trial_in(names, name)
        gain, step = tests.test((name,))
        model = candidate.neutral(self.search.fits[frozenset()].model)
        parameters = tests.estimates(model, name, step)
        return self._as_trial(name, model, parameters, gain, tests.seen(name) > UNSEEN, False)

    def _trial_in(self, found, name):
        """The Trial of an effect of a fitted set against the set without it."""
        fit = self.search.fits[found]
        parameters = [p for p in fit.parameters if p["name"].split(".")[0] == name]
        seen = any(p["identified"] for p in parameters)
        return self._as_trial(
            name, fit.model, parameters, self.search.ratio(found, found - {name}), seen, True
        )

    def _as_trial(self, name, model, parameters, gain, seen, refitted):
        described = effects.parameters_of(model, name)
        on_bound = sum(p["neutral"] in (p["lower"], p["upper"]) for p in described)
        chance = p_value(gain, len(described), on_bound)
        bic = len(described) * np.log(self.samples) - gain
        corrected = min(1.0, len(self.candidates) * chance)
        return Trial(name, model, parameters, gain, chance, corrected, float(bic), seen, refitted)

    def judge_all(self, trials):
        """Errors of refitted trials on what they were not fitted to."""
        for trial in trials:
            names = frozenset([trial.name])
            if trial.fit is None and names in self.search.fits:
                trial.fit = self.judge(names)

    # --- Effects that these runs cannot show

    def unseen(self):
        """Effects in no group that the grown model does without and that these runs could not
        show: a list of LookAlikes."""
        return [f for f in self.pool.map(self._look_alike, self.hidden_names()) if f]

    def hidden_names(self):
        """Effects in no group that are, to first order, a change of the grown model's parameters."""
        tests = self.search.test_beside(self.names)
        told = set(self.names) | {n for step in self.steps for n in step["group"]}
        return [n for n in tests.columns if n not in told and tests.seen(n) < UNSEEN]

    def _look_alike(self, name):
        """The grown model with an effect of typical size, or a part of it, and all else
        refitted, if these runs allow it; else None."""
        neutral = self.search.candidates[name].neutral(self.model)
        steps = self.search.test_beside(self.names).in_place(name, 1.0)
        for part in SIZES:
            try:
                model = stepped(neutral, steps, part)
                found = self.likelihood.fit(model, self.fit.free, self.fit, levels=False)
            except IdentifyError:
                continue
            if found.log_posterior > self.fit.log_posterior - SETTLED:
                return LookAlike(name, found, self._moved(found.model))
        return None

    def _moved(self, model):
        """Which of the free parameters differ from those of the grown model, most first."""

        def way(name):
            a, b = self.model.value(name), model.value(name)
            return abs(a - b) / max(abs(a), abs(b)) if a != b else 0.0

        return sorted((n for n in self.fit.free if way(n) > MOVED), key=lambda n: -way(n))

    # --- The end

    def conclude(self, heldout=()):
        """Judges what was found: the verdict, and the model that improves on the given one.

        heldout: _core.RunData of runs to test on; an effect that raises the error there is taken
        out and told. Without any, each run is tested by a fit to the others, or each quarter of
        a single one. Returns a Conclusion.
        """
        self.say("what is left")
        fullest = self._with_slight()
        history = remains.of_history(self.likelihood, fullest)
        state = remains.of_state(self.likelihood, fullest)
        if heldout:
            self._obey(heldout)
        floors = [study.noise_floor(self.runs, self.best.model, seed) for seed in range(FLOORS)]
        floor = float(np.mean([f.sum() for f in floors]))
        reached = float(study.noise_floor(heldout, self.best.model).sum()) if heldout else floor
        varies = self._varies()
        explained = self.best.error.sum() < EXPLAINED * floor
        return Conclusion(
            self._verdict(explained, varies, history, state),
            self.model,
            self.likelihood.intervals(self.fit),
            floor,
            self._held_out(heldout),
            self._nested(heldout),
            reached,
            varies,
            self.memory,
            history,
            state,
            budget.budget(self.runs, self.cut, self.fit),
            self._bands(heldout),
        )

    def _with_slight(self):
        """Fit of the grown model, with what is too small to matter: it is seen all the same."""
        if self.slight and self.slight_sets[1] == self.names:
            return self.search.fits[self.slight_sets[0]]
        return self.fit

    def _nested(self, heldout):
        """Error of windows held out from choice and fit alike: in each fold the choice is made
        again, beginning with the effects found, each of which has to reach the threshold there."""
        if heldout or not self.chosen:
            return self._held_out(heldout)[-1]

        def choose(likelihood):
            search = Search(
                likelihood, self.given, study.free_parameters, self.candidates, self.search.criteria
            )
            search.nominal(replace(self.search.nominal(), loudness=()))
            return search.fits[search.run(near=replace(self.fit, loudness=()))]

        return float(self.folds.nested(choose).sum())

    def _bands(self, heldout):
        if heldout:
            return bands.of_others(heldout, self.fit, len(self.cut), self.pool.map)
        return bands.of_folds(self.folds, self.fit)

    def _varies(self):
        """What differs between runs, as the grown model has it: a list of dictionaries."""
        sizes = np.array([[*trim["wrench"], trim["thrust"]] for trim in self.fit.trims])
        return [
            {
                "parameter": d.kind.parameter,
                "unit": d.kind.unit,
                "deviation": float(np.std(sizes[:, i], ddof=1)),
                "p_value": d.p_value,
                "by_run": sizes[:, i].tolist(),
            }
            for d in self.differences
            for i in [varying.KINDS.index(d.kind)]
        ]

    def _verdict(self, explained, varies, history, state):
        if self.memory or (history.found and history.gain > state.gain):
            return "memory"
        # Effects that only the runs held out speak against leave it open what is missing.
        open_still = not self.chosen and any(d.why == REFUSED for d in self.dropped)
        if not explained and (state.found or open_still):
            return "unexplained"
        if self.chosen:
            return "missing"
        return "varies" if varies else "complete"

    def _obey(self, heldout):
        """Takes out the last effects as long as they raise the error on runs that the user held
        out."""
        while self.chosen:
            errors = self._held_out(heldout)
            if errors[-1] <= min(errors):
                return
            last = self.chosen.pop()
            found = self.names | {last.name}
            self.dropped.append(Dropped(self._trial_in(found, last.name), REFUSED))
            self.steps.pop()

    def _held_out(self, heldout):
        """Errors on runs held out, of the nominal model and after each step."""
        fits = [self.nominal] + [step["fit"] for step in self.steps]
        if not heldout:
            return [float(fit.heldout.sum()) for fit in fits]
        cut = windows.cut(heldout)
        return [float(study.channel_errors(heldout, cut, fit.model).sum()) for fit in fits]


@dataclass
class LookAlike:
    """An effect that on the runs does only what others can do."""

    name: str  # of the effect
    fit: Any  # likelihood.Fit of the grown model with the effect at some size, all else refitted
    moved: List[str]  # parameters that do without what the effect does in this one


def p_value(gain, free, on_bound):
    """Chance of a log-likelihood ratio 2 (L1 - L0) as large as `gain` without the effect. Of
    `free` parameters `on_bound` have their neutral value at a bound: each of those stays there
    half of the time, which makes the ratio a mixture (Self and Liang 1987; binomial weights,
    exact for independent estimates)."""
    if not gain > 0:
        return 1.0
    total = 0.0
    for moved in range(on_bound + 1):
        count = free - on_bound + moved
        if count > 0:
            total += stats.binom.pmf(moved, on_bound, 0.5) * stats.chi2.sf(gain, count)
    return float(total)
