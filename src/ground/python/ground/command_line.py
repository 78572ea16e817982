"""Command lines that are made from dataclasses of options, and functions that take such options."""

import argparse
import functools
import inspect
import math
from dataclasses import field, fields, replace
from typing import Any, Callable, Dict, Iterable, List, Type, TypeVar

from ground import progress
from ground.errors import OptionError

_T = TypeVar("_T")
_O = TypeVar("_O")


def option(default: Any, help: str, **more: Any) -> Any:
    """A field of a dataclass that is an option of a command line, too. more: arguments of
    argparse.add_argument such as type, metavar, nargs and choices; name: of the option, if it is not
    the field's; group: title of its part of the help; range: least and largest number."""
    return field(default=default, metadata={"help": help, **more})


def add_options(parser: argparse.ArgumentParser, kind: Type[Any]) -> None:
    """Adds the options of a dataclass to a parser."""
    groups: Dict[Any, Any] = {None: parser}
    for one in (one for one in fields(kind) if one.metadata):
        more = dict(one.metadata)
        name = more.pop("name", "--" + one.name.replace("_", "-"))
        title = more.pop("group", None)
        if "range" in more:
            low, high = more.pop("range")
            more["type"] = between(low, high, more.get("type", float))
        if title not in groups:
            groups[title] = parser.add_argument_group(title)
        if one.default is False and "nargs" not in more:
            more["action"] = "store_true"
        groups[title].add_argument(name, dest=one.name, default=one.default, **more)


def options(arguments: argparse.Namespace, kind: Type[_O]) -> _O:
    """The options that were given on a command line."""
    return kind(**{f.name: getattr(arguments, f.name) for f in fields(kind) if f.metadata})


def check(options: Any) -> None:
    """OptionError when a number is not in the range of its option, or a value is none of the choices."""
    for one in fields(options):
        value = getattr(options, one.name)
        if value is None:
            continue
        choices = one.metadata.get("choices", (value,))
        if value not in choices:
            raise OptionError("{0} must be one of {known}", one.name, known=", ".join(choices))
        if "range" in one.metadata:
            low, high = one.metadata["range"]
            for number in value if isinstance(value, (list, tuple)) else [value]:
                if not low <= number <= high:
                    text = "{0}: {value:g} is not between {low:g} and {high:g}"
                    raise OptionError(text, one.name, value=number, low=low, high=high)


def given(options: Any, names: Iterable[str]) -> Dict[str, Any]:
    """The options of these names that are not left out."""
    values = {name: getattr(options, name) for name in names}
    return {name: value for name, value in values.items() if value is not None and value is not False}


def takes(kind: Type[Any]) -> Callable[[Callable[..., _T]], Callable[..., _T]]:
    """Lets a function whose last argument is `options`, a dataclass of this kind, take its fields as
    keyword arguments, too. Its signature and its docstring list them."""

    def decorate(function: Callable[..., _T]) -> Callable[..., _T]:
        @functools.wraps(function)
        def taking(*given: Any, **keywords: Any) -> _T:
            own = {f.name: keywords.pop(f.name) for f in fields(kind) if f.name in keywords}
            chosen = keywords.pop("options", None) or kind()
            return function(*given, options=replace(chosen, **own), **keywords)

        signature = inspect.signature(function)
        added = [
            inspect.Parameter(f.name, inspect.Parameter.KEYWORD_ONLY, default=f.default, annotation=f.type)
            for f in fields(kind)
        ]
        parameters = sorted([*signature.parameters.values(), *added], key=lambda p: p.kind)
        vars(taking)["__signature__"] = signature.replace(parameters=parameters)
        head, arrows, examples = (function.__doc__ or "").partition("\n\n    >>>")
        taking.__doc__ = head.rstrip() + "\n\n" + "\n".join(_described(kind)) + arrows + examples
        return taking

    return decorate


def _described(kind: Type[Any]) -> List[str]:
    """A line of a docstring for each option."""
    return [
        "    - ``%s``: %s" % (f.name, f.metadata["help"] % {"default": f.default})
        for f in fields(kind)
        if f.metadata
    ]


# Types of options


def positive(text: str) -> float:
    """A finite number above zero."""
    value = float(text)
    if not 0 < value < math.inf:
        raise argparse.ArgumentTypeError("%s is not positive" % text)
    return value


def number(text: str) -> float:
    """A finite number."""
    value = float(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError("%s is not finite" % text)
    return value


def count(text: str) -> int:
    """An integer above zero."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError("%s is not positive" % text)
    return value


def seed(text: str) -> int:
    """An integer from 0 to 2^31 - 1."""
    value = int(text)
    if not 0 <= value < 2**31:
        raise argparse.ArgumentTypeError("%s is not a seed: 0 or more" % text)
    return value


def seconds(text: str) -> float:
    """A finite time [s], zero or more."""
    value = float(text)
    if not 0 <= value < math.inf:
        raise argparse.ArgumentTypeError("%s is not a time since the start [s]" % text)
    return value


def between(low: float, high: float, kind: Callable[[str], float] = float) -> Callable[[str], float]:
    """A number from low to high."""

    def parse(text: str) -> float:
        value = kind(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError("%s is not between %g and %g" % (text, low, high))
        return value

    parse.__name__ = "number"
    return parse


# Arguments that verbs share


def add_output(parser: argparse.ArgumentParser, metavar: str, help: str = "file to write") -> None:
    """Adds --output and --force."""
    parser.add_argument("-o", "--output", metavar=metavar, required=True, help=help)
    parser.add_argument("--force", action="store_true", help="overwrite what exists")


def add_model(parser: argparse.ArgumentParser, help: str) -> None:
    """Adds --model."""
    parser.add_argument("--model", metavar="M.yaml", required=True, help=help)


def say(arguments: argparse.Namespace, text: str = "") -> None:
    """Prints a line, unless the result is printed as JSON."""
    if not arguments.json:
        progress.say(text)
