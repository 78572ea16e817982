"""What a job does, through the public functions, and what it tells of it in plain values."""

import os
import re
from dataclasses import asdict
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple, Union

from ground import Addition, Fit, Model, Recording, Room, add, compare, diagnose, fit, simulate
from ground.checks.layouts import listed
from ground.support.jobs import Tell
from ground.support.progress import Listener, Report

Errors = Dict[str, Optional[float]]  # fields of a PoseError
Cuts = Dict[str, List[Tuple[float, float]]]  # by run, spans that are left out [s]
ROW = ("effect", "meaning", "size", "certain", "selected", "seen")  # what the page shows of an effect


def parts(recordings: Sequence[Recording], names: Sequence[str], cuts: Cuts) -> List[Recording]:
    """The recordings of some names, without the spans that are left out."""
    return [
        run.without(*cuts[run.name]) if cuts.get(run.name) else run for run in recordings if run.name in names
    ]


def worker(recordings: Sequence[Recording], room: Optional[Room]) -> Callable[..., None]:
    """The function that does jobs on recordings: fit, add, try, search, page."""

    def work(kind: str, arguments: Tuple[Any, ...], tell: Tell) -> None:
        def progress(report: Report) -> None:
            tell("progress", report)

        text, names, cuts, more = arguments
        model, runs = Model.parse(text), parts(recordings, names, cuts)
        if kind == "fit":
            tell("done", fitted(fit(model, runs, free=model.free, progress=progress)))
        elif kind in ("add", "try"):
            tell("done", added(model, more if isinstance(more, list) else [more], runs, progress))
        elif kind == "page":
            tell("done", saved(model, runs, **more))
        else:
            if more:  # the stretch that candidates are judged on
                runs = [run.within(*more[1:]) for run in runs if run.name == more[0]]
            tell("done", searched(model, runs, room, tell, progress))

    return work


def saved(
    model: Model, runs: Sequence[Recording], folder: str, given: str, files: List[str]
) -> Dict[str, object]:
    """The page that compares a model with the given one, beside other files."""
    first = Model.parse(given)
    models = {"given": first} if model == first else {"given": first, "model": model}
    place = compare(models, runs).save(os.path.join(folder, "page"), force=True)
    return {"folder": folder, "files": [*files, os.path.relpath(place, folder)]}


def fitted(found: Fit) -> Dict[str, object]:
    """A Fit."""
    return {**_refitted(found, "given", "fitted"), "remarks": found.remarks}


def added(
    model: Model, effects: Sequence[Any], runs: Sequence[Recording], progress: Listener
) -> Dict[str, object]:
    """Effects added one after the other, as one step: it helps where one helps and all others may."""
    steps: List[Addition] = []
    for effect in effects:
        steps.append(add(model, effect, runs, progress=progress))
        model = Model.parse(steps[-1].model.format())
    reasons = ["%s (%s): %s" % (one.effect, one.answer, one.verdict.reason) for one in steps]
    return {
        **_refitted(steps[-1], "without", "with"),
        "before": _refitted(steps[0], "without", "with")["before"],
        "effect": listed([one.effect for one in steps]),
        "helps": {"yes"} <= {one.answer for one in steps} <= {"yes", "not clear"},
        "reason": "; ".join(reasons) if len(steps) > 1 else steps[0].verdict.reason,
    }


def _refitted(found: Union[Fit, Addition], before: str, after: str) -> Dict[str, object]:
    """A fit or an addition; before, after: names of the models in its prediction error."""
    off = found.prediction
    return {
        "model": found.model.format(),
        "parameters": {name: {"words": p.words} for name, p in found.parameters.items()},
        "before": off and asdict(off.errors[before]),
        "after": off and asdict(off.errors[after]),
        "floor": off and asdict(off.mocap),
    }


def searched(
    model: Model, runs: Sequence[Recording], room: Optional[Room], tell: Tell, progress: Listener
) -> Dict[str, object]:
    """A Diagnosis; it passes on rows of the list while it goes on."""
    predicted: Dict[str, Dict[str, object]] = {}  # by effect, what is known since it was refitted

    def rows(tried: Sequence[Mapping[str, Any]]) -> List[Dict[str, object]]:
        predicted.update(
            {r["effect"]: {k: r[k] for k in ("certain", "prediction")} for r in tried if r.get("prediction")}
        )
        return [
            {
                **{key: row[key] for key in ROW if key in row},
                **({} if row.get("selected") else predicted.get(row["effect"], {})),
                "group": [other for other in row.get("group", ()) if other != row["effect"]],
            }
            for row in tried
        ]

    found = diagnose(model, runs, tried=lambda tried: tell("rows", rows(tried)), progress=progress, room=room)
    planned = found.report["next_experiment"]
    if planned:  # where the improved model goes, open loop, from home until it leaves the room
        place, lift = room or Room.load("room_4x4"), float(planned["arguments"].partition("--lift ")[2] or 1)
        begin = (*place.home, 0.0)
        flown = simulate(found.improved, inputs=found.next_inputs, start_pose=begin, lift=lift).to_frame()
        left = flown.apply(lambda at: place.clearance((at.x, at.y)) < 0, axis=1).cummax()
        planned = {**planned, "path": flown[~left][["x", "y"]][::5].round(4).to_dict("list")}
    lines = [list(line) for line in found.headline() if not re.match("Model|Next", line[0])]
    steps = [step["added"] for step in found.report["steps"]]
    told = {name: text for name in steps for _, text in lines if re.match(name + "( -|:)", text)}
    together: List[Dict[str, object]] = []
    tried = {str(row["effect"]): row for row in rows(found.tried)}
    for name, text in told.items():  # what the answer says of it, not what it would be alone
        size, _, certain = text.partition(": ")[2].rstrip(".").rpartition(". ")
        own = {"effect": name, "size": size, "certain": certain, "group": []}
        together.append({**tried.pop(name, {}), **own, "found": [other for other in told if other != name]})
    lines = [line for line in lines if line[1] not in told.values()]
    return {
        "rows": [*together, *tried.values()],
        "answer": [["Missing", listed(list(told)) + "."], *lines] if told else lines,
        "proposal": found.proposal and found.proposal.entry,
        "next": planned,
    }
