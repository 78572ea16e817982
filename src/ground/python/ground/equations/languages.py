"""The languages that a model is written in."""

import math
from typing import Callable, Dict

from ground.equations.statements import Language

_SAME = "sin cos tan sinh cosh tanh exp log sqrt".split()  # everywhere
_ARCS = "asin acos atan asinh acosh atanh".split()


def _calls(prefix: str, names: Dict[str, str]) -> Dict[str, str]:
    """Function-call templates; with two arguments for names of binary operations."""
    two = ("min", "max", "atan2", "pow", "&&", "||")
    return {
        operation: "%s%s(%s)" % (prefix, name, "{0}, {1}" if operation in two else "{0}")
        for operation, name in names.items()
    }


def _number(infinity: str) -> Callable[[float], str]:
    """Writes numbers so that they are read back exactly."""

    def text(value: float) -> str:
        if math.isinf(value):
            return infinity if value > 0 else "-" + infinity
        return repr(float(value))

    return text


NUMPY = Language(
    {
        **_calls("np.", {name: name for name in _SAME}),
        **_calls("np.", {name: name.replace("a", "arc", 1) for name in _ARCS}),
        **_calls("np.", {"abs": "abs", "atan2": "arctan2", "min": "minimum", "max": "maximum"}),
        **_calls("np.", {"pow": "power", "rint": "rint", "!": "logical_not"}),
        **_calls("np.", {"&&": "logical_and", "||": "logical_or"}),
        "select": "np.where({0}, {1}, {2})",
    },
    _number("np.inf"),
    "{0}",
    "{0} = {1}",
)
CASADI = Language(
    {
        **_calls("ca.", {name: name for name in [*_SAME, *_ARCS]}),
        **_calls("ca.", {"abs": "fabs", "atan2": "atan2", "min": "fmin", "max": "fmax", "pow": "power"}),
        **_calls("ca.", {"&&": "logic_and", "||": "logic_or", "!": "logic_not"}),
        "rint": "ca.floor({0} + 0.5)",
        "select": "ca.if_else({0}, {1}, {2})",
    },
    _number("ca.inf"),
    "{0}",
    "{0} = {1}",
)
C = Language(
    {
        **_calls("", {name: name for name in [*_SAME, *_ARCS]}),
        **_calls("", {"abs": "fabs", "atan2": "atan2", "min": "fmin", "max": "fmax", "pow": "pow"}),
        "rint": "rint({0})",
        "!": "!({0})",
        "select": "(({0}) ? ({1}) : ({2}))",
    },
    _number("INFINITY"),
    "p->{0}",
    "const double {0} = {1};",
)
