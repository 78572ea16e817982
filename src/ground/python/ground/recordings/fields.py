"""Fields of messages and of the rows of tables, by their paths: "pose.position.x", "data[2]"."""

import re
from typing import Any, Callable, Dict, Iterable, Iterator, List, Mapping, Sequence, Tuple, Union

import numpy as np

from ground.annotations import Message
from ground.errors import GroundError

PATH = re.compile(r"[A-Za-z_]\w*(\[\d+\])*(\.[A-Za-z_]\w*(\[\d+\])*)*")
STEP = re.compile(r"([A-Za-z_]\w*)|\[(\d+)\]")
LONGEST_LIST = 16  # whose elements are named one by one

Values = Tuple[Any, ...]


class Row(Dict[str, Any]):
    """A row of a table: values by the names of its columns, or by what follows their headings."""

    short: Mapping[str, str] = {}  #: names of columns by their last parts

    def __missing__(self, key: str) -> Any:
        return self[self.short[key]]


def getter(paths: Sequence[str]) -> Callable[[Message], Values]:
    """Gives the values of fields of a message or of a Row; LookupError where one is missing."""
    steps = [_steps(path) for path in paths]

    def get(message: Message) -> Values:
        if isinstance(message, Row):
            return tuple(message[path] for path in paths)
        try:
            return tuple(_value(message, s) for s in steps)
        except AttributeError as error:
            raise LookupError(str(error))

    return get


def _steps(path: str) -> List[Union[str, int]]:
    """What leads to a field: names and numbers of elements."""
    return [name or int(number) for name, number in STEP.findall(path)]


def _value(message: Message, steps: Sequence[Union[str, int]]) -> Any:
    for step in steps:
        message = message[step] if isinstance(step, int) else getattr(message, step)
    return message


def numbers(message: Message, path: str = "") -> Iterator[Tuple[str, float]]:
    """Paths and values of all numbers in a message or a Row, without those of its header."""
    if isinstance(message, (bool, str, bytes)):
        return
    if isinstance(message, (int, float, np.number)):
        yield path, float(message)
    elif isinstance(message, Row):
        for name, value in message.items():
            yield from numbers(value, name)
    elif isinstance(message, (list, tuple, np.ndarray)):
        for number, inner in enumerate(list(message)[:LONGEST_LIST]):
            yield from numbers(inner, "%s[%d]" % (path, number))
    elif not hasattr(message, "to_sec"):
        for name in _names(message):
            if path or name != "header":
                inner = "%s.%s" % (path, name) if path else name
                yield from numbers(getattr(message, name), inner)


def _names(message: Message) -> Sequence[str]:
    """Names of a message's fields, however it was decoded."""
    names: Iterable[str] = getattr(message, "__slots__", None) or getattr(message, "__dict__", {})
    return [name for name in names if not name.startswith("_")]


def missing(where: str, topic: str, paths: Sequence[str], message: Message) -> GroundError:
    """The error for fields that a topic does not have."""
    there = [path for path, _ in numbers(message)]
    get = [path for path in paths if not _has(message, path)]
    return GroundError(
        "%s: %s has no field %s; its numbers are %s"
        % (where, topic, ", ".join(get), ", ".join(there) or "none")
    )


def _has(message: Message, path: str) -> bool:
    try:
        getter([path])(message)
    except (LookupError, TypeError):
        return False
    return True
