"""What the ROS tests share: a craft made of a socket, publishers of what it needs, patience."""
import math
import socket
import threading
import time

import rospy
from geometry_msgs.msg import PoseStamped
from ground_msgs.msg import Controls, SenderStatus, State

ZERO = (1000, 1000, 1000, 1000)


def wait_for(condition, timeout, message):
    """The first true value of condition(); fails after `timeout` seconds of wall time."""
    deadline = time.monotonic() + timeout
    while time.monotonic() < deadline:
        value = condition()
        if value:
            return value
        time.sleep(0.002)
    raise AssertionError("waited %.1f s in vain: %s" % (timeout, message))


def decode_motors(data):
    """DL, DR, R, L of a Motors datagram. Read by hand, so that the wire format itself is checked."""
    values, i = {}, 0
    while i < len(data):
        field, wire = data[i] >> 3, data[i] & 7
        assert wire == 0, "all fields are varints"
        value, shift, i = 0, 0, i + 1
        while True:
            value |= (data[i] & 0x7F) << shift
            shift, i = shift + 7, i + 1
            if not data[i - 1] & 0x80:
                break
        values[field] = value
    assert sorted(values) == [1, 2, 3, 4], values
    return tuple(values[k] for k in (1, 2, 3, 4))


# DroneState with yaw = 0: field 3, 32 bit
TELEMETRY = bytes([3 << 3 | 5, 0, 0, 0, 0])


class Craft:
    """Speaks the craft's side of the UDP protocol and keeps every packet with its arrival time."""

    def __init__(self, port, talk=True):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.005)
        self.sender = ("127.0.0.1", port)
        self.packets = []  # (monotonic time, (DL, DR, R, L))
        self._talk, self._alive = talk, True
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def say(self, data):
        self.socket.sendto(data, self.sender)

    def _run(self):
        next_talk = 0
        while self._alive:
            now = time.monotonic()
            if self._talk and now >= next_talk:
                next_talk = now + 0.02
                self.say(TELEMETRY)
            try:
                data = self.socket.recv(2048)
                self.packets.append((time.monotonic(), decode_motors(data)))
            except (socket.timeout, ConnectionError):
                pass

    def last(self):
        return self.packets[-1][1] if self.packets else None

    def zero_since(self, moment):
        """When the packets after `moment` became zero for good, or None."""
        after = [(t, m) for t, m in self.packets if t >= moment]
        driven = [t for t, m in after if m != ZERO]
        zeros = [t for t, m in after if m == ZERO and (not driven or t > driven[-1])]
        return zeros[0] if zeros else None

    def close(self):
        self._alive = False
        self._thread.join()
        self.socket.close()


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


class Station:
    """Publishes states and commands as mocap_state and controller would; fields may be changed."""

    def __init__(self, states=True, controls=True):
        self.state, self.controls = State(), Controls()
        self.state.valid = True
        self._state_publisher = rospy.Publisher("state", State, queue_size=1, tcp_nodelay=True)
        self._controls_publisher = (
            rospy.Publisher("controls", Controls, queue_size=1, tcp_nodelay=True)
            if controls
            else None
        )
        self.repeaters = {}
        if states:
            self.repeaters["states"] = Repeater(100, self.publish_state)
        if controls:
            self.repeaters["controls"] = Repeater(50, self.publish_controls)

    def publish_state(self):
        self.state.header.stamp = rospy.Time.now()
        self._state_publisher.publish(self.state)

    def publish_controls(self):
        self.controls.header.stamp = rospy.Time.now()
        self._controls_publisher.publish(self.controls)

    def command(self, left, right, lift):
        self.controls.left, self.controls.right, self.controls.lift = left, right, lift

    def stop(self, *names):
        for name in names or list(self.repeaters):
            if name in self.repeaters:
                self.repeaters.pop(name).stop()


class Latest:
    """The last message of a topic, and all of them when asked."""

    def __init__(self, topic, kind, keep=False):
        self.message, self.all = None, []
        self._keep = keep
        self._subscriber = rospy.Subscriber(topic, kind, self._take, tcp_nodelay=True)

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
