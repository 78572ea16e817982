"""The verdict of a diagnosis, the improved model, and how well it predicts."""

import contextlib
from dataclasses import astuple, dataclass, replace
from functools import cached_property
from typing import Dict, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np

from ground import _core
from ground.analysis import (
    bands,
    between_runs,
    ceiling,
    folds,
    horizon,
    judge,
    naming,
    run_differences,
    stages,
    window_error,
)
from ground.analysis.agreement import Agreement, agreement
from ground.analysis.ceiling import Ceiling
from ground.analysis.diagnosis import EXPLAINED, MISLEADS, Diagnosis
from ground.analysis.horizon import PoseError, PredictionError
from ground.analysis.likelihood import Fit, Likelihood
from ground.recordings import windows
from ground.support.annotations import Document
from ground.support.errors import GroundError

LENGTHS = (1.0, 1 / 3)  # of windows of the refits without effects, relative to those of the error
LENGTHENED = 3  # formulas, each longer than the one before
MISREAD = "misread"  # the verdict on recordings with swapped channels, wrong signs, units or clocks
NAMELESS = ("unexplained", "memory", "undecided")  # verdicts that leave something without a name
SAID = ("unexplained", "memory")  # ... of which runs show that it is there
# Largest share of the error that a smooth function of one kind may have beside `complete`
SMALL = 0.35
LIKELIHOOD, SIMULATION = "likelihood", "simulation"  # what a refit maximises or minimises


@dataclass(frozen=True)
class Refit:
    """A model refitted in one way: as it is, which the gain of effects is measured against, or with the
    effects found. Where something is missing, a fit by simulation error may predict better."""

    by: str  # LIKELIHOOD or SIMULATION
    model: _core.Model
    parameters: Sequence[Document]
    error: float  # on the runs fitted to
    heldout: float  # on runs held out
    tested: judge.Tested  # what it predicts of parts of the runs fitted to, each by a fit to the others


@dataclass(frozen=True)
class Judgement:
    """A model with an effect compared with the same model without it, on data that neither was fitted
    to."""

    fitted: judge.Comparison  # parts of the runs fitted to, each by a fit to the others
    holdout: Optional[judge.Comparison]  # runs that the user held out; None without any


@dataclass(frozen=True)
class Conclusion:
    """What a diagnosis concludes."""

    verdict: str  # complete, missing, varies, memory, unexplained, undecided or misread
    before: Refit  # the best without further effects
    after: Refit  # the improved model
    noise_floor: float
    steps: List[float]  # error on held-out runs of the model as it is by likelihood, then after each step
    cross_validated: float  # error of the improved model on parts of the runs fitted to
    judgements: Mapping[str, Judgement]  # by effect
    heldout_floor: float  # noise floor of the runs on which steps are measured
    varies: List[Document]  # what differs between runs
    ceiling: Ceiling
    agreement: Agreement
    formula: Optional[naming.Formula]  # for what is learnable and has no name
    judged: Optional[folds.Judged]  # the model with the formula
    # how far predicted poses are off on held-out data, of the models given, refitted, improved and formula;
    # None where runs are too short
    prediction: Optional[PredictionError]
    diagnosis: Diagnosis  # its basis; where it is by_simulation, its effects and parameters are
    tested: Sequence[_core.RunData] = ()  # runs that the user held out

    @property
    def improved(self) -> _core.Model:
        """The improved model."""
        return self.after.model

    @property
    def heldout(self) -> List[float]:
        """Error on held-out runs: the best without further effects, then after each step, of the improved
        model last."""
        return [self.before.heldout, *self.steps[1:-1], self.after.heldout][: len(self.steps)]

    @cached_property
    def bands(self) -> List[bands.Bands]:
        """bands.Bands of the grown model, one for each run held out; the verdict does not need them."""
        found = self.diagnosis
        if self.tested:
            return bands.of_others(self.tested, found.fit, len(found.cut), found.each)
        return bands.of_folds(found.folds, found.fit, found.best.others)


class HeldOut:
    """Runs (_core.RunData) that the user held out of a Diagnosis."""

    def __init__(self, found: Diagnosis, runs: Sequence[_core.RunData]) -> None:
        self.runs, self.cut = runs, windows.cut(runs)
        self.starts = horizon.Starts.of(runs, found.prediction_time)
        self.likelihood = Likelihood(runs, found.given, found.likelihood.varying)

    def error(self, fit: Fit) -> float:
        """Error of a Fit; differences between runs are estimated from the poses before each window."""
        each = folds.calibrated_errors(self.runs, self.cut, self.likelihood, fit)
        return float(window_error.mean(self.cut, each).sum())

    def error_of(self, refit: Refit, fit: Fit) -> float:
        """Error of a Refit; fit: the one that it is if it was fitted by likelihood."""
        if refit.by == LIKELIHOOD:
            return self.error(fit)
        try:
            return float(window_error.channel_errors(self.runs, self.cut, refit.model).sum())
        except GroundError:  # the motion is not finite
            return np.inf

    def tested_of(self, refit: Refit, fit: Fit) -> judge.Tested:
        """What a Refit predicts; fit: see error_of."""
        if refit.by == LIKELIHOOD:
            return self.tested(fit)
        errors = self.starts.errors(self.runs, [refit.model] * len(self.starts.windows))
        return judge.Tested(errors, np.array([w.run for w in self.starts.windows]))

    def tested(self, fit: Fit) -> judge.Tested:
        """What a Fit predicts, and its log-likelihood."""
        return folds.tested(self.runs, self.starts, self.likelihood, fit)


def conclude(found: Diagnosis, heldout: Sequence[_core.RunData] = (), misread: bool = False) -> Conclusion:
    """Draws the Conclusion of a Diagnosis. misread: no effect was looked for, because the recordings
    look misread.

    heldout: _core.RunData of runs to test on, which decide nothing. Without them, each run (each
    quarter of a single run) is tested by a fit to the others.
    """
    with found.work.stage(stages.LEAVING):
        return _conclude(found, heldout, misread, _refits(found))


def _conclude(
    found: Diagnosis, heldout: Sequence[_core.RunData], misread: bool, refits: Sequence[Refit]
) -> Conclusion:
    left = found.ceiling_of()
    agrees = agreement(found.runs, found.cut, found.likelihood, found.fit, found.prediction_time, found.each)
    if not agrees.holds and not left.said:
        left = replace(left, bound=1.0)  # nothing tells what the rest is: all of it may be learnable
    floor, varies = found.noise_floor(found.names), _varies(found)
    before = min(refits, key=lambda refit: found.compared(refit.tested, refits[0].tested).rise)
    if not found.chosen and not found.compared(refits[0].tested, before.tested).is_worse:
        before = refits[0]  # its intervals are the better ones
    explained = found.explains(found.names)
    verdict = MISREAD if misread else _verdict(found, explained, varies, left, agrees)
    named = None
    if verdict in NAMELESS:
        named = _name(found, before)
    elif verdict == "missing" and left.is_open:
        named = _name(found, before, left)
    if named is not None:
        reached = left.reached_by(named.formula.fit.model)
        if verdict in SAID or (reached.said and named.is_confirmed(found)):
            left = reached
            verdict = _verdict(found, explained, varies, left, agrees)
        elif verdict == "missing":
            named = None
    after = _grown(found) if found.chosen or before.by == LIKELIHOOD else before
    tested = named.judged.tested if named else after.tested
    if found.chosen and found.compared(tested, before.tested).is_worse:
        off = (*astuple(tested.error), *astuple(before.tested.error))
        if found.by_simulation is not None or not found.grow_by_simulation(MISLEADS % off):
            found.withdraw(MISLEADS % off)
        return _conclude(found, heldout, misread, refits)
    if after.by == LIKELIHOOD or found.by_simulation is not None:
        model, parameters = _on_all(found)
        after = replace(after, model=model, parameters=parameters)
    crossed = after.heldout
    formula = named.formula if named else None
    by_user = HeldOut(found, heldout) if heldout else None
    steps = _steps(found, by_user)
    if by_user:
        before = replace(before, heldout=by_user.error_of(before, found.search.nominal()))
        after = replace(after, heldout=by_user.error_of(after, found.fit))
    return Conclusion(
        verdict,
        before,
        after,
        floor,
        steps,
        crossed,
        _judgements(found, by_user, before, after),
        float(window_error.noise_floor(heldout, found.best.model).sum()) if heldout else floor,
        varies,
        left,
        agrees,
        formula,
        named.judged if named else None,
        _prediction(found, by_user, before, after, named),
        found,
        heldout,
    )


def _grown(found: Diagnosis) -> Refit:
    """The grown model, as it was found; with effects, by simulation error where that matters and the judge
    proves that it predicts better."""
    by = SIMULATION if found.by_simulation else LIKELIHOOD
    errors = [float(one.sum()) for one in (found.best.error, found.best.heldout)]
    best = Refit(by, found.model, (), errors[0], errors[1], found.best.tested)
    if found.chosen and not found.by_simulation:
        for other in _by_simulation(found, found.model, found.fit.free):
            differs = found.matter(best.model, other.model)
            if differs and found.compared(other.tested, best.tested).is_better:
                best = other
    return best


def _on_all(found: Diagnosis) -> Tuple[_core.Model, List[Document]]:
    """The grown model and its parameters, fitted to all of the runs; by simulation error to the parts of
    long runs that the search used. By likelihood, levels are those of the parts: their uncertainty hardly
    widens intervals then."""
    if found.by_simulation is not None:
        return found.model, list(found.by_simulation.parameters.values())
    if not found.is_excerpt:
        return found.model, between_runs.widened(found.likelihood, found.fit, _intervals(found))
    whole = Likelihood(found.all_runs, found.given, found.likelihood.varying, found.threads)
    try:
        fit = whole.fit(found.model, found.fit.free, near=found.fit, levels=False)
    except GroundError:  # the motion in another part is not finite
        return found.model, between_runs.widened(found.likelihood, found.fit, _intervals(found))
    return fit.model, between_runs.widened(whole, fit, fit.parameters)


def _intervals(found: Diagnosis) -> List[Document]:
    """The parameters of the grown model, with intervals that include the uncertainty of the levels where
    these can be moved without a motion that is not finite."""
    try:
        return found.likelihood.intervals(found.fit)
    except GroundError:
        return list(found.fit.parameters)


def _refits(found: Diagnosis) -> List[Refit]:
    """The model as it is, refitted by likelihood and, where it can be simulated, by simulation error over
    long windows and over short ones, on which a disturbance adds up to less. Errors are over the windows
    and folds of a Diagnosis."""
    free, near = window_error.free_parameters(found.given), [found.nominal.model]
    nominal = _refit(LIKELIHOOD, found.nominal, found.nominal.tested)
    return [nominal, *_by_simulation(found, found.given, free, near)]


def _by_simulation(
    found: Diagnosis, model: _core.Model, free: Sequence[str], also: Sequence[_core.Model] = ()
) -> List[Refit]:
    """A model refitted by simulation error over long and over short windows, from its values and those of
    others, where it can be simulated."""
    refits = []
    for length in LENGTHS:
        with contextlib.suppress(GroundError):  # the simulation diverges
            seconds = length * windows.length(found.runs)
            fitter = window_error.WindowFitter(found.runs, threads=1, length=seconds)
            fitted = fitter.fit(model, free, also)
            refits.append(_refit(SIMULATION, fitted, found.tested(fitter, fitted)))
    return refits


def _prediction(
    found: Diagnosis,
    by_user: Optional[HeldOut],
    before: Refit,
    after: Refit,
    named: Optional["_Named"],
) -> Optional[PredictionError]:
    """How far predicted poses are off, on the runs that the user held out or on the folds."""
    starts, runs = (by_user.starts, by_user.runs) if by_user else (found.starts, found.runs)
    if not len(starts.windows):
        return None

    def same(model: _core.Model) -> PoseError:
        return PoseError.of(starts.errors(runs, [model] * len(starts.windows)))

    errors = {"given": same(found.given), "refitted": before.tested.error, "improved": after.tested.error}
    if by_user:
        errors["refitted"] = by_user.tested_of(before, found.search.nominal()).error
        errors["improved"] = by_user.tested_of(after, found.fit).error
    if named:
        judged = by_user.tested(named.formula.fit) if by_user else named.judged.tested
        errors["formula"] = judged.error
    return horizon.with_floors(runs, starts, errors, found.model, found.fit.levels)


def _refit(by: str, fit: Union[folds.Judged, window_error.WindowFit], tested: judge.Tested) -> Refit:
    known = tuple(fit.parameters.values())
    return Refit(by, fit.model, known, float(fit.error.sum()), float(fit.heldout.sum()), tested)


def _steps(found: Diagnosis, others: Optional[HeldOut]) -> List[float]:
    """Error on runs held out of the model as it is by likelihood, and after each step."""
    if others is None:
        return [float(judged.heldout.sum()) for judged in (found.nominal, *(s.fit for s in found.steps))]
    names = [step.added for step in found.steps]
    return [others.error(found.search.fits[frozenset(names[:i])]) for i in range(len(names) + 1)]


def _judgements(
    found: Diagnosis, others: Optional[HeldOut], before: Refit, after: Refit
) -> Dict[str, Judgement]:
    """How sure each effect of the grown model is by data that decided nothing, by name. Runs that the user
    held out contradict all effects where the best refit without any predicts them better."""
    result = {}
    for step in found.steps:
        by_user = None
        if others:
            without = others.tested_of(before, found.search.nominal())
            by_user = found.compared(others.tested_of(after, found.fit), without)
            if not by_user.is_worse:
                by_user = found.compared(others.tested(found.fit), others.tested(step.rest))
        result[step.added] = Judgement(step.confirmed, by_user)
    return result


def _varies(found: Diagnosis) -> List[Document]:
    """Differences between runs, as fitted with the grown model."""
    sizes = np.array([[*trim["wrench"], trim["thrust"]] for trim in found.fit.trims])
    return [
        {
            "parameter": d.kind.parameter,
            "unit": d.kind.unit,
            "deviation": float(np.std(sizes[:, i], ddof=1)),
            "p": d.p_value / len(run_differences.KINDS),
            "p_corrected": d.p_value,
            "by_run": sizes[:, i].tolist(),
        }
        for d in found.differences
        for i in [run_differences.KINDS.index(d.kind)]
    ]


@dataclass(frozen=True)
class _Named:
    """A formula, and the errors of the model with it."""

    formula: naming.Formula
    judged: folds.Judged

    def is_confirmed(self, found: Diagnosis) -> bool:
        """Whether parts of the runs that it was not fitted to prove it."""
        return found.compared(self.judged.tested, found.best.tested).is_better


def _name(found: Diagnosis, before: Refit, doubted: Optional[Ceiling] = None) -> Optional[_Named]:
    """A formula for what is learnable, made longer while the judge proves it and the noise leaves less; None
    unless it is proved. before: the best refit without effects, against which it must not be vetoed; doubted:
    a Ceiling that does not say that something is left: the first formula has to show it."""
    best: Optional[_Named] = None

    def shows(made: naming.Formula) -> bool:
        """Whether runs show that a formula is learnable."""
        return doubted is None or doubted.reached_by(made.fit.model).said

    made = found.formula_of(found.names, shows)
    for _ in range(LENGTHENED):
        named = None if made is None else _judged(found, made)
        if named is None or (best and not found.compared(named.judged.tested, best.judged.tested).is_better):
            break
        if doubted and not named.is_confirmed(found):
            break
        best = named
        if float(named.judged.heldout.sum()) < EXPLAINED * found.noise_floor(found.names):
            break
        beside = ceiling.found_beside(found.likelihood, named.formula.fit, found.runs, found.cut)
        if beside is None:
            break
        made = naming.formula(found.likelihood, found.fit, beside.regression, named.formula)
    if best and (not best.is_confirmed(found) or found.compared(best.judged.tested, before.tested).is_worse):
        return None
    return best


def _judged(found: Diagnosis, made: naming.Formula) -> Optional[_Named]:
    """A formula with its errors; None where its motion is not finite."""
    try:
        return _Named(made, found.folds.judge(made.fit))
    except GroundError:
        return None


def _verdict(
    found: Diagnosis,
    explained: bool,
    varies: Sequence[Document],
    left: Ceiling,
    agrees: Agreement,
) -> str:
    if left.said and not explained:
        return "memory" if left.of_the_past else "unexplained"
    if found.chosen:
        return "missing"
    if varies:
        return "varies"
    # An effect that the likelihood prefers and held-out parts refute leaves open what is missing.
    refuted = any(dropped.change is None for dropped in found.dropped)
    open_still = refuted or left.found is not None or not agrees.holds
    if not explained and (open_still or left.bound > SMALL):
        return "undecided"
    return "complete"
