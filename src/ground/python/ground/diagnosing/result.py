"""A diagnosis: its numbers, its lines of text, and the folder in which it is kept."""

import math
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Dict, Iterator, List, Optional, Tuple

import numpy as np

from ground.analysis import candidates
from ground.analysis.effects import Effect
from ground.analysis.verdict import MISREAD
from ground.data.measured import Measured
from ground.diagnosing import answer, document, words
from ground.diagnosing.drawn import NOMINAL, Drawn
from ground.models import Model, Parameter, Room
from ground.recordings.recording import Recording
from ground.reports import matlab, result_folder
from ground.support import files
from ground.support.annotations import Array, Document, Path
from ground.support.errors import GroundError
from ground.support.headline import Line
from ground.support.results import Plotted, Shown

if TYPE_CHECKING:
    import pandas

# Files of a diagnosis, in the order in which a user is told of them
FILES = ("diagnosis.json", "report.html", "improved.yaml", "proposal.yaml", "next_experiment.csv")


@dataclass(frozen=True)
class Problem:
    """What is diagnosed."""

    model: Model
    tried: List[candidates.Candidate]
    seen: Measured  #: recordings to fit to
    held: Measured  #: recordings to test on; empty: parts of `seen` are held out
    own: List[str]  #: files of effects
    given_room: Optional[Room]
    as_recorded: bool  #: diagnoses recordings that look misread, too

    @property
    def findings(self) -> List[Document]:
        """Mistakes that the recordings look like, as diagnosis.json has them."""
        return [finding.describe() for finding in self.seen.findings + self.held.findings]

    @property
    def misread(self) -> bool:
        """Whether effects are not looked for, because the recordings look misread."""
        return not self.as_recorded and any(finding["misread"] for finding in self.findings)

    @property
    def is_turned(self) -> bool:
        """Whether the heading looks off by a constant, which is an effect of the library, too."""
        return not self.as_recorded and any(f["kind"] == "offset" for f in self.findings)

    @property
    def inputs(self) -> List[str]:
        """Paths of all that was read."""
        bags = [r.path for r in self.seen.recordings + self.held.recordings]
        return [path for path in [*bags, self.model.path, *self.own] if path]

    def flown_in(self) -> Optional[Recording]:
        """The first run that a room was kept with."""
        return next((r for r in self.seen.recordings if "room" in r.files), None)

    def truth(self) -> Optional[str]:
        """Path of the model that moved a simulated craft; None of a real one."""
        flown = next((r for r in self.seen.recordings if "truth" in r.files), None)
        return flown.files["truth"].place() if flown else None

    def room(self) -> Optional[Room]:
        """Where the next experiment has to stay; None if no room is known."""
        flown = self.flown_in()
        return self.given_room or (Room.of_recording(flown) if flown else None)

    def room_file(self) -> str:
        """A file of that room; empty without one."""
        flown = self.flown_in()
        if self.given_room:
            return self.given_room.path
        return str(flown.files["room"].place()) if flown else ""


@dataclass(frozen=True, repr=False)
class Diagnosis(Shown, Plotted):
    """Which effects are missing in a model, by how much they improve it, and the model with them.

    >>> found = ground.diagnose(model_file, bag, only=["yaw_bias", "wind"])
    >>> found.save("diagnosis")[0]
    'diagnosis/diagnosis.json'
    >>> again = ground.load("diagnosis")
    >>> again.effects, again.improved == found.improved, again.error == found.error
    (('yaw_bias',), True, True)
    """

    verdict: str  #: complete, missing, varies, memory, unexplained, undecided or misread
    effects: Tuple[str, ...]  #: effects that were added, in the order in which the error falls
    improved: Model  #: the model with them, refitted
    parameters: Dict[str, Parameter]  #: its parameters, by name
    #: held-out error of the best refit without the effects, then after each effect
    error: Tuple[float, ...]
    noise_floor: float  #: error there that the noise of the poses alone would leave
    next_inputs: Optional[Array]  #: (n, 3) time [s], left, right: the proposed experiment
    #: everything, as diagnosis.json has it; docs/schemas/diagnosis.schema.json explains the keys
    report: Document
    drawn: Optional[Drawn]  #: what its page draws; None when it was loaded

    @property
    def proposal(self) -> Optional[Effect]:
        """A formula for what has no name, as an effect that can be added; None without one."""
        found = self.report["unexplained"]["proposal"]
        return Effect.of(document.effect_entry(found)) if found else None

    def headline(self, written: str = "") -> List[Line]:
        """Its first lines: what is missing, how much it matters, and what to do next."""
        return answer.lines(self.report, written)

    def details(self) -> Iterator[str]:
        """The evidence: what each effect explains, and what is left."""
        return words.evidence(self.report)

    def to_dict(self) -> Document:
        """Plain values, as diagnosis.json has them."""
        return self.report

    def to_frame(self) -> "pandas.DataFrame":
        """The effects tried, best first, indexed by name: p, p_corrected (for their number), delta_bic,
        error_fit, error_heldout, selected, seen, estimates (in words, each effect alone)."""
        import pandas

        rows = self.report["candidates"]
        columns = ["p", "p_corrected", "delta_bic", "selected", "seen"]
        index = pandas.Index([row["effect"] for row in rows], name="effect")
        frame = pandas.DataFrame([[row[c] for c in columns] for row in rows], index, columns)
        for place, kind in enumerate(("fit", "heldout"), 3):
            errors = [row["error"][kind] for row in rows]
            frame.insert(place, "error_" + kind, pandas.array(errors, dtype="Float64"))
        frame["estimates"] = ["; ".join(words.parameters(row["parameters"])) for row in rows]
        return frame

    @classmethod
    def load(cls, folder: Path) -> "Diagnosis":
        """The diagnosis that `save` wrote into a folder, but for what its page draws. GroundError when there
        is none."""
        numbers, _, improved, _, experiment = (os.path.join(os.fspath(folder), name) for name in FILES)
        report = document.renewed(result_folder.read(folder, FILES[0], document.SCHEMA))
        found = report["improved"]
        parameters = {name: _parameter(name, p) for name, p in found["parameters"].items()}
        rows = np.loadtxt(experiment, delimiter=",", skiprows=1) if os.path.isfile(experiment) else None
        return cls(
            verdict=report["verdict"],
            effects=tuple(found["effects"]),
            improved=Model.load(improved if os.path.isfile(improved) else report["model"]),
            parameters=parameters,
            error=(report["nominal"]["error"]["heldout"], *(s["error"]["heldout"] for s in report["steps"])),
            noise_floor=math.nan if report["noise_floor"] is None else report["noise_floor"],
            next_inputs=rows,
            report=report,
            drawn=None,
        )

    def to_mat(self, path: Path, force: bool = False) -> None:
        """Writes a file for MATLAB and Octave: structs `models`, `parameters` and `runs` with what was
        measured and what the models "refitted" (without the effects) and "improved" predict, and `effects`
        with those tried; its text `about` has units and frames. GroundError when the file cannot be written,
        or the diagnosis was loaded."""
        if self.drawn is None:
            raise GroundError("a diagnosis that was loaded has no runs to write: diagnose again with --mat")
        models = {"refitted": Model(self.drawn.models[NOMINAL]), "improved": self.improved}
        studied = matlab.studies(models, [*self.drawn.runs, *self.drawn.held])
        effects = self.to_frame().reset_index().rename(columns={"effect": "name"})
        rows = effects.astype({name: float for name in ("error_fit", "error_heldout")}).to_dict("records")
        matlab.write(path, models, studied, force, verdict=self.verdict, effects=rows)

    def save(self, folder: Path, force: bool = False) -> List[str]:
        """Writes diagnosis.json, improved.yaml, the page report.html and, where there are any,
        proposal.yaml and next_experiment.csv. Returns their paths. Files of an older diagnosis in the
        folder go. GroundError when a file cannot be written, or exists and `force` is not set."""
        from ground.diagnosing import page

        if self.drawn is None:
            raise GroundError("this diagnosis was loaded: the folder that it was saved in has all of it")
        place = os.fspath(folder)
        paths = prepare(place, force)
        stale = FILES if result_folder.is_of(paths[0], document.SCHEMA) else ()
        with result_folder.replaced(place, stale, force) as new:
            self._write(new)
            written = {*os.listdir(new), os.path.basename(paths[1])}
        with result_folder.page(paths[1], paths[0]):
            page.write(paths[1], self.report, self.drawn, force)
        return [path for path in paths if os.path.basename(path) in written]

    def _write(self, folder: str) -> None:
        """Writes all files except the page."""
        numbers, _, improved, proposal, experiment = (os.path.join(folder, name) for name in FILES)
        files.write_json(numbers, self.report)
        if self.verdict != MISREAD:
            self.improved.save(improved)
        if self.report["unexplained"]["proposal"]:
            entry = document.effect_entry(self.report["unexplained"]["proposal"])
            files.write_yaml(proposal, entry)
        if self.next_inputs is not None:
            files.write_csv(experiment, "time,left,right", self.next_inputs)


def _parameter(name: str, p: Document) -> Parameter:
    """A parameter of diagnosis.json, where null is what is not finite."""
    start, value, deviation = (math.nan if p[k] is None else p[k] for k in ("start", "value", "deviation"))
    low, high = p["ci95"] or (None, None)
    interval = -math.inf if low is None else low, math.inf if high is None else high
    flags = p["at_bound"], p["identified"]
    return Parameter(name, p["unit"], start, value, interval, deviation, *flags, p.get("runs"))


def prepare(folder: str, force: bool) -> List[str]:
    """Makes the folder of a diagnosis; paths of its files. GroundError when it cannot be made, or has one of
    them and `force` is not set."""
    paths = [os.path.join(folder, name) for name in FILES]
    result_folder.prepare(folder, paths, force)
    return paths
