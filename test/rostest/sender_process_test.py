#!/usr/bin/python3
"""With sender_process:=true the sender outlives its manager, which is killed in flight, and sends zeros."""

import os
import signal
import subprocess
import sys
import time
import unittest
from xmlrpc.client import ServerProxy

import rosgraph
import rosnode
import rospy
import rostest
from fake_craft import free_port, is_zero

sys.path.insert(1, os.path.dirname(os.path.dirname(os.path.realpath(__file__))))
import harness
import requirements
from wire_proxy import WireProxy

WIRED = os.path.join(os.path.dirname(os.path.realpath(__file__)), "wired.launch")
ZEROS = 5  # zeros that show that the sender goes on
WATCHDOG = 0.25  # time without a command after which the craft stops by itself [s]


def pid(node):
    """Process id of a node."""
    uri = rosnode.get_api_uri(rosgraph.Master("/test"), node)
    return ServerProxy(uri).getPid("/test")[2]


class SenderProcessTest(unittest.TestCase):
    def setUp(self):
        sender, craft = free_port(), free_port()
        self.wire = WireProxy(sender, craft)
        self.launch = subprocess.Popen(
            ["roslaunch", "--wait", WIRED, "port:=%d" % sender, "wire:=%d" % craft]
            + ["sender_process:=true", "auto_arm:=true", "auto_start:=true"],
            start_new_session=True,
        )

    def tearDown(self):
        self.launch.send_signal(signal.SIGINT)
        self.launch.wait(timeout=20)
        self.wire.close()

    def drives(self):
        now = time.time()
        return len(self.wire.thrust_between(now - 2, now)) > 20

    def test_a_killed_manager_leaves_a_sender_that_sends_zeros(self):
        harness.wait_for(self.drives, 40, "a craft that is driven")
        manager = pid("/ground_manager")
        self.assertNotEqual(manager, pid("/sender"))
        os.kill(manager, signal.SIGKILL)
        killed = time.time()

        def zeros():
            return [p.time for p in self.wire.packets if p.time > killed and is_zero(p)]

        harness.wait_for(lambda: len(zeros()) >= ZEROS, 5, "zeros")
        packets = [p.time for p in self.wire.packets if killed - 0.1 < p.time <= zeros()[0]]
        gaps = [after - before for before, after in zip(packets, packets[1:])]
        print("zeros after %.0f ms" % (1e3 * (zeros()[0] - killed)))
        self.assertLess(zeros()[0] - killed, requirements.limit("thrust-after-end"))
        self.assertLess(max(gaps), WATCHDOG, "the sender stops the craft, not its own watchdog")
        self.assertEqual(self.wire.thrust_between(zeros()[0], time.time()), [])


if __name__ == "__main__":
    rospy.init_node("sender_process_test")
    rostest.rosrun("ground", "sender_process_test", SenderProcessTest)
