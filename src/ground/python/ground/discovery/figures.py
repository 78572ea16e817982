"""Figures of a discovery (plotly figures, as in ground.reports.figures)."""

import math
from typing import Dict, List, Optional, Sequence

import numpy as np

from ground import _core
from ground.discovery import story as tale
from ground.discovery.story import Flight, Flown, Point, Story
from ground.reports import appearance
from ground.reports.appearance import FLOOR, LESS, MARKS, MEASURED, MODELS, WARNING, model_line, thruster_line
from ground.reports.figure_parts import X_AXIS, Y_AXIS, curve, every_so_many, fewer, points, short, walls
from ground.reports.panels import Panels
from ground.reports.words import millimetres
from ground.support.annotations import Array, Style

ROOM_ABOVE = 1.6  # largest error that the axis has room for, over the largest that is drawn
MIN_ERROR = 1e-3  # smallest error that is drawn [mm]


def errors(story: Story) -> Optional[Dict[str, object]]:
    """The error of each model on each flight, and the noise floor; None before a
    flight has any."""
    flights = [flown for flown in story.flights if flown.errors]
    if not flights:
        return None
    known = [e[0] for flown in flights for e in flown.errors.values() if e is not None]
    known += [flown.floor[0] for flown in flights if flown.floor]
    low, top = max(MIN_ERROR, 0.75 * min(known, default=1.0)), ROOM_ABOVE * max(known, default=1.0)
    figure = Panels()
    for count, version in enumerate(shown(story)):
        _add_model(figure, flights, count, version, top)
    floors = [(flown.flight.number, flown.floor[0]) for flown in flights if flown.floor]
    if floors:
        at = [n + step for n, _ in floors for step in (-0.4, 0.4, math.nan)]
        levels = [level for _, level in floors for _ in range(3)]
        line = {"color": FLOOR, "width": 2, "dash": "dot"}
        figure.add(curve(at, levels, "noise floor", line, True))
    numbers = [flown.flight.number for flown in flights]
    figure.update_xaxes(title="flight", range=[min(numbers) - 0.6, max(numbers) + 0.6], tickformat="d")
    span = [math.log10(low), math.log10(top)]
    figure.update_yaxes(
        title="position off after %.3g s [mm]" % story.horizon,
        type="log",
        range=span,
        tickformat="~g",
        dtick="D2",
    )
    caption = (
        "Distance of the predicted from the measured position, root mean square; logarithmic. Each model "
        "predicts the flights after those that it was fitted to, which have open marks. Floor: error of "
        "a true model from pose noise."
    )
    if any(None in flown.errors.values() for flown in flights):
        caption += " Cross at the top: the predicted motion is not finite."
    if len(shown(story)) < len(story.versions):
        caption += " Of models with the same effects the first is drawn, and the newest of all."
    return figure.finish(400, caption, {"t": 70}, title=_errors_title(story, flights))


def _errors_title(story: Story, flights: Sequence[Flown]) -> str:
    """What the errors show: how far they fall."""
    known = [off[0] for off in flights[-1].errors.values() if off]
    if len(known) < 2:
        return "Prediction errors of the given model"
    told = flights[-1].flight.number, millimetres(known[0]), millimetres(known[-1])
    return "On flight %d predictions are off by %s with the given model, by %s with what was found" % told


def shown(story: Story) -> List[tale.Version]:
    """The models that begin another set of effects, and the newest."""
    before = [None, *(version.effects for version in story.versions)]
    pairs = list(zip(before, story.versions))
    return [v for effects, v in pairs if v.effects != effects or v is story.versions[-1]]


def _add_model(
    figure: Panels, flights: Sequence[Flown], count: int, version: tale.Version, top: float
) -> None:
    """The errors of a model: filled marks where it predicted, open ones where it was fitted."""
    kind, predicted = MARKS[count % len(MARKS)], [f for f in flights if version.label in f.errors]
    values = [e and e[0] for e in (f.errors[version.label] for f in predicted)]
    if not predicted:
        return
    fitted = [f.flight.number <= version.after for f in predicted]
    marks = ["x-open" if v is None else kind + "-open" * own for v, own in zip(values, fitted)]
    drawn = [top / 1.15 if v is None else max(v, MIN_ERROR) for v in values]
    trace = curve([f.flight.number for f in predicted], drawn, version.label, model_line(count, 2), True)
    marker = {"size": 9, "symbol": marks, "color": appearance.model_color(count)}
    figure.add(
        dict(trace, mode="lines+markers", marker=marker, cliponaxis=False, hovertemplate="%{y:.3g} mm")
    )


def flight(
    plan: Flight,
    flown: Optional[Flown],
    inputs: Optional[Array],
    thrusters: Sequence[str] = (),
    room: Optional[_core.RoomPlan] = None,
) -> Optional[Dict[str, object]]:
    """A flight seen from above, planned and flown, and its inputs; None when there is nothing to draw.

    flown: None before it was flown; inputs: (n, 2 + thrusters) time [s], inputs of the thrusters (of
    full scale), lift; thrusters: their names; room: whose walls are drawn.
    """
    paths = [
        ("planned", plan.path, {"color": MODELS[1], "width": 2, "dash": "dash"}),
        ("flown", flown.path if flown else [], {"color": MEASURED, "width": 2}),
    ]
    paths = [path for path in paths if path[1]]
    if not paths and inputs is None:
        return None
    figure = Panels() if inputs is None else Panels(1, 2, [0.45, 0.55], gaps=(0.1, 0))
    if room is not None:
        figure.add(walls(room))
    for name, path, line in paths:
        figure.add(_path(path, name, line))
    if paths:
        _, first, _ = paths[-1]
        figure.add(points([first[0][2]], [first[0][1]], {"size": 8, "color": MEASURED}, name="start"))
    if flown and flown.stopped and flown.path:
        _, x, y = flown.path[-1]
        figure.add(points([y], [x], {"size": 10, "color": WARNING, "symbol": "x"}, name="stopped"))
    figure.update_xaxes(title=Y_AXIS, row=1, col=1)
    figure.update_yaxes(title=X_AXIS, scaleanchor="x", row=1, col=1)
    if inputs is not None:
        _add_inputs(figure, inputs, thrusters)
    caption = "Seen from above" + ("." if inputs is None else "; and the inputs, played in bursts.")
    return figure.finish(400, caption, {"t": 40})


def _path(path: Sequence[Point], name: str, line: Style) -> Dict[str, object]:
    rows = np.array(path, float)
    times, x, y = fewer(list(rows.T), every_so_many(rows).step)
    hover = "%{customdata:.2f} s: x %{y:.3f} m, y %{x:.3f} m"
    return dict(curve(y, x, name, line, True), customdata=short(times), hovertemplate=hover)


def _add_inputs(figure: Panels, inputs: Array, thrusters: Sequence[str]) -> None:
    """Inputs over time, each constant until the next."""
    lift: Style = {"color": LESS, "width": 1.5, "dash": "dot", "shape": "hv"}
    lines = [*(thruster_line(i, 1.5) for i in range(len(thrusters))), lift]
    for column, (name, line) in enumerate(zip([*thrusters, "lift"], lines), 1):
        figure.add(curve(inputs[:, 0], inputs[:, column], "input, " + name, line, True), 1, 2)
    low, high = min(0.0, inputs[:, 1:].min()), max(1.0, inputs[:, 1:].max())
    figure.update_yaxes(title="input [-]", range=[low - 0.05, high + 0.05], row=1, col=2)
    figure.update_xaxes(title="time of the excitation [s]", row=1, col=2)
