"""Interactive figures of measurement and model, for pages (ground.reports.page): plotly figures.

Each takes what ground.reports.inspection has found out about the same run by one or more models.
"""

from typing import Any, List, Mapping, Optional, Sequence, Tuple

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from ground import _core
from ground.analysis import bands as bands_of
from ground.analysis import failure
from ground.annotations import Array, ArrayLike, Document
from ground.recordings import repair, windows
from ground.reports.appearance import (
    CHANNELS,
    ERROR_AGAINST,
    FLOOR,
    LEFT,
    MEASURED,
    MODELS,
    RIGHT,
    WRENCH,
    model_color,
    scaled,
    short_label,
    transparent,
)
from ground.reports.words import number

MOST = 1000  # points of a curve; what is left out is said
WRENCH_AGAINST = ["time", "u_L+u_R", "u_L-u_R", "u", "v", "r", "heading", "x", "y"]


def fall(steps: Sequence[Tuple[str, float]], floor: Optional[float], measured_on: str) -> Document:
    """Bars of the error (pairs of label and error, from top), and the noise floor or None."""
    labels, errors = [s[0] for s in steps], [s[1] for s in steps]
    figure = go.Figure(
        go.Bar(
            x=_short(errors),
            y=labels,
            orientation="h",
            text=[number(e) for e in errors],
            textposition="outside",
            cliponaxis=False,
            marker_color=[MEASURED] + [MODELS[1]] * (len(steps) - 1),
            hovertemplate="%{y}: %{x:.3f}<extra></extra>",
        )
    )
    if floor is not None:
        figure.add_vline(
            x=floor,
            line={"color": FLOOR, "dash": "dash", "width": 2},
            annotation_text="noise of the poses alone %s" % number(floor),
            annotation_position="top",
            annotation_font_color=FLOOR,
        )
    figure.update_xaxes(title="error on %s [-]" % measured_on, range=[0, 1.15 * max(errors)])
    figure.update_yaxes(autorange="reversed", automargin=True)
    return _finish(figure, 130 + 34 * len(steps), margin={"t": 40, "b": 50, "l": 20, "r": 20})


def motion(studies: Sequence[Document], bands: Optional[bands_of.Bands] = None) -> Document:
    """Velocities and commands over time, and the path from above, measured and by every model.

    bands: bands.Bands of the last model, drawn behind the velocities.
    """
    run = studies[0]["run"]
    times, nu, eta = np.array(run.times), np.array(run.nu), np.array(run.eta)
    figure = make_subplots(
        rows=4,
        cols=2,
        specs=[[{}, {"rowspan": 4}], [{}, None], [{}, None], [{}, None]],
        column_widths=[0.64, 0.36],
        row_heights=[0.28, 0.28, 0.28, 0.16],
        horizontal_spacing=0.08,
        vertical_spacing=0.03,
    )
    every = _every(times)
    shown = _with_gaps(times[every], nu[every], eta[every])
    if bands is not None:
        _add_bands(figure, bands, every.step, model_color(len(studies) - 1))
    for row, (_, label, unit) in enumerate(CHANNELS):
        line = {"color": MEASURED, "width": 4}
        figure.add_trace(
            _line(shown[0], shown[1][:, row], "measured", line, row == 0, 0.45), row + 1, 1
        )
        figure.update_yaxes(title="%s [%s]" % (label, unit), row=row + 1, col=1)
    path = _line(shown[2][:, 1], shown[2][:, 0], "measured", line, False, 0.45)
    figure.add_trace(_timed(path, shown[0]), 1, 2)
    for count, study in enumerate(studies):
        line = {"color": model_color(count), "width": 1.6}
        pieces = [_thinned(p, every.step) for p in study["evaluation"].pieces]
        over = np.concatenate([np.append(p[0], np.nan) for p in pieces])
        simulated = np.vstack([np.vstack([p[1], [np.nan] * 3]) for p in pieces])
        place = np.vstack([np.vstack([p[2], [np.nan] * 3]) for p in pieces])
        for row in range(3):
            trace = _line(over, simulated[:, row], study["label"], line, row == 0)
            figure.add_trace(trace, row + 1, 1)
        path = _line(place[:, 1], place[:, 0], study["label"], line, False)
        figure.add_trace(_timed(path, over), 1, 2)
    for column, label, shade in ((1, "left", LEFT), (2, "right", RIGHT)):
        at, values = _commands(run, column, studies[0]["model"].input_max)
        line = {"color": shade, "width": 1.2, "shape": "hv"}
        figure.add_trace(_line(at, values, "command " + label, line, True), 4, 1)
    figure.update_yaxes(title="input [-]", row=4, col=1)
    figure.update_xaxes(matches="x4", range=[float(times[0]), float(times[-1])], col=1)
    figure.update_xaxes(showticklabels=False, row=1, col=1)
    figure.update_xaxes(showticklabels=False, row=2, col=1)
    figure.update_xaxes(showticklabels=False, row=3, col=1)
    figure.update_xaxes(title="time since the start of the run [s]", row=4, col=1)
    figure.update_xaxes(title="y [m] (world_ned)", row=1, col=2)
    figure.update_yaxes(title="x [m] (world_ned)", scaleanchor="x2", row=1, col=2)
    figure.update_layout(
        legend={"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0}, hovermode="x"
    )
    if bands is None:
        return _finish(figure, 640)
    return _finish(figure, 675, margin={"t": 85, "b": 50, "l": 70, "r": 10})


def _add_bands(figure: go.Figure, bands: bands_of.Bands, step: int, shade: str) -> None:
    """Bands in the rows of u, v, r. The horizon of a window is shown first; buttons choose another.
    The bands have to be the figure's first traces."""
    traces = []  # horizon of each
    for horizon in bands_of.HORIZONS:
        tiles = [_fewer(tile, step) for tile in bands.tiled(horizon)]
        for row, (channel, _, _) in enumerate(CHANNELS if tiles else ()):
            at = bands_of.CHANNELS.index(channel)
            outlines = [_band(times, low[:, at], high[:, at]) for times, low, high in tiles]
            x, y = (np.concatenate(parts) for parts in zip(*outlines))
            name = "%.0f%% band" % (100 * bands_of.PART)
            trace = _line(x, y, name, {"width": 0, "color": shade}, row == 0)
            trace.update(fill="toself", fillcolor=transparent(shade, 0.2), hoverinfo="skip")
            trace.update(hovertemplate=None, visible=horizon == windows.WINDOW)
            figure.add_trace(trace, row + 1, 1)
            traces.append(horizon)
    buttons = [
        {
            "label": "band %g s" % horizon,
            "method": "restyle",
            "args": [{"visible": [h == horizon for h in traces]}, list(range(len(traces)))],
        }
        for horizon in sorted(set(traces))
    ]
    menu: Document = {
        "type": "buttons",
        "direction": "right",
        "buttons": buttons,
        "font": {"size": 11},
    }
    menu.update(active=bands_of.HORIZONS.index(windows.WINDOW))
    menu.update(x=0, xanchor="left", y=1.075, yanchor="bottom", pad={"t": 0, "b": 0})
    if buttons:
        figure.update_layout(updatemenus=[menu])


def motion_caption(run: _core.RunData, bands: Optional[bands_of.Bands] = None) -> str:
    """What the figure of `motion` shows, in words."""
    step = _every(np.array(run.times)).step
    thinned = " One sample in %d is drawn." % step if step > 1 else ""
    if bands is not None:
        thinned += (
            " Shaded: %.0f%% prediction band of a fit without this run. It starts anew every %g s "
            "(or as the buttons say) from the poses up to there; random wrench and noise are in it."
            % (100 * bands_of.PART, windows.WINDOW)
        )
    return (
        "Run %s: velocities in the body frame, path in world_ned seen from above; models start anew "
        "every 1.5 s. Zoom in time, and the path shows that stretch only; a double click goes back.%s"
        % (run.name, thinned)
    )


def where(studies: Sequence[Document]) -> Document:
    """Normalised error of each channel against what was measured, of every model."""
    against = ERROR_AGAINST
    figure = _small_multiples(3, len(against))
    for row, (channel, label, _) in enumerate(CHANNELS):
        top = max(np.max(s["where"][n]["error"][channel]) for s in studies for n in against)
        for column, name in enumerate(against):
            for count, study in enumerate(studies):
                entry = study["where"][name]
                legend = row == column == 0
                trace = _bins(
                    entry, entry["error"][channel], study["label"], model_color(count), legend
                )
                figure.add_trace(trace, row + 1, column + 1)
            best = min(studies, key=lambda s: float(s["numbers"]["error"]))
            _axes_of(figure, row, column, studies[0]["where"][name], [0, 1.15 * top])
            _percent(figure, row, column, len(against), best["where"][name]["share"][channel])
        figure.update_yaxes(title="%s<br>mean |error|/σ [-]" % label, row=row + 1, col=1)
    return _finish(figure, 520)


def wrench(studies: Sequence[Document], winner: Optional[str] = None) -> Document:
    """The wrench that every model lacks, against what was measured, with two standard errors; what the
    winner accounts for of the first one's drawn in it."""
    against = WRENCH_AGAINST
    figure = _small_multiples(3, len(against))
    for row, (channel, label) in enumerate(WRENCH):
        entries = [s["missing"].numbers["channels"][channel] for s in studies]
        factor, unit = scaled(entries[0])
        means = [factor * np.array(e["against"][n]["mean"]) for e in entries for n in against]
        reach = 1.4 * max(np.quantile(np.abs(m), 0.9) for m in means)
        for column, name in enumerate(against):
            for count, (study, entry) in enumerate(zip(studies, entries)):
                one, legend = entry["against"][name], row == column == 0
                trace = _bins(
                    one,
                    factor * np.array(one["mean"]),
                    study["label"],
                    model_color(count),
                    legend,
                    2 * factor * np.array(one["standard_error"]),
                )
                figure.add_trace(trace, row + 1, column + 1)
            accounted = entries[0].get("accounted")
            if accounted is not None:
                line = {"color": MEASURED, "width": 2, "dash": "dot"}
                at = entries[0]["against"][name]["centres"]
                told = factor * np.array(accounted["mean"][name])
                text = "what %s adds to %s" % (winner, studies[0]["label"])
                figure.add_trace(
                    _line(at, told, text, line, row == column == 0), row + 1, column + 1
                )
            limits = [-reach, reach] if reach > 0 else None
            one = entries[0]["against"][name]
            _axes_of(figure, row, column, one, limits)
            _percent(figure, row, column, len(against), one["share"])
        figure.update_yaxes(title="%s<br>[%s]" % (label, unit), row=row + 1, col=1)
    return _finish(figure, 540)


def wrench_over_time(studies: Sequence[Document]) -> Document:
    """The wrench that every model lacks over time, with two standard deviations of the first's."""
    figure = make_subplots(rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.03)
    for row, (channel, label) in enumerate(WRENCH):
        factor, unit = scaled(studies[0]["missing"].numbers["channels"][channel])
        reach = 0.0
        for count, study in enumerate(studies):
            missing = study["missing"]
            every = _every(missing.times)
            at, values, sigma = _with_gaps(
                missing.times[every],
                factor * missing.wrench[every, row],
                factor * missing.sigma[every, row],
            )
            reach = max(reach, 1.15 * np.nanquantile(np.abs(values) + 2 * sigma, 0.995))
            if count == 0:
                x, y = _band(at, values - 2 * sigma, values + 2 * sigma)
                band = _line(x, y, "", {"width": 0, "color": model_color(0)}, False)
                shade = transparent(model_color(0), 0.22)
                band.update(fill="toself", fillcolor=shade, hoverinfo="skip")
                figure.add_trace(band, row + 1, 1)
            line = {"color": model_color(count), "width": 1.4}
            figure.add_trace(_line(at, values, study["label"], line, row == 0), row + 1, 1)
        figure.update_yaxes(title="%s<br>[%s]" % (label, unit), row=row + 1, col=1)
        if reach > 0:
            figure.update_yaxes(range=[-reach, reach], row=row + 1, col=1)
    for event in studies[0]["missing"].numbers["disturbances"]:
        figure.add_vrect(
            x0=event["start"], x1=event["end"], fillcolor="#888888", opacity=0.35, line_width=0
        )
    figure.update_xaxes(title="time since the start of the run [s]", row=3, col=1)
    figure.update_layout(legend={"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 0})
    return _finish(figure, 430)


def shares(by_model: Sequence[Tuple[str, Sequence[Document]]]) -> Document:
    """What the failure depends on: share of the variance of error and missing wrench that each variable
    explains beyond chance, mean over runs. by_model: label and its studies, of all runs."""
    rows = ["error of " + c[0] for c in CHANNELS] + ["missing " + c[0] for c in WRENCH]
    figure = make_subplots(
        rows=1,
        cols=len(by_model),
        subplot_titles=[label for label, _ in by_model],
        shared_yaxes=True,
        horizontal_spacing=0.03,
    )
    for column, (_, studies) in enumerate(by_model, 1):
        names = [n for n in studies[0]["where"] if n != "position"]
        table = [
            [np.mean([s["where"][n]["share"][c]["share"] for s in studies]) for n in names]
            for c, _, _ in CHANNELS
        ]
        for channel, _ in WRENCH:
            entries = [s["missing"].numbers["channels"][channel] for s in studies]
            table.append([np.mean([_share_of_missing(e, n) for e in entries]) for n in names])
        percent = 100 * np.array(table)
        figure.add_trace(
            go.Heatmap(
                z=np.round(percent, 1).tolist(),
                x=names,
                y=rows,
                zmin=0,
                zmax=100,
                colorscale="Oranges",
                showscale=False,
                hovertemplate="%{y} by %{x}: %{z:.0f}%<extra></extra>",
            ),
            1,
            column,
        )
        for i, row in enumerate(rows):
            for j, name in enumerate(names):
                if percent[i, j] >= 10:
                    figure.add_annotation(
                        x=name,
                        y=row,
                        text="%.0f" % percent[i, j],
                        showarrow=False,
                        font={"size": 11, "color": "#fff" if percent[i, j] > 60 else "#222"},
                        row=1,
                        col=column,
                    )
    figure.update_yaxes(autorange="reversed", automargin=True)
    figure.update_xaxes(tickangle=-45)
    return _finish(figure, 330, margin={"t": 40, "b": 70, "l": 20, "r": 10})


def _share_of_missing(entry: Document, name: str) -> float:
    """Share of a wrench that a variable explains; 0 for a wrench within its uncertainty."""
    return float(0.0 if failure.is_nothing(entry) else entry["against"][name]["share"]["share"])


def _finish(figure: go.Figure, height: int, **layout: Any) -> Document:
    layout.setdefault("margin", {"t": 50, "b": 50, "l": 70, "r": 10})
    figure.update_layout(
        template="plotly_white",
        height=height,
        font={"family": "system-ui, sans-serif", "size": 12},
        **layout,
    )
    finished: Document = figure.to_plotly_json()
    return finished


def _line(
    x: ArrayLike, y: ArrayLike, name: str, line: Document, legend: bool, opacity: float = 1.0
) -> go.Scatter:
    return go.Scatter(
        x=_short(x),
        y=_short(y),
        name=name,
        legendgroup=name,
        mode="lines",
        line=line,
        opacity=opacity,
        showlegend=legend,
        hovertemplate="%{y:.4g}",
    )


def _timed(trace: go.Scatter, times: ArrayLike) -> go.Scatter:
    """A path that knows when it was where: the page shows the part that is zoomed into."""
    trace.update(customdata=_short(times), meta="path")
    trace.update(hovertemplate="%{customdata:.2f} s: x %{y:.3f} m, y %{x:.3f} m")
    return trace


def _bins(
    entry: Document,
    values: ArrayLike,
    name: str,
    shade: str,
    legend: bool,
    errors: Optional[ArrayLike] = None,
) -> go.Scatter:
    return go.Scatter(
        x=_short(entry["centres"]),
        y=_short(values),
        name=name,
        legendgroup=name,
        showlegend=legend,
        mode="lines+markers",
        marker={"size": 4, "color": shade},
        line={"width": 1.4, "color": shade},
        error_y=(
            None
            if errors is None
            else {"array": _short(errors), "width": 0, "thickness": 1.2, "color": shade}
        ),
        hovertemplate="%{x:.3g}: %{y:.3g}",
    )


def _small_multiples(rows: int, columns: int) -> go.Figure:
    figure = make_subplots(
        rows=rows, cols=columns, horizontal_spacing=0.012, vertical_spacing=0.035
    )
    figure.update_layout(legend={"orientation": "h", "y": 1.03, "yanchor": "bottom", "x": 0})
    figure.update_xaxes(tickfont={"size": 9}, title_font={"size": 11}, nticks=4)
    figure.update_yaxes(tickfont={"size": 9}, title_font={"size": 11})
    return figure


def _axes_of(
    figure: go.Figure, row: int, column: int, entry: Document, limits: Optional[Sequence[float]]
) -> None:
    last = row == 2
    figure.update_xaxes(
        title="%s<br>[%s]" % (short_label(entry), entry["unit"]) if last else None,
        showticklabels=last,
        row=row + 1,
        col=column + 1,
    )
    figure.update_yaxes(range=limits, showticklabels=column == 0, row=row + 1, col=column + 1)


def _percent(
    figure: go.Figure, row: int, column: int, columns: int, share: Mapping[str, float]
) -> None:
    named = failure.is_named(share)
    which = row * columns + column + 1
    figure.add_annotation(
        text="%s%.0f%%%s" % ("<b>" * named, 100 * share["share"], "</b>" * named),
        xref="x%s domain" % (which if which > 1 else ""),
        yref="y%s domain" % (which if which > 1 else ""),
        x=0.98,
        y=0.99,
        xanchor="right",
        yanchor="top",
        showarrow=False,
        font={"size": 10, "color": "#b04a00" if named else "#999999"},
    )


def _every(times: Array) -> slice:
    return slice(None, None, max(1, int(np.ceil(len(times) / MOST))))


def _thinned(piece: Document, step: int) -> List[Array]:
    """Times, velocities and poses of a window; its last sample always."""
    return _fewer((piece["times"], piece["nu"], piece["eta"]), step)


def _fewer(series: Sequence[Array], step: int) -> List[Array]:
    """One row in `step` of arrays of the same length, and the last."""
    count = len(series[0])
    index = np.unique(np.append(np.arange(0, count, step), count - 1))
    return [values[index] for values in series]


def _with_gaps(times: Array, *series: Array) -> List[Array]:
    """Times and series with NaN inside gaps, where no line shall be."""
    usual = np.median(np.diff(times)) if len(times) > 1 else 0.0
    at = np.flatnonzero(np.diff(times) > repair.MAX_GAP + 2 * usual) + 1
    return [np.insert(s, at, np.nan, axis=0) for s in (times,) + series]


def _band(times: Array, low: Array, high: Array) -> Tuple[Array, Array]:
    """Outline of what is between two curves, NaN between stretches."""
    x: List[ArrayLike] = []
    y: List[ArrayLike] = []
    whole = np.flatnonzero(np.isfinite(times))
    for part in np.split(whole, np.flatnonzero(np.diff(whole) > 1) + 1):
        x += [times[part], times[part][::-1], [np.nan]]
        y += [high[part], low[part][::-1], [np.nan]]
    return np.concatenate(x), np.concatenate(y)


def _commands(run: _core.RunData, column: int, scale: float) -> Tuple[Array, Array]:
    """When a command changes, and to what; 0..1."""
    inputs = np.array(run.inputs)
    start, end = run.times[0], run.times[-1]
    values = inputs[:, column] / scale
    keep = np.append(True, np.diff(values) != 0) & (inputs[:, 0] < end)
    at, values = inputs[keep, 0], values[keep]
    first = max(0, np.searchsorted(at, start, side="right") - 1)
    at, values = np.maximum(at[first:], start), values[first:]
    return np.append(at, end), np.append(values, values[-1:])


def _short(values: ArrayLike) -> List[Optional[float]]:
    """Numbers of five digits, None where there is none: pages stay small."""
    return [float("%.5g" % v) if np.isfinite(v) else None for v in np.asarray(values, float)]
