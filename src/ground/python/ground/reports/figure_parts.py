"""Parts of the package's figures (plotly): curves, arrows, notes, small multiples."""

from typing import Any, List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.poses import scatter
from ground.reports.appearance import model_line, model_mark, thruster_line, transparent
from ground.reports.panels import Panels
from ground.support.annotations import Array, Document, Plotly, Style

MAX_POINTS = 1000  # points of a curve; captions say what is left out
ARROW_HEAD = 0.3  # length of an arrow's head, as a share of the arrow
TIME = "time since the start of the run [s]"
Y_AXIS, X_AXIS = "y [m] (world_ned)", "x [m] (world_ned)"  # axes of a view from above
ZERO_LINE: Document = {"zeroline": True, "zerolinecolor": "#888888", "zerolinewidth": 1}


def curve(x: Any, y: Any, name: str, line: Style, legend: bool, opacity: float = 1.0) -> Plotly:
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


def shaded(x: Array, low: Array, high: Array, shade: str, opacity: float) -> Plotly:
    """The area between two curves."""
    return area(*outline(x, low, high), "", shade, opacity, False)


def area(x: Any, y: Any, name: str, shade: str, opacity: float, legend: bool) -> Plotly:
    """The area inside outlines, NaN between them."""
    trace = curve(x, y, name, {"width": 0, "color": shade}, legend)
    del trace["hovertemplate"]
    return dict(trace, fill="toself", fillcolor=transparent(shade, opacity), hoverinfo="skip")


def points(x: Any, y: Any, marker: Style, **style: Any) -> Plotly:
    """Marks at points."""
    place = {"type": "scatter", "mode": "markers", "x": short(x), "y": short(y)}
    return {**place, "marker": marker, **style}


def arrows(
    x: Any,
    y: Any,
    dx: Any,
    dy: Any,
    name: str,
    line: Style,
    head: float = ARROW_HEAD,
    legend: bool = False,
    opacity: float = 1.0,
) -> Plotly:
    """Arrows from (x, y) that are (dx, dy) long. head: length of its two lines, as a share."""
    tail, along = np.array([x, y], float), np.array([dx, dy], float)
    across = np.array([-along[1], along[0]])
    tip, gap = tail + along, np.full_like(tail, np.nan)
    left, right = (tip - head * (along + side * 0.4 * across) for side in (-1, 1))
    strokes = np.stack([tail, tip, left, gap, tip, right, gap], axis=-1).reshape(2, -1)
    return curve(strokes[0], strokes[1], name, line, legend, opacity)


def bins(x: Any, values: Any, name: str, model: int, legend: bool) -> Plotly:
    """Means at the centres of bins, by the model of that number."""
    return dict(
        curve(x, values, name, model_line(model, 1.4), legend),
        mode="lines+markers",
        marker=model_mark(model),
        hovertemplate="%{x:.3g}: %{y:.3g}",
    )


def walls(room: Any) -> Plotly:
    """The walls of a _core.RoomPlan from above."""
    corners = np.array(list(room.corners) + [room.corners[0]])
    line: Style = {"color": "#aaaaaa", "width": 4}
    return dict(curve(corners[:, 1], corners[:, 0], "walls", line, True), hoverinfo="skip")


def note(
    figure: Panels,
    row: int,
    col: int,
    text: str,
    shade: str,
    x: float,
    down: float = 0.0,
    y: float = 0.99,
    **style: Any,
) -> None:
    """A text inside a panel at (x, y), as shares of it, and `down` pixels lower."""
    figure.note(
        text,
        x,
        y,
        row,
        col,
        xanchor="center" if x == 0.5 else "left" if x < 0.5 else "right",
        yanchor="top" if y > 0.5 else "bottom",
        yshift=-down,
        font={"size": 10, "color": shade},
        **style,
    )


def add_commands(figure: Panels, model: _core.Model, run: _core.RunData, row: int) -> None:
    """Commands of all thrusters over time in a row, and the time under it."""
    low, high = 0.0, 1.0
    for column, thruster in enumerate(model.thrusters, 1):
        at, values = _commands(run, column, model.input_max)
        low, high = min(low, *values), max(high, *values)
        name = "command %s [-]" % thruster["name"].replace("_", " ")
        figure.add(curve(at, values, name, thruster_line(column - 1, 1.2), True), row, 1)
    room = 0.15 * (high - low)
    figure.update_yaxes(title="input [-]", range=[low - room, high + room], row=row, col=1)
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
    at = np.flatnonzero(np.diff(times) > (scatter.BRIDGED + 2) * usual) + 1
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
    given = np.asarray(values, float).ravel().tolist()
    return [float("%.5g" % v) if np.isfinite(v) else None for v in given]
