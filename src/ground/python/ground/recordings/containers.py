"""Files of recordings: what they hold is given as tables, one for each topic.

A table has a column for each number, text and time of a topic's messages, by its path ("pose.position.x",
"data[2]").
"""

import csv
import importlib.util
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Dict, Iterator, List, Optional, Sequence

import numpy as np

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


class Tables(Container):
    """CSV and Parquet files: each is a topic, each row a message. Raises GroundError when one cannot be
    read."""

    def __init__(self, paths: Sequence[str]) -> None:
        super().__init__(paths[0] if paths else "")
        self._frames = {os.path.basename(path): _frame(path) for path in paths}
        self.topics = {name: Topic(TABLE, len(frame)) for name, frame in self._frames.items()}

    def table(self, topic: str) -> Columns:
        """See Container."""
        frame = self._frames[topic]
        return {str(name): frame[name].to_numpy() for name in frame.columns}


def _frame(path: str) -> "pandas.DataFrame":
    """The table in a file. GroundError when it cannot be read."""
    import pandas

    read = next((READERS[suffix] for suffix in READERS if path.lower().endswith(suffix)), _csv)
    try:
        return read(path)
    except OSError as error:
        raise GroundError("%s: %s" % (path, reason(error)))
    except (ValueError, csv.Error, pandas.errors.ParserError, pandas.errors.EmptyDataError) as error:
        raise GroundError("%s: cannot be read as a table (%s)" % (path, str(error).splitlines()[0]))


def _parquet(path: str) -> "pandas.DataFrame":
    import pandas

    if not any(importlib.util.find_spec(name) for name in ("pyarrow", "fastparquet")):
        raise GroundError("%s: Parquet takes the Python module pyarrow: pip install pyarrow" % path)
    return pandas.read_parquet(path)


def _csv(path: str) -> "pandas.DataFrame":
    """In exports of bags a column without values heads those that follow:
    `position,x,y,z,orientation,x,y,z,w` is read as position.x, position.y and so on."""
    import pandas

    with open(path, newline="", encoding="utf-8-sig") as file:
        rows = csv.reader(file, skipinitialspace=True)
        head: List[str] = next(rows, [])
        first: List[str] = next(rows, [])
    if len(head) < 2:
        raise GroundError("%s: its first line does not name columns, separated by commas" % path)
    names = [name.strip() for name in head] + [""] * (len(first) - len(head))
    frame = pandas.read_csv(
        path, header=None, skiprows=1, names=range(len(names)), skipinitialspace=True, index_col=False
    )
    if frame.empty:
        raise GroundError("%s: the table has only 0 rows" % path)
    empty = frame.isna().all().tolist()
    if not all(empty[len(head) :]):
        raise GroundError("%s: its rows have more values than its first line names columns" % path)
    grouped, group = [], ""
    for name, is_group in zip(names, empty):
        group = name if is_group else group
        grouped.append("%s.%s" % (group, name) if group and not is_group else name)
    frame.columns = pandas.Index(grouped)
    frame = frame.loc[:, [bool(name) and not e for name, e in zip(names, empty)]]
    again = frame.columns[frame.columns.duplicated()]
    if len(again):
        raise GroundError("%s: two columns are named %s; rename one" % (path, again[0]))
    return frame


READERS = {".csv": _csv, ".parquet": _parquet}  #: of tables, by the end of their names
SUFFIXES = tuple(READERS)


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


def numbers(columns: Columns) -> List[str]:
    """Names of the columns that are numbers, without those of the header and the receipt."""
    return [
        name
        for name, values in columns.items()
        if values.dtype.kind in "biuf" and name != RECEIVED and not name.startswith("header.")
    ]


def values(columns: Columns, paths: Sequence[str], where: str) -> Any:
    """The numbers of fields (n, k); text becomes NaN. GroundError for fields that are missing."""
    found = [column(columns, path) for path in paths]
    missing = [path for path, one in zip(paths, found) if one is None]
    if missing:
        raise GroundError(
            "%s: a message has no field %s; its numbers are %s"
            % (where, ", ".join(missing), ", ".join(numbers(columns)) or "none")
        )
    return np.column_stack([_number(one) for one in found]) if found else np.empty((0, 0))


def _number(given: Column) -> Any:
    if given.dtype.kind in "biuf":
        return given.astype(float)
    import pandas

    return pandas.to_numeric(pandas.Series(given), errors="coerce").to_numpy(float)
