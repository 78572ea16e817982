"""Oddities of a recording, its usable parts, and the run that fits use."""

import itertools
from typing import List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.checks import reply
from ground.poses import inertial, kinematics, repair, scatter, time_scales
from ground.reading.recording import Recording, once
from ground.support.annotations import Array, Flags
from ground.support.errors import GroundError

# Shortest usable stretch, longest rest at the end that is used, and the time that is left out before and
# after a contact, of a silence, and that is kept of a rest [usual intervals between poses]
SHORTEST, IDLE, MARGIN = 36, 120, 12
MOVED = 20.0  # largest movement of a craft at rest [standard deviations of a pose]
FROZEN = 36  # poses in a row that repeat the last one, if thrusters act, from which they are no measurement
STEPS = 0.25  # largest change of velocity of a pose that steps, relative to the change in one interval
STEP = 300.0  # largest step of poses that is none of the craft [standard deviations of a pose]
ODD = 0.05  # largest share of poses that repeat the last one by chance
CONTACT = (0.85, 1.3)  # excess over any input, relative to the largest thrust and yaw moment
CONTACT_NOISE = 6.0  # least excess in multiples of its noise
AT_ONCE = 1e-6  # stamps of one instant differ by less [s]
SILENCE = 12.0  # longest pause of a publisher with a rate [long intervals between commands]
EVEN = 3.0  # ratio of a long interval to the usual one up to which a publisher has a rate
MOST_LEVELS = {1: 6, 2: 6, 3: 4, 4: 3}  # levels of each thruster in a grid, by their number; else 2

Span = Tuple[float, float]  # start, end [s]


class RepairedRun:
    """A recording with its motion repaired; findings and usable spans are on the run's clock.

    Attributes: recording; motion; zero [s], the origin of the run's clock, and end [s] on it; spans and
    contacts, silent (pauses of the commands) and frozen (repeated poses), lists of (start, end) [s]; steps of
    the measured pose, and breaks where another run begins [s]; margin around such events [s]; active,
    (start, end) of the experiment [s]; reply, how the motion follows the commands; inertial, the craft's
    calibrated sensors (None: it has none); drives, when each drive began [s], the origins of the model's t;
    drives_by, the source of these: "record", "lift" (the first command with lift), "first command" (which has
    lift already) or "start" (of the run, because no command has lift).
    """

    def __init__(self, recording: Recording) -> None:
        self.recording, self.motion = recording, recording.motion
        times = self.motion.times
        controls = recording.control_times
        self.zero = float(max(times[0], controls[0]))
        last = float(min(times[-1], controls[-1]))
        if not last > self.zero:
            raise GroundError(_apart(recording.name, times, controls))
        self.end = last - self.zero
        self.margin = MARGIN * scatter.interval(times)  # [s]
        self.drives, self.drives_by = self._drives()
        found = reply.find(recording)
        contacts = _contacts(recording, found)
        landing = _landing(recording, contacts)
        regression = reply.regression(recording)
        self.reply = found and {"lag": found["lag"], "share": found["share"], "slow": found["slow"]}
        # share of the accelerations that is no noise, if commands explain none; 0: they may explain some
        self.unexplained = None if found else regression["power"] if regression else 0.0
        if self.unexplained and not reply.decides(recording):
            self.unexplained = 0.0
        self.steps = [float(t - self.zero) for t in self.motion.times[_steps(self.motion)]]
        self.breaks = [float(t - self.zero) for t in self.motion.breaks]
        self.silent, self.frozen = (self._on_clock(s) for s in (_silences(recording), _frozen(recording)))
        self.contacts = self._on_clock([(a, b) for a, b in contacts if a < landing])
        self.active = self._active(landing)
        self.spans = self._spans()
        samples = recording.inertial
        self.inertial = None if samples is None else inertial.calibrate(samples, self.motion, contacts)

    def _on_clock(self, spans: Sequence[Span]) -> List[Span]:
        return [(float(a - self.zero), float(b - self.zero)) for a, b in spans]

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
        start, end = self.zero, min(self.zero + self.end, landing - self.margin)
        moved, turned = _away(motion, motion.eta[0])
        begins = [times[np.argmax(thrust.any(axis=1))]] if thrust.any() else []
        if (moved | turned).any():
            begins.append(motion.times[np.argmax(moved | turned)])
        if begins:
            start = max(start, min(begins) - self.margin)
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
        moved = np.flatnonzero(np.any(_away(motion, motion.eta[-1]), axis=0))
        driven = np.flatnonzero(self.recording.thrust.any(axis=1))
        last = [motion.times[moved[-1]]] if len(moved) else []
        if len(driven):
            last.append(times[driven[-1] + 1] if driven[-1] + 1 < len(times) else times[-1])
        idle = end - max(last, default=end)
        longest = IDLE * scatter.interval(motion.times)
        return end - idle + self.margin if idle > longest else end

    def _spans(self) -> List[Span]:
        start, end = self.active
        cuts = [(a - self.margin, b + self.margin) for a, b in self.contacts] + self.silent + self.frozen
        cuts += [(t - self.margin, t + self.margin) for t in [*self.steps, *self.breaks]]
        times = self.motion.times - self.zero
        inside = (times >= start) & (times <= end) & lifted(self.recording, self.motion.times)
        for a, b in cuts:
            inside &= (times < a) | (times > b)
        ends = [
            (float(times[s[0]]), float(times[s[-1]]))
            for s in kinematics.stretches(times, inside, self.motion.scales.max_gap)
        ]
        return [(a, b) for a, b in ends if b - a >= SHORTEST * scatter.interval(self.motion.times)]

    def inputs(self, model: _core.Model) -> Array:
        """Rows of time on the run's clock [s], the commands of a model's thrusters in its order, and
        lift (0 if it was not recorded). GroundError when the recording has other channels."""
        recording = self.recording
        *thrusters, lift = model.channels
        times = recording.control_times - self.zero
        lifts = recording.commands_of([lift]) if lift in recording.channels else np.zeros((len(times), 1))
        return np.column_stack([times, recording.commands_of(thrusters), lifts])

    def data(
        self,
        model: _core.Model,
        start: Optional[float] = None,
        end: Optional[float] = None,
        everything: bool = False,
        window: Optional[float] = None,
    ) -> _core.RunData:
        """_core.RunData of the usable spans, or of the whole overlap if `everything` is set. window: over
        which errors are taken [s], by default what suits the model.

        `start` and `end` [s] choose a part, on the run's clock. Raises GroundError when nothing is
        left of it.
        """
        motion = self.motion
        times = motion.times - self.zero
        low, high = start or 0.0, self.end if end is None else min(end, self.end)
        inside = (times >= low) & (times <= high)
        inside &= np.diff(times, prepend=-np.inf) > 0  # one sample of an instant, if several cameras see it
        if not everything:
            inside &= np.any([(times >= a) & (times <= b) for a, b in self.spans or [(1, 0)]], axis=0)
        if end is not None and end < low:
            raise GroundError("the requested part ends at %g s, before it starts at %g s" % (end, low))
        if inside.sum() < 10:
            raise GroundError(
                "%s: only %d poses in the requested part; of the run's %.2f s, %.2f s are usable "
                "(identify info says why, --all or everything=True uses the whole run)"
                % (self.recording.name, inside.sum(), self.end, self.usable())
            )
        inputs = self.inputs(model)
        least = repair.MIN_POSES * scatter.interval(motion.times)
        scales = motion.scales.max_gap, motion.scales.linear_jerk, motion.scales.angular_jerk
        inputs[:, 1:-1] *= model.input_max
        return _core.RunData(
            self.recording.name,
            times[inside],
            motion.eta[inside],
            motion.nu[inside],
            inputs,
            motion.measured[inside],
            np.array(motion.noise)[[0, 0, 1]],
            self.drives,
            inertial=self._inertial(),
            payload=self.recording.payload,
            scales=_core.RunScales(*scales, max(window or time_scales.usual_window(model), least)),
            battery=None if self.recording.voltage is None else self.recording.voltage.rows(self.zero),
        )

    def _inertial(self) -> Optional[_core.InertialData]:
        """The craft's sensors on the run's clock."""
        data = None if self.inertial is None else self.inertial.data
        if data is None:
            return None
        return _core.InertialData(np.array(data.times) - self.zero, data.values, data.noise, data.place)

    def usable(self) -> float:
        """Length of all usable spans [s]."""
        return float(sum(b - a for a, b in self.spans))


@once
def repaired(recording: Recording) -> RepairedRun:
    """The recording with its motion repaired, and its usable spans. GroundError when poses and commands do
    not overlap, or too few poses are left."""
    return RepairedRun(recording)


def same_inputs(runs: Sequence[RepairedRun]) -> List[Tuple[str, str]]:
    """Pairs of runs (names) that were driven by the same sequence of commands."""
    held = [(run.recording.name, _held(run.recording)) for run in runs]
    pairs = itertools.combinations(held, 2)
    return [(name, other) for (name, rows), (other, others) in pairs if _agree(rows, others)]


def _held(recording: Recording) -> Array:
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
    counts = [(i, j, min(len(a) - i, len(b) - j)) for i, j in SHIFTS]
    return any(
        (np.abs(a[i : i + n] - b[j : j + n]) < near).all(axis=1).mean() > SAME_SHARE
        for i, j, n in counts
        if n >= FEWEST_SAME
    )


def _apart(name: str, times: Array, controls: Array) -> str:
    """Says that poses and commands have no time in common, and what may help."""
    begin, other = float(times[0]), float(controls[0])
    lengths = float(np.ptp(times)), float(np.ptp(controls))
    text = "%s: commands and poses do not overlap in time: poses start at %.3f s for %.3g s, commands "
    text = (text + "at %.3f s for %.3g s; ") % (name, begin, lengths[0], other, lengths[1])
    if abs(begin - other) < 10 * max(lengths):
        return text + "are they of one run?"
    more = "their clocks differ: clock_offset in a mapping is added to the poses, %.3f if both began together"
    return text + more % (other - begin)


def _away(motion: repair.Motion, pose: Array) -> Tuple[Flags, Flags]:
    """At which poses a craft has moved, and turned, away from a pose (3,)."""
    off = np.abs(motion.eta - pose)
    return np.hypot(off[:, 0], off[:, 1]) > MOVED * motion.noise[0], off[:, 2] > MOVED * motion.noise[1]


def _silences(recording: Recording) -> List[Span]:
    """Pauses of the commands of a publisher with a rate [s, clock of the stamps]: what the craft
    did in them is not known. A publisher that sends on change has none."""
    times = recording.control_times
    steps = np.diff(times)
    usual = float(np.quantile(steps, 1 - ODD))
    if not 0 < usual < EVEN * np.median(steps):
        return []
    thrust = recording.thrust
    repeats = (thrust[1:] == thrust[:-1]).all(axis=1).mean()
    if not repeats > ODD:  # each message is another command: it may have been sent on change
        return []
    return [(times[i] + usual, times[i + 1]) for i in np.flatnonzero(steps > SILENCE * usual)]


def _frozen(recording: Recording) -> List[Span]:
    """Where poses that scatter repeat the last one while thrusters act, or all are the same [s, clock of the
    stamps]."""
    order = np.argsort(recording.pose_times, kind="stable")
    times = repair.on_commands_clock(recording.pose_times[order], recording.clock_offset)
    if not np.ptp(recording.eta, axis=0).any():
        return [(float(times[0]), float(times[-1]))]
    same = np.append(False, (np.diff(recording.eta[order], axis=0) == 0).all(axis=1))
    begins = np.flatnonzero(~same)
    lengths = np.diff(np.append(begins, len(same)))
    long = lengths > FROZEN
    others = len(same) - int(lengths[long].sum())
    if not long.any() or same.sum() - (lengths[long] - 1).sum() > ODD * others:
        return []
    found = []
    for begin, count in zip(begins[long], lengths[long]):
        span = float(times[begin]), float(times[begin + count - 1])
        if recording.held(recording.thrust, times[begin : begin + count]).any():
            found.append(span)
    return found


def _contacts(recording: Recording, found: Optional[reply.Reply]) -> List[Span]:
    """Spans with accelerations that no input within its bounds explains."""
    motion = recording.motion
    floats = lifted(recording, motion.times)  # without lift the floor brakes it
    jumps = motion.jumps & floats & ~_steps(motion)
    for start in motion.breaks:
        jumps &= np.abs(motion.times - start) > MARGIN * scatter.interval(motion.times)
    if found is None:
        return [(t, t) for t in motion.times[jumps]]
    coefficients = found["coefficients"]
    by_input = coefficients[: len(recording.thrusters)]  # rows: thrusters
    others = kinematics.smooth_terms(motion.nu)
    wanted = kinematics.accelerations(motion) - others @ coefficients[len(by_input) :]
    reachable = _levels(recording) @ by_input
    thrust = np.linalg.norm(reachable[:, :2], axis=1).max()
    turn = np.abs(reachable[:, 2]).max()
    if not (thrust > 0 and turn > 0):
        return []
    # Noise must not count as contact, even if the commands hardly determine the thrusters' effect.
    rest = wanted - reply.commands_at(recording, recording.thrust, motion.times - found["lag"]) @ by_input
    noise = np.maximum(kinematics.deviations(rest), reply.accuracy(motion))
    scale = np.maximum([thrust, thrust, turn], CONTACT_NOISE * noise)
    beyond = np.full(len(wanted), np.inf)
    for effect in reachable:
        off = (wanted - effect) / scale
        force, moment = np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2])
        beyond = np.minimum(beyond, np.maximum(force / CONTACT[0], moment / CONTACT[1]))
    # A contact lasts for several frames; a single one is noise.
    beyond = np.min([np.roll(beyond, s) for s in (-1, 0, 1)], axis=0)
    floats[floats] = kinematics.middle(motion, motion.times[floats])
    near = np.zeros(len(floats), bool)  # where a step or frozen poses make the accelerations
    margin = MARGIN * scatter.interval(motion.times)
    odd = [(t - margin, t) for t in motion.times[_steps(motion)]] + _frozen(recording)
    for start, end in odd:
        near |= (motion.times > start - margin) & (motion.times < end + margin)
    hit = ((beyond > 1) & floats & ~near) | jumps
    return [
        (motion.times[s[0]], motion.times[s[-1]])
        for s in kinematics.stretches(motion.times, hit, motion.scales.max_gap)
    ]


def _steps(motion: repair.Motion) -> Flags:
    """At which jumps only the measured pose steps, as when the mocap's cameras change: the craft goes on as
    before, whereas a blow leaves it with another velocity."""
    found = np.zeros(len(motion.times), bool)
    usual = scatter.interval(motion.times)
    for i in np.flatnonzero(motion.jumps):
        before, after = slice(max(0, i - 2 * MARGIN), max(0, i - MARGIN)), slice(i, i + MARGIN)
        if len(motion.times[before]) < MARGIN or len(motion.times[after]) < MARGIN:
            continue
        places = motion.measured[:, :2]
        lines = [np.polyfit(motion.times[s] - motion.times[i], places[s], 1) for s in (before, after)]
        change, step = np.linalg.norm(lines[1] - lines[0], axis=1)
        bend = np.linalg.norm(np.diff(places[i - MARGIN : i + 2], 2, axis=0), axis=1).max()
        found[i] = bool(change * usual < STEPS * bend and step < STEP * motion.noise[0])
    return found


def _landing(recording: Recording, contacts: Sequence[Span]) -> float:
    """When the floor begins to brake a craft whose lift was not recorded [s, clock of the stamps]: the first
    of some contacts after the last thrust, because the lift may end with it. Infinite without one."""
    driven = np.flatnonzero(recording.thrust.any(axis=1))
    if (recording.lift > 0).any() or not len(driven) or driven[-1] + 1 == len(recording.thrust):
        return np.inf
    last = recording.control_times[driven[-1] + 1]
    return min((start for start, _ in contacts if start > last), default=np.inf)


def lifted(recording: Recording, times: Array) -> Flags:
    """Whether the lift is on at some times (n,) [s], or was until then; where it was not recorded, it
    counts as on."""
    if not (recording.lift > 0).any():
        return np.ones(len(times), bool)
    around = times + np.array([[-AT_ONCE], [AT_ONCE]])
    return np.asarray(recording.held(recording.lift, around).max(axis=0) > 0)


def _levels(recording: Recording) -> Array:
    """Commands that the thrusters can be given, a grid (k, n)."""
    thrust = recording.thrust
    least = np.where(thrust.min(axis=0) < 0, -1.0, 0.0)
    count = MOST_LEVELS.get(thrust.shape[1], 2)
    grid = itertools.product(*[np.linspace(low, 1, count) for low in least])
    return np.array(list(grid))
