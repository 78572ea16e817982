"""Figures of a run alone, of what a prediction leaves of it, and of the estimates of a fit."""

from typing import List, Mapping, Sequence, Tuple

import numpy as np

from ground.reading.recording import POSE, UNITS, VELOCITY, Recording
from ground.reports.appearance import CHANNELS, MEASURED, MODELS, TEXT, thruster_line
from ground.reports.figure_parts import (
    TIME,
    X_AXIS,
    Y_AXIS,
    ZERO_LINE,
    curve,
    every_so_many,
    points,
    short,
    with_gaps,
)
from ground.reports.panels import Panels
from ground.support.annotations import Array, Plotly, Style

DARK = 0.6  # correlation whose colour is dark
Estimates = Tuple[str, Mapping[str, float], Mapping[str, Tuple[float, float]]]


def recorded(run: Recording) -> Plotly:
    """Velocities and commands over time and the path from above."""
    motion = run.motion
    times = motion.times - motion.times[0]
    figure = Panels(4, 2, [0.64, 0.36], [155, 155, 155, 88], gaps=(0.08, 0.025), tall=[2], shared="x")
    every = every_so_many(times)
    at, nu, eta = with_gaps(times[every], motion.nu[every], motion.eta[every])
    line: Style = {"color": MEASURED, "width": 2}
    for row, (_, label, unit) in enumerate(CHANNELS, 1):
        figure.add(curve(at, nu[:, row - 1], "measured", line, row == 1), row, 1)
        figure.update_yaxes(title="%s [%s]" % (label, unit), row=row, col=1)
    sent = run.control_times - motion.times[0]
    for i, name in enumerate(run.channels):
        style: Style = {**thruster_line(i, 1.2), "shape": "hv"}
        figure.add(curve(sent, run.controls[:, i], "command %s [-]" % name, style, True), 4, 1)
    figure.update_yaxes(title="command [-]", row=4, col=1)
    figure.update_xaxes(title=TIME, row=4, col=1)
    figure.add(curve(eta[:, 1], eta[:, 0], "measured", line, False), 1, 2)
    figure.add(points(eta[:1, 1], eta[:1, 0], {"size": 7, "color": MEASURED}, name="start"), 1, 2)
    figure.update_xaxes(title=Y_AXIS, row=1, col=2)
    figure.update_yaxes(title=X_AXIS, scaleanchor="x2", row=1, col=2)
    return figure.finish(713, "Run %s: velocities in the body frame, path in world_ned." % run.name)


def residuals(times: Array, values: Array, caption: str) -> Plotly:
    """Measured minus predicted poses and velocities (n, 6) over time."""
    names = (*POSE, *VELOCITY)
    figure = Panels(len(names), 1, gaps=(0.0, 0.02), shared="x")
    every = every_so_many(times)
    at, shown = with_gaps(times[every], values[every])
    for row, name in enumerate(names, 1):
        figure.add(curve(at, shown[:, row - 1], name, {"color": MODELS[0], "width": 1.4}, False), row, 1)
        figure.update_yaxes(title="%s [%s]" % (name, UNITS[name]), row=row, col=1, **ZERO_LINE)
    figure.update_xaxes(title=TIME, row=len(names))
    return figure.finish(713, "Measured minus predicted. " + caption)


def parameters(rows: Sequence[Estimates], units: Mapping[str, str]) -> Plotly:
    """Estimates with their 95% intervals: a panel for each parameter, a row for each name (of a run)."""
    figure = Panels(1, len(units), gaps=(0.03, 0.0), shared="y")
    labels = [name for name, _, _ in rows]
    figure.update_yaxes(1, 1, showticklabels=True)
    for col, (name, unit) in enumerate(units.items(), 1):
        found = np.array([values[name] for _, values, _ in rows])
        ends = np.array([intervals[name] for _, _, intervals in rows], float)
        ends[~np.isfinite(ends)] = np.nan
        trace = points(found, found, {"size": 8, "color": MODELS[0]}, showlegend=False)
        above, below = short(ends[:, 1] - found), short(found - ends[:, 0])
        bars = {"symmetric": False, "array": above, "arrayminus": below}
        figure.add({**trace, "y": labels, "error_x": bars}, 1, col)
        title = "%s [%s]" % (name, unit) if unit else name
        figure.update_xaxes(title=title, nticks=4, row=1, col=col)
    figure.update_yaxes(autorange="reversed", automargin=True, type="category")
    caption = "Estimates and their 95% intervals: each run by itself, and all together."
    return figure.finish(160 + 28 * len(rows), caption)


def correlation(names: List[str], values: Array) -> Plotly:
    """Correlation of estimates as colours and numbers."""
    figure = Panels()
    colours: Plotly = {"zmin": -1, "zmax": 1, "colorscale": "RdBu", "reversescale": True}
    heat = {"type": "heatmap", "x": names, "y": names, "z": np.round(values, 3).tolist(), "showscale": False}
    figure.add({**heat, **colours, "hovertemplate": "%{x}, %{y}: %{z}<extra></extra>"})
    for (row, col), value in np.ndenumerate(values):
        font = {"color": "#ffffff" if abs(value) > DARK else TEXT}
        figure.note("%.2f" % value, names[col], names[row], inside=False, font=font)
    figure.update_yaxes(autorange="reversed", automargin=True)
    return figure.finish(200 + 40 * len(names), "Correlation of the estimates; near 1 or -1, only their "
                         "ratio or product is known.")  # fmt: skip
