"""A figure for each parameter over time (plotly figures, as in ground.reports.figures)."""

from typing import Any, Dict, Iterator, List, Sequence

from ground.ledger import words
from ground.reports.appearance import LESS, model_color, model_line, model_mark
from ground.reports.figure_parts import curve, points, short
from ground.reports.panels import Panels
from ground.reports.words import capital, listed
from ground.support.annotations import Document

ROOM = 1.5  # the axis shows intervals up to so many spans of the values


def all_of(report: Document) -> Iterator[Document]:
    """A figure for each parameter of each type, those with changes first."""
    for kind in report["types"]:
        names = list(kind["parameters"])
        changed = [one["parameter"] for one in [*report["changes"], *report["odd"]]]
        for name in sorted(names, key=lambda n: (n not in changed, names.index(n))):
            yield of(report, kind["name"], name)


def by_name(report: Document) -> Dict[str, Document]:
    """The figures' types and parameters, by their names."""
    kinds = report["types"]
    return {
        (name if len(kinds) == 1 else "%s %s" % (name, kind["name"])): {
            "type": kind["name"],
            "parameter": name,
        }
        for kind in kinds
        for name in kind["parameters"]
    }


def of(report: Document, kind: str, name: str) -> Document:
    """A parameter of all crafts of a type over time: each run with its interval, and what changes."""
    figure, values = Panels(), []
    described = next(k for k in report["types"] if k["name"] == kind)["parameters"][name]
    crafts = [craft["name"] for craft in report["crafts"] if craft["type"] == kind]
    for number, craft in enumerate(crafts):
        runs = [
            r for r in report["runs"] if r["craft"] == craft and r["type"] == kind and r["parameters"][name]
        ]
        values += [run["parameters"][name]["value"] for run in runs]
        _add_craft(figure, craft, number, runs, name)
    own = [c for c in report["changes"] if c["parameter"] == name and c["type"] == kind]
    for one in own:
        if one["kind"] == "jump":
            figure.span(*one["times"], line={"width": 0}, fillcolor=LESS, opacity=0.25)
    unit = described["unit"]
    figure.update_yaxes(title="%s [%s]" % (name, unit), range=_range(values))
    figure.update_xaxes(title="recorded", type="date")
    caption = (
        "%s. Each mark is a run by itself, with its 95%% interval, where the other parameters are as usual. "
        "Line: mean of the craft with its drift and jumps. Grey: between the two runs of a jump. "
        "Scatter: %s."
    )
    told = caption % (capital(described["means"] or "parameter"), words.scatter(described))
    return figure.finish(330, told, {"t": 40}, title=_title(report, own, kind, name))


def _title(report: Document, own: Sequence[Document], kind: str, name: str) -> str:
    """What to see."""
    if own:
        more = " (and %d more)" % (len(own) - 1) if len(own) > 1 else ""
        return "Parameter " + words.change(report, own[0]) + more
    odd = [one["craft"] for one in report["odd"] if one["parameter"] == name and one["type"] == kind]
    if odd:
        return "Parameter %s of %s differs from the others" % (name, listed(odd))
    return "Parameter %s neither drifts nor jumps" % name


def _add_craft(figure: Panels, craft: str, number: int, runs: Sequence[Document], name: str) -> None:
    found = [run["parameters"][name] for run in runs]
    if not found:
        return
    times = [run["recorded"] for run in runs]
    up, down = [], []
    for one in found:
        low, high = words.sorted_ends(one["ci95"])
        down.append(None if low is None else one["value"] - low)
        up.append(None if high is None else high - one["value"])
    far = 10 * max([abs(one["value"]) for one in found])
    bars: Dict[str, Any] = {"type": "data", "symmetric": False, "width": 0, "thickness": 1}
    bars.update(
        array=[far if x is None else x for x in up], arrayminus=[far if x is None else x for x in down]
    )
    bars["color"] = model_color(number)
    marks = points([], [], dict(model_mark(number), size=7), name=craft, legendgroup=craft, error_y=bars)
    hover = "%{text}: %{y:.4g}<extra></extra>"
    figure.add(
        dict(
            marks,
            x=times,
            y=short([one["value"] for one in found]),
            text=[r["name"] for r in runs],
            hovertemplate=hover,
        )
    )
    mean = [(time, one["mean"]) for time, one in zip(times, found) if one["mean"] is not None]
    line = dict(curve([], [], craft, dict(model_line(number, 1.5), shape="linear"), False), hoverinfo="skip")
    del line["hovertemplate"]
    figure.add(dict(line, x=[t for t, _ in mean], y=short([m for _, m in mean])))


def _range(values: List[float]) -> List[float]:
    """The axis by the values, so that a run that tells little does not hide the others."""
    low, high = min(values, default=0.0), max(values, default=1.0)
    room = ROOM * max(high - low, 1e-3 * max(abs(low), abs(high), 1e-12)) / 2
    return [low - room, high + room]
