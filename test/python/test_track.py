"""Controllers in closed loop with the simulated craft."""

import json
import re

import numpy as np
import pytest

import ground
from conftest import MODEL, ROOT, program, succeeds

TABLE_4_1 = ROOT / "cfg" / "hovercraft" / "tiny_whoover_4_1.yaml"
MVWT = ROOT / "cfg" / "hovercraft" / "mvwt.yaml"
GAINS = ROOT / "cfg" / "gains"
STARTS = 2

# 5, 50 and 95% quantiles of the RMS error [m] of the Tiny Whoover with the thesis's gains.
THESIS = {("4_11", "circle"): (0.36, 0.44, 0.52), ("4_12", "circle"): (0.32, 0.43, 0.56)}
# kind: settings, bounds of the RMS error [m]: nominal, with noise and delay, with a wrong model.
PREDICTIVE = {"circle": (dict(rate_of_turn=0.63), 0.5e-3, 5e-3, 5e-3), "rhodonea": ({}, 0.5e-3, 5e-3, 5e-3)}
# A hidden effect, so strong that a model without it tracks badly (`make bench-tracking` has more).
HIDDEN = {"floor_tilt": {"sx": 0.02, "sy": -0.015}}


def track(*arguments):
    result = program("track", "--json", *arguments)
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)


def medians(controller, truth, believed, task, starts, conditions=None, max_error=0.0):
    from ground.simulation import tracking

    runs = tracking.many(truth, believed, controller, task, starts, conditions, max_error=max_error)
    return tracking.pooled(runs)


def load(path):
    from ground import _core

    return _core.load_model(str(path))


def test_the_mvwt_tracks_as_in_the_thesis():
    common = ["--model", MVWT, "--gains", GAINS / "thesis_4_10.yaml"]
    circle = ["--size", 1.5, "--rate-of-turn", 0.3, "--settled", 60, "--end-time", 100]
    found = track(*common, *circle)
    assert found["rms"] == pytest.approx(11.588e-3, abs=0.01e-3)
    assert found["max"] == pytest.approx(11.588e-3, abs=0.01e-3)
    assert found["saturated_fraction"] == 0
    wave = ["--reference", "sinusoid", "--speed", 0.3, "--settled", 40, "--end-time", 100]
    found = track(*common, *wave, "--rate-of-turn", 0.3)
    assert found["rms"] == pytest.approx(12.0e-3, abs=0.3e-3)
    assert found["caution"] is None


@pytest.mark.parametrize("gains, kind", THESIS)
def test_the_small_craft_tracks_as_in_the_thesis(gains, kind):
    from ground.simulation import gains as files
    from ground.simulation import tracking

    model = load(TABLE_4_1)
    controller = files.choice("TrajectoryTracking", str(GAINS / ("thesis_%s.yaml" % gains)))
    found = medians(controller, model, model, tracking.task(kind), tracking.starts(41, 7), max_error=np.inf)
    low, _, high = THESIS[gains, kind]
    assert low < found["rms_quantiles"]["median"] < high
    assert found["saturated_fraction"] > 0.95


@pytest.mark.parametrize("kind", PREDICTIVE)
def test_the_predictive_controller_tracks(kind):
    from ground.simulation import gains, tracking, tuning

    settings, nominal, noise, wrong = PREDICTIVE[kind]
    model, controller = load(TABLE_4_1), gains.choice("ModelPredictive")
    task, starts = tracking.task(kind, until=45.0, **settings), tracking.starts(STARTS, 3)
    found = medians(controller, model, model, task, starts)
    assert found["rms"] < nominal
    rough = tracking.Conditions(noise=True, delay=0.02)
    assert medians(controller, model, model, task, starts, rough)["rms"] < noise
    truth = tracking.perturbed(model, tuning.MODEL_ERROR)
    assert medians(controller, truth, model, task, starts)["rms"] < wrong


@pytest.mark.parametrize("smooth", [False, True])
def test_the_predictive_controller_stops_at_the_end_of_a_line(smooth):
    from ground.simulation import gains, tracking

    task, model = tracking.task("line", smooth=smooth), load(MODEL)
    task.until = task.reference.extent() + tracking.AFTER_STOP + 1
    found = medians(gains.choice("ModelPredictive"), model, model, task, tracking.starts(STARTS, 3))
    assert found["after_stop_max"] < 10e-3


@pytest.mark.parametrize("effect", HIDDEN)
def test_a_better_model_tracks_better(effect, tmp_path):
    """Hides an effect, fits the model with and without it to PRBS runs, and tracks with both."""
    truth = load(MODEL)
    truth.add_effect(effect)
    for name, value in HIDDEN[effect].items():
        truth.set_value("%s.%s" % (effect, name), value)
    sealed = tmp_path / "sealed.yaml"
    sealed.write_text(truth.format())
    bags = []
    for seed in (1, 2):
        bags.append(tmp_path / ("%d.bag" % seed))
        drive = ["--input", "prbs", "--duration", 12, "--seed", seed, "--start-pose", 0, 0, seed]
        succeeds("simulate", "--model", sealed, *drive, "-o", bags[-1])
    fitted, improved = tmp_path / "fitted.yaml", tmp_path / "improved.yaml"
    succeeds("fit", *bags, "--model", MODEL, "-o", fitted)
    succeeds("add", effect, *bags, "--model", fitted, "-o", improved)
    errors = {}
    for name, model in (("before", fitted), ("after", improved)):
        found = [
            track("--controller", "ModelPredictive", "--model", model, "--truth", sealed, *where)
            for where in (["--reference", "circle"], ["--reference", "rhodonea"])
        ]
        errors[name] = sum(f["rms"] for f in found)
    print("%s: %.3f mm, then %.3f mm" % (effect, 1e3 * errors["before"], 1e3 * errors["after"]))
    assert errors["after"] <= 0.5 * errors["before"]


def test_output_and_picture(tmp_path):
    picture = tmp_path / "track.html"
    loop = ["--model", MODEL, "--controller", "ModelPredictive", "--end-time", 25, "--starts", 2]
    found = track(*loop, "--noise", "--delay", 0.02, "--seed", 4, "--picture", picture)
    assert picture.stat().st_size > 20000
    assert set(found["compute_ms"]) == {"median", "p999", "max"}
    assert 0 < found["rms"] <= found["max"] < 0.1
    assert 0 <= found["saturated_fraction"] <= 1 and found["effort"] > 0
    again = track(*loop, "--noise", "--delay", 0.02, "--seed", 4)
    assert again["rms"] == found["rms"]
    other = track(*loop, "--noise", "--delay", 0.02, "--seed", 5)
    assert other["rms"] != found["rms"]
    text = program("track", *loop, "--picture", picture)
    assert text.returncode == 1 and "exists" in text.stderr


# The README's fit to all three recordings of the real craft, as factors on tiny_whoover.yaml.
REAL = ["I_z=1.182", "X_u=2.091", "Y_v=1.587", "N_r=0.0476", "k=1.229"]


def test_a_craft_that_loses_the_circle_is_stopped_with_time_and_reason(tmp_path):
    from ground.simulation import tracking

    factors = {name: float(f) for name, f in (text.split("=") for text in REAL)}
    real = tmp_path / "real.yaml"
    real.write_text(tracking.perturbed(load(MODEL), factors).format())
    loop = ["--model", real, "--noise", "--gains", GAINS / "tiny_whoover.yaml"]
    result = program("track", *loop)
    assert result.returncode == 1
    message = r"stopped: at \d+\.\d\d s: \d\.\d\d m from the reference .*max_error 0.5 m"
    assert re.search(message, result.stderr), result.stderr
    found = track(*loop, "--max-error", "inf", "--settled", 5)
    assert found["max"] > 1 and found["stops"] == []
    found = track("--model", real, "--noise", "--controller", "ModelPredictive")
    assert found["rms"] < 0.005 and found["max_error"] == 0.5 and found["stopped"] == 0


def test_a_reference_that_is_too_fast_is_named_before_the_gains(craft):
    gains = GAINS / "tiny_whoover.yaml"
    found = ground.track(craft, gains=gains, rate_of_turn=5.0)
    told = dict(found.headline())
    assert found.stopped and told["Next"].startswith("choose an easier reference")
    assert found.caution in told["Next"] and "gains" not in told["Next"]
    assert "not finite" not in told["Distance"] and "1 of 1" in told["Distance"]


def test_effects_that_the_controller_does_not_use_are_reported_or_refused():
    tilted = ROOT / "test" / "rostest" / "tilted_craft.yaml"
    short = ["--model", tilted, "--end-time", 5, "--settled", 0]
    result = program("track", *short)
    assert result.returncode == 0 and "does not use floor_tilt" in result.stdout
    found = track(*short, "--controller", "ModelPredictive")
    assert found["effects"] == {"used": ["floor_tilt"], "unused": []}
    result = program("track", "--model", ROOT / "test" / "rostest" / "delayed_craft.yaml")
    assert result.returncode == 1 and result.stderr.count("\n") == 1
    assert "does not use input_delay (commands are late by 0.08 s" in result.stderr


def test_a_reference_from_a_file(tmp_path):
    way = tmp_path / "way.csv"
    way.write_text("x,y\n0,0\n1,0.2\n1.8,1\n1.2,2\n0,2.1\n")
    loop = ["--model", MODEL, "--controller", "ModelPredictive", "--reference", way]
    found = track(*loop, "--speed", 0.3, "--smooth")
    assert found["rms"] < 0.05
    assert found["window"][1] > 8
    slower = track(*loop, "--speed", 0.15, "--smooth")
    assert slower["window"][1] > 1.5 * found["window"][1]


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["--reference", "spiral"], "must be one of circle, line"),
        (["--speed", "1"], "circle has no parameter 'speed'; it has x, y, size, rate_of_turn"),
        (["--reference", "line", "--size", "1"], "line has no parameter 'size'"),
        (["--reference", "missing.csv"], "missing.csv: cannot be read"),
        (["--gains", "missing.yaml"], "missing.yaml"),
        (["--perturb", "q=2"], "no parameter 'q'"),
        (["--size", "-1"], "size must be between"),
        (["--rate-of-turn", "0"], "rate other than 0"),
        (["--perturb", "k"], "NAME=FACTOR"),
        (["--rate", "1"], "between 10 and 500"),
        (["--max-error", "0"], "not positive"),
    ],
)
def test_bad_input_is_refused(arguments, message):
    result = program("track", "--model", MODEL, *arguments)
    assert result.returncode in (1, 2)
    assert message in result.stderr


def test_bad_gains_are_refused(tmp_path):
    for text, message in (
        ("k_e: 1\nk_q: 2\n", "no parameter 'k_q'"),
        ("k_e: fast\n", "not a finite number"),
        ("- 1\n", "NAME: NUMBER"),
        ("k_e: -1\n", "k_e must be between 1e-06 and 100 kg/s, not -1"),
    ):
        path = tmp_path / "gains.yaml"
        path.write_text(text)
        result = program("track", "--model", MODEL, "--gains", path)
        assert result.returncode == 1 and message in result.stderr, result.stderr
