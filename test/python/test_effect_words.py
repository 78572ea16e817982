"""Each effect of the library says what it does in a sentence, with its values, units and sides."""

import math
import re

import numpy as np
import pytest

import ground
from ground import _core
from ground.effect_library import candidates
from ground.reports import effect_words
from ground.reports.effect_words import Estimate, sentence

CRAFTS = (
    "tiny_whoover",
    "free_flyer",
    "air_table",
    "one_fan_rudder",
    "propeller_ship",
    "twin_screw_catamaran",
)
MODELS = {name: ground.Model.load(name) for name in CRAFTS}
EFFECTS = [
    (craft, name, described["parameters"])
    for craft, model in MODELS.items()
    for name, described in candidates.effects(model.core).items()
]
NUMBER = r"\d (%s)\b|\d%%" % "|".join(
    ["m?s", "m?m", "k?g", "deg", "deg/s", "m/s", "m?N", "m?N m", "m?N m s", "m?N s/m"]
)


def exactly(value, unit):
    """An estimate whose interval is narrow."""
    return Estimate(value, value - 1e-4 * abs(value), value + 1e-4 * abs(value), unit)


def moved(p, sign):
    """A value on one side of the neutral one, which the parameter may have, or None."""
    value = 4.0 if math.isinf(p["neutral"]) else p["neutral"] + 0.08 * sign
    return value if p["lower"] <= value <= p["upper"] else None


@pytest.mark.parametrize("craft, effect, parameters", EFFECTS)
def test_each_parameter_of_each_effect_says_what_it_does(craft, effect, parameters):
    for sign in (1, -1):
        found = {
            p["name"]: exactly(moved(p, sign), p["unit"]) for p in parameters if moved(p, sign) is not None
        }
        for p in parameters:
            if p["name"] not in found or p["shape"]:
                continue
            others = {q["name"]: exactly(q["neutral"], q["unit"]) for q in parameters if q is not p}
            told = sentence(effect, {**others, p["name"]: found[p["name"]]})
            assert re.search(NUMBER, told) or effect.startswith("dead_band_") and "0.08" in told, told
            assert not re.search(r"[{}\[\]|]|THRUSTER|[+-]\d(?!.* m\b)", told.split(" towards ")[0]), told
            if effect not in candidates.effects():  # one thruster, or a kind that few crafts have
                alone = effect[len(effect_words.kind_of(effect)) + 1 :]
                assert alone in told
    assert (
        sentence(
            effect, {p["name"]: Estimate(p["neutral"], p["neutral"], p["neutral"], "") for p in parameters}
        )
        == ""
    )


# Where the phrase says so the acceleration is positive: effect, parameter, velocities, inputs, component (of
# the derivatives of x, y, psi, u, v, r), phrase
PUSHES = [
    ("body_force_bias", "x0", (0, 0, 0), (0, 0), 3, "ahead"),
    ("body_force_bias", "y0", (0, 0, 0), (0, 0), 4, "to the right"),
    ("yaw_bias", "n0", (0, 0, 0), (0, 0), 5, "to the right"),
    (
        "thrust_asymmetry",
        "a",
        (0, 0, 0),
        (0.5, 0.5),
        5,
        "left side pushes 8% more and the right side pushes 8% less",
    ),
    ("thrust_misalignment", "angle", (0, 0, 0), (0.5, 0.5), 4, "to the right"),
    ("thrust_curve", "p", (0, 0, 0), (0.5, 0.5), 3, "larger"),
    ("thrust_speed_loss", "c", (1, 0, 0), (0.5, 0.5), 3, "rises"),
    ("thrust_sway_moment", "c", (0, 1, 0), (0.5, 0.5), 5, "the craft to the right"),
    ("differential_side_force", "c", (0, 0, 0), (0.8, 0.2), 4, "pushes the craft to the right"),
    ("sway_yaw_damping", "yr", (0, 0, 1), (0, 0), 4, "pushes the craft to the right"),
    ("sway_yaw_damping", "nv", (0, 1, 0), (0, 0), 5, "turns the craft to the right"),
    ("directional_yaw_damping", "na", (0, 0, 1), (0, 0), 5, "smaller to the right"),
    ("com_offset", "yg", (0, 0, 0), (0.5, 0.5), 5, "to the right"),
    ("drift_resistance", "xvv", (0, 1, 0), (0, 0), 3, "ahead"),
    ("drift_resistance", "xrr", (0, 0, 1), (0, 0), 3, "ahead"),
    ("drift_resistance", "xvr", (0, 1, 1), (0, 0), 3, "ahead"),
    ("hull_lift", "yv", (1, 1, 0), (0, 0), 4, "pushes the craft to the right"),
    ("hull_lift", "yr", (1, 0, 1), (0, 0), 4, "pushes the craft to the right"),
    ("hull_lift", "nv", (1, 1, 0), (0, 0), 5, "turns the craft to the right"),
    ("hull_lift", "nr", (1, 0, 1), (0, 0), 5, "turns the craft to the right"),
    ("hull_nonlinear", "xvvvv", (0, 1, 1), (0, 0), 3, "ahead"),
    ("hull_nonlinear", "yvvr", (0, 1, 1), (0, 0), 4, "pushes the craft to the right"),
    ("hull_nonlinear", "nrrr", (0, 1, 1), (0, 0), 5, "turns the craft to the right"),
]


def derivative(model, velocities, inputs):
    state = np.concatenate([np.zeros(3), velocities])
    found = _core.evaluate(model.core, [state], [[*inputs, 1.0]], [0.0], [0.01])
    return found["derivative"][0]


@pytest.mark.parametrize("effect, name, velocities, inputs, component, phrase", PUSHES)
def test_the_side_that_a_sentence_names_is_the_one_to_which_the_craft_goes(
    effect, name, velocities, inputs, component, phrase
):
    model = MODELS["tiny_whoover"]
    unit = next(p["unit"] for p in candidates.effects()[effect]["parameters"] if p["name"] == name)
    for sign in (1, -1):
        value = (1.0 if effect == "thrust_curve" else 0.0) + 0.08 * sign
        other = model.with_effect(effect, **{name: value})
        change = derivative(other, velocities, inputs) - derivative(model, velocities, inputs)
        assert change[component] != 0
        assert (phrase in sentence(effect, {name: exactly(value, unit)})) == (change[component] > 0)


def test_where_the_mocap_sees_the_craft():
    state = np.zeros((1, 6))
    for effect, name, column in (("marker_offset", "dy", 1), ("heading_offset", "psi0", 2)):
        for value in (0.08, -0.08):
            model = MODELS["tiny_whoover"].with_effect(effect, **{name: value})
            seen = _core.evaluate(model.core, state, [[0, 0, 1]], [0.0], [0.01])["measure"][0]
            assert ("to the right" in sentence(effect, {name: exactly(value, "m")})) == (seen[column] > 0)


def test_directions_and_what_is_not_known():
    wind = {"wx": Estimate(-0.13, -0.14, -0.12, "m/s"), "wy": Estimate(-0.11, -0.12, -0.10, "m/s")}
    assert sentence("wind", wind).startswith("it blows at 0.17 m/s towards -140 deg (95%: ")
    wide = {"wx": Estimate(-0.13, -0.2, -0.06, "m/s"), "wy": Estimate(-0.11, -1, 1, "m/s")}
    assert sentence("wind", wide) == "it blows at 0.17 m/s in a direction that these runs do not determine"
    assert sentence("wind", {name: Estimate(-0.13, -1, 1, "m/s") for name in wind}) == ""
    assert sentence("thrust_asymmetry", {"a": Estimate(-0.08, -0.2, 0.04, "-")}) == ""
    assert sentence("an_effect_of_my_own", {"a": exactly(1.0, "N")}) == ""
