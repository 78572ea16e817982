#!/usr/bin/python3
"""TrajectoryTracking: live gains, references and models."""

import math
import os
import tempfile
import threading

import dynamic_reconfigure.client
import harness
import rosnode
import rospy
import rostest
from controller_case import ControllerCase, S
from ground_msgs.msg import Controls, Decision, Reference
from ground_msgs.srv import LoadModel
from nav_msgs.msg import Path

HERE = os.path.dirname(os.path.abspath(__file__))
NOMINAL = os.path.join(HERE, "..", "..", "cfg", "hovercraft", "tiny_whoover.yaml")
TILTED = os.path.join(HERE, "tilted_craft.yaml")
DELAYED = os.path.join(HERE, "delayed_craft.yaml")


def circle_file(points):
    """A CSV file of a circle with a radius of 1.25 m, in steps of 10 ms."""
    file = tempfile.NamedTemporaryFile("w", suffix=".csv")
    file.write("time,x,y\n")
    for i in range(points):
        t = 0.01 * i
        file.write("%.2f,%.6f,%.6f\n" % (t, 1.25 * math.cos(0.4 * t), 1.25 * math.sin(0.4 * t)))
    file.flush()
    return file


class TrackingTest(ControllerCase):
    name = "tracking"

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
        harness.wait_for(lambda: abs(math.hypot(*reference.message.p) - 1) < 1e-6, 1, "a circle of 1 m")
        harness.wait_for(lambda: len(path.all) > 1, 1, "its path")
        client.update_configuration({"size": 2.0})
        client.close()

    def test_effects_that_are_not_used_are_reported_or_refused(self):
        load = rospy.ServiceProxy("tracking/load_model", LoadModel)
        answer = load(file=TILTED)
        self.assertTrue(answer.success, answer.message)
        self.assertIn("does not use floor_tilt", answer.message)
        self.assertIn("does not use floor_tilt", self.start().message)
        self.expect(S.RUNNING)
        self.assertIn("does not use floor_tilt", self.status.message.reason)
        answer = load(file=DELAYED)
        self.assertFalse(answer.success)
        self.assertIn("does not use input_delay", answer.message)
        self.assertEqual(self.status.message.state, S.RUNNING)
        answer = load(file=NOMINAL)
        self.assertTrue(answer.success)
        self.assertNotIn("use", answer.message[answer.message.index(".yaml") :])

    def test_controllers_with_unusable_parameters_end(self):
        for name in ("broken", "misled", "mistuned"):
            harness.wait_for(
                lambda name=name: not rosnode.rosnode_ping(name, max_count=1), 10, "the end of " + name
            )

    def test_each_decision_is_published(self):
        decisions = harness.Latest("decision", Decision, keep=True)
        wanted = harness.Latest("controls/wanted", Controls, keep=True)
        reference = harness.Latest("reference", Reference, keep=True)
        self.run_it()
        harness.wait_for(lambda: len(decisions.all) > 30 and len(wanted.all) > 30, 5, "decisions")
        found = {m.header.stamp: m for _, m in list(decisions.all)}
        given = {m.header.stamp for _, m in list(wanted.all)}
        self.assertGreater(len(given & set(found)), 25)
        self.assertTrue(all(0 < m.computing < 0.05 for m in found.values()))
        self.assertEqual({m.header.frame_id for m in found.values()}, {"/tracking"})
        states = {m.header.stamp for _, m in list(reference.all)}
        self.assertGreater(len(states & {m.state for m in found.values()}), 25)

    def test_commands_continue_while_a_large_reference_is_built(self):
        client = dynamic_reconfigure.client.Client("tracking", timeout=10)
        reference = harness.Latest("reference", Reference)
        self.run_it()
        with circle_file(300000) as file:
            wanted = {"reference": "file", "file": file.name}
            change = threading.Thread(target=client.update_configuration, args=(wanted,))
            begun = len(self.controls.all)
            change.start()
            change.join()
        harness.wait_for(lambda: abs(math.hypot(*reference.message.p) - 1.25) < 1e-3, 2, "the new reference")
        self.assertEqual(self.status.message.state, S.RUNNING, self.status.message.reason)
        times = [t for t, _ in self.controls.all[begun:]]
        gap = max(b - a for a, b in zip(times, times[1:]))
        print("built in %.2f s; commands were at most %.0f ms apart" % (times[-1] - times[0], 1e3 * gap))
        self.assertLess(gap, 0.1)
        client.update_configuration({"reference": "circle", "file": ""})
        client.close()


if __name__ == "__main__":
    rospy.init_node("tracking_controller_test")
    rostest.rosrun("ground", "tracking_controller_test", TrackingTest)
