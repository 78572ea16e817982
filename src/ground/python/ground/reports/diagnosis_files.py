"""The folder of a diagnosis: its numbers, the improved model, what to do next, and the page."""
import os
from typing import TYPE_CHECKING

from ground import files
from ground.analysis import diagnosis_report
from ground.analysis.conclusion import MISREAD
from ground.recordings import findings
from ground.reports import report, result_folder

if TYPE_CHECKING:
    from ground.api.diagnosing import Diagnosis


class Folder:
    """Where the results of one diagnosis go; `prepare` comes before it. force: overwrites files."""

    def __init__(self, path: str, force: bool) -> None:
        def inside(name: str) -> str:
            return os.path.join(path, name)

        self.path = path
        self.force = force
        self.numbers = inside("diagnosis.json")
        self.page = inside("report.html")
        self.improved = inside("improved.yaml")
        self.proposal = inside("proposal.yaml")
        self.next_experiment = inside("next_experiment.csv")
        # files that exist, in the order in which a user is told of them
        self.written = [
            self.numbers,
            self.page,
            self.improved,
            self.proposal,
            self.next_experiment,
        ]

    def prepare(self) -> None:
        """Makes the folder. GroundError when it cannot, or when a file exists and `force` is not
        set."""
        result_folder.prepare(self.path, self.written, self.force)

    def write_numbers(self, found: "Diagnosis") -> None:
        """Writes all files except the page, in place of those of an older diagnosis."""
        own = [os.path.basename(path) for path in self.written]
        stale = own if result_folder.older(self.numbers, diagnosis_report.SCHEMA) else []
        with result_folder.replaced(self.path, stale, self.force) as folder:
            self._write(found, folder)

    def _write(self, found: "Diagnosis", folder: str) -> None:
        """Writes all files except the page into a folder."""

        def inside(path: str) -> str:
            return os.path.join(folder, os.path.basename(path))

        if found.verdict == MISREAD:
            self.written.remove(self.improved)
        else:
            found.improved.save(inside(self.improved))
        if found.next_inputs is not None:
            files.write_csv(inside(self.next_experiment), "time,left,right", found.next_inputs)
        else:
            self.written.remove(self.next_experiment)
        files.write_json(inside(self.numbers), found.report)
        proposal = found.report["unexplained"]["proposal"]
        if proposal:
            files.write_yaml(inside(self.proposal), diagnosis_report.effect_entry(proposal))
        else:
            self.written.remove(self.proposal)

    def write_page(self, found: "Diagnosis") -> None:
        """Writes the page."""
        problem = found.problem
        report.diagnosis(
            self.page,
            found.report,
            found.found,
            found.conclusion,
            findings.describe(problem.seen.runs + problem.held.runs),
            problem.held.data,
            problem.inputs,
            self.force,
            problem.thorough,
        )
