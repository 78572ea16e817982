#!/usr/bin/python3
"""The craft's gyro and accelerometer, as a launch file takes them: they count, and velocities are better."""

import unittest

import harness
import numpy as np
import rospy
import rostest
from ground_msgs.msg import ControllerStatus, State, Telemetry
from rosgraph_msgs.msg import Log

WATCHED = 5.0  # [s]
YAW_RATE = 0.04  # rms error of the yaw rate [rad/s]; by poses alone it is three times as large
SPEED = 0.015  # rms error of u and v [m/s]


class CraftSensorsTest(unittest.TestCase):
    def setUp(self):
        self.log = harness.Latest("/rosout", Log, keep=True)
        self.status = harness.Latest("controller/status", ControllerStatus, keep=True)
        self.state = harness.Latest("state", State, keep=True)
        self.truth = harness.Latest("simulator/truth", State, keep=True)
        self.telemetry = harness.Latest("sender/telemetry", Telemetry)

    def last_without(self):
        """Stamp of the last state without the sensors [s]; they may cease to count while the craft starts."""
        without = [m for _, m in list(self.state.all) if m.inertial_variance[2] == 0]
        return without[-1].header.stamp.to_sec() if without else float("inf")

    def test_velocities_are_better_by_the_sensors(self):
        self.assertAlmostEqual(rospy.get_param("mocap_state/imu/gyro_scale"), 0.0010642)
        harness.wait_for_state(self.status, ControllerStatus.RUNNING)
        harness.wait_for(lambda: self.telemetry.message, 10, "telemetry")
        self.assertEqual(self.telemetry.message.voltage, 0, "this craft has no battery")
        harness.wait_for(
            lambda: self.state.message.header.stamp.to_sec() - self.last_without() > WATCHED,
            150,
            lambda: "sensors that count: %s" % [m.msg for _, m in list(self.log.all)][-5:],
        )
        self.assertTrue(any("agree with the poses" in m.msg for _, m in list(self.log.all)))
        begin = self.last_without()
        seen, true = (
            np.array([(m.header.stamp.to_sec(), *m.nu) for _, m in list(heard.all)])
            for heard in (self.state, self.truth)
        )
        seen = seen[(seen[:, 0] > begin) & (seen[:, 0] < true[-1, 0])]
        off = [np.interp(seen[:, 0], true[:, 0], true[:, i]) - seen[:, i] for i in (1, 2, 3)]
        error = np.sqrt(np.square(off).mean(axis=1))
        print("rms errors of u, v [m/s], r [rad/s]: %s" % np.round(error, 4))
        self.assertGreater(len(seen), 50 * WATCHED)
        sensed = [m for _, m in list(self.state.all) if m.header.stamp.to_sec() > begin]
        self.assertLess(max(m.inertial_span for m in sensed), 0.1)
        self.assertLess(error[2], YAW_RATE)
        self.assertLess(np.hypot(*error[:2]), 2**0.5 * SPEED)


if __name__ == "__main__":
    rospy.init_node("craft_sensors_test")
    rostest.rosrun("ground", "craft_sensors_test", CraftSensorsTest)
