"""Reads CSV and Parquet files: each file is a topic, each row a message.

In exports of bags a column without values heads those that follow: `position,x,y,z,orientation,x,y,z,w`
is read as position.x, position.y and so on. A name that is there once needs no heading: it may be a column
that just has no values.
"""

import csv
import importlib.util
import os
from typing import TYPE_CHECKING, Any, Dict, Iterable, Iterator, List, Optional, Sequence, Tuple

from ground.annotations import Message, Time
from ground.errors import GroundError, reason
from ground.recordings.bag_reader import Topic, Topics
from ground.recordings.batches import Batch
from ground.recordings.fields import Row
from ground.recordings.poses import TABLE

if TYPE_CHECKING:
    import pandas

CSV, PARQUET = ".csv", ".parquet"
SUFFIXES = (CSV, PARQUET)


class TableReader:
    """Rows of tables. Raises GroundError when one cannot be read."""

    def __init__(self, paths: Sequence[str]) -> None:
        self.warnings: List[str] = []
        self._tables: Dict[str, "pandas.DataFrame"] = {}
        for path in paths:
            self._tables[os.path.basename(path)] = table(path)

    def __enter__(self) -> "TableReader":
        return self

    def __exit__(self, *failure: Any) -> None:
        self._tables.clear()

    def get_type_and_topic_info(self) -> Topics:
        """The files by name, with the number of their rows."""
        return Topics({name: Topic(TABLE, len(rows)) for name, rows in self._tables.items()})

    def batch(self, topic: str) -> Optional[Batch]:
        """See MessageSource."""
        return None

    def read_messages(
        self, topics: Iterable[str]
    ) -> Iterator[Tuple[str, Message, Optional[Time]]]:
        """Yields the file's name, a Row, and None for the time of receipt."""
        for name in dict.fromkeys(topics):
            if name not in self._tables:
                continue
            frame = self._tables[name]
            columns = [frame[column].tolist() for column in frame.columns]
            short = _short(frame.columns)
            for values in zip(*columns):
                row = Row(zip(frame.columns, values))
                row.short = short
                yield name, row, None


def table(path: str) -> "pandas.DataFrame":
    """The table in a file. GroundError when it cannot be read."""
    import pandas

    try:
        if path.lower().endswith(PARQUET):
            if not any(importlib.util.find_spec(name) for name in ("pyarrow", "fastparquet")):
                raise GroundError(
                    "%s: Parquet takes the Python module pyarrow: pip install pyarrow" % path
                )
            return pandas.read_parquet(path)
        names, more = _names(path)
        frame = pandas.read_csv(
            path, header=None, skiprows=1, names=names, skipinitialspace=True, index_col=False
        )
    except OSError as error:
        raise GroundError("%s: %s" % (path, reason(error)))
    except (ValueError, csv.Error, pandas.errors.ParserError, pandas.errors.EmptyDataError) as error:
        raise GroundError("%s: cannot be read as a table (%s)" % (path, str(error).splitlines()[0]))
    if frame.empty:
        raise GroundError("%s: a table without rows" % path)
    empty = frame.isna().all().tolist()
    if not all(empty[len(names) - more :]):
        raise GroundError("%s: its rows have more values than its first line names columns" % path)
    useless = [e or name.startswith("\n") for name, e in zip(names, empty)]
    frame = frame.set_axis(_grouped(names, empty), axis=1).loc[:, [not u for u in useless]]
    again = frame.columns[frame.columns.duplicated()]
    if len(again):
        raise GroundError("%s: two columns are named %s; rename one" % (path, again[0]))
    return frame


def _names(path: str) -> Tuple[List[str], int]:
    """Names of a CSV file's columns, made distinct by their numbers, and how many more columns than names
    its rows have."""
    with open(path, newline="", encoding="utf-8-sig") as file:
        rows = csv.reader(file, skipinitialspace=True)
        header: List[str] = next(rows, [])
        first: List[str] = next(rows, [])
    if len(header) < 2:
        raise GroundError("%s: its first line does not name columns, separated by commas" % path)
    more = max(0, len(first) - len(header))
    header += [""] * more
    return ["%s\n%d" % (name.strip(), number) for number, name in enumerate(header)], more


def _short(columns: Sequence[str]) -> Dict[str, str]:
    """Columns by the part of their names after the heading, where it is theirs only."""
    parts = [column.rsplit(".", 1)[-1] for column in columns]
    return {part: column for part, column in zip(parts, columns) if parts.count(part) == 1}


def _grouped(names: Sequence[str], empty: Sequence[bool]) -> List[str]:
    """Names of the columns with those of the groups that they are in."""
    group, found = "", []
    for name, is_group in zip(names, empty):
        plain = name.split("\n")[0]
        if is_group:
            group = plain
        found.append("%s.%s" % (group, plain) if group and not is_group else plain)
    return found
