"""Score tests (Rao 1948) of effects added to a fit: the likelihood that one or several would gain."""

from typing import Dict, Iterable, List, Mapping, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis.distributions import DEVIATIONS
from ground.analysis.likelihood import Likelihood, LikelihoodFit, is_reciprocal
from ground.effect_library import candidates as effects
from ground.effect_library.parameters import FittedParameter, ParameterInfo, described
from ground.support.annotations import Array

UNSEEN = 0.003  # an effect is unseen if the fitted parameters leave less of its information


class ScoreTests:
    """Score tests of effects that a fit does not have, at their neutral parameters. Those that do nothing
    there (`shape`) stay.

    With scores s and information A of the fitted (n) and the tested (t) parameters, the fitted ones
    are projected out: s = s_t - A_tn A_nn^-1 s_n and A = A_tt - A_tn A_nn^-1 A_nt. The expected
    log-likelihood ratio is then s' A^-1 s, at the step A^-1 s.
    """

    def __init__(
        self, likelihood: Likelihood, fit: LikelihoodFit, candidates: Sequence[effects.Candidate]
    ) -> None:
        extended = fit.model
        for candidate in candidates:
            extended = candidate.neutral(extended)
        tested = [p for c in candidates for p in effects.seen_alone(extended, c.name)]
        self.names = [p.name for p in tested]
        own = [name.split(".")[0] for name in self.names]
        self.columns = {c.name: [i for i, name in enumerate(own) if name == c.name] for c in candidates}
        # Sign that a coordinate's step must have where the neutral value is a bound.
        self.side = np.array([_side(p) for p in tested])
        found = likelihood.scores(fit, extended, [*fit.free, *self.names])
        n, s = slice(0, len(fit.free)), slice(len(fit.free), None)
        self.nuisance, self.nuisance_scale, self.scale = fit.free, found["scale"][n], found["scale"][s]
        A, blocks = found["information"], found["score"]
        self.onto, self.raw = solve(A[n, n], A[n, s]), np.diag(A)[s]
        self.information = A[s, s] - A[s, n] @ self.onto
        self.score = (blocks[:, s] - blocks[:, n] @ self.onto).sum(axis=0)

    def seen(self, name: str) -> float:
        """Share of the information that the fitted parameters cannot take over, of the effect's
        worst parameter."""
        at = self.columns[name]
        raw = np.where(self.raw[at] > 0, self.raw[at], np.inf)
        return float(np.min(np.diag(self.information)[at] / raw))

    def hidden(self, name: str) -> bool:
        """Whether to first order an effect does only what the fitted parameters can do."""
        at = self.columns[name]
        return bool((self.raw[at] > 0).all() and self.seen(name) < UNSEEN)

    def in_place(self, name: str, part: float) -> Dict[str, float]:
        """Steps of coordinates by parameter name that add an effect of `part` of its typical size
        and, to first order, undo it by the fitted parameters."""
        at = self.columns[name]
        steps = {self.names[i]: float(part * self.scale[i]) for i in at}
        moved = -part * self.onto[:, at].sum(axis=1) * self.nuisance_scale
        steps.update(zip(self.nuisance, map(float, moved)))
        return steps

    def estimates(self, model: _core.Model, name: str, step: Mapping[str, float]) -> List[FittedParameter]:
        """Parameters of an effect after the step of its score test."""
        found: List[FittedParameter] = []
        known = {self.names[i]: i for i in self.columns[name] if self.information[i, i] > 0}
        for p in effects.parameters_of(model, name):
            value = moved(p, p.neutral, step.get(p.name, 0.0))
            deviation, ci95 = np.inf, (p.lower, p.upper)
            if p.name in known and self.seen(name) > UNSEEN:
                i = known[p.name]
                deviation = float(self.scale[i] / np.sqrt(self.information[i, i]))
                low, high = (moved(p, value, side * DEVIATIONS * deviation) for side in (-1, 1))
                ci95 = min(low, high), max(low, high)
            told = FittedParameter(name=p.name, unit=p.unit, value=value, ci95=ci95, deviation=deviation)
            told["identified"] = bool(np.isfinite(deviation))
            found.append(told)
        return found

    def test(self, names: Iterable[str]) -> Tuple[float, Dict[str, float]]:
        """Expected log-likelihood ratio 2 (L1 - L0) of effects together, and the step that reaches
        it: (gain, step by parameter name in coordinates)."""
        moving = np.array([i for name in names for i in self.columns[name]], int)
        while len(moving):
            step = solve(self.information[np.ix_(moving, moving)], self.score[moving])
            allowed = self.side[moving] * step >= 0
            if allowed.all():
                steps = {self.names[i]: float(x * self.scale[i]) for i, x in zip(moving, step)}
                return float(self.score[moving] @ step), steps
            moving = moving[allowed]
        return 0.0, {}


def moved(parameter: ParameterInfo, value: float, by: float) -> float:
    """A value after a step of its coordinate, kept inside its range."""
    if is_reciprocal(parameter):
        rate = (0 if np.isinf(value) else 1 / value) + by
        if rate <= 0:
            return float(parameter.neutral) if np.isinf(parameter.neutral) else value
        return float(np.clip(1 / rate, parameter.lower, parameter.upper))
    return float(np.clip(value + by, parameter.lower, parameter.upper))


def stepped(model: _core.Model, steps: Mapping[str, float], part: float = 1.0) -> _core.Model:
    """A model after `part` of the steps of coordinates, by parameter name."""
    known, changed = described(model), model.copy()
    for name, by in steps.items():
        changed.set_value(name, moved(known[name], model.value(name), part * by))
    return changed


def _side(parameter: ParameterInfo) -> int:
    """1 or -1 where a coordinate can only grow or fall from its neutral value, else 0."""
    if parameter.neutral == parameter.lower:
        return 1
    if parameter.neutral == parameter.upper:
        # the coordinate of an infinite time constant is its reciprocal
        return 1 if np.isinf(parameter.neutral) else -1
    return 0


def solve(matrix: Array, right: Array) -> Array:
    """Solution of matrix x = right; zero in directions in which the matrix is singular."""
    if not len(matrix):
        return np.zeros((0,) + right.shape[1:])
    # A direction without information, or whose information overflowed, tells nothing.
    known = np.isfinite(np.diag(matrix)) & (np.diag(matrix) > 0)
    size = np.sqrt(np.where(known, np.diag(matrix), 1.0))
    scaled = np.where(known & known[:, None], matrix / size / size[:, None], 0.0)
    shown = known if right.ndim == 1 else known[:, None]
    size = size if right.ndim == 1 else size[:, None]
    solution = np.linalg.lstsq(scaled, np.where(shown, right / size, 0.0), rcond=1e-9)[0]
    return np.asarray(solution / size)
