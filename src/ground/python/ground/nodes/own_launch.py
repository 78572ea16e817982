"""The launch that started this program."""

import contextlib
import glob
import os
import signal
import time
from typing import Dict

CORES = ("rosmaster", "rosout")  # what roslaunch ends last
PATIENCE = 12.0  # time for the nodes to end, less than roslaunch gives this program [s]
RED = "\033[31m%s\033[0m"  # colour of errors of ROS


def end_launch() -> bool:
    """Ends roslaunch as by Ctrl-C, and so all nodes, if it started this program; returns whether it did."""
    parent = os.getppid()
    with open("/proc/%d/cmdline" % parent) as file:
        words = file.read().split("\0")
    if "roslaunch" not in [os.path.basename(word) for word in words[:2]]:
        return False
    os.kill(parent, signal.SIGINT)
    return True


def fail_launch() -> bool:
    """Ends roslaunch like end_launch, but not with status 0, which it has whatever its nodes do: kills it
    when the other nodes have ended. roslaunch waits for this program, which must outlast SIGINT."""
    parent = os.getppid()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    if not end_launch():
        return False
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline and any(
        not any(core in line for core in CORES) for line in _others(parent).values()
    ):
        time.sleep(0.05)
    for process, line in [*_others(parent).items(), (parent, "")]:
        with contextlib.suppress(ProcessLookupError):  # it has ended
            os.kill(process, signal.SIGINT if any(core in line for core in CORES) else signal.SIGKILL)
    return True


def _others(parent: int) -> Dict[int, str]:
    """Command lines of the running children of a process by their numbers, without this one."""
    found = {}
    for path in glob.glob("/proc/%d/task/*/children" % parent):
        with contextlib.suppress(OSError), open(path) as file:  # it has ended
            for number in map(int, file.read().split()):
                with open("/proc/%d/cmdline" % number, errors="replace") as line:
                    found[number] = line.read()
    return {number: line for number, line in found.items() if line and number != os.getpid()}
