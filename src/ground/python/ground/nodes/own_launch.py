"""The launch that started this program."""

import glob
import os
import signal
import time
from typing import List, Tuple

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
    """Ends roslaunch like end_launch, but with a status that is not 0.

    roslaunch ends with status 0 whatever its nodes do. So it is killed, when all other nodes have ended and
    before it goes on: it waits for this program, which must outlast SIGINT."""
    parent = os.getppid()
    if not end_launch():
        return False
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline and any(name not in CORES for _, name in _others(parent)):
        time.sleep(0.05)
    for process, _ in _others(parent):
        os.kill(process, signal.SIGINT)
    os.kill(parent, signal.SIGKILL)
    return True


def _others(parent: int) -> List[Tuple[int, str]]:
    """Numbers and names of the running children of a process, without this one."""
    found = []
    for path in glob.glob("/proc/[0-9]*/stat"):
        try:
            with open(path, errors="replace") as file:
                before, _, after = file.read().rpartition(")")
        except OSError:  # it has ended
            continue
        number, _, name = before.partition(" (")
        state, of = after.split()[:2]
        if int(of) == parent and state != "Z" and int(number) != os.getpid():
            found.append((int(number), name))
    return found
