"""Figures as plotly's JSON describes them, put together from plain dictionaries.

plotly's own classes check each attribute whenever it is set, which takes longer than all else in a report.
test_picture.py checks finished figures with them instead.
"""

import copy
import itertools
from dataclasses import dataclass
from typing import Any, Dict, List, Optional, Sequence, Tuple

from ground.annotations import Document

Specs = Sequence[Sequence[Optional[Document]]]
GAP = 100  # space between blocks of a narrow page, for ticks and titles [pixels]
SPACING = 0.03  # between the columns of a block, as a share of its width


@dataclass(frozen=True)
class Block:
    """Columns of a figure that stay side by side on a narrow page, below the block before them."""

    columns: Sequence[int]
    height: int  #: [pixels]
    room: float = 0.0  #: share of its width right of the columns, for a colour bar


class Figure:
    """Panels in rows and columns, both counted from 1, with traces, notes and shapes in them."""

    def __init__(
        self,
        rows: int = 1,
        cols: int = 1,
        specs: Optional[Specs] = None,
        row_heights: Optional[Sequence[float]] = None,
        column_widths: Optional[Sequence[float]] = None,
        vertical_spacing: float = 0.0,
        horizontal_spacing: float = 0.0,
        titles: Sequence[str] = (),
    ) -> None:
        """The arguments mean what they do in plotly.subplots.make_subplots; titles: of the panels."""
        self.data: List[Document] = []
        self.layout: Document = {}
        #: What a trace in a panel has: its xaxis and yaxis ("x2", "y2"), or the domain of a table.
        self._places: Dict[Tuple[int, int], Document] = {}
        across = _shares(column_widths or [1.0] * cols, horizontal_spacing)
        down = _shares(row_heights or [1.0] * rows, vertical_spacing)
        for row, col in itertools.product(range(rows), range(cols)):
            spec = specs[row][col] if specs else {}
            if spec is not None:
                right = across[col + spec.get("colspan", 1) - 1][1]
                bottom = 1 - down[row + spec.get("rowspan", 1) - 1][1]
                domain = {"x": [across[col][0], right], "y": [bottom, 1 - down[row][0]]}
                self._places[row + 1, col + 1] = self._place(domain, spec.get("type", "xy"))
        for title, (row, col) in zip(titles, self._places):
            note = {"text": title, "x": 0.5, "y": 1, "xanchor": "center", "yanchor": "bottom"}
            self.annotate(row, col, inside=True, font={"size": 12}, **note)

    def add(self, trace: Document, row: int = 1, col: int = 1) -> None:
        """Adds a trace, the dictionary of which plotly documents, to a panel."""
        self.data.append({**trace, **copy.deepcopy(self._places[row, col])})

    def update_xaxes(
        self, row: Optional[int] = None, col: Optional[int] = None, **properties: Any
    ) -> None:
        """Sets properties of the x axes in a row, in a column, in a panel, or of all: those of plotly's
        documentation, the title as its text. A value of None changes nothing."""
        self._update("xaxis", row, col, properties)

    def update_yaxes(
        self, row: Optional[int] = None, col: Optional[int] = None, **properties: Any
    ) -> None:
        """The same with the y axes."""
        self._update("yaxis", row, col, properties)

    def annotate(self, row: int, col: int, inside: bool = False, **note: Any) -> None:
        """Adds an annotation. inside: its x and y are shares of the panel, not values of the axes."""
        self._note(self._refs(row, col, inside, inside), note)

    def fill(self, row: int, col: int, color: str) -> None:
        """Gives a panel a background."""
        shape = {"x0": 0, "x1": 1, "y0": 0, "y1": 1, "fillcolor": color, "layer": "below"}
        self._shape(self._refs(row, col, True, True), dict(shape, type="rect", line={"width": 0}))

    def add_span(
        self, start: float, end: float, col: int, row: Optional[int] = None, **style: Any
    ) -> None:
        """Adds a rectangle from one value of x to another to a panel, or to each of a column."""
        for its_row, its_col in self._places:
            if its_col == col and row in (None, its_row):
                shape = {"type": "rect", "x0": start, "x1": end, "y0": 0, "y1": 1, **style}
                shape["line"] = {"width": 0}
                self._shape(self._refs(its_row, col, False, True), shape)

    def add_line(self, x: float, color: str, text: str) -> None:
        """Adds a dashed line at a value of x to the first panel, with a text above it."""
        refs = self._refs(1, 1, False, True)
        line = {"color": color, "dash": "dash", "width": 2}
        self._shape(refs, {"type": "line", "x0": x, "x1": x, "y0": 0, "y1": 1, "line": line})
        note = {"text": text, "x": x, "y": 1, "xanchor": "center", "yanchor": "bottom"}
        self._note(refs, dict(note, font={"color": color}))

    def narrow(self, blocks: Sequence[Block]) -> Document:
        """How to arrange the panels on a narrow page, as blocks one below the other: "layout", the
        properties of axes that differ and the "height" of the plotting area [pixels]; and "traces",
        those of traces, by their number."""
        total = sum(block.height for block in blocks) + GAP * (len(blocks) - 1)
        layout: Document = {"height": total}
        top = float(total)
        for block in blocks:
            whole = (top - block.height) / total, top / total
            across = self._across(block)
            for (row, col), place in self._places.items():
                if col in block.columns and "yaxis" in place:
                    down = [whole[0] + (whole[1] - whole[0]) * y for y in self.domain(row, col)]
                    layout[_key(place["xaxis"])] = {"domain": across[col]}
                    first = self._labelled(row, place) if col == block.columns[0] else {}
                    layout[_key(place["yaxis"])] = {"domain": down, **first}
            top -= block.height + GAP
        traces = {
            number: {"colorbar": self._bar_beside(layout, trace)}
            for number, trace in enumerate(self.data)
            if "colorbar" in trace.get("marker", {})
        }
        return {"layout": layout, "traces": traces}

    def _across(self, block: Block) -> Dict[int, Tuple[float, float]]:
        """Where each column of a block begins and ends."""
        ends = {}
        for (_, col), place in self._places.items():
            if col in block.columns and "xaxis" in place:
                left, right = self.layout[_key(place["xaxis"])]["domain"]
                ends[col] = right - left
        shares = _shares([ends[col] for col in block.columns], SPACING)
        scale = 1 - block.room
        return {c: (scale * a, scale * b) for c, (a, b) in zip(block.columns, shares)}

    def _labelled(self, row: int, place: Document) -> Document:
        """What the y axis of a panel needs when it becomes the first of its row."""
        axis = self.layout[_key(place["yaxis"])]
        of_row = next(p for (its_row, _), p in self._places.items() if its_row == row)
        title = axis.get("title", {}).get("text") or self._title_of(of_row)
        labels = {} if axis.get("visible") is False else {"showticklabels": True}
        return {**labels, "title": {**axis.get("title", {}), "text": title}} if labels else {}

    def _title_of(self, place: Document) -> str:
        return str(self.layout[_key(place["yaxis"])].get("title", {}).get("text", ""))

    @staticmethod
    def _bar_beside(layout: Document, trace: Document) -> Document:
        """Place of a colour bar right of its panel in a narrow layout."""
        right = layout[_key(trace["xaxis"])]["domain"][1]
        bottom, top = layout[_key(trace["yaxis"])]["domain"]
        return {"x": right + 0.62 * (1 - right), "y": (bottom + top) / 2, "len": top - bottom}

    def domain(self, row: int, col: int) -> Tuple[float, float]:
        """Lower and upper end of a panel, as shares of the plotting area."""
        bottom, top = self.layout[_key(self._places[row, col]["yaxis"])]["domain"]
        return bottom, top

    def document(self) -> Document:
        """What plotly's to_plotly_json would give."""
        return {"data": self.data, "layout": self.layout}

    def _place(self, domain: Document, kind: str) -> Document:
        if kind == "table":
            return {"domain": domain}
        count = sum("xaxis" in place for place in self._places.values()) + 1
        x, y = (name + str(count) * (count > 1) for name in "xy")
        self.layout[_key(x)] = {"anchor": y, "domain": domain["x"]}
        self.layout[_key(y)] = {"anchor": x, "domain": domain["y"]}
        return {"xaxis": x, "yaxis": y}

    def _note(self, refs: Document, note: Document) -> None:
        self.layout.setdefault("annotations", []).append({**note, **refs, "showarrow": False})

    def _shape(self, refs: Document, shape: Document) -> None:
        self.layout.setdefault("shapes", []).append({**shape, **refs})

    def _refs(self, row: int, col: int, *inside: bool) -> Document:
        axes = (self._places[row, col][name] for name in ("xaxis", "yaxis"))
        x, y = (axis + " domain" * share for axis, share in zip(axes, inside))
        return {"xref": x, "yref": y}

    def _update(
        self, name: str, row: Optional[int], col: Optional[int], properties: Document
    ) -> None:
        if isinstance(properties.get("title"), str):
            properties["title"] = {"text": properties["title"]}
        for (its_row, its_col), place in self._places.items():
            if name in place and row in (None, its_row) and col in (None, its_col):
                _merge(self.layout[_key(place[name])], copy.deepcopy(properties))


def _shares(sizes: Sequence[float], spacing: float) -> List[Tuple[float, float]]:
    """Where each part begins and ends when parts of such sizes, with spaces between, fill 0..1."""
    scale = (1 - spacing * (len(sizes) - 1)) / sum(sizes)
    starts = [scale * sum(sizes[:i]) + spacing * i for i in range(len(sizes))]
    return [(start, start + scale * size) for start, size in zip(starts, sizes)]


def _merge(into: Document, given: Document) -> None:
    """Sets what is given in a dictionary and in those inside it; None leaves a value as it is."""
    for key, value in given.items():
        if isinstance(value, dict) and isinstance(into.get(key), dict):
            _merge(into[key], value)
        elif value is not None:
            into[key] = value


def _key(axis: str) -> str:
    """The name of an axis in a layout: "xaxis2" of "x2"."""
    return axis[0] + "axis" + axis[1:]
