"""Contents and oddities of a recording, in words."""

import datetime
from typing import Callable, Iterator, List, Sequence, Tuple, TypeVar

from ground.annotations import Document
from ground.recordings import quality, suspicions

_T = TypeVar("_T")

THIS_CENTURY = 946684800.0  # [s] since 1970
DRIVES_BY = {  # assumptions if no record says when the drive began
    "first command": "; assumed: the first command has lift, and no record says when it began",
    "start": "; assumed: no command has lift",
}
FEWEST_CHANGES = 20  # changes of the commands that show whether the motion follows them
CERTAIN = 3.0  # standard errors that an effect of a thruster exceeds
MAX_NAMED = 4  # gaps and other events that are listed; the rest is counted
MAX_CHANGES = 30  # live changes that are listed; the rest is counted


def when(d: Document) -> str:
    """When a recording begins, by its stamps."""
    if d["begins"] < THIS_CENTURY:
        return "from %.2f s on of a simulated clock" % d["begins"]
    moment = datetime.datetime.fromtimestamp(d["begins"], datetime.timezone.utc)
    return moment.strftime("%Y-%m-%d %H:%M:%S UTC")


def _flown_by(kind: str, name: str, d: Document) -> str:
    """A name, and the title of the file that was kept with the run."""
    kept = d["files"].get(kind)
    return "%s %s" % (kind, name) + (" ('%s', kept with the run)" % kept["title"] if kept else "")


def facts(d: Document) -> Iterator[Tuple[str, str]]:
    """Name and text of what a recording holds; d: as quality.Run.describe gives it."""
    poses, controls = d["poses"], d["controls"]
    noise = poses["noise"]
    yield "recorded", when(d)
    yield "source", d["source"]
    yield "measured", _measured(d["settings"])
    if d["flown_by"]:
        yield "flown by", ", ".join(
            _flown_by(kind, name, d) for kind, name in d["flown_by"].items()
        )
    spans = ", ".join("%.2f to %.2f" % tuple(s) for s in d["usable"]["spans"])
    yield "usable", "%.2f of %.2f s: %s" % (
        d["usable"]["duration"],
        d["duration"],
        spans or "nothing",
    )
    yield "poses", "%d at %.1f Hz, noise %.2f mm, %.1f mrad" % (
        poses["count"],
        poses["rate"],
        1e3 * noise["position"],
        1e3 * noise["heading"],
    )
    thrusters = controls["thrusters"]
    yield "commands", "%d at %.1f Hz, %d changes, %s %g to %g, lift %g to %g" % (
        controls["count"],
        controls["rate"],
        controls["changes"],
        "thrusters" if thrusters == list(quality.PAIR) else ", ".join(thrusters),
        *controls["levels"],
        *controls["lift"],
    )
    yield "drive", ", ".join(
        "from %.2f s on" % t if t >= 0 else "began %.2f s before the run" % -t
        for t in d["drives"]["begin"]
    ) + DRIVES_BY.get(d["drives"]["by"], "")
    if d["reply"]:
        yield "reply", "the craft's motion follows the commands by %.0f ms" % (
            1e3 * d["reply"]["lag"]
        )
    if d["authority"]:
        yield "thrusters", "; ".join(_does(*item) for item in d["authority"].items())


def _does(name: str, authority: Document) -> str:
    """What a thruster does at full input, as far as the recording tells."""
    forward, right, turn = (authority[key] for key in ("forward", "right", "turn"))
    errors = authority["errors"]
    parts = []
    for value, error, words, unit in (
        (forward, errors[0], ("forward", "backward"), "m/s2"),
        (right, errors[1], ("to the right", "to the left"), "m/s2"),
    ):
        if abs(value) > CERTAIN * error and abs(value) > 0.3 * max(abs(forward), abs(right)):
            parts.append("pushes %s (%.2g +- %.1g %s)" % (words[value < 0], abs(value), error, unit))
    if abs(turn) > CERTAIN * errors[2]:
        side = "right" if turn > 0 else "left"
        parts.append("turns %s (%.2g +- %.1g rad/s2)" % (side, abs(turn), errors[2]))
    return "%s %s" % (name, ", ".join(parts) or "does nothing that is certain")


def _measured(settings: Document) -> str:
    """Settings by which poses became world_ned, and their sources."""
    sources = settings["sources"]
    words = {
        "axes": "axes '%s' (%s)" % (settings["axes"], sources["axes"]),
        "heading_offset": "heading_offset %g rad (%s)"
        % (settings["heading_offset"], sources["heading_offset"]),
    }
    text = ", ".join(words[name] for name in settings["taken"]) or "as states, corrected already"
    for change in settings["changes"] if settings["taken"] else ():
        text += "; from %.2f s on axes '%s', heading_offset %g rad" % (
            change["time"],
            change["axes"],
            change["heading_offset"],
        )
    return text


def grave(d: Document) -> Iterator[str]:
    """Sentences on oddities whose repair may be wrong; all verbs print them, not only info."""
    poses, controls = d["poses"], d["controls"]
    if poses["stamps_out_of_order"]:
        yield "stamps out of order, sorted: %d" % poses["stamps_out_of_order"]
    if poses["frozen"]:
        yield "frozen poses (repeated samples of a moving craft), dropped: %d" % poses["frozen"]
    if abs(d["clock_offset"]) > 0.05:
        yield "the stamps of the poses are %.3f s off the clock of the commands, shifted" % (
            -d["clock_offset"]
        )
    suspected = {s["kind"] for s in d["suspicions"]}
    yield from map(suspicions.sentence, d["suspicions"])
    if "clock" in suspected:
        return
    if controls["changes"] >= FEWEST_CHANGES and not d["reply"]:
        yield "the motion does not follow the commands: are poses and commands of the same run?"


def findings(d: Document) -> Iterator[str]:
    """Sentences on what is odd and what was repaired."""
    yield from grave(d)
    yield from _frames(d["poses"])
    yield from _poses(d["poses"])
    yield from _overlap(d["controls"])
    if d["rest"] > 0.2:
        yield "the craft rests for %.2f s at the start, left out (--all takes it in)" % d["rest"]
    if d["rest_at_end"] > 0.2:
        yield "no lift, or the craft rests, for %.2f s at the end, left out (--all takes it in)" % (
            d["rest_at_end"]
        )
    if d["without_lift"]:
        yield "no lift, left out: %s" % _named(d["without_lift"], _span)
    if d["contacts"]:
        yield "wall or hand, likely (motion that no input explains), left out: %s" % _named(
            d["contacts"], _span
        )
    yield from _changes(d["changes"])
    if d["same_inputs_as"]:
        yield "the same sequence of inputs as %s" % ", ".join(d["same_inputs_as"])


def _frames(poses: Document) -> Iterator[str]:
    """Differences between the stamps and the instants of the frames."""
    clock = poses.get("frame_clock")
    if clock:
        late = clock["lateness"]
        yield (
            "stamps are late, in bursts or by a poll: %d of %d poses came within 1 ms of the one before; "
            "the clock of the frames is rebuilt: %.2f Hz, %d frames lost, stamps late by %.1f ms in "
            "the middle and %.0f ms at most"
            % (
                poses["bursts"],
                poses["count"],
                clock["rate"],
                clock["lost"],
                1e3 * late["median"],
                1e3 * late["largest"],
            )
        )
        if late["above_50_ms"]:
            yield "late bursts, stamps late by more than 50 ms: %d" % late["above_50_ms"]
    elif poses["bursts"]:
        yield "%d poses came within 1 ms of the one before" % poses["bursts"]


def _poses(poses: Document) -> Iterator[str]:
    """Poses that are missing, and those that were repaired."""
    if poses["gaps"]:
        yield "mocap lost %d times for more than 50 ms: %s" % (
            len(poses["gaps"]),
            _named(
                sorted(poses["gaps"], key=lambda g: float(-g["length"])),
                lambda g: "%.2f s at %.2f s" % (g["length"], g["start"]),
            ),
        )
    for count, what in (
        (poses["duplicate_stamps"], "repeated stamps"),
        (poses["overtaken"], "poses that overtook each other in a burst, put in order"),
        (poses["heading_wraps"], "wraps of the heading, unwrapped"),
        (poses["mirrored_headings"], "headings flipped to the wrong sign, undone"),
    ):
        if count:
            yield "%s: %d" % (what, count)
    if poses["spikes"]:
        yield "spikes, smoothed over: %s" % (_named(poses["spikes"], lambda t: "%.2f s" % t),)


def _overlap(controls: Document) -> Iterator[str]:
    """Where poses and commands do not begin or end together."""
    if controls["start_after_poses"] < -0.01:
        yield "commands start %.2f s before the poses" % -controls["start_after_poses"]
    if controls["start_after_poses"] > 0.2:
        yield "poses start %.2f s before the commands, left out" % controls["start_after_poses"]
    if controls["end_after_poses"] > 0.01:
        yield "poses end %.2f s before the commands" % controls["end_after_poses"]
    if controls["end_after_poses"] < -0.2:
        yield "commands end %.2f s before the poses, left out" % -controls["end_after_poses"]


def _changes(changes: List[Document]) -> Iterator[str]:
    """What was changed while the run was recorded."""
    for change in changes[:MAX_CHANGES]:
        yield "changed at %.2f s: %s: %s %s -> %s" % (
            change["time"],
            change["node"],
            change["name"],
            change["before"] or "''",
            change["after"] or "''",
        )
    if len(changes) > MAX_CHANGES:
        yield "%d more live changes (info --json lists them)" % (len(changes) - MAX_CHANGES)


def _span(d: Document) -> str:
    return "%.2f to %.2f s" % (d["start"], d["end"])


def _named(items: Sequence[_T], name: Callable[[_T], str]) -> str:
    text = ", ".join(name(item) for item in items[:MAX_NAMED])
    more = len(items) - MAX_NAMED
    return text + (" and %d more" % more if more > 0 else "")
