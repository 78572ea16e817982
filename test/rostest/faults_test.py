#!/usr/bin/python3
"""Faults injected into a craft that tracks a circle: each ends as its row says, and thrust never goes
over the wire more than 0.3 s after the last pose that could be believed."""
import copy
import math
import os
import sys
import time
import unittest

import rospy
import rostest
from geometry_msgs.msg import PoseStamped
from ground_msgs.msg import ControllerStatus, Reference, SenderStatus, State
from std_srvs.srv import SetBool, Trigger

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import harness  # noqa: E402
from wire_proxy import WireProxy  # noqa: E402

LIMIT = 0.3  # of thrust after the last pose that is to be believed [s]
GOES_ON, STOPS = "goes on", "stops"
JUMP = 2  # frames
TRACKS = 0.05  # error of a craft that has recovered [m]


class MocapFault:
    """Passes the simulator's poses on; `spoil` makes of a pose the one that is published, or None."""

    def __init__(self):
        self.spoil = None
        self.last_good = time.time()
        self._publisher = rospy.Publisher(
            "vrpn_client_node/hovercraft/pose", PoseStamped, queue_size=1, tcp_nodelay=True
        )
        self._subscriber = rospy.Subscriber(
            "unspoilt_pose", PoseStamped, self._pass, tcp_nodelay=True
        )

    def _pass(self, pose):
        spoil = self.spoil
        if spoil is None:
            self.last_good = time.time()
            self._publisher.publish(pose)
            return
        changed = spoil(copy.deepcopy(pose))
        if changed is not None:
            self._publisher.publish(changed)


def lose(pose):
    return None


def frozen():
    first = []

    def spoil(pose):
        first.append(pose)
        changed = copy.deepcopy(first[0])
        changed.header.stamp = pose.header.stamp
        return changed

    return spoil


def jump():
    frames = []

    def spoil(pose):
        frames.append(pose)
        if len(frames) <= JUMP:
            pose.pose.position.x += 1.0
        return pose

    return spoil


def not_finite(pose):
    pose.pose.position.x = math.nan
    return pose


def endless(pose):
    pose.pose.orientation.w = math.inf
    return pose


# fault, how poses are spoilt, for how long [s], how it ends
MOCAP = [
    ("mocap lost for 0.1 s", lambda: lose, 0.1, GOES_ON),
    ("mocap lost for 0.5 s", lambda: lose, 0.5, GOES_ON),
    ("mocap lost for 5 s", lambda: lose, 5.0, STOPS),
    ("pose frozen for 2 s", frozen, 2.0, STOPS),
    ("poses not finite for 2 s", lambda: not_finite, 2.0, STOPS),
    ("orientations infinite for 2 s", lambda: endless, 2.0, STOPS),
    ("pose 1 m off for two frames", jump, 0.1, GOES_ON),
]
# fault, what happens to packets for 3 s
WIRE = [
    ("30% of the packets lost", {"drop": 0.3}),
    ("packets twice and in disorder", {"twice": 0.3, "swap": 0.3}),
]


class FaultsTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.wire = WireProxy(int(sys.argv[1]), int(sys.argv[2]))
        cls.mocap = MocapFault()
        cls.status = harness.Latest("controller/status", ControllerStatus, keep=True)
        cls.sender = harness.Latest("sender/status", SenderStatus, keep=True)
        cls.truth = harness.Latest("simulator/truth", State)
        cls.reference = harness.Latest("reference", Reference)
        for name, kind in (("arm", SetBool), ("start", Trigger), ("stop", Trigger)):
            full = ("sender/" if name == "arm" else "controller/") + name
            rospy.wait_for_service(full, 30)
            setattr(cls, name, staticmethod(rospy.ServiceProxy(full, kind)))
        harness.wait_for(
            lambda: cls.status.message
            and cls.truth.message
            and cls.sender.message
            and cls.sender.message.peer,
            30,
            "craft and controller",
        )

    @classmethod
    def tearDownClass(cls):
        cls.wire.close()

    def error(self):
        t, r = self.truth.message, self.reference.message
        return math.hypot(t.eta[0] - r.p[0], t.eta[1] - r.p[1])

    def drive(self):
        """A craft that tracks, armed and on its way."""
        S = ControllerStatus
        if self.status.message.state != S.RUNNING or self.sender.message.state != 1:
            self.stop()
            harness.wait_for(lambda: self.status.message.state != S.RUNNING, 5, "a stop")
            self.arm(False)
            harness.wait_for(lambda: self.arm(True).success, 10, "an armed sender")
            self.assertTrue(self.start().success)
            harness.wait_for(lambda: self.status.message.state == S.RUNNING, 10, "RUNNING")
            harness.wait_for(lambda: self.reference.message, 10, "a reference")
        since = []

        def settled():
            since.append(self.error())
            return len(since) > 300 and max(since[-300:]) < TRACKS

        harness.wait_for(settled, 30, "a craft that tracks")

    def ended(self, ending, begun):
        """Whether status and sender say what they should since a time."""
        states = {m.state for at, m in self.status.all if at > begun}
        faults = {m.state for at, m in self.sender.all if at > begun}
        if ending == GOES_ON:
            self.assertFalse(states & {ControllerStatus.STOPPED}, self.status.message.reason)
            self.assertFalse(faults & {SenderStatus.FAULT}, self.sender.message.reason)
        else:
            self.assertIn(ControllerStatus.STOPPED, states)
            self.assertIn(SenderStatus.FAULT, faults)

    def test_the_mocap_fails(self):
        for name, spoil, seconds, ending in MOCAP:
            with self.subTest(name):
                self.drive()
                begun = time.monotonic()
                self.mocap.spoil = spoil()
                time.sleep(seconds)
                last, end = self.mocap.last_good, time.time()
                self.mocap.spoil = None
                late = [t - last for t in self.wire.thrust_between(last, end)]
                worst = max(late, default=0.0)
                print("%-32s %s; thrust until %3.0f ms after it" % (name, ending, 1e3 * worst))
                self.assertLess(worst, LIMIT)
                if ending == GOES_ON:
                    self.drive()
                else:
                    harness.wait_for(
                        lambda: self.status.message.state == ControllerStatus.STOPPED, 5, "a stop"
                    )
                    time.sleep(0.3)  # and it stays so when the mocap is back
                    self.assertEqual(self.wire.thrust_between(end, time.time()), [])
                self.ended(ending, begun)

    def test_the_wire_fails(self):
        for name, how in WIRE:
            with self.subTest(name):
                self.drive()
                begun, errors = time.monotonic(), []
                for what, share in how.items():
                    setattr(self.wire, what, share)
                while time.monotonic() < begun + 3:
                    errors.append(self.error())
                    time.sleep(0.01)
                self.wire.drop = self.wire.twice = self.wire.swap = 0.0
                print("%-32s goes on; error at most %.0f mm" % (name, 1e3 * max(errors)))
                self.assertLess(max(errors), 2 * TRACKS)
                self.ended(GOES_ON, begun)


if __name__ == "__main__":
    rospy.init_node("faults_test")
    rostest.rosrun("ground", "faults_test", FaultsTest)
