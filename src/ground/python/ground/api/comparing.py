"""compare: models against recordings, and where they fail."""

import os
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple, Union

from ground import workers
from ground.analysis import comparison
from ground.analysis.study import noise_floor
from ground.annotations import Document, Path
from ground.api.models import Model, ModelLike
from ground.api.recordings import (
    NO_RECORDING,
    Part,
    Recordings,
    note_differences,
    note_heading_offset,
    note_suspicions,
    repaired,
    taken,
)
from ground.api.values import Row, Shown, distinct_labels, number
from ground.errors import GroundError
from ground.progress import Progress, Work
from ground.recordings.recording import Recording
from ground.reports import inspection, words

if TYPE_CHECKING:
    import pandas

SCHEMA = "ground/compare/1"
# Whether a model was fitted to a run: it was, it was not, or its file does not tell
ROLES = ("fit", "held_out", "unknown")
COMPARING = "comparing (s of recordings)"  # stage; unit: a second of a recording
COST = 0.03  # usual time to compare a second of a recording with a model [s]
Models = Union[ModelLike, Sequence[ModelLike], Mapping[str, ModelLike]]
Files = Mapping[str, str]  # CSV files of one run, by model


@dataclass(frozen=True, repr=False)
class RunComparison(Shown):
    """All models against one run."""

    recording: Recording
    studies: List[Document]  #: one for each model, from ground.reports.inspection.inspect

    @property
    def name(self) -> str:
        """Name of the run."""
        return self.recording.name

    @property
    def numbers(self) -> Document:
        """Error numbers by model (keys of comparison.numbers)."""
        return {study["label"]: study["numbers"] for study in self.studies}

    @property
    def summary(self) -> Dict[str, List[str]]:
        """Sentences on what stands out, by model."""
        return {study["label"]: study["summary"] for study in self.studies}

    def to_dict(self, files: Optional[Files] = None) -> Document:
        """Plain values, as compare.json has them; files: the run's files."""
        return {
            "name": self.name,
            "bag": self.recording.bag,
            "models": {
                study["label"]: dict(
                    study["numbers"],
                    role=study["role"],
                    where=study["where"],
                    residuals=study["residuals"],
                    wrench=study["missing"].numbers,
                    files={"wrench_csv": files[study["label"]]} if files else None,
                    summary=study["summary"],
                )
                for study in self.studies
            },
        }

    def _table(self) -> Tuple[str, Row, List[Row]]:
        rows = [_row(s["label"], s["role"], s["numbers"]) for s in self.studies]
        return self.name, HEAD, rows


@dataclass(frozen=True)
class Ranking:
    """Models by their error, the least first. It says which one predicts best only where no model was
    fitted to the runs."""

    role: str  #: "held_out": no model was fitted to the runs; "fit": one was; "unknown"
    runs: List[str]  #: all that no model was fitted to; where there are none, all runs
    errors: Dict[str, float]  #: by label, over these runs
    fitted: List[str]  #: labels of models that were fitted to any of them, or that may have been


@dataclass(frozen=True, repr=False)
class Comparison(Shown):
    """Models against recordings."""

    models: Dict[str, Model]  #: by label
    runs: List[RunComparison]
    pooled: Dict[str, Document]  #: by label: error numbers over all, fit, held_out and unknown runs
    ranking: Ranking
    noise_floor: float  #: error that the noise of the poses alone would leave on the ranking's runs

    @property
    def best(self) -> str:
        """Label of the model with the least error; `ranking` says whether it was fitted to the runs."""
        return next(iter(self.ranking.errors))

    @property
    def sentence(self) -> str:
        """Which model predicts or fits best, in words."""
        return str(words.comparison(asdict(self.ranking), self.noise_floor))

    def to_dict(self, files: Optional[Sequence[Optional[Files]]] = None) -> Document:
        """Plain values, as compare.json has them; files: the files of each run."""
        named = files or [None] * len(self.runs)
        return {
            "schema": SCHEMA,
            "models": {
                label: {
                    "file": model.path or None,
                    "effects": model.core.effects,
                    "fitted_to": model.core.provenance.bags,
                }
                for label, model in self.models.items()
            },
            "runs": [run.to_dict(of_run) for run, of_run in zip(self.runs, named)],
            "pooled": self.pooled,
            "ranking": asdict(self.ranking),
            "noise_floor": self.noise_floor,
        }

    def to_frame(self) -> "pandas.DataFrame":
        """A row for each run and model: error, prediction_error, thesis_objective and the fit of u,
        v and r [%]; indexed by run and model."""
        import pandas

        index, rows = [], []
        for run in self.runs:
            for study in run.studies:
                n = study["numbers"]
                index.append((run.name, study["label"]))
                fits = [n["fit_percent"][c] for c in comparison.CHANNELS]
                numbers = [n["error"], n["prediction_error"], n["thesis_objective"], *fits]
                rows.append([study["role"], *numbers])
        columns = [
            "role",
            "error",
            "prediction_error",
            "thesis_objective",
            "fit_u",
            "fit_v",
            "fit_r",
        ]
        names = pandas.MultiIndex.from_tuples(index, names=["run", "model"])
        return pandas.DataFrame(rows, index=names, columns=columns)

    def save(self, folder: Path, page: bool = True, force: bool = False) -> str:
        """Writes compare.json and, for every run, the missing wrench as CSV; with `page` also
        report.html. Returns the path of the page, or of the JSON. GroundError when a file cannot be
        written, or exists and `force` is not set."""
        from ground.reports import comparison_files

        kept = comparison_files.Folder(os.fspath(folder), list(self.models), page, force)
        kept.prepare([run.name for run in self.runs])
        with kept.replaced():
            for run in self.runs:
                kept.write_run(run)
            numbers = kept.write_numbers(self)
        if page:
            kept.write_page(self, numbers)
        return kept.to_look_at

    def _table(self) -> Tuple[str, Row, List[Row]]:
        rows = [
            _row(label, role, groups[role])
            for label, groups in self.pooled.items()
            for role in ROLES
            if groups[role]
        ]
        return self.sentence, HEAD, rows


HEAD = ["model", "runs", "error", "prediction", "fit u [%]", "fit v [%]", "fit r [%]"]


def _row(label: str, role: str, n: Document) -> Row:
    fits = ["%.0f" % n["fit_percent"][c] for c in comparison.CHANNELS]
    return [
        label,
        role.replace("_", " "),
        "%.3f" % n["error"],
        number(n["prediction_error"]),
        *fits,
    ]


def compare(
    models: Models,
    recordings: Recordings,
    *,
    start: float = 0.0,
    end: Optional[float] = None,
    everything: bool = False,
    scheduler: Optional[str] = None,
    progress: Progress = None,
) -> Comparison:
    """Models against recordings: errors, and where they come from.

    models: one or several, or {label: model}; recordings: recordings or bags. start, end: the part
    of every run, on the run's clock [s]; everything: includes parts that are not usable. scheduler:
    address of a Dask cluster to work on, tcp://HOST:PORT, in a network you trust; None: all cores of
    this computer. progress: called with a ground.progress.Report at each step. GroundError when a
    file cannot be read, a model cannot be simulated, or a run or model is given twice.

    >>> craft = ground.Model.load(model_file)
    >>> found = ground.compare([craft, craft.with_effect("yaw_bias", n0=2e-5)], bag)
    >>> print(found.best)  # this craft turns by itself
    Tiny Whoover with yaw_bias
    >>> found.runs[0].numbers[found.best]["error"] < 2 * found.noise_floor
    True
    >>> found.to_frame().index.names
    FrozenList(['run', 'model'])
    """
    named, given, part = labelled(models), taken(recordings), Part(start, end, everything)
    if not given:
        raise GroundError(NO_RECORDING)
    note_differences(given)
    return conclude(named, list(each_run(named, given, part, scheduler, progress)))


def labelled(models: Models) -> Dict[str, Model]:
    """Models by their names in tables: the given ones, else a file's name, or the title and the effects.
    GroundError when there is none, or one is given twice."""
    if isinstance(models, Mapping):
        named = {label: Model.of(model) for label, model in models.items()}
    else:
        given = [models] if isinstance(models, (Model, str, os.PathLike)) else list(models)
        loaded = [Model.of(model) for model in given]
        labels = distinct_labels([_label(m) for m in loaded], [m.path for m in loaded])
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


def _label(model: Model) -> str:
    """A model's name in tables, which others may share."""
    return model.label if model.path else " with ".join(
        filter(None, (model.name, ", ".join(model.effects)))
    )


def _role(model: Model, recording: Recording) -> str:
    """One of ROLES."""
    provenance = model.core.provenance
    if provenance.bags and not provenance.digests:
        return "unknown"  # the file is older than digests
    return "fit" if recording.identity in provenance.digests else "held_out"


def each_run(
    models: Dict[str, Model],
    recordings: Sequence[Recording],
    part: Part,
    scheduler: Optional[str] = None,
    progress: Progress = None,
) -> Iterator[RunComparison]:
    """The RunComparison of each run, in their order. For the first model it includes how much of
    its missing wrench the last model accounts for."""
    work = Work.of(progress)
    first = next(iter(models.values()))
    recordings = [recording.with_lift_of(first.core) for recording in recordings]
    lengths = [1 + int(recording.duration) for recording in recordings]
    work.expect(COMPARING, sum(lengths), COST * len(models))
    runs = repaired(recordings, work)
    note_suspicions(recordings, first)
    for model in models.values():
        note_heading_offset(model, recordings)
    last = list(models.values())[-1].core if len(models) > 1 else None
    tasks = []
    for run in runs:
        task = []
        for count, (label, model) in enumerate(models.items()):
            role = _role(model, run.recording)
            other = last if count == 0 else None
            task.append((part.of(run, model), model.core, label, role, other))
        tasks.append(task)
    with workers.Workers(scheduler) as team:
        results = iter(zip(recordings, team.map(_inspect, tasks)))
        for length in lengths:
            with work.unit(COMPARING, length):
                recording, studies = next(results)
            yield RunComparison(recording, studies)


def _inspect(task: Sequence[Tuple[Any, ...]]) -> List[Document]:
    return [inspection.inspect(*one) for one in task]


def conclude(models: Dict[str, Model], runs: List[RunComparison]) -> Comparison:
    """The Comparison over all runs."""
    pooled: Dict[str, Document] = {}
    for label in models:
        of_model = _studies(runs, label)
        groups = {role: [s["evaluation"] for s in of_model if s["role"] == role] for role in ROLES}
        pooled[label] = {
            "all": comparison.numbers([s["evaluation"] for s in of_model]),
            **{role: comparison.numbers(groups[role]) if groups[role] else None for role in ROLES},
        }
    held_out = [run for run in runs if all(s["role"] == "held_out" for s in run.studies)]
    ranked = held_out or runs
    ranking = _ranking(list(models), ranked)
    best = next(iter(ranking.errors))
    data = [s["run"] for s in _studies(ranked, best)]
    floor = float(noise_floor(data, models[best].core).sum())
    return Comparison(models, runs, pooled, ranking, floor)


def _studies(runs: Sequence[RunComparison], label: str) -> List[Document]:
    """Studies of a model against runs."""
    return [s for run in runs for s in run.studies if s["label"] == label]


def _ranking(labels: Sequence[str], runs: Sequence[RunComparison]) -> Ranking:
    """Models by their error over runs."""
    errors, roles = {}, {}
    for label in labels:
        studies = _studies(runs, label)
        errors[label] = float(comparison.numbers([s["evaluation"] for s in studies])["error"])
        roles[label] = {s["role"] for s in studies}
    worst = next(role for role in ("fit", "unknown", "held_out") if any(role in r for r in roles.values()))
    return Ranking(
        role=worst,
        runs=[run.name for run in runs],
        errors={label: errors[label] for label in sorted(errors, key=errors.__getitem__)},
        fitted=[label for label in labels if worst != "held_out" and worst in roles[label]],
    )
