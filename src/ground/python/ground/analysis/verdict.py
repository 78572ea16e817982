"""The verdict of a diagnosis, the improved model, and how well it predicts."""

import contextlib
from dataclasses import astuple, dataclass, replace
from functools import cached_property
from typing import Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import bands, between_runs, ceiling, folds, horizon, judge, naming, window_error, windows
from ground.analysis.agreement import Agreement, agreement
from ground.analysis.ceiling import Ceiling
from ground.analysis.diagnosis import EXPLAINED, StepwiseDiagnosis
from ground.analysis.folds import Judged
from ground.analysis.horizon import PoseError, PredictionError
from ground.analysis.likelihood import KINDS, Likelihood, LikelihoodFit
from ground.effect_library.parameters import FittedParameter
from ground.support.annotations import Array
from ground.support.errors import Diverged

MISREAD = "misread"  # the verdict on recordings with swapped channels, wrong signs, units or clocks
# Largest share of the error that a smooth function of one kind may have beside `complete`
SMALL = 0.35


@dataclass(frozen=True)
class Varying:
    """What differs between runs."""

    parameter: str  # in words
    unit: str
    deviation: float  # standard deviation between runs
    p: float  # probability of as much difference by chance
    p_corrected: float  # for the number of differences tried
    by_run: List[float]


@dataclass(frozen=True)
class Conclusion:
    """What a diagnosis concludes. Where something is missing, a fit by simulation error may predict better
    than one by likelihood."""

    verdict: str  # complete, missing, varies, memory, unexplained, undecided or misread
    before: Judged  # the best refit without further effects
    after: Judged  # the improved model
    noise_floor: float
    steps: List[float]  # error on held-out runs of the model as it is by likelihood, then after each step
    cross_validated: float  # error of the improved model on parts of the runs fitted to
    # by effect: the model with it compared with the model without it on runs that the user held out; None
    # without any
    holdout: Mapping[str, Optional[judge.PairedComparison]]
    heldout_floor: float  # noise floor of the runs on which steps are measured
    varies: List[Varying]
    ceiling: Ceiling
    agreement: Agreement
    formula: Optional[naming.Formula]  # for what is learnable and has no name
    judged: Optional[Judged]  # the model with the formula
    # how far predicted poses are off on held-out data, of the models given, refitted, improved, formula and
    # written: the improved one without what is estimated of each run; None where runs are too short
    prediction: Optional[PredictionError]
    diagnosis: StepwiseDiagnosis  # its basis; where it is by simulation error, its effects and parameters are
    tested: Sequence[_core.RunData] = ()  # runs that the user held out

    @property
    def improved(self) -> _core.Model:
        """The improved model."""
        return self.after.model

    @property
    def heldout(self) -> List[float]:
        """Error on held-out runs: the best without further effects, then after each step, of the improved
        model last."""
        first, last = (float(one.heldout.sum()) for one in (self.before, self.after))
        return [first, *self.steps[1:-1], last][: len(self.steps)]

    @cached_property
    def bands(self) -> List[bands.Bands]:
        """bands.Bands of the grown model, one for each run held out; the verdict does not need them."""
        found = self.diagnosis
        if self.tested:
            return bands.of_others(self.tested, found.fit, len(found.cut), found.each)
        return bands.of_folds(found.folds, found.fit, found.best.others)


class HeldOutRuns:
    """Runs (_core.RunData) that the user held out of a StepwiseDiagnosis."""

    def __init__(self, found: StepwiseDiagnosis, runs: Sequence[_core.RunData]) -> None:
        self.runs, self.cut = runs, windows.cut(runs)
        self.starts = horizon.Starts.of(runs, found.prediction_time)
        self.likelihood = Likelihood(runs, found.given, found.likelihood.varying)

    def error(self, model: _core.Model, fit: Optional[LikelihoodFit] = None) -> Array:
        """Error (3,) of a model. fit: by likelihood, whose differences between runs are then estimated from
        the poses before each window."""
        if fit:
            each = window_error.calibrated_errors(self.runs, self.cut, self.likelihood, fit)
            return window_error.mean(self.cut, each)
        try:
            return window_error.channel_errors(self.runs, self.cut, model)
        except Diverged:  # the motion is not finite
            return np.full(3, np.inf)

    def tested(self, model: _core.Model, fit: Optional[LikelihoodFit] = None) -> judge.Tested:
        """What a model predicts; fit: see error."""
        if fit:
            return folds.tested(self.runs, self.starts, self.likelihood, fit)
        errors = self.starts.errors(self.runs, [model] * len(self.starts.windows))
        return judge.Tested(errors, self.starts.of_run)


def conclude(
    found: StepwiseDiagnosis, heldout: Sequence[_core.RunData] = (), misread: bool = False
) -> Conclusion:
    """Draws the Conclusion of a Diagnosis. misread: no effect was looked for, because the recordings
    look misread.

    heldout: _core.RunData of runs to test on, which decide nothing. Without them, each run (each
    quarter of a single run) is tested by a fit to the others.
    """
    with found.work.stage("testing what the model leaves"):
        # The model as it is: by likelihood, and from there by simulation error
        free = window_error.free_parameters(found.given)
        refits = [found.nominal, *_by_simulation(found, found.given, free, [found.nominal.model])]
        return _conclude(found, heldout, misread, refits)


def _conclude(
    found: StepwiseDiagnosis, heldout: Sequence[_core.RunData], misread: bool, refits: Sequence[Judged]
) -> Conclusion:
    left = found.ceiling_of()
    agrees = agreement(found.runs, found.cut, found.likelihood, found.fit, found.prediction_time, found.each)
    if not agrees.holds and not left.said:
        left = replace(left, bound=1.0)  # nothing tells what the rest is: all of it may be learnable
    floor, varies = found.noise_floor(found.names), _varies(found)
    before = min(refits, key=lambda refit: found.compared(refit.tested, refits[0].tested).rise)
    if not found.chosen and not found.compared(refits[0].tested, before.tested).is_worse:
        before = refits[0]  # its intervals are the better ones
    explained, refuted = found.explains(found.names), not found.chosen and before is not refits[0]
    verdict = MISREAD if misread else _verdict(found, explained, refuted, varies, left, agrees)
    formula, named = None, None
    has_no_name = verdict in ("unexplained", "memory")  # ... and runs show that it is there
    if has_no_name or verdict == "undecided":
        formula, named = _name(found, before)
    elif verdict == "missing" and left.is_open:
        formula, named = _name(found, before, left)
    if named is not None:
        reached = left.reached_by(named.model)
        if has_no_name or (reached.said and _is_confirmed(found, named)):
            left = reached
            verdict = _verdict(found, explained, refuted, varies, left, agrees)
        elif verdict == "missing":
            formula, named = None, None
    after = _grown(found) if found.chosen or before.fit else before
    tested = (named or after).tested
    if found.chosen and found.compared(tested, before.tested).is_worse:
        off = (*astuple(tested.error), *astuple(before.tested.error))
        why = (
            "held-out poses are predicted worse with it (%.2g mm, %.2g deg) than by a refit without it "
            "(%.2g mm, %.2g deg)" % off
        )
        if found.best.fit is None or not found.grow_by_simulation(why):
            found.withdraw(why)
        return _conclude(found, heldout, misread, refits)
    if after.fit:
        model, parameters = _on_all(found)
        after = replace(after, model=model, parameters=parameters)
    crossed = float(after.heldout.sum())
    by_user = HeldOutRuns(found, heldout) if heldout else None
    if by_user:
        before = replace(before, heldout=by_user.error(before.model, before.fit))
        after = replace(after, heldout=by_user.error(after.model, after.fit))
    return Conclusion(
        verdict,
        before,
        after,
        floor,
        _steps(found, by_user),
        crossed,
        _holdout(found, by_user, before, after),
        float(window_error.noise_floor(heldout, found.best.model).sum()) if heldout else floor,
        varies,
        left,
        agrees,
        formula,
        named,
        _prediction(found, by_user, before, after, named),
        found,
        heldout,
    )


def _grown(found: StepwiseDiagnosis) -> Judged:
    """The grown model, as it was found; with effects, by simulation error where that matters and the judge
    proves that it predicts better."""
    best = found.best
    if found.chosen and best.fit:
        for other in _by_simulation(found, found.model, best.fit.free):
            differs = found.matter(best.model, other.model)
            if differs and found.compared(other.tested, best.tested).is_better:
                best = other
    return best


def _on_all(found: StepwiseDiagnosis) -> Tuple[_core.Model, List[FittedParameter]]:
    """The grown model and its parameters, fitted to all of the runs by likelihood. Of long runs, levels are
    fitted to the parts that the search used: their uncertainty hardly widens intervals then."""
    if found.is_excerpt:
        whole = Likelihood(found.all_runs, found.given, found.likelihood.varying, found.threads)
        with contextlib.suppress(Diverged):  # the motion in another part is not finite
            fit = whole.fit(found.model, found.fit.free, near=found.fit, levels=False)
            return fit.model, between_runs.widened(whole, fit, fit.parameters)
    parameters = found.fit.parameters
    with contextlib.suppress(Diverged):  # levels cannot be moved without a motion that is not finite
        parameters = found.likelihood.intervals(found.fit)
    return found.model, between_runs.widened(found.likelihood, found.fit, parameters)


def _by_simulation(
    found: StepwiseDiagnosis, model: _core.Model, free: Sequence[str], also: Sequence[_core.Model] = ()
) -> List[Judged]:
    """A model refitted by simulation error over long and over short windows, on which a disturbance adds up
    to less, from its values and from other models' values, where it can be simulated. Errors are over the
    windows and folds of a Diagnosis."""
    refits = []
    for part in (1.0, 1 / 3):
        with contextlib.suppress(Diverged):  # the simulation diverges
            length = part * windows.length(found.runs)
            fitter = window_error.WindowFitter(found.runs, found.threads, length=length)
            fitted = fitter.fit(model, free, also)
            refits.append(folds.judged_windows(fitted, found.tested(fitter, fitted)))
    return refits


def _prediction(
    found: StepwiseDiagnosis,
    by_user: Optional[HeldOutRuns],
    before: Judged,
    after: Judged,
    named: Optional[Judged],
) -> Optional[PredictionError]:
    """How far predicted poses are off, on the runs that the user held out or on the folds."""
    starts, runs = (by_user.starts, by_user.runs) if by_user else (found.starts, found.runs)
    if not len(starts.windows):
        return None
    errors = {"given": PoseError.of(starts.errors(runs, [found.given] * len(starts.windows)))}
    for name, one in (("refitted", before), ("improved", after), ("formula", named)):
        if one:
            errors[name] = (by_user.tested(one.model, one.fit) if by_user else one.tested).error
    if found.differences and after.others:
        written = [after.others[part].model for part in found.folds.start_of]
        if by_user:
            written = [after.model] * len(starts.windows)
        errors["written"] = PoseError.of(starts.errors(runs, written))
    return horizon.with_floors(runs, starts, errors, found.model, found.fit.levels)


def _steps(found: StepwiseDiagnosis, others: Optional[HeldOutRuns]) -> List[float]:
    """Error on runs held out of the model as it is by likelihood, and after each step."""
    if others is None:
        return [float(judged.heldout.sum()) for judged in (found.nominal, *(s.fit for s in found.steps))]
    names = [step.added for step in found.steps]
    fits = [found.search.fits[frozenset(names[:i])] for i in range(len(names) + 1)]
    return [float(others.error(fit.model, fit).sum()) for fit in fits]


def _holdout(
    found: StepwiseDiagnosis, others: Optional[HeldOutRuns], before: Judged, after: Judged
) -> Dict[str, Optional[judge.PairedComparison]]:
    """How sure each effect of the grown model is by runs that the user held out, by name. They contradict all
    effects where the best refit without any predicts them better."""
    if not others or not found.steps:
        return {step.added: None for step in found.steps}
    without, grown = (others.tested(one.model, one.fit) for one in (before, after))
    whole = found.compared(grown, without)
    if whole.is_worse:
        return {step.added: whole for step in found.steps}
    grown = others.tested(found.model, found.fit)
    rests = {step.added: others.tested(step.rest.model, step.rest) for step in found.steps}
    return {name: found.compared(grown, rest) for name, rest in rests.items()}


def _varies(found: StepwiseDiagnosis) -> List[Varying]:
    """Differences between runs, as fitted with the grown model."""
    return [
        Varying(
            kind.parameter,
            kind.unit,
            float(np.std(sizes, ddof=1)),
            found.differences[kind] / len(KINDS),
            found.differences[kind],
            sizes.tolist(),
        )
        for kind, sizes in zip(KINDS, found.fit.trims.T)
        if kind in found.differences
    ]


def _is_confirmed(found: StepwiseDiagnosis, named: Judged) -> bool:
    """Whether parts of the runs that a model with a formula was not fitted to prove it."""
    return found.compared(named.tested, found.best.tested).is_better


def _name(
    found: StepwiseDiagnosis, before: Judged, doubted: Optional[Ceiling] = None
) -> Tuple[Optional[naming.Formula], Optional[Judged]]:
    """A formula for what is learnable, and the model with it; None unless it is proved. It is made longer,
    twice at most, while the judge proves it and the noise leaves less. before: the best refit without
    effects, against which it must not be vetoed; doubted: a Ceiling that is not significant: the first
    formula must then show that something is missing."""
    formula: Optional[naming.Formula] = None
    best: Optional[Judged] = None

    def shows(made: naming.Formula) -> bool:
        """Whether runs show that a formula is learnable."""
        return doubted is None or doubted.reached_by(made.fit.model).said

    at, made = (found.likelihood, found.fit), found.formula_of(found.names, shows)
    for _ in range(3):
        if made is None:
            break
        try:
            named = found.folds.judge(made.fit)
        except Diverged:  # its motion is not finite
            break
        if best and not found.compared(named.tested, best.tested).is_better:
            break
        if doubted and not _is_confirmed(found, named):
            break
        formula, best = made, named
        if float(named.heldout.sum()) < EXPLAINED * found.noise_floor(found.names):
            break
        beside = ceiling.found_beside(found.likelihood, made.fit, found.runs, found.cut)
        made = None if beside is None else naming.formula(*at, beside.regression, made)
    if best and _is_confirmed(found, best) and not found.compared(best.tested, before.tested).is_worse:
        return formula, best
    return None, None


def _verdict(
    found: StepwiseDiagnosis,
    explained: bool,
    refuted: bool,
    varies: Sequence[Varying],
    left: Ceiling,
    agrees: Agreement,
) -> str:
    if left.said and not explained:
        return "memory" if left.of_the_past else "unexplained"
    if found.chosen:
        return "missing"
    if varies:
        return "varies"
    # An effect that the likelihood prefers and held-out parts refute leaves open what is missing, as does a
    # model of the likelihood that predicts worse than another fit.
    refuted |= any(dropped.change is None for dropped in found.dropped)
    open_still = refuted or left.found is not None or not agrees.holds
    if not explained and (open_still or left.bound > SMALL):
        return "undecided"
    return "complete"
