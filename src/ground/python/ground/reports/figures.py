"""Figures of measurement and model: each plot is defined here once, as a plotly figure.

The page (ground.reports.page) shows them; ground.reports.picture draws them into files. Each function
takes the results of ground.reports.inspection for one run and one or more models. It returns the
result of plotly's `to_plotly_json`, with the caption in layout.meta.
"""

from typing import Any, List, Optional, Sequence, Tuple

import numpy as np

from ground.analysis import bands as bands_of
from ground.analysis import residuals
from ground.annotations import Array, Document
from ground.recordings import windows
from ground.reports import panels
from ground.reports.appearance import (
    CHANNELS,
    FAINT,
    FLOOR,
    LINES,
    MEASURED,
    MODELS,
    NUMBERS,
    TEXT,
    model_color,
    model_line,
    numbers_row,
    wrapped,
)
from ground.reports.figure_parts import (
    X_AXIS,
    Y_AXIS,
    ZERO_LINE,
    add_commands,
    area,
    bins,
    curve,
    every_so_many,
    fewer,
    finish,
    grid_blocks,
    note,
    outline,
    points,
    shaded,
    short,
    with_gaps,
)
from ground.reports.words import number

ERROR = (
    "Error: mean over samples of |e_u|/σ_u + |e_v|/σ_v + |e_r|/σ_r, windows of 1.5 s, each from "
    "its own initial velocities; σ are the run's standard deviations."
)
LABEL_WIDTH = 24  # of a line of a bar's label [characters]
TABLE_HEAD, TABLE_ROW = 26, 24  # heights of a row [pixels]


def fall(steps: Sequence[Tuple[str, float]], floor: Optional[float], title: str) -> Document:
    """Bars of the error (pairs of label and error, from top), and the noise floor or None; title: of the
    axis."""
    labels = [wrapped(label, LABEL_WIDTH) for label, _ in steps]
    errors = [error for _, error in steps]
    lines = sum(1 + label.count("<br>") for label in labels)
    figure = panels.Figure()
    figure.add(
        {
            "type": "bar",
            "x": short(errors),
            "y": labels,
            "orientation": "h",
            "text": [number(e) for e in errors],
            "textposition": "outside",
            "cliponaxis": False,
            "marker": {"color": [MODELS[0]] + [MODELS[1]] * (len(steps) - 1)},
            "hovertemplate": "%{y}: %{x:.3f}<extra></extra>",
        }
    )
    if floor is not None:
        figure.add_line(floor, FLOOR, "noise of the poses alone %s" % number(floor))
    figure.update_xaxes(title=title + " [-]", range=[0, 1.3 * max(errors)])
    figure.update_yaxes(autorange="reversed", automargin=True)
    margin = {"t": 40, "b": 50, "l": 20, "r": 20}
    height = 100 + 14 * len(steps) + 23 * lines
    return finish(figure, height, ERROR, margin, blocks=[panels.Block((1,), height - 90)])


def motion(
    studies: Sequence[Document], bands: Optional[bands_of.Bands] = None, table: bool = True
) -> Document:
    """Velocities and commands over time, the path from above and the errors of every model.

    bands: the last model's, drawn behind the velocities; table: whether the errors are below.
    """
    run = studies[0]["run"]
    times, nu, eta = np.array(run.times), np.array(run.nu), np.array(run.eta)
    heights = [155, 155, 155, 88]
    specs: List[List[Optional[Document]]] = [[{}, {"rowspan": 4}], [{}, None], [{}, None], [{}, None]]
    if table:
        heights += [30, TABLE_HEAD + TABLE_ROW * len(studies) + 2]
        specs += [[None, None], [{"type": "table", "colspan": 2}, None]]
    figure = panels.Figure(
        rows=len(heights),
        cols=2,
        specs=specs,
        column_widths=[0.64, 0.36],
        row_heights=heights,
        horizontal_spacing=0.08,
        vertical_spacing=0.025,
    )
    every = every_so_many(times)
    if bands is not None:
        _add_bands(figure, bands, every.step, model_color(len(studies) - 1))
    shown = with_gaps(times[every], nu[every], eta[every])
    _add_motion(figure, shown, "measured", {"color": MEASURED, "width": 4}, 0.35)
    for count, study in enumerate(studies):
        pieces = [_thinned(p, every.step) for p in study["evaluation"].pieces]
        ended = [[np.concatenate([a, np.full_like(a[:1], np.nan)]) for a in p] for p in pieces]
        together = [np.concatenate(parts) for parts in zip(*ended)]
        _add_motion(figure, together, study["label"], model_line(count, 1.6))
    start = {"size": 7, "color": MEASURED}
    figure.add(points(eta[:1, 1], eta[:1, 0], start, name="start"), 1, 2)
    add_commands(figure, studies[0], 4)
    if table:
        _add_numbers(figure, studies)
    figure.update_xaxes(matches="x4", range=[float(times[0]), float(times[-1])], col=1)
    figure.update_xaxes(title=Y_AXIS, row=1, col=2)
    figure.update_yaxes(title=X_AXIS, scaleanchor="x2", row=1, col=2)
    figure.layout["hovermode"] = "x"
    margin = {"t": 50 if bands is None else 110, "b": 10 if table else 50}
    height = sum(heights) + 60 + sum(margin.values())
    caption = _motion_caption(run, every.step, bands)
    blocks = [panels.Block((1,), 520), panels.Block((2,), 320)]
    return finish(figure, height, caption, margin, blocks=blocks)


def _add_motion(
    figure: panels.Figure, series: Sequence[Array], name: str, line: Document, opacity: float = 1.0
) -> None:
    """Adds velocities over time and the path; series: times, velocities and poses."""
    times, nu, eta = series
    for row, (_, label, unit) in enumerate(CHANNELS):
        trace = curve(times, nu[:, row], name, line, row == 0, opacity)
        figure.add(trace, row + 1, 1)
        figure.update_yaxes(title="%s [%s]" % (label, unit), row=row + 1, col=1)
    figure.add(_timed(curve(eta[:, 1], eta[:, 0], name, line, False, opacity), times), 1, 2)


def _add_numbers(figure: panels.Figure, studies: Sequence[Document]) -> None:
    rows = [numbers_row(s["label"], s["role"], s["numbers"]) for s in studies]
    plain = [[TEXT] * len(rows)] * (len(NUMBERS) - 1)
    labels = [[model_color(count) for count in range(len(rows))]]
    line, fill = {"color": LINES}, {"color": "#ffffff"}
    header = {
        "values": NUMBERS,
        "height": TABLE_HEAD,
        "font": {"size": 11, "color": TEXT},
        "fill": {"color": FAINT},
        "line": line,
    }
    cells = {
        "values": list(zip(*rows)),
        "height": TABLE_ROW,
        "font": {"size": 11, "color": labels + plain},
        "fill": fill,
        "line": line,
    }
    widths = [2, 1, 0.9, 1.5, 1.1, 0.8, 0.8, 0.8, 1.4]
    table = {"type": "table", "header": header, "cells": cells, "columnwidth": widths}
    figure.add(table, 6, 1)


def _add_bands(figure: panels.Figure, bands: bands_of.Bands, step: int, shade: str) -> None:
    """Adds bands to the rows of u, v, r, first with the horizon of a window; buttons choose another.
    The bands have to be the figure's first traces."""
    traces = []  # horizon of each
    for horizon in bands_of.HORIZONS:
        tiles = [fewer(tile, step) for tile in bands.tiled(horizon)]
        for row, (channel, _, _) in enumerate(CHANNELS if tiles else ()):
            at = bands_of.CHANNELS.index(channel)
            outlines = [outline(times, low[:, at], high[:, at]) for times, low, high in tiles]
            x, y = (np.concatenate(parts) for parts in zip(*outlines))
            name = "%.0f%% band" % (100 * bands_of.PART)
            trace = area(x, y, name, shade, 0.2, row == 0)
            figure.add(dict(trace, visible=horizon == windows.WINDOW), row + 1, 1)
            traces.append(horizon)
    buttons = [
        {
            "label": "band %g s" % horizon,
            "method": "restyle",
            "args": [{"visible": [h == horizon for h in traces]}, list(range(len(traces)))],
        }
        for horizon in sorted(set(traces))
    ]
    menu: Document = {"type": "buttons", "direction": "right", "buttons": buttons}
    menu.update(font={"size": 13}, active=bands_of.HORIZONS.index(windows.WINDOW))
    menu.update(x=0, xanchor="left", y=1.1, yanchor="bottom", pad={"t": 0, "b": 0})
    if buttons:
        figure.layout["updatemenus"] = [menu]


def _motion_caption(run: Any, step: int, bands: Optional[bands_of.Bands]) -> str:
    caption = (
        "Run %s: velocities in the body frame, path in world_ned seen from above; models restart "
        "every 1.5 s." % run.name
    )
    if step > 1:
        caption += " One sample in %d is drawn." % step
    if bands is not None:
        caption += (
            " Shaded: %.0f%% prediction band of a fit without this run. It restarts every %g s "
            "(or as the buttons say) from the poses so far; it includes random wrench and noise."
            % (100 * bands_of.PART, windows.WINDOW)
        )
    return caption


def residual_correlation(studies: Sequence[Document]) -> Document:
    """Correlation of one-step residuals of every model with themselves and with the commands."""
    columns = {"autocorrelation": "itself", **residuals.commands(studies[0]["model"])}
    figure = panels.Figure(
        rows=3,
        cols=len(columns),
        horizontal_spacing=0.045,
        vertical_spacing=0.05,
        titles=["with %s, earlier" % name for name in columns.values()],
    )
    for row, channel in enumerate(residuals.CHANNELS):
        for column, kind in enumerate(columns):
            for count, study in enumerate(studies):
                entry = study["residuals"]["channels"][channel][kind]
                _add_correlation(figure, row, column, entry, study["label"], count)
            figure.update_xaxes(
                title="lag [ms]" if row == 2 else None,
                showticklabels=row == 2,
                row=row + 1,
                col=column + 1,
            )
            entries = [s["residuals"]["channels"][channel][kind] for s in studies]
            values = [np.abs(e["value"]).max() for e in entries if e is not None]
            reach = 1.15 * max(values + [0.15])
            figure.update_yaxes(range=[-reach, 1.2 * reach], row=row + 1, col=column + 1)
        figure.update_yaxes(
            title="residual %s<br>correlation [-]" % channel, row=row + 1, col=1
        )
    figure.update_yaxes(**ZERO_LINE)
    figure.update_xaxes(**ZERO_LINE)
    caption = (
        "Run %s: residuals from one pose to the next (Kalman filter around the model). Shaded: "
        "%.0f%% band, where those of a true model stay."
        % (studies[0]["run"].name, 100 * residuals.BAND)
    )
    blocks = grid_blocks(len(columns), 400, 1)
    return finish(figure, 560, caption, {"t": 65}, 1.06, blocks)


def _add_correlation(
    figure: panels.Figure, row: int, column: int, entry: Optional[Document], label: str, count: int
) -> None:
    """Correlation at each lag, its band, and how many lags are outside; entry: None without one."""
    shade = model_color(count)
    if entry is None:
        text = "the command never changes"
    else:
        lags, band = 1e3 * np.array(entry["lag_seconds"]), np.array(entry["band99"])
        figure.add(shaded(lags, -band, band, shade, 0.13), row + 1, column + 1)
        trace = bins(dict(entry, centres=lags), entry["value"], label, count, row == column == 0)
        figure.add(trace, row + 1, column + 1)
        text = "%d of %d outside" % (entry["outside"], entry["lags"])
    note(figure, row + 1, column + 1, text, shade, 0.98, 14 * count)


def _timed(trace: Document, times: Any) -> Document:
    """A path with times, so that the page can show the part that is zoomed into."""
    trace.update(customdata=short(times), meta="path")
    trace.update(hovertemplate="%{customdata:.2f} s: x %{y:.3f} m, y %{x:.3f} m")
    return trace


def _thinned(piece: Document, step: int) -> List[Array]:
    """Thinned times, velocities and poses of a window, with its last sample."""
    return fewer((piece["times"], piece["nu"], piece["eta"]), step)
