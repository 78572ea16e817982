"""Commands that have to end: with limits of processor time, wall time and memory."""

import os
import resource
import signal
import subprocess
import time
from dataclasses import dataclass

MEMORY = 6 << 30  # address space of a command [bytes]


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    status: int
    output: str
    seconds: float  # processor time, of its children too
    timed_out: bool


def run(command, seconds, folder, environment=None):
    """Runs a command. seconds: limit of its processor time; the limit of the wall time is ten times as long
    and a minute more, because other work may keep the processors from it, and because a hang uses none."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    process = subprocess.Popen(
        ["prlimit", "--cpu=%d" % (seconds + 1), "--as=%d" % MEMORY, "--core=0", "--"] + command,
        cwd=str(folder),
        env={**os.environ, **(environment or {})},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,  # so that all its processes can be ended at once
    )
    try:
        output, _ = process.communicate(timeout=10 * seconds + 60)
        timed_out = process.returncode in (-signal.SIGXCPU, -signal.SIGKILL)
    except subprocess.TimeoutExpired:
        timed_out = True
    finally:
        end_group(process.pid)
    if timed_out:
        output, _ = process.communicate()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Ended(process.returncode, output.decode(errors="replace"), spent, timed_out)


def end_group(leader):
    """Ends the processes that a command has left."""
    try:
        os.killpg(leader, signal.SIGKILL)
    except ProcessLookupError:
        pass


def waited(command, folder, environment=None):
    """Runs a command that has to succeed; returns its output."""
    start = time.monotonic()
    result = subprocess.run(
        command,
        cwd=str(folder),
        env={**os.environ, **(environment or {})},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        universal_newlines=True,
    )
    if result.returncode:
        words = (" ".join(command), time.monotonic() - start, result.stdout[-3000:])
        raise SystemExit("%s failed after %.0f s:\n%s" % words)
    return result.stdout
