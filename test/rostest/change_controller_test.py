#!/usr/bin/python3
"""The lines of docs/tracking.md that change the controller while the craft drives in a room."""

import os
import re
import signal
import subprocess
import unittest

import harness
import rospy
import rostest
from ground_msgs.msg import ControllerStatus, Controls, SenderStatus, State

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
S = ControllerStatus


def documented():
    """The commands of the section about changing the controller."""
    with open(os.path.join(ROOT, "docs", "tracking.md")) as file:
        section = file.read().split("## Change the controller while it drives")[1]
    block = re.search(r"```sh\n(.*?)```", section, re.S).group(1)
    return block.replace("\\\n", " ").strip().splitlines()


class ChangeControllerTest(unittest.TestCase):
    def setUp(self):
        self.sender = harness.Latest("sender/status", SenderStatus, keep=True)
        self.status = {
            name: harness.Latest(name + "/status", S, keep=True)
            for name in ("controller", "predictive", "outside")
        }
        self.truth = harness.Latest("simulator/truth", State)
        self.controls = harness.Latest("controls", Controls)
        self.started = []

    def tearDown(self):
        for process in (p for p in self.started if p.poll() is None):
            os.killpg(process.pid, signal.SIGINT)
            process.wait(20)

    def run_line(self, line):
        self.started.append(
            subprocess.Popen(["bash", "-c", line], cwd=os.path.realpath(ROOT), start_new_session=True)
        )
        return self.started[-1]

    def done(self, line):
        self.assertEqual(self.run_line(line).wait(30), 0, line)

    def expect(self, name, state, timeout=30):
        heard = self.status[name]
        harness.wait_for(
            lambda: heard.message and heard.message.state == state,
            timeout,
            lambda: "%s in state %d; the sender: %s" % (name, state, self.sender.message),
        )

    def drives_for(self, seconds):
        """Waits; the predictive controller drives and the sender stays armed."""
        begin = rospy.Time.now().to_sec()
        harness.wait_for(lambda: rospy.Time.now().to_sec() > begin + seconds, 60, "time")
        self.assertEqual(self.sender.message.state, SenderStatus.ARMED, self.sender.message.reason)
        status = self.status["predictive"].message
        self.assertEqual(status.state, S.RUNNING, status.reason)

    def test_the_documented_lines(self):
        load, start, change = documented()
        self.expect("controller", S.RUNNING)
        self.run_line(load)
        self.expect("predictive", S.IDLE)
        self.done(start)
        self.expect("controller", S.STOPPED)
        self.drives_for(6)
        self.assertEqual(self.controls.message.header.frame_id, "/predictive")
        for name in ("reference", "size", "rate_of_turn", "lift"):
            self.assertEqual(rospy.get_param("predictive/" + name), rospy.get_param("controller/" + name))
        self.done(change)
        self.assertEqual(rospy.get_param("predictive/reference"), "rhodonea")
        self.drives_for(10)
        self.assertLess(max(abs(x) for x in self.truth.message.eta[:2]), 2)
        self.refuse_to_leave()

    def refuse_to_leave(self):
        """A controller that would leave the room of the station is not loaded."""
        load = documented()[0].replace("__name:=predictive", "__name:=outside") + " _size:=2.5"
        self.assertNotEqual(self.run_line(load).wait(30), 0)
        self.assertIsNone(self.status["outside"].message)
        self.drives_for(1)


if __name__ == "__main__":
    rospy.init_node("change_controller_test")
    rostest.rosrun("ground", "change_controller_test", ChangeControllerTest)
