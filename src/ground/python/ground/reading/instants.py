"""Stamps of tables: numbers of any unit, dates and times as text, numbers of frames."""

import itertools
import re
from typing import TYPE_CHECKING, List, Optional, Sequence, Tuple, Union

import numpy as np

from ground.reading import containers
from ground.reading.containers import RECEIVED, STAMP, Column, Columns
from ground.reading.mapping import HEADER, RECEIPT, TIMES, Clock
from ground.support.annotations import Array, Flags, Indices
from ground.support.errors import GroundError

if TYPE_CHECKING:
    import pandas

END_OF_ROS = 2**32 * 10**9  # seconds of ROS have 32 bits [ns]
CENTURY = 946684800.0  # 2000-01-01; an earlier stamp is not a date [s]
DAY = 86400 * 10**9  # [ns]
RESTART = 5 * 10**8  # a clock that goes back by more starts anew [ns]
MANY_LOST = 3  # rows for each stamp from which the stamps have lost digits
UNPADDED = "unpadded"
# Days of Excel and of Matlab, and their day 1970-01-01
CALENDARS = ((3e4, 8e4, 25569), (7e5, 8e5, 719529))
# Times as text that need no format: the year first, or no date
FORM = re.compile(
    r"\s*(?:(?P<y>\d{4})([-/.]?)(?P<mo>\d\d?)\2(?P<d>\d\d?)(?:\s*T|[\s,_-]+|$))?"
    r"(?:(?P<h>\d\d?):(?P<m>\d\d?)(?::(?P<s>\d\d?)(?:[.,](?P<f>\d+))?)?)?"
    r"\s*(?P<zone>Z|UTC|GMT|[-+]\d\d:?\d\d|[-+]\d\d)?\s*"
)
DATES = (
    "%d.%m.%Y", "%d/%m/%Y", "%m/%d/%Y", "%d-%m-%Y", "%m-%d-%Y", "%d-%b-%Y", "%d %b %Y", "%d %B %Y",
    "%Y-%b-%d", "%Y %b %d", "%d.%m.%y", "%d/%m/%y", "%m/%d/%y",
)  # fmt: skip
CLOCKS = ("%H:%M:%S.%f", "%I:%M:%S.%f %p", "%H:%M", "%I:%M %p")
FRACTION = re.compile(r"(:\d\d)[.,](\d{1,9})")
SAMPLE = 200  # texts that show their format


def stamps(columns: Columns, clock: Clock, where: str, notes: List[str]) -> Tuple[Indices, Flags]:
    """Stamps (n,) [ns] of a topic or table, by fields, the header or the times of receipt, and which rows
    have one. notes: told what was assumed. GroundError when there are none."""
    if clock.is_of_fields:
        return read(columns, clock, where, notes)
    name = STAMP if clock.source != RECEIPT and STAMP in columns else RECEIVED
    if name not in columns or (clock.source == HEADER and name != STAMP):
        missing = "no header" if clock.source == HEADER else "no time of receipt"
        raise GroundError("%s: %s; name the field that is the time in a mapping" % (where, missing))
    found = np.asarray(columns[name])
    return found, np.ones(len(found), bool)


def read(columns: Columns, clock: Clock, where: str, notes: List[str]) -> Tuple[Indices, Flags]:
    """Stamps (n,) [ns] by fields of a table, and which rows have one. notes: told what was assumed.
    GroundError where a field gives no times."""
    count = len(next(iter(columns.values()))) if columns else 0
    if not clock.field:
        return np.rint(np.arange(count) * (1e9 / clock.rate)).astype(np.int64), np.ones(count, bool)
    given = containers.column(columns, clock.field)
    if given is None:
        raise containers.no_field(columns, [clock.field], where)
    if given.dtype.kind not in "biuf" or clock.format:
        texts = given if given.dtype.kind == "O" else _written(columns, clock.field)
        return _of_texts(columns, given if texts is None else texts, clock, where, notes)
    return _of_numbers(columns, given, clock, where, notes)


def check(
    columns: Columns, clock: Clock, stamps: Indices, used: Flags, where: str, rows: Optional[Array] = None
) -> None:
    """GroundError where stamps (n,) [ns] of a table are none, of the rows that are used (n,): nanoseconds
    without leading zeros, lost digits, or a clock that starts anew. rows: what was measured (n, k); a row
    that is there twice has not lost the digits of its stamp."""
    given = containers.column(columns, clock.field) if clock.field else None
    if given is None or not used.any() or descends(stamps[used]):
        return
    is_glued = clock.stamps != UNPADDED and not clock.nanoseconds and given.dtype.kind not in "iu"
    if is_glued and (np.diff(stamps[used]) < 0).any():
        texts = _written(columns, clock.field)
        if texts is not None:
            _check_padding(stamps[used], np.asarray(texts, object)[used], where)
    count = int(used.sum())
    if rows is not None:
        count = len(np.unique(np.column_stack([stamps[used], rows[used]]), axis=0))
    _check_digits(stamps[used], count, clock, where)
    _check_restarts(stamps[used], np.flatnonzero(used), where)


def descends(stamps: Union[Array, Indices]) -> bool:
    """Whether the latest of stamps (n,) come first, as databases export them."""
    steps = np.diff(stamps)
    return bool(len(steps) and (steps < 0).sum() > 0.9 * (steps != 0).sum() > 0)


def _written(columns: Columns, name: str) -> Optional[Column]:
    """The cells of a column of a text table; None where the file has no texts."""
    text = getattr(columns, "text", None)
    ends = [one for one in columns if one == name or one.endswith("." + name)]
    return text(ends[0]) if text is not None and ends else None


def _of_numbers(
    columns: Columns, given: Column, clock: Clock, where: str, notes: List[str]
) -> Tuple[Indices, Flags]:
    """Stamps by a field that is a number, and one to add."""
    named = containers.unit(columns, clock.field)
    unit = clock.unit or (named if named in TIMES else "s")
    if clock.stamps == UNPADDED and given.dtype.kind == "f" and not clock.nanoseconds:
        texts = _written(columns, clock.field)
        if texts is not None:
            return _unpadded(texts, where)
    known, total = np.ones(len(given), bool), np.zeros(len(given), np.int64)
    parts: List[Tuple[Column, float]] = [(given, 1e9 / clock.rate if clock.rate else TIMES[unit])]
    if unit == "days":
        numbers = np.asarray(given, float)
        parts = [(numbers - first_day(numbers), TIMES[unit])]
    if clock.nanoseconds:
        parts.append((containers.values(columns, [clock.nanoseconds], where)[:, 0], 1.0))
    for values, factor in parts:
        numbers = np.asarray(values, float)
        finite = np.isfinite(numbers)
        known &= finite
        far = finite & ((numbers < 0) | (numbers * factor >= END_OF_ROS))
        if far.any() and clock.rate == 0 and (numbers[far] >= 0).any():
            other = since_1970(numbers[far][0])
            raise GroundError(
                "%s: a time is %g %s, which is not between 1970 and 2106; the key unit of the "
                "mapping's time may be wrong%s"
                % (where, numbers[far][0], unit, other and ": it is a time since 1970 in " + other)
            )
        if values.dtype.kind in "iu" and float(factor).is_integer():  # more digits than a float
            total += _unwrapped(np.asarray(values, np.int64), notes) * int(factor)
        else:
            total += np.rint(np.where(finite, numbers, 0.0) * factor).astype(np.int64)
    return total, known


def first_day(days: Array) -> int:
    """The day 1970-01-01 in the calendar of Excel or Matlab that days (n,) count in; 0: in neither."""
    ends = np.nanmin(days), np.nanmax(days)
    return next((first for low, high, first in CALENDARS if low < ends[0] and ends[1] < high), 0)


def _unwrapped(counts: Indices, notes: List[str]) -> Indices:
    """Counts of a clock of 16 or 32 bits that begins again at 0, as counts that go on."""
    steps = np.diff(counts)
    usual = np.median(np.abs(steps)) if len(steps) else 0
    for size in (2**32, 2**16):
        wraps = np.abs(steps + size) <= 5 * usual
        if wraps.any() and (counts < size).all() and 100 * usual < size / 4:
            notes.append("the clock of %d bits starts again from 0 (%d)" % (np.log2(size), wraps.sum()))
            return np.asarray(counts + size * np.concatenate([[0], np.cumsum(wraps)]), np.int64)
    return counts


def since_1970(value: float) -> str:
    """The unit in which a number is a time of this century; empty: in none."""
    units = ("s", "ms", "us", "ns")
    return next((unit for unit in units if 1e9 * CENTURY < value * TIMES[unit] < END_OF_ROS), "")


def _unpadded(texts: Column, where: str) -> Tuple[Indices, Flags]:
    """Stamps of seconds and nanoseconds between which a point stands, without leading zeros."""
    import pandas

    parts = pandas.Series(texts).astype(str).str.extract(r"^\s*(\d+)(?:[.,](\d{1,9}))?\s*$")
    known = parts[0].notna().to_numpy()
    whole = parts[0].fillna("0").astype(np.int64).to_numpy()
    rest = parts[1].fillna("0").astype(np.int64).to_numpy()
    if not known.any():
        raise GroundError("%s: no stamp has the form of seconds, a point and nanoseconds" % where)
    return whole * 10**9 + rest, known


def formats(columns: Columns, clock: Clock, where: str) -> List[str]:
    """The formats of times as text that all of a sample fit."""
    import pandas

    given = containers.column(columns, clock.field)
    texts = _joined(columns, given, clock, where)
    texts = texts[texts != ""]
    sample = texts.iloc[:: 1 + len(texts) // SAMPLE].str.replace(FRACTION, r"\1", regex=True)
    return [
        "%s %s" % (date, time)
        for date, time in itertools.product(DATES if len(sample) else (), CLOCKS)
        if pandas.to_datetime(
            sample, format="%s %s" % (date, time.replace(".%f", "")), errors="coerce"
        ).notna().all()
    ]  # fmt: skip


def _joined(columns: Columns, texts: Column, clock: Clock, where: str) -> "pandas.Series":
    """Texts of times, with the dates that stand in another column."""
    import pandas

    series = pandas.Series(texts, dtype=object).where(lambda one: one.notna(), "").astype(str).str.strip()
    if not clock.date:
        return series
    dates = containers.column(columns, clock.date)
    if dates is None:
        raise containers.no_field(columns, [clock.date], where)
    if dates.dtype.kind in "biuf":  # 20231114
        dates = _written(columns, clock.date)
    known = pandas.Series(dates, dtype=object).ffill().fillna("").astype(str).str.strip()
    return (known + " " + series).where(series != "", "")


def _of_texts(
    columns: Columns, texts: Column, clock: Clock, where: str, notes: List[str]
) -> Tuple[Indices, Flags]:
    """Stamps by texts of date and time."""
    series = _joined(columns, texts, clock, where)
    known = (series != "").to_numpy()
    if clock.format:
        return _of_format(series, known, clock, where)
    parts = series.str.extract(FORM)
    good = (parts["h"].notna() & series.str.fullmatch(FORM.pattern)).to_numpy()
    bad = known & ~good
    if known.any() and bad.mean() > 0.01 * known.mean():
        likely = formats(columns, clock, where)
        raise GroundError(
            "%s: column %s contains neither numbers nor times in a known format, such as '%s'; write time: "
            "{field: %s, format: '%s'} with the codes of strptime in the mapping"
            % (
                where, clock.field, series[np.argmax(bad)], clock.field,
                "' or '".join(likely) or "%Y-%m-%d %H:%M:%S.%f",
            )
        )  # fmt: skip
    if bad.any():
        notes.append(
            "times that cannot be read are left out (%d, the first is '%s')"
            % (bad.sum(), series[np.argmax(bad)])
        )
    parts = parts[good]
    hours, minutes, seconds = (parts[n].fillna("0").astype(np.int64).to_numpy() for n in "hms")
    of_day = ((hours * 60 + minutes) * 60 + seconds) * 10**9 + _nanoseconds(parts["f"], clock)
    zones = parts["zone"].fillna("Z")
    offsets = zones.map({zone: _offset(zone) for zone in zones.unique()})
    times = np.asarray(of_day - offsets.astype(np.int64).to_numpy(), np.int64)
    total = np.zeros(len(series), np.int64)
    if parts["y"].notna().any():
        days = [parts[n].ffill().bfill() for n in ("y", "mo", "d")]
        total[good] = times + _of_dates(days, where) * DAY
    else:
        total[good] = _past_midnight(times, notes)
    return total, good


def _of_format(series: "pandas.Series", known: Flags, clock: Clock, where: str) -> Tuple[Indices, Flags]:
    """Stamps by the format of a mapping. Fractions of seconds after a colon may have any number of digits."""
    import pandas

    rest: Indices = np.zeros(len(series), np.int64)
    form = clock.format
    if ":%S.%f" in form:
        rest = _nanoseconds(series.str.extract(FRACTION)[1], clock)
        form = form.replace(".%f", "")
        series = series.str.replace(FRACTION, r"\1", regex=True)
    found = pandas.to_datetime(series.where(known), format=form, errors="coerce", utc=True)
    known = known & found.notna().to_numpy()
    if not known.any():
        raise GroundError(
            "%s: no time fits the format '%s'; the first is '%s'" % (where, clock.format, series[0])
        )
    whole = found.dt.tz_localize(None).fillna(pandas.Timestamp(0)).to_numpy("datetime64[ns]")
    return whole.astype(np.int64) + rest, known


def _nanoseconds(digits: "pandas.Series", clock: Clock) -> Indices:
    """Fractions of seconds in digits [ns]."""
    there = digits.fillna("0").str[:9]
    there = there.str.zfill(9) if clock.stamps == UNPADDED else there.str.ljust(9, "0")
    return np.asarray(there.astype(np.int64).to_numpy())


def _of_dates(parts: Sequence["pandas.Series"], where: str) -> Indices:
    """Days since 1970 of dates in parts: year, month, day."""
    try:
        dates = ["%s-%s-%s" % (y, m.zfill(2), d.zfill(2)) for y, m, d in zip(*parts)]
        return np.array(dates, "datetime64[D]").astype(np.int64)
    except ValueError as error:
        raise GroundError(
            "%s: a date has an unknown format (%s); give the format in the mapping's time" % (where, error)
        )


def _offset(zone: str) -> int:
    """How far a zone's clock is before UTC [ns]."""
    if zone[0] not in "+-":
        return 0
    digits = zone[1:].replace(":", "").ljust(4, "0")
    seconds = 3600 * int(digits[:2]) + 60 * int(digits[2:4])
    return (-seconds if zone[0] == "-" else seconds) * 10**9


def _past_midnight(times: Indices, notes: List[str]) -> Indices:
    """Times of day of which those after midnight belong to the next day."""
    passed = np.diff(times, prepend=times[:1]) < -DAY // 2
    if passed.any():
        notes.append("the times of day pass midnight (%d)" % passed.sum())
    return np.asarray(times + np.cumsum(passed) * DAY, np.int64)


def _check_padding(stamps: Indices, texts: Column, where: str) -> None:
    """GroundError where stamps (n,) [ns] go back in the way of nanoseconds without leading zeros."""
    ends = [re.search(r"[.,](\d+)$", str(text)) for text in texts]
    digits = np.array([len(end.group(1)) if end else 0 for end in ends])
    if not 6 <= digits.max() <= 9 or not (digits < digits.max()).any():
        return
    rest = np.array([int(end.group(1)) if end else 0 for end in ends], np.int64)
    shown = np.array([int(end.group(1).ljust(9, "0")) if end else 0 for end in ends], np.int64)
    back = np.flatnonzero(np.diff(stamps) < 0)
    if (np.diff(stamps - shown + rest) < 0).sum() < 0.2 * len(back):
        at = int(back[0])
        raise GroundError(
            "%s: stamps go back %d times, the first from %s to %s: seconds and nanoseconds were written one "
            "after the other without leading zeros; stamps: unpadded in the mapping (or --stamps unpadded) "
            "corrects them" % (where, len(back), texts[at], texts[at + 1])
        )


def _check_digits(stamps: Indices, count: int, clock: Clock, where: str) -> None:
    """GroundError where most stamps are the same, because their last digits are lost. count: of different
    rows."""
    different = np.unique(stamps)
    if count < 10 or len(different) * MANY_LOST > count or not stamps.any():
        return
    step = 1e-9 * float(np.median(np.diff(different))) if len(different) > 1 else 0.0
    raise GroundError(
        "%s: %d stamps have only %d different value%s%s: their last digits were lost in writing "
        "(%%g writes six); rewrite them with all digits (%%.9f) or, where rows are evenly spaced, give "
        "time: {rate: HZ} in the mapping instead of the field %s"
        % (
            where, count, len(different), "s" * (len(different) > 1),
            ", %g s apart" % step if step else "", clock.field,
        )
    )  # fmt: skip


def _check_restarts(stamps: Indices, rows: Indices, where: str) -> None:
    """GroundError where the clock starts anew and goes on from there."""
    back = np.flatnonzero(np.diff(stamps) < -RESTART)
    far = [at for at in back if stamps[max(at - 4, 0)] > stamps[min(at + 5, len(stamps) - 1)]]
    if not far:
        return
    ends = [0, *(int(rows[at + 1]) for at in far), int(rows[-1]) + 1]
    parts = ["rows: [%d, %d]" % (a + 1, b) for a, b in zip(ends, ends[1:])]
    raise GroundError(
        "%s: the clock restarts at row %d, from %.3f to %.3f s: the clock stepped, or these are %d runs; "
        "read one of them with %s in the mapping"
        % (
            where, ends[1] + 1, 1e-9 * stamps[far[0]], 1e-9 * stamps[far[0] + 1], len(parts),
            " or ".join(parts[:4]),
        )
    )  # fmt: skip
