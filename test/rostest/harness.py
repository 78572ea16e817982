"""Helpers of the ROS tests: publishers of a nodelet's inputs, listeners, and waiting."""

import math
import threading
import time

import rospy
from geometry_msgs.msg import PoseStamped
from ground_msgs.msg import SenderStatus, State


def wait_for(condition, timeout, message):
    """Waits for the first true value of condition(). Fails after `timeout` seconds of wall time with a
    message, which may be a function that gives it."""
    deadline = time.monotonic() + timeout
    while time.monotonic() < deadline:
        value = condition()
        if value:
            return value
        time.sleep(0.002)
    text = message() if callable(message) else message
    raise AssertionError("waited %.1f s in vain: %s" % (timeout, text))


class Repeater:
    """Calls `what` at a rate in a thread until stopped."""

    def __init__(self, rate, what):
        self._what, self._period, self._alive = what, 1.0 / rate, True
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self):
        due = time.monotonic()
        while self._alive and not rospy.is_shutdown():
            self._what()
            due = max(due + self._period, time.monotonic() - 0.1)
            time.sleep(max(0.0, due - time.monotonic()))

    def stop(self):
        self._alive = False
        self._thread.join()


class StatePublisher:
    """Publishes states as mocap_state would, at 100 Hz; `state` may be changed."""

    def __init__(self):
        self.state = State()
        self.state.valid = True
        self.state.pose_covariance = (2.5e-7, 0, 0, 0, 2.5e-7, 0, 0, 0, 2.5e-5)
        self._publisher = rospy.Publisher("state", State, queue_size=1, tcp_nodelay=True)
        self._repeater = Repeater(100, self._publish)

    def _publish(self):
        self.state.header.stamp = rospy.Time.now()
        self.state.pose = self.state.eta
        self._publisher.publish(self.state)

    def stop(self):
        self._repeater.stop()


class Latest:
    """The last message of a topic; with `keep`, all of them in `all` with their arrival."""

    def __init__(self, topic, kind, keep=False):
        self.message, self.all = None, []
        self._keep = keep
        self._subscriber = rospy.Subscriber(topic, kind, self._take, tcp_nodelay=True)

    def connections(self):
        return self._subscriber.get_num_connections()

    def _take(self, message):
        self.message = message
        if self._keep:
            self.all.append((time.monotonic(), message))


class Mocap:
    """Publishes poses of a craft in OptiTrack's frame (y up) at 100 Hz."""

    def __init__(self, topic="vrpn_client_node/hovercraft/pose"):
        self.x = self.y = self.psi = 0.0  # world_ned
        self._publisher = rospy.Publisher(topic, PoseStamped, queue_size=1, tcp_nodelay=True)
        self.repeater = Repeater(100, self.publish)

    def publish(self, stamp=None):
        self._publisher.publish(optitrack_pose(self.x, self.y, self.psi, stamp))

    def stop(self):
        self.repeater.stop()


def optitrack_pose(x, y, psi, stamp=None):
    """x = x_ot, y = z_ot, z = -y_ot; psi is minus the rotation about OptiTrack's y."""
    pose = PoseStamped()
    pose.header.stamp = stamp or rospy.Time.now()
    pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = x, 0.04, y
    pose.pose.orientation.y = math.sin(-psi / 2)
    pose.pose.orientation.w = math.cos(-psi / 2)
    return pose


def sender_status():
    return Latest("sender/status", SenderStatus)
