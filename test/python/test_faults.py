"""Faults of processes and disk while a craft tracks, observed by the packets to the craft."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import time
import warnings

import pytest

import ground
from conftest import ROOT, free_port, wait_for

sys.path.insert(0, str(ROOT / "test" / "rostest"))
sys.path.insert(1, str(ROOT / "test"))
import requirements
from wire_proxy import WireProxy

LIMIT = requirements.limit("thrust-after-end")  # longest thrust after the fault [s]


class Stack:
    """Master and nodes, each in its own process, and the link between sender and craft."""

    def __init__(self, log):
        self._log = open(str(log), "w")
        self._children = []
        port = free_port(socket.SOCK_STREAM)
        self.env = dict(os.environ, ROS_MASTER_URI="http://localhost:%d" % port)
        sender, craft = free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_DGRAM)
        self.wire = WireProxy(sender, craft)
        self.run("roscore", "-p", str(port))
        nodes = ROOT / "test" / "rostest" / "processes.launch"
        self.run("roslaunch", "--wait", str(nodes), "port:=%d" % sender, "wire:=%d" % craft)

    def run(self, *command):
        process = subprocess.Popen(
            command, env=self.env, stdout=self._log, stderr=subprocess.STDOUT, start_new_session=True
        )
        self._children.append(process)
        return process

    def pid(self, node):
        """Process id of a node, or of the master, of this stack."""
        pattern = "rosmaster --core" if node == "master" else "__name:=%s " % node
        found = subprocess.run(["pgrep", "-f", pattern], stdout=subprocess.PIPE, check=True)
        ours = []
        for pid in found.stdout.split():
            with contextlib.suppress(OSError), open("/proc/%d/environ" % int(pid), "rb") as environ:
                if self.env["ROS_MASTER_URI"].encode() in environ.read():
                    ours.append(int(pid))
        assert len(ours) == 1, "%s: %s" % (node, ours)
        return ours[0]

    def kill(self, node, number=signal.SIGKILL):
        """Sends a signal to a node; returns the time [s, time.time()]."""
        pid = self.pid(node)
        os.kill(pid, number)
        return time.time()

    def drives(self, seconds):
        """Whether packets came during the last `seconds`, many of them with thrust."""
        now = time.time()
        packets = [p for p in list(self.wire.packets) if p.time > now - seconds]
        return len(packets) > 30 * seconds and sum(1 for p in packets if p.left or p.right) > 0.2 * len(
            packets
        )

    def wait_until_it_drives(self):
        wait_for(lambda: self.drives(2), 40, "the craft to be driven")

    def thrust_after(self, start, seconds=1.5):
        """Time from `start` to the last packet with thrust [s]; 0 if there was none."""
        time.sleep(seconds)
        return max([t - start for t in self.wire.thrust_between(start, time.time())], default=0.0)

    def close(self):
        for process in reversed(self._children):
            process.send_signal(signal.SIGINT)
        for process in self._children:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(timeout=20)
        for process in self._children:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        self.wire.close()
        self._log.close()


@pytest.fixture
def stack(tmp_path):
    stack = Stack(tmp_path / "log")
    try:
        stack.wait_until_it_drives()
        yield stack
    finally:
        stack.close()


def report(name, ending, what):
    print("fault: %-38s %-12s %s" % (name, ending, what))


@pytest.mark.parametrize(
    "node, name",
    [
        ("controller", "controller killed"),
        ("mocap_state", "mocap_state killed"),
        ("sender", "sender killed (or its manager)"),
        ("simulator", "mocap and craft killed"),
    ],
)
def test_a_killed_process_leaves_no_thrust(stack, node, name):
    late = stack.thrust_after(stack.kill(node))
    report(name, "stops", "thrust until %3.0f ms after it" % (1e3 * late))
    assert late < LIMIT


def test_without_a_master_it_drives_on_and_ends_with_zeros(stack):
    stack.kill("master")
    time.sleep(4)
    assert stack.drives(2)
    end = stack.kill("sender", signal.SIGINT)
    late = stack.thrust_after(end)
    last = stack.wire.packets[-1]
    report("roscore gone", "goes on", "ended by Ctrl-C: thrust until %3.0f ms after" % (1e3 * late))
    assert late < LIMIT
    assert (last.left, last.right, last.lift) == (0, 0, 0)


def test_a_clock_that_jumps_back_stops_it(stack):
    stack.run("rostopic", "pub", "-r", "200", "/clock", "rosgraph_msgs/Clock", "{clock: {secs: 1}}")
    wait_for(lambda: not stack.drives(1), 20, "a stop")
    late = stack.thrust_after(time.time(), 2)
    report("clock jumps back", "stops", "no thrust in the 2 s that follow")
    assert late == 0


def test_a_full_disk_ends_the_recording_only(stack, tmp_path):
    """The bag is readable up to the fault, and a new recording is refused."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=210m", "tmpfs", str(folder)], stderr=subprocess.PIPE
    )
    if mounted.returncode != 0:
        pytest.skip("this test needs the right to mount a file system: %s" % mounted.stderr.decode())
    record = ["roslaunch", "ground", "record.launch", "bag_dir:=%s" % folder]
    try:
        stack.run(*record)
        wait_for(lambda: any(b.stat().st_size > 2e5 for b in folder.glob("*.bag*")), 60, "a bag")
        time.sleep(2)  # on a busy computer it may hold no more than what is sent once, at the start
        with contextlib.suppress(OSError), open(str(folder / "others"), "wb") as others:
            while True:
                others.write(b"0" * 4096)
                others.flush()
        time.sleep(4)
        assert stack.drives(3)
        (bag,) = folder.glob("*_0.bag*")
        copy = tmp_path / bag.name
        copy.write_bytes(bag.read_bytes())
        os.truncate(str(folder / "others"), 60 * 10**6)  # what becomes free is too little for a flight
        refused = subprocess.run(
            ["timeout", "--signal=INT", "60", *record],
            env=stack.env,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        assert b"MB are free" in refused.stdout
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ground.GroundWarning)  # the bag was not closed
        (run,) = ground.read(copy)
    report("disk full while recording", "goes on", "%.1f s recorded before can be read" % run.duration)
    assert run.duration > 1
