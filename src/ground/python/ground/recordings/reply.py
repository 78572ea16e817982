"""How the motion of a craft replies to its commands: lag, clocks, and what each thruster does.

It needs no knowledge of the body's axes and drag: all accelerations are regressed on all commands and on
products of the velocities.
"""

import functools
import itertools
from dataclasses import dataclass
from typing import Callable, Dict, List, NamedTuple, Optional, Sequence, Tuple, TypedDict

import numpy as np

from ground.recordings import scatter
from ground.recordings.recording import Recording, once
from ground.recordings.repair import Motion
from ground.support.annotations import Array, Document, Flags, Indices

LAGS = np.arange(-0.3, 0.41, 0.01)  # tried lags of the motion behind the commands [s]
LAG_SAMPLES = 20000  # samples, spread over the recording, that determine the lag
USUAL_LAG = 0.1  # if the motion does not determine it [s]
OUTLIER = 6.0  # accelerations further from their median than so many scatters are cut
END = 5.0  # at the ends of stretches accelerations are inaccurate over this multiple of their blur
KERNEL = 3.0  # width of a mean that blurs as a smoother does, relative to its blur
PLACEBOS = 9  # tried lags at which no motion follows
# Share of the accelerations that commands explain which the motion follows: at least, or by so many times
# the share that commands of other times explain and at least the last one.
FOLLOWS, CLEARLY, MIN_FOLLOWED = 0.1, 3.0, 0.02
EXCLUDED = 3.0  # standard errors beyond which an effect is excluded
AMBIGUOUS = 0.6  # noise of headings from which it is not known which way the craft turned [rad]
POWER = 0.5  # least share of accelerations that is no noise, where it can be decided
BLOCKS = 10  # blocks of time that errors are estimated from
ALIKE = 1e-2  # commands whose singular values are in a smaller ratio do not distinguish channels

# What a clock is looked for with
CLOCK_SAMPLES, MIN_SAMPLES = 2000, 200
TAUS = (0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3)  # tried time constants of motors [s]
HONEST_LAGS = np.arange(-0.03, 0.155, 0.01)  # that one clock explains [s]
FAR_LAGS = np.arange(-5.0, 5.01, 0.02)  # where clocks differ [s]
RATES = np.arange(-0.012, 0.0121, 0.002)  # tried drifts of clocks [s/s]
DRIFT_LAGS = np.arange(-0.4, 0.61, 0.05)  # tried beside them, in the middle of a run [s]
MIN_SHARE = 0.2  # least share of the accelerations that the commands explain by another clock
MIN_DRIFTING = 16.0  # length of a run from which a drift is looked for [s]


class Reply(TypedDict):
    """How accelerations follow from the commands."""

    lag: float  # lag of the motion behind the commands [s]
    share: float  # share of the accelerations that the commands explain
    chance: float  # the largest share by commands of other times
    # share of the accelerations that is not noise of the poses, of the best channel; 0 where headings are
    # ambiguous, or commands of other times explain so much that it does not show whether these do
    power: float
    follows: bool  # whether the commands explain some
    coefficients: Array  # (n + 11, 3) of the thrusters, and smooth_terms


def stretches(times: Array, inside: Flags, max_gap: float) -> List[Indices]:
    """Indices of the samples inside, split at gaps of more than max_gap [s]."""
    index = np.flatnonzero(inside)
    if not len(index):
        return []
    return np.split(index, np.flatnonzero(np.diff(times[index]) > max_gap) + 1)


def blur(motion: Motion) -> Tuple[float, float]:
    """Times over which the smoother averages velocities of the craft over the ground, and of its heading
    [s]."""
    jerks = motion.scales.linear_jerk, motion.scales.angular_jerk
    usual = scatter.interval(motion.times)
    linear, angular = ((n * np.sqrt(usual) / jerk) ** (1 / 3) for n, jerk in zip(motion.noise, jerks))
    return linear, angular


def accelerations(motion: Motion) -> Array:
    """Specific force in the body's frame (n, 2) [m/s^2] and yaw acceleration [rad/s^2], (n, 3)."""
    u, v, r = motion.nu.T
    return np.asarray(motion.nu_dot + np.column_stack([-r * v, r * u, 0 * r]))


def smooth_terms(nu: Array) -> Array:
    """Regressors of the accelerations besides the commands, (n, 11)."""
    u, v, r = nu.T
    return np.column_stack(
        [np.ones(len(nu)), u, v, r, u * u, v * v, r * r, u * v, u * r, v * r, r * np.abs(r)]
    )


def middle(motion: Motion, times: Optional[Array] = None) -> Flags:
    """Samples away from the ends of stretches, where smoothed accelerations are inaccurate; of some of the
    motion's times, or all."""
    times = motion.times if times is None else times
    inside, margin = np.zeros(len(times), bool), END * max(blur(motion))
    for stretch in stretches(times, np.ones(len(times), bool), motion.scales.max_gap):
        start, end = times[stretch[0]], times[stretch[-1]]
        inside[stretch] = (times[stretch] > start + margin) & (times[stretch] < end - margin)
    return inside


def commands_at(recording: Recording, commands: Array, times: Array) -> Array:
    """Commands (m, n) as smoothed accelerations show them: averaged over what the smoother does."""
    width = KERNEL * max(blur(recording.motion))
    if width < scatter.interval(recording.motion.times):
        return recording.held(commands, times)
    return recording.averaged(commands, times, width)


@once
def regression(recording: Recording) -> Optional[Reply]:
    """Linear regression of the accelerations on the commands, at the lag that fits best. None where there
    are few poses, or the commands do not change."""
    motion, thrust = recording.motion, recording.thrust
    inside = middle(motion)
    times = motion.times[inside]
    if len(times) < 50 or np.ptp(thrust, axis=0).max() < 1e-6:
        return None
    wanted = accelerations(motion)[inside]
    scale = 1.4826 * np.median(np.abs(wanted - np.median(wanted, axis=0)), axis=0)
    scale = np.where(scale > 0, scale, np.maximum(wanted.std(axis=0), 1e-300))
    others = smooth_terms(motion.nu[inside])
    others = others / np.maximum(np.abs(others).max(axis=0), 1e-300)
    sizes = np.maximum(np.abs(smooth_terms(motion.nu[inside])).max(axis=0), 1e-300)

    def regressed(lag: float, some: slice = slice(None)) -> Tuple[float, Array]:
        X = np.column_stack([commands_at(recording, thrust, times[some] - lag), others[some]])
        coefficients = np.linalg.lstsq(X, wanted[some], rcond=None)[0]
        return float(np.abs((wanted[some] - X @ coefficients) / scale).mean()), coefficients

    spread = slice(None, None, 1 + len(times) // LAG_SAMPLES)
    lag = float(LAGS[int(np.argmin([regressed(lag, spread)[0] for lag in LAGS]))])
    misfit, coefficients = regressed(lag)
    coefficients[thrust.shape[1] :] /= sizes[:, None]
    without = np.linalg.lstsq(others, wanted, rcond=None)[0]
    most = np.abs((wanted - others @ without) / scale).mean()
    rough = slice(None, None, 1 + len(times) // CLOCK_SAMPLES)
    chance = 1 - min(regressed(lag, rough)[0] for lag in _placebos(recording)) / most
    share, power = float(1 - misfit / most), _power(motion, wanted) if chance < 0.5 * FOLLOWS else 0.0
    follows = share > FOLLOWS or share > max(CLEARLY * chance, MIN_FOLLOWED)
    return {
        "lag": lag,
        "share": share,
        "chance": float(chance),
        "power": power,
        "follows": bool(follows),
        "coefficients": coefficients,
    }


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
    pairs = zip(motion.noise, blur(motion))
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


class Clock(NamedTuple):
    """Another clock by which commands explain the motion."""

    lag: float  # time from a command to the motion, in the middle of the run [s]
    rate: float  # change of the lag per second [s/s]
    # gives by how many standard errors it explains more than one clock and slow motors
    evidence: Callable[[], float]


def clocks(recording: Recording) -> List[Clock]:
    """The Clock that explains the accelerations best with a drift, and the one without; none where the
    commands explain little."""
    motion = recording.motion
    inside = np.flatnonzero(middle(motion))
    inside = inside[:: 1 + len(inside) // CLOCK_SAMPLES]
    if len(inside) < MIN_SAMPLES:
        return []
    times, base = motion.times[inside], np.linalg.qr(smooth_terms(motion.nu[inside]))[0]
    wanted = _clipped(accelerations(motion)[inside])
    wanted = wanted - base @ (base.T @ wanted)
    if not (wanted**2).sum() > 0:
        return []
    wanted /= np.maximum(wanted.std(axis=0), 1e-12)
    centre, motors = 0.5 * (times[0] + times[-1]), _Motors(recording)

    def left(lag: float, rate: float, tau: float = 0.0) -> Array:
        """What commands leave of the accelerations, by sample (n,)."""
        at = times - rate * (times - centre) - lag
        commands = motors.lagged(at, tau)
        commands = commands - base @ (base.T @ commands)
        rest = wanted - commands @ np.linalg.lstsq(commands, wanted, rcond=None)[0]
        return np.asarray((rest**2).sum(axis=1))

    known: Dict[Tuple[float, float], float] = {}

    def size(way: Tuple[float, float]) -> float:
        if way not in known:
            known[way] = float(left(*way).sum())
        return known[way]

    def least(lags: Array, rate: float) -> Array:
        """The least that commands leave at some lags, with slow motors as well."""
        return np.asarray(min((left(lag, rate, tau) for tau in TAUS for lag in lags), key=np.sum))

    def evidence(lag: float, rate: float) -> float:
        honest = least(HONEST_LAGS, 0.0)
        if rate:  # a constant lag at the same place is no drift
            honest = min(honest, least(lag + np.arange(-0.15, 0.151, 0.01), 0.0), key=np.sum)
        gain = np.array_split(honest - least(np.array([lag]), rate), BLOCKS)
        blocks = np.array([block.sum() for block in gain])
        error = blocks.std(ddof=1) / np.sqrt(BLOCKS)
        return float(blocks.mean() / error) if error > 0 else 0.0

    found = []
    for lags, rates in ((DRIFT_LAGS, RATES), (FAR_LAGS, np.zeros(1))):
        drifts = len(rates) > 1
        if drifts and np.ptp(times) < MIN_DRIFTING:
            continue
        best = min(itertools.product(lags.tolist(), rates.tolist()), key=size)
        for step in 0.5 ** np.arange(5) * drifts:
            around = itertools.product((-0.05, -0.025, 0, 0.025, 0.05), (-0.002, -0.001, 0, 0.001, 0.002))
            best = min(((best[0] + step * a, best[1] + step * b) for a, b in around), key=size)
        if 1 - size(best) / (wanted**2).sum() < MIN_SHARE:
            continue
        lag, rate = best
        found.append(Clock(lag, rate, functools.partial(evidence, lag, rate)))
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


def _clipped(values: Array) -> Array:
    """Columns (n, k) without outliers."""
    centre = np.median(values, axis=0)
    scatter = 1.4826 * np.median(np.abs(values - centre), axis=0)
    return np.asarray(np.clip(values, centre - OUTLIER * scatter, centre + OUTLIER * scatter))


@dataclass(frozen=True)
class Rest:
    """Accelerations and commands without what velocities, constant wrenches and the floor's slope explain,
    at the same instants."""

    times: Array  # (n,) [s]
    accelerations: Array  # (n, 3) specific force [m/s^2], yaw acceleration [rad/s^2]
    commands: Array  # (n, k)


def rest(recording: Recording, names: Sequence[str], twisted: bool = False) -> Optional[Rest]:
    """The Rest of a motion and the commands of some channels that it follows; None without samples.
    twisted: in the frame of a body whose heading is minus the measured one."""
    motion, sent = recording.motion, recording.control_times
    inside = middle(motion) & (motion.times > sent[0]) & (motion.times < sent[-1])
    times, psi, nu = motion.times[inside], motion.eta[inside, 2], motion.nu[inside]
    if not len(times):
        return None
    wanted = accelerations(motion)[inside]
    if twisted:
        psi = -psi
        wanted, nu = (_turned(rows, -2 * psi) * [1, 1, -1] for rows in (wanted, nu))
    level = np.column_stack([np.cos(psi), np.sin(psi)])  # a slope in the body's frame
    base = np.linalg.qr(np.column_stack([smooth_terms(nu), level]))[0]
    commands = commands_at(recording, recording.commands_of(names), times - lag_of(recording))
    found = np.column_stack([_clipped(wanted), commands])
    found = found - base @ (base.T @ found)
    return Rest(times, found[:, :3], found[:, 3:])


def _turned(rows: Array, angle: Array) -> Array:
    """Rows (n, 3) with their first two columns turned by an angle (n,)."""
    turned = (rows[:, 0] + 1j * rows[:, 1]) * np.exp(1j * angle)
    return np.column_stack([turned.real, turned.imag, rows[:, 2]])


def authorities(recording: Recording) -> Document:
    """What each thruster does to the craft at full input, by its name: forward and right, along the measured
    body's axes [m/s^2], turn, clockwise from above [rad/s^2], and their standard errors, those of a jackknife
    over blocks of time. Empty if the commands do not distinguish the thrusters."""
    motion, sent = recording.motion, recording.control_times
    inside = middle(motion) & (motion.times > sent[0]) & (motion.times < sent[-1])
    others, wanted = smooth_terms(motion.nu[inside]), _clipped(accelerations(motion)[inside])
    if len(wanted) < MIN_SAMPLES:
        return {}
    commands = commands_at(recording, recording.thrust, motion.times[inside] - lag_of(recording))
    base = np.linalg.qr(others)[0]
    sizes = np.linalg.svd(commands - base @ (base.T @ commands), compute_uv=False)
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
    accelerations are excluded."""
    motion = recording.motion
    sizes = _clipped(accelerations(motion)[middle(motion)]).std(axis=0)
    return all(
        abs(effect[key]) + EXCLUDED * error < size
        for effect in authorities(recording).values()
        for key, error, size in zip(("forward", "right", "turn"), effect["errors"], sizes)
    )
