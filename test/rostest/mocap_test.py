#!/usr/bin/python3
"""From Motive to a diagnosis as a user has it: arm, start, drive, stop recording, identify."""

import glob
import json
import os
import shutil
import subprocess
import sys
import unittest

import harness
import numpy as np
import rosbag
import rospy
import rostest
from fake_lab import FakeLab
from fake_motive import FakeMotive
from geometry_msgs.msg import PoseStamped
from ground_msgs.msg import ControllerStatus, MocapFrame, State
from std_srvs.srv import SetBool, Trigger

FOLDER = os.path.dirname(os.path.abspath(__file__))
POSE, FRAME = "vrpn_client_node/hovercraft/pose", "vrpn_client_node/hovercraft/frame"


class MocapTest(unittest.TestCase):
    def test_an_experiment_with_motive_ends_in_a_diagnosis(self):
        motive = FakeMotive(host="127.0.0.3", names={1: "hovercraft", 2: "somebody else"})
        lab = FakeLab(os.path.join(FOLDER, "asymmetric_craft.yaml"), int(sys.argv[1]), motive)
        self.addCleanup(lab.close)
        state = harness.Latest("state", State)
        sender, status = harness.sender_status(), harness.Latest("controller/status", ControllerStatus)
        harness.wait_for(lambda: state.message and state.message.valid, 20, "a valid state")
        harness.wait_for(lambda: sender.message and sender.message.peer, 10, "the craft")
        poses = harness.Latest(POSE, PoseStamped, keep=True)
        frames = harness.Latest(FRAME, MocapFrame, keep=True)
        self.assertTrue(rospy.ServiceProxy("sender/arm", SetBool)(True).success)
        self.assertTrue(rospy.ServiceProxy("controller/start", Trigger)().success)
        ended = (ControllerStatus.DONE, ControllerStatus.STOPPED)
        harness.wait_for(lambda: status.message and status.message.state in ended, 60, "the end")
        self.assertEqual(status.message.state, ControllerStatus.DONE, status.message.reason)
        self.check_times(poses.all, frames.all, motive)
        self.check_recording(rospy.get_param("record/dir"))

    def check_times(self, poses, frames, motive):
        """Poses have the mocap's time, and no frame is missing."""
        stamps = np.array([m.header.stamp.to_sec() for _, m in poses])
        by_stamp = {m.header.stamp: m for _, m in frames}
        offsets = np.array([by_stamp[m.header.stamp].offset for _, m in poses if m.header.stamp in by_stamp])
        true = rospy.Time.now().to_sec() - motive.now()
        times, ages = np.diff([m.time for _, m in frames]), np.array([m.age for _, m in frames])
        print(
            "frames: largest gap %.0f ms when sent, age at arrival %.1f ms median, %.1f ms at most"
            % (1e3 * times.max(), 1e3 * np.median(ages), 1e3 * ages.max())
        )
        print("offset: %.2f ms off at most" % (1e3 * np.abs(offsets - true).max()))
        self.assertGreater(len(offsets), 0.95 * len(stamps))
        self.assertLess(np.abs(offsets - true).max(), 0.005)
        self.assertEqual(sum(m.missed for _, m in frames), 0)
        self.assertEqual(set(np.diff([m.number for _, m in frames])), {1})
        self.assertTrue(all(m.tracked and m.body == "hovercraft" for _, m in frames))

    def check_recording(self, folder):
        """The bag has what the laboratory did, and a diagnosis finds the missing effect."""
        self.addCleanup(shutil.rmtree, folder)
        # The launch, and this test, would end with the recorder: what it has written until now is copied.
        (active,) = glob.glob(folder + "/*_0.bag.active")
        bag = active.replace("_0.bag.active", "_1.bag")
        shutil.copy(active, bag)
        with rosbag.Bag(bag, "a", allow_unindexed=True) as recorded:
            list(recorded.reindex())
            topics = recorded.get_type_and_topic_info().topics
        for topic in (POSE, FRAME, "state", "controls", "drive", "mocap_state/settings"):
            self.assertGreater(topics["/" + topic].message_count, 0, topic)
        command = ["rosrun", "ground", "identify", "diagnose", "--json", "--model"]
        command += [
            os.path.join(FOLDER, "../../cfg/hovercraft/tiny_whoover.yaml"),
            bag,
            "-o",
            folder + "/found",
        ]
        told = subprocess.run(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True
        )
        self.assertEqual(told.returncode, 0, told.stderr)
        self.assertEqual(json.loads(told.stdout)["verdict"], "missing")
        with open(folder + "/found/improved.yaml") as improved:
            self.assertIn("thrust_asymmetry", improved.read())


if __name__ == "__main__":
    rospy.init_node("mocap_test")
    rostest.rosrun("ground", "mocap_test", MocapTest)
