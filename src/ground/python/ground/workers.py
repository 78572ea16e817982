"""Parallel work on all cores, or on the machines of a Dask cluster."""

import copyreg
import os
import signal
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any, Callable, Dict, Iterable, Iterator, Optional, Sequence, Tuple, Type, TypeVar

from ground import _core
from ground.command_line import option
from ground.errors import GroundError

_T = TypeVar("_T")
_R = TypeVar("_R")

RETRIES = 3  # repetitions of a piece of work that failed or whose worker died
PATIENCE = 10  # timeout of a scheduler [s]


@dataclass(frozen=True)
class Scheduled:
    """Where work is done."""

    scheduler: Optional[str] = option(
        None,
        "Dask scheduler whose cluster does the work, in a network you trust (default: all cores here)",
        metavar="tcp://HOST:PORT",
    )


class Workers:
    """A pool of workers; use it in a with statement.

    scheduler: address of a Dask scheduler, None for this computer; its workers need this package (start
    them where setup.bash was sourced), and whoever can reach the scheduler can run code here. processes:
    uses processes of this computer instead of threads, for work that holds the interpreter. With
    processes, and on a cluster, functions must be defined in modules, and items and results must be
    picklable. modules: files that a cluster's workers need besides this package. Raises GroundError when
    the scheduler does not answer.
    """

    def __init__(
        self,
        scheduler: Optional[str] = None,
        processes: bool = False,
        count: Optional[int] = None,
        modules: Sequence[str] = (),
    ) -> None:
        count = count or len(os.sched_getaffinity(0))
        self.is_cluster = scheduler is not None  # whether the work is done elsewhere
        self._pool: Any
        if scheduler:
            self._pool = _connect(scheduler)
            for path in modules:
                self._pool.upload_file(path)
        elif processes:
            self._pool = ProcessPoolExecutor(count, initializer=_end_quietly)
        else:
            self._pool = ThreadPoolExecutor(count)

    def __enter__(self) -> "Workers":
        return self

    def __exit__(self, *_: Any) -> None:
        self._pool.close() if self.is_cluster else self._pool.shutdown()

    def map(self, work: Callable[[_T], _R], items: Iterable[_T]) -> Iterator[_R]:
        """Yields work(item) in the order of the items; an exception of one is raised in its place."""
        if self.is_cluster:
            every = list(items)
            held = self._pool.scatter(work, broadcast=True)  # once, not with each item
            futures = self._pool.map(_call, [held] * len(every), every, pure=False, retries=RETRIES)
            try:
                yield from (future.result() for future in futures)
            finally:
                self._pool.cancel(futures)
            return
        try:
            yield from self._pool.map(work, items)
        except BrokenProcessPool:
            raise GroundError("a process was ended from outside, perhaps for lack of memory")


def _call(work: Callable[[_T], _R], item: _T) -> _R:
    return work(item)


def _end_quietly() -> None:
    """Lets Ctrl-C end this process without a word; its parent says what there is to say."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _connect(address: str) -> Any:
    try:
        from distributed import Client

        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except ImportError:
        raise GroundError(
            "Dask is missing: install python3-distributed (Debian) or distributed from PyPI"
        )
    except (OSError, ValueError, TypeError) as error:
        raise GroundError("%s: no Dask scheduler answers (%s)" % (address, error))
    if not client.scheduler_info()["workers"]:
        client.close()
        raise GroundError("%s: the scheduler has no workers" % address)
    return client


def _restore(kind: Type[_T], values: Dict[str, Any]) -> _T:
    made = kind()
    for name, value in values.items():
        setattr(made, name, value)
    return made


def _reduce(params: object) -> Tuple[Callable[..., Any], Tuple[Any, ...]]:
    kind = type(params)
    fields = [(name, getattr(kind, name)) for name in dir(kind)]  # inherited ones, too
    names = [name for name, value in fields if isinstance(value, property) and value.fset]
    return _restore, (kind, {name: getattr(params, name) for name in names})


# The core's parameter structs are pickled by their fields.
for _kind in (
    _core.MocapParams,
    _core.ReferenceParams,
    _core.ControllerChoice,
    _core.LifecycleParams,
    _core.RoomPlan,
    _core.TrackingParams,
):
    copyreg.pickle(_kind, _reduce)
