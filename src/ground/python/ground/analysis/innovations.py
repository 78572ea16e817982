"""The whitened innovations of a fitted grey-box filter, and what wrenches change in them."""

import contextlib
import itertools
from dataclasses import replace
from typing import List, Sequence

import numpy as np

from ground.analysis import windows
from ground.analysis.likelihood import Likelihood, LikelihoodFit
from ground.effect_library.parameters import described
from ground.poses import scatter
from ground.support.annotations import Array, Indices
from ground.support.errors import Diverged

STEP = 1e-3  # relative step of a parameter, and delay of all commands [time scales], for finite differences


class Innovations:
    """Innovations of a LikelihoodFit on the runs of a Likelihood, one run after the other.

    Their derivatives by the free parameters, and by a delay of all commands, are projected out of them and
    of all responses. What a known wrench explains is to be explained again.
    """

    def __init__(self, likelihood: Likelihood, fit: LikelihoodFit) -> None:
        self.likelihood, self.fit = likelihood, fit
        runs = range(len(likelihood.runs))
        self._scored = [np.array(likelihood.residuals(fit.point, i)["scored"], bool) for i in runs]
        self._wide = [3 if run.inertial is None else 6 for run in likelihood.runs]  # numbers a sample
        self.rows = np.cumsum([0] + [w * int(scored.sum()) for w, scored in zip(self._wide, self._scored)])
        innovations = [self._innovations(likelihood, fit, i) for i in runs]
        J = np.vstack([self._jacobian(i, e) for i, e in zip(runs, innovations)])
        J = J / np.maximum(np.sqrt((J**2).sum(axis=0)), 1e-300)
        left, sizes, _ = np.linalg.svd(J, full_matrices=False)
        self._left = left[:, sizes > 1e-6 * sizes.max()]
        for i, run in enumerate(likelihood.runs):
            if len(run.wrench):
                innovations[i] = innovations[i] + self._responses(i, np.array(run.wrench)[:, :, None])[:, 0]
        self.y = self.projected(np.concatenate(innovations))

    def projected(self, values: Array) -> Array:
        """Values (rows, ...) without what the parameters can follow."""
        return np.asarray(values - self._left @ (self._left.T @ values))

    def rows_before(self, i: int, samples: Indices) -> Indices:
        """How many rows of a run are of samples before each of some."""
        return np.asarray(self._wide[i] * np.append(0, np.cumsum(self._scored[i]))[samples])

    def responses(self, wrenches: Sequence[Array]) -> Array:
        """Change (rows, k) of the innovations by wrenches (n, 3, k) along each run, not projected."""
        return np.vstack([self._responses(i, w) for i, w in enumerate(wrenches)])

    def _responses(self, i: int, wrench: Array) -> Array:
        """Change of the scored innovations of a run by wrenches (n, 3, k), (rows, k)."""
        acting = wrench.transpose(0, 2, 1).reshape(len(wrench), -1)
        left = self.likelihood.residuals(self.fit.point, i, acting=acting)
        return np.asarray(left["responses"][np.repeat(self._scored[i], self._wide[i])])

    def scores(self, random: int) -> List[Array]:
        """Scores (n, 3, 1 + random) of a unit wrench at each sample of each run, whose response is cut
        after a time scale: by the innovations, and by random ones as they are without an effect."""
        drawn = np.random.default_rng(random).normal(size=(len(self.y), random))
        Y = np.column_stack([self.y, self.projected(drawn)])
        return [self._scores_of(i, Y[a:b]) for i, (a, b) in enumerate(zip(self.rows[:-1], self.rows[1:]))]

    def _scores_of(self, i: int, Y: Array) -> Array:
        times, scored, wide = np.array(self.likelihood.runs[i].times), self._scored[i], self._wide[i]
        apart = round(windows.time_scale(self.likelihood.runs) / scatter.interval(times))
        apart = min(len(times), max(1, apart))
        pulses = np.zeros((len(times), 3, 3, apart))
        for c, first in itertools.product(range(3), range(apart)):
            pulses[first::apart, c, c, first] = 1.0
        responses, targets = np.zeros((len(times), wide, 3, apart)), np.zeros((len(times), wide, Y.shape[1]))
        pulses = pulses.reshape(len(times), 3, -1)
        responses[scored] = self._responses(i, pulses).reshape(-1, wide, 3, apart)
        targets[scored] = Y.reshape(-1, wide, Y.shape[1])
        scores = np.empty((len(times), 3, Y.shape[1]))
        for c, first in itertools.product(range(3), range(apart)):
            products = np.einsum("ij,ijk->ik", responses[:, :, c, first], targets)
            scores[first::apart, c] = np.add.reduceat(products, np.arange(first, len(times), apart))
        return scores

    def _jacobian(self, i: int, innovations: Array) -> Array:
        """Changes of the innovations of a run; 0 where one leaves no finite motion."""
        fit, run = self.fit, self.likelihood.runs[i]
        known, changed = described(fit.model), []
        for name in fit.free:
            value, p = fit.model.value(name), known[name]
            if np.isfinite(value):
                step = STEP * (abs(value) or p.scale)
                model = fit.model.copy()
                model.set_value(name, value + step if value + step <= p.upper else value - step)
                changed.append((self.likelihood, replace(fit, model=model), i))
        late = np.array(run.inputs)
        late[:, 0] += STEP * windows.time_scale([run])
        alone = replace(fit, loudness=fit.loudness[i : i + 1])
        changed.append((Likelihood([run.replaced(inputs=late)], self.likelihood.craft), alone, 0))
        columns = np.zeros((len(innovations), len(changed)))
        for k, other in enumerate(changed):
            with contextlib.suppress(Diverged):
                columns[:, k] = innovations - self._innovations(*other)
        return columns

    @staticmethod
    def _innovations(likelihood: Likelihood, fit: LikelihoodFit, run: int) -> Array:
        left = likelihood.residuals(fit.point, run)
        return np.asarray(np.array(left["whitened"])[np.array(left["scored"])].reshape(-1))
