"""Predictions: the judge of every answer, the horizon that suits a craft, and prediction bands."""

import dataclasses
import functools

import numpy as np
import pytest

import hidden_cases
from conftest import nominal as hovercraft
from conftest import slow
from ground import _core
from ground.analysis import bands, folds, horizon, judge, window_error, windows
from ground.analysis.horizon import Starts
from ground.analysis.likelihood import Likelihood
from ground.comparing import predict
from ground.poses import repair
from ground.reading.recording import POSE, VELOCITY

MATTERS = np.array([1.0, 0.5])  # [mm], [deg]


def predicted(seed, sizes, count=40, alike=0.9, loudness=0.3):
    """What hypotheses predict of four runs, each off by its own size [mm], heading by half of it [deg]. Most
    of an error is the same for all, the errors of a run are of one loudness, and neighbours are alike."""
    random = np.random.default_rng(seed)
    part_of = np.repeat(np.arange(4), count // 4)
    loud = np.exp(loudness * random.normal(size=4))[part_of]

    def slow():
        white = random.normal(size=(count + 1, 2))
        return (white[1:] + white[:-1]) / np.sqrt(2)

    common, found = slow(), []
    for size in sizes:
        own = np.sqrt(alike) * common + np.sqrt(1 - alike) * slow()
        poses = np.abs(own) * loud[:, None] * np.array([size, 0.5 * size])
        found.append(judge.Tested(poses, part_of))
    return found


def verdicts(sizes, draws=600, **how):
    """Share of each verdict over draws of what two hypotheses predict."""
    found = [judge.compared(*predicted(seed, sizes, **how), MATTERS).verdict for seed in range(draws)]
    return {name: found.count(name) / draws for name in ("better", "undecided", "worse")}


@pytest.mark.parametrize("alike, loudness", [(0.9, 0.3), (0.0, 1.0)])
def test_hypotheses_that_predict_the_same_are_seldom_told_apart(alike, loudness):
    shares = verdicts((0.5, 0.5), alike=alike, loudness=loudness)  # below what matters
    assert shares["better"] < 0.05 and shares["worse"] < 0.05


def test_what_predicts_better_is_proved_and_what_predicts_worse_vetoed():
    better, worse = verdicts((0.3, 1.0)), verdicts((1.0, 0.3))
    assert better["better"] > 0.99 and better["worse"] == 0
    assert worse["worse"] > 0.99 and worse["better"] == 0


def test_two_hypotheses_may_change_places():
    for seed in range(50):
        first, second = predicted(seed, (0.8, 1.0))
        there, back = judge.compared(first, second, 10 * MATTERS), judge.compared(second, first, 10 * MATTERS)
        assert {there.verdict, back.verdict} in ({"better", "worse"}, {"undecided"})


def test_a_rise_that_matters_is_vetoed_before_it_is_certain():
    shares = verdicts((8.0, 7.0), alike=0.5)
    small = verdicts((0.08, 0.07), alike=0.5)
    assert shares["worse"] > 1.3 * small["worse"]


def test_one_run_alone_proves_nothing():
    """In one of four runs the error falls to nothing; in the others nothing changes."""
    (found,) = predicted(1, (1.0,))
    gone = found.poses.copy()
    gone[found.part_of == 2] = 0.0
    assert judge.compared(judge.Tested(gone, found.part_of), found, MATTERS).verdict == "undecided"


def test_likelier_innovations_prove_and_do_not_outvote_a_veto():
    random = np.random.default_rng(3)
    likelier = tuple(2.0 + random.normal(size=10) for _ in range(4))
    nothing = tuple(np.zeros(10) for _ in range(4))
    same, other = predicted(1, (1.0, 1.0))
    worse, small = predicted(1, (4.0, 1.0))

    def with_blocks(tested, blocks):
        return judge.Tested(tested.poses, tested.part_of, blocks)

    assert judge.compared(with_blocks(same, likelier), with_blocks(other, nothing), MATTERS).is_better
    assert judge.compared(with_blocks(worse, likelier), with_blocks(small, nothing), MATTERS).is_worse


@pytest.mark.filterwarnings("error")
def test_a_motion_that_is_not_finite_never_wins():
    found, other = predicted(1, (1.0, 1.0))
    never = judge.Tested(np.full_like(found.poses, np.inf), found.part_of)
    assert judge.compared(never, found, MATTERS).is_worse and judge.compared(found, never, MATTERS).is_better
    for matters in (MATTERS, np.full(2, np.inf)):
        assert not judge.compared(never, never, matters).is_better
    short = judge.Tested(np.empty((0, 2)), np.empty(0, int))
    assert judge.compared(short, short, MATTERS).verdict == "undecided"


# --- the horizon that suits a craft


FREE_FLYER = """
schema: ground/model/1
body:
  m: 16
  I_z: 0.18
  X_u: 0.01
  Y_v: 0.01
  N_r: 0.0005
  k: 0.4
  thrusters:
    - {name: ahead, position: [0, 0], direction: 0, range: [-1, 1]}
    - {name: aside, position: [0, 0], direction: 90, range: [-1, 1]}
    - {name: left, position: [0, -0.11], direction: 0, range: [-0.25, 0.25]}
    - {name: right, position: [0, 0.11], direction: 0, range: [-0.25, 0.25]}
"""


def free_flyer():
    return _core.parse_model(FREE_FLYER, "free_flyer")


@functools.lru_cache(maxsize=None)
def run_of(craft=hovercraft, duration=8.0, force=0.0, noise=(3e-4, 3e-4, 5e-3), rate=100, seed=1):
    """A run in which all thrusters act at random and a constant force pushes ahead."""
    model, random = craft(), np.random.default_rng(seed)
    ranges = [(0.0, 1.0)] * 2 if model.is_pair else [t["range"] for t in model.thrusters]
    count = int(duration * 4)
    levels = np.column_stack([random.uniform(*ends, size=count) for ends in ranges])
    inputs = np.column_stack([np.arange(count) / 4, levels, np.ones(count)])
    times = np.arange(int(duration * rate)) / rate
    wrench = np.tile([force, 0.0, 0.0], (len(times), 1))
    eta = _core.simulate(model, inputs, times, np.zeros(3), np.zeros(3), [0.0], wrench)["eta"]
    poses = eta + random.normal(size=eta.shape) * noise
    found = repair.smooth(times, poses, (noise[0], noise[2]), _core.RunScales())
    return _core.RunData("run", times, found["eta"], found["nu"], inputs, poses, np.array(noise))


def test_the_horizon_suits_the_craft():
    assert horizon.horizon([run_of()], hovercraft()) == 1.0
    assert horizon.horizon([run_of(free_flyer, duration=60.0)], free_flyer()) == 10.0


def test_the_horizon_suits_the_runs():
    short = horizon.horizon([run_of(free_flyer, duration=8.0)], free_flyer())
    assert 1.0 <= short < 10.0 and len(horizon.starts([run_of(free_flyer, duration=8.0)], short)) >= 4
    assert horizon.horizon([run_of(duration=60.0, rate=11, noise=(1e-3, 1e-3, 1e-2))], hovercraft()) >= 0.9


def test_predictions_after_a_gap_begin_at_different_times():
    whole = run_of(duration=40.0)
    times = np.array(whole.times)
    seen = (times < 7.3) | (times > 8.1)
    run = _core.RunData(
        "run", *(np.array(rows)[seen] for rows in (times, whole.eta, whole.nu)), np.array(whole.inputs),
        np.array(whole.poses)[seen], np.array(whole.noise),
    )  # fmt: skip
    first = np.array(run.times)[[window.first for window in horizon.starts([run], 1.0)]]
    assert np.diff(first).min() > 0.4 and np.diff(first).max() < 2.0


@pytest.mark.parametrize("rate", [30.0, 100.0, 150.3])
def test_predictions_of_a_run_without_gaps_follow_each_other(rate):
    run = run_of(duration=30.0, rate=rate)
    times = np.array(run.times)
    times = times + 1e-3 * np.random.default_rng(0).uniform(-1, 1, len(times))
    run = _core.RunData(
        "run", times, np.array(run.eta), np.array(run.nu), np.array(run.inputs), np.array(run.poses),
        np.array(run.noise),
    )  # fmt: skip
    shown = predict.Shape.of(run, 1.0, hovercraft())
    assert np.diff(shown.times).min() > 0
    assert np.diff(shown.times).max() < 0.2 and shown.times[-1] > times[-1] - 1.5


def test_what_the_mocap_leaves_is_what_the_true_model_leaves():
    """On recordings of the true model; the wrong one is off by more, and so are predictions under a push."""
    runs, model, seconds = [run_of(duration=60.0, noise=(3e-4, 3e-4, 5e-3))], hovercraft(), 1.0
    wrong = model.copy()
    wrong.set_value("k", 1.2 * model.value("k"))
    models = {"true": horizon.same(model), "wrong": horizon.same(wrong)}
    found = horizon.prediction_error(runs, seconds, models, model)
    assert found.errors["true"].position_mm == pytest.approx(found.mocap.position_mm, rel=0.4)
    assert found.errors["true"].heading_deg == pytest.approx(found.mocap.heading_deg, rel=0.4)
    assert found.errors["wrong"].position_mm > 5 * found.mocap.position_mm and found.disturbed is None


def test_runs_that_are_too_short_have_no_prediction_error():
    run = run_of(duration=1.0)
    assert horizon.prediction_error([run], 5.0, {"a": horizon.same(hovercraft())}, hovercraft()) is None


# --- prediction bands


SEEDS = range(6)


def fitted(seed):
    """Fitted and other runs of a disturbed craft, and the fit."""
    case = hidden_cases.make("disturbed_null", seed)
    runs, others = hidden_cases.record(case)
    model = hidden_cases.given_model(case)
    return runs, others, Likelihood(runs, model).fit(model, window_error.NOMINAL)


@pytest.fixture(scope="module")
def cases():
    return [fitted(seed) for seed in SEEDS]


def shares(found):
    """Coverage by horizon and channel."""
    return {(row.horizon, row.channel): row.coverage for row in bands.coverage(found)}


def of_folds(case):
    runs, _, fit = case
    split = folds.Folds(runs, Likelihood(runs, fit.model), windows.cut(runs), Starts.of(runs, 1.0))
    return bands.of_folds(split, fit)


@slow
def test_held_out_runs_are_covered(cases):
    found = [band for case in cases for band in of_folds(case)]
    share = shares(found)
    assert set(share) == {(h, c) for h in (0.5, 1.5, 4.0) for c in (*POSE, *VELOCITY)}
    for ahead in (1.5 * part for part in bands.HORIZONS):
        poses = [share[ahead, channel] for channel in POSE]
        assert 0.84 < np.mean(poses) < 0.96, ahead
        assert all(0.75 < share[ahead, channel] for channel in (*POSE, *VELOCITY)), share


def test_without_the_disturbance_nothing_is_covered(cases):
    found, calm = [], []
    for _, others, fit in cases:
        levels = {
            name: 1e-6 * value if name.split("_")[0] in ("sigma", "white") else value
            for name, value in fit.levels.items()
        }
        found += bands.of_others(others, fit, 160)
        calm += bands.of_others(others, dataclasses.replace(fit, levels=levels), 160)
    share, without = shares(found), shares(calm)
    for ahead in (1.5 * part for part in bands.HORIZONS):
        poses = [(ahead, channel) for channel in POSE]
        assert np.mean([without[p] for p in poses]) < np.mean([share[p] for p in poses]) - 0.25
    assert np.mean([share[p] for p in share]) > 0.8


def test_a_single_run_is_predicted_by_its_other_quarters(cases):
    runs, _, fit = cases[0]
    alone = runs[:1]
    near = dataclasses.replace(fit, loudness=())
    fit = Likelihood(alone, fit.model).fit(fit.model, fit.free, near=near)
    whole = Likelihood(alone, fit.model)
    split = folds.Folds(alone, whole, windows.cut(alone), Starts.of(alone, 1.0))
    (found,) = bands.of_folds(split, fit)
    starts = [p.times[0] for p in found.predictions]
    assert starts == sorted(starts) and len(set(starts)) == len(starts)
    assert starts[0] < alone[0].times[0] + 1 and starts[-1] > alone[0].times[-1] - 2
