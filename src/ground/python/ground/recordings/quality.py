"""Oddities of a recording, its usable parts, and the run that fits use."""

import itertools
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Iterator, List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.annotations import Array, Document, Flags, Indices
from ground.errors import GroundError
from ground.recordings import frame_clock, reply, suspicions
from ground.recordings.repair import Motion, repair, wrap

if TYPE_CHECKING:
    from ground.recordings.recording import Recording

GAP = 0.05  # a longer pause is a gap [s]
LATE = 0.05  # a stamp with a larger delay after its frame is late [s]
SHORTEST = 0.3  # shortest usable stretch [s]
IDLE = 1.0  # longest rest at the end that is used [s]
MOVED = 0.01  # largest movement of a craft at rest [m]
CONTACT = (1.0, 1.5)  # excess over any input, relative to the largest thrust and yaw moment
CONTACT_NOISE = 6.0  # least excess in multiples of its noise
AT_ONCE = 1e-6  # stamps of one instant differ by less [s]
CONTACT_MARGIN = 0.1  # time left out before and after a contact [s]
MOST_LEVELS = {1: 6, 2: 6, 3: 4, 4: 3}  # levels of each thruster in a grid, by their number; else 2

PAIR = ("left", "right")  # the thrusters of a model

Span = Tuple[float, float]  # start, end [s]


class Run:
    """A recording with its motion repaired; findings and usable spans are on the run's clock.

    Attributes: recording; motion; zero [s], the origin of the run's clock, and end [s] on it; spans
    and contacts, lists of (start, end) [s]; active, (start, end) of the experiment [s]; reply, how
    the motion follows the commands; drives, when each drive began [s], the origins of the model's
    t; drives_by, the source of these: "record", "lift" (the first command with lift), "first
    command" (which has lift already) or "start" (of the run, because no command has lift);
    suspicions, the mistakes that it looks like.
    """

    def __init__(self, recording: "Recording") -> None:
        self.recording = recording
        self.motion = repair(recording)
        times, motion = self.motion.times, self.motion
        controls = recording.control_times
        self.zero = float(max(times[0], controls[0]))
        last = float(min(times[-1], controls[-1]))
        if not last > self.zero:
            raise GroundError("%s: commands and poses do not overlap in time" % recording.name)
        self.end = last - self.zero
        self.drives, self.drives_by = self._drives()
        found = reply.find(recording, motion)
        contacts = _contacts(recording, motion, found)
        landing = _landing(recording, contacts)
        self.reply = None if found is None else {"lag": found["lag"], "share": found["share"]}
        self.contacts = [
            (float(a - self.zero), float(b - self.zero)) for a, b in contacts if a < landing
        ]
        self.active = self._active(landing)
        self.spans = self._spans()
        self.suspicions = suspicions.of(self)

    @classmethod
    def restored(cls, recording: "Recording", motion: Motion, **found: Any) -> "Run":
        """The run whose motion and other attributes were found before."""
        run = cls.__new__(cls)
        vars(run).update(found, recording=recording, motion=motion)
        return run

    def _drives(self) -> Tuple[List[float], str]:
        recording = self.recording
        times, lift = recording.control_times - self.zero, recording.lift
        starts = _core.drive_starts(times, lift, recording.drives - self.zero)
        if not starts:
            return [0.0], "start"
        if len(recording.drives):
            return starts, "record"
        return starts, "first command" if lift[0] > 0 else "lift"

    def _active(self, landing: float) -> Span:
        """From just before the first thrust or motion to the end of lift and overlap [s]. landing: when
        the floor begins to brake the craft [s, clock of the stamps]."""
        recording, motion = self.recording, self.motion
        thrust, lift, times = recording.thrust, recording.lift, recording.control_times
        start, end = self.zero, min(self.zero + self.end, landing - CONTACT_MARGIN)
        moved = np.linalg.norm(motion.eta[:, :2] - motion.eta[0, :2], axis=1) > MOVED
        turned = np.abs(motion.eta[:, 2] - motion.eta[0, 2]) > 0.1
        begins = [times[np.argmax(thrust.any(axis=1))]] if thrust.any() else []
        if (moved | turned).any():
            begins.append(motion.times[np.argmax(moved | turned)])
        if begins:
            start = max(start, min(begins) - 0.1)
            end = self._without_idle_end(end)
        if (lift > 0).any():  # else the lift was not recorded
            lifted = np.flatnonzero(lift > 0)
            start = max(start, times[lifted[0]])
            if lifted[-1] + 1 < len(times):
                end = min(end, times[lifted[-1] + 1])
        return float(start - self.zero), float(end - self.zero)

    def _without_idle_end(self, end: float) -> float:
        """The end [s, clock of the stamps], without a long rest of the craft without thrust there."""
        times, motion = self.recording.control_times, self.motion
        away = np.abs(motion.eta - motion.eta[-1])
        moved = np.flatnonzero((np.hypot(away[:, 0], away[:, 1]) > MOVED) | (away[:, 2] > 0.1))
        driven = np.flatnonzero(self.recording.thrust.any(axis=1))
        last = [motion.times[moved[-1]]] if len(moved) else []
        if len(driven):
            last.append(times[driven[-1] + 1] if driven[-1] + 1 < len(times) else times[-1])
        idle = end - max(last, default=end)
        return end - idle + 0.1 if idle > IDLE else end

    def _spans(self) -> List[Span]:
        start, end = self.active
        cuts = [(a - CONTACT_MARGIN, b + CONTACT_MARGIN) for a, b in self.contacts]
        times = self.motion.times - self.zero
        inside = (times >= start) & (times <= end) & _lifted(self.recording, self.motion.times)
        for a, b in cuts:
            inside &= (times < a) | (times > b)
        spans = []
        for stretch in reply.stretches(times, inside):
            if times[stretch[-1]] - times[stretch[0]] >= SHORTEST:
                spans.append((float(times[stretch[0]]), float(times[stretch[-1]])))
        return spans

    def inputs(self, model: _core.Model) -> Array:
        """Rows of time on the run's clock [s], the commands of a model's thrusters in its order, and
        lift (0 if it was not recorded). GroundError when the recording has other channels."""
        recording = self.recording
        *thrusters, lift = model.channels
        lifts = (
            recording.commands_of([lift])
            if lift in recording.channels
            else np.zeros((len(recording.control_times), 1))
        )
        times = recording.control_times - self.zero
        return np.column_stack([times, recording.commands_of(thrusters), lifts])

    def data(
        self,
        model: _core.Model,
        start: Optional[float] = None,
        end: Optional[float] = None,
        everything: bool = False,
    ) -> _core.RunData:
        """_core.RunData of the usable spans, or of the whole overlap if `everything` is set.

        `start` and `end` [s] choose a part, on the run's clock. Raises GroundError when nothing is
        left of it.
        """
        motion = self.motion
        times = motion.times - self.zero
        low, high = start or 0.0, self.end if end is None else min(end, self.end)
        inside = (times >= low) & (times <= high)
        if not everything:
            inside &= np.any(
                [(times >= a) & (times <= b) for a, b in self.spans or [(1, 0)]], axis=0
            )
        if inside.sum() < 10:
            raise GroundError(
                "%s: only %d poses in the part asked for; the run is %.2f s long, usable are %.2f s "
                "of it (identify info says why, --all uses the whole run)"
                % (self.recording.name, inside.sum(), self.end, self.usable())
            )
        inputs = self.inputs(model)
        inputs[:, 1:-1] *= model.input_max
        return _core.RunData(
            self.recording.name,
            times[inside],
            motion.eta[inside],
            motion.nu[inside],
            inputs,
            np.where(motion.spikes[:, None], motion.eta, motion.measured)[inside],
            np.array(motion.noise)[[0, 0, 1]],
            self.drives,
        )

    def usable(self) -> float:
        """Length of all usable spans [s]."""
        return float(sum(b - a for a, b in self.spans))

    def describe(self) -> Document:
        """Contents of `info`, as a dictionary of plain values; times are on the run's clock [s]."""
        recording = self.recording
        stamps, controls = recording.pose_times, recording.control_times
        times = self.motion.times - self.zero
        grounded = (times > self.active[0]) & (times < self.active[1])
        grounded &= ~_lifted(recording, self.motion.times)
        return {
            "name": recording.name,
            "source": recording.source,
            "settings": recording.settings.describe(self.zero),
            "flown_by": recording.flown_by,
            "files": {kind: file.describe() for kind, file in recording.files.items()},
            "changes": [change.describe(self.zero) for change in recording.changes],
            "begins": float(stamps.min()),
            "warnings": recording.warnings,
            "duration": float(max(stamps.max(), controls[-1]) - min(stamps.min(), controls[0])),
            "usable": {
                "duration": self.usable(),
                "of": float(self.end),
                "spans": [list(span) for span in self.spans],
            },
            "rest": float(self.active[0]),
            "rest_at_end": float(self.end - self.active[1]),
            "without_lift": [
                {"start": float(times[s[0]]), "end": float(times[s[-1]])}
                for s in reply.stretches(times, grounded)
            ],
            "drives": {"begin": [float(t) for t in self.drives], "by": self.drives_by},
            "poses": self._describe_poses(),
            "controls": self._describe_controls(),
            "authority": self._describe_authority(),
            "clock_offset": float(recording.clock_offset),
            "reply": self.reply,
            "contacts": [{"start": float(a), "end": float(b)} for a, b in self.contacts],
            "repairs": self.motion.repairs,
            "suspicions": [suspicion.describe() for suspicion in self.suspicions],
        }

    def _describe_poses(self) -> Document:
        """Contents of `info` on the poses."""
        recording, motion = self.recording, self.motion
        stamps = recording.pose_times
        steps = np.diff(np.sort(stamps))
        intervals = np.diff(motion.times)
        psi = recording.eta[:, 2]
        poses: Document = {
            "count": len(stamps),
            "rate": float((len(stamps) - 1) / (stamps.max() - stamps.min())),
            "median_step": float(np.median(steps)),
            "noise": {"position": motion.noise[0], "heading": motion.noise[1]},
            "gaps": [
                {"start": float(t - self.zero), "length": float(d)}
                for t, d in zip(motion.times[:-1], intervals)
                if d > GAP
            ],
            "duplicate_stamps": int((steps == 0).sum()),
            "stamps_out_of_order": int((np.diff(stamps) < 0).sum()),
            "bursts": int((steps < frame_clock.EARLIEST).sum()),
            "heading_wraps": int((np.abs(np.diff(wrap(motion.measured[:, 2]))) > np.pi).sum()),
            "mirrored_headings": motion.repairs["headings mirrored back"],
            "frozen": motion.repairs["frozen poses dropped"],
            "overtaken": motion.repairs["poses that overtook each other put in order"],
            "spikes": [float(t - self.zero) for t in motion.times[motion.spikes]],
            "out_of_range": int((np.abs(psi) > np.pi + 1e-9).sum()),
        }
        clock = motion.clock
        if clock is not None:
            poses["frame_clock"] = {
                "rate": clock.rate,
                "lost": clock.lost,
                "lateness": {
                    "median": float(np.median(clock.lateness)),
                    "largest": float(clock.lateness.max()),
                    "above_50_ms": int((clock.lateness > LATE).sum()),
                },
                "roughness": float(clock.roughness),
            }
        return poses

    def _describe_authority(self) -> Document:
        """What `info` says of what each thruster does; of crafts that are not of the usual pair."""
        recording = self.recording
        if recording.thrusters == PAIR:
            return {}
        lag = self.reply["lag"] if self.reply else None
        found = reply.authorities(recording, self.motion, lag)
        return {name: asdict(one) for name, one in zip(recording.thrusters, found)}

    def _describe_controls(self) -> Document:
        """Contents of `info` on the commands."""
        recording, motion = self.recording, self.motion
        controls, thrust = recording.control_times, recording.thrust
        changes = (np.abs(np.diff(thrust, axis=0)) > 1e-6).any(axis=1)
        return {
            "count": len(controls),
            "rate": float((len(controls) - 1) / (controls[-1] - controls[0])),
            "changes": int(changes.sum()),
            "channels": list(recording.channels),
            "thrusters": list(recording.thrusters),
            "levels": [float(f(thrust)) for f in (np.min, np.max)],
            "lift": [float(f(recording.lift)) for f in (np.min, np.max)],
            "start_after_poses": float(controls[0] - motion.times[0]),
            "end_after_poses": float(controls[-1] - motion.times[-1]),
        }


def describe(runs: List[Run]) -> List[Document]:
    """Contents of `info` on runs, a dictionary each, with the runs that have the same inputs."""
    pairs = same_inputs(runs)
    described = [run.describe() for run in runs]
    for d in described:
        d["same_inputs_as"] = [b if a == d["name"] else a for a, b in pairs if d["name"] in (a, b)]
    return described


def same_inputs(runs: List[Run]) -> List[Tuple[str, str]]:
    """Pairs of runs (names) that were driven by the same sequence of commands."""
    held = [_held(run.recording) for run in runs]
    return [
        (runs[i].recording.name, runs[j].recording.name)
        for i, j in _similar(held)
        if _agree(held[i], held[j])
    ]


def _held(recording: "Recording") -> Array:
    """Rows of the thrusters' commands, and how long they were held [s]."""
    times, commands = recording.control_times, recording.thrust
    changes = np.flatnonzero((np.abs(np.diff(commands, axis=0)) > 1e-6).any(axis=1)) + 1
    starts = np.append(0, changes)
    held = np.diff(np.append(times[starts], times[-1]))
    return np.column_stack([commands[starts], held])


SAME_COMMAND, SAME_TIME = 1e-6, 0.03  # largest differences of a command, and of how long it is held [s]
SAME_SHARE = 0.9  # least share of commands that are the same
FEWEST_SAME = 10  # least number of commands to compare
SHIFTS = [(s, 0) for s in range(5)] + [(0, s) for s in range(1, 5)]  # commands that only one run has


def _agree(a: Array, b: Array) -> bool:
    """Whether two sequences of held commands agree, except for some at the start."""
    if a.shape[1] != b.shape[1]:
        return False
    near = np.append(np.full(a.shape[1] - 1, SAME_COMMAND), SAME_TIME)
    for i, j in SHIFTS:
        count = min(len(a) - i, len(b) - j)
        if count < FEWEST_SAME:
            continue
        apart = np.abs(a[i : i + count] - b[j : j + count])
        if (apart < near).all(axis=1).mean() > SAME_SHARE:
            return True
    return False


def _similar(held: Sequence[Array]) -> Iterator[Tuple[int, int]]:
    """The pairs of sequences that may agree, by their commands alone: all pairs at once, since a thousand
    runs have half a million of them."""
    lengths = np.array([len(rows) for rows in held])
    codes = _numbered(held)
    longest = int(lengths.max(initial=0))
    table = np.full((len(held), longest), -1)
    for row, numbers in zip(table, codes):
        row[: len(numbers)] = numbers
    for first, numbers in enumerate(codes[:-1]):
        others = slice(first + 1, None)
        alike = np.zeros(len(held) - first - 1, bool)
        for i, j in SHIFTS:
            mine, theirs = numbers[i:], table[others, j:]
            overlap = min(len(mine), theirs.shape[1])
            same = (theirs[:, :overlap] == mine[:overlap]).sum(axis=1)
            counts = np.minimum(len(mine), lengths[others] - j)
            alike |= (counts >= FEWEST_SAME) & (same > SAME_SHARE * counts - 1e-6)
        yield from ((first, int(other)) for other in first + 1 + np.flatnonzero(alike))


def _numbered(held: Sequence[Array]) -> List[Indices]:
    """A number for each row of commands; those of commands that are the same are equal."""
    weights = 1 + np.sqrt(np.arange(2, 2 + max((rows.shape[1] for rows in held), default=0)))
    sums = [rows[:, :-1] @ weights[: rows.shape[1] - 1] for rows in held]
    every = np.concatenate(sums or [np.empty(0)])
    order = np.argsort(every, kind="stable")
    numbers = np.empty(len(every), int)
    apart = np.diff(every[order], prepend=-np.inf) > SAME_COMMAND * weights.sum()
    numbers[order] = np.cumsum(apart)
    return np.split(numbers, np.cumsum([len(rows) for rows in held])[:-1])


def _contacts(
    recording: "Recording", motion: Motion, found: Optional[reply.Reply]
) -> List[Span]:
    """Spans with accelerations that no input within its bounds explains."""
    if found is None:
        return [(t, t) for t in motion.times[motion.jumps]]
    coefficients = found["coefficients"]
    by_input = coefficients[: len(recording.thrusters)]  # rows: thrusters
    others = reply.smooth_terms(motion.nu)
    wanted = reply.accelerations(motion) - others @ coefficients[len(by_input) :]
    reachable = _levels(recording) @ by_input
    thrust = np.linalg.norm(reachable[:, :2], axis=1).max()
    turn = np.abs(reachable[:, 2]).max()
    if not (thrust > 0 and turn > 0):
        return []
    # Noise must not count as contact, even if the commands hardly determine the thrusters' effect.
    rest = wanted - reply.commands_at(recording, motion.times - found["lag"]) @ by_input
    noise = 1.4826 * np.median(np.abs(rest - np.median(rest, axis=0)), axis=0)
    scale = np.maximum([thrust, thrust, turn], CONTACT_NOISE * noise)
    beyond = np.full(len(wanted), np.inf)
    for effect in reachable:
        off = (wanted - effect) / scale
        force, moment = np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2])
        beyond = np.minimum(beyond, np.maximum(force / CONTACT[0], moment / CONTACT[1]))
    # A contact lasts for several frames; a single one is noise.
    beyond = np.min([np.roll(beyond, s) for s in (-1, 0, 1)], axis=0)
    floats = _lifted(recording, motion.times)  # without lift the floor brakes it
    floats[floats] = reply.middle(motion.times[floats])
    hit = ((beyond > 1) & floats) | motion.jumps
    return [(motion.times[s[0]], motion.times[s[-1]]) for s in reply.stretches(motion.times, hit)]


def _landing(recording: "Recording", contacts: Sequence[Span]) -> float:
    """When the floor begins to brake a craft whose lift was not recorded [s, clock of the stamps]: the first
    of some contacts after the last thrust, because the lift may end with it. Infinite without one."""
    driven = np.flatnonzero(recording.thrust.any(axis=1))
    if (recording.lift > 0).any() or not len(driven) or driven[-1] + 1 == len(recording.thrust):
        return np.inf
    last = recording.control_times[driven[-1] + 1]
    return min((start for start, _ in contacts if start > last), default=np.inf)


def _lifted(recording: "Recording", times: Array) -> Flags:
    """Whether the lift is on at some times (n,) [s], or was until then; where it was not recorded, it
    counts as on."""
    if not (recording.lift > 0).any():
        return np.ones(len(times), bool)
    around = times + np.array([[-AT_ONCE], [AT_ONCE]])
    return np.asarray(reply.held(recording, recording.lift, around).max(axis=0) > 0)


def _levels(recording: "Recording") -> Array:
    """Commands that the thrusters can be given, a grid (k, n)."""
    thrust = recording.thrust
    least = np.where(thrust.min(axis=0) < 0, -1.0, 0.0)
    count = MOST_LEVELS.get(thrust.shape[1], 2)
    grid = itertools.product(*[np.linspace(low, 1, count) for low in least])
    return np.array(list(grid))
