#!/usr/bin/python3
"""The controller of docs/howto/controller_python.md, as it is printed there, flies the simulated craft of a
launch without a controller."""

import math
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import unittest

import harness
import rosnode
import rospy
import rostest
from ground_msgs.msg import Controls, SenderStatus, State
from std_srvs.srv import SetBool

PAGE = pathlib.Path(__file__).resolve().parents[2] / "docs" / "howto" / "controller_python.md"
POINT = re.compile(r"^POINT = \((.*), (.*)\).*$", re.M)


class ControllerInPython(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.law, _, cls.node = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.M | re.S)
        cls.folder = tempfile.TemporaryDirectory()
        cls.status = harness.sender_status()
        cls.truth = harness.Latest("simulator/truth", State)
        rospy.wait_for_service("sender/arm", 30)
        cls.arm = staticmethod(rospy.ServiceProxy("sender/arm", SetBool))

    def setUp(self):
        self.running = []

    def tearDown(self):
        for process in self.running:
            process.kill()
            process.wait()

    def start(self, law):
        """Saves the function and the node and runs the node as the page says."""
        pathlib.Path(self.folder.name, "hold_point.py").write_text(law)
        path = pathlib.Path(self.folder.name, "hold_node.py")
        path.write_text(self.node)
        path.chmod(0o755)
        self.running.append(subprocess.Popen([str(path)], cwd=self.folder.name))
        return self.running[-1]

    def distance(self, point):
        x, y = self.truth.message.eta[:2]
        return math.hypot(x - point[0], y - point[1])

    def wait_sender(self, state, reason=""):
        found = lambda: self.status.message.state == state and reason in self.status.message.reason  # noqa: E731
        harness.wait_for(found, 20, lambda: "the sender: %s" % self.status.message.reason)

    def test_1_nothing_moves_without_it(self):
        harness.wait_for(lambda: self.truth.message and self.status.message, 20, "craft and sender")
        self.assertNotIn("/controller", rosnode.get_node_names())
        self.assertEqual(self.status.message.state, SenderStatus.DISARMED)

    def test_2_it_goes_to_the_point_and_stays(self):
        point = [float(number) for number in POINT.search(self.law).groups()]
        program = self.start(self.law)
        self.wait_sender(SenderStatus.ARMED)
        harness.wait_for(lambda: self.distance(point) < 0.2, 30, lambda: str(self.truth.message))
        settled = rospy.Time.now() + rospy.Duration(5)
        harness.wait_for(lambda: rospy.Time.now() > settled, 60, "5 s")
        until, farthest = settled + rospy.Duration(10), [0.0]
        while rospy.Time.now() < until:
            farthest.append(self.distance(point))
            rospy.rostime.wallsleep(0.01)
        self.assertLess(max(farthest), 0.2)
        self.assertEqual(self.status.message.state, SenderStatus.ARMED)
        program.send_signal(signal.SIGINT)
        self.wait_sender(SenderStatus.FAULT, "commands are stale")

    def test_3_a_second_node_that_sends_commands_prevents_arming(self):
        self.arm(False)
        self.start(self.law)
        second = rospy.Publisher("controls", Controls, queue_size=1)
        zeros = harness.Repeater(50, lambda: second.publish(zero_command()))
        try:
            answer = lambda: self.arm(False) and self.arm(True).message  # noqa: E731
            harness.wait_for(lambda: "controller:=none" in answer(), 10, answer)
        finally:
            zeros.stop()
            second.unregister()

    def test_4_the_fence_of_the_sender_keeps_it_in_the_room(self):
        self.arm(False)
        self.start(POINT.sub("POINT = (5.0, 0.0)", self.law))
        controls = harness.Latest("controls", Controls)
        harness.wait_for(lambda: controls.message, 20, "commands of this program")
        harness.wait_for(lambda: self.arm(True).success, 20, "arming")
        self.wait_sender(SenderStatus.FAULT, "outside of the room")
        resting = lambda: math.hypot(*self.truth.message.nu[:2]) < 0.01  # noqa: E731
        harness.wait_for(resting, 30, "a craft at rest")
        self.assertLess(max(map(abs, self.truth.message.eta[:2])), 2.0)


def zero_command():
    command = Controls()
    command.header.stamp = rospy.Time.now()
    return command


if __name__ == "__main__":
    rospy.init_node("controller_python_test")
    rostest.rosrun("ground", "controller_python_test", ControllerInPython, sys.argv)
