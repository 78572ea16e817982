"""Parts of the package's figures: curves, arrows, notes, small multiples (plotly)."""

import functools
import math
from typing import Any, List, Mapping, Optional, Sequence, Tuple

import numpy as np
from plotly import io

from ground.annotations import Array, Document
from ground.recordings import repair
from ground.reports import panels
from ground.reports.appearance import (
    LINES,
    TEXT,
    model_color,
    model_line,
    model_mark,
    thruster_line,
    transparent,
)

MAX_POINTS = 1000  # points of a curve; captions say what is left out
NARROW_WIDTH, LEGEND_ROW = 300, 20  # a legend on a narrow page: width, height of a row [pixels]
ARROW_HEAD = 0.3  # length of an arrow's head, as a share of the arrow
TIME = "time since the start of the run [s]"
Y_AXIS, X_AXIS = "y [m] (world_ned)", "x [m] (world_ned)"  # axes of a view from above
ZERO_LINE: Document = {"zeroline": True, "zerolinecolor": "#888888", "zerolinewidth": 1}


def finish(
    figure: panels.Figure,
    height: int,
    caption: str,
    margin: Mapping[str, int] = {},
    legend_y: float = 1.02,
    blocks: Sequence[panels.Block] = (),
) -> Document:
    """The figure as a document, with its height [pixels], caption, margins and legend.

    blocks: how its columns are arranged on a narrow page; without them they keep their places.
    """
    # Short ticks keep the labels of both axes apart in the corner between them.
    ticks: Document = {"ticks": "outside", "ticklen": 4, "tickcolor": LINES}
    figure.update_xaxes(title={"font": {"size": 11}}, **ticks)
    figure.update_yaxes(title={"font": {"size": 11}}, **ticks)
    figure.layout.update(
        template=_template(),
        height=height,
        meta=caption,
        font={"family": "system-ui, sans-serif", "size": 12, "color": TEXT},
        margin=dict({"t": 50, "b": 50, "l": 70, "r": 10}, **margin),
        legend={"orientation": "h", "y": legend_y, "yanchor": "bottom", "x": 0},
    )
    return dict(figure.document(), narrow=_narrow(figure, blocks or [panels.Block((1,), height - 90)]))


def _narrow(figure: panels.Figure, blocks: Sequence[panels.Block]) -> Document:
    """What differs on a narrow page: the panels' places, and the legend below them."""
    narrow = figure.narrow(blocks)
    names = {t["name"]: t for t in figure.data if t.get("showlegend", True) and t.get("name")}
    rows = math.ceil(sum(60 + 7 * len(name) for name in names) / NARROW_WIDTH)
    own = figure.layout["margin"]
    menus = figure.layout.get("updatemenus", [])
    margin = {"t": 60 if menus else 26, "b": panels.GAP, "l": min(own["l"], 62), "r": 10}
    area = narrow["layout"]["height"]
    narrow["layout"].update(
        height=area + margin["t"] + margin["b"] + LEGEND_ROW * rows,
        margin=dict(margin, b=margin["b"] + LEGEND_ROW * rows),
        legend={"y": -margin["b"] / area, "yanchor": "top"},
        updatemenus=[dict(menu, y=1 + 10 / area) for menu in menus],
        dragmode=False,  # a finger scrolls the page
    )
    return narrow


@functools.lru_cache(maxsize=None)
def _template() -> Document:
    template: Document = io.templates["plotly_white"].to_plotly_json()
    return template


def curve(
    x: Any, y: Any, name: str, line: Document, legend: bool, opacity: float = 1.0
) -> Document:
    """A line through points; nothing is drawn at and beside NaN."""
    return {
        "type": "scatter",
        "x": short(x),
        "y": short(y),
        "name": name,
        "legendgroup": name,
        "mode": "lines",
        "line": line,
        "opacity": opacity,
        "showlegend": legend,
        "hovertemplate": "%{y:.4g}",
    }


def shaded(x: Array, low: Array, high: Array, shade: str, opacity: float) -> Document:
    """The area between two curves."""
    return area(*outline(x, low, high), "", shade, opacity, False)


def area(x: Any, y: Any, name: str, shade: str, opacity: float, legend: bool) -> Document:
    """The area inside outlines, NaN between them."""
    trace = curve(x, y, name, {"width": 0, "color": shade}, legend)
    del trace["hovertemplate"]
    return dict(trace, fill="toself", fillcolor=transparent(shade, opacity), hoverinfo="skip")


def points(x: Any, y: Any, marker: Document, **style: Any) -> Document:
    """Marks at points."""
    place = {"type": "scatter", "mode": "markers", "x": short(x), "y": short(y)}
    return {**place, "marker": marker, **style}


def arrows(
    x: Any,
    y: Any,
    dx: Any,
    dy: Any,
    name: str,
    line: Document,
    head: float = ARROW_HEAD,
    legend: bool = False,
    opacity: float = 1.0,
) -> Document:
    """Arrows from (x, y) that are (dx, dy) long. head: length of its two lines, as a share."""
    tail, along = np.array([x, y], float), np.array([dx, dy], float)
    across = np.array([-along[1], along[0]])
    tip, gap = tail + along, np.full_like(tail, np.nan)
    left, right = (tip - head * (along + side * 0.4 * across) for side in (-1, 1))
    strokes = np.stack([tail, tip, left, gap, tip, right, gap], axis=-1).reshape(2, -1)
    return curve(strokes[0], strokes[1], name, line, legend, opacity)


def bins(
    entry: Document,
    values: Any,
    name: str,
    model: int,
    legend: bool,
    errors: Optional[Array] = None,
) -> Document:
    """Means in the bins of a variable by the model of that number, with bars of `errors` to both
    sides."""
    trace = {
        "type": "scatter",
        "x": short(entry["centres"]),
        "y": short(values),
        "name": name,
        "legendgroup": name,
        "showlegend": legend,
        "mode": "lines+markers",
        "marker": model_mark(model),
        "line": model_line(model, 1.4),
        "hovertemplate": "%{x:.3g}: %{y:.3g}",
    }
    if errors is not None:
        bars = {"array": short(errors), "width": 0, "thickness": 1.2, "color": model_color(model)}
        trace["error_y"] = bars
    return trace


def grid_blocks(columns: int, height: int, beside: int = 3) -> List[panels.Block]:
    """Blocks of a narrow page for many columns, some beside each other; height: of each [pixels]."""
    starts = range(1, columns + 1, beside)
    return [
        panels.Block(range(first, min(first + beside, columns + 1)), height) for first in starts
    ]


def note(
    figure: panels.Figure,
    row: int,
    column: int,
    text: str,
    shade: str,
    x: float,
    down: float = 0.0,
    y: float = 0.99,
    **style: Any,
) -> None:
    """A text inside a panel at (x, y), as shares of it, and `down` pixels lower."""
    figure.annotate(
        row,
        col=column,
        inside=True,
        text=text,
        x=x,
        y=y,
        xanchor="center" if x == 0.5 else "left" if x < 0.5 else "right",
        yanchor="top" if y > 0.5 else "bottom",
        yshift=-down,
        font={"size": 10, "color": shade},
        **style,
    )


def add_commands(figure: panels.Figure, study: Document, row: int) -> None:
    """Commands of all thrusters over time in a row, and the time under the rows above it."""
    low, high = 0.0, 1.0
    for column, thruster in enumerate(study["model"].thrusters, 1):
        at, values = _commands(study["run"], column, study["model"].input_max)
        low, high = min(low, *values), max(high, *values)
        name = "command %s [-]" % thruster["name"].replace("_", " ")
        figure.add(curve(at, values, name, thruster_line(column - 1, 1.2), True), row, 1)
    room = 0.15 * (high - low)
    figure.update_yaxes(title="input [-]", range=[low - room, high + room], row=row, col=1)
    for above in range(1, row):
        figure.update_xaxes(showticklabels=False, row=above, col=1)
    figure.update_xaxes(title=TIME, row=row, col=1)


def _commands(run: Any, column: int, scale: float) -> Tuple[Array, Array]:
    """When a command changes, and to what, over the largest input."""
    inputs = np.array(run.inputs)
    start, end = run.times[0], run.times[-1]
    values = inputs[:, column] / scale
    keep = np.append(True, np.diff(values) != 0) & (inputs[:, 0] < end)
    at, values = inputs[keep, 0], values[keep]
    first = max(0, np.searchsorted(at, start, side="right") - 1)
    at, values = np.maximum(at[first:], start), values[first:]
    return np.append(at, end), np.append(values, values[-1:])


def every_so_many(times: Array) -> slice:
    """Slice that leaves at most MAX_POINTS samples to draw."""
    return slice(None, None, max(1, int(np.ceil(len(times) / MAX_POINTS))))


def fewer(series: Sequence[Array], step: int) -> List[Array]:
    """One row in `step` of arrays of the same length, and the last."""
    count = len(series[0])
    index = np.unique(np.append(np.arange(0, count, step), count - 1))
    return [values[index] for values in series]


def with_gaps(times: Array, *series: Array) -> List[Array]:
    """The arrays with NaN inserted into gaps, where no line is drawn."""
    usual = np.median(np.diff(times)) if len(times) > 1 else 0.0
    at = np.flatnonzero(np.diff(times) > repair.MAX_GAP + 2 * usual) + 1
    return [np.insert(s, at, np.nan, axis=0) for s in (times,) + series]


def outline(times: Array, low: Array, high: Array) -> Tuple[Array, Array]:
    """Outline of the area between two curves, with NaN between stretches."""
    x: List[Array] = []
    y: List[Array] = []
    gap = np.array([np.nan])
    whole = np.flatnonzero(np.isfinite(times))
    for part in np.split(whole, np.flatnonzero(np.diff(whole) > 1) + 1):
        x += [times[part], times[part][::-1], gap]
        y += [high[part], low[part][::-1], gap]
    return np.concatenate(x), np.concatenate(y)


def short(values: Any) -> List[Optional[float]]:
    """Numbers with five digits, so that pages stay small; None for NaN."""
    given = np.asarray(values, float)
    finite = np.isfinite(given)
    size = np.abs(np.where(finite & (given != 0), given, 1.0))
    digits = 4 - np.floor(np.log10(size))  # after the point
    up, down = 10.0 ** np.maximum(digits, 0), 10.0 ** np.maximum(-digits, 0)
    # Powers of ten are exact, so that the nearest float results, which is written in five digits.
    found: List[Optional[float]] = (np.rint(given * up / down) / up * down).tolist()
    for at in np.flatnonzero(~finite):
        found[at] = None
    return found
