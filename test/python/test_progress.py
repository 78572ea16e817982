"""Progress of long work: what is told, forecasts that can be believed, and how a terminal shows them."""
import io
import json
import random
import re

import pexpect
import pytest
from conftest import MODEL, QUIET, located
from ground import progress, terminal
from ground.progress import Report, Work


@pytest.fixture(autouse=True)
def progress_is_shown(monkeypatch):
    monkeypatch.setattr(terminal, "QUIET", QUIET)


class Clock:
    """A clock that runs only when it is told to."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now

    def run(self, seconds, *watchers, tick=0.25):
        """Lets time pass and calls watchers every `tick` seconds."""
        end = self.now + seconds
        while self.now < end - 1e-9:
            self.now = min(end, self.now + tick)
            for watch in watchers:
                watch()


class Watch:
    """What was forecast, and when; compared with what happened."""

    def __init__(self, clock, work):
        self.clock, self.work, self.began = clock, work, clock.now
        self.seen = []

    def __call__(self):
        report = self.work.report()
        if report.left is not None:
            self.seen.append((self.clock.now, report))

    def errors(self, since=0.0):
        """Relative errors of the forecast of the whole duration, from a share of it on."""
        total = self.clock.now - self.began
        return [
            abs(at - self.began + report.left - total) / total
            for at, report in self.seen
            if at - self.began > since * total
        ]

    def backwards(self):
        """Largest rise of the time left, and fall of the share."""
        pairs = list(zip(self.seen, self.seen[1:]))
        return (
            max(b.left - a.left for (_, a), (_, b) in pairs),
            max(a.share - b.share for (_, a), (_, b) in pairs),
        )

    def rise(self, seconds):
        """Largest rise of the time left within some seconds."""
        return max(
            b.left - a.left
            for i, (start, a) in enumerate(self.seen)
            for end, b in self.seen[i:]
            if end - start <= seconds
        )


def test_equal_units_are_forecast_from_the_first_ones_on():
    """A computer that is four times as slow as usual."""
    clock = Clock()
    work = Work(clock=clock)
    watch = Watch(clock, work)
    work.expect("fitting", 20, 0.5)
    work.expect("drawing", 5, 1.0)
    with work.stage("fitting"):
        for _ in work.each(range(20)):
            clock.run(2.0, watch)
    with work.stage("drawing"):
        for _ in work.each(range(5)):
            clock.run(4.0, watch)
    assert max(watch.errors(since=0.25)) < 0.1 and max(watch.errors(since=0.6)) < 0.03
    assert watch.backwards()[1] <= 0 and watch.rise(10) < 0.1 * 60


@pytest.mark.parametrize("seed", range(10))
def test_random_durations_hardly_run_backwards(seed):
    clock, rng = Clock(), random.Random(seed)
    work = Work(clock=clock)
    watch = Watch(clock, work)
    plan = {"reading": (400, 0.01), "searching": (30, 1.0), "testing": (12, 2.0)}
    for stage, (units, cost) in plan.items():
        work.expect(stage, units, cost)
    for stage, (units, cost) in plan.items():
        with work.stage(stage):
            for _ in work.each(range(units)):
                clock.run(cost * rng.lognormvariate(0.0, 0.5), watch)
    total = clock.now - watch.began
    assert max(watch.errors(since=0.3)) < 0.3
    assert watch.backwards()[1] <= 0 and watch.rise(10) < 0.1 * total


def test_a_stage_that_ends_early_only_shortens_the_forecast():
    """An upper bound of rounds."""
    clock = Clock()
    work = Work(clock=clock)
    watch = Watch(clock, work)
    work.expect("searching", 60, 1.0, at_most=True)
    work.expect("testing", 10, 1.0)
    with work.stage("searching"):
        for found in range(3):
            work.more(6 * (10 - 3 * found), at_most=True)
            assert work.report().at_most
            for _ in work.each(range(6)):
                clock.run(1.0, watch)
    with work.stage("testing"):
        for _ in work.each(range(10)):
            clock.run(1.0, watch)
    assert not work.report().at_most
    assert watch.rise(30) < 1.5
    assert max(watch.errors(since=0.85)) < 0.1


def test_a_forecast_that_was_far_too_low_is_corrected():
    clock = Clock()
    work = Work(clock=clock)
    watch = Watch(clock, work)
    work.expect("first", 10, 1.0)
    work.expect("second", 10, 0.1)
    for stage, cost in (("first", 1.0), ("second", 8.0)):
        with work.stage(stage):
            for _ in work.each(range(10)):
                clock.run(cost, watch)
    left = {round(at - watch.began): report.left for at, report in watch.seen}
    assert left[9] < 5 and left[50] == pytest.approx(40, rel=0.4) and left[70] == pytest.approx(20, rel=0.3)
    assert watch.backwards()[0] < 2.0


def test_overdue_units_leave_some_time():
    clock = Clock()
    work = Work(clock=clock)
    work.expect("fitting", 2, 5.0)
    with work.stage("fitting"):
        clock.run(5.0, work.report)
        work.step()
        clock.run(20.0, work.report)
        report = work.report()
        assert report.left > 1 and report.share < 0.97


def test_stages_inside_each_other_keep_their_own_time():
    clock = Clock()
    work = Work(clock=clock)
    work.expect("comparing", 2, 1.0)
    work.expect("drawing", 2, 1.0)
    for _ in range(2):
        with work.unit("comparing"):
            clock.run(3.0)
            with work.unit("drawing"):
                clock.run(1.0)
    assert work.spent("comparing") == pytest.approx(6.0)
    assert work.spent("drawing") == pytest.approx(2.0)
    assert work.report().left == 0.0


def test_nothing_is_forecast_before_the_plan_is_known():
    clock, heard = Clock(), []
    work = Work(heard.append, clock)
    work.expect("fitting", None)
    with work.stage("reading", 3):
        for _ in work.each(range(3)):
            clock.run(1.0)
    assert [r.left for r in heard] == [None] * 4
    assert [str(r) for r in heard] == ["reading, %d of 3" % n for n in range(4)]
    work.expect("fitting", 2, 1.0)
    assert work.report().left > 1


def test_durations_are_as_precise_as_forecasts():
    words = [progress.duration(s) for s in (0.2, 8.4, 31, 59, 61, 3500, 3700)]
    assert words == ["1 s", "9 s", "35 s", "60 s", "2 min", "59 min", "1 h 2 min"]


# How it is shown


def shown(kind, clock, work_of):
    """What a display prints while work_of(work, watch) runs."""
    stream = io.StringIO()
    display = kind("identify fit", stream, clock)
    work = Work(display.hear, clock)
    work_of(work, lambda: display.tick(work.report()))
    display.close()
    return stream.getvalue()


@pytest.mark.parametrize("kind", [terminal.Lines, terminal.Bar])
def test_short_work_shows_nothing(kind):
    clock = Clock()

    def short(work, watch):
        with work.stage("fitting", 10):
            for _ in work.each(range(10)):
                clock.run(0.09, watch)
            work.note("something")

    assert shown(kind, clock, short) == ""


def test_lines_come_every_few_seconds_without_control_characters():
    clock = Clock()

    def long(work, watch):
        work.expect("fitting", 100, 0.1)
        with work.stage("fitting"):
            for _ in work.each(range(100)):
                clock.run(0.2, watch)
                work.note("found %d" % work.report().done)

    lines = shown(terminal.Lines, clock, long).splitlines(keepends=True)
    assert 3 <= len(lines) <= 4
    assert all(re.fullmatch(r"[\x20-\x7e]+\n", line) for line in lines)
    first = r"identify fit: fitting, \d+ of 100; \d+% done, about \d+ s left; found 0; "
    assert re.match(first, lines[0]), lines[0]
    assert "found 20" in lines[1]  # of what was noted nothing is lost


def test_json_tells_other_programs_at_once():
    clock = Clock()

    def short(work, watch):
        work.expect("reading", 4, 0.1)
        with work.stage("reading"):
            for _ in work.each(range(4)):
                clock.run(0.3, watch)
        work.note("done")

    text = shown(terminal.Json, clock, short)
    reports = [Report(**json.loads(line)["progress"]) for line in text.splitlines()]
    assert (reports[0].what, reports[0].done, reports[0].of) == ("reading", 0, 4)
    assert reports[-1].note == "done" and len(reports) < 6


def test_a_bar_is_drawn_on_a_terminal_and_removed(tmp_path):
    """Through a pseudo-terminal, as a user has it: a bar with stage and time left, then no trace."""
    arguments = ["--model", MODEL, "--input", "prbs", "--duration", "900", "-o", tmp_path / "run.bag"]
    child = pexpect.spawn(
        located("identify"), ["simulate", *map(str, arguments)], encoding="utf-8", timeout=120,
        dimensions=(24, 100),
    )  # fmt: skip
    bar = r"writing the bag \(thousands of messages\), \d+ of \d+ \|[^|]+\|, \d+% done, about \d+ s left"
    child.expect(bar)
    child.expect(r"run\.bag: 902\.00 s, ")
    before = child.before
    child.expect(pexpect.EOF)
    child.close()
    assert child.exitstatus == 0
    assert re.search(r"\r *\r$", before[: before.rfind("\r") + 1]), repr(before[-200:])


@pytest.mark.parametrize("how, expected", [("off", False), ("lines", True)])
def test_progress_can_be_chosen(how, expected, tmp_path, identified):
    """Not on a terminal: lines, or nothing; the result on standard output is the same."""
    arguments = ["--model", MODEL, "--input", "prbs", "--duration", "900", "-o", tmp_path / "run.bag"]
    done = identified("simulate", *arguments, "--progress", how)
    assert done.returncode == 0, done.stderr
    assert ("identify simulate: writing the bag" in done.stderr) == expected
    assert "\r" not in done.stderr and "\x1b" not in done.stderr and "writing" not in done.stdout
    if not expected:
        assert done.stderr == ""


@pytest.fixture
def identified():
    """Runs the program as a process."""
    import subprocess

    def run(*arguments):
        command = [located("identify"), *map(str, arguments)]
        return subprocess.run(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, universal_newlines=True
        )  # fmt: skip

    return run
