"""Conclusion of a diagnosis: the verdict, the improved model, and how well it predicts."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import (
    bands,
    baseline,
    ceiling,
    held_out,
    judgement,
    learned,
    memory,
    naming,
    rivals,
    stages,
    study,
    varying,
)
from ground.analysis.agreement import Agreement, agreement
from ground.analysis.ceiling import Ceiling
from ground.analysis.diagnosis import Diagnosis
from ground.analysis.likelihood import Fit, Likelihood
from ground.analysis.refits import Fitting
from ground.analysis.search import Search
from ground.analysis.second_opinion import Opinion, second_opinion
from ground.annotations import Document, Each
from ground.errors import GroundError

EXPLAINED = 1.15  # ratio of error to noise floor below which a model explains the data
MISREAD = "misread"  # the verdict on recordings with swapped channels, wrong signs, units or clocks
NAMELESS = ("unexplained", "memory", "undecided")  # verdicts that leave something without a name
SAID = ("unexplained", "memory")  # ... of which runs show that it is there
ENOUGH = 0.6  # of the error on parts held out: with a formula that leaves less, nothing else is tried
BETTER = 0.9  # largest ratio of errors at which a longer formula, or a learned wrench, is worth it
# Largest share of the error that a smooth function of one kind may have beside `complete`
SMALL = 0.35
# Largest log-likelihood ratio by which a rival is behind that a part of the data may prefer, in
# multiples of the one from which it is excluded.
CLOSE = 5.0
LENGTHENED = 3  # formulas, each longer than the one before
FLOORS = 5  # simulations over which the noise floor is averaged


@dataclass(frozen=True)
class Conclusion:
    """What a diagnosis concludes."""

    verdict: str  # complete, missing, varies, memory, unexplained, undecided or misread
    improved: _core.Model  # refitted
    parameters: List[Document]  # the improved model's: name, unit, value, ci95, ...
    noise_floor: float
    refits: Tuple[baseline.Refit, ...]  # the model as it is
    steps: List[float]  # error on held-out runs after each step
    judgements: Mapping[str, judgement.Judgement]  # by effect
    heldout_floor: float  # noise floor of the runs on which steps are measured
    varies: List[Document]  # what differs between runs
    memory: Optional[memory.Memory]
    ceiling: Ceiling
    agreement: Agreement
    opinion: Opinion  # another method's
    formula: Optional[naming.Formula]  # for what is learnable and has no name
    diagnosis: Diagnosis  # its basis
    tested: Sequence[_core.RunData] = ()  # runs that the user held out

    @property
    def before(self) -> baseline.Refit:
        """The refit that predicts best without further effects."""
        return min(self.refits, key=lambda refit: refit.heldout)

    @property
    def heldout(self) -> List[float]:
        """Error on held-out runs: the best without further effects, then after each step."""
        return [self.before.heldout, *self.steps]

    # The verdict does not need these: they are computed on first use.

    @cached_property
    def rivals(self) -> List[naming.Formula]:
        """Formulas by other features that explain nearly as much as the formula, the best first."""
        found, left = self.diagnosis, self.ceiling.found
        if self.formula is None or left is None:
            return []
        close = CLOSE * found.search.criteria.exclusion
        return rivals.rivals(found.likelihood, found.fit, left, self.formula, close)

    @cached_property
    def nested(self) -> float:
        """Error of the improved model on held-out runs, with the choice of effects repeated in each
        fold."""
        if self.tested or not self.steps:
            return [self.refits[0].heldout, *self.steps][-1]
        return _nested(self.diagnosis)

    @cached_property
    def bands(self) -> List[bands.Bands]:
        """bands.Bands of the grown model, one for each run held out."""
        return _bands(self.diagnosis, self.tested)


def conclude(
    found: Diagnosis, heldout: Sequence[_core.RunData] = (), misread: bool = False
) -> Conclusion:
    """Draws the Conclusion of a Diagnosis. misread: no effect was looked for, because the recordings
    look misread.

    heldout: _core.RunData of runs to test on, which decide nothing. Without them, each run (each
    quarter of a single run) is tested by a fit to the others.
    """
    with found.work.stage(stages.LEAVING):
        return _conclude(found, heldout, misread)


def _conclude(
    found: Diagnosis, heldout: Sequence[_core.RunData], misread: bool
) -> Conclusion:
    left = found.ceiling_of()
    agrees = agreement(found.runs, found.cut, found.likelihood, found.fit, found.pool.map)
    if not agrees.holds and not left.said:
        left = left.unbounded()

    def floor_of(seed: int) -> float:
        return float(study.noise_floor(found.runs, found.best.model, seed).sum())

    floor = float(np.mean(list(found.pool.map(floor_of, range(FLOORS)))))
    heldout_floor = float(study.noise_floor(heldout, found.best.model).sum()) if heldout else floor
    varies = _varies(found)
    explained = found.best.error.sum() < EXPLAINED * floor
    opinion = _opinion(found)
    trusted = agrees.holds or not found.chosen or _predicts_better(found)
    verdict = MISREAD if misread else _verdict(found, explained, varies, left, agrees, opinion, trusted)
    formula = None
    if verdict in NAMELESS or (verdict == "missing" and left.is_open):
        formula = _name(found, left, EXPLAINED * floor)
    if formula is not None:
        reached = left.reached_by(formula.fit.model, found.runs, found.cut)
        if verdict in SAID or (reached.said and _is_confirmed(found, formula.fit)):
            left = reached
            verdict = _verdict(found, explained, varies, left, agrees, opinion, trusted)
        elif verdict == "missing":
            formula = None
    return Conclusion(
        verdict,
        found.model,
        found.likelihood.intervals(found.fit),
        floor,
        baseline.refits(found, heldout),
        _steps(found, heldout),
        judgement.judgements(found, heldout),
        heldout_floor,
        varies,
        found.memory,
        left,
        agrees,
        opinion,
        formula,
        found,
        heldout,
    )


def _nested(found: Diagnosis) -> float:
    """Error of windows held out from both choice and fit. Each fold repeats the choice, beginning
    with the effects found; each of them has to reach the threshold there again, and may be replaced by
    those that all parts together hardly distinguish from it."""
    whole, close = found.search, CLOSE * found.search.criteria.exclusion
    swapped = {name: whole.rivals(found.names, name, close) for name in found.names}
    fitting = replace(whole.fitting, known=whole.fits)
    choice = _Choice(fitting, found.fit, whole.nominal(), swapped, found.inside)
    return float(found.folds.nested(choice, found.each_of_many).sum())


@dataclass(frozen=True)
class _Choice:
    """Chooses effects for a part of the runs, beginning with those that were found for all of them."""

    fitting: Fitting  # to all runs
    found: Fit
    nominal: Fit
    swapped: Mapping[str, Sequence[str]]
    each: Each

    def __call__(self, likelihood: Likelihood) -> Fit:
        fitting = replace(self.fitting, likelihood=likelihood)
        search = Search(fitting, self.each, swapped=self.swapped)
        search.nominal(replace(self.nominal, loudness=()))
        return search.fits[search.run(near=replace(self.found, loudness=()))]


def _bands(found: Diagnosis, heldout: Sequence[_core.RunData]) -> List[bands.Bands]:
    """bands.Bands of the grown model, one for each run held out."""
    if heldout:
        return bands.of_others(heldout, found.fit, len(found.cut), found.pool.map)
    return bands.of_folds(found.folds, found.fit)


def _varies(found: Diagnosis) -> List[Document]:
    """Differences between runs, as fitted with the grown model."""
    sizes = np.array([[*trim["wrench"], trim["thrust"]] for trim in found.fit.trims])
    return [
        {
            "parameter": d.kind.parameter,
            "unit": d.kind.unit,
            "deviation": float(np.std(sizes[:, i], ddof=1)),
            "p_value": d.p_value,
            "by_run": sizes[:, i].tolist(),
        }
        for d in found.differences
        for i in [varying.KINDS.index(d.kind)]
    ]


def _name(found: Diagnosis, left: Ceiling, enough: float) -> Optional[naming.Formula]:
    """A formula or a learned wrench for what is learnable: that with which parts held out are
    predicted better. enough: error with which nothing more is looked for."""
    if left.found is None:
        return None
    before = float(found.best.heldout.sum())
    best, least = _lengthened(found, before, enough)
    if least > ENOUGH * before:
        made = learned.learned(found.likelihood, found.fit, left.found)
        if made is not None and _crossed(found, made.fit) < BETTER * least:
            best = made
    return best


def _lengthened(
    found: Diagnosis, before: float, enough: float
) -> Tuple[Optional[naming.Formula], float]:
    """The formula, made longer while the cross-validated error falls and is not small enough, and that
    error; before: without a formula. The first may raise the error: a function of the commands does without
    the constant that it needs."""
    best, least = None, before
    made = found.formula_of(found.names)
    for number in range(LENGTHENED):
        after = before if made is None else _crossed(found, made.fit)
        if made is None or (after >= least and number > 0):
            break
        is_done = after < enough or BETTER * least < after < least
        if after < least:
            best, least = made, after
        if is_done:
            break
        beside = ceiling.found_beside(found.likelihood, made.fit, found.runs, found.cut)
        if beside is None:
            break
        made = naming.formula(found.likelihood, found.fit, beside.regression, made)
    return best, least


def _predicts_better(found: Diagnosis) -> bool:
    """Whether the model with the effects predicts parts held out better than each refit without them."""
    without = min(refit.heldout for refit in baseline.refits(found))
    return float(found.best.heldout.sum()) < without


def _is_confirmed(found: Diagnosis, fit: Fit) -> bool:
    """Whether a Fit makes parts of the runs likelier that it was not fitted to."""
    judged = found.folds.judge(fit)
    return held_out.compared(judged.tested, found.best.tested).verdict == held_out.BETTER


def _opinion(found: Diagnosis) -> Opinion:
    """The second method's Opinion; it says nothing of runs that are too short for it."""
    try:
        return second_opinion(found.runs, found.model)
    except GroundError:
        return Opinion({}, 0.0, (0.0, 0.0), ())


def _crossed(found: Diagnosis, fit: Fit) -> float:
    """Cross-validated error of a Fit; infinite where its motion is not finite."""
    try:
        return float(found.folds.judge(fit).heldout.sum())
    except GroundError:
        return float("inf")


def _verdict(
    found: Diagnosis,
    explained: bool,
    varies: Sequence[Document],
    left: Ceiling,
    agrees: Agreement,
    opinion: Opinion,
    trusted: bool,
) -> str:
    if found.memory:
        return "memory"
    if left.said and not explained:
        return "memory" if left.of_the_past else "unexplained"
    if found.chosen:
        return "missing" if trusted else "undecided"
    if varies:
        return "varies"
    # An effect that the likelihood prefers and held-out parts refute leaves open what is missing.
    open_still = bool(found.dropped or opinion.says) or left.found is not None or not agrees.holds
    if not explained and (open_still or left.bound > SMALL):
        return "undecided"
    return "complete"


def _steps(found: Diagnosis, heldout: Sequence[_core.RunData]) -> List[float]:
    """Error on runs held out after each step."""
    if not heldout:
        return [float(step.fit.heldout.sum()) for step in found.steps]
    names = [c.name for c in found.chosen]
    fits = [found.search.fits[frozenset(names[: i + 1])] for i in range(len(names))]
    return baseline.errors_on(found, heldout, fits)
