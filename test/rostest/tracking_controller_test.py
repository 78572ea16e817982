#!/usr/bin/python3
"""TrajectoryTracking: live gains and references."""
import math
import os
import sys

import dynamic_reconfigure.client
import rosnode
import rospy
import rostest
from ground_msgs.msg import Reference
from nav_msgs.msg import Path

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import harness  # noqa: E402
from controller_case import ControllerCase, S  # noqa: E402


class TrackingTest(ControllerCase):
    name = "tracking"

    def test_gains_change_live(self):
        self.states.state.nu[2] = 0.5
        client = dynamic_reconfigure.client.Client("tracking", timeout=10)
        client.update_configuration({"k_z": 1e-6, "k_e": 0.01})
        self.run_it()
        harness.wait_for(lambda: self.controls.message.lift == 1, 1, "commands")
        before = (self.controls.message.left, self.controls.message.right)
        answer = client.update_configuration({"k_z": 0.0003, "k_e": 4.0})
        self.assertEqual((answer["k_z"], answer["k_e"]), (0.0003, 4.0))
        harness.wait_for(
            lambda: (self.controls.message.left, self.controls.message.right) != before,
            1,
            "a change",
        )
        self.assertEqual(self.status.message.state, S.RUNNING)
        for bad in ({"delta_1": 0.0}, {"k_e": -1.0}, {"k_e": math.nan}, {"reference": "spiral"}):
            answer = client.update_configuration(bad)
            for name, value in bad.items():
                self.assertNotEqual(answer[name], value)
        self.assertEqual(self.status.message.state, S.RUNNING)
        client.close()

    def test_the_reference_is_published_and_changes_live(self):
        path = harness.Latest("path/reference", Path, keep=True)
        reference = harness.Latest("reference", Reference, keep=True)
        harness.wait_for(lambda: path.message, 3, "the path")
        self.run_it()
        harness.wait_for(lambda: len(reference.all) > 20, 2, "references")
        times = [m.header.stamp.to_sec() for _, m in reference.all]
        rate = (len(times) - 1) / (times[-1] - times[0])
        self.assertAlmostEqual(rate, 50, delta=8)
        point = reference.message
        self.assertAlmostEqual(math.hypot(*point.p), 2.0, 6)
        self.assertAlmostEqual(math.hypot(*point.p_dot), 1.2, 6)
        client = dynamic_reconfigure.client.Client("tracking", timeout=10)
        client.update_configuration({"size": 1.0})
        harness.wait_for(
            lambda: abs(math.hypot(*reference.message.p) - 1) < 1e-6, 1, "a circle of 1 m"
        )
        self.assertGreater(len(path.all), 1)
        client.update_configuration({"size": 2.0})
        client.close()

    def test_a_reference_beyond_the_craft_is_said_so_before_the_start(self):
        client = dynamic_reconfigure.client.Client("tracking", timeout=10)
        client.update_configuration({"rate_of_turn": 3.0})
        answer = self.start()
        self.assertTrue(answer.success)
        self.assertIn("cannot follow it exactly", answer.message)
        self.expect(S.RUNNING)
        self.assertIn("a thrust of", self.status.message.reason)
        self.stop()
        client.update_configuration({"rate_of_turn": 0.6})
        self.assertEqual(self.start().message, "")
        client.close()

    def test_without_a_model_the_nodelet_does_not_start(self):
        harness.wait_for(lambda: not rosnode.rosnode_ping("broken", max_count=1), 10, "it is gone")


if __name__ == "__main__":
    rospy.init_node("tracking_controller_test")
    rostest.rosrun("ground", "tracking_controller_test", TrackingTest)
