"""Which physical effect a model lacks (DESIGN 7).

Effects are tested and ranked by how likely they make the measured poses (ground.analysis.evidence), and
have to lower the simulation error on runs that they were not fitted to (ground.analysis.study) to be
chosen.
"""
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, List

import numpy as np
from scipy import stats

from ground.analysis import candidates as effects, evidence, study
from ground.analysis.unfinished import Unfinished, can_be_kept
from ground.errors import IdentifyError
from ground.recordings import windows

LEVEL = 0.01  # chance of choosing an effect although none is missing
SCREENED = 1.5  # expected gain for each parameter that makes an effect worth a refit in later steps
UNSEEN = 0.003  # part of its information that is left beside the model's other parameters
RIVALS = 6  # effects that are compared under the levels of the best one
WORTH = 0.2  # of the best one's gain: less does not make a rival
TELLS_APART = 2.0  # standard deviations between rivals that can be told apart
SETTLED = 0.1  # log-likelihood by which one has to be better than the best to take its place
ROUNDS = 3  # at most, of levels by the best trial and ranks by the levels
EXPLAINED = 1.15  # of the noise floor: a model with such an error explains the data
MIN_HELDOUT_GAIN = 0.01  # part of the held-out error by which an effect has to lower it
# Where the data are explained an effect matters from one of these sizes on; more data make it more
# certain, not larger. Its change of the motion, in parts of what the poses' noise leaves ...
MIN_INFLUENCE = 0.3
# ... and the part of the poses' noise power that it accounts for: 0.04 for a delay of 1 ms in a PRBS,
# 0.14 for a force of 1% of full thrust.
MIN_NOISE_POWER = 0.06
FAR_BETTER = 0.8  # of the error: what comes so far below is another minimum
NEARLY = 0.1  # of the fall of the error: rivals that come so near to the best are its equals
FLOORS = 5  # simulations that the noise floor is the mean of
WHITE = 1e-9  # chance of such colour in the residuals of a true model; rejected spikes add some
SIZES = (1.0, 0.5, 0.25, 0.1, -1.0, -0.5, -0.25, -0.1)  # of an effect's typical one
MOVED = 0.05  # of its value: a parameter that takes over what an effect does
RESAMPLES = 500  # of the bootstrap over windows


def mark_equals(trials, before):
    """Says which trials, best first, lower the error by nearly as much as the best one does."""
    best = trials[0].fit
    fall = before.heldout.sum() - best.heldout.sum()
    for trial in trials:
        behind = trial.fit.by_window - best.by_window
        chance = TELLS_APART * behind.std(ddof=1) / np.sqrt(len(behind))
        as_good = behind.mean() <= min(NEARLY * fall, chance)
        # nor do the poses prefer the best by far
        trial.equal = as_good and trial.delta_bic < (1 - NEARLY) * trials[0].delta_bic


def bootstrap(trials, costs):
    """How often each trial would have been the best, had other windows been recorded; costs: of the
    windows under each of them."""
    costs = np.array(costs)
    picks = np.random.default_rng(1).integers(costs.shape[1], size=(RESAMPLES, costs.shape[1]))
    best = costs[:, picks].sum(axis=2).argmin(axis=0)
    for trial, count in zip(trials, np.bincount(best, minlength=len(trials))):
        trial.inclusion = float(count / RESAMPLES)


@can_be_kept
@dataclass
class Trial:
    """An effect in the model, refitted."""

    name: str
    model: Any  # _core.Model
    parameters: List[dict]  # of the effect: name, unit, value, ci95, ...
    screened: dict  # score test: gain, step, inflation, blocks
    gain: float  # log-likelihood ratio 2 (L1 - L0) against the model without
    inflation: float
    chance: float  # p-value, corrected for the number of effects tried
    delta_bic: float
    sought: Any  # _core.Model of least simulation error, where it was sought from several starts
    costs: np.ndarray = None  # of each window under the levels of the best trial
    equal: bool = False  # to the best one, as far as the data tell
    inclusion: float = 0.0
    fit: Any = None  # study.Fit
    influence: float = None  # change of the motion by it, in parts of what the poses' noise leaves

    @property
    def seen(self):
        """Whether the effect does anything that the model without it cannot take over."""
        return self.screened["seen"] > UNSEEN


class Diagnosis:
    """A model held against runs, grown by the effects that it lacks.

    runs: _core.RunData to fit to; candidates: effects to try; budget: how many of them are refitted in
    a step, best by score test first (all for None); threads: 0 for all cores; progress: called with
    a sentence now and then; kept: Unfinished, of this very work; most: windows to look at.
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
        self.chosen = []  # Candidates, in the order of their choice
        self.steps = []
        self.tried = []  # lists of Trials, one a step
        self.slight = None  # Trial that the poses prefer and that is too small to matter
        self.say("fitting %s as it is" % model.name)
        self.nominal = self.study.fit(model, study.free_parameters(model))
        self.best = self.nominal
        self._settle(evidence.Evidence(runs, self.cut), self.nominal.model)

    def grow(self):
        """Adds effects while one earns its place."""
        while self._step():
            self._check_back()

    def _step(self):
        rest = [c for c in self.candidates if c.name not in self.model.effects]
        if not rest:
            return False
        self.explained = self._explains(self.best)
        trials = self._try(rest)
        if not trials:
            return False
        self.tried.append(trials)
        if not self.explained:
            self._judge(trials[:1])
        if self.explained or self._explains(trials[0].fit):
            found = [t for t in trials if t.chance <= LEVEL]
            if found:
                found = self._compare(found)
                self._judge([t for t in found[:1] if t.fit is None])
        else:
            # Where all models are wrong, the likeliest need not be the one that predicts best.
            self._judge(trials[1:], (1 - MIN_HELDOUT_GAIN) * self.best.error.sum())
            for trial in trials:
                if trial.fit is None:
                    trial.chance = 1.0
                    continue
                falls = self.best.by_window - trial.fit.by_window
                by_error = len(trials) * stats.ttest_1samp(falls, 0, alternative="greater").pvalue
                trial.chance = min(1.0, 2 * min(trial.chance, by_error))
            found = [t for t in trials if t.chance <= LEVEL]
            found.sort(key=lambda t: t.fit.heldout.sum())
            if found and self._explains(found[0].fit):
                found = self._compare(found)
            elif found:
                mark_equals(found, self.best)
                bootstrap(found, [t.fit.by_window for t in found])
        trials[:] = found + [t for t in trials if t not in found]
        if not found or not self._earns_its_place(found[0]):
            return False
        self._choose(found[0])
        return True

    def _earns_its_place(self, trial):
        """Whether an effect does better on what was held out: where the data are explained with it, by
        the likelihood of the poses, which sees more than the error does, on windows of every run, and
        with a change of the motion that is not lost in the noise. The likelihood of long runs sees a
        millisecond of a network as a delay; such an effect is there and does not matter.
        """
        if not self._explains(trial.fit):
            limit = (1 - MIN_HELDOUT_GAIN) * self.best.heldout.sum()
            return bool(trial.fit.heldout.sum() < limit)

        def held_out(model):
            parts = [self.cut[i :: study.PARTS] for i in range(study.PARTS)]
            return self.evidence.held_out(model, study.free_parameters(model), parts)

        costs = list(self.pool.map(held_out, (self.model, trial.model)))
        likelier = bool(costs[1] < costs[0])
        change = study.change(self.runs, self.cut, self.best.model, trial.fit.model).sum()
        trial.influence = float(change / study.noise_floor(self.runs, trial.fit.model).sum())
        shows = trial.gain >= MIN_NOISE_POWER * self.evidence.samples
        matters = shows or trial.influence >= MIN_INFLUENCE
        self.slight = trial if likelier and not matters else None
        return likelier and matters

    def _explains(self, fit):
        """Whether the noise of the poses alone leaves as much as the fitted model does. Of all runs: one
        that tells what no other does cannot be foretold from the others."""
        floor = study.noise_floor(self.runs, fit.model).sum()
        return bool(fit.error.sum() < EXPLAINED * floor)

    def _judge(self, trials, below=np.inf):
        """Errors of trials on what they were not fitted to; not of those whose error on the rest is
        not below a bound."""

        def judge(trial):
            free = study.free_parameters(trial.model)
            starts = [m for m in (trial.sought, trial.model) if m is not None]
            if windows.error(self.runs, starts[0], self.cut) > self.best.error.sum():
                # An effect more cannot make it worse: that is another minimum.
                starts.append(effects.carried_over(self.best.model, trial.model))
            return self.study.refit(starts, free, below)

        def judged(trial):
            sought = trial.sought.format() if trial.sought else ""
            what = ("judged", trial.name, trial.model.format(), sought, float(below))
            return self.kept.result(what + self._where(), lambda: judge(trial))

        for trial, fit in zip(trials, self.pool.map(judged, trials)):
            trial.fit = fit
            if (
                fit
                and FAR_BETTER * windows.error(self.runs, trial.model, self.cut) > fit.error.sum()
            ):
                trial.model = fit.model

    def judge_all(self, trials):
        """Errors of all trials of a step on what they were not fitted to."""
        self._judge([t for t in trials if t.fit is None])

    def _settle(self, under, model):
        """Makes a model the current one, with the levels under which it is likeliest."""
        free = study.free_parameters(model)
        self.evidence, self.fitted = under.settle(model, free)
        error = windows.error(self.runs, model, self.cut)
        if windows.error(self.runs, self.fitted["model"], self.cut) * FAR_BETTER > error:
            # The poses would rather have no thrust than one that comes late, say.
            self.evidence = under.levelled(model)
            self.fitted = self.evidence.as_given(model, free)
        self.model = self.fitted["model"]

    def _choose(self, trial):
        self.chosen.append(next(c for c in self.candidates if c.name == trial.name))
        self.best = self.study.adapt(trial.fit.model, study.free_parameters(trial.fit.model))
        self._settle(self.evidence, self.best.model)
        group = [t.name for t in self.tried[-1] if t.equal]
        self.steps.append({"added": trial.name, "fit": self.best, "group": group})
        self.say("%s: error on held-out runs %.3f" % (trial.name, float(self.best.heldout.sum())))

    def _check_back(self):
        """Takes out what later effects have made superfluous."""
        for candidate in self.chosen[:-1]:
            without = self.model.copy()
            without.remove_effect(candidate.name)
            free = study.free_parameters(without)
            costs = self.evidence.fit(without, free, self.fitted["initial"])["costs"]
            trial = self._refit(without, candidate, 1, costs, start=self.model)
            if trial.chance <= LEVEL:
                continue
            fit = self.study.refit([without], study.free_parameters(without))
            if fit.heldout.sum() > self.best.heldout.sum():
                continue
            self.chosen.remove(candidate)
            self.best = fit
            self._settle(self.evidence, fit.model)
            self.steps.append({"removed": candidate.name, "fit": fit, "group": []})
            self.say("%s is not needed any more" % candidate.name)

    def _try(self, rest):
        """Trials of effects, best first."""
        screened, tried = self._screen(rest), len(rest)
        if self.budget is not None:
            rest = sorted(rest, key=lambda c: -screened[c.name]["gain"])[: self.budget]
        if self.chosen:
            rest = [c for c in rest if self._may_matter(c, screened[c.name])]
        self.say("refitting with each of %d effects" % len(rest))

        def attempt(candidate):
            try:
                costs = self.fitted["costs"]
                return self.kept.result(
                    ("trial", candidate.name, tried) + self._where(),
                    lambda: self._refit(
                        self.model, candidate, tried, costs, screened[candidate.name]
                    ),
                )
            except IdentifyError as error:
                self.say("%s could not be tried: %s" % (candidate.name, error))

        trials = [trial for trial in self.pool.map(attempt, rest) if trial]
        trials.sort(key=lambda t: t.delta_bic)
        return trials

    def _where(self):
        """How far it has grown."""
        return (
            self.model.format(),
            self.best.model.format(),
            [c.name for c in self.chosen],
            len(self.steps),
        )

    def _may_matter(self, candidate, screened):
        """Whether a score test leaves a chance that a refit will show an effect. It does not see one
        that is far from neutral or, to first order, does what the model does already."""
        several = len(list(candidate.starts(self.model))) > 1 and not self.explained
        unseen = several or screened["seen"] < UNSEEN
        return unseen or screened["gain"] > SCREENED * len(screened["step"])

    def _screen(self, rest):
        """Score tests of all effects at once, each at its neutral parameters."""
        extended = self.model
        for candidate in rest:
            extended = candidate.neutral(extended)
        free = study.free_parameters(self.model)
        names = [p["name"] for c in rest for p in effects.parameters_of(extended, c.name)]
        scores = self.evidence.scores(extended, free + names, self.fitted["initial"])
        return {
            c.name: scores.test([p["name"] for p in effects.parameters_of(extended, c.name)], free)
            for c in rest
        }

    def _refit(self, model, candidate, tried, without, screened=None, start=None):
        """A candidate's Trial, one of `tried`; `model` is the one without, `without` its costs."""
        under = self.evidence
        nuisance = study.free_parameters(model)
        starts = [start] if start is not None else list(candidate.starts(model))
        free = study.free_parameters(starts[0])
        found, sought = under.fit(starts[0], free, self.fitted["initial"]), None
        if len(starts) > 1 and not self.explained:
            # What was fitted without the effect may be far from what is right with it.
            starts = starts[1:] + [effects.carried_over(self.given, s) for s in starts[1:]]
            starts.sort(key=lambda m: windows.error(self.runs, m, self.cut))
            sought = self.study.search(starts[:1], free)
            other = under.fit(sought, free)
            found = min(found, other, key=lambda f: f["costs"].sum())
        names = [p["name"] for p in effects.parameters_of(found["model"], candidate.name)]
        tested = found["scores"].test(names, nuisance)
        gain = 2 * float((without - found["costs"]).sum())
        on_bound = sum(
            p["neutral"] in (p["lower"], p["upper"])
            for p in effects.parameters_of(found["model"], candidate.name)
        )
        chance = evidence.p_value(
            gain, tested["inflation"], tested["blocks"], len(names), on_bound, len(nuisance)
        )
        effective = under.samples / tested["inflation"]
        return Trial(
            candidate.name,
            found["model"],
            [p for p in found["parameters"] if p["name"] in names],
            screened,
            gain,
            tested["inflation"],
            min(1.0, tried * chance),
            len(names) * np.log(effective) - gain / tested["inflation"],
            sought,
        )

    def _compare(self, trials):
        """Trials, the first of which explains the data, ranked under the levels of the best: those
        see finer differences."""
        first = trials[0]
        least = WORTH * max(t.gain for t in trials)
        rivals = [first] + [t for t in trials[1:] if t.gain > least][: RIVALS - 1]
        ranked = rivals
        for _ in range(ROUNDS):
            best = ranked[0]
            free = study.free_parameters(best.model)
            under, settled = self.evidence.settle(best.model, free)
            names = [p["name"] for p in best.parameters]
            rest = [name for name in free if name not in names]
            inflation = settled["scores"].test(names, rest)["inflation"]
            penalty = 0.5 * np.log(under.samples)

            def refitted(trial):
                return under.fit(trial.model, study.free_parameters(trial.model))

            for trial, found in zip(rivals, self.pool.map(refitted, rivals)):
                trial.model, trial.costs = found["model"], found["costs"]
                names = [p["name"] for p in trial.parameters]
                trial.parameters = [p for p in found["parameters"] if p["name"] in names]
            cost = {t.name: t.costs.sum() + penalty * len(t.parameters) for t in rivals}
            if cost[best.name] <= min(cost.values()) + SETTLED:
                break
            ranked = sorted(rivals, key=lambda t: cost[t.name])
        for trial in ranked:
            # Were the best true, the difference would scatter by the root of twice its mean.
            difference = float((trial.costs - ranked[0].costs).sum())
            trial.equal = np.sqrt(max(0.0, difference) / 2 / inflation) < TELLS_APART
        bootstrap(ranked, [t.costs + penalty * len(t.parameters) / len(t.costs) for t in ranked])
        return ranked + [t for t in trials if t not in ranked]

    def unseen(self):
        """Effects in no group that the grown model does without and that these runs could not show: a
        list of LookAlikes."""
        trials = self.tried[-1] if self.tried else []
        named = {c.name: c for c in self.candidates}
        told = set(self.model.effects) | {t.name for tried in self.tried for t in tried if t.equal}
        unseen = [t for t in trials if not t.seen and t.name not in told]
        found = self.pool.map(self._look_alike, [named[t.name] for t in unseen])
        return [f for f in found if f]

    def _look_alike(self, candidate):
        """The grown model with an effect of typical size, or a part of it, and all else refitted, if
        these runs allow it; else None."""
        free = study.free_parameters(self.model)
        neutral = candidate.neutral(self.model)
        for part in SIZES:
            model = neutral.copy()
            for p in effects.parameters_of(neutral, candidate.name):
                size = part * p["scale"]
                value = 1 / size if np.isinf(p["neutral"]) else p["neutral"] + size
                model.set_value(p["name"], float(np.clip(value, p["lower"], p["upper"])))
            try:
                found = self.evidence.fit(model, free)
            except IdentifyError:
                continue
            behind = found["costs"].sum() - self.fitted["costs"].sum()
            if behind < SETTLED:
                model = found["model"]
                return LookAlike(candidate.name, model, free, self._moved(model, free))
        return None

    def _moved(self, model, free):
        """Which of the free parameters differ from those of the grown model."""

        def way(name):
            a, b = self.model.value(name), model.value(name)
            return abs(a - b) / max(abs(a), abs(b)) if a != b else 0.0

        return sorted((n for n in free if way(n) > MOVED), key=lambda n: -way(n))

    def conclude(self, heldout=()):
        """Judges what was found: the verdict, and the model that improves on the given one.

        heldout: _core.RunData of runs to test on; without any, each run is tested by a fit to the
        others, or each quarter of a single one. Returns a Conclusion.
        """
        floors = [study.noise_floor(self.runs, self.best.model, seed) for seed in range(FLOORS)]
        floors = [float(f.sum()) for f in floors]
        floor, scatter = float(np.mean(floors)), float(np.std(floors, ddof=1))
        error = self.best.error.sum()
        # Colour that leaves the error where the noise puts it is no more than a clock's jitter.
        explained = error < EXPLAINED * floor and (error < floor + scatter or self._is_white())
        verdict = "unexplained" if not explained else "missing" if self.chosen else "complete"
        if explained:
            # The likelihood knows what the smoother of the velocities does, and is sharper.
            improved, parameters = self.model, self.fitted["parameters"]
        else:
            improved, parameters = self.best.model, list(self.best.parameters.values())
        reached = float(study.noise_floor(heldout, self.best.model).sum()) if heldout else floor
        errors = self._held_out(heldout)
        return Conclusion(verdict, improved, parameters, floor, errors, reached)

    def _is_white(self):
        """Whether no disturbance is needed beside the noise of the poses and what is too small to matter."""
        under = self.evidence
        if self.slight:
            model = self.slight.model
            under, _ = under.settle(model, study.free_parameters(model))
        chance = stats.chi2.sf(under.disturbed, 2 * len(self.runs))
        return bool(chance > WHITE)

    def _held_out(self, heldout):
        """Errors on runs held out, of the nominal model and after each step."""
        fits = [self.nominal] + [step["fit"] for step in self.steps]
        if not heldout:
            return [float(fit.heldout.sum()) for fit in fits]
        cut = windows.cut(heldout)
        return [float(study.channel_errors(heldout, cut, fit.model).sum()) for fit in fits]


@dataclass
class LookAlike:
    """A model with an effect more, which on the runs does the same as the one without."""

    name: str  # of the effect
    model: Any  # _core.Model
    free: List[str]  # parameters that were refitted
    moved: List[str]  # those of them that do in the model without what the effect does in this one


@dataclass
class Conclusion:
    """What a diagnosis comes to."""

    verdict: str  # complete, missing or unexplained
    improved: Any  # _core.Model, refitted
    parameters: List[dict]  # of the improved model: name, unit, value, ci95, ...
    noise_floor: float
    heldout: List[float]  # error on held-out runs: nominal, then after each step
    heldout_floor: float  # noise floor of the runs that those are of
