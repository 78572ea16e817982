"""Figures of the missing wrench: against measured variables, over time and by place (plotly figures,
as in ground.reports.figures)."""

from typing import Any, Iterable, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground.analysis import failure
from ground.annotations import Array, Document
from ground.reports import panels
from ground.reports.appearance import (
    LESS,
    MEASURED,
    SHADE,
    WARNING,
    WRENCH,
    WRENCH_AGAINST,
    model_color,
    model_line,
    scaled,
    transparent,
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
    finish,
    grid_blocks,
    label_axes,
    note,
    note_share,
    shaded,
    small_multiples,
    with_gaps,
)

NAME_WIDTH = 18  # of a line of a model's name under the arrows of thrust [characters]


def wrench(studies: Sequence[Document], winner: Optional[str] = None, first: int = 0) -> Document:
    """The missing wrench of every model against measured variables, with two standard errors, and the
    part of the first one's that the winner accounts for. first: number of the first model."""
    known = studies[0]["missing"].numbers["channels"]["X"]["against"]
    against = [name for name in WRENCH_AGAINST if name in known]
    figure = small_multiples(3, len(against))
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
                trace = bins(one, values, study["label"], count, legend, 2 * errors)
                figure.add(trace, row + 1, column + 1)
                note_share(figure, row, column, one["share"], shade, count - first)
            accounted = entries[0].get("accounted")
            if accounted is not None:
                line = {"color": MEASURED, "width": 2, "dash": "dot"}
                at = entries[0]["against"][name]["centres"]
                predicted = factor * np.array(accounted["mean"][name])
                text = "added by the last model"
                figure.add(curve(at, predicted, text, line, legend), row + 1, column + 1)
            _shade(figure, row, column, [entry["against"][name]["share"] for entry in entries])
            limits = [-reach, reach] if reach > 0 else None
            label_axes(figure, row, column, entries[0]["against"][name], limits)
        figure.update_yaxes(title="%s<br>[%s]" % (label, unit), row=row + 1, col=1)
    figure.update_yaxes(**ZERO_LINE)
    caption = _wrench_caption(studies, winner)
    blocks = grid_blocks(len(against), 330)
    return finish(figure, 554, caption, {"b": 64}, blocks=blocks)


def _wrench_caption(studies: Sequence[Document], winner: Optional[str]) -> str:
    caption = (
        "Run %s: missing wrench in the body frame, by a Kalman smoother, against what was measured; "
        "bars: two standard errors; percentage and shade: share of its variance that the variable "
        "explains beyond chance, bold if significant." % studies[0]["run"].name
    )
    channels = studies[0]["missing"].numbers["channels"]
    if "accounted" not in channels["X"]:
        return caption
    return caption + (
        " Black: what %s predicts of it; it accounts for (of the mean square) %s."
        % (
            winner,
            ", ".join(
                "%s %.0f%%" % (c, max(0.0, 100 * entry["accounted"]["share"]))
                for c, entry in channels.items()
            ),
        )
    )


def _shade(figure: panels.Figure, row: int, column: int, named: Iterable[Mapping[str, float]]) -> None:
    """A background as strong as the largest share that is named."""
    largest = max((share["share"] for share in named if failure.is_named(share)), default=0.0)
    if largest > 0:
        figure.fill(row + 1, column + 1, transparent(SHADE, 0.5 * largest))


def wrench_over_time(studies: Sequence[Document], first: int = 0) -> Document:
    """The missing wrench of every model over time, with two standard deviations of the first one's, the
    commands, the force that they produce, and the mean missing force by place.

    first: number of the first model.
    """
    top: panels.Specs = [[{}, {"rowspan": 4}, {"rowspan": 4}]]
    below: panels.Specs = [[{}, None, None]] * 3
    figure = panels.Figure(
        rows=4,
        cols=3,
        specs=[*top, *below],
        column_widths=[0.58, 0.2, 0.22],
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
    figure.update_xaxes(matches="x6", range=[float(run.times[0]), float(run.times[-1])], col=1)
    for event in studies[0]["missing"].numbers["disturbances"]:
        figure.add_span(event["start"], event["end"], 1, fillcolor="#888888", opacity=0.35)
    _add_thrust(figure, studies, first)
    _add_force_map(figure, studies, first)
    caption = (
        "Run %s: missing wrench in the body frame; shaded: two standard deviations of the "
        "estimate. Grey: left out, because no input explains the motion (contact, hand, wrong poses). "
        "Arrows from a disc: force that a constant thrust command produces, seen from above. Map: mean "
        "missing force in the axes of world_ned, place by place." % run.name
    )
    blocks = [panels.Block((1,), 470), panels.Block((2,), 360), panels.Block((3,), 320)]
    return finish(figure, 540, caption, blocks=blocks)


def _add_thrust(figure: panels.Figure, studies: Sequence[Document], first: int) -> None:
    """Body axes from above, with the force per unit of command by each model and as measured."""
    figure.update_xaxes(visible=False, range=[-1.35, 1.35], row=1, col=2)
    figure.update_yaxes(visible=False, range=[-3.2, 1.5], scaleanchor="x2", row=1, col=2)
    thrusts = [(s["label"], s["missing"].numbers["thrust"]) for s in studies]
    if thrusts[0][1] is None:
        note(figure, 1, 2, "the thrust command<br>never changes", MEASURED, 0.5)
        return
    round_it = np.linspace(0, 2 * np.pi, 61)
    grey = {"color": LESS, "width": 1}
    circle = curve(0.32 * np.sin(round_it), 0.32 * np.cos(round_it), "", grey, False)
    figure.add(circle, 1, 2)
    figure.add(arrows([0, 0], [0, 0], [0, 1.15], [1.25, 0], "body axes", grey, 0.1), 1, 2)
    for x, y, text in ((0, 1.25, "x ahead"), (1.15, 0, "y starboard")):
        figure.annotate(
            1,
            2,
            x=x,
            y=y,
            text=text,
            yanchor="bottom",
            xanchor="center" if x == 0 else "right",
            font={"size": 10, "color": LESS},
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
        figure.add(arrows([0], [0], *tip, label, line, opacity=0.8), 1, 2)
        lines.append(
            (
                "%s:<br>%.3g N per unit<br>at %.0f deg"
                % (wrapped(label, NAME_WIDTH), size, round(force["angle_deg"]) + 0.0),
                shade,
            )
        )
    lines += [
        ("<b>BODY AXES DIFFER<br>by %.0f deg: %s</b>" % (thrust["off_deg"], label), WARNING)
        for label, thrust in thrusts
        if thrust["body_axes_differ"]
    ]
    up = 0
    for text, shade in reversed(lines):
        note(figure, 1, 2, text, shade, 0.5, -up, y=0)
        up += 6 + 13 * (1 + text.count("<br>"))


def _add_force_map(figure: panels.Figure, studies: Sequence[Document], first: int) -> None:
    """Mean missing force in the world's axes, cell by cell, and the size of the longest arrow."""
    forces = [_mean_force(study["missing"]) for study in studies]
    largest = max(np.hypot(*force.T).max() for _, force in forces)
    position = studies[0]["missing"].position
    path = curve(
        position[:, 1], position[:, 0], "path", {"color": MEASURED, "width": 0.8}, False, 0.3
    )
    figure.add(path, 1, 3)
    side = max(np.ptp(position, axis=0).max(), 1e-3) / failure.MAP_CELLS
    for count, (study, (places, force)) in enumerate(zip(studies, forces), first):
        scaled_force = force * side / (largest or 1.0)
        line = {"color": model_color(count), "width": 1.5}
        at = places[:, 1], places[:, 0], scaled_force[:, 1], scaled_force[:, 0]
        figure.add(arrows(*at, study["label"], line), 1, 3)
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
