"""history: all runs of a laboratory, what drifts, what jumped, and which craft is odd.

history.json, schema ground/history/1 (docs/schemas/history.schema.json explains the keys), has what is
found; runs.csv has a line for each run. What a run tells by itself is kept in the user's cache by the
content of the run and the model, so that the next call fits new runs only.
"""

import argparse
import functools
from dataclasses import dataclass, replace
from typing import Dict, Iterable, List, Optional, Sequence, Tuple, Union

from ground.data import bag_arguments
from ground.ledger import analysed, contents, estimates, finding, verdicts
from ground.ledger.contents import LeftOut, TypeHistory, UsedRun
from ground.ledger.estimates import EstimateTask, RecordedRun
from ground.ledger.finding import Place
from ground.ledger.result import History, prepare
from ground.models import Model, ModelLike
from ground.reading.mapping import DEFAULT, FieldMapping, load
from ground.reports import result_folder
from ground.support import command_line
from ground.support.annotations import Path
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
    """How runs are grouped into craft, and what is estimated."""

    model: Optional[ModelLike] = option(
        None, "model of the craft (the model recorded with the runs)", metavar="M.yaml"
    )
    craft: Optional[str] = option(
        None,
        "which craft flew: a level of folders below FOLDER (1 is the first), or a pattern whose first group "
        "in a run's path is the craft (the recorded model's file, else the first non-date folder)",
        metavar="HOW",
    )
    free: Optional[Sequence[str]] = option(
        None, "parameters to follow (all that runs of the model may identify)", metavar="NAME", nargs="+"
    )
    tolerance: float = option(
        0.1,
        "largest ignored difference between craft of a type, as a share of a parameter, or of an "
        "effect's usual size (%(default)g)",
        metavar="SHARE",
        range=(0.0, 10.0),
    )
    verdicts: bool = option(False, "repeat saved diagnoses of other versions (minutes each)")


@command_line.takes(HistoryOptions)
def history(
    folders: Folders,
    *,
    mapping: Union[Path, FieldMapping, None] = None,
    progress: Progress = None,
    options: HistoryOptions,
) -> History:
    """Finds drifts, jumps between two runs, and odd craft.

    Each run is estimated on its own, with the likelihood of a diagnosis; then all runs of a type are fitted
    together: runs within days within craft. Runs that cannot be used are listed.

    Parameters
    ----------
    folders : path or iterable of path
        Folders below which the runs are.
    mapping : path or FieldMapping, optional
        A mapping file, or its content; tables need a mapping.

    Raises
    ------
    GroundError
        When there is no run or no model, or an option does not fit them.

    Examples
    --------
    >>> found = ground.history(bag, model=model_file, free=["k", "N_r"])
    >>> len(found.runs), found.changes, found.odd
    (1, [], [])
    >>> list(found.to_frame())[:4]
    ['recorded', 'craft', 'type', 'length']
    """
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
        raise GroundError("%s: %s" % (left_out[0].path, left_out[0].why))
    names = [run.found.model_name for run in runs]
    crafts, crafts_by = finding.crafts([run.place for run in runs], names, options.craft)
    by_type = _types([replace(run, craft=craft) for run, craft in zip(runs, crafts)], options)
    if options.model is None:
        for model, own in by_type:
            fitted = look([run.place.path for run in own], model)
            own[:] = [replace(run, found=found) for run, found in zip(own, fitted)]
    types: List[TypeHistory] = []
    with work.stage(TOGETHER, len(by_type)):
        for model, own in work.each(by_type):
            usable = [run for run in own if not run.found.failed]
            left_out += [LeftOut.of(run.place.path, run.found.failed) for run in own if run.found.failed]
            if usable:
                types.append(_together(model, usable, options))
    if not types:
        why = "%s: %s; none of the runs can be used"
        raise GroundError(why % (left_out[0].path, left_out[0].why))
    known = verdicts.read(diagnoses)
    if options.verdicts:
        known = verdicts.again(known, [place.path for place in places], mapping, work)
    return History(contents.of(paths, crafts_by, types, left_out, known))


def _looked_at(
    mapping: FieldMapping,
    options: HistoryOptions,
    work: Work,
    paths: Sequence[str],
    model: Optional[ModelLike],
) -> List[RecordedRun]:
    """What runs recorded, with their estimates if there is a model."""
    text, stage = "", LOOKING
    free: Tuple[str, ...] = ()
    if model is not None:
        extended, free = estimates.followed(Model.of(model), options.free)
        text, stage = extended.format(), FITTING
    tasks = [EstimateTask(path, mapping, options.as_recorded, text, free) for path in paths]
    with work.stage(stage, len(tasks)):
        return list(work.each(Workers(processes=True).map(estimates.looked_at, tasks)))


def _runs(places: Sequence[Place], recorded: Sequence[RecordedRun]) -> Tuple[List[UsedRun], List[LeftOut]]:
    """The runs in order of time, and those that are left out: what cannot be read, and copies."""
    runs: List[UsedRun] = []
    left_out: List[LeftOut] = []
    first: Dict[str, str] = {}  # path by content
    for place, found in zip(places, recorded):
        if found.failed:
            left_out.append(LeftOut.of(place.path, found.failed))
        elif found.content in first:
            left_out.append(LeftOut.of(place.path, "a copy of %s" % first[found.content]))
        else:
            first[found.content] = place.path
            at, source = finding.recorded_at(place, found.first_stamp)
            runs.append(UsedRun(place, found, at.isoformat(timespec="seconds"), source))
    names = distinct_labels([run.place.name for run in runs], [run.place.path for run in runs])
    named = [replace(run, name=name) for run, name in zip(runs, names)]
    return sorted(named, key=lambda run: (run.recorded, run.place.path)), left_out


def _types(runs: List[UsedRun], options: HistoryOptions) -> List[Tuple[Model, List[UsedRun]]]:
    """The models, each with its runs: the given one with all, else of each title the recorded one with the
    most effects, the earliest of these, so that new runs do not change what old ones are fitted with."""
    if options.model is not None:
        return [(Model.of(options.model), runs)]
    without = [run.place.path for run in runs if not run.found.model]
    if without:
        raise GroundError(
            "%s: no model was recorded with this run (%d of %d lack one); give it with --model"
            % (without[0], len(without), len(runs))
        )
    parsed: Dict[str, Model] = {}
    by_title: Dict[str, Tuple[List[Model], List[UsedRun]]] = {}
    for run in runs:
        text = run.found.model or ""
        if text not in parsed:
            parsed[text] = Model.parse(text, "the model recorded with %s" % run.place.path)
        models, own = by_title.setdefault(parsed[text].name, ([], []))
        models.append(parsed[text])
        own.append(run)
    return [(max(models, key=lambda model: len(model.effects)), own) for models, own in by_title.values()]


def _together(model: Model, usable: Sequence[UsedRun], options: HistoryOptions) -> TypeHistory:
    """The analysis of the runs of a type."""
    extended, _ = estimates.followed(model, options.free)
    made = analysed.analyse(
        Model(extended.core, model.path),
        [run.found.estimate for run in usable if run.found.estimate],
        [run.craft for run in usable],
        [run.recorded[:10] for run in usable],
        options.tolerance,
    )
    return TypeHistory(made, usable)


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of identify history."""
    parser.add_argument("folders", metavar="FOLDER", nargs="+", help="folder that contains the runs")
    command_line.add_output(parser, "DIR", "folder for results")
    command_line.add_options(parser, HistoryOptions)
    bag_arguments.add_reading_arguments(parser)
    command_line.add_details(parser)


def run(arguments: argparse.Namespace) -> Dict[str, object]:
    """Runs identify history; returns what --json prints."""
    if arguments.leave_out:
        raise OptionError("{0}: a history uses whole runs", "leave_out")
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
