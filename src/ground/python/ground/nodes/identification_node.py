"""The identification tool as a ROS node: fit, diagnose and add as services, results on latched topics.

A task runs the command line in a separate process. A task that fails or is cancelled therefore leaves
the node as it was, and the node can do the same as the terminal.
"""

import collections
import contextlib
import itertools
import json
import math
import os
import signal
import subprocess
import tempfile
import threading
import time
import traceback
from typing import Callable, Deque, List, Optional, Tuple

import rosbag
import rospy
from geometry_msgs.msg import PoseStamped
from ground_msgs.msg import Controls, Drive, IdentificationStatus, MocapSettings
from ground_msgs.srv import Identify, IdentifyRequest, IdentifyResponse
from std_msgs.msg import String
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse

from ground.analysis.horizon import PredictionError
from ground.diagnosing import answer
from ground.diagnosing.report import DiagnosisReport
from ground.reading import messages, recorded_files
from ground.reports.words import prediction
from ground.support import files, records
from ground.support.annotations import Document, Message
from ground.support.errors import GroundError, sentence
from ground.support.progress import Report

Status = IdentificationStatus
PATIENCE = 5.0  # timeout of a process that was asked to end [s]
MADE = {"fit": "fitted.yaml", "diagnose": "improved.yaml", "add": "extended.yaml"}
MAX_SETTINGS = 1000  # changes of the mocap's settings that are kept


class LiveBuffer:
    """The messages of the last seconds: poses, commands and starts of the drive, with the settings of
    the mocap."""

    TOPICS = {messages.POSE.lstrip("/"): PoseStamped, "controls": Controls, "sent": Controls, "drive": Drive}
    REQUIRED = [messages.POSE.lstrip("/"), "controls"]

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self._lock = threading.Lock()
        # receipt, topic, message
        self._messages: Deque[Tuple[rospy.Time, str, Message]] = collections.deque()
        self._settings: Deque[MocapSettings] = collections.deque(maxlen=MAX_SETTINGS)
        for topic, kind in self.TOPICS.items():
            rospy.Subscriber(topic, kind, self._take, topic, queue_size=1000, tcp_nodelay=True)
        settings = messages.SETTINGS.lstrip("/")
        rospy.Subscriber(settings, MocapSettings, self._take_settings, queue_size=100)

    def _take_settings(self, message: MocapSettings) -> None:
        with self._lock:
            if self._settings and message.header.stamp < self._settings[-1].header.stamp:
                self._settings.clear()  # a bag that begins again
            self._settings.append(message)

    def _take(self, message: Message, topic: str) -> None:
        with self._lock:
            now = rospy.Time.now()  # inside, so that it ascends from message to message
            if self._messages and now < self._messages[-1][0]:
                self._messages.clear()  # a bag that begins again
            self._messages.append((now, topic, message))
            while (now - self._messages[0][0]).to_sec() > self.seconds:
                self._messages.popleft()

    def silent(self) -> str:
        """Required topics from which nothing has come, with their types; empty when all are heard."""
        with self._lock:
            heard = {topic for _, topic, _ in self._messages}
        silent = [topic for topic in self.REQUIRED if topic not in heard]
        return " and ".join("%s (%s)" % (rospy.resolve_name(t), self.TOPICS[t]._type) for t in silent)

    def covered(self) -> float:
        """Time for which there are both poses and commands [s]."""
        with self._lock:
            times = [[at for at, topic, _ in self._messages if topic == t] for t in self.REQUIRED]
        if not all(times):
            return 0.0
        return float((min(t[-1] for t in times) - max(t[0] for t in times)).to_sec())

    def write(self, path: str, last: float) -> None:
        """Writes the last seconds to a bag; GroundError when there are fewer."""
        if last > self.seconds:
            raise GroundError("only the last %g s are kept, not %g (parameter keep)" % (self.seconds, last))
        if self.silent():
            raise GroundError("nothing arrives on %s" % self.silent())
        covered = self.covered()
        if covered < 0.95 * last:
            raise GroundError("poses and commands of %.1f s have come so far, not of %g s" % (covered, last))
        with self._lock:
            chosen, settings = list(self._messages), list(self._settings)
        newest = chosen[-1][0]
        chosen = [row for row in chosen if (newest - row[0]).to_sec() <= last]
        with files.new_file(path) as temporary:
            with rosbag.Bag(temporary, "w", compression="lz4", chunk_threshold=messages.CHUNK) as bag:
                for message in settings:
                    bag.write(messages.SETTINGS, message, chosen[0][0])
                for at, topic, message in chosen:
                    bag.write("/" + topic, message, at)


class IdentificationNode:
    """Parameters: model (model file, required), bag_dir and output (folders), axes and heading_offset
    (instead of the recorded ones, or of mocap_state's), keep (seconds of live topics that are kept,
    120). Subscribes: pose, controls, drive, mocap_state/settings. Services: ~fit,
    ~diagnose, ~add (ground_msgs/Identify), ~cancel (std_srvs/Trigger).
    Publishes, latched: ~status, ~result (JSON, as the command line prints it) and ~model (the path of
    the newest model).
    """

    def __init__(self, program: str) -> None:
        """program: the command line tool."""
        self._program = program
        self.model = _existing(rospy.get_param("~model", ""), "model")
        self._bag_dir = _folder(rospy.get_param("~bag_dir", "~/ground_bags"))
        self._output = _folder(rospy.get_param("~output", "~/ground_models"))
        given = {n: str(rospy.get_param("~" + n, "recorded")) for n in ("axes", "heading_offset")}
        options = ["--%s=%s" % (n.replace("_", "-"), v) for n, v in given.items() if v != "recorded"]
        self._settings = options
        keep = rospy.get_param("~keep", 120.0)
        if not isinstance(keep, (int, float)) or not 0 < keep < math.inf:
            raise GroundError("parameter keep is %s, not a number of seconds" % keep)
        self.live = LiveBuffer(keep)
        self._busy = threading.Lock()
        self._child: Optional["subprocess.Popen[str]"] = None
        self._cancelled = False
        self._began = 0.0  # when the running task began, time.monotonic() [s]
        self._stage = ""  # its last reported stage
        self._status = rospy.Publisher("~status", Status, queue_size=10, latch=True)
        self._result = rospy.Publisher("~result", String, queue_size=1, latch=True)
        self._newest = rospy.Publisher("~model", String, queue_size=1, latch=True)
        self._newest.publish(self.model)
        self._say(Status.IDLE, "", "ready")
        for task in MADE:
            rospy.Service("~" + task, Identify, lambda request, t=task: self.serve(t, request))
        rospy.Service("~cancel", Trigger, self._cancel)
        rospy.on_shutdown(self._end)

    def serve(self, task: str, request: IdentifyRequest) -> IdentifyResponse:
        """Runs a task to its end."""
        if not self._busy.acquire(blocking=False):
            message = "busy with another task; ~cancel ends it"
            return IdentifyResponse(success=False, message=message)
        self._began, self._cancelled = time.monotonic(), False
        with contextlib.ExitStack() as after:
            after.callback(self._busy.release)
            after.callback(self._end)  # a child whose output could not be read
            try:
                response = self._run(task, request)
            except Exception as error:
                rospy.logdebug("%s: %s", task, traceback.format_exc())
                response = IdentifyResponse(success=False, message=sentence(error))
            state = Status.DONE if response.success else Status.FAILED
            self._say(state, task, response.message)
        return response

    def _run(self, task: str, request: IdentifyRequest) -> IdentifyResponse:
        model = _existing(request.model or self.model, "model")
        if task == "add" and not request.effect:
            raise GroundError("effect is empty: name the effect to add")
        if request.last < 0:
            raise GroundError("last is %g s, but must be positive: it counts back from now" % request.last)
        folder = self._new_folder(task)
        made = os.path.join(folder, MADE[task])
        try:
            recordings = self._recordings(request, folder)
            command = [self._program, task] + [request.effect] * (task == "add") + recordings
            command += ["--model", model, "--json", "--progress", "json"] + self._settings
            command += ["-o", folder if task == "diagnose" else made]
            result = json.loads(self._execute(task, command))
        finally:
            with contextlib.suppress(OSError):
                os.rmdir(folder)  # if it is empty, because the task failed
        if task != "diagnose":
            files.write_json(os.path.join(folder, task + ".json"), result)
        self._result.publish(json.dumps(result))
        answer = IdentifyResponse(message=_found(task, result), folder=folder)
        if os.path.exists(made):  # misread recordings give no model
            self.model = answer.model = made
            self._newest.publish(made)
            answer.success = True
        return answer

    def _recordings(self, request: IdentifyRequest, folder: str) -> List[str]:
        if request.last > 0:
            if request.bags:
                raise GroundError("either bags or the last seconds, not both")
            path = os.path.join(folder, "live.bag")
            self.live.write(path, request.last)
            return [path]
        paths = [os.path.expanduser(path) for path in request.bags or [self._bag_dir]]
        return [_existing(path, "bag", os.path.exists) for path in recorded_files.listed(paths)]

    def _new_folder(self, task: str) -> str:
        stem = os.path.join(self._output, time.strftime("%Y-%m-%d-%H-%M-%S_") + task)
        names = itertools.chain([stem], ("%s-%d" % (stem, number) for number in itertools.count(1)))
        path = next(name for name in names if not os.path.exists(name))
        os.makedirs(path)
        return path

    def _execute(self, task: str, command: List[str]) -> str:
        """Returns what the command prints and publishes its progress as status. GroundError when it
        fails."""
        if self._cancelled:
            raise GroundError("cancelled")
        self._say(Status.RUNNING, task, "begins")
        last = ""  # line of its standard error
        with tempfile.TemporaryFile("w+") as printed:
            child = self._child = subprocess.Popen(
                command,
                stdout=printed,
                stderr=subprocess.PIPE,
                universal_newlines=True,
                start_new_session=True,
            )
            for line in map(str.strip, child.stderr or ()):
                report = _reported(line)
                if report:
                    self._report(task, report)
                elif line:
                    last = line
                    rospy.logwarn("%s", line)
            status = child.wait()
            self._child = None
            if self._cancelled:
                raise GroundError("cancelled")
            if status != 0:
                raise GroundError(last or "ended with status %d" % status)
            printed.seek(0)
            return printed.read()

    def _cancel(self, _: TriggerRequest) -> TriggerResponse:
        if not self._busy.locked():
            return TriggerResponse(success=False, message="nothing runs")
        self._end()
        return TriggerResponse(success=True, message="cancelled")

    def _end(self) -> None:
        child, self._child, self._cancelled = self._child, None, True
        if child is None:
            return
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child.pid, signal.SIGINT)
            try:
                child.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                os.killpg(child.pid, signal.SIGKILL)
                child.wait()

    def _report(self, task: str, report: Report) -> None:
        """Publishes the progress of a task; logs what is found and new stages."""
        progress = {"what": report.what, "done": report.done, "of": report.of}
        self._publish(Status.RUNNING, task, str(report), **progress)
        if report.note or report.what != self._stage:
            rospy.loginfo("%s: %s", task, report)
        self._stage = report.what

    def _say(self, state: int, task: str, message: str) -> None:
        self._publish(state, task, message)
        if task:
            rospy.loginfo("%s: %s", task, message)

    def _publish(self, state: int, task: str, message: str, **progress: object) -> None:
        status = Status(state=state, task=task, message=message, **progress)
        status.header.stamp = rospy.Time.now()
        status.elapsed = time.monotonic() - self._began if task else 0.0
        self._status.publish(status)


def _reported(line: str) -> Optional[Report]:
    """The Report in a line of a command's standard error; None for other lines."""
    return Report(**json.loads(line)["progress"]) if line.startswith('{"progress"') else None


def _existing(path: str, what: str, exists: Callable[[str], bool] = os.path.isfile) -> str:
    path = os.path.abspath(os.path.expanduser(path)) if path else ""
    if not exists(path):
        raise GroundError("%s: there is no %s of this name" % (path or "(empty)", what))
    return path


def _folder(path: str) -> str:
    return os.path.abspath(os.path.expanduser(path))


def _found(task: str, result: Document) -> str:
    """The result of a task, in a sentence."""
    if task == "diagnose":
        return answer.title(records.read(DiagnosisReport, result, task))
    names = ("given", "fitted") if task == "fit" else ("without", "with")
    found = result["prediction"] and records.read(PredictionError, result["prediction"], task)
    lines = prediction(found, *names)
    measured = "; ".join("%s: %s" % line for line in lines) or "too short to predict poses"
    return "fitted. " + measured if task == "fit" else "%s added. %s" % (result["effect"], measured)
