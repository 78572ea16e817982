"""A model and its variants on the same runs: fits, and errors on held-out data."""

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Dict, Iterable, List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import candidates
from ground.annotations import Array, Document, Random
from ground.errors import GroundError
from ground.progress import Work
from ground.recordings import repair, windows

if TYPE_CHECKING:
    from ground.analysis.likelihood import Fit as LikelihoodFit
    from ground.analysis.likelihood import Likelihood

PARTS = 4  # parts of a single run, held out one after the other
FOLDS = 8  # largest number of folds of several runs; it bounds the refits
MAX_WINDOWS = 160  # four minutes, far more than it takes to distinguish the effects that matter
# Lengths of the windows that models are fitted to [s]. Longer windows contain more information, but
# disturbances add up along them.
LENGTHS = (windows.WINDOW, windows.WINDOW / 3)
MAX_ERROR_RATIO = 0.99  # largest ratio of held-out errors for which another length is taken
NOMINAL = ("I_z", "X_u", "Y_v", "N_r", "k")  # the parameters of the nominal model that are fitted


@dataclass
class Fit:
    """A model fitted to all windows of a study."""

    model: _core.Model
    parameters: Dict[
        str, Document
    ]  # by name: value, unit, ci95, deviation, identified, at_bound
    error: Array  # (3,) mean |e|/s of u, v, r over the windows fitted to
    heldout: Array  # (3,) the same over all windows, each by a fit to the other parts
    by_window: Array  # (windows,) sum of the held-out errors of u, v, r in each window
    by_part: Dict[int, _core.Model]  # the model refitted without each part


class Study:
    """Runs (_core.RunData), their windows, and the folds that are held out together.

    Folds are runs (with more than FOLDS runs, every FOLDS-th one together), or quarters of a
    single run; `part_of` may be set to other ones. Of long runs about `most` windows are used,
    spread evenly, so that the work does not grow with them. Raises GroundError when runs are too short.
    """

    def __init__(
        self, runs: Sequence[_core.RunData], threads: int = 0, most: float = MAX_WINDOWS
    ) -> None:
        self.runs = runs
        # Threads of fits from scratch, 0 for all cores; with one thread results are reproducible.
        self.threads = threads
        every = windows.cut(runs)
        self.windows = windows.spread(every, most)
        self.available = len(every)  # number of windows before thinning
        self.width = 0.0  # width of refits' robust loss [standard deviations]; 0: each fit estimates it
        self.length = windows.WINDOW  # length of the windows that are fitted to [s]
        if len(runs) > 1:
            self.part_of = np.array([w.run % FOLDS for w in self.windows])
        else:
            count = min(PARTS, len(self.windows))
            if count < 2:
                raise GroundError(
                    "%s: too short to hold a part of it out; at least two windows of %.1f s are needed"
                    % (runs[0].name, windows.WINDOW)
                )
            edges = np.arange(count + 1) * len(self.windows) // count
            self.part_of = np.repeat(np.arange(count), np.diff(edges))

    def fit(
        self,
        model: _core.Model,
        free: Sequence[str],
        also: Sequence[_core.Model] = (),
        work: Optional[Work] = None,
    ) -> Fit:
        """Fits the free parameters, and again without each fold in turn.

        The fit starts from the model's values and from those of the models in `also`, and keeps the
        best: parameters fitted without an effect may be far from the right ones with it. It chooses
        the length of windows whose fits have the least held-out error; `refit` uses the same length
        and outliers. work: told of each of len(LENGTHS) + 1 parts.
        """
        told = work or Work()
        starts = [s for given in (model,) + tuple(also) for s in candidates.turned(given, free)]
        near = self._best(starts, free, threads=self.threads)["model"]
        told.step()
        best: Optional[Tuple[Fit, float, float]] = None
        for length in sorted(LENGTHS, key=lambda length: length != self.length):
            self.length, self.width = length, 0.0
            result = self._fit(self.windows, near, free, near=True, threads=self.threads)
            self.width = result["width"] if np.isfinite(result["width"]) else 0.0
            found = self._judged(result, free, self.threads)
            if best is None or found.heldout.sum() < MAX_ERROR_RATIO * best[0].heldout.sum():
                best = found, self.length, self.width
            told.step()
        assert best is not None
        fit, self.length, self.width = best
        return fit

    def _best(
        self, starts: Iterable[_core.Model], free: Sequence[str], **options: Any
    ) -> Document:
        """The best fit from any start; GroundError when none can be simulated."""
        found, failure = [], GroundError("there is no model to start from")
        for start in starts:
            try:
                found.append(self._fit(self.windows, start, free, **options))
            except GroundError as error:
                failure = error
        if not found:
            raise failure
        return min(found, key=lambda result: float(result["objective"]))

    def refit(self, starts: Sequence[_core.Model], free: Sequence[str]) -> Fit:
        """Fits from models near the best, in one thread; no other start is tried."""
        return self._judged(
            self._best(starts, free, near=True, threads=1, width=self.width), free, 1
        )

    def _judged(self, result: Document, free: Sequence[str], threads: int) -> Fit:
        fitted = result["model"]
        heldout = np.zeros((len(self.windows), 3))
        initial = iter(result["initial"])
        states = [list(itertools.islice(initial, len(self._pieces(w)))) for w in self.windows]
        by_part: Dict[int, _core.Model] = {}
        for part in np.unique(self.part_of).tolist():
            inside = self.part_of == part
            rest = np.flatnonzero(~inside)
            by_part[part] = self._fit(
                [self.windows[i] for i in rest],
                fitted,
                free,
                near=True,
                threads=threads,
                width=self.width,
                initial=[state for i in rest for state in states[i]],
            )["model"]
            tested = [self.windows[i] for i in np.flatnonzero(inside)]
            heldout[inside] = window_errors(self.runs, tested, by_part[part])
        samples = [w.last - w.first + 1 for w in self.windows]
        return Fit(
            fitted,
            {p["name"]: p for p in result["parameters"]},
            channel_errors(self.runs, self.windows, fitted),
            np.average(heldout, axis=0, weights=samples),
            heldout.sum(axis=1),
            by_part,
        )

    def _pieces(self, window: _core.Window) -> List[_core.Window]:
        """The shorter windows that a window is cut into for a fit."""
        return windows.cut_again(self.runs, window, self.length)

    def _fit(
        self,
        chosen: Sequence[_core.Window],
        model: _core.Model,
        free: Sequence[str],
        **options: Any,
    ) -> Document:
        pieces = [piece for w in chosen for piece in self._pieces(w)]
        try:
            return windows.problem(self.runs, pieces).fit(model, free, **options)
        except (ValueError, RuntimeError) as error:
            raise GroundError(str(error))


def free_parameters(model: _core.Model) -> List[str]:
    """The five nominal parameters and all those of a model's effects."""
    return list(NOMINAL) + [
        p["name"] for p in model.parameters() if p["name"].split(".")[0] in model.effects
    ]


def channel_errors(
    runs: Sequence[_core.RunData],
    chosen: Sequence[_core.Window],
    model: _core.Model,
    truth: Optional[Sequence[_core.RunData]] = None,
) -> Array:
    """Mean |e|/s of u, v, r (3,) over windows; s is each run's, or that of the runs in `truth`.

    Their sum is the error that reports give. Raises GroundError when the model cannot be simulated.
    """
    samples = [w.last - w.first + 1 for w in chosen]
    return np.asarray(
        np.average(window_errors(runs, chosen, model, truth), axis=0, weights=samples)
    )


def window_errors(
    runs: Sequence[_core.RunData],
    chosen: Sequence[_core.Window],
    model: _core.Model,
    truth: Optional[Sequence[_core.RunData]] = None,
) -> Array:
    """Mean |e|/s of u, v, r in each window, (windows, 3)."""
    problem = windows.problem(runs, chosen)
    scale = windows.problem(truth, chosen) if truth else problem
    try:
        simulated = problem.simulate(model)["nu"]
    except RuntimeError as error:
        raise GroundError(str(error))
    errors = []
    for window, nu in zip(chosen, simulated):
        measured = np.asarray(runs[window.run].nu)[window.first : window.last + 1]
        errors.append((np.abs(nu - measured) / scale.sigma(window.run)).mean(axis=0))
    return np.array(errors)


def calibrated_errors(
    runs: Sequence[_core.RunData],
    chosen: Sequence[_core.Window],
    likelihood: "Likelihood",
    fit: "LikelihoodFit",
) -> Array:
    """window_errors of a Fit, as in use: differences between runs (wrench and thrust) are estimated
    from a run's poses before each window. likelihood: a Likelihood of the runs."""
    if not likelihood.varying:
        return window_errors(runs, chosen, fit.model)
    errors, known = np.empty((len(chosen), 3)), {}
    for i, window in enumerate(chosen):
        if window.run not in known:
            known[window.run] = likelihood.constants(fit, window.run)
        times, constants = known[window.run]
        last = np.searchsorted(times, runs[window.run].times[window.first], side="right") - 1
        model = trimmed(fit.model, constants[max(0, last)])
        errors[i] = window_errors(runs, [window], model)[0]
    return errors


def trimmed(model: _core.Model, constant: Array) -> _core.Model:
    """A model with a constant wrench X, Y [N], N [N m] and a relative change of thrust, (4,)."""
    changed = model.copy()
    changed.set_value("k", (1 + constant[3]) * model.value("k"))
    wrench = (("body_force_bias", "x0"), ("body_force_bias", "y0"), ("yaw_bias", "n0"))
    for (effect, parameter), value in zip(wrench, constant):
        if effect not in changed.effects:
            changed = candidates.of_library(effect).neutral(changed)
        name = "%s.%s" % (effect, parameter)
        changed.set_value(name, changed.value(name) + value)
    return changed


def noise_floor(runs: Sequence[_core.RunData], model: _core.Model, seed: int = 1) -> Array:
    """Mean |e|/s of u, v, r (3,) that pose noise alone would leave if the model were true.

    The model is simulated along each stretch without a gap. Its poses get the measured noise and are
    smoothed as the recording was; s is that of the recording.
    """
    random = np.random.default_rng(seed)
    artificial = [recorded(run, model, random) for run in runs]
    return channel_errors(artificial, windows.cut(runs), model, truth=runs)


def recorded(
    run: _core.RunData,
    model: _core.Model,
    random: Random,
    wrench: Optional[Array] = None,
    thrust: float = 0.0,
    room: Optional[Array] = None,
) -> _core.RunData:
    """The recording that a run would give if the model were true: _core.RunData. wrench: (n, 3), an
    added wrench, held from sample to sample [N], [N m], body; thrust: its relative change; room:
    (n, 2), an added force along the axes of the room, held as well [N]."""
    times, eta, nu = np.array(run.times), np.array(run.eta), np.array(run.nu)
    inputs, noise = np.array(run.inputs), np.array(run.noise)
    wrench = np.zeros_like(eta) if wrench is None else wrench
    room = np.zeros((len(times), 2)) if room is None else room
    if thrust:
        model = model.copy()
        model.set_value("k", (1 + thrust) * model.value("k"))
    poses = np.empty_like(eta)
    breaks = np.flatnonzero(np.diff(times) > repair.MAX_GAP) + 1
    for stretch in np.split(np.arange(len(times)), breaks):
        start = stretch[0]
        try:
            found = _core.simulate(
                model,
                inputs,
                times[stretch],
                eta[start],
                nu[start],
                run.drives,
                wrench[stretch],
                room[stretch],
            )
        except RuntimeError:
            raise GroundError("the model's motion along %s is not finite" % run.name)
        poses[stretch] = found["eta"] + noise * random.normal(size=(len(stretch), 3))
    smoothed = repair.smooth(times, poses, (noise[0], noise[2]))
    return _core.RunData(
        run.name, times, smoothed["eta"], smoothed["nu"], inputs, poses, noise, run.drives
    )
