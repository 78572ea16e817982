"""The first lines of every verb and verdict: answer, size with units, file, and what to do next."""

import copy
import json
import re
import shlex
from dataclasses import replace

import numpy as np
import pytest

import ground
from conftest import MODEL, identify, simulate_run, succeeds, with_effect, write_bag
from ground import cli
from ground.analysis.distributions import chance_by_interval
from ground.analysis.horizon import PoseError
from ground.data import bag_arguments
from ground.diagnosing import answer
from ground.diagnosing.report import DiagnosisReport, ScreenedEffect
from ground.reports.words import least
from ground.support import records
from ground.support.headline import formatted
from ground.support.quantities import with_interval

ERROR = r"(\d+(\.\d+)? (mm|m), \d+(\.\d+)? deg|not finite)"
PREDICTION = r"Prediction after [\d.]+ s: +%s -> %s \((?:at the )?noise floor: %s" % (ERROR, ERROR, ERROR)
MAPPING = """schema: ground/mapping/1
poses:
  position: {fields: [px, py], unit: m}
  heading: {field: yaw, unit: rad}
  axes: "x, y, z"
  time: {field: time, unit: s}
commands:
  time: {field: time, unit: s}
  channels:
    left: {field: u1, unit: normalised}
    right: {field: u2, unit: normalised}
    lift: {field: u3, unit: normalised}
"""
LABEL = r"^([A-Z][^:]{2,21}): +\S"


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Bags of a craft with a motor lag; its model truth.yaml is in the same folder."""
    folder = tmp_path_factory.mktemp("lagging")
    truth = with_effect(folder / "truth.yaml", "{name: motor_lag, tau: 0.06}")
    return [write_bag(folder / ("run%d.bag" % s), seed=s, model=truth, duration=8.0) for s in (1, 2, 3)]


def test_a_label_does_not_touch_its_text():
    assert list(formatted([("Prediction after 0.2 s", "21 m")])) == ["Prediction after 0.2 s: 21 m"]


def first_lines(text):
    """Labels and texts of the lines above the first empty one; continued lines are joined."""
    found = []
    for line in text.split("\n\n")[0].splitlines():
        label = re.match(LABEL, line)
        if label:
            found.append([label.group(1), line])
        else:
            found[-1][1] += " " + line.strip()
    return dict(found)


def said_by(*arguments):
    result = succeeds(*arguments)
    return first_lines(result.stdout)


@pytest.fixture(scope="module")
def diagnosed(bags, tmp_path_factory):
    """What a diagnosis of a craft with a lag prints, and its folder."""
    out = tmp_path_factory.mktemp("diagnosed") / "out"
    options = ["--model", MODEL, "--only", "motor_lag", "input_delay", "-o", out]
    return said_by("diagnose", *bags, *options), out


def read_by(command):
    """The recordings that a command of `identify` reads."""
    rosrun, package, program, *given = shlex.split(command)
    assert (rosrun, package, program) == ("rosrun", "ground", "identify")
    return bag_arguments.read(cli._parser(given[:1]).parse_args(given))


def test_a_command_that_comes_next_reads_the_same_recordings(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    truth = with_effect(tmp_path / "truth.yaml", "{name: yaw_bias, n0: 2.0e-5}")
    times, eta, inputs = simulate_run(model=truth)
    rows = np.column_stack([times, eta, inputs[np.searchsorted(inputs[:, 0], times, side="right") - 1, 1:]])
    names = ["time", "px", "py", "yaw", "u1", "u2", "u3"]
    np.savetxt("a run.csv", rows, "%.9f", ",", header=",".join(names), comments="")
    (tmp_path / "m 2.yaml").write_text(MAPPING)
    reading = ["a run.csv", "--mapping", "m 2.yaml", "--heading-offset", 0.1, "--leave-out", "a run=1,1.5"]
    model = ["--model", MODEL, "-o"]
    np.savetxt("held.csv", rows[100:], "%.9f", ",", header=",".join(names), comments="")
    verbs = {
        "info": ["info", *reading],
        "fit": ["fit", *reading, "--holdout", "held.csv", *model, "fitted.yaml"],
        "add": ["add", "yaw_bias", *reading, *model, "added.yaml"],
        "compare": ["compare", *reading, *model, "compared", "--numbers"],
    }
    printed = {verb: succeeds(*given).stdout for verb, given in verbs.items()}
    commands = {v: re.findall(r"^    (rosrun .*)$", text, re.M) for v, text in printed.items()}
    assert commands["info"] and commands["fit"] and commands["compare"], printed
    (expected,) = bag_arguments.read(cli._parser(["info"]).parse_args([str(a) for a in verbs["info"]]))
    assert ["--holdout held.csv" in " ".join(commands[verb]) for verb in ("fit", "compare")] == [True, False]
    for command in sum(commands.values(), []):
        (found,) = read_by(command)
        assert found.identity == expected.identity, command
        assert np.array_equal(found.eta, expected.eta)


def test_a_mistake_of_the_recording_is_told_once(tmp_path):
    swapped = write_bag(tmp_path / "run.bag", change=lambda t, eta, rows: (t, eta, rows[:, [0, 2, 1, 3]]))
    diagnose = ["diagnose", swapped, "--model", MODEL, "-o", tmp_path / "out"]
    for arguments in (["info", swapped], diagnose):
        found = succeeds(*arguments)
        told = " ".join((found.stdout + found.stderr).split())
        assert told.count("left and right seem to be swapped") == 1, told


def test_numbers_of_a_noisy_run_are_written_out(tmp_path):
    def noisy(times, eta, inputs):
        return times, eta + np.random.default_rng(1).normal(size=eta.shape) * [0.31, 0.31, 0], inputs

    assert re.search(
        r"noise up to \d{3} mm", said_by("info", write_bag(tmp_path / "run.bag", change=noisy))["Poses"]
    )


def test_a_fit_a_comparison_and_an_added_effect(bags, tmp_path):
    fitted, added = tmp_path / "fitted.yaml", tmp_path / "added.yaml"
    fit = said_by("fit", *bags, "--model", MODEL, "-o", fitted)
    assert re.match(PREDICTION, fit["Prediction after 1 s"])
    assert "an effect is missing, or" in fit["Next"] and "identify diagnose" in fit["Next"]
    add = said_by("add", "motor_lag", *bags, "--model", fitted, "-o", added)
    assert "yes - motor_lag: tau" in add["Does it help"] and "use the model with it" in add["Next"]
    assert re.match(PREDICTION, add["Prediction after 1 s"])
    other = write_bag(tmp_path / "other.bag", seed=9, model=bags[0].parent / "truth.yaml")
    compared = said_by(
        "compare", other, "--model", fitted, "--model", added, "-o", tmp_path / "out", "--numbers"
    )
    assert compared["Best"].split()[1] == "added" and "use added" in compared["Next"]
    assert len(re.findall(ERROR, compared["Prediction after 1 s"])) == 3
    alone = said_by("compare", bags[0], "--model", fitted, "-o", tmp_path / "one", "--numbers")
    assert "record other runs" in alone["Next"]


@pytest.fixture(scope="module")
def report(diagnosed):
    """The diagnosis.json of a craft with a lag."""
    found = json.loads((diagnosed[1] / "diagnosis.json").read_text())
    found.pop("selection", None)  # as if all effects had been tried
    return found


@pytest.fixture(scope="module")
def unexplained(bags):
    """A diagnosis of that craft in Python that tries no lag."""
    return ground.diagnose(MODEL, ground.read(bags), only=["wind"])


def changed(report, verdict, **changes):
    """The report with another verdict."""
    other = copy.deepcopy(report)
    other["verdict"] = verdict
    for key, value in changes.items():
        other[key].update(value) if isinstance(value, dict) else other.update({key: value})
    return other


def typed(report):
    """The report of a diagnosis.json."""
    return records.read(DiagnosisReport, report, "diagnosis.json")


def lines_of(report, folder=""):
    """The first lines of a diagnosis.json."""
    return answer.lines(typed(report), folder)


OPEN = {
    "terms": ["c1"],
    "named_as": "a yaw moment of 2 mN m that depends on the heading",
    "arguments": {"heading": 0.4},
}


EXPERIMENT = {
    "separates": ["motor_lag", "input_delay"], "input": "prbs", "arguments": "", "launch": "", "room": "",
    "repeat": 1, "expected_disagreement": 9.0,
}  # fmt: skip
PROPOSAL = {
    "name": "p",
    "expression": {},
    "parameters": {},
    "means": "",
    "error": {"fit": 0.1, "heldout": 0.1, "by": "cross-validation"},
}


def test_an_effect_is_as_certain_as_its_interval_says(report):
    """The interval is widened by what runs differ by; the likelihood assumes that they are the same."""
    found, tau = copy.deepcopy(report), report["improved"]["parameters"]["motor_lag.tau"]
    words = ["may be zero", "Likely.", "Certain.", "Very certain."]
    for part, word in zip((1.0, 0.8, 0.5, 0.1), words):  # of the value, between it and an end
        ends = [(1 - part) * tau["value"], (1 + part) * tau["value"]]
        found["improved"]["parameters"]["motor_lag.tau"] = dict(tau, ci95=ends)
        found["steps"][0]["p_interval"] = chance_by_interval(tau["value"], ends, 0)
        told = lines_of(found)[0][1]
        assert word in told and ("ertain." in told) == (part < 0.8), told


def test_an_effect_that_does_not_help_to_predict_is_not_confirmed(report):
    found, improved = copy.deepcopy(report), report["prediction"]["errors"]["improved"]
    for factor, confirmed in ((2.0, True), (0.9, False)):
        found["prediction"]["errors"]["refitted"] = {name: factor * e for name, e in improved.items()}
        (_, told), *lines = lines_of(found)
        assert ("ertain." in told, "not confirmed" in told) == (confirmed, not confirmed), told
        assert ("record more runs" in dict(lines)["Next"]) != confirmed, lines


def test_many_effects_begin_with_what_they_leave_together(report):
    found, given = copy.deepcopy(report), report["prediction"]["errors"]["given"]
    for share in (0.2, 0.8):
        found["prediction"]["errors"]["improved"] = {name: share * e for name, e in given.items()}
        found["steps"] = report["steps"]
        assert "%.0f%%" % (100 * share) not in lines_of(found)[0][1]
        found["steps"] = 5 * report["steps"]
        told = lines_of(found)[0][1]
        assert "%.0f%%" % (100 * share) in told and ("unexplained" in told) == (share > 0.5), told


def test_what_swings_is_named_where_an_effect_was_refuted_too(report):
    """The next step is to switch it off."""
    dropped = dict(effect="input_delay", parameters={}, why="it fails", p=0.1, p_corrected=1.0, change=None)
    swings = dict(holds=False, frequency=1.3, common=None)
    other = changed(report, "undecided", dropped=[dropped], agreement=swings, steps=[])
    told = " ".join(text for _, text in lines_of(other))
    assert "1.3 Hz" in told and "switch off whatever swings" in told, told


def test_an_effect_at_the_end_of_its_range_is_another_effect_that_acts_like_it(report):
    found, tau = copy.deepcopy(report), report["improved"]["parameters"]["motor_lag.tau"]
    for at_bound in (False, True):
        found["improved"]["parameters"]["motor_lag.tau"] = dict(tau, at_bound=at_bound)
        told = lines_of(found)[0][1]
        assert ("beyond the range of tau" in told, "acts like it" in told) == (at_bound, at_bound), told


def test_runs_that_do_not_tell_effects_apart_name_the_experiment(report):
    found = copy.deepcopy(report)
    found["steps"][0]["group"] = ["motor_lag", "input_delay"]
    launch = "roslaunch ground room_prbs.launch design:=prbs"
    found["next_experiment"] = dict(EXPERIMENT, launch=launch)
    lines = dict(line for line in lines_of(found) if line[0])
    assert "do not distinguish it from" in lines["Missing"] and lines["Next"].splitlines()[-1] == launch


@pytest.mark.parametrize("verdict", ["unexplained", "memory", "undecided", "missing"])
@pytest.mark.parametrize("folder", ["", "out"])
def test_what_was_not_tried_is_not_called_unknown_to_the_library(report, verdict, folder):
    """A user gave --only wind: the library may well have the effect."""
    found = changed(report, verdict, next_experiment=None, ceiling=OPEN, agreement={"holds": False})
    found["improved"]["error"]["heldout"] = 10 * found["noise_floor"]
    found["selection"] = "only wind"
    lines = dict(line for line in lines_of(found, folder) if line[0])
    text = "\n".join(formatted(lines_of(found, folder)))
    assert "not in the library" not in text
    assert "diagnose" in lines["Next"] and "only" not in lines["Next"]
    if verdict in ("unexplained", "memory"):
        assert "only wind" in " ".join(text.split())


SHELL = r"rosrun|roslaunch|identify \w|(?<!\w)--\w"  # what does not run in Python
CALL = r"ground\.(\w+)\("


def test_results_in_python_name_functions_of_python(bags, report, unexplained):
    """What a result prints can be typed where it is printed; a terminal gets command lines."""
    runs = ground.read(bags)
    fit = ground.fit(MODEL, runs, free=["k", "N_r"])
    compared = ground.compare(MODEL, runs)
    flown = [ground.simulate(MODEL, "prbs", duration=6, seed=s) for s in (1, 2)]
    texts = {
        "fit": fit.summary(),
        "comparison": compared.summary(),
        "addition": ground.add(MODEL, "wind", flown).summary(),
        "tracking": ground.track(MODEL, "circle", end_time=12, settled=8, max_error=0.001).summary(),
        "diagnosis": unexplained.summary(),
    }
    group = copy.deepcopy(report)
    group["steps"][0]["group"] = ["motor_lag", "input_delay"]
    flies = {"launch": "rosrun ground identify simulate", "call": "ground.simulate(CRAFT)"}
    group["next_experiment"] = {**EXPERIMENT, **flies}
    for verdict in ("misread", "unexplained", "memory", "undecided", "varies", "complete"):
        other = changed(report, verdict, next_experiment=None, unexplained={"proposal": PROPOSAL})
        texts[verdict] = "\n".join(formatted(lines_of(other)))
    texts["group"] = "\n".join(formatted(lines_of(group)))
    for name, text in texts.items():
        assert not re.search(SHELL, text), (name, re.search(SHELL, text), text)
        for function in re.findall(CALL, text):
            assert function in ground.__all__, (name, function)
    for name in ("fit", "comparison", "diagnosis", "unexplained", "group"):
        assert re.search(CALL, texts[name]), texts[name]


def test_an_error_smaller_than_the_disturbance_makes_it_is_no_evidence(report):
    """A push at some places only leaves a smaller error than a steady one of its size."""
    from ground.diagnosing import words

    found = copy.deepcopy(report)
    found["agreement"].update(holds=False, frequency=None, common=None)
    for measured in (0.1, 0.3):
        found["agreement"]["error"].update(measured=measured, expected=0.2)
        told = words.ceiling(typed(found))
        assert "more may be missing" in told
        assert ("0.200" in told, "some times or places" in told) == (measured > 0.2, measured < 0.2)


def test_a_proposal_can_be_added_in_python(bags, unexplained):
    found = unexplained
    assert found.verdict in ("unexplained", "memory"), "a lag is none of the effects that were tried"
    added = ground.add(found.improved, found.proposal, bags)
    assert added.verdict.helps and found.proposal.name in added.model.effects


def test_after_simulated_runs_no_real_room_is_proposed(tmp_path):
    """The next experiment is flown where the last one was."""
    truth = with_effect(tmp_path / "truth.yaml", "{name: motor_lag, tau: 0.03}")
    flown = [ground.simulate(truth, "spin", duration=8, seed=s, name="run %d" % s) for s in (1, 2)]
    bags = [tmp_path / ("run%d.bag" % s) for s in (1, 2)]
    for run, bag in zip(flown, bags):
        run.save(bag)
    out = tmp_path / "out"
    only = ["motor_lag", "input_delay", "skirt_friction"]  # runs at full lift cannot show the last one
    printed = identify("diagnose", *bags, "--model", MODEL, "--only", *only, "-o", out).stdout
    assert "room_" not in printed and "rosrun ground identify simulate" in printed, printed
    command = next(line for line in printed.splitlines() if "identify simulate" in line).split("identify ")[1]
    words = shlex.split(command.replace("next.bag", str(tmp_path / "next.bag")))
    succeeds(*words)  # it runs as printed
    diagnosis = ground.diagnose(MODEL, flown, only=only)
    told = str(diagnosis)
    call = next(line for line in told.splitlines() if "ground.simulate(" in line)
    names = {"ground": ground, "CRAFT": truth, "diagnosis": diagnosis}
    assert eval(call.strip(), names).length > 1 and "roslaunch" not in told


def test_a_saved_diagnosis_may_have_a_value_that_is_infinite(report):
    """JSON has null in its place, as for the lag of a supply that does not sag."""
    from ground.diagnosing import words

    found = copy.deepcopy(report)
    tau = found["candidates"][0]["parameters"]["tau"]
    tau.update(value=None, ci95=[1.0, None])
    told = "\n".join(words.evidence(typed(found)))
    assert re.search(r"tau inf s \(95%: 1\.0+ to inf s\)", told), told


def test_an_effect_that_predicts_worse_is_not_called_certain():
    def certain(error, p):
        row = ScreenedEffect("input_delay", {}, p, p, -100.0, PoseError(error, error / 4), PoseError(87, 20))
        return answer.tried(row, 27, {})["certain"]

    assert "certain" in certain(18, 0.0) and "worse" not in certain(18, 0.0)
    assert "predicts worse" in certain(172, 0.0) and "certain" not in certain(172, 0.0)
    assert "27" in certain(18, 1.0) and "not significant" in certain(172, 1.0)


def test_an_effect_is_called_certain_only_where_its_prediction_was_judged(report):
    (row, *_), without = typed(report).candidates, 0.6

    def certain(heldout):
        tried = replace(row, p_corrected=0.0, error=replace(row.error, heldout=heldout))
        return answer.tried(tried, 27, {}, without)["certain"]

    assert [("ertain" in certain(error), "worse" in certain(error)) for error in (0.5, 0.7, None)] == [
        (True, False),
        (False, True),
        (False, False),
    ]


@pytest.mark.parametrize("error, is_as_good", [((3.2, 0.74), True), ((4.0, 0.9), True), ((5.0, 0.7), False)])
def test_an_error_within_the_scatter_of_the_mocap_is_said_to_be_as_good(error, is_as_good):
    assert ("at the noise floor" in least(PoseError(*error), PoseError(3.6, 0.81))) == is_as_good
    assert "at the noise floor" not in least(PoseError(np.inf, np.inf), PoseError(3.6, 0.81))


def test_a_value_and_its_interval_have_the_same_decimals():
    random, part = np.random.default_rng(1), r"(-?\d+(?:\.(\d+))?(e-\d+)?)"
    form = re.compile(r"%s kg m\^2 \(95%%: %s to %s kg m\^2\)" % (part, part, part))
    for _ in range(1000):
        value = random.choice((-1, 1)) * 10 ** random.uniform(-9, 5)
        low, high = value + abs(value) * 10 ** random.uniform(-6, 1) * random.uniform((-1, 0), (0, 1))
        told = with_interval(value, low, high, "kg m^2")
        found = form.fullmatch(told).groups("")
        printed = [float(text) for text in found[::3]]
        assert len({len(text) for text in found[1::3]}) == 1 and len(set(found[2::3])) == 1, told
        assert printed[1] <= printed[0] <= printed[2] and printed[1] < printed[2], told
        assert np.abs(np.subtract(printed, (value, low, high))).max() < 0.06 * (high - low), told


def test_shares_do_not_say_that_all_is_explained_where_something_is_left(report):
    from ground.diagnosing import words

    found = copy.deepcopy(report)
    found["agreement"]["holds"] = False
    for name, share in (("named", 0.9972), ("learnable", 0.0021), ("chance", 0.0007)):
        found["ceiling"][name] = {"share": share, "ci95": [share - 1e-4, share + 1e-4]}
    text = words.ceiling(typed(found))
    assert "100%" not in text and not re.search(r"(?<!\d)0%", text) and "more may be missing" in text


def test_runs_too_short_to_predict_are_not_called_well_predicted():
    from ground.comparing import words
    from ground.comparing.ranking import Ranking

    ranking = Ranking("held_out", ["run"], {"a": 0.1}, [], [])
    found = dict(words.lines(ranking, None, ground.Model.load(MODEL)))
    assert "longer runs" in found["Next"] and "noise floor" not in found["Next"]


@pytest.mark.parametrize("times, advised", [(2.0, True), (1.05, False)])
def test_half_the_error_within_the_scatter_of_a_run_is_not_called_equally_good(times, advised):
    from ground.analysis.horizon import PoseError, PredictionError
    from ground.comparing import words
    from ground.comparing.ranking import Ranking

    ranking = Ranking("held_out", ["run"], {"a": 0.1, "b": 0.2}, [], ["b"])
    errors = {"a": PoseError(4.0, 2.0), "b": PoseError(4.0 * times, 2.0 * times)}
    found = PredictionError(1.0, errors, PoseError(4.0, 2.0), None)
    told = dict(words.lines(ranking, found, ground.Model.load(MODEL)))
    assert ("equally good" in told["Best"], "use a" in told["Next"]) == (not advised, advised), told
    assert "more runs" in told["Next"]


def test_a_fit_that_predicts_worse_than_the_given_model_says_so():
    craft = ground.Model.load(MODEL)
    truth = craft.with_effect("com_offset", xg=0.006)
    runs = [
        ground.simulate(truth, "multilevel-prbs", duration=12, disturbance=[0.05, 0.5], seed=s, name=str(s))
        for s in (6, 7)
    ]
    weak = ground.Model.parse(craft.format().replace("k: %g" % craft["k"], "k: %g" % (0.5 * craft["k"])))
    assert weak["k"] < 0.6 * craft["k"]
    for given, worse in ((craft, True), (weak, False)):
        fit = ground.fit(given, runs)
        errors = fit.prediction.errors
        assert (errors["fitted"].position_mm > errors["given"].position_mm) == worse
        assert ("no better than the given" in " ".join(str(fit).split())) == worse
