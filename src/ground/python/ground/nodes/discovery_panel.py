"""The part of the live plot that shows a discovery: activity, belief in effects, errors by flight."""

import html
import math
from typing import Optional

import numpy as np
import PyQt5  # noqa: F401  before pyqtgraph, which uses the binding that it finds imported
import pyqtgraph as pg
from PyQt5 import QtWidgets

from ground.annotations import Message
from ground.discovery import story
from ground.reports import appearance, discovery_figures

HEIGHT = 280  # [pixels]
ROWS = 12  # effects that are shown
COLORS = {  # as rviz has them
    story.PRESENT: appearance.GOOD,
    story.OPEN: appearance.MISSING,
    story.HIDDEN: appearance.LINES,
    story.SLIGHT: appearance.LESS,
    story.ABSENT: appearance.LESS,
}


def headline(message: Message) -> str:
    """What happens now, as rich text: activity, time of flight, verdict."""
    flight = ", flight %d (%s)" % (message.flight, message.purpose) if message.flight else ""
    line = "<b>discovery</b>%s: %.0f of %.0f s flown" % (flight, message.flown, message.budget)
    if message.verdict:
        line += ". Verdict: <b>%s</b> %s" % (message.verdict, html.escape(", ".join(message.effects)))
    if message.ended:
        sure = "sure" if message.sure else "not sure"
        return line + ". Ended, %s: %s" % (sure, html.escape(message.reason))
    return line + (". Now: %s" % html.escape(message.activity) if message.activity else "")


class DiscoveryPanel(QtWidgets.QWidget):
    """Activity, errors and beliefs of the newest DiscoveryStatus."""

    def __init__(self) -> None:
        super().__init__()
        self.setFixedHeight(HEIGHT)
        column = QtWidgets.QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        self.line = QtWidgets.QLabel()
        # A long activity is cut off; it does not widen the window.
        self.line.setSizePolicy(QtWidgets.QSizePolicy.Ignored, QtWidgets.QSizePolicy.Fixed)
        column.addWidget(self.line)
        view = pg.GraphicsLayoutWidget()
        column.addWidget(view, 1)
        self.errors, self.beliefs = view.addPlot(), view.addPlot()
        self.errors.setLogMode(y=True)
        self.errors.setLabel("left", "error [-]")
        self.errors.setLabel("bottom", "flight")
        self.errors.showGrid(y=True, alpha=0.15)
        self.beliefs.setTitle("<b>probability that each effect acts and matters</b>", size="9pt")
        self.beliefs.setXRange(0, 1)
        self.beliefs.setYRange(-ROWS, 0)
        self._shown: Optional[Message] = None
        for plot in (self.errors, self.beliefs):
            plot.hideButtons()
            plot.setMenuEnabled(False)
            plot.setMouseEnabled(False, False)

    def draw(self, message: Message) -> None:
        """Shows a DiscoveryStatus."""
        if message is self._shown:
            return
        self._shown = message
        self.line.setText(headline(message))
        flights = np.arange(1, message.flights + 1)
        self.errors.clear()
        errors = np.array(message.errors).reshape(len(message.models), message.flights)
        rows = [(model, appearance.model_color(i), 1.5) for i, model in enumerate(message.models)]
        rows.append(("floor", appearance.FLOOR, 3.0))
        words = ["<b>error of each model by flight</b>"]
        for (name, color, width), values in zip(rows, [*errors, np.array(message.floors)]):
            values = np.where(values > 0, values, math.nan)
            if np.isfinite(values).any():
                pen = pg.mkPen(color, width=width)
                self.errors.plot(flights, values, pen=pen, symbol="o", symbolSize=7, symbolBrush=color)
                words.append('<span style="color: %s">&#9644; %s</span>' % (color, name))
        self.errors.setTitle(" &nbsp; ".join(words), size="9pt")
        known = [v for v in [*message.errors, *message.floors] if v > 0]
        low, high = 0.8 * min(known, default=1.0), 1.25 * max(known, default=1.0)
        ticks = discovery_figures.log_ticks(low, high)
        self.errors.setYRange(math.log10(low), math.log10(high), padding=0)
        self.errors.getAxis("left").setTicks([[(math.log10(t), "%g" % t) for t in ticks]])
        self.errors.getAxis("bottom").setTicks([[(n, str(n)) for n in flights]])
        self._draw_beliefs(message)

    def _draw_beliefs(self, message: Message) -> None:
        """Draws a bar for each of the most probable effects."""
        beliefs = sorted(zip(message.beliefs, message.belief_effects, message.belief_states))
        shown = beliefs[: -ROWS - 1 : -1]
        self.beliefs.clear()
        rows = [-0.5 - row for row in range(len(shown))]
        colors = [COLORS.get(state, appearance.LESS) for *_, state in shown]
        bars = [probability for probability, *_ in shown]
        zero = np.zeros(len(shown))
        self.beliefs.addItem(
            pg.BarGraphItem(x0=zero, y=rows, width=bars, height=0.7, brushes=colors, pens=colors)
        )
        names = ["%s, %s: %.0f%%" % (effect, state, 100 * p) for p, effect, state in shown]
        self.beliefs.getAxis("left").setTicks([list(zip(rows, names))])
        rest = len(beliefs) - len(shown)
        self.beliefs.setLabel("bottom", "%d more are less probable" % rest if rest else "")
