#!/usr/bin/python3
"""A hovercraft with one fan and a rudder in its stream, driven through UDP along a circle or a line: it stays
in the room, near the reference, and has no thrust after a stop."""

import os
import sys
import unittest

import numpy as np
import rospy
import rostest
from ground_msgs.msg import ControllerStatus, Controls, Reference, SenderStatus, State
from std_srvs.srv import Trigger

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import harness

S = ControllerStatus
ROOM = 2.0  # half the side of the room [m]


class OneFanTest(unittest.TestCase):
    def setUp(self):
        self.truth = harness.Latest("simulator/truth", State, keep=True)
        self.reference = harness.Latest("reference", Reference, keep=True)
        self.sender = harness.Latest("sender/status", SenderStatus, keep=True)
        self.controls = harness.Latest("controls", Controls, keep=True)
        self.status = harness.Latest("controller/status", S, keep=True)

    def expect(self, state):
        harness.wait_for(
            lambda: self.status.message and self.status.message.state == state, 40, "state %d" % state
        )

    def sleep(self, duration):
        until = rospy.Time.now().to_sec() + duration
        harness.wait_for(lambda: rospy.Time.now().to_sec() > until, 10 * duration, "time")

    def test_it_follows_its_reference(self):
        self.expect(S.RUNNING)
        self.sleep(rospy.get_param("~settling"))
        begin = rospy.Time.now().to_sec()
        self.sleep(rospy.get_param("~watched"))
        self.assertEqual(self.status.message.state, S.RUNNING, self.status.message.reason)
        self.check_error(begin, rospy.get_param("~bound"))
        self.check_commands()
        self.check_stop()

    def check_error(self, begin, bound):
        truth, reference = (
            np.array([(m.header.stamp.to_sec(), *get(m)[:2]) for _, m in list(heard.all)])
            for heard, get in ((self.truth, lambda m: m.eta), (self.reference, lambda m: m.p))
        )
        self.assertLess(np.abs(truth[:, 1:]).max(), ROOM, "it left the room")
        reference = reference[(reference[:, 0] > begin) & (reference[:, 0] <= truth[-1, 0])]
        off = [np.interp(reference[:, 0], truth[:, 0], truth[:, i]) - reference[:, i] for i in (1, 2)]
        error = np.sqrt(np.square(off).sum(axis=0).mean())
        print("error: %.1f mm" % (1e3 * error))
        self.assertLess(error, bound)

    def check_commands(self):
        """The fan only pushes; the rudder moves to both sides within its range."""
        self.assertEqual(tuple(self.controls.message.channels), ("fan", "rudder", "lift"))
        driven = np.array([m.thrusters for _, m in self.controls.all if m.header.frame_id])
        self.assertTrue(((driven[:, 0] >= 0) & (driven[:, 0] <= 1)).all())
        self.assertTrue((np.abs(driven[:, 1]) <= 1).all())
        self.assertGreater(driven[:, 0].max(), 0.1)
        self.assertGreater(np.ptp(driven[:, 1]), 0.1)

    def check_stop(self):
        """After a stop the fan is off and the rudder at its neutral position."""
        rospy.ServiceProxy("controller/stop", Trigger)()
        self.expect(S.STOPPED)
        harness.wait_for(
            lambda: self.controls.message.thrusters == (0.0, 0.0) and self.controls.message.lift == 0,
            10,
            "zero commands",
        )


if __name__ == "__main__":
    rospy.init_node("one_fan_test")
    rostest.rosrun("ground", "one_fan_test", OneFanTest)
