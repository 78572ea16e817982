"""The core's tables of controllers and references as text for --help."""

from typing import Any, Dict, Iterable, Optional

from ground import _core
from ground.annotations import Setting
from ground.simulation import gains, tracking, tuning


def controllers(names: Iterable[str]) -> str:
    """Controllers and their parameters; lines end with a line feed."""
    lines = ["controllers and their parameters [unit], range (default); * searched by tune:"]
    for info in (gains.CONTROLLERS[name] for name in names):
        lines.append("  %-18s %s" % (info.name, info.text))
        lines += [
            "    " + _line(p) + (" *" if p.name in tuning.SPACE[info.name] else "") for p in info.parameters
        ]
    return "\n".join(lines) + "\n"


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
    return "\n".join(lines) + "\n"


def option(parameter: _core.TunableInfo, default: Optional[Setting]) -> Dict[str, Any]:
    """Metavar and help of an option that sets a parameter; a default of None is not shown."""
    text = parameter.text[0].lower() + parameter.text[1:]
    if default is not None:
        text += " (%g)" % float(default)
    return {"metavar": "N" if parameter.unit == "-" else parameter.unit.upper(), "help": text}


def _line(parameter: _core.TunableInfo, default: Optional[str] = None) -> str:
    unit = " [%s]" % parameter.unit if parameter.unit not in ("", "-") else ""
    text = "%-18s %s%s" % (parameter.name, parameter.text, unit)
    if parameter.type in ("double", "int"):
        text += ", %g to %g" % (parameter.low, parameter.high)
    return text + (" (%s)" % _value(parameter.default) if default is None else "")


def _value(value: Setting) -> str:
    return str(value).lower() if isinstance(value, bool) else "%g" % float(value)
