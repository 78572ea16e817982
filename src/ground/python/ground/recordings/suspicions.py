"""Mistakes that a recording looks like, each with its evidence and the option that mends it.

Nothing is changed: another unit, axis or channel is the user's to choose. A check is a function of a Run
in CHECKS.
"""

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Callable, Iterator, List, Sequence, Tuple

import numpy as np

from ground.annotations import Array, Document
from ground.recordings import reply, units

if TYPE_CHECKING:
    from ground.recordings.quality import Run

MIN_SPEED = 5e-3  # least speed of a craft that turns [m/s]
TURNS = 0.3  # yaw rate from which a craft also moves [rad/s]
LATEST = 0.3  # largest delay of the motion on one clock [s]
EARLIEST = -0.03  # least delay: motion cannot come before its command [s]
MIN_CHANGES = 20  # changes of the commands that a delay can be determined from
CLEARLY = 0.15  # additional share of forces or turns that another reading has to explain
TIMES = 3.0  # least ratio of what another reading explains to what the recorded one does


@dataclass(frozen=True)
class Suspicion:
    """A mistake that a recording looks like."""

    kind: str  #: the mistake, in a word
    evidence: str  #: what it shows by
    remedy: str  #: option or key of a mapping that mends it

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
    """Positions in millimetres or centimetres, by speeds that no craft in a room has."""
    recording = run.recording
    unit, fast = units.length_unit(recording.pose_times, recording.eta[:, :2], run.motion.noise[0])
    if unit:
        yield Suspicion(
            "length",
            "the craft goes %.0f m/s and the poses scatter by %.2g m: positions seem to be in %s"
            % (fast, run.motion.noise[0], unit),
            "position: {unit: %s} under poses in a mapping" % unit,
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
    """Stamps of two computers, by the time from command to motion."""
    changes = (np.abs(np.diff(run.recording.thrust, axis=0)) > 1e-6).any(axis=1).sum()
    if changes < MIN_CHANGES:
        return
    lag = run.reply["lag"] if run.reply else reply.far_lag(run.recording, run.motion)
    if lag is None or EARLIEST <= lag <= LATEST:
        return
    yield Suspicion(
        "clock",
        "the motion comes %.0f ms %s its commands: the stamps seem to be of two computers' clocks"
        % (1e3 * abs(lag), "BEFORE" if lag < 0 else "after"),
        "clock_offset: %.2f in a mapping, which leaves the craft's own delay open" % -lag,
    )


@dataclass(frozen=True)
class Reading:
    """How the commands and headings of a craft with a left and a right thruster may be meant."""

    what: str
    remedy: str
    kind: str
    signs: Tuple[int, int] = (1, 1)  # signs of left and right
    swapped: bool = False
    turn: float = 0.0  # turn of the body's x axis [rad]
    heading: int = 1  # sign of the heading that forces act along
    yaw: int = 1  # sign of the yaw rate


EXCHANGE = "exchange the values off and full of %s under commands.channels in a mapping"
AS_RECORDED = Reading("", "", "")
READINGS = (
    Reading(
        "left and right seem to be swapped, or the mocap's vertical axis to point the other way",
        "exchange the fields of left and right under commands.channels in a mapping, or %s",
        "swap",
        swapped=True,
    ),
    Reading("both thrusters seem to be inverted", EXCHANGE % "both", "invert", signs=(-1, -1)),
    Reading("left seems to be inverted", EXCHANGE % "left", "invert", signs=(-1, 1)),
    Reading("right seems to be inverted", EXCHANGE % "right", "invert", signs=(1, -1)),
    Reading(
        "the heading seems to be off by half a turn", "--heading-offset %.2f", "offset", turn=np.pi
    ),
    Reading(
        "the heading seems to be off by a quarter turn",
        "--heading-offset %.2f",
        "offset",
        turn=np.pi / 2,
    ),
    Reading(
        "the heading seems to be off by a quarter turn",
        "--heading-offset %.2f",
        "offset",
        turn=-np.pi / 2,
    ),
    Reading(
        "the heading seems to have the wrong sign",
        "heading: {sign: -1} under poses in a mapping",
        "yaw",
        heading=-1,
        yaw=-1,
    ),
    Reading(
        "the positions seem to be mirrored",
        "a minus before one of position's fields under poses in a mapping",
        "mirror",
        heading=-1,
    ),
)


def directions(run: "Run") -> Iterator[Suspicion]:
    """Swapped and inverted thrusters, and headings of another sign or zero, by the accelerations that
    the commands explain when they are read so."""
    recording = run.recording
    if not run.reply or set(recording.thrusters) != {"left", "right"}:
        return
    samples = reply.samples(recording, run.motion, run.reply["lag"])
    shares = {reading: _shares(samples, reading) for reading in (AS_RECORDED, *READINGS)}
    best = max(shares, key=lambda reading: sum(shares[reading]))
    pairs = zip(shares[AS_RECORDED], shares[best])
    if not any(then - now > CLEARLY and then > TIMES * now for now, then in pairs):
        return
    evidence = "the commands explain %.0f%% of the forces and %.0f%% of the turns then, %.0f%% and %.0f%% "
    evidence = evidence % tuple(100 * s for s in (*shares[best], *shares[AS_RECORDED]))
    yield Suspicion(
        best.kind, "%s: %sas they are" % (best.what, evidence), _remedy(run, best)
    )


def _remedy(run: "Run", reading: Reading) -> str:
    settings, remedy = run.recording.settings, str(reading.remedy)
    if reading.kind == "offset":
        before = settings.changes[0].heading_offset
        return remedy % float(np.angle(np.exp(1j * (before + reading.turn))))
    if reading.kind == "swap":
        return remedy % ('--axes "%s"' % units.upside_down(settings.changes[0].axes))
    return remedy


def _shares(samples: "reply.Samples", reading: Reading) -> Tuple[float, float]:
    """Shares of the forces and of the turns that the commands explain."""
    force, turning, left, right = samples.turned(reading.heading, reading.yaw)
    if reading.swapped:
        left, right = right, left
    left, right = reading.signs[0] * left, reading.signs[1] * right
    along = np.array([np.cos(reading.turn), -np.sin(reading.turn)])
    by_force = _explained(force @ along, left + right, force)
    by_turning = _explained(turning, left - right, turning)
    return by_force, by_turning


def _explained(values: Array, by: Array, every: Array) -> float:
    """Share of the sum of squares of `every` that a factor, not negative, of `by` explains in `values`."""
    size, total, product = float(by @ by), float((every**2).sum()), float(values @ by)
    return product**2 / size / total if size > 0 and total > 0 and product > 0 else 0.0


Check = Callable[["Run"], Iterator[Suspicion]]
CHECKS: Sequence[Check] = (lengths, angles, clocks, directions)
