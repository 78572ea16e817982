"""What a job does, through the public functions, and what it tells of it in plain values."""

from dataclasses import asdict
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

import ground
from ground.analysis import window_error
from ground.analysis.effects import Effect
from ground.analysis.horizon import PoseError
from ground.diagnosing import answer
from ground.models import Model, Parameter, Room
from ground.recordings.recording import Recording
from ground.support.annotations import Document
from ground.support.progress import Report
from ground.workbench.jobs import Tell

Cuts = Dict[str, List[Tuple[float, float]]]  # by run, spans that are left out [s]


def parts(recordings: Sequence[Recording], names: Sequence[str], cuts: Cuts) -> List[Recording]:
    """The recordings of some names, without the spans that are left out."""
    return [
        run.without(*cuts[run.name]) if cuts.get(run.name) else run for run in recordings if run.name in names
    ]


def worker(recordings: Sequence[Recording], room: Optional[Room]) -> Callable[..., None]:
    """The function that does jobs on recordings: fit, add, try, search."""

    def work(kind: str, arguments: Tuple[Any, ...], tell: Tell) -> None:
        def progress(report: Report) -> None:
            tell("progress", asdict(report))

        text, names, cuts, more = arguments
        model, runs = Model.parse(text), parts(recordings, names, cuts)
        if kind == "fit":
            found = ground.fit(model, runs, free=window_error.free_parameters(model.core), progress=progress)
            tell("done", fitted(found))
        elif kind in ("add", "try"):
            tell("done", added(ground.add(model, Effect.of(more), runs, progress=progress)))
        else:
            runs = (
                [run.within(*more["judge"][1:]) for run in runs if run.name == more["judge"][0]]
                if more["judge"]
                else runs
            )
            tell("done", searched(model, runs, room, tell, progress))

    return work


def fitted(found: ground.Fit) -> Document:
    """A Fit."""
    off = found.prediction
    return {
        "model": found.model.format(),
        "parameters": {name: _parameter(p) for name, p in found.parameters.items()},
        "before": off and asdict(off.errors["given"]),
        "after": off and asdict(off.errors["fitted"]),
        "remarks": found.remarks,
    }


def added(found: ground.Addition) -> Document:
    """An Addition."""
    off = found.prediction
    return {
        "model": found.model.format(),
        "effect": found.effect,
        "parameters": {name: _parameter(p) for name, p in found.parameters.items()},
        "before": off and asdict(off.errors["without"]),
        "after": off and asdict(off.errors["with"]),
        "helps": found.verdict.helps,
        "reason": found.verdict.reason,
    }


def searched(
    model: Model,
    runs: Sequence[Recording],
    room: Optional[Room],
    tell: Tell,
    progress: Callable[[Report], None],
) -> Document:
    """A Diagnosis; rows of the list are told of while it goes on."""
    found = ground.diagnose(
        model,
        runs,
        tried=lambda rows: tell("rows", [_row(row, {}) for row in rows]),
        progress=progress,
        room=room,
    )
    report = found.report
    groups = {row["effect"]: row for row in report["candidates"]}
    last = [_row({**row, "prediction": None}, report["means"]) for row in report["candidates"]]
    for row in last:
        entry = groups[row["effect"]]
        row.update(
            group=[name for name in entry["group"] if name != row["effect"]],
            selected=entry["selected"],
            seen=entry["seen"],
        )
    proposal = found.proposal
    planned = report["next_experiment"]
    return {
        "rows": last,
        "answer": [list(line) for line in answer.known_first(report)],
        "proposal": proposal and proposal.entry,
        "means": report["unexplained"]["proposal"] and report["unexplained"]["proposal"]["means"],
        "next": planned
        and {
            **planned,
            "path": _flown(found.improved, found.next_inputs),
            "inputs": found.next_inputs.tolist(),
        },
    }


def _flown(model: Model, inputs: Any) -> Document:
    """Where the improved model goes in the next experiment, open loop."""
    made = ground.simulate(model, inputs=inputs).to_frame().iloc[::5]
    return {"x": made.x.round(4).tolist(), "y": made.y.round(4).tolist()}


def _row(row: Document, means: Document) -> Document:
    """A row of the list of effects."""
    meaning = Effect(row["effect"]).meaning or means.get(row["effect"], "")
    sizes = [
        "%s %s" % (name, _parameter_words(name, p))
        for name, p in row["parameters"].items()
        if p["identified"]
    ]
    return {
        "effect": row["effect"],
        "meaning": meaning,
        "size": ", ".join(sizes[:3]) or "not identifiable from these runs",
        "p": row["p_corrected"],
        "certain": next(words for bound, words in answer.CERTAINTY if row["p_corrected"] < bound)
        if row["p_corrected"] < 0.01
        else "not significant",
        "gain": -row["delta_bic"],
        "prediction": row["prediction"],
    }


def _parameter_words(name: str, p: Document) -> str:
    from ground.analysis.formula_words import with_interval

    return with_interval(p["value"], *p["ci95"], p["unit"])


def _parameter(p: Parameter) -> Document:
    return {
        "value": p.value,
        "ci95": list(p.ci95),
        "unit": p.unit,
        "identified": p.identified,
        "words": p.words,
    }


def pose_error(found: PoseError) -> Document:
    """A PoseError."""
    return asdict(found)
