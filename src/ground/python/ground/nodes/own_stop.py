"""Whether a craft stops by itself when no command reaches it: judged by its speed in a silence.

A craft is driven by a gentle, constant thrust; then nothing is sent to it for a while, then zeros. One
whose watchdog works accelerates until T after the last packet and brakes from there on:

    speed(t) = s0 + a t            for t < T
    speed(t) = max(0, s(T) - b (t - T))    from T on

T, b, s0 and a are fitted by least squares. Zeros at the end are the control: a craft that neither the
silence nor the zeros brake only shows that braking cannot be seen here.
"""

from dataclasses import dataclass
from typing import Optional

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from ground.support.annotations import Array

PASSED, FAILED, UNDECIDED = "passed", "failed", "undecided"

BEFORE = 0.4  # time before the silence at which the fit begins [s]
AFTER = 1.0  # motion after the silence that shows what zeros do [s]
MIN_SPEED = 0.15  # speed at the last packet that a visible loss needs [m/s]
MIN_BRAKING = 0.5  # least deceleration by braking; gliding has less [m/s^2]
MAX_BRAKING = 6.0  # largest deceleration by the floor; walls cause more [m/s^2]
MIN_LOSS = 0.1  # least loss of speed that counts as braking [m/s]
MAX_GAP = 0.1  # largest gap between states [s]
BLUR = 0.02  # standard deviation of T by filter, latency and the packets' period [s]


@dataclass(frozen=True)
class StopTrial:
    """What was measured, on one clock.

    Parameters
    ----------
    times, speeds: of the states [s], and of the craft over the floor [m/s]
    valid: which states are valid
    last_packet, silence_end: when the last packet before the silence was sent, and the first after [s]
    """

    times: Array
    speeds: Array
    valid: Array
    last_packet: float
    silence_end: float


@dataclass(frozen=True)
class StopVerdict:
    """What a trial shows; numbers are None where they are unknown.

    stopped_after: from the last packet to the beginning of braking, with its 95% `uncertainty` [s]
    braking: deceleration [m/s^2]; speed: at the last packet [m/s]
    """

    outcome: str
    reason: str
    stopped_after: Optional[float] = None
    uncertainty: Optional[float] = None
    braking: Optional[float] = None
    speed: Optional[float] = None


@dataclass(frozen=True)
class Break:
    """A fitted change of slope of the speed; `time` is on the clock of the times given [s]."""

    time: float
    deviation: float  # standard deviation of time [s]
    slope: float  # acceleration before [m/s^2]
    braking: float  # deceleration after [m/s^2]
    loss: float  # fall of the speed from the break to the end of the fit [m/s]

    @property
    def brakes(self) -> bool:
        """Whether the craft slows down by more than gliding does."""
        return self.braking >= MIN_BRAKING and self.loss >= MIN_LOSS


def judge(trial: StopTrial) -> StopVerdict:
    """The StopVerdict on a Trial."""
    silence = trial.silence_end - trial.last_packet
    wrong = _unusable(trial)
    if wrong:
        return StopVerdict(UNDECIDED, wrong)
    t = trial.times - trial.last_packet
    speed = float(np.median(trial.speeds[(t > -0.1) & (t <= 0)]))
    if speed < MIN_SPEED:
        return StopVerdict(
            UNDECIDED,
            "at the last packet it moved at only %.2f m/s, %.2f m/s is needed: give more thrust, "
            "thrust time or lift" % (speed, MIN_SPEED),
            speed=speed,
        )
    found = find_break(t, trial.speeds, -BEFORE, silence)
    if found.brakes:
        return _braked(trial, found, speed)
    control = find_break(t - silence, trial.speeds, -BEFORE, AFTER)
    return _went_on(trial, found, control, speed)


def _braked(trial: StopTrial, found: Break, speed: float) -> StopVerdict:
    uncertainty = 1.96 * float(np.hypot(found.deviation, BLUR))
    numbers = dict(stopped_after=found.time, uncertainty=uncertainty, braking=found.braking, speed=speed)
    silence = trial.silence_end - trial.last_packet
    for wrong, why in (
        (found.braking > MAX_BRAKING, "it stopped harder than a floor brakes: did it hit something?"),
        (found.time < -uncertainty, "it braked before the silence began: did something hold it?"),
        (uncertainty > 0.25, "the time at which it began to brake is uncertain"),
        (
            found.time + uncertainty > silence,
            "it began to brake when the silence ended; try a longer silence",
        ),
    ):
        if wrong:
            return StopVerdict(UNDECIDED, why, **numbers)
    reason = "it stopped by itself %.2f s (+- %.2f s) after the last packet, braking by %.1f m/s^2"
    reason %= (max(0.0, found.time), uncertainty, found.braking)
    return StopVerdict(PASSED, reason, **numbers)


def _went_on(trial: StopTrial, found: Break, control: Break, speed: float) -> StopVerdict:
    t = trial.times - trial.silence_end
    end = float(np.median(trial.speeds[(t > -0.1) & (t <= 0)]))
    silence = trial.silence_end - trial.last_packet
    if not control.brakes:
        why = "neither the silence nor the zeros after it braked the craft: braking cannot be seen here"
        return StopVerdict(UNDECIDED, why, speed=speed)
    if control.time < -1.96 * np.hypot(control.deviation, BLUR):
        why = "it began to brake when the silence ended; try a longer silence"
        return StopVerdict(UNDECIDED, why, speed=speed)
    if end < 0.5 * speed:
        why = "it slowed down from %.2f to %.2f m/s, unlike a braking craft"
        return StopVerdict(UNDECIDED, why % (speed, end), speed=speed)
    # If a speed levels off, the slope of its steep begin counts; a gliding craft gains no speed.
    how = "driven on by its thrust"
    if end < speed + min(0.5 * found.slope * silence, MIN_LOSS):
        how = "gliding, as if its lift were on"
    reason = "it went on for all the %.1f s of silence, %s (%.2f m/s, then %.2f m/s), and braked %.2f s "
    reason += "after the first zero"
    reason %= (silence, how, speed, end, max(0.0, control.time))
    return StopVerdict(FAILED, reason, speed=speed)


def _unusable(trial: StopTrial) -> str:
    """Why a trial cannot be judged; empty when it can."""
    silence = trial.silence_end - trial.last_packet
    if silence < 0.5:
        return "the silence lasted for only %.2f s" % silence
    begin, end = trial.last_packet - BEFORE, trial.silence_end + AFTER
    within = (trial.times >= begin) & (trial.times <= end)
    if not np.all(trial.valid[within]):
        when = trial.times[within][~trial.valid[within]][0] - trial.last_packet
        return "the state was lost %.2f s after the last packet" % when
    edges = np.concatenate([[begin], trial.times[within], [end]])
    gaps = np.diff(edges)
    if gaps.max() > MAX_GAP:
        when = edges[gaps.argmax()] - trial.last_packet
        return "no state for %.2f s, from %.2f s after the last packet on" % (gaps.max(), when)
    if not np.all(np.isfinite(trial.speeds[within])):
        return "a speed is not finite"
    return ""


def find_break(times: Array, speeds: Array, begin: float, end: float) -> Break:
    """The Break in the speeds between two times [s] that fits best."""
    within = (times >= begin) & (times <= end)
    t, s = times[within], speeds[within]
    step = (end - begin) / 60
    fits = []
    for at in np.arange(begin + 2 * step, end - step, 3 * step):
        before, soon = t < at, (t >= at) & (t < at + 0.3)
        slope, s0 = np.polyfit(t[before], s[before], 1) if before.sum() > 2 else (0.0, s[0])
        braking = -np.polyfit(t[soon], s[soon], 1)[0] if soon.sum() > 2 else 1.0
        fits.append(least_squares(lambda p: _shape(p[0], p[1], p[2], p[3], t) - s, [s0, slope, at, braking]))
    fit = min(fits, key=lambda found: float(found.cost))
    s0, slope, time, braking = fit.x
    at_break, last = _shape(s0, slope, time, braking, np.array([time, end]))
    deviation = _deviation(fit, 2)
    return Break(float(time), deviation, float(slope), float(braking), float(at_break - last))


def _shape(s0: float, slope: float, time: float, braking: float, t: Array) -> Array:
    before = s0 + slope * t
    after = np.maximum(0.0, s0 + slope * time - braking * (t - time))
    return np.where(t < time, before, after)


def _deviation(fit: OptimizeResult, index: int) -> float:
    """Standard deviation of a parameter, allowing for the correlation of a filter's residuals."""
    r = fit.fun
    correlation = float(np.clip(np.sum(r[1:] * r[:-1]) / max(np.sum(r * r), 1e-30), 0.0, 0.95))
    variance = np.sum(r * r) / max(1, len(r) - len(fit.x))
    covariance = np.linalg.pinv(fit.jac.T @ fit.jac) * variance
    return float(np.sqrt(covariance[index, index] * (1 + correlation) / (1 - correlation)))
