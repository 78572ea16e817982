"""A comparison: its numbers, its lines of text, and the folder in which it is kept."""

import os
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground.analysis.horizon import PredictionError
from ground.checks import findings
from ground.checks.quality import repaired
from ground.comparing import words
from ground.comparing.ranking import Ranking
from ground.models import Model
from ground.reading.recording import VELOCITY, Recording
from ground.reports import appearance, matlab, result_folder
from ground.reports.inspection import Inspection
from ground.reports.words import number
from ground.support import files, records
from ground.support.annotations import Document, Path
from ground.support.docstrings import internal
from ground.support.errors import GroundError
from ground.support.headline import Line
from ground.support.results import Plotted, Shown, distinct_labels

if TYPE_CHECKING:
    import pandas

SCHEMA = "ground/compare/1"
ROLES = ("fit", "held_out")  # a model was fitted to a run, or was not
WRENCH = "t [s],X [N],Y [N],N [N m],sigma X [N],sigma Y [N],sigma N [N m]"
COLUMNS = "%9s %7s %10s %17s %14s %20s"
HEAD = COLUMNS % ("runs", "error", "prediction", "thesis, first 4 s", "fit u,v,r [%]", "off after")
Files = Mapping[str, str]  # CSV files of one run, by model


class _Frame(Shown):
    """Errors as a table."""

    @internal
    def rows(self) -> Iterator[Sequence[Any]]:
        """Rows of run, model, role and numbers."""
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
        fits = ["fit_" + channel for channel in VELOCITY]
        frame = pandas.DataFrame(rows, columns=["run", "model", "role", *names, *fits])
        return frame.set_index(["run", "model"])


@dataclass(frozen=True)
class ComparedModel:
    """Comparison of a model with one run, as in compare.json."""

    label: str
    role: str  #: fit or held_out
    numbers: Document  #: error numbers (comparison.numbers)
    residuals: Dict[str, object]
    wrench: Dict[str, object]  #: numbers of the missing wrench
    summary: List[str]  #: what stands out, in sentences

    @classmethod
    def of(cls, one: Inspection) -> "ComparedModel":
        """The numbers of an Inspection."""
        correlations, wrench = (records.plain(found) for found in (one.residuals, one.missing.numbers))
        return cls(one.label, one.role, one.numbers, correlations, wrench, one.summary)

    @classmethod
    def read(
        cls,
        label: str,
        role: str,
        residuals: Dict[str, object],
        wrench: Dict[str, object],
        summary: List[str],
        files: object = None,
        **numbers: Any,
    ) -> "ComparedModel":
        """Of the values in compare.json."""
        return cls(label, role, numbers, residuals, wrench, summary)


@dataclass(frozen=True, repr=False)
class RunComparison(_Frame):
    """Comparison of all models with one run.

    >>> (run,) = ground.compare(model_file, bag).runs
    >>> run.name, sorted(run.numbers) == sorted(run.remarks), run.to_frame().index[0][0]
    ('run', True, 'run')
    """

    name: str  #: name of the run
    bag: str  #: name of the run's file
    models: List[ComparedModel]  #: one entry per model
    recording: Optional[Recording]  #: the recording; None in a loaded comparison
    inspections: Sequence[Inspection] = ()  #: one per model; empty in a loaded comparison

    @property
    def studies(self) -> List[Document]:
        """One object per model: label, role ("fit" or "held_out"), numbers (of comparison.numbers), summary
        (sentences), residuals and wrench (as in compare.json); and run, model, evaluation and missing, which
        a loaded comparison does not have."""
        seen = {one.label: vars(one) for one in self.inspections}
        return [{**seen.get(one.label, {}), **vars(one)} for one in self.models]

    @property
    def numbers(self) -> Document:
        """Error numbers by model: error, error_by_channel, prediction_error, thesis_objective, fit_percent,
        rms, rms_units and horizons, as docs/schemas/compare.schema.json explains them."""
        return {one.label: one.numbers for one in self.models}

    @property
    def remarks(self) -> Dict[str, List[str]]:
        """Sentences on what stands out, by model."""
        return {one.label: one.summary for one in self.models}

    def to_dict(self, files: Optional[Files] = None) -> Dict[str, object]:
        """The result as plain values, as in compare.json."""
        return {
            "name": self.name,
            "bag": self.bag,
            "models": {
                one.label: dict(
                    one.numbers,
                    role=one.role,
                    residuals=one.residuals,
                    wrench=one.wrench,
                    files={"wrench_csv": files[one.label]} if files else None,
                    summary=one.summary,
                )
                for one in self.models
            },
        }

    def rows(self) -> Iterator[Sequence[Any]]:
        """Rows of run, model, role and numbers."""
        for one in self.models:
            yield self.name, one.label, one.role, one.numbers

    def table(self) -> Iterator[str]:
        """Lines of text: errors of the models, and what stands out."""
        yield self.name
        yield from _table([(one.label, one.role, one.numbers) for one in self.models])
        for one in self.models:
            for sentence in one.summary:
                yield "  %s: %s" % (one.label, sentence)


@dataclass(frozen=True, repr=False)
class Comparison(_Frame, Plotted):
    """Comparison of models with recordings.

    >>> craft = ground.Model.load(model_file)
    >>> found = ground.compare({"given": craft, "turning": craft.with_effect("yaw_bias", n0=2e-5)}, bag)
    >>> found.best, found.to_frame().loc[("run", "given"), "error"] > found.noise_floor
    ('turning', True)
    """

    models: Dict[str, Model]  #: models by label
    runs: List[RunComparison]  #: one entry per recording
    #: by label, then by runs (all, fit, held_out): error numbers, with the keys of RunComparison.numbers
    pooled: Dict[str, Document]
    ranking: Ranking  #: models ordered by error, the best first
    noise_floor: float  #: error of a true model on the ranking's runs, from pose noise
    prediction: Optional[PredictionError]  #: errors of poses on the ranking's runs; None: too short

    @property
    def best(self) -> str:
        """Label of the model with the least error; `ranking` says whether it was fitted to the runs."""
        return self.ranking.best

    def rows(self) -> Iterator[Sequence[Any]]:
        """Rows of run, model, role and numbers."""
        for run in self.runs:
            yield from run.rows()

    def headline(self, written: str = "") -> List[Line]:
        """First lines of the report: which model predicts best, by how much, and what to do next."""
        return words.lines(self.ranking, self.prediction, self.models[self.best], written)

    def table(self) -> Iterator[str]:
        """Lines of text: errors of the models over all runs."""
        yield from _table(self._pooled)

    @property
    def _pooled(self) -> List[Tuple[str, str, Any]]:
        """Label, role and error numbers over all runs of the role."""
        return [(label, role, of[role]) for label, of in self.pooled.items() for role in ROLES if of[role]]

    def details(self) -> Iterator[str]:
        """Lines of text: errors of the models on each run, and what stands out."""
        for run in self.runs:
            yield from run.table()

    def to_dict(self, files: Optional[Sequence[Optional[Files]]] = None) -> Dict[str, object]:
        """The result as plain values, as in compare.json."""
        named: List[Optional[Files]] = [None] * len(self.runs)
        return {
            "schema": SCHEMA,
            "models": {
                label: {
                    "file": model.path or None,
                    "text": model.format(),
                    "effects": model.core.effects,
                    "fitted_to": model.core.provenance.bags,
                }
                for label, model in self.models.items()
            },
            "runs": [run.to_dict(of_run) for run, of_run in zip(self.runs, files or named)],
            "pooled": self.pooled,
            "ranking": records.plain(self.ranking),
            "noise_floor": self.noise_floor,
            "prediction": records.plain(self.prediction),
        }

    @classmethod
    @internal
    def load(cls, folder: Path) -> "Comparison":
        """The comparison that `save` wrote into a folder: models, numbers and sentences. GroundError when
        there is none."""
        document = result_folder.read(folder, "compare.json", SCHEMA)
        models = {
            label: replace(Model.parse(m["text"], label), path=m["file"] or "")
            for label, m in document["models"].items()
        }
        runs = [
            RunComparison(
                run["name"],
                run["bag"],
                [ComparedModel.read(label, **values) for label, values in run["models"].items()],
                None,
            )
            for run in document["runs"]
        ]
        ranking = records.read(Ranking, document["ranking"], "ranking")
        found = document["prediction"]
        off = found and records.read(PredictionError, found, "prediction")
        return cls(models, runs, document["pooled"], ranking, document["noise_floor"], off)

    def to_mat(self, path: Path, force: bool = False) -> None:
        """Writes a file for MATLAB and Octave.

        The file contains structs `models`, `parameters` and `runs` with the measured motion and the
        predictions of each model; its text `about` explains units and frames.
        """
        studied = [
            matlab.Study(run.inspections[0].run, {s.label: s.evaluation for s in run.inspections})
            for run in self.runs
        ]
        matlab.write(path, self.models, studied, force)

    def save(self, folder: Path, page: bool = True, force: bool = False) -> str:
        """Writes compare.json, the missing wrench of each run as CSV, and a page, replacing an older one.

        Parameters
        ----------
        page : bool, default True
            Whether to write report.html.

        Returns
        -------
        str
            Path of report.html, or of compare.json without a page.

        Raises
        ------
        GroundError
            When a file cannot be written, or this comparison was loaded.
        """
        recordings = [run.recording for run in self.runs if run.recording is not None]
        if len(recordings) < len(self.runs):
            raise GroundError("this comparison was loaded: its folder already contains it")
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
        with result_folder.replaced(place, stale, force) as new:
            for run_of, own in zip(self.runs, named):
                for one in run_of.inspections:
                    path = os.path.join(new, os.path.basename(own[one.label]))
                    missing = one.missing
                    rows = np.column_stack([missing.times, missing.wrench, missing.sigma])
                    files.write_csv(path, WRENCH, rows)
            files.write_json(os.path.join(new, "compare.json"), self.to_dict(named))
        if not page:
            return numbers
        from ground.comparing import page as report

        inputs = [recording.path for recording in recordings]
        inputs += [model.path for model in self.models.values()]
        with result_folder.page(report_file, numbers):
            report.write(
                report_file,
                self.headline(report_file),
                report.predictions(self.ranking, self.prediction),
                list(self.models),
                [appearance.numbers_row(*row) for row in self._pooled],
                [run.inspections for run in self.runs],
                findings.describe([repaired(recording) for recording in recordings]),
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
            ", ".join("%.0f" % n["fit_percent"][c] for c in VELOCITY),
            appearance.off_after(n),
        )
        yield "  %-*s " % (width, label) + COLUMNS % cells


def _stem(label: str) -> str:
    """A run's or model's name as a part of names of files."""
    return label.replace(os.sep, "_").lstrip(".") or "unnamed"
