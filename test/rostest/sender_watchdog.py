#!/usr/bin/python3
"""Zeros are sent in time after faults of controller and state."""

import sys
import time

import rospy
import rostest
from rosgraph_msgs.msg import Clock
from sender_rig import DRIVE, SenderTest, kill, spawn_controller, wait_for


class SenderWatchdog(SenderTest):
    def setUp(self):
        super().setUp()
        self.start()
        self.hovercraft = self.craft()

    def test_stale_controls(self):
        for _ in range(3):
            self.arm_and_drive(self.hovercraft)
            self.feed.set(command=None)
            start = self.feed.last_command
            self.assert_zero_within_limit(self.hovercraft, start, "stale controls")
            self.assert_fault("commands are stale")

    def test_stale_and_invalid_state(self):
        for valid, what in ((None, "stale state"), (False, "invalid state")):
            self.arm_and_drive(self.hovercraft)
            self.feed.set(valid=valid)
            self.assert_zero_within_limit(self.hovercraft, self.feed.last_state, what)
            self.assert_fault("the state is " + what.split()[0])

    def test_killed_controller(self):
        self.feed.leave_controls()
        wait_for(lambda: time.time() > self.feed.last_command + 0.3, "staleness of the old commands")
        controller = spawn_controller(self, DRIVE)
        wait_for(lambda: self.arm().success, "arming")
        self.wait_driving(self.hovercraft)
        start = kill(controller)
        self.assert_zero_within_limit(self.hovercraft, start, "killed controller")
        self.feed.take_controls()
        self.assert_fault("commands are stale")


if __name__ == "__main__":
    rospy.init_node("sender_watchdog", disable_signals=True)
    if rospy.get_param("/use_sim_time", False):
        # Publish a single time.
        clock = rospy.Publisher("/clock", Clock, queue_size=1, latch=True)
        clock.publish(Clock(clock=rospy.Time(1000)))
        wait_for(lambda: not rospy.Time.now().is_zero(), "the clock")
    rostest.rosrun("ground", "sender_watchdog", SenderWatchdog, sys.argv)
