"""Progress of long work: what is being done, how much of how much, and the time left.

Work is a sequence of stages, each of units of about equal cost. A stage may be expected before it
begins, with its number of units and what a unit usually costs. The time left is the number of units
left times their measured cost; for units of which none was measured yet, their usual cost is scaled
by how much the units so far took longer than usual. Who listens, such as a terminal, is not known
here.

    work = Work(print)
    work.expect("reading", 2, 0.1)
    work.expect("fitting", 10, 0.5)
    with work.stage("reading"):
        for path in paths:
            read(path)
            work.step()
"""

import contextlib
import math
import threading
import time
from dataclasses import dataclass
from typing import Callable, Dict, Iterable, Iterator, List, Optional, TypeVar, Union

FEW = 0.1  # share of a stage's units that the usual cost counts for at most
USUAL = 1.0  # time that has to be measured until it counts as much as the usual cost [s]
FIRST = 1.0  # time without a forecast [s]
OVERDUE = 0.2  # least time left of a unit that takes longer than expected, in times it took so far
SETTLING = 2.0  # time within which the time left follows an estimate that falls [s]
MAX_RISE = 0.3  # largest rise of the time left [s/s]: it hardly ever runs backwards
CORRECTION = 15.0  # time within which it follows an estimate that was far too low [s]

_T = TypeVar("_T")


@dataclass(frozen=True)
class Report:
    """State of the work. As text it is a sentence."""

    what: str  #: stage
    done: int  #: units of the stage that are done
    of: int  #: number of units of the stage
    share: float  #: share of the whole work that is done, 0..1
    left: Optional[float]  #: time left for the whole work [s]; None: not known yet
    at_most: bool = False  #: whether the work may end earlier than that
    note: str = ""  #: what was found since the last report

    def __str__(self) -> str:
        return self.note or "; ".join(filter(None, (self.stage, self.forecast)))

    @property
    def stage(self) -> str:
        """The stage and its units, in words."""
        return "%s, %d of %d" % (self.what, self.done, self.of) if self.of > 1 else self.what

    @property
    def forecast(self) -> str:
        """Share and time left, in words; empty while the time left is not known."""
        if self.left is None:
            return ""
        how = "at most" if self.at_most else "about"
        return "%.0f%% done, %s %s left" % (math.floor(100 * self.share), how, duration(self.left))


Listener = Callable[[Report], None]


def duration(seconds: float) -> str:
    """A time in words, as precise as an estimate can be."""
    if seconds < 60:
        step = 1 if seconds < 10 else 5
        return "%d s" % (step * max(1, math.ceil(seconds / step)))
    minutes = math.ceil(seconds / 60 - 1e-9)
    return "%d min" % minutes if minutes < 60 else "%d h %d min" % divmod(minutes, 60)


class _Stage:
    """A stage, expected or begun."""

    def __init__(self, what: str) -> None:
        self.what = what
        self.units: Optional[int] = 1  # None: not known yet
        self.cost = 0.0  # usual cost of a unit [s]
        self.at_most = False
        self.scaled = True  # whether the usual cost is multiplied by a scale
        self.done = 0
        self.begun = 1  # units that are done together and have begun
        self.spent = 0.0  # time spent in it [s]
        self.measured = 0.0  # `spent` when its last unit was done [s]
        self.ended = False

    def rate(self, scale: float) -> float:
        """Cost of a unit [s]; scale: of usual costs."""
        usual = self.cost * (scale if self.scaled else 1.0)
        most = max(1.0, FEW * (self.units or 0))
        weight = min(most, max(1.0, USUAL / usual)) if usual > 0 else 0.0  # units that it counts for
        return (self.measured + weight * usual) / max(1e-9, self.done + weight)

    def left(self, scale: float) -> float:
        """Time left [s]."""
        units = 0 if self.ended else (self.units or 0) - self.done
        if units <= 0:
            return 0.0
        unit, running = self.rate(scale), self.spent - self.measured
        begun = min(self.begun, units)
        return (units - begun) * unit + max(begun * unit - running, OVERDUE * running)


class Work:
    """Work whose progress a listener hears of: a function of a Report, called when a stage begins, a
    unit is done or something is noted, from the thread in which that happens. clock: time [s]."""

    def __init__(
        self, listener: Optional[Listener] = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._listener = listener
        self._clock = clock
        self._lock = threading.RLock()
        self._stages: Dict[str, _Stage] = {}
        self._open: List[_Stage] = []  # stages that have begun, the innermost last
        self._began = self._counted = self._shown_at = clock()
        self._shown: Optional[float] = None  # time left in the last report [s]
        self._share = 0.0  # in the last report

    @classmethod
    def of(cls, progress: "Progress") -> "Work":
        """The Work itself, or new Work that a function hears of."""
        return progress if isinstance(progress, Work) else cls(progress)

    def expect(
        self,
        what: str,
        units: Optional[int] = 1,
        cost: float = 0.0,
        at_most: bool = False,
        scaled: bool = True,
    ) -> None:
        """Plans a stage, or plans it anew. units: None as long as their number is not known, and with it
        the time left; cost: usual cost of a unit [s]; at_most: whether there may
        be fewer units; scaled: whether the cost is that of a usual computer and usual data, to be
        scaled by what was measured of other stages."""
        with self._lock:
            stage = self._stages.setdefault(what, _Stage(what))
            stage.units, stage.cost, stage.at_most, stage.scaled = units, cost, at_most, scaled

    @contextlib.contextmanager
    def stage(self, what: str, units: Optional[int] = None) -> Iterator[None]:
        """Wraps a block that does a stage. units: how many, where that was not expected."""
        with self._within(what) as stage:
            if units is not None:
                self.more(units)
            self._tell()
            try:
                yield
            finally:
                stage.done = stage.units = stage.done or stage.units or 1
                stage.ended = True

    @contextlib.contextmanager
    def unit(self, what: str, units: int = 1) -> Iterator[None]:
        """Wraps a block that does one unit or several of an expected stage."""
        with self._within(what) as stage:
            stage.begun = units
            self._tell()
            try:
                yield
            finally:
                stage.done += units
                stage.units = max(stage.units or 0, stage.done)
                stage.ended = stage.done == stage.units

    @contextlib.contextmanager
    def _within(self, what: str) -> Iterator[_Stage]:
        """Wraps a block of a stage; its time is not counted for the stage around it."""
        with self._lock:
            self._count()
            if what not in self._stages:
                self._shown = None  # the forecast was made without it
            stage = self._stages.setdefault(what, _Stage(what))
            stage.ended = False
            self._open.append(stage)
        try:
            yield stage
        finally:
            with self._lock:
                self._count()
                stage.measured = stage.spent
                self._open.remove(stage)

    def step(self, units: int = 1) -> None:
        """Counts units of the stage as done; any thread may call it."""
        with self._lock:
            if not self._open:
                return
            self._count()
            stage = self._open[-1]
            stage.done, stage.measured = stage.done + units, stage.spent
            stage.units = max(stage.units or 0, stage.done)
        self._tell()

    def reach(self, done: int) -> None:
        """Counts units of the stage as done, up to a number of them."""
        with self._lock:
            begun = self._open[-1].done if self._open else done
            if done > begun:
                self.step(done - begun)

    def each(self, items: Iterable[_T]) -> Iterator[_T]:
        """The items; each is a unit, done when the next one is asked for."""
        for item in items:
            yield item
            self.step()

    def more(self, units: int, at_most: bool = False) -> None:
        """Corrects the number of units that are left in the stage."""
        with self._lock:
            if self._open:
                stage = self._open[-1]
                stage.units, stage.at_most = stage.done + units, at_most

    def spent(self, what: str) -> float:
        """Time that a stage has taken so far [s]."""
        with self._lock:
            self._count()
            return self._stages[what].spent if what in self._stages else 0.0

    def note(self, text: str) -> None:
        """Tells what was found."""
        self._tell(text)

    def report(self, note: str = "") -> Report:
        """The state now."""
        with self._lock:
            self._count()
            stage = self._open[-1] if self._open else _Stage("")
            left = self._follow(self._left())
            if left is not None:
                elapsed = self._counted - self._began
                self._share = max(self._share, elapsed / max(1e-9, elapsed + left))
            at_most = any(s.at_most and not s.ended for s in self._stages.values())
            units = stage.done, stage.units or stage.done
            return Report(stage.what, *units, self._share, left, at_most, note)

    def _tell(self, note: str = "") -> None:
        if self._listener:
            self._listener(self.report(note))

    def _count(self) -> None:
        """Counts the time since the last call for the innermost stage."""
        now = self._clock()
        if self._open:
            self._open[-1].spent += now - self._counted
        self._counted = now

    def _left(self) -> Optional[float]:
        """Estimate of the time left [s]; None at first, while a number of units is not known, or
        nothing is done."""
        stages = self._stages.values()
        early = self._counted - self._began < FIRST
        if early or any(s.units is None for s in stages) or not any(s.done for s in stages):
            return None
        scaled = [s for s in stages if s.scaled and s.cost > 0]
        spent = sum(s.measured for s in scaled) + USUAL
        usual = sum(s.done * s.cost for s in scaled) + USUAL
        return sum(s.left(spent / usual) for s in stages)

    def _follow(self, estimate: Optional[float]) -> Optional[float]:
        """The time left that is shown [s]: it counts down, and follows an estimate that falls within a few
        seconds, one that rises slowly."""
        now = self._counted
        passed, self._shown_at = now - self._shown_at, now
        if estimate is None or self._shown is None:
            self._shown = estimate
            return estimate
        expected = max(0.0, self._shown - passed)
        if estimate < expected:
            self._shown = estimate + (expected - estimate) * math.exp(-passed / SETTLING)
        else:
            rise = max(MAX_RISE, (estimate - self._shown) / CORRECTION) * passed
            self._shown = min(estimate, self._shown + rise)
        return self._shown


Progress = Union[None, Listener, Work]  # what functions take that can be told of
