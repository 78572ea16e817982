"""How likely recorded poses are under a model with a random disturbance: what effects are tested
by.

The disturbance is part of the model (_core.GreyBox): an Ornstein-Uhlenbeck and a white wrench in
the body's frame, wrench and thrust that differ from run to run, white noise of the poses.
Parameters and levels are fitted together.
"""

from dataclasses import dataclass
from typing import Any, Dict, Tuple

import numpy as np

from ground import _core
from ground.analysis.thinning import thinned
from ground.analysis.unfinished import can_be_kept
from ground.errors import GroundError

CAP = 25.0  # squared Mahalanobis distance from which on a pose counts as noisier
BLOCK = 1.0  # of time, for standard errors [s]
ABSENT = 1e-3  # of a usual level: does nothing
VARYING = frozenset(["trim_X", "trim_Y", "trim_N", "thrust"])  # levels of what differs between runs


@can_be_kept
@dataclass(frozen=True)
class Fit:
    """The likeliest parameters and levels."""

    model: Any  # _core.Model
    levels: Dict[str, float]  # of all that is random (DisturbanceLevels)
    loudness: Tuple[float, ...]  # logarithm of the factor of the disturbance of each run
    free: Tuple[str, ...]  # names of the free parameters
    log_posterior: float  # log-likelihood and the levels' prior
    by_run: np.ndarray  # (runs,) log-likelihood
    information: np.ndarray  # (free, free) by coordinate / scale
    scale: np.ndarray  # (free,) of the coordinates
    parameters: Tuple[dict, ...]  # name, unit, value, ci95, deviation, at_bound, identified
    level_information: np.ndarray  # of the logarithms of levels, then of the runs' loudness
    trims: Tuple[dict, ...]  # of each run: wrench (3,), wrench_sigma, thrust, thrust_sigma
    converged: bool

    @property
    def point(self):
        """The same for the core: _core.GreyBoxPoint."""
        return _core.GreyBoxPoint(self.model, self.levels, list(self.loudness))

    def ratio_without(self, effect):
        """Log-likelihood ratio 2 (L1 - L0) to the model without an effect, by the information
        (Wald)."""
        at = [i for i, name in enumerate(self.free) if name.split(".")[0] == effect]
        described = {p["name"]: p for p in self.model.parameters()}
        away = np.array([_from_neutral(described[self.free[i]], self.model) for i in at])
        covariance = np.linalg.pinv(self.information, rcond=1e-10, hermitian=True)[np.ix_(at, at)]
        away = away / self.scale[at]
        return float(away @ np.linalg.lstsq(covariance, away, rcond=1e-10)[0])


def _from_neutral(parameter, model):
    """Distance of a parameter's coordinate from where it does nothing."""
    value, neutral = model.value(parameter["name"]), parameter["neutral"]
    # the coordinate of what is neutral at infinity is its reciprocal
    return 1 / value if np.isinf(neutral) else value - neutral


class Likelihood:
    """Runs (_core.RunData), thinned, under models with a disturbance. craft: _core.Model whose
    full thrust the priors of the levels are in parts of; varying: levels of what may differ
    between runs; threads: of one fit."""

    def __init__(self, runs, craft, varying=VARYING, threads=1):
        self.runs = [thinned(run) for run in runs]
        self.varying = frozenset(varying)
        self.threads = threads
        self.box = call(_core.GreyBox, self.runs, craft)
        usual = self.box.start(craft).levels
        self.absent = {level: ABSENT * usual[level] for level in VARYING - self.varying}

    def fit(self, model, free, near=None, levels=True, held=None):
        """The likeliest values of the free parameters, sought from the model's own.

        near: a Fit whose levels are near; without it the search begins far away. levels: whether
        they are fitted, too; held: values by name of those that are not. Raises GroundError when
        the model cannot be simulated.
        """
        held = {**self.absent, **(held or {})}
        start = self.box.start(model) if near is None else near
        start = _core.GreyBoxPoint(model, {**start.levels, **held}, list(start.loudness))
        found = call(
            self.box.fit,
            start,
            list(free),
            levels=levels,
            held=list(held),
            far=near is None,
            cap=CAP,
            threads=self.threads,
        )
        return Fit(
            found["point"].model,
            found["point"].levels,
            tuple(found["point"].loudness),
            tuple(free),
            found["log_posterior"],
            np.array(found["by_run"]),
            np.array(found["information"]),
            np.array(found["scale"]),
            tuple(found["parameters"]),
            np.array(found["level_information"]),
            tuple(found["trims"]),
            found["converged"],
        )

    def intervals(self, fit):
        """The fitted parameters, their 95% intervals allowing for how well the levels are known:
        a list of dictionaries as Fit has them."""
        return self.box.intervals(
            fit.point,
            fit.level_information,
            list(fit.free),
            held=list(self.absent),
            cap=CAP,
            threads=self.threads,
        )

    def blocks(self, fit, loudness=()):
        """Log-likelihood of blocks of time under another fit, one array a run."""
        point = _core.GreyBoxPoint(fit.model, fit.levels, list(loudness))
        return self.box.likelihood(point, cap=CAP, block=BLOCK, threads=self.threads)

    def constants(self, fit, run):
        """Wrench X, Y [N], N [N m] and relative change of thrust that are constant in a run, as its
        poses up to each time tell them under another fit: times [s], (times, 4)."""
        point = _core.GreyBoxPoint(fit.model, fit.levels, [])
        found = self.box.residuals(point, run, cap=CAP)["constants"]
        return np.array(self.runs[run].times), np.array(found)

    def scores(self, fit, model, names):
        """Derivatives of the log-likelihood at a fit by parameters of a model that extends the
        fit's at their neutral values: score (blocks, n), information (n, n), scale (n,), run
        (blocks,)."""
        point = _core.GreyBoxPoint(model, fit.levels, list(fit.loudness))
        found = call(
            self.box.scores, point, list(names), cap=CAP, block=BLOCK, threads=self.threads
        )
        return {key: np.array(value) for key, value in found.items()}


def call(function, *arguments, **options):
    """The core's answer; GroundError in place of what it throws."""
    try:
        return function(*arguments, **options)
    except (RuntimeError, ValueError) as error:
        raise GroundError(str(error))
