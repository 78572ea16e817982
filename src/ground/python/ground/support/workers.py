"""Parallel work on all cores of this computer."""

import multiprocessing
import os
import signal
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Callable, Iterable, Iterator, Optional, TypeVar

from ground.support.errors import GroundError

_T = TypeVar("_T")
_R = TypeVar("_R")


class Workers:
    """A pool of workers, which end with each use of `map`. processes: instead of threads, for work that holds
    the interpreter; then functions must be defined in modules, and items and results must be picklable. Where
    the system does not fork processes (macOS, Windows), each would run the user's script again, so that
    these are threads, too. count: of workers; by default one for each core that this process may use."""

    def __init__(self, processes: bool = False, count: Optional[int] = None) -> None:
        allowed = getattr(os, "sched_getaffinity", None)  # on Linux
        self._count = count or (len(allowed(0)) if allowed else os.cpu_count() or 1)
        self._forks = processes and multiprocessing.get_start_method() == "fork"

    def _pool(self) -> Executor:
        if self._forks:
            return ProcessPoolExecutor(self._count, initializer=_end_quietly)
        return ThreadPoolExecutor(self._count)

    def map(self, work: Callable[[_T], _R], items: Iterable[_T]) -> Iterator[_R]:
        """Yields work(item) in the order of the items; an exception of one is raised in its place."""
        try:
            with self._pool() as pool:
                yield from pool.map(work, items)
        except BrokenProcessPool:
            raise GroundError("a worker process was killed, perhaps for lack of memory")


def _end_quietly() -> None:
    """Lets Ctrl-C end this process silently; its parent says what there is to say."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
