"""Progress of long work: what a function is told, and how a program shows it."""

import io
import json
import re
import sys

import pexpect
import pytest

from conftest import MODEL, located, process
from ground.support import progress
from ground.support.progress import Report, Work

LONG = ["--model", MODEL, "--input", "prbs", "--duration", "400"]


def test_a_function_is_told_of_stages_units_and_findings():
    told = []
    work = Work(told.append)
    with work.stage("reading", 3):
        for _ in work.each("ab"):
            pass
        work.reach(3)
        work.reach(2)
        with work.stage("fitting"):
            work.more(2)
            work.step()
            work.note("k is 0.062")
    work.step()  # after the last stage
    assert [(r.what, r.done, r.of) for r in told] == [
        ("reading", 0, 3), ("reading", 1, 3), ("reading", 2, 3), ("reading", 3, 3),
        ("fitting", 0, 1), ("fitting", 1, 2), ("fitting", 1, 2),
    ]  # fmt: skip
    assert str(told[1]) == "reading, 1 of 3" and str(told[-1]) == "k is 0.062"
    assert Work.of(work) is work


def test_json_tells_other_programs_at_once(monkeypatch):
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with progress.shown("identify fit", "json") as work, work.stage("reading", 4):
        work.note("a gap")
    reports = [Report(**json.loads(line)["progress"]) for line in sys.stderr.getvalue().splitlines()]
    assert reports == [Report("reading", 0, 4), Report("reading", 0, 4, "a gap")]


def test_a_bar_is_drawn_on_a_terminal_and_removed(tmp_path):
    """Through a pseudo-terminal, as a user has it: a bar with its stage, then no trace of it."""
    arguments = map(str, ["simulate", *LONG, "-o", tmp_path / "run.bag"])
    child = pexpect.spawn(
        located("identify"), list(arguments), encoding="utf-8", timeout=120, dimensions=(24, 100)
    )
    child.expect(r"writing the bag \(thousands of messages\): +\d+%")
    child.expect(r"\r *\r[^\r\n]*Simulated: +402\.00 s, ")
    child.expect(pexpect.EOF)
    child.close()
    assert child.exitstatus == 0


@pytest.mark.parametrize("how, expected", [("off", False), ("lines", True)])
def test_progress_can_be_chosen(how, expected, tmp_path):
    """Not on a terminal: lines, or nothing; the result on standard output is the same."""
    done = process("identify", "simulate", *LONG, "-o", tmp_path / "run.bag", "--progress", how)
    assert done.returncode == 0, done.stderr
    assert ("identify simulate: writing the bag" in done.stderr) == expected
    assert re.search("[\r\x1b]", done.stderr) is None and "writing" not in done.stdout
