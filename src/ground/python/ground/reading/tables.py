"""Text tables of any kind: CSV, TSV, columns between blanks, exports of motion capture programs.

What separates the cells, which row names the columns and where the values begin is found in the lines; pandas
reads the values. Nothing is left out or assumed without a note.
"""

import csv
import io
import re
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Callable, Dict, List, Optional, Sequence, Tuple

import numpy as np

from ground.reading import cells, exports, words
from ground.reading.exports import Head
from ground.reading.text import lines_of
from ground.support.errors import GroundError

if TYPE_CHECKING:
    import pandas

SEPARATORS = (",", ";", "\t", "|", "")  # empty: blanks
COMMENT = re.compile(r"\s*(#|%|//|!|\*)\s*")
COMMENTS = "#%!*"  # first signs of comments between rows
SAMPLE = 200  # lines from the end that show what separates cells
SEARCHED = 200000  # lines in which the first row of values is looked for
RAGGED = 0.01  # share of short lines from which they are rows without their last cells
TUM = ("timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")
TYPES = set("float float32 float64 double int int32 int64 uint8 bool boolean string str".split())


@dataclass
class Table:
    """A table and what was found about it."""

    frame: "pandas.DataFrame"
    units: Dict[str, str]  #: that the file says, by column
    notes: List[str]  #: what was left out or assumed, in sentences
    empty: List[str] = field(default_factory=list)  #: columns without values
    text: Callable[[str], Any] = lambda _: None  #: the cells of a column as they are written


def read(path: str) -> Table:
    """The table in a text file. GroundError says why there is none."""
    notes: List[str] = []
    lines = exports.below_labview(lines_of(path, notes), notes)
    head = exports.recognised(lines)
    if head is None:
        head = _head(lines)
    notes += head.notes
    rows, decimal = _rows(lines, head, notes)
    return _table(rows, head, decimal, notes)


def _split(line: str, separator: str) -> List[str]:
    """The cells of a line."""
    if not separator:
        return [word.strip('"') for word in re.findall(r'"[^"]*"|\S+', line)]
    row: List[str] = next(csv.reader([_quoted_lists(line)], delimiter=separator, skipinitialspace=True), [])
    return [cell.strip() for cell in row]


def _quoted_lists(line: str) -> str:
    """A line with quotes around lists, whose commas separate no cells."""
    if "[" not in line and "(" not in line:
        return line
    return re.sub(r"(^|[,;\t|])\s*([\[(][-+\w., ;]*[\])])\s*(?=$|[,;\t|])", r'\1"\2"', line)


def _head(lines: Sequence[str]) -> Head:
    """Separator, names of the columns and first line of values. GroundError where no lines are rows."""
    filled = [n for n, line in enumerate(lines) if line.strip() and not COMMENT.match(line)]
    if not filled:
        raise GroundError("the table has no rows")
    sample = [lines[n] for n in filled[-SAMPLE:]]
    sample = sample[:-1] if len(sample) > 2 else sample  # the last line may be cut
    separator, width, share = max((_fit(sample, one) for one in SEPARATORS), key=lambda fit: fit[2])
    if lines[filled[0]].startswith("version https://git-lfs"):
        raise GroundError("it is a Git LFS pointer: git lfs pull fetches the file")
    if not any(cells.is_number(cell) for line in sample for one in SEPARATORS for cell in _split(line, one)):
        raise GroundError("no row contains numbers that could be poses or commands")
    if share <= 0:
        raise GroundError(
            "its lines are not rows of two values or more between commas, semicolons, tabs, bars or blanks; "
            "the last one is '%s'" % sample[-1].strip()[:60]
        )
    least = max(1, min(_count(_split(line, separator)) for line in sample) // 2)
    rows = (n for n in filled[:SEARCHED] if _count(_split(lines[n], separator)) >= least)
    first = next((n for n in rows if len(_split(lines[n], separator)) >= width - 1), None)
    if first is None:
        raise GroundError("the table has no rows: no line after its names has values")
    head = Head(first, [], separator)
    _name(head, lines, first, width)
    return head


def _count(row: Sequence[str]) -> int:
    return sum(map(cells.is_number, row))


def _fit(sample: Sequence[str], separator: str) -> Tuple[str, int, float]:
    """A separator, the usual number of cells between it, and how well the lines are rows of values."""
    rows = [_split(line, separator) for line in sample]
    width, times = Counter(map(len, rows)).most_common(1)[0]
    of_width = [row for row in rows if len(row) == width]
    number = sum(map(_count, of_width))
    filled = sum(bool(cell) for row in of_width for cell in row)
    comma = separator == "," and any(re.search(r"\d;[-+]?\d", line) for line in sample[:5])
    if width < 2 or not number or comma:
        return separator, width, 0.0
    good = sum(cells.is_value(cell) for row in of_width for cell in row if cell)
    return separator, width, times / len(rows) * (good / filled + 1e-3 * number / filled)


def _name(head: Head, lines: Sequence[str], first: int, width: int) -> None:
    """Finds the names of the columns in the lines above the first one that has values."""
    block: List[List[str]] = []
    at = first - 1
    while at >= 0 and len(block) < 4:
        line = lines[at]
        if line.strip():
            row = _names(line, head.separator, width)
            if (
                len(row) < 2
                or (not head.separator and len(row) != width)
                or (block and abs(len(row) - len(block[0])) > 1)
            ):
                break
            block.insert(0, row)
        at -= 1
    above = sum(bool(line.strip()) and not COMMENT.match(line) for line in lines[: max(at + 1, 0)])
    units: List[str] = []
    if len(block) > 1 and {cell.lower() for cell in block[-1]} <= TYPES | {""}:
        block.pop()
    if len(block) > 1 and _are_units(block[-1]):
        units = [words.unit(cell) for cell in block.pop()]
    if block:
        head.names = _joined(block)
        above += len(block) - 1 if head.names == block[-1] else 0
        _unmark(head)
        head.units = {n: u for n, u in zip(head.names, units) if n and u}
        if head.units:
            named = ", ".join("%s [%s]" % item for item in list(head.units.items())[:8])
            head.notes.append("a row of units stands below the names of the columns: %s" % named)
    else:
        _without_names(head, lines, width)
    head.rate = exports.rate_said([line for line in lines[:first] if line.strip()][-60:])
    if above:
        head.notes.append("lines above the column names are skipped: %d" % above)


def _unmark(head: Head) -> None:
    """Removes the mark of a comment before the names; rostopic's "%time" is a name."""
    if not any(name.startswith("field.") for name in head.names):
        head.names[0] = re.sub(r"^[#%!/*]+\s*", "", head.names[0])


def _names(line: str, separator: str, width: int) -> List[str]:
    """The cells of a line of names, which may be a comment, and separated in another way than the rows."""
    marked = COMMENT.match(line)
    text = line if marked is None or line.startswith("%time") else line[marked.end() :]
    found = _split(text, separator)
    found = found if separator else _merged(found)
    if len(found) < width:
        for other in SEPARATORS:
            row = _merged(_split(text, other)) if not other else _split(text, other)
            if len(row) == width:
                return row
        if marked is not None:  # a comment that is no row of names
            return []
    return found


def _merged(row: Sequence[str]) -> List[str]:
    """Names between blanks with their units, "t [s]"."""
    found: List[str] = []
    for cell in row:
        if found and re.fullmatch(r"[\[(].*[\])]", cell):
            found[-1] += " " + cell
        else:
            found.append(cell)
    return found


def _are_units(row: Sequence[str]) -> bool:
    known = [bool(words.unit(cell)) for cell in row if cell.strip("-[]() 1")]
    return bool(known) and all(known)


def _joined(block: Sequence[Sequence[str]]) -> List[str]:
    """Names of one row, or of two of which the upper one has groups of columns."""
    names = list(block[-1])
    plain = [name for name in names if name]
    above = block[-2] if len(block) > 1 else []
    grouped = len(above) == len(names) and "" not in above and len(set(above)) < len(above)
    if above and (len(set(plain)) < len(plain) or "" in names or grouped):
        group = ""
        for at, name in enumerate(names):
            group = (above[at] if at < len(above) else "") or group
            names[at] = ".".join(filter(None, (group, name)))
    return names


def _without_names(head: Head, lines: Sequence[str], width: int) -> None:
    """Names for the columns of a table that has none."""
    head.names = ["column_%d" % (i + 1) for i in range(width)]
    rows = [_split(line, head.separator) for line in lines[head.first : head.first + 50] if line.strip()]
    what = "they are called column_1 to column_%d" % width
    if width == len(TUM):
        try:
            turns = np.array([[float(cell) for cell in row[4:]] for row in rows])
            if (np.abs((turns**2).sum(axis=1) - 1) < 0.01).all():
                head.names, what = list(TUM), "as in a TUM trajectory, they are " + ", ".join(TUM)
        except ValueError:
            pass
    head.notes.append("no row names the columns: " + what)


def _rows(lines: Sequence[str], head: Head, notes: List[str]) -> Tuple[List[str], str]:
    """The lines that have values, and the sign before decimals."""
    separator, width = head.separator, len(head.names)
    repeated = lines[head.first - 1] if head.first else ""
    rows = [line for line in lines[head.first :] if (line.lstrip()[:1] or "#") not in COMMENTS]
    if any("[" in line or "(" in line for line in rows[:20]):
        rows = [_quoted_lists(line) for line in rows]
    again = rows.count(repeated)
    if again and repeated:
        notes.append("repeated header lines are left out (%d)" % again)
        rows = [line for line in rows if line != repeated]
    if not rows:
        raise GroundError("the table has no rows")
    counts = np.array(_widths(rows, separator))
    usual = Counter(counts.tolist()).most_common(1)[0][0]
    most, short = max(usual, width), counts < min(usual, width)
    keep = counts <= most
    if not short[:-1].sum() > RAGGED * len(short[:-1]):
        keep &= ~short
    if short[-1] and not keep[-1]:
        notes.append("the last line is truncated and left out")
    wrong = np.flatnonzero(~keep[: len(keep) - bool(short[-1])])
    if len(wrong):
        notes.append(
            "lines without the %d cells of the others are left out (%d, the first is '%s')"
            % (usual, len(wrong), rows[wrong[0]].strip()[:40])
        )
    kept = [line for line, good in zip(rows, keep) if good]
    head.names = head.names + [""] * (most - width)
    decimal = _decimal([cell for line in kept[:SAMPLE] for cell in _split(line, separator)])
    if separator not in (",", "") or decimal == ",":
        what = {";": "semicolons", "\t": "tabs", "|": "bars", "": "blanks", ",": "commas"}[separator]
        comma = ", and decimals have a comma" * (decimal == ",")
        if comma or separator == "|":
            notes.append("cells are separated by %s%s" % (what, comma))
    return kept, decimal


def _widths(rows: Sequence[str], separator: str) -> List[int]:
    if not separator:
        return [len(_split(line, separator)) for line in rows]
    if not any('"' in line for line in rows):
        return [line.count(separator) + 1 for line in rows]
    return [len(row) for row in csv.reader(rows, delimiter=separator, skipinitialspace=True)]


def _decimal(row: Sequence[str]) -> str:
    """The sign before decimals, by cells that are numbers."""
    comma = any(re.fullmatch(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?", cell) for cell in row)
    point = any(re.fullmatch(r"[-+]?\d*\.\d+(?:[eE][-+]?\d+)?", cell) for cell in row)
    return "," if comma and not point else "."


def _table(rows: Sequence[str], head: Head, decimal: str, notes: List[str]) -> Table:
    import pandas

    content = "\n".join(rows)

    def parsed(width: int, **options: Any) -> "pandas.DataFrame":
        return pandas.read_csv(
            io.StringIO(content), sep=head.separator or r"\s+", header=None, names=range(width),
            skipinitialspace=True, index_col=False, na_values=list(cells.MISSING), decimal=decimal, **options
        )  # fmt: skip

    frame = parsed(len(head.names))
    empty = frame.isna().all().tolist()
    named = len(head.names) - next((i for i, n in enumerate(reversed(head.names)) if n), 0)
    if not all(empty[named:]) and not head.is_export:
        raise GroundError("its rows contain more values than its first line has column names")
    names = _distinct(_grouped(head.names, empty), frame, notes)
    of_name = {name: at for at, name in enumerate(names) if name and not empty[at]}
    frame = frame[list(of_name.values())]
    frame.columns = list(of_name)
    wide = _pivoted(frame, notes)
    if wide is not None:
        frame, in_cells = cells.read(wide, notes)
        return Table(frame, {**_units(head, [*names, *frame.columns]), **in_cells}, notes)
    frame, in_cells = cells.read(frame, notes)
    found = Table(frame, {**in_cells, **_units(head, names)}, notes)
    found.empty = [name for at, name in enumerate(names) if name and empty[at]]

    def text(name: str) -> Any:
        if name not in of_name:
            return None
        at = of_name[name]
        return parsed(at + 1, dtype=str, usecols=[at]).iloc[:, 0].to_numpy()  # a row may end after it

    found.text = text
    _add_times(found, head)
    exports.complete(frame, found.units, head, notes)
    return found


def _pivoted(frame: "pandas.DataFrame", notes: List[str]) -> "Optional[pandas.DataFrame]":
    """A table with a row for each value (time, name, value) as one with a column for each signal; None: it is
    another one."""
    values = [n for n in frame.columns if n.lower() in ("value", "val", "values", "data", "_value")]
    others = [n for n in frame.columns if n not in values and not set(words.split(n)) & words.TIME]
    texts = [n for n in others if frame[n].dtype == object and 3 * frame[n].nunique() <= len(frame)]
    if len(frame.columns) != 3 or len(texts) != 1 or len(values) != 1:
        return None
    (time,) = set(frame.columns) - {texts[0], values[0]}
    notes.append(
        "each row holds one value: %s names the signal, %s holds its value; rows of the same time are joined"
        % (texts[0], values[0])
    )
    wide = frame.pivot_table(index=time, columns=texts[0], values=values[0], aggfunc="first")
    there = [name for name in frame[texts[0]].dropna().unique() if name in wide]
    return wide[there].reset_index().rename(columns=str)


def _units(head: Head, names: Sequence[str]) -> Dict[str, str]:
    """Units by the name of the column, from the head or from the name itself."""
    found = {name: words.unit_in(name) for name in names if name}
    found.update(head.units)
    return {name: unit for name, unit in found.items() if unit}


def _grouped(names: Sequence[str], empty: Sequence[bool]) -> List[str]:
    """In exports of bags a column without values heads those that follow, whose names repeat:
    `position,x,y,z,orientation,x,y,z,w` is read as position.x, position.y and so on."""
    plain = [name for name, is_empty in zip(names, empty) if name and not is_empty]
    if len(set(plain)) == len(plain) or not any(e and n for n, e in zip(names, empty)):
        return list(names)
    grouped, group = [], ""
    for name, is_group in zip(names, empty):
        group = name if is_group else group
        grouped.append("%s.%s" % (group, name) if group and name and not is_group else name)
    return grouped


def _distinct(names: Sequence[str], frame: "pandas.DataFrame", notes: List[str]) -> List[str]:
    """Names of columns of which none repeats: NAME#1, NAME#2, or the first where all have the same values."""
    found = list(names)
    for name, count in Counter(filter(None, names)).items():
        at = [i for i, one in enumerate(names) if one == name]
        if count == 1:
            continue
        if all(frame[at[0]].equals(frame[i]) for i in at[1:]):
            notes.append(
                "%d columns are named %s and have the same values: the first is read" % (count, name)
            )
            for i in at[1:]:
                found[i] = ""
            continue
        for number, i in enumerate(at, 1):
            found[i] = "%s#%d" % (name, number)
        notes.append("%d columns are named %s: they are %s" % (count, name, ", ".join(found[i] for i in at)))
    return found


def _add_times(table: Table, head: Head) -> None:
    """Times of the numbers of frames, where the file says their rate and has no time."""
    frame = table.frame
    frames = [name for name in frame.columns if name.lower() in ("frame", "frames", "frame number", "sample")]
    timed = any(set(words.split(name)) & words.TIME for name in frame.columns)
    if head.rate and frames and not timed:
        frame["time"] = frame[frames[0]] / head.rate
        table.units["time"] = "s"
        table.notes.append("times are frame numbers at the %g Hz that the file states" % head.rate)
