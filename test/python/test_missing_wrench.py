"""Where a model fails: regressions, bins and directions against plain references."""
import dataclasses

import numpy as np
import pytest
from conftest import MODEL, simulate_run

from ground import _core
from ground.analysis import comparison, failure, residuals
from ground.recordings import repair


def model():
    return _core.load_model(str(MODEL))


def run_data(duration=8.0, truth=None, noise=1.0, seed=1, keep=slice(None), nu=(0, 0, 0)):
    """The repaired run of a simulated craft."""
    times, eta, inputs = simulate_run(duration=duration, noise=noise, seed=seed, nu=nu)
    if truth is not None:
        found = _core.simulate(truth, inputs, times, np.zeros(3), np.array(nu, float))
        random = np.random.default_rng(seed)
        eta = found["eta"] + noise * random.normal(0, [3e-4, 3e-4, 5e-3], eta.shape)
    eta[:, 2] = np.unwrap(eta[:, 2])
    times, eta = times[keep], eta[keep]
    levels = 3e-4, 5e-3
    smoothed = repair.smooth(times, eta, levels)
    return _core.RunData(
        "run", times, smoothed["eta"], smoothed["nu"], inputs, eta, np.array([3e-4, 3e-4, 5e-3])
    )


def pushed(force):
    """The model with a constant force X, Y [N]."""
    truth = model()
    truth.add_effect("body_force_bias")
    for name, value in zip(("x0", "y0"), force):
        truth.set_value("body_force_bias." + name, value)
    return truth


# --- shares of variance


def smooth_series(random, count, width):
    series = np.convolve(random.normal(size=count + width), np.ones(width), "valid")
    return series[:count] / series.std()


def test_shares_are_those_of_plain_regressions_on_shifted_series():
    random = np.random.default_rng(1)
    design = np.column_stack([smooth_series(random, 400, 10) for _ in range(3)])
    values = 0.7 * design[:, 0] - 0.3 * design[:, 2] + smooth_series(random, 400, 10) + 5.0
    found = failure.share_explained(design, values)

    def r_squared(series):
        columns = np.column_stack([design, np.ones(len(series))])
        left = series - columns @ np.linalg.lstsq(columns, series, rcond=None)[0]
        return 1 - (left**2).sum() / ((series - series.mean()) ** 2).sum()

    raw = r_squared(values)
    offsets = (np.linspace(0.05, 0.95, 300) * 400).astype(int)
    chance = np.array([r_squared(np.roll(values, shift)) for shift in offsets])
    assert found["raw"] == pytest.approx(raw)
    assert found["share"] == pytest.approx((raw - chance.mean()) / (1 - chance.mean()), rel=1e-6)
    assert found["p"] == pytest.approx((1 + (chance >= raw).sum()) / 301)


def test_shares_have_the_expected_limits():
    random = np.random.default_rng(2)
    column = random.normal(size=300)
    whole = failure.share_explained(column[:, None], 3 - 2 * column)
    assert whole["share"] == pytest.approx(1) and whole["p"] == pytest.approx(1 / 301)
    none = failure.share_explained(column[:, None], random.normal(size=300))
    assert none["share"] < 0.05 and none["p"] > 0.01
    assert failure.share_explained(column[:, None], np.ones(300)) == {"raw": 0, "share": 0, "p": 1}
    # Columns that are constant or repeat others explain nothing more.
    columns = np.column_stack([column, np.ones(300), 2 * column, np.zeros(300)])
    values = column + random.normal(size=300)
    one, many = failure.share_explained(column[:, None], values), failure.share_explained(columns, values)
    assert one == pytest.approx(many)
    assert failure.share_explained(np.ones((300, 1)), values)["share"] == 0


def test_what_is_named_is_large_and_no_chance():
    assert failure.is_named({"share": 0.1, "p": 0.01})
    assert not failure.is_named({"share": 0.099, "p": 0.001})
    assert not failure.is_named({"share": 0.9, "p": 0.0101})
    channel = {"rms": 0.02, "sigma": 0.01, "full_scale": 1.0}
    assert not failure.is_negligible(channel)
    assert failure.is_negligible(dict(channel, sigma=0.03))
    assert failure.is_negligible(dict(channel, full_scale=3.0))
    for share, negligible in ((0.0101, False), (0.0099, True)):
        small = {"rms": 5 * share, "sigma": 0.0, "full_scale": 5.0}
        assert failure.is_negligible(small) == negligible
    against = {"u": {"share": {"share": 0.2}}, "v": {"share": {"share": 0.4}}}
    assert failure.best_variable(against) == ("v", {"share": 0.4})


# --- regressions


def test_a_regression_is_least_squares_with_jackknife_errors():
    random = np.random.default_rng(3)
    design = random.normal(size=(203, 4)) * [1, 2, 0.5, 1]
    values = design @ [1.0, -2.0, 0.5, 0.0] + random.normal(size=203)
    whole, spread, others = failure.regress(design, values)
    assert np.allclose(whole, np.linalg.lstsq(design, values, rcond=None)[0])
    blocks = np.array_split(np.arange(203), 20)
    for left_out, other in zip(blocks, others):
        rest = np.setdiff1d(np.arange(203), left_out)
        assert np.allclose(other, np.linalg.lstsq(design[rest], values[rest], rcond=None)[0])
    assert np.allclose(spread, np.sqrt(19 / 20 * ((others - others.mean(axis=0)) ** 2).sum(axis=0)))
    by_theory = np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    assert (0.5 * by_theory < spread).all() and (spread < 2 * by_theory).all()


def test_a_ridge_keeps_what_the_data_leave_open_at_zero():
    random = np.random.default_rng(4)
    design = random.normal(size=(200, 3))
    design[:, 2] = design[:, 1]
    values = design @ [1.0, 2.0, 2.0]
    plain = failure.regress(design, values, 1e-6)[0]
    assert plain == pytest.approx([1, 2, 2], abs=1e-3)
    normal = design.T @ design
    ridge = 0.1 * np.trace(normal) / 3 * np.eye(3)
    found = failure.regress(design, values, 0.1)[0]
    assert np.allclose(found, np.linalg.solve(normal + ridge, design.T @ values))
    assert np.linalg.norm(found) < np.linalg.norm(plain)


def test_the_stride_leaves_25_samples_a_second():
    for rate, stride in ((100, 4), (200, 8), (120, 5), (90, 4), (110, 4), (60, 2), (25, 1), (10, 1)):
        assert failure.stride_of(np.arange(50) / rate) == stride


# --- variables


def test_variables_are_what_was_measured():
    run, craft = run_data(), model()
    found = failure.variables(run, craft)
    nu, eta = np.array(run.nu), np.array(run.eta)
    for name, values in (
        ("speed", np.hypot(nu[:, 0], nu[:, 1])), ("u", nu[:, 0]), ("v", nu[:, 1]), ("r", nu[:, 2]),
        ("x", eta[:, 0]), ("y", eta[:, 1]), ("time", np.array(run.times)),
        ("heading", np.degrees(repair.wrap(eta[:, 2]))),
    ):  # fmt: skip
        variable = found[name]
        used = variable.index >= 0
        assert used.mean() > 0.9 and (np.diff(variable.centres) > 0).all(), name
        for i, centre in enumerate(variable.centres):
            inside = variable.index == i
            assert inside.mean() >= 0.01, name
            assert centre == pytest.approx(np.median(values[inside])), name
        # Bins do not overlap.
        tops = [values[variable.index == i].max() for i in range(len(variable.centres))]
        bottoms = [values[variable.index == i].min() for i in range(len(variable.centres))]
        assert all(a <= b for a, b in zip(tops, bottoms[1:])), name
    assert np.allclose(found["u"].indicators().sum(axis=1), found["u"].index >= 0)


def test_inputs_have_a_bin_for_each_level():
    run, craft = run_data(), model()
    found = failure.variables(run, craft)
    left, right, _ = (residuals.held(run, np.array(run.times)) / craft.input_max).T
    for name, values in (("u_L", left), ("u_R", right), ("u_L+u_R", left + right), ("u_L-u_R", left - right)):
        variable = found[name]
        assert np.allclose(np.array(variable.centres)[variable.index], values)
        assert variable.centres == sorted(set(variable.centres))


def test_the_map_has_cells_of_equal_size():
    run, craft = run_data(), model()
    place = failure.variables(run, craft)["position"]
    eta = np.array(run.eta)
    half = np.ptp(eta[:, :2], axis=0) / 5 / 2
    for i, centre in enumerate(place.centres):
        inside = eta[place.index == i, :2]
        assert len(inside) >= 0.01 * len(eta)
        assert (np.abs(inside - centre) <= half + 1e-9).all()
    assert len(place.centres) <= 25 and (place.index >= 0).mean() > 0.7


def test_bins_of_equal_size_hold_equally_many():
    times = np.arange(1000) / 100
    found = failure._binned("x", "x", "m", times**2)
    assert len(found.centres) == 10 and (np.bincount(found.index) == 100).all()
    rare = np.append(np.zeros(995), np.full(5, 3.0)) + np.linspace(0, 1e-3, 1000)
    edges = np.array([-1.0, 1.0, 2.0, 4.0])
    found = failure._binned("x", "x", "m", rare, edges)
    assert len(found.centres) == 1 and (found.index == -1).sum() == 5  # less than 1% of the samples


# --- the error


def test_errors_in_bins_are_their_means():
    run, craft = run_data(), model()
    evaluation = comparison.evaluate(run, pushed((0.004, 0.0)))
    found = failure.variables(run, craft)
    result = failure.of_error(evaluation, found)
    size = np.abs(evaluation.residual) / evaluation.sigma
    for name in ("u", "u_L", "position"):
        index = found[name].index[evaluation.index]
        for i in range(len(found[name].centres)):
            inside = index == i
            assert result[name]["samples"][i] == inside.sum()
            for channel, column in zip("uvr", size.T):
                expected = column[inside].mean() if inside.any() else 0
                assert result[name]["error"][channel][i] == pytest.approx(expected)
    assert result["u"]["label"] == found["u"].label and result["u"]["unit"] == "m/s"


# --- the missing wrench


@pytest.mark.parametrize("force", [(0.006, 0.0), (-0.004, 0.003)])
def test_a_constant_force_is_inferred_everywhere(force):
    run = run_data(truth=pushed(force))
    calm = failure.undisturbed(model(), run)
    assert calm.events == [] and calm.run is run
    missing = failure.of_wrench(calm, model(), pushed(force))
    channels = missing.numbers["channels"]
    for channel, true in zip("XY", force):
        one = channels[channel]
        assert one["mean"] == pytest.approx(true, abs=4e-4)
        assert one["rms"] ** 2 == pytest.approx(one["mean"] ** 2 + one["std"] ** 2)
        assert one["sigma"] == pytest.approx(np.median(missing.sigma[:, "XYN".index(channel)]))
        assert one["unit"] == "N"
        if true:
            assert one["accounted"]["share"] > 0.9
            means = np.array(one["against"]["u"]["mean"])
            assert np.allclose(means, true, atol=1.5e-3)
            assert (np.array(one["against"]["u"]["standard_error"]) < 1e-3).all()
            assert np.allclose(one["accounted"]["mean"]["u"], means, atol=1e-3)
    assert channels["N"]["unit"] == "N m" and missing.numbers["disturbances"] == []
    assert np.allclose(missing.heading, np.array(run.eta)[:, 2])
    assert np.allclose(missing.position, np.array(run.eta)[:, :2])
    assert (missing.sigma > 0).all() and missing.wrench.shape == (len(run.times), 3)
    full = 2 * model().value("k") * model().input_max
    assert [channels[c]["full_scale"] for c in "XYN"] == pytest.approx(
        [full, full, full * model().value("l")]
    )


def test_a_push_is_left_out_with_some_time_around_it():
    times, eta, inputs = simulate_run(duration=8.0)
    eta[:, 2] = np.unwrap(eta[:, 2])
    struck = times > 4.0
    eta[struck, :2] += (times[struck] - 4.0)[:, None] * [1.2, -0.8]
    smoothed = repair.smooth(times, eta, (3e-4, 5e-3))
    noise = np.array([3e-4, 3e-4, 5e-3])
    run = _core.RunData("run", times, smoothed["eta"], smoothed["nu"], inputs, eta, noise)
    calm = failure.undisturbed(model(), run)
    ((start, end),) = calm.events
    assert 3.4 < start < 3.75 and 4.25 < end < 4.6  # 0.3 s on both sides
    told = failure.of_wrench(calm, model()).numbers["disturbances"]
    assert told == [{"start": start, "end": end}]
    rest = np.array(calm.run.times)
    assert not ((rest >= start) & (rest <= end)).any() and len(rest) + 100 * (end - start) < 803
    assert np.allclose(np.array(calm.run.poses)[-1], eta[-1])


def rotated(angle, scale=1.0):
    """What thrust_direction takes of a craft whose thrust is turned by an angle [rad] and scaled."""
    random = np.random.default_rng(6)
    count, lags = 400, len(failure.COMMAND_LAGS)
    command = np.repeat(random.integers(0, 3, count // 8 + 2), 8).astype(float)
    totals = np.column_stack([command[i : i + count] for i in range(lags)])
    by_model = np.column_stack([totals[:, 0], 0 * totals[:, 0]])
    true = scale * totals[:, :1] * [np.cos(angle), np.sin(angle)]
    nu = random.normal(size=(count, 3))
    wrench = np.column_stack([true - by_model + 0.02 * random.normal(size=(count, 2)), np.zeros(count)])
    wrench[:, :2] -= 0.3 * nu[:, :2]  # damping that the model does not have
    responses = np.repeat(totals[:, None, :], 3, axis=1)
    return wrench, responses, by_model, totals, nu


@pytest.mark.parametrize("degrees,differ", [(0, False), (20, False), (-25, False), (40, True), (-120, True)])
def test_the_direction_of_thrust_is_found(degrees, differ):
    found = failure.thrust_direction(*rotated(np.radians(degrees), 1.3))
    assert found["model"]["angle_deg"] == pytest.approx(0, abs=1e-6)
    assert found["model"]["force_per_unit_input"] == pytest.approx(1)
    measured = found["measured"]
    assert measured["angle_deg"] == pytest.approx(degrees, abs=1)
    assert found["off_deg"] == pytest.approx(degrees, abs=1)
    assert measured["force_per_unit_input"] == pytest.approx(1.3, rel=0.02)
    assert measured["angle_standard_error_deg"] < 1
    assert found["body_axes_differ"] is differ


def test_no_direction_without_changing_thrust_and_none_certain_in_noise():
    wrench, responses, by_model, totals, nu = rotated(1.0)
    assert failure.thrust_direction(wrench, responses, by_model, 0 * totals + 1, nu) is None
    random = np.random.default_rng(7)
    noise = random.normal(size=wrench.shape)
    for size, least, most in ((30, 30, 60), (8, 16, 29)):
        found = failure.thrust_direction(wrench + size * noise, responses, by_model, totals, nu)
        assert least < found["measured"]["angle_standard_error_deg"] < most
        assert found["off_deg"] > 50 and not found["body_axes_differ"]


# --- residuals


def test_inputs_hold_and_are_zero_before_the_first():
    run = run_data(2.0)
    inputs = np.array(run.inputs)
    at = np.array([-1.0, inputs[0, 0], inputs[3, 0] - 1e-6, inputs[3, 0], 99.0])
    held = residuals.held(run, at)
    assert held[0].tolist() == [0, 0, 0]
    assert np.allclose(held[1:], inputs[[0, 2, 3, -1], 1:])


def test_correlations_are_those_of_plain_sums():
    random = np.random.default_rng(8)
    values = smooth_series(random, 600, 3)
    values[100] = np.nan
    stretch = np.repeat([0, 1], [250, 350])
    found = residuals._autocorrelation(values, stretch)
    assert found["lag_samples"] == list(range(1, 41))
    power = np.nanmean(values**2)
    for lag in (1, 2, 7, 40):
        pairs = [
            values[i] * values[i + lag]
            for i in range(600 - lag)
            if stretch[i] == stretch[i + lag] and np.isfinite(values[i] * values[i + lag])
        ]
        assert found["value"][lag - 1] == pytest.approx(np.mean(pairs) / power)
        assert found["band99"][lag - 1] == pytest.approx(2.5758 / np.sqrt(len(pairs)), rel=1e-4)
    assert not found["accepted"]
    series = random.normal(size=50)
    expected = [np.mean(series[lag:] * series[:-lag]) for lag in range(1, 6)]
    assert np.allclose(residuals._products(series, 6), expected)


def test_white_residuals_are_accepted_99_times_of_100():
    random = np.random.default_rng(9)
    stretch = np.zeros(500, int)
    accepted = [
        residuals._autocorrelation(random.normal(size=500), stretch)["accepted"] for _ in range(200)
    ]
    assert 0.96 <= np.mean(accepted) < 1
    outside = [residuals._autocorrelation(random.normal(size=500), stretch) for _ in range(100)]
    assert 0.003 < np.mean([one["outside"] / one["lags"] for one in outside]) < 0.02


def test_innovations_of_a_true_model_are_white_and_independent_of_the_inputs():
    run = run_data()
    found = residuals.analyse(_core.WrenchFilter(model(), run, repair.MAX_GAP), run, model())
    assert found["white"] and set(found["channels"]) == {"ahead", "starboard", "heading"}
    for channel in found["channels"].values():
        assert channel["input_sum"]["accepted"] and channel["input_difference"]["accepted"]
        lags = channel["autocorrelation"]
        assert lags["lag_seconds"] == pytest.approx([0.01 * k for k in lags["lag_samples"]])
    assert found["noise"]["position"]["value"] == pytest.approx(3e-4, rel=0.3)
    assert found["samples"] <= len(run.times)


def test_residuals_are_white_if_those_of_all_channels_are(monkeypatch):
    run = run_data(2.0)
    along = _core.WrenchFilter(model(), run, repair.MAX_GAP)
    for accepted in ((True, True, True), (True, False, True), (False, False, False)):
        left = list(accepted)
        monkeypatch.setattr(
            residuals, "_autocorrelation",
            lambda values, stretch, left=left: {"accepted": left.pop(0), "lag_samples": [1]},
        )  # fmt: skip
        assert residuals.analyse(along, run, model())["white"] is all(accepted)


@pytest.mark.parametrize("duration", [8.0, 3.0])
def test_bands_widen_with_correlated_residuals(duration):
    """Bartlett: by the correlations of both over a second, or a quarter of a shorter run."""
    run, craft = run_data(duration), model()
    times = np.array(run.times)
    values = smooth_series(np.random.default_rng(2), len(times), 20)
    values = values - values.mean()
    found = residuals._with_input(values, np.zeros(len(times), int), run, times, craft, "sum")
    command = craft.forces(residuals.held(run, times)[:, :-1])[:, 0]
    command = command - command.mean()
    count, sum_of_products = len(times), 0.0
    for lag in range(1, min(100, count // 4)):
        own, other = (np.mean(x[lag:] * x[:-lag]) / np.mean(x**2) for x in (values, command))
        sum_of_products += own * other
    width = np.sqrt(max(1.0, 1 + 2 * sum_of_products) / count)
    assert found["band99"] == pytest.approx([2.5758 * width] * len(found["value"]), rel=1e-4)
    assert width > 1.2 / np.sqrt(count)


def test_residuals_that_follow_an_input_are_not_accepted():
    """The residual repeats the thrust difference 0.2 s later."""
    run, craft = run_data(), model()
    times = np.array(run.times)
    inputs = residuals.held(run, times - 0.2)
    random = np.random.default_rng(1)
    for command, signs in (("sum", [1, 1]), ("difference", [1, -1])):
        values = 0.3 * (inputs[:, :2] @ signs) / craft.input_max + random.normal(size=len(times))
        values[:50] = np.nan
        found = residuals._with_input(
            values - np.nanmean(values), np.zeros(len(times), int), run, times, craft, command
        )
        best = int(np.argmax(np.abs(found["value"])))
        assert found["lag_seconds"][best] == pytest.approx(0.2)
        assert not found["accepted"] and found["value"][best] > 0.1
    still = dataclasses.make_dataclass("Still", ["inputs"])(np.array([[0.0, 1, 1, 1]]))
    assert residuals._with_input(values, np.zeros(len(times), int), still, times, craft, "sum") is None
