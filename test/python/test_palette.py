"""Colours: distinguished by people with a common colour blindness, the same everywhere, in one place."""

import itertools
import re

import numpy as np
import yaml

from conftest import ROOT
from ground import _core

MIN_DIFFERENCE = 15.0  # CIE76; differences of 2.3 are just noticeable side by side
# Linear RGB as people with deuteranopia, the most common of its kind, see it: Machado, Oliveira and Fernandes
# (2009), table 1.
VISION = [
    [0.367322, 0.860646, -0.227968],
    [0.280085, 0.672501, 0.047413],
    [-0.011820, 0.042940, 0.968881],
]
TO_XYZ = np.array(  # of sRGB, D65
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)


def rgb(color):
    return [int(color[i : i + 2], 16) for i in (1, 3, 5)]


def lab(color):
    """CIELAB of a colour as somebody with this vision sees it."""
    values = np.array(rgb(color)) / 255
    linear = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    xyz = TO_XYZ @ np.clip(VISION @ linear, 0, 1) / TO_XYZ.sum(axis=1)
    x, y, z = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz * (29 / 6) ** 2 / 3 + 4 / 29)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def test_lines_beside_each_other_are_distinguished():
    palette = _core.palette
    of_models = [palette["measured"], palette["reference"], *palette["models"]]
    in_rviz = [palette["measured"], palette["reference"], *palette["models"][:2]]
    in_rviz += [palette["missing"], *palette["thrusters"][:2]]
    for colors in (of_models, in_rviz, palette["thrusters"]):
        pairs = itertools.combinations(map(lab, colors), 2)
        assert min(np.linalg.norm(one - other) for one, other in pairs) > MIN_DIFFERENCE


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


def test_coloured_things_take_their_colour_from_one_place():
    """Greys may stand anywhere; colours only in palette.h, and those of texts and shades in
    appearance.py."""
    allowed = {"palette.h", "appearance.py"}
    for folder, kinds in (("src/ground", ("*.py", "*.cpp", "*.h")),):
        for path in (p for kind in kinds for p in (ROOT / folder).rglob(kind)):
            for color in re.findall(r"#[0-9a-fA-F]{6}\b", path.read_text()):
                colourful = max(rgb(color)) - min(rgb(color)) > 8
                assert not colourful or path.name in allowed, "%s: %s" % (path, color)
