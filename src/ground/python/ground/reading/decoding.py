"""Decodes serialized messages of ROS 1 and 2 as columns.

Messages that differ in numbers only are rows of one NumPy array; nothing of a file becomes code.
"""

from typing import Any, Dict, Iterator, List, Sequence, Set, Tuple

import numpy as np

from ground.reading.containers import Column, Columns
from ground.support.annotations import Flags, Indices

NUMBERS = {
    "bool": "u1", "byte": "u1", "char": "u1", "octet": "u1", "int8": "i1", "uint8": "u1", "int16": "i2",
    "uint16": "u2", "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4",
    "float64": "f8",
}  # fmt: skip
TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
Node = Tuple[int, Any]  #: type of a field in rosbags: base (1), named (2), array (3), sequence (4)
Types = Dict[str, Tuple[object, Sequence[Tuple[str, Node]]]]  #: fields of types by name
MAX_ELEMENTS = 256  # elements of an array of numbers that have columns
MOST_FIELDS = 10000  # fields of a message; more are taken for damage
MOST_LAYOUTS = 64  # tried on all messages of a topic; further messages are laid out one by one
# Sizes of numbers that measurements have; of bytes that are no floating-point numbers, few are in between.
MIN_MAGNITUDE, MAX_MAGNITUDE = 1e-30, 1e30
RARE = 0.01  # share of values that may be odd


class Layouts:
    """Decodes serialized messages of a type by where its fields are."""

    def __init__(self, types: Types, kind: str, is_ros1: bool) -> None:
        self._types, self._kind, self._is_ros1 = types, kind, is_ros1
        self._odd: Dict[str, List[Indices]] = {}  # by path: how many values are odd, and how many there are

    def doubts(self) -> List[str]:
        """Fields whose values are none of their types, which tells that the definition is another one.
        Complete after columns()."""
        counts = {path: np.sum(parts, axis=0) for path, parts in self._odd.items()}
        return [path for path, (odd, count) in counts.items() if odd > max(1, RARE * count)]

    def columns(self, messages: Sequence[bytes], of_list: str) -> Tuple[List[Tuple[Indices, Columns]], int]:
        """Columns of messages that are alike, with the numbers of these messages, and how many messages do
        not fit the type. of_list: the field whose elements become rows instead of the messages."""
        found: List[Tuple[Indices, Columns]] = []
        sizes = np.array([len(message) for message in messages])
        lost = tried = 0
        for size in np.unique(sizes):
            left = np.flatnonzero(sizes == size)
            while len(left):
                self._start(messages[left[0]])
                tried += 1
                try:
                    self._add("", (2, self._kind))
                    self._finish()
                except (ValueError, LookupError, RecursionError):
                    left, lost = left[1:], lost + 1
                    continue
                some = left if tried < MOST_LAYOUTS else left[:1]
                rows = np.frombuffer(b"".join([messages[i] for i in some]), np.uint8)
                rows = rows.reshape(-1, size)
                alike = (rows[:, self._fixed] == rows[0, self._fixed]).all(axis=1)
                found.append((some[alike], self._columns(rows[alike])))
                left = np.concatenate([some[~alike], left[len(some) :]])
        if of_list:
            found = [part for at, columns in found for part in _elements(at, columns, of_list)]
        return found, lost

    def _start(self, data: bytes) -> None:
        self._data = data
        self._begin = 0 if self._is_ros1 else 4  # CDR has a header, from whose end numbers are aligned
        self._order = "<" if self._is_ros1 or data[1:2] != b"\0" else ">"
        self._at, self._count = self._begin, 0
        self._fixed: List[int] = []  # places of texts and lengths, which are the same in messages alike
        self._numbers: List[Tuple[str, str, int]] = []  # path, type, place
        self._texts: Dict[str, str] = {}
        self._flags: Set[str] = set()  # paths of those numbers that are true or false

    def _add(self, path: str, kind: Node) -> None:
        """Finds the numbers and texts of a field. ValueError or LookupError where the message does not fit
        it."""
        node, of = int(kind[0]), kind[1]
        self._count += 1
        if self._count > MOST_FIELDS:
            raise ValueError("too many fields")
        if node == 1 and of[0] in ("string", "wstring"):
            size = self._length()
            text = self._data[self._at : self._at + size]
            self._texts[path] = text.decode("utf-8", "replace").rstrip("\0")
            self._fix(size)
        elif node == 1:
            self._flags.update([path] if of[0] == "bool" else [])
            self._number(path, NUMBERS[of[0]])
        elif node == 2 and of in TIMES:
            self._number(path, "time")
        elif node == 2:
            fields = self._types[of][1] or ([] if self._is_ros1 else [("", (1, ("uint8", 0)))])
            for name, inner in fields:
                self._add("%s.%s" % (path, name) if path else name, inner)
        else:
            inner, fixed = of
            count = fixed if node == 3 else self._length()
            if int(inner[0]) == 1 and inner[1][0] in NUMBERS and count > MAX_ELEMENTS:
                form = NUMBERS[inner[1][0]]
                self._number(path, form)
                self._numbers.pop()
                self._at += (count - 1) * int(form[1])
                return
            for number in range(count):
                self._add("%s[%d]" % (path, number), inner)

    def _finish(self) -> None:
        """ValueError for a message that is longer or shorter than its fields."""
        after = len(self._data) - self._at
        if after < 0 or after > (0 if self._is_ros1 else 3):
            raise ValueError("the message has another length")

    def _number(self, path: str, form: str) -> None:
        size = 8 if form == "time" else int(form[1])
        if not self._is_ros1:
            self._at += -(self._at - self._begin) % (4 if form == "time" else size)
        self._numbers.append((path, form, self._at))
        self._at += size

    def _length(self) -> int:
        """The length that stands here."""
        if not self._is_ros1:
            self._at += -(self._at - self._begin) % 4
        order = "little" if self._order == "<" else "big"
        length = int.from_bytes(self._data[self._at : self._at + 4], order)  # type: ignore[arg-type]
        self._fix(4)
        if length > len(self._data):
            raise ValueError("an array or string is too long")
        return length

    def _fix(self, count: int) -> None:
        self._fixed += range(self._at, self._at + count)
        self._at += count
        if self._at > len(self._data):
            raise ValueError("the message is too short")

    def _columns(self, rows: Any) -> Columns:
        """Columns of messages that are laid out alike, (n, size) bytes."""
        found: Columns = {}
        for path, form, at in self._numbers:
            if form == "time":
                parts = rows[:, at : at + 8].copy().view(self._order + ("u4" if self._is_ros1 else "i4"))
                found[path] = parts[:, 0].astype(np.int64) * 10**9 + parts[:, 1]
                odd = (parts[:, 1] < 0) | (parts[:, 1] >= 10**9)
            else:
                found[path] = rows[:, at : at + int(form[1])].copy().view(self._order + form)[:, 0]
                odd = _odd(found[path], path in self._flags)
            self._odd.setdefault(path, []).append(np.array([odd.sum(), len(odd)]))
        for path, text in self._texts.items():
            found[path] = np.full(len(rows), text, object)
            wrong = len(rows) * any(c == "\ufffd" or (c < " " and not c.isspace()) for c in text)
            self._odd.setdefault(path, []).append(np.array([wrong, len(rows)]))
        return found


def _odd(values: Column, is_flag: bool) -> Flags:
    """Which values can hardly be of their type: numbers other than 0 and 1 for true and false, floating-point
    numbers of impossible size, and integers whose bytes are flags."""
    if is_flag:
        return np.asarray(values > 1)
    if values.dtype.kind == "f":
        size = np.abs(values)
        return np.asarray(np.isfinite(size) & (size > 0) & ((size < MIN_MAGNITUDE) | (size > MAX_MAGNITUDE)))
    if values.dtype.itemsize == 1:
        return np.zeros(len(values), bool)
    parts = np.ascontiguousarray(values).view(np.uint8).reshape(len(values), -1)
    return np.asarray((parts <= 1).all(axis=1) & (parts.sum(axis=1) > 1))


def _elements(at: Indices, columns: Columns, name: str) -> Iterator[Tuple[Indices, Columns]]:
    """Columns of messages with a list, as columns of its elements."""
    number = 0
    while True:
        start = "%s[%d]." % (name, number)
        inner = {path[len(start) :]: c for path, c in columns.items() if path.startswith(start)}
        if not inner:
            return
        yield at, inner
        number += 1
