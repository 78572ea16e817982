"""Headings of which the mocap mistook the craft: mirrored, or turned because it confused its markers."""

from typing import List, Optional, Sequence, Tuple

import numpy as np

from ground.poses import angles, frame_clock, scatter
from ground.support.annotations import Array

FLIP_COST = (3.0, 0.5)  # minus log-likelihood of a change of mirroring, and of a mirrored heading
AROUND = 6  # poses before and after a step of the heading that are compared
LEAST_STEP = np.radians(20.0)  # least step between patterns of markers that are confused
BEYOND = 10.0  # least step [standard deviations of the headings around]
EXPLAINED = 4.0  # least step [what the change of the rate explains]
TOGETHER = 2.0 * AROUND  # longest time that poses on one side of a step last [usual intervals]

Steps = List[Tuple[float, float]]  # when [s], by how much [rad]


def turned_back(times: Array, eta: Array, fastest: float) -> Tuple[Array, Steps, List[float]]:
    """Undoes steps of the heading that no craft makes: it turns as fast after the step as before it. Mocap
    software whose markers have the same pattern after a turn takes one pattern for another, at once or after
    a loss.

    eta (n, 3), x, y [m], unwrapped psi [rad], at ascending stamps (n,) [s]; fastest: largest yaw rate
    [rad/s]. Returns the headings as in the longest part between losses in which the craft may turn round; the
    steps that were undone; and when place and heading step together [s]: another run
    begins there, whose heading stays.
    """
    psi, steps = eta[:, 2], []
    breaks = [0]
    usual, least = scatter.interval(times), BEYOND * float(scatter.resolution(eta)[:2].max())
    lost = [int(i) + 1 for i in np.flatnonzero(fastest * np.diff(times) > np.pi)]
    for i in _odd(times, psi):
        step = _step(times, psi[:, None], i, usual, LEAST_STEP, fastest)
        beside = range(i - AROUND, i + AROUND + 1)
        if step and any(_step(times, eta[:, :2], at, usual, least) for at in beside):
            breaks += [i] if i > breaks[-1] + AROUND else []
        elif step:
            steps.append((i, step))
    off = np.zeros(len(psi))
    parts = sorted({*breaks, *lost})
    for begin, end in zip(parts, [*parts[1:], len(psi)]):
        inside = [(i, step) for i, step in steps if begin < i < end]
        for i, step in inside:
            off[i:end] += step
        begins = [begin, *(i for i, _ in inside)]
        ends = [*begins[1:], end]
        longest = int(np.argmax([times[b - 1] - times[a] for a, b in zip(begins, ends)]))
        off[begin:end] = angles.wrap(off[begin:end] - off[begins[longest]])
    off[np.abs(off) < LEAST_STEP] = 0.0  # the same pattern again
    found = [(float(times[i]), step) for i, step in steps]
    return psi - off, found, [float(times[i]) for i in breaks[1:]]


def _odd(times: Array, psi: Array) -> Sequence[int]:
    """Indices of the poses before which the heading changes by far more than around."""
    steps = angles.wrap(np.diff(psi))
    usual = scatter.running_median(steps, AROUND)
    return [int(i) + 1 for i in np.flatnonzero(np.abs(angles.wrap(steps - usual)) > LEAST_STEP)]


def _step(times: Array, columns: Array, at: int, usual: float, least: float, fastest: float = 0.0) -> float:
    """Step of a heading (n, 1) [rad] or a place (n, 2) [m] before pose `at`; 0 where it is below `least`, or
    a move: in a loss of poses at the largest velocity. usual: interval [s]."""
    before, after = slice(at - AROUND, at), slice(at, at + AROUND)
    if at < AROUND or at + AROUND > len(columns):
        return 0.0
    if np.ptp(times[after]) > TOGETHER * usual or times[before][0] == times[before][-1]:
        return 0.0
    angle, lines, spread = columns.shape[1] == 1, [], 0.0
    for piece in (before, after):
        rows, stamps = columns[piece], times[piece] - times[at]
        rows = np.unwrap(rows, axis=0) if angle else rows
        line = np.polyfit(stamps, rows, 1)
        lines.append(line)
        rest = rows - np.outer(stamps, line[0]) - line[1]
        spread = max(spread, float(np.std(rest, axis=0, ddof=2).max()))
    change, step = lines[1] - lines[0]
    size = float(angles.wrap(step[0])) if angle else float(np.linalg.norm(step))
    waited = times[at] - times[at - 1]
    moved = EXPLAINED * float(np.linalg.norm(change)) * (waited + AROUND * usual / 2)
    return size if abs(size) > max(least, BEYOND * spread, moved, fastest * (waited - usual)) else 0.0


def unmirrored(psi: Array) -> Tuple[Array, int]:
    """Undoes mirrored headings, which the mocap gave as `centre - psi`. Returns the headings and how
    many were mirrored.

    Mocap software may confuse a rigid body with its mirror image: for single frames or several in a
    row the heading's sign is wrong. A tilt of the axes shifts the mirrored heading by a constant, which
    is estimated from single frames. The most likely sequence (Viterbi 1967) says which are mirrored.
    """
    centre = _mirror_centre(psi)
    if centre is None:
        return psi, 0
    readings = np.stack([psi, centre - psi])  # row 1: the heading if it was mirrored
    steps = np.diff(psi)
    turning = scatter.running_median(angles.wrap(steps), 7)
    width = 0.02 + 0.3 * np.abs(turning)
    change, mirrored = FLIP_COST

    def step(k: int) -> Array:
        off = angles.wrap(readings[None, :, k] - readings[:, k - 1, None] - turning[k - 1]) / width[k - 1]
        return np.asarray(np.minimum(np.abs(off), 20) + change * (1 - np.eye(2)))

    own = np.array([0.0, mirrored])
    later = ((step(k), own) for k in range(1, len(psi)))
    state = frame_clock.likeliest(np.array([0.0, change]), later)
    return readings[state, np.arange(len(psi))], int(state.sum())


def _mirror_centre(psi: Array) -> Optional[float]:
    """Sum of a heading and its mirrored one [rad]; None when no heading is mirrored."""
    before, here, after = psi[:-2], psi[1:-1], psi[2:]
    middle = before + 0.5 * angles.wrap(after - before)
    # Neighbours that agree, and a heading between them that does not.
    odd = (np.abs(angles.wrap(after - before)) < 0.3) & (np.abs(angles.wrap(here - middle)) > 0.5)
    if not odd.any():
        return None
    sums = angles.wrap(here[odd] + middle[odd])
    centre = np.median(sums)
    near = np.abs(angles.wrap(sums - centre)) < 0.1
    return float(np.median(sums[near])) if near.mean() > 0.5 else None
