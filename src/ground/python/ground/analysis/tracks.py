"""How a recorded craft followed its reference."""

from dataclasses import dataclass, field
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple, Union

import numpy as np

from ground.reading.bags import Bag
from ground.reading.containers import STAMP, Container, seconds
from ground.reading.recording import Recording
from ground.support.annotations import Array, Document, Flags
from ground.support.errors import GroundError

PAUSE = 0.5  # time without a reference after which another drive begins [s]
MAX_EXTRAPOLATION = 0.1  # longest time for which a reference is extrapolated [s]
AT_BOUND = 1e-6  # an input this near to 0 or 1 is saturated
ROUNDING = 1e-9  # [s]
MIN_DRIVE = 1.0  # shortest drive that counts [s]


@dataclass(frozen=True, eq=False)
class Track:
    """One drive along a reference, recorded or simulated. Times since it began [s]."""

    times: Array  # (n,) of the poses
    eta: Array  # (n, 3) x, y [m], psi [rad], world_ned; measured, or true
    reference: Array  # (n, 2) x, y [m]
    inputs: Array  # (k, 1 + n) time, inputs of the thrusters
    wanted: Array  # (j, 1 + n) the same before the inputs were limited; may be empty
    computing: Array  # (i, 2) time, processor time of a decision [s]; may be empty
    controller: str = ""  # node that drove; empty when that was not recorded
    began: float = 0.0  # on the clock of the poses' stamps [s]
    numbers: Document = field(default_factory=dict)  # of a simulated drive

    @property
    def errors(self) -> Array:
        """Distance from the reference (n,) [m]."""
        return np.asarray(np.hypot(*(self.eta[:, :2] - self.reference).T))


def read(path: str, recording: Recording) -> List[Track]:
    """The Tracks of a Recording, read from the bag at `path`; GroundError if nothing followed a
    reference."""
    inputs = len(recording.thrusters)
    limited: List[Array] = [np.empty((0, 1 + inputs))]
    drivers: List[Tuple[float, str]] = []
    with Bag(path) as bag:
        bag.choose(recording.namespace, "controls")
        followed = _stamped(bag, "ground_msgs/Reference", ["p[0]", "p[1]", "p_dot[0]", "p_dot[1]"])
        decided = _stamped(bag, "ground_msgs/Decision", ["computing"])
        for topic in bag.of_kind("ground_msgs/Controls"):
            columns = bag.table(topic)
            stamps = seconds(columns[STAMP])
            if topic.endswith("wanted"):
                listed = ["thrusters[%d]" % i for i in range(inputs)]
                names = listed if listed[0] in columns else ["left", "right"]  # none before there were any
                limited.append(np.column_stack([stamps, *(columns[name] for name in names)]))
            else:
                drivers += [(t, name) for t, name in zip(stamps, columns["header.frame_id"]) if name]
    if not len(followed):
        raise GroundError(
            "%s: no reference was recorded: nothing was tracked, or the topic reference is missing" % path
        )
    references = np.unique(followed, axis=0)
    wanted, computing = _by_time(np.concatenate(limited)), _by_time(decided)
    breaks = np.flatnonzero(np.diff(references[:, 0]) > PAUSE) + 1
    found = [_track(recording, part, wanted, computing, drivers) for part in np.split(references, breaks)]
    tracks = [track for track in found if track]
    if not tracks:
        raise GroundError("%s: no drive along a reference of %g s and more" % (path, MIN_DRIVE))
    return tracks


def _stamped(bag: Container, kind: str, names: Sequence[str]) -> Array:
    """Rows of stamp [s] and some numbers of the messages of a type, on all topics."""
    found = [np.empty((0, 1 + len(names)))]
    for topic in bag.of_kind(kind):
        columns = bag.table(topic)
        found.append(np.column_stack([seconds(columns[STAMP]), *(columns[name] for name in names)]))
    return np.concatenate(found)


def _by_time(rows: Array) -> Array:
    return np.asarray(rows[np.argsort(rows[:, 0], kind="stable")])


def _track(
    recording: Recording,
    references: Array,
    wanted: Array,
    computing: Array,
    drivers: Sequence[Tuple[float, str]],
) -> Optional[Track]:
    began, ended = references[0, 0], references[-1, 0]
    order = np.argsort(recording.pose_times, kind="stable")
    times, eta = recording.pose_times[order], recording.eta[order]
    inside = (times >= began) & (times <= ended)
    times, eta = times[inside], eta[inside]
    if ended - began < MIN_DRIVE or len(times) < 2:
        return None
    # a reference is published with the state that it was compared with, at the rate of control
    last = np.searchsorted(references[:, 0], times + 1e-6, side="right") - 1
    ahead = (times - references[last, 0])[:, None]
    near = ahead[:, 0] <= MAX_EXTRAPOLATION
    position = references[last, 1:3] + ahead * references[last, 3:5]
    commands = np.column_stack([recording.control_times, recording.thrust])
    names = {name for stamp, name in drivers if began <= stamp <= ended}
    return Track(
        times[near] - began,
        eta[near],
        position[near],
        _during(commands, began, ended),
        _during(wanted, began, ended),
        _during(computing, began, ended),
        " and ".join(sorted(names)),
        float(began),
    )


def _during(rows: Array, began: float, ended: float) -> Array:
    kept = rows[(rows[:, 0] >= began) & (rows[:, 0] <= ended)]
    kept[:, 0] -= began
    return kept


def numbers(track: Track, settled: float = 0.0) -> Dict[str, object]:
    """`summary` of a recorded Track, with when it began, its duration and its controller."""
    if not (track.times >= settled).any():
        raise GroundError("the drive ended before %g s" % settled)
    duration, controller = float(track.times[-1]), track.controller or None
    return dict(summary(track, settled), began=track.began, duration=duration, controller=controller)


def summary(track: Track, settled: float = 0.0) -> Dict[str, object]:
    """Numbers of a Track from `settled` [s] on: rms, max and final error [m], share of the time in which an
    input is at a bound, mean square of the inputs, share of the wanted inputs outside 0..1 (two thrusters) or
    -1..1, and the largest of them; and compute_ms of the whole drive. None for what was not recorded."""
    errors = track.errors[track.times >= settled - ROUNDING]
    inputs, wanted = (rows[rows[:, 0] >= settled - ROUNDING, 1:] for rows in (track.inputs, track.wanted))
    least = 0.0 if wanted.shape[1] == 2 else -1.0
    outside = ((wanted < least - AT_BOUND) | (wanted > 1 + AT_BOUND)).any(axis=1)
    return {
        "rms": _of(lambda e: float(np.sqrt(np.mean(e**2))), errors),
        "max": _of(np.max, errors),
        "final": float(errors[-1]) if len(errors) else None,
        "saturated_fraction": _of(np.mean, saturated(inputs)),
        "effort": _of(np.mean, inputs**2),
        "wanted_outside": _of(np.mean, outside),
        "wanted_largest": _of(np.max, np.abs(wanted)),
        "compute_ms": compute_ms(track.computing[:, 1]),
    }


def _of(number: Callable[[Any], float], values: Union[Array, Flags]) -> Optional[float]:
    """A number of values; None where there are none."""
    return float(number(values)) if len(values) else None


def saturated(inputs: Array) -> Flags:
    """Whether an input of each row (n, k) is at a bound (n,). Of two thrusters, the bounds are 0 and 1;
    more of them, or those that go backwards, are off without being at a limit."""
    high = np.abs(inputs) >= 1 - AT_BOUND
    if inputs.shape[1] == 2 and not (inputs < 0).any():
        high |= inputs <= AT_BOUND
    return np.asarray(high.any(axis=1))


def compute_ms(seconds: Array) -> Optional[Dict[str, float]]:
    """Median, 99.9% and maximum of the processor time of decisions [ms]; None without decisions."""
    if not len(seconds):
        return None
    median, p999, most = 1e3 * np.quantile(seconds, [0.5, 0.999, 1.0])
    return {"median": float(median), "p999": float(p999), "max": float(most)}
