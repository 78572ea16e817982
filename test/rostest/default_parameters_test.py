#!/usr/bin/python3
"""Printed changes of live parameters beside the default launch, while the craft drives in its room."""
import os
import re
import subprocess
import sys
import unittest

import rospy
import rostest
from ground_msgs.msg import ControllerStatus, SenderStatus

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import harness

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
PROGRAM = "rosrun ground parameters"


def run(line):
    return subprocess.run(
        line.split("#")[0].split(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        universal_newlines=True,
        timeout=60,
    )


def printed():
    """The lines of the page and of the help that set parameters."""
    with open(os.path.join(ROOT, "docs", "watching.md")) as file:
        lines = re.findall(r"rosrun ground (parameters [^`\n#]*=[^`\n#]*)", file.read())
    help_text = run(PROGRAM + " --help").stdout
    lines += re.findall(r"^parameters \S+ (?:\S+=\S+ )+", help_text, re.M)
    return ["rosrun ground " + line for line in lines]


class DefaultParametersTest(unittest.TestCase):
    def setUp(self):
        self.status = harness.Latest("controller/status", ControllerStatus)
        self.sender = harness.Latest("sender/status", SenderStatus)
        harness.wait_for(
            lambda: self.status.message and self.status.message.state == ControllerStatus.RUNNING,
            30,
            "the craft drives",
        )

    def tearDown(self):
        self.assertEqual(self.status.message.state, ControllerStatus.RUNNING, self.status.message)
        self.assertEqual(self.sender.message.state, SenderStatus.ARMED, self.sender.message)

    def test_the_printed_lines_are_accepted(self):
        lines = printed()
        self.assertGreaterEqual(len(lines), 3, lines)
        for line in lines:
            done = run(line)
            self.assertEqual(done.returncode, 0, line + ": " + done.stderr)

    def test_the_reference_changes_from_its_default_size(self):
        for reference in ("rhodonea", "line", "circle"):
            done = run("%s controller reference=%s" % (PROGRAM, reference))
            self.assertEqual(done.returncode, 0, done.stderr)
            self.assertEqual(rospy.get_param("controller/reference"), reference)

    def test_a_reference_that_leaves_the_room_is_refused_with_a_size_that_fits(self):
        change = PROGRAM + " controller reference=rhodonea size=%s"
        refused = run(change % 3)
        self.assertEqual(refused.returncode, 1)
        self.assertEqual(len(refused.stderr.splitlines()), 1, refused.stderr)
        fitting = re.search(r"size=(\S+) fits$", refused.stderr.strip())
        self.assertIsNotNone(fitting, refused.stderr)
        self.assertEqual(run(change % (float(fitting.group(1)) + 0.02)).returncode, 1)
        done = run(change % fitting.group(1))
        self.assertEqual(done.returncode, 0, done.stderr)
        refused = run(PROGRAM + " controller reference=sinusoid")
        self.assertEqual(refused.returncode, 1)
        self.assertIn("no size fits", refused.stderr)
        run(PROGRAM + " controller reference=circle size=1")


if __name__ == "__main__":
    rospy.init_node("default_parameters_test")
    rostest.rosrun("ground", "default_parameters_test", DefaultParametersTest)
