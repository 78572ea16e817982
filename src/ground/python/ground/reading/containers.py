"""Files of recordings: what they hold is given as tables, one for each topic.

A table has a column for each number, text and time of a topic's messages, by its path ("pose.position.x",
"data[2]").
"""

import csv
import importlib.util
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Dict, Iterator, List, Optional, Sequence, Tuple

import numpy as np

from ground.support.annotations import Array, Indices
from ground.support.errors import GroundError, reason

if TYPE_CHECKING:
    import pandas

    from ground.reading import tables

Column = Any  # (n,) array of numbers, times [ns] or texts
Columns = Dict[str, Column]

RECEIVED = "received"  #: column of the times of receipt [ns]
STAMP = "header.stamp"  #: column of the stamps of headers [ns]
TABLE = "table"  #: type of the "messages" of a CSV or Parquet file


@dataclass(frozen=True)
class Topic:
    """What is known of a topic."""

    kind: str  #: type of its messages as ROS 1 names it, "geometry_msgs/PoseStamped"
    count: int  #: number of its messages
    undefined: bool = False  #: whether the file does not hold the definition of its type


class Container:
    """An open file, or several that belong together; use it in a with statement."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.warnings: List[str] = []  #: what is wrong with it, complete when its tables have been read
        self.topics: Dict[str, Topic] = {}  #: by name
        self.namespace = ""  #: namespace of the only craft whose topics are left; empty: none

    def table(self, topic: str) -> Columns:
        """The columns of a topic. GroundError when it cannot be read."""
        raise NotImplementedError

    def of_kind(self, kind: str) -> List[str]:
        """Topics with messages of a type, by name."""
        return sorted(t for t, e in self.topics.items() if e.kind == kind and e.count > 0)

    def choose(self, namespace: str, commands: str = "") -> None:
        """Leaves out the topics of other crafts. namespace: of the craft's topics; commands: the topic of its
        commands; each may be empty. GroundError if it is not known which craft to take."""
        ends = [topic.rpartition("/") for topic in self.of_kind("ground_msgs/Controls")]
        crafts = {place.strip("/"): place + "/" for place, _, end in ends if end in ("controls", "sent")}
        only = next(iter(crafts), "") if len(crafts) == 1 else ""
        chosen = (namespace or commands.rpartition("/")[0] or only).strip("/")
        if chosen not in crafts and (namespace or len(crafts) > 1 and not commands):
            names = ", ".join(name or "/" for name in sorted(crafts)) or "none"
            raise GroundError("%s: choose one of its craft with --namespace: %s" % (self.path, names))
        if crafts.pop(chosen, None):
            self.namespace = chosen
            others = tuple(place for name, place in crafts.items() if name)
            own = "/%s/" % chosen if chosen else None
            self.topics = {
                name: one
                for name, one in self.topics.items()
                if own and name.startswith(own) or not name.startswith(others)
            }

    def place_of(self, topic: str) -> str:
        """A topic as messages name it: with its file, of which a table may be the only topic."""
        return self.path if topic == os.path.basename(self.path) else "%s: %s" % (self.path, topic)

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


def _table(path: str) -> "tables.Table":
    """The table in a file. GroundError when it cannot be read."""
    import pandas

    from ground.reading import tables  # pandas is slow to load, and bags need no tables

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
        raise GroundError("%s: Parquet needs the Python module pyarrow: pip install pyarrow" % path)
    return pandas.read_parquet(path)


READERS = {".parquet": _parquet}  #: of tables that are not text, by the end of their names
#: of tables; the further ones are tables in a folder that has none of the first
SUFFIXES = (*READERS, ".csv", ".tsv", ".csv.gz", ".tsv.gz")
FURTHER = (".txt", ".dat", ".log", ".asc", ".tab", ".tum", ".lvm", ".txt.gz", ".dat.gz")


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


def unit(columns: Columns, path: str) -> str:
    """The unit that a table gives a column; empty without one."""
    return str(getattr(columns, "units", {}).get(path, ""))


def _absent(columns: Columns, path: str) -> str:
    """Why there is no column of a field, where that is known."""
    same = [name for name in columns if name.startswith(path + "#")]
    if same:
        return " (%d columns have this name: write %s)" % (len(same), " or ".join(same))
    ends = [name for name in columns if name.endswith("." + path)]
    if len(ends) > 1:
        return " (there are several: write %s)" % " or ".join(ends[:4])
    elements = [name for name in columns if name.startswith(path + "[")]
    if elements:
        return " (it is a list: write %s to %s)" % (elements[0], elements[-1])
    return " (that column has no values)" * (path in getattr(columns, "empty", ()))


def numbers(columns: Columns) -> List[str]:
    """Names of the columns of numbers, without the columns of the header and the receipt."""
    return [
        name
        for name, values in columns.items()
        if values.dtype.kind in "biuf" and name != RECEIVED and not name.startswith("header.")
    ]


def no_field(columns: Columns, missing: Sequence[str], where: str) -> GroundError:
    """The error of fields that are missing, with those that are there."""
    named = ", ".join(path + _absent(columns, path) for path in missing)
    there = ", ".join(numbers(columns)) or "none"
    return GroundError("%s: a message has no field %s; its numeric fields are %s" % (where, named, there))


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
                "%s: field %s contains no numbers, but text such as '%s'" % (where, path, texts[0][:40])
            )
    return np.column_stack(read) if read else np.empty((0, 0))


def _number(given: Column) -> Any:
    if given.dtype.kind in "biuf":
        return given.astype(float)
    import pandas

    return pandas.to_numeric(pandas.Series(given), errors="coerce").to_numpy(float)
