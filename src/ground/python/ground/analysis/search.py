"""The set of effects under which recorded poses are likeliest.

The search takes forward, backward and swap steps over sets of effects. Score tests of all effects,
alone and in pairs, choose the sets to refit; a set's likelihood is from its refit, levels
included. An effect's log-likelihood ratio 2 (L1 - L0) has to be significant, corrected for the
number of effects.
"""

import itertools
from dataclasses import dataclass
from typing import Callable, Dict, FrozenSet, List, Mapping, Optional, Sequence, Set, Tuple

import numpy as np

from ground import _core
from ground.analysis.distributions import LEVEL, chi_squared_limit
from ground.analysis.likelihood import COARSE, LEAST_GAIN, Likelihood, LikelihoodFit
from ground.analysis.score_tests import ScoreTests, stepped
from ground.analysis.window_error import FEW_WINDOWS, WindowFitter, free_parameters
from ground.effect_library.candidates import Candidate, parameters_of, turned
from ground.support.annotations import Each
from ground.support.errors import Diverged
from ground.support.progress import Work

REFITTED = 4  # effects that are refitted in a step, best by score test first, and half as many pairs
MIN_BEST_GAIN = 0.3  # least expected gain of what may be the best addition, over the largest one
MIN_GAIN = 3.0  # expected gain per parameter that a refit needs
# An effect is tested for removal if its Wald ratio is below this multiple of its threshold. The Wald ratio
# is far too large where levels would change with the removal.
WALD_MARGIN = 10.0
RIVALS = 3  # effects that are tried in the place of a chosen one
MIN_RIVAL_GAIN = 0.4  # least expected gain of a rival, relative to the chosen effect's
MAX_LOSS = 0.1  # loss of log-likelihood up to which two models do the same
MIN_CHANGE = 0.05  # relative change of a parameter that has made room for an effect


@dataclass(frozen=True)
class LookAlike:
    """An effect that on the runs does only what other parameters can do."""

    name: str  # the effect's
    fit: LikelihoodFit  # the grown model with the effect at some size, all else refitted
    moved: Tuple[str, ...]  # free parameters that changed to make room for the effect, most first


class Search:
    """Sets of effects added to a model, on the runs of a Likelihood. candidates: the effects by name; each:
    maps pieces of work over items, in parallel if it can; work: told of what is done; holds(better, current):
    whether a grown set does better on held-out data, too; tested: called when more is known of effects that
    are added to the model as it is."""

    def __init__(
        self,
        likelihood: Likelihood,
        given: _core.Model,
        candidates: Mapping[str, Candidate],
        each: Each = map,
        work: Optional[Work] = None,
        holds: Callable[[FrozenSet[str], FrozenSet[str]], bool] = lambda better, current: True,
        tested: Callable[[], None] = lambda: None,
    ) -> None:
        self.likelihood, self.given, self.candidates = likelihood, given, candidates
        self.each, self.work, self.holds, self.tested = each, work or Work(), holds, tested
        # number of parameters of each effect
        self.sizes = {name: len(parameters_of(c.add(given), name)) for name, c in candidates.items()}
        self._swapped: Set[str] = set()  # effects that were tried to be swapped already
        # sets refuted by held-out data, by the smaller set
        self._refused: Dict[FrozenSet[str], List[FrozenSet[str]]] = {}
        self.fits: Dict[FrozenSet[str], LikelihoodFit] = {}  # by set of effects
        self.tests: Dict[LikelihoodFit, ScoreTests] = {}

    def nominal(self, near: Optional[LikelihoodFit] = None) -> LikelihoodFit:
        """The LikelihoodFit of the model as it is. near: one by another likelihood, from which it starts:
        with the levels of one and the values of another the filter may diverge."""
        if frozenset() not in self.fits:
            found = [] if near is None else self._from_start(near.model, near)
            if not found:
                found.append(self.likelihood.fit(self.given, free_parameters(self.given)))
            self.fits[frozenset()] = found[0]
        return self.fits[frozenset()]

    def run(self, near: Optional[LikelihoodFit] = None) -> FrozenSet[str]:
        """The likeliest set of significant effects. near: a LikelihoodFit with whose effects the search
        begins; an earlier search has tried to swap them already."""
        self.nominal()
        current: FrozenSet[str] = frozenset()
        if near is not None:
            current = frozenset(near.model.effects) & frozenset(self.candidates)
            self.fits[current] = self.likelihood.fit(near.model, near.free, near)
            current = self._prune(current)
        while True:
            better = self._grow(current) or (self._swap(current) if near is None else None)
            if better is None:
                return current
            current = self._prune(better)
            self.work.note("with %s" % (", ".join(sorted(current)) or "no effect"))

    def ratio(self, names: FrozenSet[str], without: FrozenSet[str]) -> float:
        """Log-likelihood ratio 2 (L1 - L0) of two sets of effects that were fitted."""
        return float(2 * (self.fits[names].log_posterior - self.fits[without].log_posterior))

    def test_beside(self, names: FrozenSet[str]) -> ScoreTests:
        """ScoreTests of all other effects, added to a fitted set."""
        fit = self.fits[names]
        if fit not in self.tests:
            rest = [c for n, c in self.candidates.items() if n not in names]
            self.tests[fit] = ScoreTests(self.likelihood, fit, rest)
        return self.tests[fit]

    def threshold(self, name: str) -> float:
        """Log-likelihood ratio that an effect has to reach. One that contains another one has to earn its
        place beside that one."""
        inner, sizes = self.sizes.get(self.candidates[name].contains, 0), [self.sizes[name]]
        if inner:
            sizes = [inner, sizes[0] - inner]
        return sum(chi_squared_limit(LEVEL / len(self.candidates), size) for size in sizes)

    def value(self, names: FrozenSet[str]) -> float:
        """Value by which sets are compared: the log-likelihood ratio to the model as it is, minus
        the thresholds of the effects."""
        return self.ratio(names, frozenset()) - sum(self.threshold(n) for n in names)

    def _grow(self, current: FrozenSet[str]) -> Optional[FrozenSet[str]]:
        """A better set with another effect or pair; None without one. What may be the best addition by its
        score test is tried first."""
        gains = {added: self.test_beside(current).test(added)[0] for added in self._proposals(current)}
        least = MIN_BEST_GAIN * max(gains.values(), default=0.0)
        for is_first in (True, False):
            some = [added for added, gain in gains.items() if (gain >= least if is_first else gain < least)]
            better = [s for s in self._extend(current, some) if self.value(s) > self.value(current)]
            for best in sorted(better, key=self.value, reverse=True):
                self._refine([best])
                if self.holds(best, current):
                    return best
                self._refused.setdefault(current, []).append(best)
        return None

    def refused(self, current: FrozenSet[str]) -> List[FrozenSet[str]]:
        """Larger sets that are likelier than `current` but refuted by held-out data."""
        return self._refused.get(current, [])

    def _proposals(self, current: FrozenSet[str]) -> List[Tuple[str, ...]]:
        """Effects and pairs that are worth a refit beside a set, and effects that score tests do not see."""
        tests, base = self.test_beside(current), self.fits[current]

        def excess(names: Tuple[str, ...]) -> float:
            """Expected gain above the gain of effects that do nothing."""
            return tests.test(names)[0] - sum(self.sizes[n] for n in names)

        alone: Dict[Tuple[str, ...], float] = {(n,): excess((n,)) for n in tests.columns}
        singles = [s for s in alone if alone[s] > (MIN_GAIN - 1) * self.sizes[s[0]]]
        chosen = sorted(singles, key=alone.__getitem__, reverse=True)[:REFITTED]
        unseen: List[Tuple[str, ...]] = [
            (n,)
            for n in tests.columns
            if (n,) not in chosen and (self._has_far_starts(n, base) or (current and tests.hidden(n)))
        ]
        least = max((alone[s] for s in chosen), default=0)
        pairs: Dict[Tuple[str, ...], float] = {}
        for pair in itertools.combinations(tests.columns, 2):
            gain, needed = excess(pair), min(self.threshold(n) for n in pair) / 2
            if gain > least and gain > max(alone[(n,)] for n in pair) + needed:
                pairs[pair] = gain
        return chosen + unseen + sorted(pairs, key=pairs.__getitem__, reverse=True)[: REFITTED // 2]

    def _extend(self, current: FrozenSet[str], proposals: Sequence[Tuple[str, ...]]) -> List[FrozenSet[str]]:
        """A set extended by each proposal and fitted; without those whose motion is not finite. Fits end
        early: see _refine."""
        wanted = [p for p in proposals if current | set(p) not in self.fits]
        base, tests = self.fits[current], self.test_beside(current)
        for added, fit in zip(wanted, self.each(lambda added: self._extended(base, tests, added), wanted)):
            self.work.step()
            if fit is not None:
                self.fits[current | set(added)] = fit
        if not current:
            self.tested()
        return [current | set(p) for p in proposals if current | set(p) in self.fits]

    def beside(self, current: FrozenSet[str], name: str) -> Optional[FrozenSet[str]]:
        """A set with another effect, fitted to the end; None where the motion is not finite with it."""
        found = self._extend(current, [(name,)])
        self._refine(found)
        return found[0] if found else None

    def without(self, current: FrozenSet[str], name: str) -> FrozenSet[str]:
        """A set without one of its effects, fitted."""
        return self.without_each(current, [name])[0]

    def without_each(self, current: FrozenSet[str], names: Sequence[str]) -> List[FrozenSet[str]]:
        """Fitted sets, each without one of the effects."""
        base = self.fits[current]
        wanted = [name for name in names if current - {name} not in self.fits]
        for name, fit in zip(wanted, self.each(lambda n: self._reduced(base, n), wanted)):
            self.fits[current - {name}] = fit
        return [current - {name} for name in names]

    def _refine(self, sets: Sequence[FrozenSet[str]]) -> None:
        """Continues fits of sets, which end early while others are compared with them."""

        def refined(names: FrozenSet[str]) -> LikelihoodFit:
            fit = self.fits[names]
            return max([fit, *self._from_start(fit.model, fit)], key=lambda one: one.log_posterior)

        self.fits.update(zip(sets, list(self.each(refined, sets))))

    def _prune(self, current: FrozenSet[str]) -> FrozenSet[str]:
        """Takes out effects as long as the set improves."""
        while True:
            doubtful = [n for n in sorted(current) if self.may_go(self.fits[current], n)]
            best = max(self.without_each(current, doubtful), key=self.value, default=current)
            if self.value(best) <= self.value(current):
                return current
            current = best

    def may_go(self, fit: LikelihoodFit, name: str) -> bool:
        """Whether a LikelihoodFit may do without an effect, by its Wald ratio; a refit then decides."""
        return fit.ratio_without(name) < WALD_MARGIN * self.threshold(name)

    def _swap(self, current: FrozenSet[str]) -> Optional[FrozenSet[str]]:
        """A better set with one effect replaced by another; None without one."""
        names = sorted(current - self._swapped) if len(current) > 1 else []
        self._swapped |= set(names)
        self.without_each(current, names)
        others = [s for name in names for s in self._swaps(current, name)]
        best = max(others, key=self.value, default=current)
        return best if self.value(best) > self.value(current) else None

    def _swaps(self, current: FrozenSet[str], name: str) -> List[FrozenSet[str]]:
        """Fitted sets in which another effect replaces the named one."""
        rest = self.without(current, name)
        tests = self.test_beside(rest)
        gains = {n: tests.test((n,))[0] for n in tests.columns}
        least = MIN_RIVAL_GAIN * gains.pop(name)
        names = sorted(gains, key=gains.__getitem__, reverse=True)[:RIVALS]
        found = self._extend(rest, [(n,) for n in names if gains[n] > max(least, MIN_GAIN * self.sizes[n])])
        self._refine(found)
        return found

    def rivals(self, current: FrozenSet[str], name: str) -> List[str]:
        """Effects that the data cannot distinguish from one of a set, the best first: were they true, so
        large a log-likelihood ratio would not be rare. One that contains it always explains as much: whether
        it is needed has been decided."""
        by_rival = {}
        for other in self._swaps(current, name):
            (rival,) = other - current
            if self.candidates[rival].contains != name:
                by_rival[rival] = self.value(current) - self.value(other)
        return [
            n for n in sorted(by_rival, key=by_rival.__getitem__) if by_rival[n] < chi_squared_limit(LEVEL, 1)
        ]

    def look_alike(self, current: FrozenSet[str], name: str) -> Optional[LookAlike]:
        """Adds an effect of typical size, or a part of it, to the model with the effects of a set, and
        refits all else: a LookAlike if the likelihood stays the same, else None."""
        fit, tests = self.fits[current], self.test_beside(current)
        neutral, steps = self.candidates[name].neutral(fit.model), tests.in_place(name, 1.0)
        for part in (1.0, 0.5, 0.25, 0.1, -1.0, -0.5, -0.25, -0.1):
            try:
                found = self.likelihood.fit(stepped(neutral, steps, part), fit.free, fit, levels=False)
            except Diverged:
                continue
            if found.log_posterior > fit.log_posterior - MAX_LOSS:
                values = np.array([[model.value(n) for n in fit.free] for model in (fit.model, found.model)])
                ways = np.abs(np.diff(values, axis=0)[0]) / np.maximum(np.abs(values).max(axis=0), 1e-300)
                order = np.argsort(-ways, kind="stable")
                return LookAlike(name, found, tuple(fit.free[i] for i in order if ways[i] > MIN_CHANGE))
        return None

    # Single fits

    def _extended(
        self, base: LikelihoodFit, tests: ScoreTests, added: Sequence[str]
    ) -> Optional[LikelihoodFit]:
        """The likeliest fit of a fitted set with added effects, from the steps of the score tests beside it
        and the effects' own starts. None where no motion is finite."""
        model = base.model
        for name in added:
            model = self.candidates[name].neutral(model)
        found: List[LikelihoodFit] = []
        _, step = tests.test(added)
        # where the test sees no more than what the fitted parameters do as well, all parts are the same
        is_seen = step and not any(tests.hidden(name) for name in added)
        for part in (1.0, 0.3, 0.1) if is_seen else (1.0,):
            found += self._from_start(stepped(model, step, part), base, COARSE)
            if found and found[-1].log_posterior > base.log_posterior + 1:
                break
        for name in added:
            for part in (0.5, 0.2, -0.2) if tests.hidden(name) else ():  # of its typical size
                found += self._from_start(stepped(model, tests.in_place(name, part)), base, COARSE)
            if self._has_far_starts(name, base):
                found += self._from_start(self._far_start(name, base, added), None, COARSE)
        return max(found, key=lambda fit: fit.log_posterior) if found else None

    def _reduced(self, base: LikelihoodFit, name: str) -> LikelihoodFit:
        """The fit of a fitted set without one of its effects."""
        model = base.model.copy()
        model.remove_effect(name)
        found = self._from_start(model, base)
        if found:
            return found[0]
        neutral = self.nominal().model  # the others are unstable without it
        for other in sorted(set(model.effects) & set(self.candidates)):
            neutral = self.candidates[other].neutral(neutral)
        return self.likelihood.fit(neutral, free_parameters(neutral), self.nominal())

    def _from_start(
        self, start: _core.Model, near: Optional[LikelihoodFit], least_gain: float = LEAST_GAIN
    ) -> List[LikelihoodFit]:
        """The fit from a start, as a list; an empty one where it cannot be simulated."""
        try:
            return [self.likelihood.fit(start, free_parameters(start), near, least_gain=least_gain)]
        except Diverged:
            return []

    def _has_far_starts(self, name: str, base: LikelihoodFit) -> bool:
        """Whether an effect has minima far from its neutral parameters, and a fit leaves more to the
        disturbance than fits start with."""
        start = self.likelihood.box.start(self.likelihood.craft).levels
        is_far = any(base.levels[level] > start[level] for level in ("sigma_X", "sigma_Y"))
        first, *also = self.candidates[name].starts(self.given)
        own = [p.name for p in parameters_of(first, name)]
        return is_far and len([*turned(first, own), *also]) > 1

    def _far_start(self, name: str, base: LikelihoodFit, added: Sequence[str]) -> _core.Model:
        """The model with an effect far from neutral from which a fit should start. The other parameters
        may be far from the right ones, too; a quick fit by simulation error finds them."""
        begun = base.model if set(base.model.effects) & set(self.candidates) else self.given
        for other in added:
            begun = begun if other == name else self.candidates[other].neutral(begun)
        first, *also = self.candidates[name].starts(begun)
        fitter = WindowFitter(self.likelihood.runs, threads=1, most=FEW_WINDOWS)
        try:
            return fitter.whole(first, free_parameters(first), also).model
        except Diverged:  # it cannot be simulated from any start
            return first
