"""A failure to read or write ends with one line and status 1; only --debug shows a traceback."""

import contextlib
import json
import os
import resource
import shutil
import signal
from unittest import mock

import numpy as np
import pytest
import rosbag

from conftest import MODEL, SCRIPTS, free_port, script, simulate_run, write_bag
from ground import cli
from ground.data import info
from ground.reading import messages as topics
from ground.support import files, workers
from ground.support.errors import GroundError
from test_identify import write_csv


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    """A folder with a run of 3 s as plain bag, as the recorder's bag and as CSV, one of 7 s, and a
    model."""
    folder = tmp_path_factory.mktemp("sample")
    write_bag(folder / "plain.bag", duration=3, seed=2)
    options = dict(compression="lz4", chunk_threshold=topics.CHUNK)
    with rosbag.Bag(str(folder / "plain.bag")) as source:
        with rosbag.Bag(str(folder / "small.bag"), "w", **options) as bag:
            for topic, message, time in source.read_messages():
                bag.write(topic, message, time)
    write_bag(folder / "run.bag", duration=7, seed=2)
    times, eta, inputs = simulate_run(duration=3)
    write_csv(folder / "controls.csv", inputs[:, 0], inputs[:, 1:])
    write_csv(folder / "pose.csv", times, eta)
    shutil.copy(str(MODEL), str(folder / "model.yaml"))
    return folder


@pytest.fixture
def here(sample, tmp_path, monkeypatch):
    """A working folder that has only links to the files of the sample."""
    for path in sample.iterdir():
        (tmp_path / path.name).symlink_to(path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def fails(capsys, arguments, *words, run=cli.main):
    """Checks that the command fails with one line that contains the words; returns the line."""
    capsys.readouterr()
    try:
        status = run([str(a) for a in arguments])
    except SystemExit as end:  # raised by argparse
        status = end.code
    assert status == 1
    stderr = capsys.readouterr().err
    assert "Traceback" not in stderr and "unexpected" not in stderr and stderr.count("\n") == 1, stderr
    for word in words:
        assert word in stderr, stderr
    return stderr


WRITING = {
    "import": ["import", "controls.csv", "pose.csv", "-o", "out.bag"],
    "simulate": ["simulate", "--model", "model.yaml", "--input", "prbs", "--duration", "3"]
    + ["-o", "out.bag"],
    "fit": ["fit", "run.bag", "--model", "model.yaml", "-o", "out.yaml"],
    "add": ["add", "motor_lag", "run.bag", "--model", "model.yaml", "-o", "out.yaml"],
    "compare": ["compare", "run.bag", "--model", "model.yaml", "--numbers", "-o", "out"],
}


def left(folder):
    """Names of the regular files in a folder and below it, hidden ones included."""
    return [p.name for p in folder.rglob("*") if p.is_file() and not p.is_symlink()]


@pytest.mark.parametrize("damage, count", [("flip", 20), ("cut", 10)])
def test_a_damaged_bag_gives_no_traceback(here, capsys, damage, count):
    random = np.random.default_rng(7)
    for number in range(count):
        data = bytearray((here / ("plain.bag" if number % 2 else "small.bag")).read_bytes())
        if damage == "cut":
            del data[int(random.integers(1, len(data))) :]
        else:
            data[int(random.integers(len(data)))] ^= 1 << int(random.integers(8))
        (here / "damaged.bag").write_bytes(data)
        capsys.readouterr()
        status = cli.main(["info", "damaged.bag"])
        stderr = capsys.readouterr().err
        assert status in (0, 1), number
        assert "Traceback" not in stderr and "unexpected" not in stderr, (number, stderr)
        failures = [line for line in stderr.splitlines() if line.startswith("identify info:")]
        assert len(failures) == status, (number, stderr)
        if damage == "cut":
            assert stderr, number


@pytest.mark.parametrize("verb", list(WRITING))
def test_a_full_disk_is_one_line_and_leaves_no_partial_file(here, capsys, verb):
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    # A limit on the size of files acts like a full disk.
    resource.setrlimit(resource.RLIMIT_FSIZE, (200, before[1]))
    try:
        status = cli.main(WRITING[verb])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    stderr = capsys.readouterr().err
    assert status == 1 and stderr.count("\n") == 1 and "Traceback" not in stderr, stderr
    assert "cannot be written" in stderr and "out" in stderr
    assert left(here) == []


REPEATED = {
    "fit": ["fit", "run.bag", "--model", "model.yaml", "-o", "out.yaml", "--force"],
    "compare": ["compare", "run.bag", "--model", "model.yaml", "-o", "out", "--force"],
    "history": ["history", "run.bag", "--model", "model.yaml", "-o", "out", "--force"],
}


def is_whole(name, data):
    """Whether a result can be read to its end."""
    text = data.decode()
    if name.endswith(".json"):
        return bool(json.loads(text))
    return text.rstrip().endswith("</html>") if name.endswith(".html") else text.endswith("\n")


@pytest.mark.parametrize("verb", list(REPEATED))
def test_a_full_disk_leaves_no_result_in_part(here, capsys, verb):
    """Wherever in its results a command finds the disk full, each file is the old or the new one; a page that
    does not belong to the numbers any more is gone."""
    assert cli.main(REPEATED[verb]) == 0
    sizes = {name: (here / path).stat().st_size for name, path in results(here).items()}
    assert sizes
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    for size in sorted(max(200, size - 1) for size in sizes.values()):
        capsys.readouterr()
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
        try:
            status = cli.main(REPEATED[verb])
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
        stderr = capsys.readouterr().err
        assert status == 1 and "Traceback" not in stderr and "written" in stderr, stderr
        assert set(sizes) - {"report.html"} <= set(results(here)) <= set(sizes)
        for name, path in results(here).items():
            assert is_whole(name, (here / path).read_bytes()), "%s, %d bytes" % (name, size)


def results(folder):
    """Files that a command has left, by name; hidden ones included."""
    return {p.name: p for p in folder.rglob("*") if p.is_file() and not p.is_symlink()}


def test_output_to_a_full_device_is_one_line(here, capsys):
    with open("/dev/full", "w") as full:
        with contextlib.redirect_stdout(full):
            assert cli.main(["info", "run.bag"]) == 1
    stderr = capsys.readouterr().err
    assert stderr.count("\n") == 1 and "No space left" in stderr


def test_an_unusable_path_is_one_line(here, capsys, monkeypatch):
    fit = ["fit", "run.bag", "--model", "model.yaml", "-o"]
    fails(capsys, fit + ["x" * 300 + ".yaml"], "name", "shorter")
    fails(capsys, fit + ["/proc/out.yaml"], "/proc/out.yaml")
    (here / "empty").mkdir()
    fails(capsys, ["info", "empty"], "contains no bag, ROS 2 bag or table")
    fails(capsys, ["info", "x" * 300], "no such file")
    options = ["--model", "model.yaml", "-o", "out.yaml"]
    fails(capsys, ["fit", "empty", *options], "contains no bag, ROS 2 bag or table")
    fails(capsys, ["fit", "run.bag", "--model", ".", "-o", "out.yaml"], "it is a folder")
    fails(capsys, ["fit", "run.bag", "--model", "run.bag", "-o", "out.yaml"], "run.bag")
    fails(capsys, ["compare", "run.bag", "--model", "model.yaml", "-o", "run.bag"], "folder")
    fails(capsys, ["compare", "run.bag", "--model", "model.yaml", "-o", "x" * 300], "folder")
    fails(capsys, ["import", ".", "pose.csv", "-o", "out.bag"], "Is a directory")
    fails(capsys, ["import", "run.bag", "pose.csv", "-o", "out.bag"], "run.bag")
    fails(capsys, ["add", "./run.yaml", "run.bag", "--model", "model.yaml", "-o", "o"], "run.yaml")
    (here / "bytes.yaml").write_bytes(b"name: \xff\xfe\n")
    (here / "date.yaml").write_text("name: 2001-99-99\n")
    for name in ("bytes.yaml", "date.yaml"):
        fails(capsys, ["add", name, "run.bag", "--model", "model.yaml", "-o", "o.yaml"], name)
        options = ["--model", "model.yaml", "--gains", name]
        fails(capsys, options, name, run=lambda argv: cli.program("track", argv))
        fails(capsys, options + ["-o", "g"], name, run=lambda argv: cli.program("tune", argv))
    assert sorted(left(here)) == ["bytes.yaml", "date.yaml"]


@pytest.mark.parametrize(
    "error, words",
    [
        (MemoryError(), "memory"),
        (KeyboardInterrupt(), "interrupted"),
        (OSError(28, "No space left on device", "there/x"), "there/x: No space left on device; make"),
        (ZeroDivisionError("some\ndefect"), "unexpected ZeroDivisionError: some defect; --debug"),
    ],
)
def test_only_debug_shows_a_traceback(capsys, monkeypatch, error, words):
    def fail(_):
        raise error

    monkeypatch.setattr(info, "run", fail)
    for arguments in (["info", "a"], ["info", "a", "--debug"]):
        assert cli.main(arguments) == 1
        stderr = capsys.readouterr().err
        assert words in stderr.splitlines()[-1]
        assert ("Traceback" in stderr) == ("--debug" in arguments)
        assert "--debug" in arguments or stderr.count("\n") == 1
    monkeypatch.setenv("GROUND_DEBUG", "1")
    assert cli.main(["info", "a"]) == 1 and "Traceback" in capsys.readouterr().err


@pytest.mark.parametrize("name", sorted(path.name for path in SCRIPTS.iterdir()))
def test_every_program_has_help_without_a_master(name, monkeypatch, capsys):
    """As README promises; nodes are programs, too."""
    monkeypatch.setenv("ROS_MASTER_URI", "http://localhost:%d" % free_port())
    assert script(monkeypatch, name, "--help") == 0
    shown = capsys.readouterr()
    assert "usage: %s" % name in shown.out and shown.err == ""


def killed(_):
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_process_that_is_killed_at_work_is_told():
    with pytest.raises(GroundError, match="worker process was killed"):
        list(workers.Workers(processes=True).map(killed, [bytes(10**7)] * 12))  # more than pipes hold


def test_programs_fail_in_one_line(monkeypatch, capsys, tmp_path):
    monkeypatch.setenv("ROS_MASTER_URI", "http://localhost:%d" % free_port())
    monkeypatch.setenv("DISPLAY", ":1")
    (tmp_path / "file").write_text("")
    for arguments in (
        ("record", "--dir", tmp_path / "file"),
        ("record", "--dir", "/proc/nowhere"),
        ("record", "--dir", tmp_path / ("x" * 300)),
        ("demo", "--out", tmp_path / "file"),
        ("demo", "--effect", "motor_lags"),
        ("parameters",),
        ("view",),
        ("identify", "info", tmp_path),
        ("track", "--model", tmp_path),
        ("tune", "--model", tmp_path, "-o", tmp_path / "g.yaml"),
    ):
        capsys.readouterr()
        assert script(monkeypatch, *arguments) == 1, arguments
        stderr = capsys.readouterr().err
        assert stderr.startswith(arguments[0]) and stderr.count("\n") == 1, stderr


def test_the_identification_node_is_free_after_a_task_whatever_goes_wrong(tmp_path, monkeypatch):
    """Its program prints half a line of progress and goes on; then a publisher is closed before the end."""
    import rospy

    from ground.nodes import identification_node

    program, bag = tmp_path / "program", tmp_path / "run.bag"
    program.write_text("#!/bin/sh\necho $$ > %s\necho '{\"progress\": ' >&2\nexec sleep 30\n" % bag)
    program.chmod(0o755)
    bag.write_text("")
    params = {"~model": str(MODEL), "~output": str(tmp_path / "output")}
    monkeypatch.setattr(rospy, "get_param", lambda name, default=None: params.get(name, default))
    monkeypatch.setattr(rospy, "Time", mock.Mock(now=rospy.Time))
    for name in ("Publisher", "Subscriber", "Service", "on_shutdown"):
        monkeypatch.setattr(rospy, name, mock.Mock())
    node = identification_node.IdentificationNode(str(program))
    request = identification_node.IdentifyRequest(bags=[str(bag)])
    failed = node.serve("fit", request)
    assert not failed.success and "busy" not in failed.message
    with pytest.raises(ProcessLookupError):
        os.kill(int(bag.read_text()), 0)
    rospy.Publisher().publish.side_effect = rospy.ROSException("publish() to a closed topic")
    for _ in range(2):  # the second one is not refused as busy
        with pytest.raises(rospy.ROSException):
            node.serve("fit", request)


# --- outputs that are inputs, other kinds of files


@pytest.fixture
def copied(sample, tmp_path, monkeypatch):
    """A copy of a run and a model as working folder."""
    for name in ("run.bag", "model.yaml"):
        shutil.copy(str(sample / name), str(tmp_path / name))
    monkeypatch.chdir(tmp_path)
    return tmp_path


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
def test_an_input_is_never_overwritten_even_with_force(copied, capsys, arguments):
    (copied / "symlink").symlink_to("run.bag")
    os.link(str(copied / "run.bag"), str(copied / "hardlink"))
    (copied / "link_to_here").symlink_to(copied)
    (copied / "steps.csv").write_text("time,left,right\n0,1,0\n1,0,1\n")
    (copied / "effect.yaml").write_text("{name: motor_lag, tau: 0.05}")
    (copied / "out").mkdir()
    for name in ("improved.yaml", "report.html", "fit.csv"):
        shutil.copy(str(MODEL), str(copied / "out" / name))
    (copied / "out" / "run.wrench.fit.csv").symlink_to("fit.csv")
    shutil.copy(str(copied / "run.bag"), str(copied / "out" / "diagnosis.json"))
    before = contents(copied), contents(copied / "out")
    fails(capsys, arguments, "is an input of this command", "choose another output")
    assert before == (contents(copied), contents(copied / "out"))


def test_programs_refuse_to_overwrite_their_inputs(copied, capsys):
    (copied / "way.csv").write_text("time,x,y\n0,0,0\n5,1,0\n10,1,1\n")
    before = contents(copied)
    options = ["--model", "model.yaml", "--force"]
    runs = lambda verb: lambda argv: cli.program(verb, argv)  # noqa: E731
    fails(capsys, options + ["-o", "model.yaml"], "model.yaml: it is an input", run=runs("tune"))
    more = ["--references", "way.csv:speed=0.5", "-o", "way.csv"]
    fails(capsys, options + more, "way.csv: it is an input", run=runs("tune"))
    assert before == contents(copied)


def test_only_regular_files_are_replaced(copied, capsys):
    os.mkfifo(str(copied / "pipe"))
    (copied / "folder").mkdir()
    fails(capsys, FIT + ["pipe"], "not a regular file")
    fails(capsys, FIT + ["folder"], "is a folder")
    fails(capsys, FIT + ["nowhere/f.yaml"], "no folder")


def test_a_file_is_whole_or_not_there(tmp_path):
    path = tmp_path / "new.json"
    files.write_json(str(path), {"a": float("nan")})
    assert path.read_text().split() == ["{", '"a":', "null", "}"]
    with pytest.raises(GroundError, match="exists"):
        files.write_json(str(path), {})
    with pytest.raises(GroundError, match="exists"):
        with files.new_file(str(tmp_path / "late.json")):
            (tmp_path / "late.json").write_text("somebody else's")
    with pytest.raises(ZeroDivisionError):
        with files.new_file(str(path), force=True):
            1 / 0  # noqa: B018
    assert (tmp_path / "late.json").read_text() == "somebody else's"
    assert sorted(contents(tmp_path)) == ["late.json", "new.json"]
