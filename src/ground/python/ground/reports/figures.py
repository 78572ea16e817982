"""Figures of measurement and model: each plot is described here once, as a plotly figure.

The page (ground.reports.page) shows them, ground.reports.picture draws them into files. Each takes
what ground.reports.inspection found out about one run by one or more models, and
gives what plotly's `to_plotly_json` gives, with the caption in layout.meta.
"""

from typing import Any, Iterable, List, Mapping, Optional, Sequence, Tuple

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from ground.analysis import bands as bands_of
from ground.analysis import failure, residuals
from ground.annotations import Array, ArrayLike, Document
from ground.recordings import repair, windows
from ground.reports.appearance import (
    CHANNELS,
    ERROR_AGAINST,
    FLOOR,
    LEFT,
    MEASURED,
    MODELS,
    NUMBERS,
    RIGHT,
    WARNING,
    WRENCH,
    WRENCH_AGAINST,
    model_color,
    numbers_row,
    scaled,
    short_label,
    transparent,
)
from ground.reports.words import number

MOST = 1000  # points of a curve; what is left out is said
TIME = "time since the start of the run [s]"
Y_AXIS, X_AXIS = "y [m] (world_ned)", "x [m] (world_ned)"  # of what is seen from above
ERROR = (
    "Error: mean over samples of |e_u|/σ_u + |e_v|/σ_v + |e_r|/σ_r, windows of 1.5 s, each from "
    "initial velocities of its own; σ are the run's standard deviations."
)
TABLE_HEAD, TABLE_ROW = 26, 24  # heights of a row [pixels]
SHADE = "#f5822a"  # behind what a variable explains
ARROW_HEAD = 0.3  # of the length of an arrow


def fall(steps: Sequence[Tuple[str, float]], floor: Optional[float], measured_on: str) -> Document:
    """Bars of the error (pairs of label and error, from top), and the noise floor or None."""
    labels, errors = [s[0] for s in steps], [s[1] for s in steps]
    figure = go.Figure(
        go.Bar(
            x=short(errors),
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
    figure.update_xaxes(title_text="error on %s [-]" % measured_on, range=[0, 1.15 * max(errors)])
    figure.update_yaxes(autorange="reversed", automargin=True)
    margin = {"t": 40, "b": 50, "l": 20, "r": 20}
    return finish(figure, 130 + 34 * len(steps), ERROR, margin=margin)


def motion(studies: Sequence[Document], bands: Optional[bands_of.Bands] = None) -> Document:
    """Velocities and commands over time, the path from above and the numbers of every model.

    bands: of the last model, drawn behind the velocities.
    """
    run = studies[0]["run"]
    times, nu, eta = np.array(run.times), np.array(run.nu), np.array(run.eta)
    heights = [155, 155, 155, 88, 30, TABLE_HEAD + TABLE_ROW * len(studies) + 2]
    figure = make_subplots(
        rows=6,
        cols=2,
        specs=[[{}, {"rowspan": 4}]]
        + [[{}, None]] * 3
        + [[None, None], [{"type": "table", "colspan": 2}, None]],
        column_widths=[0.64, 0.36],
        row_heights=heights,
        horizontal_spacing=0.08,
        vertical_spacing=0.025,
    )
    every = _every(times)
    if bands is not None:
        _add_bands(figure, bands, every.step, model_color(len(studies) - 1))
    shown = _with_gaps(times[every], nu[every], eta[every])
    _add_motion(figure, shown, "measured", {"color": MEASURED, "width": 4}, 0.45)
    for count, study in enumerate(studies):
        pieces = [_thinned(p, every.step) for p in study["evaluation"].pieces]
        ended = [[np.concatenate([a, np.full_like(a[:1], np.nan)]) for a in p] for p in pieces]
        line = {"color": model_color(count), "width": 1.6}
        together = [np.concatenate(parts) for parts in zip(*ended)]
        _add_motion(figure, together, study["label"], line)
    start = {"size": 7, "color": MEASURED}
    figure.add_scatter(
        x=short(eta[:1, 1]),
        y=short(eta[:1, 0]),
        name="start",
        mode="markers",
        marker=start,
        row=1,
        col=2,
    )
    _add_commands(figure, studies[0], 4)
    _add_numbers(figure, studies)
    figure.update_xaxes(matches="x4", range=[float(times[0]), float(times[-1])], col=1)
    figure.update_xaxes(title_text=Y_AXIS, row=1, col=2)
    figure.update_yaxes(title_text=X_AXIS, scaleanchor="x2", row=1, col=2)
    for count, study in enumerate(s for s in studies if _axes_differ(s)):
        text = "<b>BODY AXES DIFFER: thrust acts at %.0f deg<br>from the body x axis of %s</b>"
        angle = study["missing"].numbers["thrust"]["measured"]["angle_deg"]
        note(figure, 1, 2, text % (angle, study["label"]), WARNING, 0.5, 34 * count)
    figure.update_layout(hovermode="x")
    top = 50 if bands is None else 85
    height = sum(heights) + 100 + top
    return finish(
        figure, height, _motion_caption(run, every.step, bands), margin={"t": top, "b": 10}
    )


def _add_motion(
    figure: go.Figure, series: Sequence[Array], name: str, line: Document, opacity: float = 1.0
) -> None:
    """Velocities over time and the path of times, velocities and poses."""
    times, nu, eta = series
    for row, (_, label, unit) in enumerate(CHANNELS):
        trace = curve(times, nu[:, row], name, line, row == 0, opacity)
        figure.add_trace(trace, row + 1, 1)
        figure.update_yaxes(title_text="%s [%s]" % (label, unit), row=row + 1, col=1)
    figure.add_trace(_timed(curve(eta[:, 1], eta[:, 0], name, line, False, opacity), times), 1, 2)


def _add_commands(figure: go.Figure, study: Document, row: int) -> None:
    """Commands over time in a row, and the time under the rows above it."""
    for column, label, shade in ((1, "left", LEFT), (2, "right", RIGHT)):
        at, values = _commands(study["run"], column, study["model"].input_max)
        line = {"color": shade, "width": 1.2, "shape": "hv"}
        figure.add_trace(curve(at, values, "command " + label, line, True), row, 1)
    figure.update_yaxes(title_text="input [-]", row=row, col=1)
    for above in range(1, row):
        figure.update_xaxes(showticklabels=False, row=above, col=1)
    figure.update_xaxes(title_text=TIME, row=row, col=1)


def _add_numbers(figure: go.Figure, studies: Sequence[Document]) -> None:
    rows = [numbers_row(s["label"], s["role"], s["numbers"]) for s in studies]
    plain = [["#222222"] * len(rows)] * (len(NUMBERS) - 1)
    labels = [[model_color(count) for count in range(len(rows))]]
    line, fill = {"color": "#dddddd"}, {"color": "#ffffff"}
    figure.add_table(
        header={
            "values": NUMBERS,
            "height": TABLE_HEAD,
            "font": {"size": 11, "color": "#222222"},
            "fill": {"color": "#f2f2f0"},
            "line": line,
        },
        cells={
            "values": list(zip(*rows)),
            "height": TABLE_ROW,
            "font": {"size": 11, "color": labels + plain},
            "fill": fill,
            "line": line,
        },
        columnwidth=[2.2, 1, 0.9, 1.3, 1, 0.8, 0.8, 0.8, 1.3],
        row=6,
        col=1,
    )


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
            trace = curve(x, y, name, {"width": 0, "color": shade}, row == 0)
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
    menu: Document = {"type": "buttons", "direction": "right", "buttons": buttons}
    menu.update(font={"size": 11}, active=bands_of.HORIZONS.index(windows.WINDOW))
    menu.update(x=0, xanchor="left", y=1.075, yanchor="bottom", pad={"t": 0, "b": 0})
    if buttons:
        figure.update_layout(updatemenus=[menu])


def _motion_caption(run: Any, step: int, bands: Optional[bands_of.Bands]) -> str:
    caption = (
        "Run %s: velocities in the body frame, path in world_ned seen from above; models start "
        "anew every 1.5 s." % run.name
    )
    if step > 1:
        caption += " One sample in %d is drawn." % step
    if bands is not None:
        caption += (
            " Shaded: %.0f%% prediction band of a fit without this run. It starts anew every %g s "
            "(or as the buttons say) from the poses up to there; random wrench and noise are in it."
            % (100 * bands_of.PART, windows.WINDOW)
        )
    return caption


def where(studies: Sequence[Document]) -> Document:
    """Normalised error of each channel against what was measured, of every model, and a map of the
    last one's."""
    against = ERROR_AGAINST
    figure = _small_multiples(3, len(against) + 1)
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
                _percent(figure, row, column, entry["share"][channel], model_color(count), count)
            _axes_of(figure, row, column, studies[0]["where"][name], [0, 1.15 * top])
        figure.update_yaxes(title_text="%s<br>mean |error|/σ [-]" % label, row=row + 1, col=1)
        _add_map(figure, row, len(against), studies[-1]["where"]["position"], channel)
    caption = (
        "Run %s, windows of 1.5 s; percentage: share of its variance that the variable explains "
        "beyond chance, bold where that is worth naming. Right: mean |error|/σ of %s, place by place."
        % (studies[0]["run"].name, studies[-1]["label"])
    )
    return finish(figure, 540, caption, margin={"r": 115})


def _add_map(figure: go.Figure, row: int, column: int, entry: Document, channel: str) -> None:
    """Mean error place by place, seen from above."""
    x, y = np.array(entry["centres"]).T
    at = {"row": row + 1, "col": column + 1}
    bottom, top = figure.get_subplot(**at).yaxis.domain
    title = {"text": "mean |error|/σ [-]", "side": "right", "font": {"size": 10}}
    bar = {"x": 1.045, "y": (bottom + top) / 2, "len": top - bottom, "thickness": 8}
    marker = {
        "symbol": "square",
        "size": 12,
        "color": short(entry["error"][channel]),
        "colorscale": "Viridis",
        "cmin": 0,
        "colorbar": dict(bar, title=title, tickfont={"size": 9}),
    }
    figure.add_scatter(
        x=short(y),
        y=short(x),
        mode="markers",
        marker=marker,
        showlegend=False,
        hovertemplate="x %{y:.2f} m, y %{x:.2f} m: %{marker.color:.3g}<extra></extra>",
        **at,
    )
    figure.update_xaxes(range=_around(y), showticklabels=row == 2, **at)
    figure.update_yaxes(range=_around(x), title_text="x [m]", side="right", nticks=5, **at)
    if row == 2:
        figure.update_xaxes(title_text="y [m]<br>(world_ned)", **at)


def _around(values: Array) -> List[float]:
    """Limits with room for the marks of the outermost values."""
    room = max(0.13 * float(np.ptp(values)), 0.1)
    return [float(values.min()) - room, float(values.max()) + room]


def residual_correlation(studies: Sequence[Document]) -> Document:
    """Correlation of one-step residuals of every model with themselves and with the commands."""
    columns = [
        ("autocorrelation", "with itself, this much earlier"),
        ("input_sum", "with the command u_L+u_R, this much earlier"),
        ("input_difference", "with the command u_L-u_R, this much earlier"),
    ]
    figure = make_subplots(
        rows=3,
        cols=len(columns),
        horizontal_spacing=0.045,
        vertical_spacing=0.05,
        subplot_titles=[title for _, title in columns],
    )
    figure.update_annotations(font_size=12)
    for row, channel in enumerate(residuals.CHANNELS):
        for column, (kind, _) in enumerate(columns):
            for count, study in enumerate(studies):
                entry = study["residuals"]["channels"][channel][kind]
                _add_correlation(figure, row, column, entry, study["label"], count)
            figure.update_xaxes(
                title_text="lag [ms]" if row == 2 else None,
                showticklabels=row == 2,
                row=row + 1,
                col=column + 1,
            )
            entries = [s["residuals"]["channels"][channel][kind] for s in studies]
            values = [np.abs(e["value"]).max() for e in entries if e is not None]
            reach = 1.15 * max(values + [0.15])
            figure.update_yaxes(range=[-reach, 1.2 * reach], row=row + 1, col=column + 1)
        figure.update_yaxes(
            title_text="residual %s<br>correlation [-]" % channel, row=row + 1, col=1
        )
    figure.update_yaxes(**_zero_line())
    figure.update_xaxes(**_zero_line())
    caption = (
        "Run %s: residuals from one pose to the next (Kalman filter around the model). Shaded: "
        "%.0f%% band, where those of a true model stay."
        % (studies[0]["run"].name, 100 * residuals.BAND)
    )
    return finish(figure, 560, caption, legend_y=1.06, margin={"t": 65})


def _add_correlation(
    figure: go.Figure, row: int, column: int, entry: Optional[Document], label: str, count: int
) -> None:
    """Correlation at each lag, its band, and how many lags are outside; None: it has no such one."""
    shade = model_color(count)
    if entry is None:
        text = "the command never changes"
    else:
        lags, band = 1e3 * np.array(entry["lag_seconds"]), np.array(entry["band99"])
        figure.add_trace(_shaded(lags, -band, band, shade, 0.13), row + 1, column + 1)
        trace = _bins(dict(entry, centres=lags), entry["value"], label, shade, row == column == 0)
        figure.add_trace(trace, row + 1, column + 1)
        text = "%d of %d outside" % (entry["outside"], entry["lags"])
    note(figure, row + 1, column + 1, text, shade, 0.98, 14 * count)


def wrench(studies: Sequence[Document], winner: Optional[str] = None, first: int = 0) -> Document:
    """The wrench that is missing in every model, against what was measured, with two standard errors,
    and what the winner accounts for of the first. first: place of the first among the models."""
    against = WRENCH_AGAINST
    figure = _small_multiples(3, len(against))
    for row, (channel, label) in enumerate(WRENCH):
        entries = [s["missing"].numbers["channels"][channel] for s in studies]
        factor, unit = scaled(entries[0])
        means = [factor * np.array(e["against"][n]["mean"]) for e in entries for n in against]
        reach = 1.4 * max(np.quantile(np.abs(m), 0.9) for m in means)
        for column, name in enumerate(against):
            legend = row == column == 0
            for count, (study, entry) in enumerate(zip(studies, entries), first):
                one, shade = entry["against"][name], model_color(count)
                values, errors = (factor * np.array(one[n]) for n in ("mean", "standard_error"))
                trace = _bins(one, values, study["label"], shade, legend, 2 * errors)
                figure.add_trace(trace, row + 1, column + 1)
                _percent(figure, row, column, one["share"], shade, count - first)
            accounted = entries[0].get("accounted")
            if accounted is not None:
                line = {"color": MEASURED, "width": 2, "dash": "dot"}
                at = entries[0]["against"][name]["centres"]
                told = factor * np.array(accounted["mean"][name])
                text = "what %s adds to %s" % (winner, studies[0]["label"])
                figure.add_trace(curve(at, told, text, line, legend), row + 1, column + 1)
            _shade(figure, row, column, [entry["against"][name]["share"] for entry in entries])
            limits = [-reach, reach] if reach > 0 else None
            _axes_of(figure, row, column, entries[0]["against"][name], limits)
        figure.update_yaxes(title_text="%s<br>[%s]" % (label, unit), row=row + 1, col=1)
    figure.update_yaxes(**_zero_line())
    return finish(figure, 540, _wrench_caption(studies, winner))


def _wrench_caption(studies: Sequence[Document], winner: Optional[str]) -> str:
    caption = (
        "Run %s: missing wrench in the body frame, by a Kalman smoother, against what was measured; "
        "bars: two standard errors; percentage and shade: share of its variance that the variable "
        "explains beyond chance, bold where that is worth naming." % studies[0]["run"].name
    )
    channels = studies[0]["missing"].numbers["channels"]
    if "accounted" not in channels["X"]:
        return caption
    return caption + (
        " Dotted: what %s predicts of it; it accounts for (of the mean square) %s."
        % (
            winner,
            ", ".join(
                "%s %.0f%%" % (c, max(0.0, 100 * entry["accounted"]["share"]))
                for c, entry in channels.items()
            ),
        )
    )


def _shade(figure: go.Figure, row: int, column: int, named: Iterable[Mapping[str, float]]) -> None:
    """A background that says how large the largest share is that is worth naming."""
    largest = max((share["share"] for share in named if failure.is_named(share)), default=0.0)
    if largest > 0:
        figure.add_shape(
            type="rect",
            xref="x domain",
            yref="y domain",
            x0=0,
            x1=1,
            y0=0,
            y1=1,
            fillcolor=transparent(SHADE, 0.5 * largest),
            line_width=0,
            layer="below",
            row=row + 1,
            col=column + 1,
        )


def wrench_over_time(studies: Sequence[Document], first: int = 0) -> Document:
    """The wrench that is missing in every model over time, with two standard deviations of the first,
    the commands, the force that they bring about, and the mean missing force place by place.

    first: place of the first among the models.
    """
    figure = make_subplots(
        rows=4,
        cols=3,
        specs=[[{}, {"rowspan": 4}, {"rowspan": 4}]] + [[{}, None, None]] * 3,
        column_widths=[0.58, 0.2, 0.22],
        row_heights=[0.28, 0.28, 0.28, 0.16],
        horizontal_spacing=0.055,
        vertical_spacing=0.03,
    )
    run = studies[0]["run"]
    for row, (channel, label) in enumerate(WRENCH):
        numbers = [s["missing"].numbers["channels"][channel] for s in studies]
        factor, unit = scaled(numbers[0])
        reach = 0.0
        for count, study in enumerate(studies):
            missing, shade = study["missing"], model_color(first + count)
            every = _every(missing.times)
            at, values, sigma = _with_gaps(
                missing.times[every],
                factor * missing.wrench[every, row],
                factor * missing.sigma[every, row],
            )
            reach = max(reach, 1.15 * np.nanquantile(np.abs(values) + 2 * sigma, 0.995))
            if count == 0:
                shaded = _shaded(at, values - 2 * sigma, values + 2 * sigma, shade, 0.22)
                figure.add_trace(shaded, row + 1, 1)
            line = {"color": shade, "width": 1.4}
            figure.add_trace(curve(at, values, study["label"], line, row == 0), row + 1, 1)
        figure.update_yaxes(
            title_text="%s<br>[%s]" % (label, unit), **_zero_line(), row=row + 1, col=1
        )
        text = "rms %s %s; full thrust gives %.3g" % (
            ", ".join("%.3g" % (factor * entry["rms"]) for entry in numbers),
            unit,
            factor * numbers[0]["full_scale"],
        )
        note(figure, row + 1, 1, text, MEASURED, 0.01, bgcolor="rgba(255,255,255,0.7)")
        if reach > 0:
            figure.update_yaxes(range=[-reach, reach], row=row + 1, col=1)
    _add_commands(figure, studies[0], 4)
    figure.update_xaxes(matches="x6", range=[float(run.times[0]), float(run.times[-1])], col=1)
    for event in studies[0]["missing"].numbers["disturbances"]:
        figure.add_vrect(
            x0=event["start"],
            x1=event["end"],
            fillcolor="#888888",
            opacity=0.35,
            line_width=0,
            col=1,
        )
    _add_thrust(figure, studies, first)
    _add_force_map(figure, studies, first)
    caption = (
        "Run %s: missing wrench in the body frame; shaded: two standard deviations of the "
        "estimate. Grey: left out, for no input explains the motion (contact, hand, wrong poses). "
        "Middle: force that a lasting thrust command brings about, seen from above. Right: mean "
        "missing force in the axes of world_ned, place by place." % run.name
    )
    return finish(figure, 480, caption)


def _add_thrust(figure: go.Figure, studies: Sequence[Document], first: int) -> None:
    """Body axes from above, with the force per unit of command by each model and as measured."""
    figure.update_xaxes(visible=False, range=[-1.35, 1.35], row=1, col=2)
    figure.update_yaxes(visible=False, range=[-2.3, 1.5], scaleanchor="x2", row=1, col=2)
    thrusts = [(s["label"], s["missing"].numbers["thrust"]) for s in studies]
    if thrusts[0][1] is None:
        note(figure, 1, 2, "the thrust command<br>never changes", MEASURED, 0.5)
        return
    round_it = np.linspace(0, 2 * np.pi, 61)
    grey = {"color": "#999999", "width": 1}
    circle = curve(0.32 * np.sin(round_it), 0.32 * np.cos(round_it), "", grey, False)
    figure.add_trace(circle, 1, 2)
    figure.add_trace(arrows([0, 0], [0, 0], [0, 1.15], [1.25, 0], "body axes", grey, 0.1), 1, 2)
    for x, y, text in ((0, 1.25, "x ahead"), (1.15, 0, "y starboard")):
        figure.add_annotation(
            x=x,
            y=y,
            text=text,
            showarrow=False,
            yanchor="bottom",
            xanchor="center" if x == 0 else "right",
            font={"size": 10, "color": "#777777"},
            row=1,
            col=2,
        )
    forces = [
        (label, thrust["model"], model_color(count), 6)
        for count, (label, thrust) in enumerate(thrusts, first)
    ] + [("measured", thrusts[0][1]["measured"], MEASURED, 2.5)]
    largest = max(force["force_per_unit_input"] for _, force, _, _ in forces) or 1.0
    lines = []
    for label, force, shade, width in forces:
        angle, size = np.radians(force["angle_deg"]), force["force_per_unit_input"]
        along = size / largest
        tip = [along * np.sin(angle)], [along * np.cos(angle)]
        line = {"color": shade, "width": width}
        figure.add_trace(arrows([0], [0], *tip, label, line, opacity=0.8), 1, 2)
        lines.append(
            (
                "%s:<br>%.3g N per unit at %.0f deg"
                % (label, size, round(force["angle_deg"]) + 0.0),
                shade,
            )
        )
    lines += [
        ("<b>BODY AXES DIFFER<br>by %.0f deg: %s</b>" % (thrust["off_deg"], label), WARNING)
        for label, thrust in thrusts
        if thrust["body_axes_differ"]
    ]
    for count, (text, shade) in enumerate(reversed(lines)):
        note(figure, 1, 2, text, shade, 0.5, -32 * count, y=0)


def _add_force_map(figure: go.Figure, studies: Sequence[Document], first: int) -> None:
    """Mean missing force in the world's axes, cell by cell, and the size of the longest arrow."""
    forces = [_mean_force(study["missing"]) for study in studies]
    largest = max(np.hypot(*force.T).max() for _, force in forces)
    position = studies[0]["missing"].position
    path = curve(
        position[:, 1], position[:, 0], "path", {"color": MEASURED, "width": 0.8}, False, 0.3
    )
    figure.add_trace(path, 1, 3)
    side = max(np.ptp(position, axis=0).max(), 1e-3) / failure.MAP_CELLS
    for count, (study, (places, force)) in enumerate(zip(studies, forces), first):
        scaled_force = force * side / (largest or 1.0)
        line = {"color": model_color(count), "width": 1.5}
        at = places[:, 1], places[:, 0], scaled_force[:, 1], scaled_force[:, 0]
        figure.add_trace(arrows(*at, study["label"], line), 1, 3)
    figure.update_xaxes(title_text=Y_AXIS, row=1, col=3)
    figure.update_yaxes(title={"text": X_AXIS, "standoff": 0}, scaleanchor="x3", row=1, col=3)
    note(figure, 1, 3, "longest arrow: %.2g N" % largest, MEASURED, 0.98)


def _mean_force(missing: Any) -> Tuple[Array, Array]:
    """Cells (n, 2) x, y [m] of the map, and the mean missing force in each (n, 2) [N], world_ned."""
    centres = np.array(missing.numbers["channels"]["X"]["against"]["position"]["centres"])
    c, s = np.cos(missing.heading), np.sin(missing.heading)
    body = missing.wrench[:, :2]
    world = np.column_stack([c * body[:, 0] - s * body[:, 1], s * body[:, 0] + c * body[:, 1]])
    nearest = np.argmin(((missing.position[:, None, :] - centres[None]) ** 2).sum(axis=2), axis=1)
    present = np.unique(nearest)
    return centres[present], np.array([world[nearest == i].mean(axis=0) for i in present])


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
    runs = len(by_model[0][1])
    caption = (
        "Share of the variance [%%] of the error and of the missing wrench that each variable "
        "explains beyond chance, mean of %d run%s. u, v, r: surge, sway, yaw rate; X, Y, N: surge "
        "force, side force, yaw moment; all in the body frame." % (runs, "s" * (runs > 1))
    )
    return finish(figure, 330, caption, margin={"t": 40, "b": 70, "l": 20})


def _share_of_missing(entry: Document, name: str) -> float:
    """Of a wrench that is there; none of one that is within its uncertainty."""
    return 0.0 if failure.is_nothing(entry) else float(entry["against"][name]["share"]["share"])


def _axes_differ(study: Document) -> bool:
    thrust = study["missing"].numbers["thrust"]
    return thrust is not None and bool(thrust["body_axes_differ"])


def finish(
    figure: go.Figure,
    height: int,
    caption: str,
    margin: Mapping[str, int] = {},
    legend_y: float = 1.02,
) -> Document:
    figure.update_xaxes(title_font_size=11)
    figure.update_yaxes(title_font_size=11)
    figure.update_layout(
        template="plotly_white",
        height=height,
        meta=caption,
        font={"family": "system-ui, sans-serif", "size": 12},
        margin=dict({"t": 50, "b": 50, "l": 70, "r": 10}, **margin),
        legend={"orientation": "h", "y": legend_y, "yanchor": "bottom", "x": 0},
    )
    finished: Document = figure.to_plotly_json()
    return finished


def _zero_line() -> Document:
    return {"zeroline": True, "zerolinecolor": "#888888", "zerolinewidth": 1}


def curve(
    x: Any, y: Any, name: str, line: Document, legend: bool, opacity: float = 1.0
) -> go.Scatter:
    return go.Scatter(
        x=short(x),
        y=short(y),
        name=name,
        legendgroup=name,
        mode="lines",
        line=line,
        opacity=opacity,
        showlegend=legend,
        hovertemplate="%{y:.4g}",
    )


def _shaded(x: Array, low: Array, high: Array, shade: str, opacity: float) -> go.Scatter:
    """What is between two curves."""
    outline = _band(x, low, high)
    trace = curve(outline[0], outline[1], "", {"width": 0, "color": shade}, False)
    trace.update(fill="toself", fillcolor=transparent(shade, opacity), hoverinfo="skip")
    return trace.update(hovertemplate=None)


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
) -> go.Scatter:
    """Arrows from (x, y) that are (dx, dy) long. head: length of its two lines, as a share."""
    tail, along = np.array([x, y], float), np.array([dx, dy], float)
    across = np.array([-along[1], along[0]])
    tip, gap = tail + along, np.full_like(tail, np.nan)
    left, right = (tip - head * (along + side * 0.4 * across) for side in (-1, 1))
    strokes = np.stack([tail, tip, left, gap, tip, right, gap], axis=-1).reshape(2, -1)
    return curve(strokes[0], strokes[1], name, line, legend, opacity)


def _timed(trace: go.Scatter, times: Any) -> go.Scatter:
    """A path that knows when it was where: the page shows the part that is zoomed into."""
    trace.update(customdata=short(times), meta="path")
    trace.update(hovertemplate="%{customdata:.2f} s: x %{y:.3f} m, y %{x:.3f} m")
    return trace


def _bins(
    entry: Document,
    values: Any,
    name: str,
    shade: str,
    legend: bool,
    errors: Optional[Array] = None,
) -> go.Scatter:
    return go.Scatter(
        x=short(entry["centres"]),
        y=short(values),
        name=name,
        legendgroup=name,
        showlegend=legend,
        mode="lines+markers",
        marker={"size": 4, "color": shade},
        line={"width": 1.4, "color": shade},
        error_y=(
            None
            if errors is None
            else {"array": short(errors), "width": 0, "thickness": 1.2, "color": shade}
        ),
        hovertemplate="%{x:.3g}: %{y:.3g}",
    )


def _small_multiples(rows: int, columns: int) -> go.Figure:
    figure = make_subplots(
        rows=rows, cols=columns, horizontal_spacing=0.012, vertical_spacing=0.035
    )
    figure.update_xaxes(tickfont={"size": 9}, nticks=4)
    figure.update_yaxes(tickfont={"size": 9})
    return figure


def _axes_of(
    figure: go.Figure, row: int, column: int, entry: Document, limits: Optional[Sequence[float]]
) -> None:
    last = row == 2
    figure.update_xaxes(
        title_text="%s<br>[%s]" % (short_label(entry), entry["unit"]) if last else None,
        showticklabels=last,
        row=row + 1,
        col=column + 1,
    )
    figure.update_yaxes(range=limits, showticklabels=column == 0, row=row + 1, col=column + 1)


def _percent(
    figure: go.Figure, row: int, column: int, share: Mapping[str, float], shade: str, count: int
) -> None:
    """A share of the count-th model, bold when it is worth naming."""
    named = failure.is_named(share)
    text = "%s%.0f%%%s" % ("<b>" * named, 100 * share["share"], "</b>" * named)
    note(figure, row + 1, column + 1, text, shade, 0.98, 12 * count)


def note(
    figure: go.Figure,
    row: int,
    column: int,
    text: str,
    shade: str,
    x: float,
    down: float = 0.0,
    y: float = 0.99,
    **style: Any,
) -> None:
    """A text inside a panel at (x, y), as shares of it, and so many pixels further down."""
    figure.add_annotation(
        text=text,
        xref="x domain",
        yref="y domain",
        x=x,
        y=y,
        xanchor="center" if x == 0.5 else "left" if x < 0.5 else "right",
        yanchor="top" if y > 0.5 else "bottom",
        yshift=-down,
        showarrow=False,
        font={"size": 10, "color": shade},
        row=row,
        col=column,
        **style,
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
    """The same with NaN inside gaps, where no line shall be."""
    usual = np.median(np.diff(times)) if len(times) > 1 else 0.0
    at = np.flatnonzero(np.diff(times) > repair.MAX_GAP + 2 * usual) + 1
    return [np.insert(s, at, np.nan, axis=0) for s in (times,) + series]


def _band(times: Array, low: Array, high: Array) -> Tuple[Array, Array]:
    """Outline of what is between two curves, NaN between stretches."""
    x: List[Array] = []
    y: List[Array] = []
    gap = np.array([np.nan])
    whole = np.flatnonzero(np.isfinite(times))
    for part in np.split(whole, np.flatnonzero(np.diff(whole) > 1) + 1):
        x += [times[part], times[part][::-1], gap]
        y += [high[part], low[part][::-1], gap]
    return np.concatenate(x), np.concatenate(y)


def _commands(run: Any, column: int, scale: float) -> Tuple[Array, Array]:
    """When a command changes, and to what; 0..1."""
    inputs = np.array(run.inputs)
    start, end = run.times[0], run.times[-1]
    values = inputs[:, column] / scale
    keep = np.append(True, np.diff(values) != 0) & (inputs[:, 0] < end)
    at, values = inputs[keep, 0], values[keep]
    first = max(0, np.searchsorted(at, start, side="right") - 1)
    at, values = np.maximum(at[first:], start), values[first:]
    return np.append(at, end), np.append(values, values[-1:])


def short(values: Any) -> List[Optional[float]]:
    """Numbers of five digits, None where there is none: pages stay small."""
    return [float("%.5g" % v) if np.isfinite(v) else None for v in np.asarray(values, float)]
