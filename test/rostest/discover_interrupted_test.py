#!/usr/bin/python3
"""A discovery that is disarmed in flight, killed, stopped by hand and interrupted goes on each time."""

import os
import shutil
import signal
import subprocess
import tempfile

import harness
import roslib.packages
import rospy
import rostest
from discovery_case import DiscoveryCase, thrust
from ground_msgs.msg import ControllerStatus, SenderStatus
from std_srvs.srv import Trigger

LIMIT = 0.3  # longest thrust after a fault [s]
PROGRAM = roslib.packages.find_node("ground", "discover")[0]


class InterruptedTest(DiscoveryCase):
    def setUp(self):
        super().setUp()
        self.folder = tempfile.mkdtemp(prefix="ground-discovery-")
        self.addCleanup(shutil.rmtree, self.folder)
        rospy.set_param("discovery/folder", self.folder)
        self.process = None
        self.addCleanup(self.end)

    def begin(self):
        self.discovery.message = None
        self.process = subprocess.Popen([PROGRAM, "__name:=discovery"])

    def end(self, number=signal.SIGKILL):
        if self.process.poll() is None:
            self.process.send_signal(number)
        return self.process.wait(20)

    def check_thrust_since(self, stamp):
        """No thrust is commanded LIMIT after a stamp, until the next start."""
        harness.wait_for(
            lambda: (self.controls.message.header.stamp - stamp).to_sec() > 2 * LIMIT,
            10,
            "commands after the fault",
        )
        late = [
            m for _, m in self.controls.all
            if LIMIT < (m.header.stamp - stamp).to_sec() < 2 * LIMIT and thrust(m) > 0
        ]  # fmt: skip
        self.assertEqual(late, [])

    def flights(self):
        return self.discovery.message.flights if self.discovery.message else 0

    def test_goes_on_from_its_journal(self):
        self.begin()
        self.wait_until_it_says("arm by hand")
        self.arm()
        self.disarmed_in_flight()
        before = self.flights()
        self.killed_in_flight()
        self.stopped_by_hand()
        self.assertGreaterEqual(self.flights(), before)
        self.begin()
        self.wait_until_it_drives()
        self.assertEqual(self.end(signal.SIGINT), 0)
        self.check_rest()

        before = self.flights()
        self.begin()
        harness.wait_for(lambda: self.flights() > before, 300, "another flight")
        self.assertEqual(self.end(signal.SIGINT), 0)
        self.check_room()
        journal = self.check_folder()
        self.assertEqual([f["flight"]["number"] for f in journal["flights"]],
                         list(range(1, len(journal["flights"]) + 1)))  # fmt: skip
        self.assertIn("not armed", journal["flights"][0]["stopped"])

    def disarmed_in_flight(self):
        """Thrust ends, and nothing is flown until the sender is armed again."""
        self.wait_until_it_drives()
        stamp = self.controls.message.header.stamp
        self.arm(False)
        self.check_thrust_since(stamp)
        self.wait_until_it_says("arm by hand")
        self.assertEqual(self.flights(), 1)
        self.assertEqual(self.sender.message.state, SenderStatus.DISARMED)
        self.assertNotEqual(self.controller.message.state, ControllerStatus.RUNNING)
        self.arm()

    def killed_in_flight(self):
        """The recording ends with the node, the flight at the latest with the next start."""
        self.wait_until_it_drives()
        self.end()
        harness.wait_for(lambda: not self.recorders(), 20, "the end of the recorder")
        self.begin()
        harness.wait_for_state(self.controller, ControllerStatus.STOPPED, 60)
        self.wait_until_it_drives()

    def stopped_by_hand(self):
        """The craft is stopped; the next start goes on."""
        stamp = self.controls.message.header.stamp
        answer = rospy.ServiceProxy("discovery/stop", Trigger)()
        self.assertTrue(answer.success, answer.message)
        self.check_thrust_since(stamp)
        self.wait_until_it_ends(60)
        self.assertEqual(self.discovery.message.reason, "stopped by hand")
        self.check_rest()
        self.assertEqual(self.end(signal.SIGINT), 0)

    def recorders(self):
        return [name for name in os.listdir(self.folder) if name.endswith(".active")]


if __name__ == "__main__":
    rospy.init_node("discover_interrupted_test")
    rostest.rosrun("ground", "discover_interrupted_test", InterruptedTest)
