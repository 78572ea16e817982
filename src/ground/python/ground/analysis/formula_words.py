"""Formulas of what has no name, in words, and numbers with their units."""

import math
import re
from dataclasses import dataclass
from typing import Dict, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground.analysis.dictionary import Feature
from ground.analysis.samples import Memory


def of_feature(feature: Feature, size: str, own: Mapping[str, str], memory: Memory) -> str:
    """What a feature does, with names for values that are fitted: in braces, or in a formula in angles.
    memory: its states."""
    what = feature.channel.words.format(
        **{n: "{%s}" % n for n in memory.times}, **{n: "{%s}" % o for n, o in own.items()}
    )
    function = feature.function.format(**{n: "<%s>" % o for n, o in own.items()})
    states = _states(memory, what + function)
    function = _bare(function)
    factor = re.fullmatch(r"(.*), times (.*),", what)  # a thrust, and what it is multiplied with
    if factor:
        what, symbols = factor.groups()
        function = symbols if function == "1" else "%s*%s" % (symbols, function)
    if function == "1":
        return "%s of {%s}%s" % (what, size, states)
    depends = in_words(sorted(feature.arguments))
    return "%s that depends on %s (= {%s} %s%s)" % (what, depends, size, function, states)


def _bare(function: str) -> str:
    """A formula without parentheses about a word or about other parentheses."""
    match = re.fullmatch(r"\((\w+|\([^()]*\))\)", function)
    return match.group(1) if match else function


def _states(memory: Memory, text: str) -> str:
    """What the states are that stand in a text about a feature: ", where p0 is the mean of the command over
    the last {tau_p0}"."""
    known = {}
    for state, rate in memory.rates.items():
        name = state if state in text else state.split("_")[0]  # of all thrusters alike
        of, mean, time = rate.partition(")-%s)/" % state)
        what = "the command" if name != state else of.strip("()")
        if name in re.findall(r"\w+", text):
            known[name] = (
                "the mean of %s over the last %s" % (what, time) if mean else "the sum of %s so far" % of
            )
    if not known and memory.times and "{" not in text:
        return ", over the last {%s}" % [*memory.times][0]
    return ", where " * bool(known) + " and ".join("%s is %s" % one for one in known.items())


WORDS = {
    "heading": "the heading",
    "place": "the place",
    "velocity": "the velocity",
    "command": "the commands",
    "past": "the past",
    "time": "the time since the drive began",
}


def in_words(arguments: Sequence[str]) -> str:
    """Arguments of a dependence, in words."""
    words = [WORDS[name] for name in arguments]
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


@dataclass(frozen=True)
class Piece:
    """A part of a formula, by channel, and its parameters: value, unit, lower and upper bound."""

    number: int
    parts: Dict[str, str]
    parameters: Dict[str, Tuple[float, str, float, float]]
    means: str
    states: Dict[str, str]
    simpler: Tuple["Piece", ...]  # pieces with a factor less

    @property
    def size(self) -> str:
        """The parameter without which it does nothing."""
        return "c%d" % self.number


def of_pieces(pieces: Sequence[Piece], values: Mapping[str, float]) -> str:
    """Pieces of a formula in words, with their values."""
    return " and ".join(_told(piece, values) for piece in pieces)


def _told(piece: Piece, values: Mapping[str, float]) -> str:
    """A piece in words, with its values."""
    told = re.sub(r"<(\w+)>", lambda found: "%.3g" % values[found.group(1)], piece.means)
    told = told.replace("--", "+").replace("+-", "-")
    return re.sub(
        r"\{(\w+)\}",
        lambda found: quantity(values[found.group(1)], piece.parameters[found.group(1)][1]),
        told,
    )


def quantity(value: float, unit: str, digits: int = 3) -> str:
    """A number with its unit; a small one has the prefix milli if the unit allows it."""
    factor, unit = _scale(value, unit)
    return ("%.*g %s" % (digits, factor * value, unit)).rstrip(" -")


def with_interval(
    value: float, low: float, high: float, unit: str, runs: Optional[Tuple[float, float]] = None
) -> str:
    """A number with its 95% interval, as precise as the interval: "50.02 ms (95%: 49.98 to 50.05 ms)". runs:
    the least and the largest of runs that differ."""
    factor, unit = _scale(value, unit)
    half = factor * max(high - value, value - low)
    places = 3 if not 0 < half < math.inf else int(np.clip(-math.floor(math.log10(half)), 0, 9))
    if runs and factor * value:  # the interval may be wide: at least two digits of the value
        places = max(places, int(np.clip(1 - math.floor(math.log10(abs(factor * value))), 0, 9)))
    numbers = [value, low, high, *(runs or ())]
    told = ["%.*f" % (places, round(factor * number, places) + 0.0) for number in numbers]
    unit = " " + unit if unit not in ("", "-") else ""
    differ = "; runs differ: %s to %s%s" % (told[3], told[4], unit) if runs else ""
    return "%s%s (95%%: %s to %s%s%s)" % (told[0], unit, told[1], told[2], unit, differ)


def _scale(value: float, unit: str) -> Tuple[float, str]:
    """The factor and the unit with which a value is easy to read: the prefix milli if it is small."""
    unit = re.sub(r"/\((.*)\)$", r" per \1", unit)
    if 0 < abs(value) < 0.1 and (unit in ("s", "m", "rad") or unit.startswith("N")):
        return 1e3, "m" + unit
    return 1.0, unit
