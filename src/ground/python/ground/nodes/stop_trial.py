"""A trial of the craft's own stop in a running launch: a gentle push, then the sender is silent."""

import contextlib
import math
import signal
import subprocess
import time
from dataclasses import dataclass
from typing import Any, Callable, Iterator, List, Tuple, Union

import numpy as np
import roslib.packages
import rospy
from ground_msgs.msg import ControllerStatus, SenderStatus, State
from ground_msgs.srv import Silence
from std_srvs.srv import SetBool, Trigger

from ground import _core
from ground.nodes import own_stop
from ground.support.annotations import Say
from ground.support.command_line import option
from ground.support.errors import GroundError

DRIVE = "prove_stop_drive"  # the nodelet that gives the push
ANSWER = 10.0  # timeout of a node [s]
AT_REST = 0.1  # largest speed of a craft at rest [m/s]
TAIL = own_stop.AFTER + 0.2  # time recorded after the silence [s]
AFTER_SILENCE = "disarmed after the silence"


@dataclass(frozen=True)
class Push:
    """The commands before the silence."""

    thrust: float = option(0.15, "input of both thrusters, 0..1 (0.15)", range=(0.02, 0.5))
    lift: float = option(0.6, "input of the lift fan, 0..1 (0.6)", range=(0.05, 1.0))
    lift_time: float = option(1.0, "lift only, before the thrust [s] (1)", range=(0.2, 10.0))
    thrust_time: float = option(1.2, "thrust before the silence [s] (1.2)", range=(0.8, 5.0))
    silence: float = option(1.5, "time for which nothing is sent [s] (1.5)", range=(0.5, 2.0))

    def distance(self, model: _core.Model) -> float:
        """Distance that a craft whose watchdog fails goes until zeros come again [m]."""
        acceleration = 2 * model.value("k") * model.input_max * self.thrust / model.value("m")
        return 0.5 * acceleration * (self.thrust_time + self.silence) ** 2


class Stack:
    """The running launch: its sender, its states, and the sender's model of the craft."""

    def __init__(self, manager: str) -> None:
        self.manager = rospy.resolve_name(manager)
        self.model = _core.load_model(_parameter("sender/model"))
        published = [name for name, _ in rospy.get_published_topics()]
        truth = rospy.resolve_name("simulator/truth")
        self.simulated = truth in published or rospy.get_param("/use_sim_time", False)
        self.statuses: List[SenderStatus] = []
        self.states: List[State] = []
        self.drive: List[ControllerStatus] = []
        self._listeners = [
            rospy.Subscriber(topic, kind, heard.append, tcp_nodelay=True)
            for topic, kind, heard in (
                ("sender/status", SenderStatus, self.statuses),
                ("state", State, self.states),
                (DRIVE + "/status", ControllerStatus, self.drive),
            )
        ]
        self.silence = _service("sender/silence", Silence)
        self.arm = _service("sender/arm", SetBool)

    def try_stop(self, push: Push, patience: float, say: Say = print) -> Tuple[own_stop.StopTrial, str]:
        """Waits until the sender is armed, pushes the craft and is silent. Returns the Trial and the
        sender's reason for the end of the silence."""
        with self._loaded(push):
            self._wait_armed(patience, say)
            self._check_at_rest()
            try:
                return self._push(push, say)
            except BaseException:
                with contextlib.suppress(rospy.ServiceException, rospy.ROSException):
                    self.arm(False)
                raise

    @contextlib.contextmanager
    def _loaded(self, push: Push) -> Iterator[None]:
        """Loads a controller that gives constant thrust beside the launch's own."""
        _wait(lambda: self.statuses, "the sender publishes no status")
        nodelet = roslib.packages.find_node("nodelet", "nodelet")[0]
        values = {side + end: push.thrust for side in ("left_", "right_") for end in ("low", "high")}
        values.update(lift=push.lift, lift_time=push.lift_time)
        values["duration"] = push.thrust_time + push.silence + 1.0
        command = [nodelet, "load", "ground/OpenLoopPRBS", self.manager, "__name:=" + DRIVE]
        command += ["_%s:=%r" % (name, float(value)) for name, value in values.items()]
        del self.drive[:]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, start_new_session=True)
        fails = "no nodelet can be loaded into %s: is it the launch's manager?" % self.manager
        try:
            _wait(lambda: self.drive or process.poll() is not None, fails)
            if process.poll() is not None:
                raise GroundError(fails)
            yield
        finally:
            if self.drive and self.drive[-1].state != ControllerStatus.STOPPED:
                with contextlib.suppress(rospy.ServiceException, rospy.ROSException, GroundError):
                    _service(DRIVE + "/stop", Trigger)()
            process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(timeout=ANSWER)
            process.kill()

    def _wait_armed(self, patience: float, say: Say) -> None:
        if self.statuses[-1].state != SenderStatus.ARMED:
            say("waiting until the sender is armed: rosservice call %s true" % self.arm.resolved_name)
        _wait(
            lambda: self.statuses[-1].state == SenderStatus.ARMED,
            lambda: "the sender was not armed within %.0f s: %s" % (patience, self.statuses[-1].reason),
            patience,
        )

    def _check_at_rest(self) -> None:
        _wait(lambda: self.states, "no message on topic state")
        state = self.states[-1]
        if not state.valid:
            raise GroundError("the state is invalid: %s" % state.status)
        speed = math.hypot(state.nu[0], state.nu[1])
        if speed > AT_REST:
            raise GroundError(
                "the craft moves at %.2f m/s: stop its controller (rosservice call "
                "/controller/stop), let it come to rest, and try again" % speed
            )

    def _push(self, push: Push, say: Say) -> Tuple[own_stop.StopTrial, str]:
        del self.states[:]
        answer = _service(DRIVE + "/start", Trigger)()
        if not answer.success:
            raise GroundError("the push was refused: %s" % answer.message)
        say("lift, then thrust %.2f for %.1f s" % (push.thrust, push.thrust_time))
        _wait(
            lambda: self._ended() or self._pushed() >= push.thrust_time,
            lambda: "the push did not start: %s" % self.drive[-1].reason,
            push.lift_time + push.thrust_time + ANSWER,
        )
        if self._ended():
            reasons = self.drive[-1].reason, self.statuses[-1].reason
            raise GroundError("the push was stopped: %s; the sender: %s" % reasons)
        answer = self.silence(push.silence)
        if not answer.success:
            raise GroundError("the sender does not fall silent: %s" % answer.message)
        _service(DRIVE + "/stop", Trigger)()
        say("silence for %.1f s" % push.silence)
        began = answer.last_packet

        def after() -> List[SenderStatus]:
            late = [s for s in list(self.statuses) if s.header.stamp > began]
            return [s for s in late if s.state != SenderStatus.ARMED]

        _wait(after, "the silence does not end", push.silence + ANSWER)
        end = after()[0]
        with contextlib.suppress(GroundError):  # it is judged by the states that have come
            _wait(
                lambda: (self.states[-1].header.stamp - end.header.stamp).to_sec() > TAIL,
                "no state came after the silence",
            )
        return self._trial(began, end), end.reason

    def _ended(self) -> bool:
        return self.drive[-1].state in (ControllerStatus.STOPPED, ControllerStatus.DONE)

    def _pushed(self) -> float:
        """Time since the thrust began [s]."""
        running = [s for s in list(self.drive) if s.state == ControllerStatus.RUNNING]
        return float((rospy.Time.now() - running[0].header.stamp).to_sec()) if running else 0.0

    def _trial(self, began: rospy.Time, end: SenderStatus) -> own_stop.StopTrial:
        zero = began.to_sec() - 100.0  # smaller numbers keep more digits of a fraction
        states = list(self.states)
        return own_stop.StopTrial(
            times=np.array([s.header.stamp.to_sec() - zero for s in states]),
            speeds=np.array([math.hypot(s.nu[0], s.nu[1]) for s in states]),
            valid=np.array([s.valid for s in states], bool),
            last_packet=began.to_sec() - zero,
            silence_end=end.header.stamp.to_sec() - zero,
        )


def verdict_of(trial: own_stop.StopTrial, ended: str) -> own_stop.StopVerdict:
    """The Verdict on a trial; ended: the sender's reason for the end of the silence."""
    if ended != AFTER_SILENCE:
        return own_stop.StopVerdict(own_stop.UNDECIDED, "the silence was cut short: %s" % ended)
    return own_stop.judge(trial)


def _parameter(name: str) -> str:
    value = rospy.get_param(name, "")
    if not value:
        raise GroundError(
            "no sender with a model runs (parameter %s): start a launch first, or "
            "roslaunch ground own_stop.launch" % rospy.resolve_name(name)
        )
    return str(value)


def _service(name: str, kind: Any) -> rospy.ServiceProxy:
    try:
        rospy.wait_for_service(name, ANSWER)
    except rospy.ROSException:
        raise GroundError("no service %s" % rospy.resolve_name(name))
    return rospy.ServiceProxy(name, kind)


def _wait(
    condition: Callable[[], Any], message: Union[str, Callable[[], str]], timeout: float = ANSWER
) -> None:
    """Waits, in wall time, until condition() holds; else raises GroundError with the message, which may
    be a function that is called then."""
    deadline = time.monotonic() + timeout
    while not condition():
        if rospy.is_shutdown():
            raise GroundError("ROS was shut down")
        if time.monotonic() > deadline:
            raise GroundError(message() if callable(message) else message)
        time.sleep(0.005)
