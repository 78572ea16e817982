"""The part of the live plot that shows a discovery: activity, belief in effects, errors by flight."""

import html
import math
from dataclasses import dataclass
from typing import List, Sequence, Tuple

import PyQt5  # noqa: F401  before pyqtgraph, which uses the binding that it finds imported
import pyqtgraph as pg
from PyQt5 import QtCore, QtGui, QtWidgets

from ground.annotations import Message
from ground.discovery import story
from ground.reports import appearance, discovery_figures

HEIGHT = 250  # [pixels]
BAR = 15  # height of an effect [pixels]
NAME = 185  # width of the names of effects [pixels]
VALUE = 135  # width of a probability and its state [pixels]
MARGIN = 4  # [pixels]
COLORS = {  # as rviz has them
    story.PRESENT: appearance.GOOD,
    story.OPEN: appearance.MISSING,
    story.HIDDEN: appearance.LINES,
    story.SLIGHT: appearance.LESS,
    story.ABSENT: appearance.LESS,
}
SYMBOLS = ["o", "s", "d", "t1"]  # for models, as appearance.MARKS
PENS = {"solid": QtCore.Qt.SolidLine, "dash": QtCore.Qt.DashLine, "dot": QtCore.Qt.DotLine}
MIN_ERROR = 1e-6  # smallest error that is drawn [-]
MOST = 4  # models that are drawn: the given one, and the newest
AXIS = 62  # width of the vertical axis, as above in the window [pixels]


@dataclass(frozen=True)
class Bar:
    """The belief in an effect."""

    effect: str
    probability: float
    state: str


def bars(message: Message) -> List[Bar]:
    """The beliefs of a DiscoveryStatus: by state, then by probability."""
    found = map(Bar, message.belief_effects, message.beliefs, message.belief_states)
    places = {state: place for place, state in enumerate(discovery_figures.STATES)}
    return sorted(found, key=lambda b: (places.get(b.state, len(places)), -b.probability))


def errors(message: Message) -> List[Tuple[str, List[float]]]:
    """Models of a DiscoveryStatus and the error of each on every flight; NaN where it has none."""
    count = message.flights
    values = list(message.errors) + [math.nan] * (count * len(message.models))
    return [(m, values[i * count : (i + 1) * count]) for i, m in enumerate(message.models)]


def newest(found: Sequence[Tuple[str, List[float]]]) -> List[float]:
    """Error on every flight of the newest model that has one there; found: as `errors` gives it."""
    columns = zip(*(values for _, values in found))
    return [next((v for v in reversed(c) if math.isfinite(v)), math.nan) for c in columns]


def headline(message: Message) -> str:
    """What happens now, as rich text: activity, time of flight, verdict."""
    flight = ", flight %d (%s)" % (message.flight, message.purpose) if message.flight else ""
    line = "<b>discovery</b>%s: %.0f of %.0f s flown" % (flight, message.flown, message.budget)
    if message.verdict:
        line += ". Verdict: <b>%s</b> %s" % (message.verdict, html.escape(", ".join(message.effects)))
    if message.ended:
        sure = "sure" if message.sure else "not sure"
        line += ". Ended, %s: %s" % (sure, html.escape(message.reason))
    elif message.activity:
        line += ". Now: %s" % html.escape(message.activity)
    return line


class Beliefs(QtWidgets.QWidget):
    """A bar for each effect, as many as there is room for."""

    def __init__(self) -> None:
        super().__init__()
        self._bars: Sequence[Bar] = ()
        self.setMinimumWidth(NAME + VALUE + 80)

    def draw(self, found: Sequence[Bar]) -> None:
        """Shows other bars."""
        self._bars = found
        self.update()

    def paintEvent(self, _: QtGui.QPaintEvent) -> None:
        """Paints names, bars, and probabilities with their states."""
        painter = QtGui.QPainter(self)
        painter.fillRect(self.rect(), QtCore.Qt.white)
        fits = max(1, self.height() // BAR)
        shown = self._bars if len(self._bars) <= fits else self._bars[: fits - 1]
        for row, bar in enumerate(shown):
            self._paint(painter, row * BAR, bar)
        rest = self._bars[len(shown) :]
        if rest:
            painter.setPen(QtGui.QColor(appearance.LESS))
            most = max(bar.probability for bar in rest)
            text = "%d more, at most %.0f%% each" % (len(rest), 100 * most)
            painter.drawText(self._line(len(shown) * BAR), QtCore.Qt.AlignVCenter, text)
        painter.end()

    def _line(self, top: int) -> QtCore.QRect:
        return QtCore.QRect(MARGIN, top, self.width() - 2 * MARGIN, BAR)

    def _paint(self, painter: QtGui.QPainter, top: int, bar: Bar) -> None:
        painter.setPen(QtCore.Qt.black)
        name = QtCore.QRect(MARGIN, top, NAME - 2 * MARGIN, BAR)
        painter.drawText(name, QtCore.Qt.AlignRight | QtCore.Qt.AlignVCenter, bar.effect)
        whole = self.width() - NAME - VALUE
        width = round(whole * min(max(bar.probability, 0.0), 1.0))
        painter.fillRect(NAME, top + 2, whole, BAR - 4, QtGui.QColor(appearance.FAINT))
        color = QtGui.QColor(COLORS.get(bar.state, appearance.LESS))
        painter.fillRect(NAME, top + 2, width, BAR - 4, color)
        value = QtCore.QRect(NAME + whole + MARGIN, top, VALUE - MARGIN, BAR)
        is_slight = bar.state == story.SLIGHT
        text = bar.state if is_slight else "%.0f%% %s" % (100 * bar.probability, bar.state)
        painter.drawText(value, QtCore.Qt.AlignVCenter, text)


class DiscoveryPanel(QtWidgets.QWidget):
    """Activity, beliefs and errors of the newest DiscoveryStatus."""

    def __init__(self) -> None:
        super().__init__()
        self.setFixedHeight(HEIGHT)
        self.line = QtWidgets.QLabel()
        self.line.setTextFormat(QtCore.Qt.RichText)
        # A long activity is cut off; it does not widen the window.
        self.line.setSizePolicy(QtWidgets.QSizePolicy.Ignored, QtWidgets.QSizePolicy.Fixed)
        self.beliefs = Beliefs()
        self.legend = QtWidgets.QLabel()
        self.legend.setTextFormat(QtCore.Qt.RichText)
        self.legend.setSizePolicy(QtWidgets.QSizePolicy.Ignored, QtWidgets.QSizePolicy.Fixed)
        view = pg.GraphicsLayoutWidget()
        self.chart = view.addPlot(viewBox=pg.ViewBox(enableMouse=False, enableMenu=False))
        self.chart.hideButtons()
        self.chart.setMenuEnabled(False)
        self.chart.setLogMode(y=True)
        self.chart.showGrid(x=False, y=True, alpha=0.2)
        self.chart.setLabel("left", "error [-]")
        self.chart.getAxis("left").setWidth(AXIS)
        self.chart.setLabel("bottom", "flight")
        self._arrange(view)

    def _arrange(self, view: pg.GraphicsLayoutWidget) -> None:
        column = QtWidgets.QVBoxLayout(self)
        column.setContentsMargins(0, 2, 0, 0)
        column.setSpacing(2)
        column.addWidget(self.line)
        halves = QtWidgets.QHBoxLayout()
        column.addLayout(halves, 1)
        title = QtWidgets.QLabel("<b>belief in each effect</b>")
        for head, below in ((self.legend, view), (title, self.beliefs)):
            part = QtWidgets.QVBoxLayout()
            part.setSpacing(2)
            part.addWidget(head)
            part.addWidget(below, 1)
            halves.addLayout(part, 1)

    def draw(self, message: Message) -> None:
        """Shows a DiscoveryStatus."""
        self.line.setText(headline(message))
        self.beliefs.draw(bars(message))
        self.chart.clear()
        words = ["<b>error of each model by flight</b>"]
        found = errors(message)
        self._draw_newest(newest(found))
        for count, (label, values) in enumerate(found[:1] + found[1:][1 - MOST :]):
            if self._draw_model(count, values):
                color = appearance.model_color(count)
                mark = '<span style="color: %s">&#9644; %s</span>'
                words.append(mark % (color, html.escape(label)))
        if self._draw_floors(list(message.floors)):
            words.append('<span style="color: %s">&#9644; floor</span>' % appearance.FLOOR)
        self.legend.setText(" &nbsp; ".join(words))
        numbers = range(1, message.flights + 1)
        self.chart.getAxis("bottom").setTicks([[(n, str(n)) for n in numbers]])
        self.chart.setXRange(0.5, max(1, message.flights) + 0.5, padding=0)
        self._scale([v for v in [*message.errors, *message.floors] if math.isfinite(v)])

    def _scale(self, values: Sequence[float]) -> None:
        """Fits the logarithmic axis to errors."""
        low = 0.75 * max(min(values, default=1.0), MIN_ERROR)
        high = max(1.3 * max(values, default=1.0), 2 * low)
        self.chart.setYRange(math.log10(low), math.log10(high), padding=0)
        ticks = discovery_figures.log_ticks(low, high)
        self.chart.getAxis("left").setTicks([[(math.log10(t), "%g" % t) for t in ticks]])

    def _draw_newest(self, values: Sequence[float]) -> None:
        """Draws how the error falls from flight to flight, behind the models."""
        pairs = [(n, max(v, MIN_ERROR)) for n, v in enumerate(values, 1) if math.isfinite(v)]
        if pairs:
            at, heights = zip(*pairs)
            self.chart.plot(list(at), list(heights), pen=pg.mkPen(appearance.LINES, width=9))

    def _draw_model(self, count: int, values: Sequence[float]) -> bool:
        """Draws the errors of a model; whether there are any."""
        pairs = [(n, max(v, MIN_ERROR)) for n, v in enumerate(values, 1) if math.isfinite(v)]
        if not pairs:
            return False
        look = appearance.model_line(count, 1.5)
        style = PENS.get(look["dash"], QtCore.Qt.DashDotLine)
        at, heights = zip(*pairs)
        self.chart.plot(
            list(at),
            list(heights),
            pen=pg.mkPen(look["color"], width=look["width"], style=style),
            symbol=SYMBOLS[count % len(SYMBOLS)],
            symbolSize=7,
            symbolBrush=look["color"],
            symbolPen=None,
        )
        return True

    def _draw_floors(self, floors: Sequence[float]) -> bool:
        """Draws a level at each flight that has one; whether there are any."""
        known = [(n, floor) for n, floor in enumerate(floors, 1) if floor > 0]
        pen = pg.mkPen(appearance.FLOOR, width=2, style=QtCore.Qt.DotLine)
        for number, floor in known:
            self.chart.plot([number - 0.4, number + 0.4], [floor, floor], pen=pen)
        return bool(known)
