#!/usr/bin/python3
"""Wrong axes of the mocap do not let the craft leave its room."""

import os
import sys
import unittest

import rospy
import rostest
from ground_msgs.msg import ControllerStatus, Controls, State
from std_srvs.srv import Trigger

sys.path.insert(1, os.path.dirname(sys.path[0]))
import harness
import requirements

HALF_WIDTH = requirements.limit("fence")  # half the width of the square room [m]
REST = 3.0  # time until the craft is at rest [s]


class RoomAxesTest(unittest.TestCase):
    def test_the_craft_is_stopped_inside(self):
        truth = harness.Latest("simulator/truth", State, keep=True)
        status = harness.Latest("controller/status", ControllerStatus)
        controls = harness.Latest("controls", Controls, keep=True)
        harness.wait_for(
            lambda: status.message and all(topic.connections() for topic in (truth, controls)),
            30,
            "the nodes",
        )
        start = rospy.ServiceProxy("controller/start", Trigger)()
        self.assertTrue(start.success, start.message)
        harness.wait_for_state(status, ControllerStatus.STOPPED, 20)
        rospy.sleep(REST)
        self.assertTrue(any(m.left > 0 for _, m in controls.all))
        farthest = max(max(abs(m.eta[0]), abs(m.eta[1])) for _, m in truth.all)
        print(
            "fault: %-38s %-12s farthest %.2f m: %s"
            % ("wrong axes at the fence", "stops", farthest, status.message.reason)
        )
        self.assertGreater(farthest, 0.5)
        self.assertLess(farthest, HALF_WIDTH)


if __name__ == "__main__":
    rospy.init_node("room_axes_test")
    rostest.rosrun("ground", "room_axes_test", RoomAxesTest)
