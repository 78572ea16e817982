"""A window that shows a running experiment: model beside measurement, inputs, errors, missing wrench."""

import html
import math
import os
import signal
import time
from dataclasses import dataclass
from typing import Dict, List, Sequence, Tuple

import numpy as np
import PyQt5  # noqa: F401  before pyqtgraph, which uses the binding that it finds imported
import pyqtgraph as pg
import rospy
from PyQt5 import QtWidgets

from ground.nodes.live_feed import EXPECTED, MODELS, STATUSES, TOPICS, Feed, tracking_error
from ground.reports import appearance
from ground.support import files
from ground.support.annotations import Array
from ground.support.errors import GroundError

REDRAW = 0.05  # period [s]
SIZE = (1200, 900)  # width and height when the window opens [pixels]
SILENCE = 3.0  # silence of a node or of all topics after which the window says so [s]
WIDEST = 2.5  # an axis this many times longer than its curves need is shortened
LONGEST_NAME = 16  # characters; longer names of models are cut off in titles
NOTE, BAD = appearance.LESS, appearance.WARNING
WANTED = "#a8a8a8"
TRACKING = "tracking error"  # computed from state and reference
STATUS_COLORS = {
    **dict.fromkeys(["RUNNING", "ARMED"], appearance.GOOD),
    **dict.fromkeys(["WAITING", "LIFTING", "RECOVERING"], appearance.BUSY),
    **dict.fromkeys(["STOPPED", "FAULT"], BAD),
}


@dataclass(frozen=True)
class Curve:
    """A field of a topic, or the tracking error."""

    topic: str
    field: str
    label: str  # {model} stands for the name of the model file
    color: str


@dataclass(frozen=True)
class Panel:
    """A diagram; its curves share an axis. Later curves are drawn over earlier ones."""

    title: str
    axis: str  # quantity and unit
    curves: Sequence[Curve]
    shown: Tuple[float, float] = (0.0, 0.0)  # what the axis always shows, in its unit
    scale: float = 1.0  # from the messages' unit to the axis's
    least: float = 0.0  # smallest span of the axis, in its unit


def _by_models(field: str, *labels: str) -> List[Curve]:
    return [
        Curve(topic, field, label, appearance.model_color(i))
        for i, (topic, label) in enumerate(zip(MODELS, labels))
    ]


def _velocity(index: int, least: float) -> Panel:
    _, name, unit = appearance.CHANNELS[index]
    field = "nu[%d]" % index
    curves = [Curve("state", field, "measured", appearance.MEASURED)]
    curves += _by_models(field, "predicted by {model}", "by {model}")
    shown = (math.inf, -math.inf)
    return Panel(name, "%s [%s]" % (name.split()[-1], unit), curves, shown, least=least)


def _input(field: str, title: str, color: str) -> Panel:
    curves = [
        Curve("controls/wanted", field, "wanted by the controller", WANTED),
        Curve("controls", field, "sent", color),
    ]
    return Panel(title, "input [0..1]", curves, (0.0, 1.0))


def _missing(title: str, axis: str, most: float, *curves: Curve) -> Panel:
    return Panel(title + " missing in {model}", axis, curves, (-most, most), 1e3)


_ERRORS = _by_models("error", "{model}", "{model}")
_DISTANCE = [Curve(TRACKING, "", "", appearance.MEASURED)]
COLUMNS = [
    [
        _velocity(0, 0.1),
        _velocity(1, 0.1),
        _velocity(2, 0.5),
        Panel("model error, sum of u, v, r", "|error| / spread", _ERRORS, (0.0, 1.0)),
        Panel("distance from the reference", "distance [mm]", _DISTANCE, (0.0, 5.0), 1e3),
    ],
    [
        _input("left", "left thruster", appearance.THRUSTERS[0]),
        _input("right", "right thruster", appearance.THRUSTERS[1]),
        _input("lift", "lift fan", appearance.MEASURED),
        _missing(
            "force", "force [mN]", 2.0,
            Curve("model_error", "wrench[0]", "ahead X", appearance.MISSING),
            Curve("model_error", "wrench[1]", "to starboard Y", appearance.REFERENCE),
        ),
        _missing(
            "moment", "moment [mN m]", 0.1,
            Curve("model_error", "wrench[2]", "clockwise N", appearance.MISSING),
        ),
    ],
]  # fmt: skip


class Diagram:
    """A drawn Panel."""

    def __init__(self, panel: Panel, plot: pg.PlotItem, duration: float, bottom: bool) -> None:
        """duration: length of the time axis [s]. bottom: whether the time axis is labelled."""
        self.panel, self.plot = panel, plot
        plot.hideButtons()
        plot.setMenuEnabled(False)
        plot.showGrid(x=True, y=True, alpha=0.15)
        plot.setXRange(-duration, 0.0, padding=0.025)
        plot.setLabel("left", panel.axis)
        left, below = plot.getAxis("left"), plot.getAxis("bottom")
        left.setWidth(62)
        below.setStyle(showValues=bottom)
        if bottom:
            plot.setLabel("bottom", "time before the newest message [s]")
        for axis in (left, below):
            axis.enableAutoSIPrefix(False)
        self._lines = [
            plot.plot(pen=curve.color, connect="finite", autoDownsample=True, downsampleMethod="peak")
            for curve in panel.curves
        ]
        self.title = ""
        self.axis = (0.0, 0.0)  # range that it shows

    def draw(self, now: float, samples: Dict[str, Array], names: Dict[str, str]) -> None:
        """now: the newest stamp [s]. names: of the models, by topic."""
        words = ["<b>%s</b>" % self.panel.title.format(model=names.get(MODELS[0], "the model"))]
        low, high = self.panel.shown
        for curve, line in zip(self.panel.curves, self._lines):
            row = 1 if curve.topic == TRACKING else 1 + TOPICS[curve.topic][1].index(curve.field)
            times, values = samples[curve.topic][0], self.panel.scale * samples[curve.topic][row]
            line.setData(times - now, values)
            known = values[np.isfinite(values)]
            low, high = min(low, known.min(initial=low)), max(high, known.max(initial=high))
            label = curve.label.format(model=names.get(curve.topic, ""))
            if len(times) and label:
                words.append(colored("&#9644; " + label, curve.color))
        title = " &nbsp; ".join(words)
        if title != self.title:
            self.plot.setTitle(title, size="9pt", justify="left")
            self.title = title
        self._fit(low, high)

    def _fit(self, low: float, high: float) -> None:
        """Shows all values; the axis stays while it fits, because one that moves cannot be read."""
        if high < low:
            return
        span = max(high - low, self.panel.least)
        fits = self.axis[0] <= low and high <= self.axis[1]
        if not fits or self.axis[1] - self.axis[0] > WIDEST * span:
            middle, half = (low + high) / 2, 0.65 * span
            self.axis = (middle - half, middle + half)
            self.plot.setYRange(*self.axis, padding=0)


class LivePlot(QtWidgets.QWidget):
    """The window; it draws a feed."""

    def __init__(self, feed: Feed) -> None:
        super().__init__()
        self._feed = feed
        pg.setConfigOptions(antialias=False, background="w", foreground="k")
        font = QtWidgets.QApplication.font()
        font.setPointSize(9)
        QtWidgets.QApplication.setFont(font)  # axes take it, too
        self.setWindowTitle("ground: live plot")
        self.setStyleSheet("background: white; color: black")
        self.resize(*SIZE)
        column = QtWidgets.QVBoxLayout(self)
        column.setSpacing(1)
        self.lines = [QtWidgets.QLabel() for _ in range(3)]
        for line in self.lines:
            # A long reason is cut off; it does not widen the window.
            line.setSizePolicy(QtWidgets.QSizePolicy.Ignored, QtWidgets.QSizePolicy.Fixed)
            column.addWidget(line)
        view = pg.GraphicsLayoutWidget()
        self.diagrams = [
            Diagram(panel, view.addPlot(j, i), feed.duration, panel is panels[-1])
            for i, panels in enumerate(COLUMNS)
            for j, panel in enumerate(panels)
        ]
        for i in range(len(COLUMNS)):
            view.ci.layout.setColumnPreferredWidth(i, SIZE[0] / len(COLUMNS))
        column.addWidget(view, 1)
        self._drawn = math.nan  # newest stamp of the curves [s]

    def redraw(self) -> None:
        """Draws the newest messages."""
        feed = self._feed
        now, samples = feed.samples()
        texts = [status_line(topic, feed) for topic in STATUSES] + [data_line(now, samples, feed)]
        for line, text in zip(self.lines, texts):
            line.setText(text)
        if now != self._drawn:
            self._drawn = now
            samples[TRACKING] = tracking_error(samples["state"], samples["reference"])
            names = {topic: html.escape(short(m.model)) for topic, m in list(feed.models.items())}
            for diagram in self.diagrams:
                diagram.draw(now, samples, names)

    def save(self, path: str, force: bool = False) -> None:
        """Writes a PNG of the window; GroundError when that is not possible."""
        self.redraw()
        with files.new_file(path, force) as temporary:
            if not self.grab().save(temporary, "PNG"):
                raise GroundError("%s: the picture cannot be written" % path)


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
    kind = STATUSES[topic]
    states = {getattr(kind, name): name for name in dir(kind) if name.isupper()}
    state = states.get(message.state, "?")
    name = colored(state, STATUS_COLORS.get(state, NOTE))
    line = "<b>%s %s</b> %s" % (node, name, html.escape(message.reason))
    silent = time.monotonic() - received
    return line + (colored(" (no message for %.0f s)" % silent, BAD) if silent > SILENCE else "")


def data_line(now: float, samples: Dict[str, Array], feed: Feed) -> str:
    """What is missing, as rich text: topics or new messages; otherwise the time."""
    missing = [topic for topic in EXPECTED if not samples[topic].shape[1]]
    silent = time.monotonic() - feed.heard
    if math.isfinite(now) and silent > SILENCE:
        text = "No new message for %.0f s; the newest has stamp %.0f s." % (silent, now)
        return colored(text, appearance.BUSY)
    if missing:
        return colored("Waiting for messages on %s." % ", ".join(missing), appearance.BUSY)
    if feed.invalid:
        return colored("The state is invalid: %s" % html.escape(feed.invalid), BAD)
    horizon = feed.models[MODELS[0]].horizon
    return colored("Newest message: %.0f s. Predictions are %g s ahead." % (now, horizon), NOTE)


def check_display() -> None:
    """Raises GroundError if there is no display; Qt itself would abort this process."""
    if os.environ.get("QT_QPA_PLATFORM") == "offscreen":
        return
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise GroundError(
            "DISPLAY is not set: start it on a desktop or through ssh -X, or, for a picture only, as "
            "QT_QPA_PLATFORM=offscreen rosrun ground plot --picture FILE.png"
        )


def show(feed: Feed, picture: str = "", after: float = 0.0, force: bool = False) -> None:
    """Shows a feed until the window is closed or a signal ends it.

    picture: PNG file that is written `after` [s], whereupon the window closes. force: overwrites it.
    """
    # pg.mkQApp would make Qt scale everything by the screen's resolution, including curves.
    application = QtWidgets.QApplication.instance() or QtWidgets.QApplication(["plot"])
    window = LivePlot(feed)
    signals: List[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda caught, _: signals.append(caught))
    window.show()
    end = time.monotonic() + after
    while window.isVisible() and not signals and not rospy.is_shutdown():
        window.redraw()
        application.processEvents()
        if picture and time.monotonic() > end:
            window.save(picture, force)
            return
        time.sleep(REDRAW)
