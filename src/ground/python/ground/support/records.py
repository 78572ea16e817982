"""Dataclasses as plain values, as JSON and MATLAB have them, and back by the types of their fields."""

import dataclasses
import math
import typing
from typing import Any, Dict, Mapping, Optional, Type, TypeVar, Union

from ground.support.errors import GroundError

T = TypeVar("T")
# Keys of a field's metadata. ABSENT: value with which its key is left out; NULL: what null stands for, a
# number that is not finite or a pair of them (else not a number).
ABSENT, NULL = "absent", "null"


def plain(value: Any) -> Any:
    """A value with dictionaries instead of dataclasses, and lists instead of tuples."""
    if dataclasses.is_dataclass(value):
        items = [(one, getattr(value, one.name)) for one in dataclasses.fields(value)]
        return {
            one.name: plain(item)
            for one, item in items
            if not (ABSENT in one.metadata and item == one.metadata[ABSENT])
        }
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, (list, tuple)) else value


def read(kind: Type[T], value: object, where: str) -> T:
    """A dataclass from its plain value; other keys are ignored. where: its name in messages. GroundError
    where a key is missing or its value is not of its type."""
    found: T = _read(kind, value, where)
    return found


def _read(kind: Any, value: Any, where: str) -> Any:
    """A value of a type."""
    outer, inner = typing.get_origin(kind), typing.get_args(kind)
    if outer is Union:  # Optional
        return None if value is None else _read(inner[0], value, where)
    if dataclasses.is_dataclass(kind) and isinstance(value, dict):
        types = typing.get_type_hints(kind)
        found = {one.name: _field(one, types[one.name], value, where) for one in dataclasses.fields(kind)}
        return kind(**found)
    if outer is dict and isinstance(value, dict):
        return {key: _read(inner[1], item, "%s.%s" % (where, key)) for key, item in value.items()}
    if outer in (list, tuple) and isinstance(value, (list, tuple)):
        items = [_read(inner[0], item, "%s[%d]" % (where, i)) for i, item in enumerate(value)]
        if outer is list or inner[-1] is Ellipsis or len(items) == len(inner):
            return outer(items)
    if kind is float and value is None:
        return math.nan
    if kind in (bool, int, float, str) and isinstance(value, (int, float) if kind is float else kind):
        return value
    raise GroundError("%s: %.40r is not a value of this key" % (where, value))


def _field(one: "dataclasses.Field[Any]", kind: Any, values: Dict[str, Any], where: str) -> Any:
    """The value of a field."""
    place = "%s.%s" % (where, one.name)
    if one.name not in values:
        if ABSENT in one.metadata:
            return one.metadata[ABSENT]
        if one.default is not dataclasses.MISSING:
            return one.default
        if type(None) in typing.get_args(kind):
            return None
        raise GroundError("%s: missing" % place)
    return _read(kind, _filled(values[one.name], one.metadata.get(NULL)), place)


def _filled(value: Any, null: Optional[Any]) -> Any:
    """A value with what null stands for instead of None."""
    if isinstance(null, tuple) and isinstance(value, list):
        return [_filled(item, end) for item, end in zip(value, null)]
    return null if value is None else value
