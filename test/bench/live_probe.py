#!/usr/bin/python3
"""Publishes poses and commands of a PRBS experiment, and measures the delay of the models' errors and the
processor time of the manager."""

import argparse
import sys
import threading
import time
import xmlrpc.client

import numpy as np
import rosgraph
import rosnode
import rospy
from geometry_msgs.msg import PoseStamped
from ground import _core
from ground_msgs.msg import Controls, ModelError, State

CLOCK = 15.0  # bits of the PRBS [1/s]
SETTLE = 5.0  # time until the models predict and the load is steady [s]


def processor_time(pid):
    """Processor time of a process, user and system [s]."""
    with open("/proc/%d/stat" % pid) as file:
        fields = file.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / 100.0


def flight(model, seconds, rate):
    """Times [s], poses and inputs (a row per bit) of a simulated PRBS experiment."""
    count = int(seconds * rate)
    bits = np.array(_core.make_prbs(9, 1), float)
    edges = np.arange(int(count / rate * CLOCK) + 1) / CLOCK
    inputs = np.column_stack([edges, bits[np.arange(len(edges)) % len(bits)], np.ones(len(edges))])
    times = np.arange(count) / rate
    return times, _core.simulate(model, inputs, times, np.zeros(3), np.zeros(3))["eta"], inputs


def parse_arguments():
    parser = argparse.ArgumentParser()
    parser.add_argument("--rate", type=float, required=True)
    parser.add_argument("--seconds", type=float, required=True)
    parser.add_argument("--model", required=True, help="model by which the craft moves")
    parser.add_argument("--without", action="store_true")
    return parser.parse_args(rospy.myargv()[1:])


class Latencies:
    """Times from the publication of a pose to the messages with its stamp [s], by topic."""

    KINDS = {"model_error": ModelError, "model_error2": ModelError, "state": State}

    def __init__(self):
        self.of_topic = {topic: [] for topic in self.KINDS}
        self._sent, self._lock = {}, threading.Lock()
        for topic, kind in self.KINDS.items():
            rospy.Subscriber(topic, kind, self._listen, topic, tcp_nodelay=True)

    def expect(self, stamp):
        """Takes the time at which a pose with this stamp is published."""
        with self._lock:
            self._sent[stamp] = time.monotonic()

    def clear(self):
        for values in self.of_topic.values():
            values.clear()

    def _listen(self, message, topic):
        now = time.monotonic()
        with self._lock:
            begun = self._sent.get(message.header.stamp)
        if begun is not None:
            self.of_topic[topic].append(now - begun)


class Craft:
    """Publishes poses of a simulated PRBS experiment and its commands."""

    def __init__(self, inputs):
        self._inputs, self._held = inputs, -1
        self._mapping = _core.AxisMapping("x, z, -y")
        pose = "vrpn_client_node/hovercraft/pose"
        self._poses = rospy.Publisher(pose, PoseStamped, queue_size=1, tcp_nodelay=True)
        self._controls = rospy.Publisher("controls", Controls, queue_size=1, tcp_nodelay=True)

    def publish(self, at, eta, latencies):
        """Publishes the pose eta of time `at` [s], then the command if it has changed."""
        message = PoseStamped()
        message.header.stamp = rospy.Time.now()
        p, q = self._mapping.to_mocap(eta, 0.04)
        message.pose.position.x, message.pose.position.y, message.pose.position.z = p
        o = message.pose.orientation
        o.x, o.y, o.z, o.w = q
        latencies.expect(message.header.stamp)
        self._poses.publish(message)
        bit = int(at * CLOCK)
        if bit != self._held:
            self._held = bit
            _, left, right, lift = self._inputs[bit]
            command = Controls(left=left, right=right, lift=lift)
            command.header.stamp = message.header.stamp
            self._controls.publish(command)


def manager_pid():
    """Process id of the nodelet manager."""
    uri = rosnode.get_api_uri(rosgraph.Master("/live_probe"), "/bench_manager")
    return xmlrpc.client.ServerProxy(uri).getPid("/live_probe")[2]


def main():
    arguments = parse_arguments()
    rospy.init_node("live_probe")
    model = _core.load_model(arguments.model)
    times, poses, inputs = flight(model, arguments.seconds + SETTLE, arguments.rate)
    latencies, craft = Latencies(), Craft(inputs)
    time.sleep(2)
    pid = manager_pid()
    start = time.monotonic()
    began = used = None
    for at, eta in zip(times, poses):
        time.sleep(max(0.0, start + at - time.monotonic()))
        if began is None and at >= SETTLE:
            began, used = time.monotonic(), processor_time(pid)
            latencies.clear()
        craft.publish(at, eta, latencies)
    share = (processor_time(pid) - used) / (time.monotonic() - began)
    report(arguments, share, latencies.of_topic)
    return 0


def report(arguments, share, late):
    """Prints the manager's share of a core and the delays of each topic's messages [s]."""
    print(
        "live comparison %s at %g Hz: manager takes %.1f%% of a core"
        % ("off" if arguments.without else "on, two models", arguments.rate, 100 * share)
    )
    for topic, values in late.items():
        if values:
            ms = 1e3 * np.array(values)
            print(
                "  pose to %-13s %5.2f ms median, %5.2f ms 99%%, %5.2f ms at most, of %d"
                % (topic, np.median(ms), np.quantile(ms, 0.99), ms.max(), len(ms))
            )


if __name__ == "__main__":
    sys.exit(main())
