#!/usr/bin/python3
"""Watches a long experiment: memory stays constant, commands keep their rate, and there are no warnings."""

import argparse
import math
import sys
import time
import xmlrpc.client

import numpy as np
import rosgraph
import rosnode
import rospy
from ground_msgs.msg import ControllerStatus, Controls, Reference, SenderStatus, State
from rosgraph_msgs.msg import Log

SAMPLES = 60  # number of measurements of the memory
SETTLING = 0.1  # share of the time before the checks of memory and tracking error begin
MAX_GROWTH = 0.02  # relative growth of memory after settling
MAX_DRIFT = 0.01  # relative change of the commands' rate


def memory(pid):
    """Resident memory of a process [MB]."""
    with open("/proc/%d/statm" % pid) as file:
        return int(file.read().split()[1]) * 4096 / 1e6


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, required=True)
    arguments = parser.parse_args(rospy.myargv()[1:])
    rospy.init_node("soak_probe")
    stamps, warnings, errors, newest = [], [], [], {}
    rospy.Subscriber("controls", Controls, lambda m: stamps.append(m.header.stamp.to_sec()))
    rospy.Subscriber("/rosout", Log, lambda m: warnings.append(m.msg) if m.level >= Log.WARN else None)
    for topic, kind in (
        ("controller/status", ControllerStatus),
        ("sender/status", SenderStatus),
        ("reference", Reference),
        ("simulator/truth", State),
    ):
        rospy.Subscriber(topic, kind, lambda m, t=topic: newest.__setitem__(t, m))
    while "controller/status" not in newest or newest["controller/status"].state != 3:
        time.sleep(0.1)
    uri = rosnode.get_api_uri(rosgraph.Master("/soak_probe"), "/ground_manager")
    pid = xmlrpc.client.ServerProxy(uri).getPid("/soak_probe")[2]
    begin, wall = rospy.Time.now().to_sec(), time.monotonic()
    sizes = []
    while len(sizes) < SAMPLES:
        due = begin + (len(sizes) + 1) * arguments.seconds / SAMPLES
        while rospy.Time.now().to_sec() < due and not rospy.is_shutdown():
            time.sleep(0.02)
        sizes.append(memory(pid))
        if len(sizes) > SETTLING * SAMPLES:
            t, r = newest["simulator/truth"].eta, newest["reference"].p
            errors.append(math.hypot(t[0] - r[0], t[1] - r[1]))
    seconds = rospy.Time.now().to_sec() - begin
    first = sizes[int(SETTLING * SAMPLES)]
    thirds = np.array_split([s for s in stamps if s > begin], 3)
    rates = [(len(part) - 1) / (part[-1] - part[0]) for part in thirds]
    print(
        "%.0f s of experiment in %.0f s; memory %.1f MB, %.1f MB at the end; commands at %.2f, %.2f, "
        "%.2f Hz; error at most %.0f mm"
        % (seconds, time.monotonic() - wall, first, sizes[-1], *rates, 1e3 * max(errors))
    )
    for warning in sorted(set(warnings)):
        print("  %d times: %s" % (warnings.count(warning), warning))
    sound = (
        sizes[-1] < (1 + MAX_GROWTH) * first
        and max(rates) / min(rates) < 1 + MAX_DRIFT
        and newest["controller/status"].state == 3
        and newest["sender/status"].state == SenderStatus.ARMED
        and not warnings
    )
    print("soak: %s" % ("sound" if sound else "NOT SOUND"))
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main())
