"""How the motion of a craft replies to its commands."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, List, Optional, Sequence, Tuple, TypedDict

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
    at = np.searchsorted(recording.control_times, times, side="right") - 1
    commands = np.asarray(recording.thrust[np.maximum(at, 0)])
    commands[at < 0] = 0
    return commands


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


def far_lag(recording: "Recording", motion: Motion) -> Optional[float]:
    """The lag [s] of the motion after the commands where it is further off than `find` looks; None where
    the commands explain little at every lag."""
    inside = middle(motion.times)
    times, wanted = motion.times[inside], accelerations(motion)[inside]
    others = smooth_terms(motion.nu[inside])
    spread = slice(None, None, 1 + len(times) // FAR_SAMPLES)
    if len(times[spread]) < 200:
        return None
    base = np.linalg.qr(others[spread])[0]
    rest = _clipped(wanted[spread])
    rest = rest - base @ (base.T @ rest)
    shares = []
    for lag in FAR_LAGS:
        commands = commands_at(recording, times[spread] - lag)
        commands = commands - base @ (base.T @ commands)
        by_commands = np.linalg.lstsq(commands, rest, rcond=None)[0]
        left = rest - commands @ by_commands
        shares.append(1 - float(np.mean((left**2).sum(axis=0) / (rest**2).sum(axis=0))))
    best = int(np.argmax(shares))
    return float(FAR_LAGS[best]) if shares[best] > FAR_SHARE else None


@dataclass(frozen=True)
class Samples:
    """What tells how accelerations follow from the commands of a left and a right thruster."""

    psi: Array  # (n,) [rad]
    nu: Array  # (n, 3) u, v [m/s], r [rad/s] in the measured body's frame
    accelerations: Array  # (n, 3) specific force [m/s^2] and yaw acceleration [rad/s^2]
    left: Array  # (n,) commands that act then
    right: Array

    def turned(self, heading: int, yaw: int) -> Tuple[Array, Array, Array, Array]:
        """Force (n, 2), yaw acceleration, left and right (n,) without what velocities explain, in the
        frame of a body whose heading is `heading` times the measured one and turns `yaw` times."""
        force, velocity = self.accelerations[:, :2], self.nu[:, :2]
        if heading < 0:
            force, velocity = (_rotated(v, 2 * self.psi) for v in (force, velocity))
        others = smooth_terms(np.column_stack([velocity, yaw * self.nu[:, 2]]))
        base = np.linalg.qr(others)[0]
        columns = np.column_stack(
            [_clipped(force), yaw * _clipped(self.accelerations[:, 2:]), self.left, self.right]
        )
        rest = columns - base @ (base.T @ columns)
        return rest[:, :2], rest[:, 2], rest[:, 3], rest[:, 4]


def samples(recording: "Recording", motion: Motion, lag: float) -> Samples:
    """The Samples of a motion that follows its commands by a lag [s]."""
    inside = middle(motion.times)
    times = motion.times[inside]
    at = np.searchsorted(recording.control_times, times - lag, side="right") - 1
    commands = recording.commands_of(("left", "right"))[np.maximum(at, 0)]
    commands[at < 0] = 0
    return Samples(
        motion.eta[inside, 2],
        motion.nu[inside],
        accelerations(motion)[inside],
        commands[:, 0],
        commands[:, 1],
    )


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
    """Accelerations and commands without what the velocities explain, at the same instants."""

    accelerations: Array  # (n, 3) specific force [m/s^2], yaw acceleration [rad/s^2]
    commands: Array  # (n, k)


def rest(
    recording: "Recording", motion: Motion, lag: Optional[float], names: Sequence[str]
) -> Rest:
    """The Rest of a motion that follows the commands of some channels by a lag [s]."""
    inside = middle(motion.times)
    times = motion.times[inside]
    sent = (times > recording.control_times[0]) & (times < recording.control_times[-1])
    at = np.searchsorted(
        recording.control_times, times[sent] - (USUAL_LAG if lag is None else lag), side="right"
    )
    commands = recording.commands_of(names)[np.maximum(at - 1, 0)]
    commands[at < 1] = 0
    base = np.linalg.qr(smooth_terms(motion.nu[inside][sent]))[0]
    found = np.column_stack([_clipped(accelerations(motion)[inside][sent]), commands])
    found = found - base @ (base.T @ found)
    return Rest(found[:, :3], found[:, 3:])


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
