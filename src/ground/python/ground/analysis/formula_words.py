"""Formulas of what has no name, in words."""

import math
import re
from dataclasses import dataclass
from typing import Dict, Mapping, Sequence, Tuple

from ground.analysis.dictionary import Feature
from ground.analysis.samples import Memory
from ground.support.quantities import quantity


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
    """A formula without the parentheses around a name, a call, or all of it, except around a sum."""
    function = re.sub(r"(?<!\w)\((\w+|\w+\([^()]*\))\)", r"\1", function)
    inside = function[1:-1] if function.startswith("(") else ""
    depth, sums = 0, False
    for letter in inside:
        depth += {"(": 1, ")": -1}.get(letter, 0)
        sums |= depth == 0 and letter in "+-"
        if depth < 0:  # the first parenthesis closes before the end
            return function
    return function if sums or not inside else _bare(inside)


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
class FormulaTerm:
    """A part of a formula, by channel, and its parameters: value, unit, lower and upper bound."""

    number: int
    parts: Dict[str, str]
    parameters: Dict[str, Tuple[float, str, float, float]]
    means: str
    states: Dict[str, str]
    simpler: Tuple["FormulaTerm", ...]  # pieces with a factor less

    @property
    def size(self) -> str:
        """The parameter without which it does nothing."""
        return "c%d" % self.number


def of_pieces(pieces: Sequence[FormulaTerm], values: Mapping[str, float]) -> str:
    """Pieces of a formula in words, with their values."""
    return " and ".join(_told(piece, values) for piece in pieces)


def _told(piece: FormulaTerm, values: Mapping[str, float]) -> str:
    """A piece in words, with its values."""
    told = re.sub(r"<(\w+)>", lambda found: "%.3g" % values[found.group(1)], piece.means)
    told = told.replace("--", "+").replace("+-", "-")
    return re.sub(
        r"\{(\w+)\}",
        lambda found: _size(values[found.group(1)], piece.parameters[found.group(1)][1]),
        told,
    )


def _size(value: float, unit: str) -> str:
    """A value with its unit; angles are in degrees."""
    return "%.3g deg" % math.degrees(value) if unit == "rad" else quantity(value, unit)
