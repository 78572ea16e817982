#!/usr/bin/python3
"""Mocap poses to state: validity, stamps, frames."""

import math
import time
import unittest

import dynamic_reconfigure.client
import harness
import rospy
import rostest
import tf2_ros
from geometry_msgs.msg import PoseStamped
from ground_msgs.msg import MocapSettings, State
from nav_msgs.msg import Odometry

POSE = "vrpn_client_node/hovercraft/pose"


class MocapStateTest(unittest.TestCase):
    def setUp(self):
        self.state = harness.Latest("state", State, keep=True)
        self.odometry = harness.Latest("odometry", Odometry, keep=True)
        self.publisher = rospy.Publisher(POSE, PoseStamped, queue_size=10, tcp_nodelay=True)
        harness.wait_for(self.publisher.get_num_connections, 20, "a subscriber")
        # Wait until the node reports the end of the last test's poses, and for its max_gap.
        harness.wait_for(lambda: self.state.message and "no pose" in self.state.message.status, 5, "silence")
        time.sleep(0.5)
        self.state.all.clear()

    def play(self, duration, rate_of_turn=1.0, spoil=None):
        """Publishes poses of a craft that moves along x at 0.5 m/s and turns; returns the first stamp."""
        start = rospy.Time.now()
        for i in range(int(100 * duration)):
            stamp = start + rospy.Duration(0.01 * i)
            while rospy.Time.now() < stamp:
                time.sleep(0.0005)
            t = 0.01 * i
            pose = harness.optitrack_pose(0.5 * t, 0.2, rate_of_turn * t, stamp)
            for p in spoil(i, pose) if spoil else [pose]:
                self.publisher.publish(p)
        return start

    def valid_now(self):
        return self.state.message.valid

    def test_without_poses_the_state_is_invalid_with_a_reason(self):
        self.play(0.3)
        harness.wait_for(self.valid_now, 1, "a valid state")
        stopped = time.monotonic()
        harness.wait_for(lambda: not self.valid_now(), 1, "an invalid state")
        self.assertLess(time.monotonic() - stopped, 0.25)
        self.assertIn("no pose", self.state.message.status)
        count = len(self.state.all)
        harness.wait_for(lambda: len(self.state.all) >= count + 3, 1, "repeated invalid states")
        self.assertEqual(tuple(self.state.message.pose_covariance), (0,) * 9, "it has no new pose")

    def test_states_have_the_stamps_of_poses_and_velocities_in_the_body_frame(self):
        start = self.play(1.0)
        harness.wait_for(self.valid_now, 1, "a valid state")
        states = [m for _, m in self.state.all if m.valid]
        self.assertGreater(len(states), 80)
        ages = sorted(m.age for m in states[20:])
        self.assertLess(ages[int(0.9 * len(ages))], 0.05)
        for m in states[20:]:
            t = (m.header.stamp - start).to_sec()
            self.assertAlmostEqual(100 * t, round(100 * t), 3)
            self.assertAlmostEqual(m.eta[0], 0.5 * t, 2)
            self.assertAlmostEqual(m.eta[2], t, 2)
            self.assertAlmostEqual(m.nu[0], 0.5 * math.cos(t), 1)
            self.assertAlmostEqual(m.nu[1], -0.5 * math.sin(t), 1)
            self.assertAlmostEqual(m.nu[2], 1.0, 1)
            self.assertAlmostEqual(m.pose[0], 0.5 * t, 6)
            self.assertAlmostEqual(m.pose[2], t, 6)
            self.assertGreaterEqual(m.pose_covariance[0], 0.99 * 5e-4**2)
            self.assertEqual(tuple(m.inertial_variance), (0, 0, 0))
        self.assertEqual(self.state.message.header.frame_id, "world_ned")

    def test_odometry_and_tf_agree_and_the_world_is_z_up(self):
        buffer = tf2_ros.Buffer()
        listener = tf2_ros.TransformListener(buffer)
        self.play(0.6, rate_of_turn=2.0)
        odometry = harness.wait_for(lambda: self.odometry.message, 1, "odometry")
        self.assertEqual(odometry.header.frame_id, "world_ned")
        self.assertEqual(odometry.child_frame_id, "hovercraft")
        self.assertAlmostEqual(odometry.twist.twist.angular.z, 2.0, 1)
        harness.wait_for(lambda: buffer.can_transform("world", "hovercraft", rospy.Time(0)), 3, "tf")
        down = buffer.lookup_transform("world", "world_ned", rospy.Time(0)).transform.rotation
        self.assertAlmostEqual(abs(down.x), 1, 6)

        def yaw_in_world(t):
            q = t.transform.rotation
            # direction of the craft's x axis in the z-up world
            x = 1 - 2 * (q.y**2 + q.z**2)
            y = 2 * (q.x * q.y + q.w * q.z)
            return math.atan2(y, x)

        psi = self.state.message.eta[2]
        seen = yaw_in_world(buffer.lookup_transform("world", "hovercraft", rospy.Time(0)))
        self.assertGreater(psi, 0.8)
        # psi grows clockwise seen from above: the yaw about the world's upward z falls.
        self.assertAlmostEqual(seen, -psi, 1)
        listener.unregister()

    def since_first_valid(self):
        messages = [m for _, m in self.state.all]
        first = next(i for i, m in enumerate(messages) if m.valid)
        return messages[first:]

    def test_a_gap_is_reported_and_ends(self):
        self.play(1.2, spoil=lambda i, pose: [] if 60 <= i < 80 else [pose])
        states = self.since_first_valid()
        gap = [m for m in states if not m.valid and "no pose" in m.status]
        self.assertGreater(len(gap), 0)
        before = [m for m in states if m.valid and m.header.stamp <= gap[0].header.stamp]
        self.assertEqual(gap[0].header.stamp, before[-1].header.stamp, "the stamp of the last pose")
        self.assertGreater(gap[0].age, 0.09)
        after = [m for m in states if m.header.stamp > gap[0].header.stamp]
        self.assertTrue(after[0].valid, "the first pose after the gap is used")
        self.assertGreater(len(after), 35)
        for m in after[:35]:
            self.assertLess(abs(math.hypot(m.nu[0], m.nu[1]) - 0.5), 0.1)
            self.assertLess(abs(m.nu[2] - 1.0), 0.2)

    def test_poses_that_are_not_finite_make_the_state_invalid(self):
        def spoil(i, pose):
            if i >= 50:
                pose.pose.position.x = math.nan
            return [pose]

        self.play(0.7, spoil=spoil)
        self.assertFalse(self.valid_now())
        self.assertTrue(any("not finite" in m.status for _, m in self.state.all))
        for _, m in self.state.all:
            self.assertTrue(all(map(math.isfinite, list(m.eta) + list(m.nu))))

    def test_stamps_that_are_old_or_missing_make_the_state_invalid(self):
        def late(i, pose):
            pose.header.stamp -= rospy.Duration(3.0)
            return [pose]

        self.play(0.3, spoil=late)
        harness.wait_for(
            lambda: any("too old" in m.status and not m.valid for _, m in self.state.all), 1, "old"
        )
        self.assertFalse(any(m.valid for _, m in self.state.all))

        def without(i, pose):
            pose.header.stamp = rospy.Time()
            return [pose]

        self.play(0.2, spoil=without)
        harness.wait_for(lambda: any("no stamp" in m.status for _, m in self.state.all), 1, "without stamp")
        self.assertFalse(any(m.valid for _, m in self.state.all))

    def test_parameters_change_live_and_bad_ones_are_refused(self):
        client = dynamic_reconfigure.client.Client("mocap_state", timeout=10)
        answer = client.update_configuration({"gate": 0.5})
        self.assertEqual(answer["gate"], 6)
        client.update_configuration({"heading_offset": 0.5})
        self.play(0.3, rate_of_turn=0.0)
        harness.wait_for(self.valid_now, 1, "a valid state")
        self.assertAlmostEqual(self.state.message.eta[2], -0.5, 6)
        # Recordings need the settings and the pose from which they apply.
        settings = harness.Latest("mocap_state/settings", MocapSettings)
        harness.wait_for(lambda: settings.message, 5, "the latched settings")
        self.assertEqual((settings.message.axes, settings.message.heading_offset), ("x, z, -y", 0.5))
        client.update_configuration({"heading_offset": 0.0})
        harness.wait_for(lambda: settings.message.heading_offset == 0, 5, "the new settings")
        last = lambda: self.state.message.header.stamp  # noqa: E731
        harness.wait_for(lambda: settings.message.header.stamp == last(), 5, "the stamp of the last state")
        client.close()


if __name__ == "__main__":
    rospy.init_node("mocap_state_test")
    rostest.rosrun("ground", "mocap_state_test", MocapStateTest)
