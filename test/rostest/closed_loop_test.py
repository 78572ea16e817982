#!/usr/bin/python3
"""Simulated room, mocap_state, tracking controller and sender, through UDP on loopback."""
import math
import os
import sys
import unittest

import rospy
import rostest
from ground_msgs.msg import Controls, ControllerStatus, Reference, SenderStatus, State, Telemetry
from nav_msgs.msg import Path
from visualization_msgs.msg import MarkerArray

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import harness

MIN_DIFFERENCE = 0.1  # difference of the inputs above which its yaw moment exceeds all others


class ClosedLoopTest(unittest.TestCase):
    def setUp(self):
        self.state = harness.Latest("state", State, keep=True)
        self.truth = harness.Latest("simulator/truth", State, keep=True)
        self.reference = harness.Latest("reference", Reference, keep=True)
        self.status = harness.Latest("controller/status", ControllerStatus)
        self.sender = harness.Latest("sender/status", SenderStatus)
        self.telemetry = harness.Latest("sender/telemetry", Telemetry)
        self.controls = harness.Latest("controls", Controls, keep=True)
        self.measured = harness.Latest("path/measured", Path)
        self.predicted = harness.Latest("path/predicted", Path)
        self.markers = harness.Latest("markers", MarkerArray)

    def test_tracks_the_circle(self):
        status, sender = self.status, self.sender
        harness.wait_for(
            lambda: status.message and status.message.state == ControllerStatus.RUNNING,
            30,
            "RUNNING",
        )
        harness.wait_for(lambda: status.message.elapsed > 40, 40, "40 s of tracking")
        self.assertEqual(status.message.state, ControllerStatus.RUNNING, status.message.reason)
        self.assertEqual(sender.message.state, SenderStatus.ARMED, sender.message.reason)
        self.assertEqual(sender.message.malformed + sender.message.refused, 0)
        truths = {round(m.header.stamp.to_sec(), 2): m for _, m in self.truth.all}
        self.check_tracking_error()
        self.check_state(truths)
        self.check_turning(truths)
        self.check_displays()

    def check_tracking_error(self):
        """The default controller is predictive: the bound allows for delays of a busy host."""
        references = {round(m.header.stamp.to_sec(), 3): m for _, m in self.reference.all}
        errors = []
        for _, m in self.state.all:
            r = references.get(round(m.header.stamp.to_sec(), 3))
            if r and len(errors) < 10**6:
                errors.append(math.hypot(m.eta[0] - r.p[0], m.eta[1] - r.p[1]))
        late = errors[len(errors) // 2 :]
        rms = math.sqrt(sum(e * e for e in late) / len(late))
        print("tracking error %.4f m RMS over %d samples" % (rms, len(late)))
        self.assertGreater(len(late), 500)
        self.assertLess(rms, 0.05)

    def check_state(self, truths):
        """The state agrees with the true state of its stamp."""
        off, speed = [], []
        for _, m in self.state.all:
            t = truths.get(round(m.header.stamp.to_sec(), 2))
            if m.valid and t:
                off.append(math.hypot(m.eta[0] - t.eta[0], m.eta[1] - t.eta[1]))
                speed.append(math.hypot(m.nu[0] - t.nu[0], m.nu[1] - t.nu[1]))
        self.assertGreater(len(off), 500)
        self.assertLess(sorted(off)[len(off) // 2], 0.01)
        self.assertLess(sorted(speed)[len(speed) // 2], 0.08)

    def check_turning(self, truths):
        """Thrust of the left side alone turns the craft clockwise seen from above: r grows."""
        pairs = 0
        rising = 0
        commands = [(m.header.stamp.to_sec(), m.left - m.right) for _, m in self.controls.all]
        for (t, difference), (following, _) in zip(commands, commands[1:]):
            if abs(difference) < MIN_DIFFERENCE or following - t < 0.015:
                continue
            here = truths.get(round(t + 0.01, 2))
            if here:
                pairs += 1
                rising += (here.nu_dot[2] > 0) == (difference > 0)
        print("%d pairs" % pairs)
        self.assertGreater(pairs, 50)
        self.assertGreater(rising / pairs, 0.9)

    def check_displays(self):
        """Telemetry, paths and markers agree with the motion."""
        self.assertAlmostEqual(
            self.telemetry.message.yaw,
            math.degrees(math.remainder(self.truth.message.eta[2], 2 * math.pi)),
            delta=90,
        )
        self.assertGreater(len(self.measured.message.poses), 50)
        self.assertGreater(len(self.predicted.message.poses), 20)
        self.assertEqual(self.measured.message.header.frame_id, "world_ned")
        self.assertEqual(len(self.markers.message.markers), 8)
        # The predicted path ends near the measurement of that time.
        last = self.predicted.message
        end = last.poses[-1].pose.position
        states = [m for _, m in self.state.all]
        then = min(states, key=lambda m: abs(m.header.stamp - last.header.stamp))
        self.assertLess(math.hypot(end.x - then.eta[0], end.y - then.eta[1]), 0.5)


if __name__ == "__main__":
    rospy.init_node("closed_loop_test")
    rostest.rosrun("ground", "closed_loop_test", ClosedLoopTest)
