"""compare: models against recordings, and where they fail.

compare.json, schema ground/compare/1 (docs/schemas/compare.schema.json explains the keys), has the numbers.
"""

import argparse
import json
from dataclasses import replace
from typing import Any, Dict, Iterable, Iterator, List, Mapping, Sequence, Tuple, Union

import numpy as np

from ground.analysis import comparison, horizon
from ground.analysis.window_error import levels_of, noise_floor
from ground.comparing.ranking import Ranking, equally_good
from ground.comparing.result import ROLES, ComparedModel, Comparison, RunComparison, prepare
from ground.data import bag_arguments
from ground.data.measured import Part, note_differences, note_suspicions, repaired
from ground.data.read import NO_RECORDING, Recordings, taken
from ground.models import Model, ModelLike
from ground.poses import time_scales
from ground.reading.recording import Recording
from ground.reports import inspection, result_folder
from ground.support import command_line, workers
from ground.support.errors import GroundError
from ground.support.progress import Progress, Work
from ground.support.results import distinct_labels

COMPARING = "comparing (s of recordings)"  # stage; unit: a second of a recording
Models = Union[ModelLike, Sequence[ModelLike], Mapping[str, ModelLike]]


@command_line.takes(bag_arguments.Part)
def compare(
    models: Models,
    recordings: Recordings,
    *,
    progress: Progress = None,
    options: bag_arguments.Part,
) -> Comparison:
    """Compares models with recordings: errors, and their causes.

    Parameters
    ----------
    models : Model, path, or several
        A model or several, or a dictionary {label: model}.

    Returns
    -------
    Comparison
        Errors by run and model, and which model predicts best.

    Raises
    ------
    GroundError
        When a file cannot be read, a model cannot be simulated, or a run or model is given twice.

    Examples
    --------
    >>> craft = ground.Model.load(model_file)
    >>> found = ground.compare([craft, craft.with_effect("yaw_bias", n0=2e-5)], bag)
    >>> print(found.best)  # this craft turns by itself
    Tiny Whoover with yaw_bias
    >>> found.runs[0].numbers[found.best]["error"] < 2 * found.noise_floor
    True
    >>> found.to_frame().index.names
    FrozenList(['run', 'model'])
    """
    named, given = labelled(models), taken(recordings)
    if not given:
        raise GroundError(NO_RECORDING)
    note_differences(given)
    runs = _each_run(named, given, options, Work.of(progress))
    return _conclude(named, list(runs))


def labelled(models: Models) -> Dict[str, Model]:
    """Models by their names in tables: the given ones, else a file's name, or the title and the effects.
    GroundError when there is none, or one is given twice."""
    if isinstance(models, Mapping):
        named = {label: Model.of(model) for label, model in models.items()}
    else:
        given: List[Any] = [models]
        if isinstance(models, Iterable) and not isinstance(models, str):
            given = list(models)
        loaded = [Model.of(model) for model in given]
        labels = distinct_labels([m.label for m in loaded], [m.path for m in loaded])
        named = dict(zip(labels, loaded))
    if not named:
        raise GroundError("no models are given")
    first: Dict[str, str] = {}
    for label, model in named.items():
        other = first.setdefault(model.format(), label)
        if other != label:
            names = dict.fromkeys(named[one].path or one for one in (other, label))
            raise GroundError("the same model is given twice: %s" % " and ".join(names))
    return named


def _role(model: Model, recording: Recording) -> str:
    """One of ROLES."""
    provenance = model.core.provenance
    may_be_any = provenance.bags and not provenance.digests
    return "fit" if may_be_any or recording.identity in provenance.digests else "held_out"


def _each_run(
    models: Dict[str, Model],
    recordings: Sequence[Recording],
    part: Part,
    work: Work,
) -> Iterator[RunComparison]:
    """The RunComparison of each run, in their order."""
    first = next(iter(models.values()))
    part = replace(
        part, window=part.window or time_scales.usual_window(first.core)
    )  # the same for all models
    recordings = [recording.with_lift_of(first.core) for recording in recordings]
    lengths = [1 + int(recording.duration) for recording in recordings]
    runs = repaired(recordings, work)
    recordings = [run.recording for run in runs]
    note_suspicions(recordings, first)
    tasks = []
    for run in runs:
        task = []
        for label, model in models.items():
            task.append((part.of(run, model), model.core, label, _role(model, run.recording)))
        tasks.append(task)
    results = iter(zip(recordings, workers.Workers().map(_inspect, tasks)))
    with work.stage(COMPARING, sum(lengths)):
        for length, (recording, found) in zip(lengths, results):
            work.step(length)
            models_of = [ComparedModel.of(one) for one in found]
            yield RunComparison(recording.name, recording.bag, models_of, recording, found)


def _inspect(task: Sequence[Tuple[Any, ...]]) -> List[inspection.Inspection]:
    return [inspection.inspect(*one) for one in task]


def _conclude(models: Dict[str, Model], runs: List[RunComparison]) -> Comparison:
    """The Comparison over all runs."""
    pooled = {}
    for label in models:
        of_model = _studies(runs, label)
        groups = {"all": of_model, **{role: [s for s in of_model if s.role == role] for role in ROLES}}
        pooled[label] = {
            name: comparison.numbers([s.evaluation for s in group]) if group else None
            for name, group in groups.items()
        }
    held_out = [run for run in runs if all(s.role == "held_out" for s in run.inspections)]
    ranked = held_out or runs
    ranking = _ranking(list(models), ranked)
    best = models[ranking.best].core
    data = [s.run for s in _studies(ranked, ranking.best)]
    floor = float(noise_floor(data, best).sum())
    seconds = horizon.horizon(data, best)
    each = {label: horizon.same(model.core) for label, model in models.items()}
    levels = levels_of(best.disturbance)
    prediction = horizon.prediction_error(data, seconds, each, best, levels)
    for label in models:  # over all starts, as the tables have it
        for row in comparison.numbers([s.evaluation for s in _studies(ranked, label)])["horizons"]:
            if prediction and row["seconds"] == seconds and row["starts"]:
                prediction.errors[label] = horizon.PoseError(row["position_mm"], row["heading_deg"])
    return Comparison(models, runs, pooled, ranking, floor, prediction)


def _studies(runs: Sequence[RunComparison], label: str) -> List[inspection.Inspection]:
    """Inspections of a model on runs."""
    return [s for run in runs for s in run.inspections if s.label == label]


def _ranking(labels: Sequence[str], runs: Sequence[RunComparison]) -> Ranking:
    """Models by their error over runs."""
    errors, roles, by_window = {}, {}, {}
    for label in labels:
        studies = _studies(runs, label)
        each = [s.evaluation.by_window for s in studies]
        by_window[label], run_of = np.concatenate(each), np.repeat(range(len(each)), list(map(len, each)))
        errors[label] = float(comparison.numbers([s.evaluation for s in studies])["error"])
        roles[label] = {s.role for s in studies}
    fitted = [label for label in labels if "fit" in roles[label]]
    order = sorted(errors, key=errors.__getitem__)
    return Ranking(
        role="fit" if fitted else "held_out",
        runs=[run.name for run in runs],
        errors={label: errors[label] for label in order},
        fitted=fitted,
        equal=equally_good(order, by_window, run_of),
    )


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of identify compare."""
    bag_arguments.add_bag_arguments(parser)
    parser.add_argument(
        "--model", metavar="M.yaml", action="append", required=True, help="model; once for each model"
    )
    command_line.add_output(parser, "DIR", "folder for results")
    command_line.add_options(parser, bag_arguments.Part)
    command_line.add_details(parser)
    command_line.add_mat(parser)
    parser.add_argument("--numbers", action="store_true", help="compare.json and CSV only: no page")


def run(arguments: argparse.Namespace) -> Dict[str, object]:
    """Runs identify compare; returns what --json prints."""
    command_line.check_mat(arguments)
    models = labelled(arguments.model)
    recordings = list(bag_arguments.reading(arguments, arguments.bags))
    with result_folder.kept_if_used(arguments.output):
        _, numbers = prepare(arguments.output, arguments.force)
        chosen = command_line.options(arguments, bag_arguments.Part)
        found = compare(models, recordings, options=chosen, progress=arguments.work)
    with arguments.work.stage(result_folder.WRITING):
        place = found.save(arguments.output, not arguments.numbers, arguments.force)
    bag_arguments.say_result(arguments, found, place)
    command_line.write_mat(arguments, found)
    with open(numbers) as file:
        return dict(json.load(file))
