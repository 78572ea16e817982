#!/usr/bin/python3
"""A craft loses half a thruster in flight: the user hears since when the model fails, in which channel, and
what to do next."""

import math
import os
import re
import unittest

import harness
import rospy
import rostest
from ground_msgs.msg import ControllerStatus, Controls, ModelError, State
from ground_msgs.srv import LoadModel
from rosgraph_msgs.msg import Log
from visualization_msgs.msg import MarkerArray

HALF = os.path.join(os.path.dirname(os.path.abspath(__file__)), "half_thruster.yaml")
SETTLED = 15.0  # flight before the loss [s]
SAID = 4.0  # time in which the failure is said [s]
YAW = 2  # index of failing_since


class ModelFailureTest(unittest.TestCase):
    def setUp(self):
        self.status = harness.Latest("controller/status", ControllerStatus, keep=True)
        self.error = harness.Latest("model_error", ModelError, keep=True)
        self.controls = harness.Latest("controls", Controls, keep=True)
        self.state = harness.Latest("state", State, keep=True)
        self.legend = harness.Latest("legend", MarkerArray)
        self.log = harness.Latest("/rosout", Log, keep=True)

    def test_the_failure_is_said_with_its_start_channel_and_next_step(self):
        harness.wait_for_state(self.status, ControllerStatus.RUNNING)
        harness.pass_time(SETTLED)
        self.assertEqual({m.failure for _, m in self.error.all}, {""}, "nothing has changed yet")
        self.assertTrue(all(map(math.isnan, self.error.message.failing_since)))
        lost = rospy.Time.now().to_sec()
        answer = rospy.ServiceProxy("simulator/load_model", LoadModel)(file=HALF)
        self.assertTrue(answer.success, answer.message)
        fails = lambda: self.error.message.failure  # noqa: E731
        harness.wait_for(fails, 10 * SAID, "a failure")
        said = next(m for _, m in self.error.all if m.failure)
        print("after %.2f s: %s" % (said.header.stamp.to_sec() - lost, said.failure))
        self.assertLess(said.header.stamp.to_sec() - lost, SAID)
        zero = max(heard.all[0][1].header.stamp.to_sec() for heard in (self.state, self.controls))
        self.assertAlmostEqual(said.failing_since[YAW], lost - zero, delta=2.0)
        self.assertIn("yaw since %.1f s" % said.failing_since[YAW], said.failure)
        command = r"^rosrun ground identify diagnose BAG --model \S+tiny_whoover.yaml --from (\d+) -o \S+$"
        start = re.match(command, said.next)
        self.assertTrue(start, said.next)
        self.assertAlmostEqual(int(start[1]), lost - zero, delta=2.0)
        warned = lambda: any(said.next in m.msg for _, m in self.log.all if m.level == Log.WARN)  # noqa: E731
        harness.wait_for(warned, 5, "a warning in the log")
        shown = lambda: any("yaw since" in m.text for m in self.legend.message.markers)  # noqa: E731
        harness.wait_for(shown, 10, "a line in the legend")
        self.assertEqual(self.status.message.state, ControllerStatus.RUNNING, self.status.message.reason)


if __name__ == "__main__":
    rospy.init_node("model_failure_test")
    rostest.rosrun("ground", "model_failure_test", ModelFailureTest)
