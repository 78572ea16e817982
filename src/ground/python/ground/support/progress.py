"""Progress of long work: its stages, how much of each is done, and how a program shows that.

work = Work(print)
with work.stage("reading", len(paths)):
    for path in paths:
        read(path)
        work.step()
"""

import contextlib
import json
import re
import sys
import time
from dataclasses import asdict, dataclass
from typing import Any, Callable, Dict, Iterable, Iterator, List, Optional, TextIO, TypeVar, Union

HOWS = ("bar", "lines", "json", "off")
QUIET = 1.0  # time until the first line [s]
INTERVAL = 5.0  # least time between lines [s]
JSON_INTERVAL = 0.5  # least time between reports of a stage in JSON [s]
# What moves the cursor, colours or reorders text on a terminal; lines and tabs stay.
_CONTROLS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")

_T = TypeVar("_T")


@dataclass
class Report:
    """State of the work. As text it is a sentence."""

    what: str  #: stage
    done: int  #: units of the stage that are done
    of: int  #: number of units of the stage
    note: str = ""  #: what was found since the last report

    def __str__(self) -> str:
        stage = "%s, %d of %d" % (self.what, self.done, self.of) if self.of > 1 else self.what
        return self.note or stage


Listener = Callable[[Report], None]


class Work:
    """Work in stages. A function of a Report is called when a stage begins, a unit is done or something
    is noted, from the thread in which that happens."""

    def __init__(self, listener: Optional[Listener] = None) -> None:
        self._listener = listener
        self._open: List[Report] = []  # stages that have begun, the innermost last

    @classmethod
    def of(cls, progress: "Progress") -> "Work":
        """The Work itself, or new Work that a function hears of."""
        return progress if isinstance(progress, Work) else cls(progress)

    @contextlib.contextmanager
    def stage(self, what: str, units: int = 1) -> Iterator[None]:
        """Wraps a block that does a stage of so many units."""
        self._open.append(Report(what, 0, units))
        self._tell()
        try:
            yield
        finally:
            self._open.pop()

    def step(self, units: int = 1) -> None:
        """Counts units of the innermost stage as done."""
        if self._open:
            stage = self._open[-1]
            stage.done += units
            stage.of = max(stage.of, stage.done)
            self._tell()

    def reach(self, done: int) -> None:
        """Counts units of the stage as done, up to a number of them."""
        if self._open and done > self._open[-1].done:
            self.step(done - self._open[-1].done)

    def each(self, items: Iterable[_T]) -> Iterator[_T]:
        """The items; each is a unit, done when the next one is asked for."""
        for item in items:
            yield item
            self.step()

    def more(self, units: int) -> None:
        """Corrects the number of units that are left in the stage."""
        if self._open:
            self._open[-1].of = self._open[-1].done + units

    def note(self, text: str) -> None:
        """Tells what was found."""
        self._tell(text)

    def quiet(self) -> "Work":
        """Work of which this one's listener hears the stages, but no notes."""
        return Work(lambda report: None if report.note or not self._listener else self._listener(report))

    def _tell(self, note: str = "") -> None:
        if self._listener:
            stage = self._open[-1] if self._open else Report("", 0, 1)
            self._listener(Report(stage.what, stage.done, stage.of, note))


Progress = Union[None, Listener, Work]  # what functions take that can be told of


def _lines(name: str) -> Listener:
    """One line in several seconds."""
    due = time.monotonic() + QUIET

    def tell(report: Report) -> None:
        nonlocal due
        if time.monotonic() >= due and report.done < report.of:
            due = time.monotonic() + INTERVAL
            print(harmless("%s: %s" % (name, report)), file=sys.stderr, flush=True)

    return tell


def _json() -> Listener:
    """One JSON object a line for other programs: the fields of a Report."""
    what, due = "", 0.0

    def tell(report: Report) -> None:
        nonlocal what, due
        if report.note or report.what != what or time.monotonic() >= due:
            what, due = report.what, time.monotonic() + JSON_INTERVAL
            print(json.dumps({"progress": asdict(report)}), file=sys.stderr, flush=True)

    return tell


class _Bar:
    """A bar of tqdm for each stage, at the bottom of a terminal."""

    def __init__(self, name: str) -> None:
        from tqdm import tqdm

        tqdm.monitor_interval = 0  # no thread
        self.name, self._new, self._what = name, tqdm, ""
        self._bar: Any = None

    def __call__(self, report: Report) -> None:
        if report.note:
            say("%s: %s" % (self.name, report.note), sys.stderr)
        elif report.what != self._what or self._bar is None:
            self.close()
            self._what = report.what
            options = {"file": sys.stderr, "leave": False, "dynamic_ncols": True}
            self._bar = self._new(total=report.of, desc=harmless(report.what), **options)
        else:
            self._bar.total = report.of
            self._bar.update(report.done - self._bar.n)

    def close(self) -> None:
        """Removes the bar."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None


def harmless(text: str) -> str:
    """Text for a terminal: a control character, which names in files may have, is shown as its code."""
    return _CONTROLS.sub(lambda found: found.group().encode("unicode_escape").decode(), text)


def say(text: str, stream: Optional[TextIO] = None) -> None:
    """Prints a line at once, above a bar if there is one."""
    text = harmless(text)
    bars = sys.modules.get("tqdm")
    if bars:
        bars.tqdm.write(text, file=stream or sys.stdout)
        (stream or sys.stdout).flush()
    else:
        print(text, file=stream, flush=True)


@contextlib.contextmanager
def shown(name: str, how: Optional[str] = None) -> Iterator[Work]:
    """The Work of a program, shown on standard error. how: one of HOWS; None: a bar on a terminal, lines
    elsewhere."""
    how = how or ("bar" if sys.stderr.isatty() else "lines")
    others: Dict[str, Optional[Listener]] = {"lines": _lines(name), "json": _json(), "off": None}
    if how in others:
        yield Work(others[how])
        return
    bar = _Bar(name)
    try:
        yield Work(bar)
    finally:
        bar.close()
