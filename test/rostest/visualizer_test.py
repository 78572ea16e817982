#!/usr/bin/python3
"""Arrows of the thrusters show direction and size of their forces, for any kind of thruster."""

import math
import os
import subprocess
import tempfile
import unittest

import harness
import roslib.packages
import rospy
import rostest
from ground_msgs.msg import Controls
from visualization_msgs.msg import Marker, MarkerArray

NODELET = roslib.packages.find_node("nodelet", "nodelet")[0]
BODY = "{m: 0.5, I_z: 0.01, X_u: 0.2, Y_v: 0.3, N_r: 0.01, k: %g, %s}"
MODEL = "schema: ground/model/1\nname: made up\nbody: " + BODY + "\n"
LENGTH = 0.6  # of the arrow of the strongest thruster [m]
HEADING = 0.7  # [rad]


class VisualizerTest(unittest.TestCase):
    def setUp(self):
        self.states = harness.StatePublisher()
        self.states.state.eta = (0.3, -0.2, HEADING)
        self.addCleanup(self.states.stop)
        self.controls = rospy.Publisher("controls", Controls, queue_size=1, latch=True)
        self.markers = harness.Latest("markers", MarkerArray)

    def start(self, k, thrusters):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        model = os.path.join(folder.name, "model.yaml")
        with open(model, "w") as file:
            file.write(MODEL % (k, thrusters))
        parameters = ["_model:=" + model, "_thrust_length:=%g" % LENGTH, "_rate:=60"]
        command = [NODELET, "standalone", "ground/Visualizer", "__name:=visualizer", *parameters]
        process = subprocess.Popen(command)
        self.addCleanup(process.wait)
        self.addCleanup(process.terminate)
        harness.wait_for(lambda: self.markers.message, 20, "markers")

    def arrows(self, **command):
        """Angle to the heading [rad], clockwise, and length [m] of each thruster's arrow by a command."""
        message = Controls(lift=1.0, **command)
        message.header.stamp = rospy.Time.now()
        self.controls.publish(message)
        rospy.sleep(0.5)
        self.markers.message = None
        found = harness.wait_for(lambda: self.markers.message, 5, "markers").markers
        arrows = [m for m in found if m.type == Marker.ARROW and m.id >= 10]  # those of thrusters
        return [self.measure(arrow) for arrow in sorted(arrows, key=lambda arrow: arrow.id)]

    def measure(self, arrow):
        if arrow.action == Marker.DELETE:
            return 0.0, 0.0
        tail, tip = arrow.points
        x, y = tip.x - tail.x, tip.y - tail.y
        return math.remainder(math.atan2(y, x) - HEADING, 2 * math.pi), math.hypot(x, y)

    def assert_arrow(self, arrow, angle, length):
        self.assertAlmostEqual(arrow[1], length, places=3)
        self.assertAlmostEqual(math.remainder(arrow[0] - angle, 2 * math.pi), 0, places=3)

    def test_a_pair_whose_input_is_in_newtons(self):
        self.start(1.0, "l: 0.1, input_max: 4.5")
        left, right = self.arrows(left=1.0, right=0.25)
        self.assert_arrow(left, 0, LENGTH)
        self.assert_arrow(right, 0, 0.25 * LENGTH)

    def test_a_thruster_that_turns_and_one_with_a_curve(self):
        pod = "{name: pod, position: [0.1, 0], direction: 0, range: [-1, 1]}"
        swivel = "{name: swivel, turns: pod, angle: 180}"
        jet = "{name: jet, position: [-0.1, 0.05], direction: -90, gain: 0.5, curve: {power: 2}}"
        self.start(0.3, "thrusters: [%s, %s, %s]" % (pod, swivel, jet))
        channels = ["pod", "swivel", "jet", "lift"]
        for turn in (0.0, 0.25, -0.4):
            pod, swivel, jet = self.arrows(thrusters=[1.0, turn, 0.5], channels=channels)
            self.assert_arrow(pod, math.pi * turn, LENGTH)
            self.assertEqual(swivel[1], 0, "an angle pushes nothing")
            self.assert_arrow(jet, -math.pi / 2, 0.5 * 0.5**2 * LENGTH)
        backwards = self.arrows(thrusters=[-0.5, 0.25, 0.0], channels=channels)
        self.assert_arrow(backwards[0], math.pi / 4 + math.pi, 0.5 * LENGTH)
        self.assertEqual(backwards[2][1], 0)


if __name__ == "__main__":
    rospy.init_node("visualizer_test")
    rostest.rosrun("ground", "visualizer_test", VisualizerTest)
