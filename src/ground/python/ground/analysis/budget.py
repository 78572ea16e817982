"""Parts of a model's error: pose noise, the random disturbance, differences between runs.

The grown model is simulated along the recordings with each of these at the fitted levels. The
simulation error (study.channel_errors) of such artificial recordings is what each part alone would
leave. Independent parts add in squares.
"""

import itertools
from dataclasses import dataclass
from typing import Dict, Mapping, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import likelihood, study
from ground.analysis.unfinished import can_be_kept
from ground.annotations import Array, Each, Random

SEEDS = (1, 2, 3)  # one artificial recording each; errors are their means


@can_be_kept
@dataclass(frozen=True)
class Budget:
    """Simulation errors (study.channel_errors) of artificial recordings and of the real ones."""

    noise: float  # the poses' noise alone
    disturbance: float  # with the random wrench
    trim: float  # with the constant wrench and thrust of each run as well
    measured: float  # the real recordings

    def parts(self) -> Dict[str, float]:
        """Share of the squared measured error that each part adds: noise, disturbance, trim, and the
        rest, which is negative where the levels predict more than was measured."""
        edges = np.array([0.0, self.noise, self.disturbance, self.trim, self.measured]) ** 2
        return dict(zip(("noise", "disturbance", "trim", "rest"), np.diff(edges) / edges[-1]))


def budget(
    runs: Sequence[_core.RunData],
    cut: Sequence[_core.Window],
    fit: likelihood.Fit,
    each: Each = map,
) -> Budget:
    """The Budget of a likelihood.Fit on runs (_core.RunData) over windows of them; each: maps a function
    over artificial recordings, in parallel if it can."""
    together: Tuple[Tuple[str, ...], ...] = ((), ("disturbance",), ("disturbance", "trim"))

    def error(what: Tuple[Tuple[str, ...], int]) -> float:
        return _error_of(runs, cut, fit, *what)

    found = list(each(error, itertools.product(together, SEEDS)))
    noise, disturbance, trim = map(float, np.reshape(found, (len(together), -1)).mean(axis=1))
    measured = float(study.channel_errors(runs, cut, fit.model).sum())
    return Budget(noise, disturbance, trim, measured)


def _error_of(
    runs: Sequence[_core.RunData],
    cut: Sequence[_core.Window],
    fit: likelihood.Fit,
    parts: Sequence[str],
    seed: int,
) -> float:
    """Error of artificial recordings that have some parts besides the poses' noise."""
    random = np.random.default_rng(seed)
    factors = np.exp(fit.loudness) if fit.loudness else np.ones(len(runs))
    artificial = []
    for run, trim, factor in zip(runs, fit.trims, factors):
        wrench, thrust = np.zeros((len(run.times), 3)), 0.0
        if "disturbance" in parts:
            wrench += factor * wrench_of(run, fit.levels, random)
        if "trim" in parts:
            wrench += np.array(trim["wrench"])
            thrust = trim["thrust"]
        artificial.append(study.recorded(run, fit.model, random, wrench, thrust))
    return float(study.channel_errors(artificial, cut, fit.model, truth=runs).sum())


def wrench_of(run: _core.RunData, levels: Mapping[str, float], random: Random) -> Array:
    """An Ornstein-Uhlenbeck and white wrench (n, 3) of some levels at a run's samples [N], [N m]."""
    steps = np.diff(np.array(run.times), append=run.times[-1] + 1e-3)
    steps = np.maximum(steps, 1e-4)
    wrench = np.empty((len(steps), 3))
    for i, channel in enumerate("XYN"):
        sigma, time = levels["sigma_" + channel], levels["time_" + channel]
        slow = sigma * random.normal()
        drawn, white = random.normal(size=(2, len(steps)))
        left = np.exp(-steps / time)
        pushes = sigma * np.sqrt(1 - left**2) * drawn
        values = []
        for share, push in zip(left.tolist(), pushes.tolist()):
            values.append(slow)
            slow = share * slow + push
        wrench[:, i] = values + levels["white_" + channel] / np.sqrt(steps) * white
    return wrench
