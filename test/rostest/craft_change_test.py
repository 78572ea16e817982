#!/usr/bin/python3
"""A thruster weakens in flight: it is named with its size and start, and the controller takes it."""

import os
import sys
import unittest

import numpy as np
import rospy
import rostest
from ground_msgs.msg import ControllerStatus, CraftChange, Drive, Reference, State
from ground_msgs.srv import LoadModel

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import harness

WEAK = os.path.join(os.path.dirname(os.path.abspath(__file__)), "weak_craft.yaml")
SETTLED = 10.0  # flight before the change [s]
NAMED = 3.0  # time in which it is named [s]
RECOVERY = 5.0  # time after which the error is as before [s]


class CraftChangeTest(unittest.TestCase):
    def setUp(self):
        self.status = harness.Latest("controller/status", ControllerStatus, keep=True)
        self.change = harness.Latest("craft_change", CraftChange, keep=True)
        self.truth = harness.Latest("simulator/truth", State, keep=True)
        self.reference = harness.Latest("reference", Reference, keep=True)
        self.drive = harness.Latest("drive", Drive)

    def pass_time(self, duration):
        until = rospy.Time.now().to_sec() + duration
        harness.wait_for(lambda: rospy.Time.now().to_sec() > until, 10 * duration, "time")

    def error(self, begin, end):
        """RMS of the true position error between two times [m]."""
        truth, reference = (
            np.array([(m.header.stamp.to_sec(), *get(m)[:2]) for _, m in list(heard.all)])
            for heard, get in ((self.truth, lambda m: m.eta), (self.reference, lambda m: m.p))
        )
        reference = reference[(reference[:, 0] > begin) & (reference[:, 0] < end)]
        off = [np.interp(reference[:, 0], truth[:, 0], truth[:, i]) - reference[:, i] for i in (1, 2)]
        return float(np.sqrt(np.square(off).sum(axis=0).mean()))

    def test_a_weak_thruster_is_named_and_taken(self):
        harness.wait_for(
            lambda: self.status.message and self.status.message.state == ControllerStatus.RUNNING,
            40,
            "the craft to be driven",
        )
        self.pass_time(SETTLED)
        self.assertEqual({m.text for _, m in self.change.all}, {""}, "nothing has changed yet")
        began = rospy.Time.now().to_sec()
        answer = rospy.ServiceProxy("simulator/load_model", LoadModel)(file=WEAK)
        self.assertTrue(answer.success, answer.message)
        self.pass_time(NAMED)
        named = [m for _, m in self.change.all if m.text]
        self.assertTrue(named, "no change was named in %.0f s" % NAMED)
        self.pass_time(RECOVERY + 3)
        last = self.change.message
        print("first: %s\nlast: %s" % (named[0].text, last.text))
        self.assertEqual(last.what, ["left thruster"], last.text)
        self.assertLess(last.lower[0], -0.2)
        self.assertGreater(last.upper[0], -0.2)
        self.assertAlmostEqual(last.since[0], began - self.drive.message.began.to_sec(), delta=1.0)
        now = rospy.Time.now().to_sec()
        before, after = self.error(began - 5, began), self.error(began + RECOVERY, now)
        print("error before %.2f mm, after %.2f mm" % (1e3 * before, 1e3 * after))
        self.assertLess(after, max(1.3 * before, 2e-3))
        self.assertEqual(self.status.message.state, ControllerStatus.RUNNING, self.status.message.reason)


if __name__ == "__main__":
    rospy.init_node("craft_change_test")
    rostest.rosrun("ground", "craft_change_test", CraftChangeTest)
