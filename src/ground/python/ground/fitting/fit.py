"""fit: a model's parameters from recordings."""

import argparse
from dataclasses import dataclass
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import comparison, folds, window_error
from ground.data import bag_arguments
from ground.data.measured import Measured, Recordings, held_out, measured
from ground.fitting import identifiability, unit_slips
from ground.fitting.result import BlockErrors, Change, Errors, Fit, RunFit, ThesisObjective
from ground.models import Model, ModelLike, fitted_model, parameters_by_name
from ground.recordings import quality, windows
from ground.support import command_line
from ground.support.annotations import Array, Document
from ground.support.command_line import count, option, positive
from ground.support.errors import GroundError, warn
from ground.support.progress import Progress, Work

OBJECTIVES = ("least-squares", "thesis")
TARGETS = ("velocities", "poses")
FITTING = "fitting"  # stage


@dataclass(frozen=True)
class FitOptions(bag_arguments.Part):
    """How a model is fitted."""

    free: Sequence[str] = option(
        window_error.NOMINAL,
        "free parameters (%s)" % " ".join(window_error.NOMINAL),
        metavar="NAME",
        nargs="+",
    )
    objective: str = option(
        "least-squares",
        "robust weighted least squares (default), or mean absolute error (3.4)",
        choices=OBJECTIVES,
    )
    target: str = option(
        "velocities",
        "what is simulated and measured: smoothed velocities (default), or raw poses, which are more "
        "precise if the model is right",
        choices=TARGETS,
    )
    window: float = option(windows.WINDOW, "length of windows [s] (%(default)s)", type=positive)
    starts: int = option(
        1,
        "fit from the model's values and N - 1 others, and keep the best (%(default)s)",
        type=count,
        metavar="N",
    )
    block: float = option(
        folds.BLOCK,
        "length of the blocks of time that are held out, in %d parts at most [s] (%%(default)s)"
        % folds.BLOCK_FOLDS,
        type=positive,
    )


@dataclass(frozen=True)
class _Problem:
    """The data of a fit, and its options."""

    runs: List[_core.RunData]
    options: FitOptions

    def cut(self) -> List[_core.Window]:
        """Windows of all runs."""
        return windows.cut(self.runs, self.options.window)

    def fit(
        self, model: _core.Model, cut: Sequence[_core.Window], starts: int = 1, **options: Any
    ) -> Document:
        """The core's result of a fit of a _core.Model to windows."""
        objective = getattr(_core.Objective, self.options.objective.replace("-", "_"))
        target = getattr(_core.Target, self.options.target)
        try:
            problem = windows.problem(self.runs, cut, target)
            return problem.fit(model, list(self.options.free), objective, starts, **options)
        except (ValueError, RuntimeError) as error:
            raise GroundError(str(error))

    def alone(self, index: int, model: _core.Model) -> Document:
        """The core's result of a fit to one run."""
        one = _Problem([self.runs[index]], self.options)
        return one.fit(model, one.cut())

    def refit_near(self, result: Document) -> folds.Refit:
        """A function of windows and initial states that fits again, starting from a result and with
        the same outliers, so that a refit takes a few steps only."""
        width = result["width"] if np.isfinite(result["width"]) else 0.0

        def refit(part: Sequence[_core.Window], initial: Sequence[Array]) -> Document:
            return self.fit(result["model"], part, warm=True, width=width, initial=initial)

        return refit


@command_line.takes(FitOptions)
def fit(
    model: ModelLike,
    recordings: Recordings,
    *,
    holdout: Recordings = (),
    progress: Progress = None,
    options: FitOptions,
) -> Fit:
    """A model's parameters, fitted to recordings by simulation error.

    model: with the start values. recordings, holdout: recordings or bags to fit to and to test on.
    progress: called with a ground.support.progress.Report at each step. GroundError when a file cannot be
    read, a parameter does not exist or there is nothing to fit to. Options, as keyword arguments or as
    FitOptions:

    >>> craft = ground.Model.load(model_file)
    >>> found = ground.fit(craft.with_values({"k": 0.09}), bag, free=["k", "N_r"])
    >>> low, high = found.parameters["k"].ci95
    >>> low < 0.062 < high  # [N], the craft's true value
    True
    >>> found.error.after < found.error.before
    True
    """
    work = Work.of(progress)
    given = Model.of(model)
    command_line.check(options)
    seen = measured(recordings, given, options, work)
    held = held_out(holdout, given, options, work, seen)
    problem = _Problem(seen.data, options)
    with work.stage(FITTING):
        result = problem.fit(given.core, problem.cut(), options.starts)
    if not result["converged"]:
        warn("the fit has not converged after %d iterations" % result["iterations"])
    refit = problem.refit_near(result)
    with work.stage(folds.BLOCKS):
        blocks = _blocks(problem, given.core, result, refit, work)
    tested = _change(held.data, given.core, result["model"]) if held.data else None
    runs: List[RunFit] = []
    if len(seen.data) > 1:
        with work.stage(folds.RUNS):
            runs = _each(problem, result, refit, work)
    whole = _change(seen.data, given.core, result["model"])
    errors = Errors(whole.before, whole.after, _pooled(problem, runs), blocks, tested)
    return _result(given, seen, options.starts, result, errors, runs)


def _change(runs: List[_core.RunData], start: _core.Model, fitted: _core.Model) -> Change:
    """Errors over runs (_core.RunData) of the start values and of the fit."""
    return Change(windows.error(runs, start), windows.error(runs, fitted))


def _blocks(
    problem: _Problem, start: _core.Model, result: Document, refit: folds.Refit, work: Work
) -> Optional[BlockErrors]:
    models, options = (start, result["model"]), problem.options
    found = folds.leave_blocks_out(problem.runs, models, refit, options.block, options.window, work=work)
    if found is None:
        return None
    before, after = found["models"]
    return BlockErrors(before, after, found["heldout"], found["blocks"], found["folds"], options.block)


def _each(problem: _Problem, result: Document, refit: folds.Refit, work: Work) -> List[RunFit]:
    """Every run by itself, and held out."""
    rows = []
    held = folds.leave_runs_out(problem.runs, refit, result, problem.options.window, work=work)
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
                folds.disagreements(alone, others),
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
    given: Model, seen: Measured, starts: int, result: Document, errors: Errors, runs: List[RunFit]
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


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of identify fit."""
    bag_arguments.configure_fit(parser, "model, with the start values", "FITTED.yaml", FitOptions)


def run(arguments: argparse.Namespace) -> Document:
    """Runs identify fit; returns what --json prints."""
    return bag_arguments.run_fit(arguments, fit, FitOptions)
