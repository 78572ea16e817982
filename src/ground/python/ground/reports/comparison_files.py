"""The folder of a comparison: compare.json, wrenches over time as CSV, and the page."""

import contextlib
import os
from typing import TYPE_CHECKING, Dict, Iterator, Sequence

import numpy as np

from ground import files
from ground.annotations import Document
from ground.api.comparing import SCHEMA
from ground.api.values import distinct_labels
from ground.recordings import quality
from ground.reports import report, result_folder

if TYPE_CHECKING:
    from ground.api.comparing import Comparison, RunComparison

HEADER = "t [s],X [N],Y [N],N [N m],sigma X [N],sigma Y [N],sigma N [N m]"


class Folder:
    """Where the results of one comparison go. Call `prepare`; write runs and numbers within `replaced`; then
    write the page.

    labels: the models'; with_page: whether there is a page; force: overwrites files.
    """

    def __init__(self, path: str, labels: Sequence[str], with_page: bool, force: bool) -> None:
        self.path = path
        self.labels = labels
        self.with_page = with_page
        self.force = force
        self.numbers = os.path.join(path, "compare.json")
        self.page = os.path.join(path, "report.html")
        self._names: Dict[str, Dict[str, str]] = {}  # CSV of each run, by model
        self._new = path  # where files are written

    @property
    def to_look_at(self) -> str:
        """The page, or the JSON file where there is none."""
        return self.page if self.with_page else self.numbers

    def prepare(self, runs: Sequence[str]) -> None:
        """Makes the folder. GroundError when it cannot, or when a file exists and `force` is not
        set."""
        stems = distinct_labels([_stem(run) for run in runs], [""] * len(runs))
        self._names = {run: self._files_of(stem) for run, stem in zip(runs, stems)}
        paths = [self.numbers] + ([self.page] if self.with_page else [])
        for named in self._names.values():
            paths += named.values()
        result_folder.prepare(self.path, paths, self.force)

    @contextlib.contextmanager
    def replaced(self) -> Iterator[None]:
        """Wraps a block that writes all files except the page. They take the place of those of an older
        comparison when it succeeds."""
        older = result_folder.older(self.numbers, SCHEMA)
        stale = [os.path.basename(self.page)] if older else []
        for run in older.get("runs", []):
            named = [model["files"] for model in run["models"].values() if model.get("files")]
            stale += [os.path.basename(path) for files_of in named for path in files_of.values() if path]
        with result_folder.replaced(self.path, stale, self.force) as folder:
            self._new = folder
            yield

    def _place(self, path: str) -> str:
        """Where a file is written."""
        return os.path.join(self._new, os.path.basename(path))

    def _files_of(self, run: str) -> Dict[str, str]:
        """Paths of the CSV files of one run."""
        stems = distinct_labels([_stem(label) for label in self.labels], [""] * len(self.labels))
        return {
            label: os.path.join(self.path, "%s.wrench.%s.csv" % (run, stem))
            for label, stem in zip(self.labels, stems)
        }

    def write_run(self, run: "RunComparison") -> None:
        """Writes the files of one run."""
        for study in run.studies:
            _write_wrench(self._place(self._names[run.name][study["label"]]), study)

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
            quality.describe([run.recording.repaired for run in found.runs]),
            [path for path in inputs if path],
            self.force,
        )


def _stem(label: str) -> str:
    """A run's or model's name as a part of names of files."""
    return label.replace(os.sep, "_").lstrip(".") or "unnamed"


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
