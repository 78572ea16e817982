"""Publishes what a mocap sees of one body."""

import ctypes
import gc
import math
import os
import sys
import time
from contextlib import ExitStack
from typing import Callable, ContextManager, Dict, Optional

import rospy
from geometry_msgs.msg import Point, PoseStamped, Quaternion
from ground_msgs.msg import MocapFrame

from ground.mocap import library, motive
from ground.mocap.clock import Follower, Sighting
from ground.mocap.frames import FrameSource
from ground.support.annotations import Message
from ground.support.errors import GroundError

SYSTEMS = ("optitrack", *library.SYSTEMS)
PRIORITY = 31  # under SCHED_FIFO: as of what receives poses (link/real_time.h)
LOCK_ALL = 7  # MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT of mlockall(2)
REPEAT = 5.0  # time after which a problem that lasts is reported again [s]
SETTLED = 2.0  # time after which the offset of the clocks is reported [s]
SWITCH = 1e-4  # longest time for which the thread that sends a pose waits for the one that made it [s]
QUEUE = 10  # messages that wait for a slow subscriber


def opened(system: str, host: str) -> ContextManager[FrameSource]:
    """A source of a system at a host. GroundError if it is unknown, or cannot be opened."""
    if system not in SYSTEMS:
        raise GroundError("there is no mocap %s: it must be one of %s" % (system, ", ".join(SYSTEMS)))
    return motive.opened(host) if system == "optitrack" else library.opened(system, host)


def ask_for_real_time() -> str:
    """Gives this process real-time priority and keeps its memory from being swapped out, where the system
    grants it; returns what it grants. Threads that begin later have the priority, too."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        priority = "priority granted"
    except OSError as error:
        priority = "no priority (%s)" % error.strerror
    libc = ctypes.CDLL(None, use_errno=True)
    locked = libc.mlockall(LOCK_ALL) == 0
    why = "" if locked else " (%s)" % os.strerror(ctypes.get_errno())
    return "real time: %s, memory %slocked%s" % (priority, "" if locked else "not ", why)


class MocapClient:
    """Parameters: mocap (the system), server (its host), body (name of the rigid body), frame_id. Publishes:
    ~hovercraft/pose (when the body is seen), ~hovercraft/frame (of every frame that comes in order).

    A body that the mocap has lost has no pose.
    """

    def __init__(self) -> None:
        """Raises GroundError when the mocap cannot be opened."""
        host = str(rospy.get_param("~server", ""))
        if not host:
            raise GroundError(
                "mocap_host must be given: the address of the computer that streams the mocap's data"
            )
        self._body = str(rospy.get_param("~body", "hovercraft"))
        self._axes = str(rospy.get_param("~frame_id", "mocap"))
        self._closing = ExitStack()
        self._source = self._closing.enter_context(opened(str(rospy.get_param("~mocap", "vrpn")), host))
        self._follower = Follower(self._body)
        self._poses = rospy.Publisher("~hovercraft/pose", PoseStamped, queue_size=QUEUE)
        self._frames = rospy.Publisher("~hovercraft/frame", MocapFrame, queue_size=QUEUE)
        self._said: Dict[str, float] = {}  # when something was said, by what it is about
        self._begun: Optional[float] = None  # when the first frame came
        self._seen: Optional[bool] = None

    def run(self) -> int:
        """Publishes until the node is shut down; returns the exit status."""
        gc.collect()
        gc.freeze()  # what exists by now stays: it need not be searched for garbage
        sys.setswitchinterval(SWITCH)
        with self._closing:
            for frame in self._source.frames:
                if rospy.is_shutdown():
                    break
                if frame is None:
                    self._say("silence", rospy.logwarn, self._source.told())
                    continue
                sighting = self._follower.take(frame)
                if sighting:
                    self._report(sighting, self._publish(sighting))
        return 0

    def _publish(self, sighting: Sighting) -> Message:
        """Publishes pose and frame; returns the latter."""
        frame, pose = sighting.frame, sighting.pose
        stamp = rospy.Time.now() - rospy.Duration.from_sec(time.monotonic() - sighting.captured)
        if pose:
            message = PoseStamped()
            message.header.stamp, message.header.frame_id = stamp, self._axes
            message.pose.position = Point(*pose.position)
            message.pose.orientation = Quaternion(*pose.rotation)
            self._poses.publish(message)
        message = MocapFrame(body=self._body, tracked=pose is not None)
        message.missed, message.late = sighting.missed, sighting.late
        message.header.stamp, message.header.frame_id = stamp, self._axes
        message.number = -1 if frame.number is None else frame.number
        message.time = math.nan if frame.time is None else frame.time
        message.offset = stamp.to_sec() - message.time
        message.age = frame.received - sighting.captured
        self._frames.publish(message)
        return message

    def _report(self, sighting: Sighting, frame: Message) -> None:
        """Says what changed, and what is wrong."""
        now = sighting.frame.received
        if self._begun is None:
            self._begun = now
            rospy.loginfo("mocap: %s", self._source.told())
        if not math.isnan(frame.offset) and now - self._begun > SETTLED and "offset" not in self._said:
            self._say("offset", rospy.loginfo, "its clock + %.3f s is this computer's" % frame.offset)
        if self._follower.offset.jump:
            jump = -self._follower.offset.jump
            self._say(
                "jump", rospy.logwarn, "its clock stepped by %+.3f s relative to this computer's" % jump, 1.0
            )
        names = self._source.names()
        if not frame.tracked and self._body not in names:
            listed = ", ".join(names) or "none"
            self._say("names", rospy.logwarn, "the mocap has no body %s; it has %s" % (self._body, listed))
        elif frame.tracked != self._seen:
            what = "is seen" if frame.tracked else "is lost"
            self._say(what, rospy.loginfo, "%s %s" % (self._body, what))
            self._seen = frame.tracked

    def _say(self, topic: str, log: Callable[[str], None], text: str, interval: float = REPEAT) -> None:
        """Logs a text, but about a topic not more often than once an interval [s]."""
        now = time.monotonic()
        if now - self._said.get(topic, -math.inf) > interval:
            self._said[topic] = now
            log("mocap: " + text)
