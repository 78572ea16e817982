"""Colours: distinguished by people with any common colour vision, the same everywhere, in one place."""

import itertools
import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
import yaml
from conftest import ROOT

from ground import _core
from ground.reports import appearance

MIN_DIFFERENCE = 15.0  # CIE76; differences of 2.3 are just noticeable side by side
# Linear RGB as people see it: Machado, Oliveira and Fernandes (2009), table 1, severity 1.
VISION = {
    "normal": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}
TO_XYZ = np.array(  # of sRGB, D65
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)


def rgb(color):
    return [int(color[i : i + 2], 16) for i in (1, 3, 5)]


def lab(color, vision):
    """CIELAB of a colour as somebody with this vision sees it."""
    values = np.array(rgb(color)) / 255
    linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    xyz = TO_XYZ @ np.clip(VISION[vision] @ linear, 0, 1) / TO_XYZ.sum(axis=1)
    x, y, z = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz * (29 / 6) ** 2 / 3 + 4 / 29)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def least_difference(colors, vision):
    return min(
        np.linalg.norm(lab(one, vision) - lab(other, vision))
        for one, other in itertools.combinations(colors, 2)
    )


@pytest.mark.parametrize("vision", VISION)
def test_colours_beside_each_other_are_distinguished(vision):
    palette = _core.palette
    of_models = [palette["measured"], palette["reference"], *palette["models"]]
    in_rviz = [palette["measured"], palette["reference"], *palette["models"][:2]]
    in_rviz += [palette["missing"], *palette["thrusters"][:2]]
    for colors in (of_models, in_rviz, palette["thrusters"]):
        assert least_difference(colors, vision) > MIN_DIFFERENCE
    former = ["#222222", "#d1495b", "#1f77b4", "#2a9d5c", "#8e5ea2"]
    assert vision in ("normal", "tritanopia") or least_difference(former, vision) < 6


@pytest.mark.parametrize("vision", VISION)
def test_lightness_alone_tells_values_on_a_scale(vision):
    for scale in (_core.palette["scale"], [c for _, c in appearance.ORANGES]):
        scale = [hexadecimal(color) for color in scale]
        steps = np.diff([lab(color, vision)[0] for color in scale])
        assert (np.sign(steps) == np.sign(steps[0])).all() and abs(steps).min() > 2


def hexadecimal(color):
    found = re.findall(r"\d+", color)
    return "#%02x%02x%02x" % tuple(map(int, found)) if color.startswith("rgb(") else color


def test_models_and_thrusters_differ_by_more_than_colour():
    """Each has its own dashes where colours begin again, models also among the first ones."""
    models = [appearance.model_line(i, 1) for i in range(8)]
    assert len({line["dash"] for line in models[:4]}) == 4
    assert len({appearance.model_mark(i)["symbol"] for i in range(4)}) == 4
    thrusters = [appearance.thruster_line(i, 1) for i in range(8)]
    for lines in (models, thrusters):
        assert len({(line["color"], line["dash"]) for line in lines}) == 8


def test_rviz_shows_paths_in_the_colours_of_the_palette():
    view = yaml.safe_load((ROOT / "cfg" / "rviz" / "ground.rviz").read_text())
    found = {
        d["Topic"]: "#%02x%02x%02x" % tuple(map(int, d["Color"].split(";")))
        for d in view["Visualization Manager"]["Displays"]
        if d["Class"] == "rviz/Path"
    }
    first, second = _core.palette["models"][:2]
    assert found == {
        "path/reference": _core.palette["reference"],
        "path/measured": _core.palette["measured"],
        "path/predicted": first,
        "path/predicted2": second,
        "discovery/planned": _core.palette["thrusters"][1],
    }


def test_plotjuggler_shows_curves_in_the_colours_of_the_palette():
    pages = ElementTree.parse(str(ROOT / "cfg" / "plotjuggler" / "ground.xml"))
    found = {c.get("name"): c.get("color") for c in pages.iter("curve")}
    palette = _core.palette
    for i in range(3):
        assert found["/state/nu[%d]" % i] == palette["measured"]
        for topic, color in zip(("model_error", "model_error2"), palette["models"]):
            assert found["/%s/nu[%d]" % (topic, i)] == color
    assert found["/controls/left"], found["/controls/right"] == palette["thrusters"][:2]
    assert found["/model_error/wrench[2]"] == palette["missing"]


def test_coloured_things_take_their_colour_from_one_place():
    """Greys may stand anywhere; colours only in palette.h, and those of texts and shades in
    appearance.py."""
    allowed = {"palette.h", "appearance.py"}
    for folder, kinds in (("src/ground", ("*.py", "*.cpp", "*.h")),):
        for path in (p for kind in kinds for p in (ROOT / folder).rglob(kind)):
            for color in re.findall(r"#[0-9a-fA-F]{6}\b", path.read_text()):
                colourful = max(rgb(color)) - min(rgb(color)) > 8
                assert not colourful or path.name in allowed, "%s: %s" % (path, color)
