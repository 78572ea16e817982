"""Which columns of a table are probably its time, for drafts of mappings."""

import re
from dataclasses import dataclass, replace
from typing import Iterator, List, Mapping, Sequence, Set, Tuple

import numpy as np

from ground.draft.undecided import MARK
from ground.reading import containers, instants, words
from ground.reading.containers import Columns
from ground.reading.mapping import TIMES, Clock
from ground.support.annotations import Array
from ground.support.errors import GroundError

RATES = (2.0, 1000.0)  # of rows, of which one unit of time alone can be [Hz]
GIVEN_RATES = (1.0, 1e4)  # the same of a unit that is given [Hz]
CLEARLY = 0.5  # by which the name of a time is likelier than others
MAX_PERIOD = 20.0  # usual time between rows up to which times may be days [s]


@dataclass(frozen=True)
class TableClock:
    """The clock of a table."""

    key: str  #: `time` of a mapping, with a comment
    fields: Tuple[str, ...]  #: columns that it takes
    times: Array  #: (n,) of the rows [s]; NaN for those without one


def find(
    columns: Columns, values: Mapping[str, Array], units: Mapping[str, str], topic: str, shared: Set[str]
) -> TableClock:
    """The clock of a table. values: its numbers, by column; units: that the file says; shared: columns that
    all tables of a folder have, whose clock is one."""
    clocks = sorted(_clocks(columns, values, units), key=lambda one: one[0].field not in shared)
    lost = ""
    for clock, unit in clocks:
        fields = tuple(filter(None, (clock.field, clock.nanoseconds, clock.date)))
        try:
            stamps, known = instants.read(columns, clock, topic, [])
        except GroundError:
            continue
        times, comment = np.where(known, containers.seconds(stamps), np.nan), ""
        try:
            instants.check(columns, clock, stamps, known, topic)
            doubt = _doubt(columns, clock, fields, times, values, _given_unit(clock.field, units))
            comment = "  # %s%s" % (MARK, doubt) if doubt else ""
        except GroundError as error:
            comment = "  # %s%s" % (MARK, error)
            if "unpadded" in str(error):
                unit += ", stamps: unpadded"
                comment = "  # seconds and nanoseconds were written without leading zeros between them"
            elif "digits" in str(error):
                lost = "the stamps of %s have lost their last digits" % clock.field
                continue
        keys = [("field", clock.field), ("date", clock.date), ("nanoseconds", clock.nanoseconds)]
        named = ", ".join("%s: %s" % (key, quoted(value)) for key, value in keys if value)
        key = "{%s%s}%s" % (named, unit, comment)
        return TableClock(key, fields, times)
    frames = [n for n in _rising(values) if set(words.split(n)) & words.FRAMES]
    named = "field: %s, " % quoted(frames[0]) if frames else ""
    key = "{%srate: }  # %s%s: give the rows per second [Hz]"
    key %= named, MARK, lost or "no column is a time"
    return TableClock(key, tuple(frames[:1]), np.arange(len(next(iter(columns.values()))), dtype=float))


def _clocks(
    columns: Columns, numbers: Mapping[str, Array], units: Mapping[str, str]
) -> Iterator[Tuple[Clock, str]]:
    """Clocks that a table may have, the likeliest first, and the rest of their keys."""
    names = list(columns)
    for seconds in names:
        for end, rest in (("secs", "nsecs"), ("sec", "nanosec"), ("sec", "nsec"), ("s", "ns")):
            other = seconds[: -len(end)] + rest if seconds.endswith(end) else ""
            if other in numbers and seconds in numbers:
                yield Clock(field=seconds, unit="s", nanoseconds=other), ", unit: s"
    likely = [(_time_worth(name), -names.index(name), name) for name in names]
    for worth, _, name in sorted(likely, reverse=True):
        if worth <= 0:
            continue
        if name in numbers:
            values = numbers[name][np.isfinite(numbers[name])]
            steps = np.diff(values)
            still = len(values) < 2 or (np.ptp(values) <= 0 and values[0] < 1e8) or (steps >= 0).mean() < 0.5
            if still and not _is_date(name):
                continue
            unit = _given_unit(name, units) or _time_unit(values)
            yield Clock(field=name, unit=unit), ", unit: %s" % unit
        elif columns[name].dtype == object:
            dates = [n for n in names if _is_date(n) and n != name]
            alone = not dates or re.search(r"\d[-/.]\d+[-/.]\d", str(next(filter(None, columns[name]), "")))
            for clock in (Clock(field=name, date="" if alone else dates[0]), Clock(field=name)):
                yield clock, ""
                for form in instants.formats(columns, clock, name):
                    yield replace(clock, format=form), ', format: "%s"' % form
    for name in _rising(numbers):
        if not set(words.split(name)) & (words.FRAMES | words.MOTION) and not words.axis(name)[0]:
            unit = _time_unit(numbers[name])
            yield Clock(field=name, unit=unit), ", unit: %s" % unit


def _doubt(
    columns: Columns,
    clock: Clock,
    fields: Sequence[str],
    times: Array,
    numbers: Mapping[str, Array],
    said: str,
) -> str:
    """Why a clock may be another one; empty where names, units and rate leave no doubt."""
    formats = instants.formats(columns, clock, clock.field) if clock.format else []
    if len(formats) > 1:
        return "of the formats that fit: %s" % ", ".join(formats)
    worth = _time_worth(clock.field)
    if worth <= 0:
        return "it rises, but its name suggests no time"
    likely = [n for n in numbers if n not in fields and _time_worth(n) > max(worth - CLEARLY, 0)]
    rivals = [n for n in likely if _rises(numbers[n], repeats=True)]
    if rivals:
        return "others that could be it: %s" % ", ".join(rivals)
    steps = np.diff(times[np.isfinite(times)])
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
    rate = "in %s, %.3g rows come per second" % (clock.unit, 1 / usual)
    least, most = GIVEN_RATES if said else RATES
    if not clock.unit or (least < 1 / usual < most and (said or not _are_ticks(clock, numbers))):
        return ""
    return rate if said else "no unit is given; " + rate


def _are_ticks(clock: Clock, numbers: Mapping[str, Array]) -> bool:
    """Whether times are whole numbers that may count any ticks, because they do not count from 1970."""
    values = numbers[clock.field][np.isfinite(numbers[clock.field])]
    is_whole = not clock.nanoseconds and not (values % 1).any()
    return bool(is_whole and instants.since_1970(values[0]) != clock.unit)


def _is_date(name: str) -> bool:
    return words.split(name)[-1:] == ["date"] or words.split(name)[:1] == ["date"]


def _time_worth(name: str) -> float:
    """How likely a name stands for the time of the samples."""
    found = words.split(name)
    if not set(found) & words.TIME:
        return 0.0
    unlike = len(set(found) & words.OTHER_TIMES) + 0.5 * bool({"dt", "interval"} & set(found))
    return 3.0 - 0.2 * len(found) - unlike - 2.5 * (found == ["date"])


def _rising(numbers: Mapping[str, Array]) -> List[str]:
    """Columns that rise all the time."""
    return [name for name, values in numbers.items() if _rises(values)]


def _rises(values: Array, repeats: bool = False) -> bool:
    """Whether numbers rise all the time; repeats: or stay, as the stamp of a pose does until the next."""
    if len(values) < 2 or not np.isfinite(values).all():
        return False
    steps = np.diff(values)
    return bool(((steps >= 0) if repeats else (steps > 0)).mean() > 0.95 and np.ptp(values) > 0)


def _given_unit(name: str, units: Mapping[str, str]) -> str:
    """The unit that the file gives a time, or its own name: millis, micros; empty without one."""
    named = units.get(name, "") or words.unit("".join(words.split(name)[-1:]))
    return named if named in TIMES else ""


def _time_unit(values: Array) -> str:
    """By its size if it is a time since 1970, or its steps."""
    steps = np.diff(values)
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    if instants.first_day(values) and step < MAX_PERIOD / 86400:
        return "days"
    since = instants.since_1970(values[0])
    if since:
        return since
    return "s" if step <= 1 else "ms" if step < 1000 else "us" if step < 1e6 else "ns"


def quoted(name: str) -> str:
    """A name as YAML takes it for text."""
    plain = re.fullmatch(r"[A-Za-z_][\w.]*", name) and name not in ("off", "on", "yes", "no", "y", "n")
    return name if plain else '"%s"' % name.replace("\\", "\\\\").replace('"', '\\"')
