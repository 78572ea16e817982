"""Figures of the missing wrench: against measured variables, over time and by place (plotly figures,
as in ground.reports.figures)."""

from typing import Any, Optional, Sequence, Tuple

import numpy as np

from ground.analysis import failure
from ground.annotations import Array, Document
from ground.reports.appearance import (
    LESS,
    MEASURED,
    WARNING,
    WRENCH,
    WRENCH_AGAINST,
    model_color,
    model_line,
    scaled,
    wrapped,
)
from ground.reports.figure_parts import (
    X_AXIS,
    Y_AXIS,
    ZERO_LINE,
    add_commands,
    arrows,
    bins,
    curve,
    every_so_many,
    note,
    note_share,
    shaded,
    small_multiples,
    with_gaps,
)
from ground.reports.panels import Panels

NAME_WIDTH = 18  # of a line of a model's name under the arrows of thrust [characters]


def wrench(studies: Sequence[Document], winner: Optional[str] = None) -> Document:
    """The missing wrench of every model against measured variables, with two standard errors, and the
    part of the first one's that the winner accounts for."""
    channels = [s["missing"].numbers["channels"] for s in studies]
    known = channels[0]["X"]["against"]
    against = [name for name in WRENCH_AGAINST if name in known]
    units = {channel: scaled(channels[0][channel]) for channel, _ in WRENCH}
    titles = ["%s<br>[%s]" % (label, units[channel][1]) for channel, label in WRENCH]
    figure = small_multiples([known[name] for name in against], titles)
    for row, (channel, _) in enumerate(WRENCH, 1):
        factor = units[channel][0]
        accounted = channels[0][channel].get("accounted")
        tops = []
        for col, name in enumerate(against, 1):
            for count, study in enumerate(studies):
                one = channels[count][channel]["against"][name]
                values, errors = (factor * np.array(one[n]) for n in ("mean", "standard_error"))
                tops.append(np.quantile(np.abs(values), 0.9))
                legend = row == col == 1
                trace = bins(one["centres"], values, study["label"], count, legend, 2 * errors)
                figure.add(trace, row, col)
                note_share(figure, row, col, one["share"], model_color(count), count)
            if accounted is not None:
                line = {"color": MEASURED, "width": 2, "dash": "dot"}
                values = factor * np.array(accounted["mean"][name])
                at, text = known[name]["centres"], "added by the last model"
                figure.add(curve(at, values, text, line, row == col == 1), row, col)
        reach = 1.4 * max(tops)
        if reach > 0:
            figure.update_yaxes(range=[-reach, reach], row=row)
    figure.update_yaxes(**ZERO_LINE)
    return figure.finish(554, _wrench_caption(studies, winner), {"b": 64})


def _wrench_caption(studies: Sequence[Document], winner: Optional[str]) -> str:
    caption = (
        "Run %s: missing wrench in the body frame, by a Kalman smoother, against what was measured; "
        "bars: two standard errors; percentage: share of its variance that the variable explains "
        "beyond chance, bold if significant." % studies[0]["run"].name
    )
    channels = studies[0]["missing"].numbers["channels"]
    if "accounted" not in channels["X"]:
        return caption
    shares = ", ".join(
        "%s %.0f%%" % (c, max(0.0, 100 * entry["accounted"]["share"]))
        for c, entry in channels.items()
    )
    text = " Black: what %s predicts of it; it accounts for (of the mean square) %s."
    return caption + text % (winner, shares)


def wrench_over_time(studies: Sequence[Document]) -> Document:
    """The missing wrench of every model over time, with two standard deviations of the first one's, the
    commands, the force that they produce, and the mean missing force by place."""
    figure = Panels(
        4,
        3,
        widths=[0.58, 0.2, 0.22],
        heights=[0.28, 0.28, 0.28, 0.16],
        gaps=(0.075, 0.03),
        tall=[2, 3],
        shared="x",
    )
    run = studies[0]["run"]
    for row, (channel, label) in enumerate(WRENCH):
        numbers = [s["missing"].numbers["channels"][channel] for s in studies]
        factor, unit = scaled(numbers[0])
        reach = 0.0
        for count, study in enumerate(studies):
            missing, shade = study["missing"], model_color(count)
            every = every_so_many(missing.times)
            wrench_of, sigma_of = (v[every, row] for v in (missing.wrench, missing.sigma))
            at, values, sigma = with_gaps(missing.times[every], factor * wrench_of, factor * sigma_of)
            reach = max(reach, 1.15 * np.nanquantile(np.abs(values) + 2 * sigma, 0.995))
            if count == 0:
                deviations = shaded(at, values - 2 * sigma, values + 2 * sigma, shade, 0.22)
                figure.add(deviations, row + 1, 1)
            trace = curve(at, values, study["label"], model_line(count, 1.4), row == 0)
            figure.add(trace, row + 1, 1)
        axis: Document = {"title": "%s<br>[%s]" % (label, unit), **ZERO_LINE}
        if reach > 0:
            axis["range"] = [-reach, reach]
        figure.update_yaxes(row=row + 1, col=1, **axis)
        sizes = ", ".join("%.3g" % (factor * entry["rms"]) for entry in numbers)
        text = "rms %s %s; full thrust %.3g" % (sizes, unit, factor * numbers[0]["full_scale"])
        note(figure, row + 1, 1, text, MEASURED, 0.01, bgcolor="rgba(255,255,255,0.7)")
    add_commands(figure, studies[0], 4)
    figure.update_xaxes(range=[float(run.times[0]), float(run.times[-1])], col=1)
    for event in studies[0]["missing"].numbers["disturbances"]:
        for row in (1, 2, 3, 4):
            figure.span(event["start"], event["end"], row, fillcolor="#888888", opacity=0.35)
    _add_thrust(figure, studies)
    _add_force_map(figure, studies)
    caption = (
        "Run %s: missing wrench in the body frame; shaded: two standard deviations of the "
        "estimate. Grey: left out, because no input explains the motion (contact, hand, wrong poses). "
        "Arrows: force that a constant thrust command produces, seen from above, x ahead, y to "
        "starboard. Map: mean missing force in the axes of world_ned, place by place." % run.name
    )
    return figure.finish(540, caption)


def _add_thrust(figure: Panels, studies: Sequence[Document]) -> None:
    """Body axes from above, with the force per unit of command by each model and as measured."""
    figure.update_xaxes(visible=False, range=[-1.35, 1.35], row=1, col=2)
    figure.update_yaxes(visible=False, range=[-3.2, 1.5], scaleanchor="x2", row=1, col=2)
    thrusts = [(s["label"], s["missing"].numbers["thrust"]) for s in studies]
    if thrusts[0][1] is None:
        note(figure, 1, 2, "the thrust command<br>never changes", MEASURED, 0.5)
        return
    grey = {"color": LESS, "width": 1}
    figure.add(arrows([0, 0], [0, 0], [0, 1.15], [1.25, 0], "body axes", grey, 0.1), 1, 2)
    forces = [(label, thrust["model"], model_color(i), 6.0) for i, (label, thrust) in enumerate(thrusts)]
    forces.append(("measured", thrusts[0][1]["measured"], MEASURED, 2.5))
    largest = max(force["force_per_unit_input"] for _, force, _, _ in forces) or 1.0
    lines = []
    for label, force, shade, width in forces:
        angle, size = np.radians(force["angle_deg"]), force["force_per_unit_input"]
        tip = [size / largest * np.sin(angle)], [size / largest * np.cos(angle)]
        line = {"color": shade, "width": width}
        figure.add(arrows([0], [0], *tip, label, line, opacity=0.8), 1, 2)
        text = "%s:<br>%.3g N per unit<br>at %.0f deg"
        lines.append((text % (wrapped(label, NAME_WIDTH), size, force["angle_deg"]), shade))
    lines += [
        ("<b>BODY AXES DIFFER<br>by %.0f deg: %s</b>" % (thrust["off_deg"], label), WARNING)
        for label, thrust in thrusts
        if thrust["body_axes_differ"]
    ]
    up = 0
    for text, shade in reversed(lines):
        note(figure, 1, 2, text, shade, 0.5, -up, y=0)
        up += 6 + 13 * (1 + text.count("<br>"))


def _add_force_map(figure: Panels, studies: Sequence[Document]) -> None:
    """Mean missing force in the world's axes, cell by cell, and the size of the longest arrow."""
    forces = [_mean_force(study["missing"]) for study in studies]
    largest = max(np.hypot(*force.T).max() for _, force in forces)
    position = studies[0]["missing"].position
    line = {"color": MEASURED, "width": 0.8}
    figure.add(curve(position[:, 1], position[:, 0], "path", line, False, 0.3), 1, 3)
    side = max(np.ptp(position, axis=0).max(), 1e-3) / failure.MAP_CELLS
    for count, (study, (places, force)) in enumerate(zip(studies, forces)):
        shown = force * side / (largest or 1.0)
        at = places[:, 1], places[:, 0], shown[:, 1], shown[:, 0]
        figure.add(arrows(*at, study["label"], model_line(count, 1.5)), 1, 3)
    figure.update_xaxes(title=Y_AXIS, row=1, col=3)
    figure.update_yaxes(title={"text": X_AXIS, "standoff": 0}, scaleanchor="x3", row=1, col=3)
    note(figure, 1, 3, "longest arrow<br>%.2g N" % largest, MEASURED, 0.98)


def _mean_force(missing: Any) -> Tuple[Array, Array]:
    """Cells (n, 2) x, y [m] of the map, and the mean missing force in each (n, 2) [N], world_ned."""
    centres = np.array(missing.numbers["channels"]["X"]["against"]["position"]["centres"])
    c, s = np.cos(missing.heading), np.sin(missing.heading)
    body = missing.wrench[:, :2]
    world = np.column_stack([c * body[:, 0] - s * body[:, 1], s * body[:, 0] + c * body[:, 1]])
    nearest = np.argmin(((missing.position[:, None, :] - centres[None]) ** 2).sum(axis=2), axis=1)
    present = np.unique(nearest)
    return centres[present], np.array([world[nearest == i].mean(axis=0) for i in present])
