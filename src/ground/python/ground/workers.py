"""Parallel work on all cores, or on the machines of a Dask cluster."""

import argparse
import copyreg
import inspect
import os
import signal
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Callable, Dict, Iterable, Iterator, Optional, Sequence, Tuple, Type, TypeVar

from ground import _core
from ground.errors import GroundError

_T = TypeVar("_T")
_R = TypeVar("_R")

RETRIES = 3  # repetitions of a piece of work that failed or whose worker died
PATIENCE = 10  # timeout of a scheduler [s]


def add_scheduler_argument(parser: argparse.ArgumentParser) -> None:
    """Adds --scheduler."""
    parser.add_argument(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        help="Dask scheduler whose cluster does the work, in a network you trust (default: all cores here)",
    )


class Workers:
    """A pool of workers; use it in a with statement.

    scheduler: address of a Dask scheduler, None for this computer; its workers need this package (start
    them where setup.bash was sourced). processes: uses processes of this computer instead of threads,
    for work that holds the interpreter. With processes, and on a cluster, functions must be defined in
    modules, and items and results must be picklable. A cluster gets the data of a callable object, or of
    a functools.partial, once, not with each item. Pickles are sent over the cluster's network:
    whoever can reach the scheduler can run code here. modules: files that a cluster's workers need
    besides this package. Raises GroundError when the scheduler does not answer.
    """

    def __init__(
        self,
        scheduler: Optional[str] = None,
        processes: bool = False,
        count: Optional[int] = None,
        modules: Sequence[str] = (),
    ) -> None:
        self._client: Any = None
        self._pool: Optional[Executor] = None
        if scheduler:
            self._client = _connect(scheduler)
            for path in modules:
                self._client.upload_file(path)
        else:
            count = count or len(os.sched_getaffinity(0))
            self._pool = (
                ProcessPoolExecutor(count, initializer=_end_quietly)
                if processes
                else ThreadPoolExecutor(count)
            )

    def __enter__(self) -> "Workers":
        return self

    def __exit__(self, *_: Any) -> None:
        if self._client:
            self._client.close()
        if self._pool:
            self._pool.shutdown()

    @property
    def is_cluster(self) -> bool:
        """Whether the work is done elsewhere."""
        return self._client is not None

    def map(self, work: Callable[[_T], _R], items: Iterable[_T]) -> Iterator[_R]:
        """Yields work(item) in the order of the items; an exception of one is raised in its place."""
        if self._pool:
            try:
                yield from self._pool.map(work, items)
            except BrokenProcessPool:
                raise GroundError("a process was ended from outside, perhaps for lack of memory")
            return
        from distributed import KilledWorker

        every = list(items)
        if inspect.isfunction(work):
            futures = self._client.map(work, every, pure=False, retries=RETRIES)
        else:
            # A task of its own, which is repeated if the worker that holds its result dies.
            held = self._client.submit(_itself, work, pure=False)
            given = [held] * len(every)
            futures = self._client.map(_call, given, every, pure=False, retries=RETRIES)
        try:
            for future in futures:
                yield future.result()
        except KilledWorker as error:
            raise GroundError("a piece of work has ended several workers: %s" % error)
        except ImportError as error:
            raise GroundError("a module is missing on the workers: %s" % error)
        finally:
            self._client.cancel(futures)


def _itself(work: _T) -> _T:
    return work


def _call(work: Callable[[_T], _R], item: _T) -> _R:
    return work(item)


def _end_quietly() -> None:
    """Lets Ctrl-C end this process without a word; its parent says what there is to say."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def _connect(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError:
        raise GroundError(
            "Dask is missing: install python3-distributed (Debian) or distributed from PyPI"
        )
    try:
        client = Client(address, timeout=PATIENCE, set_as_default=False)
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
