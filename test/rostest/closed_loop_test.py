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

CLEAR = 0.1  # difference of the inputs whose yaw moment outweighs what else turns the craft


class ClosedLoopTest(unittest.TestCase):
    def test_tracks_the_circle(self):
        state = harness.Latest("state", State, keep=True)
        truth = harness.Latest("simulator/truth", State, keep=True)
        reference = harness.Latest("reference", Reference, keep=True)
        status = harness.Latest("controller/status", ControllerStatus)
        sender = harness.Latest("sender/status", SenderStatus)
        telemetry = harness.Latest("sender/telemetry", Telemetry)
        controls = harness.Latest("controls", Controls, keep=True)
        measured = harness.Latest("path/measured", Path)
        predicted = harness.Latest("path/predicted", Path)
        markers = harness.Latest("markers", MarkerArray)

        harness.wait_for(
            lambda: status.message and status.message.state == ControllerStatus.RUNNING,
            30,
            "RUNNING",
        )
        harness.wait_for(lambda: status.message.elapsed > 40, 40, "40 s of tracking")
        self.assertEqual(status.message.state, ControllerStatus.RUNNING, status.message.reason)
        self.assertEqual(sender.message.state, SenderStatus.ARMED, sender.message.reason)
        self.assertEqual(sender.message.malformed + sender.message.refused, 0)

        # By default the controller is the predictive one: some millimetres, and a busy host's delays.
        references = {round(m.header.stamp.to_sec(), 3): m for _, m in reference.all}
        errors = []
        for _, m in state.all:
            r = references.get(round(m.header.stamp.to_sec(), 3))
            if r and len(errors) < 10**6:
                errors.append(math.hypot(m.eta[0] - r.p[0], m.eta[1] - r.p[1]))
        late = errors[len(errors) // 2 :]
        rms = math.sqrt(sum(e * e for e in late) / len(late))
        print("tracking error %.4f m RMS over %d samples" % (rms, len(late)))
        self.assertGreater(len(late), 500)
        self.assertLess(rms, 0.05)

        # The state is what the simulated craft does, at the stamp it says.
        truths = {round(m.header.stamp.to_sec(), 2): m for _, m in truth.all}
        off, speed = [], []
        for _, m in state.all:
            t = truths.get(round(m.header.stamp.to_sec(), 2))
            if m.valid and t:
                off.append(math.hypot(m.eta[0] - t.eta[0], m.eta[1] - t.eta[1]))
                speed.append(math.hypot(m.nu[0] - t.nu[0], m.nu[1] - t.nu[1]))
        self.assertGreater(len(off), 500)
        self.assertLess(sorted(off)[len(off) // 2], 0.01)
        self.assertLess(sorted(speed)[len(speed) // 2], 0.08)

        # Thrust of the left side alone turns the craft clockwise seen from above: r grows.
        pairs = 0
        rising = 0
        commands = [(m.header.stamp.to_sec(), m.left - m.right) for _, m in controls.all]
        times = sorted(truths)
        for (t, difference), (following, _) in zip(commands, commands[1:]):
            if abs(difference) < CLEAR or following - t < 0.015:
                continue
            here = truths.get(round(t + 0.01, 2))
            if here:
                pairs += 1
                rising += (here.nu_dot[2] > 0) == (difference > 0)
        self.assertTrue(times)
        print("%d pairs" % pairs)
        self.assertGreater(pairs, 50)
        self.assertGreater(rising / pairs, 0.9)

        self.assertAlmostEqual(
            telemetry.message.yaw,
            math.degrees(math.remainder(truth.message.eta[2], 2 * math.pi)),
            delta=90,
        )
        self.assertGreater(len(measured.message.poses), 50)
        self.assertGreater(len(predicted.message.poses), 20)
        self.assertEqual(measured.message.header.frame_id, "world_ned")
        self.assertEqual(len(markers.message.markers), 9)
        # what the model predicts over its horizon ends near what was measured at that time
        last = predicted.message
        end = last.poses[-1].pose.position
        then = min((m for _, m in state.all), key=lambda m: abs(m.header.stamp - last.header.stamp))
        self.assertLess(math.hypot(end.x - then.eta[0], end.y - then.eta[1]), 0.5)


if __name__ == "__main__":
    rospy.init_node("closed_loop_test")
    rostest.rosrun("ground", "closed_loop_test", ClosedLoopTest)
