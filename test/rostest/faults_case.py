"""What the tests of faults share: arming and starting, how a fault ends, a test for each row of a table."""

import os
import re
import unittest

import harness
import rospy
from ground_msgs.msg import ControllerStatus, SenderStatus
from std_srvs.srv import SetBool, Trigger

# How a fault ends: the controller drives on; it stops; it stops and the sender is in FAULT.
GOES_ON, STOPS, FAULTS = "goes on", "stops", "stops, FAULT"
RUNNING, STOPPED = ControllerStatus.RUNNING, ControllerStatus.STOPPED


class FaultsCase(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.status = harness.Latest("controller/status", ControllerStatus, keep=True)
        cls.sender = harness.Latest("sender/status", SenderStatus, keep=True)
        for name, kind in (("arm", SetBool), ("start", Trigger), ("stop", Trigger)):
            full = ("sender/" if name == "arm" else "controller/") + name
            rospy.wait_for_service(full, 30)
            setattr(cls, name, staticmethod(rospy.ServiceProxy(full, kind)))

    def expect(self, state, timeout=5):
        harness.wait_for_state(self.status, state, timeout)

    def run_again(self):
        """Arms and starts if necessary."""
        harness.wait_for(lambda: self.status.message.state != ControllerStatus.RECOVERING, 5, "the recovery")
        if self.status.message.state != RUNNING or self.sender.message.state != SenderStatus.ARMED:
            self.stop()
            harness.wait_for(lambda: self.status.message.state != RUNNING, 5, "a stop")
            self.arm(False)
            harness.wait_for(lambda: self.arm(True).success, 15, "an armed sender")
            self.assertTrue(self.start().success)
            self.expect(RUNNING, 15)

    def ended(self, ending, begun):
        """Checks the states of controller and sender since a time."""
        states = {m.state for at, m in self.status.all if at > begun}
        faults = {m.state for at, m in self.sender.all if at > begun}
        if ending == GOES_ON:
            self.assertFalse(states & {STOPPED}, self.status.message.reason)
            self.assertFalse(faults & {SenderStatus.FAULT}, self.sender.message.reason)
        else:
            self.assertIn(STOPPED, states)
        if ending == FAULTS:
            self.assertIn(SenderStatus.FAULT, faults)

    def print(self, name, ending, what):
        print("fault: %-38s %-12s %s" % (name, ending, what))


def add_tests(case, function, rows):
    """Adds a test to a case for each row, because rosunit does not count failures in subTest. The environment
    variable FAULTS, a regular expression, chooses rows."""
    for row in rows:
        if re.search(os.environ.get("FAULTS", ""), row[0]):
            name = "test_" + re.sub(r"\W+", "_", row[0])
            setattr(case, name, lambda self, row=row: function(self, *row))
