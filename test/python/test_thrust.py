"""identify thrust: thrust of a model from forces measured on a bench."""

import json

import numpy as np
import pytest
from conftest import MODEL, identify

LEVELS = np.linspace(0, 1, 11)


def table(path, force, columns=("left", "right"), noise=5e-4, repeat=3, seed=1, off=0.0, full=1.0):
    """Writes a bench's table; force(column, w) is the true force [N] at level w."""
    random = np.random.default_rng(seed)
    names = ["%s_%d" % (c, i + 1) for c in columns for i in range(repeat)]
    lines = ["input," + ",".join(names)]
    for w in LEVELS:
        forces = [force(n.split("_")[0], w) + noise * random.normal() for n in names]
        lines.append(",".join("%.6g" % x for x in [off + (full - off) * w] + forces))
    path.write_text("\n".join(lines) + "\n")
    return path


def fitted(tmp_path, path, *options):
    out = tmp_path / "thrust.yaml"
    result = identify("thrust", path, "--model", MODEL, "-o", out, "--json", *options)
    assert result.returncode == 0, result.stderr
    from ground import _core

    return json.loads(result.stdout), _core.load_model(str(out))


def test_the_thesis_bench_is_a_line_with_an_asymmetry(tmp_path):
    k = {"left": 0.103, "right": 0.100}  # thesis 3.2
    report, model = fitted(tmp_path, table(tmp_path / "bench.csv", lambda side, w: k[side] * w))
    assert set(report["parameters"]) == {"k", "a"}
    assert model.value("k") == pytest.approx(0.1015, rel=0.005)
    assert model.value("thrust_asymmetry.a") == pytest.approx(0.0148, abs=0.004)
    low, high = report["parameters"]["a"]["ci95"]
    assert low < 0.0148 < high
    assert report["scatter"] == pytest.approx(5e-4, rel=0.4)
    assert report["residual"] == pytest.approx(5e-4, rel=0.4)


def test_a_curve_in_grams_over_pwm_of_both_thrusters_together(tmp_path):
    path = table(
        tmp_path / "bench.csv",
        lambda side, w: 2 * 20 * w**1.7,
        columns=("both",),
        noise=0.2,
        off=1000,
        full=2000,
    )
    report, model = fitted(tmp_path, path, "--inputs", 1000, 2000, "--unit", "g")
    assert set(report["parameters"]) == {"k", "p"}  # the thrusters cannot be distinguished
    assert model.value("k") == pytest.approx(20 * 9.80665e-3, rel=0.01)
    assert model.value("thrust_curve.p") == pytest.approx(1.7, abs=0.05)


def test_equal_linear_thrusters_get_no_effects(tmp_path):
    chosen = []
    for seed in range(40):
        path = table(tmp_path / ("%d.csv" % seed), lambda side, w: 0.1 * w, seed=seed)
        from ground.analysis import thrust_bench

        chosen += [n for n in thrust_bench.fit(thrust_bench.read(str(path))).values if n != "k"]
    assert len(chosen) <= 4  # the mean is 1% of 80


def test_extrapolation_beyond_the_bench_is_reported(tmp_path):
    path = tmp_path / "bench.csv"
    # A spreadsheet writes a byte order mark at the beginning and an empty row at the end.
    path.write_text("\ufeffinput,left\n0.1,0.01\n0.2,0.021\n0.3,0.03\n,\n", encoding="utf-8")
    result = identify("thrust", path, "--model", MODEL, "-o", tmp_path / "thrust.yaml")
    assert result.returncode == 0, result.stderr
    assert "extrapolation" in result.stdout and "the bench gives 1.6" in result.stdout


@pytest.mark.parametrize(
    "text, message",
    [
        ("", "line 1 must name the columns"),
        ("u,left\n0,0\n", "line 1 must name the columns"),
        ("input,front\n0,0\n", "line 1 must name the columns"),
        ("input,left\n0,0\n0.5,x\n", "line 3: must be 2 numbers"),
        ("input,left\n0,0\n1500,0.1\n", "line 3: input 1500 is not between 0 and 1"),
        ("input,left\n0,0\n1,0.1\n", "a fit needs forces at two inputs above zero"),
        ("input,left\n0.5,0\n1,0\n", "no force is positive"),
        ("input,left\n0.5,-0.04\n1,-0.1\n", "no force is positive"),
    ],
)
def test_a_bad_table_is_refused_with_its_line(tmp_path, text, message):
    path = tmp_path / "bench.csv"
    path.write_text(text)
    result = identify("thrust", path, "--model", MODEL, "-o", tmp_path / "thrust.yaml")
    assert result.returncode == 1
    assert message in result.stderr and "Traceback" not in result.stderr
    assert not (tmp_path / "thrust.yaml").exists()


def test_a_draft_has_a_cell_for_every_held_level(tmp_path):
    from ground.analysis import thrust_bench

    single = [(0, 0), (0.2, 0), (0, 0), (0.7, 0), (0, 0), (0, 0.2), (0, 0), (0, 0.7)]
    assert thrust_bench.draft(single) == "input,left,right\n0.2,,\n0.7,,\n"
    assert thrust_bench.draft([(0.5, 0.5), (0, 0), (1, 1)]) == "input,both\n0.5,\n1,\n"
    twice = thrust_bench.draft(2 * single[:4])
    assert twice == "input,left_1,left_2\n0.2,,\n0.7,,\n"
    path = tmp_path / "bench.csv"
    path.write_text(twice.replace("0.2,,", "0.2,0.02,0.02").replace("0.7,,", "0.7,0.07,0.07"))
    assert thrust_bench.fit(thrust_bench.read(path)).values["k"] == pytest.approx(0.1)


@pytest.mark.parametrize(
    "levels, message",
    [
        ([(0.2, 0), (0.7, 0), (0, 0.2)], "not held at the same levels"),  # cut short
        ([(0.2, 0), (0.7, 0), (0.2, 0)], "equally often"),
        ([(0.2, 0.7)], "left 0.2 and right 0.7 at once"),
        ([(0, 0)], "not held"),
    ],
)
def test_levels_that_fit_no_table_are_refused(levels, message):
    from ground.analysis import thrust_bench
    from ground.errors import GroundError

    with pytest.raises(GroundError, match=message):
        thrust_bench.draft(levels)


def test_a_level_is_announced_once_it_is_held():
    from ground.nodes.bench_levels import Levels

    levels, announced = Levels(), []
    for i in range(300):  # at 50 Hz: zero, a level, a short one, zero, the level again
        time = 10 + i / 50
        left = 0.5 if 1 <= i / 50 < 3 or i / 50 >= 5 else 1.0 if 3 <= i / 50 < 3.3 else 0.0
        level = levels.command(time, left, 0.0)
        if level:
            announced.append((round(time, 2), level.text(levels.start)))
    assert announced == [
        (10.5, "left 0, right 0 since 0.0 s of the run; read the scale's zero"),
        (11.5, "left 0.5, right 0 since 1.0 s of the run; read the scale"),
        (13.8, "left 0, right 0 since 3.3 s of the run; read the scale's zero"),
        (15.5, "left 0.5, right 0 since 5.0 s of the run; read the scale"),
    ]
    assert [level.left for level in levels.held] == [0, 0.5, 0, 0.5]
