"""What the missing wrench depends on: each part against a plain computation of the same."""

import numpy as np
import pytest
from conftest import ROOT
from test_missing_wrench import model, pushed, rotated, run_data, smooth_series

from ground import _core
from ground.analysis import candidates, comparison, failure, residuals
from ground.recordings import repair, windows
from ground.reports import figures, inspection


def four():
    return _core.load_model(str(ROOT / "cfg" / "hovercraft" / "four_thrusters.yaml"))


def four_run():
    """A run of the craft with four thrusters, without noise."""
    craft = four()
    random = np.random.default_rng(1)
    edges = np.arange(75) / 15
    rows = np.column_stack([edges, random.integers(0, 3, (75, 4)) / 2 * craft.input_max, np.ones(75)])
    times = np.arange(0, 5, 0.01)
    found = _core.simulate(craft, rows, times, np.zeros(3), np.array([0.2, 0.0, 0.5]))
    return _core.RunData("four", times, found["eta"], found["nu"], rows), craft


# --- variables


def test_variables_of_other_crafts_are_those_of_their_thrusters():
    run, craft = four_run()
    found = failure.variables(run, craft)
    inputs = residuals.held(run, np.array(run.times))[:, :-1] / craft.input_max
    for thruster, values in zip(craft.thrusters, inputs.T):
        one = found["u_" + thruster["name"]]
        assert np.allclose(np.array(one.centres)[one.index], values) and len(one.centres) == 3
    assert "u_L" not in found and "u_L+u_R" not in found
    forces = craft.forces(inputs)
    for name, values in zip(("thrust ahead", "thrust to starboard", "moment"), forces.T):
        one = found[name]
        for i, centre in enumerate(one.centres):
            assert centre == pytest.approx(np.median(values[one.index == i]), abs=1e-5), name


def test_residuals_of_other_crafts_do_not_follow_inputs_that_they_do_not_have():
    """Motors lag, which the model does not know."""
    _, craft = four_run()
    random = np.random.default_rng(1)
    edges = np.arange(150) / 15
    rows = np.column_stack([edges, 0.3 * random.integers(0, 2, (150, 4)), np.ones(150)])
    times, levels = np.arange(0, 10, 0.01), np.array([3e-4, 3e-4, 5e-3])
    truth = candidates.of_library("motor_lag").neutral(without_effects(craft))
    truth.set_value("motor_lag.tau", 0.15)
    eta = np.array(_core.simulate(truth, rows, times, np.zeros(3), np.zeros(3))["eta"])
    eta += random.normal(0, levels, eta.shape)
    found = repair.smooth(times, eta, (3e-4, 5e-3))
    run = _core.RunData("four", times, found["eta"], found["nu"], rows, eta, levels)
    study = inspection.inspect(run, without_effects(craft), "four")
    titles = str(figures.residual_correlation([study]))
    assert any("still follow the commanded" in sentence for sentence in study["summary"])
    assert "u_L" not in " ".join(study["summary"]) + titles and "moment" in titles


def without_effects(craft):
    plain = craft.copy()
    for name in craft.effects:
        plain.remove_effect(name)
    return plain


def test_headings_have_bins_of_thirty_degrees():
    psi = np.radians(np.linspace(-720, 720, 4801))
    run = _core.RunData("r", np.arange(4801) / 100, np.column_stack([psi, psi, psi]),
                        np.zeros((4801, 3)), np.array([[0.0, 0, 0, 1]]))  # fmt: skip
    heading = failure.variables(run, model())["heading"]
    assert heading.centres == pytest.approx(np.arange(-165, 180, 30), abs=0.5)
    for i, centre in enumerate(heading.centres):
        inside = np.degrees(repair.wrap(psi))[heading.index == i]
        assert np.abs(inside - centre).max() <= 15.3


def test_few_levels_have_bins_of_their_own():
    for count in (10, 11):
        values = np.tile(np.arange(count) ** 2.0, 30)
        found = failure._binned("x", "x", "m", values)
        assert (found.centres == (np.arange(count) ** 2.0).tolist()) == (count == 10)
        assert len(found.centres) == 10 and set(found.index) == set(range(10))


def test_levels_are_apart_by_more_than_rounding():
    values = np.repeat([0.5, 0.5 + 3e-7, 0.5 - 3e-7, 0.7, 0.700004], 20)
    found = failure._binned("x", "x", "m", values)
    assert found.centres == pytest.approx([0.5, 0.7, 0.700004], abs=1e-6)
    assert found.index.tolist() == np.repeat([0, 0, 0, 1, 2], 20).tolist()


def test_bins_of_a_hundredth_of_the_samples_are_kept():
    for rare, kept in ((10, True), (9, False)):
        index = np.repeat([0, 1], [1000 - rare, rare])
        assert (failure._without_rare(index) == np.where((index == 1) & (not kept), -1, index)).all()
    assert failure._renumbered(np.array([-1, 4, 2, 4, 3]), [2, 4]).tolist() == [-1, 1, 0, 1, -1]
    assert failure._renumbered(np.array([-1, -1]), []).tolist() == [-1, -1]


def test_cells_of_the_map_are_where_the_craft_was():
    grid = (np.arange(5) + 0.5) / 5
    places = np.array([(x, 2 * y) for x in grid for y in grid])
    corners = np.array([[0.0, 0.0], [1.0, 2.0]])
    eta = np.column_stack([np.vstack([np.repeat(places, 20, axis=0), corners]), np.zeros(502)])
    found = failure._map(eta)
    assert np.allclose(found.centres, places)
    assert (found.index[:500] == np.repeat(np.arange(25), 20)).all()
    assert found.index[500:].tolist() == [0, 24]


# --- shares of the error, and of the wrench


def test_shares_of_the_error_are_of_25_samples_a_second():
    run = run_data()
    evaluation = comparison.evaluate(run, pushed((0.004, 0.0)))
    found = failure.variables(run, model())
    result = failure.of_error(evaluation, found)
    size = (np.abs(evaluation.residual) / evaluation.sigma)[::4]
    for name in ("u", "position"):
        design = found[name].indicators()[evaluation.index[::4]]
        for i, channel in enumerate("uvr"):
            assert result[name]["share"][channel] == failure.share_explained(design, size[:, i])
        assert result[name]["share_of_sum"] == failure.share_explained(design, size.sum(axis=1))


def test_means_in_bins_are_shrunk_by_three_thousandths():
    random = np.random.default_rng(1)
    found = {
        name: failure.Variable(name, name, "-", list(range(count)), random.integers(0, count, 300))
        for name, count in (("a", 3), ("b", 2))
    }
    responses = np.hstack([v.indicators() for v in found.values()] + [random.normal(size=(300, 2))])
    values = random.normal(size=300) + 2.0 * (found["a"].index == 1)
    result = failure._against(values, responses, found)
    accounted = failure._accounted(values, 0.7 * values, responses, found)
    assert accounted["share"] == pytest.approx(1 - 0.3**2)
    assert failure._accounted(0 * values, values, responses, found)["share"] == 0
    for name, variable in found.items():
        design = variable.indicators()
        normal = design.T @ design
        ridge = 0.003 * np.trace(normal) / len(normal) * np.eye(len(normal))
        expected = np.linalg.solve(normal + ridge, design.T @ values)
        assert result[name]["mean"] == pytest.approx(expected.tolist())
        assert accounted["mean"][name] == pytest.approx((0.7 * expected).tolist())
        assert result[name]["standard_error"] == failure.regress(design, values, 0.003)[1].tolist()
        assert result[name]["share"] == failure.share_explained(design, values)


def test_full_thrust_is_that_of_the_largest_inputs():
    """The moment is that of one thruster at the largest input against the other at none, twice."""
    craft = _core.load_model(str(ROOT / "cfg" / "hovercraft" / "mvwt.yaml"))
    assert craft.input_max > 1
    force, _, _ = craft.forces(np.full((1, 2), craft.input_max))[0] * craft.value("k")
    assert failure.full_scale(craft) == pytest.approx([force, force, force * craft.value("l")])


def test_disturbances_are_left_out_by_three_tenths_of_a_second():
    """Where the wrench is inferred by a stand-in that is 1 N at some instants and 0.01 N else."""
    run = run_data(8.0)
    times = np.array(run.times)
    full = failure.full_scale(model())
    assert full[0] == full[1] == 2 * model().value("k") * model().input_max
    assert full[2] == full[0] * model().value("l")
    cases = {
        "one": ([400], 1.0), "two": ([300, 500], 1.0), "near": ([300, 330], 1.0), "apart": ([300, 365], 1.0),
        "first": ([0], 1.0), "slight": ([400], 2.9 / 3), "none": ([], 1.0),
        "half": (range(100, 560, 20), 1.0),
    }  # fmt: skip
    for name, (at, size) in cases.items():
        wrench = np.full((len(times), 3), 1e-3) * full
        wrench[list(at), 0] = 3.03 * size * full[0]

        class Filter:
            def __init__(self, craft, run, gap):
                assert gap == repair.MAX_GAP

            def likeliest_noise(self, nature):
                return nature

            def smooth(self, noise, wrench=wrench):
                return {"wrench": wrench}

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(failure._core, "WrenchFilter", Filter)
            calm = failure.undisturbed(model(), run)
        if name in ("slight", "none", "half"):
            assert calm.events == [] and calm.run is run, name
            continue
        spans = [(max(0.0, times[i] - 0.3), times[i] + 0.3) for i in at]
        if name == "near":
            spans = [(spans[0][0], spans[1][1])]
        assert np.allclose(calm.events, spans), name
        kept = np.ones(len(times), bool)
        for begin, end in spans:
            kept &= (times < begin) | (times > end)
        assert np.array_equal(calm.run.times, times[kept]), name
        for what in ("eta", "nu", "poses"):
            assert np.array_equal(getattr(calm.run, what), np.array(getattr(run, what))[kept])
        assert np.array_equal(calm.run.noise, run.noise) and calm.run.name == run.name


def test_what_is_usual_in_a_run_is_no_disturbance():
    """A wrench that is always large has to be eight times its scatter."""
    run = run_data(8.0)
    full = failure.full_scale(model())
    for times_usual, left_out in ((7.9, False), (8.1, True)):
        wrench = np.tile(full, (len(run.times), 1))
        wrench[400, 1] = times_usual * 1.4826 * full[1]

        class Filter:
            def __init__(self, craft, run, gap):
                pass

            def likeliest_noise(self, nature):
                return nature

            def smooth(self, noise, wrench=wrench):
                return {"wrench": -wrench}

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(failure._core, "WrenchFilter", Filter)
            assert bool(failure.undisturbed(model(), run).events) == left_out


# --- the direction of thrust


def turned_model(by_model, angle):
    c, s = np.cos(angle), np.sin(angle)
    return by_model @ np.array([[c, s], [-s, c]])


@pytest.mark.parametrize("own,true,off", [(170, -170, 20), (-100, 170, -90), (30, 30, 0), (90, 121, 31)])
def test_directions_are_compared_the_short_way_round(own, true, off):
    wrench, responses, by_model, totals, nu = rotated(np.radians(true))
    turned = turned_model(by_model, np.radians(own))
    wrench[:, :2] += by_model - turned
    found = failure.thrust_direction(wrench, responses, turned, totals, nu)
    assert found["model"]["angle_deg"] == pytest.approx(own, abs=1e-6)
    assert found["measured"]["angle_deg"] == pytest.approx(true, abs=1)
    assert found["off_deg"] == pytest.approx(off, abs=1)


def test_axes_are_wrong_from_thirty_degrees_on():
    for degrees, differ in ((28.5, False), (31.5, True)):
        assert failure.thrust_direction(*rotated(np.radians(degrees)))["body_axes_differ"] is differ


def test_the_error_of_a_direction_is_the_scatter_of_repeated_trials():
    wrench, responses, by_model, totals, nu = rotated(0.5)
    found = []
    for seed in range(25):
        noise = np.random.default_rng(seed).normal(0, 0.6, wrench.shape)
        found.append(failure.thrust_direction(wrench + noise, responses, by_model, totals, nu)["measured"])
    scatter = np.std([one["angle_deg"] for one in found])
    said = np.mean([one["angle_standard_error_deg"] for one in found])
    assert 0.6 * scatter < said < 1.6 * scatter and scatter > 1
    assert np.mean([one["force_per_unit_input"] for one in found]) == pytest.approx(1, abs=0.05)


# --- residuals


def test_correlations_need_fifty_pairs_and_a_quarter_of_the_series():
    random = np.random.default_rng(1)
    for count, stretch, lags in (
        (1000, np.zeros(1000, int), 40), (100, np.zeros(100, int), 25),
        (100, np.repeat([0, 1], 50), 25), (80, np.zeros(80, int), 20), (60, np.zeros(60, int), 10),
        (51, np.zeros(51, int), 1), (50, np.zeros(50, int), 0), (240, np.repeat(np.arange(24), 10), 7),
    ):  # fmt: skip
        found = residuals._autocorrelation(random.normal(size=count), stretch)
        assert found["lag_samples"] == list(range(1, 1 + lags)), count
        assert len(found["value"]) == len(found["band99"]) == found["lags"] == lags


def test_bands_hold_99_of_100_values_and_their_maximum():
    """The limit of n values is that of each at a level of 1% over n."""
    for count, limit in ((1, 2.5758), (10, 3.2905), (40, 3.6623)):
        for sign in (1, -1):
            for factor, accepted in ((0.999, True), (1.001, False)):
                values = np.zeros(count)
                values[-1] = sign * factor * limit * 0.2
                found = residuals._judged(values, [0.2] * count)
                assert found["accepted"] == accepted and found["value"] == values.tolist()
                assert found["band99"] == pytest.approx([2.5758 * 0.2] * count, rel=1e-4)
                assert found["outside"] == (count > 1 or not accepted)
    assert residuals._judged([], [])["accepted"]
    assert residuals._judged([0.5151, 0.5152, -0.5152], [0.2] * 3)["outside"] == 2


def test_inputs_are_compared_from_before_to_eight_tenths_after():
    run, craft = run_data(), model()
    values = smooth_series(np.random.default_rng(1), len(run.times), 3)
    found = residuals._with_input(values, np.zeros(len(values), int), run, np.array(run.times), craft, "sum")
    assert found["lag_seconds"] == pytest.approx(np.arange(-5, 21) * 0.04)
    times = np.array(run.times)
    for lag, value in zip(found["lag_seconds"], found["value"]):
        told = (residuals.held(run, times - lag)[:, :2]).sum(axis=1)
        assert value == pytest.approx(np.corrcoef(told, values)[0, 1] * np.sqrt(
            ((values - values.mean()) ** 2).mean() / values.var()))  # fmt: skip


# --- predictions of a model


def test_predictions_leave_out_what_their_begin_was_fitted_to():
    run = run_data(6.0)
    found = comparison.evaluate(run, model())
    times, rows = np.array(run.times), 0
    for window in windows.cut([run]):
        inside = times[window.first : window.last + 1]
        rows += (inside >= inside[0] + 0.4 - 1e-9).sum()
    assert len(found.predicted) == rows
    assert np.abs(found.predicted).mean() < 0.3
    exact = run_data(6.0, noise=0)
    assert np.abs(comparison.evaluate(exact, model()).predicted).max() < 0.15


def test_the_objective_of_the_thesis_is_of_the_first_four_seconds():
    run, craft = run_data(8.0, nu=(0.3, 0.1, 0.4)), pushed((0.004, 0.0))
    (window,) = [w for w in _core.cut_windows(run, 0, 0.0, 4.0, 4.0, 4.0)]
    assert (window.first, window.last) in ((0, 399), (0, 400))
    expected = _core.SimulationError([run], [window]).simulate(craft, _core.Objective.thesis)["objective"]
    assert comparison.thesis_objective(run, craft) == expected
    for duration, known in ((3.65, True), (3.55, False)):  # nine tenths of it suffice
        assert (comparison.thesis_objective(run_data(duration), craft) is not None) == known


def test_errors_at_horizons_are_those_of_single_predictions():
    run = run_data(6.0, keep=np.r_[0:250, 280:600])
    craft = pushed((0.01, 0.0))
    found = comparison.evaluate(run, craft)
    times, eta, nu = np.array(run.times), np.array(run.eta), np.array(run.nu)
    rows = {row["seconds"]: row["errors"] for row in found.horizons}
    assert sorted(rows) == pytest.approx([0.01, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0])
    for horizon in (0.25, 1.0):
        expected, free_from = [], 0.0
        ends = np.where(np.arange(len(times)) < 250, 249, len(times) - 1)
        for first, end in enumerate(ends):
            if times[first] < free_from or first == end:
                continue
            free_from = times[first] + 0.1
            at = np.searchsorted(times, times[first] + horizon)
            if at > end:
                continue
            one = _core.predict(craft, run, [_core.Window(0, first, int(at))], nu[[first]])
            off = one["eta"][0][-1] - eta[at]
            expected.append(
                [*(np.abs(one["nu"][0][-1] - nu[at]) / found.sigma), 1000 * np.linalg.norm(off[:2]),
                 np.degrees(abs(repair.wrap(off[2])))]
            )  # fmt: skip
        assert np.allclose(rows[horizon], expected, rtol=1e-6, atol=1e-9)
    assert len(rows[min(rows)]) >= len(rows[0.25])

