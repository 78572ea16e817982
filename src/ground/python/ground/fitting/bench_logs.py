"""Logs of a load cell on a thrust bench: each pulse of a thruster is a measured force.

A log has columns of time, force and command. A pulse is a stretch of one command; its force is the median of
the second half, minus the force without command before and after. Rows whose command is the same all along
have no pulse.
"""

import os
import re
from dataclasses import dataclass
from typing import Iterator, List, Optional, Sequence, Tuple, TypeVar

import numpy as np
from scipy import stats

from ground.reading import containers
from ground.support.annotations import Array, Indices
from ground.support.errors import GroundError

#: Newtons in a unit.
NEWTONS = {"N": 1.0, "mN": 1e-3, "g": 9.80665e-3, "kg": 9.80665, "lbf": 4.4482216}
UNITS = {"newton": "N", "newtons": "N", "gram": "g", "grams": "g", "gf": "g", "kgf": "kg"}
SECONDS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
TIME = re.compile(r"^(t|time|stamp|timestamp|elapsed|seconds|secs?)$", re.I)
FORCE = re.compile(r"force|thrust|weight|load|cell|gram|newton|^(f|g|N)$", re.I)
COMMAND = re.compile(r"mask|bits|command|cmd|input|pwm|throttle|duty|valve|switch|level|esc|^(u|on)$", re.I)
MASK = re.compile(r"mask|bits", re.I)
STILL = 0.1  # change within the second half of a stretch, relative to that in the whole, that is too much
MIN_READINGS = 4  # readings in half of a stretch
SHARES = (0.1, 0.5, 0.9)  # shares of the force of a pulse whose times are measured
_Values = TypeVar("_Values", float, Array)


@dataclass(frozen=True)
class BenchFormat:
    """How the files of a bench are read."""

    names: Sequence[str]  #: thrusters of the craft
    off: float = 0.0  #: value of the input that means 0
    full: float = 1.0  #: ... that means 1
    unit: Optional[str] = (
        None  #: of the forces; else N in a table, and the unit in its column's name in a log
    )
    #: thrusters at work together in all columns of a table, whose names then say nothing; or their number
    together: Optional[Sequence[str]] = None
    columns: Sequence[str] = ()  #: names of a log's columns of time, force and command

    def level(self, value: _Values) -> _Values:
        """An input, 0..1."""
        return (value - self.off) / (self.full - self.off)


@dataclass(frozen=True)
class Pulse:
    """A stretch of one command."""

    level: float  #: command, 0..1
    together: Tuple[float, ...]  #: 1 for thrusters at work, else 0
    force: float  #: [N]
    rise: Tuple[float, ...]  #: times from the command to SHARES of the force [s]; nan where they are unknown
    fall: Tuple[float, ...]  #: times from its end until SHARES of the force are left [s]


@dataclass(frozen=True)
class Log:
    """What a log has."""

    pulses: List[Pulse]
    lost: int  #: pulses whose force is not known
    readings: float  #: median time between different readings of the scale [s]
    step: float  #: median time between rows [s]


@dataclass(frozen=True)
class Timing:
    """How the measured force follows commands: thruster and scale together."""

    rise: Tuple[float, ...]  #: median times to SHARES of a pulse's force [s]
    fall: Tuple[float, ...]
    longer: float  #: how much longer half of the force lasts than the command [s]
    longer_ci95: Tuple[float, float]
    readings: float  #: median time between different readings while the force changes [s]

    def lines(self) -> Iterator[str]:
        """What is known of it, in words."""
        yield "the scale shows 10, 50, 90%% of a force %s s after a command, and %s s after its end" % (
            ", ".join("%.2f" % t for t in self.rise),
            ", ".join("%.2f" % t for t in self.fall[::-1]),
        )
        yield (
            "that is thruster and scale (a new reading every %.2g s) together: the limit for a thruster"
            % self.readings
        )
        low, high = self.longer_ci95
        differ = (
            "no sign that it opens and closes at different speeds"
            if low < 0 < high
            else ("%s is slower" % ("closing" if self.longer > 0 else "opening"))
        )
        yield "a force lasts %.3f s longer than its command [%.3f, %.3f]: %s" % (
            self.longer,
            low,
            high,
            differ,
        )


def is_log(header: Sequence[str]) -> bool:
    """Whether a table with these columns is a log: it has a time."""
    return any(TIME.match(_words(name)[0]) for name in header if _words(name))


def read(path: str, form: BenchFormat) -> Log:
    """The pulses in a log. GroundError where it has none."""
    with containers.Tables([path]) as tables:
        (topic,) = tables.topics
        table = tables.table(topic)
    numeric = containers.numbers(table)
    time, force, commands = _columns(path, numeric, form)
    newtons = NEWTONS[form.unit or _unit(path, force)]
    rows = containers.values(table, [time, force, *commands], path)
    levels, together = _commands(path, rows[:, 2:], commands, form)
    known = np.isfinite(rows[:, :2]).all(axis=1) & np.isfinite(levels)
    rows, levels, together = rows[known], levels[known], together[known]
    seconds = rows[:, 0] * next((SECONDS[w] for w in _words(time)[1:] if w in SECONDS), 1.0)
    if len(seconds) < 2 * MIN_READINGS or (np.diff(seconds) < 0).any():
        raise GroundError("%s: the times in column %s do not rise from row to row" % (path, time))
    each = list(_pulses(seconds, newtons * rows[:, 1], levels, together))
    found = [pulse for pulse in each if pulse]
    if not found:
        raise GroundError(
            "%s: no pulse in it: the command in column %s must be off, then held until the force is steady, "
            "then off again" % (path, ", ".join(commands))
        )
    changed = np.flatnonzero(np.diff(rows[:, 1]) != 0)
    readings = float(np.median(np.diff(seconds[changed]))) if len(changed) > 2 else float("nan")
    return Log(found, len(each) - len(found), readings, float(np.median(np.diff(seconds))))


def timing(logs: Sequence[Log]) -> Optional[Timing]:
    """How the force follows the commands, over the pulses of logs; None where too few tell it."""
    times = np.array([[*p.rise, *p.fall] for log in logs for p in log.pulses])
    times = times[np.isfinite(times).all(axis=1)]
    if len(times) < 3:
        return None
    middle = len(SHARES) // 2
    longer = times[:, len(SHARES) + middle] - times[:, middle]
    step = float(np.median([log.step for log in logs]))
    scatter = stats.t.ppf(0.975, len(longer) - 1) * longer.std(ddof=1) / np.sqrt(len(longer))
    reach = float(np.hypot(scatter, 1.96 * step / np.sqrt(6)))  # samples may keep step with the pulses
    mean, median = float(longer.mean()), np.median(times, axis=0)
    return Timing(
        tuple(map(float, median[: len(SHARES)])),
        tuple(map(float, median[len(SHARES) :])),
        mean,
        (mean - reach, mean + reach),
        float(np.nanmedian([log.readings for log in logs])),
    )


def _words(name: str) -> List[str]:
    return re.findall(r"[A-Za-z]+", name)


def _unit(path: str, column: str) -> str:
    """The unit of force that a column's name has. GroundError for none."""
    words = [UNITS.get(word.lower(), word) for word in _words(column)]
    found = [word for word in words if word in NEWTONS]
    if not found:
        known = ", ".join(NEWTONS)
        raise GroundError(
            "%s: the unit of column %s is not known; give it with --unit (%s)" % (path, column, known)
        )
    return found[-1]


def _columns(path: str, numeric: Sequence[str], form: BenchFormat) -> Tuple[str, str, List[str]]:
    """The columns of time, force and command. GroundError where they are not clear."""
    given = form.columns
    if given:
        missing = [name for name in given if name not in numeric]
        if missing:
            raise GroundError(
                "%s: no column of numbers is named %s; there are %s"
                % (path, ", ".join(missing), ", ".join(numeric))
            )
        return given[0], given[1], [given[2]]
    times = [n for n in numeric if TIME.match((_words(n) or [""])[0])]
    rest = [n for n in numeric if n not in times]
    named = [n for n in rest if n in form.names]
    commands = named or [n for n in rest if _is(COMMAND, n)]
    forces = [n for n in rest if n not in commands and _is(FORCE, n)]
    if not (times and len(forces) == 1 and (named or len(commands) == 1)):
        raise GroundError(
            "%s: a log of a load cell needs one column each of time, force and command (found: %s; %s; %s); "
            "name them with --log-columns TIME FORCE COMMAND"
            % (path, *(", ".join(found) or "none" for found in (times, forces, commands)))
        )
    return times[0], forces[0], commands


def _is(form: "re.Pattern[str]", name: str) -> bool:
    return any(form.search(word) for word in _words(name))


def _commands(path: str, values: Array, columns: Sequence[str], form: BenchFormat) -> Tuple[Array, Array]:
    """Level of each row (n,), 0..1, and which thrusters are at work (n, m). GroundError where that is not
    known."""
    names = list(form.names)
    if len(columns) == 1 and columns[0] not in names and _is(MASK, columns[0]):
        bits = np.nan_to_num(values[:, 0]).astype(np.int64)
        if bits.min() < 0 or bits.max() >= 1 << len(names):
            raise GroundError(
                "%s: %s has the value %d, which names a thruster that the model does not have"
                % (path, columns[0], bits.max())
            )
        together = (bits[:, None] >> np.arange(len(names)) & 1).astype(float)
        _check_name(path, together, names)
        return np.where(np.isfinite(values[:, 0]), together.max(axis=1), np.nan), together
    levels = form.level(values)
    if np.nanmin(levels) < -1e-6 or np.nanmax(levels) > 1 + 1e-6:
        raise GroundError(
            "%s: the command goes from %g to %g: define 0 and 1 with --inputs"
            % (path, np.nanmin(values), np.nanmax(values))
        )
    if columns[0] in names:
        together = np.zeros((len(values), len(names)))
        together[:, [names.index(name) for name in columns]] = levels > 0
        return levels.max(axis=1), together
    own = _named(path, names)
    if len(own) != 1:
        raise GroundError(
            "%s: its thruster is not known: name the file, or its columns of commands, after %s"
            % (path, ", ".join(names))
        )
    together = np.zeros((len(values), len(names)))
    together[:, names.index(own[0])] = levels[:, 0] > 0
    return levels[:, 0], together


def _named(path: str, names: Sequence[str]) -> List[str]:
    """The thrusters that a file is named after."""
    file = os.path.basename(path).lower().replace("-", "_")
    form = r"(?<![a-z0-9])%s(?![a-z0-9])"
    return [name for name in names if re.search(form % re.escape(name.lower()), file)]


def _check_name(path: str, together: Array, names: Sequence[str]) -> None:
    """GroundError where a file is named after another thruster than its bits say."""
    at_work = [name for name, any_on in zip(names, together.any(axis=0)) if any_on]
    own = _named(path, names)
    if own and at_work and not set(own) & set(at_work):
        raise GroundError(
            "%s: it is named after %s, but its bits say %s, in the model's thruster order; "
            "correct one" % (path, own[0], ", ".join(at_work))
        )


@dataclass(frozen=True)
class _Stretches:
    """Stretches of one command each, in order."""

    times: Array
    forces: Array
    levels: Array
    together: Array
    starts: Indices
    ends: Indices

    def part(self, number: int) -> slice:
        """The rows of a stretch."""
        return slice(int(self.starts[number]), int(self.ends[number]))

    def is_off(self, number: int) -> bool:
        """Whether there is such a stretch, and it is without command."""
        return 0 <= number < len(self.starts) and bool(self.levels[self.starts[number]] <= 0)

    def steady(self, number: int, size: float) -> Tuple[float, float]:
        """The median force of the second half of a stretch, and of its last quarter; nan where it is too
        short or still changes. size: of all forces."""
        part = self.part(number)
        half = self.forces[(part.start + part.stop) // 2 : part.stop]
        if len(half) < MIN_READINGS:
            return float("nan"), float("nan")
        early, late = (float(np.median(p)) for p in np.array_split(half, 2))
        changed = abs(late - float(self.forces[part.start]))
        if abs(late - early) > STILL * max(changed, STILL * size):
            return float("nan"), float("nan")
        return float(np.median(half)), late

    def pulse(self, number: int, size: float) -> Optional[Pulse]:
        """The pulse of a stretch with a command; None where its force is not known."""
        beside = [self.steady(n, size)[0] for n in (number - 1, number + 1) if self.is_off(n)]
        zeros = [zero for zero in beside if np.isfinite(zero)]
        shown, late = self.steady(number, size)
        if not zeros or not np.isfinite(shown):
            return None
        zero, part = float(np.mean(zeros)), self.part(number)
        quarter = len(self.forces[part]) // 4
        first = float(np.median(self.forces[part.start + quarter : part.start + 2 * quarter + 1])) - zero
        rise = _times(self.times[part] - self.times[part.start], self.forces[part] - zero, first, True)
        fall: Tuple[float, ...] = (float("nan"),) * len(SHARES)
        if self.is_off(number + 1) and np.isfinite(after := self.steady(number + 1, size)[0]):
            part = self.part(number + 1)
            fall = _times(
                self.times[part] - self.times[part.start], self.forces[part] - after, late - after, False
            )
        start = self.starts[number]
        at_work = tuple(map(float, self.together[start]))
        return Pulse(float(self.levels[start]), at_work, shown - zero, rise, fall)


def _pulses(times: Array, forces: Array, levels: Array, together: Array) -> Iterator[Optional[Pulse]]:
    """Stretches of one command; None for one whose force is not known."""
    kinds = np.column_stack([levels, together * (levels > 0)[:, None]])
    starts = np.flatnonzero(np.r_[True, (np.diff(kinds, axis=0) != 0).any(axis=1)])
    found = _Stretches(times, forces, levels, together, starts, np.r_[starts[1:], len(times)])
    size = float(np.ptp(forces))
    for number in range(len(starts)):
        if not found.is_off(number):
            yield found.pulse(number, size)


def _times(times: Array, forces: Array, size: float, rises: bool) -> Tuple[float, ...]:
    """When a force reaches SHARES of a size for the first time [s]; nan where it does not."""
    found = []
    for share in SHARES:
        passed = (forces >= share * size) if rises == (size > 0) else (forces <= share * size)
        at = int(np.argmax(passed))
        found.append(float((times[at] + times[max(0, at - 1)]) / 2) if passed.any() else float("nan"))
    return tuple(found)
