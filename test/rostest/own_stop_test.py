#!/usr/bin/python3
"""Trials of the craft's own stop through the whole chain, and their outcomes when arming."""

import os
import unittest

import dynamic_reconfigure.client
import harness
import rospy
import rostest
from ground_msgs.msg import SenderStatus, State
from ground_msgs.srv import Silence
from rosgraph_msgs.msg import Log
from std_srvs.srv import SetBool

from ground.nodes import own_stop, stop_trial
from ground.nodes import own_stop_records as records

UNPROVEN = "it is not proven that this craft stops by itself (rosrun ground prove_stop)"
PUSH = stop_trial.Push(thrust=0.2, lift_time=0.3, thrust_time=0.9, silence=1.0)


class OwnStopTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.status = harness.sender_status()
        cls.state = harness.Latest("state", State)
        cls.truth = harness.Latest("simulator/truth", State)
        cls.log = harness.Latest("/rosout", Log, keep=True)
        rospy.wait_for_service("sender/silence", 30)
        cls.arm = staticmethod(rospy.ServiceProxy("sender/arm", SetBool))
        cls.silence = staticmethod(rospy.ServiceProxy("sender/silence", Silence))
        harness.wait_for(lambda: cls.state.message and cls.state.message.valid, 20, "a state")
        cls.simulator = dynamic_reconfigure.client.Client("simulator", timeout=10)

    @classmethod
    def tearDownClass(cls):
        cls.simulator.close()

    def armed(self):
        answers = []
        harness.wait_for(
            lambda: answers.append(self.arm(True)) or answers[-1].success, 10, lambda: str(answers[-1])
        )
        return answers[-1].message

    def at_rest(self):
        still = lambda: abs(self.truth.message.nu[0]) < 0.01  # noqa: E731
        harness.wait_for(still, 5, "a craft at rest")

    def verdict(self, watchdog):
        self.simulator.update_configuration({"watchdog": watchdog})
        self.at_rest()
        stack = stop_trial.Stack("ground_manager")
        self.assertTrue(stack.simulated)
        self.armed()
        verdict = stop_trial.verdict_of(*stack.try_stop(PUSH, 5.0))
        print("watchdog %.1f s: %s: %s" % (watchdog, verdict.outcome, verdict.reason))
        harness.wait_for(lambda: self.status.message.state == SenderStatus.DISARMED, 5, "a disarmed sender")
        return verdict

    def test_a_craft_that_stops_after_half_a_second(self):
        verdict = self.verdict(0.5)
        self.assertEqual(verdict.outcome, own_stop.PASSED, verdict.reason)
        self.assertAlmostEqual(verdict.stopped_after, 0.5, delta=0.1)

    def test_a_craft_that_does_not_stop(self):
        verdict = self.verdict(0.0)
        self.assertEqual(verdict.outcome, own_stop.FAILED, verdict.reason)
        self.assertIn("driven on by its thrust", verdict.reason)
        self.at_rest()  # the sender's zeros stop it

    def test_a_silence_is_refused_while_disarmed(self):
        self.arm(False)
        answer = self.silence(1.0)
        self.assertFalse(answer.success)
        self.assertEqual(answer.message, "not armed: disarmed by hand")

    def test_arming_reports_the_proof(self):
        path, craft = rospy.get_param("sender/own_stop"), "Tiny Whoover"
        self.addCleanup(lambda: os.path.exists(path) and os.remove(path))
        self.arm(False)

        def trial(outcome, simulated=False):
            records.append(path, craft, {"date": "2026-01-02", "outcome": outcome, "simulated": simulated})

        def arming_message():
            message = self.armed()
            reason = harness.wait_for(
                lambda: self.status.message.state == SenderStatus.ARMED and self.status.message.reason,
                5,
                "ARMED",
            )
            self.arm(False)
            harness.wait_for(lambda: self.status.message.state == SenderStatus.DISARMED, 5, "DISARMED")
            self.assertEqual(reason.partition("; ")[2], message.partition("; ")[2])
            return message

        trial("passed", simulated=True)
        self.assertEqual(arming_message(), "armed; " + UNPROVEN)
        warned = lambda: [  # noqa: E731
            m for _, m in self.log.all if m.level == Log.WARN and UNPROVEN in m.msg
        ]
        harness.wait_for(warned, 5, "a warning in the log")
        trial("failed")
        self.assertIn("armed; this craft FAILED to stop by itself on 2026-01-02", arming_message())
        trial("passed")
        self.assertEqual(arming_message(), "armed")


if __name__ == "__main__":
    rospy.init_node("own_stop_test")
    rostest.rosrun("ground", "own_stop_test", OwnStopTest)
