"""The report of a diagnosis, from a StepwiseDiagnosis and its Conclusion."""

from dataclasses import replace
from typing import Iterable, List, Mapping, Optional, Sequence, Tuple

from ground import _core
from ground.analysis import bands, excerpts
from ground.analysis.ceiling import Share
from ground.analysis.diagnosis import Step, StepwiseDiagnosis
from ground.analysis.distributions import chance_by_interval, student_outside
from ground.analysis.horizon import PoseError
from ground.analysis.likelihood import LikelihoodFit
from ground.analysis.search import LookAlike
from ground.analysis.verdict import MISREAD, Conclusion
from ground.diagnosing.report import (
    SCHEMA,
    AddedEffect,
    ArgumentShare,
    DiagnosisReport,
    DroppedEffect,
    EffectTests,
    ErrorShare,
    ErrorShares,
    Extent,
    FitLikelihood,
    Improved,
    Mistake,
    ModelError,
    Nominal,
    Parameters,
    Planned,
    ProposedEffect,
    ProposedParameter,
    ReportedParameter,
    RunNames,
    ScreenedEffect,
    TriedEffect,
    Unexplained,
    corrected,
)
from ground.effect_library import candidates
from ground.effect_library.parameters import FittedParameter

MAX_PLANNED_RUNS = 6  # runs that the next experiment is planned with
MAX_JUDGED = 3  # best effects whose errors are in the report, beside those found
CROSSED = "cross-validation"


def begun(
    diagnosis: StepwiseDiagnosis,
    conclusion: Conclusion,
    model_name: str,
    heldout: Sequence[_core.RunData] = (),
    findings: Sequence[Mistake] = (),
    selection: str = "",
) -> DiagnosisReport:
    """What the verdict needs of the report; heldout: the runs that it was judged on; findings: mistakes that
    the recordings look like; selection: which effects of the library were tried, "only wind"; empty: all."""
    before, after, left = conclusion.before, conclusion.after, conclusion.ceiling
    names = [run.name for run in diagnosis.runs]
    by, fit = "holdout" if heldout else CROSSED, diagnosis.fit
    improved = parameters(after.parameters, given=diagnosis.given)
    return DiagnosisReport(
        schema=SCHEMA,
        version=_core.version,
        model=model_name,
        means={**candidates.summaries(before.model), **candidates.summaries(conclusion.improved)},
        runs=RunNames(
            names,
            [run.name for run in heldout] or names,
            [run.name for run in diagnosis.runs if run.inertial is not None],
        ),
        windows=Extent(len(diagnosis.cut), diagnosis.fitter.available),
        seconds=Extent(excerpts.duration(diagnosis.runs), excerpts.duration(diagnosis.all_runs)),
        verdict=conclusion.verdict,
        findings=list(findings),
        selection=selection,
        nominal=Nominal(
            parameters(before.parameters, given=diagnosis.given),
            ModelError(float(before.error.sum()), conclusion.heldout[0], by),
            float(diagnosis.nominal.heldout.sum()),
            before.by,
        ),
        improved=Improved(
            [c.name for c in diagnosis.chosen],
            improved,
            ModelError(float(after.error.sum()), float(after.heldout.sum()), by),
            conclusion.cross_validated,
            after.by,
            FitLikelihood(float(fit.by_run.sum()), len(fit.free), diagnosis.samples)
            if after.by == "likelihood"
            else None,
        ),
        noise_floor=conclusion.heldout_floor,
        prediction=conclusion.prediction,
        matters=PoseError(*diagnosis.matters.tolist()),
        steps=_steps(diagnosis, conclusion, by, improved),
        dropped=_dropped(diagnosis),
        varies=conclusion.varies,
        ceiling=ErrorShares(
            _share(left.named),
            _share(left.learnable),
            _share(left.chance),
            left.bound,
            left.said,
            left.arguments,
            [] if left.found is None else [term.name for term in left.found.terms],
            conclusion.formula.means if conclusion.formula else None,
        ),
        agreement=conclusion.agreement,
        disturbance=dict(fit.levels),
        candidates=[],
        bands=[],
        next_experiment=None,
        unexplained=_unexplained(conclusion),
    )


def completed(
    report: DiagnosisReport,
    diagnosis: StepwiseDiagnosis,
    conclusion: Conclusion,
    room: Optional[_core.RoomPlan] = None,
) -> Tuple[DiagnosisReport, Optional[Planned]]:
    """The whole report, from what `begun` returned, and the next experiment.

    The errors of low-ranked effects are None. room: the _core.RoomPlan in which the next experiment has to
    stay (4 x 4 m).
    """
    with diagnosis.work.stage("errors of the best effects"):
        alike = [] if conclusion.verdict == MISREAD else diagnosis.unseen()
        tried, banded = _tried(diagnosis, alike), bands.coverage(conclusion.bands)
    planned = _planned(diagnosis, alike, room)
    proposed = planned and planned.experiment
    return replace(report, candidates=tried, bands=banded, next_experiment=proposed), planned


def screened(diagnosis: StepwiseDiagnosis) -> List[ScreenedEffect]:
    """What is known of single effects while a search goes on, the best first."""
    count, given = len(diagnosis.candidates), diagnosis.prediction_of(diagnosis.given)
    return [
        ScreenedEffect(
            trial.name,
            parameters(trial.parameters, trial.name + "."),
            trial.p_value,
            corrected(trial.p_value, count),
            float(trial.delta_bic),
            diagnosis.prediction_with(trial),
            given,
        )
        for trial in diagnosis.trials()
    ]


def parameters(
    parameters: Iterable[FittedParameter], prefix: str = "", given: Optional[_core.Model] = None
) -> Parameters:
    """Parameters by name; `start` is the value in the given model, where it has the parameter."""
    values = candidates.values(given) if given else {}
    return {
        p["name"][len(prefix) :]: ReportedParameter(
            p["value"],
            p["unit"],
            p["ci95"],
            p["identified"],
            values.get(p["name"], p.get("start")),
            p.get("deviation"),
            p.get("at_bound"),
            p.get("runs"),
        )
        for p in parameters
    }


def _steps(
    diagnosis: StepwiseDiagnosis, conclusion: Conclusion, by: str, improved: Parameters
) -> List[AddedEffect]:
    """The effects that were added; improved: parameters of the improved model."""
    return [
        AddedEffect(
            step.added,
            ModelError(float(step.fit.error.sum()), error, by),
            list(step.group),
            step.p_value,
            corrected(step.p_value, len(diagnosis.candidates)),
            EffectTests(step.confirmed, conclusion.holdout[step.added]),
            _chance_of_nothing(step, improved),
        )
        for step, error in zip(diagnosis.steps, conclusion.steps[1:])
    ]


def _chance_of_nothing(step: Step, improved: Parameters) -> float:
    """Probability that an effect of the library is nothing, by the interval of its parameter that is furthest
    from it. The intervals contain what runs differ by, the likelihood does not. Where the runs show
    parameters only together, intervals say nothing, and the held-out predictions decide."""
    name, judged = step.added, step.confirmed
    known = candidates.effects().get(name, {"parameters": []})
    neutral = {"%s.%s" % (name, p["name"]): p["neutral"] for p in known["parameters"] if not p["shape"]}
    own = [(improved[key], value) for key, value in neutral.items() if key in improved]
    if not all(p.identified for p, _ in own):
        better = ((judged.gain, judged.gain_error), (-judged.rise, judged.rise_error))
        chances = [_chance_of_rise(by, error) for by, error in better]
        return min(1.0, len(chances) * min(chances))
    return min((chance_by_interval(p.value, p.ci95, value) for p, value in own), default=0.0)


def _chance_of_rise(rise: float, error: float) -> float:
    """Probability of such a rise by chance, from its standard error; 0: the motion without it diverges."""
    if not rise > 0:  # or it is not known
        return 1.0
    return student_outside(rise / error) if error > 0 else 0.0


def _dropped(diagnosis: StepwiseDiagnosis) -> List[DroppedEffect]:
    """The effects that were not added."""
    return [
        DroppedEffect(
            one.trial.name,
            parameters(one.trial.parameters, one.trial.name + "."),
            one.why,
            one.trial.p_value,
            corrected(one.trial.p_value, len(diagnosis.candidates)),
            one.change,
        )
        for one in diagnosis.dropped
    ]


def _share(share: Share) -> ErrorShare:
    """A share of the error."""
    return ErrorShare(share.value, (share.low, share.high))


def _tried(diagnosis: StepwiseDiagnosis, alike: Sequence[LookAlike]) -> List[TriedEffect]:
    """The effects, each tried with the refitted nominal model, best first."""
    tried, chosen = diagnosis.tried, {c.name for c in diagnosis.chosen}
    judged = {t.name for t in tried[:MAX_JUDGED]} | chosen
    taken_over = {a.name: list(a.moved) for a in alike}
    groups = {step.added: list(step.group) for step in diagnosis.steps}
    first = [t.name for t in tried if t.equal]
    described = []
    for rank, trial in enumerate(tried, 1):
        fit = diagnosis.judged_of(trial) if trial.name in judged else None
        errors = (float(fit.error.sum()), float(fit.heldout.sum())) if fit else (None, None)
        group = groups.get(trial.name, [trial.name]) + taken_over.get(trial.name, [])
        described.append(
            TriedEffect(
                trial.name,
                parameters(trial.parameters, trial.name + "."),
                rank,
                trial.p_value,
                corrected(trial.p_value, len(diagnosis.candidates)),
                float(trial.delta_bic),
                ModelError(*errors, CROSSED),
                trial.name in chosen,
                first if trial.equal else group,
                trial.name not in taken_over,
            )
        )
    return described


def _planned(
    diagnosis: StepwiseDiagnosis, alike: Sequence[LookAlike], room: Optional[_core.RoomPlan]
) -> Optional[Planned]:
    """The experiment that would distinguish the effects of the first group. Without a group, the
    experiment that would show an effect which these runs cannot; None if there is none."""
    from ground.diagnosing import next_experiment

    many = len(diagnosis.runs)
    some = [diagnosis.runs[i * many // MAX_PLANNED_RUNS] for i in range(MAX_PLANNED_RUNS)]
    runs = diagnosis.runs if many <= MAX_PLANNED_RUNS else some

    def planned(rivals: Mapping[str, LikelihoodFit]) -> Optional[Planned]:
        return next_experiment.propose(rivals, runs, diagnosis.each, room, diagnosis.work)

    for step in diagnosis.steps:
        if len(step.group) > 1:
            rest = diagnosis.names - {step.added}
            return planned({name: diagnosis.search.fits[rest | {name}] for name in step.group})
    for other in alike:
        found = planned({other.name: other.fit, "": diagnosis.fit})
        if found:
            separates = [other.name, *other.moved]
            return found._replace(experiment=replace(found.experiment, separates=separates))
    return None


def _unexplained(conclusion: Conclusion) -> Unexplained:
    """What the error depends on, and an effect that would lower it on held-out runs, where something has no
    name."""
    if conclusion.verdict not in ("unexplained", "memory", "undecided"):
        return Unexplained([], None)
    formula, judged, proposal = conclusion.formula, conclusion.judged, None
    if formula and judged:
        entry = formula.entry
        proposal = ProposedEffect(
            entry["name"],
            entry.get("states", {}),
            entry["expression"],
            {name: ProposedParameter(**p) for name, p in entry["parameters"].items()},
            formula.means,
            ModelError(float(judged.error.sum()), float(judged.heldout.sum()), CROSSED),
        )
    return Unexplained(
        [ArgumentShare(name, share) for name, share in conclusion.ceiling.arguments.items()], proposal
    )
