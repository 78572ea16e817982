"""The launch that started this program."""

import contextlib
import glob
import os
import signal
import time
from typing import List, Optional

CORES = ("rosmaster", "rosout")  # what roslaunch ends last
PATIENCE = 12.0  # time for the nodes to end [s]
RED = "\033[31m%s\033[0m"  # colour of errors of ROS


def words_of(process: int) -> Optional[List[str]]:
    """The command line of a roslaunch after its name; None for another program."""
    with contextlib.suppress(OSError), open("/proc/%d/cmdline" % process, errors="surrogateescape") as file:
        words = file.read().split("\0")[:-1]
        program = [os.path.basename(word) for word in words[:2]]
        return words[program.index("roslaunch") + 1 :] if "roslaunch" in program else None
    return None


def end_launch() -> bool:
    """Ends roslaunch as by Ctrl-C, and so all nodes, if it started this program; returns whether it did."""
    started = words_of(os.getppid()) is not None
    if started:
        os.kill(os.getppid(), signal.SIGINT)
    return started


def fail_launch(process: int) -> None:
    """Ends a roslaunch and its nodes, but not with status 0, which roslaunch has whatever its nodes do: stops
    it, interrupts its nodes, the master last, and kills it when they have ended. Leaves another program."""
    if words_of(process) is None:
        return
    os.kill(process, signal.SIGSTOP)
    deadline = time.monotonic() + PATIENCE
    for cores in (False, True):
        for child in _children(process, cores):
            with contextlib.suppress(OSError):  # it has ended
                os.killpg(os.getpgid(child), signal.SIGINT)
        while _children(process, cores) and time.monotonic() < deadline:
            time.sleep(0.05)
    for child in (*_children(process, False), *_children(process, True), process):
        with contextlib.suppress(OSError):
            os.kill(child, signal.SIGKILL)


def _children(parent: int, cores: bool) -> List[int]:
    """The running children of a process, without this one: a roscore's children, or the others."""
    found = []
    for path in glob.glob("/proc/%d/task/*/children" % parent):
        with contextlib.suppress(OSError), open(path) as file:  # it has ended
            for number in map(int, file.read().split()):
                with open("/proc/%d/cmdline" % number, errors="replace") as file_of_words:
                    words = file_of_words.read()
                if words and number != os.getpid() and cores == any(core in words for core in CORES):
                    found.append(number)
    return found
