"""What the cells of a text table say: numbers, switches, lists, and what stands for no value."""

import re
from typing import TYPE_CHECKING, Dict, List, Optional, Tuple

import numpy as np

from ground.support.annotations import Array

if TYPE_CHECKING:
    import pandas

# What stands for no value, beside what pandas knows (an empty cell, NaN, NULL, N/A and the like)
MISSING = (
    "-", "--", "---", "?", ".", "none", "None", "NONE", "Nan", "nil", "Null", "undefined", "invalid", "lost",
    "missing", "N.A.", "n.a.", "na", "#VALUE!", "#DIV/0!", "#REF!",
)  # fmt: skip
ON = {"true", "on", "yes", "open", "opened", "enabled", "active", "high", "t", "y"}
OFF = {"false", "off", "no", "closed", "close", "disabled", "inactive", "low", "f", "n"}
NUMBER = r"[-+]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eEdD][-+]?\d+)?"
LIST = re.compile(r"[\[({].*[\])}]|%s(?:[ ;|]+%s)+" % (NUMBER, NUMBER))
WITH_UNIT = r"(%s)\s*([A-Za-zµ°%%]+(?:/[A-Za-z]+)?)" % NUMBER
MOST_WRONG = 0.1  # share of cells that are no numbers in a column of numbers
MIN_APART = 20.0  # a mark of a missing value is further from the others than so many of their ranges
# Numbers that loggers write for a missing value, and their opposites
MARKS = (999, 9999, 99999, 999999, 999.25, 2**15 - 1, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 1e30)


def is_value(cell: str) -> bool:
    """Whether a cell has what rows of measurements have, and not a name: a number, a time, a list, a switch,
    or nothing."""
    text = cell.strip()
    return (
        not text
        or re.fullmatch(NUMBER, text) is not None
        or re.fullmatch(r"\d[\d .:/T,-]*\d ?(?:[AaPp][Mm]|Z|UTC|[+-]\d\d:?\d\d)?", text) is not None
        or LIST.fullmatch(text) is not None
        or text.lower() in ON | OFF | {"nan", "inf", "-inf", "null"}
        or text in MISSING
    )


def is_number(cell: str) -> bool:
    """Whether a cell has a number or a time."""
    return (
        bool(cell.strip()) and cell.strip()[-1:].isalnum() and is_value(cell) and any(map(str.isdigit, cell))
    )


def read(frame: "pandas.DataFrame", notes: List[str]) -> Tuple["pandas.DataFrame", Dict[str, str]]:
    """The table with numbers where its texts are numbers, switches or lists, and the units that stand in
    cells, by column. notes: told what was left out."""
    import pandas

    columns: Dict[str, "pandas.Series"] = {}
    units: Dict[str, str] = {}
    for name in frame.columns:
        values = frame[name]
        if values.dtype.kind == "b":
            values = values.astype(np.uint8)
        elif values.dtype == object:
            found = _switches(values)
            if found is None:
                found, units[name] = _numbers(name, values, notes)
            lists = _lists(name, values, notes) if found is None else {}
            columns.update(lists)
            if lists:
                continue
            values = values if found is None else found
        if values.dtype.kind in "if":
            values = _without_marks(name, values, notes)
        columns[name] = values
    return pandas.DataFrame(columns, index=frame.index), {n: u for n, u in units.items() if u}


def _switches(values: "pandas.Series") -> Optional["pandas.Series"]:
    """1 and 0 of words such as on and off; None where there are other words."""
    words = values.dropna().astype(str).str.strip().str.lower()
    known = set(words.unique())
    if not known or len(known) > 4 or not known <= ON | OFF | {"0", "1", "0.0", "1.0"}:
        return None
    meant = {word: float(word in ON or word[0] == "1") for word in known}
    return words.map(meant).reindex(values.index)


def _numbers(name: str, values: "pandas.Series", notes: List[str]) -> Tuple[Optional["pandas.Series"], str]:
    """The numbers in texts and their unit, where nearly all of them are numbers; else None."""
    import pandas

    texts = values.dropna().astype(str).str.strip()
    parts = texts.str.extract(r"^%s$" % WITH_UNIT)
    unit = ""
    if len(texts) and parts[1].notna().mean() > 1 - MOST_WRONG and parts[1].nunique() == 1:
        texts, unit = parts[0].reindex(texts.index), str(parts[1].dropna().iloc[0])
    plain = texts.str.replace(r"^([-+]?\d*\.?\d*)[dD]([-+]?\d+)$", r"\1e\2", regex=True)  # of Fortran
    plain = plain.str.replace(r"^([-+]?\d*),(\d+)$", r"\1.\2", regex=True)
    numbers = pandas.to_numeric(plain, errors="coerce")
    wrong = numbers.isna()
    if not len(texts) or wrong.mean() > MOST_WRONG:
        return None, ""
    if wrong.any():
        first = str(values[texts.index[wrong]].iloc[0])[:20]
        notes.append(
            "%d cells of column %s are not numbers ('%s') and are left out" % (wrong.sum(), name, first)
        )
    return numbers.reindex(values.index), unit


def _lists(name: str, values: "pandas.Series", notes: List[str]) -> Dict[str, "pandas.Series"]:
    """A column NAME[i] for each element of lists in cells; none where the texts are no lists."""
    import pandas

    texts = values.dropna().astype(str).str.strip()
    if not len(texts) or not texts.str.fullmatch(LIST.pattern).all():
        return {}
    words = texts.str.lower().str.replace(r"\btrue\b|\bon\b", "1", regex=True)
    words = words.str.replace(r"\bfalse\b|\boff\b", "0", regex=True)
    found = words.str.findall(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?|nan")
    sizes = found.str.len()
    if sizes.nunique() != 1 or not sizes.iloc[0]:
        reach = name, sizes.min(), sizes.max()
        notes.append("the lists in column %s have %d to %d elements and are not read" % reach)
        return {}
    elements = pandas.DataFrame(found.tolist(), index=found.index).astype(float).reindex(values.index)
    return {"%s[%d]" % (name, i): elements[i] for i in elements}


def _without_marks(name: str, values: "pandas.Series", notes: List[str]) -> "pandas.Series":
    """The numbers without those that stand for a missing value, -9999 and the like: far from all others."""
    numbers: Array = values.to_numpy(float)
    infinite = np.isinf(numbers)
    if infinite.any():
        notes.append("infinite values of column %s are left out (%d)" % (name, infinite.sum()))
        values = values.where(~infinite)
    there = numbers[np.isfinite(numbers)]
    ends = {float(there.min()), float(there.max())} if len(there) else set()
    for mark in (end for end in ends if abs(end) in MARKS):
        marked = numbers == mark
        if marked.all():
            continue
        others = numbers[~marked & np.isfinite(numbers)]
        if not len(others) or np.abs(others - mark).min() <= MIN_APART * max(
            np.ptp(others), np.abs(others).max()
        ):
            continue
        notes.append(
            "%d values of column %s are %g, which stands for a missing value, and are left out"
            % (marked.sum(), name, mark)
        )
        values = values.where(~marked)
    return values
