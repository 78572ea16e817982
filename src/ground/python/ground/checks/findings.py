"""What a recording holds and what is odd in it, as plain values and in words."""

import datetime
import json
from typing import Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground.checks import reply, suspicions
from ground.checks.quality import SHORTEST, RepairedRun, lifted, same_inputs
from ground.poses import angles, kinematics, repair, scatter
from ground.reading import words
from ground.reading.gathered import LATE
from ground.reading.instants import CENTURY
from ground.reading.recording import Recording
from ground.reading.run_settings import NAMES, RunFile
from ground.support.annotations import Document

DRIVES_BY = {  # assumptions if no record says when the drive began
    "first command": "; assumed: the first command has lift, and no record says when it began",
    "start": "; assumed: no command has lift",
}
FEWEST_CHANGES = 20  # changes of the commands that show whether the motion follows them
MAX_NAMED = 4  # gaps and other events that are listed; the rest is counted
GAP = 6.0  # a longer pause is a gap [usual intervals between poses]
EFFECTS = (  # what a thruster does forward, to the right, and as it turns: words, unit
    (("pushes forward", "pushes backward"), "m/s2"),
    (("pushes to the right", "pushes to the left"), "m/s2"),
    (("turns right", "turns left"), "rad/s2"),
)
BATTERY = (
    "%(first).2f V at the start, %(last).2f V at the end (%(least).2f to %(most).2f V), at %(rate).3g Hz"
)
UNUSABLE = "; %(unusable)d samples that are not positive numbers, left out"
PAIR = ["left", "right"]  # the thrusters of a usual craft
MAX_CHANGES = 30  # live changes that are listed; the rest is counted
Spans = Sequence[Mapping[str, float]]  # each with start and end [s]

# Poses that were repaired: key of their count, and words
REPAIRED = (
    ("duplicate_stamps", "repeated stamps"),
    ("held", "positions that only repeat the last fix, left out"),
    ("overtaken", "poses that overtook each other in a burst, put in order"),
    ("heading_wraps", "wraps of the heading, unwrapped"),
    ("mirrored_headings", "headings flipped to the wrong sign, undone"),
)
# Spans that are not usable: their key, and why
LEFT_OUT = (
    ("without_lift", "no lift, left out"),
    ("steps", "the measured pose jumps, as when a camera drops out; left out"),
    ("silent", "no commands for longer than their period; left out"),
    ("frozen", "the last pose is repeated while thrusters act, left out"),
    ("contacts", "no input explains the motion (contact, hand, wrong poses), left out"),
)
# Commands that begin or end at other times than the poses: key, sign, least time apart [s], and words
APART = (
    ("start_after_poses", -1, 0.01, "the commands start %.2f s before the poses"),
    ("start_after_poses", 1, 0.2, "poses start %.2f s before the commands, left out"),
    ("end_after_poses", 1, 0.01, "poses end %.2f s before the commands"),
    ("end_after_poses", -1, 0.2, "commands end %.2f s before the poses, left out"),
)


def describe(
    runs: Sequence[RepairedRun], every: Optional[Sequence[suspicions.Suspicion]] = None
) -> List[Document]:
    """`described` of runs, with the runs that have the same inputs. every: Suspicions of the craft, of which
    each run has those that are about it alone, instead of its own."""
    pairs, found = same_inputs(runs), [described(run) for run in runs]
    for d in found:
        d["same_inputs_as"] = [b if a == d["name"] else a for a, b in pairs if d["name"] in (a, b)]
        if every is not None:
            d["suspicions"] = [one.describe() for one in every if one.runs == (d["name"],)]
    return found


def described(run: RepairedRun) -> Document:
    """What a run holds and what is odd in it, as plain values; times are on the run's clock [s]."""
    recording = run.recording
    stamps, controls = recording.pose_times, recording.control_times
    times = run.motion.times - run.zero
    grounded = (times > run.active[0]) & (times < run.active[1])
    grounded &= ~lifted(recording, run.motion.times)
    return {
        "name": recording.name,
        "source": recording.source,
        "settings": recording.settings.describe(run.zero),
        "flown_by": recording.flown_by,
        "files": {kind: file.describe() for kind, file in recording.files.items()},
        "changes": [change.describe(run.zero) for change in recording.changes],
        "begins": float(stamps.min()),
        "warnings": recording.warnings,
        "duration": float(max(stamps.max(), controls[-1]) - min(stamps.min(), controls[0])),
        "usable": {
            "duration": run.usable(),
            "of": float(run.end),
            "spans": [list(span) for span in run.spans],
        },
        "rest": float(run.active[0]),
        "rest_at_end": float(run.end - run.active[1]),
        "without_lift": [
            {"start": float(times[s[0]]), "end": float(times[s[-1]])}
            for s in kinematics.stretches(times, grounded, run.motion.scales.max_gap)
        ],
        "drives": {"begin": [float(t) for t in run.drives], "by": run.drives_by},
        "poses": _poses_of(run),
        "controls": _controls_of(run),
        "authority": {} if list(recording.thrusters) == PAIR else reply.authorities(recording),
        "clock_offset": float(recording.clock_offset),
        "reply": run.reply,
        "inertial": None if run.inertial is None else run.inertial.describe(),
        "silent": [{"start": a, "end": b} for a, b in run.silent],
        "frozen": [{"start": a, "end": b} for a, b in run.frozen],
        "steps": [{"start": t, "end": t} for t in run.steps],
        "breaks": run.breaks,
        "unexplained": run.unexplained,
        "battery": None if recording.voltage is None else recording.voltage.describe(run.zero),
        "contacts": [{"start": float(a), "end": float(b)} for a, b in run.contacts],
        "repairs": run.motion.repairs,
        "suspicions": [one.describe() for one in suspicions.of(recording)],
    }


def _poses_of(run: RepairedRun) -> Document:
    """Contents of `info` on the poses."""
    recording, motion = run.recording, run.motion
    stamps = recording.pose_times
    steps = np.diff(np.sort(stamps))
    usual = scatter.interval(motion.times)
    third = scatter.third_differences(motion.times, motion.measured)
    intervals = np.diff(motion.times)
    poses = {
        "count": len(stamps),
        "rate": float((len(stamps) - 1) / (stamps.max() - stamps.min())),
        "noise": {
            "position": motion.noise[0],
            "heading": motion.noise[1],
            "given": recording.noise is not None,
        },
        "third_differences": None
        if third is None
        else {"position": float(np.hypot(*third[:2]) / np.sqrt(2)), "heading": float(third[2])},
        "interval": usual,
        "held": motion.repairs["positions held between fixes left out"],
        "gaps": [
            {"start": float(t - run.zero), "length": float(d)}
            for t, d in zip(motion.times[:-1], intervals)
            if d > GAP * usual
        ],
        "duplicate_stamps": int((steps == 0).sum()),
        "stamps_out_of_order": int((np.diff(stamps) < 0).sum()),
        "bursts": int((steps < repair.APART * usual).sum()),
        "heading_wraps": int((np.abs(np.diff(angles.wrap(motion.measured[:, 2]))) > np.pi).sum()),
        "mirrored_headings": motion.repairs["headings mirrored back"],
        "heading_steps": [{"time": float(t - run.zero), "angle": angle} for t, angle in motion.heading_steps],
        "frozen": motion.repairs["frozen poses dropped"],
        "overtaken": motion.repairs["poses that overtook each other put in order"],
        "spikes": [float(t - run.zero) for t in motion.spikes],
    }
    clock = motion.clock
    if clock is not None:
        late = clock.lateness
        lateness = {"median": float(np.median(late)), "largest": float(late.max())}
        lateness["above_50_ms"] = int((late > LATE).sum())
        poses["frame_clock"] = {"rate": clock.rate, "lost": clock.lost, "lateness": lateness}
    return poses


def _controls_of(run: RepairedRun) -> Document:
    """Contents of `info` on the commands."""
    recording, motion = run.recording, run.motion
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


def when(begins: float) -> str:
    """When a recording begins, by its first stamp [s]."""
    if begins < CENTURY:
        return "without a date; times begin at %.4g s" % begins
    moment = datetime.datetime.fromtimestamp(begins, datetime.timezone.utc)
    return moment.strftime("%Y-%m-%d %H:%M:%S UTC")


def facts(d: Document) -> Iterator[Tuple[str, str]]:
    """Name and text of what a recording holds; d: of `described`."""
    poses, controls, usable = d["poses"], d["controls"], d["usable"]
    yield "recorded", when(d["begins"])
    yield "source", d["source"]
    yield "measured", _measured(**d["settings"])
    kept = {kind: " ('%s', kept with the run)" % file["title"] for kind, file in d["files"].items()}
    if d["flown_by"]:
        by = ("%s %s%s" % (kind, name, kept.get(kind, "")) for kind, name in d["flown_by"].items())
        yield "flown by", ", ".join(by)
    spans = ", ".join("%.2f to %.2f" % tuple(span) for span in usable["spans"]) or "nothing"
    yield "usable", "%.2f of %.2f s: %s" % (usable["duration"], d["duration"], spans)
    noise = 1e3 * poses["noise"]["position"], np.degrees(poses["noise"]["heading"])
    form = "%.2f mm, %.2f deg" if min(noise) >= 0.1 else "%.2g mm, %.2g deg"
    text = "%d at %.1f Hz, noise " % (poses["count"], poses["rate"]) + form % noise
    yield "poses", text + (" (as given)" if poses["noise"]["given"] else "")
    thrusters = controls["thrusters"]
    names = "thrusters" if thrusters == PAIR else ", ".join(thrusters)
    text = "%(count)d at %(rate).1f Hz, %(changes)d changes, " % controls
    text += "%s %g to %g" % (names, *controls["levels"])
    has_lift = len(thrusters) < len(controls["channels"])
    yield "commands", text + (", lift %g to %g" % tuple(controls["lift"]) if has_lift else "")
    starts = (
        "from %.2f s on" % t if t >= 0 else "began %.2f s before the run" % -t for t in d["drives"]["begin"]
    )
    yield "drive", ", ".join(starts) + (DRIVES_BY.get(d["drives"]["by"], "") if has_lift else "")
    if d["reply"]:
        lag, doubts = 1e3 * d["reply"]["lag"], {one["kind"] for one in d["suspicions"]}
        before = "the motion comes %.0f ms before its command" if doubts & {"clock", "missing"} else ""
        before = before or "the craft reacts within %.0f ms of a command"
        text = ("the craft reacts %.0f ms after a command" if lag >= 0 else before) % abs(lag)
        slow = "the craft follows its commands, too slowly for poses with this noise to show its delay"
        yield "reply", slow if d["reply"]["slow"] else text
    if d["inertial"]:
        yield from _sensors(poses["noise"]["heading"] * np.sqrt(2) * poses["rate"], **d["inertial"])
    if d["battery"]:
        yield "battery", (BATTERY + UNUSABLE * bool(d["battery"]["unusable"])) % d["battery"]
    if d["authority"]:
        angles = [name for name in d["authority"] if words.ANGLES & set(words.split(name))]
        unknown = "not tested: a thruster's effect changes with %s" % ", ".join(angles)
        yield ("thrusters", unknown if angles else "; ".join(_does(*item) for item in d["authority"].items()))


def _sensors(
    of_poses: float,
    rate: float,
    delay: float,
    gyro: Mapping[str, float],
    accelerometer: Mapping[str, float],
    noise: Sequence[float],
    place: Sequence[float],
    problems: Sequence[str],
    source: str,
) -> Iterator[Tuple[str, str]]:
    """What the craft's gyro and accelerometer measure, and the parameters of mocap_state by which it uses
    them. of_poses: noise of the yaw rate from two poses [rad/s]; the others: described Calibrated."""
    if not noise:
        yield "sensors", "not used: " + "; ".join(problems)
        return
    parts = [
        "gyro %.0f Hz, noise %.2g deg/s (from two poses: %.2g deg/s)"
        % (rate, np.degrees(noise[0]), np.degrees(of_poses))
    ]
    if not problems:
        push, mounting = np.hypot(noise[1], noise[2]) / np.sqrt(2), np.degrees(accelerometer["mounting"])
        parts.append(
            "accelerometer, noise %.2g m/s2, turned by %.1f deg, %.0f mm ahead and %.0f mm to starboard of "
            "the markers" % (push, mounting, 1e3 * place[0], 1e3 * place[1])
        )
    parts.append("%.0f ms after the poses" % (1e3 * delay))
    yield "sensors", ", ".join([*parts, *problems])
    values = (
        ("gyro_scale", gyro["scale"]),
        ("acceleration_scale", 0.0 if problems else accelerometer["scale"]),
        ("mounting", accelerometer["mounting"]),
        ("ahead", place[0]),
        ("starboard", place[1]),
        ("delay", delay),
    )
    yield "imu", "{%s} for mocap_state" % ", ".join("%s: %.5g" % item for item in values)


def _does(name: str, authority: reply.Authority) -> str:
    """What a thruster does at full input, as far as the recording tells."""
    parts, forward, right = [], authority["forward"], authority["right"]
    least = 0.3 * max(abs(forward), abs(right))
    values = (forward, right, authority["turn"])
    for (sentences, unit), value, error in zip(EFFECTS, values, authority["errors"]):
        if abs(value) > reply.CERTAIN * error and (unit == "rad/s2" or abs(value) > least):
            parts.append("%s (%.2g +- %.1g %s)" % (sentences[value < 0], abs(value), error, unit))
    return "%s %s" % (name, ", ".join(parts) or "has no clear effect")


def _measured(
    axes: str,
    heading_offset: float,
    sources: Mapping[str, str],
    taken: Sequence[str],
    changes: Sequence[Mapping[str, object]],
) -> str:
    """Settings by which poses became world_ned, and their sources."""
    texts = {"axes": "axes '%s'" % axes, "heading_offset": "heading_offset %g rad" % heading_offset}
    text = ", ".join("%s (%s)" % (texts[name], sources[name]) for name in taken)
    for change in changes if taken else ():
        text += "; from %(time).2f s on axes '%(axes)s', heading_offset %(heading_offset)g rad" % change
    return text or "as states, corrected already"


def grave(d: Document) -> Iterator[str]:
    """Sentences on oddities whose repair may be wrong; all verbs print them, not only info."""
    poses = d["poses"]
    if not d["usable"]["spans"]:
        why = max(_left_out(d), default=(0.0, "no %d poses follow each other without a gap" % SHORTEST))[1]
        if poses["third_differences"] and not any(poses["third_differences"].values()):
            why = "all poses are the same: the mocap was frozen"
        yield "no part is usable: " + why
    if poses["stamps_out_of_order"]:
        yield "stamps out of order, sorted: %d" % poses["stamps_out_of_order"]
    if poses["frozen"]:
        yield "frozen poses (repeated samples of a moving craft), left out: %d" % poses["frozen"]
    if poses["heading_steps"]:
        steps = ["%.0f deg at %.2f s" % (np.degrees(s["angle"]), s["time"]) for s in poses["heading_steps"]]
        yield (
            "the measured heading steps while the craft goes on, as when the mocap mistakes one pattern of "
            "markers for another; turned to agree with the longest part: " + _named(steps)
        )
    if d["breaks"]:
        times = _named(["%.2f s" % time for time in d["breaks"]])
        yield "position and heading step at once, so another run begins; no window spans this: " + times
    if abs(d["clock_offset"]) > repair.CLOCK_OFFSET:
        text = "the stamps of the poses are %.3f s off the clock of the commands; shifted"
        yield text % -d["clock_offset"]
    yield from map(suspicions.sentence, d["suspicions"])
    clock = any(one["kind"] == "clock" for one in d["suspicions"])
    if d["controls"]["changes"] >= FEWEST_CHANGES and not d["reply"] and not clock:
        share = d["unexplained"]
        if share is not None and share >= reply.POWER:
            yield "the motion does not follow the commands: are poses and all commands of the same run?"
        elif share is not None:
            why = "most of the accelerations are pose noise"
            if d["poses"]["noise"]["heading"] > reply.AMBIGUOUS:
                why = "the headings scatter so much that the direction of turn is unknown"
            elif share == 0:
                why = "the same commands at other times, or pose noise, explain as much of it"
            yield "whether the motion follows the commands cannot be decided, because " + why


def findings(d: Document) -> Iterator[str]:
    """Sentences on what is odd and what was repaired."""
    poses = d["poses"]
    yield from grave(d)
    yield from _late(poses["bursts"], poses["count"], **poses.get("frame_clock", {}))
    if poses["gaps"]:
        gaps = sorted(poses["gaps"], key=lambda gap: -float(gap["length"]))
        named = _named(["%(length).2f s at %(start).2f s" % gap for gap in gaps])
        yield "mocap lost %d times for more than %.2g s: %s" % (len(gaps), GAP * poses["interval"], named)
    yield from ("%s: %d" % (what, poses[key]) for key, what in REPAIRED if poses[key])
    if poses["spikes"]:
        times = _named(["%.2f s" % time for time in poses["spikes"]])
        yield "spikes (positions or headings that no smooth motion explains), left out: " + times
    for key, sign, least, text in APART:
        if sign * d["controls"][key] > least:
            yield text % (sign * d["controls"][key])
    yield from (text for _, text in _left_out(d))
    told = [one for one in d["suspicions"] if one["kind"] == suspicions.CHANGED]
    changes = [c for c in d["changes"] if not (told and suspicions.is_of_craft(c["node"], c["name"]))]
    for change in changes[:MAX_CHANGES]:
        ends = change["before"] or "''", change["after"] or "''"
        yield "changed at %(time).2f s: %(node)s: %(name)s " % change + "%s -> %s" % ends
    if len(changes) > MAX_CHANGES:
        yield "%d more live changes (info --json lists them)" % (len(changes) - MAX_CHANGES)
    if d["same_inputs_as"]:
        yield "the same sequence of inputs as %s" % ", ".join(d["same_inputs_as"])


def _left_out(d: Document) -> Iterator[Tuple[float, str]]:
    """What is not usable and why: its length [s] and a sentence."""
    if d["rest"] > 0.2:
        text = "the first %.2f s are left out, because the craft does not move (--all keeps them)"
        yield d["rest"], text % d["rest"]
    if d["rest_at_end"] > 0.2:
        controls = d["controls"]
        none = "lift" if len(controls["thrusters"]) < len(controls["channels"]) else "commands"
        text = "the last %.2f s are left out, because they are without %s or motion (--all keeps them)"
        yield d["rest_at_end"], text % (d["rest_at_end"], none)
    for key, what in LEFT_OUT:
        spans: Spans = d[key]
        if spans:
            named = _named(["%(start).2f to %(end).2f s" % span for span in spans])
            yield sum(span["end"] - span["start"] for span in spans), "%s: %s" % (what, named)


def _late(
    bursts: int, count: int, rate: float = 0.0, lost: int = 0, lateness: Optional[Mapping[str, float]] = None
) -> Iterator[str]:
    """Differences between the stamps and the instants of the frames, which a frame clock tells."""
    if lateness:
        yield (
            "stamps are late, in bursts or from polling: %d of %d poses arrived with the previous one; "
            "the clock of the frames is rebuilt: %.2f Hz, %d frames lost, stamps late by %.1f ms "
            "(median), %.0f ms at most"
            % (bursts, count, rate, lost, 1e3 * lateness["median"], 1e3 * lateness["largest"])
        )
        if lateness["above_50_ms"]:
            yield "late bursts, stamps late by more than 50 ms: %d" % lateness["above_50_ms"]
    elif bursts:
        yield "%d poses arrived with the previous one" % bursts


def _named(items: Sequence[str]) -> str:
    more = len(items) - MAX_NAMED
    return ", ".join(items[:MAX_NAMED]) + (" and %d more" % more if more > 0 else "")


def differences(recordings: Sequence[Recording]) -> str:
    """A line that groups recordings by settings, and by model and room of their controllers, if these
    differ; empty if they do not."""
    parts = []
    for kind in (*NAMES, "axes", "heading_offset"):
        groups: Dict[str, Tuple[str, List[str]]] = {}
        for recording, key, text in _settings(recordings, kind):
            groups.setdefault(key, (text, []))[1].append(recording.name)
        if len(groups) > 1:
            parts += ["%s %s for %s" % (kind, text, ", ".join(names)) for text, names in groups.values()]
    return "the runs were recorded with different settings: " + "; ".join(parts) if parts else ""


def _settings(recordings: Sequence[Recording], kind: str) -> Iterator[Tuple[Recording, str, str]]:
    """Recordings that have a setting, each with what tells it from others and what it is called. A model
    and a room are compared by content where it was recorded, otherwise by name."""
    kept = {r.flown_by[kind]: _content(r.files[kind]) for r in recordings if kind in r.files}
    for recording in recordings:
        name, values = recording.flown_by.get(kind), recording.settings.values(kind)
        if kind in NAMES and name is not None:
            file = recording.files.get(kind)
            yield recording, _content(file) if file else kept.get(name, name), name
        elif values is not None:
            text = " then ".join("%s" % value for value in values)
            yield recording, text, text


def _content(file: RunFile) -> str:
    return json.dumps(file.entries(), sort_keys=True, default=str)
