"""A window that shows a running experiment: model beside measurement, inputs, errors, missing wrench."""

import html
import math
import os
import signal
import sys
import time
from typing import Dict, List, Optional, Tuple

import numpy as np
import PyQt5  # noqa: F401  before pyqtgraph, which uses the binding that it finds imported
import pyqtgraph as pg
import rospy
from PyQt5 import QtCore, QtGui, QtWidgets

from ground.nodes.live_feed import EXPECTED, MODELS, STATUSES, TOPICS, Feed, smoothed, tracking_error
from ground.nodes.live_panels import COLUMNS, PALE, TRACKING, Panel, PlottedCurve
from ground.reports import appearance
from ground.support import files
from ground.support.annotations import Array, Message
from ground.support.errors import GroundError

REDRAW = 0.05  # period [s]
SIZE = (1200, 900)  # width and height when the window opens [pixels]
SILENCE = 3.0  # silence of a node or of all topics after which the window reports it [s]
WIDEST = 2.5  # an axis this many times longer than its curves need is shortened
LONGEST_NAME = 16  # characters; longer names of models are cut off in titles
NOTE, BAD = appearance.LESS, appearance.WARNING
SMOOTH = 0.15  # reach of the smoothed line's weights [s]
# Begins of messages of Qt that tell a user nothing
QT_NOISE = ("QStandardPaths: XDG_RUNTIME_DIR not set", "This plugin does not support")
PAUSED = "<b>Paused.</b> Space goes on."
SIZES = ("error", "noise")
HELP = (
    "Space pauses; the mouse shows values, its wheel zooms and dragging moves; Home shows all.<br>Normal: "
    "predictions lie on the measured curve, errors near the noise floor, missing forces between its lines; "
    "what is wanted is sent."
)
STATUS_COLORS = {
    **dict.fromkeys(["RUNNING", "ARMED"], appearance.GOOD),
    **dict.fromkeys(["WAITING", "LIFTING", "RECOVERING"], appearance.BUSY),
    **dict.fromkeys(["STOPPED", "FAULT"], BAD),
}


class ValueAxis(pg.AxisItem):  # type: ignore[misc]
    """An axis with two labelled values or more, however low its diagram is."""

    def tickSpacing(self, minVal: float, maxVal: float, size: float) -> List[Tuple[float, float]]:
        """Spacing and offset of the ticks of one level, in the axis's units."""
        half = (maxVal - minVal) / 2
        decade = 10.0 ** math.floor(math.log10(half)) if half > 0 else 1.0
        return [(max(n for n in (1, 2, 5) if n * decade <= half or n == 1) * decade, 0.0)]


class Diagram:
    """A drawn Panel."""

    def __init__(self, panel: Panel, plot: pg.PlotItem, duration: float, bottom: bool) -> None:
        """duration: length of the time axis [s]. bottom: whether the time axis is labelled."""
        self.panel, self.plot, self._duration = panel, plot, duration
        plot.hideButtons()
        plot.setMenuEnabled(False)
        plot.showGrid(x=True, y=True, alpha=0.15)
        plot.setLabel("left", panel.axis)
        left, below = plot.getAxis("left"), plot.getAxis("bottom")
        left.setWidth(62)
        below.setStyle(showValues=bottom)
        if bottom:
            plot.setLabel("bottom", "time before the newest message [s]")
        for axis in (left, below):
            axis.enableAutoSIPrefix(False)
        self._lines = [(self._raw(curve), self._line(curve.color, curve.width)) for curve in panel.curves]
        self.cursor = pg.InfiniteLine(angle=90, pen=NOTE)
        self.cursor.hide()
        plot.addItem(self.cursor, ignoreBounds=True)
        self.title = ""
        self.axis = (0.0, 0.0)  # range that it shows
        self.home()

    def _line(self, color: str, width: float) -> pg.PlotDataItem:
        pen = pg.mkPen(color, width=width)
        return self.plot.plot(pen=pen, connect="finite", autoDownsample=True, downsampleMethod="peak")

    def _raw(self, curve: PlottedCurve) -> Optional[pg.PlotDataItem]:
        return self._line(curve.color + PALE, 1.0) if curve.smooth else None

    def home(self) -> None:
        """Shows the whole time, and all values at the next draw()."""
        self.plot.setXRange(-self._duration, 0.0, padding=0.025)
        self.axis = (0.0, 0.0)

    def draw(self, now: float, samples: Dict[str, Array], names: Dict[str, str]) -> None:
        """now: the newest stamp [s]. names: of the models, by topic."""
        words = ["<b>%s</b>" % self.panel.title.format(model=names.get(MODELS[0], "the model"))]
        low, high = self.panel.shown
        for curve, (raw, line) in zip(self.panel.curves, self._lines):
            row = 1 if curve.topic == TRACKING else 1 + TOPICS[curve.topic][1].index(curve.field)
            times, values = samples[curve.topic][0], samples[curve.topic][row]
            values = self.panel.scale * curve.factor * values
            if raw is not None:
                raw.setData(times - now, values)
                values = smoothed(times, values, SMOOTH)
            line.setData(times - now, values)
            known = values[np.isfinite(values)]
            if curve.fitted:
                low, high = min(low, known.min(initial=low)), max(high, known.max(initial=high))
            label = curve.label.format(model=names.get(curve.topic, ""))
            if len(times) and label:
                label += self._value(times - now, values)
                words.append(colored("&#9644; " + label, curve.color))
        title = " &nbsp; ".join(words)
        if title != self.title:
            self.plot.setTitle(title, size="9pt", justify="left")
            self.title = title
        self._fit(low, high)

    def _value(self, times: Array, values: Array) -> str:
        """The value at the cursor."""
        if not self.cursor.isVisible():
            return ""
        found = values[np.abs(times - self.cursor.value()).argmin()]
        return " <b>%.3g</b>" % found if math.isfinite(found) else " -"

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
        self.resize(*_size())
        column = QtWidgets.QVBoxLayout(self)
        column.setSpacing(1)
        self.lines = [QtWidgets.QLabel() for _ in range(4)]
        help = QtWidgets.QLabel(colored(HELP, NOTE))
        for line in [*self.lines, help]:
            # A long reason is cut off; it does not widen the window.
            line.setSizePolicy(QtWidgets.QSizePolicy.Ignored, QtWidgets.QSizePolicy.Fixed)
        for line in self.lines:
            column.addWidget(line)
        view = pg.GraphicsLayoutWidget()
        self.diagrams = [
            Diagram(
                panel,
                view.addPlot(j, i, axisItems={"left": ValueAxis("left")}),
                feed.duration,
                panel is panels[-1],
            )
            for i, panels in enumerate(COLUMNS)
            for j, panel in enumerate(panels)
        ]
        for i in range(len(COLUMNS)):
            view.ci.layout.setColumnPreferredWidth(i, self.width() / len(COLUMNS))
        for diagram in self.diagrams[1:]:
            diagram.plot.setXLink(self.diagrams[0].plot)
        view.scene().sigMouseMoved.connect(self._point)
        column.addWidget(view, 1)
        column.addWidget(help)
        self.paused = False
        self._drawn = math.nan  # newest stamp of the curves [s]
        self._shown: Tuple[float, Dict[str, Array], Dict[str, str]] = (math.nan, {}, {})

    def redraw(self) -> None:
        """Draws the newest messages; while it is paused, only their statuses."""
        feed = self._feed
        now, samples = feed.samples()
        texts = [status_line(topic, feed) for topic in STATUSES] + [models_line(feed)]
        texts.append(PAUSED if self.paused else data_line(now, samples, feed))
        for line, text in zip(self.lines, texts):
            line.setText(text)
        if now != self._drawn and not self.paused:
            self._drawn = now
            samples[TRACKING] = tracking_error(samples["state"], samples["reference"])
            names = {topic: html.escape(short(m.model)) for topic, m in list(feed.models.items())}
            self._shown = now, samples, names
            self._draw()

    def _draw(self) -> None:
        now, samples, names = self._shown
        for diagram in self.diagrams if samples else ():
            diagram.draw(now, samples, names)

    def _point(self, position: QtCore.QPointF) -> None:
        """Shows the values at the time under the mouse."""
        under = [d for d in self.diagrams if d.plot.vb.sceneBoundingRect().contains(position)]
        for diagram in self.diagrams:
            diagram.cursor.setVisible(bool(under))
            if under:
                diagram.cursor.setValue(under[0].plot.vb.mapSceneToView(position).x())
        self._draw()

    def keyPressEvent(self, event: QtGui.QKeyEvent) -> None:
        """Space pauses, Home shows all."""
        if event.key() == QtCore.Qt.Key_Space:
            self.paused = not self.paused
            self.redraw()
        elif event.key() == QtCore.Qt.Key_Home:
            for diagram in self.diagrams:
                diagram.home()
            self._draw()
        else:
            super().keyPressEvent(event)

    def save(self, path: str, force: bool = False) -> None:
        """Writes a PNG of the window; GroundError when that is not possible."""
        self.redraw()
        with files.new_file(path, force) as temporary:
            if not self.grab().save(temporary, "PNG"):
                raise GroundError("%s: the picture cannot be written" % path)


def _size() -> Tuple[int, int]:
    """Width and height of a new window [pixels]: not larger than the screen, if there is one."""
    if QtGui.QGuiApplication.platformName() == "offscreen":
        return SIZE
    screen = QtWidgets.QApplication.primaryScreen().availableGeometry()
    return min(SIZE[0], screen.width()), min(SIZE[1], screen.height())


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


def models_line(feed: Feed) -> str:
    """How far each model is off, as rich text."""
    texts = []
    for i, topic in enumerate(MODELS):
        if topic in feed.models:
            texts.append(colored(html.escape(off_in_words(feed.models[topic])), appearance.model_color(i)))
    return " &nbsp; ".join(texts)


def off_in_words(error: Message) -> str:
    """How far a model is off, and since when it has failed, by its ModelError."""
    name = short(error.model)
    if error.failure:
        name = "%s %s" % (name, error.failure)
    if not error.excited:
        return "%s: no excitation, the craft hardly moves" % name
    sizes = [_pose(getattr(error, "position_" + what), getattr(error, "heading_" + what)) for what in SIZES]
    return "%s: %s after %.2g s (noise floor: %s)" % (name, sizes[0], error.horizon, sizes[1])


def _pose(position: float, heading: float) -> str:
    """A distance [m] and an angle [rad] in words."""
    numbers = (1e3 * position, math.degrees(heading))
    return "%s mm, %s deg" % tuple("%.*f" % (0 if x >= 9.95 else 1, x) for x in numbers)


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
    lift = samples["controls"][1 + TOPICS["controls"][1].index("lift"), -1]
    horizon = feed.models[MODELS[0]].horizon
    text = "Newest message: %.0f s. Predictions are %.2g s ahead. Lift fan: %.2g." % (now, horizon, lift)
    return colored(text, NOTE)


def check_display() -> None:
    """Raises GroundError if there is no display; Qt itself would abort this process."""
    if os.environ.get("QT_QPA_PLATFORM") == "offscreen":
        return
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise GroundError(
            "DISPLAY is not set: start it on a desktop or through ssh -X, or, for a picture only, as "
            "QT_QPA_PLATFORM=offscreen rosrun ground plot --picture FILE.png"
        )


def _qt_said(kind: object, where: object, text: str) -> None:
    """Prints a message of Qt as Qt does, unless it is noise."""
    if not text.startswith(QT_NOISE):
        print(text, file=sys.stderr)


def show(feed: Feed, picture: str = "", after: float = 0.0, force: bool = False) -> None:
    """Shows a feed until the window is closed or a signal ends it.

    picture: PNG file that is written `after` [s], whereupon the window closes. force: overwrites it.
    """
    QtCore.qInstallMessageHandler(_qt_said)
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
            print("written to %s" % picture, flush=True)
            return
        time.sleep(REDRAW)
