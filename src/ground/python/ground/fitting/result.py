"""A fit, and its lines of text."""

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Dict, Iterator, List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.models import Model, Parameter, parameter_frame
from ground.support.annotations import Document, Path
from ground.support.results import Shown

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Change:
    """Errors before and after: of the start values and the fit, or without an effect and with it."""

    before: float
    after: float

    @property
    def change(self) -> float:
        """Relative change of the error: -0.1 is 10% less."""
        return self.after / self.before - 1


@dataclass(frozen=True)
class ThesisObjective:
    """(3.4) over the first 4 s of runs, with the start values and with the fit; None for shorter
    runs."""

    before: Optional[float]
    after: Optional[float]


@dataclass(frozen=True)
class Errors:
    """Mean of |e_u|/s_u + |e_v|/s_v + |e_r|/s_r over windows of 1.5 s."""

    before: float  #: error of the start values
    after: float  #: error of the fit
    #: each run by a fit to the others, each quarter of a single run by a fit to the rest; None where it is
    #: too short
    heldout: Optional[float]
    holdout: Optional[Change]  #: on runs given to test on


@dataclass(frozen=True)
class RunFit:
    """One run fitted by itself, and held out of a fit to the others (the thesis's table 3.2)."""

    run: str
    parameters: Dict[str, float]
    ci95: Dict[str, Tuple[float, float]]
    error: float
    heldout_error: float
    disagrees_in: List[str]  #: parameters whose estimate differs from that of the other runs


@dataclass(frozen=True, repr=False)
class Fit(Shown):
    """A model fitted to recordings."""

    model: Model  #: fitted
    parameters: Dict[str, Parameter]  #: the free parameters, by name
    error: Errors
    thesis_objective: ThesisObjective
    objective: float  #: the minimised value
    starts: Dict[str, int]  #: number of starts tried, and that reached this optimum (at_best)
    condition: float  #: condition number of the scaled information matrix
    weak: List[Document]  #: combinations of parameters that are known better than their parts
    converged: bool
    runs: List[RunFit]  #: fits to each run; empty for a single run
    same_inputs: List[Tuple[str, str]]  #: runs that were driven by the same commands
    remarks: List[str]  #: sentences on what is not identifiable
    given: Model  #: with the start values
    data: List[_core.RunData]  #: the runs fitted to, as fits use them

    def to_dict(self) -> Document:
        """Plain values, as `identify fit --json` prints them."""
        parameters = {name: asdict(p) for name, p in self.parameters.items()}
        for described in parameters.values():
            del described["name"]
        return {
            "parameters": parameters,
            "error": asdict(self.error),
            "thesis_objective": asdict(self.thesis_objective),
            "objective": self.objective,
            "starts": self.starts,
            "condition": self.condition,
            "weak": self.weak,
            "converged": self.converged,
            "runs": [asdict(run) for run in self.runs],
            "same_inputs": self.same_inputs,
        }

    def to_frame(self) -> "pandas.DataFrame":
        """Parameters, indexed by name: start, value, low, high (95%), identified, unit."""
        return parameter_frame(self.parameters)

    def to_mat(self, path: Path, force: bool = False) -> None:
        """Writes a file for MATLAB and Octave: structs `models`, `parameters` and `runs` with what was
        measured and what the models "start" and "fitted" predict; its text `about` has units and frames.
        GroundError when the file cannot be written."""
        from ground.reports import matlab

        models = {"start": self.given, "fitted": self.model}
        matlab.write(path, models, matlab.studies(models, self.data), force)

    def save(self, path: Path, force: bool = False) -> Model:
        """Writes the fitted model; see Model.save."""
        return self.model.save(path, force)

    @property
    def title(self) -> str:
        """The fit in a line."""
        errors = self.model.name, self.error.after, self.error.before
        return "Fit of %s: error %.3f, %.3f before" % errors

    def lines(self) -> Iterator[str]:
        """What `identify fit` prints: parameters, errors, each run, and what is not identifiable."""
        yield "%-18s %12s %12s   %s" % ("parameter", "start", "estimate", "95% interval")
        for p in self.parameters.values():
            unit = p.unit if p.identified else ""
            yield "%-18s %12.4g %12.4g   %s %s" % (p.name, p.start, p.value, p.interval, unit)
        yield ""
        yield "%-50s %8s %8s %9s" % ("error over windows of 1.5 s", "start", "fitted", "held out")
        for words, values in self._errors():
            yield "  %-48s %8s %8s %9s" % ((words,) + tuple("" if v is None else "%.3f" % v for v in values))
        if self.runs:
            yield ""
            yield from _table(list(self.parameters), self.runs)
        same = sorted({name for pair in self.same_inputs for name in pair})
        if same:
            yield "the same inputs drove %s: validating one on the other is optimistic" % ", ".join(same)
        yield from self.remarks
        if self.starts["tried"] > 1:
            yield "%(at_best)d of %(tried)d starts reached this optimum" % self.starts

    def _errors(self) -> Iterator[Tuple[str, Tuple[Optional[float], ...]]]:
        """Data, and the error there of the start values, of the fit, and held out."""
        errors, thesis = self.error, self.thesis_objective
        words = "the run; held out: each quarter by a fit to the rest"
        if self.runs:
            words = "all runs; held out: each by a fit to the others"
        yield words, (errors.before, errors.after, errors.heldout)
        if errors.holdout:
            yield "the held-out runs", (errors.holdout.before, None, errors.holdout.after)
        if thesis.after is not None:
            yield "(3.4) over the first 4 s", (thesis.before, thesis.after, None)


def _table(names: Sequence[str], rows: Sequence[RunFit]) -> Iterator[str]:
    """One row per run, then mean and spread, as in the thesis's table 3.2."""
    width = max(map(len, [row.run for row in rows] + ["spread"]))
    head = "".join("%11s" % n.split(".")[-1] for n in names)
    yield "%-*s %s%9s%10s" % (width, "run", head, "error", "held out")
    for row in rows:
        estimates = "".join("%11.4g" % row.parameters[n] for n in names)
        errors = "%9.3f%10.3f" % (row.error, row.heldout_error)
        yield "%s %s%s" % (row.run.ljust(width), estimates, errors)
    table = np.array([[row.parameters[n] for n in names] for row in rows])
    for name, values in (("mean", table.mean(axis=0)), ("spread", table.std(axis=0, ddof=1))):
        yield "%s %s" % (name.ljust(width), "".join("%11.4g" % v for v in values))
    for row in rows:
        if row.disagrees_in:
            yield "%s disagrees with the others in %s: inspect it before pooling the runs" % (
                row.run,
                ", ".join(row.disagrees_in),
            )
