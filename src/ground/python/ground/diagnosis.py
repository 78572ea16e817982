"""Which physical effect a model lacks (DESIGN 7): every candidate refitted, judged on held-out data."""
from dataclasses import dataclass, field
from typing import Any, Dict, List

import numpy as np
from scipy import stats

from ground import _core, validation, windows
from ground.errors import IdentifyError

SIGNIFICANT = 0.05  # of the family of all candidates
WORTH = 0.01  # an effect that lowers the held-out error by less is not worth its parameters
PARTS = 4  # held out one after the other, where there is one short run
ANGLES = ("heading_offset.psi0",)  # found from several starts, all round
STARTS = {"heading_offset.psi0": (np.pi / 2, np.pi, -np.pi / 2)}


@dataclass
class Fit:
    """A model fitted to all windows, and its losses on windows that it was not fitted to."""

    model: Any
    parameters: Dict[str, dict]  # by name: value, ci95, deviation, identified, …
    result: dict
    error: float  # over the windows fitted to
    heldout: float = np.nan  # over all windows, each by a fit to the other parts
    losses: np.ndarray = field(default_factory=lambda: np.zeros(0))  # (windows,) held out


class Study:
    """Windows of runs, parts of them that are held out together, and fits of models to them."""

    def __init__(self, runs, free):
        self.runs, self.free = runs, list(free)
        self.windows = windows.cut(runs)
        self.problem = windows.problem(runs, self.windows)
        self.part = self._parts()
        self.samples = np.array([w.last - w.first + 1 for w in self.windows])

    def _parts(self):
        """Which part each window belongs to: its run, or a quarter of a single one."""
        if len(self.runs) > 1:
            return np.array([w.run for w in self.windows])
        count = min(PARTS, len(self.windows))
        if count < 2:
            raise IdentifyError("%s: too short to hold a part out" % self.runs[0].name)
        return np.arange(len(self.windows)) * count // len(self.windows)

    def fit(self, model, free=None, heldout=True):
        free = self.free if free is None else free
        result = self.problem.fit(model, free)
        fitted = result["model"]
        fit = Fit(
            fitted, {p["name"]: p for p in result["parameters"]}, result, result["objective"]
        )
        return self.hold_out(fit, free) if heldout else fit

    def hold_out(self, fit, free):
        """Fills in the errors on windows that the parameters were not fitted to."""
        losses = np.zeros(len(self.windows))
        for part in np.unique(self.part):
            inside = np.flatnonzero(self.part != part)
            out = np.flatnonzero(self.part == part)
            there = windows.problem(self.runs, [self.windows[i] for i in inside])
            model = there.fit(fit.model, free)["model"]
            here = [self.windows[i] for i in out]
            losses[out] = self._errors(model, here)
        fit.losses = losses
        fit.heldout = float(np.average(losses, weights=self.samples))
        return fit

    def _errors(self, model, chosen):
        """Mean of |e|/s, summed over the channels, of each window."""
        problem = windows.problem(self.runs, chosen)
        simulated = problem.simulate(model)["nu"]
        errors = []
        for window, nu in zip(chosen, simulated):
            measured = np.asarray(self.runs[window.run].nu)[window.first : window.last + 1]
            errors.append(np.abs((nu - measured) / problem.sigma(window.run)).sum(axis=1).mean())
        return np.array(errors)
