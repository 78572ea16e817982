"""A discovery as a ROS node: it flies through the nodelets of its launch file, and can be watched."""

import contextlib
import math
import os
import pathlib
import threading
import time
from typing import Optional

import rospy
from ground_msgs.msg import DiscoveryStatus
from nav_msgs.msg import Path
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse
from visualization_msgs.msg import MarkerArray

from ground import _core
from ground.discovery import page, words
from ground.discovery.campaign import FlightCampaign
from ground.discovery.flights import CampaignSettings
from ground.discovery.story import Story
from ground.nodes import discovery_markers, discovery_messages
from ground.nodes.flying_laboratory import Ended, FlyingLaboratory
from ground.support.errors import GroundError, sentence
from ground.support.progress import Report, Work

STOPPED = "stopped by hand"
PREPARES = "prepares: simulates what flights could show"
QUIET = 5.0  # longest time without a report on a diagnosis that goes on [s]
NICE = 5  # niceness: other busy nodes get three times the time of the diagnosis


class DiscoveryNode:
    """Parameters: model (file of the given model, required), room (file, required), folder (keeps all,
    and is gone on from; empty: a new one in ~/ground_discoveries), budget (longest time of flight
    [s]), track (whether a reference is tracked before and after), seed (of random inputs), patience
    (longest wait before a flight [s]), simulated (whether a sender in FAULT is armed again).
    Publishes, latched: ~status, ~planned (path of the next flight), ~markers. Service: ~stop.

    It never arms the sender of a real craft.
    """

    def __init__(self, recorder: str) -> None:
        """recorder: path of scripts/record. Raises GroundError."""
        self.broken = ""  # why the discovery cannot begin; empty if it can
        self._status = rospy.Publisher("~status", DiscoveryStatus, queue_size=10, latch=True)
        self._planned = rospy.Publisher("~planned", Path, queue_size=1, latch=True)
        self._markers = rospy.Publisher("~markers", MarkerArray, queue_size=1, latch=True)
        self._publishing = threading.Lock()
        self._model = _core.load_model(_required("model"))
        self._settings = CampaignSettings(
            budget=_number("budget", CampaignSettings.budget),
            track=bool(rospy.get_param("~track", CampaignSettings.track)),
            seed=int(_number("seed", CampaignSettings.seed)),
        )
        self._folder = _folder(str(rospy.get_param("~folder", "")))
        room = _core.load_room(_required("room"))
        track = self._settings.track
        patience = _number("patience", math.inf)
        simulated = bool(rospy.get_param("~simulated", False))
        self._laboratory = FlyingLaboratory(
            room, self._folder, recorder, track, patience, self._wait_for, self._stopped, simulated
        )
        self._discovery: Optional[FlightCampaign] = None
        self._teller = words.Teller(_log, self._model)
        self._story = Story(self._model.name, room.name, self._settings.budget, activity=PREPARES)
        self._waits = ""  # what the laboratory waits for
        self._does, self._since = "", time.monotonic()  # what a diagnosis does now, and since when [s]
        self._said = time.monotonic()  # when the last word was said [s]
        self._failure = ""
        self._keeps = False  # whether a flight is not in the journal yet
        self._closed = False  # nothing is published any more
        self._publish()
        rospy.Service("~stop", Trigger, self._stop)
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        """Begins, or goes on with the story of the folder."""
        rospy.loginfo("discovery: everything is kept in %s", self._folder)
        self._thread.start()
        threading.Thread(target=self._break_silence, daemon=True).start()

    def end(self, patience: float) -> None:
        """Interrupts the discovery, which its folder can go on with: ends a flight at once, and waits
        at most `patience` [s] until what was flown is in the journal."""
        self._laboratory.end("interrupted")
        deadline = time.monotonic() + patience
        while self._thread.is_alive() and self._keeps and time.monotonic() < deadline:
            time.sleep(0.05)
        with self._publishing:
            self._closed = True

    def _run(self) -> None:
        _yield_to_other_nodes()
        try:
            self._discovery = FlightCampaign(
                self._model,
                self._laboratory,
                self._settings,
                self._folder,
                self._tell,
                work=Work(self._report),
            )
            self._tell(self._discovery.story)
            self._discovery.run()
        except Ended:
            pass
        except Exception as error:
            if self._discovery is None:
                self.broken = sentence(error)
                return
            self._failure = sentence(error)
            rospy.logerr("discovery: %s", self._failure)
            self._publish()

    def _stop(self, _: TriggerRequest) -> TriggerResponse:
        if self._story.ended or self._failure:
            return TriggerResponse(success=False, message="the discovery has ended already")
        self._stopped(STOPPED)
        self._laboratory.end(STOPPED)
        return TriggerResponse(success=True, message="the discovery ends, and the craft is stopped")

    def _stopped(self, reason: str) -> None:
        """Ends the discovery because a person has stopped it."""
        if self._discovery is not None:
            self._discovery.stop(reason)

    def _wait_for(self, what: str) -> None:
        """Says what the laboratory waits for; empty when it no longer does."""
        if what:
            rospy.logwarn("discovery: %s", what)
        self._waits = what
        self._publish()

    def _tell(self, story: Story) -> None:
        """Shows a change of the story, which is in the journal."""
        self._story, self._keeps = story, story.planned is not None
        self._does, self._since, self._said = "", time.monotonic(), time.monotonic()
        try:
            page.write(story, self._folder, self._laboratory.room)
        except (GroundError, OSError) as error:
            rospy.logwarn("discovery: the page is not up to date: %s", sentence(error))
        self._teller(story)
        if story.ended:
            _log(story.reason)
        self._publish()

    def _report(self, report: Report) -> None:
        """Hears what a diagnosis does, and how much of it is done."""
        if not report.note and str(report) != self._does:
            self._does, self._since = str(report), time.monotonic()

    def _break_silence(self) -> None:
        """Says from time to time what is done on the ground, and for how long."""
        while self._thread.is_alive():
            time.sleep(1.0)
            now, does = time.monotonic(), "" if self._keeps or self._waits else self._doing()
            if does and now - self._said > QUIET:
                self._said = now
                _log("%s, for %.0f s" % (does, now - self._since) if now - self._since > 1 else does)
                self._publish()

    def _doing(self) -> str:
        """What is done now, empty after the end."""
        return "%s: %s" % (self._story.activity, self._does) if self._does else self._story.activity

    def _publish(self) -> None:
        with self._publishing:
            if self._closed:
                return
            message = discovery_messages.status(self._story, self._folder, self._waits or self._doing())
            message.header.stamp = self._laboratory.now()
            if self._failure:
                message.ended, message.reason = True, self._failure
            path = discovery_messages.planned(self._story.planned, message.header.stamp)
            self._status.publish(message)
            self._planned.publish(path)
            follows = bool(rospy.get_param("visualizer/follow", True))
            self._markers.publish(discovery_markers.markers(message, self._laboratory.room, follows))


def _yield_to_other_nodes() -> None:
    """Gives this thread, and the threads and processes that it starts, a low priority, and this node's
    session, too: Linux divides the processors between sessions first (autogroup in sched(7)), and
    roslaunch makes each node a session. The session of a terminal keeps its priority."""
    os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICE)
    if os.getsid(0) == os.getpid():
        with contextlib.suppress(OSError):  # a kernel that does not divide between sessions
            pathlib.Path("/proc/self/autogroup").write_text(str(NICE))


def _log(text: str) -> None:
    rospy.loginfo("discovery: %s", text)


def _required(name: str) -> str:
    value = str(rospy.get_param("~" + name, ""))
    if not value:
        raise GroundError("parameter %s is missing" % rospy.resolve_name("~" + name))
    return value


def _number(name: str, default: float) -> float:
    value = rospy.get_param("~" + name, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not value > 0:
        raise GroundError("parameter %s is %s, not a positive number" % (name, value))
    return value


def _folder(path: str) -> str:
    """The folder of a discovery; a new one, named by the time, if none is given."""
    if not path:
        path = os.path.join("~/ground_discoveries", time.strftime("%Y-%m-%d-%H-%M-%S"))
    return os.path.abspath(os.path.expanduser(path))
