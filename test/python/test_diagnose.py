"""identify diagnose as a user runs it: it names the missing effect and writes a model with it."""

import argparse
import dataclasses
import html
import json
import re

import numpy as np
import pytest
import yaml

import ground
import mistakes
from conftest import MODEL, identify, json_of, schema, slow, succeeds, with_effect, write_bag
from ground import _core
from ground.diagnosing import answer, next_experiment
from ground.diagnosing import diagnose as verb
from ground.diagnosing.report import DiagnosisReport
from ground.support import records
from ground.support.errors import GroundError

WASHBOARD = """
name: washboard
expression: {X: "a*sin(2*pi*x/0.3)*cos(psi)", Y: "-a*sin(2*pi*x/0.3)*sin(psi)"}
parameters:
  a: {value: 0.02, unit: N, neutral: 0, lower: -1, upper: 1}
"""


def bags_of(folder, truth, seeds=(1, 40), **options):
    return [
        write_bag(folder / ("run%d.bag" % s), seed=s, model=truth, nu=(0.3, 0.1, 1), **options) for s in seeds
    ]


def title(printed):
    """The answer of a diagnosis that was printed, in a sentence."""
    return answer.title(records.read(DiagnosisReport, printed, "printed"))


def reported(*arguments):
    """The report of a diagnosis."""
    return json_of("diagnose", *arguments)


@pytest.fixture(scope="module")
def lagging(tmp_path_factory):
    """Bags of a craft with a motor lag; its model truth.yaml is in the same folder."""
    folder = tmp_path_factory.mktemp("lagging")
    return bags_of(folder, with_effect(folder / "truth.yaml", "{name: motor_lag, tau: 0.06}"))


def of_day(bags, day):
    """The real recordings of a day."""
    return [bag for stamp, bag in bags.items() if stamp.startswith(day)]


@pytest.fixture
def unplanned(monkeypatch):
    """Diagnoses of this test plan no next experiment, which takes half of their time."""
    monkeypatch.setattr(next_experiment, "propose", lambda *_, **__: None)


def tried_by_default():
    """Names of the library's effects that a diagnosis tries by default."""
    return {
        name
        for name, effect in _core.effects().items()
        if effect["surroundings"] != "water" and not effect["opt_in"]
    }


def test_a_lag_is_found_and_its_model_can_be_used(tmp_path, lagging):
    out = tmp_path / "out"
    report = reported(*lagging, "--model", MODEL, "-o", out)
    assert report == json.loads((out / "diagnosis.json").read_text())
    assert report["schema"] == "ground/diagnosis/1"
    assert report["verdict"] == "missing"
    assert report["improved"]["effects"] == ["motor_lag"]
    first = report["candidates"][0]
    assert first["effect"] == "motor_lag" and first["rank"] == 1 and first["selected"]
    assert first["p"] <= first["p_corrected"] < 1e-6 and first["delta_bic"] < -100
    low, high = report["improved"]["parameters"]["motor_lag.tau"]["ci95"]
    assert low < 0.06 < high and high - low < 0.002
    assert report["nominal"]["error"]["heldout"] > 3 * report["improved"]["error"]["heldout"]
    assert report["improved"]["error"]["heldout"] == pytest.approx(report["noise_floor"], rel=0.15)
    assert [s["added"] for s in report["steps"]] == ["motor_lag"]
    assert {c["effect"] for c in report["candidates"]} == tried_by_default()
    assert [c["rank"] for c in report["candidates"]] == list(range(1, len(tried_by_default()) + 1))
    page = (out / "report.html").read_text()
    assert "motor_lag - first-order lag" in page
    bands = {(b["horizon"], b["channel"]): b for b in report["bands"]}
    assert set(bands) == {(h, c) for h in (0.5, 1.5, 4.0) for c in ("x", "y", "psi", "u", "v", "r")}
    assert 0.75 < bands[0.5, "psi"]["coverage"] <= 1
    assert "90% prediction bands contain" in page
    # The simulator accepts the model.
    drive = "--input", "prbs", "--duration", "2"
    succeeds("simulate", "--model", out / "improved.yaml", *drive, "-o", tmp_path / "again.bag")
    # Existing results are not overwritten.
    again = identify("diagnose", *lagging, "--model", MODEL, "-o", out)
    assert again.returncode == 1 and "--force" in again.stderr


def test_an_improvement_is_that_over_what_a_fit_reaches(tmp_path, lagging, unplanned):
    """A fit without the effect predicts as well as `identify fit` says; the gain begins there."""
    out = tmp_path / "out"
    report = reported(*lagging, "--model", MODEL, "--only", "motor_lag", "-o", out)
    before, after = (report[name]["error"]["heldout"] for name in ("nominal", "improved"))
    assert after < before <= ground.fit(MODEL, lagging).error.heldout * 1.001
    errors = report["prediction"]["errors"]
    for unit in ("position_mm", "heading_deg"):
        assert 3 * errors["improved"][unit] < min(errors["given"][unit], errors["refitted"][unit])
    improved = yaml.safe_load((out / "improved.yaml").read_text())["provenance"]
    for name, error in (("error_before", "nominal"), ("error_after", "improved")):
        assert improved[name].items() <= report[error]["error"].items()


@slow
def test_an_improvement_on_real_runs_is_that_over_what_a_fit_reaches(real_bags, unplanned):
    """These runs differ from one another, too; estimates of what differs may help a fit."""
    bags = of_day(real_bags, "2019-04-16")[:2]
    found = ground.diagnose(MODEL, bags, only=["motor_lag"])
    assert found.error[-1] < found.error[0] <= ground.fit(MODEL, bags).error.heldout * 1.001


@slow
def test_without_the_right_effect_a_part_stays_unexplained(tmp_path, lagging, unplanned):
    lags = ["motor_lag", "motor_rise_fall", "motor_rate"]
    report = reported(*lagging, "--model", MODEL, "-o", tmp_path / "out", "--exclude", *lags)
    assert report["verdict"] == "memory"  # a lag is a memory of the commands
    proposal = report["unexplained"]["proposal"]
    assert "the past" in proposal["means"] or "over the last" in proposal["means"]
    assert proposal["error"]["heldout"] < 0.8 * report["improved"]["error"]["heldout"]
    assert (tmp_path / "out" / "proposal.yaml").exists()


def test_a_complete_model_is_not_changed(tmp_path, unplanned):
    bag = write_bag(tmp_path / "run.bag", seed=3, duration=12.0)
    result = succeeds("diagnose", bag, "--model", MODEL, "-o", tmp_path / "out")
    assert "Missing:               nothing" in result.stdout
    report = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert report["verdict"] == "complete" and not report["steps"]
    found = report["prediction"]
    assert found["seconds"] == 1.0
    for unit, error in found["errors"]["improved"].items():
        assert error < 2 * found["mocap"][unit]
    assert report["improved"]["effects"] == [] and report["unexplained"]["proposal"] is None


def test_an_effect_too_small_to_matter_is_reported_but_not_called_missing(tmp_path, unplanned):
    truth = with_effect(tmp_path / "truth.yaml", "{name: input_delay, delay: 0.0005}")
    bags = bags_of(tmp_path, truth)
    result = succeeds("diagnose", *bags, "--model", MODEL, "-o", tmp_path / "out", "--details")
    assert "Missing:               nothing" in result.stdout
    report = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert report["verdict"] == "complete" and report["improved"]["effects"] == []
    (slight,) = [dropped for dropped in report["dropped"] if dropped["change"]]
    assert slight["effect"] in ("input_delay", "motor_lag") and slight["p"] < 0.01
    assert slight["change"]["seconds"] == 1.0 and 0.1 < slight["change"]["position_mm"] < 2
    for text in (result.stdout, (tmp_path / "out" / "report.html").read_text()):
        assert "(%s) was not added: it is too small to matter" % slight["effect"] in text


@slow
def test_an_unknown_effect_is_described_and_found_when_supplied(tmp_path, unplanned):
    washboard = yaml.safe_load(WASHBOARD)
    truth = with_effect(tmp_path / "truth.yaml", json.dumps(washboard))
    bags = bags_of(tmp_path, truth, seeds=(1, 40))
    # test_hidden.py has such a case with the whole library.
    known = ["--model", MODEL, "--only", "floor_tilt", "momentum_drag", "motor_lag", "wind"]
    report = reported(*bags, *known, "-o", tmp_path / "out")
    assert report["verdict"] == "unexplained"
    assert report["unexplained"]["where"][0]["variable"] == "place"
    proposal = report["unexplained"]["proposal"]
    waves = [p["value"] for p in proposal["parameters"].values() if p["unit"] == "rad/m"]
    assert 2 * np.pi / np.hypot(*waves) == pytest.approx(0.3, rel=0.02), proposal
    assert "in the room" in proposal["means"] and "depends on the place (= " in proposal["means"]
    error = report["improved"]["error"]["heldout"]
    assert proposal["error"]["heldout"] < 0.7 * error
    proposal, improved = tmp_path / "out" / "proposal.yaml", tmp_path / "out" / "improved.yaml"
    succeeds("add", proposal, *bags, "--model", improved, "-o", tmp_path / "added.yaml")
    # A user writes the effect and has it tried with the others.
    washboard["parameters"]["a"]["value"] = 0.001
    (tmp_path / "washboard.yaml").write_text(yaml.safe_dump(washboard))
    options = ["--effects", tmp_path / "washboard.yaml"]
    report = reported(*bags, *known, "-o", tmp_path / "own", *options)
    assert report["verdict"] == "missing" and report["improved"]["effects"] == ["washboard"]
    low, high = report["improved"]["parameters"]["washboard.a"]["ci95"]
    assert low < 0.02 < high


def test_own_effects_are_chosen_by_name_and_errors_name_their_line(tmp_path):
    own = {}
    for name in ("gust", "swirl"):
        own[name] = tmp_path / (name + ".yaml")
        own[name].write_text(
            "name: %s\nexpression: {X: a*u}\nparameters:\n  a: {value: 0.1, unit: N}\n" % name
        )
    model = ground.Model.load(MODEL)

    def tried(*options):
        parser = argparse.ArgumentParser()
        verb.configure(parser)
        files = ["--effects"] + [str(path) for path in own.values()]
        arguments = parser.parse_args(["run.bag", "--model", "m", "-o", "o"] + files + list(options))
        chosen = arguments.only, arguments.exclude, arguments.effects
        return {c.name for c in verb.effects_to_try(model, *chosen)}

    assert tried() == tried_by_default() | {"gust", "swirl"}
    assert tried("--only", "motor_lag") == {"motor_lag", "gust", "swirl"}
    assert tried("--only", "gust") == {"gust"}
    assert tried("--only", "gust", "motor_lag") == {"gust", "motor_lag"}
    assert tried("--only", "gust", "floor_friction_map") == {"gust", "floor_friction_map"}
    assert tried("floor_friction_map") == tried() | {"floor_friction_map"}  # a value of --effects
    assert "swirl" not in tried("--exclude", "swirl")
    with pytest.raises(GroundError, match="there is no effect guts"):
        tried("--only", "guts")

    text = own["gust"].read_text()
    own["gust"].write_text(text.replace("value: 0.1", "value: much"))
    with pytest.raises(GroundError, match="gust.yaml, line 4: a must be a number"):
        tried()
    own["gust"].write_text(text.replace("name: gust", "name: swirl"))
    with pytest.raises(GroundError, match="gust.yaml: another effect swirl"):
        tried()
    own["gust"].write_text("name: motor_lag\ntau: 0.1\n")
    assert tried() == tried_by_default() | {"swirl"}
    own["gust"].write_text("")
    with pytest.raises(GroundError, match="gust.yaml: it is empty"):
        tried()


@slow
def test_a_turned_mocap_is_found_from_zero(tmp_path, unplanned):
    truth = with_effect(tmp_path / "truth.yaml", "{name: heading_offset, psi0: 1.85}")
    bags = bags_of(tmp_path, truth)
    report = reported(*bags, "--model", MODEL, "-o", tmp_path / "out")
    angles = [
        report["improved"]["parameters"].get(name, {"value": 0.0})["value"]
        for name in ("heading_offset.psi0", "thrust_misalignment.angle")
    ]
    assert report["steps"][0]["added"] == "heading_offset"
    assert angles[0] == pytest.approx(1.85, abs=0.01)
    assert report["verdict"] == "missing"


def test_runs_can_be_held_out(tmp_path, lagging, unplanned):
    held = bags_of(tmp_path, lagging[0].parent / "truth.yaml", seeds=(90,))
    options = ["--holdout", *held, "--only", "motor_lag"]
    report = reported(*lagging, "--model", MODEL, "-o", tmp_path / "out", *options)
    assert report["runs"] == {"fit": ["run1", "run40"], "heldout": ["run90"]}
    assert report["nominal"]["error"]["heldout"] > 2 * report["improved"]["error"]["heldout"]


def test_runs_that_are_held_out_judge_and_do_not_choose(tmp_path, lagging, unplanned):
    """What was found stays, and the verdict says that a run of a craft without it contradicts."""
    other = bags_of(tmp_path, MODEL, seeds=(90,))
    options = ["--model", MODEL, "--only", "motor_lag", "input_delay"]
    found = {}
    for name, more in (("alone", []), ("tested", ["--holdout", *other])):
        found[name] = reported(*lagging, *options, "-o", tmp_path / name, *more)
    for what in ("effects", "parameters"):
        assert found["tested"]["improved"][what] == found["alone"]["improved"][what]
    assert found["tested"]["dropped"] == found["alone"]["dropped"]
    errors = [found["tested"][kind]["error"]["heldout"] for kind in ("nominal", "improved")]
    assert errors[0] < errors[1]
    said, alone = (title(found[name]) for name in ("tested", "alone"))
    assert "motor_lag" in said.split("Contradicted")[0]
    shown = html.unescape((tmp_path / "tested" / "report.html").read_text())
    assert said.partition(": ")[2].partition(". ")[0] in " ".join(shown.split())
    assert "Contradicted" not in alone


@pytest.mark.parametrize(
    "options, words",
    [
        (["--only", "motor_leg"], "there is no effect motor_leg"),
        (["--exclude", "motor_leg"], "there is no effect motor_leg"),
        (["--effects", "nowhere.yaml"], "nowhere.yaml"),
    ],
)
def test_bad_options_are_named(tmp_path, options, words):
    bag = write_bag(tmp_path / "run.bag", seed=3)
    result = identify("diagnose", bag, "--model", MODEL, "-o", tmp_path / "out", *options)
    assert result.returncode == 1
    assert words in result.stderr and "Traceback" not in result.stderr
    assert not (tmp_path / "out").exists()


@slow
def test_real_runs_of_one_day(tmp_path, real_bags, unplanned):
    bags = of_day(real_bags, "2019-04-11")
    options = ["--only", "heading_offset", "motor_lag", "floor_tilt", "body_force_bias"]
    report = reported(*bags, "--model", MODEL, "-o", tmp_path / "out", *options)
    assert report["verdict"] in ("memory", "unexplained", "undecided", "missing")
    assert "heading_offset" in [step["added"] for step in report["steps"]]
    offset = report["improved"]["parameters"]["heading_offset.psi0"]["value"]
    assert offset == pytest.approx(1.8, abs=0.15)
    assert report["improved"]["error"]["heldout"] < 0.75 * report["nominal"]["error"]["heldout"]


@pytest.mark.parametrize(
    "delay, seed, duration, verdict", [(0.001, 4, 30, "complete"), (0.01, 1, 10, "missing")]
)
def test_a_delay_matters_by_its_size_not_by_the_length_of_the_run(tmp_path, delay, seed, duration, verdict):
    from ground import _core
    from ground.analysis import diagnosis
    from ground.analysis.verdict import conclude
    from ground.checks import quality
    from ground.effect_library import candidates
    from ground.reading import readers

    truth = with_effect(tmp_path / "truth.yaml", "{name: input_delay, delay: %g}" % delay)
    bag = write_bag(tmp_path / "run.bag", seed=seed, duration=duration, model=truth)
    runs = [quality.repaired(readers.read(str(bag))).data(_core.load_model(str(MODEL)))]
    model = _core.load_model(str(MODEL))
    tried = [c for c in candidates.library(model) if c.name in ("input_delay", "wind")]
    found = diagnosis.StepwiseDiagnosis(runs, model, tried)
    found.grow()
    assert conclude(found).verdict == verdict, [(t.name, t.p_value) for t in found.tried]
    if delay == 0.001:
        assert [d.trial.name for d in found.dropped if d.change] == ["input_delay"]


def written(folder, change, seed=3, **options):
    """Options of a diagnosis for a run of the mistakes' bench in tables."""
    folder.mkdir(exist_ok=True)
    run = mistakes.Recorded(seed, duration=12.0, **options)
    change(run)
    path, mapping = run.write(folder / "run")
    return [path, "--mapping", mapping, "--model", MODEL]


SOME = ["--only", "thrust_asymmetry", "thrust_misalignment", "yaw_bias", "motor_lag", "input_delay"]


@pytest.mark.parametrize(
    "change, kind, options",
    [(mistakes.swapped, "swap", {}), (mistakes.nothing, "dead", {"dead": 1})],
    ids=["swap", "dead"],
)
def test_misread_recordings_are_not_diagnosed_as_missing_effects(change, kind, options, tmp_path):
    report = reported(*written(tmp_path, change, **options), *SOME, "-o", tmp_path / "out")
    assert report["verdict"] == "misread" and report["improved"]["effects"] == []
    assert report["candidates"] == [] and report["steps"] == []
    (finding,) = report["findings"]
    assert finding["kind"] == kind and finding["misread"] and finding["runs"] == ["run"]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "not searched" in page
    assert finding["evidence"] in html.unescape(page)
    assert "distinguish all effects" not in page and "Parts of its squared error" not in page
    assert not (tmp_path / "out" / "improved.yaml").exists()


def test_add_refuses_misread_recordings_unless_told_otherwise(tmp_path):
    command = ["add", "motor_lag", *written(tmp_path, mistakes.swapped), "-o", tmp_path / "new.yaml"]
    refused = identify(*command)
    assert refused.returncode == 1 and not (tmp_path / "new.yaml").exists()
    assert "left and right seem to be swapped" in refused.stderr
    assert "--as-recorded (as_recorded in Python) uses it as it is" in refused.stderr
    succeeds(*command, "--as-recorded")
    with pytest.raises(GroundError, match="as_recorded in Python"):
        path, _, mapping, _, model = written(tmp_path / "again", mistakes.swapped)
        ground.add(model, "motor_lag", ground.read(path, mapping=mapping))


@slow
def test_what_was_misread_can_be_diagnosed_as_it_is(tmp_path, unplanned):
    options = written(tmp_path, mistakes.inverted(1)) + ["--only", "motor_lag", "-o", tmp_path / "out"]
    report = reported(*options, "--as-recorded")
    assert report["verdict"] != "misread" and report["findings"][0]["kind"] == "invert"
    assert [c["effect"] for c in report["candidates"]] == ["motor_lag"]


@pytest.mark.parametrize("parameter, value", [("thrust_asymmetry.a", 0.25), ("yaw_bias.n0", 4e-4)])
def test_a_strong_effect_is_missing_and_not_misread(parameter, value, tmp_path, unplanned):
    options = written(tmp_path, mistakes.nothing, effects={parameter: value})
    report = reported(*options, *SOME, "-o", tmp_path / "out")
    assert report["findings"] == [] and report["verdict"] == "missing"
    assert parameter.split(".")[0] in report["improved"]["effects"]
    assert report["improved"]["parameters"][parameter]["value"] == pytest.approx(value, rel=0.1)


def test_a_turned_heading_is_not_taken_for_another_effect(tmp_path, unplanned):
    """At a quarter turn the fit gives up on thrust, so that no search by derivatives finds the offset."""
    options = written(tmp_path, mistakes.turned(1.57)) + ["--only", "heading_offset", "motor_lag"]
    report = reported(*options, "-o", tmp_path / "out")
    (finding,) = report["findings"]
    assert finding["kind"] == "offset" and "--heading-offset 1.57" in finding["remedy"]
    if report["verdict"] == "misread":
        assert report["improved"]["effects"] == []
    else:
        assert "heading_offset" in report["improved"]["effects"]
        found = report["improved"]["parameters"]["heading_offset.psi0"]["value"]
        assert found == pytest.approx(1.57, abs=0.05)


SLOW = """schema: ground/model/1
name: "free-flyer"
body: {m: 16, l: 0.1, I_z: 0.16, X_u: 0.3, Y_v: 0.3, N_r: 0.008, k: 0.1, input_max: 1.0}
effects: %s
"""


@slow
def test_an_effect_of_millimetres_on_a_slow_craft_is_found(tmp_path, unplanned):
    """16 kg that full thrust accelerates by 0.0125 m/s^2: what a precise motion capture sees of a
    weak left thruster is small beside the noise of smoothed velocities, and large beside that of poses."""
    truth = _core.parse_model(SLOW % "[{name: thrust_asymmetry, a: 0.02}]", "truth")
    paths = []
    for seed in (1, 2):
        random = np.random.default_rng(seed)
        bits = random.integers(0, 2, (80, 2))
        commands = np.column_stack([np.arange(80) / 2, bits, np.zeros(80)])
        times = np.arange(60 * 40) / 60
        eta = _core.simulate(truth, commands, times, np.zeros(3), np.zeros(3))["eta"]
        eta = eta + random.normal(size=eta.shape) * [2e-5, 2e-5, 1e-4]
        held = bits[np.minimum((2 * times + 1e-9).astype(int), 79)]
        rows = ["time,x,y,psi,left,right"]
        rows += ["%.5f,%.7f,%.7f,%.7f,%d,%d" % (t, *pose, *now) for t, pose, now in zip(times, eta, held)]
        paths.append(tmp_path / ("run%d.csv" % seed))
        paths[-1].write_text("\n".join(rows) + "\n")
    (tmp_path / "model.yaml").write_text(SLOW % "[]")
    (tmp_path / "mapping.yaml").write_text("""schema: ground/mapping/1
poses: {position: {fields: [x, y]}, heading: {field: psi}, time: {field: time, unit: s}}
commands:
  time: {field: time, unit: s}
  channels: {left: {field: left}, right: {field: right}}
""")
    result = succeeds(
        "diagnose", *paths, "--mapping", tmp_path / "mapping.yaml", "--model", tmp_path / "model.yaml",
        "--only", "thrust_asymmetry", "quadratic_drag", "floor_tilt", "-o", tmp_path / "out",
    )  # fmt: skip
    report = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert report["verdict"] == "missing", result.stdout
    assert report["improved"]["effects"] == ["thrust_asymmetry"]


def held_by_a_controller(craft, seed, seconds=10.0):
    """A run of a craft that turns ever faster by itself, and is held by a controller of its heading."""
    random, state = np.random.default_rng(seed), np.zeros(6)
    strength = 2 * craft["l"] * craft["k"] / craft["I_z"]  # [rad/s^2]
    rows, times, poses = [], [], []
    for i in range(int(20 * seconds)):
        if i % 20 == 0:
            wanted, ahead = random.uniform(-1, 1), random.uniform(0.2, 0.5)
        turn = np.clip((25 * (wanted - state[2]) - 14 * state[5]) / strength, -0.4, 0.4)
        rows.append((0.05 * i, *np.clip([ahead + turn, ahead - turn], 0, 1), 1.0))
        at = 0.05 * i + np.arange(6) / 100
        found = _core.simulate(craft.core, np.array(rows), at, state[:3], state[3:])
        times, poses = [*times, *at[:-1]], [*poses, *found["eta"][:-1]]
        state = np.concatenate([found["eta"][-1], found["nu"][-1]])
    poses = np.array(poses) + random.normal(size=(len(poses), 3)) * (3e-4, 3e-4, 3e-3)
    commands = np.array(rows)
    return ground.Recording.from_arrays(times, poses, commands[:, 1:], commands[:, 0], name="run %d" % seed)


def test_a_model_that_diverges_along_whole_runs_is_diagnosed_and_said_to_do_so(tmp_path):
    """Over windows its motion is as measured; without the controller it goes off within seconds."""
    stable = ground.Model.load(MODEL)
    craft = stable + ground.Effect("spin", N="c*r", c=(stable["N_r"] + 3 * stable["I_z"], "N m s"))
    runs = [held_by_a_controller(craft, seed) for seed in (1, 2)]
    with pytest.warns(ground.GroundWarning, match="motion along run 1 is not finite"):
        found = ground.diagnose(craft, runs, only=["yaw_bias"])
    assert found.effects == () and found.verdict == "undecided"
    assert any("not finite over whole runs" in text for _, text in found.headline())
    assert list(found.details())
    with pytest.warns(ground.GroundWarning, match="no run is drawn: run 1"):
        written = found.save(tmp_path / "diagnosis")
    assert len(written) == 3
    schema("diagnosis").validate(json.loads((tmp_path / "diagnosis" / "diagnosis.json").read_text()))
    again = ground.load(tmp_path / "diagnosis")
    assert list(again.headline()) == list(found.headline())
    assert list(again.details()) == list(found.details()) and np.isnan(again.noise_floor)
    numbers = tmp_path / "diagnosis" / "diagnosis.json"
    older = json.loads(numbers.read_text())
    for row in older["candidates"]:  # they had one number
        row["p_value"] = row.pop("p_corrected")
        del row["p"]
    numbers.write_text(json.dumps(older))
    told, ranked = [], r"^ +\d+ +(\S+) "  # all but p is as it was
    for one in (found, ground.load(tmp_path / "diagnosis")):
        told.append([re.sub(ranked, "", line) for line in one.details()])
    assert told[0] == told[1]


def test_where_runs_differ_the_answer_says_how_its_model_predicts_an_unknown_run(unplanned):
    """Predictions that know the thrust of each run are better than the model that is written."""
    craft = ground.Model.load(MODEL).with_effect("yaw_bias", n0=2e-4)

    def flown(seed, thrust):
        truth = craft.with_values({"k": thrust * craft["k"]})
        return ground.simulate(truth, "multilevel-prbs", duration=6, seed=seed, name="run %d" % seed)

    found = ground.diagnose(MODEL, [flown(1, 0.9), flown(2, 1.0), flown(3, 1.1)], only=["yaw_bias"])
    assert found.effects == ("yaw_bias",)
    head = " ".join(text for _, text in found.headline())
    for part in (
        "thrust differs between runs",
        "same thrust in all runs",
        "comes from differences between runs",
    ):
        assert part in head, head
    known, written = (found.contents.prediction.errors[name] for name in ("improved", "written"))
    assert written.position_mm > 1.5 * known.position_mm and written.heading_deg > 2 * known.heading_deg
    unknown = ground.compare(found.improved, flown(4, 1.1)).prediction
    assert list(unknown.errors.values())[0].position_mm < 1.5 * written.position_mm
    ends, errors = found.conf_int(), found.bse
    half = (ends["high"] - ends["low"]) / 2
    assert (1.5 * errors < half).all() and (half < 3 * errors).all()  # what runs differ by is in both


def test_an_effect_that_is_known_only_as_a_whole_is_not_called_zero(unplanned):
    """Motion shows what the two added masses do, and neither of them."""
    truth = ground.Model.load(MODEL).with_effect("added_mass", mx=0.004, my=0.012)
    runs = [
        ground.simulate(truth, "prbs", duration=10, seed=seed, name="run %d" % seed) for seed in (1, 2, 3)
    ]
    found = ground.diagnose(MODEL, runs, only=["added_mass"])
    assert found.effects == ("added_mass",)
    answered = dict(found.headline())
    assert "ertain." in answered["Missing"] and "more runs" not in answered["Next"], answered


def test_a_craft_that_is_changed_in_a_run_is_not_diagnosed_with_certainty():
    from ground.reading.run_settings import LiveChange

    craft = ground.Model.load(MODEL)
    lagging = craft.with_effect("motor_lag", tau=0.06)
    run = ground.simulate(lagging, "multilevel-prbs", duration=20, seed=3)
    start = max(run.pose_times[0], run.control_times[0])
    changed = dataclasses.replace(run, changes=[LiveChange(start + 12, "/simulator", "k_factor", "1", "0.7")])
    whole = str(ground.diagnose(craft, changed, only=["motor_lag"]))
    assert "not confirmed" in whole and "k_factor" in whole and "--to 12" in whole
    part = str(ground.diagnose(craft, changed, only=["motor_lag"], end=11.5))
    assert "ertain" in part and "k_factor" not in part
    assert "k_factor" in str(ground.info(changed)) and "k_factor" not in str(ground.info(run))
    other = dataclasses.replace(run, changes=[LiveChange(start + 12, "/controller", "k_factor", "1", "0.7")])
    assert "not confirmed" not in str(ground.diagnose(craft, other, only=["motor_lag"]))
