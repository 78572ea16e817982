"""Panels in rows and columns, as the dictionaries of which plotly documents the keys.

plotly's own classes check every attribute whenever it is set: with them and make_subplots, the page of a
diagnosis of four runs took 17 s longer. So figures are dictionaries, which
plotly.graph_objects.Figure takes as they are; tests check them so.
"""

import functools
import itertools
import math
from typing import Any, Dict, List, Mapping, Sequence, Tuple, Union

from plotly import io

from ground.reports.appearance import LINES, TEXT
from ground.support.annotations import Plotly

MARGIN = 50  # above the panels [pixels]
ICONS = 30  # height of plotly's icons, which are at the top of a figure [pixels]
# Of a legend, about: height of a row, width of an entry and of each letter, and of the narrowest one [pixels]
ROW, ENTRY, LETTER, NARROWEST = 30, 45, 6.5, 860


class Panels:
    """Panels, counted from 1, with traces, notes and shapes in them."""

    def __init__(
        self,
        rows: int = 1,
        cols: int = 1,
        widths: Sequence[float] = (),
        heights: Sequence[float] = (),
        gaps: Tuple[float, float] = (0.0, 0.0),
        tall: Sequence[int] = (),
        shared: str = "",
        titles: Sequence[str] = (),
    ) -> None:
        """widths, heights: relative sizes of columns and rows; gaps: between columns and between rows, as
        shares of the whole; tall: columns that are one panel; shared: "x" if a column has one x axis,
        "xy" if a row has one y axis as well; titles: of the panels."""
        self.data: List[Plotly] = []
        self.annotations: List[Plotly] = []
        self.shapes: List[Plotly] = []
        self.axes: Dict[str, Plotly] = {}
        self._numbers: Dict[Tuple[int, int], str] = {}
        across = _shares(widths or [1.0] * cols, gaps[0])
        down = _shares(heights or [1.0] * rows, gaps[1])
        for row, col in itertools.product(range(1, rows + 1), range(1, cols + 1)):
            if row == 1 or col not in tall:
                number = str(len(self._numbers) + 1) if self._numbers else ""
                self._numbers[row, col] = number
                last = rows if col in tall else row
                ends = [1 - down[last - 1][1], 1 - down[row - 1][0]]
                self.axes["xaxis" + number] = {"anchor": "y" + number, "domain": across[col - 1]}
                self.axes["yaxis" + number] = {"anchor": "x" + number, "domain": ends}
        for row, col in self._numbers:
            if "x" in shared and row < rows and col not in tall:
                self.update_xaxes(row, col, matches="x" + self._numbers[rows, col], showticklabels=False)
            if "y" in shared and col > 1:
                self.update_yaxes(row, col, matches="y" + self._numbers[row, 1], showticklabels=False)
        for title, (row, col) in zip(titles, self._numbers):
            self.note(title, 0.5, 1, row, col, yanchor="bottom", font={"size": 12})

    def add(self, trace: Plotly, row: int = 1, col: int = 1) -> None:
        """Adds a trace to a panel."""
        number = self._numbers[row, col]
        self.data.append({**trace, "xaxis": "x" + number, "yaxis": "y" + number})

    def update_xaxes(self, row: int = 0, col: int = 0, **properties: Any) -> None:
        """Sets properties of the x axes of a panel, a row (col 0), a column (row 0) or of all."""
        self._update("xaxis", row, col, properties)

    def update_yaxes(self, row: int = 0, col: int = 0, **properties: Any) -> None:
        """Sets properties of y axes likewise."""
        self._update("yaxis", row, col, properties)

    def note(
        self, text: str, x: Any, y: Any, row: int = 1, col: int = 1, inside: bool = True, **style: Any
    ) -> None:
        """Adds a text. inside: x and y are shares of the panel, not values of its axes."""
        end = " domain" * inside
        place: Plotly = {"x": x, "y": y, "xref": self.axis("x", col, row) + end}
        place.update(yref=self.axis("y", col, row) + end, text=text, showarrow=False)
        self.annotations.append({**place, **style})

    def span(
        self, start: Union[float, str], end: Union[float, str], row: int = 1, col: int = 1, **style: Any
    ) -> None:
        """Adds a rectangle, or a line if start is end, from one value of x to another, such as a date."""
        place: Plotly = {"x0": start, "x1": end, "y0": 0, "y1": 1, "xref": self.axis("x", col, row)}
        place.update(yref=self.axis("y", col, row) + " domain", line={"width": 0})
        kind = "line" if start == end else "rect"
        self.shapes.append({"type": kind, **place, **style})

    def finish(
        self,
        height: int,
        caption: str,
        margin: Mapping[str, int] = {},
        legend_y: float = 1.02,
        title: str = "",
        **more: object,
    ) -> Plotly:
        """The figure with its height [pixels], its caption and its title (in layout.meta), margins and
        legend, which is below the icons of plotly."""
        entries = {str(trace["name"]) for trace in self.data if trace.get("showlegend")}
        if entries:
            rows = math.ceil(sum(ENTRY + LETTER * len(name) for name in entries) / NARROWEST)
            added = ICONS + ROW * (rows - 1)
            height += added
            margin = {**margin, "t": margin.get("t", MARGIN) + added}
        layout = {
            "annotations": self.annotations,
            "shapes": self.shapes,
            **self.axes,
            **more,
            "template": _template(),
            "height": height,
            "meta": {"caption": caption, "title": title},
            "margin": {"t": MARGIN, "b": 50, "l": 70, "r": 10, **margin},
            "legend": {"orientation": "h", "y": legend_y, "yanchor": "bottom", "x": 0},
        }
        return {"data": self.data, "layout": layout}

    def axis(self, name: str, col: int, row: int = 1) -> str:
        """The name of an axis, "x" or "y", of a panel."""
        return name + self._numbers[row, col]

    def _update(self, name: str, row: int, col: int, properties: Plotly) -> None:
        if isinstance(properties.get("title"), str):
            properties["title"] = {"text": properties["title"]}
        for (its_row, its_col), number in self._numbers.items():
            if row in (0, its_row) and col in (0, its_col):
                self.axes[name + number].update(properties)


def _shares(sizes: Sequence[float], gap: float) -> List[Tuple[float, float]]:
    """Where each part begins and ends when parts of such sizes, with gaps between, fill 0..1."""
    scale = (1 - gap * (len(sizes) - 1)) / sum(sizes)
    starts = [scale * sum(sizes[:i]) + gap * i for i in range(len(sizes))]
    return [(start, start + scale * size) for start, size in zip(starts, sizes)]


@functools.lru_cache(maxsize=None)
def _template() -> Plotly:
    """plotly's white template with the package's font, and short ticks, which keep the labels of both axes
    apart in the corner between them."""
    template = io.templates["plotly_white"].to_plotly_json()
    template["layout"]["font"] = {"family": "system-ui, sans-serif", "size": 12, "color": TEXT}
    for axis in ("xaxis", "yaxis"):
        ticks = {"ticks": "outside", "ticklen": 4, "tickcolor": LINES}
        given = template["layout"][axis]
        given.update(ticks, title={**given.get("title", {}), "font": {"size": 11}})
    found: Plotly = template
    return found
