"""Curves of force against input, fitted to forces that were measured on a bench.

A curve is a sum of given functions of the input, so that a fit is a linear least-squares problem, or a
power of the input (thesis 3.2, figure 3.1).
"""

from dataclasses import dataclass
from typing import Callable, List, Optional, Sequence, Tuple

import numpy as np
from scipy import optimize

from ground.support.annotations import Array

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
