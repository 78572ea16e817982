"""What accelerations say about a model, without its likelihood."""

import numpy as np
import pytest
from conftest import MODEL

from ground import _core
from ground.analysis import second_opinion
from ground.errors import GroundError
from ground.recordings import repair

NOISE = np.array([3e-4, 3e-4, 5e-3])  # of poses [m, m, rad]
SECONDS = 8.0
FULL = 0.124  # thrust of both thrusters [N]
EFFECT = """
- name: hidden
  expression: {%s}
  parameters:
    c: {value: %g, unit: "%s", neutral: 0, lower: -10, upper: 10}
"""


def model():
    return _core.load_model(str(MODEL))


def with_hidden(formulas, value, unit):
    """The model with an effect of formulas of one constant, c."""
    return _core.with_effect(model(), EFFECT % (formulas, value, unit), "hidden")


def recordings(truth, push=0.0, fixed_in="body", count=4, seconds=SECONDS, seed=1):
    """Runs of a craft under random commands and a random push, which lasts about 3 s."""
    return [one(truth, push, fixed_in, seconds, 100 * seed + i) for i in range(count)]


def one(truth, push, fixed_in, seconds, seed):
    random = np.random.default_rng(seed)
    times = np.arange(0, seconds, 0.01)
    edges = np.arange(-0.5, seconds, 0.2)
    inputs = np.column_stack(
        [edges, random.choice([0, 0.3, 0.7, 1], (len(edges), 2)), 1 + 0 * edges]
    )
    start = np.array([0, 0, random.uniform(-3, 3)])
    force = np.zeros((len(times), 3))
    force[0] = random.normal(size=3)
    for i in range(1, len(times)):
        force[i] = force[i - 1] * (1 - 0.01 / 3) + np.sqrt(0.02 / 3) * random.normal(size=3)
    force = force * push * FULL * np.array([1, 1, 0.0 if fixed_in == "room" else 0.016])
    wrench = force
    for _ in range(6 if fixed_in == "room" else 1):  # turns the force by the heading that it causes
        found = _core.simulate(truth, inputs, times, start, np.zeros(3), wrench=wrench)
        c, s = np.cos(found["eta"][:, 2]), np.sin(found["eta"][:, 2])
        if fixed_in == "room":
            x, y = force[:, 0], force[:, 1]
            wrench = np.column_stack([c * x + s * y, c * y - s * x, force[:, 2]])
    poses = found["eta"] + NOISE * random.normal(size=(len(times), 3))
    smoothed = repair.smooth(times, poses, (NOISE[0], NOISE[2]))
    return _core.RunData(
        "run %d" % seed, times, smoothed["eta"], smoothed["nu"], inputs, poses, NOISE
    )


@pytest.mark.parametrize("fixed_in", ["body", "room"])
@pytest.mark.parametrize("push", [0.0, 0.005, 0.05])
def test_a_push_is_not_taken_for_a_missing_effect(push, fixed_in):
    runs = recordings(model(), push, fixed_in)
    opinion = second_opinion.second_opinion(runs, model())
    assert opinion.says == ()
    assert "nothing" in second_opinion.words(opinion)


@pytest.mark.parametrize(
    "formulas, value, unit, argument",
    [
        ("N: c*sin(psi)", 2e-4, "N m", "heading"),
        ("X: c*cos(psi)*sin(21*x), Y: -c*sin(psi)*sin(21*x)", 0.01, "N", "place"),
        ("X: -c*(x*cos(psi)+y*sin(psi)), Y: -c*(y*cos(psi)-x*sin(psi))", 0.02, "N/m", "place"),
        ("X: c*r*v, Y: -c*r*u", 0.02, "kg", "velocity"),
        ("Y: c*(u_L-u_R)*(u_L-u_R)", 0.01, "N", "command"),
    ],
)
@pytest.mark.parametrize("push", [0.0, 0.01])
def test_what_a_missing_effect_depends_on_is_said(formulas, value, unit, argument, push):
    runs = recordings(with_hidden(formulas, value, unit), push, seed=2)
    opinion = second_opinion.second_opinion(runs, model())
    assert opinion.says[0] == argument
    share, p_value = opinion.arguments[argument]
    assert share > 0.1 and p_value < 0.01
    assert opinion.interval[0] <= opinion.share <= opinion.interval[1]
    assert argument in second_opinion.words(opinion) or "velocit" in second_opinion.words(opinion)


def test_an_effect_that_the_model_has_is_not_missing():
    truth = with_hidden("N: c*sin(psi)", 2e-4, "N m")
    assert second_opinion.second_opinion(recordings(truth), truth).says == ()


def test_a_single_run_is_judged_by_its_parts():
    truth = with_hidden("N: c*sin(psi)", 3e-4, "N m")
    runs = recordings(truth, count=1, seconds=20.0)
    assert second_opinion.second_opinion(runs, model()).says[:1] == ("heading",)


def test_runs_that_are_too_short_are_refused():
    with pytest.raises(GroundError, match="too short"):
        second_opinion.second_opinion(recordings(model(), count=1, seconds=1.0), model())
