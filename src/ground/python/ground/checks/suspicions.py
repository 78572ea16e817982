"""Mistakes that a recording looks like, each with its evidence and the option that mends it.

Nothing is changed: another unit, axis or channel is the user's to choose. A check is a function of a
Recording in CHECKS.
"""

import math
from dataclasses import asdict, dataclass, replace
from typing import Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np
from scipy import constants

from ground import _core
from ground.checks import angle_signs, imitations, layouts, other_clocks, reply
from ground.checks.quality import RepairedRun, repaired
from ground.poses import kinematics, scatter
from ground.reading import units
from ground.reading.recording import Recording, once
from ground.support.errors import GroundError

CHANGED = "changed"  # kind: the craft of a run changed
MIN_SPEED = 5e-3  # least speed of a craft that turns [m/s]
FINEST = 5e-6  # no mocap measures a craft that moves more precisely [m]
TURNS = 0.3  # yaw rate from which a craft also moves [rad/s]
# Delays that scatter explains, that one clock explains, and that may be the craft's own, all at once; shares
# of reply.turn_time(). What velocities do to a craft while it answers shifts a delay by as little.
EARLIEST, DELAYED, LATEST = -0.043, 0.22, 0.45
BLURRED = 0.05  # uncertainty of a delay by poses of 100 Hz [s]
MIN_DRIFT = 0.03  # least change of the delay from the begin to the end of a run [s]
FADED = 0.5  # share of a command's effect below which other commands act most of the time
LEAST_SHARE = 0.05  # share of the accelerations that commands explain, below which their ages decide nothing
WHOLE = 0.8  # share above which an effect lasts, at the lag of a wrong clock
BOUND = 1.645  # standard errors of a bound of 95%
CLEAR = 2.5  # least evidence of another clock, in its standard errors
MIN_COMMAND = 0.1  # full thrust of commands of which none exceeds this is less than 1
MIN_CHANGES = 20  # changes of the commands that a delay can be determined from
# Kinds of mistakes that effects of a model can also explain: heading_offset, input_delay, other thrust,
# thruster_gain; missing commands, at which motion hints only; a low-pass of poses, which is undone; and a
# craft that changed.
EXPLAINED = ("offset", "delay", "command", "weak", "missing", "smoothed", CHANGED)
SIMULATOR = "simulator"  # the node that moves the simulated craft
# Its parameters that change the craft, as LiveChange names them
OF_CRAFT = ("model", *(name + "_factor" for name in ("k", "m", "I_z", "X_u", "Y_v", "N_r")))
MIN_TURNING = 4  # thrusters that turn the craft, from which one that does not stands out
WEAK = 0.5  # share of the moment that its place promises, below which a thruster is weak
Thrusters = Tuple[layouts.Thruster, ...]
# A left and a right thruster; the moments of any lever are the same but for a factor.
PAIR: Thrusters = (layouts.Thruster("left", 0.0, -1.0, 0.0), layouts.Thruster("right", 0.0, 1.0, 0.0))


@dataclass(frozen=True)
class Suspicion:
    """A mistake that some recordings look like."""

    kind: str  #: the mistake, in a word
    evidence: str  #: the evidence
    remedy: str  #: option or key of a mapping that corrects it
    runs: Tuple[str, ...] = ()  #: names of the recordings

    @property
    def misread(self) -> bool:
        """Whether a model of such recordings would be wrong."""
        return self.kind not in EXPLAINED

    @property
    def sentence(self) -> str:
        """In words."""
        return "%s: %s" % (", ".join(self.runs), sentence(self.describe()))

    def describe(self) -> Dict[str, object]:
        """As plain values."""
        return {**asdict(self), "runs": list(self.runs), "misread": self.misread}


def sentence(d: Mapping[str, object]) -> str:
    """A described Suspicion in words, without the recordings."""
    joint = ": " if d["kind"] == CHANGED else "; if so: "  # a change is recorded, no suspicion
    return joint.join([str(d["evidence"]), str(d["remedy"])])


@once
def of(recording: Recording) -> List[Suspicion]:
    """The Suspicions of a Recording."""
    every = (one for check in CHECKS for one in check(recording))
    return [replace(one, runs=(recording.name,)) for one in every]


def changed(run: RepairedRun, start: float = 0.0, end: float = math.inf) -> Iterator[Suspicion]:
    """Whether somebody changed the simulated craft between two times of a run [s], so that no model fits."""
    every = [(one.time - run.zero, one) for one in run.recording.changes]
    found = [(time, one) for time, one in every if is_of_craft(one.node, one.name) and start < time < end]
    if found:
        texts = ["%s %s -> %s at %.2f s" % (c.name, c.before, c.after, time) for time, c in found]
        before, after = math.floor(10 * found[0][0]) / 10, math.ceil(10 * found[-1][0]) / 10
        yield Suspicion(
            CHANGED,
            "the simulated craft changed (%s), so one model cannot fit the whole run" % ", ".join(texts),
            "use a part without the change, --to %.1f or --from %.1f" % (before, after),
            (run.recording.name,),
        )


def is_of_craft(node: str, name: str) -> bool:
    """Whether a parameter of a node, when changed, changes the simulated craft."""
    return node.strip("/") == SIMULATOR and name in OF_CRAFT


def about(recordings: Sequence[Recording], model: Optional[_core.Model]) -> List[Suspicion]:
    """The Suspicions of recordings of a craft; model: its model, if there is one. Those about channels and
    headings that all recordings share are reported once."""
    every = [one for recording in recordings for one in of(recording)]
    if model is not None and _turns(model):
        return every + list(_angles(recordings, model))
    thrusters = judged_by(recordings, model)
    if not thrusters:
        return every
    return [one for one in every if one.kind not in layouts.GRAVEST] + _of_craft(recordings, thrusters, model)


def _turns(model: _core.Model) -> bool:
    """Whether a rudder or a thruster of a craft turns."""
    return any(thruster["is_angle"] for thruster in model.thrusters)


def judged_by(recordings: Sequence[Recording], model: Optional[_core.Model]) -> Thrusters:
    """The thrusters by which the channels of a craft are judged; none where they are not: without a model,
    unless it is a pair, and where a thruster turns."""
    if model is None:
        return PAIR if all(set(one.thrusters) == {"left", "right"} for one in recordings) else ()
    found = () if _turns(model) else tuple(layouts.thrusters_of(model))
    return PAIR if _is_pair(found) else found


def _is_pair(thrusters: Sequence[layouts.Thruster]) -> bool:
    """Whether thrusters do the same as PAIR, but for a factor."""
    found = {one.name: one for one in thrusters}
    if set(found) != {"left", "right"} or any(one.direction for one in thrusters):
        return False
    return found["left"].y < 0 and abs(found["left"].y + found["right"].y) < 1e-9


def lengths(recording: Recording) -> Iterator[Suspicion]:
    """Positions in millimetres, centimetres or inches, by speeds that no craft in a room has."""
    motion = recording.motion
    noise = motion.noise[0]
    likely, fast = units.length_units(recording.pose_times, recording.eta[:, :2], noise)
    hard = float(np.quantile(np.linalg.norm(motion.nu_dot[:, :2], axis=1), 0.95))
    # thrusters hardly accelerate a craft by more than gravity; a boat is fast as well, but slow to be so
    if likely and (fast > units.FASTEST or hard > constants.g):
        yield Suspicion(
            "length",
            "the craft reaches %.0f m/s and the poses scatter by %.2g m: positions seem to be in %s%s"
            % (fast, noise, " or ".join(likely), ", which speed and noise do not decide" * (len(likely) > 1)),
            " or ".join("position: {unit: %s}" % unit for unit in likely) + " under poses in a mapping",
        )
    turning = units.speed(recording.pose_times, np.unwrap(recording.eta[:, 2])[:, None])
    if fast < MIN_SPEED and turning > TURNS and noise < FINEST:
        yield Suspicion(
            "length",
            "the craft turns at %.2g rad/s, but reaches only %.1g m/s: positions seem to be in a larger "
            "unit than the mapping says" % (turning, fast),
            "position: {unit: m}, or another scale, under poses in a mapping",
        )


def missing(recording: Recording) -> Iterator[Suspicion]:
    """Commands that were not recorded, by the effect of those before them, which ends before the next one."""
    follows = repaired(recording).reply
    if not follows or follows["slow"] or follows["share"] < LEAST_SHARE:
        return
    lag = reply.lag_of(recording)  # below zero by missing commands, or by a clock that alone explains it
    if lag <= reply.LAGS[1]:  # a motion so slow that its delay is not known
        return
    found, alone = (reply.fading(recording, one) for one in (max(lag, 0.0), lag))
    if found and alone and found[0] + BOUND * found[1] < FADED and alone[0] - BOUND * alone[1] < WHOLE:
        yield Suspicion(
            "missing",
            "%.2g s after a command, %.0f%% of its effect remains: commands between the recorded ones are "
            "missing, or their stamps are wrong by varying times" % (found[2], 100 * max(found[0], 0.0)),
            "record all commands as the craft receives them; otherwise a fit underestimates the thrust",
        )


def clocks(recording: Recording) -> Iterator[Suspicion]:
    """Stamps of two computers, by the time from command to motion and its change."""
    if (np.abs(np.diff(recording.thrust, axis=0)) > 1e-6).any(axis=1).sum() < MIN_CHANGES:
        return
    found = reply.find(recording)
    if found and found["early"]:
        yield Suspicion(
            "clock",
            "the motion comes %.0f ms (+- %.0f) before its command: commands are stamped late, or the clocks "
            "of poses and commands differ" % (-1e3 * found["lag"], reply.SIDES * 1e3 * found["error"]),
            "clock_offset: %.2f in a mapping" % -found["lag"],
        )
        return
    follows = repaired(recording).reply
    motion = repaired(recording).motion
    # The limits already contain BLURRED.
    slack = max(0.0, max(kinematics.blur(motion)) + scatter.interval(motion.times) - BLURRED)
    early, usual, longest = (share * reply.turn_time(motion) for share in (EARLIEST, DELAYED, LATEST))
    for clock in other_clocks.find(recording):
        lag = follows["lag"] if follows and not follows["slow"] else clock.lag
        drifts = abs(clock.rate) > MIN_DRIFT / repaired(recording).end
        if not drifts and (clock.rate or early - slack <= lag <= usual + slack):
            continue
        if clock.evidence() < CLEAR:  # slow motors, or a loop that a controller closes
            continue
        if drifts:
            yield Suspicion(
                "drift",
                "poses and commands drift apart by %.1f ms per second: their clocks probably belong to two "
                "computers" % (1e3 * clock.rate),
                "clock_drift: %.5f in a mapping" % -clock.rate,
            )
            return
        late = usual < lag <= longest
        yield Suspicion(
            "delay" if late else "clock",
            "the craft moves %.0f ms %s its commands%s: the clocks of poses and commands probably belong "
            "to two computers"
            % (
                1e3 * abs(lag),
                "BEFORE" if lag < 0 else "after",
                " and at once, unlike a craft with a motor lag" if late else "",
            ),
            "clock_offset: %.2f in a mapping, which leaves the craft's own delay open" % -lag,
        )
        return  # the search with a drift and the one without may find the same


def smoothing(recording: Recording) -> Iterator[Suspicion]:
    """Poses that the mocap's software smoothed, by their noise and by how the motion follows the commands."""
    found = recording.motion.low_pass
    if found is None:
        return
    late = "the motion is %.0f ms late" % (1e3 * found.delay)
    yield Suspicion(
        "smoothed",
        "the mocap seems to smooth at %.2g Hz (%s): %s"
        % (found.corner, found.form, "forward and backward" if found.both_ways else late),
        "switch off the mocap software's filter; the filter is undone in these poses",
    )


def forces(recording: Recording) -> Iterator[Suspicion]:
    """Commands in newtons or another unit in which full thrust is far below 1."""
    most = float(np.abs(recording.thrust).max())
    if repaired(recording).reply and most < MIN_COMMAND:
        yield Suspicion(
            "command",
            "the craft moves, but no command exceeds %.2g of full thrust: commands are probably in newtons "
            "or another unit" % most,
            "full: the value of full thrust, for each channel under commands.channels in a mapping",
        )


def directions(recording: Recording) -> Iterator[Suspicion]:
    """Swapped, inverted and dead thrusters, and headings of another sign or zero, of a craft with a left and
    a right one."""
    if set(recording.thrusters) == {"left", "right"}:
        yield from _worded([recording], PAIR, alone(recording, PAIR))


def alone(recording: Recording, thrusters: Thrusters) -> Optional[layouts.LayoutVerdict]:
    """The verdict of a recording by itself, which it keeps; None without one."""
    known = recording.known.setdefault("alone", {})
    if thrusters not in known:
        replies = thrusters != PAIR or repaired(recording).reply
        known[thrusters] = _judged([recording], thrusters) if replies else None
    found: Optional[layouts.LayoutVerdict] = known[thrusters]
    return found


CHECKS = (lengths, smoothing, missing, clocks, forces, directions)


def _angles(recordings: Sequence[Recording], model: _core.Model) -> Iterator[Suspicion]:
    """Angles of rudders and turning thrusters that seem to be recorded with the wrong sign."""
    try:
        found = angle_signs.find(recordings, model)
    except GroundError:  # other channels
        return
    for one in found:
        yield Suspicion(
            "invert",
            "the angle %s seems to have the wrong sign: the commands would then explain %.0f%% of the "
            "turns; as recorded they explain %.0f%%" % (one.channel, 100 * one.share, 100 * one.as_recorded),
            "toggle sign: -1 of %s %s" % (one.channel, layouts.CHANNELS),
            tuple(recording.name for recording in recordings),
        )


def _of_craft(
    recordings: Sequence[Recording], thrusters: Thrusters, model: Optional[_core.Model]
) -> List[Suspicion]:
    """Suspicions about the channels and headings of a craft. What all recordings together look like says it
    all, unless one of them alone refutes it."""

    def confirmed(
        verdict: Optional[layouts.LayoutVerdict], some: Sequence[Recording]
    ) -> Optional[layouts.LayoutVerdict]:
        return verdict and imitations.confirmed(verdict, some, thrusters, model)

    own_ones = [confirmed(alone(one, thrusters), [one]) for one in recordings]
    together = confirmed(_judged(recordings, thrusters), recordings) if len(recordings) > 1 else None
    if together and not together.is_as_recorded and all(_leaves_open(own, together) for own in own_ones):
        return list(_worded(recordings, thrusters, together))
    found = [s for one, own in zip(recordings, own_ones) for s in _worded([one], thrusters, own)]
    return found or [one for recording in recordings for one in _weak(recording, thrusters)]


def _leaves_open(own: Optional[layouts.LayoutVerdict], together: layouts.LayoutVerdict) -> bool:
    """Whether a recording's own verdict leaves open what all of them look like."""
    if own is None or own.open_share > layouts.HARDLY:
        return True
    ways = [own.best.hypothesis, *own.same, *(found.hypothesis for found in own.undecided)]
    return _to_quarters(together.best.hypothesis) in map(_to_quarters, ways)


def _to_quarters(one: layouts.Hypothesis) -> layouts.Hypothesis:
    """A hypothesis with its heading's offset rounded to quarter turns, in these."""
    return replace(one, heading_offset=float(round(2 * one.heading_offset / np.pi)))


def _weak(recording: Recording, thrusters: Sequence[layouts.Thruster]) -> Iterator[Suspicion]:
    """Thrusters that turn the craft much less in a run than their place and the others promise."""
    levers = {one.name: one.effect[2] for one in thrusters}
    longest = max((abs(lever) for lever in levers.values()), default=0.0)
    turning = [name for name, lever in levers.items() if abs(lever) > WEAK * longest > 0]
    if len(turning) < MIN_TURNING:
        return
    found = reply.authorities(recording)
    if set(found) != set(levers):
        return
    rates = {name: found[name]["turn"] / levers[name] for name in turning}
    usual = float(np.median(list(rates.values())))
    for name in turning:
        error = found[name]["errors"][2]
        most = rates[name] * np.sign(usual) + reply.CERTAIN * error / abs(levers[name])
        if most < WEAK * abs(usual):
            yield Suspicion(
                "weak",
                "%s turns the craft by %.2g +- %.1g rad/s2, but its position gives %.2g: it does little or "
                "nothing in this run" % (name, found[name]["turn"], error, usual * levers[name]),
                "leave the run out: it makes all thrusts look smaller",
                (recording.name,),
            )


def _judged(
    recordings: Sequence[Recording], thrusters: Sequence[layouts.Thruster]
) -> Optional[layouts.LayoutVerdict]:
    """The verdict of recordings; None where the commands change too little."""
    try:
        return layouts.judge(recordings, thrusters)
    except GroundError:
        return None


def _worded(
    recordings: Sequence[Recording],
    thrusters: Sequence[layouts.Thruster],
    verdict: Optional[layouts.LayoutVerdict],
) -> Iterator[Suspicion]:
    """The suspicion about recordings of a craft, where they refute their channels and headings."""
    if verdict is None or verdict.is_as_recorded:
        return
    names, measured = [thruster.name for thruster in thrusters], recordings[0].settings
    ways = [verdict.best.hypothesis, *verdict.same]
    what = [layouts.suppositions(way, names, seem=not i) for i, way in enumerate(ways)]
    yield Suspicion(
        layouts.kind(ways[0], names),
        "%s: %s" % (", or equally ".join(what), layouts.evidence(verdict)),
        ", or ".join(layouts.remedies(way, names, measured) for way in ways),
        tuple(recording.name for recording in recordings),
    )
