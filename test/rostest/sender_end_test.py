#!/usr/bin/python3
"""Whatever ends the controller or the sender, the last packets to the craft are zero."""
import os
import signal
import subprocess
import sys
import time
import unittest

import rospy
import rostest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import harness  # noqa: E402

PORT = 33421
LIMIT = 0.25  # from the fault to zero on the wire [s]
DRIVEN = (2000, 2000, 1600, 1250)  # DL, DR, R, L


class EndTest(unittest.TestCase):
    """A sender of its own, driven, that is ended in different ways."""

    def setUp(self):
        self.station = harness.Station(controls=False)
        self.processes = []
        self.craft = harness.Craft(PORT)

    def tearDown(self):
        for process in self.processes:
            if process.poll() is None:
                process.kill()
            process.wait()
        self.station.stop()
        self.craft.close()

    def start(self, *command):
        self.processes.append(subprocess.Popen(command, stdout=sys.stderr))
        return self.processes[-1]

    def start_sender(self, *nodelet):
        private = ["__name:=other_sender", "_port:=%d" % PORT, "_auto_arm:=true"]
        return self.start("rosrun", "nodelet", "nodelet", *nodelet, *private)

    def start_controller(self):
        """Zero commands until armed, then driving; a process that may be killed."""
        script = (
            "import rospy\n"
            "from ground_msgs.msg import Controls, SenderStatus\n"
            "rospy.init_node('scripted_controller')\n"
            "armed = []\n"
            "rospy.Subscriber('other_sender/status', SenderStatus,"
            " lambda s: armed.append(1) if s.state == 1 else None)\n"
            "pub = rospy.Publisher('controls', Controls, queue_size=1)\n"
            "while not rospy.is_shutdown():\n"
            "    c = Controls(left=0.25, right=0.6, lift=1.0) if armed else Controls()\n"
            "    c.header.stamp = rospy.Time.now()\n"
            "    pub.publish(c)\n"
            "    rospy.sleep(0.02)\n"
        )
        controller = self.start("/usr/bin/python3", "-c", script)
        harness.wait_for(lambda: self.craft.last() == DRIVEN, 15, "the craft is driven")
        return controller

    def expect_zero(self, moment, what):
        harness.wait_for(lambda: self.craft.zero_since(moment), 3, "zero packets")
        time.sleep(0.3)
        delay = self.craft.zero_since(moment) - moment
        zeros = [m for t, m in self.craft.packets if t > moment and m == harness.ZERO]
        print(
            "%s: zero on the wire after %.0f ms, %d zero packets" % (what, 1e3 * delay, len(zeros))
        )
        self.assertEqual(self.craft.last(), harness.ZERO)
        self.assertGreaterEqual(len(zeros), 3, "zero packets are repeated")
        return delay

    def test_killing_the_controller(self):
        self.start_sender("standalone", "ground/Sender")
        controller = self.start_controller()
        controller.kill()
        delay = self.expect_zero(time.monotonic(), "controller killed")
        self.assertLess(delay, LIMIT)

    def test_unloading_the_nodelet(self):
        self.start("rosrun", "nodelet", "nodelet", "manager", "__name:=other_manager")
        loader = self.start_sender("load", "ground/Sender", "other_manager")
        self.start_controller()
        moment = time.monotonic()
        loader.send_signal(signal.SIGINT)  # unloads what it has loaded
        self.expect_zero(moment, "nodelet unloaded")

    def test_shutting_down_the_node(self):
        sender = self.start_sender("standalone", "ground/Sender")
        self.start_controller()
        moment = time.monotonic()
        pids = subprocess.run(["pgrep", "-f", "__name:=other_sender"], stdout=subprocess.PIPE)
        for pid in pids.stdout.split():
            os.kill(int(pid), signal.SIGINT)
        self.expect_zero(moment, "node shut down")
        sender.wait(timeout=10)


if __name__ == "__main__":
    rospy.init_node("sender_end_test")
    rostest.rosrun("ground", "sender_end_test", EndTest)
