"""The runs of a laboratory over months: what drifts, what jumped, which craft is odd."""

import datetime
import json
import os
import shutil

import numpy as np
import pytest

import ground
from conftest import MODEL, identify, slow, succeeds
from ground.ledger import changes, estimates, finding, hierarchy

CRAFTS = ("craft_1", "craft_2", "craft_3")
BATTERY = datetime.date(2025, 4, 12)  # since then craft 1 has another one
DAYS = [datetime.date(2025, 3, 3) + datetime.timedelta(days=11 * i) for i in range(8)]
RUNS = 2 * len(CRAFTS) * len(DAYS)


def fly(path, craft, k=1.0, seed=1, asymmetry=0.0, **options):
    """Records a run of a craft with a factor on its thrust."""
    model = ground.Model.load(MODEL)
    truth = model.with_values({"k": k * model["k"]})
    if asymmetry:
        truth = truth.with_effect("thrust_asymmetry", a=asymmetry)
    path.parent.mkdir(parents=True, exist_ok=True)
    options = {"duration": 6, "disturbance": [0.01, 0.3], **options}
    ground.simulate(truth, "prbs", seed=seed, **options).save(path)


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory):
    """Three crafts over three months, two runs a day: craft 1 gets another battery in April, craft 3 has
    unequal thrusters."""
    folder = tmp_path_factory.mktemp("laboratory")
    random, seed = np.random.default_rng(7), 0
    for craft in CRAFTS:
        for day in DAYS:
            for hour in (10, 11):
                seed += 1
                charge = 1 + 0.008 * random.normal()
                battery = 0.94 if craft == "craft_1" and day > BATTERY else 1.0
                name = "%s-%02d-05-00.bag" % (day, hour)
                odd = 0.08 if craft == "craft_3" else 0.0
                fly(folder / craft / str(day) / name, craft, charge * battery, seed, odd)
    return folder


@pytest.fixture(scope="module")
def told(laboratory, tmp_path_factory):
    """What identify history prints, and its folder."""
    out = tmp_path_factory.mktemp("told") / "history"
    result = succeeds("history", laboratory, "--model", MODEL, "-o", out, "--details")
    return result.stdout, out


def test_a_lab_learns_what_changed_in_months(told):
    text, folder = told
    first = " ".join(text.split("Next:")[0].split())
    found = json.loads((folder / "history.json").read_text())
    (jump,) = found["changes"]
    assert (jump["craft"], jump["parameter"], jump["kind"]) == ("craft_1", "k", "jump")
    ends = sorted(end / jump["before"] for end in jump["after_ci95"])
    assert ends[0] < 0.94 < ends[1] and ends[1] - ends[0] < 0.04
    before, after = (datetime.date.fromisoformat(time[:10]) for time in jump["times"])
    assert before <= BATTERY < after
    assert "k of craft_1 fell by" in first and "battery" in first
    (odd,) = found["odd"]
    assert (odd["craft"], odd["parameter"]) == ("craft_3", "thrust_asymmetry.a")
    assert odd["ci95"][0] < 0.08 < odd["ci95"][1] and not odd["either"]
    assert "craft_3" in first


def test_each_run_has_a_line_and_each_parameter_a_figure(told, laboratory):
    text, folder = told
    assert len([line for line in text.splitlines() if line.startswith("2025-")]) == RUNS
    assert len((folder / "runs.csv").read_text().splitlines()) == RUNS + 1
    again = ground.load(folder)
    frame = again.to_frame()
    k = ground.Model.load(MODEL)["k"]
    assert len(frame) == RUNS and ((frame["k low"] < frame["k"]) & (frame["k"] < frame["k high"])).all()
    inside = (frame["k low"] < 1.03 * k) & (frame["k high"] > 0.9 * k)
    assert inside.all()
    figures = again.plot()
    assert set(figures) == set(again.report["types"][0]["parameters"])
    assert len(figures["k"].layout.shapes) == 1 and "craft_1" in figures["k"].layout.meta["title"]
    page = (folder / "report.html").read_text()
    assert "craft_3" in page and "Evidence" in page


def test_the_next_call_fits_new_runs_only(told, laboratory, tmp_path):
    fresh = tmp_path / "lab"
    shutil.copytree(laboratory, fresh)
    fly(fresh / "craft_2" / "2025-06-20-10-00-00.bag", "craft_2", seed=99)
    before = set(os.listdir(estimates.cache_folder()))
    found = ground.history(fresh, model=MODEL)
    added = [name for name in set(os.listdir(estimates.cache_folder())) - before if "changes" not in name]
    assert len(added) == 1 and len(found.runs) == RUNS + 1
    assert [run["craft"] for run in found.runs[-1:]] == ["craft_2"]


def test_a_run_without_a_turn_is_wide_not_refused(tmp_path):
    rows = np.array([[0, 0.6, 0.6], [1.5, 0, 0], [3, 0.8, 0.8], [4, 0, 0], [5, 0, 0]])
    model = ground.Model.load(MODEL)
    ground.simulate(model, inputs=rows).save(tmp_path / "2025-03-01-straight.bag")
    for i in range(3):
        fly(tmp_path / ("2025-03-0%d-turns.bag" % (i + 2)), "craft", seed=i + 1)
    straight, *turning = ground.history(tmp_path, model=MODEL).runs
    assert straight["name"] == "2025-03-01-straight"

    def width(run, name):
        found = run["parameters"][name]
        ends = found["ci95"] if found else [None]
        return np.inf if None in ends else ends[1] - ends[0]

    assert "cannot be decided" in repr(ground.history(tmp_path, model=MODEL))
    for name in ("I_z", "N_r"):
        assert width(straight, name) > 3 * max(width(run, name) for run in turning)
    assert width(straight, "k") < 0.5 * model["k"]


def test_the_recorded_model_says_which_craft_flew(tmp_path):
    for craft, factor in (("alpha", 1.0), ("beta", 0.8)):
        model = ground.Model.load(MODEL)
        model = model.with_values({"k": factor * model["k"]}).save(tmp_path / (craft + ".yaml"))
        for i in range(2):
            run = ground.simulate(model, "tracking", duration=6, seed=i + len(craft))
            run.save(tmp_path / ("2025-05-0%d-%s.bag" % (i + 1, craft)))
    found = ground.history(tmp_path)
    assert [run["craft"] for run in found.runs] == ["alpha", "beta", "alpha", "beta"]
    (odd,) = found.odd
    assert odd["parameter"] == "k" and odd["either"]
    bare = tmp_path / "bare"
    fly(bare / "a.bag", "a")
    with pytest.raises(ground.GroundError, match="model"):
        ground.history(bare)


def test_what_cannot_be_used_is_listed(tmp_path):
    fly(tmp_path / "a.bag", "a")
    shutil.copy(str(tmp_path / "a.bag"), str(tmp_path / "copy.bag"))
    (tmp_path / "torn.bag").write_bytes((tmp_path / "a.bag").read_bytes()[:500])
    found = ground.history(tmp_path, model=MODEL)
    reasons = {os.path.basename(one["path"]): one["why"] for one in found.left_out}
    assert set(reasons) == {"copy.bag", "torn.bag"} and "copy of" in reasons["copy.bag"]
    assert found.runs[0]["time_from"] == "file" and "last change" in repr(found)


def test_bad_input_is_one_sentence(tmp_path):
    empty = identify("history", tmp_path, "--model", MODEL, "-o", tmp_path / "out")
    assert empty.returncode == 1 and len(empty.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()
    shutil.rmtree(str(tmp_path / "out"), ignore_errors=True)
    fly(tmp_path / "a.bag", "a")
    for options, word in (
        (["--model", MODEL, "--craft", "("], "--craft"),
        (["--model", MODEL, "--craft", "nowhere"], "--craft"),
        (["--model", MODEL, "--free", "mass"], "mass"),
    ):
        found = identify("history", tmp_path, "-o", tmp_path / "out", *options)
        assert found.returncode in (1, 2) and word in found.stderr and "Traceback" not in found.stderr


def test_verdicts_of_other_versions_are_listed_and_repeated(tmp_path, flown, diagnosed):
    shutil.copy(str(flown), str(tmp_path / "run.bag"))
    diagnosed.save(tmp_path / "diagnosis")
    (known,) = ground.history(tmp_path, model=MODEL).verdicts
    assert known["verdict"] == "missing" and known["current"]
    path = tmp_path / "diagnosis" / "diagnosis.json"
    report = json.loads(path.read_text())
    path.write_text(json.dumps({**report, "version": "0.0.1"}))
    found = ground.history(tmp_path, model=MODEL)
    assert not found.verdicts[0]["current"] and "0.0.1" in found.summary()
    path.write_text(json.dumps({**report, "version": "0.0.1", "model": "nowhere.yaml"}))
    (again,) = ground.history(tmp_path, model=MODEL, verdicts=True).verdicts
    assert "nowhere.yaml" in again["now"]["why"]


@slow
def test_a_repeated_verdict_is_the_same(tmp_path, flown, diagnosed):
    shutil.copy(str(flown), str(tmp_path / "run.bag"))
    diagnosed.save(tmp_path / "diagnosis")
    path = tmp_path / "diagnosis" / "diagnosis.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "version": "0.0.1"}))
    (again,) = ground.history(tmp_path, model=MODEL, verdicts=True).verdicts
    assert again["now"]["verdict"] == "missing" and not again["now"]["changed"]


# Times and crafts


def place(path):
    return finding.Place("/lab/" + path, "/lab")


@pytest.mark.parametrize(
    "path, expected",
    [
        ("craft/2019-04-11-11-09-43.bag", "2019-04-11T11:09:43"),
        ("2025_05_03/run7.bag", "2025-05-03T00:00:00"),
        ("a_20250503_1502.mcap", "2025-05-03T15:02:00"),
        ("2025-01-01/spin_2025-05-03.bag", "2025-05-03T00:00:00"),
    ],
)
def test_the_date_in_a_path_is_when_it_was_recorded(path, expected):
    at, source = finding.recorded_at(place(path), 1000.0)
    assert (at.isoformat(), source) == (expected, finding.NAME)


def test_stamps_are_before_names():
    stamp = datetime.datetime(2025, 5, 3, 10, 0).timestamp()
    at, source = finding.recorded_at(place("2019-04-11.bag"), stamp)
    assert (at.year, source) == (2025, finding.STAMPS)


def test_crafts_are_told_apart():
    places = [place("a/2025-05-03/x.bag"), place("2025-05-03/b/y.bag")]
    assert finding.crafts(places, ["one.yaml", "two.yaml"], None) == (["one", "two"], finding.BY_MODEL)
    assert finding.crafts(places, [None, None], None) == (["a", "b"], finding.BY_FOLDER)
    assert finding.crafts(places, [None, None], "1")[0] == ["a", "2025-05-03"]
    assert finding.crafts(places, [None, None], r"([xy])\.bag")[0] == ["x", "y"]


# Statistics


def made_up(random, count=24, fall=0.0, step=0.0):
    """Values with errors of 0.5%, a scatter of 1% from run to run, two runs a day."""
    mean = 1 - fall * np.linspace(0, 1, count) - step * (np.arange(count) >= count // 2)
    values = mean + 0.005 * random.normal(size=count) + 0.01 * random.normal(size=count)
    return changes.Series(values, np.full(count, 0.005**2), np.arange(count) // 2)


def test_nothing_changes_in_scatter():
    random = np.random.default_rng(1)
    assert sum(bool(changes.find(made_up(random), 0.01)) for _ in range(100)) <= 5


def test_a_step_is_found_with_its_place_and_size():
    random = np.random.default_rng(2)
    for _ in range(10):
        found = changes.find(made_up(random, step=0.08), 1e-3)
        assert [one.kind for one in found] == [changes.JUMP]
        assert abs(found[0].at - 12) <= 1 and found[0].low < -0.06 and found[0].high > -0.10


def test_an_interval_of_a_drift_holds_the_truth():
    random = np.random.default_rng(3)
    found = [changes.find(made_up(random, fall=0.1), 1e-2) for _ in range(40)]
    drifts = [one for own in found for one in own if one.kind == changes.DRIFT]
    assert len(drifts) >= 36
    assert sum(one.low < -0.1 < one.high for one in drifts) >= 0.85 * len(drifts)


def test_a_battery_that_fades_each_day_is_no_drift():
    random = np.random.default_rng(4)
    false = 0
    for _ in range(50):
        series = made_up(random)
        fading = series.values - 0.04 * (np.arange(24) % 2)
        false += bool(changes.find(changes.Series(fading, series.variance, series.day), 0.01))
    assert false <= 3


def runs_of(random, crafts=2, days=12, per_day=3, spread=(0.02, 0.03)):
    """Estimates of two parameters of which each run knows one combination well; scatter of days and runs."""
    count = crafts * days * per_day
    craft, day = np.arange(count) // (days * per_day), np.arange(count) // per_day
    truth = 1 + 0.1 * craft[:, None] + spread[0] * random.normal(size=(crafts * days, 2))[day]
    truth = truth + spread[1] * random.normal(size=(count, 2))
    directions = np.array([[1, 1], [1, -1]]) / np.sqrt(2)
    information = np.empty((count, 2, 2))
    for i in range(count):
        known = directions[i % 2]
        information[i] = np.outer(known, known) / 0.01**2
    errors = np.array([0.01 * random.normal() * directions[i % 2] for i in range(count)])
    unknown = 10 * random.normal(size=count)[:, None] * directions[(np.arange(count) + 1) % 2]
    return hierarchy.Runs(truth + errors + unknown, information, craft, day)


def test_runs_that_know_one_combination_each_give_all_parameters():
    found = hierarchy.fit(runs_of(np.random.default_rng(6)))
    deviation = np.sqrt(np.array([np.diag(one) for one in found.covariance]))
    assert (np.abs(found.mean - [[1.0, 1.0], [1.1, 1.1]]) < 4 * deviation).all() and (deviation < 0.03).all()


def test_scatters_of_days_and_runs_are_told_apart():
    random = np.random.default_rng(7)
    found = [hierarchy.fit(runs_of(random, days=30, per_day=4)) for _ in range(4)]
    day = np.sqrt(np.mean([one.day for one in found]))
    run = np.sqrt(np.mean([one.run for one in found]))
    assert 0.012 < day < 0.028 and 0.024 < run < 0.036
