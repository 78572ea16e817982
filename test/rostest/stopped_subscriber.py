#!/usr/bin/python3
"""Subscribes to what the ground station publishes, and stops reading as soon as it is connected."""

import os
import signal

import rospy
from harness import wait_for

TOPICS = ("state", "odometry", "controls", "controls/wanted", "decision", "reference", "tf",
          "controller/status", "sender/status", "sender/telemetry")  # fmt: skip


def main():
    rospy.init_node("stopped_subscriber", disable_signals=True)
    subscribers = [rospy.Subscriber(topic, rospy.AnyMsg, lambda _: None) for topic in TOPICS]
    wait_for(lambda: all(s.get_num_connections() for s in subscribers), 60, "connections to all topics")
    os.kill(os.getpid(), signal.SIGSTOP)


if __name__ == "__main__":
    main()
