#!/usr/bin/python3
"""The sender: who may drive the craft, and what ends it."""
import math
import os
import subprocess
import sys
import time
import unittest

import dynamic_reconfigure.client
import rospy
import rostest
from ground_msgs.msg import SenderStatus
from std_srvs.srv import SetBool

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import harness  # noqa: E402

PORT = 33411
LIMIT = 0.25  # from the fault to zero on the wire [s]
DRIVEN = (2000, 2000, 1600, 1250)  # DL, DR, R, L


class SenderTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.status = harness.sender_status()
        rospy.wait_for_service("sender/arm", 20)
        cls.arm = rospy.ServiceProxy("sender/arm", SetBool)
        # one craft for all tests: the link stays with the first it has confirmed
        cls.craft = harness.Craft(PORT)

    def setUp(self):
        self.station = harness.Station()
        self.arm(False)

    def tearDown(self):
        self.station.stop()

    def state(self):
        return self.status.message.state if self.status.message else None

    def armed(self):
        harness.wait_for(lambda: self.arm(True).success, 5, "arming")

    def drive(self):
        self.armed()
        self.station.command(0.25, 0.6, 1.0)
        harness.wait_for(lambda: self.craft.last() == DRIVEN, 2, "the command on the wire")

    def expect_fault(self, moment, reason):
        harness.wait_for(lambda: self.craft.zero_since(moment), 2, "zero packets")
        time.sleep(0.1)  # and they stay zero
        delay = self.craft.zero_since(moment) - moment
        print("%s: zero on the wire after %.0f ms" % (reason, 1e3 * delay))
        self.assertLess(delay, LIMIT)
        harness.wait_for(lambda: self.state() == SenderStatus.FAULT, 1, "FAULT")
        self.assertIn(reason, self.status.message.reason)
        self.station.command(0, 0, 0)
        refused = self.arm(True)
        self.assertFalse(refused.success, "a fault is latched")
        self.assertIn("disarm", refused.message)

    def test_disarmed_sends_zero_whatever_is_commanded(self):
        self.station.command(1, 1, 1)
        moment = time.monotonic()
        harness.wait_for(lambda: sum(t > moment for t, _ in self.craft.packets) > 10, 2, "packets")
        self.assertEqual({m for t, m in self.craft.packets if t > moment + 0.1}, {harness.ZERO})

    def test_arms_only_with_a_zero_command_and_a_fresh_valid_state(self):
        self.station.command(0.1, 0, 0)
        time.sleep(0.1)
        self.assertIn("not zero", self.arm(True).message)
        self.station.command(0, 0, 0)
        self.station.state.valid = False
        time.sleep(0.1)
        self.assertIn("valid state", self.arm(True).message)
        self.station.state.valid = True
        self.station.stop("controls")
        time.sleep(0.3)
        self.assertIn("command", self.arm(True).message)

    def test_maps_and_saturates_commands(self):
        self.drive()
        self.station.command(-3, 7, 0.5)
        harness.wait_for(lambda: self.craft.last() == (1500, 1500, 2000, 1000), 1, "saturation")

    def test_stale_commands(self):
        self.drive()
        self.station.stop("controls")
        self.expect_fault(time.monotonic(), "commands are stale")

    def test_stale_state(self):
        self.drive()
        self.station.stop("states")
        self.expect_fault(time.monotonic(), "state is stale")

    def test_invalid_state(self):
        self.drive()
        self.station.state.valid = False
        self.expect_fault(time.monotonic(), "state is invalid")

    def test_old_stamps_are_stale_however_often_they_come(self):
        self.drive()
        publish = self.station._controls_publisher.publish
        self.station.stop("controls")
        moment = time.monotonic()
        repeater = harness.Repeater(100, lambda: publish(self.station.controls))
        try:
            self.expect_fault(moment, "commands are stale")
        finally:
            repeater.stop()

    def test_commands_that_are_not_finite_are_refused(self):
        self.drive()
        before = self.status.message.refused
        moment = time.monotonic()
        self.station.command(math.nan, 0.5, 1)
        harness.wait_for(lambda: self.state() == SenderStatus.FAULT, 2, "FAULT")
        self.assertTrue({m for t, m in self.craft.packets if t > moment} <= {DRIVEN, harness.ZERO})
        harness.wait_for(lambda: self.status.message.refused > before, 2, "a count of refusals")
        self.station.command(0, math.inf, 0)
        self.arm(False)
        time.sleep(0.3)
        self.assertFalse(self.arm(True).success)

    def test_garbage_is_counted_and_ignored(self):
        self.drive()
        before = self.status.message.malformed
        for data in (b"\xff" * 40, b"", harness.TELEMETRY[:3], b"hello", bytes(range(256)) * 8):
            self.craft.say(data)
        harness.wait_for(lambda: self.status.message.malformed >= before + 5, 2, "a count")
        self.assertEqual(self.state(), SenderStatus.ARMED)
        harness.wait_for(lambda: self.craft.last() == DRIVEN, 1, "still driven")

    def test_a_second_sender_of_packets_cannot_take_over(self):
        self.drive()
        peer, before = self.status.message.peer, self.status.message.foreign
        thief = harness.Craft(PORT)
        try:
            harness.wait_for(lambda: self.status.message.foreign >= before + 10, 3, "a count")
            self.assertEqual(self.status.message.peer, peer)
            self.assertEqual(thief.packets, [])
            self.assertEqual(self.craft.last(), DRIVEN)
            self.arm(False)
            time.sleep(0.2)
            self.assertEqual(thief.packets, [])
        finally:
            thief.close()

    def test_another_controller_cannot_interfere(self):
        self.drive()
        before = self.status.message.refused
        other = subprocess.Popen(
            ["rostopic", "pub", "-r", "50", "-s", "controls", "ground_msgs/Controls"]
            + ["{header: auto, left: 1.0, right: 1.0, lift: 1.0}"],
            stdout=subprocess.DEVNULL,
        )
        try:
            harness.wait_for(lambda: self.status.message.refused > before + 5, 8, "refusals")
            self.assertEqual({m for _, m in self.craft.packets[-20:]}, {DRIVEN})
        finally:
            other.terminate()
            other.wait()

    def test_parameters_change_live_and_bad_ones_are_refused(self):
        client = dynamic_reconfigure.client.Client("sender", timeout=10)
        self.assertEqual(
            client.update_configuration({"keepalive_rate": 100.0})["keepalive_rate"], 100
        )
        self.assertEqual(
            client.update_configuration({"keepalive_rate": 1e6})["keepalive_rate"], 100
        )
        self.assertEqual(
            client.update_configuration({"command_timeout": -1.0})["command_timeout"], 0.2
        )
        self.assertEqual(
            client.update_configuration({"command_timeout": math.nan})["command_timeout"], 0.2
        )
        moment = time.monotonic()
        time.sleep(0.5)
        rate = sum(t > moment for t, _ in self.craft.packets) / 0.5
        self.assertGreater(rate, 70)
        client.update_configuration({"keepalive_rate": 50.0})
        client.close()


if __name__ == "__main__":
    rospy.init_node("sender_test")
    rostest.rosrun("ground", "sender_test", SenderTest)
