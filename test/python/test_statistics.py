"""Statistics behind the analysis, against plain references and scipy.stats."""
import types

import numpy as np
import pytest
from conftest import MODEL, simulate_run
from scipy import stats

from ground import _core
from ground.analysis import (
    bands,
    candidates,
    distributions,
    held_out,
    look_alikes,
    pushes,
    score_tests,
    stages,
    study,
    trials,
    validation,
)
from ground.errors import GroundError
from ground.recordings import repair, windows


def model():
    return _core.load_model(str(MODEL))


def run_data(duration=6.0, seed=1, noise=1.0):
    times, eta, inputs = simulate_run(duration=duration, seed=seed, noise=noise)
    eta[:, 2] = np.unwrap(eta[:, 2])
    level = np.array([3e-4, 3e-4, 5e-3])
    nu = repair.smooth(times, eta, (level[0], level[2]))["nu"]
    return _core.RunData("run%d" % seed, times, eta, nu, inputs, eta, level)


# --- distributions


@pytest.mark.parametrize("freedom", [1, 2, 7])
def test_tails_are_those_of_scipy(freedom):
    for value in (0.1, 1.0, 6.6, 30.0):
        assert distributions.chi_squared_above(value, freedom) == pytest.approx(
            stats.chi2.sf(value, freedom)
        )
    assert distributions.chi_squared_above(0.0, freedom) == 1.0
    assert distributions.chi_squared_above(-3.0, freedom) == 1.0
    for chance in (1e-5, 0.01, 0.3):
        limit = distributions.chi_squared_limit(chance, freedom)
        assert distributions.chi_squared_above(limit, freedom) == pytest.approx(chance)
        assert distributions.student_limit(chance, freedom) == pytest.approx(
            stats.t.isf(chance, freedom)
        )


def test_heads_are_binomial():
    for tosses in (1, 3, 6):
        found = [distributions.heads(count, tosses) for count in range(tosses + 1)]
        assert found == pytest.approx(stats.binom.pmf(range(tosses + 1), tosses, 0.5))


def test_the_mean_is_tested_as_by_scipy():
    random = np.random.default_rng(1)
    for shift in (-0.5, 0.0, 0.7):
        values = random.normal(shift, 1, 12)
        expected = stats.ttest_1samp(values, 0, alternative="greater").pvalue
        assert distributions.mean_not_above_zero(values) == pytest.approx(expected)
    assert distributions.mean_not_above_zero(np.array([3.0])) == 1.0
    assert distributions.mean_not_above_zero(np.full(4, 3.0)) == 1.0
    assert 0 < distributions.mean_not_above_zero(np.array([3.0, 2.0])) < 0.5


# --- effects on trial


def test_p_values_are_those_of_the_mixture():
    assert trials.p_value(5.0, 2, 0) == pytest.approx(stats.chi2.sf(5.0, 2))
    assert trials.p_value(5.0, 1, 1) == pytest.approx(0.5 * stats.chi2.sf(5.0, 1))
    both = 0.5 * stats.chi2.sf(5.0, 1) + 0.25 * stats.chi2.sf(5.0, 2)
    assert trials.p_value(5.0, 2, 2) == pytest.approx(both)
    one = 0.5 * stats.chi2.sf(5.0, 1) + 0.5 * stats.chi2.sf(5.0, 2)
    assert trials.p_value(5.0, 2, 1) == pytest.approx(one)
    assert trials.p_value(0.0, 2, 1) == 1.0 and trials.p_value(-1.0, 2, 0) == 1.0
    # A simulated parameter that cannot be negative: its ratio is above a value as often.
    draws = np.maximum(np.random.default_rng(1).normal(size=200000), 0) ** 2
    assert trials.p_value(2.0, 1, 1) == pytest.approx((draws >= 2.0).mean(), rel=0.03)


def trial(name, gain=10.0, refitted=True, tried=20, samples=1000):
    extended = candidates.of_library(name).add(model())
    return trials.trial(name, extended, (), gain, True, refitted, tried, samples)


def test_a_trial_counts_parameters_and_effects_tried():
    found = trial("quadratic_drag", 10.0)
    described = candidates.parameters_of(found.model, "quadratic_drag")
    free, on_bound = len(described), sum(p["neutral"] in (p["lower"], p["upper"]) for p in described)
    assert found.delta_bic == pytest.approx(free * np.log(1000) - 10.0)
    assert found.p_value == pytest.approx(trials.p_value(10.0, free, on_bound))
    assert found.chance == pytest.approx(min(1, 20 * found.p_value))
    assert trial("quadratic_drag", 0.1).chance == 1.0


def test_trials_are_ranked_by_evidence_and_weighed_by_likelihood():
    names = ["quadratic_drag", "yaw_bias", "coulomb_friction", "momentum_drag"]
    given = [trial(name, gain) for name, gain in zip(names, (30.0, 10.0, 20.0, 5.0))]
    values = {"quadratic_drag": 4.0, "yaw_bias": 10.0, "coulomb_friction": 8.0}
    found = trials.ranked(given, ["yaw_bias", "coulomb_friction"], values)
    assert found[0].name == "yaw_bias"  # the first of its group
    rest = [t.delta_bic for t in found[1:]]
    assert rest == sorted(rest)
    assert {t.name for t in found if t.equal} == {"yaw_bias", "coulomb_friction"}
    weights = {t.name: t.inclusion for t in found}
    assert sum(weights.values()) == pytest.approx(1) and weights["momentum_drag"] == 0
    assert weights["coulomb_friction"] / weights["yaw_bias"] == pytest.approx(np.exp(-1))
    assert weights["quadratic_drag"] / weights["yaw_bias"] == pytest.approx(np.exp(-3))
    worse = trials.ranked(given, [], {"yaw_bias": -20.0})
    assert [t.name for t in worse] == [t.name for t in sorted(given, key=lambda t: t.delta_bic)]
    assert all(t.inclusion == 0 or t.name == "yaw_bias" for t in worse)


# --- held-out data


def judged(*parts, errors=()):
    """Made-up errors of windows and log-likelihoods of blocks, in parts that were held out."""
    errors = errors or [np.zeros(len(part)) for part in parts]
    part_of = np.repeat(np.arange(len(errors)), [len(part) for part in errors])
    blocks = tuple(np.array(part, float) for part in parts)
    return held_out.Tested(np.concatenate(errors), part_of, blocks)


def test_the_gain_on_held_out_blocks_has_the_error_of_their_sum():
    better, worse = judged([3, 5, 4], [2, 8]), judged([1, 4, 4], [1, 3])
    rises = np.array([2, 1, 0, 1, 5])
    found = held_out.compared(better, worse)
    assert found.verdict == held_out.BETTER
    assert found.gain == 9 and found.gain_error == pytest.approx(rises.std(ddof=1) * np.sqrt(5))
    back = held_out.compared(worse, better)
    assert back.gain == -9 and back.gain_error == pytest.approx(found.gain_error)
    assert held_out.share_raised(better, worse) == 1.0
    assert held_out.share_raised(judged([1], [2], [3], [4]), judged([2], [1], [3], [0])) == 0.5
    diverges = judged([-np.inf], [1.0])
    assert held_out.compared(better, diverges).verdict == held_out.BETTER
    assert held_out.compared(diverges, better).verdict == held_out.WORSE
    assert held_out.compared(diverges, diverges).verdict == held_out.WORSE


def part_of_run(mean, count=8, seed=1, scale=1.0):
    """Made-up differences in the blocks or windows of a run."""
    scattered = scale * np.random.default_rng(seed).normal(size=count)
    return mean + scattered - scattered.mean()


@pytest.mark.parametrize(
    "means, verdict",
    [
        ((3.0, 3.0), "better"),
        ((0.05, -0.05), "undecided"),
        ((4.0, -3.0), "undecided"),  # one of two runs got worse
        ((-4.0, 3.0), "undecided"),
        ((-3.0, -4.0), "worse"),
        ((-3.0, -4.0, -2.0, -3.0), "worse"),
        ((-3.0, 2.0, -4.0, 3.0), "undecided"),
        ((-3.0,), "worse"),
        ((-0.1,), "undecided"),
    ],
)  # fmt: skip
def test_held_out_data_refute_what_makes_them_significantly_worse(means, verdict):
    rises = [part_of_run(mean, seed=i) for i, mean in enumerate(means)]
    zeros = [np.zeros(8)] * len(means)
    likelier = held_out.compared(judged(*rises), judged(*zeros))
    assert likelier.verdict == verdict
    if verdict != "better":
        errors = [0.01 * -rise for rise in rises]
        gained = [part_of_run(0.0, seed=9, scale=1e-3)] * len(means)
        closer = held_out.compared(judged(*gained, errors=errors), judged(*zeros))
        assert (closer.verdict == "worse") == (verdict == "worse")



def test_quarters_of_a_run_hold_all_of_it_once():
    run = run_data(4.0)
    parts = held_out.quarters(run)
    assert len(parts) == 4 and all(len(part) == 1 for part in parts)
    lengths = [len(part.times) for (part,) in parts]
    assert max(lengths) - min(lengths) <= 1
    for name in ("times", "eta", "nu", "poses"):
        joined = np.concatenate([np.array(getattr(part, name)) for (part,) in parts])
        assert np.array_equal(joined, np.array(getattr(run, name))), name
    assert all(np.array_equal(np.array(p.inputs), np.array(run.inputs)) for (p,) in parts)


def test_windows_belong_to_the_folds_of_their_runs():
    for count in (2, 3):
        folds = held_out.Folds.__new__(held_out.Folds)
        folds.runs, folds.count = ["run"] * count, count
        assert [folds._fold_of(_core.Window(i, 0, 9)) for i in range(count)] == list(range(count))


def test_a_motion_that_is_not_finite_has_an_infinite_error(monkeypatch):
    """The other folds keep theirs; a fold without windows has none."""
    folds = held_out.Folds.__new__(held_out.Folds)
    folds.runs, folds.whole, folds.cut = [], None, [_core.Window(i % 2, 0, 9) for i in range(4)]
    folds.fold_of = np.array([0, 1, 0, 1])

    def errors(runs, chosen, whole, fit):
        assert {w.run for w in chosen} == {fit}
        if fit == 1:
            raise GroundError("not finite")
        return np.full((len(chosen), 3), 0.5)

    monkeypatch.setattr(study, "calibrated_errors", errors)
    assert folds._errors([0, 1, 2]).tolist() == [[0.5] * 3, [np.inf] * 3] * 2


# --- windows of runs


def test_errors_are_means_over_samples():
    run, craft = run_data(6.0, noise=0), model()
    wrong = craft.copy()
    wrong.set_value("k", 1.2 * craft.value("k"))
    cut = windows.cut([run])
    problem = windows.problem([run], cut)
    found = study.window_errors([run], cut, wrong)
    for window, nu, row in zip(cut, problem.simulate(wrong)["nu"], found):
        measured = np.array(run.nu)[window.first : window.last + 1]
        assert np.allclose(row, (np.abs(nu - measured) / problem.sigma(0)).mean(axis=0))
    samples = np.array([w.last - w.first + 1 for w in cut])
    by_channel = study.channel_errors([run], cut, wrong)
    assert np.allclose(by_channel, (found * samples[:, None]).sum(axis=0) / samples.sum())
    # Relative to a run that varies twice as much, errors are half as large.
    wide = _core.RunData("w", run.times, run.eta, 2 * np.array(run.nu), run.inputs, run.poses, run.noise)
    assert np.allclose(study.window_errors([run], cut, wrong, truth=[wide]), found / 2)


def test_a_trimmed_model_has_the_constants_of_the_run():
    craft = model()
    constant = np.array([0.002, -0.003, 1e-4, 0.1])
    once = study.trimmed(craft, constant)
    assert once.value("k") == pytest.approx(1.1 * craft.value("k"))
    names = ("body_force_bias.x0", "body_force_bias.y0", "yaw_bias.n0")
    assert [once.value(n) for n in names] == pytest.approx(constant[:3])
    twice = study.trimmed(once, constant)
    assert [twice.value(n) for n in names] == pytest.approx(2 * constant[:3])
    assert craft.effects == model().effects and craft.value("k") == model().value("k")
    assert study.trimmed(craft, np.zeros(4)).value("k") == craft.value("k")


def test_free_parameters_are_the_nominal_ones_and_those_of_effects():
    craft = model()
    assert set(study.free_parameters(craft)) == {"I_z", "X_u", "Y_v", "N_r", "k"}
    extended = candidates.of_library("quadratic_drag").add(craft)
    own = {p["name"] for p in candidates.parameters_of(extended, "quadratic_drag")}
    assert own and set(study.free_parameters(extended)) == {"I_z", "X_u", "Y_v", "N_r", "k"} | own


def test_parts_of_a_study_are_runs_or_quarters():
    alone = study.Study([run_data(9.0)], threads=1)
    assert sorted(set(alone.part_of)) == [0, 1, 2, 3] and (np.diff(alone.part_of) >= 0).all()
    several = study.Study([run_data(4.0, seed=s) for s in range(1, 11)], threads=1)
    assert [p for p, w in zip(several.part_of, several.windows)] == [w.run % 8 for w in several.windows]
    few = study.Study([run_data(9.0), run_data(9.0, seed=2)], threads=1, most=4)
    assert len(few.windows) == 4 < few.available
    with pytest.raises(Exception, match="too short to hold a part of it out; at least two"):
        study.Study([run_data(2.0)], threads=1)


def test_an_artificial_recording_has_the_noise_and_the_motion_of_the_model():
    run, craft = run_data(6.0, noise=0), model()
    found = study.recorded(run, craft, np.random.default_rng(1))
    first = np.array(run.eta)[0], np.array(run.nu)[0]
    true = _core.simulate(craft, np.array(run.inputs), np.array(run.times), *first)["eta"]
    off = np.array(found.poses) - true
    assert np.allclose(off.std(axis=0), np.array(run.noise), rtol=0.15)
    pushed = study.recorded(
        run, craft, np.random.default_rng(1), np.tile([0.01, 0, 0], (len(run.times), 1)), 0.1
    )
    assert np.abs(np.array(pushed.poses) - np.array(found.poses))[:, :2].max() > 0.05
    assert np.array_equal(np.array(found.times), np.array(run.times))
    floor = study.noise_floor([run], craft)
    assert (floor > 0).all() and (floor < 0.2).all()
    assert np.array_equal(floor, study.noise_floor([run], craft, 1))
    assert not np.array_equal(floor, study.noise_floor([run], craft, 2))


# --- blocks that are held out


def test_blocks_last_six_seconds(monkeypatch):
    monkeypatch.setattr(windows, "error", lambda runs, craft, cut: 1.0)
    for duration, blocks in ((13.0, 2), (20.0, 3)):
        found = validation.leave_blocks_out(
            [run_data(duration)], [], lambda cut, initial: {"model": None, "initial": [None] * len(cut)}
        )
        assert found["blocks"] == blocks and found["heldout"] == 1.0


def test_blocks_divide_each_run_evenly():
    runs = [run_data(12.0), run_data(7.0, seed=2)]
    blocks = validation._blocks(runs, 6.0, 1.5)
    assert [tested[0].run for _, tested in blocks] == [0, 0, 1]
    for _, tested in blocks:
        assert all(b.first >= a.last for a, b in zip(tested, tested[1:]))
    assert blocks[0][1][0].first == blocks[2][1][0].first == 0  # nothing is left out
    first, second = blocks[0][1], blocks[1][1]
    middle = np.array(runs[0].times)[second[0].first]
    assert middle == pytest.approx(6.0, abs=0.05) and first[-1].last <= second[0].first
    assert len(validation._blocks(runs, 1e9, 1.5)) == 2


def test_each_fold_is_fitted_without_its_windows():
    seen = []

    def fit(cut, initial):
        seen.append((list(cut), list(initial)))
        return {"model": len(seen)}

    from ground.progress import Work

    found = validation._refits([10, 11, 12, 13], [0, 1, 0, 2], fit, "abcd", Work())
    assert found == {0: {"model": 1}, 1: {"model": 2}, 2: {"model": 3}}
    assert seen == [
        ([11, 13], ["b", "d"]),
        ([10, 12, 13], ["a", "c", "d"]),
        ([10, 11, 12], ["a", "b", "c"]),
    ]


def test_runs_are_held_out_alone_or_every_so_many_th_together():
    runs = [run_data(4.0, seed=s) for s in (1, 2, 3)]
    asked = []

    def fit(cut, initial):
        asked.append({w.run for w in cut})
        return {"model": model()}

    whole = {"initial": [None] * len(windows.cut(runs))}
    found = validation.leave_runs_out(runs, fit, whole)
    assert asked == [{1, 2}, {0, 2}, {0, 1}]
    assert [error for _, error in found] == pytest.approx([windows.error([r], model()) for r in runs])
    asked.clear()
    validation.leave_runs_out(runs, fit, whole, most=2)
    assert asked == [{1}, {0, 2}]


def fit_of(**values):
    parameters = [
        dict(name=name, value=value, deviation=deviation, identified=identified)
        for name, (value, deviation, identified) in values.items()
    ]
    return {"parameters": parameters}


def test_disagreements_are_counted_in_deviations_of_both():
    one = fit_of(a=(1.0, 0.3, True), b=(1.0, 0.3, True), c=(1.0, 0.1, False), d=(5.0, 0.3, True))
    other = fit_of(a=(2.5, 0.4, True), b=(2.49, 0.4, True), c=(9.0, 0.1, True), d=(9.0, 0.4, False))
    assert validation.disagreements(one, other) == []  # 3.0 deviations are not more than 3
    assert validation.disagreements(one, other, 2.99) == ["a"]
    assert validation.disagreements(other, one, 2.9) == ["a", "b"]


# --- bands


def prediction(begin, end, inside=True, step=0.01):
    times = np.arange(begin, end + 1e-9, step)
    wide = np.ones((len(times), 6)) * (1 + times - begin)[:, None]
    measured = 0 * wide if inside else 2 * wide
    return bands.Prediction(times, 0 * wide, wide, -wide, wide, measured)


def test_a_prediction_is_read_at_a_horizon():
    one = prediction(2.0, 3.0)
    assert one.sample(0.5) == 50 and one.sample(1.0) == 100
    assert one.sample(1.04) == 100 and one.sample(1.06) is None


def test_predictions_are_tiled_without_overlap():
    run = run_data(6.0)
    many = bands.Bands(
        run, tuple(prediction(b, e) for b, e in ((0, 4), (0.5, 1.0), (1.0, 1.5), (1.5, 5.5), (3, 7)))
    )
    tiles = many.tiled(1.5)
    spans = [(float(t[0]), float(t[-1])) for t, _, _ in tiles]
    assert np.allclose(spans, [(0, 1.5), (1.5, 3), (3, 4.5)], atol=0.011)
    assert all(len(t) == len(low) == len(high) and (low < high).all() for t, low, high in tiles)
    assert all(t[-1] - t[0] <= 1.5 + 1e-9 for t, _, _ in tiles)
    short = [(float(t[0]), float(t[-1])) for t, _, _ in many.tiled(0.5)]
    assert np.allclose(short, [(0, 0.5), (0.5, 1.0), (1.0, 1.5), (1.5, 2.0), (3, 3.5)], atol=0.011)


def test_coverage_is_the_share_of_measurements_inside():
    run = run_data(6.0)
    parts = [[True] * 8 + [False] * 2, [True] * 5 + [False] * 5, [True] * 10]
    many = [bands.Bands(run, tuple(prediction(0.0, 1.6, inside) for inside in p)) for p in parts]
    deviation, held = many[0].at(0.5)
    assert deviation.shape == held.shape == (10, 6)
    assert held.all(axis=1).sum() == 8 and np.allclose(deviation, 1.5)
    rows = bands.coverage(many)
    assert {row["horizon"] for row in rows} == {0.5, 1.5} and len(rows) == 12
    for row in rows:
        assert row["coverage"] == pytest.approx(23 / 30) and row["predictions"] == 30
        assert row["sd"] == pytest.approx(1 + row["horizon"])
        # ratio estimator: by hand
        off = np.array([8, 5, 10]) - 10 * 23 / 30
        half = stats.t.isf(0.025, 2) * np.sqrt(3 / 2 * (off**2).sum()) / 30
        assert row["ci95"] == pytest.approx([max(0, 23 / 30 - half), min(1, 23 / 30 + half)])
    assert [row["unit"] for row in rows[:6]] == ["m", "m", "rad", "m/s", "m/s", "rad/s"]
    alone = bands.coverage(many[:1])
    assert all(row["ci95"] is None and row["coverage"] == 0.8 for row in alone)
    assert bands.coverage([bands.Bands(run, ())]) == []


def test_predictions_start_in_windows_but_not_at_the_first_pose_of_a_stretch():
    times = np.concatenate([np.arange(600) / 100, 6.5 + np.arange(300) / 100])
    cut = [_core.Window(0, 0, 150), _core.Window(0, 150, 300), _core.Window(0, 600, 750)]
    starts, horizons = bands._starts(times, cut)
    assert starts == [50, 100, 150, 200, 250, 650, 700]
    assert horizons == pytest.approx([1.0, 0.5, 4.0, 0.5, 0.5, 1.0, 0.5])
    starts, horizons = bands._starts(times, [_core.Window(0, 601, 751)])
    assert starts == [601, 651, 701] and horizons == pytest.approx([4.0, 0.5, 0.5])
    starts, _ = bands._starts(times, [_core.Window(0, 1, 151)])
    assert starts == [1, 51, 101]


def test_the_expected_loudness_is_that_of_the_other_runs():
    fit = types.SimpleNamespace(loudness=(1.0, 2.0, 6.0, 3.0))
    assert bands._loudness(fit) == 3.0
    assert bands._loudness(fit, 2, 4) == 2.0 and bands._loudness(fit, 0, 2) == 2.5
    assert bands._loudness(types.SimpleNamespace(loudness=())) == 0.0


def of_folds(monkeypatch, runs, count):
    """What bands.of_folds predicts: (run, model, windows, loudness) of each part."""
    cut = windows.cut(runs)
    fold_of = [w.run % count if len(runs) > 1 else i % count for i, w in enumerate(cut)]
    folds = types.SimpleNamespace(
        runs=runs, count=count, cut=cut, fold_of=fold_of, each=map,
        models=lambda fit: ["without %d" % fold for fold in range(count)],
    )  # fmt: skip
    asked = []

    def predict(task):
        asked.append(task)
        starts = [prediction(float(task[0].times[w.first]), 9.0) for w in task[2]]
        return bands.Bands(None, tuple(starts))

    monkeypatch.setattr(bands, "_predict", predict)
    fit = types.SimpleNamespace(loudness=(1.0, 2.0, 6.0)[: len(runs)])
    return bands.of_folds(folds, fit), asked, cut


def test_bands_of_runs_are_by_models_without_them(monkeypatch):
    runs = [run_data(5.0, seed=seed) for seed in (1, 2, 3)]
    for count, loudness in ((3, [4.0, 3.5, 1.5]), (2, [2.0, 3.5, 2.0])):
        found, asked, cut = of_folds(monkeypatch, runs, count)
        assert [one.run for one in found] == runs and len(asked) == 3
        for i, (run, craft, some, loud) in enumerate(asked):
            assert run is runs[i] and craft == "without %d" % (i % count)
            assert some == [w for w in cut if w.run == i] and loud == loudness[i]
    two, asked, _ = of_folds(monkeypatch, runs[:2], 2)
    assert [one.run for one in two] == runs[:2] and [task[3] for task in asked] == [2.0, 1.0]


def test_bands_of_one_run_are_by_models_without_its_parts(monkeypatch):
    run = run_data(9.0)
    (found,), asked, cut = of_folds(monkeypatch, [run], 2)
    assert found.run is run and [task[1] for task in asked] == ["without 0", "without 1"]
    assert [task[2] for task in asked] == [cut[::2], cut[1::2]] and [task[3] for task in asked] == [1.0] * 2
    begins = [float(one.times[0]) for one in found.predictions]
    assert begins == [run.times[w.first] for w in cut]  # the order of the parts


def test_bands_of_other_runs_start_in_windows_of_their_own(monkeypatch):
    runs = [run_data(9.0, seed=seed) for seed in (1, 2)]
    asked = []

    def predict(task):
        asked.append(task)
        return bands.Bands(None, ())

    monkeypatch.setattr(bands, "_predict", predict)
    fit = types.SimpleNamespace(loudness=(1.0, 4.0))
    found = bands.of_others(runs, fit, 4)
    assert [one.run for one in found] == [task[0] for task in asked] == runs
    assert [{w.run for w in task[2]} for task in asked] == [{0}, {1}]
    assert [len(task[2]) for task in asked] == [2, 2]
    assert all(task[1] is fit and task[3] == 2.5 for task in asked)


# --- artificial recordings


def test_a_random_wrench_has_its_levels():
    levels = {"sigma_X": 0.3, "time_X": 0.2, "white_X": 0.0}
    levels.update(sigma_Y=0.0, time_Y=1.0, white_Y=0.05, sigma_N=0.1, time_N=0.05, white_N=0.02)
    levels.update(sigma_room=0.2, time_room=1.5)
    run = types.SimpleNamespace(times=np.arange(40000) / 100)
    drawn = pushes.of_levels(run, levels, np.random.default_rng(1))
    x, y, n = drawn.wrench.T
    assert x.std() == pytest.approx(0.3, rel=0.1)
    for lag in (5, 20):
        alike = np.mean(x[lag:] * x[:-lag]) / np.mean(x**2)
        assert alike == pytest.approx(np.exp(-lag / 100 / 0.2), abs=0.08)
    assert y.std() == pytest.approx(0.05 / np.sqrt(0.01), rel=0.05)
    assert abs(np.mean(y[1:] * y[:-1])) < 0.05 * np.mean(y**2)
    assert n.std() == pytest.approx(np.hypot(0.1, 0.02 * 10), rel=0.05)
    assert drawn.room.std(axis=0) == pytest.approx([0.2, 0.2], rel=0.2)
    late = drawn.room[150:] * drawn.room[:-150]
    assert late.mean() / np.mean(drawn.room**2) == pytest.approx(np.exp(-1), abs=0.12)
    assert abs(np.corrcoef(drawn.room.T)[0, 1]) < 0.2
    again = pushes.of_levels(run, levels, np.random.default_rng(1))
    assert np.array_equal(drawn.wrench, again.wrench) and np.array_equal(drawn.room, again.room)


# --- score tests


def scores_of(A, blocks, scale, neutral_at_bound=()):
    """ScoreTests of two effects, "a" with one parameter and "b" with two, beside two fitted ones."""
    tests = score_tests.ScoreTests.__new__(score_tests.ScoreTests)
    tests.nuisance, tests.nuisance_scale, tests.scale = ["k", "X_u"], scale[:2], scale[2:]
    tests.names, tests.columns = ["a.p", "b.p", "b.q"], {"a": [0], "b": [1, 2]}
    tests.side = np.array([1 if name in neutral_at_bound else 0 for name in tests.names])
    tests._project({"information": A, "score": blocks}, 2)
    return tests


def random_scores(seed=1):
    random = np.random.default_rng(seed)
    root = random.normal(size=(5, 5))
    return root @ root.T + np.eye(5), random.normal(size=(7, 5)), random.uniform(0.5, 2, 5)


def test_a_score_test_is_the_gain_of_the_quadratic_likelihood():
    """To second order the log-likelihood is s'x - x'Ax/2; its largest values with and without the effect
    differ by the gain. Here the score of what was fitted is not zero."""
    A, blocks, scale = random_scores()
    tests, s = scores_of(A, blocks, scale), blocks.sum(axis=0)

    def most(at):
        step = np.linalg.solve(A[np.ix_(at, at)], s[at])
        return s[at] @ step, step

    for names, at in ((["a"], [2]), (["b"], [3, 4]), (["a", "b"], [2, 3, 4])):
        gain, step = tests.test(names)
        whole, best = most([0, 1] + at)
        assert gain == pytest.approx(whole - most([0, 1])[0])
        expected = dict(zip([tests.names[i - 2] for i in at], best[2:] * scale[at]))
        assert step == pytest.approx(expected)
    assert tests.test([]) == (0.0, {})


def test_a_parameter_does_not_step_beyond_its_neutral_bound():
    A, blocks, scale = random_scores()
    free = scores_of(A, blocks, scale)
    for name in ("a", "b"):
        for parameter, step in free.test([name])[1].items():
            for sign in (1, -1):
                bounded = scores_of(A, sign * blocks, scale, (parameter,))
                gain, found = bounded.test([name])
                assert found.get(parameter, 0.0) >= 0
                assert gain <= free.test([name])[0] + 1e-9
                if sign * step >= 0:
                    assert gain == pytest.approx(free.test([name])[0])
    wrong = scores_of(A, blocks * np.sign(-free.score[0]), scale, ("a.p",))
    assert wrong.test(["a"]) == (0.0, {})


def test_an_effect_that_fitted_parameters_imitate_is_hidden():
    A, blocks, scale = random_scores()
    tests = scores_of(A, blocks, scale)
    assert 0 < tests.seen("a") < 1 and not tests.hidden("a")
    inverse = np.linalg.inv(A[np.ix_([0, 1, 2], [0, 1, 2])])
    assert tests.seen("a") == pytest.approx(1 / inverse[2, 2] / A[2, 2])
    copied = np.array(A)
    copied[2], copied[:, 2] = copied[0], copied[:, 0]
    copied[2, 2] = copied[0, 0] * (1 + 1e-4)
    same = scores_of(copied, blocks, scale)
    assert same.seen("a") < 0.003 and same.hidden("a")
    steps = same.in_place("a", 0.5)
    assert steps["a.p"] == pytest.approx(0.5 * scale[2])
    assert steps["k"] == pytest.approx(-0.5 * scale[0], rel=1e-3)
    assert steps["X_u"] == pytest.approx(0, abs=1e-3)
    blind = np.array(A)
    blind[2] = blind[:, 2] = 0
    assert not scores_of(blind, blocks, scale).hidden("a")  # it does nothing at all


def test_singular_equations_have_no_step_where_nothing_is_known():
    matrix = np.diag([4.0, 0.0, 1e-8])
    assert score_tests.solve(matrix, np.array([8.0, 0.0, 1e-8])) == pytest.approx([2, 0, 1])
    assert score_tests.solve(np.zeros((0, 0)), np.zeros((0, 3))).shape == (0, 3)
    random = np.random.default_rng(2)
    root = random.normal(size=(4, 4))
    matrix, right = root @ root.T, random.normal(size=(4, 2))
    assert np.allclose(score_tests.solve(matrix, right), np.linalg.solve(matrix, right))


@pytest.mark.parametrize("information", [0.0, -1e-3, np.inf, np.nan])
def test_directions_without_finite_information_tell_nothing(information):
    matrix = np.array([[4.0, 1.0, 2.0, 3.0], [1.0, 9.0, 3.0, 2.0], [2.0, 3.0, 0, 0], [3.0, 2.0, 0, 0]])
    matrix[2:, 2:] = [[information, 1e200], [1e200, information]]
    right = np.array([6.0, 19.0, 5.0, -4.0])
    expected = [*np.linalg.solve(matrix[:2, :2], right[:2]), 0, 0]
    assert score_tests.solve(matrix, right) == pytest.approx(expected)
    both = score_tests.solve(matrix, np.column_stack([right, 2 * right]))
    assert both == pytest.approx(np.column_stack([expected, 2 * np.array(expected)]))


def test_a_step_stays_in_the_range_of_a_parameter():
    plain = {"name": "c", "neutral": 0.0, "lower": -1.0, "upper": 2.0}
    assert score_tests.moved(plain, 0.5, 0.7) == pytest.approx(1.2)
    assert score_tests.moved(plain, 0.5, 9.0) == 2.0 and score_tests.moved(plain, 0.5, -9.0) == -1.0
    time = {"name": "tau", "neutral": np.inf, "lower": 0.1, "upper": np.inf}
    assert score_tests.moved(time, np.inf, 2.0) == pytest.approx(0.5)
    assert score_tests.moved(time, 0.5, 2.0) == pytest.approx(0.25)
    assert score_tests.moved(time, 4.0, 0.25) == pytest.approx(2.0)
    assert score_tests.moved(time, 2.0, -0.25) == pytest.approx(4.0)
    assert score_tests.moved(time, 0.5, -3.0) == np.inf
    assert score_tests.moved(time, 0.5, 1e6) == 0.1
    inertia = {"name": "I_z", "neutral": 0.0, "lower": 1e-6, "upper": 1.0}
    assert score_tests.moved(inertia, 0.01, 100.0) == pytest.approx(0.005)
    assert score_tests.moved(inertia, 0.01, -200.0) == 0.01
    sides = [(0, 0, 1, 1), (0, -1, 0, -1), (0, -1, 1, 0), (np.inf, 0, np.inf, 1)]
    for neutral, lower, upper, side in sides:
        parameter = {"neutral": neutral, "lower": lower, "upper": upper}
        assert score_tests._side(parameter) == side


def test_a_stepped_model_has_part_of_the_step():
    craft = model()
    moved = score_tests.stepped(craft, {"X_u": 0.01, "k": -0.02}, 0.5)
    assert moved.value("X_u") == pytest.approx(craft.value("X_u") + 0.005)
    assert moved.value("k") == pytest.approx(craft.value("k") - 0.01)
    assert craft.value("k") == model().value("k")


def test_estimates_are_those_of_the_step_with_their_intervals():
    extended = candidates.of_library("body_force_bias").neutral(model())
    described = candidates.parameters_of(extended, "body_force_bias")
    A, blocks, _ = random_scores()
    scale = np.array([1.0, 1.0, 1e-3, 1e-3, 1e-3])
    tests = scores_of(A, blocks, scale)
    tests.names = ["a.p"] + [p["name"] for p in described]
    tests.columns = {"a": [0], "body_force_bias": [1, 2]}
    step = {described[0]["name"]: 0.004, described[1]["name"]: -0.002}
    found = tests.estimates(extended, "body_force_bias", step)
    for i, (one, p) in enumerate(zip(found, described), 1):
        assert (one["name"], one["unit"], one["identified"]) == (p["name"], p["unit"], True)
        assert one["value"] == pytest.approx(step[p["name"]])
        assert one["deviation"] == pytest.approx(1e-3 / np.sqrt(tests.information[i, i]))
        low, high = one["ci95"]
        assert low == pytest.approx(one["value"] - 1.96 * one["deviation"])
        assert high == pytest.approx(one["value"] + 1.96 * one["deviation"])
    A[3], A[:, 3] = A[0], A[:, 0]
    A[3, 3] = A[0, 0] * (1 + 1e-4)
    hidden = scores_of(A, blocks, scale)
    hidden.names, hidden.columns = tests.names, tests.columns
    for one, p in zip(hidden.estimates(extended, "body_force_bias", {}), described):
        assert not one["identified"] and one["ci95"] == (p["lower"], p["upper"])
        assert one["value"] == p["neutral"] and one["deviation"] == np.inf


def test_parameters_that_moved_are_named_the_most_first():
    craft = model()
    other = craft.copy()
    for name, factor in (("k", 1.04), ("X_u", 1.1), ("N_r", 0.5)):
        other.set_value(name, factor * craft.value(name))
    fit = types.SimpleNamespace(model=craft, free=("k", "X_u", "N_r", "Y_v"))
    assert look_alikes._moved(fit, other) == ("N_r", "X_u")


# --- what is expected of a diagnosis


class Expected:
    """A Work that keeps what it was told."""

    def __init__(self):
        self.units, self.seconds, self.added = {}, {}, 0

    def expect(self, what, units, seconds=0.0, at_most=False, scaled=True):
        self.units[what], self.seconds[what] = units, seconds

    def more(self, count, at_most=False):
        self.added += count

    def spent(self, what):
        return 40.0


def test_a_plan_grows_with_the_effects_and_the_samples():
    told = Expected()
    plan = stages.Plan(told, 14000)
    plan.begin()
    assert told.units[stages.FITTING] == told.units[stages.LEAVING] == told.units[stages.ERRORS] == 1
    assert told.seconds[stages.FITTING] == pytest.approx(2 * stages.COSTS[stages.FITTING])
    few = dict(told.units)
    plan.round(10, 3, 1)
    assert told.units[stages.ORDERING] == told.units[stages.RIVALS] == 4 > few[stages.ORDERING]
    assert told.units[stages.TESTING] == 8
    assert told.added == 10 + 3 * 10 + round(1.5 * 4)
    plan.found(0)
    for what in (stages.ORDERING, stages.RIVALS, stages.CHOOSING, stages.REFITTING):
        assert told.units[what] == 0
    assert told.seconds[stages.REPEATING] == 0
    plan.found(2)
    assert told.seconds[stages.REPEATING] == 40.0 and told.units[stages.CHOOSING] > 30
    plan.planned()
    assert told.units[stages.CHOOSING] == told.units[stages.REFITTING] == 0


def test_tests_are_repeated_with_each_effect_that_is_left_out():
    told = Expected()
    plan = stages.Plan(told)
    plan.tested(5, 0)
    assert told.added == 0
    plan.tested(5, 2)  # next four, then three are tested
    assert told.added == 4 + 3
    plan.swaps(4)
    assert told.added == 7 + 6
