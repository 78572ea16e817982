#!/usr/bin/python3
"""An air-bearing table with eight jets in closed loop through UDP: all nodes command every thruster."""

import harness
import numpy as np
import rospy
import rostest
from closed_loop_case import ClosedLoopCase, S
from ground_msgs.msg import Controls, SenderStatus
from visualization_msgs.msg import MarkerArray

SETTLING = 10  # time to reach the circle [s]
WATCHED = 15  # [s]
BOUND = 0.02  # error of the predictive controller [m]; some millimetres without a network


class AnyThrustersTest(ClosedLoopCase):
    def setUp(self):
        super().setUp()
        self.sender = harness.Latest("sender/status", SenderStatus, keep=True)
        self.wanted = harness.Latest("controls/wanted", Controls)
        self.markers = harness.Latest("markers", MarkerArray)

    def test_it_follows_a_circle(self):
        self.expect(S.RUNNING)
        harness.pass_time(SETTLING)
        begin = rospy.Time.now().to_sec()
        harness.pass_time(WATCHED)
        self.check_error(begin, WATCHED, BOUND)
        self.check_commands()
        self.check_a_command_for_another_craft()
        self.assertEqual(self.status.message.state, S.RUNNING, self.status.message.reason)
        self.check_stop()

    def check_commands(self):
        """Every jet is used; commands and wanted ones name the channels of the model."""
        channels = self.controls.message.channels
        self.assertEqual(len(channels), 9)
        self.assertEqual((channels[0], channels[-1]), ("front_right_back", "air"))
        self.assertEqual(self.wanted.message.channels, channels)
        driven = np.array([m.thrusters for _, m in self.controls.all if m.header.frame_id])
        self.assertTrue((driven.max(axis=0) > 0.05).all(), driven.max(axis=0))
        self.assertTrue(((driven >= 0) & (driven <= 1)).all())
        harness.wait_for(lambda: self.markers.message, 10, "markers")
        self.assertEqual(len(self.markers.message.markers), 4 + 2 * 8)

    def check_a_command_for_another_craft(self):
        """The sender refuses the command of a left and a right thruster, and the craft drives on."""
        # advertised only now, because several publishers of commands prevent arming
        stranger = rospy.Publisher("controls", Controls, queue_size=4)
        harness.wait_for(lambda: stranger.get_num_connections() >= 2, 10, "the sender")
        refused = self.sender.message.refused
        message = Controls(left=1.0, right=1.0, lift=1.0)
        message.header.stamp = rospy.Time.now()
        stranger.publish(message)
        harness.wait_for(lambda: self.sender.message.refused > refused, 10, "a refused command")
        self.assertEqual(self.sender.message.state, SenderStatus.ARMED)


if __name__ == "__main__":
    rospy.init_node("any_thrusters_test")
    rostest.rosrun("ground", "any_thrusters_test", AnyThrustersTest)
