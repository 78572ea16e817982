"""What a diagnosis found, as the dictionary of diagnosis.json (schema ground/diagnosis/1)."""

import dataclasses
from typing import TYPE_CHECKING, Any, Iterable, List, Mapping, Optional, Sequence

from ground import _core
from ground.analysis import bands, excerpts, horizon
from ground.analysis.diagnosis import StepwiseDiagnosis
from ground.analysis.evidence import Trial
from ground.analysis.likelihood import LikelihoodFit
from ground.analysis.search import LookAlike
from ground.analysis.verdict import MISREAD, Conclusion
from ground.effect_library import candidates
from ground.support.annotations import Document

if TYPE_CHECKING:
    from ground.diagnosing.next_experiment import NextExperiment

SCHEMA = "ground/diagnosis/1"
MAX_PLANNED_RUNS = 6  # runs that the next experiment is planned with
MAX_JUDGED = 3  # best effects whose errors are in the report, beside those found


def begun(
    diagnosis: StepwiseDiagnosis,
    conclusion: Conclusion,
    model_name: str,
    heldout: Sequence[_core.RunData] = (),
    findings: Sequence[Document] = (),
    selection: str = "",
) -> Document:
    """The part of the report that the verdict needs, of a StepwiseDiagnosis and its Conclusion; heldout: the
    runs that it was judged on; findings: mistakes that the recordings look like; selection: which effects
    of the library were tried, "only wind"; empty: all."""
    before, tried = conclusion.before, len(diagnosis.candidates)
    names = [run.name for run in diagnosis.runs]
    by = "holdout" if heldout else "cross-validation"
    sensed = [run.name for run in diagnosis.runs if run.inertial is not None]
    return {
        "schema": SCHEMA,
        "version": _core.version,
        "model": model_name,
        "means": {**candidates.summaries(before.model), **candidates.summaries(conclusion.improved)},
        "runs": {
            "fit": names,
            "heldout": [run.name for run in heldout] or names,
            **({"inertial": sensed} if sensed else {}),
        },
        "windows": {"used": len(diagnosis.cut), "available": diagnosis.fitter.available},
        "seconds": {
            "used": excerpts.duration(diagnosis.runs),
            "available": excerpts.duration(diagnosis.all_runs),
        },
        "verdict": conclusion.verdict,
        "findings": list(findings),
        **({"selection": selection} if selection else {}),
        "nominal": {
            "parameters": _parameters(before.parameters, given=diagnosis.given),
            "error": _error(before.error.sum(), conclusion.heldout[0], by),
            "cross_validated": float(diagnosis.nominal.heldout.sum()),
            "by": before.by,
        },
        "improved": {
            "effects": [c.name for c in diagnosis.chosen],
            "parameters": _parameters(conclusion.after.parameters, given=diagnosis.given),
            "error": _error(conclusion.after.error.sum(), conclusion.after.heldout.sum(), by),
            "cross_validated": conclusion.cross_validated,
            "by": conclusion.after.by,
            **({"likelihood": _likelihood(diagnosis)} if conclusion.after.by == "likelihood" else {}),
        },
        "noise_floor": conclusion.heldout_floor,
        "prediction": horizon.as_document(conclusion.prediction),
        "matters": dict(zip(("position_mm", "heading_deg"), diagnosis.matters.tolist())),
        "steps": [
            {
                "added": step.added,
                "error": _error(step.fit.error.sum(), error, by),
                "group": list(step.group),
                **_chances(step.p_value, tried),
                "judged": {
                    "fitted": dataclasses.asdict(step.confirmed),
                    "holdout": held and dataclasses.asdict(held),
                },
            }
            for step, error in zip(diagnosis.steps, conclusion.steps[1:])
            for held in [conclusion.holdout[step.added]]
        ],
        "dropped": [
            {
                **_tried(dropped.trial, tried, why=dropped.why),
                "change": dropped.change and dataclasses.asdict(dropped.change),
            }
            for dropped in diagnosis.dropped
        ],
        "varies": conclusion.varies,
        **_left(conclusion),
        "disturbance": dict(diagnosis.fit.levels),
    }


def completed(
    report: Document,
    diagnosis: StepwiseDiagnosis,
    conclusion: Conclusion,
    room: Optional[_core.RoomPlan] = None,
) -> Document:
    """The whole report, from what `begun` returned.

    The errors of low-ranked effects are None. room: the _core.RoomPlan in which the next experiment has to
    stay (4 x 4 m).
    """
    with diagnosis.work.stage("errors of the best effects"):
        alike = [] if conclusion.verdict == MISREAD else diagnosis.unseen()
        described, banded = _candidates(diagnosis, alike), bands.coverage(conclusion.bands)
    proposed = _next_experiment(diagnosis, alike, room)
    return {
        **report,
        "candidates": described,
        "bands": banded,
        "next_experiment": proposed and dataclasses.asdict(proposed),
        "unexplained": _unexplained(conclusion),
    }


def _likelihood(diagnosis: StepwiseDiagnosis) -> Document:
    """The log-likelihood of the grown model, and what information criteria need."""
    fit = diagnosis.fit
    return {
        "llf": float(fit.by_run.sum()),
        "parameters": len(fit.free),
        "observations": diagnosis.samples,
    }


def _error(fit: Optional[float], heldout: Optional[float], by: str = "cross-validation") -> Document:
    """Errors on the runs fitted to and on those held out: parts of these, each by a fit to the others, or,
    by "holdout", runs of the user."""
    return {"fit": fit and float(fit), "heldout": heldout and float(heldout), "by": by}


def _parameters(
    parameters: Iterable[Document], prefix: str = "", given: Optional[_core.Model] = None
) -> Document:
    """Parameters by name; `start` is the value in the given model, where it has the parameter."""
    values = candidates.values(given) if given else {}
    return {
        p["name"][len(prefix) :]: {
            "value": p["value"],
            "unit": p["unit"],
            "ci95": list(p["ci95"]),
            "identified": p["identified"],
            **{key: p[key] for key in ("start", "deviation", "at_bound", "runs") if key in p},
            **({"start": values[p["name"]]} if p["name"] in values else {}),
        }
        for p in parameters
    }


def _left(conclusion: Conclusion) -> Document:
    """What the improved model leaves: shares of the squared error, and whether the rest is a random push."""
    left, agrees = conclusion.ceiling, conclusion.agreement
    return {
        "ceiling": {
            **{
                name: {"share": share.value, "ci95": [share.low, share.high]}
                for name, share in (
                    ("named", left.named),
                    ("learnable", left.learnable),
                    ("chance", left.chance),
                )
            },
            "bound": left.bound,
            "said": left.said,
            "arguments": left.arguments,
            "terms": [] if left.found is None else [term.name for term in left.found.terms],
            "named_as": conclusion.formula and conclusion.formula.means,
        },
        "agreement": {
            "error": {"measured": agrees.error, "expected": agrees.expected, "noise": agrees.noise},
            "holds": agrees.holds,
            "frequency": agrees.frequency,
            "common": agrees.common and dataclasses.asdict(agrees.common),
        },
    }


def _chances(p: float, tried: int) -> Document:
    """A p-value, and its bound for the number of effects tried (Bonferroni)."""
    return {"p": p, "p_corrected": min(1.0, tried * p)}


def renewed(report: Document) -> Document:
    """A report as also older versions wrote it, whose `p_value` was corrected in some lists only."""
    for kind in ("candidates", "varies", "steps", "dropped"):
        for row in (row for row in report[kind] if "p_value" in row):
            p, corrected = row.pop("p_value"), kind in ("candidates", "varies")
            row.update({"p": None, "p_corrected": p} if corrected else _chances(p, len(report["candidates"])))
    return report


def _tried(trial: Trial, count: int, **more: Any) -> Document:
    """An effect with its parameters, more, and its chances among some that were tried."""
    parameters = _parameters(trial.parameters, trial.name + ".")
    return {"effect": trial.name, "parameters": parameters, **more, **_chances(trial.p_value, count)}


def tested(diagnosis: StepwiseDiagnosis) -> List[Document]:
    """What is known of single effects while a search goes on, the best first."""
    return [
        {
            **_tried(trial, len(diagnosis.candidates)),
            "delta_bic": float(trial.delta_bic),
            "prediction": off and dataclasses.asdict(off),
        }
        for trial in diagnosis.trials()
        for off in [diagnosis.prediction_with(trial)]
    ]


def _candidates(diagnosis: StepwiseDiagnosis, alike: Sequence[LookAlike]) -> List[Document]:
    """The effects, each tried with the refitted nominal model, best first."""
    tried, chosen = diagnosis.tried, {c.name for c in diagnosis.chosen}
    judged = {t.name for t in tried[:MAX_JUDGED]} | chosen
    taken_over = {a.name: list(a.moved) for a in alike}
    groups = {step.added: list(step.group) for step in diagnosis.steps}
    first = [t.name for t in tried if t.equal]
    described = []
    for rank, trial in enumerate(tried, 1):
        fit = diagnosis.judged_of(trial) if trial.name in judged else None
        group = groups.get(trial.name, [trial.name]) + taken_over.get(trial.name, [])
        described.append(
            {
                **_tried(trial, len(diagnosis.candidates), rank=rank),
                "delta_bic": float(trial.delta_bic),
                "error": _error(fit.error.sum(), fit.heldout.sum()) if fit else _error(None, None),
                "selected": trial.name in chosen,
                "group": first if trial.equal else group,
                "seen": trial.name not in taken_over,
            }
        )
    return described


def _next_experiment(
    diagnosis: StepwiseDiagnosis,
    alike: Sequence[LookAlike],
    room: Optional[_core.RoomPlan],
) -> "Optional[NextExperiment]":
    """The experiment that would distinguish the effects of the first group. Without a group, the
    experiment that would show an effect which these runs cannot; None if there is none."""

    from ground.diagnosing import next_experiment

    many = len(diagnosis.runs)
    some = [diagnosis.runs[i * many // MAX_PLANNED_RUNS] for i in range(MAX_PLANNED_RUNS)]
    runs = diagnosis.runs if many <= MAX_PLANNED_RUNS else some

    def propose(rivals: Mapping[str, LikelihoodFit]) -> "Optional[NextExperiment]":
        return next_experiment.propose(rivals, runs, diagnosis.each, room, diagnosis.work)

    for step in diagnosis.steps:
        if len(step.group) > 1:
            rest = diagnosis.names - {step.added}
            return propose({name: diagnosis.search.fits[rest | {name}] for name in step.group})
    for other in alike:
        proposed = propose({other.name: other.fit, "": diagnosis.fit})
        if proposed:
            return dataclasses.replace(proposed, separates=[other.name, *other.moved])
    return None


def _unexplained(conclusion: Conclusion) -> Document:
    """What the error depends on, and an effect that would lower it on held-out runs, where something has no
    name."""
    found: Document = {"where": [], "proposal": None}
    if conclusion.verdict in ("unexplained", "memory", "undecided"):
        formula, judged, shares = conclusion.formula, conclusion.judged, conclusion.ceiling.arguments
        found["where"] = [{"variable": name, "share": share} for name, share in shares.items()]
        if formula and judged:
            error = _error(judged.error.sum(), judged.heldout.sum())
            found["proposal"] = dict(formula.entry, means=formula.means, error=error)
    return found


def proposed_effect(report: Document) -> Optional[Document]:
    """The formula that a report proposes, as model files list effects; None without one."""
    proposal = report["unexplained"]["proposal"]
    return proposal and {key: value for key, value in proposal.items() if key not in ("means", "error")}
