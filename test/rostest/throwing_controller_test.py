#!/usr/bin/python3
"""A controller of a user throws an exception in flight: it stops with the reason, the craft gets zeros, and
the sender beside it in the manager goes on. It can be started again."""

import os
import sys
import time
import unittest

import rospy
import rostest
from ground_msgs.msg import ControllerStatus, SenderStatus
from std_srvs.srv import SetBool, Trigger

sys.path.insert(1, os.path.dirname(sys.path[0]))
import harness
import requirements
from fake_craft import FakeCraft, is_zero

LIMIT = requirements.limit("thrust-after-end")  # [s]
LASTS = 3.0  # how long it flies before it throws [s]


def thrusts(packets):
    return [p for p in packets if p.left or p.right]


class ThrowingControllerTest(unittest.TestCase):
    def test_it_stops_with_zeros_and_the_reason_and_can_be_started_again(self):
        craft = FakeCraft(int(sys.argv[1]))
        self.addCleanup(craft.close)
        states = harness.StatePublisher()
        self.addCleanup(states.stop)
        status = harness.Latest("controller/status", ControllerStatus, keep=True)
        sender = harness.Latest("sender/status", SenderStatus, keep=True)
        rospy.wait_for_service("controller/start", 20)
        rospy.wait_for_service("sender/arm", 20)
        start, arm = (
            rospy.ServiceProxy("controller/start", Trigger),
            rospy.ServiceProxy("sender/arm", SetBool),
        )
        telemetry = harness.Repeater(50, craft.send)
        self.addCleanup(telemetry.stop)
        harness.wait_for(lambda: arm(True).success, 10, "an armed sender")
        for _ in range(2):
            self.assertTrue(start().success)
            begun = time.time()
            harness.wait_for(lambda: craft.packets[-1].left, 5, "thrust")
            harness.wait_for(lambda: status.message.state == ControllerStatus.STOPPED, LASTS + 5, "a stop")
            stopped = time.time()
            flown = thrusts(craft.since(begun))
            self.assertGreater(flown[-1].time - flown[0].time, LASTS - 0.5, "it threw too early")
            self.assertLess(flown[-1].time - flown[0].time, LASTS + 0.5)
            self.assertIn("failed", status.message.reason)
            self.assertIn("300", status.message.reason, "the text of the exception")
            time.sleep(1)
            late = craft.since(flown[-1].time + LIMIT)
            self.assertGreater(len(late), 30, "the sender goes on")
            self.assertEqual([p for p in late if not is_zero(p)], [])
            self.assertLess(thrusts(craft.since(begun))[-1].time, stopped + LIMIT)
            self.assertEqual(sender.message.state, SenderStatus.ARMED, sender.message.reason)


if __name__ == "__main__":
    rospy.init_node("throwing_controller_test")
    rostest.rosrun("ground", "throwing_controller_test", ThrowingControllerTest)
