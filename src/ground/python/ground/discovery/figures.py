"""Figures of a discovery (plotly figures, as in ground.reports.figures)."""

import math
from typing import Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.annotations import Array, Document
from ground.discovery import story as tale
from ground.discovery.story import Flight, Flown, Point, Story
from ground.reports.appearance import (
    FLOOR,
    LESS,
    MARKS,
    MEASURED,
    MODELS,
    ORANGES,
    TEXT,
    WARNING,
    model_color,
    model_line,
    thruster_line,
    transparent,
)
from ground.reports.figure_parts import (
    X_AXIS,
    Y_AXIS,
    curve,
    every_so_many,
    fewer,
    points,
    short,
    walls,
)
from ground.reports.panels import Panels

ROOM_ABOVE = 1.6  # largest error that the axis has room for, over the largest that is drawn
MIN_ERROR = 1e-6  # smallest error that is drawn [-]
MOST = 8  # diagnoses, or numbers of flights, that there is room for beside each other
SMALL = 0.005  # probability up to which an effect that was always absent is not drawn
FEWEST = 8  # effects that are drawn in any case
ROW = 26  # height of an effect [pixels]
STATES = [tale.PRESENT, tale.OPEN, tale.HIDDEN, tale.SLIGHT, tale.ABSENT]  # from top
CELLS = {  # text of a probability
    tale.PRESENT: "<b>%s</b>",
    tale.OPEN: "%s ?",
    tale.HIDDEN: "×",
    tale.SLIGHT: "○",
}


def errors(story: Story) -> Optional[Document]:
    """The error of each model on each flight, and the floor of noise and disturbance; None before a
    flight has any."""
    flights = [flown for flown in story.flights if flown.errors]
    if not flights:
        return None
    known = [e for flown in flights for e in flown.errors.values() if e is not None]
    known += [flown.floor for flown in flights if flown.floor]
    top = ROOM_ABOVE * max(known, default=1.0)
    figure = Panels()
    for count, version in enumerate(shown(story)):
        _add_model(figure, flights, count, version, top)
    _add_floor(figure, flights)
    for flown in flights:
        if flown.flight.purpose == tale.CONFIRM:
            at = flown.flight.number
            shade = transparent(FLOOR, 0.12)
            figure.span(at - 0.5, at + 0.5, fillcolor=shade, layer="below")
    numbers = [flown.flight.number for flown in flights]
    ticks = numbers[:: math.ceil(len(numbers) / MOST)]
    figure.update_xaxes(
        title="flight",
        range=[min(numbers) - 0.6, max(numbers) + 0.6],
        tickvals=ticks,
        ticktext=["%d" % n for n in ticks],
    )
    low = max(MIN_ERROR, 0.75 * min(known, default=1.0))
    top = max(top, 2 * low)
    levels = log_ticks(low, top)
    figure.update_yaxes(
        title="error of the prediction [-]",
        type="log",
        range=[math.log10(low), math.log10(top)],
        tickvals=levels,
        ticktext=["%g" % level for level in levels],
    )
    caption = _errors_caption(flights)
    if len(shown(story)) < len(story.versions):
        caption += " Of models with the same effects the first is drawn, and the newest of all."
    return figure.finish(400, caption, {"t": 70})


def shown(story: Story) -> List[tale.Version]:
    """The models that begin another set of effects, and the newest."""
    before = [None, *(version.effects for version in story.versions)]
    last = len(story.versions) - 1
    pairs = enumerate(zip(before, story.versions))
    return [v for i, (effects, v) in pairs if v.effects != effects or i == last]


def log_ticks(low: float, high: float) -> List[float]:
    """Round values of a logarithmic axis: 1, 2 and 5 of each decade, or more where these are few."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for steps in ((1, 2, 5), (1, 1.5, 2, 3, 4, 5, 7)):
        found = [step * 10.0**power for power in decades for step in steps]
        found = [value for value in found if low <= value <= high]
        if len(found) > 2:
            break
    return found


def _errors_caption(flights: Sequence[Flown]) -> str:
    caption = (
        "Error: mean over samples of |e_u|/σ_u + |e_v|/σ_v + |e_r|/σ_r, windows of 1.5 s; logarithmic. "
        "Each model predicts the flights after those that it was fitted to, which have open marks."
    )
    if any(flown.floor is not None for flown in flights):
        caption += " Floor: what noise of the poses and the disturbance leave to a true model."
    if any(flown.flight.purpose == tale.CONFIRM for flown in flights):
        caption += " Shaded: the confirming flight."
    if any(None in flown.errors.values() for flown in flights):
        caption += " Cross at the top: the predicted motion is not finite."
    return caption


def newest(story: Story, flown: Flown) -> Optional[str]:
    """Label of the newest model that predicted a flight."""
    before = [v.label for v in story.versions if v.label in flown.errors and v.after < flown.flight.number]
    return before[-1] if before else None


def _add_model(
    figure: Panels,
    flights: Sequence[Flown],
    count: int,
    version: tale.Version,
    top: float,
) -> None:
    """The errors of a model: filled marks where it predicted, open ones where it was fitted."""
    at, values, marks, notes = [], [], [], []
    kind = MARKS[count % len(MARKS)]
    for flown in flights:
        if version.label not in flown.errors:
            continue
        value, fitted = flown.errors[version.label], flown.flight.number <= version.after
        at.append(flown.flight.number)
        values.append(top / 1.15 if value is None else max(value, MIN_ERROR))
        marks.append("x-open" if value is None else kind + "-open" * fitted)
        how = "not finite" if value is None else "%.3f" % value
        notes.append("flight %d, %s: %s%s" % (at[-1], version.label, how, ", fitted to it" * fitted))
    if not at:
        return
    trace = curve(at, values, version.label, model_line(count, 2), True)
    marker = {"size": 9, "symbol": marks, "color": model_color(count)}
    trace.update(mode="lines+markers", marker=marker, customdata=notes, cliponaxis=False)
    figure.add(dict(trace, hovertemplate="%{customdata}<extra></extra>"))


def _add_floor(figure: Panels, flights: Sequence[Flown]) -> None:
    """A level at each flight that has one."""
    at: List[float] = []
    levels: List[float] = []
    for flown in flights:
        if flown.floor:
            at += [flown.flight.number - 0.4, flown.flight.number + 0.4, math.nan]
            levels += [flown.floor, flown.floor, math.nan]
    if at:
        line = {"color": FLOOR, "width": 2, "dash": "dot"}
        figure.add(curve(at, levels, "floor of noise and disturbance", line, True))


def beliefs(story: Story) -> Optional[Document]:
    """Probability of each effect after each diagnosis, with its state; None without any."""
    known = [finding for finding in story.findings if finding.beliefs]
    if not known:
        return None
    count = min(MOST, len(known))
    findings = [known[round(i * (len(known) - 1) / max(1, count - 1))] for i in range(count)]
    table = [{belief.effect: belief for belief in finding.beliefs} for finding in findings]
    names = _considered(story)
    columns = ["%d" % finding.after for finding in findings]
    percent = [[_percent(column[n]) if n in column else None for column in table] for n in names]
    figure = Panels()
    figure.add(
        {
            "type": "heatmap",
            "z": [[None if p is None else round(p, 1) for p in row] for row in percent],
            "x": columns,
            "y": names,
            "zmin": 0,
            "zmax": 100,
            "colorscale": ORANGES,
            "showscale": False,
            "customdata": [[b[n].state if n in b else "" for b in table] for n in names],
            "hovertemplate": "%{y} after flight %{x}: %{z:.0f}%, %{customdata}<extra></extra>",
        }
    )
    for row, name in zip(percent, names):
        for place, (column, value) in enumerate(zip(table, row)):
            if value is not None:
                text = CELLS.get(column[name].state, "%s").replace("%s", "%.0f" % value)
                font = {"size": 11, "color": "#ffffff" if value > 60 else TEXT}
                figure.note(text, place, name, inside=False, font=font)
    figure.update_xaxes(title="after flight", type="category")
    figure.update_yaxes(autorange="reversed", automargin=True, type="category", tickvals=names)
    caption = (
        "Probability [%] that each effect acts on the craft and matters, after each diagnosis. Bold: "
        "present; ?: still open; ×: not identifiable, no flight in this room shows it or distinguishes "
        "it from others; ○: it acts, and is too small to matter; plain: absent."
    )
    rest = len(ranked(story)) - len(names)
    if rest:
        caption += " %d more effects were never above %g%%." % (rest, 100 * SMALL)
    if count < len(known):
        caption += " %d of %d diagnoses are shown." % (count, len(known))
    return figure.finish(ROW * len(names) + 90, caption, {"t": 40, "b": 50, "l": 20})


def _percent(belief: tale.Belief) -> float:
    """Probability that is drawn [%]; 0 for what is too small to matter."""
    return 0.0 if belief.state == tale.SLIGHT else 100 * belief.probability


def _considered(story: Story) -> List[str]:
    """The effects that were open, present or likely after some diagnosis; of others the likeliest."""
    every = [belief for finding in story.findings for belief in finding.beliefs]
    kept = {b.effect for b in every if b.state != tale.ABSENT or b.probability > SMALL}
    names = ranked(story)
    return [name for place, name in enumerate(names) if name in kept or place < FEWEST]


def ranked(story: Story) -> List[str]:
    """All effects that a belief is known of: by their last state, then by probability."""
    last: Dict[str, tale.Belief] = {}
    for finding in story.findings:
        last.update((belief.effect, belief) for belief in finding.beliefs)

    def key(name: str) -> Tuple[int, float]:
        state = last[name].state
        place = STATES.index(state) if state in STATES else len(STATES)
        return place, -last[name].probability

    return sorted(last, key=key)


def flight(
    plan: Flight,
    flown: Optional[Flown],
    inputs: Optional[Array],
    thrusters: Sequence[str] = (),
    room: Optional[_core.RoomPlan] = None,
) -> Optional[Document]:
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
        figure.add(walls(room), 1, 1)
    for name, path, line in paths:
        figure.add(_path(path, name, line), 1, 1)
    if paths:
        _, first, _ = paths[-1]
        start = {"size": 8, "color": MEASURED}
        figure.add(points([first[0][2]], [first[0][1]], start, name="start"), 1, 1)
    if flown and flown.stopped and flown.path:
        _, x, y = flown.path[-1]
        marker = {"size": 10, "color": WARNING, "symbol": "x"}
        figure.add(points([y], [x], marker, name="stopped"), 1, 1)
    figure.update_xaxes(title=Y_AXIS, row=1, col=1)
    figure.update_yaxes(title=X_AXIS, scaleanchor="x", row=1, col=1)
    caption = "Seen from above" + ("." if inputs is None else "; and the inputs, played in bursts.")
    if inputs is not None:
        _add_inputs(figure, inputs, thrusters)
    return figure.finish(400, caption, {"t": 40})


def _path(path: Sequence[Point], name: str, line: Mapping[str, object]) -> Document:
    rows = np.array(path, float)
    times, x, y = fewer(list(rows.T), every_so_many(rows).step)
    hover = "%{customdata:.2f} s: x %{y:.3f} m, y %{x:.3f} m"
    return dict(curve(y, x, name, dict(line), True), customdata=short(times), hovertemplate=hover)


def _add_inputs(figure: Panels, inputs: Array, thrusters: Sequence[str]) -> None:
    """Inputs over time, each constant until the next."""
    times = inputs[:, 0]
    names = [*thrusters, "lift"]
    for column, name in enumerate(names, 1):
        line = thruster_line(column - 1, 1.5)
        if column == len(names):
            line = {"color": LESS, "width": 1.5, "dash": "dot", "shape": "hv"}
        figure.add(curve(times, inputs[:, column], "input, " + name, line, True), 1, 2)
    low, high = min(0.0, inputs[:, 1:].min()), max(1.0, inputs[:, 1:].max())
    figure.update_yaxes(title="input [-]", range=[low - 0.05, high + 0.05], row=1, col=2)
    figure.update_xaxes(title="time of the excitation [s]", row=1, col=2)
