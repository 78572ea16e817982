#!/usr/bin/python3
"""The identification node says at once why nothing arrives, and when it does."""

import os
import sys
import time
import unittest

import rospy
import rostest
from geometry_msgs.msg import PointStamped, PoseStamped
from ground_msgs.msg import Controls, IdentificationStatus

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import harness

POSE = "/vrpn_client_node/hovercraft/pose"


class IdentificationSilentTest(unittest.TestCase):
    def test_silent_topics_are_named_within_five_seconds(self):
        wrong = rospy.Publisher(POSE, PointStamped, queue_size=1)
        other = rospy.Publisher("/elsewhere/controls", Controls, queue_size=1)
        status = harness.Latest("identification/status", IdentificationStatus)
        harness.wait_for(lambda: status.message, 20, "the node")
        began = time.monotonic()
        harness.wait_for(
            lambda: "nothing arrives on" in status.message.message, 5, lambda: status.message.message
        )
        self.assertLess(time.monotonic() - began, 5)
        text = status.message.message
        self.assertEqual(status.message.state, IdentificationStatus.IDLE)
        self.assertIn("%s (geometry_msgs/PoseStamped): its publisher sends" % POSE, text)
        self.assertIn("/controls (ground_msgs/Controls): it has no publisher: remap one of /elsewhere", text)
        wrong.unregister()
        other.unregister()
        poses = rospy.Publisher(POSE, PoseStamped, queue_size=1)
        controls = rospy.Publisher("/controls", Controls, queue_size=1)

        def heard():
            poses.publish(PoseStamped())
            controls.publish(Controls())
            return status.message.message == "poses and commands arrive"

        harness.wait_for(heard, 15, lambda: status.message.message)


if __name__ == "__main__":
    rospy.init_node("identification_silent_test")
    rostest.rosrun("ground", "identification_silent_test", IdentificationSilentTest)
