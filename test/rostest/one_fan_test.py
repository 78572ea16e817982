#!/usr/bin/python3
"""A hovercraft with one fan and a rudder in its stream, driven through UDP along a circle or a line: it stays
in the room, near the reference, and has no thrust after a stop."""

import harness
import numpy as np
import rospy
import rostest
from closed_loop_case import ClosedLoopCase, S

ROOM = 2.0  # half the side of the room [m]


class OneFanTest(ClosedLoopCase):
    def test_it_follows_its_reference(self):
        self.expect(S.RUNNING)
        harness.pass_time(rospy.get_param("~settling"))
        begin = rospy.Time.now().to_sec()
        watched = rospy.get_param("~watched")
        harness.pass_time(watched)
        self.assertEqual(self.status.message.state, S.RUNNING, self.status.message.reason)
        self.assertLess(
            np.abs(self.places(self.truth, lambda m: m.eta)[:, 1:]).max(), ROOM, "it left the room"
        )
        self.check_error(begin, watched, rospy.get_param("~bound"))
        self.check_commands()
        self.check_stop()

    def check_commands(self):
        """The fan only pushes; the rudder moves to both sides within its range."""
        self.assertEqual(tuple(self.controls.message.channels), ("fan", "rudder", "lift"))
        driven = np.array([m.thrusters for _, m in self.controls.all if m.header.frame_id])
        self.assertTrue(((driven[:, 0] >= 0) & (driven[:, 0] <= 1)).all())
        self.assertTrue((np.abs(driven[:, 1]) <= 1).all())
        self.assertGreater(driven[:, 0].max(), 0.1)
        self.assertGreater(np.ptp(driven[:, 1]), 0.1)


if __name__ == "__main__":
    rospy.init_node("one_fan_test")
    rostest.rosrun("ground", "one_fan_test", OneFanTest)
