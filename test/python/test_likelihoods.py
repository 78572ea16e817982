"""Fits with a random disturbance, held-out parts, bands and experiments, on short simulated runs."""

import dataclasses
import functools

import numpy as np
import pytest

from conftest import nominal as model
from ground import _core
from ground.analysis import (
    bands,
    between_runs,
    folds,
    horizon,
    judge,
    likelihood,
    run_differences,
    window_error,
    windows,
)
from ground.diagnosing import reporting, words
from ground.effect_library import candidates
from ground.poses import repair
from ground.support.errors import Diverged, GroundError, core_error

FREE = window_error.NOMINAL
NOISE = np.array([3e-4, 3e-4, 5e-3])


@functools.lru_cache(maxsize=None)
def run_data(seed=1, duration=8.0, force=(0.0, 0.0), sigma=0.0, effect="", value=0.0, levels=2):
    """A run of a craft with a constant force, a random wrench, and perhaps an effect of one parameter.
    levels: of its thrusters, two: on or off."""
    craft, random = model(), np.random.default_rng(seed)
    if effect:
        name, parameter = effect.split(".")
        craft.add_effect(name)
        craft.set_value(effect, value)
    bits = random.integers(0, levels, (int(duration * 15), 2)) / (levels - 1)
    inputs = np.column_stack([np.arange(len(bits)) / 15, bits, np.ones(len(bits))])
    times = np.arange(int(duration * 100)) / 100
    wrench, slow = np.tile([*force, 0.0], (len(times), 1)), np.zeros(3)
    for i in range(len(times)):
        slow = slow * np.exp(-0.01 / 0.3) + random.normal(size=3) * np.sqrt(1 - np.exp(-0.02 / 0.3))
        wrench[i] += sigma * slow * [1, 1, 0.03]
    eta = _core.simulate(craft, inputs, times, np.zeros(3), np.zeros(3), [0.0], wrench)["eta"]
    eta = eta + random.normal(size=eta.shape) * NOISE
    found = repair.smooth(times, eta, (NOISE[0], NOISE[2]), _core.RunScales())
    return _core.RunData("run%d" % seed, times, found["eta"], found["nu"], inputs, eta, NOISE)


@functools.lru_cache(maxsize=None)
def fitted(seeds=(1, 2, 3), varies=(), **options):
    runs = [run_data(seed, **options) for seed in seeds]
    like = likelihood.Likelihood(runs, model(), varies)
    return runs, like, like.fit(model(), FREE)


def test_the_true_parameters_are_found_within_their_deviations():
    _, like, fit = fitted(sigma=0.004)
    for p in fit.parameters:
        assert p["identified"] and abs(p["value"] - model().value(p["name"])) < 4 * p["deviation"]
        assert fit.model.value(p["name"]) == p["value"]
    wider = {p["name"]: p for p in like.intervals(fit)}
    for p in fit.parameters:
        low, high = wider[p["name"]]["ci95"]
        assert low < p["value"] < high
    assert 0.002 < fit.levels["sigma_X"] < 0.008
    assert fit.levels["position"] == pytest.approx(1, rel=0.2)  # relative to the runs' own noise
    again = like.fit(fit.model, FREE, near=fit)
    assert again.log_posterior == pytest.approx(fit.log_posterior, abs=0.05)


@functools.lru_cache(maxsize=None)
def in_draught(seed, room, time, body=0.0):
    """A run of 8 s under a random force whose direction is fixed in the room, and one fixed in the body [N].

    The thrusters turn the craft whatever the forces are, so that the heading is known beforehand."""
    craft, random = model(), np.random.default_rng(seed)
    bits = random.integers(0, 2, (120, 2))
    inputs = np.column_stack([np.arange(len(bits)) / 15, bits, np.ones(len(bits))])
    times, slow = np.arange(8000) / 1000, random.normal(size=4)
    left = np.exp(-1e-3 / np.array([time, time, 0.3, 0.3]))
    pushes = np.empty((len(times), 4))
    for i in range(len(times)):
        pushes[i] = slow * [room, room, body, body]
        slow = left * slow + np.sqrt(1 - left**2) * random.normal(size=4)
    start = (craft, inputs, times, [0, 0, random.uniform(-3, 3)], np.zeros(3), [0.0])
    motion = _core.simulate(*start)
    psi = np.array(motion["eta"])[:, 2] + 0.5e-3 * np.array(motion["nu"])[:, 2]  # in the middle of a step
    x, y = pushes[:, 0], pushes[:, 1]
    turned = np.column_stack([np.cos(psi) * x + np.sin(psi) * y, np.cos(psi) * y - np.sin(psi) * x])
    wrench = np.column_stack([turned + pushes[:, 2:], np.zeros(len(times))])
    eta = np.array(_core.simulate(*start, wrench)["eta"])
    same = np.array(_core.simulate(*start, np.column_stack([pushes[:, 2:], 0 * x]), pushes[:, :2])["eta"])
    assert np.abs(same - eta).max() < 1e-4  # the core turns it just as well
    times, eta = times[::10], eta[::10] + random.normal(size=(800, 3)) * NOISE
    found = repair.smooth(times, eta, (NOISE[0], NOISE[2]), _core.RunScales())
    return _core.RunData("run%d" % seed, times, found["eta"], found["nu"], inputs, eta, NOISE)


@pytest.mark.parametrize("room, time, body", [(0.0025, 0.5, 0.0), (0.0, 1.0, 0.0025), (0.0025, 0.5, 0.0025)])
def test_random_forces_are_found_in_the_frame_in_which_they_act(room, time, body):
    """At 2% of full thrust."""
    runs = [in_draught(seed, room, time, body) for seed in range(6)]
    fit = likelihood.Likelihood(runs, model(), ()).fit(model(), FREE)
    factor = np.exp(np.mean(fit.loudness))
    levels = {name: factor * fit.levels[name] for name in ("sigma_X", "sigma_Y", "sigma_room")}
    if room:
        assert room / 1.5 < levels["sigma_room"] < 1.5 * room
        assert time / 1.5 < fit.levels["time_room"] < 1.5 * time
    else:
        assert levels["sigma_room"] < 0.2 * body
    for name in ("sigma_X", "sigma_Y"):
        assert body / 1.5 < levels[name] < 1.5 * body if body else levels[name] < 0.6 * room


def test_a_draught_does_not_narrow_the_interval_of_a_tilted_floor():
    """The floor is level. Without a force in the room, the draught was a significant tilt."""
    inside, widest = 0, 0.0
    for first in range(0, 16, 2):
        runs = [in_draught(seed, 0.004, 1.5) for seed in (first, first + 1)]
        like = likelihood.Likelihood(runs, model(), ())
        tilted = candidates.of_library("floor_tilt").neutral(model())
        names = tuple(p.name for p in candidates.parameters_of(tilted, "floor_tilt"))
        found = {p["name"]: p["ci95"] for p in like.intervals(like.fit(tilted, FREE + names))}
        inside += sum(low <= 0 <= high for low, high in (found[name] for name in names))
        widest = max(widest, *(found[name][1] - found[name][0] for name in names))
    assert inside >= 14 and widest < 0.1  # of 16


def test_constants_of_a_run_are_estimated_from_its_poses():
    runs, like, fit = fitted((1, 2), None, force=(0.005, -0.003))
    times, constants = like.constants(fit, 0)
    assert constants.shape == (len(times), 4) and np.array_equal(times, np.array(like.runs[0].times))
    assert constants[-1, :2] == pytest.approx([0.005, -0.003], abs=1.5e-3)
    early, late = (np.abs(constants[at, :2] - [0.005, -0.003]).max() for at in (3, -1))
    assert late < early
    assert fit.trims[0, :2] == pytest.approx([0.005, -0.003], abs=1.5e-3)


BLAST = '{name: blast, expression: {X: "c*u*u*u"}, parameters: {c: {value: 1e9, unit: N s^3/m^3}}}'


def test_a_model_whose_motion_is_not_finite_is_refused_and_never_wins():
    """A log-density of 0 would be better than any honest one, and residuals of 0 would look white."""
    runs, like, fit = fitted(sigma=0.004)
    odd = dataclasses.replace(fit, model=_core.with_effect(fit.model, BLAST, "blast"))
    for use in (
        lambda: like.fit(odd.model, FREE),
        lambda: like.blocks(odd),
        lambda: like.constants(odd, 0),
        lambda: like.intervals(odd),
        lambda: like.scores(odd, odd.model, FREE),
    ):
        with pytest.raises(Diverged, match="not finite"):
            use()
    assert np.isinf(window_error.calibrated_errors(runs, windows.cut(runs), like, odd)).all()
    at = horizon.Starts.of(runs, 1.0)
    judged = folds.tested(runs, at, like, odd)
    assert np.isinf(judged.poses).all() and np.concatenate(judged.likelihood).sum() == -np.inf
    better = judge.compared(folds.tested(runs, at, like, fit), judged, np.ones(2))
    assert better.verdict == "better" and judge.compared(judged, judged, np.ones(2)).verdict == "worse"


def test_an_error_of_the_user_is_not_taken_for_a_motion_that_is_not_finite(monkeypatch):
    runs, like, fit = fitted(sigma=0.004)

    def refuse(*_):
        raise GroundError("the runs have other channels")

    monkeypatch.setattr(window_error, "window_errors", refuse)
    with pytest.raises(GroundError, match="other channels"):
        window_error.calibrated_errors(runs, windows.cut(runs), like, fit)
    for text in ("the model's motion is not finite", "the information is not positive definite"):
        assert isinstance(core_error(RuntimeError(text)), Diverged)
    assert not isinstance(core_error(ValueError("there is no parameter 'q'")), Diverged)


# --- differences between runs


def test_runs_with_other_forces_differ_and_others_do_not():
    like = likelihood.Likelihood(
        [run_data(s, force=(f, 0.0)) for s, f in ((1, 0.01), (2, -0.01), (3, 0.012), (4, -0.008))], model()
    )
    fit = like.fit(model(), FREE)
    found = run_differences.differences(like, fit)
    assert [kind.parameter for kind in found] == ["surge force"] and max(found.values()) < 1e-4
    same = likelihood.Likelihood([run_data(s, force=(0.01, 0.0)) for s in (1, 2, 3)], model())
    assert run_differences.differences(same, same.fit(model(), FREE)) == {}  # a force that all share
    one = likelihood.Likelihood([run_data(1)], model())
    assert run_differences.differences(one, one.fit(model(), FREE)) == {}


# --- held-out parts


def test_an_effect_that_acts_gains_on_held_out_runs():
    value = 0.06
    runs, like, fit = fitted(effect="motor_lag.tau", value=value)
    extended = candidates.of_library("motor_lag").neutral(fit.model)
    with_it = like.fit(extended, FREE + ("motor_lag.tau",), near=fit)
    assert with_it.model.value("motor_lag.tau") == pytest.approx(value, rel=0.2)
    split = folds.Folds(runs, like, windows.cut(runs), horizon.Starts.of(runs, 1.0))
    better, worse = split.judge(with_it), split.judge(fit)
    found = judge.compared(better.tested, worse.tested, np.ones(2))
    assert found.gain > 3 * found.gain_error > 0 and -found.rise > 3 * found.rise_error > 0
    assert better.heldout.sum() < worse.heldout.sum()


# --- bands


@pytest.mark.parametrize("turns", [1, -2])
def test_bands_do_not_depend_on_whole_turns(turns):
    runs, _, fit = fitted()
    run = runs[0]
    poses = np.array(run.poses) + [0, 0, 2 * np.pi * turns]
    turned = _core.RunData("t", run.times, run.eta, run.nu, run.inputs, poses, NOISE)
    plain, other = (bands.of_others([one], fit, 3)[0].predictions for one in (run, turned))
    assert len(plain) == len(other) > 2
    for a, b in zip(plain, other):
        assert np.abs(a.measured - (a.low + a.high) / 2)[:, 2].max() < 1
        assert np.allclose(b.measured - b.low, a.measured - a.low, atol=1e-6)
        assert np.allclose(b.high - b.low, a.high - a.low, atol=1e-6)


# --- Whether runs agree on parameters


def agreed(seeds, values, free):
    """The parameters of a fit to runs whose lag of the thrusters has some values, by name."""
    runs = [run_data(s, sigma=0.004, effect="motor_lag.tau", value=v) for s, v in zip(seeds, values)]
    craft = model()
    craft.add_effect("motor_lag")
    craft.set_value("motor_lag.tau", 0.1)
    like = likelihood.Likelihood(runs, craft, ())
    fit = like.fit(craft, free)
    found = between_runs.widened(like, fit, like.intervals(fit))
    return {p["name"]: p for p in found}, {p["name"]: p for p in like.intervals(fit)}


def test_an_interval_contains_what_runs_differ_by():
    found, before = agreed((1, 2, 3, 4, 5), (0.05, 0.06, 0.12, 0.14, 0.15), ("k", "motor_lag.tau"))
    tau = found["motor_lag.tau"]
    assert tau["runs"] == pytest.approx((0.05, 0.15), abs=0.025)
    low, high = tau["ci95"]
    assert low < 0.08 and high > 0.13 and high - low > 2 * np.ptp(before["motor_lag.tau"]["ci95"])
    assert "runs" not in found["k"] and np.ptp(found["k"]["ci95"]) >= np.ptp(before["k"]["ci95"])
    (reported,) = reporting.parameters([tau]).values()
    assert "; runs differ: " in words.parameter("tau", reported)


def test_runs_that_do_not_tell_a_parameter_do_not_hide_that_others_differ():
    """With thrusters on or off, nothing is known of the curve of thrust."""
    told = [
        run_data(s, sigma=0.002, effect="thrust_curve.p", value=p, levels=5) for s, p in ((1, 1.0), (2, 1.4))
    ]
    craft = model()
    craft.add_effect("thrust_curve")
    ends = []
    for silent in (0, 8):
        runs = told + [run_data(s, sigma=0.002) for s in range(10, 10 + silent)]
        like = likelihood.Likelihood(runs, craft, ())
        fit = like.fit(craft, ("k", "thrust_curve.p"))
        (found,) = (p for p in between_runs.widened(like, fit, like.intervals(fit)) if p["name"] != "k")
        assert found["runs"] == pytest.approx((1.0, 1.4), abs=0.1)
        ends.append(found["ci95"])
    assert np.ptp(ends[1]) > 0.5 * np.ptp(ends[0])


def test_runs_that_agree_are_not_said_to_differ():
    free = (*FREE, "motor_lag.tau")
    differ = 0
    for seed in range(10, 70, 5):
        found, _ = agreed(range(seed, seed + 5), [0.1] * 5, free)
        differ += any("runs" in p for p in found.values())
    assert differ <= 1  # of 12, each with a probability of 1%
