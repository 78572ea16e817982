"""identify compare as a user runs it: does it point at the hidden effect of a run?"""

import json

import numpy as np
import pytest

from conftest import MODEL, identify, slow, succeeds, write_bag


def model_with(path, effects):
    """Writes the Tiny Whoover's model with effects, given as a line of YAML each."""
    lines = "".join("  - %s\n" % e for e in effects)
    path.write_text(MODEL.read_text().replace("effects: []", "effects:\n" + lines))
    return path


def hidden(tmp_path, *effects, noise=1.0, seed=7):
    """A change for write_bag: the craft has effects that the nominal model does not have."""
    from ground import _core

    truth = _core.load_model(str(model_with(tmp_path / "truth.yaml", effects)))

    def change(times, eta, inputs):
        random = np.random.default_rng(seed)
        run = _core.simulate(truth, inputs, times, np.zeros(3), np.zeros(3))
        eta = run["eta"] + noise * random.normal(0, [3e-4, 3e-4, 5e-3], (len(times), 3))
        eta[:, 2] = np.angle(np.exp(1j * eta[:, 2]))
        return times, eta, inputs

    return change


def compare(folder, bags, *models, options=("--numbers", "--details")):
    """Runs compare and returns its JSON, with its printed text under "words"."""
    arguments = [a for m in models for a in ("--model", m)]
    result = succeeds("compare", *bags, *arguments, "-o", folder, *options)
    assert "Traceback" not in result.stderr

    def refuse(word):
        raise AssertionError("%s is not valid in JSON" % word)

    report = json.loads((folder / "compare.json").read_text(), parse_constant=refuse)
    report["words"] = result.stdout
    return report


def study(tmp_path, *effects, duration=15, **options):
    """Numbers of the nominal model on one run of a craft with hidden effects."""
    change = hidden(tmp_path, *effects, **options)
    bag = write_bag(tmp_path / "run.bag", duration=duration, change=change)
    report = compare(tmp_path / "out", [bag], MODEL)
    one = report["runs"][0]["models"]["tiny_whoover"]
    one["words"] = report["words"]
    return one


def test_a_true_model_leaves_nothing(tmp_path):
    bags = [write_bag(tmp_path / ("%d.bag" % s), seed=s, duration=15) for s in (1, 2, 3)]
    report = compare(tmp_path / "out", bags, MODEL)
    outside = lags = 0
    for run in report["runs"]:
        one = run["models"]["tiny_whoover"]
        assert one["residuals"]["white"], run["name"]
        for channel in one["residuals"]["channels"].values():
            for kind in ("autocorrelation", "input_sum", "input_difference"):
                outside += channel[kind]["outside"]
                lags += channel[kind]["lags"]
            assert channel["input_sum"]["accepted"] and channel["input_difference"]["accepted"]
        for channel in one["wrench"]["channels"].values():
            assert channel["rms"] < 0.01 * channel["full_scale"]
        assert one["wrench"]["disturbances"] == []
        assert 0.9 < one["wrench"]["noise"]["position"]["value"] / 3e-4 < 1.3
        assert one["fit_percent"]["u"] > 90
    assert outside / lags < 0.03, "%d of %d outside the 99%% bands" % (outside, lags)
    assert "smaller than their uncertainty" in report["words"]


def test_the_horizon_errors_are_those_of_an_independent_simulation(tmp_path):
    """The heading error by a missing yaw moment equals the closed form."""
    one = study(tmp_path, "{name: yaw_bias, n0: 1.0e-4}")
    inertia, damping = 8.8e-5, 4.62e-5
    for horizon in one["horizons"][3:5]:
        t, rate = horizon["seconds"], damping / inertia
        turned = 1e-4 / damping * (t - (1 - np.exp(-rate * t)) / rate)
        assert horizon["heading_deg"] == pytest.approx(np.degrees(turned), rel=0.1)


def test_lag_leaves_residuals_that_follow_the_input(tmp_path):
    one = study(tmp_path, "{name: motor_lag, tau: 0.15}")
    assert not one["residuals"]["white"]
    heading = one["residuals"]["channels"]["heading"]
    assert not heading["autocorrelation"]["accepted"]
    assert not heading["input_difference"]["accepted"]
    assert "in heading follows the command u_L" in one["words"]


def test_a_push_is_left_out_and_reported(tmp_path):
    change = hidden(tmp_path, "{name: differential_side_force, c: 0.5}")

    def pushed(times, eta, inputs):
        times, eta, inputs = change(times, eta, inputs)
        eta[:, 0] += 0.15 * np.clip((times - 9) / 0.06, 0, 1)  # 2.5 m/s for 60 ms
        return times, eta, inputs

    bag = write_bag(tmp_path / "run.bag", duration=15, change=pushed)
    report = compare(tmp_path / "out", [bag], MODEL, options=["--all", "--numbers", "--details"])
    one = report["runs"][0]["models"]["tiny_whoover"]
    (event,) = one["wrench"]["disturbances"]
    assert event["start"] < 9 < event["end"] and event["end"] - event["start"] < 2.5
    assert "no input explains" in report["words"]


def test_fitted_and_held_out_runs_are_pooled_separately(tmp_path):
    change = hidden(tmp_path, "{name: quadratic_drag, cx: 0.03, cy: 0.03, cr: 0.0}")
    bags = [write_bag(tmp_path / ("%d.bag" % s), seed=s, duration=10, change=change) for s in (1, 2, 3)]
    fitted = tmp_path / "fitted.yaml"
    succeeds("fit", *bags[:2], "--model", MODEL, "-o", fitted)
    report = compare(tmp_path / "out", bags, MODEL, fitted)
    roles = [run["models"]["fitted"]["role"] for run in report["runs"]]
    assert roles == ["fit", "fit", "held_out"]
    assert {run["models"]["tiny_whoover"]["role"] for run in report["runs"]} == {"held_out"}
    errors = [run["models"]["fitted"]["error"] for run in report["runs"]]
    pooled = report["pooled"]["fitted"]
    assert pooled["fit"]["error"] == pytest.approx(np.mean(errors[:2]), rel=0.05)
    assert pooled["held_out"]["error"] == pytest.approx(errors[2], rel=1e-9)
    assert report["pooled"]["tiny_whoover"]["fit"] is None
    assert pooled["all"]["error"] < report["pooled"]["tiny_whoover"]["all"]["error"]
    assert "held out" in report["words"] and "fit" in report["words"]


def test_files(tmp_path):
    bag = write_bag(tmp_path / "run.bag", duration=6)
    out = tmp_path / "out"
    other = model_with(tmp_path / "other.yaml", ["{name: yaw_bias, n0: 0.0}"])
    report = compare(out, [bag], MODEL, other, options=())
    names = {p.name for p in out.iterdir()}
    wrenches = {"run.wrench.%s.csv" % name for name in ("tiny_whoover", "other")}
    assert names == {"compare.json", "report.html"} | wrenches
    series = np.genfromtxt(out / "run.wrench.other.csv", delimiter=",", names=True)
    assert len(series) > 500 and np.isfinite(series.view(float)).all()
    assert report["schema"] == "ground/compare/1"

    plain = tmp_path / "plain"
    numbers = compare(plain, [bag], MODEL, other)
    assert {p.name for p in plain.iterdir()} == {n for n in names if n[-4:] in ("json", ".csv")}
    assert numbers["pooled"] == report["pooled"]

    before = {p: p.read_bytes() for p in out.iterdir()}
    again = identify("compare", bag, "--model", MODEL, "-o", out)
    assert again.returncode == 1 and "exists" in again.stderr and "--force" in again.stderr
    assert {p: p.read_bytes() for p in out.iterdir()} == before


def test_bad_input_is_refused_with_one_sentence(tmp_path):
    bag = write_bag(tmp_path / "run.bag", duration=6)
    bad = tmp_path / "bad.yaml"
    bad.write_text(MODEL.read_text().replace("effects: []", "effects: []\nwheels: 4"))
    occupied = tmp_path / "occupied"
    occupied.write_text("a file")
    out = tmp_path / "out"
    stiff = tmp_path / "stiff.yaml"
    stiff.write_text(MODEL.read_text().replace("4.62e-5", "1e300").replace("8.8e-5", "1e-300"))
    for arguments, words in (
        ((bag, "--model", bad, "-o", out), ["bad.yaml", "wheels"]),
        ((bag, "--model", MODEL, "--model", MODEL, "-o", out), ["model", "twice"]),
        ((bag, "--model", MODEL, "-o", occupied), ["occupied", "folder"]),
        ((bag, "--model", stiff, "-o", out), ["stiff", "not finite"]),
    ):
        result = identify("compare", *arguments)
        assert result.returncode == 1, (arguments, result.stdout)
        errors = [line for line in result.stderr.splitlines() if not line.startswith("warning:")]
        assert len(errors) == 1, result.stderr
        for word in words:
            assert word in result.stderr, result.stderr
        assert not list(out.glob("*"))
    assert occupied.read_text() == "a file"
    for arguments in ((bag, "-o", out), (bag, "--model", MODEL), (bag, "--numbers", "gif")):
        result = identify("compare", *arguments)
        assert result.returncode == 2 and "--help" in result.stderr


@slow
def test_the_two_days_of_the_real_recordings(tmp_path, real_bags):
    fitted = tmp_path / "fitted.yaml"
    second = [b for s, b in real_bags.items() if s.startswith("2019-04-16")]
    succeeds("fit", *second, "--model", MODEL, "-o", fitted)
    report = compare(tmp_path / "out", real_bags.values(), fitted)
    for run in report["runs"]:
        one = run["models"]["fitted"]
        first_day = run["name"].startswith("2019-04-11")
        assert one["role"] == ("held_out" if first_day else "fit")
    pooled = report["pooled"]["fitted"]
    assert pooled["held_out"]["error"] > 2 * pooled["fit"]["error"]


def test_every_verb_has_the_same_error_of_the_same_model():
    import ground

    craft = ground.Model.load(MODEL)
    runs = [
        ground.simulate(craft.with_effect("yaw_bias", n0=2e-5), "prbs", duration=30, seed=s, name=str(s))
        for s in (1, 2)
    ]
    predictor = ground.Predictor(craft, runs)
    fit, compared = ground.fit(craft, runs), ground.compare({"given": craft}, runs)
    diagnosis = ground.diagnose(craft, runs, only=["yaw_bias"])
    for found in (fit.prediction, compared.prediction, diagnosis.contents.prediction):
        assert found.errors["given"] == predictor.error(craft)
    added, alone = ground.add(craft, "yaw_bias", runs), ground.predict(craft, runs[0])
    of_run = compared.runs[0].models[0].numbers["horizons"]
    assert alone.position_mm in [row["position_mm"] for row in of_run]
    assert added.prediction.errors["without"] == fit.prediction.errors["fitted"]


@slow
def test_a_diagnosed_model_knows_its_disturbance_on_other_runs(tmp_path):
    import ground

    craft = ground.Model.load(MODEL)
    truth = craft.with_effect("motor_lag", tau=0.08)

    def flown(seeds, **pushed):
        return [
            ground.simulate(truth, "multilevel-prbs", duration=40, seed=s, name=str(s), **pushed)
            for s in seeds
        ]

    runs, other = (flown(seeds, disturbance=[0.04, 0.5]) for seeds in ((11, 12, 13), (14,)))
    fit = ground.fit(craft, runs)
    found = ground.diagnose(fit.model, runs, only=["motor_lag", "motor_rate"])
    assert found.effects == ("motor_lag",)
    found.save(tmp_path / "diagnosis")
    improved = ground.Model.load(tmp_path / "diagnosis" / "improved.yaml")
    pushes = 0.04 * craft["k"] * np.array([2, 2, craft["l"]])
    assert np.all(abs(np.log(improved.core.disturbance.sigma / pushes)) < np.log(1.5))
    # The search for a missing effect uses the runs of the fit, and only tests on the other run.
    assert "holdout=RECORDINGS" in str(ground.compare({"fitted": fit.model}, other))
    assert "ground.diagnose" not in str(ground.compare({"fitted": fit.model, "improved": improved}, other))
    # The disturbance does not explain a missing effect; a diagnosis of runs without pushes writes none.
    slower = truth.with_values({"motor_lag.tau": 0.25})
    lagging = [ground.simulate(slower, "multilevel-prbs", duration=40, seed=15)]
    assert "ground.diagnose" in str(ground.compare({"improved": improved}, lagging))
    calm = ground.diagnose(craft, flown((16, 17)), only=["motor_lag"])
    assert calm.effects == ("motor_lag",) and calm.improved.core.disturbance.empty()
