#!/usr/bin/python3
"""Models during an experiment: errors, predicted paths, the missing wrench, and which model is better."""

import math
import os
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from xmlrpc.client import ServerProxy

import rosgraph
import rosnode
import rospy
import rostest
from ground_msgs.msg import (
    ControllerStatus,
    Controls,
    Drive,
    ModelComparison,
    ModelError,
    SenderStatus,
    State,
    Telemetry,
)
from ground_msgs.srv import LoadModel
from nav_msgs.msg import Path
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

import ground
from ground import _core

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import harness

HERE = os.path.dirname(os.path.abspath(__file__))
MODEL = os.path.join(HERE, "..", "..", "cfg", "hovercraft", "tiny_whoover.yaml")
TRUTH = os.path.join(HERE, "tilted_craft.yaml")
SAGGING = os.path.join(HERE, "sagging_craft.yaml")
WEIGHT = 0.0583 * 9.81  # weight of the craft [N]
SILENT, DRIVES = 3.0, 2.0  # time without a craft, and from its hello to thrust [s]
SLOPES = 0.02, -0.01  # slopes of the floor, x and y in world_ned


class LiveComparisonTest(unittest.TestCase):
    def test_a_pause_of_the_process_pauses_simulated_time(self):
        controller = harness.Latest("controller/status", ControllerStatus, keep=True)
        sender = harness.Latest("sender/status", SenderStatus, keep=True)

        def running():
            return controller.message and controller.message.state == ControllerStatus.RUNNING

        harness.wait_for(running, 40, "the craft to be driven")
        uri = rosnode.get_api_uri(rosgraph.Master("/test"), "/ground_manager")
        manager = ServerProxy(uri).getPid("/test")[2]
        before = rospy.Time.now()
        os.kill(manager, signal.SIGSTOP)
        time.sleep(0.5)
        os.kill(manager, signal.SIGCONT)
        time.sleep(0.1)
        passed = (rospy.Time.now() - before).to_sec()
        self.assertLess(passed, 0.4, "the simulation must not catch up after a pause")
        time.sleep(1)
        reasons = {m.reason for _, m in controller.all if m.state == ControllerStatus.STOPPED}
        reasons |= {m.reason for _, m in sender.all if m.state == SenderStatus.FAULT}
        self.assertEqual(reasons, set())
        self.assertTrue(running())

    def setUp(self):
        self.late = None

    def tearDown(self):
        if self.late:
            self.late.terminate()
            self.late.wait(timeout=10)

    def listen(self):
        self.drive = harness.Latest("drive", Drive)
        self.controls = harness.Latest("controls", Controls, keep=True)
        self.state = harness.Latest("state", State, keep=True)
        self.first = harness.Latest("model_error", ModelError, keep=True)
        self.second = harness.Latest("model_error2", ModelError, keep=True)
        self.comparison = harness.Latest("model_comparison", ModelComparison)
        self.paths = [harness.Latest("path/predicted" + s, Path) for s in ("", "2")]
        self.markers = harness.Latest("markers", MarkerArray)
        self.floor = harness.Latest("floor_map", Marker)
        self.legend = harness.Latest("legend", MarkerArray)

    def test_model_and_measurement_are_compared(self):
        self.listen()
        first = self.first
        harness.wait_for(lambda: first.message and first.message.window > 3, 40, "errors")
        self.assertEqual(first.message.model, "tiny_whoover")
        self.assertIsNone(self.second.message)
        self.assertIsNone(self.comparison.message)
        self.load_the_true_model()
        by_stamp = self.check_errors()
        self.check_missing_force(by_stamp)
        self.check_sizes()
        self.check_displays()
        self.check_time_of_the_drive()
        self.check_voltage()

    def test_its_clock_begins_with_what_was_sent(self):
        """A craft that says hello late: a recording of it begins with the first command that left for it."""
        self.late = subprocess.Popen(
            ["rosrun", "nodelet", "nodelet", "standalone", "ground/LiveComparison"]
            + ["__ns:=hello", "__name:=comparison", "_model:=" + MODEL]
        )
        kinds = {"state": State, "controls": Controls, "sent": Controls}
        topics = {t: rospy.Publisher("hello/" + t, kind, queue_size=10) for t, kind in kinds.items()}
        error = harness.Latest("hello/model_error", ModelError)
        heard = lambda: all(t.get_num_connections() for t in topics.values())  # noqa: E731
        harness.wait_for(heard, 20, "the comparison")
        first, hello = [], []  # stamps of the first command and of the first one that is sent

        def publish():
            header = Header(stamp=rospy.Time.now())
            passed = (header.stamp - hello[0]).to_sec() if hello else 0
            thrust = 0.5 if passed > DRIVES else 0.0
            controls = Controls(header=header, left=thrust, right=thrust, lift=float(bool(hello)))
            topics["controls"].publish(controls)
            if hello:
                topics["sent"].publish(controls)
            covariance = (1e-6, 0, 0, 0, 1e-6, 0, 0, 0, 1e-4)
            topics["state"].publish(State(header=header, valid=True, pose_covariance=covariance))
            first.extend([] if first else [header.stamp])

        repeater = harness.Repeater(100, publish)
        try:
            harness.wait_for(
                lambda: first and (rospy.Time.now() - first[0]).to_sec() > SILENT, 30, "commands"
            )
            hello.append(rospy.Time.now())
            harness.wait_for(lambda: error.message and error.message.failure, 30, "a craft that stays")
        finally:
            repeater.stop()
        self.assertAlmostEqual(error.message.failing_since[0], DRIVES, delta=0.5)

    def load_the_true_model(self):
        """Loads a second model live, which must win; files without a model are refused."""
        first, second, comparison = self.first, self.second, self.comparison
        load = rospy.ServiceProxy("live_comparison/load_model2", LoadModel)
        load.wait_for_service(10)
        refused = load(file=os.path.join(HERE, "live_comparison.test"))
        self.assertFalse(refused.success)
        self.assertIn("the old model stays", refused.message)
        refused = rospy.ServiceProxy("live_comparison/load_model", LoadModel)(file="/nowhere.yaml")
        self.assertFalse(refused.success)
        self.assertEqual(first.message.model, "tiny_whoover")
        taken = load(file=TRUTH)
        self.assertTrue(taken.success, taken.message)
        harness.wait_for(lambda: comparison.message and comparison.message.better, 30, "a preference")
        self.assertEqual(list(comparison.message.models), ["tiny_whoover", "tilted_craft"])
        self.assertEqual(comparison.message.better, "tilted_craft")
        self.assertGreater(comparison.message.difference, 0)
        self.assertLess(second.message.position_error, 0.7 * first.message.position_error)
        self.assertEqual(second.message.model, "tilted_craft")

    def check_sizes(self):
        """A tilt of the floor pushes the craft by a known way; the true model shows its noise, and what the
        delays of a busy computer add."""
        harness.wait_for(lambda: self.second.message.window > 5, 20, "errors over some seconds")
        first, second = self.first.message, self.second.message
        pushed = 0.5 * 9.81 * math.hypot(*SLOPES)  # without damping [m]
        self.assertTrue(first.excited)
        self.assertLess(0.6 * pushed, first.position_error)
        self.assertLess(first.position_error, 1.2 * pushed)
        self.assertLess(second.position_error, 3 * second.position_noise)
        self.assertLess(second.heading_error, 3 * second.heading_noise)

    def check_errors(self):
        """Each state has an error with its stamp. Returns the states by stamp."""
        expected = {m.header.stamp for _, m in self.state.all if m.valid}
        found = {m.header.stamp for _, m in self.first.all}
        begun, ended = min(found), max(found)
        missed = [s for s in expected if begun < s < ended and s not in found]
        self.assertLess(len(missed), 0.02 * len(found))
        by_stamp = {m.header.stamp: m for _, m in self.state.all}
        # An error may arrive before its state.
        last = next(m for _, m in reversed(self.first.all) if m.header.stamp in by_stamp)
        self.assertAlmostEqual(last.horizon, 1.0, delta=0.03)
        measured = by_stamp[last.header.stamp]
        for i in range(2):
            self.assertAlmostEqual(last.eta[i] + last.eta_error[i], measured.pose[i], places=9)
        return by_stamp

    def check_missing_force(self, by_stamp):
        """The missing force, in the world's axes, is that of the floor's slope."""
        forces = []
        for _, m in self.first.all:
            s = by_stamp.get(m.header.stamp)
            if s and m.window > 2:
                c, n = math.cos(s.eta[2]), math.sin(s.eta[2])
                forces.append((c * m.wrench[0] - n * m.wrench[1], n * m.wrench[0] + c * m.wrench[1]))
        self.assertGreater(len(forces), 300)
        for axis in range(2):
            mean = sum(f[axis] for f in forces) / len(forces)
            self.assertAlmostEqual(mean, SLOPES[axis] * WEIGHT, delta=0.25 * abs(SLOPES[0]) * WEIGHT)

    def check_displays(self):
        """rviz gets paths, the missing force, the map of the floor, and a legend with units."""
        for path in self.paths:
            self.assertGreater(len(path.message.poses), 30)
            self.assertEqual(path.message.header.frame_id, "world_ned")
        missing = harness.wait_for(self.missing_force, 10, "an arrow of the missing force")
        start, tip = missing.points
        self.assertTrue(0.02 < math.hypot(tip.x - start.x, tip.y - start.y) < 1)
        floor = self.floor.message
        self.assertGreater(len(floor.points), 5)
        self.assertEqual(len(floor.points), len(floor.colors))
        self.check_legend()

    def check_legend(self):
        """Texts have a patch in the colour of what they explain, and begin at the left; arrows of thrust
        have the stated scale."""
        model = _core.load_model(MODEL)
        better = lambda: any(m.text.endswith("better") for m in self.legend.message.markers)  # noqa: E731
        harness.wait_for(better, 10, "a legend that says which model is better")
        first, panel, *markers = self.legend.message.markers
        self.assertEqual(first.action, Marker.DELETEALL)
        self.assertEqual({marker.header.frame_id for marker in markers}, {"view"})
        self.assertEqual(panel.type, Marker.CUBE)
        lines = [marker for marker in markers if marker.type == Marker.TEXT_VIEW_FACING]
        patches = {m.pose.position.x: m for m in markers if m.type == Marker.CUBE}
        edges = [m.pose.position.y - 0.5 * m.scale.z * _core.text_width(m.text) for m in lines]
        self.assertLess(max(edges) - min(edges), 1e-6)
        self.assertLess(max(m.pose.position.y for m in patches.values()), min(edges))
        entries = {line.text.split(":")[0]: line for line in lines}
        line = entries["tilted_craft"]
        self.assertRegex(line.text, r"^tilted_craft: [\d.]+ mm, [\d.]+ deg after 1 s, better$")
        self.assertRegex(lines[lines.index(line) + 1].text, r"noise alone: [\d.]+ mm, [\d.]+ deg$")
        self.assertNotIn("reference", [line.text for line in lines], "there is none")
        patch = patches[line.pose.position.x].color
        color = [round(255 * c) for c in (patch.r, patch.g, patch.b)]
        self.assertEqual("#%02x%02x%02x" % tuple(color), _core.palette["models"][1])
        length = rospy.get_param("visualizer/thrust_length")
        full = model.value("k") * model.input_max
        self.assertIn("%.2f m is %.0f mN" % (length, 1e3 * full), entries["thrust of each thruster"].text)
        sent = {u for _, m in self.controls.all for u in (m.left, m.right)}
        harness.wait_for(self.arrows_of_thrust, 10, "arrows of thrust")
        for drawn in self.arrows_of_thrust():  # its colour and place say of which thruster
            self.assertLess(min(abs(drawn / length - u) for u in sent), 1e-3)

    def missing_force(self):
        """The arrow of the missing force, when it is shown."""
        arrows = [m for m in self.markers.message.markers if m.id == 2 and m.action == Marker.ADD]
        return arrows[0] if arrows else None

    def arrows_of_thrust(self):
        """Lengths of the arrows of both thrusters that are shown."""
        arrows = [m for m in self.markers.message.markers if m.type == Marker.ARROW and m.id >= 10]
        return [
            math.hypot(tip.x - start.x, tip.y - start.y)
            for start, tip in (m.points for m in arrows if m.action == Marker.ADD)
        ]

    def check_time_of_the_drive(self):
        """t counts from the beginning of the drive in simulator and comparison, even if a model is loaded
        or a comparison started during the drive."""
        lifted = next((m for _, m in self.controls.all if m.lift > 0), None)
        drive = self.drive.message
        if self.controls.all[0][1].lift == 0:
            late = (drive.began - lifted.header.stamp).to_sec()
            self.assertAlmostEqual(late, 0, delta=0.1)
        elapsed = (drive.header.stamp - drive.began).to_sec()
        self.assertGreater(elapsed, 4.0)
        for node in ("simulator/load_model", "live_comparison/load_model2"):
            answer = rospy.ServiceProxy(node, LoadModel)(file=SAGGING)
            self.assertTrue(answer.success, answer.message)
        self.late = subprocess.Popen(
            ["rosrun", "nodelet", "nodelet", "standalone", "ground/LiveComparison"]
            + ["__name:=late", "_model:=" + SAGGING, "model_error:=late_error"]
        )
        late = harness.Latest("late_error", ModelError)
        for error in (self.second, late):  # errors by delays at the start decay
            harness.wait_for(
                lambda error=error: (
                    error.message
                    and error.message.model == "sagging_craft"
                    and error.message.window > 3
                    and error.message.position_error < 3 * error.message.position_noise
                ),
                20,
                lambda error=error: "small errors of the sagging craft, not %s" % error.message,
            )

    def check_voltage(self):
        """A model whose thrust follows the voltage uses the telemetry's: two thirds of it make it wrong."""
        with open(SAGGING) as text:
            model = ground.Model.parse(text.read().replace("body:", "body:\n  volts: 7.4", 1))
        file = os.path.join(tempfile.mkdtemp(), "by_voltage.yaml")
        model.with_effect("battery_voltage", p=4).save(file)
        answer = rospy.ServiceProxy("live_comparison/load_model2", LoadModel)(file=file)
        self.assertTrue(answer.success, answer.message)

        def error():
            message = self.second.message
            if message.model != "by_voltage" or message.window < 3:
                return 0
            return message.position_error / message.position_noise

        harness.wait_for(lambda: 0 < error() < 3, 20, "small errors without a voltage")
        craft = rospy.Publisher("sender/telemetry", Telemetry, queue_size=1)

        def fails():
            craft.publish(Telemetry(header=Header(stamp=rospy.Time.now()), voltage=5.0))
            return error() > 6

        harness.wait_for(fails, 20, "errors with two thirds of the voltage")


if __name__ == "__main__":
    rospy.init_node("live_comparison_test")
    rostest.rosrun("ground", "live_comparison_test", LiveComparisonTest)
