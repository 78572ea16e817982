"""Which columns are probably commands, what their values mean, and what their channels are called."""

import re
from typing import Dict, Iterable, List, Mapping, Tuple

import numpy as np

from ground.draft.undecided import MARK
from ground.reading import units, words
from ground.support.annotations import Array

MAX_LEVELS = 40  # levels of a command that switches
LENGTHS = ("m", "cm", "mm", "km", "in", "ft")
COUNTER = re.compile(r"(^|\.)(seq|secs|nsecs)$")
NEUTRAL = (1450.0, 1550.0)  # pulses at which servos and controllers of reversible motors rest [us]
LEAST_PULSE, MOST_PULSE = 1010.0, 1990.0  # pulses that reach off and full [us]
RESTS = 0.02  # share of commands at 0 from which a command that goes below it rests there
FEEBLE = 20.0  # percent that a command never exceeds, as pulses of a servo by their duty, and fractions
REACHED = 0.99  # largest command of a unit that it is sure to have [full thrust]
STEPS = (255.0, 1023.0, 4095.0, 32767.0, 65535.0)  # largest values of whole numbers of a few bits


def finite(values: Array) -> Array:
    """The values that are there."""
    return np.asarray(values[np.isfinite(values)])


def likely(topic: str, values: Mapping[str, Array]) -> Dict[str, Array]:
    """Columns that could be commands. Names of commands decide; without one, columns of few levels and
    constant columns that are not 0 could be commands."""
    there = {p: finite(v) for p, v in values.items() if not COUNTER.search(p) and np.isfinite(v).any()}
    there = {p: v for p, v in there.items() if not re.fullmatch(r"column_\d+", p)}  # without a name
    bodily = {"u", "v", "r"} <= set(there)  # velocities of the craft
    named = {p: v for p, v in there.items() if words.is_command(p) and not (bodily and p == "u")}
    changing = {p: v for p, v in named.items() if np.any(v != 0)}
    if changing:
        with_angles = {p: v for p, v in there.items() if p in named or _is_angle_beside(p, changing)}
        return {
            p: v for p, v in with_angles.items() if p not in named or p in changing or _siblings(p, changing)
        }
    commanded = words.is_command(topic) or re.search(
        "cmd|command|control|thrust|pwm|actuator|demand", topic, re.I
    )
    return {
        path: v
        for path, v in there.items()
        if (commanded or not words.is_measured(path))
        and not (words.axis(path)[0] and (words.heading(path)[0] or words.unit_in(path) in LENGTHS))
        and not (bodily and path in "uvwpqr")
        and (units.command_unit(v) or commanded)
        and np.any(v != 0)
    }


def further(topic: str, values: Mapping[str, Array]) -> List[str]:
    """Columns beside the likely ones that switch as commands do, under names that say nothing."""
    found = likely(topic, values)
    return [
        path
        for path, v in ((p, finite(v)) for p, v in values.items() if p not in found)
        if len(v) and 2 <= len(np.unique(v)) <= MAX_LEVELS and units.command_unit(v)
        if not words.is_measured(path) and not words.OTHERS & set(words.split(path))
        if not words.axis(path)[0] and not words.heading(path)[0] and not words.component(path)[0]
    ]


def _is_angle_beside(path: str, others: Mapping[str, Array]) -> bool:
    """Whether a path is a commanded angle beside a commanded thrust: `angle_ref` beside `throttle_ref`."""
    rest = set(words.split(path)) - words.ANGLES
    if rest == set(words.split(path)) or (words.SENSED | words.MOTION) & rest:
        return False
    return any(rest == set(words.split(other)) - words.STRONG for other in others)


def _siblings(path: str, others: Mapping[str, Array]) -> bool:
    """Whether others have the same name but for their number."""
    plain = re.sub(r"\d+", "", path)
    return any(re.sub(r"\d+", "", other) == plain for other in others)


def score(topic: str, values: Mapping[str, Array]) -> float:
    """How likely a topic has the commands."""
    found = likely(topic, values)
    if not found:
        return 0.0
    switching = [
        len(np.unique(v)) <= MAX_LEVELS or units.command_unit(v) != "normalised" for v in found.values()
    ]
    named = words.is_command(topic) or any(map(words.is_command, found))
    changes = any(np.any(np.diff(v) != 0) for v in found.values())
    return 2.0 * named + changes + float(np.mean(switching))


def meaning(path: str, values: Array, said: str) -> Tuple[str, str]:
    """The keys that say what values of a command mean, and why."""
    low, high, why = float(values.min()), float(values.max()), reach(values)
    most = max(abs(low), abs(high))
    both = ", range: [-1, 1]" * (low < 0)
    unit = units.command_unit(values)
    if unit == "microseconds" and said in ("", "us"):
        rest = _neutral(values)
        if rest:
            most = max(high - rest, rest - low)
            keys = "off: %g, full: %g, range: [-1, 1]" % (rest, rest + most)
            return keys, MARK + why + ", and %g is its rest" % rest
        return "unit: microseconds", ("" if low <= LEAST_PULSE and high >= MOST_PULSE else MARK) + why
    rests = low >= 0 or values[0] == 0 or np.mean(values == 0) >= RESTS
    why += "" if rests else ", it never rests at 0: %g may be off" % low
    turned = _direction(path, most, said)
    if turned[0]:
        return turned[0], MARK + why + turned[1]
    if said in ("rad", "deg"):
        keys = "off: 0, full: %s%s" % (_above(most), both)
        return keys, MARK + why + ", an angle in %s: full is its largest" % said
    if said == "%" or unit == "percent":
        is_sure = most > FEEBLE if said == "%" else most >= 100 * REACHED
        return "unit: percent" + both, ("" if is_sure and rests else MARK) + why
    if unit == "normalised" and said != "rpm":
        return "unit: normalised" + both, ("" if most >= REACHED and not said and rests else MARK) + why
    top = next((step for step in STEPS if most == step), most)
    keys = "off: 0, full: %s%s" % (_above(top), both)
    return keys, MARK + why + (", full is its largest" if top == most else "")


def reach(values: Array) -> str:
    """What a command does, in words."""
    return "%g to %g, %d changes" % (values.min(), values.max(), (np.diff(values) != 0).sum())


def _direction(path: str, most: float, said: str) -> Tuple[str, str]:
    """The keys of the direction of a thruster that turns, and why; empty for what is none."""
    unit = said or ("deg" if 2 * np.pi < most <= 360 else "rad" if most <= 2 * np.pi else "")
    half = {"deg": 180.0, "rad": np.pi}.get(unit, 0.0)
    if not words.ANGLES & set(words.split(path)) or not half / 2 < most <= 2 * half * 1.01:
        return "", ""
    both = most <= half * 1.01
    full, span = (half, "[-1, 1]") if both else (2 * half, "[0, 1]")
    why = ", a direction in %s: the angle of the entry that `turns` the thruster is %d"
    return "off: 0, full: %.8g, range: %s" % (full, span), why % (unit, 180 if both else 360)


def _above(size: float) -> str:
    """A size with six digits, rounded up, so that the largest value is not beyond it; 1 for none."""
    digit = 10.0 ** (np.floor(np.log10(size or 1)) - 5)
    return "%g" % (np.ceil((size or 1) / digit - 1e-6) * digit)


def _neutral(values: Array) -> float:
    """The pulse at which a reversible motor rests; 0 where values lie on one side only."""
    levels, counts = np.unique(np.round(values), return_counts=True)
    inside = (levels >= NEUTRAL[0]) & (levels <= NEUTRAL[1])
    if not inside.any():
        return 0.0
    rest = float(levels[inside][np.argmax(counts[inside])])
    usual = counts[inside].max() >= 0.02 * len(values) or round(float(values[0])) == rest
    return rest if usual and values.min() < rest - 25 and values.max() > rest + 25 else 0.0


def names(found: Mapping[str, Array]) -> Dict[str, str]:
    """Names of channels, from the names of the fields. A word says which is left, right or lift. Of three
    channels without such words, the lift is the channel that changes least."""
    called = {path: plain(path) for path in found}
    last = {path: path.rsplit(".", 1)[-1] for path in found}
    if set(last.values()) >= {"left", "right"}:
        return {path: plain(name) for path, name in last.items()}
    said = {path: set(words.split(path)) for path in found}
    for name, known in words.CHANNELS.items():
        which = [path for path in found if said[path] & known]
        if len(which) == 1:
            called[which[0]] = name
    left_over = [path for path in found if not said[path] & words.ACTUATORS]
    sided = {"left", "right"} <= set(called.values())
    if len(found) == 3 and (len(left_over) == 3 or (sided and "lift" not in called.values())):
        rest = [path for path in found if called[path] not in ("left", "right")] if sided else list(found)
        unlike = [path for path in rest if not said[path] & (words.ACTUATORS - {"fan"})]
        changes = {path: int((np.diff(found[path]) != 0).sum()) for path in unlike}
        if unlike:
            lift = min(unlike, key=lambda path: changes[path])
            called[lift] = "lift"
            if not sided:
                called.update(zip([path for path in found if path != lift], ("left", "right")))
    return _distinct(called)


def is_named(name: str, path: str, others: Iterable[str]) -> bool:
    """Whether a word of a field, and of no other one, says that its channel is left, right or lift; of other
    channels, whether the name is the field's."""
    known = words.CHANNELS.get(name)
    if known is None:
        return name == plain(path)
    return [other for other in others if known & set(words.split(other))] == [path]


def plain(path: str) -> str:
    """The name of a field as one of a channel."""
    name = re.sub(r"\W+", "_", words.bare(path)).strip("_") or "channel"
    return name if name[0].isalpha() or name[0] == "_" else "channel_" + name


def _distinct(given: Mapping[str, str]) -> Dict[str, str]:
    """Names of which none repeats."""
    found: Dict[str, str] = {}
    taken: List[str] = []
    for path, name in given.items():
        while name in taken:
            name += "_"
        taken.append(name)
        found[path] = name
    return found
