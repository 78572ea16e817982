#!/usr/bin/python3
"""The open-loop controller in a room: its fence knows the thrust of its craft."""

import contextlib
import os
import re
import subprocess
import unittest

import harness
import roslib.packages
import rospy
import rostest
from ground_msgs.msg import ControllerStatus, State
from std_srvs.srv import Trigger

SHARE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
NODELET = roslib.packages.find_node("nodelet", "nodelet")[0]


@contextlib.contextmanager
def loaded(**parameters):
    """The process of a controller in the room."""
    parameters["room"] = os.path.join(SHARE, "cfg", "room", "room_4x4.yaml")
    command = ["stdbuf", "-oL", NODELET, "standalone", "ground/OpenLoopPRBS", "__name:=open_loop"]
    command += ["_%s:=%s" % p for p in parameters.items()]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        yield process
    finally:
        process.terminate()
        process.communicate()
        for name in parameters:
            rospy.delete_param("open_loop/" + name)


def said(**parameters):
    """What the controller says of the room when it is loaded."""
    with loaded(**parameters) as process:
        return next((line for line in process.stdout if "the room" in line), "")


class OpenLoopTest(unittest.TestCase):
    def test_it_knows_how_fast_its_craft_may_be(self):
        speeds = []
        for craft in ("tiny_whoover", "mvwt"):
            line = said(model=os.path.join(SHARE, "cfg", "hovercraft", craft + ".yaml"))
            speeds += [float(number) for number in re.findall(r"([\d.]+) m/s", line)[:1]]
        self.assertEqual(len(speeds), 2, "it says up to which speed")
        self.assertNotEqual(*speeds)

    def test_without_a_model_it_says_that_it_does_not_know(self):
        self.assertIn("without a model", said())

    def ended(self, **parameters):
        """How a drive of 2 s ends beside a wall, at which the craft looks, by states that come late."""
        publisher = rospy.Publisher("state", State, queue_size=1, tcp_nodelay=True)

        def publish():
            state = State(valid=True, eta=(1.7, 0.0, 0.0))
            state.header.stamp = rospy.Time.now() - rospy.Duration(0.15)
            publisher.publish(state)

        states = harness.Repeater(100, publish)
        self.addCleanup(states.stop)
        status = harness.Latest("open_loop/status", ControllerStatus)
        given = {"require_armed": "false", "lift_time": 0.2, "state_timeout": 1.0, "duration": 2.0}
        with loaded(**given, **parameters):
            rospy.wait_for_service("open_loop/start", 20)
            self.assertTrue(rospy.ServiceProxy("open_loop/start", Trigger)().success)
            ends = (ControllerStatus.DONE, ControllerStatus.STOPPED)
            harness.wait_for(lambda: status.message and status.message.state in ends, 10, "an end")
            return status.message

    def test_the_thrust_since_the_last_state_counts_at_a_wall(self):
        """It seems to rest 0.3 m from the wall, but its thrusters have pushed it since then."""
        model = os.path.join(SHARE, "cfg", "hovercraft", "tiny_whoover.yaml")
        end = self.ended(model=model)
        self.assertEqual(end.state, ControllerStatus.STOPPED)
        self.assertIn("if it were stopped later", end.reason)
        self.assertEqual(self.ended().state, ControllerStatus.DONE, "without a model it does not know")


if __name__ == "__main__":
    rospy.init_node("open_loop_test")
    rostest.rosrun("ground", "open_loop_test", OpenLoopTest)
