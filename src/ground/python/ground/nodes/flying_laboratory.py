"""The laboratory of a discovery in ROS: the nodelets of a launch fly the craft, and each flight is
recorded into a bag of its own."""

import contextlib
import math
import os
import threading
import time
from typing import Dict, List, Sequence, Tuple

import numpy as np
import rospy
from ground_msgs.msg import ControllerStatus, SenderStatus, State
from ground_msgs.srv import LoadModel
from std_srvs.srv import SetBool, Trigger

from ground import _core
from ground.analysis import tracks
from ground.discovery import simulated, tracking
from ground.discovery.laboratory import Landed, lifted
from ground.discovery.story import GIVEN, Flight, Point
from ground.nodes import live_parameters
from ground.nodes.flight_recorder import FlightRecorder
from ground.nodes.stop_trial import ANSWER, AT_REST
from ground.reading import readers
from ground.support import files
from ground.support.annotations import Array, Message, Say
from ground.support.errors import GroundError

START = 60.0  # timeout of the start of nodes [s]
SILENCE = 10.0  # silence of a node after which the discovery ends [s]
LATE = 1.2  # age of the start of a controller beyond which all its statuses are of this flight [s]
LOOK = 0.02  # period at which statuses are looked at [s]
SPARE = 10.0  # time after its end at which a controller that goes on is stopped [s]
BY_HAND = "stopped by hand"  # reason of a controller that was stopped by its service
TAKEN_OVER = "has taken over"  # end of the reason of a controller that another one replaced
ARM = "rosservice call %s true"
ATTEMPTS = 3  # of a simulated flight
ENDED = (ControllerStatus.DONE, ControllerStatus.STOPPED)
IDLE = (ControllerStatus.IDLE, *ENDED)


class Ended(GroundError):
    """The discovery was asked to end while the laboratory waited."""


class FlyingLaboratory:
    """A Laboratory (ground/discovery/laboratory.py) of the nodes `excitation` (Excitation) and
    `tracker` (ModelPredictive, None if there is none), `sender`, `mocap_state` and `live_comparison`.

    It never arms the sender of a real craft: it waits until somebody does. The nodes set all limits.
    """

    def __init__(
        self,
        room: _core.RoomPlan,
        folder: str,
        recorder: str,
        tracker: bool = True,
        patience: float = math.inf,
        waits: Say = rospy.logwarn,
        stopped: Say = rospy.logwarn,
        simulated: bool = False,
    ) -> None:
        """folder: where bags and models are kept. recorder: path of scripts/record.
        tracker: whether there is one. patience: longest wait before a flight [s]. waits: called with
        a sentence when the laboratory waits for a person, and with an empty one when it no longer
        does. stopped: called with the reason when a person has stopped a flight: nothing may be flown
        after it. simulated: whether a sender in FAULT is armed again, and the flight repeated."""
        self.room = room
        self._stopped = stopped
        self._simulated, self._faulted = simulated, False
        self._folder = folder
        self._recorder = recorder
        self._waits = waits
        self._patience = patience
        self._asked = threading.Event()  # to end
        self._why = ""
        self._said = ""
        self._stamp = rospy.Time()  # of the newest status
        self._sender: Message = None  # its newest status
        names = ["controller"] + (["tracker"] if tracker else [])
        # by controller: its newest status (None before the first), and when it came, time.monotonic() [s]
        self._controllers: Dict[str, Tuple[Message, float]] = dict.fromkeys(names, (None, 0.0))
        for name in names:
            rospy.Subscriber(name + "/status", ControllerStatus, self._take, name, queue_size=100)
        rospy.Subscriber("sender/status", SenderStatus, self._take_sender)
        self._players = {name: _node(name) for name in names}
        for name in names:  # one that a killed discovery has left driving
            try:
                status = rospy.wait_for_message(name + "/status", ControllerStatus, START)
            except rospy.ROSException:
                raise GroundError("%s publishes no status" % rospy.resolve_name(name))
            if status.state not in IDLE:
                _call(name + "/stop", Trigger)

    def _take(self, status: Message, name: str) -> None:
        self._stamp = status.header.stamp
        self._controllers[name] = status, time.monotonic()

    def _take_sender(self, status: Message) -> None:
        self._stamp, self._sender = status.header.stamp, status

    def now(self) -> rospy.Time:
        """Time of the newest message: of a simulated clock, too, which this node does not follow."""
        return self._stamp

    def end(self, reason: str) -> None:
        """Ends a flight and all waiting, from any thread. Later flights are refused."""
        self._why = self._why or reason
        self._asked.set()

    def fly(self, flight: Flight, inputs: Array) -> Landed:
        """Waits until the craft may be flown, and flies. inputs: rows of time [s], inputs of the
        thrusters, lift; empty when flight.reference is tracked. Raises Ended or GroundError."""
        self._check()
        name = "tracker" if flight.reference else "controller"
        if name not in self._players:
            raise GroundError("no controller tracks references: restart with track:=true")
        longest = self._prepare(name, flight, inputs)
        for _ in range(ATTEMPTS):
            landed = self._fly(name, longest, flight)
            failed = landed.stopped and self._sender.state == SenderStatus.FAULT
            if not failed or not self._simulated:
                return landed
            reason = "the sender was in FAULT (%s)" % self._sender.reason
            reason = ("the computer was too busy: " if "stale" in reason else "") + reason
            rospy.logwarn("discovery: %s; the flight is repeated", reason)
        raise GroundError("%s on %d flights in a row" % (reason, ATTEMPTS))

    def _fly(self, name: str, longest: float, flight: Flight) -> Landed:
        self._wait_until_ready()
        recorder = FlightRecorder(self._recorder, self._folder, "flight-%02d" % flight.number)
        try:
            stopped = self._drive(name, longest, recorder)
        finally:
            bag = recorder.close()
        return _landed(bag, stopped, bool(flight.reference))

    def resume(self, rest: Sequence[float]) -> None:
        """See Laboratory: the mocap sees where the craft is."""

    def load(self, model: _core.Model, label: str) -> str:
        """Gives the model to the controllers, and to live_comparison beside the given one. Returns why
        a controller refused it; then all have the model that they had."""
        path = self._kept(model, label)
        loaded: List[str] = []
        for name in self._players:
            refusal = _offer(name + "/load_model", path)
            if refusal:
                for other in loaded:
                    _offer(other + "/load_model", rospy.get_param(other + "/model"))
                return "%s: %s" % (name, refusal)
            loaded.append(name)
        for name in loaded:  # the parameters of a flight are recorded, with the file's contents
            rospy.set_param(name + "/model", path)
        if label != GIVEN:
            with contextlib.suppress(GroundError):  # the display is not needed to fly
                _offer("live_comparison/load_model2", path)
        return ""

    def expected(self, inputs: Array, model: _core.Model) -> List[Point]:
        """The path that a model expects of `fly` with these inputs, from where the craft is. Raises
        GroundError when the model cannot be simulated."""
        with simulated.played(inputs, model.channels) as path:
            params = simulated.excitation(self.room, inputs, path)
            return simulated.path_of(params, model, self._where())

    def _where(self) -> Array:
        """Pose x, y [m], psi [rad] of the craft at rest; waits until it is seen at rest."""
        while True:
            state = self._newest_state()
            if state.valid and math.hypot(state.nu[0], state.nu[1]) < AT_REST:
                self._say("")
                return np.array(state.eta)
            if not state.valid:
                self._say("waits for the mocap: %s" % state.status)
            self._check()

    def _kept(self, model: _core.Model, label: str) -> str:
        """Path of a file with the model, which nodes can load; its name tells the label."""
        folder = os.path.join(self._folder, "loaded")
        os.makedirs(folder, exist_ok=True)
        path = os.path.join(folder, label.replace(" ", "_") + ".yaml")
        files.write_text(path, model.format(), force=True)
        return path

    def _prepare(self, name: str, flight: Flight, inputs: Array) -> float:
        """Sets the controller's parameters for a flight. Returns its longest duration [s]."""
        node = self._players[name]
        if flight.reference:
            home = self.room.home
            place = {"x": float(home[0]), "y": float(home[1]), "size": float(flight.size)}
            node.set({"reference": flight.reference, "duration": float(flight.duration), **place})
            return flight.duration + SPARE
        path = os.path.join(self._folder, flight.inputs)
        longest = simulated.excitation(self.room, inputs, path).duration
        node.set({"design": "file", "file": path, "returns": True, "duration": longest})
        return longest + SPARE

    def _wait_until_ready(self) -> None:
        """Waits until the craft is seen and the sender is armed by hand."""
        deadline = time.monotonic() + self._patience
        while True:
            problem = self._sender_problem()
            if not problem:
                state = self._newest_state()
                problem = "" if state.valid else "waits for the mocap: %s" % state.status
            self._say(problem)
            if not problem:
                return
            self._arm_again()
            if time.monotonic() > deadline:
                raise GroundError("nothing can be flown for %g s: %s" % (self._patience, problem))
            self._check()

    def _arm_again(self) -> None:
        """Arms the sender of a simulated craft after a FAULT; one that was disarmed by hand stays so."""
        state = self._sender and self._sender.state
        self._faulted = state == SenderStatus.FAULT or (self._faulted and state != SenderStatus.ARMED)
        for armed in (False, True) if self._simulated and self._faulted else ():
            _call("sender/arm", SetBool, data=armed)

    def _say(self, what: str) -> None:
        """Tells what the laboratory waits for, when it changes."""
        if what != self._said:
            self._said = what
            self._waits(what)

    def _sender_problem(self) -> str:
        """What somebody has to do before the sender passes commands on; empty when it does."""
        sender = self._sender
        arm = ARM % rospy.resolve_name("sender/arm")
        if sender is None:
            return "waits for the sender, which publishes no status"
        if sender.state == SenderStatus.FAULT:
            return "the sender is in FAULT (%s): disarm it, then arm by hand: %s" % (sender.reason, arm)
        if sender.state != SenderStatus.ARMED:
            return "the sender is not armed (%s): arm by hand: %s" % (sender.reason, arm)
        return ""

    def _newest_state(self) -> Message:
        """The next State. Waits for one, and says so."""
        while True:
            with contextlib.suppress(rospy.ROSException):
                return rospy.wait_for_message("state", State, timeout=1.0)
            self._say("waits for the mocap: nothing arrives on topic state")
            self._check()

    def _check(self) -> None:
        """Waits for a moment. Raises Ended when the discovery was asked to end."""
        if self._asked.wait(LOOK):
            raise Ended(self._why)

    def _drive(self, name: str, longest: float, recorder: FlightRecorder) -> str:
        """Starts a controller and watches it to its end. Returns why it ended early, or ""."""
        self._check()
        started, began, asked = time.monotonic(), False, ""
        answer = _call(name + "/start", Trigger)
        if not answer.success:
            raise GroundError("%s was not started: %s" % (name, answer.message))
        while True:
            status, heard = self._controllers[name]
            # An earlier one may be the last of the flight before.
            began = began or heard - started > LATE or (status and status.state not in IDLE)
            if began and status.state in ENDED:
                break
            if not asked:
                if self._asked.is_set():
                    asked = self._why
                elif began and status.elapsed > longest:
                    asked = "it did not finish within %.0f s" % longest
                elif recorder.has_ended():
                    asked = "its recorder has ended"
                if asked:
                    _call(name + "/stop", Trigger)
            if began and status.state == ControllerStatus.WAITING:
                self._say(self._sender_problem())
            if time.monotonic() - max(started, heard) > SILENCE:
                raise GroundError("%s is silent for %g s: its node has ended" % (name, SILENCE))
            time.sleep(LOOK)
        self._say("")
        if status.state == ControllerStatus.DONE:
            return ""
        if not asked and (status.reason == BY_HAND or status.reason.endswith(TAKEN_OVER)):
            self._stopped("%s: %s" % (name, status.reason))
        return asked or str(status.reason)


def _node(name: str) -> live_parameters.Node:
    """A controller whose parameters can be set, when it runs."""
    try:
        rospy.wait_for_service(name + "/set_parameters", START)
    except rospy.ROSException:
        raise GroundError("%s does not run: start discover.launch" % rospy.resolve_name(name))
    return live_parameters.Node(name)


def _landed(bag: str, stopped: str, tracked: bool) -> Landed:
    """The Landed of a flight, read from its bag. bag: its path; empty when nothing was recorded."""
    if not bag:
        return Landed(None, "", 0.0, stopped or "nothing was recorded")
    try:
        recording = readers.read(bag)
    except GroundError as problem:
        return Landed(None, "", 0.0, stopped or str(problem))
    parts: List[float] = []  # root mean square errors in parts of the reference [m]
    if tracked and not stopped:
        with contextlib.suppress(GroundError):
            track = tracks.read(bag, recording)[-1]
            parts = tracking.in_parts(track.times, track.errors)
    return Landed(recording, os.path.basename(bag), lifted(recording), stopped, parts)


def _offer(service: str, path: str) -> str:
    """Offers a model file to a node. Returns why it was refused; empty if it was not."""
    answer = _call(service, LoadModel, file=path)
    return "" if answer.success else str(answer.message)


def _call(service: str, kind: object, **request: object) -> Message:
    """The answer of a service; GroundError when there is none."""
    name = rospy.resolve_name(service)
    try:
        rospy.wait_for_service(name, ANSWER)
        return rospy.ServiceProxy(name, kind)(**request)
    except (rospy.ROSException, rospy.ServiceException) as error:
        raise GroundError("%s does not answer: %s" % (name, error))
