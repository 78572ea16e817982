"""Base class of tests in which a controller drives a simulated craft through UDP along a reference."""

import unittest

import harness
import numpy as np
import rospy
from ground_msgs.msg import ControllerStatus, Controls, Reference, State
from std_srvs.srv import Trigger

S = ControllerStatus


class ClosedLoopCase(unittest.TestCase):
    def setUp(self):
        self.truth = harness.Latest("simulator/truth", State, keep=True)
        self.reference = harness.Latest("reference", Reference, keep=True)
        self.controls = harness.Latest("controls", Controls, keep=True)
        self.status = harness.Latest("controller/status", S, keep=True)

    def expect(self, state):
        harness.wait_for_state(self.status, state)

    def places(self, heard, get):
        """Times [s], x and y [m] of all messages, (n, 3)."""
        return np.array([(m.header.stamp.to_sec(), *get(m)[:2]) for _, m in list(heard.all)])

    def check_error(self, begin, watched, bound):
        """The craft has been near its reference for some time [s] since an instant [s]."""
        truth = self.places(self.truth, lambda m: m.eta)
        reference = self.places(self.reference, lambda m: m.p)
        reference = reference[(reference[:, 0] > begin) & (reference[:, 0] <= truth[-1, 0])]
        self.assertGreater(len(reference), 25 * watched)
        off = [np.interp(reference[:, 0], truth[:, 0], truth[:, i]) - reference[:, i] for i in (1, 2)]
        error = np.sqrt(np.square(off).sum(axis=0).mean())
        print("error: %.1f mm" % (1e3 * error))
        self.assertLess(error, bound)

    def check_stop(self):
        """After a stop every channel has the command 0."""
        rospy.ServiceProxy("controller/stop", Trigger)()
        self.expect(S.STOPPED)
        harness.wait_for(
            lambda: not any(self.controls.message.thrusters) and self.controls.message.lift == 0,
            10,
            "zero commands",
        )
