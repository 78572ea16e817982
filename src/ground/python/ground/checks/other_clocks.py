"""Whether another clock, one that is late or drifts, explains the motion better than slow motors."""

import functools
import itertools
from typing import Callable, Dict, List, NamedTuple, Tuple

import numpy as np

from ground.checks import reply
from ground.poses import kinematics
from ground.reading.recording import Recording
from ground.support.annotations import Array

# What a clock is looked for with
TAUS = (0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3)  # tried time constants of motors [s]
HONEST_LAGS = np.arange(-0.03, 0.155, 0.01)  # that one clock explains [s]
FAR_LAGS = np.arange(-5.0, 5.01, 0.02)  # where clocks differ [s]
RATES = np.arange(-0.012, 0.0121, 0.002)  # tried drifts of clocks [s/s]
DRIFT_LAGS = np.arange(-0.4, 0.61, 0.05)  # tried beside them, in the middle of a run [s]
FAST_RATES = (0.014, 0.05)  # tried drifts of clocks that begin together, as by a wrong rate of frames [s/s]
FAST_STEP, END_STEP = 0.002, 0.1  # between these: least step [s/s], or what moves the end of a run by [s]
BEGIN_LAGS = np.arange(-0.1, 0.31, 0.05)  # tried beside them, at the begin [s]
MIN_SHARE = 0.2  # least share of the accelerations that the commands explain by another clock
MIN_DRIFTING = 16.0  # length of a run from which a drift is looked for [s]


class CommandClock(NamedTuple):
    """Another clock by which commands explain the motion."""

    lag: float  # time from a command to the motion, in the middle of the run [s]
    rate: float  # change of the lag per second [s/s]
    # gives by how many standard errors it explains more than one clock and slow motors
    evidence: Callable[[], float]


def find(recording: Recording) -> List[CommandClock]:
    """The CommandClock that explains the accelerations best with a drift, and the one without; none where the
    commands explain little."""
    motion = recording.motion
    inside = np.flatnonzero(kinematics.middle(motion))
    inside = inside[:: 1 + len(inside) // reply.CLOCK_SAMPLES]
    if len(inside) < reply.MIN_SAMPLES:
        return []
    times, base = motion.times[inside], np.linalg.qr(kinematics.smooth_terms(motion.nu[inside]))[0]
    wanted = kinematics.clipped(kinematics.accelerations(motion)[inside])
    wanted = kinematics.without(wanted, base)
    if not (wanted**2).sum() > 0:
        return []
    wanted /= np.maximum(wanted.std(axis=0), 1e-12)
    centre, motors = 0.5 * (times[0] + times[-1]), _Motors(recording)

    def given(lag: float, rate: float, tau: float = 0.0) -> Array:
        """Commands (n, k) less what is smooth in them."""
        return kinematics.without(motors.lagged(times - rate * (times - centre) - lag, tau), base)

    def left(lag: float, rate: float, tau: float = 0.0) -> Array:
        """What commands leave of the accelerations, by sample (n,)."""
        return np.asarray((kinematics.residuals(given(lag, rate, tau), wanted) ** 2).sum(axis=1))

    known: Dict[Tuple[float, float], float] = {}

    def size(way: Tuple[float, float]) -> float:
        if way not in known:
            known[way] = float(kinematics.squares_left(given(*way), wanted).sum())
        return known[way]

    def least(lags: Array, rate: float) -> Array:
        """The least that commands leave at some lags, with slow motors as well."""
        return np.asarray(min((left(lag, rate, tau) for tau in TAUS for lag in lags), key=np.sum))

    def evidence(lag: float, rate: float) -> float:
        honest = least(HONEST_LAGS, 0.0)
        if rate:  # a constant lag at the same place is no drift
            honest = min(honest, least(lag + np.arange(-0.15, 0.151, 0.01), 0.0), key=np.sum)
        gain = np.array_split(honest - least(np.array([lag]), rate), reply.BLOCKS)
        blocks = np.array([block.sum() for block in gain])
        error = blocks.std(ddof=1) / np.sqrt(reply.BLOCKS)
        return float(blocks.mean() / error) if error > 0 else 0.0

    found = []
    length = float(np.ptp(times))
    fast = np.arange(*FAST_RATES, max(FAST_STEP, END_STEP / length))
    begins = itertools.product(BEGIN_LAGS.tolist(), [*fast.tolist(), *(-fast).tolist()])
    drifting = [*itertools.product(DRIFT_LAGS.tolist(), RATES.tolist())]
    drifting += [(lag + 0.5 * rate * length, rate) for lag, rate in begins]
    for ways, drifts in ((drifting, True), ([(lag, 0.0) for lag in FAR_LAGS.tolist()], False)):
        if drifts and length < MIN_DRIFTING:
            continue
        best = min(ways, key=size)
        for step in 0.5 ** np.arange(5) * drifts:
            around = itertools.product((-0.05, -0.025, 0, 0.025, 0.05), (-0.002, -0.001, 0, 0.001, 0.002))
            best = min(((best[0] + step * a, best[1] + step * b) for a, b in around), key=size)
        if 1 - size(best) / (wanted**2).sum() < MIN_SHARE:
            continue
        lag, rate = best
        found.append(CommandClock(lag, rate, functools.partial(evidence, lag, rate)))
    return found


class _Motors:
    """Commands of the thrusters after first-order lags."""

    def __init__(self, recording: Recording) -> None:
        thrust = recording.thrust
        kept = np.append(True, (np.diff(thrust, axis=0) != 0).any(axis=1))
        self._begins, self._thrust = recording.control_times[kept], thrust[kept]
        self._reached: Dict[float, Array] = {}  # by the lag when each command begins, by time constant

    def lagged(self, times: Array, tau: float) -> Array:
        """The commands after a lag of time constant tau [s], at times (n,) [s]."""
        begins, thrust = self._begins, self._thrust
        if not tau:
            self._reached[tau] = thrust
        if tau not in self._reached:
            reached = self._reached[tau] = np.zeros_like(thrust)
            for i, decay in enumerate(np.exp(-np.diff(begins) / tau), 1):
                reached[i] = thrust[i - 1] + (reached[i - 1] - thrust[i - 1]) * decay
        at = np.searchsorted(begins, times, side="right") - 1
        begun = np.maximum(at, 0)
        since = np.exp(-np.maximum(times - begins[begun], 0) / (tau or 1.0))[:, None]
        found = thrust[begun] + (self._reached[tau][begun] - thrust[begun]) * since
        found[at < 0] = 0
        return np.asarray(found)
