"""How the motion of a craft replies to its commands."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, List, NamedTuple, Optional, Sequence, Tuple, TypedDict

import numpy as np

from ground.annotations import Array, Flags, Indices
from ground.recordings.repair import MAX_GAP, Motion

if TYPE_CHECKING:
    from ground.recordings.recording import Recording

LAGS = np.arange(-0.3, 0.41, 0.01)  # tried lags of the motion behind the commands [s]
FAR_LAGS = np.arange(-5.0, 5.01, 0.02)  # where clocks differ [s]
FAR_SHARE = 0.3  # least share of the accelerations that the commands explain at such a lag
FAR_SAMPLES = 2000  # samples of motion to find it from
LAG_SAMPLES = 20000  # samples, spread over the recording, that determine the lag
MIN_FOLLOWING = 200  # samples that lags are found from
TAUS = (0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3)  # tried time constants of motors [s]
RATES = np.arange(-0.012, 0.0121, 0.002)  # tried drifts of clocks [s/s]
DRIFT_LAGS = np.arange(-0.4, 0.61, 0.05)  # tried beside them, in the middle of a run [s]
DRIFT_AROUND = np.arange(-0.15, 0.151, 0.01)  # tried around the best one in each part of a run [s]
DRIFT_PART = 4.0  # length of the parts [s]
DRIFT_SHARE = 0.2  # least share of the accelerations that the commands explain at the best rate
MIN_DRIFTING = 16.0  # length of a run from which a drift is looked for [s]
BLOCKS = 10  # blocks of time that errors are estimated from
USUAL_LAG = 0.1  # if the motion does not determine it [s]
ALIKE = 1e-2  # commands whose singular values are in a smaller ratio do not distinguish channels
OUTLIER = 6.0  # accelerations further from their median than so many scatters are cut


class Reply(TypedDict):
    """How accelerations follow from the commands."""

    lag: float  # lag of the motion behind the commands [s]
    share: float  # share of the accelerations that the commands explain
    coefficients: Array  # (n + 11, 3) of the thrusters, and _smooth_terms


def stretches(times: Array, inside: Flags) -> List[Indices]:
    """Indices of the samples inside, split at gaps."""
    index = np.flatnonzero(inside)
    if not len(index):
        return []
    return np.split(index, np.flatnonzero(np.diff(times[index]) > MAX_GAP) + 1)


def commands_at(recording: "Recording", times: Array) -> Array:
    """Commands of the thrusters that hold at some times (n,) [s]; 0 before the first one."""
    return held(recording, recording.thrust, times)


def held(recording: "Recording", values: Array, times: Array) -> Array:
    """The values (m, ...) of the commands that hold at some times [s]; 0 before the first command."""
    at = np.searchsorted(recording.control_times, times, side="right") - 1
    found = np.asarray(values[np.maximum(at, 0)])
    found[at < 0] = 0
    return found


def accelerations(motion: Motion) -> Array:
    """Specific force in the body's frame (n, 2) [m/s^2] and yaw acceleration [rad/s^2], (n, 3)."""
    u, v, r = motion.nu.T
    turning = np.column_stack([-r * v, r * u, 0 * r])
    return np.asarray(motion.nu_dot + turning)


def find(recording: "Recording", motion: Motion) -> Optional[Reply]:
    """Linear regression of the accelerations on the commands, at the lag that fits best.

    It needs no knowledge of the body's axes and drag: it regresses all accelerations on all commands
    and on products of the velocities. None when the commands explain less than 10%.
    """
    inside = middle(motion.times)
    times = motion.times[inside]
    if len(times) < 50 or np.ptp(recording.thrust, axis=0).max() < 1e-6:
        return None
    wanted = accelerations(motion)[inside]
    scale = 1.4826 * np.median(np.abs(wanted - np.median(wanted, axis=0)), axis=0) + 1e-9
    others = smooth_terms(motion.nu[inside])

    def regression(lag: float, some: slice = slice(None)) -> Tuple[float, Array]:
        X = np.column_stack([commands_at(recording, times[some] - lag), others[some]])
        coefficients = np.linalg.lstsq(X, wanted[some], rcond=None)[0]
        return np.abs((wanted[some] - X @ coefficients) / scale).mean(), coefficients

    spread = slice(None, None, 1 + len(times) // LAG_SAMPLES)
    lag = LAGS[int(np.argmin([regression(lag, spread)[0] for lag in LAGS]))]
    misfit, coefficients = regression(lag)
    without = np.linalg.lstsq(others, wanted, rcond=None)[0]
    share = 1 - misfit / np.abs((wanted - others @ without) / scale).mean()
    if share < 0.1:
        return None
    return {"lag": float(lag), "share": float(share), "coefficients": coefficients}


def smooth_terms(nu: Array) -> Array:
    """Regressors of the accelerations besides the commands, (n, 11)."""
    u, v, r = nu.T
    return np.column_stack(
        [np.ones(len(nu)), u, v, r, u * u, v * v, r * r, u * v, u * r, v * r, r * np.abs(r)]
    )


def middle(times: Array, margin: float = 0.06) -> Flags:
    """Samples away from the ends of stretches, where smoothed accelerations are inaccurate."""
    inside = np.zeros(len(times), bool)
    for stretch in stretches(times, np.ones(len(times), bool)):
        start, end = times[stretch[0]], times[stretch[-1]]
        inside[stretch] = (times[stretch] > start + margin) & (times[stretch] < end - margin)
    return inside


def changes(recording: "Recording") -> Indices:
    """Indices of the commands of thrusters after which others hold."""
    thrust = recording.thrust
    return np.flatnonzero((np.abs(np.diff(thrust, axis=0)) > 1e-6).any(axis=1))


@dataclass(frozen=True)
class _Following:
    """Samples of a motion, to compare it with commands that are earlier by some lag."""

    recording: "Recording"
    times: Array  # (n,) [s]
    wanted: Array  # (n, 3) accelerations without what the velocities explain, each of variance 1
    base: Array  # (n, 13) orthonormal, what the velocities explain

    @classmethod
    def of(cls, recording: "Recording", motion: Motion) -> Optional["_Following"]:
        """Of FAR_SAMPLES samples at most; None where there are few or the craft rests."""
        inside = middle(motion.times)
        spread = slice(None, None, 1 + int(inside.sum()) // FAR_SAMPLES)
        times, nu = motion.times[inside][spread], motion.nu[inside][spread]
        if len(times) < MIN_FOLLOWING:
            return None
        base = np.linalg.qr(smooth_terms(nu))[0]
        wanted = _clipped(accelerations(motion)[inside][spread])
        wanted = wanted - base @ (base.T @ wanted)
        if not (wanted**2).sum() > 0:
            return None
        return cls(recording, times, wanted / np.maximum(wanted.std(axis=0), 1e-12), base)

    def left(self, times: Array, tau: float = 0.0) -> Array:
        """What the commands at some times (n,) [s], after a first-order lag, leave of the accelerations:
        (n, 3)."""
        commands = _lagged(self.recording, times, tau) if tau else commands_at(self.recording, times)
        commands = commands - self.base @ (self.base.T @ commands)
        by_commands = np.linalg.lstsq(commands, self.wanted, rcond=None)[0]
        return np.asarray(self.wanted - commands @ by_commands)

    def share(self, times: Array, tau: float = 0.0) -> float:
        """Share of the accelerations that those commands explain."""
        return 1 - float((self.left(times, tau) ** 2).mean() / (self.wanted**2).mean())

    @property
    def middle(self) -> float:
        """The middle of the run [s]."""
        return 0.5 * float(self.times[0] + self.times[-1])

    def at_rate(self, rate: float) -> Array:
        """The times (n,) [s] on a clock that runs slower by a rate [s/s], set in the middle of the run."""
        return np.asarray(self.times - rate * (self.times - self.middle))

    def least(self, rate: float, lags: Array) -> Array:
        """The least sum of squares, by sample (n,), that commands leave of the accelerations on a clock of
        that rate: at the best of some lags (m,) [s] and of the time constants TAUS."""
        times = self.at_rate(rate)
        left = ((self.left(times - lag, tau) ** 2).sum(axis=1) for tau in TAUS for lag in lags)
        return np.asarray(min(left, key=np.sum))


def far_lag(recording: "Recording", motion: Motion) -> Optional[float]:
    """The lag [s] of the motion after the commands where it is further off than `find` looks; None where
    the commands explain little at every lag."""
    following = _Following.of(recording, motion)
    if following is None:
        return None
    shares = [following.share(following.times - lag) for lag in FAR_LAGS]
    best = int(np.argmax(shares))
    return float(FAR_LAGS[best]) if shares[best] > FAR_SHARE else None


class Drift(NamedTuple):
    """How the lag of a motion behind its commands changes."""

    rate: float  # change of the lag per second [s/s]
    error: float  # its standard error
    lag: float  # in the middle of the run [s]


def drift(recording: "Recording", motion: Motion) -> Drift:
    """The Drift of a run; of rate 0 where the run is too short or the motion does not follow the commands.

    For each rate, commands are taken at times that run at it. The share that they explain then has a peak;
    the scatter of the best rates of parts of the run gives its error.
    """
    following = _Following.of(recording, motion)
    if following is None or np.ptp(following.times) < MIN_DRIFTING:
        return Drift(0.0, np.inf, 0.0)
    times = following.times
    shares = {
        (lag, rate): following.share(following.at_rate(rate) - lag)
        for rate in RATES
        for lag in DRIFT_LAGS
    }
    coarse = max(shares, key=lambda way: shares[way])
    if shares[coarse] < DRIFT_SHARE:
        return Drift(0.0, np.inf, 0.0)
    straight = following.at_rate(coarse[1])
    part = ((times - times[0]) / DRIFT_PART).astype(int)
    lags = coarse[0] + DRIFT_AROUND
    losses = np.array([(following.left(straight - lag) ** 2).sum(axis=1) for lag in lags])
    parts = [i for i in np.unique(part) if (part == i).sum() > MIN_FOLLOWING // 4]
    if len(parts) < 2:  # too few samples in each, in a run of several minutes
        return Drift(0.0, np.inf, 0.0)
    best = np.array([lags[int(np.argmin(losses[:, part == i].sum(axis=1)))] for i in parts])
    at = np.array([times[part == i].mean() for i in parts]) - following.middle
    slopes = [(best[j] - best[i]) / (at[j] - at[i]) for j in range(len(at)) for i in range(j)]
    slope = float(np.median(slopes))  # Theil 1950, Sen 1968
    rest = best - slope * at
    scatter = 1.4826 * np.median(np.abs(rest - np.median(rest))) + np.diff(lags).max()
    error = float(scatter / np.sqrt(((at - at.mean()) ** 2).sum()))
    return Drift(coarse[1] + slope, error, float(coarse[0]))


def drift_evidence(recording: "Recording", motion: Motion, found: Drift) -> float:
    """By how many standard errors a lag that drifts explains more than a constant one."""
    return _evidence(recording, motion, found.lag + DRIFT_AROUND, found.lag + DRIFT_AROUND, found.rate)


def lag_evidence(recording: "Recording", motion: Motion, lag: float, delays: Array) -> float:
    """By how many standard errors a lag [s] explains more than any of some delays (n,) [s]."""
    return _evidence(recording, motion, np.array([lag]), delays)


def _evidence(
    recording: "Recording", motion: Motion, suspected: Array, honest: Array, rate: float = 0.0
) -> float:
    """By how many standard errors commands on another clock explain more of the accelerations than those
    on the motion's own. 0 where there are too few samples.

    suspected: lags that are tried on the other clock [s], which runs at a rate [s/s]; honest: lags on the
    motion's own. Slow motors are tried with both. A large share alone is no evidence: where a controller
    closes the loop, commands follow the motion, and oscillations of a slow craft make them alike at lags
    that no clock has caused. The difference of the two in blocks of time shows whether one wins throughout.
    """
    following = _Following.of(recording, motion)
    if following is None:
        return 0.0
    gain = following.least(0.0, honest) - following.least(rate, suspected)
    blocks = np.array([block.sum() for block in np.array_split(gain, BLOCKS)])
    error = blocks.std(ddof=1) / np.sqrt(BLOCKS)
    return float(blocks.mean() / error) if error > 0 else 0.0


def _lagged(recording: "Recording", times: Array, tau: float) -> Array:
    """Commands of the thrusters after a first-order lag of time constant tau [s], at times (n,) [s]."""
    begins, thrust = recording.control_times, recording.thrust
    reached = np.zeros_like(thrust)  # by the lag when each command begins
    for i, decay in enumerate(np.exp(-np.diff(begins) / tau), 1):
        reached[i] = thrust[i - 1] + (reached[i - 1] - thrust[i - 1]) * decay
    at = np.searchsorted(begins, times, side="right") - 1
    since = np.exp(-np.maximum(times - begins[np.maximum(at, 0)], 0) / tau)[:, None]
    held = thrust[np.maximum(at, 0)]
    found = held + (reached[np.maximum(at, 0)] - held) * since
    found[at < 0] = 0
    return np.asarray(found)


def _rotated(vectors: Array, angle: Array) -> Array:
    """Vectors (n, 2), each turned by its angle (n,)."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = vectors.T
    return np.column_stack([c * x - s * y, s * x + c * y])


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


def rest(
    recording: "Recording",
    motion: Motion,
    lag: float,
    names: Sequence[str],
    twisted: bool = False,
) -> Rest:
    """The Rest of a motion that follows the commands of some channels by a lag [s]; twisted: in the frame
    of a body whose heading is minus the measured one."""
    inside = middle(motion.times)
    sent = (motion.times > recording.control_times[0]) & (motion.times < recording.control_times[-1])
    inside &= sent
    times, psi, nu = motion.times[inside], motion.eta[inside, 2], motion.nu[inside]
    wanted = accelerations(motion)[inside]
    if twisted:
        psi, signs = -psi, np.array([1, 1, -1])
        wanted, nu = (_turned(v, -2 * psi) * signs for v in (wanted, nu))
    level = np.column_stack([np.cos(psi), np.sin(psi)])  # a slope in the body's frame
    base = np.linalg.qr(np.column_stack([smooth_terms(nu), level]))[0]
    commands = held(recording, recording.commands_of(names), times - lag)
    found = np.column_stack([_clipped(wanted), commands])
    found = found - base @ (base.T @ found)
    return Rest(times, found[:, :3], found[:, 3:])


def _turned(rows: Array, angle: Array) -> Array:
    """Rows (n, 3) with their first two columns turned by an angle (n,)."""
    return np.column_stack([_rotated(rows[:, :2], angle), rows[:, 2]])


@dataclass(frozen=True)
class Authority:
    """What a thruster does to a craft at full input, with standard errors."""

    forward: float  #: [m/s^2], along the measured body's x axis
    right: float  #: [m/s^2], along its y axis
    turn: float  #: [rad/s^2], clockwise from above
    errors: Tuple[float, float, float]


def authorities(recording: "Recording", motion: Motion, lag: Optional[float]) -> List[Authority]:
    """The Authority of each thruster, by the accelerations that follow its commands by a lag [s]; empty
    if the commands do not distinguish the thrusters."""
    inside = middle(motion.times)
    times = motion.times[inside]
    sent = (times > recording.control_times[0]) & (times < recording.control_times[-1])
    times = times[sent]
    commands = commands_at(recording, times - (USUAL_LAG if lag is None else lag))
    wanted = _clipped(accelerations(motion)[inside][sent])
    others = smooth_terms(motion.nu[inside][sent])
    if len(times) < 20 * others.shape[1]:
        return []
    base = np.linalg.qr(others)[0]
    sizes = np.linalg.svd(commands - base @ (base.T @ commands), compute_uv=False)
    if not sizes[-1] > ALIKE * sizes[0]:
        return []
    count = commands.shape[1]
    X = np.column_stack([commands, others])

    def fit(some: Flags) -> Array:
        return np.asarray(np.linalg.lstsq(X[some], wanted[some], rcond=None)[0][:count])

    block = np.arange(len(times)) * BLOCKS // len(times)
    without = np.array([fit(block != b) for b in range(BLOCKS)])
    spread = ((without - without.mean(axis=0)) ** 2).sum(axis=0)
    errors = np.sqrt((BLOCKS - 1) / BLOCKS * spread)
    return [
        Authority(float(f), float(r), float(t), (float(e[0]), float(e[1]), float(e[2])))
        for (f, r, t), e in zip(fit(block >= 0), errors)
    ]
