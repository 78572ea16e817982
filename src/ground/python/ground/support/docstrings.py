"""Docstrings of numpy's style: signatures and dataclasses of options write their part of them."""

import inspect
import os
import re
import sys
import textwrap
from dataclasses import Field, fields
from typing import Any, Callable, Collection, Dict, ForwardRef, Iterator, List, Type, TypeVar, Union

_F = TypeVar("_F", bound=Callable[..., Any])

WIDTH = 100  # of generated text
SECTIONS = "Parameters|Attributes|"
SECTIONS += "Returns|Yields|Other Parameters|Raises|Warns|See Also|Notes|References|Examples"
#: A field, or what __init__ sets: the comment above it, its name, and the comment beside it
FIELD = re.compile(r"((?:^ +#: .*\n)*)^ +(?:self\.)?(\w+)(?::| =) [^#\n]*(?:#: (.*))?", re.M)
INTERNAL = ":meta private:"  # Sphinx leaves it out
ROWS = {  # parameters that mean the same everywhere
    "recordings": "Recording, path, or several\n    Recordings or bags.",
    "holdout": "Recording, path, or several, optional\n    Recordings or bags to test on.",
    "model": "Model or path\n    Model of the craft.",
    "recording": "Recording or path\n    A single run.",
    "horizon": "float, optional\n    How far each prediction goes [s]; default: what suits the craft.",
    "run": "str\n    Name of a run; empty: the first.",
    "start": "float\n    Start on the run's clock [s].",
    "end": "float\n    End on the run's clock [s].",
    "path": "path\n    The file.",
    "folder": "path\n    The folder.",
    "files": "mapping or sequence, optional\n    CSV files of the run, or of each run, by model.",
    "force": "bool, default False\n    Overwrite what exists.",
    "progress": "callable, optional\n    Called with a `ground.support.progress.Report` at each step.",
}
OPTIONS = "options : %s, optional\n    The following as one object, whose values keyword arguments replace."
READING = "GroundError\n    Names file, line and key of what is wrong."
WRITING = "GroundError\n    When it cannot be written, or exists and `force` is not set."


class Described:
    """Docstrings of what derives from this have what `complete` adds, and list the fields. Its objects do not
    offer internal methods for completion."""

    def __init_subclass__(cls, **more: Any) -> None:
        super().__init_subclass__(**more)
        cls.__doc__ = _joined({**_sections(cls.__doc__ or ""), "Attributes": "\n".join(_attributes(cls))})
        for name, member in vars(cls).items():
            function = getattr(member, "__func__", member)
            if inspect.isfunction(function) and not name.startswith("_"):
                if any(is_internal(getattr(base, name, None)) for base in cls.__mro__[1:]):
                    internal(function)
                complete(function)

    def __dir__(self) -> List[str]:
        return [name for name in super().__dir__() if not is_internal(getattr(type(self), name, None))]


def internal(function: _F) -> _F:
    """Marks a method that other modules of the package call, and no user."""
    function.__doc__ = "%s\n\n%s" % (inspect.cleandoc(function.__doc__ or ""), INTERNAL)
    return function


def is_internal(function: object) -> bool:
    """Whether a method is marked as internal."""
    return INTERNAL in (getattr(function, "__doc__", None) or "")


def complete(function: _F) -> _F:
    """Adds to a docstring the parameters in ROWS, the type of what is returned, and errors of files."""
    if is_internal(function):
        return function
    found, signature = _sections(function.__doc__ or ""), inspect.signature(function)
    rows = re.findall(r"^\S.*(?:\n .*)*", found.get("Parameters", ""), flags=re.M)
    known = {name for row in rows for name in row.partition(" :")[0].split(", ")}
    names = list(signature.parameters)
    rows += ["%s : %s" % (name, ROWS[name]) for name in names if name in ROWS.keys() - known]
    order = {name: i for i, name in enumerate(names)}
    rows.sort(key=lambda row: order.get(re.split(r"\W", row.lstrip("*"))[0], len(order)))
    found["Parameters"] = "\n".join(rows)
    if signature.return_annotation is not None:
        found.setdefault("Returns", type_name(signature.return_annotation))
    if "path" in names or "force" in names:
        found.setdefault("Raises", WRITING if "force" in names else READING)
    function.__doc__ = _joined(found)
    return function


def with_options(function: Callable[..., Any], kind: Type[Any]) -> str:
    """The docstring of a function, with the fields of the dataclass that are its options."""
    known = [*inspect.signature(function).parameters, *(f.name for f in fields(kind))]
    rows = "\n".join([OPTIONS % kind.__name__, *_described(kind, known)])
    return _joined({**_sections(complete(function).__doc__ or ""), "Other Parameters": rows})


def _sections(docstring: str) -> Dict[str, str]:
    """The sections of a docstring by title, "" for what is before the first."""
    first, *others = re.split(r"^(%s)\n---+\n" % SECTIONS, inspect.cleandoc(docstring), flags=re.M)
    head, arrows, rest = first.partition(">>>")
    return {"": head, "Examples": arrows + rest, **dict(zip(others[::2], others[1::2]))}


def _joined(sections: Dict[str, str]) -> str:
    titles = [title for title in SECTIONS.split("|") if sections.get(title)]
    texts = ["%s\n%s\n%s" % (title, "-" * len(title), sections[title].strip()) for title in titles]
    return "\n\n".join([sections[""].strip(), *texts])


def _attributes(kind: Type[Any]) -> Iterator[str]:
    """The lines that describe the fields of a class: the comments `#:` above or beside them. A package
    without its sources has none."""
    found: Dict[str, str] = {}
    for base in (base for base in reversed(kind.__mro__) if issubclass(base, Described)):
        source = vars(sys.modules[base.__module__])["__loader__"].get_source(base.__module__) or ""
        body = re.split(r"\n(?=\S)", source.partition("\nclass %s(" % base.__name__)[2])[0]
        types = vars(base).get("__annotations__", {})
        for above, name, beside in FIELD.findall(body):
            text = " ".join([*(line.strip(" #:") for line in above.splitlines()), beside]).strip()
            if text:
                head = "%s : %s\n    " % (name, type_name(types[name])) if name in types else name + "\n    "
                found[name] = head + textwrap.fill(text, WIDTH, subsequent_indent="    ")
    yield from found.values()


def _described(kind: Type[Any], known: Collection[str]) -> Iterator[str]:
    """The lines that describe options. known: names of all arguments, as Python has them."""

    def named(option: "re.Match[str]") -> str:
        name = option.group(1).replace("-", "_")
        return "`%s`" % name if name in known else option.group()

    for f in fields(kind):
        text = re.sub(r" \(%\(default\)\w\)", "", f.metadata["help"]) % {"default": f.default}
        text = re.sub(r"--([a-z][a-z-]*)", named, text)
        if f.default is True:
            text = text.replace("do not ", "", 1)  # the command line has its opposite
        if re.match("[a-z]+[ ,]", text):
            text = text[0].upper() + text[1:]
        default = "optional" if f.default in (None, ()) else "default %r" % (f.default,)
        yield "%s : %s, %s" % (f.name, _option_type(f), default)
        yield from textwrap.wrap(text + ".", WIDTH, initial_indent="    ", subsequent_indent="    ")


def _option_type(option: "Field[Any]") -> str:
    """The type of an option in words, with its choices or its range."""
    name = type_name(option.type)
    if "choices" in option.metadata:
        name = name.replace("str", "{%s}" % ", ".join(map(repr, option.metadata["choices"])))
    return name + " from %g to %g" % option.metadata["range"] if "range" in option.metadata else name


def type_name(kind: Any) -> str:
    """A type in words: "sequence of float", "Model or path"."""
    origin, parts = getattr(kind, "__origin__", None), getattr(kind, "__args__", ())
    if isinstance(kind, ForwardRef):
        return kind.__forward_arg__
    if kind is os.PathLike:
        return "path"
    if origin is None:
        return str(getattr(kind, "__name__", kind))
    of = [*dict.fromkeys(type_name(part) for part in parts if part is not type(None))]
    if origin is Union:
        return " or ".join(name for name in of if name != "str" or "path" not in of)
    name = str(origin.__name__).lower()
    return "%s of %s" % (name, *of) if len(of) == 1 and name != "callable" else name
