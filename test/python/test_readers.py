"""The registry of readers, with the user's reader of docs/howto/file_format.md."""

import csv
import re

import ground
import numpy as np
import pytest
from conftest import ROOT, identify, simulate_run
from ground.recordings import readers

PAGE = ROOT / "docs" / "howto" / "file_format.md"


@pytest.fixture
def registry(monkeypatch):
    monkeypatch.setattr(readers, "READERS", list(readers.READERS))


@pytest.fixture
def log(tmp_path, monkeypatch):
    """Writes a log as the page describes it to the current folder; gives its poses."""
    monkeypatch.chdir(tmp_path)
    times, eta, inputs = simulate_run(duration=4)
    at = np.searchsorted(inputs[:, 0], times, side="right") - 1
    rows = np.column_stack(
        [times + 1000, eta[:, 0], -eta[:, 1], -np.degrees(eta[:, 2]), inputs[at, 1:]]
    )
    with open("log.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time", "x", "y", "heading", "left", "right", "lift"])
        writer.writerows(rows.tolist())
    return eta


def test_a_registered_reader_is_used(registry, log, tmp_path):
    example = re.search(
        r"```python\n(import csv\nimport math\n\nimport ground\n.*?)```", PAGE.read_text(), re.S
    )
    scope = {}
    exec(example.group(1), scope)
    assert scope["run"].eta == pytest.approx(log)
    (in_folder,) = ground.read(tmp_path)
    assert in_folder.eta == pytest.approx(log)
    assert "400 at 100.0 Hz" in identify("info", "log.csv").stdout


def test_files_that_no_reader_takes_are_refused(registry, log):
    with pytest.raises(ground.GroundError, match="log.csv: not a bag$"):
        ground.read("log.csv")
    with pytest.raises(ground.GroundError, match="there is no bag in this folder"):
        ground.read(".")
