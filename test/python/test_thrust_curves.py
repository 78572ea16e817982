"""Fits to forces of a bench, against least squares, F tests and jackknives that are written plainly."""
import types

import numpy as np
import pytest
from scipy import optimize, stats

from ground.analysis import thrust_bench, thrust_curve
from ground.errors import GroundError


def bench(rows):
    """Of rows (input, thrusters at work, repetition, force)."""
    return thrust_bench.Bench(*(np.array(column, float) for column in zip(*rows)))


def one_thruster(force, levels, repeat=1, noise=0.0, seed=1):
    random = np.random.default_rng(seed)
    return bench(
        [
            (w, [1.0], number, force(w) + noise * random.normal())
            for w in levels
            for number in range(repeat)
        ]
    )


def squares_of(basis, forces):
    """Sum of squares that a linear regression leaves."""
    rest = forces - basis @ np.linalg.lstsq(basis, forces, rcond=None)[0]
    return float(rest @ rest)


# --- tables


def table(tmp_path, *lines):
    path = tmp_path / "bench.csv"
    path.write_text("\n".join(lines) + "\n")
    return str(path)


@pytest.mark.parametrize("low,high", [(0, 1), (1000, 2000), (200, 100)])
def test_inputs_reach_from_off_to_full_up_to_rounding(tmp_path, low, high):
    def read(first, last):
        path = table(tmp_path, "pwm,left", "%.9g,0" % (low + first * (high - low)), "%.9g,0.1" % (
            low + 0.5 * (high - low)), "%.9g,0.2" % (low + last * (high - low)))  # fmt: skip
        return thrust_bench.read(path, ["left"], low, high)

    assert read(-5e-7, 1 + 5e-7).inputs.tolist() == [0.0, pytest.approx(0.5), 1.0]
    for first, last, line in ((-5e-6, 1, 2), (0, 1 + 5e-6, 4)):
        with pytest.raises(GroundError, match="line %d: input .* is not between %d and %d: give what"
                           % (line, low, high)):  # fmt: skip
            read(first, last)


def test_a_table_is_of_newtons_and_shares_unless_it_says_otherwise(tmp_path):
    path = table(tmp_path, "input,left", "0.5,0.25", "1,0.75")
    assert thrust_bench.read(path, ["left"]).forces.tolist() == [0.25, 0.75]
    assert thrust_bench.read(path, ["left"]).inputs.tolist() == [0.5, 1.0]
    assert thrust_bench.read(path, ["left"], unit=0.01).forces == pytest.approx([0.0025, 0.0075])


def test_a_fit_needs_two_levels_of_a_running_thruster(tmp_path):
    with pytest.raises(GroundError, match="needs forces at two inputs above zero"):
        thrust_bench.read(table(tmp_path, "input,left", "0,0", "1,1", "1,1.1"), ["left"])
    found = thrust_bench.read(table(tmp_path, "input,left", "0.5,1", "1,1"), ["left"])
    assert len(found.inputs) == 2


def test_lines_of_a_table_are_counted_as_an_editor_does(tmp_path):
    cases = (
        (["0,1", "", "x,2"], 4), (["0,1", "1,2,3"], 3), (["0,nan"], 2), (["0,1", "1,inf"], 3),
        (["0,1", " , ", "0.5"], 4),
    )  # fmt: skip
    for lines, number in cases:
        path = table(tmp_path, "input,left", *lines)
        with pytest.raises(GroundError, match="line %d: must be 2 numbers$" % number):
            thrust_bench.read(path, ["left"])
    with pytest.raises(GroundError, match="nowhere.csv: cannot be read: "):
        thrust_bench.read(str(tmp_path / "nowhere.csv"), ["left"])


def test_thrusters_that_were_measured_together_are_counted_or_named(tmp_path):
    path = table(tmp_path, "input,a,b", "0.5,1,2", "1,3,4")
    names = ["left", "right", "top", "low"]
    for measured, working in (
        (["3"], [0.75] * 4), (["4"], [1.0] * 4), (["1"], [0.25] * 4), (["top", "left"], [1, 0, 1, 0]),
    ):  # fmt: skip
        found = thrust_bench.read(path, names, measured=measured)
        assert found.together.tolist() == [working] * 4 and found.repetition.tolist() == [0, 1, 0, 1]
    for measured, said in ((["5"], "5"), (["front", "left"], "front"), (["left", "2"], "2"), ([], "")):
        with pytest.raises(GroundError) as error:
            thrust_bench.read(path, names, measured=measured)
        assert "no thruster is called %s: the model's are left, right" % said in str(error.value)


def test_what_a_header_has_to_name_is_said(tmp_path):
    for header in ("input,front", "input", "input,left,left+front"):
        with pytest.raises(GroundError) as error:
            thrust_bench.read(table(tmp_path, header), ["left", "right"])
        assert (
            "line 1 must name the columns: input, then the thrusters (left, right, or both for all of them "
            "together), each optionally with an ending such as left_2. Where all columns are of the same "
            "thrusters, say so with --thrusters" in str(error.value)
        )


def test_a_draft_that_is_filled_in_has_the_levels_that_were_held(tmp_path):
    held = [(0.0, 0.0), (0.3, 0.0), (0.6, 0.0), (0.0, 0.3), (0.0, 0.6), (0.6, 0.6), (0.3, 0.3)]
    for rounds in (1, 3):
        lines = thrust_bench.draft(held * rounds).splitlines()
        columns = lines[0].split(",")[1:]
        assert len(columns) == 3 * rounds and len(lines) == 3
        assert all(line.count(",") == len(columns) for line in lines)
        filled = [line.split(",")[0] + ",0.1" * len(columns) for line in lines[1:]]
        found = thrust_bench.read(table(tmp_path, lines[0], *filled), ["left", "right"])
        rows = sorted(zip(found.inputs, *found.together.T))
        expected = [(max(pair), float(pair[0] > 0), float(pair[1] > 0)) for pair in held[1:] * rounds]
        assert rows == sorted(expected)


# --- the choice of a curve


def lack_of_fit(given, basis):
    """p-value of a linear regression by repeated measurements (Draper and Smith 1998, 2.1)."""
    levels = np.unique(given.inputs)
    pure = sum(squares_of(np.ones((n, 1)), part) for part, n in (
        (given.forces[given.inputs == w], (given.inputs == w).sum()) for w in levels))  # fmt: skip
    freedom = len(given.inputs) - len(levels)
    left = len(levels) - basis.shape[1]
    lack = squares_of(basis, given.forces) - pure
    return stats.f.sf(lack / left / (pure / freedom), left, freedom)


def bent(bend, repeat=3):
    return one_thruster(
        lambda w: 0.2 * w + bend * w * (w - 0.55), np.linspace(0.1, 1, 10), repeat, 2e-3
    )


def bend_at(p_value, of):
    """The bend at which a p-value, which falls with it, has a value."""
    return optimize.brentq(lambda b: np.log(of(bent(b))) - np.log(p_value), 0.002, 0.2)


def test_a_curve_is_rejected_below_a_hundredth():
    def of(given):
        return lack_of_fit(given, given.inputs[:, None])

    accepted = thrust_bench.fit(bent(bend_at(0.0105, of)), ["a"])
    assert accepted.curve.kind == "linear" and accepted.rejected == []
    rejected = thrust_bench.fit(bent(bend_at(0.0095, of)), ["a"])
    assert rejected.curve.kind != "linear"
    assert rejected.rejected[0] == ("proportional force", pytest.approx(0.0095, rel=1e-6))


def test_two_repeated_measurements_suffice_for_the_test():
    twice = bent(0.2, repeat=2)
    given = twice.part((twice.repetition == 0) | np.isin(np.arange(20), [5, 11]))
    found = thrust_bench.fit(given, ["a"])
    expected = lack_of_fit(given, given.inputs[:, None])
    assert 0 < expected < 0.01 and found.rejected[0][1] == pytest.approx(expected)


def test_every_simpler_curve_is_listed_with_its_p_value():
    given = one_thruster(
        lambda w: 0.05 + 0.3 * w - 0.6 * w**2 + 0.5 * w**3, np.linspace(0.1, 1, 12), 4, 1e-4
    )
    found = thrust_bench.fit(given, ["a"])
    assert found.curve.words == "polynomial of degree 3"
    names = [name for name, _ in found.rejected]
    assert names == ["proportional force", "power", "polynomial of degree 1"] or names == [
        "proportional force", "power", "polynomial of degree 1", "polynomial of degree 2",
    ]  # fmt: skip
    line = lack_of_fit(given, given.inputs[:, None] ** np.arange(2))
    assert dict(found.rejected)["polynomial of degree 1"] == pytest.approx(line, rel=1e-3, abs=1e-12)


def test_without_repetitions_a_criterion_decides_at_strong_evidence():
    def criterion(given, degree):
        basis = given.inputs[:, None] ** np.arange(1, degree + 1)
        n = len(given.forces)
        return n * np.log(squares_of(basis, given.forces) / n) + degree * np.log(n)

    def curves(given):
        """Lines and parabolas through nothing, as the fit sees them."""
        found = []
        for degree in (1, 2):
            basis = given.inputs[:, None] ** np.arange(1, degree + 1)
            weights = np.linalg.lstsq(basis, given.forces, rcond=None)[0]
            found.append(
                types.SimpleNamespace(
                    order=degree,
                    words="degree %d" % degree,
                    force=lambda w, d=degree, k=weights: w[:, None] ** np.arange(1, d + 1) @ k,
                )
            )
        return found

    def difference(bend):
        given = bent(bend, repeat=1)
        return criterion(given, 1) - criterion(given, 2)

    for amount in (5.8, 6.2):
        given = bent(optimize.brentq(lambda b, a=amount: difference(b) - a, 0.004, 0.2), repeat=1)
        line, parabola = curves(given)
        chosen, rejected = thrust_bench._choose(given, np.ones(1), [line, parabola])
        if amount < 6:
            assert chosen is line and rejected == []
        else:
            assert chosen is parabola
            assert rejected == [("degree 1", pytest.approx(np.exp(-amount / 2)))]


def test_forces_on_a_curve_need_no_flexible_one():
    """Rounding errors of exact forces reject nothing, with repetitions or without."""
    for repeat in (1, 2, 3):
        for force, kind in ((lambda w: 0.2 * w, "linear"), (lambda w: 0.2 * w**1.5, "power")):
            given = one_thruster(force, np.linspace(0.1, 1, 10), repeat)
            assert thrust_bench.fit(given, ["a"]).curve.kind == kind, (repeat, kind)


def test_the_best_of_rejected_curves_is_taken():
    """Where the curves jump, none fits; the closest is better than none."""
    given = one_thruster(lambda w: 0.1 * np.ceil(7 * w), np.linspace(0.05, 1, 20), 3, 1e-4)
    found = thrust_bench.fit(given, ["a"])
    left = []
    for _, kind in thrust_curve.KINDS:
        curve = kind(given.inputs, np.ones(len(given.inputs)), given.forces)
        if curve is not None:
            left.append((((given.forces - curve.force(given.inputs)) ** 2).sum(), curve.words))
    assert found.curve.words == min(left)[1]
    assert {name for name, _ in found.rejected} == {words for _, words in left} - {found.curve.words}


# --- gains


def two_thrusters(gain, levels=6, repeat=2, noise=0.003, seed=2):
    random = np.random.default_rng(seed)
    return bench(
        [
            (w, [float(j == 0), float(j == 1)], number, g * 0.2 * w + noise * random.normal())
            for w in np.linspace(0.2, 1, levels)
            for number in range(repeat)
            for j, g in enumerate((gain, 2 - gain))
        ]
    )


def equal_gains(given, order):
    """p-value of equal gains beside a table with straight lines between `order` inputs, by a fit of
    all numbers together; knots are those of the most flexible curve of six levels."""
    knots = np.quantile(np.unique(given.inputs), np.linspace(0, 1, order))

    def left(x):
        gains = np.array([x[0], 2 - x[0]])
        return given.together @ gains * np.interp(given.inputs, knots, x[1:]) - given.forces

    free = optimize.least_squares(left, np.r_[1.0, 0.2 * knots], xtol=1e-14, ftol=1e-14)
    same = optimize.least_squares(lambda x: left(np.r_[1.0, x]), 0.2 * knots, xtol=1e-14)
    freedom = len(given.forces) - order - 1
    return stats.f.sf(2 * (same.cost - free.cost) / (2 * free.cost / freedom), 1, freedom)


def test_gains_are_tested_beside_the_most_flexible_curve():
    for gain in (1.0, 1.01, 1.02):
        given = two_thrusters(gain)
        found = thrust_bench.fit(given, ["a", "b"])
        expected = equal_gains(given, 3)
        assert found.p_value == pytest.approx(expected, rel=0.02)
        assert (found.gains != 1).any() == (expected < 0.01)


def test_gains_differ_below_a_hundredth():
    def of(gain):
        return equal_gains(two_thrusters(gain), 3)

    for p_value, differ in ((0.012, False), (0.0085, True)):
        gain = optimize.brentq(lambda g, p=p_value: np.log(of(g) / p), 1.0, 1.2)
        found = thrust_bench.fit(two_thrusters(gain), ["a", "b"])
        assert (found.gains != 1).any() == differ and found.p_value == pytest.approx(p_value, rel=0.03)


def test_gains_are_not_tested_without_a_degree_of_freedom():
    """Two coefficients of a power and one gain: four measurements are needed."""
    rows = [(0.5, [1, 0], 0, 0.1), (1.0, [1, 0], 0, 0.2), (0.5, [0, 1], 0, 0.15), (1.0, [0, 1], 0, 0.31)]
    few = thrust_bench.fit(bench(rows[:3]), ["a", "b"])
    assert few.p_value is None and (few.gains == 1).all()
    assert thrust_bench.fit(bench(rows), ["a", "b"]).p_value is not None
    together = bench([(w, [1, 1], 0, 0.2 * w) for w in (0.25, 0.5, 0.75, 1.0)])
    assert thrust_bench.fit(together, ["a", "b"]).p_value is None  # nothing separates them


def test_gains_that_no_column_separates_are_the_same():
    rows = [
        (w, at, 0, 0.2 * w * force)
        for w in (0.2, 0.4, 0.6, 0.8, 1.0)
        for at, force in (([1, 0, 0], 0.8), ([0, 1, 1], 2.2))
    ]
    found = thrust_bench.fit(bench(rows), ["a", "b", "c"])
    assert found.gains == pytest.approx([0.8, 1.1, 1.1], abs=1e-6)
    assert found.values["k"] == pytest.approx(0.2) and found.p_value < 1e-6


@pytest.mark.parametrize("unit", [1e-4, 1e4])
@pytest.mark.parametrize("noise", [0.0, 0.003])
def test_nothing_but_sizes_depends_on_the_unit_of_force(unit, noise):
    """Nor does the order of the rows matter."""
    for given in (two_thrusters(1.1, noise=noise), two_thrusters(1.0, noise=noise), bent(0.1 * noise)):
        names = ["a", "b"][: given.together.shape[1]]
        order = np.random.default_rng(1).permutation(len(given.forces))
        plain = thrust_bench.fit(given, names)
        scaled = thrust_bench.Bench(
            given.inputs[order], given.together[order], given.repetition[order], unit * given.forces[order]
        )
        found = thrust_bench.fit(scaled, names)
        assert found.curve.words == plain.curve.words
        assert found.gains == pytest.approx(plain.gains, rel=1e-6)
        assert [p for _, p in found.rejected] == pytest.approx([p for _, p in plain.rejected], rel=1e-4)
        if noise:
            assert found.p_value == pytest.approx(plain.p_value, rel=1e-4)
        assert set(found.values) == set(plain.values)
        size = unit * plain.values["k"]
        assert found.values["k"] == pytest.approx(size, rel=1e-6)
        assert found.intervals["k"] == pytest.approx([unit * x for x in plain.intervals["k"]], rel=1e-4)
        for name in ("residual", "scatter"):
            expected = unit * getattr(plain, name)
            assert getattr(found, name) == pytest.approx(expected, rel=1e-4, abs=1e-9 * size, nan_ok=True)


def test_gains_of_exact_forces_are_certain_in_any_unit():
    for unit in (1e-4, 1.0, 1e4):
        given = two_thrusters(1.1, noise=0.0)
        given = thrust_bench.Bench(given.inputs, given.together, given.repetition, unit * given.forces)
        found = thrust_bench.fit(given, ["a", "b"])
        assert found.gains == pytest.approx([1.1, 0.9]) and 0 < found.p_value < 1e-60


def test_all_gains_are_given_if_any_is_not_one():
    curve = thrust_curve.linear(np.array([0.5, 1.0]), np.ones(2), np.array([0.1, 0.2]))
    found = thrust_bench._values(curve, np.array([0.9, 1.0, 1.1]), ["a", "b", "c"])
    assert found == {"k": pytest.approx(0.2), "a": 0.9, "b": 1.0, "c": 1.1}
    assert set(thrust_bench._values(curve, np.ones(3), ["a", "b", "c"])) == {"k"}


# --- what a fit is worth


def test_the_residual_counts_coefficients_and_gains():
    line = bent(0.0)
    found = thrust_bench.fit(line, ["a"], "linear")
    basis = line.inputs[:, None]
    assert found.residual == pytest.approx(np.sqrt(squares_of(basis, line.forces) / (30 - 1)))
    given = two_thrusters(1.1)
    found = thrust_bench.fit(given, ["a", "b"])
    misfit = given.forces - found.force(given)
    free = found.curve.order + 1
    assert found.residual == pytest.approx(np.sqrt(misfit @ misfit / (len(misfit) - free)))
    off = thrust_bench.Bench(*(np.append(a, 0 * a[:2], axis=0) for a in (
        line.inputs, line.together, line.repetition, line.forces)))  # fmt: skip
    assert thrust_bench.fit(off, ["a"], "linear").residual == pytest.approx(
        thrust_bench.fit(line, ["a"], "linear").residual
    )  # forces of thrusters that are off say nothing


def jackknife(given, key):
    """Half of the 95% interval of a slope, each group of the rows left out in turn."""
    found = [
        given.inputs[key != g] @ given.forces[key != g] / (given.inputs[key != g] ** 2).sum()
        for g in np.unique(key)
    ]
    count = len(found)
    return stats.t.ppf(0.975, count - 1) * np.sqrt((count - 1) ** 2 / count * np.var(found, ddof=1))


def test_intervals_are_the_wider_jackknife():
    given = bent(0.02)
    shifted = thrust_bench.Bench(
        given.inputs, given.together, given.repetition, given.forces * (1 + 0.1 * given.repetition)
    )
    for one, wider in ((given, given.inputs), (shifted, shifted.repetition)):
        found = thrust_bench.fit(one, ["a"], "linear")
        half = max(jackknife(one, one.inputs), jackknife(one, one.repetition))
        assert half == jackknife(one, wider)
        value = found.values["k"]
        assert found.intervals["k"] == pytest.approx((value - half, value + half))


def test_the_size_of_a_power_is_that_at_full_input():
    given = one_thruster(lambda w: 0.3 * w**1.6, np.linspace(0.1, 0.8, 8))
    found = thrust_bench.fit(given, ["a"])
    assert found.values == pytest.approx({"k": 0.3, "p": 1.6}, rel=1e-4)
    part = thrust_bench.fit(given, ["a"], "polynomial")
    assert part.values == pytest.approx({"k": 0.3 * 0.8**1.6}, rel=0.02)  # at the largest input


def test_a_kind_that_cannot_be_fitted_is_refused():
    few = one_thruster(lambda w: 0.2 * w, (0.5, 1.0))
    with pytest.raises(GroundError, match="a table needs forces at more inputs than the table has"):
        thrust_bench.fit(few, ["a"], "table")
    with pytest.raises(GroundError, match="no force is positive: thrusters push"):
        thrust_bench.fit(one_thruster(lambda w: -0.2 * w, (0.5, 1.0)), ["a"])
    idle = one_thruster(lambda w: 1.0 if w == 0 else 0.0, (0.0, 0.5, 1.0))
    with pytest.raises(GroundError, match="no force is positive"):
        thrust_bench.fit(idle, ["a"])  # a force without input is the scale's


# --- curves

INPUTS = np.repeat(np.linspace(0.2, 1, 9), 2)
WORKING = np.tile([1.0, 2.0], 9)


def test_a_line_is_the_least_squares_one():
    random = np.random.default_rng(1)
    forces = WORKING * INPUTS * 0.3 + 0.05 * random.normal(size=18)
    found = thrust_curve.linear(INPUTS, WORKING, forces)
    slope = np.linalg.lstsq((WORKING * INPUTS)[:, None], forces, rcond=None)[0][0]
    assert found.force(np.array([0.0, 0.5, 2.0])) == pytest.approx(slope * np.array([0, 0.5, 2]))
    assert found.power == 1 and found.full == pytest.approx(slope)


def test_a_power_is_the_least_squares_one():
    random = np.random.default_rng(1)
    forces = WORKING * 0.3 * (INPUTS / 2) ** 1.4 + 0.02 * random.normal(size=18)
    found = thrust_curve.power(INPUTS / 2, WORKING, forces)
    (k, p), _ = optimize.curve_fit(
        lambda x, k, p: x[1] * k * x[0] ** p, np.array([INPUTS / 2, WORKING]), forces, [0.3, 1.0]
    )
    at = np.array([0.1, 0.3, 0.5])
    assert found.force(at) == pytest.approx(k * at**p, rel=1e-4)
    assert found.power == pytest.approx(p, rel=1e-4) and found.largest == 0.5
    assert found.force(np.array([-0.1, 0.0])).tolist() == [0.0, 0.0]


@pytest.mark.parametrize("exponent,expected", [(0.1, 0.2), (0.3, 0.3), (4.0, 4.0), (7.0, 5.0)])
def test_exponents_lie_between_a_fifth_and_five(exponent, expected):
    found = thrust_curve.power(INPUTS, WORKING, WORKING * INPUTS**exponent)
    assert found.power == pytest.approx(expected, abs=1e-3)


def test_a_polynomial_begins_where_it_becomes_positive():
    """Below, forces are zero and do not bend it."""
    for begin in (0.31, 0.47):
        forces = WORKING * np.maximum(0, 0.5 * (INPUTS - begin) + 0.3 * (INPUTS - begin) ** 2)
        forces[INPUTS < begin] = 0
        found = thrust_curve.polynomial(2)(INPUTS, WORKING, forces)
        assert found.knots[0] == pytest.approx(begin, abs=1 / 300)
        fine = np.linspace(0, 1, 400)
        true = np.where(fine > begin, 0.5 * (fine - begin) + 0.3 * (fine - begin) ** 2, 0)
        assert np.abs(found.force(fine) - true).max() < 0.003
        assert (found.force(fine[fine < begin - 0.01]) == 0).all()
        table = np.array(found.table())
        assert table[0].tolist() == [0, 0] and len(table) == 13
        assert np.diff(table[1:, 0]) == pytest.approx(np.diff(table[1:, 0])[0], abs=1e-5)
    line = thrust_curve.polynomial(1)(INPUTS, WORKING, WORKING * 0.4 * INPUTS)
    assert len(line.knots) == 2  # a line needs no more
    offset = thrust_curve.polynomial(1)(INPUTS, WORKING, WORKING * (0.1 + 0.4 * INPUTS))
    assert offset.force(np.array([0.001, 1.0])) == pytest.approx([0.1004, 0.5])
    assert offset.table() == [(0, 0), (1, 1)]  # no force without input


def test_a_polynomial_that_falls_is_no_curve():
    for fall, is_curve in ((0.49, True), (0.51, False)):  # the slope vanishes at the largest input
        forces = WORKING * (INPUTS - fall * INPUTS**2)
        found = thrust_curve.polynomial(2)(INPUTS, WORKING, forces)
        assert (found is not None) == is_curve
    assert thrust_curve.polynomial(1)(INPUTS, WORKING, WORKING * (0.5 - INPUTS)) is None


def test_a_table_continues_its_first_and_last_line():
    def force(w):
        return np.interp(w, [0.2, 0.6, 1.0], [0.1, 0.4, 0.9])

    found = thrust_curve.table(2)(INPUTS, WORKING, WORKING * force(INPUTS))
    zero = 0.2 - 0.1 / (0.3 / 0.4)
    below = np.array([0.0, zero, zero + 0.05, 0.2])
    assert found.force(below) == pytest.approx([0, 0, 0.05 * 0.75, 0.1], abs=1e-6)
    assert found.force(np.array([1.2, 1.4])) == pytest.approx([0.9 + 0.25, 0.9 + 0.5], abs=1e-6)
    assert found.knots == pytest.approx([zero, 0.2, 0.6, 1.0]) and found.largest == 1.0
    table = np.array(found.table())
    assert table == pytest.approx(np.array(
        [[0, 0], [zero, 0], [0.2, 1 / 9], [0.6, 4 / 9], [1.0, 1.0]]), abs=1e-5)  # fmt: skip
    steep = thrust_curve.table(2)(
        INPUTS, WORKING, WORKING * np.interp(INPUTS, [0.2, 0.6, 1.0], [0.4, 0.5, 0.9])
    )
    # The first line would end in a force without input: a steeper one leads to none.
    assert steep.force(np.array([0.0, 0.1])) == pytest.approx([0.0, 0.2], abs=1e-6)
    flat = thrust_curve.table(2)(
        INPUTS, WORKING, WORKING * np.interp(INPUTS, [0.2, 0.6, 1.0], [0.5, 0.4, 0.9])
    )
    assert flat.force(np.array([0.1])) == pytest.approx(flat.force(np.array([0.6])) / 2)
    begins = thrust_curve.table(2)(
        INPUTS, WORKING, WORKING * np.interp(INPUTS, [0.2, 0.6, 1.0], [0.0, 0.4, 0.9])
    )
    assert begins.force(np.array([0.1, 0.2])) == pytest.approx([0, 0], abs=1e-12)
    assert begins.table() == [(0, 0), (0.2, 0), (0.6, pytest.approx(4 / 9, abs=1e-6)), (1, 1)]


def test_a_table_has_lines_between_uneven_inputs():
    levels = np.array([0.2, 0.25, 0.3, 0.5, 1.0])

    def force(w):
        return np.interp(w, [0.1, 0.3, 1.0], [0.0, 0.1, 0.8])

    found = thrust_curve.table(2)(levels, np.ones(5), force(levels))
    at = np.linspace(0.05, 1.0, 20)
    assert found.force(at) == pytest.approx(force(at), abs=1e-6)
    assert found.force(np.array([1.1])) == pytest.approx([0.9], abs=1e-6)


def test_a_table_is_the_least_squares_one_that_does_not_fall():
    random = np.random.default_rng(3)
    forces = WORKING * 0.3 * INPUTS**2 + 0.02 * random.normal(size=18)
    found = thrust_curve.table(4)(INPUTS, WORKING, forces)
    knots = np.quantile(np.unique(INPUTS), [0, 0.25, 0.5, 0.75, 1])

    def left(x):
        return WORKING * np.interp(INPUTS, knots, np.cumsum(x)) - forces

    best = optimize.lsq_linear(
        np.column_stack([left(e) - left(np.zeros(5)) for e in np.eye(5)]), forces, (0, np.inf)
    )
    assert found.force(knots) == pytest.approx(np.cumsum(best.x), abs=1e-6)
