"""A figure for each parameter over time (plotly figures, as in ground.reports.figures)."""

from typing import Dict, Iterator, List, Sequence, Tuple

from ground.ledger import words
from ground.ledger.changes import JUMP
from ground.ledger.contents import CraftType, FoundChange, HistoryContents, RunEntry, RunValue
from ground.reports.appearance import LESS, model_color, model_line, model_mark
from ground.reports.figure_parts import curve, points, short
from ground.reports.panels import Panels
from ground.reports.words import capital, listed
from ground.support.annotations import Plotly

ROOM = 1.5  # the axis shows intervals up to so many spans of the values


def all_of(found: HistoryContents) -> Iterator[Plotly]:
    """A figure for each parameter of each type, those with changes first."""
    changed = {one.parameter for one in found.changes} | {one.parameter for one in found.odd}
    for kind in found.types:
        for name in sorted(kind.parameters, key=lambda name: name not in changed):
            yield of(found, kind, name)


def by_name(found: HistoryContents) -> Dict[str, Tuple[CraftType, str]]:
    """The figures' types and parameters, by their names."""
    several = len(found.types) > 1
    return {
        "%s %s" % (name, kind.name) if several else name: (kind, name)
        for kind in found.types
        for name in kind.parameters
    }


def of(found: HistoryContents, kind: CraftType, name: str) -> Plotly:
    """A parameter of all crafts of a type over time: each run with its interval, and what changes."""
    figure, values = Panels(), []
    described = kind.parameters[name]
    for number, craft in enumerate(found.crafts_of(kind)):
        own = [run for run in found.runs if (run.craft, run.type) == (craft.name, kind.name)]
        known = [(run, value) for run in own for value in [run.parameters[name]] if value]
        values += [value.value for _, value in known]
        if known:
            _add_craft(figure, craft.name, number, known)
    changes = [one for one in found.changes if (one.parameter, one.type) == (name, kind.name)]
    for one in changes:
        if one.kind == JUMP:
            figure.span(one.times[0], one.times[1], line={"width": 0}, fillcolor=LESS, opacity=0.25)
    figure.update_yaxes(title="%s [%s]" % (name, described.unit), range=_range(values))
    figure.update_xaxes(title="recorded", type="date")
    caption = (
        "%s. Each mark is a run by itself, with its 95%% interval, where the other parameters are as usual. "
        "Line: mean of the craft with its drift and jumps. Grey: between the two runs of a jump. "
        "Scatter: %s."
    )
    told = caption % (capital(described.means or "parameter"), words.scatter(described))
    return figure.finish(330, told, {"t": 40}, title=_title(found, changes, kind, name))


def _title(found: HistoryContents, changes: Sequence[FoundChange], kind: CraftType, name: str) -> str:
    """What to see."""
    if changes:
        more = " (and %d more)" % (len(changes) - 1) if len(changes) > 1 else ""
        return "Parameter " + words.change(found, changes[0]) + more
    odd = [one.craft for one in found.odd if (one.parameter, one.type) == (name, kind.name)]
    if odd:
        return "Parameter %s of %s differs from the others" % (name, listed(odd))
    return "Parameter %s neither drifts nor jumps" % name


def _add_craft(figure: Panels, craft: str, number: int, known: Sequence[Tuple[RunEntry, RunValue]]) -> None:
    """Marks of the runs of a craft with their intervals, and the line of their mean."""
    far = 10 * max(abs(one.value) for _, one in known)  # beyond the axis
    up, down = [], []
    for _, one in known:
        low, high = words.sorted_ends(one.ci95)
        down.append(far if low is None else one.value - low)
        up.append(far if high is None else high - one.value)
    bars = {"type": "data", "symmetric": False, "width": 0, "thickness": 1, "array": up, "arrayminus": down}
    bars["color"] = model_color(number)
    marks = points([], [], dict(model_mark(number), size=7), name=craft, legendgroup=craft, error_y=bars)
    figure.add(
        dict(
            marks,
            x=[run.recorded for run, _ in known],
            y=short([one.value for _, one in known]),
            text=[run.name for run, _ in known],
            hovertemplate="%{text}: %{y:.4g}<extra></extra>",
        )
    )
    mean = [(run.recorded, one.mean) for run, one in known if one.mean is not None]
    line = dict(curve([], [], craft, dict(model_line(number, 1.5), shape="linear"), False), hoverinfo="skip")
    del line["hovertemplate"]
    figure.add(dict(line, x=[t for t, _ in mean], y=short([m for _, m in mean])))


def _range(values: List[float]) -> List[float]:
    """The axis by the values, so that a run that tells little does not hide the others."""
    low, high = min(values, default=0.0), max(values, default=1.0)
    room = ROOM * max(high - low, 1e-3 * max(abs(low), abs(high), 1e-12)) / 2
    return [low - room, high + room]
