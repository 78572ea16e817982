"""Python functions as formulas: a function is called once with symbols, and what it does with them is the
formula. So an effect that is written in Python runs in the core as fast as one in YAML."""

import inspect
from typing import Any, Callable, Dict, Iterable, Mapping, Sequence, Tuple

import numpy as np

from ground.support.errors import GroundError, did_you_mean

# Functions of numpy as formulas
FORMS = {
    **{name: name + "(%s)" for name in "sin cos tan sinh cosh tanh exp log2 log10 sqrt sign rint".split()},
    **{"arc" + name: "a" + name + "(%s)" for name in "sin cos tan sinh cosh tanh".split()},
    "arctan2": "atan2(%s,%s)", "log": "ln(%s)", "absolute": "abs(%s)", "fabs": "abs(%s)",
    "minimum": "min(%s,%s)", "fmin": "min(%s,%s)", "maximum": "max(%s,%s)", "fmax": "max(%s,%s)",
    "negative": "(-%s)", "positive": "%s", "square": "(%s)^2", "hypot": "sqrt(%s^2+%s^2)",
    "add": "(%s+%s)", "subtract": "(%s-%s)", "multiply": "(%s*%s)", "divide": "(%s/%s)",
    "true_divide": "(%s/%s)", "power": "(%s^%s)", "less": "(%s<%s)", "less_equal": "(%s<=%s)",
    "greater": "(%s>%s)", "greater_equal": "(%s>=%s)", "equal": "(%s==%s)", "not_equal": "(%s!=%s)",
    "logical_and": "(%s&&%s)", "logical_or": "(%s||%s)", "bitwise_and": "(%s&&%s)", "bitwise_or": "(%s||%s)",
    "where": "(%s ? %s : %s)", "clip": "min(max(%s,%s),%s)",
}  # fmt: skip
ONLY = (
    "a force is made of + - * / **, comparisons, numpy.where, clip, interp and numpy's absolute, cos, cosh, "
    "exp, log, log10, log2, maximum, minimum, rint, sign, sin, sinh, sqrt, tan, tanh"
)


class TracedSymbol(np.lib.mixins.NDArrayOperatorsMixin):
    """A number that is known when the formula is evaluated."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **kwargs: Any) -> "TracedSymbol":
        name = ufunc.__name__ if method == "__call__" else "%s.%s" % (ufunc.__name__, method)
        return _called(name, inputs, kwargs)

    def __array_function__(self, function: Any, kinds: Any, given: Any, options: Any) -> "TracedSymbol":
        if function is np.interp and len(given) == 3 and not options:
            return _interpolated(*given)
        return _called(function.__name__, given, options)

    def __abs__(self) -> "TracedSymbol":
        return TracedSymbol("abs(%s)" % self.text)

    def __bool__(self) -> bool:
        raise GroundError("a force must not decide by if, and, or, min, max: numpy.where does, in a formula")

    def __float__(self) -> float:
        raise GroundError("a force must not take numbers out of its arguments (math.sin does): %s" % ONLY)

    __index__ = __int__ = __len__ = __iter__ = __float__


def _called(name: str, given: Sequence[Any], options: Mapping[str, object]) -> TracedSymbol:
    """What a function of numpy makes of symbols and numbers."""
    form = FORMS.get(name, "")
    if options or not form or form.count("%s") != len(given):
        raise GroundError("numpy.%s is no formula: %s" % (name, ONLY))
    return TracedSymbol(form % tuple(map(formula, given)))


def _interpolated(at: Any, points: Any, values: Any) -> TracedSymbol:
    """numpy.interp: constant outside the points, so that slopes begin and end with 0."""
    x, y = np.asarray(points, float), np.asarray(values, float)
    if x.ndim != 1 or x.shape != y.shape or not len(x) or (np.diff(x) <= 0).any():
        raise GroundError("numpy.interp needs as many values as points, and points that ascend")
    kinks = np.diff(np.concatenate([[0.0], np.diff(y) / np.diff(x), [0.0]]))
    terms = ["%s*max(%s-%s,0)" % (formula(k), formula(at), formula(p)) for k, p in zip(kinks, x) if k]
    return TracedSymbol("(%s)" % "+".join([formula(y[0]), *terms]))


def formula(value: Any) -> str:
    """The text of a formula: of a symbol, a number or a text."""
    if isinstance(value, (TracedSymbol, str)):
        return value.text if isinstance(value, TracedSymbol) else value
    try:
        number = float(value)
    except (TypeError, ValueError):
        raise GroundError("a force needs numbers, not %s" % type(value).__name__)
    if not np.isfinite(number):
        raise GroundError("a force must be finite, not %g" % number)
    return repr(number) if number >= 0 else "(%r)" % number


class Symbols:
    """Symbols by name, as attributes. what: they are of; names: in formulas, by attribute; prefix: of other
    attributes that are names in formulas, too (empty: there are none)."""

    def __init__(self, what: str, names: Mapping[str, str], prefix: str = "") -> None:
        self._what, self._names, self._prefix = what, names, prefix

    def __getattr__(self, name: str) -> TracedSymbol:
        if name not in self._names and not (self._prefix and name.startswith(self._prefix)):
            known = [*self._names, *[self._prefix + "NAME of a thruster"] * bool(self._prefix)]
            hint = did_you_mean(name, self._names)
            raise GroundError("%s has no %s%s; it has %s" % (self._what, name, hint, ", ".join(known)))
        return TracedSymbol(self._names.get(name, name))


def traced(
    name: str, force: Callable[..., Any], states: Iterable[str], parameters: Iterable[str]
) -> Dict[str, str]:
    """The formulas X, Y, N of a function of state, inputs and parameters; see Effect. GroundError when it is
    none."""
    own = {one: one for one in ("u", "v", "r", "x", "y", "psi", "t", *states)}
    inputs = Symbols("inputs", {"left": "u_L", "right": "u_R", "lift": "lift", "volt": "volt"}, prefix="u_")
    given = {one: TracedSymbol(one) for one in parameters}
    try:
        inspect.signature(force).bind("state", "inputs", **given)
    except TypeError as error:
        wanted = ", ".join(["state", "inputs", *given])
        raise GroundError("effect %s: its force is called as force(%s): %s" % (name, wanted, error))
    try:
        found = force(Symbols("state", own), inputs, **given)
        if isinstance(found, Mapping):
            return {key: formula(value) for key, value in found.items()}
        if not isinstance(found, (tuple, list, np.ndarray)):
            raise GroundError("its force must return X, Y, N or a dictionary of components, not one value")
        rows: Tuple[Any, ...] = tuple(found)
    except GroundError as error:
        raise GroundError("effect %s: %s" % (name, error))
    except TypeError as error:
        raise GroundError("effect %s: its force cannot be a formula (%s): %s" % (name, error, ONLY))
    if len(rows) != 3:
        raise GroundError("effect %s: its force must return X, Y, N, not %d values" % (name, len(rows)))
    texts = {key: formula(value) for key, value in zip("XYN", rows)}
    return {key: text for key, text in texts.items() if text not in ("0.0", "(-0.0)")}
