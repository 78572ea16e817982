"""Definitions of message types that files contain, and decoders that follow them.

A definition is data from elsewhere. It is parsed by a grammar, and messages are decoded by closures that
follow the parsed types: no text of a file becomes code.
"""

import hashlib
import re
import struct
from types import SimpleNamespace
from typing import Any, Callable, Dict, List, Optional, Set, Tuple

import numpy as np

from ground.annotations import Message
from ground.recordings import codecs
from ground.recordings.codecs.with_rosbags import Time

SEPARATOR = "=" * 80  # line between the definitions of a type and of those that it contains
TYPE = re.compile(r"[A-Za-z]\w*/[A-Za-z]\w*", re.ASCII)
LINE = re.compile(
    r"(?P<type>[A-Za-z]\w*(/[A-Za-z]\w*)?)(?P<array>\[\d*\])?\s+(?P<name>[A-Za-z]\w*)"
    r"\s*(?P<value>=.*)?",
    re.ASCII,
)
ARRAY = re.compile(r"(.+)\[(\d*)\]")
NUMBERS = {
    "int8": "b", "uint8": "B", "char": "B", "byte": "b", "int16": "h", "uint16": "H", "int32": "i",
    "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d", "bool": "?",
}  # fmt: skip
NUMBERS_OF_ROS2 = {**NUMBERS, "byte": "B"}
TIMES = {"time": "II", "duration": "ii"}
TIMES_OF_ROS2 = {"time": "iI", "duration": "iI"}
BASIC = {*NUMBERS, *TIMES, "string"}
HEADER = 4  # size of what precedes a message of ROS 2 [bytes]
FILLER = "structure_needs_at_least_one_member"  # the only field of a message of ROS 2 without any

Types = Dict[str, List[Tuple[str, str]]]  # names and types of the fields of each type
Read = Callable[[bytes, int], Tuple[Any, int]]  # takes a place; returns a value and where it ends


def kind(name: str, definition: str) -> codecs.Kind:
    """The Kind of a type of ROS 1 by its definition. Raises ValueError when the definition is wrong."""
    types, md5sum = parsed(name, definition)
    read = _Readers(types.get).of(name)

    def decode(data: bytes) -> Message:
        message, end = read(data, 0)
        if end != len(data):
            raise ValueError("%d bytes follow a message" % (len(data) - end))
        return message

    return codecs.Kind(md5sum, decode, types.get)


def ros2_decoder(name: str, fields: codecs.Fields) -> codecs.Decode:
    """Decodes messages of ROS 2 (CDR) of a type. Raises ValueError for types that are not known."""
    read = {order: _Readers(fields, order, ros2=True).of(name) for order in "<>"}

    def decode(data: bytes) -> Message:
        if len(data) < HEADER or data[0] != 0 or data[1] > 1:
            raise ValueError("the message is not in plain CDR")
        return read["<" if data[1] else ">"](bytes(data[HEADER:]), 0)[0]

    return decode


def parsed(name: str, definition: str) -> Tuple[Types, str]:
    """The fields of a type of ROS 1 and of those that it contains, and its MD5 sum. Raises ValueError."""
    if not TYPE.fullmatch(name):
        raise ValueError("%r is not the name of a type" % name)
    types: Types = {name: []}
    constants: Dict[str, List[str]] = {name: []}
    current, begins = name, False
    for line in map(str.strip, definition.split("\n")):
        if line == SEPARATOR:
            begins = True
        elif begins and line:
            current, begins = line[len("MSG:") :].strip(), False
            if not line.startswith("MSG:") or not TYPE.fullmatch(current):
                raise ValueError("%r is not the name of a type" % line)
            types[current], constants[current] = [], []
        elif line and not line.startswith("#"):
            _take_line(line, current, types[current], constants[current])
    return types, _md5sum(name, types, constants, {})


def _take_line(line: str, owner: str, fields: List[Tuple[str, str]], constants: List[str]) -> None:
    """Adds the field or the constant of a line."""
    text = "string" == line.split(None, 1)[0] and "=" in line.split("#")[0]
    found = LINE.fullmatch(line if text else line.split("#")[0].strip())
    if not found:
        raise ValueError("%r is not a field" % line)
    inner, array, name, value = (found.group(g) for g in ("type", "array", "name", "value"))
    if value is not None:
        if array or inner not in (*NUMBERS, "string"):
            raise ValueError("%r is not a constant" % line)
        constants.append("%s %s=%s" % (inner, name, value[1:].strip()))
        return
    if name in dict(fields):
        raise ValueError("two fields are named %s" % name)
    if inner == "Header":
        inner = "std_msgs/Header"
    elif inner not in BASIC and "/" not in inner:
        inner = "%s/%s" % (owner.split("/")[0], inner)
    fields.append((name, inner + (array or "")))


def _md5sum(
    name: str, types: Types, constants: Dict[str, List[str]], known: Dict[str, Optional[str]]
) -> str:
    """The sum that ROS 1 tells versions of a type by; known: sums that were computed, and None for types
    that are being computed."""
    if name not in types or known.get(name, "") is None:
        raise ValueError("the type %s is not defined, or contains itself" % name)
    if name not in known:
        known[name] = None
        lines = list(constants[name])
        for field, inner in types[name]:
            bare = inner.split("[")[0]
            shown = inner if bare in BASIC else _md5sum(bare, types, constants, known)
            lines.append("%s %s" % (shown, field))
        known[name] = hashlib.md5("\n".join(lines).encode()).hexdigest()
    return known[name] or ""


class _Readers:
    """Makes what reads values of types. A value that takes no bytes is made once, so that the time to
    read a message is limited by its size."""

    def __init__(self, fields: codecs.Fields, order: str = "<", ros2: bool = False) -> None:
        self._fields = fields
        self._order = order
        self._ros2 = ros2  # numbers are aligned, and texts end in a zero
        self._forms = NUMBERS_OF_ROS2 if ros2 else NUMBERS
        self._times = TIMES_OF_ROS2 if ros2 else TIMES
        self._length = self._number("I")
        self._made: Dict[str, Optional[Read]] = {}  # None: is being made
        self._empty: Set[str] = set()  # types whose values take no bytes

    def of(self, kind: str) -> Read:
        """Reads values of a type. Raises ValueError."""
        if kind not in self._made:
            self._made[kind] = None
            self._made[kind] = self._new(kind)
        made = self._made[kind]
        if made is None:
            raise ValueError("the type %s contains itself" % kind)
        return made

    def _new(self, kind: str) -> Read:
        array = ARRAY.fullmatch(kind)
        if array:
            return self._array(array.group(1), array.group(2))
        if kind in self._forms:
            return self._number(self._forms[kind])
        if kind in self._times:
            return self._time(kind)
        return self._text() if kind == "string" else self._message(kind)

    def _number(self, form: str) -> Read:
        number = struct.Struct(self._order + form)
        unpack, size = number.unpack_from, number.size
        step = size if self._ros2 else 1

        def read(data: bytes, at: int) -> Tuple[Any, int]:
            at += -at % step
            return unpack(data, at)[0], at + size

        return read

    def _time(self, kind: str) -> Read:
        unpack = struct.Struct(self._order + self._times[kind]).unpack_from
        step = 4 if self._ros2 else 1
        new: Callable[..., Any] = Time
        if kind == "time" and not self._ros2:
            new = codecs.installed().Time

        def read(data: bytes, at: int) -> Tuple[Any, int]:
            at += -at % step
            return new(*unpack(data, at)), at + 8

        return read

    def _text(self) -> Read:
        length, zero = self._length, int(self._ros2)

        def read(data: bytes, at: int) -> Tuple[Any, int]:
            size, at = length(data, at)
            end = at + size
            if end > len(data):
                raise ValueError("a text is too long")
            return data[at : max(at, end - zero)].decode("utf-8", "replace"), end

        return read

    def _array(self, kind: str, fixed: str) -> Read:
        """Reads arrays of a fixed number of elements, or of one that precedes them."""
        form, length, most = self._forms.get(kind), self._length, int(fixed or 0)
        inner = self._numbers(form) if form else self._list(self.of(kind))
        if kind in self._empty or fixed and not most:
            raise ValueError("an array without elements")

        def read(data: bytes, at: int) -> Tuple[Any, int]:
            count, at = (most, at) if fixed else length(data, at)
            if count > len(data) - at:
                raise ValueError("an array is too long")
            return inner(data, at, count)

        return read

    def _numbers(self, form: str) -> Callable[[bytes, int, int], Tuple[Any, int]]:
        dtype = np.dtype(self._order + form)
        size = dtype.itemsize
        step = size if self._ros2 else 1

        def read(data: bytes, at: int, count: int) -> Tuple[Any, int]:
            if not count:
                return np.empty(0, dtype), at
            at += -at % step
            return np.frombuffer(data, dtype, count, at), at + count * size

        return read

    def _list(self, element: Read) -> Callable[[bytes, int, int], Tuple[Any, int]]:
        def read(data: bytes, at: int, count: int) -> Tuple[Any, int]:
            found = []
            for _ in range(count):
                value, at = element(data, at)
                found.append(value)
            return found, at

        return read

    def _message(self, kind: str) -> Read:
        fields = self._fields(kind)
        if fields is None:
            raise ValueError("the type %s is not known" % kind)
        if not fields and self._ros2:
            fields = [(FILLER, "uint8")]
        parts = [(name, self.of(inner)) for name, inner in fields]

        def read(data: bytes, at: int) -> Tuple[Any, int]:
            values = {}
            for name, inner in parts:
                values[name], at = inner(data, at)
            return SimpleNamespace(**values), at

        if any(inner not in self._empty for _, inner in fields):
            return read
        self._empty.add(kind)
        empty = read(b"", 0)[0]
        return lambda data, at: (empty, at)
