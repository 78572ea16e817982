"""compare: models against recordings, and where they fail."""

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Dict, Iterator, List, Optional, Sequence, Tuple, Union

from ground import workers
from ground.analysis import comparison
from ground.analysis.study import noise_floor
from ground.annotations import Document, Path
from ground.api.models import Model, ModelLike
from ground.api.recordings import (
    Part,
    Recordings,
    note_differences,
    note_heading_offset,
    note_suspicions,
    repaired,
    taken,
)
from ground.api.values import Row, Shown, number
from ground.errors import GroundError
from ground.progress import Progress, Work
from ground.recordings.recording import Recording
from ground.reports import inspection, words

if TYPE_CHECKING:
    import pandas

SCHEMA = "ground/compare/1"
ROLES = ("fit", "held_out")
COMPARING = "comparing (s of recordings)"  # stage; unit: a second of a recording
COST = 0.03  # usual time to compare a second of a recording with a model [s]
Models = Union[ModelLike, Sequence[ModelLike]]
Files = Optional[Document]  # files of one run: pictures and series, by their subject


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

    def to_dict(self, files: Files = None) -> Document:
        """Plain values, as compare.json has them; files: the run's files."""
        named = files or {"comparison": None, "where": None, "residuals": None, "models": {}}
        return {
            "name": self.name,
            "bag": self.recording.bag,
            "picture": named["comparison"],
            "pictures": {kind: named[kind] for kind in ("where", "residuals")},
            "models": {
                study["label"]: dict(
                    study["numbers"],
                    role=study["role"],
                    where=study["where"],
                    residuals=study["residuals"],
                    wrench=study["missing"].numbers,
                    files=named["models"].get(study["label"]),
                    summary=study["summary"],
                )
                for study in self.studies
            },
        }

    def _table(self) -> Tuple[str, Row, List[Row]]:
        rows = [_row(s["label"], s["role"], s["numbers"]) for s in self.studies]
        return self.name, HEAD, rows


@dataclass(frozen=True, repr=False)
class Comparison(Shown):
    """Models against recordings."""

    models: Dict[str, Model]  #: by label
    runs: List[RunComparison]
    pooled: Dict[str, Document]  #: by label: error numbers over all, fit and held_out runs
    noise_floor: float  #: error that the noise of the poses alone would leave

    @property
    def best(self) -> str:
        """Label of the model that predicts best."""
        return _best(self.pooled)

    @property
    def sentence(self) -> str:
        """Which model predicts best, in words."""
        return str(words.comparison({"pooled": self.pooled, "noise_floor": self.noise_floor}))

    def to_dict(self, files: Optional[Sequence[Files]] = None) -> Document:
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

    def save(
        self, folder: Path, pictures: bool = True, form: str = "png", force: bool = False
    ) -> str:
        """Writes compare.json and, for every run, the missing wrench as CSV; with `pictures` also the
        pictures and the page report.html. form: "png" or "svg". Returns the path of the page, or of
        the JSON. GroundError when a file cannot be written, or exists and `force` is not set."""
        from ground.reports import comparison_files

        kept = comparison_files.Folder(os.fspath(folder), list(self.models), pictures, form, force)
        kept.prepare([run.name for run in self.runs])
        for run in self.runs:
            kept.write_run(run)
        kept.write(self)
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

    models: one or several; recordings: recordings or bags. start, end: the part of every run, on the
    run's clock [s]; everything: includes parts that are not usable. scheduler: address of a Dask
    cluster to work on, tcp://HOST:PORT, in a network you trust; None: all cores of this computer.
    progress: called with a ground.progress.Report at each step. GroundError when a file
    cannot be read or a model cannot be simulated.

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
    note_differences(given)
    return conclude(named, list(each_run(named, given, part, scheduler, progress)))


def labelled(models: Models) -> Dict[str, Model]:
    """Models by their names in tables. GroundError when one is given twice."""
    given = [models] if isinstance(models, (Model, str, os.PathLike)) else list(models)
    loaded = [Model.of(model) for model in given]
    labels = [_label(model, loaded) for model in loaded]
    if len(set(labels)) < len(loaded):
        raise GroundError("the same model is given twice")
    return dict(zip(labels, loaded))


def _label(model: Model, others: Sequence[Model]) -> str:
    """A model's name in tables: its file's, with the folder where two files share it; of a model
    without a file its title and effects."""
    if not model.path:
        return " with ".join(filter(None, (model.name, ", ".join(model.effects))))
    shared = sum(other.label == model.label for other in others) > 1
    return os.path.splitext(model.path)[0] if shared else model.label


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
        bag, task = run.recording.bag, []
        for count, (label, model) in enumerate(models.items()):
            role = "fit" if bag in model.core.provenance.bags else "held_out"
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
        of_model = [s for run in runs for s in run.studies if s["label"] == label]
        groups = {role: [s["evaluation"] for s in of_model if s["role"] == role] for role in ROLES}
        pooled[label] = {
            "all": comparison.numbers(groups["fit"] + groups["held_out"]),
            **{role: comparison.numbers(groups[role]) if groups[role] else None for role in ROLES},
        }
    best = _best(pooled)
    data = [s["run"] for run in runs for s in run.studies if s["label"] == best]
    return Comparison(models, runs, pooled, float(noise_floor(data, models[best].core).sum()))


def _best(pooled: Dict[str, Document]) -> str:
    return min(pooled, key=lambda label: float(pooled[label]["all"]["error"]))
