"""Parallel work on all cores of this computer."""

import multiprocessing
import os
import signal
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Callable, Iterable, Iterator, List, Optional, Tuple, TypeVar

from ground.support.errors import GroundError

_T = TypeVar("_T")
_R = TypeVar("_R")


class Workers:
    """A pool of workers, which end with each use of `map`. processes: instead of threads, for work that holds
    the interpreter; then results must be picklable. Where the system does not fork processes (macOS,
    Windows), each would run the user's script again, so that these are threads, too. count: of workers; by
    default one for each core that this process may use."""

    def __init__(self, processes: bool = False, count: Optional[int] = None) -> None:
        allowed = getattr(os, "sched_getaffinity", None)  # on Linux
        self._count = count or (len(allowed(0)) if allowed else os.cpu_count() or 1)
        self._forks = processes and multiprocessing.get_start_method() == "fork"

    def map(self, work: Callable[[_T], _R], items: Iterable[_T]) -> Iterator[_R]:
        """Yields work(item) in the order of the items; an exception of one is raised in its place."""
        if not self._forks:
            with ThreadPoolExecutor(self._count) as threads:
                yield from threads.map(work, items)
            return
        # A forked process has the work. Items that were sent would fill a pipe that a killed worker leaves
        # unread, and the pool would wait for it forever.
        given = list(items)
        try:
            with ProcessPoolExecutor(self._count, initializer=_begin, initargs=(work, given)) as processes:
                yield from processes.map(_done, range(len(given)))
        except BrokenProcessPool:
            raise GroundError("a worker process was killed, perhaps for lack of memory")


_work: Tuple[Callable[[Any], Any], List[Any]]  # of a worker process, and its items


def _begin(work: Callable[[Any], Any], given: List[Any]) -> None:
    """Keeps the work of a process. Ctrl-C ends it silently; its parent says what there is to say."""
    global _work
    _work = work, given
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _done(i: int) -> Any:
    work, given = _work
    return work(given[i])
