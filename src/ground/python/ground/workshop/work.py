"""What a job does, through the public functions, and what it tells of it in plain values."""

import os
from dataclasses import asdict
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

import ground
from ground.analysis import window_error
from ground.analysis.effects import Effect
from ground.analysis.formula_words import with_interval
from ground.analysis.search import LEVEL
from ground.diagnosing import answer
from ground.models import Model, Room
from ground.recordings.recording import Recording
from ground.support.annotations import Document
from ground.support.jobs import Tell
from ground.support.progress import Listener, Report

MOST_SIZES = 3  # parameters of an effect that its row has
Cuts = Dict[str, List[Tuple[float, float]]]  # by run, spans that are left out [s]


def parts(recordings: Sequence[Recording], names: Sequence[str], cuts: Cuts) -> List[Recording]:
    """The recordings of some names, without the spans that are left out."""
    return [
        run.without(*cuts[run.name]) if cuts.get(run.name) else run for run in recordings if run.name in names
    ]


def worker(recordings: Sequence[Recording], room: Optional[Room]) -> Callable[..., None]:
    """The function that does jobs on recordings: fit, add, try, search, page."""

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
        elif kind == "page":
            tell("done", saved(model, runs, **more))
        else:
            if more:  # the stretch that candidates are judged on
                runs = [run.within(*more[1:]) for run in runs if run.name == more[0]]
            tell("done", searched(model, runs, room, tell, progress))

    return work


def saved(model: Model, runs: Sequence[Recording], folder: str, given: str, files: List[str]) -> Document:
    """The page that compares a model with the given one, beside other files."""
    first = Model.parse(given)
    models = {"given": first} if model == first else {"given": first, "model": model}
    place = ground.compare(models, runs).save(os.path.join(folder, "page"), force=True)
    return {"folder": folder, "files": [*files, os.path.relpath(place, folder)]}


def fitted(found: ground.Fit) -> Document:
    """A Fit."""
    return {**_refitted(found, "given", "fitted"), "remarks": found.remarks}


def added(found: ground.Addition) -> Document:
    """An Addition."""
    verdict = {"helps": found.verdict.helps, "reason": found.verdict.reason}
    return {**_refitted(found, "without", "with"), "effect": found.effect, **verdict}


def _refitted(found: Any, before: str, after: str) -> Document:
    """A fit or an addition; before, after: names of the models in its prediction error."""
    off, names = found.prediction, ("value", "ci95", "unit", "identified")
    return {
        "model": found.model.format(),
        "parameters": {name: {key: getattr(p, key) for key in names} for name, p in found.parameters.items()},
        "before": off and asdict(off.errors[before]),
        "after": off and asdict(off.errors[after]),
        "floor": off and asdict(off.mocap),
    }


def searched(
    model: Model, runs: Sequence[Recording], room: Optional[Room], tell: Tell, progress: Listener
) -> Document:
    """A Diagnosis; rows of the list are told of while it goes on."""
    predictions: Dict[str, Document] = {}

    def tried(rows: List[Document]) -> None:
        predictions.update({row["effect"]: row["prediction"] for row in rows})
        tell("rows", [_row(row, predictions, {}) for row in rows])

    found = ground.diagnose(model, runs, tried=tried, progress=progress, room=room)
    report, proposal = found.report, found.proposal
    planned = report["next_experiment"]
    if planned:  # where the improved model goes, open loop
        flown = ground.simulate(found.improved, inputs=found.next_inputs).to_frame().iloc[::5]
        planned = {**planned, "path": {name: flown[name].round(4).tolist() for name in ("x", "y")}}
    return {
        "rows": [_row(row, predictions, report["means"]) for row in report["candidates"]],
        "answer": [list(line) for line in answer.known_first(report)],
        "proposal": proposal and proposal.entry,
        "next": planned,
    }


def _row(row: Document, predictions: Dict[str, Document], means: Document) -> Document:
    """A row of the list of effects."""
    name, p = row["effect"], row["p_corrected"]
    sizes = [
        "%s %s" % (key, with_interval(one["value"], one["ci95"][0], one["ci95"][1], one["unit"]))
        for key, one in row["parameters"].items()
        if one["identified"]
    ]
    return {
        "effect": name,
        "meaning": Effect(name).meaning or means.get(name, ""),
        "size": ", ".join(sizes[:MOST_SIZES]) or "not identifiable from these runs",
        "certain": next(words for bound, words in answer.CERTAINTY if p < bound)
        if p < LEVEL
        else "not significant",
        "prediction": predictions.get(name),
        "group": [other for other in row.get("group", ()) if other != name],
        **{key: row[key] for key in ("selected", "seen") if key in row},
    }
