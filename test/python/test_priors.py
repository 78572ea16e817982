"""What a user knows of parameters before a fit."""

import os

import numpy as np
import pytest

import ground
from conftest import MODEL, slow
from ground import _core

KNOWN = {"hull_lift.yv": 0.3, "hull_lift.yr": 0.3, "hull_lift.nv": 0.3, "hull_lift.nr": 0.3}  # shares
SEEDS = range(12 if os.environ.get("SLOW") else 4)


def boat():
    return ground.Model.load(MODEL.parent.parent / "craft/twin_screw_catamaran.yaml")


def recorded(model, seed, seconds=60.0, turn=0.0):
    """A run of a boat that mostly goes straight on: it hardly shows the forces of a turn. Or of one that
    turns."""
    random = np.random.default_rng(seed)
    at = np.arange(0, seconds, 5.0)
    left = np.where(at > 0, 0.5 + turn, 0.5) if turn else 0.5 + 0.1 * random.normal(size=len(at))
    commands = np.column_stack([left, 1.0 - left, np.zeros(len(at))])
    times = np.arange(0.1, seconds, 0.1)
    eta = _core.simulate(model.core, np.column_stack([at, commands]), times, np.zeros(3), np.zeros(3))["eta"]
    poses = eta + random.normal(size=eta.shape) * (0.02, 0.02, 0.01)
    channels = ("port", "starboard", "lift")
    return ground.Recording.from_arrays(times, poses, commands, at, channels=channels, name="run%d" % seed)


def drawn(known, seed):
    """A boat as one knows it: true values are drawn about those known."""
    random = np.random.default_rng(1000 + seed)
    return known.with_values(
        {name: known[name] * (1 + share * random.normal()) for name, share in KNOWN.items()}
    )


@pytest.fixture(scope="module")
def guess():
    values = {"hull_lift.yv": 40.0, "hull_lift.yr": -10.0, "hull_lift.nv": 8.0, "hull_lift.nr": 60.0}
    return boat().with_effect("hull_lift").with_values(values)


def test_values_known_beforehand_make_a_fit_better_than_either_alone(guess):
    """Over boats drawn from what is known: the fit is nearer to the truth than what was known and than a fit
    without it, and its intervals hold the truth."""
    off = np.empty((3, len(SEEDS), len(KNOWN)))  # of what was known, of the runs alone, of both
    inside = np.empty(off.shape[1:], bool)
    for i, seed in enumerate(SEEDS):
        true = drawn(guess, seed)
        run = recorded(true, seed)
        alone = ground.fit(guess, run, free=list(KNOWN))
        both = ground.fit(guess, run, free=list(KNOWN), prior={name: "30%" for name in KNOWN})
        for j, name in enumerate(KNOWN):
            estimates = guess[name], alone.parameters[name].value, both.parameters[name].value
            off[:, i, j] = (np.array(estimates) - true[name]) / guess[name]
            low, high = both.parameters[name].ci95
            inside[i, j] = low < true[name] < high
    sizes = np.sqrt((off**2).mean(axis=1))
    gain = sizes[2] / sizes[:2].min(axis=0)
    assert gain.max() < 1.15 and np.exp(np.log(gain).mean()) < 0.95, sizes
    assert inside.mean() >= 0.85, inside


@slow
def test_a_band_contains_what_was_known(guess):
    """A circle that the runs hardly tell of, by boats drawn from what is known."""
    inside = []
    for seed in range(6):
        true = drawn(guess, 50 + seed)
        runs = [recorded(true, 100 * seed + one) for one in range(4)]
        found = ground.fit(guess, runs, free=list(KNOWN), prior={name: "30%" for name in KNOWN})
        circle = found.predict(recorded(true, 7, 30.0, turn=0.4), horizon=np.inf, band=0.9)
        held = (circle.measured >= circle.low) & (circle.measured <= circle.high)
        inside.append(held[:, :3].mean())
    assert np.mean(inside) >= 0.8, inside


def test_an_effect_stands_for_its_parameters_which_are_free_then(guess):
    run = recorded(guess, 1)
    found = ground.fit(guess, run, free=["I_z"], prior={"hull_lift": "10%"})
    assert list(found.parameters) == ["I_z", *KNOWN]
    assert all(found.parameters[name].identified for name in KNOWN)


def test_what_is_known_for_certain_stays_and_what_runs_contradict_is_said(guess):
    true = guess.with_values({"X_u": 2.0 * guess["X_u"]})
    run = recorded(true, 2)
    held = ground.fit(guess, run, free=["X_u"], prior={"X_u": 1e-5, "hull_lift.nv": 0.01})
    assert held.parameters["X_u"].value == pytest.approx(guess["X_u"], rel=1e-3)
    assert any("barely determine hull_lift.nv" in told for told in held.remarks)
    moved = ground.fit(guess, run, free=["X_u"], prior={"X_u": "5%"})
    assert moved.parameters["X_u"].value > 1.5 * guess["X_u"]
    assert any("contradict the prior of X_u" in told for told in moved.remarks)


def test_a_known_mass_makes_thrust_and_inertia_known(guess):
    """Motion alone tells ratios; with a mass that is known to 2%, forces are known as well."""
    run = recorded(guess, 3)
    free = ["m", "I_z", "k", "X_u"]
    with pytest.raises(ground.GroundError, match="cannot be free together"):
        ground.fit(guess, run, free=free)
    found = ground.fit(guess, run, free=free, prior={"m": "2%"})
    low, high = found.parameters["m"].ci95
    assert high - low == pytest.approx(4 * 0.02 * guess["m"], rel=0.2)


@pytest.mark.parametrize(
    "prior, said",
    [
        ({"hull": "20%"}, "no such parameter or effect"),
        ({"hull_lift": 0}, "above 0"),
        ({"hull_lift": -1}, "above 0"),
        ({"hull_lift": "much"}, "neither a number nor a share"),
        ({"hull_lift": float("nan")}, "above 0"),
    ],
)
def test_what_cannot_be_known_is_refused(guess, prior, said):
    with pytest.raises(ground.GroundError, match=said):
        ground.fit(guess, recorded(guess, 4), free=["I_z"], prior=prior)


def test_a_share_of_nothing_is_refused(guess):
    none = guess.with_values({"hull_lift.yv": 0.0})
    with pytest.raises(ground.GroundError, match="its value is 0"):
        ground.fit(none, recorded(guess, 4), free=["I_z"], prior={"hull_lift": "20%"})


def test_an_inertia_that_runs_do_not_bound_has_no_upper_end():
    """A boat that goes straight on does not say how large its inertia may be."""
    ends = []
    for seed in range(4):
        straight = recorded(boat(), seed, 20.0, turn=1e-5)
        ends.append(ground.fit(boat(), straight, free=["I_z", "k"]).parameters["I_z"].ci95[1])
    assert np.inf in ends
    assert all(end == np.inf or end < 1e4 * boat()["I_z"] for end in ends), ends
