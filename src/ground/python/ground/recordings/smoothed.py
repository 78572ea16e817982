"""Poses that the mocap's software smoothed by a low-pass: recognised, and undone.

Sound poses are smooth motion seen with white noise. A low-pass filters both. What commands do to the craft
shows which low-pass it would have to be (`_by_commands`); the spectrum of the poses shows whether their
noise went through it, too, which no lag of a craft does (`_evidence`).
"""

import itertools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, List, Optional, Sequence, Tuple

import numpy as np

from ground.recordings import reply, scatter
from ground.recordings.repair import Motion
from ground.support.annotations import Array

if TYPE_CHECKING:
    from ground.recordings.recording import Recording

# Poles of low-passes over 2 pi times the corner
POLES = {
    "first-order": (-1.0,),
    "critically damped": (-1.0, -1.0),
    "Butterworth": (np.exp(0.75j * np.pi), np.exp(-0.75j * np.pi)),
}
WIDEST, SLOWEST, CORNERS = 0.3, 0.003, 30  # tried corners [rate of the poses]
FEWEST, MOST, ROWS = 200, 20000, 2000  # poses, and those that are regressed
BINS, FIRST = 40, 3  # of a spectrum, and the first harmonic in it
MISFIT = 0.25  # relative error of a usual spectrum
ROUNDS = 60  # of the search for the levels of a spectrum
EXPLAINED = 0.99  # part of what commands leave that they leave with a low-pass ...
NEAR, STEPS = 1.05, (1.05, 1.02, 1.006)  # ... and with others that are tried too, at corners in these steps
TRIED = (-2, -1, 0, 1, 2)
MANY, RESIDUALS = 3000, 200  # independent ones of the accelerations, as usual and at least
LATE = (0, 1, 2, 3, 5, 8, 13, 20, 30)  # tried delays of a craft [poses]
SEEN = 10.0  # least deviance by which filtered noise shows
LIKELIER, CLEAR = 5.0, 50.0  # least evidence where it shows, and where it does not, in deviances
TAPS, EDGE = 6, 0.4  # of an inverse: half its length, and width of its band's edge [of the thinned poses]
SPOILT, SLOWER = (
    0.5,
    4.0,
)  # largest share of amplified rounding [noise]; least rate of thinned poses [corners]


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
        poles = np.array(POLES[self.form])
        if not self.bilinear:
            below = np.poly(np.exp(2 * np.pi * self.corner / self.rate * poles)).real
            return np.array([below.sum()]), below
        warped = np.tan(np.pi * self.corner / self.rate) * poles
        below = np.poly((1 + warped) / (1 - warped)).real
        above = np.poly(-np.ones(len(poles)))
        return above * below.sum() / above.sum(), below

    def response(self, angles: Array) -> Array:
        """Complex gains at some angles (n,) [rad per pose]."""
        above, below = (np.polyval(part[::-1], np.exp(-1j * angles)) for part in self.coefficients())
        gain = above / below
        return np.asarray(gain * gain.conj() if self.both_ways else gain)

    def filtered(self, rows: Array) -> Array:
        """Rows (n, k) at the rate, smoothed."""
        from scipy.signal import lfilter  # slow to load

        for _ in range(1 + self.both_ways):
            rows = (lfilter(*self.coefficients(), rows - rows[0], axis=0) + rows[0])[::-1]
        return np.asarray(rows if self.both_ways else rows[::-1])

    def undone(self, times: Array, poses: Array) -> Tuple[Array, Array]:
        """Poses (n, 3) with ascending stamps (n,) [s] as they were before it, at so low a rate that the rounding
        after it does not spoil them. Those whose neighbours are missing are left out."""
        from scipy.interpolate import CubicSpline  # slow to load

        usual, taps, step = 1 / self.rate, *self._inverse()
        half = len(taps) // 2
        steps = np.append(0, np.cumsum(np.maximum(1, np.round(np.diff(times) / usual))).astype(int))
        frames = np.arange(steps[-1] + 1)
        known = np.interp(frames, steps, times)
        whole = np.column_stack([CubicSpline(steps, column)(frames) for column in poses.T])
        near = np.diff(steps, prepend=-half)[np.searchsorted(steps, frames)] <= max(step, 2)
        good = np.convolve(near, np.ones(2 * half + 1), "valid") == 2 * half + 1
        at = np.arange(half, len(frames) - half)
        chosen = good & (at % step == 0)
        found = np.column_stack([np.convolve(column, taps, "valid") for column in whole.T])
        return known[at][chosen], found[chosen]

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
        waves = np.exp(-1j * angles[:, None] * lags)
        weight = np.sqrt(1 + (1 / np.maximum(angles * step, 0.1)) ** 4)
        A = np.vstack([(weight * gains)[:, None] * waves, max(loud, 1e-9) * waves])
        b = np.append(weight * wanted, 0 * wanted)
        rows, right = np.vstack([A.real, A.imag]), np.append(b, 0 * b)
        return np.linalg.lstsq(rows, right, rcond=None)[0], step


class _Commands:
    """How well commands explain the accelerations of a motion, if a low-pass acted on both."""

    def __init__(self, recording: "Recording", motion: Motion) -> None:
        usual = scatter.interval(motion.times)
        inside = np.flatnonzero(reply.middle(motion))[:MOST]
        inside = inside[:: 1 + len(inside) // ROWS]
        times = motion.times[inside]
        self._grid = np.arange(motion.times[0], times[-1] + usual, usual)
        self._at = np.searchsorted(self._grid, times - 0.5 * usual)
        width = max(reply.KERNEL * max(reply.blur(motion)), usual)
        self._commands = recording.averaged(recording.thrust, self._grid, width)
        others = reply.smooth_terms(motion.nu[inside])
        self._base = np.linalg.qr(others / np.maximum(np.abs(others).max(axis=0), 1e-300))[0]
        wanted = reply.clipped(reply.accelerations(motion)[inside])
        self._wanted = self._rest(wanted / np.maximum(wanted.std(axis=0), 1e-300))

    def _rest(self, rows: Array) -> Array:
        return np.asarray(rows - self._base @ (self._base.T @ rows))

    def left(self, one: Optional[LowPass], late: int = 0) -> float:
        """Share of the squared accelerations that commands do not explain, the geometric mean of three axes;
        late: [poses]."""
        commands = self._commands if one is None else one.filtered(self._commands)
        commands = self._rest(commands[np.maximum(self._at - late, 0)])
        off = self._wanted - commands @ np.linalg.lstsq(commands, self._wanted, rcond=None)[0]
        shares = (off**2).sum(axis=0) / np.maximum((self._wanted**2).sum(axis=0), 1e-300)
        return float(np.exp(np.log(np.maximum(shares, 1e-6)).mean()))


class _Spectrum:
    """Of third differences of poses, in bins."""

    def __init__(self, times: Array, poses: Array) -> None:
        self.rate = 1 / scatter.interval(times)
        apart = np.diff(times) * self.rate
        runs = np.split(np.arange(len(times)), np.flatnonzero((apart > 1.5) | (apart < 0.5)) + 1)
        length = max(64, min(1024, len(times) // 4))
        while length > 64 and sum(len(run) for run in runs if len(run) >= length) < len(times) / 2:
            length //= 2
        window = np.hanning(length - 1)[1:-1]
        pieces = [run[i : i + length] for run in runs for i in range(0, len(run) - length + 1, length // 2)]
        self.count = len(pieces)
        if not pieces:
            return
        third = np.diff(poses[np.array(pieces)], 3, axis=1) * window[:, None]
        power = (np.abs(np.fft.rfft(third, axis=1)) ** 2).mean(axis=0) / (window**2).sum()
        angles = 2 * np.pi * np.arange(len(power)) / (length - 3)
        edges = np.unique(np.geomspace(FIRST, len(power) - 1, BINS).round().astype(int))
        self.angles = angles[edges[0] : edges[-1]]
        self._begins, self._sizes = edges[:-1] - edges[0], np.diff(edges)
        self._differences = (2 * np.sin(self.angles / 2)) ** 6
        self._powers = [
            self._binned(power[edges[0] : edges[-1], columns].mean(axis=1)) for columns in ([0, 1], [2])
        ]
        self._weights = [1 / (MISFIT**2 + 2 / (self._sizes * self.count * n)) for n in (2, 1)]
        self._rounding = [max(quantum(poses[:, i]) for i in c) / np.sqrt(12) for c in ([0, 1], [2])]

    def _binned(self, rows: Array) -> Array:
        """Means (..., bins) of rows (..., angles)."""
        return np.asarray(np.add.reduceat(rows, self._begins, axis=-1) / self._sizes)

    def _fitted(self, which: int, parts: Sequence[Sequence[Array]]) -> Tuple[Array, Array]:
        """The likeliest levels (n, k) of so many parts of the spectrum, for each of n models (Fevotte 2009),
        and their deviances (n,)."""
        power, weights = self._powers[which], self._weights[which]
        A = self._binned(self._differences * np.array([list(model) for model in parts]))
        rounded = self._binned(self._differences) * self._rounding[which] ** 2
        levels = (power / A).min(axis=2)
        for _ in range(ROUNDS):
            S = np.einsum("nk,nkb->nb", levels, A) + rounded
            up = np.einsum("nb,nkb->nk", weights * power / S**2, A)
            levels = levels * up / np.einsum("nb,nkb->nk", weights / S, A)
        ratio = power / (np.einsum("nk,nkb->nb", levels, A) + rounded)
        return levels, (weights * (ratio - 1 - np.log(ratio))).sum(axis=1)

    def fitted_to(self, one: LowPass) -> Tuple[float, float, Tuple[float, float]]:
        """The deviance from motion and white noise that a low-pass filtered, that without noise, and the noise
        before it of positions [m] and headings [rad]."""
        gains = np.abs(one.response(self.angles)) ** 2
        models = [(motion * gains, gains) for motion in self._motions()]
        found = [self._fitted(i, models) for i in (0, 1)]
        best = int((found[0][1] + found[1][1]).argmin())
        alone = sum(self._fitted(i, [models[best][:1]])[1][0] for i in (0, 1))
        position, heading = (float(np.sqrt(levels[best, 1])) for levels, _ in found)
        return float(found[0][1][best] + found[1][1][best]), float(alone), (position, heading)

    def confirmed(self, one: LowPass, gain: float) -> Optional[LowPass]:
        """The low-pass, with the noise before it, if it filtered the noise too; else None. gain: deviance by
        which commands explain the motion better with it than with lags of a craft."""
        motions, flat = self._motions(), np.ones(len(self.angles))
        lags = 1 / (1 + (self.angles / np.geomspace(0.02, 1.5, 8)[:, None]) ** 2)
        slow = [motions[0] * lag**n for lag in lags for n in (1, 2)]
        models = [(motion, self.angles**-2, flat) for motion in motions + slow]
        sound = sum(self._fitted(i, models)[1].min() for i in (0, 1))
        misfit, alone, noise = self.fitted_to(one)
        least = LIKELIER if alone - misfit > SEEN else CLEAR
        if misfit > 2 * len(self._sizes) or sound - misfit + gain < least:
            return None
        return replace(one, noise=noise, rounding=(self._rounding[0], self._rounding[1]))

    def _motions(self) -> List[Array]:
        """Spectra of motion by forces that change at different rates."""
        turns = 2 * np.pi * np.geomspace(SLOWEST, 0.1, 8)
        return [self.angles**-4 / (1 + (self.angles / turn) ** 2) for turn in turns]


def quantum(values: Array) -> float:
    """The rounding of which the steps of some values (n,) are multiples, their greatest common divisor; 0
    without one."""
    least, found = 1e-9 * max(float(np.ptp(values)), 1e-9), 0.0
    steps = np.unique(np.abs(np.diff(values)))
    for step in steps[steps > least][:20]:
        found, rest = float(step), found
        while rest > least:
            found, rest = rest, found % rest
            rest = 0.0 if min(rest, found - rest) < 0.02 * found else rest
    return found if found > 10 * least else 0.0


def recognised(recording: "Recording", motion: Motion) -> Optional[LowPass]:
    """The low-pass that smoothed the poses of a motion of a recording, with the noise before it; None without
    one, and where the commands do not show it."""
    spectrum = _Spectrum(motion.times, motion.measured)
    if len(motion.times) < FEWEST or not spectrum.count or not np.ptp(recording.thrust, axis=0).any():
        return None
    commands = _Commands(recording, motion)
    corners = np.geomspace(SLOWEST, WIDEST, CORNERS) * spectrum.rate
    found = []
    for form, both_ways in itertools.product(POLES, (False, True)):
        some = [LowPass(form, corner, spectrum.rate, both_ways) for corner in corners]
        shares = [commands.left(one) for one in some]
        found.append((min(shares), some[int(np.argmin(shares))]))
    least = min(share for share, _ in found)
    if not least < EXPLAINED * commands.left(None):
        return None
    lags = [LowPass("first-order", corner, spectrum.rate) for corner in corners[::3]]
    craft = min(commands.left(lag, late) for lag in [None, *lags] for late in LATE)

    near = []
    for (share, one), bilinear in itertools.product(found, (False, True)):
        one = replace(one, bilinear=bilinear)
        for step in STEPS if share < NEAR * least else ():
            one = min((replace(one, corner=one.corner * step**i) for i in TRIED), key=commands.left)
            share = commands.left(one)
        near.append((share, one))
    least = min(share for share, _ in near)
    near = [(s, one) for s, one in near if s < NEAR * least]

    def unlikely(one: LowPass) -> float:
        return spectrum.fitted_to(one)[0] + MANY * float(np.log(commands.left(one)))

    one = min((one for _, one in near), key=unlikely)
    for step in STEPS:
        one = min((replace(one, corner=one.corner * step**i) for i in TRIED), key=unlikely)
    share = commands.left(one)
    return spectrum.confirmed(one, RESIDUALS * float(np.log(craft / share)))
