"""Base class of the tests of controllers."""

import time
import unittest

import harness
import rospy
from ground_msgs.msg import ControllerStatus, Controls, SenderStatus
from std_srvs.srv import Trigger

S = ControllerStatus


class ControllerCase(unittest.TestCase):
    name = None

    def setUp(self):
        self.status = harness.Latest(self.name + "/status", S, keep=True)
        self.controls = harness.Latest(self.name + "/controls", Controls, keep=True)
        rospy.wait_for_service(self.name + "/start", 20)
        self.start = rospy.ServiceProxy(self.name + "/start", Trigger)
        self.stop = rospy.ServiceProxy(self.name + "/stop", Trigger)
        self.sender = rospy.Publisher("sender/status", SenderStatus, queue_size=1, latch=True)
        self.states = harness.StatePublisher()
        self.arm(True)
        harness.wait_for(lambda: self.status.message, 5, "a status")
        harness.wait_for(lambda: self.controls.message, 5, "commands")
        time.sleep(0.2)

    def tearDown(self):
        self.stop()
        self.states.stop()

    def arm(self, armed):
        self.sender.publish(SenderStatus(state=SenderStatus.ARMED if armed else SenderStatus.DISARMED))

    def expect(self, state, timeout=3):
        harness.wait_for(lambda: self.status.message.state == state, timeout, "status %d" % state)

    def run_it(self):
        self.assertTrue(self.start().success)
        self.expect(S.RUNNING)
