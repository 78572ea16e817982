#!/usr/bin/python3
"""Faults on the wire between Motive and its client, while a craft tracks a circle. Each must end as its row
states, and no thrust may be sent long after the last frame that is right."""

import os
import random
import struct
import sys
import threading
import time

import rospy
import rostest
from geometry_msgs.msg import PoseStamped
from ground_msgs.msg import MocapFrame, State
from rosgraph_msgs.msg import Log

sys.path.insert(1, os.path.dirname(sys.path[0]))
import harness
import requirements
from fake_lab import FakeLab
from fake_motive import FakeMotive
from faults_case import FAULTS, GOES_ON, RUNNING, STOPPED, FaultsCase, add_tests

FOLDER = os.path.dirname(os.path.realpath(__file__))
HOST = "127.0.0.4"
LIMIT = requirements.limit("thrust-after-state")  # longest thrust after the last right frame [s]
SOMEWHERE = (1.5, 0.5, -1.5)  # where a body is that is not the craft [m]
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def lost(body):
    return [(body[0], *body[1:3], False)]


def lost_as_zeros(body):
    return [(body[0], (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0), True)]


def lost_as_nan(body):
    return [(body[0], (float("nan"),) * 3, (float("nan"),) * 4, True)]


def with_another(body):
    return [(2, SOMEWHERE, UPRIGHT, True), body, (3, SOMEWHERE, UPRIGHT, True)]


def absent(body):
    return [(2, SOMEWHERE, UPRIGHT, True)]


class Dropped:
    """Loses a share of the packets."""

    def __init__(self):
        self._random = random.Random(1)

    def __call__(self, packet):
        return [] if self._random.random() < 0.3 else [packet]


class Disordered:
    """Sends a share of the packets twice, and another share behind the next one."""

    def __init__(self):
        self._random, self._held = random.Random(2), []

    def __call__(self, packet):
        held, self._held = self._held, []
        chance = self._random.random()
        if chance < 0.3 and not held:
            self._held = [packet]
            return []
        return [packet] * (2 if chance > 0.7 else 1) + held


class Garbled:
    """Sends, beside each packet, ones that are cut off, inflated, or random."""

    def __init__(self):
        self._random = random.Random(3)

    def __call__(self, packet):
        cut = packet[: self._random.randrange(len(packet))]
        shrunk = cut[:2] + struct.pack("<H", max(0, len(cut) - 4)) + cut[4:]
        noise = struct.pack("<HH", 7, 60) + bytes(self._random.randrange(256) for _ in range(60))
        return [cut, shrunk, noise, packet, packet + bytes(40), b"\7"]


def cut_off(packet):
    return [packet[:2] + struct.pack("<H", 40) + packet[4:44]]


def silence(packet):
    return []


# (fault, spoiler of bodies, maker of a spoiler of packets, duration [s], end)
FAULTS_OF_FRAMES = [
    ("30% of the frames lost", None, Dropped, 3.0, GOES_ON),
    ("frames twice and in disorder", None, Disordered, 3.0, GOES_ON),
    ("unreadable packets between", None, Garbled, 3.0, GOES_ON),
    ("all frames cut off", None, lambda: cut_off, 2.0, FAULTS),
    ("two more bodies", with_another, None, 3.0, GOES_ON),
    ("body lost for 0.1 s", lost, None, 0.1, GOES_ON),
    ("body lost: last pose, flag off", lost, None, 2.0, FAULTS),
    ("body lost: zeros, flag on", lost_as_zeros, None, 2.0, FAULTS),
    ("body lost: NaN, flag on", lost_as_nan, None, 2.0, FAULTS),
    ("body no longer in the frames", absent, None, 2.0, FAULTS),
    ("server silent", None, lambda: silence, 2.0, FAULTS),
]


class FaultsMocapTest(FaultsCase):
    @classmethod
    def setUpClass(cls):
        cls.motive = FakeMotive(host=HOST)
        model = os.path.join(FOLDER, "../../cfg/hovercraft/tiny_whoover.yaml")
        cls.lab = FakeLab(model, int(sys.argv[1]), cls.motive)
        cls.state = harness.Latest("state", State)
        cls.log = harness.Latest("/rosout", Log, keep=True)
        cls.poses = harness.Latest("vrpn_client_node/hovercraft/pose", PoseStamped, keep=True)
        cls.frames = harness.Latest("vrpn_client_node/hovercraft/frame", MocapFrame, keep=True)
        super().setUpClass()

    @classmethod
    def tearDownClass(cls):
        cls.lab.close()

    def drive(self):
        """Arms and starts if necessary, and waits until the craft tracks for a while."""
        ready = lambda: self.state.message and self.state.message.valid  # noqa: E731
        harness.wait_for(lambda: ready() and self.status.message and self.sender.message, 30, "a valid state")
        self.run_again()
        since = time.monotonic()
        while time.monotonic() < since + 1.5:
            self.assertEqual(self.status.message.state, RUNNING, self.status.message.reason)
            time.sleep(0.05)

    def ends(self, name, ending, last, begun):
        """Checks the thrust after the last right frame [s, time.time()], and states since `begun` [s]."""
        if ending == GOES_ON:
            self.print("mocap: " + name, ending, "no stop")
        else:
            self.expect(STOPPED)
            time.sleep(0.3)  # no thrust when the mocap is back
            late = max([t - last for t in self.lab.thrust_between(last, time.time())], default=0.0)
            self.print("mocap: " + name, ending, "thrust until %3.0f ms after it" % (1e3 * late))
            self.assertLess(late, LIMIT)
        self.ended(ending, begun)

    def said(self, text, begun):
        return [m.msg for at, m in self.log.all if at > begun and text in m.msg]

    def frames_are_spoilt(self, name, bodies, packets, seconds, ending):
        self.drive()
        begun = time.monotonic()
        self.motive.spoil, self.lab.spoil = packets and packets(), bodies
        time.sleep(seconds)
        last = self.lab.last_good
        poses = [m.pose.position.x for at, m in self.poses.all if at > begun + 0.1]
        self.motive.spoil = self.lab.spoil = None
        self.ends(name, ending, last, begun)
        if ending == GOES_ON:
            self.assertFalse([x for x in poses if abs(x - SOMEWHERE[0]) < 0.01])
        elif bodies or packets() is silence:
            self.assertEqual(poses, [], "a lost body has no pose")

    def test_renamed(self):
        self.drive()
        begun, last = time.monotonic(), time.time()
        self.motive.names = {1: "teapot"}
        try:
            harness.wait_for(
                lambda: self.said("has no body hovercraft; it has teapot", begun), 5, "the names"
            )
        finally:
            renamed, self.motive.names = time.time(), {1: "hovercraft"}
        # Until the client hears of it, at most ASK, the poses are still those of the craft.
        heard = [at for at, m in self.poses.all if begun < at][-1] - begun
        self.ends("body renamed", FAULTS, last + heard, begun)
        self.assertLess(heard, 1.5)
        self.assertGreater(renamed, last)

    def begins_again(self, name, version, pause):
        """The server restarts: numbers and clock begin again."""
        self.drive()
        begun = time.monotonic()
        self.motive.spoil, last = lambda packet: [], time.time()
        time.sleep(pause)
        self.motive.restart(version)
        self.motive.spoil = None
        self.ends(name, FAULTS, last, begun)
        self.drive()
        numbers = [m.number for at, m in self.frames.all if at > begun]
        self.assertLess(min(numbers), 2 / 0.01)
        self.stop()
        self.motive.restart((4, 1))
        since = time.monotonic() + 1
        harness.wait_for(lambda: self.frames.all[-1][0] > since and self.state.message.valid, 10, "frames")

    def clock_is_set(self, name, seconds):
        """The stamps of the poses stay right: nothing else happens."""
        self.drive()
        begun = time.monotonic()
        self.motive.origin -= seconds
        time.sleep(2)
        self.ends(name, GOES_ON, self.lab.last_good, begun)
        ages = [abs((rospy.Time.now() - m.header.stamp).to_sec()) for _, m in self.poses.all[-1:]]
        self.assertLess(max(ages), 0.1)
        self.assertTrue(
            self.said(
                "its clock stepped by %+.3f" % seconds if seconds > 0 else "its clock stepped by -", begun
            )
        )

    def test_flood(self):
        """20 times as many packets: frames again and again, and noise."""
        self.drive()
        begun, ends = time.monotonic(), threading.Event()
        newest = [b""]

        def keep(packet):
            newest[0] = packet
            return [packet]

        def flood():
            while not ends.wait(0.005):
                for one in [newest[0]] * 5 + [bytes(1400)] * 5:
                    self.motive.transmit(one)

        self.motive.spoil = keep
        flooding = threading.Thread(target=flood)
        flooding.start()
        time.sleep(3)
        ends.set()
        flooding.join()
        self.motive.spoil = None
        self.ends("flood, 2000 packets a second", GOES_ON, self.lab.last_good, begun)
        numbers = [m.number for at, m in self.frames.all if at > begun]
        self.assertEqual(len(numbers), len(set(numbers)))


if __name__ == "__main__":
    add_tests(FaultsMocapTest, FaultsMocapTest.frames_are_spoilt, FAULTS_OF_FRAMES)
    add_tests(
        FaultsMocapTest,
        FaultsMocapTest.begins_again,
        [("server restarts", None, 1.5), ("server of another version", (3, 0), 1.5)],
    )
    add_tests(
        FaultsMocapTest,
        FaultsMocapTest.clock_is_set,
        [("clock set ahead by 2 s", 2.0), ("clock set back by 2 s", -2.0)],
    )
    rospy.init_node("faults_mocap_test")
    rostest.rosrun("ground", "faults_mocap_test", FaultsMocapTest)
