"""Likelihood of recorded poses under a model with a random disturbance: the basis of all tests of
effects.

The disturbance is part of the model (_core.GreyBox): an Ornstein-Uhlenbeck and a white wrench in
the body frame, an Ornstein-Uhlenbeck force along the axes of the room, wrench and thrust that
differ from run to run, white noise of the poses.
Parameters and levels are fitted together.
"""

from dataclasses import dataclass, fields
from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple, TypeVar

import numpy as np

from ground import _core
from ground.analysis import windows
from ground.analysis.thinning import thinned
from ground.effect_library.parameters import FittedParameter, ParameterInfo, described
from ground.support.annotations import Array
from ground.support.errors import core_errors

_T = TypeVar("_T")

CAP = 25.0  # squared Mahalanobis distance above which a pose counts as noisier
LEAST_GAIN = 0.01  # of the log-posterior, below which a fit ends
COARSE = 0.2  # the same of a fit from which others start, or of one of many that are compared
ABSENT = 1e-3  # share of a usual level that has no effect


@dataclass(frozen=True)
class RunDifference:
    """A wrench on a channel, or the thrust, that may differ from run to run."""

    parameter: str
    unit: str
    level: str  # name of its level in DisturbanceLevels
    time: str  # name of the correlation time of the random wrench on the same channel, or ""


KINDS = (
    RunDifference("surge force", "N", "trim_X", "time_X"),
    RunDifference("side force", "N", "trim_Y", "time_Y"),
    RunDifference("yaw moment", "N m", "trim_N", "time_N"),
    RunDifference("thrust", "-", "thrust", ""),
)


@dataclass(frozen=True, eq=False)
class LikelihoodFit:
    """The likeliest parameters and levels. Two are the same only if they are one object."""

    model: _core.Model
    levels: Dict[str, float]  # the disturbance's and the noise's, by name (DisturbanceLevels)
    loudness: Tuple[float, ...]  # log of the factor by which each run's disturbance is stronger
    free: Tuple[str, ...]  # names of the free parameters
    log_posterior: float  # log-likelihood and the levels' prior
    by_run: Array  # (runs,) log-likelihood
    information: Array  # (free, free) Fisher information, of coordinates / scale
    scale: Array  # (free,) scale of the coordinates
    parameters: Sequence[FittedParameter]
    level_information: Array  # Fisher information of the levels' logs, then of each run's loudness
    trims: Array  # (runs, 4) what is constant in each run, in the order of KINDS
    trims_sigma: Array  # (runs, 4) their standard deviations
    converged: bool

    @property
    def point(self) -> _core.GreyBoxPoint:
        """Model, levels and loudness as the core takes them."""
        return _core.GreyBoxPoint(self.model, self.levels, list(self.loudness))

    def ratio_without(self, effect: str) -> float:
        """Log-likelihood ratio 2 (L1 - L0) to the model without an effect, by the information
        (Wald)."""
        known = {name: p for name, p in described(self.model).items() if not p.shape}
        at = [i for i, name in enumerate(self.free) if name.split(".")[0] == effect and name in known]
        own = [known[self.free[i]] for i in at]
        away = np.array([step(p, p.neutral, self.model.value(p.name)) for p in own])
        covariance = np.linalg.pinv(self.information, rcond=1e-10, hermitian=True)[np.ix_(at, at)]
        away = away / self.scale[at]
        return float(away @ np.linalg.lstsq(covariance, away, rcond=1e-10)[0])


def step(parameter: ParameterInfo, first: float, second: float) -> float:
    """The step of a parameter's coordinate from one value to another."""
    return float(1 / second - 1 / first if is_reciprocal(parameter) else second - first)


def is_reciprocal(parameter: ParameterInfo) -> bool:
    """Whether its coordinate is 1 / value: of the inertia, and of what is neutral at infinity."""
    return bool(np.isinf(parameter.neutral) or parameter.name == "I_z")


class Likelihood:
    """Runs (_core.RunData), thinned, under models with a disturbance. craft: _core.Model whose
    full thrust scales the priors of the levels; varying: levels of what may differ between runs (all of
    KINDS); threads: number of them in a fit."""

    def __init__(
        self,
        runs: Sequence[_core.RunData],
        craft: _core.Model,
        varying: Optional[Iterable[str]] = None,
        threads: int = 1,
    ) -> None:
        self.runs = [thinned(run) for run in runs]
        self.craft = craft
        levels = [kind.level for kind in KINDS]
        self.varying = frozenset(levels if varying is None else varying)
        self.threads = threads
        self.box = call(_core.GreyBox, self.runs, craft)
        usual = self.box.start(craft).levels
        self.absent = {level: ABSENT * usual[level] for level in levels if level not in self.varying}

    def fit(
        self,
        model: _core.Model,
        free: Sequence[str],
        near: Optional[LikelihoodFit] = None,
        levels: bool = True,
        held: Optional[Mapping[str, float]] = None,
        least_gain: float = LEAST_GAIN,
    ) -> LikelihoodFit:
        """The likeliest values of the free parameters; the search begins at the model's values.

        near: a LikelihoodFit whose levels are near the optimum; without it they start far away. levels:
        whether levels are fitted, too; held: values, by name, of levels that are fixed; least_gain: of
        the log-posterior, below which the search ends. Raises GroundError when the model cannot be
        simulated.
        """
        held = {**self.absent, **(held or {})}
        near_by = self.box.start(model) if near is None else near.point
        start = _core.GreyBoxPoint(model, {**near_by.levels, **held}, near_by.log_scales)
        found = call(
            self.box.fit,
            start,
            list(free),
            levels=levels,
            held=list(held),
            warm=near is not None,
            cap=CAP,
            threads=self.threads,
            least_gain=least_gain,
        )
        at = found["point"]
        own = {field.name: found[field.name] for field in fields(LikelihoodFit) if field.name in found}
        own.update({name: np.array(found[name]) for name in ("by_run", "scale")})
        for kind in ("", "_sigma"):
            rows = [(*trim["wrench" + kind], trim["thrust" + kind]) for trim in found["trims"]]
            own["trims" + kind] = np.array(rows)
        return LikelihoodFit(at.model, at.levels, tuple(at.log_scales), tuple(free), **own)

    def intervals(self, fit: LikelihoodFit) -> List[FittedParameter]:
        """The fitted parameters, with 95% intervals that include the uncertainty of the levels: a
        list of dictionaries as Fit has them."""
        return call(
            self.box.intervals,
            fit.point,
            fit.level_information,
            list(fit.free),
            held=list(self.absent),
            cap=CAP,
            threads=self.threads,
        )

    def blocks(self, fit: LikelihoodFit, loudness: Sequence[float] = ()) -> List[Array]:
        """Log-likelihood of blocks of time under another fit, one array per run. Raises GroundError
        when the motion is not finite."""
        point, block = (
            _core.GreyBoxPoint(fit.model, fit.levels, list(loudness)),
            windows.time_scale(self.runs),
        )
        return call(self.box.likelihood, point, cap=CAP, block=block, threads=self.threads)

    def constants(self, fit: LikelihoodFit, run: int) -> Tuple[Array, Array]:
        """Wrench X, Y [N], N [N m] and relative change of thrust that are constant in a run, as
        estimated from its poses up to each time under another fit: times [s], (times, 4)."""
        point = _core.GreyBoxPoint(fit.model, fit.levels, [])
        found = self.residuals(point, run)["constants"]
        return np.array(self.runs[run].times), np.array(found)

    def residuals(self, point: _core.GreyBoxPoint, run: int, **acting: Any) -> Dict[str, Array]:
        """GreyBox.residuals; GroundError when the motion is not finite."""
        return call(self.box.residuals, point, run, cap=CAP, **acting)

    def scores(self, fit: LikelihoodFit, model: _core.Model, names: Sequence[str]) -> Dict[str, Array]:
        """Derivatives of the log-likelihood at a fit with respect to parameters of an extended
        model, which are neutral: score (blocks, n), information (n, n), scale (n,), run
        (blocks,)."""
        point, block = (
            _core.GreyBoxPoint(model, fit.levels, list(fit.loudness)),
            windows.time_scale(self.runs),
        )
        found = call(self.box.scores, point, list(names), cap=CAP, block=block, threads=self.threads)
        return {key: np.array(value) for key, value in found.items()}


def call(function: Callable[..., _T], *arguments: Any, **options: Any) -> _T:
    """Calls the core; its exceptions become GroundErrors."""
    with core_errors():
        return function(*arguments, **options)
