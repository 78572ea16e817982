"""Figures of measurement and model: each is defined here once, as a plotly figure.

Each function takes the results of ground.reports.inspection for one run and one or more models. It
returns what plotly.graph_objects.Figure takes, with the caption in layout.meta.
"""

from typing import Any, List, Optional, Sequence, Tuple

import numpy as np

from ground.analysis import bands as bands_of
from ground.analysis import residuals
from ground.analysis.horizon import PredictionError
from ground.reports.appearance import CHANNELS, FLOOR, MEASURED, MODELS, model_color, model_line, wrapped
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
    note,
    outline,
    points,
    shaded,
    short,
    with_gaps,
)
from ground.reports.inspection import Inspection, PredictionBand, SimulatedMotion
from ground.reports.panels import Panels
from ground.reports.words import listed, two_digits
from ground.support.annotations import Array, Plotly, Style

LABEL_WIDTH = 24  # of a line of a bar's label [characters]


def predictions(found: PredictionError, shown: Sequence[Tuple[str, str]], title: str, data: str) -> Plotly:
    """Bars of how far predicted poses are off, and the noise floor.

    shown: names and labels of its models, from the top; data: what they predict, after "data".
    """
    labels = [wrapped(label, LABEL_WIDTH) for _, label in shown]
    figure = Panels(2, 1, gaps=(0.0, 0.3))
    for row, (key, unit) in enumerate((("position_mm", "mm"), ("heading_deg", "deg")), 1):
        values = [getattr(found.errors[name], key) for name, _ in shown]
        known = [v for v in values if np.isfinite(v)]
        floor, most = getattr(found.mocap, key), max(known, default=1.0)
        bar = {
            "type": "bar",
            "x": short([min(v, most) for v in values]),
            "y": labels,
            "orientation": "h",
            "text": ["%s %s" % (two_digits(v), unit) if v in known else "not finite" for v in values],
            "textposition": "outside",
            "cliponaxis": False,
            "marker": {"color": [MODELS[0]] * (len(shown) - 1) + [MODELS[1]]},
            "showlegend": False,
            "hovertemplate": "%{y}: %{text}<extra></extra>",
        }
        figure.add(bar, row, 1)
        figure.span(floor, floor, row, 1, line={"color": FLOOR, "dash": "dash", "width": 2})
        text = "noise floor: %s %s" % (two_digits(floor), unit)
        figure.note(
            text, floor, 1, row, 1, xref=figure.axis("x", 1, row), font={"color": FLOOR},
            yanchor="bottom", xanchor="left",
        )  # fmt: skip
        figure.update_xaxes(row, 1, range=[0, 1.35 * max(most, floor)], ticksuffix=" " + unit)
    figure.update_yaxes(autorange="reversed", automargin=True)
    lines = sum(1 + label.count("<br>") for label in labels)
    caption = (
        "Root mean square distance between predicted and measured pose, on data %s. Each prediction "
        "starts at the measured pose, at velocities from the time before." % data
    )
    height = 130 + 12 * len(shown) + 36 * lines
    return figure.finish(height, caption, {"t": 30, "b": 30, "l": 20, "r": 20}, title=title)


def motion(
    studies: Sequence[SimulatedMotion], bands: Optional[bands_of.Bands] = None, caption: str = ""
) -> Plotly:
    """Velocities and commands over time and the path from above, of every model.

    bands: the last model's, drawn behind the velocities; caption: instead of the usual one. The band of a
    study is drawn about the path, too.
    """
    run = studies[0].run
    times, nu, eta = np.array(run.times), np.array(run.nu), np.array(run.eta)
    figure = Panels(4, 2, [0.64, 0.36], [155, 155, 155, 88], gaps=(0.08, 0.025), tall=[2], shared="x")
    every = every_so_many(times)
    if bands is not None:
        _add_bands(figure, bands, every.step, model_color(len(studies) - 1))
    for count, study in enumerate(studies):
        if study.band:
            _add_band(figure, study, study.band, every.step, model_color(count))
    shown = with_gaps(times[every], nu[every], eta[every])
    _add_motion(figure, shown, "measured", {"color": MEASURED, "width": 4}, 0.35)
    for count, study in enumerate(studies):
        pieces = [fewer([p[n] for n in ("times", "nu", "eta")], every.step) for p in study.pieces]
        ended = [[np.concatenate([a, np.full_like(a[:1], np.nan)]) for a in p] for p in pieces]
        together = [np.concatenate(parts) for parts in zip(*ended)]
        _add_motion(figure, together, study.label, model_line(count, 1.6))
    start = {"size": 7, "color": MEASURED}
    figure.add(points(eta[:1, 1], eta[:1, 0], start, name="start"), 1, 2)
    add_commands(figure, studies[0].model, run, 4)
    for row, (_, label, unit) in enumerate(CHANNELS, 1):
        figure.update_yaxes(title="%s [%s]" % (label, unit), row=row, col=1)
    figure.update_xaxes(range=[float(times[0]), float(times[-1])], col=1)
    figure.update_xaxes(title=Y_AXIS, row=1, col=2)
    figure.update_yaxes(title=X_AXIS, scaleanchor="x2", row=1, col=2)
    caption = caption or _motion_caption(run, every.step, bands)
    return figure.finish(713, caption, title=motion_title(studies), hovermode="x")


def motion_title(studies: Sequence[SimulatedMotion]) -> str:
    """What the velocities show: which model follows them, and where the first one fails."""
    first, last = studies[0], studies[-1]
    by_channel = first.errors
    name = max(by_channel, key=lambda name: by_channel[name])
    share = 100 * by_channel[name] / max(1e-300, sum(by_channel.values()))
    channel = {c: label for c, label, _ in CHANNELS}[name]
    fails = "%.0f%% of the error (%s) is in the %s" % (share, first.label, channel)
    if first is last:
        return fails
    ratio = sum(first.errors.values()) / max(sum(last.errors.values()), 1e-300)
    if ratio < 1:
        return "%s; %s is no better" % (fails, last.label)
    return "%s; %s follows the motion %s times as well" % (fails, last.label, two_digits(ratio))


def _add_motion(
    figure: Panels, series: Sequence[Array], name: str, line: Style, opacity: float = 1.0
) -> None:
    """Adds velocities over time and the path; series: times, velocities and poses."""
    times, nu, eta = series
    for row in range(len(CHANNELS)):
        trace = curve(times, nu[:, row], name, line, row == 0, opacity)
        figure.add(trace, row + 1, 1)
    path = curve(eta[:, 1], eta[:, 0], name, line, False, opacity)
    # With its times, so that the page can show the part that is zoomed into.
    path.update(customdata=short(times), meta="path")
    path.update(hovertemplate="%{customdata:.2f} s: x %{y:.3f} m, y %{x:.3f} m")
    figure.add(path, 1, 2)


def _add_bands(figure: Panels, bands: bands_of.Bands, step: int, shade: str) -> None:
    """Adds bands with the horizon of a window to the rows of u, v, r."""
    tiles = [fewer(tile, step) for tile in bands.tiled(bands.unit)]
    for row in range(len(CHANNELS) if tiles else 0):
        outlines = [outline(times, low[:, 3 + row], high[:, 3 + row]) for times, low, high in tiles]
        x, y = (np.concatenate(parts) for parts in zip(*outlines))
        figure.add(area(x, y, "%.0f%% band" % (100 * bands_of.PART), shade, 0.2, row == 0), row + 1, 1)


def _add_band(figure: Panels, study: SimulatedMotion, band: PredictionBand, step: int, shade: str) -> None:
    """Adds the band of a prediction to the rows of u, v, r, and to both sides of the path."""
    name, rows, places = "%.0f%% band" % (100 * band.level), [], []
    for piece, low, high in zip(study.pieces, band.low, band.high):
        times, eta, low, high = fewer([piece["times"], piece["eta"], low, high], step)
        rows.append([outline(times, low[:, 3 + row], high[:, 3 + row]) for row in range(len(CHANNELS))])
        places += _swept(eta[:, :2], (high - low)[:, :2] / 2)
    for row in range(len(CHANNELS)):
        x, y = (np.concatenate([piece[row][i] for piece in rows]) for i in range(2))
        figure.add(area(x, y, name, shade, 0.2, row == 0), row + 1, 1)
    path = np.concatenate(places)
    figure.add(area(path[:, 1], path[:, 0], name, shade, 0.2, False), 1, 2)


def _swept(path: Array, half: Array) -> List[Array]:
    """Outlines, NaN between them, of the area that ellipses of half axes (n, 2) sweep along a path (n, 2)."""
    from scipy.spatial import ConvexHull

    turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    ellipses = path[:, None] + half[:, None] * ring
    outlines = []
    for first, last in zip(ellipses[: max(1, len(path) - 1)], ellipses[1:] if len(path) > 1 else ellipses):
        both = np.concatenate([first, last])
        hull = both[ConvexHull(both, qhull_options="QJ").vertices]
        outlines.append(np.concatenate([hull, hull[:1], np.full((1, 2), np.nan)]))
    return outlines


def _motion_caption(run: Any, step: int, bands: Optional[bands_of.Bands]) -> str:
    caption = (
        "Run %s: velocities in the body frame, path in world_ned seen from above; models restart "
        "every %.3g s." % (run.name, run.scales.window)
    )
    if step > 1:
        caption += " One sample in %d is drawn." % step
    if bands is not None:
        caption += (
            " Shaded: %.0f%% prediction band of a fit without this run. It restarts every %g s "
            "from the poses so far; it includes disturbance and noise." % (100 * bands_of.PART, bands.unit)
        )
    return caption


def residual_correlation(studies: Sequence[Inspection]) -> Plotly:
    """Correlation of one-step residuals of every model with themselves and with the commands."""
    columns = {"autocorrelation": "itself", **residuals.commands(studies[0].model)}
    figure = Panels(
        3,
        len(columns),
        gaps=(0.045, 0.05),
        shared="x",
        titles=["with %s, earlier" % name for name in columns.values()],
    )
    for row, channel in enumerate(studies[0].residuals.channels, 1):
        for col, kind in enumerate(columns, 1):
            entries = [getattr(s.residuals.channels[channel], kind) for s in studies]
            for count, (study, entry) in enumerate(zip(studies, entries)):
                _add_correlation(figure, row, col, entry, study.label, count)
            values = [np.abs(e.value).max() for e in entries if e is not None]
            reach = 1.15 * max(values + [0.15])
            figure.update_yaxes(range=[-reach, 1.2 * reach], row=row, col=col)
        figure.update_yaxes(title="residual %s<br>correlation [-]" % channel, row=row, col=1)
    figure.update_yaxes(**ZERO_LINE)
    figure.update_xaxes(**ZERO_LINE)
    figure.update_xaxes(title="lag [ms]", row=3)
    caption = (
        "Run %s: residuals from one pose to the next (Kalman filter around the model). Shaded: "
        "%.0f%% band of a true model's residuals." % (studies[0].run.name, 100 * residuals.BAND)
    )
    return figure.finish(560, caption, {"t": 65}, 1.06, title=residuals_title(studies))


def residuals_title(studies: Sequence[Inspection]) -> str:
    """What the residuals show: of each model, whether they follow something."""
    white = [s.label for s in studies if s.residuals.white]
    if len(white) == len(studies):
        return "The residuals are random: they depend neither on the commands nor on their own past"
    others = [s.label for s in studies if s.label not in white]
    told = "The residuals of %s depend on commands or on their own past" % listed(others)
    return told + ("; the residuals of %s are random" % listed(white) if white else "")


def _add_correlation(
    figure: Panels, row: int, col: int, entry: Optional[residuals.Correlation], label: str, count: int
) -> None:
    """Correlation at each lag, its band, and how many lags are outside; entry: None without one."""
    shade = model_color(count)
    if entry is None:
        text = "the command never changes"
    else:
        lags, band = 1e3 * np.array(entry.lag_seconds), np.array(entry.band99)
        figure.add(shaded(lags, -band, band, shade, 0.13), row, col)
        figure.add(bins(lags, entry.value, label, count, row == col == 1), row, col)
        text = "%d of %d outside" % (entry.outside, entry.lags)
    note(figure, row, col, text, shade, 0.98, 14 * count)
