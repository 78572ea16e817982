"""Figures: plotly knows them, quantities have units, a model has one colour, and a file can be made."""

import json
import re
import shutil

import numpy as np
import plotly.graph_objects as go
import pytest

from conftest import MODEL, write_bag
from ground import _core
from ground.recordings import quality, readers
from ground.reports import (
    appearance,
    figures,
    inspection,
    picture,
    tracking_figures,
    wrench_figures,
)
from ground.simulation import gains, tracking
from ground.support.errors import GroundError
from test_diagnose import with_effect

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
        inspection.inspect(run, given, "given", "held_out"),
        inspection.inspect(run, right, "right"),
    ]


def driven():
    model = _core.load_model(str(MODEL))
    choice = gains.choice("TrajectoryTracking")
    run = tracking.run(model, model, choice, tracking.task("circle", 1.0, 4.0), max_error=np.inf)
    room = _core.load_room(str(MODEL.parents[1] / "room" / "room_4x4.yaml"))
    return tracking_figures.driven(run, "a circle", (1.0, 4.0), room)


DESCRIBED = {
    "fall": lambda studies: figures.fall([("given", 0.3), ("+ lag", 0.1)], 0.05, "all runs"),
    "motion": figures.motion,
    "residual_correlation": figures.residual_correlation,
    "wrench_over_time": wrench_figures.wrench_over_time,
    "driven": lambda studies: driven(),
}


@pytest.fixture(scope="module")
def drawn(studies):
    return {name: describe(studies) for name, describe in DESCRIBED.items()}


@pytest.mark.parametrize("name", DESCRIBED)
def test_plotly_knows_every_property_of_a_figure(drawn, name):
    go.Figure(json.loads(json.dumps(drawn[name], default=list)))  # ValueError for any other


NOT_QUANTITIES = {
    *("given", "right", "a", "b", "measured", "reference", "craft", "walls", "start", "heading"),
}


@pytest.mark.parametrize("name", DESCRIBED)
def test_quantities_have_units(drawn, name):
    layout, data = drawn[name]["layout"], drawn[name]["data"]
    axes = [part for key, part in layout.items() if re.match("[xy]axis", key)]
    titles = [part.get("title", {}).get("text") for part in axes]
    entries = [t["name"] for t in data if t.get("name") and t.get("showlegend", True)]
    for text in filter(None, titles + [e for e in entries if e not in NOT_QUANTITIES]):
        assert re.search(r"\[[^\]]+\]", text), text
    assert any(titles)


def test_the_same_model_has_the_same_colour_everywhere(studies, drawn):
    wanted = {s["label"]: appearance.model_color(i) for i, s in enumerate(studies)}
    for name in ("motion", "residual_correlation", "wrench_over_time"):
        lines = [t for t in drawn[name]["data"] if t.get("name") in wanted]
        assert lines and all(t["line"]["color"] == wanted[t["name"]] for t in lines)


@pytest.mark.skipif(not shutil.which("chromium"), reason="chromium is not installed")
def test_a_browser_draws_a_png(drawn, tmp_path):
    from PIL import Image

    path = tmp_path / "fall.png"
    picture.write(str(path), [drawn["fall"]])
    shown = Image.open(str(path)).convert("RGB")
    assert sum(shown.resize((1, 1)).getpixel((0, 0))) < 3 * 253
    colors = {color for _, color in shown.getcolors(1 << 20)}
    bars = [appearance.MODELS[0], appearance.MODELS[1]]
    assert {tuple(int(bar[i : i + 2], 16) for i in (1, 3, 5)) for bar in bars} <= colors


def test_without_a_browser_a_page_is_offered(drawn, tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(GroundError, match="needs Chromium.*ends with .html"):
        picture.write(str(tmp_path / "fall.png"), [drawn["fall"]])
    picture.write(str(tmp_path / "fall.html"), [drawn["fall"]])
    assert "Error: mean over samples" in (tmp_path / "fall.html").read_text()
