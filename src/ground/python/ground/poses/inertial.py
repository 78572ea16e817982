"""The craft's own gyro and accelerometer: turned into the frame of the poses, with what the poses say about
units, mounting, place, delay and bias.

Poses say the slow motion far better than any such sensor, so that nothing of use is lost when its bias,
which may drift, is what makes it agree with them over seconds. The fast motion it says better.
"""

import functools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Callable, Dict, List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.support.annotations import Array, Flags

if TYPE_CHECKING:
    from ground.poses import repair

GRID = 0.005  # step of the signals that are compared [s]
BAND = 0.04  # standard deviation of the weights that both are smoothed with [s]
DRIFT = 2.0  # the same for a bias that drifts [s]
DELAYS = np.arange(-0.06, 0.1501, 0.002)  # sensor after poses [s]
MOST_POINTS = 20000  # that a calibration compares
MIN_RATE = 20.0  # least rate of samples [Hz]
MIN_TURN, MIN_PUSH = 0.1, 0.05  # least motion that calibrates: rms yaw rate [rad/s], acceleration [m/s^2]
MIN_SHARE = {"gyro": 0.9, "accelerometer": 0.6}  # least share of the poses' signal that it explains
UNKNOWN = 1e3  # noise of a sensor that is not used, far above all motion
LIKE_NOISE = 3.0  # a misfit counts as noise above this multiple of what noise leaves
MAX_DISTANCE = 0.5  # largest plausible distance of a sensor from the markers [m]

Span = Tuple[float, float]  # start, end [s]


@dataclass(frozen=True, eq=False)
class InertialSamples:
    """What a craft's sensors told, in any units and any mounting about the vertical."""

    times: Array  #: (n,) [s], on the clock of the commands
    yaw_rate: Array  #: (n,) about the vertical, either way
    acceleration: Array  #: (n, 2) along two axes of the sensor
    source: str  #: topic that it was read from


@dataclass(frozen=True, eq=False)
class Calibrated:
    """Samples in the frame of the poses, and what that took."""

    data: Optional[_core.InertialData]  #: None: neither sensor is used
    rate: float  #: of samples [Hz]
    source: str
    delay: float = 0.0  #: of the samples after the poses [s]
    gyro_scale: float = 1.0  #: rad/s of a unit of the gyro; negative: its axis points up
    gyro_bias: float = 0.0  #: [rad/s]
    acceleration_scale: float = 1.0  #: m/s^2 of a unit of the accelerometer
    mounting: float = 0.0  #: angle by which the sensor is turned in the frame of the poses [rad]
    problems: Tuple[str, ...] = ()  #: why a sensor is not used

    def describe(self) -> Dict[str, object]:
        """The values of a JSON document."""
        noise = np.empty(0) if self.data is None else np.array(self.data.noise)
        place = np.empty(0) if self.data is None else np.array(self.data.place)
        return {
            "source": self.source,
            "rate": self.rate,
            "delay": self.delay,
            "gyro": {"scale": self.gyro_scale, "bias": self.gyro_bias},
            "accelerometer": {"scale": self.acceleration_scale, "mounting": self.mounting},
            "noise": noise.tolist(),
            "place": place.tolist(),
            "problems": list(self.problems),
        }


def calibrate(samples: InertialSamples, motion: "repair.Motion", contacts: Sequence[Span] = ()) -> Calibrated:
    """Samples in the frame of a run's motion; contacts: spans [s] that do not count. Times stay on the clock
    of the commands."""
    times, first = np.unique(samples.times, return_index=True)
    rate = (len(times) - 1) / float(np.ptp(times)) if len(times) > 1 else 0.0
    if rate < MIN_RATE or times[0] > motion.times[-1] or times[-1] < motion.times[0]:
        return Calibrated(None, rate, samples.source, problems=("too few samples during the poses",))
    gyro, pushed = samples.yaw_rate[first], samples.acceleration[first]
    compared = _Compared(motion, contacts, times)
    problems: List[str] = []

    delay, scale, bias, share = _turns(compared, gyro)
    why = _unfit("gyro", share, compared.turn, MIN_TURN)
    if why:
        return Calibrated(None, rate, samples.source, problems=(why,))
    turns = scale * gyro + compared.drifting(times - delay, scale * gyro, compared.r)
    noise = [_noise(scale * gyro), UNKNOWN, UNKNOWN]
    pushed = pushed * [1, -1 if scale < 0 else 1]  # an axis that points up has a left-handed frame

    found = _pushes(compared, pushed, delay)
    values, place, size, mounting = np.zeros_like(pushed), np.zeros(2), 1.0, 0.0
    why = _unfit("accelerometer", found.share, compared.push, MIN_PUSH)
    if not why and np.hypot(*found.place) > MAX_DISTANCE:
        why = "the accelerometer would be %.2g m from the markers" % np.hypot(*found.place)
    if why:
        problems.append(why)
    else:
        values, place, size, mounting = found.values, found.place, found.scale, found.mounting
        white = size * max(_noise(pushed[:, 0]), _noise(pushed[:, 1]))
        left = np.sqrt(2 * np.sqrt(np.pi) * BAND * rate) / LIKE_NOISE * found.misfit
        noise[1:] = np.maximum(white, left)
    data = _core.InertialData(times - delay, np.column_stack([turns, values]), noise, place)
    return Calibrated(data, rate, samples.source, delay, scale, bias, size, mounting, tuple(problems))


def _unfit(name: str, share: float, size: float, least: float) -> str:
    """Why a sensor cannot be used; empty: it can."""
    if size < least:
        return "the craft moves too little to say what the %s measures" % name
    if not share >= MIN_SHARE[name]:
        return "the %s does not agree with the poses (it has %.0f%% of their motion)" % (
            name, 100 * max(0.0, share),
        )  # fmt: skip
    return ""


class _Compared:
    """The motion by the poses on an even grid of times, smoothed, and the same of a sensor's samples."""

    def __init__(self, motion: "repair.Motion", contacts: Sequence[Span], times: Array) -> None:
        start = max(motion.times[0], times[0])
        end = min(motion.times[-1], times[-1])
        self.grid = np.arange(start, end, GRID)
        self.times = times
        good = self._known(motion, contacts)
        self.weights = _smoothed(good.astype(float), BAND)
        self.good = self.weights > 0.999
        u, v, r = (np.interp(self.grid, motion.times, motion.nu[:, c]) for c in range(3))
        du, dv, dr = (np.interp(self.grid, motion.times, motion.nu_dot[:, c]) for c in range(3))
        smooth = functools.partial(_smoothed, width=BAND)
        self.r, self.dr, self.rr = smooth(r), smooth(dr), smooth(r * r)
        self.a = np.column_stack([smooth(du - v * r), smooth(dv + u * r)])
        some = self.good
        self.turn = float(np.std(self.r[some])) if some.any() else 0.0
        self.push = float(np.sqrt(np.mean(np.var(self.a[some], axis=0)))) if some.any() else 0.0
        self.every = np.flatnonzero(some)[:: 1 + int(some.sum()) // MOST_POINTS]

    def _known(self, motion: "repair.Motion", contacts: Sequence[Span]) -> Flags:
        after = np.clip(np.searchsorted(motion.times, self.grid), 1, len(motion.times) - 1)
        good = motion.times[after] - motion.times[after - 1] <= motion.scales.max_gap
        sample = np.clip(np.searchsorted(self.times, self.grid), 1, len(self.times) - 1)
        good &= self.times[sample] - self.times[sample - 1] <= motion.scales.max_gap
        for a, b in contacts:
            good &= (self.grid < a - 0.1) | (self.grid > b + 0.1)
        return np.asarray(good)

    def of(self, values: Array, delay: float) -> Array:
        """Samples (n,) of a sensor that is late by `delay`, on the grid."""
        return _smoothed(np.interp(self.grid + delay, self.times, values), BAND)

    def drifting(self, at: Array, values: Array, truth: Array) -> Array:
        """What to add to samples (n,) at some times so that they agree with the truth on the grid over
        seconds."""
        own = _smoothed(np.interp(self.grid, at, values), BAND)
        left = np.where(self.good, truth - own, 0.0)
        share = np.maximum(_smoothed(self.good.astype(float), DRIFT), 1e-6)
        return np.asarray(np.interp(at, self.grid, _smoothed(left, DRIFT) / share))


def _smoothed(values: Array, width: float) -> Array:
    """Values on the grid, weighted by a normal curve of this standard deviation [s]."""
    half = min(int(np.ceil(3 * width / GRID)), max(1, (len(values) - 1) // 2))
    curve = np.exp(-0.5 * (np.arange(-half, half + 1) * GRID / width) ** 2)
    ends = np.convolve(np.ones(len(values)), curve, "same")
    return np.asarray(np.convolve(values, curve, "same") / ends)


def _turns(compared: _Compared, gyro: Array) -> Tuple[float, float, float, float]:
    """Delay [s], scale and bias of a gyro, and the share of the poses' turns that it explains."""
    at, r = compared.every, compared.r[compared.every]
    if len(at) < 10:
        return 0.0, 1.0, 0.0, 0.0

    def fitted(delay: float) -> Tuple[float, float, float]:
        g = compared.of(gyro, delay)[at]
        spread = g.var()
        scale = float(np.mean((g - g.mean()) * (r - r.mean())) / spread) if spread > 0 else 0.0
        bias = float(r.mean() - scale * g.mean())
        return scale, bias, float(np.mean((r - bias - scale * g) ** 2))

    delay = _best(lambda d: fitted(d)[2])
    scale, bias, left = fitted(delay)
    return delay, scale, bias, 1 - left / max(r.var(), 1e-30)


def _best(cost: Callable[[float], float]) -> float:
    """The delay of least cost, between those that are tried by a parabola."""
    costs = np.array([cost(float(d)) for d in DELAYS])
    i = int(np.clip(np.argmin(costs), 1, len(costs) - 2))
    a, b, c = costs[i - 1 : i + 2]
    bend = a - 2 * b + c
    away = 0.5 * (a - c) / bend if bend > 0 else 0.0
    return float(DELAYS[i] + np.clip(away, -1, 1) * (DELAYS[1] - DELAYS[0]))


@dataclass(frozen=True)
class _Pushes:
    """A calibrated accelerometer."""

    values: Array  # (n, 2) [m/s^2]
    place: Array  # (2,) [m]
    scale: float
    mounting: float  # [rad]
    share: float  # of the poses' accelerations
    misfit: Array  # (2,) rms of what is left, smoothed [m/s^2]


def _pushes(compared: _Compared, raw: Array, delay: float) -> _Pushes:
    """An accelerometer (n, 2) by linear least squares: at its place p it measures the acceleration of the
    markers and the part of the turn, a + r' x p - r^2 p."""
    at = compared.every
    ax, ay = (compared.of(raw[:, c], delay) for c in range(2))
    zero, one = np.zeros(len(at)), np.ones(len(at))
    dr, rr, a = compared.dr[at], compared.rr[at], compared.a[at]
    x, y = ax[at], ay[at]
    rows_x = np.column_stack([x, -y, one, zero, rr, dr])
    rows_y = np.column_stack([y, x, zero, one, -dr, rr])
    rows, wanted = np.vstack([rows_x, rows_y]), np.concatenate([a[:, 0], a[:, 1]])
    found = np.linalg.lstsq(rows, wanted, rcond=1e-9)[0]
    left = (wanted - rows @ found).reshape(2, -1)
    total = ((a - a.mean(axis=0)) ** 2).sum()
    alpha, beta, px, py = found[0], found[1], found[4], found[5]
    turned = np.column_stack([alpha * raw[:, 0] - beta * raw[:, 1], alpha * raw[:, 1] + beta * raw[:, 0]])
    seen = [
        compared.a[:, 0] - compared.rr * px - compared.dr * py,
        compared.a[:, 1] + compared.dr * px - compared.rr * py,
    ]
    late = compared.times - delay
    drift = [compared.drifting(late, turned[:, c], seen[c]) for c in range(2)]
    return _Pushes(
        np.asarray(turned + np.column_stack(drift), float),
        np.array([px, py]),
        float(np.hypot(alpha, beta)),
        float(np.arctan2(beta, alpha)),
        float(1 - (left**2).sum() / max(total, 1e-30)),
        np.sqrt((left**2).mean(axis=1)),
    )


def _noise(values: Array) -> float:
    """Standard deviation of the white noise of samples (n,), at least the noise of their resolution."""
    second = np.abs(np.diff(values, 2))
    steps = np.abs(np.diff(values))
    resolution = np.quantile(steps[steps > 1e-12], 0.02) if (steps > 1e-12).any() else 0.0
    white = 1.4826 * np.median(second) / np.sqrt(6) if len(second) else 0.0
    return float(max(white, resolution / np.sqrt(12), 1e-6))
