"""Files of recordings: what they hold is given as tables, one for each topic.

A table has a column for each number, text and time of a topic's messages, by its path ("pose.position.x",
"data[2]"). Bags of ROS 1 and 2 and MCAP files are opened by rosbags, whose grammar parses the definitions of
their types. Messages that differ in numbers only are rows of one NumPy array; nothing of a file becomes code.
The file is longer than 400 lines, because bags, tables and the decoder of messages share their columns.
"""

import contextlib
import csv
import importlib.util
import os
import pathlib
import shutil
import tempfile
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground.recordings import tables
from ground.support.annotations import Array, Indices
from ground.support.errors import GroundError, reason

if TYPE_CHECKING:
    import pandas

Column = Any  # (n,) array of numbers, times [ns] or texts
Columns = Dict[str, Column]

RECEIVED = "received"  #: column of the times of receipt [ns]
STAMP = "header.stamp"  #: column of the stamps of headers [ns]
TABLE = "table"  #: type of the "messages" of a CSV or Parquet file
MAGIC = b"#ROSBAG V"  #: first bytes of bags of ROS 1
NUMBERS = {
    "bool": "u1", "byte": "u1", "char": "u1", "octet": "u1", "int8": "i1", "uint8": "u1", "int16": "i2",
    "uint16": "u2", "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4",
    "float64": "f8",
}  # fmt: skip
TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
LISTS = {"tf2_msgs/TFMessage": "transforms", "tf/tfMessage": "transforms"}  #: types that are lists of rows
LONGEST = 256  # elements of an array of numbers that have columns
MOST_FIELDS = 10000  # fields of a message; more are taken for damage
MOST_LAYOUTS = 64  # tried on all messages of a topic; further messages are laid out one by one


@dataclass(frozen=True)
class Topic:
    """What is known of a topic."""

    kind: str  #: type of its messages as ROS 1 names it, "geometry_msgs/PoseStamped"
    count: int  #: number of its messages


class Container:
    """An open file, or several that belong together; use it in a with statement."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.warnings: List[str] = []  #: what is wrong with it, complete when its tables have been read
        self.topics: Dict[str, Topic] = {}  #: by name

    def table(self, topic: str) -> Columns:
        """The columns of a topic. GroundError when it cannot be read."""
        raise NotImplementedError

    def of_kind(self, kind: str) -> List[str]:
        """Topics with messages of a type, by name."""
        return sorted(t for t, e in self.topics.items() if e.kind == kind and e.count > 0)

    def rows(self, kind: str) -> Iterator[Dict[str, Any]]:
        """The messages of a type, by column."""
        for topic in self.of_kind(kind):
            columns = self.table(topic)
            names = list(columns)
            for values in zip(*(column.tolist() for column in columns.values())):
                yield dict(zip(names, values))

    def close(self) -> None:
        """Closes the file."""

    def __enter__(self) -> "Container":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Bag(Container):
    """A bag of ROS 1 or 2, or an MCAP file. Raises GroundError when it cannot be read.

    One of ROS 1 that was cut or never closed is read from a reindexed copy, where ROS is installed.
    """

    def __init__(self, path: str) -> None:
        super().__init__(path)
        self._files = contextlib.ExitStack()
        self.is_ros1 = _is_ros1(path)
        try:
            self._reader = self._open(path) if not self.is_ros1 else self._open_ros1(path)
        except Exception:
            self._files.close()
            raise
        kinds: Dict[str, Dict[str, int]] = {}
        for connection in self._reader.connections:
            of_topic = kinds.setdefault(connection.topic, {})
            kind = connection.msgtype.replace("/msg/", "/")
            of_topic[kind] = of_topic.get(kind, 0) + connection.msgcount
        for topic, counts in kinds.items():
            used = {kind for kind, count in counts.items() if count} or set(counts)
            self.topics[topic] = Topic(" and ".join(sorted(used)), sum(counts.values()))

    def _open(self, path: str) -> Any:
        """rosbags' reader of a file."""
        if importlib.util.find_spec("rosbags") is None:
            raise GroundError("%s: bags take the Python module rosbags: pip install rosbags" % path)
        try:
            if self.is_ros1:
                from rosbags.rosbag1 import Reader
            else:
                from rosbags.rosbag2 import Reader
            reader = Reader(pathlib.Path(path))
            reader.open()
        except Exception as error:  # rosbags, SQLite and their parsers raise many kinds
            raise GroundError("%s: cannot be read as a bag (%s)" % (self.path, _said(error)))
        self._files.callback(reader.close)
        return reader

    def _open_ros1(self, path: str) -> Any:
        """The reader of a bag of ROS 1, or of its reindexed copy."""
        try:
            return self._open(path)
        except GroundError as error:
            if importlib.util.find_spec("rosbags") is None or not _is_ros1(path, b"2.0\n"):
                raise
            failure = error
        if importlib.util.find_spec("rosbag") is None:
            raise GroundError(
                "%s: it was cut or never closed: rosbag reindex %s on a computer with ROS mends it"
                % (failure, path)
            )
        copy = os.path.join(self._files.enter_context(tempfile.TemporaryDirectory()), "run.bag")
        try:
            _reindexed(path, copy)
            reader = self._open(copy)
        except Exception:  # rosbag raises many kinds on files that are no bags
            raise GroundError("%s, and rosbag reindex does not mend it" % failure)
        if not reader.connections:
            raise GroundError("%s: it holds no messages, also after rosbag reindex" % path)
        self.warnings.append("the bag is damaged or was not closed: read after rosbag reindex")
        return reader

    def table(self, topic: str) -> Columns:
        """See Container."""
        parts = []
        for kind in sorted({c.msgtype for c in self._reader.connections if c.topic == topic}):
            connections = [c for c in self._reader.connections if c.topic == topic and c.msgtype == kind]
            received, messages = self._messages(connections)
            if not messages:
                continue
            layouts = _Layouts(_types(connections[0], self.is_ros1), kind, self.is_ros1)
            found, lost = layouts.columns(messages, LISTS.get(kind.replace("/msg/", "/"), ""))
            if lost:
                self.warnings.append(
                    "the bag is damaged: messages on %s that do not fit their type were left out (%d)"
                    % (topic, lost)
                )
            parts += [{RECEIVED: received[at], **columns} for at, columns in found]
        return _joined(parts)

    def _messages(self, connections: Sequence[Any]) -> Tuple[Indices, List[bytes]]:
        """Times of receipt [ns] and contents of messages, as far as they can be read."""
        received, found = [], []
        try:
            for _, time, data in self._reader.messages(connections=connections):
                received.append(time)
                found.append(bytes(data))
        except Exception as error:  # the file ends early, or a chunk is damaged
            warning = "the bag is damaged: read as far as it goes (%s)" % _said(error)
            if warning not in self.warnings:
                self.warnings.append(warning)
        return np.array(received, np.int64), found

    def close(self) -> None:
        """See Container."""
        self._files.close()


def _is_ros1(path: str, version: bytes = b"") -> bool:
    magic = MAGIC + version
    if not os.path.isfile(path):
        return False
    with open(path, "rb") as file:
        return file.read(len(magic)) == magic


def _said(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__


def _reindexed(path: str, copy: str) -> None:
    """Copies a bag of ROS 1 and writes its index anew."""
    import rosbag

    shutil.copyfile(path, copy)
    with rosbag.Bag(copy, "a", allow_unindexed=True) as bag:
        for _ in bag.reindex():
            pass


def _types(connection: Any, is_ros1: bool) -> Mapping[str, Any]:
    """Descriptions of types by name: those that the file defines, and the usual ones. GroundError for a
    definition that is none."""
    from rosbags.typesys import get_types_from_idl, get_types_from_msg
    from rosbags.typesys.stores import ros1_noetic, ros2_humble

    text, is_idl = connection.msgdef, False
    if not isinstance(text, str):  # since rosbags 0.10
        text, is_idl = text.data, text.format.name == "IDL"
    line = "=" * 80 + "\n"
    found = dict(ros1_noetic.FIELDDEFS if is_ros1 else ros2_humble.FIELDDEFS)
    found.update((name, of) for name, of in ros2_humble.FIELDDEFS.items() if name in TIMES)
    try:
        if text.startswith(line + "IDL: "):
            for part in text.split(line)[1:]:
                found.update(get_types_from_idl(part.split("\n", 1)[1]))
        elif text:
            msgtype = connection.msgtype
            found.update(get_types_from_idl(text) if is_idl else get_types_from_msg(text, msgtype))
    except Exception as error:  # rosbags' parsers raise many kinds
        raise GroundError(
            "%s: the definition of %s in the file is damaged (%s)"
            % (connection.topic, connection.msgtype, _said(error))
        )
    if connection.msgtype not in found:
        text = "%s has messages of type %s, which the file does not define"
        raise GroundError(text % (connection.topic, connection.msgtype))
    return found


class _Layouts:
    """Decodes serialized messages of a type by where its fields are."""

    def __init__(self, types: Mapping[str, Any], kind: str, is_ros1: bool) -> None:
        self._types, self._kind, self._is_ros1 = types, kind, is_ros1

    def columns(self, messages: Sequence[bytes], of_list: str) -> Tuple[List[Tuple[Indices, Columns]], int]:
        """Columns of messages that are alike, with the numbers of these messages, and how many messages do
        not fit the type. of_list: the field whose elements become rows in place of the messages."""
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

    def _add(self, path: str, kind: Tuple[int, Any]) -> None:
        """Finds the numbers and texts of a field. ValueError or LookupError where the message does not fit
        it. kind: as rosbags describes it: base (1), named (2), array (3) or sequence (4)."""
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
            if int(inner[0]) == 1 and inner[1][0] in NUMBERS and count > LONGEST:
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
            raise ValueError("an array or a text is too long")
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
            else:
                found[path] = rows[:, at : at + int(form[1])].copy().view(self._order + form)[:, 0]
        for path, text in self._texts.items():
            found[path] = np.full(len(rows), text, object)
        return found


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


def _joined(parts: Sequence[Columns]) -> Columns:
    """Columns of all parts in the order of receipt; a number that a part lacks is NaN, a text is empty."""
    if len(parts) == 1:
        return parts[0]
    found: Columns = {}
    for name in dict.fromkeys(name for part in parts for name in part):
        like = next(part[name] for part in parts if name in part)
        missing = "" if like.dtype == object else np.nan
        found[name] = np.concatenate(
            [p[name] if name in p else np.full(len(p[RECEIVED]), missing) for p in parts]
        )
    if parts:
        order = np.argsort(found[RECEIVED], kind="stable")
        found = {name: column[order] for name, column in found.items()}
    return found


class TableColumns(Dict[str, Any]):
    """The columns of a table, with what else its file says."""

    def __init__(self, table: "tables.Table", rows: slice) -> None:
        super().__init__((str(n), table.frame[n].to_numpy()[rows]) for n in table.frame.columns)
        self.units, self.empty = table.units, table.empty
        self._table, self._rows = table, rows

    def text(self, name: str) -> Column:
        """The cells of a column as they are written; None where the file has no texts."""
        texts = self._table.text(name)
        return None if texts is None else texts[self._rows]


class Tables(Container):
    """Text tables and Parquet files: each is a topic, each row a message. rows: the first and the last one
    that are read, from 1. Raises GroundError when one cannot be read."""

    def __init__(self, paths: Sequence[str], rows: Tuple[int, ...] = ()) -> None:
        super().__init__(paths[0] if paths else "")
        self._rows = slice(rows[0] - 1, rows[1]) if rows else slice(None)
        self._tables = {os.path.basename(path): _table(path) for path in paths}
        self.topics = {n: Topic(TABLE, len(t.frame[self._rows])) for n, t in self._tables.items()}
        for name, table in self._tables.items():
            self.warnings += ["%s: %s" % (name, n) if len(paths) > 1 else n for n in table.notes]

    def table(self, topic: str) -> Columns:
        """See Container."""
        return TableColumns(self._tables[topic], self._rows)


def _table(path: str) -> tables.Table:
    """The table in a file. GroundError when it cannot be read."""
    import pandas

    plain = path.lower()[: -len(".gz")] if path.lower().endswith(".gz") else path.lower()
    read = next((READERS[suffix] for suffix in READERS if plain.endswith(suffix)), None)
    try:
        return tables.Table(read(path), {}, []) if read else tables.read(path)
    except OSError as error:
        raise GroundError("%s: %s" % (path, reason(error)))
    except GroundError as error:
        raise error if str(error).startswith(path) else GroundError("%s: %s" % (path, error))
    except (ValueError, csv.Error, pandas.errors.ParserError, pandas.errors.EmptyDataError) as error:
        raise GroundError("%s: cannot be read as a table (%s)" % (path, str(error).splitlines()[0]))


def _parquet(path: str) -> "pandas.DataFrame":
    import pandas

    if not any(importlib.util.find_spec(name) for name in ("pyarrow", "fastparquet")):
        raise GroundError("%s: Parquet takes the Python module pyarrow: pip install pyarrow" % path)
    return pandas.read_parquet(path)


READERS = {".parquet": _parquet}  #: of tables that are not text, by the end of their names
#: of tables; the further ones are tables in a folder that has none of the first
SUFFIXES = (*READERS, ".csv", ".tsv", ".csv.gz", ".tsv.gz")
FURTHER = (".txt", ".dat", ".log", ".asc", ".tab", ".tum", ".txt.gz", ".dat.gz")


def seconds(nanoseconds: Indices) -> Array:
    """Times [s] of times [ns], to the digit as genpy.Time.to_sec() gives them."""
    return np.asarray(nanoseconds // 10**9 + (nanoseconds % 10**9) / 1e9)


def column(columns: Columns, path: str) -> Optional[Column]:
    """The column of a field; one that a heading groups is also found by its own name where that is there
    once. None where it is missing."""
    if path in columns:
        return columns[path]
    ends = [name for name in columns if name.endswith("." + path)]
    return columns[ends[0]] if len(ends) == 1 else None


def _absent(columns: Columns, path: str) -> str:
    """Why there is no column of a field, where that is known."""
    same = [name for name in columns if name.startswith(path + "#")]
    if same:
        return " (%d columns are named so: write %s)" % (len(same), " or ".join(same))
    ends = [name for name in columns if name.endswith("." + path)]
    if len(ends) > 1:
        return " (there are several: write %s)" % " or ".join(ends[:4])
    elements = [name for name in columns if name.startswith(path + "[")]
    if elements:
        return " (it is a list: write %s to %s)" % (elements[0], elements[-1])
    return " (that column has no values)" * (path in getattr(columns, "empty", ()))


def numbers(columns: Columns) -> List[str]:
    """Names of the columns that are numbers, without those of the header and the receipt."""
    return [
        name
        for name, values in columns.items()
        if values.dtype.kind in "biuf" and name != RECEIVED and not name.startswith("header.")
    ]


def no_field(columns: Columns, missing: Sequence[str], where: str) -> GroundError:
    """The error of fields that are missing, with those that are there."""
    named = ", ".join(path + _absent(columns, path) for path in missing)
    there = ", ".join(numbers(columns)) or "none"
    return GroundError("%s: a message has no field %s; its numbers are %s" % (where, named, there))


def values(columns: Columns, paths: Sequence[str], where: str) -> Any:
    """The numbers of fields (n, k); text becomes NaN. GroundError for fields that are missing."""
    found = [column(columns, path) for path in paths]
    missing = [path for path, one in zip(paths, found) if one is None]
    if missing:
        raise no_field(columns, missing, where)
    there = [one for one in found if one is not None]
    read = [_number(one) for one in there]
    for path, one, given in zip(paths, read, there):
        texts = [text for text in given if text and isinstance(text, str)] if given.dtype == object else []
        if texts and np.isnan(one).all():
            raise GroundError(
                "%s: field %s has no numbers, but text such as '%s'" % (where, path, texts[0][:40])
            )
    return np.column_stack(read) if read else np.empty((0, 0))


def _number(given: Column) -> Any:
    if given.dtype.kind in "biuf":
        return given.astype(float)
    import pandas

    return pandas.to_numeric(pandas.Series(given), errors="coerce").to_numpy(float)
