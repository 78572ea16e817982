"""A window that shows a running experiment: model beside measurement, inputs, errors, missing wrench;
and a discovery, while there is one."""

import contextlib
import html
import math
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from typing import Any, Callable, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple, TypeVar

import numpy as np
import PyQt5  # noqa: F401  before pyqtgraph, which uses the binding that it finds imported
import pyqtgraph as pg
import rosgraph
import rospy
from ground_msgs.msg import (
    ControllerStatus,
    Controls,
    DiscoveryStatus,
    ModelError,
    Reference,
    SenderStatus,
    State,
)
from PyQt5 import QtCore, QtGui, QtWidgets

from ground import files
from ground.annotations import Array, Message
from ground.errors import GroundError
from ground.nodes.discovery_panel import HEIGHT, DiscoveryPanel
from ground.nodes.live_buffers import (
    LiveBuffers,
    Samples,
    Span,
    axis_range,
    extent,
    thinned,
    ticks,
    tracking_error,
)
from ground.reports import appearance

REDRAW = 33  # period [ms]
FIT = 0.2  # period at which vertical axes are fitted to their curves [s]
SIZE = (1200, 900)  # width and height when the window opens [pixels]
SILENCE = 3.0  # silence of a node or of all topics after which the window says so [s]
WATCH = 1.0  # period at which the master is checked [s]
LONGEST_NAME = 16  # characters; longer names of models are cut off in titles
TICK_SPACE = 20  # between two ticks of a vertical axis [pixels]
TITLE = 24  # height of a title [pixels]
MARGIN = 0.025  # left and right of the history, for the labels of its ends, as share of it

NOTE = appearance.LESS
GOOD, BUSY, BAD = appearance.GOOD, appearance.BUSY, appearance.WARNING
WANTED, GRID = "#a8a8a8", "#e6e6e6"
STATUS_COLORS = {
    **dict.fromkeys(["RUNNING", "ARMED"], GOOD),
    **dict.fromkeys(["WAITING", "LIFTING", "RECOVERING"], BUSY),
    **dict.fromkeys(["STOPPED", "FAULT"], BAD),
}

_Numbers = TypeVar("_Numbers", float, Array)
Line = Tuple[Array, Array]  # stamps [s] and values, (n,); NaN interrupts it


class Topic:
    """A topic with stamped messages, and their fields that are drawn."""

    def __init__(self, kind: Any, *fields: str) -> None:
        """kind: class of the messages. fields: their numbers, such as "error" or "nu[0]"."""
        self.kind = kind
        self.fields = fields
        self._keys = [field.rstrip("]").partition("[")[::2] for field in fields]

    def row(self, message: Message) -> List[float]:
        """The numbers of a message."""
        values = ((getattr(message, name), index) for name, index in self._keys)
        return [value[int(index)] if index else value for value, index in values]


_PREDICTED = ["nu[0]", "nu[1]", "nu[2]", "error", "wrench[0]", "wrench[1]", "wrench[2]"]
_INPUTS = ["left", "right", "lift"]
TOPICS = {
    # tracking_error() takes the first two as x and y.
    "state": Topic(State, "eta[0]", "eta[1]", "nu[0]", "nu[1]", "nu[2]"),
    "model_error": Topic(ModelError, *_PREDICTED),
    "model_error2": Topic(ModelError, *_PREDICTED),
    "controls": Topic(Controls, *_INPUTS),
    "controls/wanted": Topic(Controls, *_INPUTS),
    "reference": Topic(Reference, "p[0]", "p[1]"),
}
EXPECTED = ["state", "model_error", "controls"]  # every experiment and every replay has these
MODELS = ["model_error", "model_error2"]
STATUSES = {"controller/status": ControllerStatus, "sender/status": SenderStatus}
STATES = {
    topic: {getattr(kind, name): name for name in dir(kind) if name.isupper()}
    for topic, kind in STATUSES.items()
}
TRACKING = "tracking error"  # computed from state and reference


@dataclass(frozen=True)
class Curve:
    """One line: a field of a topic, or the tracking error."""

    topic: str
    field: str
    label: str  # {model} stands for the name of the model file
    color: str

    def channel(self) -> int:
        """Which of the topic's numbers it is."""
        return 0 if self.topic == TRACKING else TOPICS[self.topic].fields.index(self.field)


@dataclass(frozen=True)
class Panel:
    """A diagram; its curves share an axis. Later curves are drawn over earlier ones."""

    title: str
    axis: str  # quantity and unit
    curves: Sequence[Curve]
    scale: float = 1.0  # from the messages' unit to the axis's
    least: float = 0.0  # smallest span of the axis, in its unit
    always: Tuple[float, ...] = ()  # what the axis always shows, in its unit
    waits_for: Sequence[str] = ()  # topics that it needs besides its EXPECTED ones


def _velocity(index: int, least: float) -> Panel:
    _, name, unit = appearance.CHANNELS[index]
    field = "nu[%d]" % index
    curves = [Curve("state", field, "measured", appearance.MEASURED)]
    curves += [
        Curve(topic, field, label, appearance.model_color(i))
        for i, (topic, label) in enumerate(zip(MODELS, ["predicted by {model}", "by {model}"]))
    ]
    return Panel(name, "%s [%s]" % (name.split()[-1], unit), curves, least=least)


def _input(field: str, title: str, color: str) -> Panel:
    curves = [
        Curve("controls/wanted", field, "wanted by the controller", WANTED),
        Curve("controls", field, "sent", color),
    ]
    return Panel(title, "input [0..1]", curves, always=(0.0, 1.0))


def _error() -> Panel:
    curves = [
        Curve(topic, "error", "{model}", appearance.model_color(i))
        for i, topic in enumerate(MODELS)
    ]
    return Panel("model error, sum of u, v, r", "|error| / spread", curves, always=(0.0, 1.0))


def _tracking() -> Panel:
    curves = [Curve(TRACKING, "", "", appearance.MEASURED)]
    title = "tracking error, distance from the reference"
    return Panel(title, "distance [mm]", curves, 1e3, always=(0.0, 5.0), waits_for=["reference"])


def _missing_force() -> Panel:
    curves = [
        Curve("model_error", "wrench[0]", "ahead X", appearance.MISSING),
        Curve("model_error", "wrench[1]", "to starboard Y", appearance.REFERENCE),
    ]
    return Panel("force missing in {model}", "force [mN]", curves, 1e3, always=(-2.0, 2.0))


def _missing_moment() -> Panel:
    curves = [Curve("model_error", "wrench[2]", "clockwise N", appearance.MISSING)]
    return Panel("moment missing in {model}", "moment [mN m]", curves, 1e3, always=(-0.1, 0.1))


COLUMNS = [
    [_velocity(0, 0.1), _velocity(1, 0.1), _velocity(2, 0.5), _error(), _tracking()],
    [
        _input("left", "left thruster", appearance.THRUSTERS[0]),
        _input("right", "right thruster", appearance.THRUSTERS[1]),
        _input("lift", "lift fan", appearance.MEASURED),
        _missing_force(),
        _missing_moment(),
    ],
]


class Feed:
    """The newest data of the topics: samples in buffers, and the last statuses.

    Subscribes: state, model_error, model_error2, controls, controls/wanted, reference,
    discovery/status, controller/status, sender/status. It subscribes again when the master is
    replaced, as by a restarted launch file.
    """

    def __init__(self, duration: float) -> None:
        """duration: length of the history [s]."""
        self.buffers = LiveBuffers({n: len(t.fields) for n, t in TOPICS.items()}, duration)
        self.models: Dict[str, ModelError] = {}  # topic to newest message
        # topic to newest message, received [s]
        self.statuses: Dict[str, Tuple[Message, float]] = {}
        self.discovery: Optional[Message] = None  # the newest DiscoveryStatus
        self.invalid = ""  # why the newest state is invalid
        self.heard = -math.inf  # when the newest sample came, time.monotonic() [s]
        self.master_answers = True
        self._subscribers: List[rospy.Subscriber] = []

    def connect(self) -> None:
        """Subscribes; the node has to be initialised."""
        master = rosgraph.Master(rospy.get_name())
        known = _pid(master)  # first, so that the end of a master right afterwards is noticed
        self._subscribe()
        threading.Thread(target=self._watch_master, args=(master, known), daemon=True).start()

    def take(self, message: Message, topic: str) -> None:
        """Takes a message of one of TOPICS."""
        row = TOPICS[topic].row(message)
        if topic in MODELS:
            self.models[topic] = message
        elif topic == "state":
            self.invalid = "" if message.valid else message.status or "no reason is given"
            row = row if message.valid else [math.nan] * len(row)
        self.heard = time.monotonic()
        self.buffers.add(topic, message.header.stamp.to_sec(), row)

    def take_status(self, message: Message, topic: str) -> None:
        """Takes a message of one of STATUSES."""
        self.statuses[topic] = (message, time.monotonic())

    def take_discovery(self, message: Message) -> None:
        """Takes a DiscoveryStatus."""
        self.discovery = message

    def _subscribe(self) -> None:
        for topic, what in TOPICS.items():
            self._subscribers.append(rospy.Subscriber(topic, what.kind, self.take, topic))
        found = rospy.Subscriber("discovery/status", DiscoveryStatus, self.take_discovery)
        self._subscribers.append(found)
        for topic, kind in STATUSES.items():
            self._subscribers.append(rospy.Subscriber(topic, kind, self.take_status, topic))

    def _watch_master(self, master: rosgraph.Master, known: Optional[int]) -> None:
        while not rospy.is_shutdown():
            pid = _pid(master)
            self.master_answers = pid is not None
            if pid and known and pid != known:
                for subscriber in self._subscribers:
                    subscriber.unregister()
                self._subscribers.clear()
                self._subscribe()
            known = pid or known
            time.sleep(WATCH)


def _pid(master: rosgraph.Master) -> Optional[int]:
    """Number of the master's process; None when it does not answer."""
    with contextlib.suppress(OSError, rosgraph.MasterException):
        return int(master.getPid())
    return None


class Strip(QtWidgets.QWidget):
    """The inside of a diagram: grid, curves, or a note.

    It lies on top of the graphics view that draws the axes. Until an axis changes, it moves its
    picture by whole pixels and adds the new part: to draw all curves again, 30 times a second, takes
    several times as long.
    """

    def __init__(self, parent: QtWidgets.QWidget, panel: Panel, across: Span) -> None:
        """across: range of the time axis, 0 at the newest message [s]."""
        super().__init__(parent)
        self.setAttribute(QtCore.Qt.WA_OpaquePaintEvent)
        self._pens = [pg.mkPen(curve.color) for curve in panel.curves]
        self._scale = panel.scale
        self._grid_pen, self._note_pen = pg.mkPen(GRID), pg.mkPen(NOTE)
        self._across = across
        self._per_second = 1.0  # columns of pixels per second
        self._column = 0  # column of the newest stamp
        self._up: Span = (0.0, 1.0)
        self._lines: Sequence[Line] = [(np.empty(0), np.empty(0))] * len(panel.curves)
        self._picture = QtGui.QPixmap()
        self._drawn: Any = None  # size, axis and grid of the picture
        self.note = ""  # text shown on the curves
        self.grid: Tuple[Sequence[float], Sequence[float]] = ((), ())  # shares of the width, values

    def draw(self, now: float, up: Span, lines: Sequence[Line]) -> None:
        """now: the newest stamp [s]. up: range of the vertical axis."""
        if self.rect().isEmpty():  # the window is very small
            return
        drawn = (self.size(), up, self.grid)
        self._per_second = self.width() / (self._across[1] - self._across[0])
        column = math.floor(now * self._per_second)
        moved = column - self._column
        since = self._undrawn(lines)
        self._column, self._up, self._lines = column, up, lines
        whole = self.rect()
        if drawn != self._drawn or not 0 <= moved < self.width() or since == -math.inf:
            self._drawn = drawn
            self._picture = QtGui.QPixmap(self.size())
            self._draw_part(whole)
        else:
            self._picture.scroll(-moved, 0, whole)
            left = whole.right() + 1 - moved
            if since < math.inf:
                left = min(left, math.floor(self._x(since)) - 1)
            self._draw_part(whole.adjusted(max(left, 0), 0, 0, 0))
        self.update()

    def paintEvent(self, event: QtGui.QPaintEvent) -> None:
        """Paints the curves, the grid and the note."""
        painter = QtGui.QPainter(self)
        painter.drawPixmap(event.rect(), self._picture, event.rect())
        # These lines do not move with the curves, and lie behind them.
        painter.setCompositionMode(QtGui.QPainter.CompositionMode_Darken)
        painter.setPen(self._grid_pen)
        xs = [int(share * self.width()) for share in self.grid[0]]
        painter.drawLines([QtCore.QLine(x, 0, x, self.height()) for x in xs])
        if self.note:
            where = painter.boundingRect(self.rect(), QtCore.Qt.AlignCenter, self.note)
            painter.setCompositionMode(QtGui.QPainter.CompositionMode_SourceOver)
            painter.fillRect(where, QtCore.Qt.white)
            painter.setPen(self._note_pen)
            painter.drawText(where, QtCore.Qt.AlignCenter, self.note)
        painter.end()

    def _draw_part(self, area: QtCore.QRect) -> None:
        painter = QtGui.QPainter(self._picture)
        painter.setClipRect(area)
        painter.fillRect(area, QtCore.Qt.white)
        painter.setPen(self._grid_pen)
        ys = [int(self._y(value)) for value in self.grid[1]]
        painter.drawLines([QtCore.QLine(area.left(), y, area.right(), y) for y in ys])
        for pen, line in zip(self._pens, self._lines):
            if len(line[0]):
                painter.setPen(pen)
                for piece in self._pieces(line, area.left() - 2, area.right() + 2):
                    painter.drawPolyline(piece)
        painter.end()

    def _pieces(self, line: Line, left: int, right: int) -> Iterator[QtGui.QPolygonF]:
        """The part of a line between two columns of pixels, in pieces without a gap."""
        times, values = line
        first = int(np.searchsorted(times, self._time(left))) - 1
        last = int(np.searchsorted(times, self._time(right))) + 1
        part = slice(max(first, 0), last)
        times, values = thinned(times[part], values[part], max(2 * (right - left), 100))
        # Lists are faster than arrays here, because there are mostly a few samples.
        points: List[QtCore.QPointF] = []
        for x, y in zip(self._x(times).tolist(), self._y(self._scale * values).tolist()):
            if not math.isnan(y):
                points.append(QtCore.QPointF(x, y))
            elif points:
                yield QtGui.QPolygonF(points)
                points = []
        if points:
            yield QtGui.QPolygonF(points)

    def _undrawn(self, lines: Sequence[Line]) -> float:
        """The earliest stamp from which the picture differs [s]: infinity when nothing differs, minus
        infinity when everything does."""
        since = math.inf
        for (before, _), (times, _) in zip(self._lines, lines):
            if len(before) and (not len(times) or times[-1] < before[-1]):
                return -math.inf
            if len(times) and not len(before):
                since = min(since, times[0])
            elif len(times) and times[-1] > before[-1]:
                since = min(since, before[-1])
        return since

    def _x(self, stamps: _Numbers) -> _Numbers:
        """Columns of stamps."""
        return (stamps - self._across[0]) * self._per_second - self._column

    def _time(self, x: float) -> float:
        return (x + self._column) / self._per_second + self._across[0]

    def _y(self, values: _Numbers) -> _Numbers:
        return (self._up[1] - values) * (self.height() / (self._up[1] - self._up[0]))


class Diagram:
    """A drawn panel: axes in the view, curves and title on top of it."""

    def __init__(
        self, panel: Panel, duration: float, view: pg.GraphicsLayoutWidget, bottom: bool
    ) -> None:
        """duration: length of the time axis [s]. bottom: whether the time axis is labelled."""
        self.panel = panel
        self.item = pg.PlotItem(viewBox=pg.ViewBox(enableMouse=False, enableMenu=False))
        self._view = view
        across = (-(1 + MARGIN) * duration, MARGIN * duration)
        self.strip = Strip(view.viewport(), panel, across)
        self.title = QtWidgets.QLabel(view.viewport())
        self._across = across
        self._up: Span = (0.0, 0.0)
        self._channels = [curve.channel() for curve in panel.curves]
        self._words: Any = None  # what title and note depend on
        self._style(bottom)
        self._show_range([])

    def _style(self, bottom: bool) -> None:
        item = self.item
        item.hideButtons()
        item.setMenuEnabled(False)
        item.layout.setRowFixedHeight(0, TITLE)
        self.title.setTextFormat(QtCore.Qt.RichText)
        item.setXRange(*self._across, padding=0)
        left, below = item.getAxis("left"), item.getAxis("bottom")
        left.setWidth(62)
        below.setStyle(showValues=bottom)
        item.setLabel("left", self.panel.axis)
        if bottom:
            item.setLabel("bottom", "time before the newest message [s]")
        for axis in (left, below):
            axis.enableAutoSIPrefix(False)
            axis.setStyle(tickLength=0)  # the strip draws grid lines instead

    def place(self) -> None:
        """Moves the curves to the inside of the diagram in the view, and the title above it."""
        inside = self._view.mapFromScene(self.item.vb.sceneBoundingRect()).boundingRect()
        self.strip.setGeometry(inside.adjusted(1, 0, 0, -2))  # beside the axes
        self.title.setGeometry(inside.left() + 4, inside.top() - TITLE, inside.width() - 4, TITLE)
        self._find_ticks()

    def draw(
        self,
        now: Optional[float],
        samples: Dict[str, Samples],
        models: Dict[str, str],
        silent: Sequence[str],
        fit: bool,
    ) -> None:
        """now: the newest stamp [s]; None before the first. samples, models: samples and name of the
        model file, by topic. silent: topics without a sample. fit: whether the vertical axis is
        fitted to the samples."""
        lines = [
            (samples[curve.topic].times, samples[curve.topic].values[channel])
            for curve, channel in zip(self.panel.curves, self._channels)
        ]
        if fit:
            self._show_range([values for _, values in lines])
        drawn = [c for c, (times, _) in zip(self.panel.curves, lines) if len(times)]
        waits = [] if drawn else [topic for topic in self._waits_for() if topic in silent]
        words = (drawn, waits, models)
        if words != self._words:
            self._words = words
            self._name(drawn, models)
            self.strip.note = "no message yet on " + " and ".join(waits) if waits else ""
        self.strip.draw(now or 0.0, self._up, lines)

    def _waits_for(self) -> List[str]:
        topics = [curve.topic for curve in self.panel.curves if curve.topic in EXPECTED]
        return list(dict.fromkeys(topics)) + list(self.panel.waits_for)

    def _show_range(self, curves: Sequence[Array]) -> None:
        """curves: the values of each."""
        ends = list(self.panel.always)
        for values in curves:
            ends += [self.panel.scale * end for end in extent(values)]
        up = axis_range(min(ends, default=0.0), max(ends, default=0.0), self._up, self.panel.least)
        if up != self._up:
            self._up = up
            self.item.setYRange(*up, padding=0)
            self._find_ticks()

    def _find_ticks(self) -> None:
        left, right = self._across
        times = ticks(left, right, 6)
        values = ticks(*self._up, max(self.strip.height() // TICK_SPACE, 2))
        self.strip.grid = (tuple((time - left) / (right - left) for time in times), tuple(values))
        for side, found in (("bottom", times), ("left", values)):
            self.item.getAxis(side).setTicks([[(value, "%g" % value) for value in found]])

    def _name(self, curves: Sequence[Curve], models: Mapping[str, str]) -> None:
        """Sets title and legend, in one line above the curves."""
        model = models.get(MODELS[0], "the model")
        words = ["<b>%s</b>" % html.escape(self.panel.title.format(model=model))]
        for curve in curves:
            label = curve.label.format(model=models.get(curve.topic, ""))
            if label:
                words.append(colored("&#9644; " + html.escape(label), curve.color))
        self.title.setText(" &nbsp; ".join(words))


class LivePlot(QtWidgets.QWidget):
    """The window; it draws a feed."""

    def __init__(self, feed: Feed) -> None:
        super().__init__()
        self._feed = feed
        self._drawn = -1  # version of the buffers
        self._fitted = math.inf  # stamp at which the axes were fitted [s]
        self._placed = False  # whether the curves are where the axes are
        pg.setConfigOptions(antialias=False, background="w", foreground="k")
        font = QtWidgets.QApplication.font()
        font.setPointSize(9)
        QtWidgets.QApplication.setFont(font)  # axes take it, too
        self.setWindowTitle("ground: live plot")
        self.resize(*SIZE)
        palette = self.palette()
        palette.setColor(palette.Window, QtCore.Qt.white)
        palette.setColor(palette.WindowText, QtCore.Qt.black)
        self.setPalette(palette)
        column = QtWidgets.QVBoxLayout(self)
        column.setContentsMargins(8, 6, 8, 4)
        column.setSpacing(1)
        self.lines = [QtWidgets.QLabel() for _ in range(3)]
        for line in self.lines:
            line.setTextFormat(QtCore.Qt.RichText)
            # A long reason is cut off; it does not widen the window.
            line.setSizePolicy(QtWidgets.QSizePolicy.Ignored, QtWidgets.QSizePolicy.Fixed)
            column.addWidget(line)
        column.addWidget(self._diagrams(), 1)
        self.panel: Optional[DiscoveryPanel] = None  # once there is a discovery
        self._shown: Optional[Message] = None  # DiscoveryStatus in the panel

    def _diagrams(self) -> pg.GraphicsLayoutWidget:
        view = pg.GraphicsLayoutWidget()
        view.ci.layout.setHorizontalSpacing(20)
        view.ci.layout.setVerticalSpacing(2)
        self.diagrams = []
        for i, panels in enumerate(COLUMNS):
            view.ci.layout.setColumnPreferredWidth(i, SIZE[0] / len(COLUMNS))
            view.ci.layout.setColumnStretchFactor(i, 1)
            for j, panel in enumerate(panels):
                bottom = j == len(panels) - 1
                diagram = Diagram(panel, self._feed.buffers.duration, view, bottom)
                view.addItem(diagram.item, row=j, col=i)
                diagram.item.vb.sigResized.connect(self._move)
                self.diagrams.append(diagram)
        return view

    def _move(self, *_: object) -> None:
        self._placed = False  # redraw places the curves, when the layout is complete

    def redraw(self) -> None:
        """Draws the messages since the last call."""
        feed, version = self._feed, self._feed.buffers.version
        now, samples = feed.buffers.snapshot()
        self._tell(now)
        self._show_discovery()
        if version == self._drawn and self._placed:
            return
        if not self._placed:
            for diagram in self.diagrams:
                diagram.place()
        self._drawn, self._placed = version, True
        samples[TRACKING] = tracking_error(samples["state"], samples["reference"])
        models = {topic: short(message.model) for topic, message in list(feed.models.items())}
        silent = feed.buffers.silent(list(TOPICS))
        fit = now is not None and not 0 <= now - self._fitted < FIT
        if now is not None and fit:
            self._fitted = now
        for diagram in self.diagrams:
            diagram.draw(now, samples, models, silent, fit)

    def _show_discovery(self) -> None:
        """Shows the newest DiscoveryStatus below the diagrams; the first one makes the window higher."""
        message = self._feed.discovery
        if message is None or message is self._shown:
            return
        if self.panel is None:
            self.panel = DiscoveryPanel()
            self.layout().addWidget(self.panel)
            self.resize(self.width(), self.height() + HEIGHT)
        self._shown = message
        self.panel.draw(message)

    def save(self, path: str, force: bool = False) -> None:
        """Writes a PNG of the window; GroundError when that is not possible."""
        self.redraw()
        with files.new_file(path, force) as temporary:
            if not self.grab().save(temporary, "PNG"):
                raise GroundError("%s: the picture cannot be written" % path)

    def _tell(self, now: Optional[float]) -> None:
        sentences = [status_line(topic, self._feed) for topic in STATUSES]
        sentences.append(data_line(now, self._feed))
        for line, sentence in zip(self.lines, sentences):
            if line.text() != sentence:
                line.setText(sentence)


def short(name: str) -> str:
    """A name, cut off to fit into a title."""
    return name if len(name) <= LONGEST_NAME else name[: LONGEST_NAME - 1] + "…"


def colored(text: str, color: str) -> str:
    """Rich text of a color "#rrggbb"."""
    return '<span style="color: %s">%s</span>' % (color, text)


def status_line(topic: str, feed: Feed) -> str:
    """A node's last status, as rich text: state and reason."""
    node = topic.split("/")[0]
    if topic not in feed.statuses:
        return "<b>%s</b> %s" % (node, colored("no message yet on " + topic, NOTE))
    message, received = feed.statuses[topic]
    state = STATES[topic].get(message.state, "?")
    color = STATUS_COLORS.get(state, NOTE)
    line = "<b>%s %s</b> %s" % (node, colored(state, color), html.escape(message.reason))
    silent = time.monotonic() - received
    if silent > SILENCE:
        line += colored(" (%.0f s ago; silent since)" % silent, BAD)
    return line


def data_line(now: Optional[float], feed: Feed) -> str:
    """What is missing, as rich text: the master, topics or new messages; otherwise the time."""
    missing = feed.buffers.silent(EXPECTED)
    silent = time.monotonic() - feed.heard
    if not feed.master_answers:
        return colored("The ROS master does not answer; waiting for a new one.", BAD)
    if now is not None and silent > SILENCE:
        return colored("No new message for %.0f s; the newest has stamp %.0f s." % (silent, now), BUSY)
    if missing:
        return colored("Waiting for messages on %s." % ", ".join(missing), BUSY)
    if feed.invalid:
        return colored("The state is invalid: %s" % html.escape(feed.invalid), BAD)
    horizon = feed.models[MODELS[0]].horizon
    return colored(
        "Newest message: %.0f s. Predictions are %g s ahead." % (now or 0.0, horizon), NOTE
    )


def check_display() -> None:
    """Raises GroundError if no window can be opened; Qt itself would abort this process."""
    probe = [sys.executable, "-c", "from PyQt5.QtWidgets import QApplication; QApplication([])"]
    result = subprocess.run(probe, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    if result.returncode == 0:
        return
    display = os.environ.get("DISPLAY")
    what = "display %s cannot be opened" % display if display else "DISPLAY is not set"
    raise GroundError(
        "%s: start it on a desktop or through ssh -X, or, for a picture only, as "
        "QT_QPA_PLATFORM=offscreen rosrun ground plot --picture FILE.png" % what
    )


def show(
    feed: Feed, picture: Optional[str] = None, after: float = 0.0, force: bool = False
) -> None:
    """Shows a feed until the window is closed or a signal ends it.

    picture: PNG file that is written `after` [s], whereupon the window closes. force: overwrites it.
    """
    # pg.mkQApp would make Qt scale everything by the screen's resolution, including curves.
    application = QtWidgets.QApplication.instance() or QtWidgets.QApplication(["plot"])
    window = LivePlot(feed)
    signals: List[int] = []
    failures: List[Exception] = []

    def guarded(work: Callable[[], None]) -> None:
        # An exception that leaves a slot would abort the process.
        try:
            work()
        except Exception as error:
            failures.append(error)
            application.quit()

    def tick() -> None:
        if signals or rospy.is_shutdown():
            application.quit()
        elif window.isVisible():
            guarded(window.redraw)

    def take_picture() -> None:
        guarded(lambda: window.save(picture or "", force))
        application.quit()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda caught, _: signals.append(caught))
    timer = QtCore.QTimer()
    timer.timeout.connect(tick)
    timer.start(REDRAW)
    if picture:
        QtCore.QTimer.singleShot(int(1000 * after), take_picture)
    window.show()
    application.exec_()
    timer.stop()
    if failures:
        raise failures[0]
