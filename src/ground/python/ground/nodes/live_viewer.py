"""The topics of what runs, as a live view for Foxglove, Lichtblick and MCAP files."""

import collections
import gc
import os
import time
from typing import Any, Callable, Deque, Dict, Optional, Tuple

import rospy
from ground_msgs import msg

from ground.exporting.view import View
from ground.models import Model, Room
from ground.nodes import live_feed
from ground.support.annotations import Message
from ground.support.errors import GroundError

PERIOD = 0.066  # between looks at new messages, and so between pictures that a viewer shows [s]
# A subscription that has waited for a message rests, so that the next ones come together: waking up costs
# most.
WAITED, REST, REST_OF_STATE = 0.001, 0.15, 0.055  # [s]
JUMP = int(live_feed.JUMP * 1e9)  # [ns]
NICE = 5  # niceness: the nodes that fly come first
PARAMETERS = {"model": "visualizer/model", "room": "visualizer/room"}  # files that the launch names
LEVELS = {  # of the log, by the name of a state
    **dict.fromkeys(["WAITING", "RECOVERING"], "warning"),
    **dict.fromkeys(["STOPPED", "FAULT"], "error"),
}


class LiveViewer:
    """Writes the messages of the topics to a view.

    Subscribes: state, controls, controls/wanted, reference, model_error, model_error2, model_comparison,
    controller/status, sender/status, discovery/status, live_changes. Publishes nothing.
    """

    def __init__(
        self, view: View, restarted: Callable[[], Any], begins: Callable[[View], None] = lambda view: None
    ) -> None:
        """restarted: called when time jumps back. begins: called with the view then, and at the first
        state."""
        self._view, self._restarted, self._begins = view, restarted, begins
        self._arrived: Deque[Tuple[str, Message]] = collections.deque()
        self._newest = 0  # stamp of the newest state [ns]
        self._states: Dict[str, Tuple[int, str]] = {}  # last state and reason of nodes
        self._invalid = ""
        self._failures: Dict[str, str] = {}  # what models do not predict, by name
        self.counts: Dict[str, int] = collections.Counter()  # messages by topic
        self._topics: Dict[str, Tuple[Any, Callable[[int, Message], None]]] = {
            "state": (msg.State, self._state),
            "controls": (msg.Controls, self._controls),
            "controls/wanted": (msg.Controls, lambda at, m: self._controls(at, m, wanted=True)),
            "reference": (msg.Reference, lambda at, m: view.reference(at, m.p, m.p_dot)),
            "model_error": (msg.ModelError, lambda at, m: self._error(0, at, m)),
            "model_error2": (msg.ModelError, lambda at, m: self._error(1, at, m)),
            "model_comparison": (msg.ModelComparison, self._comparison),
            "controller/status": (msg.ControllerStatus, self._controller),
            "sender/status": (msg.SenderStatus, self._sender),
            "discovery/status": (msg.DiscoveryStatus, self._discovery),
            "live_changes": (msg.LiveChange, self._change),
        }
        self._rested: Dict[str, float] = dict.fromkeys(self._topics, 0.0)  # end of the last rest [s]

    def connect(self) -> None:
        """Subscribes; the node has to be initialised."""
        for topic, (kind, _) in self._topics.items():
            rospy.Subscriber(topic, kind, self._arrive, topic, tcp_nodelay=False)

    def work(self) -> None:
        """Writes what has arrived."""
        while self._arrived:
            topic, message = self._arrived.popleft()
            self.take(topic, message)

    def take(self, topic: str, message: Message) -> None:
        """Writes a message of a topic. Time that jumps back begins a new view."""
        at = message.header.stamp.to_nsec() or time.time_ns()
        if topic == "state":
            if at < self._newest - JUMP:
                self._view.clear()
                self._restarted()
            if not 0 < self._newest <= at + JUMP:
                self._begins(self._view)
            self._newest = at
        self.counts[topic] += 1
        self._topics[topic][1](at, message)

    def _arrive(self, message: Message, topic: str) -> None:
        """Called in the thread of a subscription."""
        self._arrived.append((topic, message))
        if time.monotonic() - self._rested[topic] > WAITED:
            time.sleep(REST_OF_STATE if topic == "state" else REST)
            self._rested[topic] = time.monotonic()

    def _state(self, at: int, state: Message) -> None:
        self._view.state(at, state.eta, state.nu, state.age, state.valid, state.status)
        invalid = "" if state.valid else state.status or "no reason is given"
        if invalid != self._invalid:
            words = "the state is invalid: " + invalid if invalid else "the state is valid"
            self._view.say(at, "state", words, "warning" if invalid else "info")
            self._invalid = invalid

    def _controls(self, at: int, sent: Message, wanted: bool = False) -> None:
        if sent.channels:
            names, values = (*sent.channels, "lift"), (*sent.thrusters, sent.lift)
        else:
            names, values = ("left", "right", "lift"), (sent.left, sent.right, sent.lift)
        self._view.commands(at, names, values, wanted)

    def _error(self, model: int, at: int, error: Message) -> None:
        label, view = error.model, self._view
        view.prediction(model, at, label, error.horizon, error.eta, error.nu, error.eta_error)
        both = (error.position_error, error.heading_error), (error.position_noise, error.heading_noise)
        view.accuracy(model, at, label, *both, error.horizon, error.excited, error.window)
        view.missing(model, at, label, error.wrench, error.wrench_noise)
        if error.failure != self._failures.get(label, ""):
            words = (
                "%s; next: %s" % (error.failure, error.next)
                if error.failure
                else "predicts as before its failure"
            )
            view.say(at, label, words, "warning" if error.failure else "info")
            self._failures[label] = error.failure

    def _comparison(self, at: int, found: Message) -> None:
        self._view.numbers("/comparison", at, (found.difference, found.standard_error), (found.better,))

    def _controller(self, at: int, status: Message) -> None:
        name = self._status(at, "controller", status)
        self._view.numbers("/controller", at, (status.elapsed,), (name, status.reason))

    def _sender(self, at: int, status: Message) -> None:
        name = self._status(at, "sender", status)
        counts = (status.sent, status.received, status.malformed, status.foreign, status.refused)
        self._view.numbers("/sender", at, counts, (name, status.reason, status.peer))

    def _status(self, at: int, node: str, status: Message) -> str:
        """The name of a state; logs a change of it, or of its reason."""
        kind = type(status)
        names = {getattr(kind, name): name for name in dir(kind) if name.isupper()}
        name = names.get(status.state, "?")
        if self._states.get(node) != (status.state, status.reason):
            self._states[node] = status.state, status.reason
            self._view.say(at, node, "%s: %s" % (name, status.reason), LEVELS.get(name, "info"))
        return name

    def _discovery(self, at: int, status: Message) -> None:
        self._view.beliefs(at, status.belief_effects, status.beliefs, status.belief_states)
        numbers = status.flight, status.flown, status.budget
        texts = status.activity, status.purpose, status.verdict, status.reason
        self._view.numbers("/discovery", at, numbers, texts, status.ended, status.sure)
        self._view.say(at, "discovery", status.activity)

    def _change(self, at: int, change: Message) -> None:
        self._view.change(at, change.node, change.name, change.before, change.after)


class Furniture:
    """What is drawn beside the messages: the craft and the room."""

    def __init__(self, model: str, room: str) -> None:
        """model, room: files; where they are empty, those that the launch file names. GroundError when a
        given one cannot be read."""
        self._model = Model.load(model) if model else None
        self._room = Room.load(room) if room else None

    def __call__(self, view: View) -> None:
        """Gives them to a view."""
        view.furnish(
            self._model or _launched("model", Model.load), self._room or _launched("room", Room.load)
        )


def _launched(name: str, load: Callable[[str], Any]) -> Any:
    """What the launch file names; None without."""
    path = str(rospy.get_param(PARAMETERS[name], ""))
    try:
        return load(path) if path else None
    except GroundError as error:
        rospy.logwarn("shown without its %s: %s", name, error)
        return None


def run(viewer: LiveViewer, waiting: Callable[[], None], patience: float = 5.0) -> None:
    """Writes what arrives until the node is shut down. waiting: called once if no state has come after a
    time [s]."""
    os.nice(NICE)
    gc.freeze()  # what was imported stays: it need not be looked at again and again
    viewer.connect()
    deadline: Optional[float] = time.monotonic() + patience
    while not rospy.is_shutdown():
        viewer.work()
        if deadline and time.monotonic() > deadline:
            if not viewer.counts.get("state"):
                waiting()
            deadline = None
        time.sleep(PERIOD)
    viewer.work()
