"""Forces of thrusters that were measured on a bench: curve, gains, and what they are worth.

Thruster j gives the force g_j f(w) at input w (0..1): one curve f for all, and gains g_j whose mean is 1.
Gains are fitted if they differ significantly. The curve is the simplest one that the Bayesian information
criterion does not clearly reject. Of thrusters that are on or off, there are gains only.

A curve is a sum of given functions of the input, so that a fit is a linear least-squares problem, or a power
of the input (thesis 3.2, figure 3.1).
"""

from dataclasses import dataclass, replace
from typing import Callable, Dict, List, Optional, Sequence, Tuple

import numpy as np
from scipy import optimize, stats

from ground.analysis.distributions import LEVEL
from ground.fitting.bench_forces import OFF, Bench
from ground.support.annotations import Array
from ground.support.errors import GroundError

STRONG = 6.0  # difference of the information criterion that is strong evidence (Kass and Raftery 1995)
ROUNDS = 8  # fits of curve and gains, in turn
BATCHES = 5  # of repetitions in a row, whose drift is common
POWERS = (0.2, 5.0)  # bounds for the exponent
POINTS = 12  # rows of the table that a polynomial is written as
GRID = 301  # inputs at which a polynomial must not fall
MAX_FITS = 8  # each to the inputs above the dead band of the fit before


@dataclass(frozen=True)
class Curve:
    """The force of one thruster against its input."""

    kind: str  #: "linear", "power" or "polynomial"
    order: int  #: number of coefficients
    largest: float  #: largest input that was measured
    force: Callable[[Array], Array]  #: force [N] at inputs (n,), up to the largest one
    power: Optional[float] = None  #: exponent, of a linear curve or a power
    knots: Sequence[float] = ()  #: inputs of the table as which a polynomial is written

    @property
    def words(self) -> str:
        """Such as "polynomial of degree 2"."""
        if self.kind == "polynomial":
            return "polynomial of degree %d" % (self.order - 1)
        return {"linear": "proportional force"}.get(self.kind, self.kind)

    @property
    def full(self) -> float:
        """Force at the largest input that was measured [N]."""
        return float(self.force(np.array([self.largest]))[0])

    def table(self) -> List[Tuple[float, float]]:
        """Rows input, force relative to that at the largest input, from no input on; both ascend."""
        inputs = np.asarray(self.knots)
        force = np.maximum.accumulate(np.maximum(self.force(inputs), 0.0)) / self.full
        force[0] = 0.0
        # Inputs that are equal as they are written are one row.
        rows = {round(float(w), 6): round(float(f), 6) for w, f in zip(inputs, force)}
        return list({0.0: 0.0, **rows}.items())


#: A fit of one kind of curve to inputs (n,), numbers of thrusters at work (n,) and forces (n,) [N].
Kind = Callable[[Array, Array, Array], Optional[Curve]]


def linear(inputs: Array, working: Array, forces: Array) -> Optional[Curve]:
    """A force in proportion to the input."""
    basis = working * inputs
    slope = float(basis @ forces / (basis @ basis))
    return Curve("linear", 1, float(inputs.max()), lambda w: slope * w, 1.0)


def power(inputs: Array, working: Array, forces: Array) -> Optional[Curve]:
    """A power of the input."""
    scale = float(np.max(forces / working))
    largest = float(inputs.max())

    def residuals(x: Array) -> Array:
        return np.asarray(working * x[0] * (inputs / largest) ** x[1] - forces / scale)

    bounds = ([1e-3, POWERS[0]], [1e3, POWERS[1]])
    found = optimize.least_squares(residuals, [1.0, 1.0], bounds=bounds, x_scale="jac").x
    k, p = scale * float(found[0]), float(found[1])

    def force(at: Array) -> Array:
        return np.asarray(k * (np.maximum(at, 0.0) / largest) ** p)

    return Curve("power", 2, largest, force, p)


def polynomial(degree: int) -> Kind:
    """A polynomial, without force below the input at which it becomes positive."""

    def fit(inputs: Array, working: Array, forces: Array) -> Optional[Curve]:
        if len(np.unique(inputs)) <= degree + 1:
            return None
        largest = float(inputs.max())
        at = np.linspace(0, largest, GRID)
        zero = -1.0  # largest input without force
        for _ in range(MAX_FITS):
            above = inputs > zero
            if len(np.unique(inputs[above])) <= degree + 1:
                return None
            basis = working[:, None] * (inputs[:, None] / largest) ** np.arange(degree + 1)
            found = np.linalg.lstsq(basis[above], forces[above], rcond=None)[0]
            value = np.polyval(found[::-1], at / largest)
            off = np.flatnonzero(value <= 0)
            begin = int(off[-1]) if len(off) else 0
            if at[begin] <= zero:
                break
            zero = float(at[begin])
        if value[-1] <= 0 or np.diff(value[begin:]).min() < 0:
            return None  # it falls somewhere
        count = 2 if degree == 1 else POINTS
        return Curve(
            "polynomial",
            degree + 1,
            largest,
            lambda w: np.where(w > at[begin], np.polyval(found[::-1], w / largest), 0.0),
            knots=[float(w) for w in np.linspace(at[begin], largest, count)],
        )

    return fit


#: From the simplest to the most flexible.
KINDS: Sequence[Kind] = (linear, power, polynomial(1), polynomial(2), polynomial(3))


@dataclass(frozen=True)
class Thrust:
    """The fitted thrust."""

    curve: Curve  # force of a thruster with gain 1
    gains: Array  # (m,) mean 1; all 1 unless they differ significantly
    values: Dict[str, float]  # k [N]: force at input 1, or at the largest one of a polynomial; p; gains
    intervals: Dict[str, Tuple[float, float]]  # 95%
    p_value: Optional[float]  # that equal gains differ so much; None where it cannot be tested
    rejected: List[Tuple[str, float]]  # simpler curves, with how likely they are: ratio to the best one
    residual: float  # standard deviation of the forces about the fit [N]
    scatter: float  # standard deviation of repeated measurements [N]; nan without any
    switches: bool = False  # whether thrusters were on or off only, so that nothing is known of the curve


def fit(bench: Bench, names: Sequence[str], only: Optional[str] = None) -> Thrust:
    """The Thrust that a Bench of the named thrusters shows. only: a kind of Curve
    to be used whatever the evidence. Raises GroundError."""
    driven = bench.part(bench.inputs > OFF)
    if not np.max(driven.forces) > 0:
        raise GroundError("no force is positive: thrusters push, so flip the sign or the table")
    gains, p_value = _gains(driven)
    curves = [c for c in _curves(driven, gains) if only is None or c.kind == only]
    if not curves:
        raise GroundError("a %s needs more inputs than the table has, with rising forces" % only)
    chosen, rejected = _choose(driven, gains, curves)

    def refit(part: Bench) -> Dict[str, float]:
        again = _again(part, chosen)
        again = replace(again, largest=chosen.largest)  # also without the largest level
        return _values(again, _fit_gains(part, again) if (gains != 1).any() else gains, names)

    misfit = driven.forces - (driven.together @ gains) * chosen.force(driven.inputs)
    free = chosen.order + int((gains != 1).any()) * _separate(driven)
    values = _values(chosen, gains, names)
    return Thrust(
        chosen,
        gains,
        values,
        _intervals(driven, values, refit),
        p_value,
        rejected,
        float(np.sqrt(misfit @ misfit / max(1, len(misfit) - free))),
        _scatter(driven),
        len(bench.levels) == 1,
    )


def _values(curve: Curve, gains: Array, names: Sequence[str]) -> Dict[str, float]:
    """k, p of a power, and gains that are not 1, by their names."""
    k = curve.full
    values = {"k": k if curve.power is None else k / curve.largest**curve.power}
    if curve.kind == "power":
        values["p"] = float(curve.power or 1.0)
    if (gains != 1).any():
        values.update(zip(names, map(float, gains)))
    return values


def _curves(bench: Bench, gains: Array) -> List[Curve]:
    working = bench.together @ gains
    kinds = KINDS if len(bench.levels) > 1 else KINDS[:1]
    found = [kind(bench.inputs, working, bench.forces) for kind in kinds]
    return [curve for curve in found if curve is not None and curve.full > 0]


def _again(bench: Bench, like: Curve) -> Curve:
    """A curve of the same kind and order, fitted to other forces; as it is where that fails."""
    for curve in _curves(bench, np.ones(bench.together.shape[1])):
        if (curve.kind, curve.order) == (like.kind, like.order):
            return curve
    return like


def _separate(bench: Bench) -> int:
    """The number of gains that the columns can separate."""
    return int(np.linalg.matrix_rank(bench.together)) - 1


def _fit_gains(bench: Bench, curve: Curve) -> Array:
    """Gains with mean 1; those that the columns do not separate are the same."""
    force = curve.force(bench.inputs)
    basis = force[:, None] * bench.together
    # minimum norm: what the data leave open stays at 1
    change = np.linalg.lstsq(basis, bench.forces - basis.sum(axis=1), rcond=1e-9)[0]
    gains = 1 + change
    return np.asarray(gains / gains.mean())


def _gains(bench: Bench) -> Tuple[Array, Optional[float]]:
    """Gains, all 1 unless they differ significantly by an F test with the most flexible curve, and its
    p-value."""
    ones = np.ones(bench.together.shape[1])
    separate = _separate(bench)
    if separate < 1:
        return ones, None
    gains, squares = ones, []
    for _ in range(ROUNDS):
        curve = _curves(bench, gains)[-1]
        misfit = bench.forces - (bench.together @ gains) * curve.force(bench.inputs)
        squares.append(float(misfit @ misfit))
        gains = _fit_gains(bench, curve)
    freedom = len(bench.forces) - curve.order - separate
    if freedom < 1:
        return ones, None
    least = max(min(squares), 1e-12 * max(squares[0], 1e-300))
    p_value = float(stats.f.sf((squares[0] - least) / separate / (least / freedom), separate, freedom))
    return (gains if p_value < LEVEL else ones), p_value


def _scatter(bench: Bench) -> float:
    """Standard deviation of repetitions; nan without any."""
    kinds = np.column_stack([bench.inputs, bench.together])
    group = np.unique(kinds, axis=0, return_inverse=True)[1].ravel()
    count = np.bincount(group)
    freedom = len(group) - len(count)
    misfit = bench.forces - (np.bincount(group, bench.forces) / count)[group]
    return float(np.sqrt(misfit @ misfit / freedom)) if freedom else float("nan")


def _choose(bench: Bench, gains: Array, curves: Sequence[Curve]) -> Tuple[Curve, List[Tuple[str, float]]]:
    """The simplest curve that the forces do not reject, and the simpler ones, by their evidence's ratio."""
    working, n = bench.together @ gains, len(bench.forces)
    least = 1e-12 * float(bench.forces @ bench.forces)
    squares = [((bench.forces - working * c.force(bench.inputs)) ** 2).sum() for c in curves]
    score = [n * np.log(max(s, least) / n) + c.order * np.log(n) for s, c in zip(squares, curves)]
    near = next(i for i, s in enumerate(score) if s - min(score) < STRONG)
    rejected = [(c.words, float(np.exp((min(score) - s) / 2))) for s, c in zip(score, curves)]
    return curves[near], rejected[:near]


def _intervals(
    bench: Bench, values: Dict[str, float], refit: Callable[[Bench], Dict[str, float]]
) -> Dict[str, Tuple[float, float]]:
    """95% intervals by the jackknife: the widest one of leaving out levels, repetitions, whose errors are not
    independent when a whole repetition is off, and batches of many repetitions, which drift."""
    away = {name: 0.0 for name in values}
    count = int(bench.repetition.max()) + 1
    batches = bench.repetition * BATCHES // count if count >= 2 * BATCHES else bench.repetition
    for key in (bench.inputs, bench.repetition, batches):
        groups = np.unique(key)
        if len(groups) < 2:
            continue
        parts = [bench.part(key != group) for group in groups]
        found = [
            refit(part) for part in parts if len(part.levels) == len(bench.levels) or len(part.levels) > 1
        ]
        count = len(found)
        if count < 2:
            continue
        quantile = stats.t.ppf(0.975, count - 1)
        for name in values:
            each = np.array([one.get(name, 1.0) for one in found])
            error = np.sqrt((count - 1) / count * ((each - each.mean()) ** 2).sum())
            away[name] = max(away[name], float(quantile * error))
    # none of them can be negative
    return {name: (max(0.0, value - away[name]), value + away[name]) for name, value in values.items()}
