"""Messages of a topic as columns, which are decoded at once where all have the same layout.

The layout of a message follows from its type and the lengths of its strings and arrays. Messages of one
type that agree in these lengths are rows of one NumPy table. Where anything is unusual, there is no batch,
and the messages are decoded one by one.
"""

from dataclasses import dataclass
from typing import Any, List, Optional, Sequence, Tuple

import numpy as np

from ground.annotations import Array, Indices, Message
from ground.recordings import codecs, definitions

NUMBERS = {
    "int8": "i1", "uint8": "u1", "char": "u1", "int16": "<i2", "uint16": "<u2", "int32": "<i4",
    "uint32": "<u4", "int64": "<i8", "uint64": "<u8", "float32": "<f4", "float64": "<f8",
}  # fmt: skip
LONGEST = 64  # elements of an array whose messages are laid out
MOST_FIELDS = 10000  # largest number of fields of a message that is decoded in batches
MOST_GROUPS = 16  # layouts of a topic's messages
STAMP = "header.stamp"
SECONDS, NANOSECONDS = "/s", "/ns"  # ends of the names of a time's columns; no path has them


@dataclass(frozen=True)
class Group:
    """Messages that differ in numbers only."""

    at: Indices  #: (n,) their places among the topic's messages
    sample: Message  #: the first one
    table: Any  #: (n,) structured array, a column for each number by its path

    def has(self, paths: Sequence[str]) -> bool:
        """Whether there are columns for paths."""
        return set(paths) <= set(self.table.dtype.names)


@dataclass(frozen=True)
class Batch:
    """All messages of a topic, in the order of receipt."""

    received_ns: Indices  #: (n,) times of receipt [ns]
    groups: Tuple[Group, ...]

    @property
    def received(self) -> Array:
        """Times of receipt (n,) [s]."""
        return in_seconds(self.received_ns // 10**9, self.received_ns % 10**9)

    def stamps(self) -> Optional[Tuple[Array, Indices]]:
        """Stamps of the headers in seconds and in nanoseconds; None without headers."""
        names = [STAMP + SECONDS, STAMP + NANOSECONDS]
        if not all(group.has(names) for group in self.groups):
            return None
        seconds, rest = np.empty((2, len(self.received_ns)), np.int64)
        for group in self.groups:
            seconds[group.at], rest[group.at] = (group.table[name] for name in names)
        return in_seconds(seconds, rest), seconds * 10**9 + rest

    def values(self, paths: Sequence[str]) -> Optional[Array]:
        """The numbers at paths (n, k) of all messages; None where one is missing."""
        found = np.empty((len(self.received_ns), len(paths)))
        for group in self.groups:
            if not group.has(paths):
                return None
            for column, path in enumerate(paths):
                found[group.at, column] = group.table[path]
        return found


def in_seconds(seconds: Indices, nanoseconds: Indices) -> Array:
    """Times as genpy.Time.to_sec() gives them."""
    return np.asarray(seconds.astype(float) + nanoseconds.astype(float) / 1e9)


def gathered(
    name: str, kind: codecs.Kind, received: Indices, messages: Sequence[bytes]
) -> Optional[Batch]:
    """The Batch of serialized messages of a type and its name, received at some times (n,) [ns]; None
    where they have to be decoded one by one."""
    sizes, which = np.unique([len(message) for message in messages], return_inverse=True)
    if not 0 < len(sizes) <= MOST_GROUPS:
        return None
    groups = []
    for number in range(len(sizes)):
        at = np.flatnonzero(which == number)
        group = _group(name, kind, at, [messages[i] for i in at])
        if group is None:
            return None
        groups.append(group)
    groups.sort(key=lambda group: int(group.at[0]))
    return Batch(received, tuple(groups))


def _group(
    name: str, kind: codecs.Kind, at: Indices, messages: Sequence[bytes]
) -> Optional[Group]:
    size, first = len(messages[0]), messages[0]
    layout = _Layout(kind.fields, first)
    try:
        sample = kind.decode(first)
        layout.add("", name)
    except Exception:  # decoders may raise anything
        return None
    if layout.size != size:
        return None
    joined = b"".join(messages)
    same = np.array(layout.same, int)
    every = np.frombuffer(joined, np.uint8).reshape(-1, size)
    if not (every[:, same] == every[0, same]).all():
        return None
    return Group(at, sample, np.frombuffer(joined, layout.dtype()))


class _Layout:
    """Places of the numbers in a message and in those like it."""

    def __init__(self, fields: codecs.Fields, data: bytes) -> None:
        self._fields = fields
        self._data = data
        self._names: List[str] = []
        self._formats: List[str] = []
        self._offsets: List[int] = []
        self.same: List[int] = []  # places of strings and of lengths, which are the same in all messages
        self.size = 0
        self._count = 0  # number of fields

    def add(self, path: str, kind: str) -> None:
        """Adds a field. Raises LookupError for types without a layout."""
        self._count += 1
        if self._count > MOST_FIELDS:
            raise LookupError("the message has too many fields")
        array = definitions.ARRAY.fullmatch(kind)
        if kind in NUMBERS:
            self._number(path, NUMBERS[kind])
        elif kind in ("time", "duration"):
            for name in (SECONDS, NANOSECONDS):
                self._number(path + name, "<u4" if kind == "time" else "<i4")
        elif kind == "string":
            self._fixed(self._length())
        elif kind == "bool":
            self.size += 1  # not a number: any byte but 0 is true
        elif array:
            self._array(path, array.group(1), array.group(2))
        else:
            fields = self._fields(kind)
            if fields is None:
                raise LookupError("the type %s is not known" % kind)
            for name, inner in fields:
                self.add("%s.%s" % (path, name) if path else name, inner)

    def dtype(self) -> "np.dtype[Any]":
        """The type of a table of such messages."""
        return np.dtype(
            {
                "names": self._names,
                "formats": self._formats,
                "offsets": self._offsets,
                "itemsize": self.size,
            }
        )

    def _number(self, path: str, form: str) -> None:
        self._names.append(path)
        self._formats.append(form)
        self._offsets.append(self.size)
        self.size += np.dtype(form).itemsize

    def _array(self, path: str, kind: str, count: str) -> None:
        length = int(count) if count else self._length()
        if length > LONGEST:
            raise LookupError("%s has %d elements" % (path, length))
        for number in range(length):
            self.add("%s[%d]" % (path, number), kind)

    def _length(self) -> int:
        """The length that stands here."""
        length = int.from_bytes(self._data[self.size : self.size + 4], "little")
        self._fixed(4)
        return length

    def _fixed(self, count: int) -> None:
        if self.size + count > len(self._data):
            raise LookupError("the message is too short")
        self.same += range(self.size, self.size + count)
        self.size += count
