#!/usr/bin/python3
"""What rosrun ground viewer costs: its share of a core, while a craft with two models at 100 Hz is looked at.

    source build/devel/setup.bash && /usr/bin/python3 test/bench/viewer_cost.py [SECONDS]

The bound is 3% of a core on an idle computer. Other load makes the same work take more time, so the share of
the computer's time that others used is printed, too.
"""

import os
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "python"))
import foxglove_client
from conftest import ROOT, free_port

BOUND = 3.0  # [%]
MODEL = ROOT / "cfg" / "hovercraft" / "tiny_whoover.yaml"
TICK = os.sysconf("SC_CLK_TCK")


def used(pid):
    """Processor time that a process has used [s]."""
    with open("/proc/%d/stat" % pid) as file:
        return sum(map(int, file.read().rpartition(")")[2].split()[11:13])) / TICK


def busy():
    """Processor time that all have used [s]."""
    with open("/proc/stat") as file:
        user, nice, system, idle, wait, *_ = map(int, file.readline().split()[1:])
    return (user + nice + system) / TICK


def measure(seconds, client=True, mcap=None):
    """The viewer's share of a core [%], and the share of all cores that the rest had."""
    command = ["rosrun", "ground", "viewer", "--port", "0", *(["--mcap", mcap] if mcap else [])]
    viewer = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        port = int(re.search(r"localhost:(\d+)", viewer.stdout.readline()).group(1))
        shown = foxglove_client.Client(port) if client else None
        time.sleep(4)  # imports, connections
        began, before, all_before = time.monotonic(), used(viewer.pid), busy()
        count = len(shown.messages["/state"]) if shown else 0
        time.sleep(seconds)
        passed, own, every = time.monotonic() - began, used(viewer.pid) - before, busy() - all_before
        rate = (len(shown.messages["/state"]) - count) / passed if shown else 0
        if shown:
            shown.close()
        return 100 * own / passed, 100 * (every - own) / passed / os.cpu_count(), rate
    finally:
        viewer.send_signal(signal.SIGINT)
        viewer.wait(timeout=10)


def main():
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
    port = free_port()
    os.environ["ROS_MASTER_URI"] = "http://localhost:%d" % port
    model2 = "model2:=%s" % MODEL
    launch = ["roslaunch", "-p", str(port), "ground", "sim_tracking.launch", model2, "port:=%d" % free_port()]
    flying = subprocess.Popen(launch, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        time.sleep(6)
        with tempfile.TemporaryDirectory() as folder:
            cases = {
                "nobody looks": {"client": False},
                "a viewer has all channels": {},
                "and a file is written": {"mcap": folder + "/live.mcap"},
            }
            for name, arguments in cases.items():
                share, others, rate = measure(seconds, **arguments)
                text = "%-28s %.1f%% of a core (bound %g%%); others: %.0f%% of the computer; %.0f states/s"
                print(text % (name, share, BOUND, others, rate), flush=True)
    finally:
        flying.send_signal(signal.SIGINT)
        flying.wait(timeout=30)


if __name__ == "__main__":
    main()
