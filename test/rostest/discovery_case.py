"""What the tests of a discovery share: what they listen to, and its folder."""

import json
import os
import unittest

import harness
import rospy
from ground_msgs.msg import ControllerStatus, Controls, DiscoveryStatus, SenderStatus, State
from std_srvs.srv import SetBool

from ground.reading import readers

HALF_WIDTH = 2.0  # half the width of the square room [m]
AT_REST = 0.02  # largest true speed of a craft at rest [m/s]
STARTS = 120  # longest time until a discovery has begun, wall time [s]


def thrust(controls):
    """The larger of both inputs."""
    return max(controls.left, controls.right)


class DiscoveryCase(unittest.TestCase):
    helped = True  # a person lends a hand

    def setUp(self):
        self.truth = harness.Latest("simulator/truth", State, keep=True)
        self.controls = harness.Latest("controls", Controls, keep=True)
        self.controller = harness.Latest("controller/status", ControllerStatus, keep=True)
        self.discovery = harness.Latest("discovery/status", DiscoveryStatus, keep=True)
        self.sender = harness.sender_status()

    def said(self):
        """What the discovery says now."""
        return self.discovery.message.activity if self.discovery.message else ""

    def wait_until_it_says(self, words, timeout=STARTS):
        harness.wait_for(lambda: words in self.said(), timeout, lambda: "said: " + self.said())

    def wait_until_it_drives(self, timeout=STARTS):
        def drives():
            self.lend_a_hand()
            status = self.controller.message
            return status and status.state == ControllerStatus.RUNNING and status.elapsed > 0.5

        harness.wait_for(drives, timeout, lambda: "flight; said: " + self.said())

    def lend_a_hand(self):
        """What a person does where a busy computer made commands or poses stale, which is no defect."""
        sender = self.sender.message
        if self.helped and sender and sender.state == SenderStatus.FAULT and "stale" in sender.reason:
            for armed in (False, True):
                rospy.ServiceProxy("sender/arm", SetBool)(armed)

    def arm(self, armed=True):
        """What a person does."""
        answer = rospy.ServiceProxy("sender/arm", SetBool)(armed)
        self.assertTrue(answer.success, answer.message)

    def wait_until_it_ends(self, timeout):
        def ended():
            self.lend_a_hand()
            return self.discovery.message and self.discovery.message.ended

        harness.wait_for(ended, timeout, lambda: "the end; said: " + self.said())

    def check_rest(self):
        """No thrust, no lift, no motion."""
        harness.wait_for(lambda: max(map(abs, self.truth.message.nu[:2])) < AT_REST, 10, "the craft at rest")
        self.assertEqual((thrust(self.controls.message), self.controls.message.lift), (0, 0))

    def check_room(self):
        farthest = max(max(abs(m.eta[0]), abs(m.eta[1])) for _, m in self.truth.all)
        print("farthest %.2f m" % farthest)
        self.assertLess(farthest, HALF_WIDTH)
        self.assertGreater(farthest, 0.3)

    def check_found(self, effect):
        """The effect is found and confirmed."""
        status = self.discovery.message
        self.assertTrue(status.sure, status.reason)
        self.assertEqual(status.verdict, "missing")
        self.assertIn(effect, status.effects)
        self.assertEqual(len(status.errors), len(status.models) * status.flights)
        last = status.errors[status.flights - 1 :: status.flights]
        print("errors on the last flight: %s" % ", ".join("%.3f" % e for e in last))
        self.assertLess(last[-1], 0.5 * last[0])
        belief = dict(zip(status.belief_effects, status.beliefs))
        self.assertGreater(belief[effect], 0.9)

    def check_folder(self):
        """Each flight of the journal has a bag that can be read; returns the journal."""
        folder = self.discovery.message.folder
        with open(os.path.join(folder, "journal.json")) as file:
            journal = json.load(file)
        names = [flown["recording"] for flown in journal["flights"]]
        for name in names:
            self.assertGreater(len(readers.read(os.path.join(folder, name)).pose_times), 50, name)
        self.assertEqual(len(names), len(set(names)))
        return journal
