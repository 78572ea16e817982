"""Poses that the mocap's software smoothed by a low-pass: recognised, and undone.

Sound poses are smooth motion seen with white noise. A low-pass filters both. What commands do to the craft
shows which low-pass it would have to be, the spectrum of the poses whether their noise went through it, too.
No lag of a craft does that.
"""

import itertools
from dataclasses import replace
from typing import Callable, List, Optional, Sequence, Tuple

import numpy as np

from ground.poses import kinematics, scatter
from ground.poses.low_pass import POLES, LowPass
from ground.poses.repair import Motion
from ground.support.annotations import Array

Averaged = Callable[[Array, Array, float], Array]  # see Recording.averaged

SLOWEST = 0.003  # tried corner ...
CORNERS = np.geomspace(SLOWEST, 0.3, 30)  # ... and all [rate of the poses]
MIN_POSES, MAX_POSES, ROWS = 200, 20000, 2000  # poses, and those that are regressed
BINS, FIRST = 40, 3  # of a spectrum, and the first harmonic in it
MISFIT = 0.25  # relative error of a usual spectrum
ROUNDS = 60  # of the search for the levels of a spectrum
EXPLAINED = 0.99  # part of what commands leave that they leave with a low-pass ...
NEAR, STEPS = 1.05, (1.05, 1.02, 1.006)  # ... and with others that are tried too, at corners in these steps
TRIED = (-2, -1, 0, 1, 2)
MANY, RESIDUALS = 3000, 200  # independent ones of the accelerations, as usual and at least
LATE = (0, 1, 2, 3, 5, 8, 13, 20, 30)  # tried delays of a craft [poses]
HOPELESS = 400.0  # deviance at a rough corner beyond which it filtered no noise
SEEN = 30.0  # least deviance by which filtered noise shows
SLACK = 25.0  # deviance by which sound poses may seem likelier, or smoothed ones, by chance
LIKELIER, CLEAR = 8.0, 50.0  # least evidence where it shows, and where it does not, in deviances
LEFT = 0.2  # part of the deviance of sound poses that a low-pass may leave


class _Commands:
    """How well commands explain the accelerations of a motion, if a low-pass acted on both."""

    def __init__(self, thrust: Array, averaged: Averaged, motion: Motion) -> None:
        usual = scatter.interval(motion.times)
        inside = np.flatnonzero(kinematics.middle(motion))[:MAX_POSES]
        inside = inside[:: 1 + len(inside) // ROWS]
        grid = np.arange(motion.times[0], motion.times[inside[-1]] + usual, usual)
        self._at = np.searchsorted(grid, motion.times[inside] - 0.5 * usual)
        width = max(kinematics.averaged_over(motion), usual)
        self._commands = averaged(thrust, grid, width)
        others = kinematics.smooth_terms(motion.nu[inside])
        self._base = np.linalg.qr(others / np.maximum(np.abs(others).max(axis=0), 1e-300))[0]
        wanted = kinematics.clipped(kinematics.accelerations(motion)[inside])
        self._wanted = kinematics.without(wanted / np.maximum(wanted.std(axis=0), 1e-300), self._base)
        self._squares = np.maximum((self._wanted**2).sum(axis=0), 1e-300)

    def left(self, one: Optional[LowPass], late: int = 0) -> float:
        """Share of the squared accelerations that commands do not explain, the geometric mean of three axes;
        late: [poses]."""
        commands = self._commands if one is None else one.filtered(self._commands)
        commands = kinematics.without(commands[np.maximum(self._at - late, 0)], self._base)
        shares = kinematics.squares_left(commands, self._wanted) / self._squares
        return float(np.exp(np.log(np.maximum(shares, 1e-6)).mean()))

    def gain(self, one: LowPass) -> float:
        """Deviance by which commands explain the motion better with a low-pass than with lags of a craft."""
        lags = [
            replace(one, form="first-order", corner=c * one.rate, both_ways=False, bilinear=kind)
            for c in CORNERS
            for kind in (False, True)
        ]
        craft = min(self.left(lag, late) for lag in [None, *lags] for late in LATE)
        return RESIDUALS * float(np.log(craft / self.left(one)))


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
        self.is_empty = not pieces
        if self.is_empty:
            return
        third = np.diff(poses[np.array(pieces)], 3, axis=1) * window[:, None]
        power = (np.abs(np.fft.rfft(third, axis=1)) ** 2).mean(axis=0) / (window**2).sum()
        angles = 2 * np.pi * np.arange(len(power)) / (length - 3)
        edges = np.unique(np.geomspace(FIRST, len(power) - 1, BINS).round().astype(int))
        self.angles = angles[edges[0] : edges[-1]]
        self._begins, self._sizes = edges[:-1] - edges[0], np.diff(edges)
        self._differences = (2 * np.sin(self.angles / 2)) ** 6
        power = self._binned(power[edges[0] : edges[-1]].T)
        self._powers = [power[:2].mean(axis=0), power[2]]
        self._weights = [1 / (MISFIT**2 + 2 / (self._sizes * len(pieces) * n)) for n in (2, 1)]
        x, y, heading = (quantum(column) / np.sqrt(12) for column in poses.T)
        self._rounding = max(x, y), heading

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

    def misfit(self, one: LowPass) -> Tuple[float, LowPass]:
        """Deviance from motion and white noise that a low-pass filtered; it, with the noise before it."""
        gains = np.asarray(np.abs(one.response(self.angles)) ** 2, float)
        models: List[Sequence[Array]] = [(motion * gains, gains) for motion in self._motions()]
        found = [self._fitted(i, models) for i in (0, 1)]
        misfits = found[0][1] + found[1][1]
        best = int(misfits.argmin())
        position, heading = (float(np.sqrt(levels[best, 1])) for levels, _ in found)
        return float(misfits[best]), replace(one, noise=(position, heading), rounding=self._rounding)

    def sound(self) -> float:
        """Deviance from motion, white noise and noise of the velocity that no low-pass filtered."""
        motions = self._motions()
        lags = 1 / (1 + (self.angles / np.geomspace(0.02, 1.5, 8)[:, None]) ** 2)
        slow = [*motions, *(motions[0] * lags), *(motions[0] * lags**2)]
        return self._least([(motion, self.angles**-2, 0 * self.angles + 1) for motion in slow])

    def confirms(self, one: LowPass, gain: float) -> bool:
        """Whether a low-pass filtered the noise too; gain: deviance by which commands explain the motion
        better with it than with lags of a craft."""
        gains = np.abs(one.response(self.angles)) ** 2
        hidden = self._least([(motion * gains,) for motion in self._motions()])
        sound, misfit = self.sound(), self.misfit(one)[0]
        least = LIKELIER if hidden - misfit > SEEN else CLEAR
        explains = misfit < max(2 * len(self._sizes), LEFT * sound)
        return explains and misfit < sound + SLACK and sound - misfit + gain > least

    def _least(self, parts: Sequence[Sequence[Array]]) -> float:
        """The least deviance of positions and headings of some models."""
        return sum(float(self._fitted(i, parts)[1].min()) for i in (0, 1))

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


def recognised(thrust: Array, averaged: Averaged, motion: Motion) -> Optional[LowPass]:
    """The low-pass that smoothed the poses of a motion of a recording, with the noise before it; None without
    one, and where the commands do not show it."""
    spectrum = _Spectrum(motion.times, motion.measured)
    if _is_silent(spectrum, thrust, motion):
        return None
    commands = _Commands(thrust, averaged, motion)

    def tuned(one: LowPass, cost: Callable[[LowPass], float]) -> LowPass:
        for step in STEPS:
            one = min((replace(one, corner=one.corner * step**i) for i in TRIED), key=cost)
        return one

    def unlikely(one: LowPass) -> float:
        return spectrum.misfit(one)[0] + MANY * float(np.log(commands.left(one)))

    found = [
        min((LowPass(form, c * spectrum.rate, spectrum.rate, both) for c in CORNERS), key=commands.left)
        for form, both in itertools.product(POLES, (False, True))
    ]
    least = min(map(commands.left, found))
    near = [
        replace(one, bilinear=kind)
        for one in found
        for kind in (False, True)
        if commands.left(one) < NEAR * least
    ]
    if least > EXPLAINED * commands.left(None) or min(spectrum.misfit(one)[0] for one in near) > HOPELESS:
        return None
    one = tuned(min((tuned(one, commands.left) for one in near), key=unlikely), unlikely)
    return spectrum.misfit(one)[1] if spectrum.confirms(one, commands.gain(one)) else None


def shared(
    found: Sequence[Optional[LowPass]],
    seen: Sequence[Tuple[Array, Averaged, Motion]],
    decided: Sequence[Optional[LowPass]] = (),
) -> List[Optional[LowPass]]:
    """The low-pass of each recording of one mocap, or None for all of them.

    found: the low-pass that each recording shows by itself; some are None. seen: arguments of `recognised`
    for each recording, with its poses as measured. decided: low-passes of other recordings of the
    mocap; where there are any, they decide whether it smooths."""
    known = sorted((one for one in decided or found if one), key=lambda one: one.corner)
    if not known:
        return [None] * len(found)
    usual, evidence = known[len(known) // 2], []
    likeliest: List[Optional[LowPass]] = []
    for own, given in zip(found, seen):
        spectrum = _Spectrum(given[2].times, given[2].measured)
        if _is_silent(spectrum, given[0], given[2]):
            likeliest.append(usual)
            continue
        misfit, one = spectrum.misfit(own or replace(usual, rate=spectrum.rate))
        evidence.append(spectrum.sound() - misfit + _Commands(*given).gain(one))
        likeliest.append(one if evidence[-1] > 0 else None)
    smooths = bool(decided) or sum(evidence) > SLACK * np.sqrt(len(evidence))
    return likeliest if smooths else [None] * len(found)


def _is_silent(spectrum: _Spectrum, thrust: Array, motion: Motion) -> bool:
    """Whether poses or commands are too few to tell a low-pass."""
    few = spectrum.is_empty or int(kinematics.middle(motion).sum()) < MIN_POSES
    return few or not bool((thrust[1:] != thrust[:-1]).any())
