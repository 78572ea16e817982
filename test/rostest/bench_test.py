#!/usr/bin/python3
"""The thruster bench: constant levels without mocap, only if parameter bench allows it."""

import os
import sys

import harness
import rospy
import rostest
from ground_msgs.msg import ControllerStatus
from sender_rig import NODELET, ZERO, SenderTest, refusal, wait_for
from std_srvs.srv import Trigger

CFG = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "cfg")
MODEL = os.path.join(CFG, "hovercraft", "tiny_whoover.yaml")
ROOM = os.path.join(CFG, "room", "room_4x4.yaml")
BENCH = "bench mode: without mocap there is no fence; tie the craft down"
HOLD = 0.6  # [s]
LEVELS = [0.0, 0.3, 0.0, 0.8]
LEFT, RIGHT = [(x, 0.0, 0.0) for x in LEVELS], [(0.0, x, 0.0) for x in LEVELS]
PARAMETERS = {
    "require_state": "false",
    "returns": "false",
    "design": "single-thruster",
    "levels": " ".join(map(str, LEVELS)),
    "hold": HOLD,
    "duration": 2 * HOLD * len(LEVELS),
    "lift": 0.0,
    "lift_time": 0.0,
}


class Bench(SenderTest):
    """Tests of a sender for the bench; none publishes a state."""

    def setUp(self):
        super().setUp()
        self.feed.set(valid=None)
        self.hovercraft = self.speaking = None

    def tearDown(self):
        if self.speaking:
            self.speaking.stop()
        super().tearDown()
        for name in ("controller", "other"):
            if rospy.has_param(name):
                rospy.delete_param(name)

    def bench(self, **parameters):
        """Starts a sender for the bench, a craft that sends telemetry, and a controller."""
        self.start(bench="true", **parameters)
        self.hovercraft = self.craft()
        self.speaking = harness.Repeater(50, self.hovercraft.send)
        self.feed.leave_controls()
        return self.controller("Excitation", PARAMETERS)

    def controller(self, kind, parameters):
        self.controller_status = harness.Latest("controller/status", ControllerStatus)
        process = self.spawn(
            NODELET,
            "standalone",
            "ground/" + kind,
            "__name:=controller",
            *("_%s:=%s" % p for p in parameters.items()),
        )
        rospy.wait_for_service("controller/start", 20)
        return process

    def run_until(self, level):
        """Arms, starts, and waits for a level."""
        answers = []
        wait_for(lambda: answers.append(self.arm()) or answers[-1].success, "arming")
        self.assertEqual(answers[-1].message, "armed; " + BENCH)
        start = rospy.ServiceProxy("controller/start", Trigger)()
        self.assertTrue(start.success, start.message)
        self.wait_driving(self.hovercraft, level)

    def wait_controller(self, state, what):
        wait_for(lambda: self.controller_status.message.state == state, what)

    def test_levels_arrive_on_time(self):
        self.bench()
        self.run_until(LEFT[1])
        self.assertEqual(self.status.reason, "armed with commands of /controller; " + BENCH)
        self.wait_controller(ControllerStatus.DONE, "the end")
        self.hovercraft.wait_packets(3)  # until the zero arrives
        packets = self.hovercraft.since(0)
        edges = [
            (after.time, after[1:]) for before, after in zip(packets, packets[1:]) if after[1:] != before[1:]
        ]
        expected = [(i * HOLD, level) for i, level in enumerate(LEFT + RIGHT)][1:]
        expected.append((len(LEFT + RIGHT) * HOLD, ZERO))
        self.assertEqual([level for _, level in edges], [level for _, level in expected])
        begin = edges[0][0] - HOLD
        late = [time - begin - due for (time, _), (due, _) in zip(edges, expected)]
        print("edges off by at most %.1f ms" % (1e3 * max(map(abs, late))))
        self.assertLess(sorted(map(abs, late))[len(late) // 2], 0.005)
        self.assertLess(max(map(abs, late)), 0.1)

    def test_a_controller_that_needs_the_state_is_refused(self):
        self.start(bench="true")
        self.craft()
        self.feed.leave_controls()
        self.controller("TrajectoryTracking", {"require_state": "false", "model": MODEL})
        answer = rospy.ServiceProxy("controller/start", Trigger)()
        self.assertFalse(answer.success)
        self.assertEqual(answer.message, "it drives by the state, and require_state is false")

    def test_without_bench_nothing_is_armed(self):
        self.start()
        rospy.set_param("sender/bench", True)  # has no effect on a running sender
        craft = self.craft()
        craft.wait_packets(5)
        answer = self.arm()
        self.assertEqual((answer.success, answer.message), (False, "not armed: there is no state"))

    def test_parameters_that_contradict_a_bench_are_refused(self):
        for nodelet, parameters, complaint in (
            ("Sender", {"bench": "true", "room": ROOM}, "a bench has no room"),
            ("Sender", {"bench": "true", "auto_arm": "true"}, "arm a craft on a bench by hand"),
            ("Excitation", {"require_state": "false"}, "returns go by the state"),
            ("Excitation", {**PARAMETERS, "room": ROOM}, "the room needs the state"),
        ):
            self.assertIn(complaint, refusal(nodelet, {"port": 0, **parameters}))


if __name__ == "__main__":
    rospy.init_node("bench_test", disable_signals=True)
    rostest.rosrun("ground", "bench", Bench, sys.argv)
