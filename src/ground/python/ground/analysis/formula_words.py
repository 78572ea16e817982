"""Formulas of what has no name, in words, and numbers with their units."""

import re
from dataclasses import dataclass, field
from typing import Dict, Mapping, Sequence, Tuple

import numpy as np

from ground.analysis.dictionary import PLACE, Feature

ALONG = 3.0  # angle from an axis of the room within which a wave is said to go along it [deg]
OWN = re.compile(r"_\d+$")  # in the name of a constant of one piece
TURN = re.compile(r"^\(?sin\((?:(\d)\*)?psi\+\{p[01]\}\)\)?$")
WAVE = re.compile(r"^\(?sin\(\{kx\}\*x\+\{ky\}\*y\+\{p\d\}\)\)?$")
# A force away from a point of the room, or around it, times a function, perhaps near the point alone
PULLED = re.compile(r"^(.*?)\*(exp\([^*]*\{mw\}\^2\)\*)?\(\(x-\{mx\}\)\*(cos|sin)\(psi\)")
# A force along an axis of the room, by channel
ROOM = {"x": {"X": "%s*cos(psi)", "Y": "-%s*sin(psi)"}, "y": {"X": "%s*sin(psi)", "Y": "%s*cos(psi)"}}
DIRECTED = "*cos(psi-{dr})"  # behind a force ahead that is part of a force in a direction of the room
# A force away from a point of the room, as the dictionary has it
PULL = {"X": "((x-{x0}))*cos(psi)+((y-{y0}))*sin(psi)", "Y": "((y-{y0}))*cos(psi)+-((x-{x0}))*sin(psi)"}


def of_feature(feature: Feature, size: str, own: Mapping[str, str]) -> str:
    """What a feature does, with names in braces for values that are fitted."""
    arguments, template = in_words(sorted(feature.family.arguments)), feature.template
    what, text = _along(feature, own)
    turn, wave = TURN.match(text), WAVE.match(text)
    if text == "1":
        return "%s of {%s}" % (what, size)
    if turn:
        times = turn.group(1) or "1"
        often = "once" if times == "1" else "%s times" % times
        return "%s of up to {%s} that depends on the heading, %s a turn" % (what, size, often)
    if wave:
        return "%s of up to {%s} that repeats every {wave:%s:%s}" % (what, size, own["kx"], own["ky"])
    if template == PULL:
        point = ", ".join("{%s}" % own[name] for name in ("x0", "y0"))
        return "a force {away:%s} the point (%s), {%s} of distance" % (size, point, size)
    values = {n: "{%s}" % o for n, o in own.items()}
    pulled = PULLED.match(template.get("X", ""))
    if pulled:
        return _pulled(pulled, size, own, values, feature)
    if text:
        return "%s that depends on %s (= {%s} %s)" % (what, arguments, size, text.format(**values))
    texts = ["%s = {%s} %s" % (c, size, t.format(**values)) for c, t in template.items()]
    return "%s that depends on %s (%s)" % (what, arguments, "; ".join(texts))


def _pulled(
    found: "re.Match[str]", size: str, own: Mapping[str, str], values: Mapping[str, str], feature: Feature
) -> str:
    """What a force away from a point or around it does; found: by PULLED in its formula ahead."""
    function, near, turn = found.groups()
    point = "(%s, %s)" if function == "1" else "(%s m, %s m)"
    where = point % (values["mx"], values["my"]) + (", within %s" % values["mw"] if near else "")
    of_place = re.search(r"\b[xy]\b", function)
    arguments = [a for a in sorted(feature.family.arguments) if a != PLACE or of_place]
    if function == "1":
        way = "{away:%s}" % size if turn == "cos" else "around"
        return "a force %s the point %s, of {%s}" % (way, where, size)
    way, much = ("{away:%s}" % size, "{abs:%s}" % size) if turn == "cos" else ("around", "{%s}" % size)
    what = "a force %s the point %s, that depends on %s" % (way, where, in_words(arguments))
    return "%s (= %s %s)" % (what, much, function.format(**values))


def _along(feature: Feature, own: Mapping[str, str]) -> Tuple[str, str]:
    """What a feature acts as, in words, and its formula along that; no formula if it has several."""
    template, what = feature.template, _what(feature)
    if len(template) == 1:
        return what, next(iter(template.values()))
    if template.get("X", "").endswith(DIRECTED):
        return "a force {room:%s}" % own["dr"], template["X"][: -len(DIRECTED)]
    for axis, turned in ROOM.items():
        text = template.get("X", "")[: -len(turned["X"]) + 2]
        if template == {c: formula % text for c, formula in turned.items()}:
            return "a force along the room's %s" % axis, text
    return what, ""


def _what(feature: Feature) -> str:
    """What a feature acts as, in words."""
    parts = set(feature.parts)
    if parts == {"N"}:
        return "a moment"
    if all(p.startswith("thrust_") for p in parts):
        if len(parts) > 1:
            return "thrust"
        return "thrust of %s" % next(iter(parts))[len("thrust_") :]
    if parts == {"X"}:
        return "a force ahead"
    if parts == {"Y"}:
        return "a force to the side"
    return "a force in the room" if PLACE in feature.family.arguments else "a force"


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
    arguments: Tuple[str, ...]  # what its feature depends on, such as place
    dependence: str
    states: Dict[str, str] = field(default_factory=dict)
    simpler: Tuple["Piece", ...] = ()  # pieces with a factor less

    @property
    def size(self) -> str:
        """The parameter without which it does nothing."""
        return "c%d" % self.number


def of_pieces(pieces: Sequence[Piece], values: Mapping[str, float]) -> str:
    """Pieces of a formula in words, with their values."""
    return " and ".join(_told(piece, values) for piece in pieces)


def _told(piece: Piece, values: Mapping[str, float]) -> str:
    """A piece in words, with its values."""

    def put(found: "re.Match[str]") -> str:
        name = found.group(1)
        if name.startswith("away:"):
            return "away from" if values[name[len("away:") :]] > 0 else "towards"
        if name.startswith("wave:"):
            return _wave(*(values[part] for part in name.split(":")[1:]))
        if name.startswith("room:"):
            return _direction(np.degrees(values[name[len("room:") :]]))
        if name.startswith("abs:"):
            name = name[len("abs:") :]
            return quantity(abs(values[name]), piece.parameters[name][1])
        unit = piece.parameters[name][1]
        if name[0] == "c":
            return quantity(abs(values[name]) if "= {%s}" % name not in piece.means else values[name], unit)
        in_formula = OWN.search(name) and re.search(r"= \{(c|abs)", piece.means)
        return "%.3g" % values[name] if in_formula else quantity(values[name], unit)

    told = re.sub(r"\{([\w:]+)\}", put, piece.means)
    return told.replace("--", "+").replace("+-", "-")


def _wave(kx: float, ky: float) -> str:
    """Length and direction of a wave by its components [rad/m]."""
    return "%.3g m %s" % (2 * np.pi / np.hypot(kx, ky), _direction(np.degrees(np.arctan2(ky, kx)) % 180))


def _direction(angle: float) -> str:
    """A direction of the room [deg], in words."""
    axes = {0: "the room's x", 90: "the room's y", 180: "the room's x"}
    near = [axis for at, axis in axes.items() if abs(angle - at) < ALONG]
    return "along %s" % near[0] if near else "in the direction %.0f deg of the room" % angle


def quantity(value: float, unit: str, digits: int = 3) -> str:
    """A number with its unit; a small one has the prefix milli if the unit allows it."""
    unit = re.sub(r"/\((.*)\)$", r" per \1", unit)
    if 0 < abs(value) < 0.1 and (unit in ("s", "m", "rad") or unit.startswith("N")):
        return "%.*g m%s" % (digits, 1e3 * value, unit)
    return ("%.*g %s" % (digits, value, unit)).rstrip(" -")
