"""identify bench: thrust of a model from forces measured on a bench."""

import json
import math

import numpy as np
import pytest

import ground
from conftest import MODEL, ROOT, SHARED, identify, json_of, slow, succeeds
from ground import _core
from ground.fitting import bench_forces, thrust_bench
from ground.fitting.bench_logs import BenchFormat

LEVELS = np.linspace(0, 1, 11)
PAIR = ["left", "right"]
FOUR = ["back_left", "back_right", "front_left", "front_right"]
REAL_BENCH = SHARED.parent / "epfl_2019_12" / "thrust_bench.csv"


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
    return json_of("bench", path, "--model", MODEL, "-o", out, *options), _core.load_model(str(out))


def test_the_thesis_bench_is_a_line_with_an_asymmetry(tmp_path):
    k = {"left": 0.103, "right": 0.100}  # thesis 3.2
    report, model = fitted(tmp_path, table(tmp_path / "bench.csv", lambda side, w: k[side] * w))
    assert set(report["parameters"]) == {"k", "left", "right"} and report["curve"] == "linear"
    assert model.value("k") == pytest.approx(0.1015, rel=0.005)
    assert model.value("thrust_asymmetry.a") == pytest.approx(0.0148, abs=0.004)
    low, high = report["parameters"]["left"]["ci95"]
    assert low < 1.0148 < high and high - low < 0.05
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


@pytest.mark.parametrize(
    "text, message",
    [
        ("", "line 1 must name the columns"),
        ("u,1\n0,0\n", "line 1 must name the columns"),
        ("input,front\n0,0\n", "line 1 must name the columns"),
        ("input,left\n0,0\n0.5,x\n", "line 3: must be 2 numbers"),
        ("input,left\n0,0\n1500,0.1\n", "line 3: input 1500 is not between 0 and 1"),
        ("input,left\n0,0\n", "a fit needs a force at an input above zero"),
        ("input,left\n0,0\n0.5,0.1\n", "there are forces at the input 0.5 only"),
        ("input,left\n0.5,0\n1,0\n", "no force is positive"),
        ("input,left\n0.5,-0.04\n1,-0.1\n", "no force is positive"),
    ],
)
def test_a_bad_table_is_refused_with_its_line(tmp_path, text, message):
    path = tmp_path / "bench.csv"
    path.write_text(text)
    result = identify("bench", path, "--model", MODEL, "-o", tmp_path / "thrust.yaml")
    assert result.returncode == 1
    assert message in result.stderr and "Traceback" not in result.stderr
    assert not (tmp_path / "thrust.yaml").exists()


def test_a_draft_has_a_cell_for_every_held_level():
    single = [(0, 0), (0.2, 0), (0, 0), (0.7, 0), (0, 0), (0, 0.2), (0, 0), (0, 0.7)]
    assert bench_forces.draft(single) == "input,left,right\n0.2,,\n0.7,,\n"
    assert bench_forces.draft([(0.5, 0.5), (0, 0), (1, 1)]) == "input,both\n0.5,\n1,\n"
    assert bench_forces.draft(2 * single[:4]) == "input,left_1,left_2\n0.2,,\n0.7,,\n"


@pytest.mark.parametrize("repeat", [1, 3])
@pytest.mark.parametrize(
    "kind, force",
    [
        ("linear", lambda w: 0.1 * w),
        ("power", lambda w: 0.1 * w**1.8),
        ("polynomial", lambda w: 0.1 * np.maximum(0, w - 0.12) * (0.5 + 0.6 * w)),
    ],
)
def test_the_curve_is_the_simplest_that_fits(tmp_path, monkeypatch, kind, force, repeat):
    monkeypatch.setattr("test_bench.LEVELS", np.linspace(0, 1, 41))
    found = []
    for seed in range(10):
        path = table(tmp_path / "bench.csv", lambda side, w: force(w), ["left"], repeat=repeat, seed=seed)
        fit = thrust_bench.fit(bench_forces.read([str(path)], BenchFormat(PAIR)), PAIR)
        found.append(fit.curve.kind)
        w = np.linspace(0.02, 1, 50)
        assert np.abs(fit.curve.force(w) - force(w)).max() < 0.004
        low, high = fit.intervals["k"]
        assert high - low < 0.01
    assert found.count(kind) >= 9


def test_a_repetition_that_is_off_widens_the_interval(tmp_path):
    """An error that a whole repetition shares is not independent from level to level."""
    drift = {"left_1": 1.0, "left_2": 1.05, "left_3": 0.95}
    rows = ["%g,%s" % (w, ",".join("%g" % (0.1 * w * d) for d in drift.values())) for w in LEVELS]
    path = tmp_path / "bench.csv"
    path.write_text("\n".join(["input," + ",".join(drift)] + rows) + "\n")
    low, high = thrust_bench.fit(bench_forces.read([str(path)], BenchFormat(PAIR)), PAIR).intervals["k"]
    # of a mean of three with a standard deviation of 5%
    assert high - low == pytest.approx(2 * 4.3 * 0.1 * 0.05 / 3**0.5, rel=0.02)


def test_thrusters_of_a_list_get_gains_and_a_table(tmp_path):
    gains = dict(zip(FOUR, (1.2, 1.0, 0.8, 1.0)))
    path = tmp_path / "bench.csv"
    random = np.random.default_rng(3)
    lines = ["input," + ",".join("%s_%d" % (n, i) for n in FOUR for i in (1, 2, 3))]
    for pwm in range(1100, 1301, 10):
        w = (pwm - 1000) / 1000
        force = 0.37 * max(0, w - 0.09) + 0.3 * max(0, w - 0.09) ** 2
        values = [gains[n] * force + 5e-4 * random.normal() for n in FOUR for _ in range(3)]
        lines.append(",".join(["%d" % pwm] + ["%.6f" % v for v in values]))
    path.write_text("\n".join(lines) + "\n")
    out = tmp_path / "bench.yaml"
    craft = ROOT / "cfg" / "hovercraft" / "four_thrusters.yaml"
    report = json_of("bench", path, "--model", craft, "--inputs", 1000, 2000, "-o", out)
    assert report["curve"] == "polynomial" and report["largest_input"] == pytest.approx(0.3)
    model = _core.load_model(str(out))
    for thruster in model.thrusters:
        assert thruster["gain"] == pytest.approx(gains[thruster["name"]], abs=0.02)
        assert thruster["range"] == (0.0, pytest.approx(0.3))
    forces = model.forces(np.array([[0.2, 0, 0, 0], [0, 0, 0.3, 0], [0.05, 0, 0, 0]]))[:, 0]
    true = 0.37 * np.array([0.11, 0.21]) + 0.3 * np.array([0.11, 0.21]) ** 2
    assert model.value("k") * forces[:2] == pytest.approx([1.2 * true[0], -0.8 * true[1]], rel=0.03)
    assert forces[2] == 0


def test_a_pair_with_a_dead_band_lists_its_thrusters(tmp_path):
    path = table(tmp_path / "bench.csv", lambda side, w: 0.1 * max(0, w - 0.2) / 0.8, repeat=3)
    report, model = fitted(tmp_path, path)
    assert report["curve"] == "polynomial" and not model.is_pair
    assert [one["name"] for one in model.thrusters] == PAIR
    assert model.value("l") == pytest.approx(_core.load_model(str(MODEL)).value("l"))
    wrench = model.value("k") * model.forces(np.array([[0.6, 0.6], [0.1, 0.1], [1.0, 0.0]]))
    assert wrench[:, 0] == pytest.approx([0.1, 0, 0.1], abs=0.003)
    assert wrench[2, 2] == pytest.approx(0.1, abs=0.003)  # over l


@pytest.mark.parametrize(
    "options, message",
    [
        (["--thrusters", "front"], "no thruster is called front"),
        (["--thrusters", "3"], "no thruster is called 3"),
        (["--curve", "polynomial"], "a polynomial needs more inputs"),
        (["--model", ROOT / "cfg" / "hovercraft" / "mvwt.yaml", "--curve", "polynomial"], "inputs up to 4.5"),
    ],
)
def test_a_bad_option_is_refused(tmp_path, options, message):
    path = tmp_path / "bench.csv"
    rows = [(0.25, 0.01), (0.5, 0.03), (0.75, 0.06), (1, 0.1)]
    rows = rows[::3] if options == ["--curve", "polynomial"] else rows
    path.write_text("input,left\n" + "".join("%g,%g\n" % row for row in rows))
    model = [] if "--model" in options else ["--model", MODEL]
    refused = identify("bench", path, *model, *options, "-o", tmp_path / "thrust.yaml")
    assert refused.returncode == 1
    assert message in refused.stderr and "Traceback" not in refused.stderr
    assert not (tmp_path / "thrust.yaml").exists()


VALVES = ROOT / "cfg" / "craft" / "air_table.yaml"


def switches(path, rows=("1",), repeat=6, seed=1, gain=None):
    """Writes a bench of eight on/off valves of 0.4 N, in grams; rows: inputs, of which each but the last is
    computed from it."""
    random = np.random.default_rng(seed)
    names = [one["name"] for one in _core.load_model(str(VALVES)).thrusters]
    gain = gain or dict.fromkeys(names, 1.0)
    full = [round(40 * gain[n] * (1 + 0.01 * random.normal()), 1) for n in names for _ in range(repeat)]
    lines = ["input," + ",".join("%s_%d" % (n, i + 1) for n in names for i in range(repeat))]
    lines += ["0" + ",0" * len(full)]
    for row in rows:
        lines.append(row + "," + ",".join("%.6g" % (float(row) * value) for value in full))
    path.write_text("\n".join(lines) + "\n")
    return path, names


def test_valves_get_gains_and_keep_their_curve(tmp_path):
    names = [one["name"] for one in _core.load_model(str(VALVES)).thrusters]
    gain = dict(zip(names, (1.05, 0.95, 1.0, 1.0, 1.1, 0.9, 1.0, 1.0)))
    path, _ = switches(tmp_path / "bench.csv", gain=gain)
    out = tmp_path / "bench.yaml"
    report = json_of("bench", path, "--model", VALVES, "--unit", "g", "-o", out)
    assert report["curve"] == "switch" and report["rejected"] == []
    low, high = report["parameters"]["k"]["ci95"]
    assert low < 40 * 9.80665e-3 < high and high - low < 0.02
    held = [report["parameters"][n]["ci95"][0] < gain[n] < report["parameters"][n]["ci95"][1] for n in names]
    assert sum(held) >= 6
    before, after = (_core.load_model(str(p)).format() for p in (VALVES, out))
    assert before.count("curve") == after.count("curve")


def test_a_row_that_was_computed_is_left_out_and_named(tmp_path):
    path, _ = switches(tmp_path / "bench.csv", ("0.5", "1"))
    out = tmp_path / "bench.yaml"
    result = identify("bench", path, "--model", VALVES, "--unit", "g", "-o", out, "--json")
    assert result.returncode == 0 and json.loads(result.stdout)["curve"] == "switch"
    assert "line 3 is left out: its forces equal line 4 times 0.5" in result.stderr


def test_measured_rows_are_never_taken_for_computed_ones(tmp_path):
    random = np.random.default_rng(2)
    columns = [(1.0, 0.0)] * 3 + [(0.0, 1.0)] * 3
    for _ in range(200):
        rows = [
            (line, [level, *(round(50 * level * (1 + 0.005 * random.normal()), 1) for _ in columns)])
            for line, level in enumerate((0.25, 0.5, 0.75, 1.0))
        ]
        assert bench_forces.without_copies("bench.csv", rows, columns) == (rows, [])


def log(
    path, thruster=0, names=("t_s", "weight_g", "bitmask"), on=None, force=45.0, lag=0.25, late=0.0, seed=1
):
    """Writes a log of a load cell at 50 Hz: ten pulses of 3 s, which the scale follows with a lag. late: how
    much later a valve closes than it opens [s]."""
    random = np.random.default_rng(seed)
    times = np.arange(0, 62, 0.02)
    command = ((times % 6) >= 3) & (times < 60)
    delayed = np.interp(times - 0.04, times, command) > 0.5
    for shift in np.arange(0, late + 0.01, 0.02):
        delayed |= np.interp(times - 0.04 - shift, times, command) > 0.5
    shown, rows = 0.0, []
    for time, is_on, pushes in zip(times, command, delayed):
        shown += 0.02 / lag * (force * pushes - shown)
        value = (1 << thruster if on is None else on) if is_on else 0
        rows.append("%.2f,%.2f,%g" % (time, 2.0 + shown + 0.05 * random.normal(), value))
    path.write_text(",".join(names) + "\n" + "\n".join(rows) + "\n")
    return path


def test_logs_of_a_load_cell_are_read_pulse_by_pulse(tmp_path):
    names = [one["name"] for one in _core.load_model(str(VALVES)).thrusters]
    logs = [
        log(tmp_path / ("log_%s.csv" % name), i, force=45.0 + i, seed=i, late=0.06)
        for i, name in enumerate(names)
    ]
    out = tmp_path / "bench.yaml"
    report = json_of("bench", *logs, "--model", VALVES, "-o", out, "--details")
    assert report["curve"] == "switch"
    mean = 45.0 + np.arange(8).mean()
    assert report["parameters"]["k"]["value"] == pytest.approx(mean * 9.80665e-3, rel=0.002)
    for i, name in enumerate(names):
        assert report["parameters"][name]["value"] == pytest.approx((45.0 + i) / mean, abs=0.003)
    timing = report["timing"]
    low, high = timing["longer_ci95"]
    assert low < 0.06 < high and high - low < 0.05
    assert timing["rise"][1] == pytest.approx(0.04 + 0.25 * np.log(2), abs=0.03)
    text = identify("bench", *logs, "--model", VALVES, "-o", out, "--details", "--force").stdout
    assert "80 pulses in 8 logs" in text and "closing is slower" in text


def test_a_log_of_one_thruster_with_its_command_and_unit(tmp_path):
    path = log(tmp_path / "left-1.csv", names=("time [s]", "force [mN]", "pwm_us"), on=1000, force=300.0)
    path.write_text(path.read_text().replace(",1000\n", ",2000\n").replace(",0\n", ",1000\n"))
    report, model = fitted(tmp_path, path, "--inputs", 1000, 2000)
    assert model.value("k") == pytest.approx(0.3, rel=0.005)


@pytest.mark.parametrize(
    "names, name, options, message",
    [
        (
            ("t", "force", "bitmask"),
            "log.csv",
            [],
            "the unit of column force is not known; give it with --unit",
        ),
        (("t", "a_g", "b"), "log.csv", [], "--log-columns TIME FORCE COMMAND"),
        (("t", "weight_g", "pwm"), "log.csv", [], "its thruster is not known"),
        (("t", "weight_g", "bitmask"), "right.csv", [], "named after right, but its bits say left"),
        (
            ("t", "a_g", "b"),
            "left.csv",
            ["--log-columns", "t", "a_g", "c"],
            "no column of numbers is named c",
        ),
    ],
)
def test_a_log_that_is_not_clear_says_what_is_missing(tmp_path, names, name, options, message):
    path = log(tmp_path / name, names=names)
    refused = identify("bench", path, "--model", MODEL, "-o", tmp_path / "out.yaml", *options)
    assert refused.returncode == 1 and message in refused.stderr and refused.stderr.count("\n") == 1


def test_pulses_too_short_for_the_scale_are_refused(tmp_path):
    path = log(tmp_path / "log.csv", lag=20.0)
    refused = identify("bench", path, "--model", MODEL, "-o", tmp_path / "out.yaml")
    assert refused.returncode == 1 and "held until the force is steady" in refused.stderr


def test_mass_and_inertia_follow_from_motion_with_the_bench(tmp_path):
    """The model is told a wrong mass; the valves act 60 ms late."""
    true, run, path = ground.Model.load(VALVES), tmp_path / "run.bag", tmp_path / "bench.csv"
    mass, inertia = true["m"], true["I_z"]
    wrong = true.with_values({"m": 0.7 * mass, "I_z": 1.3 * inertia}).save(tmp_path / "wrong.yaml").path
    craft = true.with_effect("input_delay", delay=0.06).save(tmp_path / "true.yaml").path
    succeeds("simulate", "--model", craft, "--input", "prbs", "--duration", 40, "--seed", 3, "-o", run)
    columns = ["%s_%d" % (one["name"], i) for one in true.core.thrusters for i in range(1, 5)]
    random = np.random.default_rng(1)
    forces = ["%.5f" % (true["k"] * (1 + 0.01 * random.normal())) for _ in columns]
    path.write_text("input,%s\n1,%s\n" % (",".join(columns), ",".join(forces)))
    out = tmp_path / "out.yaml"
    motion = json_of("bench", path, "--model", wrong, "-o", out, "--runs", run)["mass"]
    for name, value in (("m", mass), ("I_z", inertia)):
        low, high = motion["parameters"][name]["ci95"]
        assert low < value < high and high - low < 0.2 * value
    assert motion["delay"]["effect"] == "input_delay"
    assert motion["delay"]["value"] == pytest.approx(0.06, abs=0.005)
    low, high = motion["ratio"]["ci95"]
    assert low < 0.7 < high  # what the wrong mass makes of the thrust


@slow
def test_the_real_bench_rejects_a_power_and_motion_tells_what_was_weighed(tmp_path):
    """The bench of the second craft, and its runs."""
    if not REAL_BENCH.is_file():
        pytest.skip("the real measurements of December 2019 are not beside the workspace")
    out = tmp_path / "bench.yaml"
    result = succeeds(
        *("bench", REAL_BENCH, "--inputs", 1000, 2000, "--unit", "g", "--thrusters", 2),
        *("--model", ROOT / "cfg" / "hovercraft" / "four_thrusters.yaml", "-o", out, "--json"),
        *("--runs", REAL_BENCH.parent, "--mapping", ROOT / "cfg" / "mapping" / "four_thrusters.yaml"),
    )
    report, model = json.loads(result.stdout), _core.load_model(str(out))
    assert report["curve"] == "polynomial"
    assert {"power", "proportional force"} <= {one["curve"] for one in report["rejected"]}
    assert report["residual"] < 1.1 * report["scatter"]
    measured = np.array([[1100, 1.47], [1200, 8.2], [1300, 16.63]])  # PWM, mean of three [g]
    inputs = np.zeros((3, 4))
    inputs[:, 0] = (measured[:, 0] - 1000) / 1000
    force = model.value("k") * model.forces(inputs)[:, 0]
    assert 2 * force / 9.80665e-3 == pytest.approx(measured[:, 1], abs=0.4)
    low, high = report["motion"]["parameters"]["k"]["ci95"]
    assert 0.03 < low < high < report["parameters"]["k"]["ci95"][0]
    low, high = report["mass"]["parameters"]["m"]["ci95"]
    assert low < 0.1763 < high and high - low < 0.03  # [kg]


def test_intervals_of_positive_quantities_stay_positive():
    """Not even a thrust that motion hardly determines may be negative."""
    from ground.fitting import bench_motion

    k, bench = bench_motion.WithInterval(0.06, -0.01, 0.2), bench_motion.WithInterval(0.05, 0.045, 0.055)
    motion = bench_motion.MassByMotion(k, k, k, (0.06, 1e-4), bench, None, 1.0, True)
    value, low, high = motion.ratio
    assert value == pytest.approx(1.2) and low == 0 and high > 0.2 / 0.055
    sure = bench_motion.WithInterval(0.06, 0.057, 0.063)
    sure = bench_motion.MassByMotion(sure, k, k, (0.06, 1e-4), bench, None, 1.0, True).ratio
    assert sure[0] - sure[1] == pytest.approx(1.2 * math.hypot(0.05, 0.1), rel=0.1)
