"""A low-pass that a mocap's software applied to poses, and its inverse."""

from dataclasses import dataclass
from typing import Tuple

import numpy as np

from ground.support.annotations import Array

# Poles of low-passes over 2 pi times the corner
POLES = {
    "first-order": (-1.0,),
    "critically damped": (-1.0, -1.0),
    "Butterworth": (np.exp(0.75j * np.pi), np.exp(-0.75j * np.pi)),
}
TAPS, EDGE = 6, 0.4  # of an inverse: half its length, and width of its band's edge [of the thinned poses]
SPOILT = 0.5  # largest share of amplified rounding [noise]
SLOWER = 4.0  # least rate of thinned poses [corners]


@dataclass(frozen=True)
class LowPass:
    """A low-pass of second or first order that acts on poses of a constant rate."""

    form: str  #: of POLES
    corner: float  #: [Hz]
    rate: float  #: of the poses [Hz]
    both_ways: bool = False  #: forward and backward, so that nothing is late
    bilinear: bool = False  #: designed by the bilinear transform, with zeros at half the rate
    noise: Tuple[float, float] = (0.0, 0.0)  #: of the poses before it, [m], [rad]
    rounding: Tuple[float, float] = (0.0, 0.0)  #: of the poses after it, 1 sigma [m], [rad]

    @property
    def delay(self) -> float:
        """By which slow motion is late [s]."""
        late = -np.sum(1 / np.array(POLES[self.form])).real / (2 * np.pi * self.corner)
        return 0.0 if self.both_ways else float(late)

    def coefficients(self) -> Tuple[Array, Array]:
        """Of its numerator and denominator, by ascending delay."""
        poles, turn = np.array(POLES[self.form]), np.pi * self.corner / self.rate
        warped = np.tan(turn) * poles
        below = _expanded((1 + warped) / (1 - warped) if self.bilinear else np.exp(2 * turn * poles))
        above = _expanded(-np.ones(len(poles))) if self.bilinear else np.ones(1)
        return above * below.sum() / above.sum(), below

    def response(self, angles: Array) -> Array:
        """Complex gains at some angles (n,) [rad per pose]."""
        gain = np.divide(*(np.polyval(part[::-1], np.exp(-1j * angles)) for part in self.coefficients()))
        return np.asarray(gain * gain.conj() if self.both_ways else gain)

    def filtered(self, rows: Array) -> Array:
        """Rows (n, k) at the rate, smoothed."""
        from scipy.signal import lfilter  # slow to load

        coefficients = self.coefficients()
        for _ in range(1 + self.both_ways):
            rows = (lfilter(*coefficients, rows - rows[0], axis=0) + rows[0])[::-1]
        return np.asarray(rows if self.both_ways else rows[::-1])

    def undone(self, times: Array, poses: Array) -> Tuple[Array, Array]:
        """Poses (n, 3) with ascending stamps (n,) [s] as they were before it, at so low a rate that rounding
        does not spoil them. Those whose neighbours are missing are left out."""
        from scipy.interpolate import CubicSpline  # slow to load

        usual, taps, step = 1 / self.rate, *self._inverse()
        half = len(taps) // 2
        steps = np.append(0, np.cumsum(np.maximum(1, np.round(np.diff(times) / usual))).astype(int))
        frames = np.arange(steps[-1] + 1)
        near = np.diff(steps, prepend=-half)[np.searchsorted(steps, frames)] <= max(step, 2)
        good = np.convolve(near, np.ones(len(taps)), "valid") == len(taps)
        chosen = np.flatnonzero(good & (np.arange(len(good)) % step == 0))
        whole = CubicSpline(steps, poses)(frames)
        found = [np.convolve(column, taps, "valid")[chosen] for column in whole.T]
        return np.interp(chosen + half, steps, times), np.column_stack(found)

    def _inverse(self) -> Tuple[Array, int]:
        """Taps that undo it and pass what thinned poses show; every how many poses are left. Least squares,
        weighted as motion is."""
        least = 1 + self.bilinear * (1 + self.both_ways)
        most = max(least, int(self.rate / (SLOWER * self.corner)))
        loud = max(q / max(n, 1e-3 * q, 1e-300) for q, n in zip(self.rounding, self.noise))
        for step in range(least, most + 1):
            angles = np.linspace(0, np.pi, 12 * TAPS * step, endpoint=False)
            edge = np.clip((angles * step / np.pi - 1 + EDGE) / (2 * EDGE), 0, 1)
            wanted = np.cos(0.5 * np.pi * edge) if step > 1 else np.ones(len(angles))
            gains = self.response(angles)
            if loud**2 * np.mean(np.abs(wanted / gains) ** 2) < SPOILT * np.mean(wanted**2):
                break
        lags = np.arange(-TAPS * step, TAPS * step + 1)
        weight = np.sqrt(1 + (1 / np.maximum(angles * step, 0.1)) ** 4)
        waves = np.exp(-1j * angles[:, None] * lags)
        passed = (weight * gains)[:, None] * waves
        rows = np.vstack(
            [passed.real, passed.imag, max(loud, 1e-9) * waves.real, max(loud, 1e-9) * waves.imag]
        )
        right = np.append(weight * wanted, np.zeros(3 * len(angles)))
        return np.linalg.lstsq(rows, right, rcond=None)[0], step


def _expanded(roots: Array) -> Array:
    """Coefficients of the polynomial of one or two roots, real or conjugate."""
    return np.array([1.0, -roots.sum().real, roots.prod().real][: 1 + len(roots)])
