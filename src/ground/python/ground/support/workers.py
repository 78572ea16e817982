"""Parallel work on all cores of this computer."""

import os
import signal
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Callable, Iterable, Iterator, Optional, TypeVar

from ground.support.errors import GroundError

_T = TypeVar("_T")
_R = TypeVar("_R")


class Workers:
    """A pool of workers; use it in a with statement. processes: instead of threads, for work that holds the
    interpreter; then functions must be defined in modules, and items and results must be picklable."""

    def __init__(self, processes: bool = False, count: Optional[int] = None) -> None:
        count = count or len(os.sched_getaffinity(0))
        self._pool: Executor = (
            ProcessPoolExecutor(count, initializer=_end_quietly) if processes else ThreadPoolExecutor(count)
        )

    def __enter__(self) -> "Workers":
        return self

    def __exit__(self, *_: Any) -> None:
        self._pool.shutdown()

    def map(self, work: Callable[[_T], _R], items: Iterable[_T]) -> Iterator[_R]:
        """Yields work(item) in the order of the items; an exception of one is raised in its place."""
        try:
            yield from self._pool.map(work, items)
        except BrokenProcessPool:
            raise GroundError("a process was ended from outside, perhaps for lack of memory")


def _end_quietly() -> None:
    """Lets Ctrl-C end this process without a word; its parent says what there is to say."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
