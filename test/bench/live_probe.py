#!/usr/bin/python3
"""Poses and commands of a craft that flies a PRBS; how late the errors of two models come, and what
processor time the manager takes meanwhile."""

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


def processor_time(pid):
    """Of a process, user and system [s]."""
    with open("/proc/%d/stat" % pid) as file:
        fields = file.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / 100.0


def flight(model, seconds, rate):
    """Times [s] and poses of a PRBS flight, and its inputs: a row for each of CLOCK bits a second."""
    count = int(seconds * rate)
    bits = np.array(_core.make_prbs(9, 1), float)
    edges = np.arange(int(count / rate * CLOCK) + 1) / CLOCK
    inputs = np.column_stack([edges, bits[np.arange(len(edges)) % len(bits)], np.ones(len(edges))])
    times = np.arange(count) / rate
    return times, _core.simulate(model, inputs, times, np.zeros(3), np.zeros(3))["eta"], inputs


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--rate", type=float, required=True)
    parser.add_argument("--seconds", type=float, required=True)
    parser.add_argument("--model", required=True, help="moves the craft")
    parser.add_argument("--without", action="store_true")
    arguments = parser.parse_args(rospy.myargv()[1:])
    rospy.init_node("live_probe")
    model = _core.load_model(arguments.model)
    settle = 5.0  # until the models predict and the load is steady [s]
    times, eta, inputs = flight(model, arguments.seconds + settle, arguments.rate)
    mapping = _core.AxisMapping("x, z, -y")

    sent, late, lock = {}, {"model_error": [], "model_error2": [], "state": []}, threading.Lock()

    def listen(message, topic):
        now = time.monotonic()
        with lock:
            begun = sent.get(message.header.stamp)
        if begun is not None:
            late[topic].append(now - begun)

    kinds = {"model_error": ModelError, "model_error2": ModelError, "state": State}
    for topic, kind in kinds.items():
        rospy.Subscriber(topic, kind, listen, topic, tcp_nodelay=True)
    poses = rospy.Publisher(
        "vrpn_client_node/hovercraft/pose", PoseStamped, queue_size=1, tcp_nodelay=True
    )
    controls = rospy.Publisher("controls", Controls, queue_size=1, tcp_nodelay=True)
    time.sleep(2)
    pid = xmlrpc.client.ServerProxy(
        rosnode.get_api_uri(rosgraph.Master("/live_probe"), "/bench_manager")
    ).getPid("/live_probe")[2]

    start, held = time.monotonic(), -1
    began = used = None
    for at, place in zip(times, eta):
        time.sleep(max(0.0, start + at - time.monotonic()))
        if began is None and at >= settle:
            began, used = time.monotonic(), processor_time(pid)
            for values in late.values():
                values.clear()
        message = PoseStamped()
        message.header.stamp = rospy.Time.now()
        p, q = mapping.to_mocap(place, 0.04)
        message.pose.position.x, message.pose.position.y, message.pose.position.z = p
        o = message.pose.orientation
        o.x, o.y, o.z, o.w = q
        with lock:
            sent[message.header.stamp] = time.monotonic()
        poses.publish(message)
        bit = int(at * CLOCK)
        if bit != held:
            held = bit
            command = Controls(left=inputs[bit, 1], right=inputs[bit, 2], lift=1)
            command.header.stamp = message.header.stamp
            controls.publish(command)
    share = (processor_time(pid) - used) / (time.monotonic() - began)
    tell(arguments, share, late)
    return 0


def tell(arguments, share, late):
    """Prints the manager's share of a core and how late each topic's messages were [s]."""
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
