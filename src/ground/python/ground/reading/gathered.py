"""Commands of one recording from one topic or table, or several, such as one for each thruster."""

from dataclasses import dataclass, replace
from typing import Iterator, List, Sequence, Tuple

import numpy as np

from ground.reading import commands, containers, instants
from ground.reading.containers import RECEIVED, Columns, Container
from ground.reading.mapping import CommandChannel, Commands
from ground.support.annotations import Array, Flags, Indices
from ground.support.errors import GroundError

CAME_LATE = "commands came late"
LATE = 0.05  # least delay beyond the usual one that is late [s]
TOGETHER = 0.1  # stamps of one command in several topics lie closer [shortest usual interval of a topic]
PAUSE = 12.0  # a topic that ends earlier than the others by more has stopped [usual intervals]


@dataclass(frozen=True)
class Gathered:
    """The commands of a recording, or of one of its topics or tables."""

    rows: Array  #: (n, 1 + c) stamp [s] and normalised commands
    channels: Tuple[CommandChannel, ...]
    lift: str  #: the channel of the lift fan
    delay: float  #: median time from stamp to receipt [s]; 0 where that is not known
    topic: str = ""  #: the topic or table that has them; empty: several

    @property
    def times(self) -> Array:
        """Stamps (n,) [s]."""
        return np.asarray(self.rows[:, 0])

    @property
    def interval(self) -> float:
        """Usual time between two commands [s]."""
        steps = np.diff(self.times)
        return float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0


def read(source: Container, given: Sequence[Commands], notes: List[str]) -> Gathered:
    """The commands in the topics that parts of a mapping name. notes: told what was left out or assumed.
    GroundError if they cannot be read."""
    parts = []
    for one in given:
        noted: List[str] = []
        parts.append(_part(source, one, noted))
        notes += ["%s: %s" % (one.topic, text) for text in noted] if len(given) > 1 else noted
    return parts[0] if len(parts) == 1 else _merged(source.path, parts, given[0].lift, notes)


def _part(source: Container, given: Commands, notes: List[str]) -> Gathered:
    where, columns = source.place_of(given.topic), source.table(given.topic)
    channels, lift = commands.channels_of(columns, source.topics[given.topic].kind, given, where)
    sent_at, known = instants.stamps(columns, given.time, where, notes)
    backward = instants.descends(sent_at[known])
    values, used = commands.read(columns, channels, where, given.empty, known, backward, notes)
    instants.check(columns, given.time, sent_at, used, where, values)
    sent_at = sent_at[used]
    rows = ascending(np.column_stack([containers.seconds(sent_at), values[used]]), "commands", notes)
    disorder = int((np.diff(rows[:, 0]) < 0).sum())
    if disorder:
        notes.append("stamps of the commands are out of order and were sorted (%d)" % disorder)
    notes.extend(_late(columns, used, sent_at))
    return Gathered(rows, channels, lift, delay(columns, used, sent_at), given.topic)


def _merged(path: str, parts: Sequence[Gathered], lift: str, notes: List[str]) -> Gathered:
    """The commands of several topics with a row for each time at which one of them has a new one; the others
    hold theirs. GroundError where they have no time in common."""
    for part in parts:
        if len(part.times) == 0:
            raise GroundError("%s: %s has no commands" % (path, part.topic))
    ordered = [part.rows[np.argsort(part.times, kind="stable")] for part in parts]
    begin = max(rows[0, 0] for rows in ordered)
    if begin > min(rows[-1, 0] for rows in ordered):
        spans = ["%s %.3f to %.3f s" % (p.topic, r[0, 0], r[-1, 0]) for p, r in zip(parts, ordered)]
        raise GroundError(
            "%s: the commands have no time in common: %s; are they of one run, and do their clocks agree?"
            % (path, ", ".join(spans))
        )
    room = TOGETHER * min(part.interval for part in parts)
    times = _instants([rows[:, 0] for rows in ordered], room)
    times = times[times >= begin]
    at = [np.searchsorted(rows[:, 0], times, side="right") - 1 for rows in ordered]
    values = [rows[index, 1:] for rows, index in zip(ordered, at)]
    notes.append(
        "commands of %d sources were put together: %s; each is held until its next one, and those within "
        "%.2g ms are one command" % (len(parts), ", ".join(part.topic for part in parts), 1e3 * room)
    )
    notes.extend(_stopped(parts, float(times[-1])))
    channels = tuple(channel for part in parts for channel in part.channels)
    late = float(np.median([part.delay for part in parts]))
    return Gathered(np.column_stack([times, *values]), channels, lift, late)


def _instants(times: Sequence[Array], room: float) -> Array:
    """Times of commands. Commands of different topics within room [s] of each other are one, at the last of
    their times."""
    owner = np.concatenate([np.full(len(t), number) for number, t in enumerate(times)])
    every = np.concatenate(times)
    order = np.argsort(every, kind="stable")
    found: List[float] = []
    first, seen = -np.inf, set(owner[:0].tolist())
    for at, of in zip(every[order].tolist(), owner[order].tolist()):
        if found and at - first <= room and (of not in seen or at == found[-1]):
            found[-1] = at
        else:
            found.append(at)
            first, seen = at, set()
        seen.add(of)
    return np.array(found)


def _stopped(parts: Sequence[Gathered], end: float) -> Iterator[str]:
    """Topics whose commands end before the other topics' commands."""
    for part in parts:
        last = float(part.times.max())
        if end - last > PAUSE * max(part.interval, max(other.interval for other in parts)):
            yield "%s ends %.3g s before the other commands; its last one is held" % (part.topic, end - last)


def in_order(given: Sequence[CommandChannel], gathered: Gathered) -> Gathered:
    """The same with the channels in the order of a mapping."""
    names = [channel.name for channel in gathered.channels]
    if not given or [channel.name for channel in given] == names:
        return gathered
    at = [names.index(channel.name) for channel in given]
    rows = gathered.rows[:, [0, *(1 + index for index in at)]]
    return replace(gathered, rows=rows, channels=tuple(gathered.channels[index] for index in at))


def ascending(rows: Array, what: str, notes: List[str]) -> Array:
    """Rows that begin with a time, in ascending order. If the latest rows come first, they are reversed."""
    if not instants.descends(rows[:, 0]):
        return rows
    notes.append("the latest %s come first: their order is reversed" % what)
    return np.asarray(rows[np.argsort(rows[:, 0], kind="stable")])


def delay(columns: Columns, chosen: Flags, stamps: Indices) -> float:
    """Median time from stamp to receipt [s]; 0 where that is not known."""
    if RECEIVED not in columns or not len(stamps):
        return 0.0
    return 1e-9 * float(np.median(columns[RECEIVED][chosen] - stamps))


def _late(columns: Columns, given: Flags, sent_at: Indices) -> Iterator[str]:
    """Commands that came later than others do by more than the usual interval: which time acted?"""
    if RECEIVED not in columns or len(sent_at) < 2:
        return
    delays = 1e-9 * (np.asarray(columns[RECEIVED])[given] - sent_at)
    late = delays - np.median(delays)
    interval = 1e-9 * float(np.ptp(sent_at)) / (len(sent_at) - 1)
    if (late > max(interval, LATE)).any():
        yield (
            "%d of %d " + CAME_LATE + ", by up to %.2g s after their stamps, and the craft may have acted "
            "only then: give `time: receipt` for the commands in a mapping (a file that identify info "
            "--write-mapping drafts), and compare the errors of both"
        ) % ((late > max(interval, LATE)).sum(), len(late), late.max())
