"""How a recorded craft followed its reference."""

from dataclasses import dataclass
from typing import List, Optional, Sequence, Tuple

import numpy as np

from ground.annotations import Array, Document
from ground.errors import GroundError
from ground.recordings import tracking_error
from ground.recordings.bag_reader import BagReader
from ground.recordings.recording import Recording

PAUSE = 0.5  # time without a reference after which another drive begins [s]
LONGEST = 0.1  # longest time for which a reference is extrapolated [s]
SHORTEST = 1.0  # shortest drive that counts [s]


@dataclass(frozen=True)
class Track:
    """One drive along a reference. Times since it began [s]."""

    times: Array  # (n,) of the poses
    eta: Array  # (n, 3) measured x, y [m], psi [rad], world_ned
    reference: Array  # (n, 2) x, y [m]
    inputs: Array  # (k, 1 + n) time, inputs of the thrusters
    wanted: Array  # (j, 1 + n) the same before the inputs were limited; may be empty
    computing: Array  # (i, 2) time, processor time of a decision [s]; may be empty
    controller: str  # node that drove; empty when that was not recorded
    began: float  # on the clock of the poses' stamps [s]

    @property
    def errors(self) -> Array:
        """Distance from the reference (n,) [m]."""
        return np.asarray(np.hypot(*(self.eta[:, :2] - self.reference).T))


def read(path: str, recording: Recording) -> List[Track]:
    """The Tracks of a Recording, read from the bag at `path`; GroundError if nothing followed a
    reference."""
    followed: List[Tuple[float, ...]] = []
    limited: List[Tuple[float, ...]] = []
    decided: List[Tuple[float, ...]] = []
    drivers: List[Tuple[float, str]] = []
    with BagReader(path) as bag:
        topics = bag.get_type_and_topic_info().topics
        ours = [t for t, e in topics.items() if e.msg_type == "ground_msgs/Reference"]
        commands = [t for t, e in topics.items() if e.msg_type == "ground_msgs/Controls"]
        decisions = [t for t, e in topics.items() if e.msg_type == "ground_msgs/Decision"]
        for topic, message, _ in bag.read_messages(ours + commands + decisions):
            stamp = message.header.stamp.to_sec()
            if topic in decisions:
                decided.append((stamp, message.computing))
                continue
            if topic in ours:
                followed.append((stamp, *message.p, *message.p_dot))
            elif topic.endswith("wanted"):
                thrusters = getattr(message, "thrusters", ())  # none before there were any
                limited.append(
                    (stamp, *(thrusters if len(thrusters) else (message.left, message.right)))
                )
            elif message.header.frame_id:
                drivers.append((stamp, message.header.frame_id))
    if not followed:
        raise GroundError(
            "%s: no reference was recorded: nothing was tracked, or the topic reference is missing"
            % path
        )
    references = np.array(sorted(set(followed)))
    inputs = len(recording.thrusters)
    wanted = np.array(sorted(limited)).reshape(-1, 1 + inputs)
    computing = np.array(sorted(decided)).reshape(-1, 2)
    breaks = np.flatnonzero(np.diff(references[:, 0]) > PAUSE) + 1
    found = [
        _track(recording, part, wanted, computing, drivers) for part in np.split(references, breaks)
    ]
    tracks = [track for track in found if track]
    if not tracks:
        raise GroundError("%s: no drive along a reference of %g s and more" % (path, SHORTEST))
    return tracks


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
    if ended - began < SHORTEST or inside.sum() < 2:
        return None
    times, eta = times[inside], eta[inside]
    # a reference is published with the state that it was compared with, at the rate of control
    last = np.searchsorted(references[:, 0], times + 1e-6, side="right") - 1
    ahead = (times - references[last, 0])[:, None]
    near = ahead[:, 0] <= LONGEST
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


def numbers(track: Track, settled: float = 0.0) -> Document:
    """Numbers of a Track from `settled` [s] on: rms, max and final error [m], share of the time in which
    an input is at a bound, mean square of the inputs, and wanted_summary and compute_ms of
    tracking_error (the latter of the whole drive), None for what was not recorded."""
    counts = track.times >= settled
    if not counts.any():
        raise GroundError("the drive ended before %g s" % settled)
    inputs = track.inputs[track.inputs[:, 0] >= settled, 1:]
    wanted = track.wanted[track.wanted[:, 0] >= settled, 1:]
    return {
        "began": track.began,
        "duration": float(track.times[-1]),
        "controller": track.controller or None,
        **tracking_error.summary(track.errors[counts], inputs),
        **tracking_error.wanted_summary(wanted),
        "compute_ms": tracking_error.compute_ms(track.computing[:, 1]),
    }
