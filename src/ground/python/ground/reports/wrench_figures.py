"""Figures of the missing wrench, over time and by place (plotly figures, as in ground.reports.figures)."""

from typing import Sequence

import numpy as np

from ground.analysis import missing_wrench
from ground.annotations import Document
from ground.reports import panels
from ground.reports.appearance import (
    MEASURED,
    WRENCH,
    model_color,
    model_line,
    scaled,
)
from ground.reports.figure_parts import (
    X_AXIS,
    Y_AXIS,
    ZERO_LINE,
    add_commands,
    arrows,
    curve,
    every_so_many,
    finish,
    note,
    shaded,
    with_gaps,
)

def wrench_over_time(studies: Sequence[Document], first: int = 0) -> Document:
    """The missing wrench of every model over time, with two standard deviations of the first one's, the
    commands, and the mean missing force by place.

    first: number of the first model.
    """
    top: panels.Specs = [[{}, {"rowspan": 4}]]
    below: panels.Specs = [[{}, None]] * 3
    figure = panels.Figure(
        rows=4,
        cols=2,
        specs=[*top, *below],
        column_widths=[0.72, 0.28],
        row_heights=[0.28, 0.28, 0.28, 0.16],
        horizontal_spacing=0.075,
        vertical_spacing=0.03,
    )
    run = studies[0]["run"]
    for row, (channel, label) in enumerate(WRENCH):
        numbers = [s["missing"].numbers["channels"][channel] for s in studies]
        factor, unit = scaled(numbers[0])
        reach = 0.0
        for count, study in enumerate(studies):
            missing, shade = study["missing"], model_color(first + count)
            every = every_so_many(missing.times)
            at, values, sigma = with_gaps(
                missing.times[every],
                factor * missing.wrench[every, row],
                factor * missing.sigma[every, row],
            )
            reach = max(reach, 1.15 * np.nanquantile(np.abs(values) + 2 * sigma, 0.995))
            if count == 0:
                deviations = shaded(at, values - 2 * sigma, values + 2 * sigma, shade, 0.22)
                figure.add(deviations, row + 1, 1)
            line = model_line(first + count, 1.4)
            figure.add(curve(at, values, study["label"], line, row == 0), row + 1, 1)
        figure.update_yaxes(
            title="%s<br>[%s]" % (label, unit), **ZERO_LINE, row=row + 1, col=1
        )
        text = "rms %s %s; full thrust %.3g" % (
            ", ".join("%.3g" % (factor * entry["rms"]) for entry in numbers),
            unit,
            factor * numbers[0]["full_scale"],
        )
        note(figure, row + 1, 1, text, MEASURED, 0.01, bgcolor="rgba(255,255,255,0.7)")
        if reach > 0:
            figure.update_yaxes(range=[-reach, reach], row=row + 1, col=1)
    add_commands(figure, studies[0], 4)
    figure.update_xaxes(matches="x5", range=[float(run.times[0]), float(run.times[-1])], col=1)
    for event in studies[0]["missing"].numbers["disturbances"]:
        figure.add_span(event["start"], event["end"], 1, fillcolor="#888888", opacity=0.35)
    _add_force_map(figure, studies, first)
    caption = (
        "Run %s: missing wrench in the body frame; shaded: two standard deviations of the "
        "estimate. Grey: left out, because no input explains the motion (contact, hand, wrong poses). "
        "Map: mean missing force in the axes of world_ned, place by place." % run.name
    )
    blocks = [panels.Block((1,), 470), panels.Block((2,), 360)]
    return finish(figure, 540, caption, blocks=blocks)


def _add_force_map(figure: panels.Figure, studies: Sequence[Document], first: int) -> None:
    """Mean missing force in the world's axes, cell by cell, and the size of the longest arrow."""
    forces = [study["missing"].by_place() for study in studies]
    largest = max(np.hypot(*force.T).max() for _, force in forces)
    position = studies[0]["missing"].position
    path = curve(
        position[:, 1], position[:, 0], "path", {"color": MEASURED, "width": 0.8}, False, 0.3
    )
    figure.add(path, 1, 2)
    side = max(np.ptp(position, axis=0).max(), 1e-3) / missing_wrench.MAP_CELLS
    for count, (study, (places, force)) in enumerate(zip(studies, forces), first):
        scaled_force = force * side / (largest or 1.0)
        line = {"color": model_color(count), "width": 1.5}
        at = places[:, 1], places[:, 0], scaled_force[:, 1], scaled_force[:, 0]
        figure.add(arrows(*at, study["label"], line), 1, 2)
    figure.update_xaxes(title=Y_AXIS, row=1, col=2)
    figure.update_yaxes(title={"text": X_AXIS, "standoff": 0}, scaleanchor="x2", row=1, col=2)
    note(figure, 1, 2, "longest arrow<br>%.2g N" % largest, MEASURED, 0.98)


