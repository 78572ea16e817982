#!/usr/bin/python3
"""However the sender ends, it sends zeros several times."""

import shutil
import signal
import sys
import tempfile
import time

import rospy
import rostest
from fake_craft import is_zero
from ground_msgs.msg import SenderStatus
from sender_rig import NODELET, SenderTest, kill

END_LIMIT = 1.0  # longest time until zeros; roslaunch and roscpp check signals every 0.1 s [s]
REPEATS = 10  # smallest number of zeros

LAUNCH = """<launch>
  <node name="sender" pkg="nodelet" type="nodelet" args="standalone ground/Sender" required="true">
    <param name="port" value="%d"/>
  </node>
</launch>"""


class SenderShutdown(SenderTest):
    def assert_ends_with_zeros(self, craft, process, start, what):
        """Checks zeros after the process got a signal at `start` while commands kept coming."""
        process.wait(timeout=20)
        zeros = craft.wait(
            lambda packets: [p for p in packets if p.time > start and is_zero(p)], "zeros at the end"
        )
        craft.wait(lambda packets: sum(p.time > start and is_zero(p) for p in packets) >= REPEATS, "repeats")
        self.assert_zero(craft.since(zeros[0].time))
        self.worst[what] = zeros[0].time - start
        self.assertLessEqual(zeros[0].time - start, END_LIMIT, what)
        last = SenderTest.status  # zeros by the end, not by the watchdog for stale commands
        self.assertNotEqual(last.state, SenderStatus.FAULT, last.reason)

    def test_signals_while_driving(self):
        # SIGHUP comes when a terminal is closed, SIGTERM from kill and systemd.
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            process = self.start()
            craft = self.craft()
            self.arm_and_drive(craft)
            start = kill(process, number)
            self.assert_ends_with_zeros(craft, process, start, number.name)
            self.assertEqual(process.returncode, 0)

    def test_unloading(self):
        manager = self.spawn(NODELET, "manager", "__name:=manager")
        loader = self.start("load", "ground/Sender", "manager")
        craft = self.craft()
        self.arm_and_drive(craft)
        start = kill(loader, signal.SIGINT)
        self.assert_ends_with_zeros(craft, loader, start, "unloading")
        self.assertIsNone(manager.poll())
        self.wait_status(
            lambda s: s.state == SenderStatus.DISARMED and s.reason == "the sender ends", "DISARMED"
        )

    def test_end_of_the_manager(self):
        # With a bond to a living loader, nodelet's Loader crashes after it has destroyed the nodelets,
        # because its bond's destructor unloads them again. Zeros have been sent by then.
        for options in ((), ("--no-bond",)):
            manager = self.spawn(NODELET, "manager", "__name:=manager")
            self.start("load", "ground/Sender", "manager", *options)
            craft = self.craft()
            self.arm_and_drive(craft)
            start = kill(manager, signal.SIGTERM)
            self.assert_ends_with_zeros(craft, manager, start, "SIGTERM to the manager")
            self.processes[-1].kill()
            if options:
                self.assertEqual(manager.returncode, 0)

    def test_roslaunch(self):
        with tempfile.NamedTemporaryFile("w", suffix=".launch") as launch:
            launch.write(LAUNCH % self.port)
            launch.flush()
            SenderTest.status = None
            process = self.spawn(sys.executable, shutil.which("roslaunch"), launch.name)
            self.wait_connected()
            craft = self.craft()
            self.arm_and_drive(craft)
            start = time.time()
            process.send_signal(signal.SIGINT)
            self.assert_ends_with_zeros(craft, process, start, "roslaunch's shutdown")


if __name__ == "__main__":
    rospy.init_node("sender_shutdown", disable_signals=True)
    rostest.rosrun("ground", "sender_shutdown", SenderShutdown, sys.argv)
