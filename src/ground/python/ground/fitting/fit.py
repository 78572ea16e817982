"""fit: a model's parameters from recordings."""

import argparse
import contextlib
import functools
from dataclasses import astuple, dataclass, replace
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import horizon, window_error, windows
from ground.analysis.distributions import LEVEL, student_outside
from ground.analysis.horizon import ModelsAt, PredictionError
from ground.analysis.window_error import WindowFit, WindowFitter
from ground.data import voltage
from ground.data.measured import Measured, Part, held_out, measured
from ground.data.read import Recordings
from ground.fitting import identifiability, priors
from ground.fitting.identifiability import WindowEstimates
from ground.fitting.result import Change, Errors, Fit, RunFit, ThesisObjective
from ground.models import Model, ModelLike, fitted_model
from ground.poses import time_scales
from ground.reading.recording import NOT_SECONDS
from ground.support import command_line
from ground.support.command_line import count, option
from ground.support.errors import GroundError, warn
from ground.support.progress import Progress, Work

OBJECTIVES = ("least-squares", "thesis")
TARGETS = ("velocities", "poses")
RUNS = 20  # most parts that runs are held out in, where each has an error of its own
CLOSED = (
    "%s: the commands depend on the motion before them (closed loop), so the fit mistakes disturbances for "
    "effects of commands, and its intervals may miss the truth; record commands that do not depend on the "
    "motion, such as a PRBS, by itself or on top of the controller's"
)
FITTING, ALONE = "fitting", "fitting to each run separately"  # stages


@dataclass(frozen=True)
class FitOptions(Part):
    """How a model is fitted."""

    free: Sequence[str] = option(
        window_error.NOMINAL,
        "free parameters (%s)" % " ".join(window_error.NOMINAL),
        metavar="NAME",
        nargs="+",
    )
    prior: priors.Given = option(
        (),
        "prior of parameters: the model's value, with this standard deviation, in its unit "
        "or as a share such as 20%%; an effect stands for all its parameters; they are also free",
        metavar="NAME=DEVIATION",
        nargs="+",
        type=priors.parse,
    )
    objective: str = option(
        "least-squares",
        "robust weighted least squares (default), or mean absolute error (3.4)",
        choices=OBJECTIVES,
    )
    target: str = option(
        "velocities",
        "what is compared: smoothed velocities (default), or raw poses, which are more "
        "precise if the model is right",
        choices=TARGETS,
    )
    starts: int = option(
        1,
        "fit from the model's values and N - 1 others, and keep the best (%(default)s)",
        type=count,
        metavar="N",
    )

    def fitter(self, runs: Sequence[_core.RunData], known: priors.Known, **more: Any) -> WindowFitter:
        """Fits to runs as these options want it, with what is known beforehand. more: of WindowFitter."""
        more = {"most": np.inf, "starts": self.starts, **more}
        return WindowFitter(
            runs,
            most_parts=RUNS,
            target=getattr(_core.Target, self.target),
            objective=getattr(_core.Objective, self.objective.replace("-", "_")),
            priors=known,
            **more,
        )


@command_line.takes(FitOptions)
def fit(
    model: ModelLike,
    recordings: Recordings,
    *,
    holdout: Recordings = (),
    progress: Progress = None,
    options: FitOptions,
) -> Fit:
    """Fits a model's parameters to recordings, by simulation error.

    Parameters
    ----------
    model : Model or path
        The model with the start values.

    Returns
    -------
    Fit
        The fitted model, its parameters with intervals, and errors.

    Raises
    ------
    GroundError
        When a file cannot be read, a parameter does not exist, or there is nothing to fit to.

    Warns
    -----
    GroundWarning
        When the fit has not converged, or the commands depend on the motion.

    Examples
    --------
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
    seen = measured(recordings, given, options, work)
    given = voltage.at_recorded(given, seen.recordings)
    held = held_out(holdout, given, options, work, seen)
    if options.free is window_error.NOMINAL:  # the default; the same names given are what a user wants
        options = replace(options, free=identifiability.with_mass(options.free, seen.data))
    known = priors.known(given.core, options.prior)
    free = [*options.free, *(name for name in known if name not in options.free)]
    options = replace(options, free=free)
    seen, start, kept, unknown = _prepared(seen, given, options, known)
    held = _recut(held, given, options, windows.length(seen.data)) if held.data else held
    fitter = options.fitter(seen.data, known, kept=kept)
    with work.stage(FITTING, 1 + len(fitter.parts)):
        found = fitter.fit(start, options.free, work=work)
    estimates = WindowEstimates.of(found.result)
    for name, p in estimates.parameters.items():
        p = replace(p, start=given.core.value(name))
        if name in unknown:
            p = replace(p, identified=False, ci95=(0.0, np.inf), deviation=np.inf)
        estimates.parameters[name] = p
    from ground.fitting import closed_loop

    if not _corrections(seen, given):  # which may look like a closed loop
        for name in closed_loop.closed(seen.runs, seen.data, found.model):
            warn(CLOSED % name)
    if not found.result.converged:
        warn("the fit has not converged after %d iterations" % found.result.iterations)
    runs: List[RunFit] = []
    if len(seen.data) > 1:
        with work.stage(ALONE, len(seen.data)):
            runs = [_alone(fitter, found, i, options, known) for i in work.each(range(len(seen.data)))]
    before = np.inf  # a start that is far off may have no finite motion
    with contextlib.suppress(GroundError):
        before = windows.error(seen.data, given.core)
    errors = Errors(
        before,
        float(found.error.sum()),
        float(found.heldout.sum()) if found.others else None,
        Change(*(windows.error(held.data, m) for m in (given.core, found.model))) if held.data else None,
    )
    models: Dict[str, ModelsAt] = {"given": horizon.same(given.core), "fitted": horizon.same(found.model)}
    if not held.data:
        models["fitted"] = functools.partial(fitter.models_at, found)
    tested, seconds = held.data or seen.data, horizon.horizon(seen.data, start)
    prediction = horizon.prediction_error(tested, seconds, models, found.model)
    from ground.analysis.predicted_band import FitWithout

    parts = [
        FitWithout(without.model, seen.data[part :: fitter.most_parts])
        for part, without in (found.others.items() if len(seen.data) > 1 else ())
    ]
    parts += [FitWithout(shifted) for shifted in found.result.shifted]
    result = _result(given, seen, options.starts, found, estimates, errors, prediction, runs, known)
    return replace(result, parts=parts)


def _prepared(
    seen: Measured, given: Model, options: FitOptions, known: priors.Known
) -> Tuple[Measured, _core.Model, List[str], List[str]]:
    """The recordings in windows that suit their craft, the model to start from, its parameters that keep
    their start, and those that are not identifiable. A start that is far off has a wrong time scale: windows
    are cut again by the fitted model until their length stays."""
    free = [name for name in options.free if name in identifiability.KEPT and name not in known]

    def fit(runs: Sequence[_core.RunData], start: _core.Model, kept: Sequence[str]) -> WindowEstimates:
        more = {"kept": list(kept), "most": window_error.MAX_WINDOWS, "starts": 1}
        return WindowEstimates.of(options.fitter(runs, known, **more).whole(start, options.free))

    model = given.core
    lengths: List[float] = []
    longest = 0.5 * min(float(np.ptp(run.times)) for run in seen.data)
    while True:
        cut = _recut(seen, given, options, min(time_scales.usual_window(model), longest))
        if windows.length(cut.data) in lengths:
            break
        lengths.append(windows.length(cut.data))
        found, kept, unknown = identifiability.kept(cut.data, given.core, free, fit)
        moved = fit(cut.data, given.core, []) if kept else found
        if kept and _worse(cut.data, found.model, moved.model):
            found, kept, unknown = moved, [], []
        model = found.model
    if time_scales.usual_window(model) > longest:
        cut = seen  # too short for this craft: as given
    same = windows.length(cut.data) == windows.length(seen.data)
    return cut, given.core if same else model, kept, unknown


def _worse(runs: Sequence[_core.RunData], kept: _core.Model, moved: _core.Model) -> bool:
    """Whether starts that are kept are contradicted: predicted poses are off by more than the mocap's noise
    explains."""
    models = {"kept": horizon.same(kept), "moved": horizon.same(moved)}
    found = horizon.prediction_error(runs, horizon.horizon(runs, moved), models, moved)
    pairs = [] if found is None else zip(*map(astuple, (*found.errors.values(), found.mocap)))
    return any(a**2 - b**2 > noise**2 for a, b, noise in pairs)


def _recut(seen: Measured, given: Model, options: FitOptions, seconds: float) -> Measured:
    """Recordings in windows of some seconds, if the user has not chosen their length."""
    part = replace(options, window=options.window or seconds)
    return replace(seen, data=[part.of(run, given) for run in seen.runs])


def _alone(
    fitter: WindowFitter, found: WindowFit, index: int, options: FitOptions, known: priors.Known
) -> RunFit:
    """A run by itself, and held out."""
    run, level = fitter.runs[index], LEVEL / len(fitter.runs)
    free = identifiability.without_mass(options.free, [run])
    known = {name: prior for name, prior in known.items() if name in free}
    alone = WindowEstimates.of(replace(options, starts=1).fitter([run], known).whole(found.model, free))
    own = [i for i, window in enumerate(fitter.windows) if window.run == index]
    others = WindowEstimates.of(found.others[fitter.part_of[own[0]]])
    sizes = [fitter.windows[i].last - fitter.windows[i].first + 1 for i in own]
    return RunFit(
        run.name,
        {name: alone.model.value(name) for name in options.free},
        {name: p.ci95 for name, p in alone.parameters.items()},
        windows.error([run], alone.model),
        float(np.average(found.by_window[own], weights=sizes)),
        disagreements(alone, others, level),
    )


def disagreements(fitted: WindowEstimates, others: WindowEstimates, level: float) -> List[str]:
    """Parameters whose estimates from one run and from the others differ, where any does with a probability
    of `level` although all are the same: by Student's t with the fewer degrees of freedom of both."""
    freedom = min(fitted.freedom, others.freedom)
    pairs = [(p, others.parameters[name]) for name, p in fitted.parameters.items()]
    return [
        a.name
        for a, b in pairs
        if a.identified and b.identified
        for off in [(a.value - b.value) / np.hypot(a.deviation, b.deviation)]
        if len(others.parameters) * student_outside(off, freedom) < level
    ]


def _result(
    given: Model,
    seen: Measured,
    starts: int,
    found: WindowFit,
    estimates: WindowEstimates,
    errors: Errors,
    prediction: Optional[PredictionError],
    runs: List[RunFit],
    known: priors.Known,
) -> Fit:
    from ground.analysis import comparison
    from ground.checks import quality

    result, core, parameters = found.result, estimates.model, estimates.parameters
    return Fit(
        model=fitted_model(core, seen.recordings, *_by_kind(errors), parameters),
        parameters=parameters,
        error=errors,
        prediction=prediction,
        thesis_objective=ThesisObjective(
            comparison.thesis_objective(seen.data, given.core),
            comparison.thesis_objective(seen.data, core),
        ),
        objective=result.objective,
        starts={"tried": starts, "at_best": result.starts_at_best},
        condition=result.condition,
        weak=identifiability.weak_directions(estimates),
        converged=result.converged,
        runs=runs,
        same_inputs=quality.same_inputs(seen.runs),
        remarks=[
            *identifiability.of_payloads(seen.data, list(parameters)),
            *identifiability.sentences(estimates),
            *priors.sentences(known, parameters),
        ],
        correlations=estimates.correlation,
        freedom=estimates.freedom,
        given=given,
        data=seen.data,
        corrections=_corrections(seen, given),
    )


def _corrections(seen: Measured, given: Model) -> List[str]:
    """What corrects recordings that a fit would be wrong with."""
    wrong = [one for one in seen.findings if one.misread]
    if "heading_offset" not in given.effects:
        wrong += [one for one in seen.findings if one.kind == "offset"]
    slow = any(NOT_SECONDS in text for run in seen.recordings for text in run.warnings)
    return list(dict.fromkeys([one.remedy for one in wrong] + ["unit: ms under time"] * slow))


def _by_kind(errors: Errors) -> Tuple[Dict[str, float], Dict[str, float]]:
    """Errors before and after by kind of runs, as model files keep them."""
    before, after = {"fit": errors.before}, {"fit": errors.after}
    if errors.heldout is not None:
        before["heldout"], after["heldout"] = errors.before, errors.heldout
    if errors.holdout:
        before["holdout"], after["holdout"] = errors.holdout.before, errors.holdout.after
    return before, after


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of identify fit."""
    from ground.data import bag_arguments

    bag_arguments.configure_fit(parser, "model, with the start values", "FITTED.yaml", FitOptions)
    command_line.add_mat(parser)


def run(arguments: argparse.Namespace) -> Dict[str, object]:
    """Runs identify fit; returns what --json prints."""
    from ground.data import bag_arguments

    command_line.check_mat(arguments)
    return bag_arguments.run_fit(arguments, fit, FitOptions)
