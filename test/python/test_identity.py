"""Runs are told by what their files contain, and models by theirs; names are labels."""

import pathlib
import shutil

import pytest

import ground
from conftest import MODEL, identify, succeeds, write_bag

FREE = ["k"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """train/run1.bag and test/run1.bag, two runs of one name."""
    folder = tmp_path_factory.mktemp("runs")
    for seed, name in enumerate(("train", "test"), 1):
        (folder / name).mkdir()
        write_bag(folder / name / "run1.bag", seed=seed, duration=8)
    return folder


@pytest.fixture
def here(folder, monkeypatch):
    monkeypatch.chdir(folder)
    return folder


def refused(call, *words):
    """Checks that a call fails with one line that contains the words."""
    with pytest.raises(ground.GroundError) as error:
        call()
    assert "\n" not in str(error.value)
    for word in words:
        assert word in str(error.value)


def names_of(runs):
    return [run.name for run in runs]


# Two runs of one name


def test_folders_for_training_and_for_tests_may_have_the_same_names(here):
    found = ground.fit(MODEL, "train/run1.bag", holdout="test/run1.bag", free=FREE)
    assert found.error.holdout.after > 0
    both = ground.fit(MODEL, ["train/run1.bag", "test/run1.bag"], free=FREE)
    assert len({run.run for run in both.runs}) == 2
    arguments = "--model", MODEL, "-o", here / "by_name.yaml", "--free", "k"
    succeeds("fit", "train/run1.bag", "--holdout", "test/run1.bag", *arguments)
    added = ground.add(MODEL, "yaw_bias", "train/run1.bag", holdout="test/run1.bag")
    assert "holdout" in added.error


def test_a_diagnosis_names_both_runs_of_a_name(here):
    found = ground.diagnose(MODEL, "train/run1.bag", holdout="test/run1.bag", only=["yaw_bias"])
    runs = found.report["runs"]
    assert len({*runs["fit"], *runs["heldout"]}) == 2


def test_runs_read_at_once_or_one_by_one_get_names_of_their_own(here):
    paths = ["train/run1.bag", "test/run1.bag"]
    assert len(set(names_of(ground.read(paths)))) == 2
    one_by_one = [run for path in paths for run in ground.read(path)]
    compared = ground.compare(MODEL, one_by_one)
    assert len(set(names_of(compared.runs))) == 2
    assert len(compared.to_frame()) == 2


# One run of two names


@pytest.fixture
def twins(here, tmp_path):
    """Other paths of train/run1.bag: a link, and a folder with a copy."""
    source, link, folder = here / "train" / "run1.bag", tmp_path / "another.bag", tmp_path / "copy"
    link.symlink_to(source)
    folder.mkdir()
    shutil.copy(str(source), str(folder / "another.bag"))
    return link, folder


def test_a_run_is_not_taken_twice(twins):
    once = ground.read("train/run1.bag")
    for twin in twins:
        refused(lambda twin=twin: ground.read(["train/run1.bag", twin]), "twice", "run1.bag")
        refused(lambda twin=twin: ground.fit(MODEL, ["train/run1.bag", twin]), "twice")
        refused(lambda twin=twin: ground.compare(MODEL, [*once, *ground.read(twin)]), "twice")


def test_a_run_is_not_tested_on_what_it_was_fitted_to(here, twins):
    runs = ["train/run1.bag", "test/run1.bag"]
    for verb in (ground.fit, ground.diagnose, lambda *a, **o: ground.add(a[0], "wind", a[1], **o)):
        for twin in twins:
            refused(lambda v=verb, t=twin: v(MODEL, runs, holdout=t), "holdout", "train/run1.bag")
    result = identify("fit", *runs, "--holdout", twins[0], "--model", MODEL, "-o", here / "no.yaml")
    assert result.returncode == 1 and "holdout" in result.stderr
    assert result.stderr.count("\n") == 1


def test_a_fitted_model_knows_its_run_under_any_name(here, twins, tmp_path):
    ground.fit(MODEL, "train/run1.bag", free=FREE).save(tmp_path / "fitted.yaml")
    fitted = tmp_path / "fitted.yaml"

    def role(run):
        return ground.compare(fitted, run).runs[0].studies[0]["role"]

    assert {role(run) for run in ("train/run1.bag", *twins)} == {"fit"}
    assert role("test/run1.bag") == "held_out"


def test_the_mapping_of_a_table_does_not_make_it_another_run(here, tmp_path):
    table, run = tmp_path / "run.csv", ground.read("train/run1.bag")[0]
    run.to_frame().dropna().to_csv(table, index=False)
    mapping = """schema: ground/mapping/1
poses: {time: {field: t}, position: {fields: [%s, %s]}, heading: {field: psi}}
commands: {time: {field: t}, channels: {left: {field: left}, right: {field: right}, lift: {field: lift}}}
"""
    (tmp_path / "one.yaml").write_text(mapping % ("x", "y"))
    (tmp_path / "other.yaml").write_text(mapping % ("y", "x"))
    one, other = [ground.read(table, mapping=tmp_path / name)[0] for name in ("one.yaml", "other.yaml")]
    assert one.identity == other.identity != run.identity
    refused(lambda: ground.fit(MODEL, one, holdout=other), "holdout")


# Recordings in memory


def test_simulated_runs_of_the_default_name_are_different_runs(tmp_path):
    one, other = [ground.simulate(MODEL, duration=6, seed=seed) for seed in (1, 2)]
    found = ground.fit(MODEL, one, holdout=other, free=FREE)
    compared = ground.compare(found.model, [one, other])
    roles = [run.studies[0]["role"] for run in compared.runs]
    assert roles == ["fit", "held_out"] and len(set(names_of(compared.runs))) == 2
    again = ground.simulate(MODEL, duration=6, seed=1, name="again")
    refused(lambda: ground.fit(MODEL, one, holdout=again), "holdout")
    refused(lambda: ground.compare(MODEL, [one, one]), "twice")
    one.save(tmp_path / "saved.bag")
    assert ground.read(tmp_path / "saved.bag")[0].identity == one.identity


def test_a_model_file_without_digests_does_not_pretend_to_know(here, tmp_path):
    fitted = ground.fit(MODEL, "train/run1.bag", free=FREE).model
    text, digest = fitted.format(), ground.read("train/run1.bag")[0].identity
    assert digest in text
    lines = [line for line in text.splitlines() if digest not in line and "digests:" not in line]
    old = tmp_path / "old.yaml"
    old.write_text("\n".join(lines) + "\n")
    for run in ("train/run1.bag", "test/run1.bag"):
        found = ground.compare([old, MODEL], run)
        assert found.ranking.role == "fit"
        assert "predicts" not in found.title


# Models


def test_nothing_to_work_on_is_said_in_one_line():
    for verb in (ground.fit, ground.diagnose, ground.compare):
        refused(lambda verb=verb: verb(MODEL, []), "no recordings")
    refused(lambda: ground.add(MODEL, "yaw_bias", []), "no recordings")
    refused(lambda: ground.compare([], []), "no models")
    refused(lambda: ground.compare({}, []), "no models")


def test_a_changed_model_has_nothing_of_the_fit_before(here, tmp_path):
    fitted = ground.fit(MODEL, "train/run1.bag", free=FREE).model
    assert "confidence_95" in fitted.format()
    for changed in (
        fitted.with_values({"k": 0.2}),
        fitted.with_effect("yaw_bias", n0=1e-5),
        fitted.with_effect("yaw_bias").without_effect("yaw_bias"),
    ):
        text = changed.save(tmp_path / "changed.yaml", force=True).format()
        assert "confidence_95" not in text and "run1.bag" not in text and "error_after" not in text
    assert "confidence_95" in fitted.format()


# What a comparison says


def test_a_model_does_not_predict_the_run_that_it_was_fitted_to(here):
    fitted = ground.fit(MODEL, "train/run1.bag", free=FREE).model
    models = {"given": MODEL, "fitted": fitted}
    used = ground.compare(models, "train/run1.bag")
    assert "predicts" not in used.title and "used to fit fitted" in " ".join(repr(used).split())
    assert used.ranking.role == "fit" and used.ranking.fitted == ["fitted"]
    both = ground.compare(models, ["train/run1.bag", "test/run1.bag"])
    new = ground.compare(models, "test/run1.bag")
    assert "used to fit" not in " ".join(repr(both).split()) and len(both.ranking.runs) == 1
    assert both.ranking.errors == pytest.approx(new.ranking.errors)
    assert both.best == new.best == next(iter(new.ranking.errors))
    assert both.to_dict()["ranking"]["role"] == "held_out"
    assert both.noise_floor == pytest.approx(new.noise_floor)


def test_runs_that_another_model_was_fitted_to_do_not_rank(here):
    fits = [ground.fit(MODEL, p, free=FREE).model for p in ("train/run1.bag", "test/run1.bag")]
    found = ground.compare(fits, ["train/run1.bag", "test/run1.bag"])
    assert found.ranking.role == "fit" and len(found.ranking.fitted) == 2
    assert "predicts" not in found.title


# Folders of results


def files_in(folder):
    return {path.name: path.read_bytes() for path in pathlib.Path(folder).iterdir()}


def test_a_comparison_leaves_no_file_of_the_one_before(here, tmp_path):
    out, other = tmp_path / "out", ground.Model.load(MODEL).with_values({"k": 0.07})
    ground.compare({"one": MODEL, "two": other}, ["train/run1.bag", "test/run1.bag"]).save(out, page=False)
    (out / "notes.csv").write_text("mine")
    ground.compare({"two": other}, "test/run1.bag").save(out, page=False, force=True)
    fresh = tmp_path / "fresh"
    ground.compare({"two": other}, "test/run1.bag").save(fresh, page=False)
    assert set(files_in(out)) - set(files_in(fresh)) == {"notes.csv"}


def test_a_diagnosis_leaves_no_file_of_the_one_before(diagnosed, tmp_path):
    out = tmp_path / "out"

    def swapped(times, eta, inputs):
        return times, eta, inputs[:, [0, 2, 1, 3]]

    misread = write_bag(tmp_path / "misread.bag", duration=20, change=swapped)
    arguments = "--model", MODEL, "--only", "yaw_bias", "-o", out
    diagnosed.save(out)
    assert "improved.yaml" in files_in(out)
    (out / "proposal.yaml").write_text("left by an older diagnosis")
    (out / "next_experiment.csv").write_text("left by an older diagnosis")
    (out / "notes.txt").write_text("mine")
    second = succeeds("diagnose", misread, *arguments, "--force")
    left = files_in(out)
    assert "wrong" in second.stdout or "misread" in second.stdout
    assert "improved.yaml" not in left and left["notes.txt"] == b"mine"
    assert set(left) == {"diagnosis.json", "report.html", "notes.txt"}


def test_files_that_no_diagnosis_wrote_are_left_alone(diagnosed, tmp_path):
    (tmp_path / "proposal.yaml").write_text("mine")
    assert diagnosed.report["unexplained"]["proposal"] is None
    diagnosed.save(tmp_path, force=True)
    assert (tmp_path / "proposal.yaml").read_text() == "mine"
    assert not list(tmp_path.glob(".ground*"))
