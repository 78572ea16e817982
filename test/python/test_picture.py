"""Pictures show everything in their figures, and refuse what they cannot show."""

import copy
import inspect
import json
import re

import numpy as np
import plotly.graph_objects as go
import pytest
from conftest import MODEL, write_bag
from plotly.subplots import make_subplots
from test_diagnose import with_effect

from ground import _core
from ground.annotations import Document
from ground.errors import GroundError
from ground.recordings import quality, readers
from ground.reports import (
    appearance,
    figures,
    inspection,
    picture,
    tracking_figures,
    wrench_figures,
)
from ground.simulation import gains, tracking, tuning

QUANTILES = {"p05": 0.01, "median": 0.02, "p95": 0.05}


@pytest.fixture(scope="module")
def studies(tmp_path_factory):
    """One run, inspected with a model without the true motor lag and with the true model."""
    folder = tmp_path_factory.mktemp("picture")
    truth = with_effect(folder / "truth.yaml", "{name: motor_lag, tau: 0.06}")
    bag = write_bag(folder / "run.bag", model=truth, nu=(0.3, 0.1, 1))
    given, right = (_core.load_model(str(path)) for path in (MODEL, truth))
    run = quality.repaired(readers.read(str(bag))).data(given)
    return [
        inspection.inspect(run, given, "given", "held_out", right),
        inspection.inspect(run, right, "right"),
    ]


def driven():
    model = _core.load_model(str(MODEL))
    choice = gains.choice("TrajectoryTracking")
    run = tracking.run(model, model, choice, tracking.task("circle", 1.0, 4.0), max_error=np.inf)
    room = _core.load_room(str(MODEL.parents[1] / "room" / "room_4x4.yaml"))
    return tracking_figures.driven(run, "a circle", (1.0, 4.0), room)


def tuned():
    tried = [tuning.Candidate({}) for _ in range(3)]
    for count, one in enumerate(tried):
        one.errors, one.saturated, one.effort = {"circle, nominal": [0.1 + count]}, 0.1 * count, 0.2
    rows = [
        {
            "reference": name,
            "held_out": True,
            "condition": "noise",
            "rms": dict.fromkeys("ab", QUANTILES),
        }
        for name in ("circle", "line")
    ]
    best = [{"error": 0.1, "saturated": 0.2}]
    compared = dict.fromkeys("ab", tried[0])
    return tracking_figures.tuned(compared, tried, {"table": rows, "trade_off": best})


DESCRIBED = {
    "fall": lambda studies: figures.fall([("given", 0.3), ("+ lag", 0.1)], 0.05, "all runs"),
    "motion": figures.motion,
    "where": figures.where,
    "residual_correlation": figures.residual_correlation,
    "wrench": lambda studies: wrench_figures.wrench(studies, "right"),
    "wrench_over_time": wrench_figures.wrench_over_time,
    "shares": lambda studies: figures.shares([(s["label"], [s]) for s in studies]),
    "driven": lambda studies: driven(),
    "tuned": lambda studies: tuned(),
}


def test_every_figure_is_tried():
    described = {
        name
        for module in (figures, wrench_figures, tracking_figures)
        for name, function in inspect.getmembers(module, inspect.isfunction)
        if function.__module__ == module.__name__
        and inspect.signature(function).return_annotation == Document
        and not name.startswith("_")
    }
    assert described == set(DESCRIBED)


@pytest.mark.parametrize("name", DESCRIBED)
def test_plotly_knows_every_property_of_a_figure(studies, name):
    figure = DESCRIBED[name](studies)
    document = json.loads(json.dumps(figure, default=list))
    assert go.Figure(document).to_plotly_json()["layout"].keys() == document["layout"].keys()
    document["layout"]["xaxis"]["tilte"] = "a property that does not exist"
    with pytest.raises(ValueError, match="tilte"):
        go.Figure(document)


@pytest.fixture(scope="module")
def pictures(studies):
    """{name: (figure, its picture below another figure, {gid: artists in it})}."""
    above = go.Figure(layout={"height": 50, "font": {"size": 9}}).to_plotly_json()
    found = {}
    for name, describe in DESCRIBED.items():
        figure = describe(studies)
        whole = picture.draw([above, figure])
        whole.canvas.draw()
        artists = {}
        for artist in whole.findobj(lambda artist: artist.get_gid()):
            artists.setdefault(artist.get_gid(), []).append(artist)
        found[name] = figure, whole, artists
    return found


def lengths(values):
    return len([value for value in values if value is not None])


@pytest.mark.parametrize("name", DESCRIBED)
def test_everything_in_a_figure_is_in_its_picture(pictures, name):
    figure, whole, found = pictures[name]
    found = dict(found)
    layout = figure["layout"]
    for count, trace in enumerate(figure["data"]):
        artists = found.pop("1.%d" % count)
        if trace["type"] == "bar":
            assert [patch.get_width() for patch in artists] == list(trace["x"])
        elif trace["type"] == "heatmap":
            assert artists[0].get_array().size == np.size(trace["z"])
        elif trace["type"] == "table":
            texts = {cell.get_text().get_text() for cell in artists[0].get_celld().values()}
            assert texts == set(trace["header"]["values"]).union(*trace["cells"]["values"])
        elif "fill" in trace:
            assert sum(len(path.vertices) - 1 for path in artists[0].get_paths()) == lengths(
                trace["x"]
            )
        elif "colorscale" in trace.get("marker", {}):
            assert len(artists[0].get_offsets()) == len(trace["x"])
        else:
            assert np.isfinite(artists[0].get_xdata()).sum() == lengths(trace["x"])
            assert artists[0].axes.get_xscale() == layout["xaxis" + trace["xaxis"][1:]].get(
                "type", "linear"
            )
    assert len(found.pop("shape", ())) == len(layout.get("shapes", ()))
    notes = [
        re.sub("</?b>", "", note["text"]).replace("<br>", "\n")
        for note in layout.get("annotations", ())
    ]
    assert [text.get_text() for text in found.pop("annotation", ())] == notes
    assert not found
    titles = [
        axis["title"].get("text") for key, axis in layout.items() if re.match("[xy]axis", key)
    ]
    shown = {text for axes in whole.axes for text in (axes.get_xlabel(), axes.get_ylabel())}
    assert {title.replace("<br>", "\n") for title in titles if title} <= shown
    entries = [text.get_text() for legend in whole.legends for text in legend.get_texts()]
    named = [
        trace["name"]
        for trace in figure["data"]
        if trace.get("name") and trace.get("showlegend", True)
    ]
    assert entries == list(dict.fromkeys(named)) and (entries or name in ("fall", "shares"))
    assert layout["meta"].split()[0] in whole.texts[0].get_text()


NOT_QUANTITIES = {
    *("given", "right", "a", "b", "measured", "reference", "craft", "walls", "start", "heading"),
    *("body axes", "added by the last model", "none better in error, saturation and effort"),
}


@pytest.mark.parametrize("name", DESCRIBED)
def test_quantities_have_units(pictures, name):
    figure = pictures[name][0]
    axes = [part for key, part in figure["layout"].items() if re.match("[xy]axis", key)]
    bars = [t["marker"]["colorbar"] for t in figure["data"] if "colorbar" in t.get("marker", {})]
    titles = [part["title"].get("text") for part in axes + bars]
    entries = [t["name"] for t in figure["data"] if t.get("name") and t.get("showlegend", True)]
    for text in filter(None, titles + [e for e in entries if e not in NOT_QUANTITIES]):
        assert re.search(r"\[[^\]]+\]", text), text
    assert any(titles) or name == "shares"  # whose caption has the unit
    assert name != "shares" or "[%]" in figure["layout"]["meta"]


def test_texts_stay_inside_the_picture_and_do_not_overlap(pictures):
    for name, (_, whole, _) in pictures.items():
        renderer, scale = whole.canvas.get_renderer(), whole.bbox
        boxes = [
            (label.get_text(), label.get_window_extent(renderer))
            for axes in whole.axes
            for axis in (axes.xaxis, axes.yaxis)
            for label in [axis.label]
            if axes.axison and label.get_text() and axis.get_visible()
        ]
        boxes += [
            (t.get_text(), t.get_window_extent(renderer)) for t in whole.texts if not t.get_gid()
        ]
        for count, (text, box) in enumerate(boxes):
            assert box.x0 >= 0 and box.x1 <= scale.x1 and box.y0 >= 0 and box.y1 <= scale.y1, (
                name,
                text,
            )
            for other, beside in boxes[:count]:
                assert not box.overlaps(beside), (name, text, other)


def test_the_same_model_has_the_same_colour_everywhere(studies, pictures):
    wanted = {s["label"]: appearance.model_color(i) for i, s in enumerate(studies)}
    alone = [
        wrench_figures.wrench(studies[1:], first=1),
        wrench_figures.wrench_over_time(studies[1:], first=1),
    ]
    described = [pictures[n][0] for n in ("motion", "where", "wrench", "residual_correlation")]
    for figure in described + alone:
        lines = [t for t in figure["data"] if t.get("name") in wanted]
        assert lines and all(t["line"]["color"] == wanted[t["name"]] for t in lines)


def simple(**layout):
    figure = make_subplots(rows=1, cols=2)
    figure.add_scatter(
        x=[1, 10, None, 30], y=[1, 2, 3, 4], mode="lines", line_color="#ff0000", row=1, col=1
    )
    figure.add_scatter(
        x=[1, 2], y=[0, 1], mode="lines", line_color="rgba(0,0,255,0.5)", row=1, col=2
    )
    figure.update_layout(
        height=300, font={"size": 12}, margin=dict.fromkeys("lrtb", 50), meta="Two lines"
    )
    figure.update_layout(
        showlegend=None, legend={"orientation": "h", "x": 0, "y": 1, "yanchor": "bottom"}
    )
    figure.update_layout(**layout)
    return figure.to_plotly_json()


def test_places_scales_and_gaps():
    figure = simple(
        xaxis={"type": "log", "range": [0, 2]}, yaxis2={"scaleanchor": "x2"}, xaxis2_range=[0, 4]
    )
    whole = picture.draw([figure])
    left, right = whole.axes
    assert left.get_xlim() == pytest.approx((1, 100)) and left.get_xscale() == "log"
    box = left.get_position()
    width = (picture.WIDTH - 100) / picture.WIDTH
    assert box.x0 == pytest.approx(50 / picture.WIDTH) and box.width == pytest.approx(0.45 * width)
    assert box.height == pytest.approx(200 / (300 + picture.LINE_HEIGHT))
    size, x, y = right.get_window_extent().size, np.ptp(right.get_xlim()), np.ptp(right.get_ylim())
    assert size[0] / x == pytest.approx(size[1] / y)
    assert np.isnan(left.lines[0].get_xdata()[2]) and right.lines[0].get_color() == (0, 0, 1, 0.5)


def change(path, value):
    """A simple figure with one part changed."""
    figure = part = copy.deepcopy(simple())
    for key in path[:-1]:
        part = (
            part[key]
            if isinstance(part, (list, tuple)) or key in part
            else part.setdefault(key, {})
        )
    part[path[-1]] = value
    return figure


NOTE = {"text": "a", "x": 0, "y": 0, "xref": "x", "yref": "y", "showarrow": False}
SHAPE = {
    "type": "circle",
    "x0": 0,
    "x1": 1,
    "y0": 0,
    "y1": 1,
    "xref": "x",
    "yref": "y",
    "line": {"width": 0},
}


@pytest.mark.parametrize(
    "path, value, words",
    [
        (("data", 0, "type"), "pie", "type pie"),
        (("data", 0, "mode"), "lines+text", "scatter.mode 'lines+text'"),
        (("data", 0, "fill"), "tozeroy", "scatter.fill 'tozeroy'"),
        (("data", 0, "text"), ["a"], "scatter.text"),
        (("data", 0, "line", "smoothing"), 1.3, "line.smoothing"),
        (("data", 0, "yaxis"), "y2", "two y axes"),
        (("layout", "images"), [], "layout.images"),
        (("layout", "xaxis", "rangeslider"), {}, "axis.rangeslider"),
        (("layout", "annotations"), [dict(NOTE, showarrow=True)], "annotation.showarrow True"),
        (("layout", "annotations"), [dict(NOTE, text="<i>a</i>")], "the markup in <i>a</i>"),
        (("layout", "shapes"), [SHAPE], "type circle"),
    ],
)
def test_what_a_picture_cannot_show_is_refused(path, value, words):
    picture.draw([simple()])
    with pytest.raises(GroundError, match=re.escape("a picture cannot show ")) as refused:
        picture.draw([change(path, value)])
    assert words in str(refused.value)


def test_files(tmp_path):
    for form, begin in ((".png", b"\x89PNG"), (".svg", b"<?xml")):
        picture.write(str(tmp_path / ("a" + form)), [simple(), simple()])
        assert (tmp_path / ("a" + form)).read_bytes().startswith(begin)
    with pytest.raises(GroundError, match="exists"):
        picture.write(str(tmp_path / "a.png"), [simple()])
