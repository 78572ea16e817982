"""history: all runs of a laboratory, what drifts, what jumped, and which craft is odd.

history.json, schema ground/history/1 (docs/schemas/history.schema.json explains the keys), has what is
found; runs.csv has a line for each run. What a run tells by itself is kept in the user's cache by the
content of the run and the model, so that the next call fits new runs only.
"""

import argparse
import functools
from dataclasses import dataclass
from typing import Dict, Iterable, List, Optional, Sequence, Tuple, Union

from ground.data import bag_arguments
from ground.ledger import analysed, document, estimates, finding, verdicts
from ground.ledger.analysed import Analysed
from ground.ledger.estimates import EstimateTask
from ground.ledger.finding import Place
from ground.ledger.result import History, prepare
from ground.models import Model, ModelLike
from ground.reading.mapping import DEFAULT, FieldMapping, load
from ground.reports import result_folder
from ground.support import command_line
from ground.support.annotations import Document, Path
from ground.support.command_line import option
from ground.support.errors import GroundError, OptionError
from ground.support.progress import Progress, Work
from ground.support.results import distinct_labels
from ground.support.workers import Workers

LOOKING, FITTING = "looking at runs", "fitting each run"
TOGETHER = "all runs together"
Folders = Union[Path, Iterable[Path]]


@dataclass(frozen=True)
class HistoryOptions(bag_arguments.AsRecorded):
    """How runs are grouped into crafts, and what is estimated."""

    model: Optional[ModelLike] = option(
        None, "model of the crafts (the one that was recorded with the runs)", metavar="M.yaml"
    )
    craft: Optional[str] = option(
        None,
        "which craft flew: a level of folders below FOLDER (1 is the first), or a pattern whose first group "
        "in a run's path is the craft (the recorded model's file, else the first folder that is no date)",
        metavar="HOW",
    )
    free: Optional[Sequence[str]] = option(
        None, "parameters to follow (all that runs of the model may identify)", metavar="NAME", nargs="+"
    )
    tolerance: float = option(
        0.1,
        "difference between crafts of a type that does not count, as a share of a parameter, or of an "
        "effect's usual size (%(default)g)",
        metavar="SHARE",
        range=(0.0, 10.0),
    )
    verdicts: bool = option(False, "repeat saved diagnoses that another version made (minutes for each)")


@command_line.takes(HistoryOptions)
def history(
    folders: Folders,
    *,
    mapping: Union[Path, FieldMapping, None] = None,
    progress: Progress = None,
    options: HistoryOptions,
) -> History:
    """What drifts, what jumped between which two runs, and which craft is odd, over all runs below folders.

    folders: a path or several. mapping: a mapping file, or its content; tables need one. progress: called
    with a ground.support.progress.Report at each step. Each run has an estimate of its own, of the likelihood
    that a diagnosis takes; then all of a type are fitted together: runs within days within crafts. Runs that
    cannot be used are listed. GroundError when there is no run, no model or an option does not go with
    them. Options, as keyword arguments or as HistoryOptions:

    >>> found = ground.history(bag, model=model_file, free=["k", "N_r"])
    >>> len(found.runs), found.changes, found.odd
    (1, [], [])
    >>> list(found.to_frame())[:4]
    ['recorded', 'craft', 'type', 'length']
    """
    command_line.check(options)
    work = Work.of(progress)
    given = (
        [folders] if isinstance(folders, (str, bytes)) or hasattr(folders, "__fspath__") else list(folders)
    )
    paths = [str(path) for path in given]
    if mapping is None:
        mapping = DEFAULT
    elif not isinstance(mapping, FieldMapping):
        mapping = load(str(mapping))
    places, diagnoses = finding.find(paths, mapping)
    look = functools.partial(_looked_at, mapping, options, work)
    runs, left_out = _runs(places, look([place.path for place in places], options.model))
    if not runs:
        raise GroundError("%(path)s: %(why)s" % left_out[0])
    crafts_by = _add_crafts(runs, options.craft)
    by_type = _types(runs, options)
    if options.model is None:
        for model, own in by_type:
            for run, fitted in zip(own, look([run["path"] for run in own], model)):
                run["_found"] = fitted
    found: List[Tuple[Analysed, List[Document]]] = []
    with work.stage(TOGETHER, len(by_type)):
        for model, own in work.each(by_type):
            usable = [run for run in own if "failed" not in run["_found"]]
            left_out += [_unused(r["path"], r["_found"]["failed"]) for r in own if "failed" in r["_found"]]
            if usable:
                found.append(_together(model, usable, options))
    if not found:
        raise GroundError("%(path)s: %(why)s; none of the runs can be used" % left_out[0])
    known = verdicts.read(diagnoses)
    if options.verdicts:
        known = verdicts.again(known, [place.path for place in places], mapping, work)
    types = [one for one, _ in found]
    report = document.of(paths, crafts_by, types, [own for _, own in found], left_out, known)
    return History(report)


def _looked_at(
    mapping: FieldMapping,
    options: HistoryOptions,
    work: Work,
    paths: Sequence[str],
    model: Optional[ModelLike],
) -> List[Document]:
    """What runs recorded, with their estimates if there is a model (estimates.looked_at)."""
    text, stage = "", LOOKING
    free: Tuple[str, ...] = ()
    if model is not None:
        extended, free = estimates.followed(Model.of(model), options.free)
        text, stage = extended.format(), FITTING
    tasks = [EstimateTask(path, mapping, options.as_recorded, text, free) for path in paths]
    with work.stage(stage, len(tasks)):
        return list(work.each(Workers(processes=True).map(estimates.looked_at, tasks)))


def _unused(path: str, why: str) -> Document:
    return {"path": path, "why": why.replace(path + ": ", "")}


def _runs(places: Sequence[Place], recorded: Sequence[Document]) -> Tuple[List[Document], List[Document]]:
    """The runs in order of time, and those that are left out: what cannot be read, and copies."""
    runs: List[Document] = []
    left_out: List[Document] = []
    contents: Dict[str, str] = {}
    for place, found in zip(places, recorded):
        if "failed" in found:
            left_out.append(_unused(place.path, found["failed"]))
        elif found["content"] in contents:
            left_out.append(_unused(place.path, "a copy of %s" % contents[found["content"]]))
        else:
            contents[found["content"]] = place.path
            at, source = finding.recorded_at(place, found["first_stamp"])
            told = {"path": place.path, "recorded": at.isoformat(timespec="seconds"), "time_from": source}
            runs.append({**told, "_place": place, "_found": found})
    names = [place.name for place in (run["_place"] for run in runs)]
    for run, name in zip(runs, distinct_labels(names, [run["path"] for run in runs])):
        run["name"] = name
    return sorted(runs, key=lambda run: (run["recorded"], run["path"])), left_out


def _add_crafts(runs: Sequence[Document], how: Optional[str]) -> str:
    """Adds the craft of each run; how it was found."""
    crafts, crafts_by = finding.crafts(
        [r["_place"] for r in runs], [r["_found"]["model_name"] for r in runs], how
    )
    for run, craft in zip(runs, crafts):
        run["craft"] = craft
    return crafts_by


def _types(runs: Sequence[Document], options: HistoryOptions) -> List[Tuple[Model, List[Document]]]:
    """The models, each with its runs: the given one with all, else of each title the recorded one with the
    most effects, the earliest of these, so that new runs do not change what old ones are fitted with."""
    if options.model is not None:
        return [(Model.of(options.model), list(runs))]
    texts = [run["_found"]["model"] for run in runs]
    without = [run["path"] for run, text in zip(runs, texts) if not text]
    if without:
        raise GroundError(
            "%s: no model was recorded with this run (%d of %d have none); --model names the crafts' model"
            % (without[0], len(without), len(runs))
        )
    parsed: Dict[str, Model] = {}
    by_title: Dict[str, Tuple[List[Model], List[Document]]] = {}
    for run, text in zip(runs, texts):
        if text not in parsed:
            parsed[text] = Model.parse(text, "the model recorded with %s" % run["path"])
        models, own = by_title.setdefault(parsed[text].name, ([], []))
        models.append(parsed[text])
        own.append(run)
    return [(max(models, key=lambda model: len(model.effects)), own) for models, own in by_title.values()]


def _together(
    model: Model, usable: Sequence[Document], options: HistoryOptions
) -> Tuple[Analysed, List[Document]]:
    """The analysis of the runs of a type, and what is known of each of them."""
    extended, _ = estimates.followed(model, options.free)
    made = analysed.analyse(
        Model(extended.core, model.path),
        [run["_found"] for run in usable],
        [run["craft"] for run in usable],
        [run["recorded"][:10] for run in usable],
        options.tolerance,
    )
    kept = ("name", "path", "recorded", "time_from")
    return made, [{**{key: run[key] for key in kept}, "length": run["_found"]["length"]} for run in usable]


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of identify history."""
    parser.add_argument("folders", metavar="FOLDER", nargs="+", help="folder below which runs are")
    command_line.add_output(parser, "DIR", "folder for results")
    command_line.add_options(parser, HistoryOptions)
    bag_arguments.add_reading_arguments(parser)
    command_line.add_details(parser)


def run(arguments: argparse.Namespace) -> Document:
    """Runs identify history; returns what --json prints."""
    if arguments.leave_out:
        raise OptionError("{0}: a history takes whole runs", "leave_out")
    with result_folder.kept_if_used(arguments.output):
        prepare(arguments.output, arguments.force)
        found = history(
            arguments.folders,
            mapping=bag_arguments.mapping_of(arguments),
            options=command_line.options(arguments, HistoryOptions),
            progress=arguments.work,
        )
    with arguments.work.stage(result_folder.WRITING):
        place = found.save(arguments.output, arguments.force)
    command_line.say_result(arguments, found, place)
    return found.to_dict()
