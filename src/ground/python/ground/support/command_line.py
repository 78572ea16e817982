"""Command lines that are made from dataclasses of options, and functions that take such options."""

import argparse
import functools
import inspect
import math
import numbers
from dataclasses import Field, dataclass, field, fields, replace
from typing import Any, Callable, Dict, Generic, Iterable, Mapping, Optional, Sequence, Type, TypeVar

from ground.support import docstrings, files, progress
from ground.support.errors import OptionError, did_you_mean
from ground.support.results import Shown

_T = TypeVar("_T")
_O = TypeVar("_O")
_N = TypeVar("_N", int, float)


def option(default: Any, help: str, **more: Any) -> Any:
    """A field of a dataclass that is an option of a command line, too. more: arguments of
    argparse.add_argument such as type, metavar, nargs and choices; name: of the option, if it is not
    the field's; group: title of its part of the help; range: least and largest number."""
    return field(default=default, metadata={"help": help, **more})


def add_options(parser: "argparse._ActionsContainer", kind: Type[Any]) -> None:
    """Adds the options of a dataclass to a parser."""
    groups: Dict[Optional[str], argparse._ActionsContainer] = {None: parser}
    for one in (one for one in fields(kind) if one.metadata):
        more = dict(one.metadata)
        name = more.pop("name", "--" + one.name.replace("_", "-"))
        title = more.pop("group", None)
        if more.pop("range", None):
            more["type"] = _type(one)
        if title not in groups:
            groups[title] = parser.add_argument_group(title)
        if one.default is False and "nargs" not in more:
            more["action"] = "store_true"
        groups[title].add_argument(name, dest=one.name, default=one.default, **more)


def options(arguments: argparse.Namespace, kind: Type[_O]) -> _O:
    """The options that were given on a command line."""
    return kind(**{f.name: getattr(arguments, f.name) for f in fields(kind) if f.metadata})


def check(options: Any) -> Any:
    """The options, with tuples where several values are due. OptionError when a value is not allowed."""
    given = {f.name: (f, getattr(options, f.name)) for f in fields(options) if f.metadata}
    own = {
        name: _checked(one, value)
        for name, (one, value) in given.items()
        if value is not None and not (type(value) is type(one.default) and value == one.default)
    }
    return replace(options, **own)


def _checked(one: "Field[Any]", value: Any) -> Any:
    """A value of an option as the command line would give it."""
    kind, number_of = _type(one), one.metadata.get("nargs")
    if callable(value) or isinstance(value, bool) and isinstance(one.default, bool):
        return value
    if isinstance(one.default, bool) and number_of is None:
        raise OptionError("{0}: {value!r} is neither True nor False", one.name, value=value)
    if number_of is None:
        return _single(one, kind, value)
    if isinstance(value, Mapping) and kind and not isinstance(kind, _Number):
        return value
    is_single = isinstance(value, (str, Mapping)) or not isinstance(value, Iterable)
    values = tuple(_single(one, kind, v) for v in ([value] if is_single else value))
    if isinstance(number_of, int) and len(values) != number_of:
        raise OptionError("{0} needs {count} numbers, not {n}", one.name, count=number_of, n=len(values))
    return values


def _single(one: "Field[Any]", kind: Any, value: Any) -> Any:
    """A value of an option that takes one, or one of several."""
    wrong = ""
    if isinstance(kind, _Number):
        whole = kind.kind is int
        if isinstance(value, bool) or not isinstance(value, numbers.Integral if whole else numbers.Real):
            wrong = "is not a whole number" if whole else "is not a number"
        elif not kind.allows(value):
            wrong = kind.otherwise
        else:
            return kind.kind(value)
    elif kind and isinstance(value, str):
        try:
            return kind(value)
        except argparse.ArgumentTypeError as error:
            raise OptionError("{0}: {why}", one.name, why=error) from None
    elif kind and not isinstance(value, Sequence):
        wrong = "is not %s" % one.metadata["metavar"]
    elif docstrings.type_name(one.type) in ("str", "sequence of str") and not isinstance(value, str):
        wrong = "is not a string"
    elif value not in one.metadata.get("choices", (value,)):
        raise OptionError("{0} must be one of {known}", one.name, known=", ".join(one.metadata["choices"]))
    if wrong:
        shown = "%g" % value if isinstance(value, float) else repr(value)
        raise OptionError("{0}: {value} {wrong}", one.name, value=shown, wrong=wrong)
    return value


def given(options: Any, names: Iterable[str]) -> Dict[str, Any]:
    """The options of these names that are not left out."""
    values = {name: getattr(options, name) for name in names}
    return {name: value for name, value in values.items() if value is not None and value is not False}


def takes(kind: Type[Any]) -> Callable[[Callable[..., _T]], Callable[..., _T]]:
    """Lets a function with an argument `options`, a dataclass of this kind, take its fields as keyword
    arguments, too, and checks them. Its signature and its docstring list them."""

    def decorate(function: Callable[..., _T]) -> Callable[..., _T]:
        @functools.wraps(function)
        def taking(*given: Any, **keywords: Any) -> _T:
            for name in set(keywords) - set(known):
                text = "%s() has no argument %s%s" % (function.__name__, name, did_you_mean(name, known))
                raise TypeError(text)
            own = {f.name: keywords.pop(f.name) for f in fields(kind) if f.name in keywords}
            chosen = keywords.pop("options", None) or kind()
            return function(*given, options=check(replace(chosen, **own)), **keywords)

        signature = inspect.signature(function)
        given = dict(signature.parameters)
        given["options"] = given["options"].replace(default=None)
        for f in fields(kind):
            given[f.name] = inspect.Parameter(f.name, inspect.Parameter.KEYWORD_ONLY, default=f.default)
        # The docstring has the types: as Python writes them they fill the screen before it.
        bare = [one.replace(annotation=inspect.Parameter.empty) for one in given.values()]
        parameters = sorted(bare, key=lambda one: one.kind)
        known = [one.name for one in parameters]
        vars(taking)["__signature__"] = signature.replace(parameters=parameters)
        taking.__doc__ = docstrings.with_options(function, kind)
        return taking

    return decorate


# Types of options


@dataclass(frozen=True)
class _Number(Generic[_N]):
    """A type of options: numbers that are allowed."""

    kind: Callable[[Any], _N]
    allows: Callable[[_N], bool]
    otherwise: str  #: what is wrong with another one
    __name__ = "number"  # in errors of argparse

    def __call__(self, text: str) -> _N:
        if text.endswith("%") and self.kind is float:
            raise argparse.ArgumentTypeError("%s is not a number: write %g" % (text, float(text[:-1]) / 100))
        value = self.kind(text)
        if not self.allows(value):
            raise argparse.ArgumentTypeError("%s %s" % (text, self.otherwise))
        return value


def _type(one: "Field[Any]") -> Any:
    """The type of an option, as argparse takes it; None for text."""
    kind = one.metadata.get("type")
    if "range" not in one.metadata:
        return kind
    low, high = one.metadata["range"]
    return _Number(kind or float, lambda x: bool(low <= x <= high), "is not between %g and %g" % (low, high))


above_zero = _Number(float, lambda x: x > 0, "is not positive")
positive = _Number(float, lambda x: 0 < x < math.inf, "is not positive")
number = _Number(float, math.isfinite, "is not finite")
count = _Number(int, lambda n: n > 0, "is not positive")
seed = _Number(int, lambda n: 0 <= n < 2**31, "is not a seed: 0 or more")
seconds = _Number(float, lambda x: 0 <= x < math.inf, "is not a time since the start [s]")


# Arguments that verbs share


def add_output(parser: argparse.ArgumentParser, metavar: str, help: str = "file to write") -> None:
    """Adds --output and --force."""
    parser.add_argument("-o", "--output", metavar=metavar, required=True, help=help)
    parser.add_argument("--force", action="store_true", help="overwrite existing files")


def add_model(parser: argparse.ArgumentParser, help: str) -> None:
    """Adds --model."""
    parser.add_argument("--model", metavar="M.yaml", required=True, help=help)


def add_details(parser: argparse.ArgumentParser) -> None:
    """Adds --details."""
    parser.add_argument("--details", action="store_true", help="also print the evidence")


def say_details(arguments: argparse.Namespace, details: Iterable[str]) -> None:
    """Prints the evidence of a result if it was asked for."""
    for line in ["", *details] if arguments.details else ():
        say(arguments, line)


def say_result(arguments: argparse.Namespace, found: Shown, written: str) -> None:
    """Prints a result that was written to a file or folder, and its evidence if that was asked for."""
    for line in found.lines(written):
        say(arguments, line)
    say_details(arguments, found.details())


def add_mat(parser: argparse.ArgumentParser) -> None:
    """Adds --mat."""
    help = "also write models, runs and predictions for MATLAB and Octave"
    parser.add_argument("--mat", metavar="FILE.mat", help=help)


def check_mat(arguments: argparse.Namespace) -> None:
    """GroundError when the file of --mat cannot be written. Call it before long work starts."""
    if arguments.mat:
        files.refuse_existing(arguments.mat, arguments.force)


def write_mat(arguments: argparse.Namespace, found: Any) -> None:
    """Writes the file of --mat, if it is given. found: a result with to_mat()."""
    if arguments.mat:
        found.to_mat(arguments.mat, arguments.force)
        say(arguments, "written to %s" % arguments.mat)


def say(arguments: argparse.Namespace, text: str = "") -> None:
    """Prints a line, unless the result is printed as JSON."""
    if not arguments.json:
        progress.say(text)
