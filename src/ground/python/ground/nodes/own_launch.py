"""The launch that started this program."""

import os
import signal


def end_launch() -> bool:
    """Ends roslaunch as by Ctrl-C, and so all nodes, if it started this program; returns whether it did."""
    parent = os.getppid()
    with open("/proc/%d/cmdline" % parent) as file:
        words = file.read().split("\0")
    if "roslaunch" not in [os.path.basename(word) for word in words[:2]]:
        return False
    os.kill(parent, signal.SIGINT)
    return True
