#!/usr/bin/python3
"""Both tracking controllers in closed loop through UDP: live changes of gains, reference, model and
controller, and a loss of the mocap. Loading of files never blocks the sender."""

import math
import os
import shutil
import tempfile
import threading
import time
import unittest

import dynamic_reconfigure.client
import harness
import numpy as np
import rospy
import rostest
from ground_msgs.msg import ControllerStatus, Controls, Reference, SenderStatus, State
from ground_msgs.srv import LoadModel
from std_srvs.srv import SetBool, Trigger

S = ControllerStatus
TILTED = os.path.join(os.path.dirname(os.path.abspath(__file__)), "tilted_craft.yaml")
TUNED_BOUND = 0.25  # error of the tuned backstepping law [m]; 0.05 to 0.12 in its table
PREDICTIVE_BOUND = 0.02  # error of the predictive controller [m]; about 1 mm without a network


class TrackingLoopTest(unittest.TestCase):
    def setUp(self):
        self.truth = harness.Latest("simulator/truth", State, keep=True)
        self.reference = harness.Latest("reference", Reference, keep=True)
        self.sender = harness.Latest("sender/status", SenderStatus, keep=True)
        self.controls = harness.Latest("controls", Controls, keep=True)
        self.status = {
            name: harness.Latest(name + "/status", S, keep=True) for name in ("controller", "predictive")
        }

        harness.wait_for(lambda: not rospy.Time.now().is_zero(), 20, "the clock")

    def expect(self, name, state, timeout=30):
        harness.wait_for_state(self.status[name], state, timeout)

    def start(self, name):
        rospy.wait_for_service(name + "/start", 20)
        answer = rospy.ServiceProxy(name + "/start", Trigger)()
        self.assertTrue(answer.success, answer.message)

    def change(self, node, **values):
        client = dynamic_reconfigure.client.Client(node, timeout=10)
        answer = client.update_configuration(values)
        client.close()
        for name, value in values.items():
            self.assertEqual(answer[name], value)

    def error(self, duration):
        """RMS of the true error over the next `duration` seconds [m]."""
        begin = rospy.Time.now().to_sec()
        harness.wait_for(lambda: rospy.Time.now().to_sec() > begin + duration, 10 * duration, "time")
        truth, reference = (
            np.array([(m.header.stamp.to_sec(), *get(m)[:2]) for _, m in list(heard.all)])
            for heard, get in ((self.truth, lambda m: m.eta), (self.reference, lambda m: m.p))
        )
        reference = reference[(reference[:, 0] > begin) & (reference[:, 0] <= truth[-1, 0])]
        self.assertGreater(len(reference), 25 * duration)  # 50 Hz; a busy host loses some
        off = [np.interp(reference[:, 0], truth[:, 0], truth[:, i]) - reference[:, i] for i in (1, 2)]
        return math.sqrt(np.square(off).sum(axis=0).mean())

    def load(self, name, file):
        return rospy.ServiceProxy(name + "/load_model", LoadModel)(file=file)

    def settled(self, bound, what, patience=30):
        """Waits until the error stays within the bound for 3 s."""
        error = None
        deadline = rospy.Time.now().to_sec() + patience
        while rospy.Time.now().to_sec() < deadline:
            error = self.error(3)
            if error < bound:
                print("%s: %.1f mm" % (what, 1e3 * error))
                return
        self.fail("%s: the error is %.3f m, not within %.3f m" % (what, error, bound))

    def test_live_changes(self):
        self.expect("controller", S.RUNNING)
        self.settled(TUNED_BOUND, "tuned gains on the circle")
        self.change_gains()
        self.change_controller()
        self.change("predictive", reference="rhodonea", size=1.5, rate_of_turn=0.4)
        self.settled(PREDICTIVE_BOUND, "the predictive controller on the rhodonea")
        self.change_models()
        self.lose_the_mocap()
        self.return_to_the_first_controller()

    def change_gains(self):
        """The thesis's gains saturate and give errors up to about 0.5 m; a limit on it stops the craft."""
        tuned = rospy.get_param("controller/k_phi_1"), rospy.get_param("controller/k_e")
        self.change("controller", k_e=4.0, k_phi_1=0.005, max_error=5.0)
        rough = self.error(6)
        print("other gains: %.1f mm" % (1e3 * rough))
        self.assertGreater(rough, 2 * PREDICTIVE_BOUND)
        self.assertEqual(self.status["controller"].message.state, S.RUNNING)
        self.change("controller", max_error=0.05)
        self.expect("controller", S.STOPPED, 20)
        self.assertRegex(
            self.status["controller"].message.reason,
            r"^\d\.\d\d m from the reference for 1 s, more than max_error 0.05 m$",
        )
        self.change("controller", k_phi_1=tuned[0], k_e=tuned[1], max_error=0.0)
        self.start("controller")
        self.expect("controller", S.RUNNING, 10)

    def change_controller(self):
        """The other controller takes over without disarming."""
        self.start("predictive")
        self.expect("predictive", S.RUNNING, 5)
        self.expect("controller", S.STOPPED, 5)
        self.assertIn("taken over", self.status["controller"].message.reason)
        self.settled(PREDICTIVE_BOUND, "the predictive controller on the circle")
        drivers = {m.header.frame_id for _, m in self.controls.all[-50:]}
        self.assertEqual(len(drivers), 1, drivers)
        self.assertTrue(all(m.lift == 1 for _, m in self.controls.all[-50:]))

    def change_models(self):
        """Tilts the floor of the craft, then of the controller's model; bad files are refused."""
        self.assertTrue(self.load("simulator", TILTED).success)
        self.settled(PREDICTIVE_BOUND, "the craft on a tilted floor")
        self.assertTrue(self.load("predictive", TILTED).success)
        for name in ("simulator", "predictive"):
            refused = self.load(name, __file__)
            self.assertFalse(refused.success)
            self.assertIn("old model stays", refused.message)
        self.settled(PREDICTIVE_BOUND, "the controller with the tilt in its model")
        self.assertEqual(self.status["predictive"].message.state, S.RUNNING)
        stopped = [m for _, m in self.status["predictive"].all if m.state == S.STOPPED]
        self.assertEqual(stopped, [])

    def lose_the_mocap(self):
        """A loss of the mocap for 0.3 s does not stop the craft."""
        before = len(self.sender.all)
        began = rospy.Time.now().to_sec()
        self.change("simulator", loss=1.0)
        harness.wait_for(lambda: rospy.Time.now().to_sec() > began + 0.3, 5, "a loss of 0.3 s")
        self.change("simulator", loss=0.0)
        self.settled(PREDICTIVE_BOUND, "after the loss")
        self.assertEqual(self.status["predictive"].message.state, S.RUNNING)
        states = {m.state for _, m in self.sender.all[before:]}
        self.assertEqual(states, {SenderStatus.ARMED}, self.sender.message.reason)

    def return_to_the_first_controller(self):
        """It takes over where its circle begins: backstepping may diverge from far away."""
        line = {"x": 1.9, "y": 0.0, "end_x": 2.0, "end_y": 0.0, "speed": 0.1}
        self.change("predictive", reference="line", **line)
        self.settled(PREDICTIVE_BOUND, "the predictive controller where the circle begins")
        self.start("controller")
        self.expect("predictive", S.STOPPED, 5)
        self.settled(TUNED_BOUND, "tuned gains again")

    def test_loading_of_files_does_not_block_the_sender(self):
        folder = tempfile.mkdtemp()
        fifo, huge = os.path.join(folder, "fifo"), os.path.join(folder, "huge")
        os.mkfifo(fifo)
        with open(huge, "w") as file:
            file.truncate(10**9)  # sparse: needs no space on the disk
        wrong = {
            fifo: "not a regular file",
            "/dev/zero": "not a regular file",
            folder: "a folder, not a regular file",
            huge: "larger than 1 MB",
        }
        nodes = ("controller", "predictive", "simulator", "live_comparison")
        answers = {}

        def load(node, path):
            answers[node, path] = self.load(node, path)

        calls = [
            threading.Thread(target=load, args=(node, path), daemon=True) for path in wrong for node in nodes
        ]
        for call in calls:
            call.start()
        time.sleep(0.2)
        asked = time.monotonic()
        disarm = threading.Thread(
            target=lambda: answers.update(disarmed=rospy.ServiceProxy("sender/arm", SetBool)(False)),
            daemon=True,
        )
        disarm.start()
        disarm.join(5)
        took = time.monotonic() - asked
        self.assertIn("disarmed", answers, "the sender did not answer in 5 s")
        self.assertLess(took, 0.5)
        for call in calls:
            call.join(10)
        for path, reason in wrong.items():
            for node in nodes:
                self.assertFalse(answers[node, path].success)
                self.assertIn(path + ": it is " + reason, answers[node, path].message)
        shutil.rmtree(folder)


if __name__ == "__main__":
    rospy.init_node("tracking_loop_test")
    rostest.rosrun("ground", "tracking_loop_test", TrackingLoopTest)
