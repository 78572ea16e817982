"""A comparison: its numbers, its lines of text, and the folder in which it is kept."""

import os
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Dict, Iterator, List, Mapping, Optional, Sequence

import numpy as np

from ground.analysis import comparison
from ground.comparing import words
from ground.models import Model
from ground.recordings import findings
from ground.recordings.quality import repaired
from ground.recordings.recording import Recording
from ground.reports import appearance, matlab, result_folder
from ground.reports.words import number
from ground.support import files
from ground.support.annotations import Document, Path
from ground.support.results import Shown, distinct_labels

if TYPE_CHECKING:
    import pandas

SCHEMA = "ground/compare/1"
ROLES = ("fit", "held_out")  # a model was fitted to a run, or was not
WRENCH = "t [s],X [N],Y [N],N [N m],sigma X [N],sigma Y [N],sigma N [N m]"
COLUMNS = "%9s %7s %10s %9s %14s %15s"
HEAD = COLUMNS % ("runs", "error", "prediction", "(3.4) 4 s", "fit u,v,r [%]", "off after 1 s")
Files = Mapping[str, str]  # CSV files of one run, by model


class _Frame(Shown):
    """Errors as a table."""

    def rows(self) -> Iterator[Sequence[Any]]:
        """Run, model, role and numbers."""
        raise NotImplementedError

    def to_frame(self) -> "pandas.DataFrame":
        """A row for each run and model: error, prediction_error, thesis_objective and the fit of u,
        v and r [%]; indexed by run and model."""
        import pandas

        names = ["error", "prediction_error", "thesis_objective"]
        rows = [
            [run, label, role, *(n[name] for name in names), *n["fit_percent"].values()]
            for run, label, role, n in self.rows()
        ]
        fits = ["fit_" + channel for channel in comparison.CHANNELS]
        frame = pandas.DataFrame(rows, columns=["run", "model", "role", *names, *fits])
        return frame.set_index(["run", "model"])


@dataclass(frozen=True, repr=False)
class RunComparison(_Frame):
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
                    residuals=study["residuals"],
                    wrench=study["missing"].numbers,
                    files={"wrench_csv": files[study["label"]]} if files else None,
                    summary=study["summary"],
                )
                for study in self.studies
            },
        }

    def rows(self) -> Iterator[Sequence[Any]]:
        """Run, model, role and numbers."""
        for s in self.studies:
            yield self.name, s["label"], s["role"], s["numbers"]

    def lines(self) -> Iterator[str]:
        """Errors of the models, and what stands out."""
        yield self.name
        yield from _table([(s["label"], s["role"], s["numbers"]) for s in self.studies])
        for study in self.studies:
            for sentence in study["summary"]:
                yield "  %s: %s" % (study["label"], sentence)


@dataclass(frozen=True)
class Ranking:
    """Models by their error, the least first. It says which one predicts best only where no model was
    fitted to the runs."""

    role: str  #: "held_out": no model was fitted to the runs; "fit": one was
    runs: List[str]  #: all that no model was fitted to; where there are none, all runs
    errors: Dict[str, float]  #: by label, over these runs
    fitted: List[str]  #: labels of models that were fitted to any of them


@dataclass(frozen=True, repr=False)
class Comparison(_Frame):
    """Models against recordings."""

    models: Dict[str, Model]  #: by label
    runs: List[RunComparison]
    pooled: Dict[str, Document]  #: by label: error numbers over all, fit and held_out runs
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

    def rows(self) -> Iterator[Sequence[Any]]:
        """Run, model, role and numbers."""
        for run in self.runs:
            yield from run.rows()

    @property
    def title(self) -> str:
        """The comparison in a sentence."""
        return self.sentence

    def lines(self) -> Iterator[str]:
        """What `identify compare` prints."""
        for run in self.runs:
            yield from run.lines()
        if len(self.runs) > 1:
            yield "all runs"
            yield from _table(
                [(label, role, of[role]) for label, of in self.pooled.items() for role in ROLES if of[role]]
            )
        yield self.sentence

    def to_dict(self, files: Optional[Sequence[Optional[Files]]] = None) -> Document:
        """Plain values, as compare.json has them; files: the files of each run."""
        named: List[Optional[Files]] = [None] * len(self.runs)
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
            "runs": [run.to_dict(of_run) for run, of_run in zip(self.runs, files or named)],
            "pooled": self.pooled,
            "ranking": asdict(self.ranking),
            "noise_floor": self.noise_floor,
        }

    def to_mat(self, path: Path, force: bool = False) -> None:
        """Writes a file for MATLAB and Octave: structs `models`, `parameters` and `runs` with what was
        measured and what each model predicts; its text `about` has units and frames. GroundError when the
        file cannot be written."""
        studied = [
            matlab.Study(run.studies[0]["run"], {s["label"]: s["evaluation"] for s in run.studies})
            for run in self.runs
        ]
        matlab.write(path, self.models, studied, force)

    def save(self, folder: Path, page: bool = True, force: bool = False) -> str:
        """Writes compare.json and, for every run, the missing wrench as CSV; with `page` also
        report.html. Returns the path of the page, or of the JSON. Files of an older comparison in the
        folder go. GroundError when a file cannot be written, or exists and `force` is not set."""
        place = os.fspath(folder)
        report_file, numbers = prepare(place, force)
        runs = distinct_labels([_stem(run.name) for run in self.runs], [""] * len(self.runs))
        labels = distinct_labels([_stem(label) for label in self.models], [""] * len(self.models))
        named = [
            {
                label: os.path.join(place, "%s.wrench.%s.csv" % (run, stem))
                for label, stem in zip(self.models, labels)
            }
            for run in runs
        ]
        stale = ("report.html", "*.wrench.*.csv") if result_folder.is_of(numbers, SCHEMA) else ()
        result = self.to_dict(named)
        with result_folder.replaced(place, stale, force) as new:
            for run_of, own in zip(self.runs, named):
                for study in run_of.studies:
                    path = os.path.join(new, os.path.basename(own[study["label"]]))
                    missing = study["missing"]
                    rows = np.column_stack([missing.times, missing.wrench, missing.sigma])
                    files.write_csv(path, WRENCH, rows)
            files.write_json(os.path.join(new, "compare.json"), result)
        if not page:
            return numbers
        from ground.comparing import page as report

        inputs = [run.recording.path for run in self.runs]
        inputs += [model.path for model in self.models.values()]
        with result_folder.page(report_file, numbers):
            report.write(
                report_file,
                result,
                [run.studies for run in self.runs],
                findings.describe([repaired(run.recording) for run in self.runs]),
                [path for path in inputs if path],
                force,
            )
        return report_file


def prepare(folder: str, force: bool) -> Sequence[str]:
    """Makes the folder of a comparison; paths of its page and of its numbers. GroundError when it cannot be
    made, or has them and `force` is not set."""
    paths = [os.path.join(folder, name) for name in ("report.html", "compare.json")]
    result_folder.prepare(folder, paths, force)
    return paths


def _table(rows: Sequence[Sequence[Any]]) -> Iterator[str]:
    """A table of labels, roles and numbers."""
    width = max(len(row[0]) for row in rows)
    yield "  %-*s " % (width, "model") + HEAD
    for label, role, n in rows:
        cells = (
            role.replace("_", " "),
            "%.3f" % n["error"],
            number(n["prediction_error"]),
            number(n["thesis_objective"]),
            ", ".join("%.0f" % n["fit_percent"][c] for c in comparison.CHANNELS),
            appearance.off_after_a_second(n),
        )
        yield "  %-*s " % (width, label) + COLUMNS % cells


def _stem(label: str) -> str:
    """A run's or model's name as a part of names of files."""
    return label.replace(os.sep, "_").lstrip(".") or "unnamed"
