#!/usr/bin/python3
"""A thruster of many dies in flight: it is named, and the craft comes home without it inside the room."""

import os
import sys
import tempfile
import unittest

import numpy as np
import rospy
import rostest
from ground_msgs.msg import ControllerStatus, CraftChange, SenderStatus, State
from ground_msgs.srv import LoadModel

import ground

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import harness

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
S = ControllerStatus
DEAD = "front_right_left"
SETTLED = 12.0  # flight before it dies [s]
HOME = 60.0  # longest way home [s]
WALL, NEAR = 2.0, 0.6  # of the room, and how near home the craft has to come to rest [m]


class DeadThrusterTest(unittest.TestCase):
    def setUp(self):
        self.status = harness.Latest("controller/status", S, keep=True)
        self.sender = harness.Latest("sender/status", SenderStatus, keep=True)
        self.change = harness.Latest("craft_change", CraftChange, keep=True)
        self.truth = harness.Latest("simulator/truth", State, keep=True)

    def pass_time(self, duration):
        until = rospy.Time.now().to_sec() + duration
        harness.wait_for(lambda: rospy.Time.now().to_sec() > until, 10 * duration, "time")

    def kill(self, thruster):
        craft = ground.Model.load(os.path.join(ROOT, "cfg", "craft", "air_table.yaml"))
        file = os.path.join(tempfile.mkdtemp(), "dead.yaml")
        craft.with_effect("thruster_gain_" + thruster, a=-1).save(file)
        answer = rospy.ServiceProxy("simulator/load_model", LoadModel)(file=file)
        self.assertTrue(answer.success, answer.message)

    def said(self):
        return "controller: %s; sender: %s; change: %s" % (
            self.status.message.reason,
            self.sender.message.reason,
            self.change.message.text,
        )

    def test_it_comes_home(self):
        harness.wait_for(lambda: self.status.message and self.status.message.state == S.RUNNING, 60, "flight")
        self.pass_time(SETTLED)
        self.assertEqual({m.text for _, m in self.change.all}, {""}, "nothing has changed yet")
        began = rospy.Time.now().to_sec()
        self.kill(DEAD)
        harness.wait_for(lambda: self.status.message.state == S.STOPPED, 3 * HOME, self.said)
        print("named: %s\nafter %.1f s: %s" % (
            next((m.text for _, m in self.change.all if m.text), "nothing"),
            rospy.Time.now().to_sec() - began,
            self.said(),
        ))  # fmt: skip
        self.assertIn("the craft is home: %s is dead" % DEAD, self.status.message.reason, self.said())
        states = {m.state for _, m in self.sender.all}
        self.assertNotIn(SenderStatus.FAULT, states, self.said())
        self.pass_time(3)
        path = np.array([m.eta[:2] for _, m in list(self.truth.all)])
        self.assertLess(np.abs(path).max(), WALL)
        self.assertLess(np.hypot(*path[-1]), NEAR)


if __name__ == "__main__":
    rospy.init_node("dead_thruster_test")
    rostest.rosrun("ground", "dead_thruster_test", DeadThrusterTest)
