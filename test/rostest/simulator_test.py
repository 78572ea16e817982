#!/usr/bin/python3
"""The simulator: its clock, repeatable runs, live changes, and the craft's side of the protocol."""

import math
import signal
import socket
import struct
import subprocess
import tempfile
import time
import unittest

import dynamic_reconfigure.client
import harness
import rospy
import rostest
from fake_craft import free_port
from geometry_msgs.msg import PoseStamped
from ground_msgs.msg import LiveChange, State
from ground_msgs.srv import LoadModel
from rosgraph_msgs.msg import Clock

POSE = "vrpn_client_node/hovercraft/pose"


def motors(left, right, lift):
    """A Motors datagram; every value has two bytes."""
    data = b""
    for field, value in ((1, lift), (2, lift), (3, right), (4, left)):
        n = 1000 + int(round(1000 * value))
        data += bytes([field << 3, n & 0x7F | 0x80, n >> 7])
    return data


class SimulatorTest(unittest.TestCase):
    def setUp(self):
        self.ground = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.ground.bind(("127.0.0.1", free_port()))
        self.ground.settimeout(5)
        self.process = None

    def tearDown(self):
        self.end()
        self.ground.close()

    def start(self, **parameters):
        parameters.setdefault("model", rospy.get_param("~model"))
        parameters["sender"] = "127.0.0.1:%d" % self.ground.getsockname()[1]
        arguments = ["_%s:=%s" % pair for pair in parameters.items()]
        self.clock = harness.Latest("/clock", Clock, keep=True)
        self.truth = harness.Latest("simulator/truth", State, keep=True)
        self.poses = harness.Latest(POSE, PoseStamped, keep=True)
        self.process = subprocess.Popen(
            ["rosrun", "nodelet", "nodelet", "standalone", "ground/Simulator", "__name:=simulator"]
            + arguments
        )
        _, self.craft = self.ground.recvfrom(2048)
        harness.wait_for(lambda: self.poses.message, 10, "poses")

    def end(self):
        if self.process and self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            self.process.wait(timeout=10)
        # The next simulator must not inherit parameters.
        if rospy.has_param("simulator"):
            rospy.delete_param("simulator")

    def drive(self, left, right, duration):
        end = time.monotonic() + duration
        while time.monotonic() < end:
            self.ground.sendto(motors(left, right, 1.0), self.craft)
            time.sleep(0.02)

    def test_the_clock_runs_at_the_real_time_factor(self):
        self.start(real_time_factor=4.0)
        time.sleep(1.5)
        (w0, c0), (w1, c1) = self.clock.all[10], self.clock.all[-1]
        factor = (c1.clock - c0.clock).to_sec() / (w1 - w0)
        self.assertAlmostEqual(factor, 4, delta=0.2)
        stamps = [m.header.stamp.to_sec() for _, m in self.poses.all]
        steps = [b - a for a, b in zip(stamps, stamps[1:])]
        self.assertAlmostEqual(sorted(steps)[len(steps) // 2], 0.01, 6)
        client = dynamic_reconfigure.client.Client("simulator", timeout=10)
        client.update_configuration({"real_time_factor": 1.0})
        self.assertEqual(client.update_configuration({"real_time_factor": 0.0})["real_time_factor"], 1.0)
        client.close()
        start = len(self.clock.all)
        time.sleep(1.0)
        (w0, c0), (w1, c1) = self.clock.all[start], self.clock.all[-1]
        self.assertAlmostEqual((c1.clock - c0.clock).to_sec() / (w1 - w0), 1, delta=0.1)

    def test_the_craft_can_be_changed_while_it_moves(self):
        self.start(watchdog=0.0, N_r_factor=2.0)
        changes = harness.Latest("live_changes", LiveChange, keep=True)
        harness.wait_for(changes.connections, 10, "a connection")
        client = dynamic_reconfigure.client.Client("simulator", timeout=10)
        load = rospy.ServiceProxy("simulator/load_model", LoadModel)
        thrust, mass, damping = 2 * 0.062, 0.0583, 0.0055
        self.drive(1, 1, 0.1)

        def accelerates(k, m, x):
            """Waits half a second for the acceleration by thrust k, mass m and damping x."""

            def near():
                self.ground.sendto(motors(1, 1, 1.0), self.craft)
                truth = self.truth.message
                expected = (k - x * truth.nu[0]) / m
                return abs(truth.nu_dot[0] - expected) < 0.02 * abs(expected)

            harness.wait_for(near, 0.5, lambda: "%s, %s" % (self.truth.message, (k, m, x)))

        accelerates(thrust, mass, damping)
        for values, expected in (
            ({"k_factor": 0.5}, (0.5 * thrust, mass, damping)),
            ({"k_factor": 2.0, "m_factor": 2.0, "X_u_factor": 8.0}, (2 * thrust, 2 * mass, 8 * damping)),
        ):
            before = self.truth.message
            client.update_configuration(values)
            accelerates(*expected)
            self.assertGreater(self.truth.message.nu[0], 0.8 * before.nu[0])  # speed is continuous
        for bad in ({"k_factor": 20.0}, {"k_factor": math.nan}, {"m_factor": 0.0}):
            kept = client.update_configuration(bad)
            self.assertEqual((kept["k_factor"], kept["m_factor"]), (2.0, 2.0))
        accelerates(2 * thrust, 2 * mass, 8 * damping)
        # The factors also apply to another model.
        with open(rospy.get_param("~model")) as file:
            text = file.read()
        with tempfile.NamedTemporaryFile("w", suffix=".yaml") as model:
            model.write(text.replace("k: 0.062", "k: 0.031"))
            model.flush()
            self.assertTrue(load(model.name).success)
        accelerates(thrust, 2 * mass, 8 * damping)
        # Factors that make the loaded model impossible are refused.
        with tempfile.NamedTemporaryFile("w", suffix=".yaml") as model:
            model.write(text.replace("k: 0.062", "k: 1.5e-5").replace("N_r: 4.62e-5", "N_r: 1e-9"))
            model.flush()
            self.assertTrue(load(model.name).success)
        kept = client.update_configuration({"k_factor": 0.1})
        self.assertEqual(kept["k_factor"], 2.0)
        client.close()
        changed = [(m.node, m.name, m.before, m.after) for _, m in changes.all]
        self.assertIn(("simulator", "k_factor", "1", "0.5"), changed)
        self.assertNotIn("0.1", [m[3] for m in changed])

    def test_factors_are_judged_by_the_thrusters_of_the_craft(self):
        """A pair of the same body would hardly move it."""
        with open(rospy.get_param("~model")) as file:
            lines = [line for line in file if not line.startswith(("  l:", "  input_max:"))]
        thruster = "  thrusters: [{name: fan, position: [-0.1, 0.1], direction: 0, gain: 1000}]\n"
        text = "".join(lines).replace("k: 0.062", "k: 6.2e-6").replace("body:\n", "body:\n" + thruster)
        with tempfile.NamedTemporaryFile("w", suffix=".yaml") as model:
            model.write(text)
            model.flush()
            self.start(model=model.name)
        client = dynamic_reconfigure.client.Client("simulator", timeout=10)
        self.assertEqual(client.update_configuration({"k_factor": 0.3})["k_factor"], 0.3)
        client.close()

    def test_obeys_its_sender_alone_and_stops_without_it(self):
        self.start(position_noise=0.0, heading_noise=0.0)
        self.drive(1, 0, 0.4)
        moving = self.truth.message
        self.assertGreater(moving.nu[2], 1.0, "left thrust turns the craft clockwise: r grows")
        self.assertGreater(moving.eta[2], 0.1)
        # In OptiTrack's frame this is a negative rotation about y, which points up.
        self.assertLess(self.poses.message.pose.orientation.y, 0)
        harness.wait_for(lambda: abs(self.truth.message.nu_dot[2]) < 4, 2, "the craft's watchdog")
        stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        rate = self.truth.message.nu[2]
        for _ in range(20):
            stranger.sendto(motors(1, 0, 1), self.craft)
            self.ground.sendto(b"garbage", self.craft)
            time.sleep(0.01)
        stranger.close()
        self.assertLess(self.truth.message.nu[2], rate + 0.1)
        data, _ = self.ground.recvfrom(2048)
        yaw = struct.unpack("<f", data[11:15])[0]  # third of three floats, each after a byte
        self.assertTrue(math.isfinite(yaw) and abs(yaw) <= 180)


if __name__ == "__main__":
    rospy.init_node("simulator_test")
    rostest.rosrun("ground", "simulator_test", SimulatorTest)
