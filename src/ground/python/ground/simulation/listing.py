"""The core's tables of controllers and references: as options, and as text for --help."""

import textwrap
from typing import Any, Dict, Iterable, Iterator, List, Optional, Sequence, Tuple

from ground import _core
from ground.simulation import gains, tracking, tuning
from ground.support import command_line
from ground.support.annotations import Setting
from ground.support.command_line import number, option

NAMES = ("size", "rate_of_turn", "petals", "speed")  # parameters of references that are options
PLACES = {"origin": ("x", "y"), "end": ("end_x", "end_y")}  # options that set parameters of references
WIDTH = 79  # longest line [characters]


def controllers(names: Iterable[str]) -> str:
    """Controllers and their parameters; lines end with a line feed."""
    lines = ["controllers and their parameters [unit], range (default); * searched by tune:"]
    for info in (gains.CONTROLLERS[name] for name in names):
        lines.append("  %-18s %s" % (info.name, info.text))
        lines += [
            "    " + _line(p) + (" *" if p.name in tuning.SPACE[info.name] else "") for p in info.parameters
        ]
    return _wrapped(lines)


def references() -> str:
    """References and their parameters; lines end with a line feed."""
    lines = ["references and their parameters, with defaults (the thesis's, where it has them):"]
    parameters = {p.name: p for p in _core.reference_parameters()}
    for info in tracking.KINDS.values():
        values = {name: parameters[name].default for name in info.takes if name != "file"}
        values.update(tracking.REFERENCES.get(info.name, ({}, None))[0])
        name = "FILE.csv" if info.name == "file" else info.name
        lines.append("  %-18s %s" % (name, info.text))
        lines.append("    " + ", ".join("%s %s" % (n, _value(v)) for n, v in values.items()))
    lines.append("parameters of references [unit], range:")
    lines += ["    " + _line(p, "") for p in parameters.values() if p.name != "file"]
    return _wrapped(lines)


def _wrapped(lines: List[str]) -> str:
    """Lines that fit a terminal; the rest of a longer one stands below its text."""
    return "".join(textwrap.fill(line, WIDTH, subsequent_indent=" " * 23) + "\n" for line in lines)


def reference_fields() -> Iterator[Tuple[str, Any, Any]]:
    """Fields of a dataclass of options that set parameters of references."""
    for p in (p for p in _core.reference_parameters() if p.name in NAMES):
        unit, metavar = ("", "N") if p.unit == "-" else (" [%s]" % p.unit, p.unit.upper())
        help = p.text[0].lower() + p.text[1:] + unit
        yield p.name, Optional[float], option(None, help, type=number, metavar=metavar, group="tracking")
    for place in PLACES:
        help = "%s [m]" % {"origin": "centre or start", "end": "end of a line"}[place]
        yield (
            place,
            Optional[Sequence[float]],
            option(None, help, type=number, nargs=2, metavar=("X", "Y"), group="tracking"),
        )


def reference_settings(options: Any) -> Dict[str, float]:
    """The parameters of references that options set."""
    settings = command_line.given(options, (*NAMES, *PLACES))
    found = {name: settings[name] for name in NAMES if name in settings}
    for place, names in PLACES.items():
        found.update(zip(names, settings.get(place, ())))
    return found


def _line(parameter: _core.TunableInfo, default: Optional[str] = None) -> str:
    unit = " [%s]" % parameter.unit if parameter.unit not in ("", "-") else ""
    text = "%-18s %s%s" % (parameter.name, parameter.text, unit)
    if parameter.type in ("double", "int"):
        text += ", %g to %g" % (parameter.low, parameter.high)
    return text + (" (%s)" % _value(parameter.default) if default is None else "")


def _value(value: Setting) -> str:
    return str(value).lower() if isinstance(value, bool) else "%g" % float(value)
