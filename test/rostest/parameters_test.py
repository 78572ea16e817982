#!/usr/bin/python3
"""Live parameters: each is documented, and a user lists and sets them in a terminal."""

import importlib
import os
import re
import subprocess
import unittest

import harness
import rospy
import rostest
from ground_msgs.msg import LiveChange
from ground_msgs.srv import LoadModel
from rosgraph_msgs.msg import Log

CFG = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "cfg")


def parameters(*arguments):
    return subprocess.run(
        ["rosrun", "ground", "parameters"] + list(arguments),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        universal_newlines=True,
        timeout=60,
    )


def described(group):
    for p in group["parameters"]:
        yield group["name"], p
    for inner in group["groups"]:
        yield from described(inner)


class ParametersTest(unittest.TestCase):
    def test_every_parameter_has_group_unit_range_and_meaning(self):
        files = [f[:-4] for f in os.listdir(CFG) if f.endswith(".cfg")]
        self.assertGreater(len(files), 6)
        for name in files:
            config = importlib.import_module("ground.cfg.%sConfig" % name)
            for group, p in described(config.config_description):
                what = "%s: %s" % (name, p["name"])
                self.assertNotEqual(group, "Default", what)
                self.assertGreater(len(p["description"]), 5, what)
                if p["type"] in ("double", "int"):
                    self.assertRegex(p["description"], r"\[[^\]]+\]$", what)
                    self.assertTrue(p["min"] <= p["default"] <= p["max"], what)
                    self.assertTrue(p["min"] < p["max"] <= 1e6, what)

    def test_listed_and_set(self):
        harness.wait_for(
            lambda: (
                rospy.has_param("/controller/k_phi_2")
                and rospy.has_param("/visualizer/rate")
                and rospy.has_param("/simulator/latency")
            ),
            30,
            "the nodes",
        )
        listed = parameters()
        self.assertEqual(listed.returncode, 0, listed.stderr)
        for line in (
            r"^/controller$",
            r"^    k_e .* Position error \[kg/s\] \(1e-06 to 100\)$",
            r"^    reference +circle  Kind of reference \(circle, line, ",
            r"^/sender$",
            r"^/mocap_state$",
            r"^/live_comparison$",
            r"^/simulator$",
            r"^/visualizer$",
        ):
            self.assertIsNotNone(re.search(line, listed.stdout, re.M), line)

        self.assertLess(max(map(len, listed.stdout.splitlines())), 80)
        self.check_changes()
        self.check_undo()
        self.check_refusals()
        self.assertEqual(rospy.get_param("/controller/k_e"), 0.125)

    def check_changes(self):
        """Changes of parameters and model are published and logged."""
        log = harness.Latest("/rosout", Log, keep=True)
        changes = harness.Latest("live_changes", LiveChange, keep=True)
        harness.wait_for(lambda: changes.connections() and log.connections() > 1, 10, "connections")
        done = parameters("controller", "k_e=0.125", "reference=line")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("/controller k_e = 0.125", done.stdout)
        harness.wait_for(lambda: len(changes.all) >= 2, 5, "the changes")
        seen = sorted((c.node, c.name, c.before, c.after) for _, c in changes.all)
        before = seen[0][2]
        self.assertEqual(
            seen, [("controller", "k_e", before, "0.125"), ("controller", "reference", "circle", "line")]
        )
        line = "controller: k_e %s -> 0.125, reference circle -> line" % before
        harness.wait_for(lambda: line in [m.msg for _, m in log.all], 5, "a line in the log")

        model = rospy.get_param("/controller/model")
        other = os.path.join(CFG, "hovercraft", "tiny_whoover_4_1.yaml")
        answer = rospy.ServiceProxy("/controller/load_model", LoadModel)(file=other)
        self.assertTrue(answer.success, answer.message)
        harness.wait_for(lambda: len(changes.all) == 3, 5, "the model's change")
        change = changes.message
        self.assertEqual(
            (change.node, change.name, change.before, change.after), ("controller", "model", model, other)
        )
        self.assertEqual(rospy.get_param("/controller/k_e"), 0.125)
        self.assertEqual(rospy.get_param("/controller/reference"), "line")

    def check_undo(self):
        """Changes are undone one by one, the last first."""
        was = rospy.get_param("/visualizer/rate")
        for value in (7.0, 8.0):
            self.assertEqual(parameters("visualizer", "rate=%g" % value).returncode, 0)
        for value in (7.0, was):
            undone = parameters("visualizer", "--undo")
            self.assertIn("/visualizer rate = %g" % value, undone.stdout, undone.stderr)
            self.assertEqual(rospy.get_param("/visualizer/rate"), value)
        undone = parameters("visualizer", "--undo")
        self.assertEqual(undone.returncode, 1)
        self.assertIn("no change to undo", undone.stderr)

    def check_refusals(self):
        for arguments, reason in (
            (("controller", "k_e=-1"), "k_e must be between 1e-06 and 100 kg/s, not -1"),
            (("controller", "k_e=fast"), "is not a number"),
            (("controller", "wings=2"), "has no parameter wings; rosrun ground parameters controller"),
            (("controller", "sise=2"), "did you mean size"),
            (("nobody", "k_e=1"), "no running node of this name.*/controller"),
            (("controller", "reference=file"), "refused"),
        ):
            refused = parameters(*arguments)
            self.assertEqual(refused.returncode, 1, arguments)
            self.assertRegex(refused.stderr, reason)
            self.assertNotIn("Traceback", refused.stderr)


if __name__ == "__main__":
    rospy.init_node("parameters_test")
    rostest.rosrun("ground", "parameters_test", ParametersTest)
