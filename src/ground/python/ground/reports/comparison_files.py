"""The folder of a comparison: compare.json, wrenches over time as CSV, pictures and the page."""

import os
from typing import TYPE_CHECKING, Dict, List, Optional, Sequence

import numpy as np

from ground import files
from ground.annotations import Document
from ground.errors import GroundError
from ground.recordings import quality
from ground.reports import report

if TYPE_CHECKING:
    from ground.api.comparing import Comparison, RunComparison

KINDS = ("comparison", "where", "residuals")  # kinds of pictures, one of each for a run
HEADER = "t [s],X [N],Y [N],N [N m],sigma X [N],sigma Y [N],sigma N [N m]"


class Folder:
    """Where the results of one comparison go; `prepare` comes before the runs, `write` after them.

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
        self._names: Dict[str, Document] = {}  # names of the files of each run

    @property
    def to_look_at(self) -> str:
        """The page, or the JSON file where there is none."""
        return self.page if self.pictures else self.numbers

    def prepare(self, runs: Sequence[str]) -> None:
        """Makes the folder. GroundError when it cannot, or when a file exists and `force` is not
        set."""
        try:
            os.makedirs(self.path, exist_ok=True)
        except OSError as error:
            raise GroundError("%s: cannot be made a folder (%s)" % (self.path, error))
        self._names = {run: self._files_of(run) for run in runs}
        paths = [self.numbers] + ([self.page] if self.pictures else [])
        for named in self._names.values():
            paths += [named[kind] for kind in KINDS]
            paths += [path for of_model in named["models"].values() for path in of_model.values()]
        for path in paths:
            if path:
                files.refuse_existing(path, self.force)

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
        for label in self.labels:
            stem = "%s.wrench.%s" % (run, label.strip("./").replace(os.sep, "_"))
            named["models"][label] = {
                "wrench_picture": picture(stem),
                "wrench_csv": os.path.join(self.path, "%s.csv" % stem),
            }
        return named

    def write_run(self, run: "RunComparison") -> None:
        """Writes the files of one run."""
        named = self._names[run.name]
        for study in run.studies:
            _write_wrench(named["models"][study["label"]]["wrench_csv"], study, self.force)
        if self.pictures:
            _draw(run.studies, named, self.force)

    def write(self, found: "Comparison") -> Document:
        """Writes compare.json and the page; returns the contents of the former."""
        result = self.write_numbers(found)
        if self.pictures:
            self.write_page(found, result)
        return result

    def write_numbers(self, found: "Comparison") -> Document:
        """Writes compare.json; returns its contents."""
        result: Document = found.to_dict([self._names[run.name] for run in found.runs])
        files.write_json(self.numbers, result, self.force)
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


def _draw(studies: List[Document], named: Document, force: bool) -> None:
    from ground.reports import figures, picture, wrench_figures

    picture.write(named["comparison"], [figures.motion(studies)], force)
    picture.write(named["where"], [figures.where(studies)], force)
    picture.write(named["residuals"], [figures.residual_correlation(studies)], force)
    winner = studies[-1]["label"]
    for place, study in enumerate(studies):
        over_time = wrench_figures.wrench_over_time([study], place)
        drawn = [over_time, wrench_figures.wrench([study], winner, place)]
        picture.write(named["models"][study["label"]]["wrench_picture"], drawn, force)


def _write_wrench(path: str, study: Document, force: bool) -> None:
    missing = study["missing"]
    with files.new_file(path, force) as temporary:
        np.savetxt(
            temporary,
            np.column_stack([missing.times, missing.wrench, missing.sigma]),
            fmt="%.6g",
            delimiter=",",
            header=HEADER,
            comments="",
        )
