"""fit: a model's parameters from recordings."""

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Dict, List, Optional, Sequence, Tuple

import numpy as np

from ground import _core, core_types
from ground.analysis import comparison, identifiability, study, unit_slips, validation
from ground.annotations import Array, Document, Path
from ground.api.models import (
    Model,
    ModelLike,
    Parameter,
    fitted_model,
    parameter_frame,
    parameter_rows,
    parameters_by_name,
)
from ground.api.recordings import Measured, Part, Recordings, held_out, measured
from ground.api.values import Row, Shown
from ground.errors import GroundError, OptionError
from ground.progress import Progress, Work
from ground.recordings import quality, windows

if TYPE_CHECKING:
    import pandas

OBJECTIVES = ("least-squares", "thesis")
TARGETS = ("velocities", "poses")
FITTING = "fitting"  # stage


@dataclass(frozen=True)
class Change:
    """Errors of the start values and of the fit."""

    before: float
    after: float


@dataclass(frozen=True)
class ThesisObjective:
    """(3.4) over the first 4 s of runs, with the start values and with the fit; None for shorter
    runs."""

    before: Optional[float]
    after: Optional[float]


@dataclass(frozen=True)
class BlockErrors:
    """Errors on blocks of time."""

    before: float  #: error of the start values
    after: float  #: error of the fit
    heldout: float  #: error of fits without the block
    count: int  #: number of blocks
    folds: int  #: number of folds of blocks


@dataclass(frozen=True)
class Errors:
    """Mean of |e_u|/s_u + |e_v|/s_v + |e_r|/s_r over windows of 1.5 s."""

    before: float  #: error of the start values
    after: float  #: error of the fit
    heldout_runs: Optional[float]  #: each run by a fit to the others; None for a single run
    blocks: Optional[BlockErrors]  #: None where the runs are too short
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
    message: str  #: the optimizer's message
    runs: List[RunFit]  #: fits to each run; empty for a single run
    same_inputs: List[Tuple[str, str]]  #: runs that were driven by the same commands
    remarks: List[str]  #: sentences on units that seem wrong and what is not identifiable

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

    def save(self, path: Path, force: bool = False) -> Model:
        """Writes the fitted model; see Model.save."""
        return self.model.save(path, force)

    def _table(self) -> Tuple[str, Row, List[Row]]:
        title = "Fit of %s: error %.3f, %.3f before" % (
            self.model.name,
            self.error.after,
            self.error.before,
        )
        return (
            title,
            ["parameter", "estimate", "95% interval", "unit"],
            parameter_rows(self.parameters),
        )


@dataclass(frozen=True)
class _Problem:
    """The data of a fit, and its options."""

    runs: List[_core.RunData]
    free: List[str]
    objective: str
    target: str
    window: float  #: [s]

    def cut(self) -> List[_core.Window]:
        """Windows of all runs."""
        return windows.cut(self.runs, self.window)

    def fit(
        self, model: _core.Model, cut: Sequence[_core.Window], starts: int = 1, **options: Any
    ) -> core_types.Fit:
        """The core's result of a fit of a _core.Model to windows."""
        objective = getattr(_core.Objective, self.objective.replace("-", "_"))
        target = getattr(_core.Target, self.target)
        try:
            problem = windows.problem(self.runs, cut, target)
            return problem.fit(model, self.free, objective, starts, **options)
        except (ValueError, RuntimeError) as error:
            raise GroundError(str(error))

    def alone(self, index: int, model: _core.Model) -> core_types.Fit:
        """The core's result of a fit to one run."""
        one = _Problem([self.runs[index]], self.free, self.objective, self.target, self.window)
        return one.fit(model, one.cut())

    def refit_near(self, result: core_types.Fit) -> validation.Refit:
        """A function of windows and initial states that fits again, starting from a result and with
        the same outliers, so that a refit takes a few steps only."""
        width = result["width"] if np.isfinite(result["width"]) else 0.0

        def refit(part: Sequence[_core.Window], initial: Sequence[Array]) -> core_types.Fit:
            return self.fit(result["model"], part, near=True, width=width, initial=initial)

        return refit


def fit(
    model: ModelLike,
    recordings: Recordings,
    *,
    holdout: Recordings = (),
    free: Sequence[str] = study.NOMINAL,
    objective: str = "least-squares",
    target: str = "velocities",
    window: float = windows.WINDOW,
    starts: int = 1,
    block: float = validation.BLOCK,
    start: float = 0.0,
    end: Optional[float] = None,
    everything: bool = False,
    progress: Progress = None,
) -> Fit:
    """A model's parameters, fitted to recordings by simulation error.

    model: with the start values. recordings, holdout: recordings or bags to fit to and to test on.
    free: names of the free parameters. objective: "least-squares" (robust, weighted) or "thesis"
    (mean absolute error, 3.4). target: "velocities" (smoothed) or "poses" (raw; more precise if the
    model is right). window: length of the windows that are simulated [s]. starts: fits from the
    model's values and starts - 1 others, and keeps the best. block: length of blocks of time that
    are held out [s]. start, end: the part of every run, on the run's clock [s]; everything: includes
    parts that are not usable. progress: called with a ground.progress.Report at each step. GroundError
    when a file cannot be read, a parameter does not exist or there is nothing to fit to.

    >>> craft = ground.Model.load(model_file)
    >>> found = ground.fit(craft.with_values({"k": 0.09}), bag, free=["k", "N_r"])
    >>> low, high = found.parameters["k"].ci95
    >>> low < 0.062 < high  # [N], the craft's true value
    True
    >>> found.error.after < found.error.before
    True
    """
    work = Work.of(progress)
    given, part = Model.of(model), Part(start, end, everything)
    _check(objective, target)
    seen = measured(recordings, given, part, work)
    held = held_out(holdout, given, part, work, seen)
    problem = _Problem(seen.data, list(free), objective, target, window)
    with work.stage(FITTING):
        result = problem.fit(given.core, problem.cut(), starts)
    refit = problem.refit_near(result)
    with work.stage(validation.BLOCKS):
        blocks = _blocks(problem, given.core, result, refit, block, work)
    tested = _change(held.data, given.core, result["model"]) if held.data else None
    runs: List[RunFit] = []
    if len(seen.data) > 1:
        with work.stage(validation.RUNS):
            runs = _each(problem, result, refit, work)
    whole = _change(seen.data, given.core, result["model"])
    errors = Errors(whole.before, whole.after, _pooled(problem, runs), blocks, tested)
    return _result(given, seen, starts, result, errors, runs)


def _check(objective: str, target: str) -> None:
    for name, value, known in (("objective", objective, OBJECTIVES), ("target", target, TARGETS)):
        if value not in known:
            raise OptionError("{0} must be one of {known}", name, known=", ".join(known))


def _change(runs: List[_core.RunData], start: _core.Model, fitted: _core.Model) -> Change:
    """Errors over runs (_core.RunData) of the start values and of the fit."""
    return Change(windows.error(runs, start), windows.error(runs, fitted))


def _blocks(
    problem: _Problem,
    start: _core.Model,
    result: core_types.Fit,
    refit: validation.Refit,
    block: float,
    work: Work,
) -> Optional[BlockErrors]:
    models = start, result["model"]
    found = validation.leave_blocks_out(problem.runs, models, refit, block, problem.window, work=work)
    if found is None:
        return None
    before, after = found["models"]
    return BlockErrors(before, after, found["heldout"], found["blocks"], found["folds"])


def _each(
    problem: _Problem,
    result: core_types.Fit,
    refit: validation.Refit,
    work: Work,
) -> List[RunFit]:
    """Every run by itself, and held out."""
    rows = []
    held = validation.leave_runs_out(problem.runs, refit, result, problem.window, work=work)
    work.more(len(problem.runs))
    for i, (others, error) in enumerate(held):
        alone = problem.alone(i, result["model"])
        rows.append(
            RunFit(
                problem.runs[i].name,
                {p["name"]: p["value"] for p in alone["parameters"]},
                {p["name"]: p["ci95"] for p in alone["parameters"]},
                windows.error([problem.runs[i]], alone["model"]),
                error,
                validation.disagreements(alone, others),
            )
        )
        work.step()
    return rows


def _pooled(problem: _Problem, runs: List[RunFit]) -> Optional[float]:
    """Mean error of runs held out, weighted by their number of samples."""
    if not runs:
        return None
    samples = [len(run.times) for run in problem.runs]
    return float(np.average([run.heldout_error for run in runs], weights=samples))


def _result(
    given: Model,
    seen: Measured,
    starts: int,
    result: core_types.Fit,
    errors: Errors,
    runs: List[RunFit],
) -> Fit:
    core, parameters = result["model"], parameters_by_name(result["parameters"])
    return Fit(
        model=fitted_model(core, seen.recordings, *_by_kind(errors), parameters),
        parameters=parameters,
        error=errors,
        thesis_objective=ThesisObjective(
            comparison.mean_thesis_objective(seen.data, given.core),
            comparison.mean_thesis_objective(seen.data, core),
        ),
        objective=result["objective"],
        starts={"tried": starts, "at_best": result["starts_at_best"]},
        condition=result["condition"],
        weak=identifiability.weak_directions(result),
        converged=result["converged"],
        message=result["message"],
        runs=runs,
        same_inputs=quality.same_inputs(seen.runs),
        remarks=[
            *unit_slips.sentences(given.core, {p.name: p.value for p in parameters.values()}),
            *identifiability.sentences(result),
        ],
    )


def _by_kind(errors: Errors) -> Tuple[Dict[str, float], Dict[str, float]]:
    """Errors before and after by kind of runs, as model files keep them."""
    before, after = {"fit": errors.before}, {"fit": errors.after}
    if errors.blocks:
        before["blocks"], after["blocks"] = errors.blocks.before, errors.blocks.heldout
    if errors.holdout:
        before["heldout"], after["heldout"] = errors.holdout.before, errors.holdout.after
    return before, after
