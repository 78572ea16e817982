"""What a diagnosis found, as the dictionary of diagnosis.json (schema ground/diagnosis/1)."""

import dataclasses
from typing import Dict, Iterable, List, Optional, Sequence, Tuple, Union

from ground import _core
from ground.analysis import (
    bands,
    candidates,
    held_out,
    likelihood,
    look_alikes,
    naming,
    next_experiment,
    second_opinion,
    stages,
    study,
)
from ground.analysis.agreement import Agreement
from ground.analysis.ceiling import Ceiling, Share
from ground.analysis.conclusion import MISREAD, Conclusion
from ground.analysis.diagnosis import Diagnosis
from ground.annotations import Document
from ground.errors import GroundError

SCHEMA = "ground/diagnosis/1"
# Refits for the report alone are bounded, so that its cost grows linearly with the data.
# What a held-out error is of: parts of the runs fitted to, each by a fit to the others, or runs that the
# user held out.
CROSSED, HOLDOUT = "cross-validation", "holdout"
MIN_JUDGED = 3  # best effects whose errors are always in the report
MAX_PLANNED_RUNS = 6  # runs that the next experiment is planned with


def begun(
    diagnosis: Diagnosis,
    conclusion: Conclusion,
    model_name: str,
    heldout: Sequence[_core.RunData] = (),
    findings: Sequence[Document] = (),
) -> Document:
    """The part of the report that the verdict needs, of a Diagnosis and its Conclusion; heldout: the runs
    that it was judged on; findings: mistakes that the recordings look like."""
    before = conclusion.before
    names = [run.name for run in diagnosis.runs]
    with diagnosis.work.stage(stages.REPEATING):
        nested = conclusion.nested
    by = HOLDOUT if heldout else CROSSED
    return {
        "schema": SCHEMA,
        "model": model_name,
        "means": {
            **candidates.summaries(before.model),
            **candidates.summaries(conclusion.improved),
        },
        "runs": {"fit": names, "heldout": [run.name for run in heldout] or names},
        "windows": {"used": len(diagnosis.cut), "available": diagnosis.study.available},
        "verdict": conclusion.verdict,
        "findings": list(findings),
        "nominal": {
            "parameters": _parameters(before.parameters),
            "error": {"fit": before.error, "heldout": before.heldout, "by": by},
            "cross_validated": float(diagnosis.nominal.heldout.sum()),
            "by": before.by,
            "refits": {
                r.by: {"fit": r.error, "heldout": r.heldout, "by": by} for r in conclusion.refits
            },
        },
        "improved": {
            "effects": [c.name for c in diagnosis.chosen],
            "parameters": _parameters(conclusion.parameters),
            "error": _errors(diagnosis.best, nested, by),
            "cross_validated": float(diagnosis.best.heldout.sum()),
        },
        "noise_floor": conclusion.heldout_floor,
        "steps": [
            {
                "added": step.added,
                "error": _errors(step.fit, error, by),
                "group": list(step.group),
                "judged": dataclasses.asdict(conclusion.judgements[step.added]),
            }
            for step, error in zip(diagnosis.steps, conclusion.steps)
        ],
        "slight": _slight(diagnosis),
        "dropped": _dropped(diagnosis),
        "varies": conclusion.varies,
        "memory": _memory(conclusion),
        "ceiling": _ceiling(conclusion.ceiling, conclusion.formula),
        "agreement": _agreement(conclusion.agreement),
        "second_opinion": {
            "says": list(conclusion.opinion.says),
            "share": conclusion.opinion.share,
            "ci95": list(conclusion.opinion.interval),
            "words": second_opinion.words(conclusion.opinion),
        },
        "disturbance": _disturbance(diagnosis.fit),
    }


def completed(
    report: Document,
    diagnosis: Diagnosis,
    conclusion: Conclusion,
    thorough: bool = False,
    room: Optional[_core.RoomPlan] = None,
) -> Document:
    """The whole report, from what `begun` returned.

    thorough: gives the errors of all effects in the table, and plans the next experiment with all
    runs; otherwise the errors of low-ranked effects are None. room: the _core.RoomPlan in which the
    next experiment has to stay (4 x 4 m).
    """
    with diagnosis.work.stage(stages.ERRORS):
        alike = [] if conclusion.verdict == MISREAD else diagnosis.unseen()
        described, banded = _candidates(diagnosis, alike, thorough), bands.coverage(conclusion.bands)
    proposed = _next_experiment(diagnosis, alike, thorough, room)
    left: Document = {"fraction": 0.0, "where": [], "proposal": None}
    if conclusion.verdict in ("unexplained", "memory", "undecided"):
        left = _unexplained(diagnosis, conclusion)
    return {
        **report,
        "candidates": described,
        "bands": banded,
        "next_experiment": proposed,
        "unexplained": left,
    }


def _errors(
    fit: Union[held_out.Judged, study.Fit, None],
    heldout: Optional[float] = None,
    by: str = CROSSED,
) -> Document:
    if fit is None:
        return {"fit": None, "heldout": None, "by": by}
    heldout = fit.heldout.sum() if heldout is None else heldout
    return {"fit": float(fit.error.sum()), "heldout": float(heldout), "by": by}


def _parameters(parameters: Iterable[Document], prefix: str = "") -> Document:
    return {
        p["name"][len(prefix) :]: {
            "value": p["value"],
            "unit": p["unit"],
            "ci95": list(p["ci95"]),
            "identified": p["identified"],
        }
        for p in parameters
    }


def _memory(conclusion: Conclusion) -> Document:
    """Whether the past matters, and the kind of memory that was found."""
    found, kind = conclusion.memory, None
    if found:
        constants = zip(found.kind.constants, found.constants)
        kind = {
            "name": found.kind.name,
            "means": found.means,
            "constants": [{"name": c.name, "value": at, "unit": c.unit} for c, at in constants],
            "p_value": found.p_value,
        }
    return {"found": conclusion.verdict == "memory", "kind": kind}


def _share(share: Share) -> Document:
    return {"share": share.value, "ci95": [share.low, share.high]}


def _ceiling(left: Ceiling, formula: Optional[naming.Formula]) -> Document:
    """Shares of the squared error: named, learnable, chance; and what the learnable part depends on."""
    found = left.found
    terms = [] if found is None else [term.name for term in found.terms]
    return {
        "named": _share(left.named),
        "learnable": _share(left.learnable),
        "chance": _share(left.chance),
        "of_runs": _share(left.of_runs),
        "of_left": _share(left.left),
        "bound": left.bound,
        "said": left.said,
        "arguments": left.arguments,
        "terms": terms,
        "error": left.errors,
        "named_as": formula and formula.means,
        "poses": left.poses and dataclasses.asdict(left.poses),
    }


def _agreement(found: Agreement) -> Document:
    return {
        "error": {"measured": found.error, "expected": found.expected, "noise": found.noise},
        "deviations": found.deviations,
        "holds": found.holds,
    }


def _disturbance(fit: likelihood.Fit) -> Document:
    """The fitted levels: of the wrench in the body's frame, of the force in the room's, of the poses,
    and between runs."""
    levels = fit.levels

    def channels(kind: str) -> Dict[str, float]:
        return {c: levels["%s_%s" % (kind, c)] for c in "XYN"}

    return {
        "sigma": channels("sigma"),
        "time": channels("time"),
        "white": channels("white"),
        "room": {"sigma": levels["sigma_room"], "time": levels["time_room"]},
        "trim": dict(channels("trim"), thrust=levels["thrust"]),
        "noise": {"position": levels["position"], "heading": levels["heading"]},
    }


def _candidates(
    diagnosis: Diagnosis, alike: Sequence[look_alikes.LookAlike], thorough: bool
) -> List[Document]:
    """The effects, each tried with the refitted nominal model, best first."""
    tried, chosen = diagnosis.tried, {c.name for c in diagnosis.chosen}
    judged = {t.name for i, t in enumerate(tried) if thorough or i < MIN_JUDGED} | chosen
    taken_over = {a.name: list(a.moved) for a in alike}
    groups = {step.added: list(step.group) for step in diagnosis.steps}
    first = [t.name for t in tried if t.equal]
    return [
        {
            "effect": trial.name,
            "rank": rank,
            "p_value": trial.chance,
            "delta_bic": float(trial.delta_bic),
            "inclusion": trial.inclusion,
            "error": _errors(diagnosis.judged_of(trial) if trial.name in judged else None),
            "selected": trial.name in chosen,
            "group": (
                first
                if trial.equal
                else groups.get(trial.name, [trial.name]) + taken_over.get(trial.name, [])
            ),
            "seen": trial.name not in taken_over,
            "parameters": _parameters(trial.parameters, trial.name + "."),
        }
        for rank, trial in enumerate(tried, 1)
    ]


def _dropped(diagnosis: Diagnosis) -> List[Document]:
    """Effects that the likelihood prefers and that were not added."""
    return [
        {
            "effect": d.trial.name,
            "why": d.why,
            "p_value": d.trial.p_value,
            "parameters": _parameters(d.trial.parameters, d.trial.name + "."),
        }
        for d in diagnosis.dropped
    ]


def _slight(diagnosis: Diagnosis) -> Optional[Document]:
    """The effect that is detected but too small to matter; None without one."""
    trial = diagnosis.slight
    if trial is None or trial.change is None:
        return None
    return {
        "effect": trial.name,
        "p_value": trial.chance,
        "change": dataclasses.asdict(trial.change),
        "parameters": _parameters(trial.parameters, trial.name + "."),
    }


def _next_experiment(
    diagnosis: Diagnosis,
    alike: Sequence[look_alikes.LookAlike],
    thorough: bool,
    room: Optional[_core.RoomPlan],
) -> Optional[Document]:
    """The experiment that would distinguish the effects of the first group. Without a group, the
    experiment that would show an effect which these runs cannot; None if there is none."""
    each, runs = diagnosis.pool.map, list(diagnosis.runs)
    if len(runs) > MAX_PLANNED_RUNS and not thorough:
        runs = [runs[i * len(runs) // MAX_PLANNED_RUNS] for i in range(MAX_PLANNED_RUNS)]
    for step in diagnosis.steps:
        rivals = []
        for name in step.group:
            names = (diagnosis.names - {step.added}) | {name}
            rivals.append(next_experiment.Rival(name, diagnosis.search.fits[names]))
        if len(rivals) > 1:
            return next_experiment.propose(rivals, runs, each, room, diagnosis.work)
    for other in alike:
        rivals = [
            next_experiment.Rival(other.name, other.fit),
            next_experiment.Rival("", diagnosis.fit),
        ]
        proposed = next_experiment.propose(rivals, runs, each, room, diagnosis.work)
        if proposed:
            proposed["separates"] = [other.name, *other.moved]
            return proposed
    return None


def _unexplained(diagnosis: Diagnosis, conclusion: Conclusion) -> Document:
    """How much of the error is above the noise, what it depends on, and an effect that would lower it
    on held-out runs."""
    error = float(diagnosis.best.error.sum())
    proposed: List[Tuple[Document, likelihood.Fit]] = []
    if conclusion.memory:
        proposed.append((conclusion.memory.entry, conclusion.memory.fit))
    elif conclusion.formula:
        entry = dict(conclusion.formula.entry, means=conclusion.formula.means)
        proposed.append((entry, conclusion.formula.fit))
    proposal = None
    for entry, fit in proposed:
        try:
            judged = diagnosis.folds.judge(fit)
        except GroundError:
            continue  # the simulation diverges
        if judged.heldout.sum() < diagnosis.best.heldout.sum():
            proposal = dict(entry, error=_errors(judged))
    return {
        "fraction": max(0.0, 1 - (conclusion.noise_floor / error) ** 2),
        "where": [
            {"variable": name, "share": share}
            for name, share in conclusion.ceiling.arguments.items()
        ],
        "proposal": proposal,
    }


def effect_entry(proposal: Document) -> Document:
    """A proposal as model files list effects."""
    keys = ("name", "states", "expression", "frame", "parameters")
    return {key: proposal[key] for key in keys if key in proposal}
