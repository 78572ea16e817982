#!/usr/bin/python3
"""The open-loop controller in a room: its fence knows the thrust of its craft."""

import os
import re
import subprocess
import unittest

import roslib.packages
import rospy
import rostest

SHARE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
NODELET = roslib.packages.find_node("nodelet", "nodelet")[0]


def said(**parameters):
    """What the controller says of the room when it is loaded."""
    parameters["room"] = os.path.join(SHARE, "cfg", "room", "room_4x4.yaml")
    command = ["stdbuf", "-oL", NODELET, "standalone", "ground/OpenLoopPRBS", "__name:=open_loop"]
    command += ["_%s:=%s" % p for p in parameters.items()]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        for line in process.stdout:
            if "the room" in line:
                return line
        return ""
    finally:
        process.terminate()
        process.communicate()
        for name in parameters:
            rospy.delete_param("open_loop/" + name)


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


if __name__ == "__main__":
    rospy.init_node("open_loop_test")
    rostest.rosrun("ground", "open_loop_test", OpenLoopTest)
