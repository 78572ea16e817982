"""Writing files: outputs that are inputs, other kinds of files, file systems without hard links."""

import os
import shutil

import pytest

from conftest import MODEL, write_bag
from ground import cli
from ground.support import errors, files


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    """A folder with a short run and a model."""
    folder = tmp_path_factory.mktemp("sample")
    write_bag(folder / "run.bag", duration=7, seed=2)
    shutil.copy(str(MODEL), str(folder / "model.yaml"))
    return folder


@pytest.fixture
def here(sample, tmp_path, monkeypatch):
    """A copy of the sample as working folder."""
    for name in ("run.bag", "model.yaml"):
        shutil.copy(str(sample / name), str(tmp_path / name))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def fails(capsys, arguments, *words, run=cli.main):
    """Checks that the tool ends with status 1 and one line that contains the words; returns the line."""
    capsys.readouterr()
    assert run([str(a) for a in arguments]) == 1
    stderr = capsys.readouterr().err
    assert "Traceback" not in stderr and stderr.count("\n") == 1, stderr
    for word in words:
        assert word in stderr, stderr
    return stderr


def contents(folder):
    return {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()}


FIT = ["fit", "run.bag", "--model", "model.yaml", "--force", "-o"]
SIMULATE = ["simulate", "--model", "model.yaml", "--input", "steps.csv", "--force", "-o"]


@pytest.mark.parametrize(
    "arguments",
    [
        FIT + ["model.yaml"],
        FIT + ["run.bag"],
        FIT + ["./run.bag"],
        FIT + ["symlink"],
        FIT + ["hardlink"],
        FIT + ["link_to_here/model.yaml"],
        ["fit", "run.bag", "--holdout", "hardlink", "--model", "model.yaml", "--force", "-o"] + ["symlink"],
        ["add", "motor_lag", "run.bag", "--model", "model.yaml", "--force", "-o", "model.yaml"],
        ["add", "effect.yaml", "run.bag", "--model", "model.yaml", "--force", "-o", "effect.yaml"],
        ["diagnose", "run.bag", "--model", "out/improved.yaml", "--force", "-o", "out"],
        ["diagnose", "out/diagnosis.json", "--model", "model.yaml", "--force", "-o", "out"],
        ["compare", "run.bag", "--model", "out/report.html", "--force", "-o", "out"],
        ["compare", "run.bag", "--model", "out/fit.csv", "--force", "-o", "out"],
        SIMULATE + ["model.yaml"],
        SIMULATE + ["steps.csv"],
        ["import", "steps.csv", "effect.yaml", "--force", "-o", "steps.csv"],
    ],
)
def test_an_input_is_never_overwritten_even_with_force(here, capsys, arguments):
    (here / "symlink").symlink_to("run.bag")
    os.link(str(here / "run.bag"), str(here / "hardlink"))
    (here / "link_to_here").symlink_to(here)
    (here / "steps.csv").write_text("time,left,right\n0,1,0\n1,0,1\n")
    (here / "effect.yaml").write_text("{name: motor_lag, tau: 0.05}")
    (here / "out").mkdir()
    for name in ("improved.yaml", "report.html", "fit.csv"):
        shutil.copy(str(MODEL), str(here / "out" / name))
    (here / "out" / "run.wrench.fit.csv").symlink_to("fit.csv")
    shutil.copy(str(here / "run.bag"), str(here / "out" / "diagnosis.json"))
    before = contents(here), contents(here / "out")
    fails(capsys, arguments, "is an input of this command", "choose another output")
    assert before == (contents(here), contents(here / "out"))


def test_programs_refuse_to_overwrite_their_inputs(here, capsys):
    (here / "way.csv").write_text("time,x,y\n0,0,0\n5,1,0\n10,1,1\n")
    before = contents(here)
    options = ["--model", "model.yaml", "--force"]
    runs = lambda verb: lambda argv: cli.program(verb, argv)  # noqa: E731
    fails(capsys, options + ["-o", "model.yaml"], "model.yaml: it is an input", run=runs("tune"))
    more = ["--references", "way.csv:speed=0.5", "-o", "way.csv"]
    fails(capsys, options + more, "way.csv: it is an input", run=runs("tune"))
    assert before == contents(here)


def test_only_regular_files_are_replaced(here, capsys):
    os.mkfifo(str(here / "pipe"))
    (here / "folder").mkdir()
    fails(capsys, FIT + ["pipe"], "not a regular file")
    fails(capsys, FIT + ["folder"], "is a folder")
    fails(capsys, FIT + ["nowhere/f.yaml"], "no folder")


def test_a_file_is_whole_or_not_there(tmp_path):
    path = tmp_path / "new.json"
    files.write_json(str(path), {"a": float("nan")})
    assert path.read_text().split() == ["{", '"a":', "null", "}"]
    with pytest.raises(errors.GroundError, match="exists"):
        files.write_json(str(path), {})
    with pytest.raises(errors.GroundError, match="exists"):
        with files.new_file(str(tmp_path / "late.json")):
            (tmp_path / "late.json").write_text("somebody else's")
    with pytest.raises(ZeroDivisionError):
        with files.new_file(str(path), force=True):
            1 / 0  # noqa: B018
    assert (tmp_path / "late.json").read_text() == "somebody else's"
    assert sorted(contents(tmp_path)) == ["late.json", "new.json"]
