"""Helpers of the sender's tests: a sender for each test, crafts, states and commands."""

import os
import signal
import subprocess
import sys
import threading
import time
import unittest

import roslib.packages
import rospy
from fake_craft import FakeCraft, free_port, is_zero
from ground_msgs.msg import Controls, SenderStatus, State
from std_srvs.srv import SetBool

LIMIT = 0.25  # longest time until zeros are sent [s]
DRIVE = (0.5, 0.25, 1.0)
ZERO = (0.0, 0.0, 0.0)
NODELET = roslib.packages.find_node("nodelet", "nodelet")[0]


def refusal(nodelet, parameters):
    """Standard error of a nodelet that must not load with these parameters {name: value}."""
    command = [NODELET, "standalone", "ground/" + nodelet, "__name:=other"]
    command += ["_%s:=%s" % p for p in parameters.items()]
    other = subprocess.run(command, stderr=subprocess.PIPE, timeout=20)
    rospy.delete_param("other")
    assert other.returncode != 0, "%s has loaded with %s" % (nodelet, parameters)
    return other.stderr.decode()


def wait_for(condition, what, timeout=10.0):
    """Waits until condition() is true and returns its value."""
    deadline = time.monotonic() + timeout
    while True:
        result = condition()
        if result:
            return result
        if time.monotonic() > deadline:
            raise AssertionError(what + " did not happen")
        time.sleep(0.002)


def stamp(age=0.0):
    return rospy.Time.now() - rospy.Duration(age)


def controls_of(values, age=0.0):
    message = Controls()
    message.header.stamp = stamp(age)
    message.left, message.right, message.lift = values
    return message


class Feed:
    """Publishes state and controls at 100 Hz like mocap_state and controller. None for `valid` or
    `command` stops the topic; state_age and command_age make its stamps older. last_state and last_command
    are the times of the last good messages."""

    def __init__(self):
        self.command = ZERO
        self.valid = True
        self.eta, self.nu = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        self.command_age = self.state_age = 0.0  # [s]
        self.last_state = self.last_command = 0.0  # [s, time.time()]
        self.lock = threading.Lock()
        self.states = rospy.Publisher("state", State, queue_size=1, tcp_nodelay=True)
        self.controls = None
        self.take_controls()
        threading.Thread(target=self._run, daemon=True).start()

    def set(self, **values):
        """Sets all values at once: no old value is published after it returns."""
        with self.lock:
            for name, value in values.items():
                setattr(self, name, value)

    def take_controls(self):
        with self.lock:
            if self.controls is None:
                self.controls = rospy.Publisher("controls", Controls, queue_size=1, tcp_nodelay=True)

    def leave_controls(self):
        """Stops publishing controls: only one controller may."""
        with self.lock:
            self.controls.unregister()
            self.controls = None

    def _run(self):
        due = time.monotonic()
        while not rospy.is_shutdown():
            with self.lock:
                if self.valid is not None:
                    state = State(valid=self.valid, status="" if self.valid else "lost")
                    state.header.stamp = stamp(self.state_age)
                    state.eta, state.nu = self.eta, self.nu
                    self.states.publish(state)
                    if self.valid and not self.state_age:
                        self.last_state = time.time()
                if self.command is not None and self.controls is not None:
                    self.controls.publish(controls_of(self.command, self.command_age))
                    if not self.command_age:
                        self.last_command = time.time()
            due = max(due + 0.01, time.monotonic())
            time.sleep(due - time.monotonic() if due > time.monotonic() else 0)


class SenderTest(unittest.TestCase):
    """Each test gets a sender in a separate process, which is ended afterwards."""

    feed = None
    worst = {}

    @classmethod
    def setUpClass(cls):
        if SenderTest.feed is None:
            SenderTest.feed = Feed()
            SenderTest.status = None
            rospy.Subscriber("sender/status", SenderStatus, SenderTest._on_status, tcp_nodelay=True)

    @classmethod
    def tearDownClass(cls):
        for what, seconds in sorted(cls.worst.items()):
            print("worst case, %s: %.1f ms" % (what, 1000 * seconds))
        sys.stdout.flush()

    @staticmethod
    def _on_status(message):
        SenderTest.status = message

    def setUp(self):
        self.processes, self.crafts = [], []
        self.port = free_port()
        self.feed.take_controls()
        self.feed.set(command=ZERO, valid=True, command_age=0.0, state_age=0.0)
        self.feed.set(eta=(0.0, 0.0, 0.0), nu=(0.0, 0.0, 0.0))

    def tearDown(self):
        for process in self.processes:
            if process.poll() is None:
                process.kill()
            process.wait()
        for craft in self.crafts:
            craft.close()
            self.assertEqual(craft.garbled, [])
        if rospy.has_param("sender"):
            rospy.delete_param("sender")
        wait_for(lambda: self.feed.states.get_num_connections() == 0, "the end of the old sender")

    def spawn(self, *command):
        process = subprocess.Popen(command)
        self.processes.append(process)
        return process

    def start(self, *arguments, **parameters):
        """Starts a sender and waits until its topics are connected."""
        SenderTest.status = None
        parameters.setdefault("port", self.port)
        command = [NODELET, *(arguments or ("standalone", "ground/Sender")), "__name:=sender"]
        process = self.spawn(*command, *("_%s:=%s" % p for p in parameters.items()))
        self.wait_connected()
        return process

    def wait_connected(self):
        wait_for(
            lambda: self.feed.controls.get_num_connections() and self.feed.states.get_num_connections(),
            "the sender's subscriptions",
            timeout=20,
        )
        wait_for(lambda: SenderTest.status, "a status", timeout=20)
        rospy.wait_for_service("sender/arm", 20)

    def craft(self, hello=True):
        craft = FakeCraft(self.port)
        self.crafts.append(craft)
        if hello:
            craft.send()
            craft.wait_packets(1)
        return craft

    def wait_status(self, condition, what):
        return wait_for(lambda: SenderTest.status and condition(SenderTest.status), "status " + what)

    @staticmethod
    def arm(on=True):
        return rospy.ServiceProxy("sender/arm", SetBool)(on)

    def arm_and_drive(self, craft, values=DRIVE):
        """Arms as soon as possible and waits until the command is sent."""
        self.feed.set(command=ZERO, valid=True, command_age=0.0, state_age=0.0)
        wait_for(lambda: self.arm().success, "arming")
        self.wait_status(lambda s: s.state == SenderStatus.ARMED, "ARMED")
        self.feed.set(command=values)
        self.wait_driving(craft, values)

    @staticmethod
    def wait_driving(craft, values=DRIVE):
        # Five packets ensure that the feed's last message is younger than the last zero.
        craft.wait(
            lambda packets: len(packets) >= 5 and all(p[1:] == values for p in packets[-5:]), "driving"
        )

    def assert_zero_within_limit(self, craft, start, what):
        """Checks that after `start` zeros are sent in time, and nothing else after them."""
        zero = craft.wait(
            lambda packets: next((p for p in packets if p.time > start and is_zero(p)), None),
            "zero packet after " + what,
        )
        craft.wait_packets(5)
        self.assert_zero(craft.since(zero.time))
        self.worst[what] = max(self.worst.get(what, 0), zero.time - start)
        self.assertLessEqual(zero.time - start, LIMIT, what)

    def assert_zero(self, packets):
        self.assertEqual([p for p in packets if not is_zero(p)], [])

    def assert_fault(self, reason):
        status = self.wait_status(lambda s: s.state == SenderStatus.FAULT and s, "FAULT")
        self.assertIn(reason, status.reason)
        # The fault is latched: good messages and arming do not end it.
        self.feed.set(command=ZERO, valid=True)
        answer = self.arm()
        self.assertFalse(answer.success)
        self.assertIn("disarm first", answer.message)
        self.assertTrue(self.arm(False).success)


def publish_until_killed(values):
    """Publishes as a controller: zeros until the sender is armed, then `values`."""
    rospy.init_node("doomed_controller", anonymous=True)
    feed = rospy.Publisher("controls", Controls, queue_size=1, tcp_nodelay=True)
    armed = []
    rospy.Subscriber("sender/status", SenderStatus, lambda s: armed.append(s.state == SenderStatus.ARMED))
    while not rospy.is_shutdown():
        feed.publish(controls_of(values if armed and armed[-1] else ZERO))
        time.sleep(0.01)


def spawn_controller(test, values):
    return test.spawn(sys.executable, os.path.abspath(__file__), *map(str, values))


def kill(process, number=signal.SIGKILL):
    """Sends a signal; returns the time [s, time.time()]."""
    process.send_signal(number)
    return time.time()


if __name__ == "__main__":
    publish_until_killed([float(v) for v in sys.argv[1:4]])
