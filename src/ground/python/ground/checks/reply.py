"""How the motion of a craft replies to its commands: lag, clocks, and what each thruster does.

It needs no knowledge of the body's axes and drag: all accelerations are regressed on all commands and on
products of the velocities.
"""

from dataclasses import dataclass
from typing import Dict, List, NamedTuple, Optional, Sequence, Tuple, TypedDict

import numpy as np

from ground.poses import kinematics, scatter
from ground.poses.repair import Motion
from ground.reading.recording import Recording, once
from ground.support.annotations import Array, Flags

# Tried lags of the motion behind the commands [s]; later ones if the last fits best.
LAGS = np.arange(-0.3, 0.41, 0.01)
LAG_SAMPLES = 20000  # samples, spread over the recording, that determine the lag
USUAL_LAG = 0.1  # if the motion does not determine it [s]
HARDEST = 0.95  # quantile of accelerations that are the craft's hardest
PLACEBOS = 9  # tried lags at which no motion follows
# Share of the accelerations that commands explain which the motion follows: at least, or by so many times
# the share that commands of other times explain and at least the last one.
FOLLOWS, CLEARLY, MIN_FOLLOWED = 0.1, 3.0, 0.02
# Two lags are a controller's answer and the craft's reply if the reply explains at least this share of what
# the answer explains, and some lag between them explains at most this share of what the reply explains.
AS_WELL, APART = 0.7, 0.5
CERTAIN = 3.0  # standard errors beyond which an effect or a difference is certain, or excluded
SIDES = 2.0  # standard errors on both sides of a number in a report
AMBIGUOUS = 0.6  # noise of headings from which it is not known which way the craft turned [rad]
POWER = 0.5  # least share of accelerations that is no noise, where it can be decided
BLOCKS = 10  # blocks of time that errors are estimated from
# Time over which accelerations are averaged to see a slow craft's reply above noise: in times over which the
# smoother averages, and at most so long that a run has as many of them.
COARSE, MIN_AVERAGES = 10.0, 60
COARSE_LAGS = np.arange(-0.3, 0.41, 0.05)  # tried there [s]
ALIKE = 1e-2  # commands whose singular values are in a smaller ratio do not distinguish channels

CLOCK_SAMPLES, MIN_SAMPLES = 2000, 200


class Reply(TypedDict):
    """How accelerations follow from the commands."""

    lag: float  # lag of the motion behind the commands [s]
    error: float  # its standard error [s]
    early: bool  # whether the motion comes before its commands, beyond chance and the poses' interval
    share: float  # share of the accelerations that the commands explain
    chance: float  # the largest share by commands of other times
    # share of the accelerations that is not noise of the poses, of the best channel; 0 where headings are
    # ambiguous, or commands of other times explain so much that it does not show whether these do
    power: float
    follows: bool  # whether the commands explain some
    slow: bool  # whether that only shows in accelerations averaged over the coarse time; lag is the usual one
    coefficients: Array  # (n + 11, 3) of the thrusters, and smooth_terms


def turn_time(motion: Motion) -> float:
    """Time in which the craft turns round by its hardest yaw accelerations [s]: 0.7 s for a palm-sized
    hovercraft, 10 s for a model ship."""
    hardest = np.quantile(np.abs(motion.nu_dot[:, 2]), HARDEST)
    return float(np.sqrt(4 * np.pi / max(hardest, 1e-9)))


def driven(recording: Recording, shift: float = 0.0) -> Flags:
    """Samples of a motion away from the ends of stretches, where commands are known up to so much earlier and
    later [s]."""
    times, sent = recording.motion.times, recording.control_times
    inside = (times > sent[0] + shift) & (times < sent[-1] - shift)
    return np.asarray(kinematics.middle(recording.motion) & inside)


@once
def _averaged_over(recording: Recording) -> float:
    """Time over which smoothed accelerations show commands [s]; 0 where it is below the poses' interval."""
    width = kinematics.averaged_over(recording.motion)
    return 0.0 if width < scatter.interval(recording.motion.times) else width


def commands_at(recording: Recording, commands: Array, times: Array) -> Array:
    """Commands (m, n) as smoothed accelerations show them: averaged over what the smoother does."""
    width = _averaged_over(recording)
    return recording.averaged(commands, times, width) if width else recording.held(commands, times)


@once
def regression(recording: Recording) -> Optional[Reply]:
    """Linear regression of the accelerations on the commands, at the lag that fits best. None where there
    are few poses, or the commands do not change."""
    motion, thrust = recording.motion, recording.thrust
    inside = kinematics.middle(motion)
    times = motion.times[inside]
    if len(times) < 50 or np.ptp(thrust, axis=0).max() < 1e-6:
        return None
    wanted = kinematics.accelerations(motion)[inside]
    scale = kinematics.deviations(wanted)
    scale = np.where(scale > 0, scale, np.maximum(wanted.std(axis=0), 1e-300))
    others = kinematics.smooth_terms(motion.nu[inside])
    others = others / np.maximum(np.abs(others).max(axis=0), 1e-300)
    sizes = np.maximum(np.abs(kinematics.smooth_terms(motion.nu[inside])).max(axis=0), 1e-300)

    def regressed(lag: float, some: slice = slice(None)) -> Tuple[Array, Array]:
        X = np.column_stack([commands_at(recording, thrust, times[some] - lag), others[some]])
        coefficients = np.linalg.lstsq(X, wanted[some], rcond=None)[0]
        return np.abs((wanted[some] - X @ coefficients) / scale).mean(axis=1), coefficients

    spread = slice(None, None, 1 + len(times) // LAG_SAMPLES)
    lags, begins = LAGS, np.arange(BLOCKS) * len(times[spread]) // BLOCKS
    unexplained = np.abs(kinematics.residuals(others, wanted) / scale)
    most = unexplained[spread].mean(axis=1).sum()
    while True:
        costs = np.array([np.add.reduceat(regressed(lag, spread)[0], begins) for lag in lags])
        if _answers_motion(lags, 1 - costs.sum(axis=1) / most):
            lags, costs = lags[lags >= 0], costs[lags >= 0]
        best = int(costs.sum(axis=1).argmin())
        if best < len(lags) - 1 or lags[-1] >= turn_time(motion):
            break
        lags = lags[-1] + 2 * (lags - lags[0])  # a craft may answer later, less exactly
    lag = float(lags[best])
    error, early = _timing(lags, costs, scatter.interval(motion.times))
    misfits, coefficients = regressed(lag)
    coefficients[thrust.shape[1] :] /= sizes[:, None]
    most = unexplained.mean()
    rough = slice(None, None, 1 + len(times) // CLOCK_SAMPLES)
    chance = 1 - min(regressed(lag, rough)[0].mean() for lag in _placebos(recording)) / most
    share, power = float(1 - misfits.mean() / most), _power(motion, wanted) if chance < 0.5 * FOLLOWS else 0.0
    follows = share > FOLLOWS or share > max(CLEARLY * chance, MIN_FOLLOWED)
    slow = None if follows else _slow(recording)
    if slow is not None and slow.share > max(FOLLOWS, CLEARLY * slow.chance):
        lag, early, share, chance, follows = USUAL_LAG, False, slow.share, slow.chance, True
    elif slow is not None and slow.chance >= 0.5 * FOLLOWS:
        power = 0.0
    return {
        "lag": lag,
        "error": error,
        "early": early,
        "share": share,
        "chance": float(chance),
        "power": power,
        "follows": bool(follows),
        "slow": slow is not None and bool(follows),
        "coefficients": coefficients,
    }


def _answers_motion(lags: Array, shares: Array) -> bool:
    """Whether the lag that explains the most is a controller's answer to the motion. shares: of the
    accelerations that the commands explain, by lag. In a closed loop, they have a peak at a negative lag, the
    answer, and another one at a positive lag, the craft's reply. A wrong clock leaves one peak, unless the
    commands are periodic."""
    best, later = int(shares.argmax()), np.flatnonzero(lags >= 0)
    first = int(later[shares[later].argmax()])
    between = shares[best:first].min(initial=np.inf)
    return bool(lags[best] < 0 and shares[first] > AS_WELL * shares[best] and between < APART * shares[first])


def _timing(lags: Array, costs: Array, resolved: float) -> Tuple[float, bool]:
    """The standard error [s] of the lag with the least of some costs (lags, blocks), and whether the lag is
    below zero beyond chance, its own uncertainty, and what is resolved [s]."""
    whole = costs.sum(axis=1, keepdims=True)
    others = lags[(whole - costs).argmin(axis=0)]  # without one block
    error = float(np.sqrt((BLOCKS - 1) * others.var() + (lags[1] - lags[0]) ** 2 / 12))
    best, later = int(whole.argmin()), np.flatnonzero(lags >= 0)
    gain = costs[later[whole[later].argmin()]] - costs[best]
    clear = gain.mean() > CERTAIN * gain.std(ddof=1) / np.sqrt(BLOCKS)
    return error, bool(lags[best] < -max(resolved, SIDES * error) and clear)


class _Slow(NamedTuple):
    """How accelerations that are averaged over the coarse time follow from the commands: the axis that shows
    it best."""

    share: float  # share of the squared accelerations that the commands explain
    chance: float  # the largest share by commands of other times


def coarse_width(motion: Motion) -> float:
    """Time over which averaged accelerations show a slow craft's reply [s]."""
    return min(COARSE * kinematics.averaged_over(motion), float(np.ptp(motion.times)) / MIN_AVERAGES)


def coarse(motion: Motion, times: Array, rows: Array) -> Array:
    """Means (m, k) over coarse_width() of rows (n, k) at some times, without gaps."""
    return means(times, rows, coarse_width(motion), scatter.interval(motion.times))


def means(times: Array, rows: Array, width: float, usual: float) -> Array:
    """Means (m, k) over a width [s] of rows (n, k) at some times with a usual interval [s], without gaps."""
    count = max(1, round(width / usual))
    sums = np.vstack([0 * rows[:1], np.cumsum(rows, axis=0)])
    begins = np.arange(0, len(rows) - count + 1, max(1, count // 4))
    whole = times[begins + count - 1] - times[begins] < 1.5 * width
    return np.asarray((sums[begins + count] - sums[begins])[whole] / count)


def _slow(recording: Recording) -> Optional[_Slow]:
    """The reply of a slow craft; None where the run is too short for it."""
    motion = recording.motion
    inside = kinematics.middle(motion)
    times = motion.times[inside]
    if coarse_width(motion) < 2 * scatter.interval(motion.times) or len(times) < MIN_SAMPLES:
        return None
    base = coarse(motion, times, kinematics.smooth_terms(motion.nu[inside]))
    base = np.linalg.qr(base / np.maximum(np.abs(base).max(axis=0), 1e-300))[0]
    wanted = kinematics.without(coarse(motion, times, kinematics.accelerations(motion)[inside]), base)
    most = np.maximum((wanted**2).sum(axis=0), 1e-300)

    def share(lag: float) -> Array:
        """Of the squares that commands explain, by axis (3,)."""
        commands = coarse(motion, times, recording.held(recording.thrust, times - lag))
        left = kinematics.residuals(kinematics.without(commands, base), wanted)
        return np.asarray(1 - (left**2).sum(axis=0) / most)

    if not len(wanted) > MIN_AVERAGES:
        return None
    shares = np.array([share(lag) for lag in COARSE_LAGS])
    chances = np.max([share(lag) for lag in _placebos(recording)], axis=0)
    axis = int(np.argmax(shares.max(axis=0) - CLEARLY * chances))
    return _Slow(float(shares[:, axis].max()), float(chances[axis]))


def _placebos(recording: Recording) -> Array:
    """Lags at which no motion follows the commands, spread over the recording [s]."""
    length = float(np.ptp(recording.motion.times))
    return np.asarray(length * np.linspace(0.1, 0.5, PLACEBOS) * np.resize([1.0, -1.0], PLACEBOS))


def _power(motion: Motion, wanted: Array) -> float:
    """Share of the accelerations (n, 3) that is not noise of the poses, of the best channel; 0 where headings
    scatter so much that unwrapping them makes turns of noise."""
    if motion.noise[1] > AMBIGUOUS:
        return 0.0
    return float(np.max(1 - accuracy(motion) ** 2 / np.maximum(wanted.var(axis=0), 1e-300)))


def accuracy(motion: Motion) -> Array:
    """Standard deviations (3,) of the noise that smoothing leaves in accelerations [m/s^2], [rad/s^2]."""
    usual = scatter.interval(motion.times)
    pairs = zip(motion.noise, kinematics.blur(motion))
    linear, angular = (noise * np.sqrt(usual / max(time, 0.5 * usual) ** 5 / 18) for noise, time in pairs)
    return np.array([linear, linear, angular])


def find(recording: Recording) -> Optional[Reply]:
    """The regression where the motion follows the commands; else None."""
    found = regression(recording)
    return found if found and found["follows"] else None


def lag_of(recording: Recording) -> float:
    """The lag of the motion behind the commands [s], or the usual one."""
    found = find(recording)
    return USUAL_LAG if found is None else found["lag"]


@dataclass(frozen=True)
class Rest:
    """Accelerations and commands without what velocities, constant wrenches and the floor's slope explain,
    at the same instants."""

    times: Array  # (n,) [s]
    accelerations: Array  # (n, 3) specific force [m/s^2], yaw acceleration [rad/s^2]
    commands: Array  # (n, k)


def rest(
    recording: Recording, names: Sequence[str], twisted: bool = False, lag: Optional[float] = None
) -> Optional[Rest]:
    """The Rest of a motion and the commands of some channels that it follows; None without samples.
    twisted: in the frame of a body whose heading is minus the measured one; lag: by default lag_of() [s]."""
    motion, inside = recording.motion, driven(recording)
    times = motion.times[inside]
    if not len(times):
        return None
    wanted, nu, psi = seen(motion, inside, twisted)
    level = np.column_stack([np.cos(psi), np.sin(psi)])  # a slope in the body frame
    base: Array = np.column_stack([kinematics.smooth_terms(nu), level])
    behind = times - (lag_of(recording) if lag is None else lag)
    commands = commands_at(recording, recording.commands_of(names), behind)
    found = regression(recording)
    if found and found["slow"]:
        wanted, commands, base = (coarse(motion, times, rows) for rows in (wanted, commands, base))
        times = coarse(motion, times, times[:, None]).ravel()
    left = kinematics.without(np.column_stack([kinematics.clipped(wanted), commands]), np.linalg.qr(base)[0])
    return Rest(times, left[:, :3], left[:, 3:])


def seen(motion: Motion, inside: Flags, twisted: bool) -> Tuple[Array, Array, Array]:
    """Accelerations (n, 3), velocities (n, 3) and heading (n,) [rad] of some poses; twisted: in the frame of
    a body whose heading is minus the measured one."""
    wanted, nu, psi = kinematics.accelerations(motion)[inside], motion.nu[inside], motion.eta[inside, 2]
    if not twisted:
        return wanted, nu, psi
    wanted, nu = (_turned(rows, 2 * psi) * [1, 1, -1] for rows in (wanted, nu))
    return wanted, nu, -psi


def _turned(rows: Array, angle: Array) -> Array:
    """Rows (n, 3) with their first two columns turned by an angle (n,)."""
    turned = (rows[:, 0] + 1j * rows[:, 1]) * np.exp(1j * angle)
    return np.column_stack([turned.real, turned.imag, rows[:, 2]])


def fading(recording: Recording, lag: float) -> Optional[Tuple[float, float, float]]:
    """Share of a command's effect that is left while it holds, in the quarter of its ages with the least; its
    standard error; the mean age there [s]. lag: of the motion behind the commands [s]. None where the motion
    does not resolve the ages, or no command acts."""
    sent = recording.control_times
    left = rest(recording, recording.thrusters, lag=lag)
    if left is None:
        return None
    ages = left.times - lag - sent[np.maximum(np.searchsorted(sent, left.times - lag, side="right") - 1, 0)]
    ends = np.quantile(ages, [0.25, 0.5, 0.75])
    motion = recording.motion
    if not ends[2] - ends[0] > max(*kinematics.blur(motion), scatter.interval(motion.times)):
        return None
    wanted = left.accelerations / np.maximum(left.accelerations.std(axis=0), 1e-300)
    by_command = left.commands @ np.linalg.lstsq(left.commands, wanted, rcond=None)[0]
    both, own = ((by_command * rows).sum(axis=1) for rows in (wanted, by_command))
    block, quarter = np.arange(len(ages)) * BLOCKS // len(ages), np.searchsorted(ends, ages)
    some = [[(quarter == q) & (block != b) for q in range(4)] for b in range(-1, BLOCKS)]
    effects = np.array([[both[s].sum() / (own[s].sum() or np.nan) for s in row] for row in some])
    if np.isnan(effects[0]).all():
        return None
    most = int(np.nanargmax(effects[0]))  # a quarter may be empty, of ages that repeat
    least = most + int(np.nanargmin(effects[0, most:]))
    shares = effects[:, least] / effects[:, most]
    error = np.sqrt(BLOCKS - 1) * shares[1:].std()
    return float(shares[0]), float(error), float(ages[quarter == least].mean())


class Authority(TypedDict):
    """What a thruster does to the craft at full input."""

    forward: float  # along the measured body's axes [m/s^2]
    right: float  # [m/s^2]
    turn: float  # clockwise from above [rad/s^2]
    errors: List[float]  # standard errors of these, from a jackknife over blocks of time


def authorities(recording: Recording) -> Dict[str, Authority]:
    """The Authority of each thruster, by its name. Empty if the commands do not distinguish the thrusters."""
    motion, inside = recording.motion, driven(recording)
    if inside.sum() < MIN_SAMPLES:
        return {}
    others = kinematics.smooth_terms(motion.nu[inside])
    wanted = kinematics.clipped(kinematics.accelerations(motion)[inside])
    commands = commands_at(recording, recording.thrust, motion.times[inside] - lag_of(recording))
    sizes = np.linalg.svd(kinematics.without(commands, np.linalg.qr(others)[0]), compute_uv=False)
    if not sizes[-1] > ALIKE * sizes[0]:
        return {}
    count, X = commands.shape[1], np.column_stack([commands, others])
    block = np.arange(len(X)) * BLOCKS // len(X)

    def fit(without: int) -> Array:
        some = block != without
        return np.asarray(np.linalg.lstsq(X[some], wanted[some], rcond=None)[0][:count])

    parts = np.array([fit(b) for b in range(BLOCKS)])
    errors = np.sqrt((BLOCKS - 1) / BLOCKS * ((parts - parts.mean(axis=0)) ** 2).sum(axis=0)).tolist()
    return {
        name: {"forward": forward, "right": right, "turn": turn, "errors": error}
        for name, (forward, right, turn), error in zip(recording.thrusters, fit(-1).tolist(), errors)
    }


def decides(recording: Recording) -> bool:
    """Whether a craft that follows its commands would show it: effects of thrusters as large as the
    accelerations are excluded, and averaging over the coarse time leaves more of these than of noise."""
    motion = recording.motion
    inside = kinematics.middle(motion)
    found = kinematics.clipped(kinematics.accelerations(motion)[inside])
    sizes, slow = found.std(axis=0), coarse(motion, motion.times[inside], found).std(axis=0)
    noise = np.sqrt(min(1.0, kinematics.averaged_over(motion) / coarse_width(motion)))
    return bool((slow > noise * sizes).any()) and all(
        abs(value) + CERTAIN * error < size
        for one in authorities(recording).values()
        for value, error, size in zip((one["forward"], one["right"], one["turn"]), one["errors"], sizes)
    )
