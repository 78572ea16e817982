"""Reads CSV and Parquet files: each file is a topic, each row a message.

In exports of bags a column without values heads those that follow: `position,x,y,z,orientation,x,y,z,w`
is read as position.x, position.y and so on.
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
            for values in zip(*columns):
                yield name, Row(zip(frame.columns, values)), None


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
        names = _names(path)
        frame = pandas.read_csv(path, header=None, skiprows=1, names=names, skipinitialspace=True)
    except OSError as error:
        raise GroundError("%s: %s" % (path, reason(error)))
    except (ValueError, csv.Error, pandas.errors.ParserError, pandas.errors.EmptyDataError) as error:
        raise GroundError("%s: cannot be read as a table (%s)" % (path, str(error).splitlines()[0]))
    if frame.empty:
        raise GroundError("%s: a table without rows" % path)
    empty = frame.isna().all().tolist()
    return frame.set_axis(_grouped(names, empty), axis=1).loc[:, [not e for e in empty]]


def _names(path: str) -> List[str]:
    """Names of a CSV file's columns, made distinct by their numbers."""
    with open(path, newline="", encoding="utf-8-sig") as file:
        header: List[str] = next(csv.reader(file, skipinitialspace=True), [])
    if len(header) < 2:
        raise GroundError("%s: its first line does not name columns, separated by commas" % path)
    return ["%s\n%d" % (name.strip(), number) for number, name in enumerate(header)]


def _grouped(names: Sequence[str], empty: Sequence[bool]) -> List[str]:
    """Names of the columns with those of the groups that they are in."""
    group, found = "", []
    for name, is_group in zip(names, empty):
        plain = name.split("\n")[0]
        if is_group:
            group = plain
        found.append("%s.%s" % (group, plain) if group and not is_group else plain)
    return found
