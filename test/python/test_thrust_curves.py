"""Fits to forces of a bench, against least squares, F tests and jackknives that are written plainly."""

import numpy as np
import pytest

from ground.analysis import thrust_bench
from ground.errors import GroundError


def bench(rows):
    """Of rows (input, thrusters at work, repetition, force)."""
    return thrust_bench.Bench(*(np.array(column, float) for column in zip(*rows)))


def one_thruster(force, levels, repeat=1, noise=0.0, seed=1):
    random = np.random.default_rng(seed)
    return bench(
        [(w, [1.0], number, force(w) + noise * random.normal()) for w in levels for number in range(repeat)]
    )


# --- tables


def table(tmp_path, *lines):
    path = tmp_path / "bench.csv"
    path.write_text("\n".join(lines) + "\n")
    return str(path)


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


def bent(bend, repeat=3):
    return one_thruster(lambda w: 0.2 * w + bend * w * (w - 0.55), np.linspace(0.1, 1, 10), repeat, 2e-3)


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
