#!/usr/bin/python3
"""Time from a packet of Motive to its pose on the topic, through loopback: needs a ROS master (roscore).

Sends frames of three bodies at a rate, runs `rosrun ground mocap_client`, and receives its poses as a
subscriber in this process, whose own delay counts, too. Run it on an idle computer; it says the load.
"""

import argparse
import os
import pathlib
import socket
import subprocess
import sys
import threading
import time

import numpy as np
import rospy
from geometry_msgs.msg import PoseStamped

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "rostest"))
from fake_motive import FakeMotive

BOUND = 1e-3  # of which 99.9% are to be below [s]
HOST = "127.0.0.5"
PRIORITY = 40  # of this process, above the client's


def there_and_back(seconds, rate):
    """Times that a byte takes to another process and back [s]: what this computer does without a client."""
    ours, theirs = socket.socketpair()
    echo = os.fork()
    if echo == 0:
        while theirs.recv(1) != b"\0":
            theirs.send(b"1")
        os._exit(0)
    found = []
    for _ in range(int(seconds * rate)):
        time.sleep(1 / rate)
        begun = time.monotonic()
        ours.send(b"1")
        ours.recv(1)
        found.append(time.monotonic() - begun)
    ours.send(b"\0")
    os.waitpid(echo, 0)
    return np.array(found)


def say(what, delays):
    numbers = [1e3 * np.quantile(delays, q) for q in (0.5, 0.99, 0.999, 1)]
    within = 100 * np.mean(delays < BOUND)
    print(
        "%-22s median %.3f, 99%% %.3f, 99.9%% %.3f, most %.3f ms; within 1 ms: %.3f%%"
        % (what, *numbers, within)
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="duration [s] (%(default)g)")
    parser.add_argument("--rate", type=float, default=240.0, help="frames per second [Hz] (%(default)g)")
    parser.add_argument("--ordinary", action="store_true", help="without real-time priority")
    arguments = parser.parse_args()
    if not arguments.ordinary:  # before there are threads, which inherit it
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    rospy.init_node("mocap_latency", disable_signals=True)
    name = "/vrpn_client_node/"
    for key, value in (("mocap", "optitrack"), ("server", HOST), ("real_time", not arguments.ordinary)):
        rospy.set_param(name + key, value)
    sys.setswitchinterval(1e-4)  # threads of this process do not wait for each other
    sent, arrived, ready = [], {}, threading.Event()

    def take(pose):
        arrived[round(pose.pose.position.x)] = time.monotonic()
        ready.set()

    listener = rospy.Subscriber(name + "hovercraft/pose", PoseStamped, take, tcp_nodelay=True, queue_size=10)
    motive = FakeMotive(host=HOST)

    def stamp(packet):
        sent.append(time.monotonic())
        return [packet]

    motive.spoil = stamp
    client = subprocess.Popen(["rosrun", "ground", "mocap_client", "__name:=vrpn_client_node"])
    begun = None
    due = time.monotonic()
    while begun is None or due < begun + arguments.seconds:
        due += 1 / arguments.rate
        time.sleep(max(0.0, due - time.monotonic()))
        if begun is None and ready.is_set():
            begun = due + 1
        number = len(sent)
        others = [(body, (1, 2, 3), (0, 0, 0, 1), True) for body in (2, 3)]
        motive.send([(1, (number, 0.5, 0.5), (0, 0, 0, 1), True), *others], age=0.004)
    time.sleep(0.5)
    client.terminate()
    listener.unregister()
    motive.close()
    counted = [i for i, at in enumerate(sent) if at > begun]
    delays = np.array([arrived[i] - sent[i] for i in counted if i in arrived])
    lost = len(counted) - len(delays)
    priority = "ordinary" if arguments.ordinary else "real-time"
    print(
        "%d frames at %g Hz, %d lost; load %.1f, %s priority"
        % (len(counted), arguments.rate, lost, os.getloadavg()[0], priority)
    )
    say("packet to topic:", delays)
    say("a byte there and back:", there_and_back(arguments.seconds / 2, arguments.rate))
    return 0 if np.mean(delays < BOUND) >= 0.999 and lost == 0 else 1


if __name__ == "__main__":
    sys.exit(main())
