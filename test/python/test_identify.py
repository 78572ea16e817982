"""The identification tool as users run it: command line, real files, bad input."""

import json
import re
import subprocess

import numpy as np
import pytest

from conftest import MODEL, fails, identify, json_of, program, simulate_run, slow, succeeds, write_bag

TRUTH = {"I_z": 8.8e-5, "X_u": 0.0055, "Y_v": 0.0271, "N_r": 4.62e-5, "k": 0.062}


@pytest.fixture
def guess(tmp_path):
    path = tmp_path / "guess.yaml"
    path.write_text(
        "schema: ground/model/1\nname: guess\nbody: {m: 0.0583, l: 0.0325, I_z: 2.0e-4, X_u: 0.03,"
        " Y_v: 0.01, N_r: 1.0e-4, k: 0.1, input_max: 1}\neffects: []\n"
    )
    return path


@pytest.fixture
def bag(tmp_path):
    return write_bag(tmp_path / "run.bag")


def write_csv(path, stamps, rows):
    with open(path, "w") as file:
        file.write(
            "%time,field.header.seq,field.header.stamp,field.header.frame_id,"
            "field.point.x,field.point.y,field.point.z\n"
        )
        for i, (stamp, row) in enumerate(zip(stamps, rows)):
            ns = 1555406701000000000 + int(round(1e9 * stamp))
            file.write("%d,%d,%d,,%r,%r,%r\n" % (ns + 200000, i, ns, *map(float, row)))
    return path


def test_import_then_info(tmp_path):
    times, eta, inputs = simulate_run()
    controls = write_csv(tmp_path / "controls.csv", inputs[:, 0], inputs[:, 1:])
    pose = write_csv(tmp_path / "pose.csv", times, eta)
    out = tmp_path / "run.bag"
    succeeds("import", controls, pose, "-o", out)
    info = json_of("info", out)[0]
    assert info["poses"]["count"] == len(times)
    assert info["poses"]["rate"] == pytest.approx(100, abs=0.1)
    assert info["controls"]["count"] == len(inputs)
    assert info["usable"]["duration"] == pytest.approx(inputs[-1, 0], abs=0.02)
    before = out.read_bytes()
    fails(identify("import", controls, pose, "-o", out), "exists", "--force")
    assert out.read_bytes() == before
    succeeds("import", controls, pose, "-o", out, "--force")


def test_fit_finds_the_parameters(tmp_path, bag, guess):
    out = tmp_path / "fitted.yaml"
    fit = json_of("fit", bag, "--model", guess, "-o", out)
    for name, value in TRUTH.items():
        found = fit["parameters"][name]
        tolerance = 0.15 if name == "X_u" else 0.03
        assert found["value"] == pytest.approx(value, rel=tolerance), name
        low, high = found["ci95"]
        assert low < found["value"] < high
    assert fit["error"]["after"] < 0.1 * fit["error"]["before"]
    text = out.read_text()
    assert "run.bag" in text and "confidence_95" in text
    # The written model can be compared at once and is not overwritten.
    fails(identify("fit", bag, "--model", guess, "-o", out), "exists")
    assert out.read_text() == text
    folder = tmp_path / "compare"
    models = ["--model", guess, "--model", out]
    succeeds("compare", bag, *models, "-o", folder, "--json", "--numbers")
    run = json.loads((folder / "compare.json").read_text())["runs"][0]
    assert run["models"]["fitted"]["error"] == pytest.approx(fit["error"]["after"], rel=1e-3)
    assert run["models"]["guess"]["error"] > 5 * run["models"]["fitted"]["error"]
    assert min(run["models"]["fitted"]["fit_percent"].values()) > 90
    fails(identify("compare", bag, "--model", guess, "-o", folder), "exists")


def test_spans_of_runs_are_left_out_or_refused(tmp_path, guess):
    bag, other = (write_bag(tmp_path / ("run%d.bag" % s), seed=s) for s in (1, 20))
    out = tmp_path / "f.yaml"

    def fit(*spans):
        command = ["fit", bag, "--model", guess, "--holdout", other, "-o", out, "--force", "--json"]
        return identify(*command, "--leave-out", *spans)

    whole, part, held = fit("run1=90,95"), fit("run1=2,4"), fit("run20=2,4")
    fitted = [json.loads(one.stdout)["error"] for one in (whole, part, held)]
    assert fitted[1]["after"] != fitted[0]["after"] == fitted[2]["after"]
    assert fitted[2]["holdout"] != fitted[0]["holdout"]
    fails(fit("run2=2,4"), "no run run2")
    for wrong in ("run1=4,2", "run1", "=2,4", "run1=2"):
        refused = fit(wrong)
        assert refused.returncode == 2 and "FROM before TO" in refused.stderr
    history = identify("history", tmp_path, "--model", guess, "-o", tmp_path / "h", "--leave-out", "run1=2,4")
    assert history.returncode == 2 and "whole runs" in history.stderr


def test_fit_reports_agreement_of_runs_and_held_out_errors(tmp_path, guess):
    bags = [write_bag(tmp_path / ("run%d.bag" % s), seed=s) for s in (1, 20, 300)]
    # One run is of another craft with a larger inertia.
    heavy = tmp_path / "heavy.yaml"
    heavy.write_text(MODEL.read_text().replace("I_z: 8.8e-5", "I_z: 1.3e-4"))
    other = write_bag(tmp_path / "other.bag", seed=41, model=heavy)
    out = tmp_path / "f.yaml"
    result = identify("fit", *bags, other, "--model", guess, "-o", out, "--holdout", other, "--json")
    fails(result, "both for the fit and as holdout")
    fit = json_of("fit", *bags, "--model", guess, "-o", out, "--holdout", other)
    assert [r["run"] for r in fit["runs"]] == ["run1", "run20", "run300"]
    for run in fit["runs"]:
        assert run["parameters"]["k"] == pytest.approx(TRUTH["k"], rel=0.05)
        assert run["disagrees_in"] == []
        assert run["heldout_error"] < 0.06
    error = fit["error"]
    assert error["after"] < error["heldout"] < 1.3 * error["after"]
    assert error["heldout"] < 0.1 * error["before"]
    assert error["holdout"]["after"] > 3 * error["heldout"]
    mixed = identify("fit", *bags, other, "--model", guess, "-o", out, "--force", "--json")
    runs = {r["run"]: r for r in json.loads(mixed.stdout)["runs"]}
    assert "I_z" in runs["other"]["disagrees_in"]
    text = identify("fit", *bags, other, "--model", guess, "-o", out, "--force", "--details").stdout
    assert "other disagrees with the others in" in text and "spread" in text


def test_fit_to_poses_is_more_accurate_with_a_true_model(tmp_path, bag, guess):
    off = {}
    for target in ("velocities", "poses"):
        out = tmp_path / (target + ".yaml")
        found = json_of("fit", bag, "--model", guess, "-o", out, "--target", target)["parameters"]
        off[target] = sum(abs(found[n]["value"] / truth - 1) for n, truth in TRUTH.items())
        for name, truth in TRUTH.items():
            limit = 0.01 if target == "poses" else 0.03
            assert found[name]["value"] == pytest.approx(truth, rel=limit), (target, name)
    assert off["poses"] < 0.5 * off["velocities"]


def test_fit_reports_identifiable_combinations(tmp_path):
    # A spin with hardly any thrust identifies its decay rate N_r / I_z only.
    spin = write_bag(tmp_path / "spin.bag", strength=0.02, nu=(0.3, 0, 15))
    arguments = ["fit", spin, "--model", MODEL, "--free", "I_z", "N_r"]
    weak = json_of(*arguments, "-o", tmp_path / "f.yaml")["weak"]
    assert [w["parameters"] for w in weak] == [["I_z", "N_r"]]
    assert weak[0]["known_as"] == "I_z/N_r"
    assert weak[0]["deviation"] < 0.3 * min(weak[0]["deviations"])
    text = identify(*arguments, "-o", tmp_path / "g.yaml").stdout
    assert "I_z and N_r are only known as I_z/N_r" in text


def test_a_closed_pipe_is_no_error(bag):
    command = "rosrun ground identify info --progress off %s | head -n 1" % bag
    result = subprocess.run(command, shell=True, capture_output=True, text=True, timeout=60)
    assert result.stderr == "" and result.stdout.count("\n") == 1


def degrees(times, eta, inputs):
    eta[:, 2] = np.degrees(np.unwrap(eta[:, 2]))
    return times, eta, inputs


def wrapped_degrees(times, eta, inputs):
    eta[:, 2] = np.degrees(eta[:, 2])
    assert np.abs(np.diff(eta[:, 2])).max() > 300
    return times, eta, inputs


def clock_set_back(times, eta, inputs):
    times = times.copy()
    times[300:] -= 1.0
    return times, eta, inputs


def no_stamps(times, eta, inputs):
    return 0 * times, eta, inputs


def microseconds(times, eta, inputs):
    return times, eta, inputs * [1, 1000, 1000, 1000] + [0, 1000, 1000, 1000]


def too_short(times, eta, inputs):
    return times[:40], eta[:40], inputs


def swapped(times, eta, inputs):
    late = np.arange(len(times))
    late[[100, 101]] = 101, 100
    return times[late], eta[late], inputs


def test_fit_and_add_warn_of_reversed_stamps(tmp_path):
    bag = write_bag(tmp_path / "run.bag", change=swapped)
    for verb in (["fit"], ["add", "motor_lag"]):
        done = identify(*verb, bag, "--model", MODEL, "-o", tmp_path / (verb[0] + ".yaml"))
        assert "warning: run: stamps out of order, sorted: 1" in done.stderr


def no_overlap(times, eta, inputs):
    inputs = inputs.copy()
    inputs[:, 0] += 100
    return times, eta, inputs


@pytest.mark.parametrize(
    "change, words",
    [
        (degrees, ["degrees"]),
        (wrapped_degrees, ["degrees"]),
        (clock_set_back, ["jump back by 0.99 s", "301"]),
        (no_stamps, ["all poses have the same stamp"]),
        (microseconds, ["looks like microseconds"]),
        (too_short, ["too short"]),
        (no_overlap, ["do not overlap"]),
    ],
)
def test_bad_recordings_are_refused_with_a_reason(tmp_path, guess, change, words):
    path = write_bag(tmp_path / "bad.bag", change=change)
    out = tmp_path / "fitted.yaml"
    fails(identify("fit", path, "--model", guess, "-o", out), "bad", *words)
    assert not out.exists()


def test_degrees_in_a_bag_are_refused_before_they_are_turned(tmp_path):
    path = write_bag(tmp_path / "bad.bag", change=wrapped_degrees)
    fails(identify("info", path, "--heading-offset", "0.5"), "bad", "degrees", "unit: deg")


def test_bad_files_are_refused_with_a_reason(tmp_path, bag, guess):
    import rosbag
    from std_msgs.msg import Float64

    out = tmp_path / "fitted.yaml"
    no_bag = tmp_path / "text.bag"
    no_bag.write_text("not a bag")
    empty = tmp_path / "empty.bag"
    rosbag.Bag(str(empty), "w").close()
    other = tmp_path / "other.bag"
    with rosbag.Bag(str(other), "w") as file:
        file.write("speed", Float64(1.0))
    fails(identify("info", tmp_path / "none.bag"), "none.bag", "no such file")
    fails(identify("info", no_bag), "text.bag", "neither a bag")
    fails(identify("info", empty), "empty.bag", "no poses")
    fails(identify("info", other), "no poses", "speed (std_msgs/Float64)")
    silent = tmp_path / "silent.bag"
    with rosbag.Bag(str(bag)) as source, rosbag.Bag(str(silent), "w") as file:
        for topic, message, stamp in source.read_messages("pose"):
            file.write(topic, message, stamp)
    fails(identify("fit", silent, "--model", guess, "-o", out), "silent.bag", "no controls")
    bad = tmp_path / "bad.yaml"
    bad.write_text(guess.read_text().replace("k: 0.1", "k: 0.1, kk: 2"))
    fails(identify("fit", bag, "--model", bad, "-o", out), "bad.yaml, line 3", "unknown key 'kk'")
    wild = tmp_path / "wild.yaml"
    wild.write_text(guess.read_text().replace("2.0e-4", "1e-300").replace("1.0e-4", "1e300"))
    fails(identify("fit", bag, "--model", wild, "-o", out), "not finite in run")
    fails(identify("fit", bag, "--model", guess, "-o", out, "--free", "K"), "no parameter 'K'")
    fails(
        identify("fit", bag, "--model", guess, "-o", out, "--free", "m", "k", "I_z"), "payload of known mass"
    )
    fails(identify("fit", bag, "--model", guess, "-o", tmp_path / "no" / "f.yaml"), "no folder")
    fails(identify("fit", bag, bag, "--model", guess, "-o", out), "twice")
    fails(identify("fit", bag, "--model", guess, "-o", out, "--from", "100"), "only 0 poses", "--all")
    fails(identify("info", bag, "--axes", "x,y"), "--axes")
    assert not out.exists()


def test_a_folder_stands_for_the_bags_in_it(tmp_path, guess):
    folder = tmp_path / "runs [1]"
    folder.mkdir()
    fails(identify("info", folder), "runs [1]: this folder contains no bag")
    for seed in (1, 2):
        write_bag(folder / ("run%d.bag" % seed), seed=seed)
    (folder / "notes.txt").write_text("no bag")
    assert [run["name"] for run in json_of("info", folder)] == ["run1", "run2"]
    by_day = tmp_path / "lab" / "craft_1" / "2026-03-05"
    by_day.parent.mkdir(parents=True)
    by_day.symlink_to(folder)
    assert [run["name"] for run in json_of("info", tmp_path / "lab")] == ["run1", "run2"]
    out = tmp_path / "fitted.yaml"
    fit = identify("fit", folder / "run1.bag", "--holdout", folder, "--model", guess, "-o", out)
    fails(fit, "a run is given both for the fit and as holdout")


def test_a_model_in_grams_is_warned_about(tmp_path):
    grams, out = tmp_path / "grams.yaml", tmp_path / "run.bag"
    grams.write_text(MODEL.read_text().replace("m: 0.0583", "m: 58.3"))
    options = ["--input", "prbs", "--duration", 1, "-o", out]
    result = succeeds("simulate", "--model", grams, *options)
    assert "warning: %s, line 5: m: 58.3 kg is implausible" % grams in result.stderr
    assert "write 0.0583 kg if it is in g" in result.stderr
    grams.write_text(MODEL.read_text().replace("input_max: 1.0", "input_max: 1e-300"))
    failed = identify("simulate", "--model", grams, *options, "--force")
    fails(failed, "grams.yaml, line 13: input_max: 1e-300", "refused")


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["fit"],
        ["guess"],
        ["fit", "a.bag", "--model", "m", "-o", "o", "--window", "-1"],
        ["fit", "a.bag", "--model", "m", "-o", "o", "--starts", "0"],
        ["fit", "a.bag", "--model", "m", "-o", "o", "--free"],
        ["fit", "a.bag", "--model", "m", "-o", "o", "--from", "nan"],
        ["fit", "a.bag", "--model", "m", "-o", "o", "--nonsense", "3"],
        ["fit", "a.bag", "--model", "m", "-o", "o", "--fre", "k"],
        ["info"],
    ],
)
def test_bad_usage_is_status_2(arguments):
    verb = " " + arguments[0] if arguments[:1] in (["fit"], ["info"]) else ""
    result = identify(*arguments)
    fails(result, "identify%s" % verb, "-h", status=2)
    assert not arguments or result.stderr.count("\n") == 1  # what is wrong, and where options are listed


FIT = ["fit", "a.bag", "--model", "m", "-o", "o"]


@pytest.mark.parametrize(
    "arguments, wrong, right",
    [
        ([*FIT, "--detail"], "--detail", "--details"),
        ([*FIT, "--maping=m2.yaml"], "--maping", "--mapping"),
        (["fit", "a.bag", "--modle", "m", "-o", "o"], "--modle", "--model"),  # --model is missing, too
        ([*FIT, "--starts", "0", "--windw", "3"], "--windw", "--window"),  # a value is wrong, too
        (["info", "a.bag", "--axis", "x, y, z"], "--axis", "--axes"),
        (["info", "a.bag", "-json"], "-json", "--json"),
        (["--verson"], "--verson", "--version"),
    ],
)
def test_a_misspelt_option_is_named_with_the_nearest(arguments, wrong, right):
    told = "there is no option %s (did you mean %s?)" % (wrong, right)
    fails(identify(*arguments), told, status=2)


def test_a_program_of_one_verb_names_a_misspelt_option_too():
    told = "track: there is no option --sized (did you mean --size?)"
    fails(program("track", "--sized", 3), told, status=2)
    fails(program("track", "--nothing-like-it"), "there is no option --nothing-like-it", status=2)


@pytest.mark.parametrize(
    "arguments, form",
    [
        (
            ["add", "a.bag", "--model", "m", "-o", "o", "--effect", "wind"],
            "EFFECT BAG ... --model M.yaml -o N",
        ),
        (["add", "wind", "--model", "m", "-o", "o"], "add EFFECT BAG ..."),
        (["export", "--python", "m", "-o", "o.py"], "export MODEL -o FILE.py"),
        (["export", "m", "o.py"], "export MODEL -o FILE.py"),
    ],
)
def test_arguments_that_make_no_command_are_answered_with_the_form(arguments, form):
    fails(identify(*arguments), form, status=2)


@pytest.mark.parametrize("option", ["--disturbance", "--trim", "--loss"])
def test_a_share_in_per_cent_is_answered_with_the_number(option):
    given = ["simulate", "--model", "m", "--input", "prbs", "-o", "o.bag"]
    fails(identify(*given, option, "2%"), option, "write 0.02", status=2)
    fails(identify(*given, option, "x%"), option, "invalid number", status=2)


@pytest.mark.parametrize(
    "spoil, words",
    [
        (lambda t: t.replace("field.point.z", "z", 1), ["no field field.point.z"]),
        (lambda t: t.replace(",0.0,", ",,", 1), ["line 2", "not a number"]),
        (lambda t: t.replace(",0.0,", ",nan,", 1), ["line 2", "not finite"]),
        (lambda t: re.sub(r"\d{15,}", "9" * 20, t, count=1), ["line 2", "not a time"]),
        (lambda t: t[: t.index("\n") + 1], ["no rows"]),
    ],
)
def test_bad_csv_is_refused_with_file_and_line(tmp_path, spoil, words):
    times, eta, inputs = simulate_run()
    controls = write_csv(tmp_path / "controls.csv", inputs[:, 0], 0 * inputs[:, 1:])
    pose = write_csv(tmp_path / "pose.csv", times, eta)
    controls.write_text(spoil(controls.read_text()))
    out = tmp_path / "run.bag"
    fails(identify("import", controls, pose, "-o", out), "controls.csv", *words)
    assert not out.exists()


@slow
def test_real_recordings_import_and_fit(tmp_path, real_bags):
    infos = json_of("info", *real_bags.values())
    for info in infos:
        clock = info["poses"]["frame_clock"]  # frames at 120 Hz are polled at 100 Hz
        assert clock["rate"] == pytest.approx(120, abs=0.05)
        assert 0.2 < info["poses"]["bursts"] / info["poses"]["count"] < 0.36
        assert info["repairs"]["duplicates dropped"] == 0, "no distinct frame may be dropped"
    for stamp, bag in real_bags.items():
        out = tmp_path / (stamp + ".yaml")
        fit = json_of("fit", bag, "--model", MODEL, "-o", out)
        assert fit["error"]["after"] < 0.9 * fit["error"]["before"]
        if stamp.startswith("2019-04-16"):
            # Thrust and inertia agree with table 3.2 of the thesis for the same craft.
            assert 0.04 < fit["parameters"]["k"]["value"] < 0.1
            assert 4e-5 < fit["parameters"]["I_z"]["value"] < 1.6e-4
            assert fit["error"]["after"] < 0.65
            assert all(p["identified"] for p in fit["parameters"].values())
            # The result does not depend on the start, even with a damping at its bound.
            far = identify("fit", bag, "--model", MODEL, "-o", out, "--force", "--starts", 3, "--json")
            assert json.loads(far.stdout)["starts"]["at_best"] == 3, far.stderr
