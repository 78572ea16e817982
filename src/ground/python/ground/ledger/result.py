"""A history: its numbers, its lines of text, and the folder in which it is kept."""

import csv
import functools
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Dict, Iterator, List, Sequence

from ground.ledger import words
from ground.ledger.contents import SCHEMA, HistoryContents
from ground.reports import result_folder
from ground.support import files, records
from ground.support.annotations import Document, Path
from ground.support.docstrings import internal
from ground.support.headline import Line
from ground.support.results import Plotted, Shown

if TYPE_CHECKING:
    import pandas

FILES = ("report.html", "history.json", "runs.csv")
OF_RUN = ("recorded", "craft", "type", "length")  # columns of a table, before the parameters


@dataclass(frozen=True, repr=False)
class History(Shown, Plotted):
    """What changed over the runs of a laboratory.

    >>> found = ground.history(bag, model=model_file, free=["k"])
    >>> found.runs[0]["parameters"]["k"]["value"] > 0.05
    True
    >>> list(found.plot("k").layout.xaxis)[:1] != []
    True
    """

    contents: HistoryContents  #: all contents of history.json

    @functools.cached_property
    def report(self) -> Document:
        """All contents of history.json; docs/schemas/history.schema.json explains the keys."""
        return dict(records.plain(self.contents))

    @property
    def changes(self) -> List[Document]:
        """Drifts and jumps, the most certain first: craft, parameter, kind, before, after, after_ci95,
        between (names of two runs), times, p_value."""
        return list(self.report["changes"])

    @property
    def odd(self) -> List[Document]:
        """Craft that differ from the others of their type: craft, parameter, value, ci95, others."""
        return list(self.report["odd"])

    @property
    def runs(self) -> List[Document]:
        """The runs in order of time: name, path, recorded, craft, type, and parameters (value, ci95, mean;
        None for a parameter that the run does not identify)."""
        return list(self.report["runs"])

    @property
    def left_out(self) -> List[Document]:
        """Files that could not be used: path, and why."""
        return list(self.report["left_out"])

    @property
    def verdicts(self) -> List[Document]:
        """Saved diagnoses below the folders: folder, verdict, effects, version, current, now."""
        return list(self.report["verdicts"])

    @classmethod
    @internal
    def load(cls, folder: Path) -> "History":
        """The history in a folder. GroundError when it cannot be read."""
        document = result_folder.read(folder, FILES[1], SCHEMA)
        return cls(records.read(HistoryContents, document, FILES[1]))

    def headline(self, written: str = "") -> List[Line]:
        """First lines of the report: what changed, which craft is odd, and what to do next."""
        return words.lines(self.contents, written)

    def table(self) -> Iterator[str]:
        """Lines of text: the craft as they are now."""
        return words.crafts(self.contents)

    def details(self) -> Iterator[str]:
        """Lines of text: all changes, and the runs."""
        return words.evidence(self.contents)

    def to_dict(self) -> Dict[str, object]:
        """The result as plain values, as in history.json."""
        return self.report

    def to_frame(self) -> "pandas.DataFrame":
        """Table of the runs, indexed by name: recorded, craft, type, length [s], and for each parameter its
        value, low and high (95%), in its unit."""
        import pandas

        header, *rows = self._rows()
        return pandas.DataFrame(rows, columns=header).set_index("run")

    def _rows(self) -> Iterator[Sequence[Any]]:
        """A header, and a row for each run."""
        names = list(dict.fromkeys(name for kind in self.contents.types for name in kind.parameters))
        yield ["run", *OF_RUN, *(name + end for name in names for end in ("", " low", " high"))]
        for run in self.contents.runs:
            row = [run.name, run.recorded, run.craft, run.type, run.length]
            for name in names:
                found = run.parameters.get(name)
                row += [found.value, *found.ci95] if found else [None] * 3
            yield row

    def save(self, folder: Path, force: bool = False) -> str:
        """Writes history.json, runs.csv (one line per run) and report.html.

        Returns
        -------
        str
            Path of the page.
        """
        place = os.fspath(folder)
        page_file, numbers, _ = prepare(place, force)
        with result_folder.replaced(place, (), force) as new:
            files.write_json(os.path.join(new, FILES[1]), self.report)
            with open(os.path.join(new, FILES[2]), "w", newline="") as file:
                csv.writer(file).writerows(self._rows())
        from ground.ledger import page

        with result_folder.page(page_file, numbers):
            inputs = [kind.file for kind in self.contents.types if kind.file]
            page.write(page_file, self.contents, inputs, force)
        return page_file


def prepare(folder: str, force: bool) -> Sequence[str]:
    """Makes the folder of a history; paths of its files. GroundError when it cannot be made, or has them and
    `force` is not set."""
    paths = [os.path.join(folder, name) for name in FILES]
    result_folder.prepare(folder, paths, force)
    return paths
