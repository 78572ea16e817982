"""The set of effects under which recorded poses are likeliest.

The search takes forward, backward and swap steps over sets of effects. Score tests of all effects,
alone and in pairs, choose the sets to refit; a set's likelihood is that of the refit, levels
included. An effect's log-likelihood ratio 2 (L1 - L0) has to be significant, corrected for the
number of effects.
"""

import itertools
from typing import (
    Callable,
    Dict,
    FrozenSet,
    List,
    Optional,
    Sequence,
    Set,
    Tuple,
)

from scipy import special

from ground.analysis import candidates as effects
from ground.analysis.likelihood import Fit
from ground.analysis.refits import Fitting
from ground.analysis.score_tests import ScoreTests
from ground.analysis.window_error import free_parameters
from ground.support.annotations import Each
from ground.support.progress import Work

LEVEL = 0.01  # probability of choosing an effect although none is missing
REFITTED = 4  # effects that are refitted in a step, best by score test first
PAIRS = 2  # pairs that are refitted in a step
MIN_BEST_GAIN = 0.3  # least expected gain of what may be the best addition, over the largest one
MIN_GAIN = 3.0  # expected gain per parameter that a refit needs
# An effect is tested for removal if its Wald ratio is below this multiple of its threshold. The Wald ratio
# is far too large where levels would change with the removal.
WALD_MARGIN = 10.0
RIVALS = 3  # effects that are tried in the place of a chosen one
MIN_RIVAL_GAIN = 0.4  # least expected gain of a rival, relative to the chosen effect's
# Log-likelihood ratio from which a rival is excluded. If the rival were true, so large a ratio would
# have a probability of at most 0.4% (its root is the least number of standard deviations).
EXCLUSION = 7.0


class Search:
    """Sets of effects added to a model, on the runs of a Likelihood. each: maps pieces of work over items, in
    parallel if it can; work: told of what is done; holds(better, current): whether a grown set does better on
    held-out data, too."""

    def __init__(
        self,
        fitting: Fitting,
        each: Each = map,
        work: Optional[Work] = None,
        holds: Callable[[FrozenSet[str], FrozenSet[str]], bool] = lambda better, current: True,
    ) -> None:
        self.fitting = fitting
        self.likelihood, self.given = fitting.likelihood, fitting.given
        self.candidates = fitting.candidates
        self._sizes: Dict[str, int] = {}  # parameters of an effect
        self._thresholds: Dict[int, float] = {}  # by number of parameters
        self.each = each
        self.work = work or Work()
        self.holds = holds
        self._swapped: Set[str] = set()  # effects that were tried to be swapped already
        # sets refuted by held-out data, by the smaller set
        self._refused: Dict[FrozenSet[str], List[FrozenSet[str]]] = {}
        self.fits: Dict[FrozenSet[str], Fit] = {}  # by set of effects
        self.tests: Dict[Fit, ScoreTests] = {}

    def nominal(self, near: Optional[Fit] = None) -> Fit:
        """The Fit of the model as it is. near: one by another likelihood, from which it starts: with the
        levels of one and the values of another the filter may diverge."""
        if frozenset() not in self.fits:
            start = self.given if near is None else near.model
            self.fits[frozenset()] = self.likelihood.fit(start, free_parameters(start), near)
        return self.fits[frozenset()]

    def run(self, near: Optional[Fit] = None) -> FrozenSet[str]:
        """The likeliest set of significant effects. near: a Fit with whose effects the search
        begins."""
        self.nominal()
        current: FrozenSet[str] = frozenset()
        if near is not None:
            current = frozenset(near.model.effects) & frozenset(self.candidates)
            self.fits[current] = self.likelihood.fit(near.model, near.free, near)
            current = self._prune(current)
        while True:
            better = self._grow(current)
            if better is None:
                better = self._swap(current)
                if better == current:
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
        size, inner = self._size(name), self.candidates[name].contains
        if inner in self.candidates:
            return self._threshold(self._size(inner)) + self._threshold(size - self._size(inner))
        return self._threshold(size)

    def _threshold(self, size: int) -> float:
        if size not in self._thresholds:
            chance = LEVEL / max(1, len(self.candidates))
            self._thresholds[size] = float(special.chdtri(size, chance))
        return self._thresholds[size]

    def _size(self, name: str) -> int:
        if name not in self._sizes:
            model = self.candidates[name].add(self.given)
            self._sizes[name] = len(effects.parameters_of(model, name))
        return int(self._sizes[name])

    def value(self, names: FrozenSet[str]) -> float:
        """Value by which sets are compared: the log-likelihood ratio to the model as it is, minus
        the thresholds of the effects."""
        return self.ratio(names, frozenset()) - sum(self.threshold(n) for n in names)

    def _grow(self, current: FrozenSet[str]) -> Optional[FrozenSet[str]]:
        """A better set with another effect or pair; None without one."""
        proposals = self._proposals(current)
        for some in self._promising_first(current, proposals):
            self._fit_all(current, some)
            fitted = [current | set(p) for p in some if current | set(p) in self.fits]
            better = [s for s in fitted if self.value(s) > self.value(current)]
            for best in sorted(better, key=self.value, reverse=True):
                self.refine([best])
                if self.holds(best, current):
                    return best
                self._refused.setdefault(current, []).append(best)
        return None

    def _promising_first(
        self, current: FrozenSet[str], proposals: Sequence[Tuple[str, ...]]
    ) -> List[List[Tuple[str, ...]]]:
        """Proposals in two parts: those that may be the best by their score tests, and the others."""
        tests = self.test_beside(current)
        gains = {proposal: tests.test(proposal)[0] for proposal in proposals}
        least = MIN_BEST_GAIN * max(gains.values(), default=0.0)
        first = [p for p in proposals if gains[p] >= least]
        return [first, [p for p in proposals if gains[p] < least]]

    def refused(self, current: FrozenSet[str]) -> List[FrozenSet[str]]:
        """Larger sets that are likelier than `current` but refuted by held-out data."""
        return self._refused.get(current, [])

    def _proposals(self, current: FrozenSet[str]) -> List[Tuple[str, ...]]:
        tests = self.test_beside(current)
        rest = list(tests.columns)
        gains: Dict[Tuple[str, ...], float] = {(n,): tests.test((n,))[0] - self._size(n) for n in rest}
        singles = sorted(gains, key=gains.__getitem__, reverse=True)
        promising = [s for s in singles if gains[s] + self._size(s[0]) > MIN_GAIN * self._size(s[0])]
        chosen = promising[:REFITTED]
        base = self.fits[current]
        unseen: List[Tuple[str, ...]] = [  # by score tests
            (n,)
            for n in rest
            if (n,) not in chosen and (self.fitting.has_far_starts(n, base) or (current and tests.hidden(n)))
        ]
        pairs: Dict[Tuple[str, ...], float] = {}
        for pair in itertools.combinations(rest, 2):
            gain = tests.test(pair)[0] - sum(self._size(n) for n in pair)
            alone = max(gains[(n,)] for n in pair)
            needed = min(self.threshold(n) for n in pair)
            if gain > alone + needed / 2:
                pairs[pair] = gain
        best = sorted(pairs, key=pairs.__getitem__, reverse=True)
        least = max((gains[s] for s in chosen), default=0)
        return chosen + unseen + [p for p in best if pairs[p] > least][:PAIRS]

    def _fit_all(self, current: FrozenSet[str], proposals: Sequence[Tuple[str, ...]]) -> None:
        """Fits a set extended by each proposal."""
        wanted = [p for p in proposals if current | set(p) not in self.fits]
        base, tests = self.fits[current], self.test_beside(current)
        fitted = self.each(lambda added: self.fitting.extended(base, tests, added), wanted)
        for added, fit in zip(wanted, fitted):
            self.work.step()
            if fit is not None:
                self.fits[current | set(added)] = fit

    def beside(self, current: FrozenSet[str], name: str) -> Optional[FrozenSet[str]]:
        """A set with another effect, fitted to the end; None where the motion is not finite with it."""
        extended = current | {name}
        self._fit_all(current, [(name,)])
        if extended not in self.fits:
            return None
        self.refine([extended])
        return extended

    def without(self, current: FrozenSet[str], name: str) -> FrozenSet[str]:
        """A set without one of its effects, fitted."""
        return self.without_each(current, [name])[0]

    def without_each(self, current: FrozenSet[str], names: Sequence[str]) -> List[FrozenSet[str]]:
        """Fitted sets, each without one of the effects."""
        base, nominal = self.fits[current], self.fits[frozenset()]
        wanted = [name for name in names if current - {name} not in self.fits]
        for name, fit in zip(wanted, self.each(lambda n: self.fitting.reduced(base, nominal, n), wanted)):
            self.fits[current - {name}] = fit
        return [current - {name} for name in names]

    def refine(self, sets: Sequence[FrozenSet[str]]) -> None:
        """Continues fits of sets, which end early while others are compared with them."""
        for names, fit in zip(sets, self.each(lambda n: self.fitting.refined(self.fits[n]), sets)):
            self.fits[names] = fit

    def _prune(self, current: FrozenSet[str]) -> FrozenSet[str]:
        """Takes out effects as long as the set improves."""
        while True:
            doubtful = [n for n in sorted(current) if self.may_go(self.fits[current], n)]
            others = self.without_each(current, doubtful)
            best = max(others, key=self.value, default=current)
            if self.value(best) <= self.value(current):
                return current
            current = best

    def may_go(self, fit: Fit, name: str) -> bool:
        """Whether a Fit may do without an effect, by its Wald ratio; a refit then decides."""
        return fit.ratio_without(name) < WALD_MARGIN * self.threshold(name)

    def _swap(self, current: FrozenSet[str]) -> FrozenSet[str]:
        """A better set with one effect replaced by another; the same set without one."""
        names = sorted(current - self._swapped) if len(current) > 1 else []
        self._swapped |= set(names)
        self.without_each(current, names)
        others = [s for name in names for s in self.swaps(current, name)]
        best = max(others, key=self.value, default=current)
        return best if self.value(best) > self.value(current) else current

    def swaps(self, current: FrozenSet[str], name: str) -> List[FrozenSet[str]]:
        """Fitted sets in which another effect replaces the named one."""
        rest = self.without(current, name)
        tests = self.test_beside(rest)
        gains = {n: tests.test((n,))[0] for n in tests.columns}
        least = MIN_RIVAL_GAIN * gains.pop(name)
        names = sorted(gains, key=gains.__getitem__, reverse=True)[:RIVALS]
        needed = {n: max(least, MIN_GAIN * self._size(n)) for n in names}
        proposals = [(n,) for n in names if gains[n] > needed[n]]
        self._fit_all(rest, proposals)
        found = [rest | set(p) for p in proposals if rest | set(p) in self.fits]
        self.refine(found)
        return found

    def rivals(self, current: FrozenSet[str], name: str) -> List[str]:
        """Effects that the data cannot distinguish from one of a set, the best first."""
        by_rival = {}
        for other in self.swaps(current, name):
            (rival,) = other - current
            by_rival[rival] = self.value(current) - self.value(other)
        return [n for n in sorted(by_rival, key=by_rival.__getitem__) if by_rival[n] < EXCLUSION]
