#!/usr/bin/python3
"""Two crafts on one master: each has its own poses, commands and link, and stops alone."""

import random
import time
import unittest

import harness
import rospy
import rostest
from fake_craft import FakeCraft, is_zero
from ground_msgs.msg import State
from std_srvs.srv import SetBool, Trigger

PORTS = {"a": (33582, 33571), "b": (33583, 33572)}  # of the sender and of the craft


class TrembleMocap(harness.Mocap):
    """Poses with noise, since a pose that stands still is that of a body that is lost."""

    def publish(self, stamp=None):
        self.y = random.gauss(0, 3e-4)
        super().publish(stamp)


class TwoCraftsTest(unittest.TestCase):
    def setUp(self):
        self.crafts = {name: FakeCraft(*ports) for name, ports in PORTS.items()}
        self.mocaps = {name: TrembleMocap("/mocap/%s/pose" % name) for name in PORTS}
        self.states = {name: harness.Latest("/%s/state" % name, State) for name in PORTS}
        self.mocaps["a"].x, self.mocaps["b"].x = -1.0, 1.0

    def call(self, service, kind, *request):
        rospy.wait_for_service(service, 30)
        return rospy.ServiceProxy(service, kind)(*request)

    def drive(self, name):
        harness.wait_for(
            lambda: self.call("/%s/sender/arm" % name, SetBool, True).success, 20, "arming of " + name
        )
        self.assertTrue(self.call("/%s/controller/start" % name, Trigger).success)
        self.crafts[name].wait(lambda packets: packets and packets[-1].left > 0.5, "thrust of " + name)

    def test_each_flies_alone(self):
        for name, x in (("a", -1.0), ("b", 1.0)):
            harness.wait_for(
                lambda n=name: self.states[n].message and self.states[n].message.valid,
                20,
                "a state of " + name,
            )
            self.assertAlmostEqual(self.states[name].message.eta[0], x, delta=0.05)
        self.drive("a")
        self.assertTrue(all(map(is_zero, self.crafts["b"].packets)), "b got commands of a")
        self.drive("b")
        self.assertTrue(self.call("/a/sender/arm", SetBool, False).success)
        stopped = time.time()
        self.crafts["b"].wait(
            lambda packets: any(p.left > 0.5 and p.time > stopped + 0.3 for p in packets),
            "further thrust of b",
        )
        late = [packet for packet in self.crafts["a"].since(stopped + 0.3) if not is_zero(packet)]
        self.assertEqual(late, [])


if __name__ == "__main__":
    rospy.init_node("two_crafts_test")
    rostest.rosrun("ground", "two_crafts_test", TwoCraftsTest)
