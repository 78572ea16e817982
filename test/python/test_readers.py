"""The mapping and the recording of docs/howto/file_format.md, and files that are no recordings."""

import csv
import re

import numpy as np
import pytest

import ground
from conftest import MODEL, ROOT, identify, simulate_run

PAGE = ROOT / "docs" / "howto" / "file_format.md"


@pytest.fixture
def log(tmp_path, monkeypatch):
    """A log as the page describes it, with a header and without, in the current folder; its poses."""
    monkeypatch.chdir(tmp_path)
    times, eta, inputs = simulate_run(duration=4)
    at = np.searchsorted(inputs[:, 0], times, side="right") - 1
    rows = np.column_stack([times + 1000, eta[:, 0], -eta[:, 1], -np.degrees(eta[:, 2]), inputs[at, 1:]])
    np.savetxt("run.log", rows, "%.17g")
    rows[:, 4:6] *= 100
    with open("log.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time", "x", "y", "heading", "left", "right", "lift"])
        writer.writerows(rows.tolist())
    return eta


def fenced(language, start=""):
    """The only fence of the page that begins so."""
    found = re.findall(r"```%s\n(%s.*?)```" % (language, start), PAGE.read_text(), re.S)
    (text,) = found
    return text


def test_the_recording_of_the_page_is_taken_as_a_bag_is(log):
    scope = {"model": MODEL}
    exec(fenced("python"), scope)
    assert scope["run"].eta == pytest.approx(log)
    assert scope["found"].parameters["k"].identified


def test_the_mapping_of_the_page_reads_its_log(log):
    with open("mapping.yaml", "w") as file:
        file.write(fenced("yaml", "schema"))
    (run,) = ground.read("log.csv", mapping="mapping.yaml")
    assert run.eta == pytest.approx(log)
    info = identify("info", "log.csv", "--mapping", "mapping.yaml")
    assert (info.returncode, info.stderr) == (0, "")


def test_files_that_no_reader_takes_are_refused(log, tmp_path):
    (tmp_path / "run.exe").write_bytes(b"MZ\0\0")
    with pytest.raises(ground.GroundError, match="run.exe: neither a bag nor a table$"):
        ground.read("run.exe")
    for kind in ("model", "mapping"):
        (tmp_path / "f.yaml").write_text("# of a craft\nschema: ground/%s/1\n" % kind)
        with pytest.raises(ground.GroundError, match="a %s, not a recording.*--%s" % (kind, kind)):
            ground.read(tmp_path / "f.yaml")
    for name in ("log.csv", "run.log"):
        with pytest.raises(ground.GroundError, match=name + ": .*--write-mapping M.yaml"):
            ground.read(name)
    (tmp_path / "empty").mkdir()
    with pytest.raises(ground.GroundError, match="contains no bag, ROS 2 bag or table"):
        ground.read("empty")
