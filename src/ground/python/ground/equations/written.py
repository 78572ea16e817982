"""A model as code of another language, compared with the core when it is written."""

import os
import re
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Dict, Iterable, Iterator, List, Optional, Sequence, Tuple

import jinja2

from ground import _core
from ground.effect_library.parameters import described
from ground.equations import checks, languages
from ground.equations.statements import Equations, Function, Language, Symbol
from ground.support import files, origin
from ground.support.annotations import Path
from ground.support.errors import GroundError, core_errors
from ground.support.headline import Line
from ground.support.results import Shown

if TYPE_CHECKING:
    import pandas

SUFFIXES = {".py": "numpy", ".h": "c", ".c": "c"}  # what the end of a file's name asks for
TARGETS = {"numpy": languages.NUMPY, "casadi": languages.CASADI, "c": languages.C}
MEANINGS = {
    "x": " [m], world_ned",
    "y": " [m], world_ned",
    "psi": " [rad], world_ned: heading",
    "u": " [m/s], body: surge",
    "v": " [m/s], body: sway",
    "r": " [rad/s]: yaw rate",
}
# Names with a meaning in the code, beside keywords
RESERVED = "np ca collections state inputs parameters t dt p h i rate acting measured at after rates".split()


@dataclass(frozen=True, repr=False)
class ExportedModel(Shown):
    """A model that was written as code.

    >>> import tempfile
    >>> written = ground.Model.load(model_file).export(tempfile.mkdtemp() + "/craft.py")
    >>> written.to, written.states
    ('numpy', ['x', 'y', 'psi', 'u', 'v', 'r'])
    """

    path: str  #: path of the file
    to: str  #: language: numpy, casadi or c
    states: List[str]  #: names of the components of a state
    inputs: List[str]  #: names of the inputs
    #: largest relative difference from the core's results at random states; None if not compared
    difference: Optional[float]
    unchecked: str  #: why the code was not compared; empty if it was

    def headline(self, written: str = "") -> List[Line]:
        """First lines of the report: what was written, and whether it agrees with the model."""
        return [
            ("Exported", "states %s; inputs %s." % (", ".join(self.states), ", ".join(self.inputs))),
            ("Checked", _checked(self.difference, self.unchecked)),
            ("File", self.path),
            (
                "Next",
                "use it: its first lines explain how"
                if self.difference is not None
                else "check it on a computer that can run it",
            ),
        ]

    def to_frame(self) -> "pandas.DataFrame":
        """Table of the positions of states and inputs in their vectors, indexed by kind and name."""
        import pandas

        rows = [(kind, *item[::-1]) for kind, names in self._groups() for item in enumerate(names)]
        return pandas.DataFrame(rows, columns=["kind", "name", "index"]).set_index(["kind", "name"])

    def to_dict(self) -> Dict[str, object]:
        """The result as plain values, as `identify export --json` prints them."""
        return asdict(self)

    def _groups(self) -> Iterator[Tuple[str, List[str]]]:
        yield "state", self.states
        yield "input", self.inputs


def target(path: str, to: Optional[str]) -> str:
    """What a file is written as: what is asked for, else what its name says. GroundError when neither is
    known."""
    found = to or SUFFIXES.get(os.path.splitext(path)[1])
    if found in TARGETS:
        return str(found)
    ends = ", ".join("%s as %s" % item for item in SUFFIXES.items())
    raise GroundError(
        "%s: unknown format; name the file %s, or choose one of %s with --to (to= in Python)"
        % (path, ends, ", ".join(TARGETS))
        if to is None
        else "a model is not exported to %s; --to (to= in Python) needs one of %s" % (to, ", ".join(TARGETS))
    )


def write(core: _core.Model, path: Path, to: Optional[str] = None, force: bool = False) -> ExportedModel:
    """Writes a model as code of its own: `to` is numpy, casadi or c, by default what the file's name says.

    The code is compared with the core at random states first. GroundError when it differs, an effect
    cannot be written as formulas, or the file cannot be written.
    """
    place = os.fspath(path)
    chosen = target(place, to)
    prefix = re.sub(r"\W", "_", os.path.splitext(os.path.basename(place))[0], flags=re.ASCII)
    prefix = prefix if prefix[:1].isalpha() else "model_" + prefix
    files.refuse_existing(place, force)
    with core_errors():
        equations = Equations(core, RESERVED)
    code = _code(equations, chosen, prefix, place)
    difference, unchecked = checks.compared(equations, code, chosen, prefix)
    files.write_text(place, code.replace(CHECK, _safe(_checked(difference, unchecked))), force)
    names = [[symbol.name for symbol in group] for group in (equations.states, equations.inputs)]
    return ExportedModel(place, chosen, names[0], names[1], difference, unchecked)


CHECK = "@CHECK@"  # stands for what is known only when the code has run


def _checked(difference: Optional[float], unchecked: str) -> str:
    """Whether the code was compared with the core."""
    if difference is None:
        return "It was not compared with the model: %s" % unchecked
    text = "It agrees with the model at %d random states: the largest relative difference is %.0e"
    return text % (checks.COUNT, difference)


def _code(equations: Equations, to: str, prefix: str, path: str) -> str:
    """The file, with CHECK in it."""
    language, core = TARGETS[to], equations.core
    loader = jinja2.FileSystemLoader(os.path.dirname(os.path.abspath(__file__)))
    environment = jinja2.Environment(loader=loader, trim_blocks=True, lstrip_blocks=True)
    template = environment.get_template("c.jinja" if to == "c" else "python.jinja")
    known = described(core)
    text = template.render(
        title=_safe(core.name or "A model"),
        version=_core.version,
        date=origin.now(),
        command=_safe(origin.command()),
        check=CHECK,
        casadi=to == "casadi",
        prefix=prefix,
        linkage="static inline " if path.endswith(".h") else "",
        number=language.number,
        states=equations.states,
        inputs=equations.inputs,
        initial=equations.initial,
        meanings={s.name: MEANINGS.get(s.name, ": state of an effect") for s in equations.states},
        ranges=_ranges(core),
        parameters=[
            {
                "name": name,
                "identifier": symbol.identifier,
                "value": core.value(name),
                "doc": _safe(known[name].doc or name),
                "unit": _safe(known[name].unit),
            }
            for name, symbol in equations.parameters.items()
        ],
        actuated=equations.is_actuated,
        delays=equations.delays,
        **_functions(equations, language),
    )
    return checks.named(text, prefix)


def _ranges(core: _core.Model) -> List[str]:
    """Where the inputs are, in words."""
    ends = ["%g to %g" % tuple(core.input_max * end for end in t["range"]) for t in core.thrusters]
    return [": thruster, %s" % end for end in ends] + [": lift fan, 0 to 1"]


@dataclass(frozen=True)
class UsedSymbol:
    """A symbol that a function uses, and its place in the argument."""

    name: str
    identifier: str
    index: int


@dataclass
class WrittenFunction:
    """A function of the code, for its template: its statements, and what they use of its arguments."""

    states: List[UsedSymbol]
    inputs: List[UsedSymbol]
    parameters: List[UsedSymbol]
    lines: List[str]
    outputs: List[str]
    unused: List[str]  # arguments
    # Parts of the outputs, where commands pass actuators
    nodes: List[List[str]] = field(default_factory=list)
    after: List[str] = field(default_factory=list)
    now: List[str] = field(default_factory=list)
    rates: List[str] = field(default_factory=list)

    @property
    def chooses(self) -> bool:
        """Whether it depends on conditions."""
        return any("where(" in text for text in [*self.lines, *self.outputs])


def _functions(equations: Equations, language: Language) -> Dict[str, WrittenFunction]:
    """The functions of the code, for its template."""

    def written(places: Sequence[int], *arguments: str) -> WrittenFunction:
        return _written(equations, equations.function(places, language), arguments)

    outputs = equations.outputs
    found = {
        "motion": written(outputs.motion, "state", "inputs", "t", "p"),
        "measured": written(outputs.measured, "state", "p"),
        "delay": written([outputs.delay], "p"),
    }
    if equations.is_actuated:
        nodes, now = outputs.nodes, outputs.now
        places = [place for node in nodes for place in node]
        step = written([*places, *outputs.after], "state", "inputs", "dt", "p")
        width = len(nodes[0])
        step.nodes = [step.outputs[i * width : (i + 1) * width] for i in range(len(nodes))]
        step.after = step.outputs[len(places) :]
        at_once = written([*now, *outputs.rates], "state", "inputs", "p")
        at_once.now, at_once.rates = at_once.outputs[: len(now)], at_once.outputs[len(now) :]
        found.update(step=step, at_once=at_once)
    return found


def _written(equations: Equations, function: Function, arguments: Sequence[str]) -> WrittenFunction:
    def used(kind: str, symbols: Iterable[Symbol]) -> List[UsedSymbol]:
        return [
            UsedSymbol(symbol.name, symbol.identifier, index)
            for index, symbol in enumerate(symbols)
            if "%s %s" % (kind, symbol.name) in function.used
        ]

    states, inputs = used("state", equations.states), used("input", equations.inputs)
    parameters = used("parameter", equations.parameters.values())
    needed = {"state": states, "inputs": inputs, "p": parameters}
    unused = [a for a in arguments if not needed.get(a, a in function.used)]
    return WrittenFunction(states, inputs, parameters, function.lines, function.outputs, unused)


def _safe(text: str) -> str:
    """A text that cannot end a comment or a docstring."""
    return " ".join(text.split()).replace("\\", "/").replace('"', "'").replace("*/", "* /")
