"""Figures of the missing wrench, over time and by place (plotly figures, as in ground.reports.figures)."""

from typing import Sequence

import numpy as np

from ground.analysis import missing_wrench
from ground.reports import inspection
from ground.reports.appearance import MEASURED, WRENCH, model_color, model_line, scaled
from ground.reports.figure_parts import (
    X_AXIS,
    Y_AXIS,
    ZERO_LINE,
    add_commands,
    arrows,
    curve,
    every_so_many,
    note,
    shaded,
    with_gaps,
)
from ground.reports.inspection import Inspection
from ground.reports.panels import Panels
from ground.reports.words import capital
from ground.support.annotations import Plotly


def wrench_over_time(studies: Sequence[Inspection]) -> Plotly:
    """The missing wrench of every model over time, with two standard deviations of the first one's, the
    commands, the force that they produce, and the mean missing force by place."""
    figure = Panels(4, 2, [0.72, 0.28], [0.28, 0.28, 0.28, 0.16], gaps=(0.075, 0.03), tall=[2], shared="x")
    run = studies[0].run
    for row, (channel, label) in enumerate(WRENCH):
        numbers = [s.missing.numbers.channels[channel] for s in studies]
        factor, unit = scaled(numbers[0])
        reach = 0.0
        for count, study in enumerate(studies):
            missing, shade = study.missing, model_color(count)
            every = every_so_many(missing.times)
            wrench_of, sigma_of = (v[every, row] for v in (missing.wrench, missing.sigma))
            at, values, sigma = with_gaps(missing.times[every], factor * wrench_of, factor * sigma_of)
            reach = max(reach, 1.15 * np.nanquantile(np.abs(values) + 2 * sigma, 0.995))
            if count == 0:
                deviations = shaded(at, values - 2 * sigma, values + 2 * sigma, shade, 0.22)
                figure.add(deviations, row + 1, 1)
            trace = curve(at, values, study.label, model_line(count, 1.4), row == 0)
            figure.add(trace, row + 1, 1)
        axis: Plotly = {"title": "%s<br>[%s]" % (label, unit), **ZERO_LINE}
        if reach > 0:
            axis["range"] = [-reach, reach]
        figure.update_yaxes(row=row + 1, col=1, **axis)
        sizes = ", ".join("%.3g" % (factor * entry.rms) for entry in numbers)
        text = "rms %s %s; full thrust %.3g" % (sizes, unit, factor * numbers[0].full_scale)
        note(figure, row + 1, 1, text, MEASURED, 0.01, bgcolor="rgba(255,255,255,0.7)")
    add_commands(figure, studies[0].model, run, 4)
    figure.update_xaxes(range=[float(run.times[0]), float(run.times[-1])], col=1)
    for event in studies[0].missing.numbers.disturbances:
        for row in (1, 2, 3, 4):
            figure.span(event.start, event.end, row, fillcolor="#888888", opacity=0.35)
    _add_force_map(figure, studies)
    caption = (
        "Run %s: missing wrench in the body frame; shaded: two standard deviations of the "
        "estimate. Grey: left out, because no input explains the motion (contact, hand, wrong poses). "
        "Map: mean missing force in the axes of world_ned, place by place." % run.name
    )
    return figure.finish(540, caption, title=capital(inspection.missing_in(studies[0])))


def _add_force_map(figure: Panels, studies: Sequence[Inspection]) -> None:
    """Mean missing force in the world's axes, cell by cell, and the size of the longest arrow."""
    forces = [study.missing.by_place() for study in studies]
    largest = max(np.hypot(*force.T).max() for _, force in forces)
    position = studies[0].missing.position
    line = {"color": MEASURED, "width": 0.8}
    figure.add(curve(position[:, 1], position[:, 0], "path", line, False, 0.3), 1, 2)
    side = max(np.ptp(position, axis=0).max(), 1e-3) / missing_wrench.MAP_CELLS
    for count, (study, (places, force)) in enumerate(zip(studies, forces)):
        shown = force * side / (largest or 1.0)
        at = places[:, 1], places[:, 0], shown[:, 1], shown[:, 0]
        figure.add(arrows(*at, study.label, model_line(count, 1.5)), 1, 2)
    figure.update_xaxes(title=Y_AXIS, row=1, col=2)
    figure.update_yaxes(title={"text": X_AXIS, "standoff": 0}, scaleanchor="x2", row=1, col=2)
    note(figure, 1, 2, "longest arrow<br>%.2g N" % largest, MEASURED, 0.98)
