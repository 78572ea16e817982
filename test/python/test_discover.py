"""identify discover as users run it: a simulated craft finds its own physics."""
import dataclasses
import json
import signal
import subprocess
import time

import pytest
from conftest import MODEL, identify, located
from test_diagnose import with_effect
from test_identify import fails

import ground
from ground.discovery.story import CONFIRM, Story

pytestmark = pytest.mark.usefixtures("one_preparation")

OPTIONS = ["--budget", 80, "--no-track", "--latency", 0.02, "--progress", "off"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("discover")


@pytest.fixture(scope="module")
def truth(folder):
    return with_effect(folder / "truth.yaml", "{name: yaw_bias, n0: 1e-4}")


@pytest.fixture(scope="module")
def discovered(folder, truth):
    """What the verb has printed, and its folder."""
    out = folder / "found"
    result = identify("discover", "--model", MODEL, "--truth", truth, "-o", out, *OPTIONS)
    assert result.returncode == 0, result.stderr
    return result.stdout, out


def story_of(out):
    return Story.from_dict(json.loads((out / "journal.json").read_text()))


def test_it_finds_the_hidden_effect_and_confirms_it(discovered):
    text, out = discovered
    story = story_of(out)
    assert story.ended and story.findings[-1].effects == ["yaw_bias"]
    assert story.confirmation.holds and story.confirmation.final < story.confirmation.given
    assert story.flights[-1].flight.purpose == CONFIRM and story.flown <= 80
    found = ground.Model.load(out / story.versions[-1].file)
    assert found["yaw_bias.n0"] == pytest.approx(1e-4, rel=0.1)
    assert "Constant yaw moment (yaw_bias) is missing." in text.split("\n\n")[-1]


def test_it_tells_each_flight_as_it_happens(discovered):
    text, out = discovered
    lines = text.splitlines()
    told = [line.split(" (")[0] for line in lines if line.startswith("Flight ")]
    assert told == ["Flight %d" % (i + 1) for i in range(len(story_of(out).flights))]
    assert sum(line.startswith("   Flown ") for line in lines) == len(told)
    assert "error of prediction: given" in text and "The final model predicts the flight" in text
    assert lines[-1] == "written to %s" % (out / "report.html")


def test_its_folder_has_all_that_it_tells(discovered):
    _, out = discovered
    story = story_of(out)
    for flown in story.flights:
        assert len(ground.read(out / flown.recording)) == 1
        head, *rows = (out / flown.flight.inputs).read_text().splitlines()
        assert head == "time,left,right,lift" and len(rows) > 5
    page = (out / "report.html").read_text()
    assert "Constant yaw moment (yaw_bias) is missing." in page
    assert page.count("<summary>Flight ") == len(story.flights)


def test_the_same_command_adds_nothing_to_what_has_ended(discovered, truth):
    _, out = discovered
    before = (out / "journal.json").read_text()
    result = identify("discover", "--model", MODEL, "--truth", truth, "-o", out, *OPTIONS, "--json")
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout) == json.loads(before)
    assert (out / "journal.json").read_text() == before


class Interruption:
    """Interrupts as Ctrl-C does, after the first flight."""

    def __init__(self, *_):
        pass

    def __call__(self, story):
        if story.flights:
            raise KeyboardInterrupt


def test_an_interrupted_discovery_is_continued(folder, truth, monkeypatch):
    out = folder / "interrupted"
    arguments = ["discover", "--model", MODEL, "--truth", truth, "-o", out, "--budget", 50]
    arguments += ["--no-track", "--progress", "off"]
    with monkeypatch.context() as patch:
        patch.setattr("ground.reports.discovery_words.Teller", Interruption)
        result = identify(*arguments)
    assert result.returncode == 1
    assert result.stderr == (
        "identify discover: interrupted; the same command continues %s\n" % out
    )
    first = story_of(out)
    assert len(first.flights) == 1 and not first.ended
    assert "<summary>Flight 1 " in (out / "report.html").read_text()
    result = identify(*arguments)
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith("1 flight and %.0f s of flight are known already." % first.flown)
    story = story_of(out)
    assert story.ended
    again = dataclasses.replace(story.flights[0], floor=None)  # known after the diagnosis
    assert again == first.flights[0]


def kill_when(arguments, out, happens):
    """Starts the tool in a process of its own, and ends it as a loss of power does."""
    with subprocess.Popen([located("identify"), *map(str, arguments)], stdout=subprocess.DEVNULL) as process:
        deadline = time.monotonic() + 240
        while not happens() and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.005)
        process.kill()
    assert process.returncode == -signal.SIGKILL


def test_a_killed_discovery_ends_with_the_model_of_one_that_was_not(folder, truth, discovered):
    _, whole = discovered
    out = folder / "killed"
    arguments = ["discover", "--model", MODEL, "--truth", truth, "-o", out, *OPTIONS]

    def begun():
        return out.is_dir() and any(out.iterdir())

    def diagnoses_again():
        return (out / "journal.json").exists() and (
            story_of(out).findings and story_of(out).activity.startswith("diagnoses")
        )

    kill_when(arguments, out, begun)
    kill_when(arguments, out, diagnoses_again)
    result = identify(*arguments)
    assert result.returncode == 0, result.stderr
    assert story_of(out) == story_of(whole)
    for version in story_of(whole).versions:
        assert (out / version.file).read_text() == (whole / version.file).read_text()
    made, expected = ({path.name for path in f.iterdir()} for f in (out, whole))
    assert made == expected


@pytest.mark.parametrize(
    "options, status, reason",
    [
        (["--budget", 0], 2, "0 is not positive"),
        (["--disturbance", 0.1], 2, "--disturbance takes a SHARE"),
        (["--loss", 2], 2, "loss"),
        (["--truth", "nowhere.yaml"], 1, "nowhere.yaml"),
        (["--room", "nowhere.yaml"], 1, "nowhere.yaml"),
        (["--disturbance"], 2, "has none; give SHARE and TIME"),
    ],
)
def test_wrong_options_are_refused_before_the_first_flight(tmp_path, truth, options, status, reason):
    out = tmp_path / "out"
    given = ["--truth", truth] * ("--truth" not in options)
    result = identify("discover", "--model", MODEL, *given, "-o", out, *options)
    assert result.returncode == status
    assert reason in result.stderr.splitlines()[-1], result.stderr
    assert not out.exists()


def test_another_folder_is_left_alone(tmp_path, discovered, truth):
    (tmp_path / "letter.txt").write_text("dear reader")
    fails(
        identify("discover", "--model", MODEL, "--truth", truth, "-o", tmp_path, *OPTIONS),
        "has files, but no journal.json",
    )
    _, out = discovered
    fails(
        identify("discover", "--model", truth, "--truth", truth, "-o", out, *OPTIONS),
        "is the discovery of another model",
    )


def test_the_api_gives_the_result_as_a_table(discovered, truth):
    _, out = discovered
    told = []
    found = ground.discover(MODEL, truth, out, budget=80, track=False, told=told.append)
    assert found.confirmed and found.effects == ("yaw_bias",) and found.page == str(out / "report.html")
    frame = found.to_frame()
    assert list(frame.columns)[0] == "given" and frame.index.name == "flight"
    last = frame.iloc[-1]
    assert last[found.story.versions[-1].label] < 0.5 * last["given"]
    assert "yaw_bias" in repr(found) and found._repr_html_().count("<tr>") > 2
    assert told and told[-1].ended
