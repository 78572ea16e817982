"""The error of models over windows: fits to it, errors on held-out data, and their noise floor."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import windows
from ground.effect_library import candidates
from ground.effect_library.parameters import FittedParameter, described
from ground.support.annotations import Array, Indices, Random
from ground.support.errors import Diverged, GroundError, core_errors, warn
from ground.support.progress import Work

if TYPE_CHECKING:
    from ground.analysis.likelihood import Likelihood, LikelihoodFit

PARTS = 4  # most parts of runs that are held out one after the other; quarters of a single run
MAX_WINDOWS = 160  # four minutes, far more than it takes to distinguish the effects that matter
FEW_WINDOWS = 40  # where a quarter of them is enough
NOMINAL = ("I_z", "X_u", "Y_v", "N_r", "k")  # the parameters of the nominal model that are fitted
WRENCH = ("body_force_bias.x0", "body_force_bias.y0", "yaw_bias.n0")  # parameters of a constant wrench


@dataclass(frozen=True)
class FitResult:
    """What the core's fit to windows returns."""

    model: _core.Model
    parameters: List[FittedParameter]
    correlation: Array
    condition: float  # of the scaled information matrix
    objective: float
    initial: List[Array]  # velocities in which each window begins
    shifted: List[_core.Model]
    width: float  # of the loss of outliers
    starts: int
    starts_at_best: int
    freedom: float  # degrees of freedom of Student's t
    iterations: int
    converged: bool


@dataclass(frozen=True)
class WindowFit:
    """A model fitted to windows."""

    result: FitResult
    error: Array  # (3,) mean |e|/s of u, v, r over the windows fitted to
    heldout: Array  # (3,) the same, each window by a fit to the other parts
    by_window: Array  # (windows,) sum of the held-out errors of u, v, r in each window
    others: Mapping[int, FitResult]  # results without each part

    @property
    def model(self) -> _core.Model:
        """The fitted model."""
        return self.result.model

    @property
    def parameters(self) -> List[FittedParameter]:
        """The fitted parameters."""
        return self.result.parameters


class WindowFitter:
    """Fits models to windows of runs (_core.RunData), and again without each part of them.

    Of long runs about `most` windows are used, spread evenly, so that the work does not grow with them.
    threads: 0 for all cores; with one thread results are reproducible; most_parts: parts that several runs
    are held out in; length: of the windows fitted to [s] (default: as for the error); target, options: what
    is simulated, and of the core's fit. Raises GroundError when runs are too short.
    """

    def __init__(
        self,
        runs: Sequence[_core.RunData],
        threads: int = 0,
        most: float = MAX_WINDOWS,
        most_parts: int = PARTS,
        length: Optional[float] = None,
        target: _core.Target = _core.Target.velocities,
        **options: Any,
    ) -> None:
        self.runs, self.target, self.options = runs, target, {"threads": threads, **options}
        self.most_parts = most_parts
        every = windows.cut(runs)
        self.windows = windows.spread(every, most)  # whose errors are taken
        self.available = len(every)  # number of windows before thinning
        usual = windows.length(runs)
        length = length or usual
        # the same total length of data
        self.fitted = windows.spread(windows.cut(runs, length), most * usual / length)
        self.part_of = parts_of(runs, self.windows, most_parts)
        self.part_of_fitted = parts_of(runs, self.fitted, most_parts)

    def fit(
        self,
        model: _core.Model,
        free: Sequence[str],
        also: Sequence[_core.Model] = (),
        work: Optional[Work] = None,
    ) -> WindowFit:
        """Fits the free parameters, and again without each part in turn.

        The fit starts from the model's values and from the values of the models in `also`, and keeps the
        best: parameters fitted without an effect may be far from the right ones with it. Held-out errors
        are not a number where there is a single part. work: told of each fit.
        """
        told, parts = work or Work(), self.parts
        result = self.whole(model, free, also)
        told.step()
        heldout, others = np.full((len(self.windows), 3), np.nan), {}
        for part in told.each(parts if len(parts) > 1 else []):
            rest = np.flatnonzero(self.part_of_fitted != part).tolist()
            others[part] = self._again(result, free, rest)
            inside = np.flatnonzero(self.part_of == part)
            tested = [self.windows[i] for i in inside]
            heldout[inside] = window_errors(self.runs, tested, others[part].model)
        error = channel_errors(self.runs, self.windows, result.model)
        return WindowFit(result, error, mean(self.windows, heldout), heldout.sum(axis=1), others)

    def models_at(self, found: WindowFit, chosen: Sequence[_core.Window]) -> List[_core.Model]:
        """The model for each of some windows that was not fitted to it; the model fitted to all where no
        part can be held out."""
        parts = parts_of(self.runs, chosen, self.most_parts)
        return [found.others[p].model if p in found.others else found.model for p in parts]

    @property
    def parts(self) -> List[int]:
        """Parts that can be held out, if there are two or more."""
        return sorted(set(self.part_of.tolist()))

    def check(self) -> None:
        """GroundError when runs are too short to hold a part of them out."""
        if len(self.parts) < 2:
            raise GroundError(
                "%s: too short for cross-validation, which needs at least two windows of %.1f s"
                % (self.runs[0].name, windows.length(self.runs))
            )

    def whole(self, model: _core.Model, free: Sequence[str], also: Sequence[_core.Model] = ()) -> FitResult:
        """The core's result of the best fit to all windows. See fit."""
        found, failure = [], Diverged("there is no model to start from")
        for start in [s for given in (model, *also) for s in candidates.turned(given, free)]:
            try:
                found.append(self._fit(self.fitted, start, free, **self.options))
            except Diverged as error:
                failure = error
        if not found:
            raise failure
        return min(found, key=lambda result: result.objective)

    def _again(self, result: FitResult, free: Sequence[str], rest: Sequence[int]) -> FitResult:
        """The fit to some of the windows, from a result and with its outliers and states, so that it takes a
        few steps only."""
        width = result.width if np.isfinite(result.width) else 0.0
        known = [result.initial[i] for i in rest]
        options = {**self.options, "starts": 1, "warm": True, "width": width, "initial": known}
        return self._fit([self.fitted[i] for i in rest], result.model, free, **options)

    def _fit(
        self, chosen: Sequence[_core.Window], model: _core.Model, free: Sequence[str], **options: Any
    ) -> FitResult:
        with core_errors():
            found = windows.problem(self.runs, chosen, self.target).fit(model, list(free), **options)
        return FitResult(**found)


def parts_of(runs: Sequence[_core.RunData], cut: Sequence[_core.Window], most: int = PARTS) -> Indices:
    """The part (windows,) that each window is in: its run, of more than `most` runs every `most`-th one
    together; or the quarter of a single run that its middle is in."""
    if len(runs) > 1:
        return np.array([w.run % most for w in cut])
    count = len(runs[0].times)
    return np.array([PARTS * ((w.first + w.last) // 2) // count for w in cut])


def free_parameters(model: _core.Model) -> List[str]:
    """The five nominal parameters and all parameters of a model's effects."""
    return list(NOMINAL) + [name for name in described(model) if name.split(".")[0] in model.effects]


def channel_errors(
    runs: Sequence[_core.RunData],
    chosen: Sequence[_core.Window],
    model: _core.Model,
    truth: Optional[Sequence[_core.RunData]] = None,
) -> Array:
    """Mean |e|/s of u, v, r (3,) over windows; s is each run's, or from the runs in `truth`.

    Their sum is the error that reports give. Raises GroundError when the model cannot be simulated.
    """
    return mean(chosen, window_errors(runs, chosen, model, truth))


def mean(cut: Sequence[_core.Window], errors: Array) -> Array:
    """Mean (3,) of the errors (windows, 3) of windows, each sample with the same weight."""
    return np.asarray(np.average(errors, axis=0, weights=[w.last - w.first + 1 for w in cut]))


def window_errors(
    runs: Sequence[_core.RunData],
    chosen: Sequence[_core.Window],
    model: _core.Model,
    truth: Optional[Sequence[_core.RunData]] = None,
) -> Array:
    """Mean |e|/s of u, v, r in each window, (windows, 3)."""
    problem = windows.problem(runs, chosen)
    scale = windows.problem(truth, chosen) if truth else problem
    with core_errors():
        simulated = problem.simulate(model)["nu"]
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
    """window_errors of a LikelihoodFit, as in use: see calibrated_models. Infinite where a motion is not
    finite."""
    try:
        if not likelihood.varying:
            return window_errors(runs, chosen, fit.model)
        models = calibrated_models(runs, chosen, likelihood, fit)
        return np.array([window_errors(runs, [window], m)[0] for window, m in zip(chosen, models)])
    except Diverged:
        return np.full((len(chosen), 3), np.inf)


def calibrated_models(
    runs: Sequence[_core.RunData],
    chosen: Sequence[_core.Window],
    likelihood: "Likelihood",
    fit: "LikelihoodFit",
) -> List[_core.Model]:
    """The model of a LikelihoodFit for each window, with the differences between runs (wrench and thrust)
    that are estimated from the run's poses before it. likelihood: a Likelihood of the runs."""
    if not likelihood.varying:
        return [fit.model] * len(chosen)
    models, known = [], {}
    for window in chosen:
        if window.run not in known:
            known[window.run] = likelihood.constants(fit, window.run)
        times, constants = known[window.run]
        last = np.searchsorted(times, runs[window.run].times[window.first], side="right") - 1
        models.append(trimmed(fit.model, constants[max(0, last)]))
    return models


def squared_errors(
    runs: Sequence[_core.RunData],
    cut: Sequence[_core.Window],
    model: _core.Model,
    known: Optional[Sequence[Array]] = None,
    scale: Optional[Sequence[_core.RunData]] = None,
) -> Array:
    """Mean squared error of u, v, r of each window, (windows,), over their standard deviations in the
    run and summed over the three. Each window is simulated from the initial velocity that suits best.
    known: a wrench (n, 3) for each run; scale: runs whose standard deviations count. Raises
    GroundError where the motion is not finite."""
    nothing: List[Optional[Array]] = [None] * len(runs)
    wrenches = known or nothing
    sigma = [np.array(run.nu).std(axis=0) for run in scale or runs]
    return np.array([_squared_error(runs[w.run], w, model, wrenches[w.run], sigma[w.run]) for w in cut])


def _squared_error(
    run: _core.RunData, window: _core.Window, model: _core.Model, known: Optional[Array], sigma: Array
) -> float:
    span = slice(window.first, window.last + 1)
    wrench = None if known is None else known[span]

    def off(nu: Array) -> Array:
        """Errors of a simulation from an initial velocity, over standard deviations."""
        with core_errors():
            found = _core.simulate(
                model, run.inputs, run.times[span], run.eta[window.first], nu, run.drives, wrench,
                payload=run.payload, battery=run.battery,
            )  # fmt: skip
        return np.asarray((found["nu"] - np.array(run.nu)[span]) / sigma).ravel()

    start, steps = run.nu[window.first], np.diag(0.02 * sigma)
    e = off(start)
    slopes = np.column_stack([off(start + step) - e for step in steps])
    moved = off(start + np.linalg.lstsq(slopes, -e, rcond=None)[0] @ steps)
    return float(3 * min((e**2).mean(), (moved**2).mean()))


def trimmed(model: _core.Model, constant: Array) -> _core.Model:
    """A model with a constant wrench X, Y [N], N [N m] and a relative change of thrust, (4,)."""
    changed = with_wrench(_with_thrust(model, float(constant[3])))
    for name, value in zip(WRENCH, constant):
        changed.set_value(name, changed.value(name) + value)
    return changed


def with_wrench(model: _core.Model) -> _core.Model:
    """A model with the effects of a constant wrench, of zero where it had none."""
    for effect in dict.fromkeys(name.split(".")[0] for name in WRENCH):
        model = model if effect in model.effects else candidates.of_library(effect).neutral(model)
    return model


def _with_thrust(model: _core.Model, change: float) -> _core.Model:
    """A model with a relative change of thrust. It hardly pushes (by a thousandth) where the change, which a
    likelihood takes for normally distributed, would turn it round."""
    changed = model.copy()
    changed.set_value("k", max(1 + change, 1e-3) * model.value("k"))
    return changed


def noise_floor(runs: Sequence[_core.RunData], model: _core.Model, seed: int = 1) -> Array:
    """Mean |e|/s of u, v, r (3,) that pose noise would leave if the model were true.

    The model is simulated along each stretch without a gap. Its poses get the measured noise and are
    smoothed as the recording was; s is the recording's. NaN, with a warning, where the motion is
    not finite.
    """
    random = np.random.default_rng(seed)
    try:
        artificial = [recorded(run, model, random) for run in runs]
        return channel_errors(artificial, windows.cut(runs), model, truth=runs)
    except Diverged as error:
        warn("the noise floor is not known: %s" % error)
        return np.full(3, np.nan)


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
    wrench = np.zeros_like(eta) if wrench is None else wrench
    room = np.zeros((len(times), 2)) if room is None else room
    model = _with_thrust(model, thrust) if thrust else model
    poses = np.empty_like(eta)
    breaks = np.flatnonzero(np.diff(times) > run.scales.max_gap) + 1
    for at in np.split(np.arange(len(times)), breaks):
        start = (eta[at[0]], nu[at[0]])
        try:
            found = _core.simulate(
                model, run.inputs, times[at], *start, run.drives, wrench[at], room[at], run.payload,
                run.battery,
            )  # fmt: skip
        except RuntimeError:
            raise Diverged("the model's motion along %s is not finite" % run.name)
        poses[at] = found["eta"] + np.array(run.noise) * random.normal(size=(len(at), 3))
    from ground.poses import repair  # few fits draw poses

    smoothed = repair.again(run, poses)
    alone = run.replaced(wrench=np.empty((0, 3)), inertial=_core.InertialData())
    return alone.replaced(eta=smoothed["eta"], nu=smoothed["nu"], poses=poses)


def pushes(run: _core.RunData, levels: Mapping[str, float], random: Random) -> Tuple[Array, Array]:
    """Random pushes of some levels of the likelihood, Ornstein-Uhlenbeck and white noise, at a run's samples,
    each until the next: a wrench (n, 3) X, Y [N], N [N m] in the body frame, and a force (n, 2) [N] along
    the axes x, y of the room."""
    steps = np.maximum(np.diff(np.array(run.times), append=run.times[-1] + 1e-3), 1e-4)
    wrench = np.empty((len(steps), 3))
    for i, channel in enumerate("XYN"):
        slow = _slow(steps, levels["sigma_" + channel], levels["time_" + channel], random)
        white = levels["white_" + channel] / np.sqrt(steps) * random.normal(size=len(steps))
        wrench[:, i] = slow + white
    room = [_slow(steps, levels["sigma_room"], levels["time_room"], random) for _ in "xy"]
    return wrench, np.column_stack(room)


def levels_of(disturbance: _core.Disturbance) -> Optional[Dict[str, float]]:
    """Levels for pushes of a model's own disturbance, without its trim; None where it has none."""
    sigma, time, white = (np.array(getattr(disturbance, name)) for name in ("sigma", "time", "white"))
    if not (sigma.any() or white.any()):
        return None
    levels = {"sigma_room": 0.0, "time_room": 1.0}
    for channel, s, t, w in zip("XYN", sigma, np.where(sigma > 0, time, 1.0), white):
        levels.update({"sigma_" + channel: s, "time_" + channel: t, "white_" + channel: w})
    return levels


def disturbance_of(levels: Dict[str, float], varies: bool) -> _core.Disturbance:
    """A model's own disturbance of the levels of the likelihood. A force along the axes of the room, which a
    model file does not know, is one in the body frame here. varies: whether the trims are more than their
    prior."""
    found, room = _core.Disturbance(), np.array([1.0, 1.0, 0.0]) * levels["sigma_room"] ** 2
    body = np.array([levels["sigma_" + channel] for channel in "XYN"]) ** 2
    times = np.array([levels["time_" + channel] for channel in "XYN"])
    found.sigma = _rounded(np.sqrt(body + room))
    found.time = _rounded((body * times + room * levels["time_room"]) / np.maximum(body + room, 1e-300))
    found.white = _rounded(np.array([levels["white_" + channel] for channel in "XYN"]))
    if varies:
        found.trim = _rounded(np.array([levels["trim_" + channel] for channel in "XYN"]))
        found.trim_thrust = float("%.3g" % levels["thrust"])
    return found


def _rounded(values: Array) -> Array:
    """The values with three digits."""
    return np.array([float("%.3g" % value) for value in values])


def _slow(steps: Array, sigma: float, time: float, random: Random) -> Array:
    """An Ornstein-Uhlenbeck process of a deviation and correlation time [s] before each step [s]."""
    left = np.exp(-steps / time)
    fresh = sigma * np.sqrt(1 - left**2) * random.normal(size=len(steps))
    value, values = float(sigma * random.normal()), np.empty(len(steps))
    for i, (share, push) in enumerate(zip(left.tolist(), fresh.tolist())):
        values[i] = value
        value = share * value + push
    return values
