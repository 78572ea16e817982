#!/usr/bin/python3
"""From the poses of a mocap to the packets on the wire, all nodelets in one manager."""
import os
import sys
import time
import unittest

import rospy
import rostest
from ground_msgs.msg import ControllerStatus, SenderStatus
from std_srvs.srv import SetBool, Trigger

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import harness  # noqa: E402
from ground import _core  # noqa: E402

PORT, CLOCK, DURATION = 33441, 15.0, 4.0


class WireTest(unittest.TestCase):
    def setUp(self):
        self.craft = harness.Craft(PORT)
        self.mocap = harness.Mocap()
        self.status = harness.Latest("controller/status", ControllerStatus)
        self.sender = harness.sender_status()
        rospy.wait_for_service("controller/start", 20)
        self.start = rospy.ServiceProxy("controller/start", Trigger)
        self.arm = rospy.ServiceProxy("sender/arm", SetBool)

    def tearDown(self):
        self.mocap.stop()
        self.craft.close()

    def expect(self, state, timeout):
        harness.wait_for(
            lambda: self.status.message and self.status.message.state == state, timeout, str(state)
        )

    def test_bits_on_the_wire_then_loss_of_the_mocap(self):
        self.assertTrue(self.start().success)
        self.expect(ControllerStatus.RUNNING, 15)
        self.expect(ControllerStatus.DONE, 10)
        self.check_bits()
        self.check_loss_of_mocap()

    def check_bits(self):
        bits = _core.make_prbs(6, 5)
        expected, last = [], None
        for i in range(int(DURATION * CLOCK)):
            # DL, DR, R, L
            motors = (
                2000,
                2000,
                1000 + 1000 * bits[i % len(bits)][1],
                1000 + 1000 * bits[i % len(bits)][0],
            )
            if motors != last:
                expected.append((i / CLOCK, motors))
                last = motors
        lifting = (2000, 2000, 1000, 1000)
        edges, last = [], None
        for t, motors in list(self.craft.packets):
            if motors != last:
                edges.append((t, motors))
                last = motors
        first = next(i for i, (_, m) in enumerate(edges) if m == lifting) + 1
        if expected[0][1] == lifting:  # the first bits look like lifting: start at the next edge
            expected = expected[1:]
        edges = edges[first : first + len(expected) + 1]
        self.assertEqual([m for _, m in edges[:-1]], [m for _, m in expected])
        self.assertEqual(edges[-1][1], harness.ZERO, "the end is zero")
        times = [t for t, _ in edges]
        wanted = [t for t, _ in expected] + [DURATION]
        offset = sorted(t - w for t, w in zip(times, wanted))[len(times) // 2]
        errors = sorted(abs(t - w - offset) for t, w in zip(times, wanted))
        print(
            "bits on the wire: %d edges, off by %.2f ms (median), %.2f ms (most)"
            % (len(errors), 1e3 * errors[len(errors) // 2], 1e3 * errors[-1])
        )
        self.assertLess(errors[len(errors) // 2], 0.002)
        self.assertLess(errors[-1], 0.02)

    def check_loss_of_mocap(self):
        self.assertTrue(self.start().success)
        self.expect(ControllerStatus.RUNNING, 10)
        time.sleep(0.3)
        moment = time.monotonic()
        self.mocap.stop()
        harness.wait_for(lambda: self.craft.zero_since(moment), 2, "zero packets")
        time.sleep(0.2)
        delay = self.craft.zero_since(moment) - moment
        print("poses lost: zero on the wire after %.0f ms" % (1e3 * delay))
        self.assertLess(delay, 0.25)
        harness.wait_for(lambda: self.sender.message.state == SenderStatus.FAULT, 2, "FAULT")
        self.expect(ControllerStatus.STOPPED, 2)


if __name__ == "__main__":
    rospy.init_node("wire_test")
    rostest.rosrun("ground", "wire_test", WireTest)
