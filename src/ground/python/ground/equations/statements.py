"""A model's equations, as the core writes them down, in statements of a language."""

import keyword
from dataclasses import dataclass, field
from typing import Callable, Dict, Iterable, List, Mapping, Sequence, Set, Tuple

from ground import _core

MAX_EXPRESSION = 80  # expression that is not given a name of its own [characters]
POSE_AND_VELOCITY = ("x", "y", "psi", "u", "v", "r")
# How tightly operators bind, in C as in Python
TIGHTNESS = {"||": 1, "&&": 2, "!": 2, "+": 5, "-": 5, "*": 6, "/": 6, "neg": 7}
TIGHTNESS.update(dict.fromkeys(("<", ">", "<=", ">=", "==", "!="), 3))
LOOSE, WHOLE = 0, 9  # a list of arguments; a name, a number or a call


@dataclass(frozen=True)
class Language:
    """How expressions are written. Operators are C's where `functions` has no other."""

    functions: Mapping[str, str]  #: by name of the operation, with {0}, {1}, {2} for the arguments
    number: Callable[[float], str]
    parameter: str  #: with {0} for its name
    assignment: str  #: with {0} for the name and {1} for the value


@dataclass(frozen=True)
class Symbol:
    """A quantity that the equations depend on."""

    name: str  #: as users know it, such as motor_lag.tau
    identifier: str  #: in code


@dataclass(frozen=True)
class Function:
    """Statements that compute some outputs."""

    lines: List[str]
    outputs: List[str]  #: expressions
    used: Set[str]  #: labels of the symbols that they contain


@dataclass(frozen=True)
class Places:
    """Places of what the equations give, among the operations."""

    motion: List[int]
    measured: List[int]
    delay: int
    # Where commands pass actuators
    nodes: List[List[int]] = field(default_factory=list)
    now: List[int] = field(default_factory=list)
    after: List[int] = field(default_factory=list)
    rates: List[int] = field(default_factory=list)


class Equations:
    """The equations of a model: _core.equations, with names for code."""

    def __init__(self, core: _core.Model, reserved: Iterable[str] = ()) -> None:
        """Raises ValueError for an effect that cannot be written down. reserved: names with a meaning in
        the code."""
        found = _core.equations(core)
        self.core: _core.Model = found["model"]  #: with the effects that act
        self.initial: List[float] = found["initial"]  #: states of effects before the first command
        self.outputs = Places(**found["outputs"])
        self._operations: List[Tuple[str, str, List[int], float]] = found["operations"]
        self._taken = {*reserved, *keyword.kwlist}
        self.symbols: Dict[str, Symbol] = {"t": Symbol("t", "t"), "dt": Symbol("dt", "dt")}
        self.states = [self._symbol("state", name) for name in (*POSE_AND_VELOCITY, *found["states"])]
        thrusters = [t["name"] for t in self.core.thrusters]
        self.inputs = [self._symbol("input", name, "u_" + name) for name in thrusters]
        self.inputs.append(self._symbol("input", "lift"))
        self.parameters = {p["name"]: self._symbol("parameter", p["name"]) for p in self.core.parameters()}

    @property
    def is_actuated(self) -> bool:
        """Whether commands pass actuators before they act."""
        return bool(self.outputs.nodes)

    @property
    def delays(self) -> bool:
        """Whether inputs act late."""
        return bool(self._operations[self.outputs.delay][3] != 0)

    def function(self, places: Sequence[int], language: Language) -> Function:
        """The statements that compute the operations at some places, each with one name."""
        return _Writer(self._operations, self.symbols, language, self._taken).function(places)

    def _symbol(self, kind: str, name: str, wanted: str = "") -> Symbol:
        """A symbol with an identifier of its own."""
        identifier = (wanted or name).replace(".", "_")
        while identifier in self._taken:
            identifier += "_"
        self._taken.add(identifier)
        self.symbols["%s %s" % (kind, name)] = symbol = Symbol(name, identifier)
        return symbol


class _Writer:
    """Writes the statements of a function."""

    def __init__(
        self,
        operations: Sequence[Tuple[str, str, List[int], float]],
        symbols: Mapping[str, Symbol],
        language: Language,
        taken: Set[str],
    ) -> None:
        self.operations, self.symbols, self.language, self.taken = operations, symbols, language, taken
        self.texts: Dict[int, Tuple[str, int]] = {}  # by place: expression, and how tightly it binds
        self.lines: List[str] = []
        self.used: Set[str] = set()
        self.number = 0

    def function(self, places: Sequence[int]) -> Function:
        """The statements that compute the operations at some places."""
        counts: Dict[int, int] = {}
        waiting = list(places)
        while waiting:
            place = waiting.pop()
            counts[place] = counts.get(place, 0) + 1
            if counts[place] == 1:
                waiting.extend(self.operations[place][2])
        for place in sorted(counts):
            self._write(place, counts[place])
        return Function(self.lines, [self.texts[place][0] for place in places], self.used)

    def _write(self, place: int, uses: int) -> None:
        name, label, arguments, value = self.operations[place]
        if name == "constant":
            text = self.language.number(value)
            self.texts[place] = text, TIGHTNESS["neg"] if text.startswith("-") else WHOLE
        elif name == "symbol":
            self.used.add(label)
            text = self.symbols[label].identifier
            is_parameter = label.startswith("parameter ")
            self.texts[place] = self.language.parameter.format(text) if is_parameter else text, WHOLE
        else:
            self._operation(place, name, arguments, uses)

    def _operation(self, place: int, name: str, arguments: Sequence[int], uses: int) -> None:
        tightness = WHOLE
        if name in self.language.functions:
            text = self.language.functions[name].format(*(self._argument(a, LOOSE) for a in arguments))
        else:
            tightness = TIGHTNESS[name]
            operands = [self._argument(a, tightness + i) for i, a in enumerate(arguments)]
            text = (" %s " % name).join(operands) if len(operands) == 2 else "-" + operands[0]
        if uses > 1 or len(text) > MAX_EXPRESSION:
            own = self._name()
            self.lines.append(self.language.assignment.format(own, text))
            text, tightness = own, WHOLE
        self.texts[place] = text, tightness

    def _argument(self, place: int, tightness: int) -> str:
        text, own = self.texts[place]
        return "(%s)" % text if own < tightness else text

    def _name(self) -> str:
        """A name that nothing else has."""
        self.number += 1
        while "e%d" % self.number in self.taken:
            self.number += 1
        return "e%d" % self.number
