"""The folder of a comparison: compare.json, wrenches over time as CSV, pictures and the page."""

import contextlib
import os
from typing import TYPE_CHECKING, Dict, Iterator, List, Optional, Sequence

import numpy as np

from ground import files
from ground.annotations import Document
from ground.api.comparing import SCHEMA
from ground.api.values import distinct_labels
from ground.recordings import findings
from ground.recordings.quality import repaired
from ground.reports import report, result_folder

if TYPE_CHECKING:
    from ground.api.comparing import Comparison, RunComparison

KINDS = ("comparison", "where", "residuals")  # kinds of pictures, one of each for a run
HEADER = "t [s],X [N],Y [N],N [N m],sigma X [N],sigma Y [N],sigma N [N m]"


class Folder:
    """Where the results of one comparison go. Call `prepare`; write runs and numbers within `replaced`; then
    write the page.

    labels: the models'; form: format of pictures, "png" or "svg"; force: overwrites files.
    """

    def __init__(
        self, path: str, labels: Sequence[str], pictures: bool, form: str, force: bool
    ) -> None:
        self.path = path
        self.labels = labels
        self.pictures = pictures
        self.form = form
        self.force = force
        self.numbers = os.path.join(path, "compare.json")
        self.page = os.path.join(path, "report.html")
        self._names: Dict[str, Document] = {}  # paths of the files of each run
        self._new = path  # where files are written

    @property
    def to_look_at(self) -> str:
        """The page, or the JSON file where there is none."""
        return self.page if self.pictures else self.numbers

    def prepare(self, runs: Sequence[str]) -> None:
        """Makes the folder. GroundError when it cannot, or when a file exists and `force` is not
        set."""
        stems = distinct_labels([_stem(run) for run in runs], [""] * len(runs))
        self._names = {run: self._files_of(stem) for run, stem in zip(runs, stems)}
        paths = [self.numbers] + ([self.page] if self.pictures else [])
        for named in self._names.values():
            paths += _paths(named)
        result_folder.prepare(self.path, paths, self.force)

    @contextlib.contextmanager
    def replaced(self) -> Iterator[None]:
        """Wraps a block that writes all files except the page. They take the place of those of an older
        comparison when it succeeds."""
        older = result_folder.older(self.numbers, SCHEMA)
        stale = [os.path.basename(self.page)] if older else []
        for run in older.get("runs", []):
            named = dict(run.get("pictures") or {}, comparison=run.get("picture"))
            named["models"] = {label: m.get("files") for label, m in run["models"].items()}
            stale += [os.path.basename(path) for path in _paths(named)]
        with result_folder.replaced(self.path, stale, self.force) as folder:
            self._new = folder
            yield

    def _place(self, path: Optional[str]) -> str:
        """Where a file is written."""
        return os.path.join(self._new, os.path.basename(path or ""))

    def _files_of(self, run: str) -> Document:
        """Names of all files of one run; None for pictures that are not drawn."""

        def picture(stem: str) -> Optional[str]:
            name = "%s.%s" % (stem, self.form)
            return os.path.join(self.path, name) if self.pictures else None

        named: Document = {
            "comparison": picture(run),
            "where": picture(run + ".where"),
            "residuals": picture(run + ".residuals"),
            "models": {},
        }
        stems = distinct_labels([_stem(label) for label in self.labels], [""] * len(self.labels))
        for label, stem in zip(self.labels, stems):
            stem = "%s.wrench.%s" % (run, stem)
            named["models"][label] = {
                "wrench_picture": picture(stem),
                "wrench_csv": os.path.join(self.path, "%s.csv" % stem),
            }
        return named

    def write_run(self, run: "RunComparison") -> None:
        """Writes the files of one run."""
        named = self._names[run.name]
        for study in run.studies:
            _write_wrench(self._place(named["models"][study["label"]]["wrench_csv"]), study)
        if self.pictures:
            places: Document = {kind: self._place(named[kind]) for kind in KINDS}
            places["models"] = {
                label: self._place(of_model["wrench_picture"])
                for label, of_model in named["models"].items()
            }
            _draw(run.studies, places)

    def write_numbers(self, found: "Comparison") -> Document:
        """Writes compare.json; returns its contents."""
        result: Document = found.to_dict([self._names[run.name] for run in found.runs])
        files.write_json(self._place(self.numbers), result)
        return result

    def write_page(self, found: "Comparison", result: Document) -> None:
        """Writes the page; result: contents of compare.json."""
        inputs = [run.recording.path for run in found.runs]
        inputs += [model.path for model in found.models.values()]
        report.comparison(
            self.page,
            result,
            [run.studies for run in found.runs],
            findings.describe([repaired(run.recording) for run in found.runs]),
            [path for path in inputs if path],
            self.force,
        )


def _stem(label: str) -> str:
    """A run's or model's name as a part of names of files."""
    return label.replace(os.sep, "_").lstrip(".") or "unnamed"


def _paths(named: Document) -> List[str]:
    """Paths of all files of one run."""
    paths = [named.get(kind) for kind in KINDS]
    for of_model in named["models"].values():
        paths += (of_model or {}).values()
    return [path for path in paths if path]


def _draw(studies: List[Document], places: Document) -> None:
    """Draws one run; places: by kind, or by model's label."""
    from ground.reports import figures, picture, wrench_figures

    picture.write(places["comparison"], [figures.motion(studies)])
    picture.write(places["where"], [figures.where(studies)])
    picture.write(places["residuals"], [figures.residual_correlation(studies)])
    winner = studies[-1]["label"]
    for place, study in enumerate(studies):
        over_time = wrench_figures.wrench_over_time([study], place)
        drawn = [over_time, wrench_figures.wrench([study], winner, place)]
        picture.write(places["models"][study["label"]], drawn)


def _write_wrench(path: str, study: Document) -> None:
    missing = study["missing"]
    with files.new_file(path) as temporary:
        np.savetxt(
            temporary,
            np.column_stack([missing.times, missing.wrench, missing.sigma]),
            fmt="%.6g",
            delimiter=",",
            header=HEADER,
            comments="",
        )
