#!/usr/bin/python3
"""A simulated discovery whose sender is in FAULT goes on without a hand, and repeats the flight."""

import dynamic_reconfigure.client
import harness
import rospy
import rostest
from discovery_case import DiscoveryCase
from ground_msgs.msg import ControllerStatus, SenderStatus


class BusyTest(DiscoveryCase):
    helped = False

    def drives(self):
        return self.controller.message.state == ControllerStatus.RUNNING and (
            self.controller.message.elapsed > 0.5
        )

    def state(self):
        return self.sender.message.state

    def fault(self, node, bad, reason):
        """Puts the sender into FAULT by a parameter of a node, and waits until the craft drives again."""
        client = dynamic_reconfigure.client.Client(node, timeout=60)
        before = client.get_configuration(timeout=10)
        client.update_configuration(bad)
        harness.wait_for(lambda: self.state() == SenderStatus.FAULT, 20, "a FAULT")
        self.assertIn(reason, self.sender.message.reason)
        client.update_configuration({name: before[name] for name in bad})
        client.close()
        harness.wait_for(
            lambda: self.state() == SenderStatus.ARMED and self.drives(), 60, lambda: "said: " + self.said()
        )

    def test_the_flight_is_repeated(self):
        self.wait_until_it_drives()
        # as a computer without time for the mocap's node, and for the controller
        self.fault("simulator", {"loss": 1.0}, "the state")
        self.fault("sender", {"command_timeout": 0.02}, "commands are stale")
        self.assertEqual(self.discovery.message.flights, 0)
        harness.wait_for(lambda: self.discovery.message.flights == 1, 120, self.said)
        (flown,) = self.check_folder()["flights"]
        self.assertEqual(flown["stopped"], "")
        self.check_room()


if __name__ == "__main__":
    rospy.init_node("discover_busy_test")
    rostest.rosrun("ground", "discover_busy_test", BusyTest)
