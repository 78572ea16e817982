"""A diagnosis: its numbers, its lines of text, and the folder in which it is kept."""

import math
import os
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Dict, Iterator, List, Optional, Tuple

import numpy as np

from ground.analysis.verdict import MISREAD
from ground.diagnosing import answer, words
from ground.diagnosing.drawn import REFITTED, Drawn
from ground.diagnosing.report import SCHEMA, DiagnosisReport, FitLikelihood
from ground.effect_library.effects import Effect
from ground.models import Estimated, Model, Parameter
from ground.reports import result_folder
from ground.support import files, records
from ground.support.annotations import Array, Document, Path
from ground.support.docstrings import internal
from ground.support.errors import GroundError
from ground.support.headline import Line
from ground.support.results import Plotted, Shown

if TYPE_CHECKING:
    import pandas

# Files of a diagnosis, in the order in which they are listed
FILES = ("diagnosis.json", "report.html", "improved.yaml", "proposal.yaml", "next_experiment.csv")


@dataclass(frozen=True, repr=False)
class Diagnosis(Shown, Plotted, Estimated):
    """Effects that are missing in a model, how much they improve it, and the model with them.

    >>> found = ground.diagnose(model_file, bag, only=["yaw_bias", "wind"])
    >>> found.save("diagnosis")[0]
    'diagnosis/diagnosis.json'
    >>> again = ground.load("diagnosis")
    >>> again.effects, again.improved == found.improved, again.error == found.error
    (('yaw_bias',), True, True)
    >>> round(found.aic + 2 * found.llf) == 2 * len(found.params), found.bic > found.aic
    (True, True)
    >>> "95%" in found.to_frame().loc["yaw_bias", "estimates"]
    True
    """

    verdict: str  #: complete, missing, varies, memory, unexplained, undecided or misread
    effects: Tuple[str, ...]  #: added effects, in the order in which they lower the error
    improved: Model  #: the model with these effects, refitted
    parameters: Dict[str, Parameter]  #: parameters of the improved model, by name
    #: held-out error of the best refit without the effects, then after each effect
    error: Tuple[float, ...]
    noise_floor: float  #: held-out error of a true model, from pose noise
    next_inputs: Optional[Array]  #: (n, 3) time [s], left, right: the proposed experiment
    contents: DiagnosisReport  #: all contents of diagnosis.json
    drawn: Optional[Drawn]  #: data of the page's figures; None in a loaded diagnosis

    @classmethod
    @internal
    def of(
        cls,
        found: DiagnosisReport,
        improved: Model,
        next_inputs: Optional[Array],
        drawn: Optional[Drawn] = None,
    ) -> "Diagnosis":
        """The diagnosis of a report."""
        errors = [found.nominal.error, *(step.error for step in found.steps[:-1]), found.improved.error]
        held = [math.inf if one.heldout is None else one.heldout for one in errors[: 1 + len(found.steps)]]
        return cls(
            verdict=found.verdict,
            effects=tuple(found.improved.effects),
            improved=improved,
            parameters={name: p.named(name) for name, p in found.improved.parameters.items()},
            error=tuple(held),
            noise_floor=found.noise_floor,
            next_inputs=next_inputs,
            contents=found,
            drawn=drawn,
        )

    @cached_property
    def report(self) -> Document:
        """All contents of diagnosis.json; docs/schemas/diagnosis.schema.json explains the keys."""
        return records.plain(self.contents)  # type: ignore[no-any-return]

    @property
    def proposal(self) -> Optional[Effect]:
        """A formula for the unnamed part of the error, as an effect that can be added; None without one."""
        proposal = self.contents.unexplained.proposal
        return Effect.of(proposal.entry) if proposal else None

    @property
    def tried(self) -> List[Document]:
        """The effects tried, best first, as `candidates` of the report, with `meaning`, `size` and `certain`
        in words."""
        return [
            answer.tried(
                c,
                len(self.contents.candidates),
                self.contents.means,
                self.contents.nominal.cross_validated,
            )
            for c in self.contents.candidates
        ]

    @property
    def llf(self) -> float:
        """Log-likelihood of the measured poses (and of gyro and accelerometer, where they were recorded)
        under the improved model with a random disturbance and the noise of the poses, whose levels are
        also fitted: of one-step predictions of a Kalman filter (docs: Likelihood). Poses are thinned; of
        long runs, it covers the parts that were searched (`seconds` of the report). GroundError where the
        improved model was fitted by simulation error, or the diagnosis was saved by an older version."""
        return self._likelihood.llf

    @property
    def aic(self) -> float:
        """Akaike's criterion, 2 k - 2 llf. k counts the parameters, not the levels of disturbance and
        noise, which all models have."""
        return 2 * self._likelihood.parameters - 2 * self.llf

    @property
    def bic(self) -> float:
        """Schwarz's criterion, k ln(n) - 2 llf, with k as in `aic` and three numbers for each pose in n."""
        found = self._likelihood
        return found.parameters * math.log(found.observations) - 2 * self.llf

    @property
    def _likelihood(self) -> FitLikelihood:
        found = self.contents.improved.likelihood
        if found is None:
            raise GroundError(
                "the improved model has no likelihood: it was fitted by simulation error, or the "
                "diagnosis was saved by an older version"
            )
        return found

    def headline(self, written: str = "") -> List[Line]:
        """First lines of the report: what is missing, how much it matters, and what to do next."""
        return answer.lines(self.contents, written)

    def details(self) -> Iterator[str]:
        """Lines of text: the evidence for each effect, and the remaining error."""
        return words.evidence(self.contents)

    def to_dict(self) -> Document:
        """The result as plain values, as in diagnosis.json."""
        return self.report

    def to_frame(self) -> "pandas.DataFrame":
        """Table of the effects tried, best first, indexed by name: p, p_corrected (for their number),
        delta_bic, error_fit, error_heldout, selected, seen, estimates (in words, effect by effect)."""
        import pandas

        rows = [
            [c.effect, c.p, c.p_corrected, c.delta_bic, c.error.fit, c.error.heldout, c.selected, c.seen]
            for c in self.contents.candidates
        ]
        columns = [
            "effect",
            "p",
            "p_corrected",
            "delta_bic",
            "error_fit",
            "error_heldout",
            "selected",
            "seen",
        ]
        frame = pandas.DataFrame(rows, columns=columns).set_index("effect")
        frame = frame.astype({"error_fit": "Float64", "error_heldout": "Float64"})
        frame["estimates"] = ["; ".join(words.parameters(c.parameters)) for c in self.contents.candidates]
        return frame

    @classmethod
    @internal
    def load(cls, folder: Path) -> "Diagnosis":
        """The diagnosis that `save` wrote into a folder, without its page's figures. GroundError when there
        is none."""
        _, _, improved, _, experiment = (os.path.join(os.fspath(folder), name) for name in FILES)
        found = DiagnosisReport.load(folder, FILES[0])
        rows = np.loadtxt(experiment, delimiter=",", skiprows=1) if os.path.isfile(experiment) else None
        model = Model.load(improved if os.path.isfile(improved) else found.model)
        return cls.of(found, model, rows)

    def to_mat(self, path: Path, force: bool = False) -> None:
        """Writes a file for MATLAB and Octave.

        The file contains structs `models`, `parameters` and `runs` with the measured motion and the
        predictions of the models "refitted" (without the effects) and "improved", and `effects` with the
        effects tried; its text `about` explains units and frames.

        Raises
        ------
        GroundError
            When the file cannot be written, or this diagnosis was loaded.
        """
        from ground.reports import matlab

        if self.drawn is None:
            raise GroundError("a loaded diagnosis contains no runs to write: diagnose again with --mat")
        models = {REFITTED: Model(self.drawn.models[REFITTED]), "improved": self.improved}
        studied = matlab.studies(models, [*self.drawn.runs, *self.drawn.held])
        effects = self.to_frame().reset_index().rename(columns={"effect": "name"})
        rows = effects.astype({name: float for name in ("error_fit", "error_heldout")}).to_dict("records")
        matlab.write(path, models, studied, force, verdict=self.verdict, effects=rows)

    def save(self, folder: Path, force: bool = False) -> List[str]:
        """Writes diagnosis.json, improved.yaml, report.html and, where there are any, proposal.yaml and
        next_experiment.csv. Files of an older diagnosis are removed.

        Returns
        -------
        list of str
            Paths of the written files.

        Raises
        ------
        GroundError
            When a file cannot be written, or this diagnosis was loaded.
        """
        from ground.diagnosing import page

        if self.drawn is None:
            raise GroundError("this diagnosis was loaded: its folder already contains it")
        place = os.fspath(folder)
        paths = prepare(place, force)
        stale = FILES if result_folder.is_of(paths[0], SCHEMA) else ()
        with result_folder.replaced(place, stale, force) as new:
            numbers, _, improved, proposal, experiment = (os.path.join(new, name) for name in FILES)
            files.write_json(numbers, self.report)
            if self.verdict != MISREAD:
                self.improved.save(improved)
            if self.contents.unexplained.proposal:
                files.write_yaml(proposal, self.contents.unexplained.proposal.entry)
            if self.next_inputs is not None:
                files.write_csv(experiment, "time,left,right", self.next_inputs)
            written = {*os.listdir(new), os.path.basename(paths[1])}
        with result_folder.page(paths[1], paths[0]):
            page.write(paths[1], self.contents, self.drawn, force)
        return [path for path in paths if os.path.basename(path) in written]


def prepare(folder: str, force: bool) -> List[str]:
    """Makes the folder of a diagnosis; paths of its files. GroundError when it cannot be made, or has one of
    them and `force` is not set."""
    paths = [os.path.join(folder, name) for name in FILES]
    result_folder.prepare(folder, paths, force)
    return paths
