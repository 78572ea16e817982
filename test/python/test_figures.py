"""Figures: plotly knows them, quantities have units, a model has one colour, and a file can be made."""

import json
import re

import numpy as np
import plotly.graph_objects as go
import pytest

from conftest import MODEL, with_effect, write_bag
from ground import _core
from ground.recordings import quality, readers
from ground.reports import (
    figures,
    inspection,
    page,
    tracking_figures,
    wrench_figures,
)
from ground.simulation import gains, tracking

FOUND = {
    "seconds": 1.0,
    "errors": {
        "a": {"position_mm": 56.0, "heading_deg": 12.0},
        "b": {"position_mm": None, "heading_deg": None},
    },
    "mocap": {"position_mm": 3.0, "heading_deg": 0.5},
    "disturbed": None,
}


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
    "predictions": lambda studies: figures.predictions(
        FOUND, [("a", "given"), ("b", "with lag")], "It falls"
    ),
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
    assert any(titles) or any(part.get("ticksuffix", "").strip() for part in axes)


def test_figures_make_a_page(drawn, tmp_path):
    page.write_figures(str(tmp_path / "fall.html"), [drawn["predictions"]])
    assert "It falls." in (tmp_path / "fall.html").read_text()
