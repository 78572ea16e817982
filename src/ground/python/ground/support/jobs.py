"""Long work in processes of its own: told of as it goes on, ended at once.

A process without threads is forked before the server has any, with all recordings read; it forks a child for
each job. So a job begins in milliseconds, and a job that is ended or crashes harms nothing.
"""

import contextlib
import multiprocessing
import os
import secrets
import signal
import tempfile
import threading
import traceback
from multiprocessing.connection import Client, Connection, Listener
from typing import Any, Callable, Dict, Set, Tuple

from ground.support import errors

Tell = Callable[[str, Any], None]  # tells the server: kind, content
Work = Callable[[str, Tuple[Any, ...], Tell], None]  # does a job: kind, arguments


class Jobs:
    """Processes for long work. heard: called with the job's number, a kind and content, from a thread of its
    own: "failed" with a sentence, "ended" at last, and what `work` tells."""

    def __init__(self, work: Work, heard: Callable[[int, str, Any], None]) -> None:
        """Forks: call it before any thread begins."""
        self._folder = tempfile.mkdtemp(prefix="ground-workbench-")
        address, key = os.path.join(self._folder, "jobs"), secrets.token_bytes(16)
        self._heard, self._listener = heard, Listener(address, "AF_UNIX", authkey=key)
        self._orders, orders = multiprocessing.Pipe()
        self._last = 0
        self._pids: Dict[int, int] = {}
        self._ended: Set[int] = set()
        self._lock = threading.Lock()
        self._parent = os.fork()
        if self._parent == 0:
            self._orders.close()
            _fork_jobs(orders, address, key, work)
        orders.close()
        threading.Thread(target=self._accept, daemon=True).start()

    def begin(self, kind: str, *arguments: Any) -> int:
        """Begins a job; its number."""
        with self._lock:
            self._last += 1
            self._orders.send((self._last, kind, arguments))
            return self._last

    def end(self, number: int) -> None:
        """Ends a job at once."""
        with self._lock:
            self._ended.add(number)
            pid = self._pids.get(number)
        if pid:
            _kill(pid)

    def close(self) -> None:
        """Ends all jobs."""
        self._orders.close()
        with contextlib.suppress(OSError):
            os.waitpid(self._parent, 0)
            self._listener.close()
            os.rmdir(self._folder)

    def _accept(self) -> None:
        while True:
            with contextlib.suppress(OSError, EOFError, multiprocessing.AuthenticationError):
                job = self._listener.accept()
                threading.Thread(target=self._listen, args=(job,), daemon=True).start()

    def _listen(self, job: Connection) -> None:
        number, pid = job.recv()
        with self._lock:
            self._pids[number] = pid
            ended = number in self._ended
        if ended:
            _kill(pid)
        said = False
        with contextlib.suppress(OSError, EOFError):
            while True:
                kind, content = job.recv()
                said |= kind in ("done", "failed")
                if number not in self._ended:
                    self._heard(number, kind, content)
        with self._lock:
            self._pids.pop(number)
        if not said and number not in self._ended:
            self._heard(number, "failed", "its process ended, perhaps for lack of memory")
        self._heard(number, "ended", None)


def _kill(pid: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(pid, signal.SIGKILL)


def _fork_jobs(orders: Connection, address: str, key: bytes, work: Work) -> None:
    """The process that forks jobs, until the server closes the pipe or dies."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    children: Set[int] = set()
    with contextlib.suppress(EOFError, OSError):
        while True:
            number, kind, arguments = orders.recv()
            with contextlib.suppress(ChildProcessError):
                while True:
                    pid, _ = os.waitpid(-1, os.WNOHANG)
                    if not pid:
                        break
                    children.discard(pid)
            pid = os.fork()
            if pid == 0:
                orders.close()
                _do(number, kind, arguments, address, key, work)
            with contextlib.suppress(OSError):
                os.setpgid(pid, pid)
            children.add(pid)
    for pid in children:
        _kill(pid)
    os._exit(0)


def _do(number: int, kind: str, arguments: Tuple[Any, ...], address: str, key: bytes, work: Work) -> None:
    """A job, in its process."""
    status = 1
    try:
        os.setpgid(0, 0)
        server = Client(address, "AF_UNIX", authkey=key)
        server.send((number, os.getpid()))
        try:
            work(kind, arguments, lambda what, content: server.send((what, content)))
            status = 0
        except Exception as error:
            if not isinstance(error, errors.GroundError):
                traceback.print_exc()
            server.send(("failed", errors.sentence(error)))
        server.close()
    finally:
        os._exit(status)
