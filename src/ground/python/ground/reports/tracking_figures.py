"""Figures of controllers in closed loop (plotly figures, as in ground.reports.figures)."""

from typing import Any, List, Mapping, Optional, Tuple

import numpy as np

from ground.analysis.tracks import Track
from ground.reports.appearance import MEASURED, MODELS, REFERENCE, thruster_line, transparent
from ground.reports.figure_parts import X_AXIS, Y_AXIS, arrows, curve, note, points, walls
from ground.reports.panels import Panels
from ground.support.annotations import Plotly

MIN_ERROR = 1e-7  # smallest error that is drawn [m]
HEADINGS = 24  # number of arrows along a path


def driven(run: Track, text: str, counts: Tuple[float, float], room: Optional[Any] = None) -> Plotly:
    """Path, error, inputs and computing times of a drive.

    text: the caption; counts: the span of time in which errors count [s]; room: the _core.RoomPlan
    whose walls are drawn.
    """
    figure = Panels(3, 2, [0.42, 0.58], [1, 1, 0.6], gaps=(0.08, 0.04), tall=[1], shared="x")
    _add_path(figure, run, room)
    line = {"color": MEASURED, "width": 1}
    errors = np.maximum(run.errors, MIN_ERROR)
    figure.add(curve(run.times, errors, "craft", line, False), 1, 2)
    shade = transparent(REFERENCE, 0.12)
    figure.span(*counts, 1, 2, fillcolor=shade, layer="below")
    note(figure, 1, 2, "shaded: errors count", REFERENCE, 0.98)
    figure.update_yaxes(title="error [m]", type="log", row=1, col=2)
    _add_inputs(figure, run)
    if len(run.computing):
        times, spent = run.computing[:, 0], 1e3 * run.computing[:, 1]
        point = {"size": 2, "color": MEASURED}
        figure.add(points(times, spent, point, showlegend=False), 3, 2)
    else:
        note(figure, 3, 2, "not recorded", MEASURED, 0.5)
    figure.update_yaxes(title="computing [ms]", rangemode="tozero", row=3, col=2)
    figure.update_xaxes(title="time since the reference began [s]", row=3, col=2)
    return figure.finish(600, text)


def caption(name: str, numbers: Mapping[str, Any]) -> str:
    """The numbers of a run in a line."""
    saturated = 100 * (numbers["saturated_fraction"] or 0)
    error = 1e3 * numbers["rms"]
    return "%s: error %.3g mm rms, saturated %.0f%% of the time" % (name, error, saturated)


def _add_path(figure: Panels, run: Track, room: Optional[Any]) -> None:
    if room is not None:
        figure.add(walls(room), 1, 1)
    for path, name, shade, width, opacity in (
        (run.reference, "reference", REFERENCE, 4, 0.4),
        (run.eta, "craft", MEASURED, 1, 1.0),
    ):
        line = {"color": shade, "width": width}
        figure.add(curve(path[:, 1], path[:, 0], name, line, True, opacity), 1, 1)
    x, y, heading = run.eta[:: max(1, len(run.eta) // HEADINGS)].T
    length = 0.05 * max(np.ptp(run.eta[:, 0]), np.ptp(run.eta[:, 1]), 0.1)
    along = length * np.sin(heading), length * np.cos(heading)
    line = {"color": MODELS[0], "width": 1.5}
    figure.add(arrows(y, x, *along, "heading", line, legend=True), 1, 1)
    figure.update_xaxes(title=Y_AXIS, row=1, col=1)
    figure.update_yaxes(title=X_AXIS, scaleanchor="x", row=1, col=1)


def _add_inputs(figure: Panels, run: Track) -> None:
    """Adds the inputs, and behind them the wanted ones before they were limited."""
    for rows, prefix, opacity in ((run.wanted, "wanted, ", 0.35), (run.inputs, "", 1.0)):
        for column, name in enumerate(_thrusters(rows.shape[1] - 1), 1):
            line = thruster_line(column - 1, 1)
            trace = curve(rows[:, 0], rows[:, column], prefix + name, line, True, opacity)
            if len(rows):
                figure.add(trace, 2, 2)
    if len(run.wanted):
        least, most = run.wanted[:, 1:].min(), run.wanted[:, 1:].max()
        limits = [np.clip(least, -1, 0) - 0.05, np.clip(most, 1, 2) + 0.05]
        figure.update_yaxes(range=limits, row=2, col=2)
    figure.update_yaxes(title="input [-]", row=2, col=2)


def _thrusters(count: int) -> List[str]:
    """Names of the inputs of thrusters, for a legend."""
    if count == 2:
        return ["left [-]", "right [-]"]
    return ["thruster %d [-]" % (i + 1) for i in range(count)]
