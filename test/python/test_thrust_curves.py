"""Fits to forces of a bench, against least squares, F tests and jackknives that are written plainly."""

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


def test_a_fit_needs_two_levels_of_a_running_thruster(tmp_path):
    with pytest.raises(GroundError, match="needs forces at two inputs above zero"):
        thrust_bench.read(table(tmp_path, "input,left", "0,0", "1,1", "1,1.1"), ["left"])
    found = thrust_bench.read(table(tmp_path, "input,left", "0.5,1", "1,1"), ["left"])
    assert len(found.inputs) == 2


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
