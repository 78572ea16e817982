"""Progress of a program on standard error: a bar on a terminal, else plain lines, or JSON."""

import contextlib
import json
import sys
import threading
import time
from dataclasses import asdict
from typing import Any, Callable, Dict, Iterator, List, Optional, TextIO

from ground.progress import Report, Work

HOWS = ("bar", "lines", "json", "off")
QUIET = 1.0  # nothing is shown of work that takes less [s]
INTERVAL = 5.0  # least time between lines [s]
JSON_INTERVAL = 0.5  # least time between reports of the same stage in JSON [s]
TICK = 0.25  # time between updates of a bar [s]
Clock = Callable[[], float]


class Display:
    """Shows reports; `hear` gets those of events, `tick` one of now and then."""

    def __init__(self, name: str, stream: TextIO, clock: Clock = time.monotonic) -> None:
        """name: the program's; clock: time [s]."""
        self.name = name
        self.stream = stream
        self.clock = clock
        self.began = clock()
        self._notes: List[str] = []  # not shown yet

    def hear(self, report: Report) -> None:
        """Takes what was noted."""
        if report.note:
            self._notes.append(report.note)

    def tick(self, report: Report) -> None:
        """Shows a report, if it is time."""

    def close(self) -> None:
        """Removes what does not have to stay."""

    def _taken(self) -> List[str]:
        notes, self._notes = self._notes, []
        return notes


class Lines(Display):
    """One line in several seconds, without control characters."""

    def __init__(self, name: str, stream: TextIO, clock: Clock = time.monotonic) -> None:
        super().__init__(name, stream, clock)
        self._next = self.began + QUIET

    def tick(self, report: Report) -> None:
        """Prints a line, if it is time."""
        if self.clock() < self._next or not report.what:
            return
        self._next = self.clock() + INTERVAL
        text = "; ".join([str(report), *self._taken()])
        print("%s: %s" % (self.name, text), file=self.stream, flush=True)


class Bar(Display):
    """A bar at the bottom of a terminal, below what is printed meanwhile."""

    def __init__(self, name: str, stream: TextIO, clock: Clock = time.monotonic) -> None:
        super().__init__(name, stream, clock)
        self.lock = threading.RLock()
        self._bar: Any = None

    def tick(self, report: Report) -> None:
        """Draws the bar."""
        if self.clock() < self.began + QUIET or not report.what:
            return
        with self.lock:
            bar = self._bar = self._bar or self._new()
            for note in self._taken():
                self.clear()
                print("%s: %s" % (self.name, note), file=self.stream)
            bar.n = round(report.share, 3)
            bar.set_description_str(report.stage, refresh=False)
            bar.set_postfix_str(report.forecast, refresh=False)
            bar.refresh()

    def _new(self) -> Any:
        from tqdm import tqdm

        tqdm.monitor_interval = 0
        return tqdm(
            total=1.0,
            file=self.stream,
            bar_format="{desc} |{bar:20}|{postfix}",
            dynamic_ncols=True,
            leave=False,
        )

    def clear(self) -> None:
        """Makes room for a line of text."""
        with self.lock:
            if self._bar is not None:
                self._bar.clear()

    def close(self) -> None:
        """Removes the bar."""
        with self.lock:
            if self._bar is not None:
                self._bar.close()
            self._bar = None


class Json(Display):
    """One JSON object a line for other programs: the fields of a Report, from the beginning on."""

    def __init__(self, name: str, stream: TextIO, clock: Clock = time.monotonic) -> None:
        super().__init__(name, stream, clock)
        self._lock = threading.Lock()
        self._last: Dict[str, Any] = {"what": None}
        self._next = self.began

    def hear(self, report: Report) -> None:
        """Prints a note or a new stage at once."""
        if report.note or report.what != self._last["what"]:
            self._print(report)
        else:
            self.tick(report)

    def tick(self, report: Report) -> None:
        """Prints a report, if it is time and anything has changed."""
        if self.clock() >= self._next and asdict(report) != self._last:
            self._print(report)

    def _print(self, report: Report) -> None:
        with self._lock:
            self._next, self._last = self.clock() + JSON_INTERVAL, asdict(report)
            line = json.dumps({"progress": self._last})
            print(line, file=self.stream, flush=True)


class _Above:
    """A stream of text above a bar."""

    def __init__(self, stream: TextIO, bar: Bar) -> None:
        self._stream = stream
        self._bar = bar

    def write(self, text: str) -> int:
        """Writes text where the bar was; the bar comes back with its next update."""
        with self._bar.lock:
            self._bar.clear()
            written = self._stream.write(text)
            self._stream.flush()
            return written

    def flush(self) -> None:
        """Flushes the stream."""
        self._stream.flush()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextlib.contextmanager
def shown(name: str, how: Optional[str] = None) -> Iterator[Work]:
    """The Work of a program in a with statement, shown on standard error. name: the program's; how: one
    of HOWS, None for a bar on a terminal and lines elsewhere."""
    stream = sys.stderr
    how = how or ("bar" if stream.isatty() else "lines")
    if how == "off":
        yield Work()
        return
    display: Display = {"bar": Bar, "lines": Lines, "json": Json}[how](name, stream)
    work, ended = Work(display.hear), threading.Event()

    def update() -> None:
        while not ended.wait(TICK):
            display.tick(work.report())

    with contextlib.ExitStack() as stack:
        if isinstance(display, Bar):
            above = contextlib.redirect_stdout(_Above(sys.stdout, display))  # type: ignore[type-var]
            stack.enter_context(above)
            stack.enter_context(contextlib.redirect_stderr(_Above(stream, display)))  # type: ignore[type-var]
        thread = threading.Thread(target=update, daemon=True)
        thread.start()
        try:
            yield work
        finally:
            ended.set()
            thread.join()
            display.close()
