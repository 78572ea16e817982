#!/usr/bin/python3
"""Packets follow poses although the log of the ground station blocks and a subscriber stops reading."""

import os
import signal
import subprocess
import sys
import threading
import time
import unittest

import harness
import roslib.packages
import rospy
import rostest
from fake_craft import FakeCraft
from ground_msgs.msg import ControllerStatus

HERE = os.path.dirname(os.path.abspath(__file__))
NODELET = roslib.packages.find_node("nodelet", "nodelet")[0]


class Pipe:
    """Standard output of the manager. Nobody reads it after block()."""

    def __init__(self):
        self._read, self.write = os.pipe()
        self._reading = True
        self._thread = threading.Thread(target=self._drain, daemon=True)
        self._thread.start()

    def _drain(self):
        os.set_blocking(self._read, False)
        while self._reading:
            try:
                if not os.read(self._read, 65536):
                    return
            except BlockingIOError:
                time.sleep(0.01)

    def block(self):
        self._reading = False
        self._thread.join()
        # Another description of the pipe, so that it stays blocking for the manager.
        filler = os.open("/proc/self/fd/%d" % self.write, os.O_WRONLY | os.O_NONBLOCK)
        try:
            for size in (4096, 1):
                try:
                    while True:
                        os.write(filler, b" " * size)
                except BlockingIOError:
                    pass
        finally:
            os.close(filler)

    def release(self):
        self._reading = True
        self._thread = threading.Thread(target=self._drain, daemon=True)
        self._thread.start()


class BlockedTest(unittest.TestCase):
    def test_packets_follow_poses(self):
        log = Pipe()
        manager = subprocess.Popen(
            [NODELET, "manager", "__name:=blocked_manager"], stdout=log.write, stderr=log.write
        )
        self.addCleanup(self.end, manager, log)
        mocap = harness.Mocap()
        craft = FakeCraft(int(sys.argv[1]))
        self.addCleanup(craft.close)
        self.addCleanup(mocap.stop)
        status = harness.Latest("controller/status", ControllerStatus)
        telemetry = harness.Repeater(5, craft.send)
        self.addCleanup(telemetry.stop)
        harness.wait_for_state(status, ControllerStatus.RUNNING, 40)
        subscriber = subprocess.Popen([sys.executable, os.path.join(HERE, "stopped_subscriber.py")])
        self.addCleanup(subscriber.wait)
        self.addCleanup(subscriber.kill)
        harness.wait_for(lambda: self.stopped(subscriber.pid), 40, "the stopped subscriber")
        log.block()
        # mocap_state and the controller log that the state is lost, and that it is back.
        mocap.stop()
        harness.wait_for_state(status, ControllerStatus.RECOVERING, 10)
        mocap.repeater = harness.Repeater(100, mocap.publish)
        harness.wait_for_state(status, ControllerStatus.RUNNING, 10)
        before, begin = craft.count(), time.monotonic()
        # Without a command for each pose, there would be only the packets that are repeated at 10 Hz.
        harness.wait_for(lambda: craft.count() - before >= 200, 10, "packets")
        self.assertLess((craft.count() - before) / (time.monotonic() - begin), 200)
        self.assertIsNone(manager.poll())

    @staticmethod
    def stopped(pid):
        with open("/proc/%d/stat" % pid) as file:
            return file.read().rsplit(")", 1)[1].split()[0] == "T"

    @staticmethod
    def end(manager, log):
        log.release()
        manager.send_signal(signal.SIGINT)
        try:
            manager.wait(10)
        except subprocess.TimeoutExpired:
            manager.kill()
            manager.wait()


if __name__ == "__main__":
    rospy.init_node("blocked_test", disable_signals=True)
    rostest.rosrun("ground", "blocked_test", BlockedTest, sys.argv)
