"""report.html of a discovery, of whole and of unfinished stories."""

import dataclasses
import json
import re

import numpy as np
import pytest

import stories
from browsing import assert_fits, assert_sound, open_page
from conftest import ROOT
from ground import _core
from ground.discovery import figures
from ground.discovery import page as discovery_page
from ground.discovery import story as tale
from ground.discovery.story import Story
from ground.support import files

ROOM = _core.load_room(str(ROOT / "cfg" / "room" / "room_4x4.yaml"))


def written(story, folder, room=ROOM):
    """Path of the page of a story that went through journal.json."""
    stories.write_files(story, folder)
    again = Story.from_dict(json.loads(json.dumps(story.to_dict())))
    discovery_page.write(again, str(folder), room)
    return folder / "report.html"


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return written(stories.whole(), tmp_path_factory.mktemp("discovery"))


def text_of(browser):
    return browser.find_element("tag name", "body").text


def test_the_page_tells_the_whole_story(whole, browser):
    names = open_page(browser, whole)
    assert len(names) == 1 + 4  # errors; a figure of each flight
    assert_sound(browser, names)
    text = text_of(browser)
    for part in (
        "first-order lag of the thrusters (motor_lag) and air that moves over the floor (wind). Confirmed",
        "4 flights, 55 of at most 180 s",
        "confirms it: 1.750 falls to 0.221.",
        "after flight 2 (in the controller)",
    ):
        assert part in text, part


def test_the_error_falls_from_flight_to_flight_in_the_figure(whole, browser):
    open_page(browser, whole)
    traces = browser.execute_script(
        "return document.getElementById('figure0').data.map(t => [t.name, t.x, t.y])"
    )
    by_name = {name: (x, y) for name, x, y in traces}
    assert by_name["given"] == ([1, 2, 3], [192, 210, 175])
    assert by_name["floor of noise"][1][:2] == [21, 21]


def test_a_flight_is_drawn_as_planned_and_as_flown(whole, browser):
    open_page(browser, whole)
    names, count = browser.execute_script(
        "const t = document.getElementById('figure1').data;"
        "return [t.map(t => t.name), t.find(t => t.name === 'planned').y.length]"
    )
    assert names[:4] == ["walls", "planned", "flown", "start"] and count > 100
    assert "input, left" in names and "input, lift" in names


def planned():
    made = stories.begun()
    made.planned = stories.flight(1, tale.LOOK)
    return made


def stopped():
    """The first flight was stopped before anything was recorded."""
    made = planned()
    plan = dataclasses.replace(made.planned, path=[], why="")
    made.flights = [tale.Flown(plan, "", 0.4, tale.GIVEN, stopped="no pose for 0.5 s")]
    made.planned = None
    return made


def unfinished():
    """All values that can be missing are: errors, floors, paths, tracking."""
    made = stories.whole()
    made.ended, made.confirmation, made.activity = False, None, "diagnoses flights 1 to 4"
    made.tracking = dataclasses.replace(made.tracking, before=None, after=None, taken_back=True)
    for flown in made.flights:
        flown.floor, flown.path = None, []
        flown.errors = {label: None for label in flown.errors}
    made.findings = [dataclasses.replace(f, beliefs=[], sentences=[], open=[]) for f in made.findings]
    made.planned = stories.flight(5, tale.DECIDE)
    return made


def long():
    """Twenty flights, most of which change nothing."""
    made = stories.whole()
    first = made.flights[1]
    for number in range(5, 21):
        label = "after flight %d" % number
        made.versions.append(tale.Version(label, "model-02.yaml", ["motor_lag", "wind"], number))
        plan = dataclasses.replace(first.flight, number=number)
        errors = {v.label: (22.0, 4.0) for v in made.versions[:-1]}
        made.flights.append(dataclasses.replace(first, flight=plan, errors=errors))
        made.findings.append(dataclasses.replace(made.findings[1], after=number, label=label))
    return made


def empty():
    return Story("", "", 180.0)


@pytest.mark.parametrize("story", [empty, stopped, unfinished, long], ids=lambda story: story.__name__)
def test_a_story_has_a_page_at_any_time(story, browser, as_wide_as, tmp_path):
    page = written(story(), tmp_path)
    for width in (400, 1200):
        as_wide_as(width)
        names = open_page(browser, page)
        assert_fits(browser, width)
    assert_sound(browser, names)


def test_missing_and_damaged_files_are_left_out(tmp_path):
    story = stories.whole()
    page = written(story, tmp_path, None)
    (tmp_path / "model-02.yaml").write_text("nonsense")
    (tmp_path / "flight-01.csv").write_text("time,left,right,lift\n0,1,oops,1\n")
    (tmp_path / "flight-02.csv").unlink()
    discovery_page.write(story, str(tmp_path))
    text = page.read_text()
    assert "Flight 3" in text and "wind.wx" not in text


def test_a_command_may_write_the_page_after_each_step(tmp_path):
    story = stories.begun()
    page, seen = written(story, tmp_path), []
    with files.protect([]):
        for story.activity in ("flies", "diagnoses"):
            discovery_page.write(story, str(tmp_path))
            seen.append(re.search("Now: (.*?)[.]<", page.read_text()).group(1))
    assert seen == ["flies", "diagnoses"]


def test_a_motion_that_is_not_finite_is_marked_above_all_errors():
    story = stories.whole()
    story.flights[1].errors["after flight 1"] = None
    figure = figures.errors(story)
    model = next(trace for trace in figure["data"] if trace["name"] == "after flight 1")
    assert model["marker"]["symbol"][0] == "x-open" and model["y"][0] > 210
    assert "not finite" in figure["layout"]["meta"]["caption"]


def test_figures_are_those_that_plotly_knows():
    from plotly import graph_objects

    story = stories.whole()
    inputs = [[0, 0, 0, 1], [1, 1, -1, 1]]
    drawn = figures.flight(
        story.flights[0].flight, story.flights[0], np.array(inputs, float), ["left", "right"], ROOM
    )
    for figure in (figures.errors(story), drawn):
        graph_objects.Figure(data=figure["data"], layout=figure["layout"])
