"""Which columns are probably commands, what their values mean, and what their channels are called."""

import re
from typing import Dict, List, Mapping, Tuple

import numpy as np

from ground.recordings import units, words
from ground.support.annotations import Array

MAX_LEVELS = 40  # levels of a command that switches
LENGTHS = ("m", "cm", "mm", "km", "in", "ft")
COUNTER = re.compile(r"(^|\.)(seq|secs|nsecs)$")
NEUTRAL = (1450.0, 1550.0)  # pulses at which servos and controllers of reversible motors rest [us]
STEPS = (255.0, 1023.0, 4095.0, 32767.0, 65535.0)  # largest values of whole numbers of a few bits


def finite(values: Array) -> Array:
    """The values that are there."""
    return np.asarray(values[np.isfinite(values)])


def likely(topic: str, values: Mapping[str, Array]) -> Dict[str, Array]:
    """Columns that could be commands: those that are named so, else those of few levels, or that do not
    change but are not 0."""
    there = {p: finite(v) for p, v in values.items() if not COUNTER.search(p) and np.isfinite(v).any()}
    there = {p: v for p, v in there.items() if not re.fullmatch(r"column_\d+", p)}  # without a name
    bodily = {"u", "v", "r"} <= set(there)  # velocities of the craft
    named = {p: v for p, v in there.items() if words.is_command(p) and not (bodily and p == "u")}
    changing = {p: v for p, v in named.items() if np.any(v != 0)}
    if changing:
        return {p: v for p, v in named.items() if p in changing or _siblings(p, changing)}
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
    low, high = float(values.min()), float(values.max())
    changes = int((np.diff(values) != 0).sum())
    why = "%g to %g, %d changes" % (low, high, changes)
    most = max(abs(low), abs(high))
    both = ", range: [-1, 1]" * (low < 0)
    unit = units.command_unit(values)
    if unit == "microseconds" and said in ("", "us"):
        rest = _neutral(values)
        if rest:
            reach = max(high - rest, rest - low)
            keys = "off: %g, full: %g, range: [-1, 1]" % (rest, rest + reach)
            return keys, why + ", and %g is its rest" % rest
        return "unit: microseconds", why
    if said in ("rad", "deg"):
        keys = "off: 0, full: %s%s" % (_above(most), both)
        return keys, why + ", an angle in %s: full is its largest" % said
    if said == "%" or unit == "percent":
        return "unit: percent" + both, why
    if unit == "normalised" and said != "rpm":
        return "unit: normalised" + both, why
    top = next((step for step in STEPS if most == step), most)
    return "off: 0, full: %s%s" % (_above(top), both), why + (", full is its largest" if top == most else "")


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
    """Names of channels: those of the fields. A word says which is left, right or lift; of three without
    such words the one that changes least is the lift."""
    plain = {path: _plain(path) for path in found}
    last = {path: path.rsplit(".", 1)[-1] for path in found}
    if set(last.values()) >= {"left", "right"}:
        return {path: _plain(name) for path, name in last.items()}
    said = {path: set(words.split(path)) for path in found}
    for name, known in (("left", words.LEFT), ("right", words.RIGHT), ("lift", words.LIFT)):
        which = [path for path in found if said[path] & known]
        if len(which) == 1:
            plain[which[0]] = name
    left_over = [path for path in found if not said[path] & words.ACTUATORS]
    sided = {"left", "right"} <= set(plain.values())
    if len(found) == 3 and (len(left_over) == 3 or (sided and "lift" not in plain.values())):
        rest = [path for path in found if plain[path] not in ("left", "right")] if sided else list(found)
        unlike = [path for path in rest if not said[path] & (words.ACTUATORS - {"fan"})]
        changes = {path: int((np.diff(found[path]) != 0).sum()) for path in unlike}
        if unlike:
            lift = min(unlike, key=lambda path: changes[path])
            plain[lift] = "lift"
            if not sided:
                plain.update(zip([path for path in found if path != lift], ("left", "right")))
    return _distinct(plain)


def _plain(path: str) -> str:
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
