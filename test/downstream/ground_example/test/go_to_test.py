#!/usr/bin/python3
"""The controller drives the simulated craft to its point and stops there."""

import math
import unittest

import rospy
import rostest
from ground_msgs.msg import ControllerStatus, State


class GoToTest(unittest.TestCase):
    def test_reaches_the_point(self):
        point = [rospy.get_param("controller/" + axis) for axis in "xy"]
        self.status = None
        rospy.Subscriber("controller/status", ControllerStatus, self.take)
        ended = (ControllerStatus.DONE, ControllerStatus.STOPPED)
        while self.status is None or self.status.state not in ended:
            rospy.sleep(0.05)
        self.assertEqual(self.status.state, ControllerStatus.DONE, self.status.reason)
        print("reached after %.1f s" % self.status.elapsed)
        truth = rospy.wait_for_message("simulator/truth", State, 5)
        self.assertLess(math.dist(truth.eta[:2], point), 0.15)
        self.assertLess(math.hypot(*truth.nu[:2]), 0.15)

    def take(self, status):
        self.status = status


if __name__ == "__main__":
    rospy.init_node("go_to_test")
    rostest.rosrun("ground_example", "go_to_test", GoToTest)
