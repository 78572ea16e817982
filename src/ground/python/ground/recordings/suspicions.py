"""Mistakes that a recording looks like, each with its evidence and the option that mends it.

Nothing is changed: another unit, axis or channel is the user's to choose. A check is a function of a Run
in CHECKS.
"""

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Callable, Iterator, List, Sequence, Tuple

import numpy as np

from ground import _core
from ground.annotations import Document
from ground.errors import GroundError
from ground.recordings import layouts, repair, reply, units
from ground.recordings.layouts import verdicts, words

if TYPE_CHECKING:
    from ground.recordings.quality import Run
    from ground.recordings.recording import Recording

MIN_SPEED = 5e-3  # least speed of a craft that turns [m/s]
TURNS = 0.3  # yaw rate from which a craft also moves [rad/s]
LATEST = 0.3  # largest delay of the motion on one clock [s]
EARLIEST = -0.03  # least delay: motion cannot come before its command [s]
DELAYED = 0.15  # largest delay of the motion, all at once [s]
DRIFTING = 5.0  # least drift of two clocks, in its standard errors
DELAYS = np.arange(EARLIEST, DELAYED + 0.005, 0.01)  # delays that one clock explains [s]
CLEAR = 2.5  # least evidence of another clock, in its standard errors
MIN_DRIFT = 0.03  # least change of the delay from the begin to the end of a run [s]
MIN_COMMAND = 0.1  # full thrust of commands of which none exceeds this is less than 1
MIN_CHANGES = 20  # changes of the commands that a delay can be determined from
# Kinds of mistakes that effects of a model can also explain: heading_offset, input_delay, other thrust.
EXPLAINED = ("offset", "delay", "command")
# A left and a right thruster; the moments of any lever are the same but for a factor.
PAIR = (layouts.Thruster("left", 0.0, -1.0, 0.0), layouts.Thruster("right", 0.0, 1.0, 0.0))


@dataclass(frozen=True)
class Suspicion:
    """A mistake that a recording looks like."""

    kind: str  #: the mistake, in a word
    evidence: str  #: what it shows by
    remedy: str  #: option or key of a mapping that mends it

    @property
    def what(self) -> str:
        """What seems to be wrong, without the figures."""
        return self.evidence.split(":")[0]

    def describe(self) -> Document:
        """As plain values."""
        return asdict(self)


def sentence(d: Document) -> str:
    """A described Suspicion in words."""
    return "%s; if so: %s" % (d["evidence"], d["remedy"])


def of(run: "Run") -> List[Suspicion]:
    """The Suspicions of a Run."""
    return [suspicion for check in CHECKS for suspicion in check(run)]


def lengths(run: "Run") -> Iterator[Suspicion]:
    """Positions in millimetres, centimetres or inches, by speeds that no craft in a room has."""
    recording = run.recording
    scatter = repair.scatter(run.motion.times, run.motion.measured)
    noise = run.motion.noise[0] if scatter is None else float(np.hypot(*scatter[:2]) / np.sqrt(2))
    likely, fast = units.length_units(recording.pose_times, recording.eta[:, :2], noise)
    if likely:
        yield Suspicion(
            "length",
            "the craft goes %.0f m/s and the poses scatter by %.2g m: positions seem to be in %s%s"
            % (fast, noise, " or ".join(likely), ", which speed and noise cannot decide" * (len(likely) > 1)),
            " or ".join("position: {unit: %s}" % unit for unit in likely) + " under poses in a mapping",
        )
    turning = units.speed(recording.pose_times, np.unwrap(recording.eta[:, 2])[:, None])
    if fast < MIN_SPEED and turning > TURNS:
        yield Suspicion(
            "length",
            "the craft turns by %.2g rad/s, but goes %.1g m/s only: positions seem to be in a larger "
            "unit than the mapping says" % (turning, fast),
            "position: {unit: m}, or another scale, under poses in a mapping",
        )


def angles(run: "Run") -> Iterator[Suspicion]:
    """Headings in degrees, by turns that no craft makes."""
    recording = run.recording
    if "axes" in recording.settings.taken:  # headings of quaternions have no unit
        return
    if units.in_degrees(recording.pose_times, recording.eta[:, 2]):
        yield Suspicion(
            "angle",
            "headings reach %.0f and change by %.0f a second: they seem to be in degrees"
            % (
                np.abs(recording.eta[:, 2]).max(),
                units.speed(recording.pose_times, recording.eta[:, 2:]),
            ),
            "heading: {unit: deg} under poses in a mapping",
        )


def clocks(run: "Run") -> Iterator[Suspicion]:
    """Stamps of two computers, by the time from command to motion and its change."""
    if len(reply.changes(run.recording)) < MIN_CHANGES:
        return
    recording, motion = run.recording, run.motion
    drift = reply.drift(recording, motion)
    drifts = abs(drift.rate) > max(DRIFTING * drift.error, MIN_DRIFT / run.end)
    if drifts and reply.drift_evidence(recording, motion, drift) > CLEAR:
        yield Suspicion(
            "drift",
            "the motion falls behind its commands by %.1f ms a second (+- %.1f): the stamps seem to be of "
            "two computers' clocks that run at different rates" % (1e3 * drift.rate, 1e3 * drift.error),
            "clock_drift: %.5f in a mapping" % -drift.rate,
        )
        return
    lag = run.reply["lag"] if run.reply else reply.far_lag(recording, motion)
    if lag is None or EARLIEST <= lag <= DELAYED:
        return
    if reply.lag_evidence(recording, motion, lag, DELAYS) < CLEAR:
        return  # slow motors, or a loop that a controller closes
    late = DELAYED < lag <= LATEST
    yield Suspicion(
        "delay" if late else "clock",
        "the motion comes %.0f ms %s its commands%s: the stamps seem to be of two computers' clocks"
        % (
            1e3 * abs(lag),
            "BEFORE" if lag < 0 else "after",
            " and all at once, as no motor's lag explains" if late else "",
        ),
        "clock_offset: %.2f in a mapping, which leaves the craft's own delay open" % -lag,
    )


def forces(run: "Run") -> Iterator[Suspicion]:
    """Commands in newtons or another unit in which full thrust is far below 1."""
    most = float(np.abs(run.recording.thrust).max())
    if run.reply and most < MIN_COMMAND:
        yield Suspicion(
            "command",
            "the craft is driven, but no command exceeds %.2g of full thrust: commands seem to be in newtons "
            "or another unit" % most,
            "full: the value that is full thrust, for each channel under commands.channels in a mapping",
        )


def directions(run: "Run") -> Iterator[Suspicion]:
    """Swapped, inverted and dead thrusters, and headings of another sign or zero, of a craft with a left and
    a right one."""
    if run.reply and set(run.recording.thrusters) == {"left", "right"}:
        yield from _of_layout([run], PAIR)


@dataclass(frozen=True)
class Finding:
    """A Suspicion about some recordings."""

    runs: Tuple[str, ...]  #: their names
    suspicion: Suspicion

    def describe(self) -> Document:
        """As plain values."""
        return {"runs": list(self.runs), **self.suspicion.describe(), "misread": self.misread}

    @property
    def misread(self) -> bool:
        """Whether a model of such recordings would be wrong."""
        return self.suspicion.kind not in EXPLAINED

    @property
    def sentence(self) -> str:
        """In words."""
        return "%s: %s" % (", ".join(self.runs), sentence(self.suspicion.describe()))


def of_thrusters(recordings: Sequence["Recording"], model: _core.Model) -> List[Finding]:
    """Findings about the channels and headings of a craft with other thrusters than a left and a right
    one; those of a pair are among the Suspicions of each Run."""
    if model.is_pair:
        return []
    thrusters = layouts.thrusters_of(model)
    alone = [
        Finding((r.name,), one) for r in recordings for one in _of_layout([r.repaired], thrusters)
    ]
    every = [r.repaired for r in recordings]
    together = [
        Finding(tuple(r.name for r in recordings), one) for one in _of_layout(every, thrusters)
    ]
    said = {finding.suspicion.what for finding in together}
    return together if {finding.suspicion.what for finding in alone} <= said else alone


def of_runs(recordings: Sequence["Recording"]) -> List[Finding]:
    """The Suspicions of each Run as Findings."""
    return [Finding((r.name,), one) for r in recordings for one in r.repaired.suspicions]


def _of_layout(
    runs: Sequence["Run"], thrusters: Sequence[layouts.Thruster]
) -> Iterator[Suspicion]:
    """The suspicion about runs of a craft, where they refute their channels and headings."""
    try:
        verdict = verdicts.of_runs(runs, thrusters)
    except GroundError:  # the commands change too little
        return
    if verdict.is_as_recorded:
        return
    names, measured = [thruster.name for thruster in thrusters], runs[0].recording.settings
    ways = [verdict.best.hypothesis, *verdict.same]
    remedies = [" and ".join(words.remedies(way, names, measured)) for way in ways]
    yield Suspicion(
        words.kind(ways[0], names),
        "%s: %s" % (words.alternatives(ways, names), words.evidence(verdict)),
        ", or ".join(remedies),
    )


Check = Callable[["Run"], Iterator[Suspicion]]
CHECKS: Sequence[Check] = (lengths, angles, clocks, forces, directions)
