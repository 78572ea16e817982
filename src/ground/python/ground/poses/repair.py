"""Repair of a recording's poses; repairs are counted."""

from dataclasses import dataclass, field
from typing import Dict, List, Optional, Tuple

import numpy as np

from ground import _core
from ground.poses import angles, frame_clock, headings, scatter
from ground.poses.low_pass import LowPass
from ground.support.annotations import Array, Flags, Indices
from ground.support.errors import GroundError

CLOCK_OFFSET = 0.05  # least offset between the topics' clocks that is corrected [s]
FROZEN = 3  # least number of equal poses in a row that are a repeated sample, if the craft moves
RARE = 0.01  # expected number of equal poses by chance, below which all are repeated samples
HELD = 0.2  # least share of positions that repeat the last one of a table that is faster than the fixes
QUANTA = 4.0  # a craft that moves by more than so many roundings between two positions moves in each row
FEWEST_FAST = 10  # positions of such a craft that show whether a table repeats them
APART = 0.1  # stamps of a burst are not further apart [usual intervals]
AROUND = 2  # poses before and after a burst that give its direction
MIN_WAY = 20.0  # shortest way along which a burst is sorted [standard deviations]
MIN_GAIN = 50.0  # least fall of the roughness for a new order
MAX_RATIO = 0.5  # largest roughness of a new order, relative to the old one
GATE = 8.0  # poses further off than this many standard deviations are spikes
MIN_POSES = 10  # of a recording; intervals between poses in a window
BESIDE = 6  # poses before and after one that it is compared with
ODD = 10.0  # least distance of an outlier from its neighbours' motion [usual distances around]
MAX_SPEED_RATIO = 2.0  # largest velocity [largest one of the sound stretches]


@dataclass
class Motion:
    """Repaired poses in ascending order of time, and velocities smoothed from them."""

    times: Array  # (n,) [s], on the clock of the commands
    measured: Array  # (n, 3) repaired x, y [m], psi unwrapped [rad]
    eta: Array  # (n, 3) the same, smoothed
    nu: Array  # (n, 3) body velocities u, v [m/s], r [rad/s]
    nu_dot: Array  # (n, 3) their derivatives [m/s^2], [rad/s^2]
    noise: scatter.Levels  # standard deviations of the poses [m], [rad]
    scales: _core.RunScales  # longest gap, and jerk by which the poses were smoothed
    jumps: Flags  # (n,) where the motion restarts although no pose is missing
    spikes: Array  # (k,) times of the poses that no smooth motion explains, which are left out [s]
    clock: Optional[frame_clock.FrameClock]  # if the frames' instants were rebuilt
    repairs: Dict[str, float] = field(default_factory=dict)  # kind of repair -> how often
    heading_steps: headings.Steps = field(default_factory=list)  # steps of the heading that were undone
    breaks: List[float] = field(default_factory=list)  # where another run begins [s]
    low_pass: Optional[LowPass] = None  # of the mocap's software, if it was undone


def on_commands_clock(times: Array, offset: float) -> Array:
    """Stamps of poses [s] on the clock of the commands, which is off by `offset` [s]."""
    return times + offset if abs(offset) > CLOCK_OFFSET else times


def repair(
    name: str,
    stamps: Array,
    measured: Array,
    clock_offset: float = 0.0,
    noise: Optional[scatter.Levels] = None,
    frame_rate: Optional[float] = None,
    low_pass: Optional[LowPass] = None,
) -> Motion:
    """The repaired motion of poses (n, 3) with stamps (n,) [s], in the order of arrival; clock_offset: see
    Recording; noise: of positions [m] and headings [rad], by default the scatter of the poses; frame_rate:
    of a camera whose stamps are late [Hz], by default estimated from stamps and motion; low_pass: of the
    mocap, which is undone. GroundError names the run when too little of it is left."""
    repairs: Dict[str, float] = {}
    times = on_commands_clock(stamps, clock_offset)
    if abs(clock_offset) > CLOCK_OFFSET:
        repairs["poses shifted to the clock of the commands [s]"] = clock_offset
    repairs["stamps put in order"] = int((np.diff(times) < 0).sum())
    order = np.argsort(times, kind="stable")
    times, eta = times[order], measured[order].copy()
    keep = _distinct(times, eta, repairs)
    times, eta = times[keep], eta[keep]
    if len(times) < MIN_POSES:
        raise GroundError("%s: only %d distinct poses" % (name, len(times)))
    rough = scatter.in_order(np.column_stack([eta[:, :2], np.unwrap(eta[:, 2])]))
    eta, repairs["poses that overtook each other put in order"] = _in_order(times, eta, rough)
    eta[:, 2], repairs["headings mirrored back"] = headings.unmirrored(eta[:, 2])
    clock = frame_clock.rebuild(times, np.column_stack([eta[:, :2], np.unwrap(eta[:, 2])]), rough, frame_rate)
    if clock is not None:
        repairs["stamps replaced by the frame clock"] = len(times)
        times = clock.times
    outliers = _outliers(times, eta, rough)
    spikes, times, eta = times[outliers], times[~outliers], eta[~outliers]
    eta[:, 2] = np.unwrap(eta[:, 2])
    speeds = scatter.largest_speeds(times, eta)
    eta[:, 2], heading_steps, breaks = headings.turned_back(times, eta, speeds[1])
    if low_pass is not None:
        times, eta = low_pass.undone(times, eta)
        speeds = scatter.largest_speeds(times, eta)
    max_gap = scatter.longest_gap(times, speeds[1])
    found, jerks, excess = scatter.levels(times, eta, max_gap, speeds)
    scales = _core.RunScales(max_gap, *jerks)
    noise = noise or found
    smoothed = smooth(times, eta, noise, scales, GATE * excess, speeds)
    used = np.asarray(smoothed["used"], bool) & ~_too_fast(smoothed["nu"], speeds)
    if used.sum() < MIN_POSES:
        raise GroundError("%s: only %d poses follow a motion of the craft" % (name, used.sum()))
    spikes = np.sort(np.append(spikes, times[~used]))
    jumps = (np.asarray(smoothed["starts"], bool) & (np.diff(times, prepend=-np.inf) <= max_gap))[used]
    moved, nu, nu_dot = (smoothed[key][used] for key in ("eta", "nu", "nu_dot"))
    times, eta = times[used], eta[used]
    eta[:, 2] = moved[:, 2] + angles.wrap(eta[:, 2] - moved[:, 2])
    return Motion(
        times, eta, moved, nu, nu_dot, noise, scales, jumps, spikes, clock, repairs, heading_steps, breaks,
        low_pass,
    )  # fmt: skip


def smooth(
    times: Array,
    eta: Array,
    noise: scatter.Levels,
    scales: _core.RunScales,
    gate: float = GATE,
    speeds: Optional[scatter.Levels] = None,
) -> Dict[str, Array]:
    """_core.smooth for poses with this noise (position [m], heading [rad]) and of these scales; gate:
    [standard deviations] beyond which a pose is a spike; speeds: largest ones of sound stretches [m/s],
    [rad/s]."""
    params = _core.EstimatorParams()
    params.position_noise, params.heading_noise = noise
    params.linear_jerk, params.angular_jerk = scales.linear_jerk, scales.angular_jerk
    params.gate, params.max_gap = gate, scales.max_gap
    if speeds is not None:
        (params.linear_speed, params.angular_speed), params.most = speeds, MAX_SPEED_RATIO
    found: Dict[str, Array] = _core.smooth(times, eta, params)
    return found


def again(run: _core.RunData, poses: Array) -> Dict[str, Array]:
    """_core.smooth for other poses (n, 3) at the times of a run, as its own were smoothed."""
    return smooth(run.times, poses, (run.noise[0], run.noise[2]), run.scales)


def _outliers(times: Array, eta: Array, noise: Array) -> Flags:
    """Poses (n, 3) whose place or heading a smooth motion of their neighbours does not explain: Hampel's test
    (1974) of the median distance to what the neighbours' usual velocity makes of them, by the stamps (n,) [s]
    or by the order of the poses."""
    steps = np.diff(eta, axis=0)
    steps[:, 2] = angles.wrap(steps[:, 2])
    lasted = np.maximum(np.diff(times), 0.1 * scatter.interval(times))[:, None]
    by_order, by_time = (scatter.running_median(rows, BESIDE) for rows in (steps, steps / lasted))
    by_order, by_time = (np.vstack([rows, rows[-1:]]) for rows in (by_order, by_time))
    index = np.arange(len(times))
    places, turns, sides = [], [], []
    for other in scatter.around(index, BESIDE).T:
        gone = by_order * (other - index)[:, None], by_time * (times[other] - times)[:, None]
        off = eta[other] - eta - np.stack(gone)
        places.append(np.linalg.norm(off[..., :2], axis=-1).min(axis=0))
        turns.append(np.abs(angles.wrap(off[..., 2])).min(axis=0))
        sides.append((off[0, :, 0] + 1j * off[0, :, 1], np.exp(1j * off[0, :, 2])))
    found = np.zeros(len(times), bool)
    for i, (distances, least) in enumerate(((places, noise[0]), (turns, noise[2]))):
        distance = np.median(distances, axis=0)
        usual = scatter.running_median(distance, 2 * BESIDE)
        before, after = (np.mean([side[i] for side in part], axis=0) for part in (sides[:3], sides[-3:]))
        gone, own = np.abs(after - before), (np.abs(before), np.abs(after))
        if i == 1:
            gone, own = (
                np.abs(np.angle(after * before.conj())),
                (np.abs(np.angle(before)), np.abs(np.angle(after))),
            )
        on_the_way = gone > np.minimum(*own)  # of a move that takes a few poses
        found |= (distance > np.maximum(ODD * usual, GATE * least)) & ~on_the_way
    return found


def _too_fast(nu: Array, speeds: scatter.Levels) -> Flags:
    """Which of the velocities nu (n, 3) are beside one that the sound stretches, with these largest speeds,
    rule out."""
    size = np.column_stack([np.hypot(nu[:, 0], nu[:, 1]), np.abs(nu[:, 2])])
    beyond = (size > MAX_SPEED_RATIO * np.sqrt([2, 1]) * speeds).any(axis=1)
    return np.asarray(scatter.around(beyond, BESIDE).any(axis=1))


def _distinct(times: Array, eta: Array, repairs: Dict[str, float]) -> Flags:
    """Which poses are not repeated, neither with the same stamp nor while the craft moves."""
    same = np.concatenate([[False], (np.diff(eta, axis=0) == 0).all(axis=1)])
    again = same & np.concatenate([[False], np.diff(times) == 0])
    repairs["duplicates dropped"] = int(again.sum())
    frozen = np.zeros(len(times), bool)
    starts = np.flatnonzero(~same)
    # Up to so many equal poses in a row are repeated samples, whether the craft moves or not; longer ones may
    # be a mocap's rest.
    repeated = scatter.BRIDGED if _by_chance(eta[~same]) * len(eta) < RARE else 0
    ends = np.append(starts[1:], len(times))
    moves = np.linalg.norm(np.diff(eta[:, :2], axis=0), axis=1)
    typical = np.median(moves[moves > 0]) if (moves > 0).any() else np.inf
    for start, end in zip(starts, ends):
        jumps = end < len(times) and moves[end - 1] > 2 * typical
        if (end - start >= FROZEN and jumps) or end - start <= repeated:
            frozen[start + 1 : end] = True
    held = _held(eta) & ~again & ~frozen
    repairs["frozen poses dropped"] = int((frozen & ~again).sum())
    repairs["positions held between fixes left out"] = int(held.sum())
    return np.asarray(~(again | frozen | held))


def _by_chance(eta: Array) -> float:
    """How likely it is that a pose equals the one before by rounding, although it was measured anew."""
    unwrapped = np.column_stack([eta[:, :2], np.unwrap(eta[:, 2])])
    quantum, noise = scatter.resolution(unwrapped) * np.sqrt(12), scatter.in_order(unwrapped)
    return float(np.prod(np.minimum(1, quantum / (2 * np.sqrt(np.pi) * noise))))


def _held(eta: Array) -> Flags:
    """Which poses only repeat a position, because a table has more rows than there are fixes."""
    same = np.concatenate([[False], (np.diff(eta[:, :2], axis=0) == 0).all(axis=1)])
    begins = np.flatnonzero(~same)
    lengths = np.diff(np.append(begins, len(eta)))
    usual = np.median(np.repeat(lengths, lengths))  # of the stay that a pose is in
    if not 1 < usual < FROZEN * 4 or len(begins) < 10:
        return np.zeros(len(eta), bool)
    steps = np.abs(np.diff(eta[begins, :2], axis=0))
    quantum = scatter.resolution(eta)[:2] * np.sqrt(12)
    # A slow craft that is measured in whole millimetres moves by one of them at a time: only where it is
    # faster, before a stay and after it, nothing but a table makes it stay.
    fast = (steps / quantum).max(axis=1) > QUANTA
    lasting = lengths[1:-1][fast[:-1] & fast[1:]]
    if len(lasting) < FEWEST_FAST or 1 - len(lasting) / lasting.sum() < HELD:
        return np.zeros(len(eta), bool)
    short = np.repeat(lengths <= 3 * usual, lengths)  # a longer stay is a rest, or a lost fix
    return np.asarray(same & short)


def _in_order(times: Array, eta: Array, noise: Array) -> Tuple[Array, int]:
    """Poses eta (n, 3) of noise (3,), with stamps (n,) [s] not descending, in the order in which they were
    measured; how many of them move.

    All frames of a burst of a network have nearly the same stamp. A craft goes on in one direction while a
    burst lasts, and turns on. No order is taken that makes the path rougher: a mocap may flip headings.
    """
    heading = np.column_stack([np.cos(eta[:, 2]), np.sin(eta[:, 2])])
    places = np.column_stack([eta[:, :2] / noise[:2], heading / noise[2]])
    order = np.arange(len(times))
    close = np.diff(times) < APART * scatter.interval(times)
    starts = np.flatnonzero(close & ~np.append(False, close[:-1]))
    ends = np.flatnonzero(close & ~np.append(close[1:], False)) + 2
    for start, end in zip(starts, ends):
        if start < AROUND or end + AROUND > len(times):
            continue
        burst = places[start - AROUND : end + AROUND]
        found = min((_sorted(burst, n) for n in (2, 4)), key=lambda o: _roughness(burst[o]))
        before, after = _roughness(burst), _roughness(burst[found])
        rougher = _roughness(burst[found, :2]) > _roughness(burst[:, :2])
        if after < MAX_RATIO * before and before - after > MIN_GAIN and not rougher:
            order[start - AROUND : end + AROUND] = start - AROUND + found
    return eta[order], int((order != np.arange(len(times))).sum())


def _sorted(places: Array, columns: int) -> Indices:
    """Indices that sort the places of a burst along its way, by the first columns; unchanged if
    the way is too short."""
    burst = places[:, :columns]
    way = burst[-AROUND:].mean(axis=0) - burst[:AROUND].mean(axis=0)
    order = np.arange(len(burst))
    if np.linalg.norm(way) > MIN_WAY:
        order[AROUND:-AROUND] = AROUND + np.argsort(burst[AROUND:-AROUND] @ way, kind="stable")
    return order


def _roughness(places: Array) -> float:
    """Sum of the squared second differences of consecutive places [variances of the noise]."""
    return float((np.diff(places, 2, axis=0) ** 2).sum())
