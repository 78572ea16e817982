"""The workbench: its story in a browser, what it refuses, and what it survives."""

import contextlib
import http.client
import json
import os
import pathlib
import random
import re
import signal
import statistics
import subprocess
import sys
import time
import types

import numpy as np
import psutil
import pytest

import ground
from browsing import waiting
from conftest import MODEL, ROOT, SHARED, located, slow, started_browser, wait_for
from ground.analysis.horizon import PoseError
from ground.data import import_csv
from ground.effect_library import units
from ground.support.errors import GroundError
from ground.support.event_file import EventFile
from ground.workshop import work
from ground.workshop.session import SCHEMA

LAG, SLOPE = 0.05, 0.005
COMPUTED = 1800  # until a fit or a search has ended, however busy the computer is [s]
FLYER = SHARED.parent / "others" / "stanford_freeflyer"
PICTURES = os.environ.get("WORKBENCH_PICTURES")  # folder for a picture of each step


class Bench:
    """A workbench in a process of its own, which ends with its test at the latest."""

    of_a_test = []

    def __init__(self, bags, holdout, folder, *more, model=MODEL):
        self.command = [located("workbench"), *map(str, bags), "--model", str(model)]
        self.command += ["--holdout", *map(str, holdout)] if holdout else []
        self.command += ["-o", str(folder), "--no-browser", "--progress", "off", *more]
        self.folder = pathlib.Path(folder)
        Bench.of_a_test.append(self)
        self.start()

    def start(self):
        environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
        self.process = subprocess.Popen(
            self.command,
            stdout=subprocess.PIPE,
            universal_newlines=True,
            env=environment,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's job ignores it
        )
        line = self.process.stdout.readline()
        found = re.search(r"http://127\.0\.0\.1:(\d+)/\?token=([\w-]+)", line)
        assert found, line
        self.address, self.port, self.token = found.group(), int(found.group(1)), found.group(2)
        self.ssh = self.process.stdout.readline()

    def kill(self):
        self.process.kill()
        self.process.wait()

    def end(self):
        self.process.send_signal(signal.SIGINT)
        assert self.process.wait(30) == 0

    def ask(self, name, headers=(), method="POST", body=None, **content):
        """Status and answer of a request."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        sent = {"X-Token": self.token, "Content-Type": "application/json", **dict(headers)}
        connection.request(method, "/" + name, json.dumps(content) if body is None else body, sent)
        answer = connection.getresponse()
        text = answer.read()
        connection.close()
        return answer.status, json.loads(text) if text[:1] == b"{" else text

    def state(self):
        status, state = self.ask("state")
        assert status == 200, state
        return state

    def done(self, kind, **content):
        """Does long work, and waits for its end."""
        assert self.ask("begin", kind=kind, **content)[0] == 200
        wait_for(lambda: not self.state()["running"], 300, kind)
        return self.state()


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Runs of a craft with a lag and on a tilted floor, which its model does not have."""
    folder = tmp_path_factory.mktemp("bags")
    truth = ground.Model.load(MODEL).with_effect("motor_lag", tau=LAG).with_effect("floor_tilt", sx=SLOPE)
    paths = [folder / ("run%d.bag" % i) for i in range(1, 5)]
    for seed, path in enumerate(paths, 1):
        ground.simulate(truth, "prbs", duration=20, seed=seed).save(path)
    return paths


@pytest.fixture(scope="module")
def bench(bags, tmp_path_factory):
    made = Bench(bags[:3], bags[3:], tmp_path_factory.mktemp("bench") / "out")
    Bench.of_a_test.remove(made)
    yield made
    made.end()


@pytest.fixture
def own_browser():
    made = started_browser()
    yield made
    made.quit()


@pytest.fixture(autouse=True)
def none_left():
    yield
    for made in Bench.of_a_test:
        made.kill()
    Bench.of_a_test.clear()


class Page:
    """The page in a browser."""

    def __init__(self, browser, address):
        self.browser = browser
        browser.get(address)
        self.settled()

    def js(self, text, *arguments):
        return self.browser.execute_script(text, *arguments)

    def until(self, condition, seconds=300):
        """Waits for a condition in JavaScript."""
        return waiting(self.browser, seconds).until(lambda b: b.execute_script("return " + condition))

    def settled(self):
        """Waits until all views show the current model."""
        self.until("S && document.getElementById('wrench').dataset.drawn === drawnOf && drawnOf !== ''")

    def click(self, name):
        self.browser.find_element("id", name).click()

    def mouse(self):
        from selenium.webdriver.common.action_chains import ActionChains

        return ActionChains(self.browser, duration=50)

    def drag_over(self, name, start, end):
        """Drags with the mouse over a part of the first axes of a plot, in times [s]."""
        self.js("document.getElementById(arguments[0]).scrollIntoView({block: 'center'})", name)
        x0, x1, y = self.js(
            """const plot = document.getElementById(arguments[0]), box = plot.getBoundingClientRect();
            const {xaxis, yaxis} = plot._fullLayout, at = t => box.left + xaxis._offset + xaxis.d2p(t);
            return [at(arguments[1]), at(arguments[2]), box.top + yaxis._offset + yaxis._length / 2]""",
            name,
            start,
            end,
        )
        mouse = self.mouse()
        pointer = mouse.w3c_actions.pointer_action
        pointer.move_to_location(round(x0), round(y))
        pointer.pointer_down()
        for x in ((x0 + x1) / 2, x1):
            pointer.move_to_location(round(x), round(y))
        pointer.pointer_up()
        mouse.perform()

    def text(self, name):
        return self.browser.find_element("id", name).text

    def picture(self, name):
        if PICTURES:
            time.sleep(0.8)  # bars move
            for scheme in ("light", "dark"):
                emulated = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
                self.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", emulated)
                time.sleep(0.7)
                self.settled()
                self.browser.save_screenshot("%s/%s_%s.png" % (PICTURES, name, scheme))
            self.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
            time.sleep(0.3)


@pytest.fixture(scope="module")
def page(browser, bench):
    device = {"width": 1280, "height": 800, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", device)
    yield Page(browser, bench.address)
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def error(state, node=None):
    """Position error of a model [mm], the current one by default."""
    return next(n["error"]["position_mm"] for n in state["nodes"] if n["id"] == (node or state["current"]))


# The story, in its order


def test_1_dragging_a_parameter_moves_the_curves(page, bench):
    assert "Prediction after 1 s" in page.text("number") and "noise floor" in page.text("number")
    assert "of 22.0 s usable, 100 Hz" in page.text("runs")
    assert "% of full thrust" in page.text("worst") or "% of the moment of full thrust" in page.text("worst")
    page.picture("1_first")
    before = page.js("return [...document.getElementById('motion').data[6].y]")
    page.mouse().click_and_hold(page.browser.find_element("id", "p_N_r")).move_by_offset(70, 0).perform()
    page.until("timing.drag.length > 0 && timing.all.length > 0")
    assert page.js("return [...document.getElementById('motion').data[6].y]") != before
    assert "as it is" in page.text("number")
    assert bench.state()["current"] == 1  # only shown until the slider is let go
    page.mouse().release().perform()
    page.until("S.current === 2")
    assert bench.state()["parameters"][5]["value"] > 1.5 * ground.Model.load(MODEL)["N_r"]
    page.settled()
    page.picture("1_dragged")


def test_2_a_fit_shows_bars_before_and_after(page, bench):
    page.click("fit")
    page.until("S.nodes.some(n => n.kind === 'fit')")
    page.settled()
    rows = [row.text for row in page.browser.find_elements("css selector", "#bars .bar")]
    assert [row.split("\n")[0] for row in rows] == ["before", "now, cross-validated", "held out, sealed"]
    assert error(bench.state()) < error(bench.state(), 2)
    page.picture("2_fitted")
    page.click("open")
    page.until("S.opened === 1")
    assert "held out, seen once" in page.text("bars")


def test_3_a_zoom_in_one_view_is_one_in_all(page, bench):
    page.drag_over("wrench", 5, 9)
    page.until("Math.abs(view.from - 5) < 0.2 && Math.abs(view.to - 9) < 0.2")
    page.settled()
    ends = page.js("return [known.measured.t[0], known.measured.t.at(-1), known.missing.t.at(-1)]")
    assert ends[0] > 4.8 and max(ends) < 9.2
    page.picture("3_zoomed")
    page.js("Plotly.relayout('against', {'xaxis.range[0]': 0.5, 'xaxis.range[1]': 9})")
    page.settled()
    page.click("whole")
    page.settled()
    page.click("brush")
    page.drag_over("motion", 6, 12)
    page.until("Math.abs(stretch()[0] - 6) < 0.2 && Math.abs(stretch()[1] - 12) < 0.2")
    page.click("judge")
    page.until("S.judge !== null")
    page.click("cut")
    page.until("S.runs[0].cuts.length === 1")
    page.settled()
    page.picture("3_left_out")
    name = bench.state()["runs"][0]["name"]
    for action in ("cut", "judge"):
        assert bench.ask(action, run=name, span=None)[0] == 200
    page.until("S.judge === null && S.runs[0].cuts.length === 0")
    page.click("brush")
    page.settled()


def test_4_effects_fill_the_list_and_adding_lets_the_error_fall(page, bench):
    page.click("search")
    page.until("S.search.state === 'running' && S.search.rows.length > 10")
    page.picture("4_searching")
    page.until("S.search.rows.some(row => row.effect === 'motor_lag' && row.prediction)", COMPUTED)
    page.click("stop")
    page.until("S.search.state === 'stopped'")
    before = error(bench.state())
    page.js("document.querySelector('[data-effect=motor_lag]').click()")
    page.until("S.nodes.some(n => n.kind === 'add')", COMPUTED)
    page.settled()
    assert error(bench.state()) < 0.5 * before
    assert "It helps" in page.text("said")
    page.picture("4_added")
    page.click("undo")
    page.until("S.nodes.find(n => n.id === S.current).kind === 'fit'")
    page.js("[...document.querySelectorAll('.node')].at(-1).click()")
    page.until("S.effects.includes('motor_lag')")
    page.js("const o = document.getElementById('other'); o.value = '1'; o.dispatchEvent(new Event('change'))")
    page.settled()
    page.until("document.getElementById('motion').data.some(t => t.name === 'model 1')")
    page.picture("4_compared")


def test_5_a_formula_is_read_judged_and_added(page, bench):
    page.js("document.getElementById('own').open = true")
    field = page.browser.find_element("id", "fY")
    field.send_keys("a*u*")
    page.until("document.querySelector('#parsed .no')")
    field.send_keys("v")
    page.until("document.getElementById('parsed').textContent.includes('a in N s2/m2')")
    page.until("/not shown to help|it helps/.test(document.getElementById('parsed').textContent)", COMPUTED)
    page.picture("5_formula")
    field.clear()
    for name, text in (("fX", "g*cos(psi)"), ("fY", "-g*sin(psi)")):
        page.browser.find_element("id", name).send_keys(text)
    page.until("/g in N; error .* it helps/.test(document.getElementById('parsed').textContent)", COMPUTED)
    before, count = error(bench.state()), len(bench.state()["nodes"])
    page.click("addformula")
    page.until("S.nodes.length === %d" % (count + 1), COMPUTED)
    assert error(bench.state()) < 0.5 * before
    page.settled()
    assert "at the noise floor" in page.text("number")
    assert page.text("worst").startswith("nothing")
    page.picture("5_added")


def test_6_what_was_done_is_a_script_with_the_same_numbers(page, bench):
    page.click("save")
    page.until("document.getElementById('said').textContent.startsWith('Saved')", COMPUTED)
    page.picture("6_saved")
    same_numbers(bench)
    same_by_shell(bench)
    assert (bench.folder / "page" / "report.html").is_file()


def same_by_shell(bench):
    """Runs the saved shell script, and compares its model with that of the saved Python script."""
    by_python = ground.Model.load(bench.folder / "model.yaml")
    path = "%s:%s" % (pathlib.Path(located("identify")).parent, os.environ["PATH"])
    environment = dict(os.environ, PATH=path)
    (bench.folder / "shell").mkdir()
    subprocess.run(["sh", "../script.sh"], cwd=bench.folder / "shell", env=environment, check=True)
    by_shell = ground.Model.load(bench.folder / "shell" / "model.yaml")
    assert by_shell.values == pytest.approx(by_python.values, rel=1e-6)


def same_numbers(bench):
    """Runs the saved script, and compares what it prints with the page."""
    state, folder = bench.state(), bench.folder
    made = subprocess.run(
        [sys.executable, "script.py"], cwd=folder, stdout=subprocess.PIPE, universal_newlines=True, check=True
    )
    told = {
        int(number): (float(mm), float(deg))
        for number, mm, deg in re.findall(r"^(\d+) .*: (\S+) mm, (\S+) deg$", made.stdout, re.M)
    }
    for node in state["nodes"]:
        expected = node["error"]["position_mm"], node["error"]["heading_deg"]
        assert told[node["id"]] == pytest.approx(expected, rel=1e-5), node["what"]


def test_7_the_next_experiment_is_drawn(page):
    page.js("S.search.next = arguments[0]; S.search.state = 'done'; showNext()", NEXT)
    assert "a spin: it distinguishes momentum_drag, X_u and Y_v." in page.text("nexttext")
    assert "roslaunch" in page.text("nexttext")
    page.until("document.getElementById('next').data.length === 2")
    page.js("document.getElementById('next').scrollIntoView()")
    page.picture("7_next")


NEXT = {
    "input": "a spin",
    "separates": ["momentum_drag", "X_u", "Y_v"],
    "launch": "roslaunch ground room_prbs.launch mocap_host:=ADDRESS design:=prbs levels:='0.4 1'",
    "path": {"x": [0, 0.5, 1], "y": [0, 0.2, -0.4]},
}


def test_the_next_experiment_is_drawn_as_far_as_the_room(monkeypatch, tmp_path):
    """From home, at the lift of the experiment."""
    text = "schema: ground/room/1\nname: far\nhome: [4, 4]\nmargin: 0.2\n"
    text += "corners: [[3, 3], [6, 3], [6, 5], [3, 5]]"
    (tmp_path / "room.yaml").write_text(text)
    room = ground.Room.load(tmp_path / "room.yaml")
    sticking = ground.Model.load(MODEL) + ground.Effect("sticks", X="-a*(1-lift)*u", a=(1.0, "N s/m"))
    paths = []
    for more in ("", " --lift 0.6"):
        found = types.SimpleNamespace(improved=sticking, next_inputs=np.array([[0.0, 1, 1], [16, 0, 0]]))
        found.report = {"steps": [], "next_experiment": {"arguments": "--input steps --hold 1" + more}}
        found.headline, found.tried, found.proposal = list, [], None
        monkeypatch.setattr(work, "diagnose", lambda *_, found=found, **__: found)
        paths.append(work.searched(sticking, [], room, None, None)["next"]["path"])
        places = list(zip(paths[-1]["x"], paths[-1]["y"]))
        assert places[0] == pytest.approx((4, 4), abs=0.01)
        assert min(map(room.clearance, places)) >= 0 and max(paths[-1]["x"]) > 5.5
    assert len(paths[1]["x"]) > 2 * len(paths[0]["x"])  # more drag, with less lift


@pytest.mark.parametrize(
    "answers, helps",
    [(["yes"], True), (["yes", "not clear"], True), (["not clear"], False), (["yes", "no"], False)],
)
def test_a_step_helps_where_one_effect_helps_and_none_is_refuted(answers, helps, monkeypatch):
    craft, given = ground.Model.load(MODEL), iter(answers)

    def added(model, effect, *_, **__):
        verdict = types.SimpleNamespace(helps=False, reason="the reason")
        errors = dict.fromkeys(("without", "with"), PoseError(1.0, 1.0))
        prediction = types.SimpleNamespace(errors=errors, mocap=PoseError(1.0, 1.0))
        made = {"effect": effect, "model": model, "parameters": {}, "prediction": prediction}
        return types.SimpleNamespace(answer=next(given), verdict=verdict, **made)

    monkeypatch.setattr(work, "add", added)
    assert work.added(craft, ["a", "b"][: len(answers)], [], None)["helps"] == helps


def test_nothing_went_wrong_in_the_browser(page):
    lines = [line for line in page.browser.get_log("browser") if line["level"] == "SEVERE"]
    assert [line for line in lines if "400" not in line["message"]] == []  # half a formula is refused


def test_a_reload_and_a_second_tab_show_the_same(page, bench):
    page.browser.refresh()
    page.settled()
    first = page.browser.current_window_handle
    page.browser.switch_to.new_window("tab")
    other = Page(page.browser, bench.address)
    other.click("undo")
    other.settled()
    page.browser.close()
    page.browser.switch_to.window(first)
    page.until("S.current === %d" % bench.state()["current"])


def test_all_that_one_can_do_has_a_name_and_is_reached_by_keys(page):
    """As a screen reader and a keyboard have it."""
    tree = page.browser.execute_cdp_cmd("Accessibility.getFullAXTree", {})["nodes"]
    doing = ("button", "slider", "spinbutton", "combobox", "textbox", "treeitem", "DisclosureTriangle")
    found = [n for n in tree if not n["ignored"] and n["role"]["value"] in doing]
    assert len(found) > 30
    assert [n for n in found if not n.get("name", {}).get("value", "").strip()] == []
    keyed = "return [...document.querySelectorAll('[tabindex]')].filter(e => e.tabIndex > 0).length"
    assert page.js(keyed) == 0  # the order of the page is that of the keys
    page.js("document.activeElement.blur()")
    before = page.js("return S.current")
    page.mouse().send_keys("u").perform()
    page.until("S.current !== %d" % before)
    page.js("act('select', {node: %d})" % before)
    page.until("S.current === %d" % before)
    page.settled()


# The story of a user whose craft has two effects, one of which is plain only beside the other

SIDEWAYS = """return ['left', 'right', 'middle', 'views'].map(id => [id, document.getElementById(id)])
    .filter(([id, box]) => box.scrollWidth > box.clientWidth).map(([id]) => id)"""
SCROLLED = """return [...document.querySelectorAll('section, section *')]
    .filter(e => /auto|scroll/.test(getComputedStyle(e).overflowY) && !/left|right|views/.test(e.id))
    .map(e => e.id || e.tagName)"""
WIDE = """[...document.querySelectorAll('#views .js-plotly-plot')]
    .every(p => Math.abs(p._fullLayout.width - p.clientWidth) < 2)"""
OUTSIDE = """return [...document.querySelectorAll('#left *, #right *')].filter(e => {
    const box = e.getBoundingClientRect(), column = e.closest('section').getBoundingClientRect();
    return box.width && (box.right > column.right || box.left < column.left)
  }).map(e => e.id || e.className)"""
COVERED = """const found = [];
for (const id of ['motion', 'wrench', 'against']) {
  const texts = [...document.querySelectorAll(`#${id} [class$=tick] text`)];
  const boxes = texts.map(e => [e.textContent, e.getBoundingClientRect()]);
  boxes.forEach(([a, p], i) => boxes.slice(i + 1).forEach(([b, q]) => {
    const beside = p.left > q.right - 1 || q.left > p.right - 1;
    const above = p.top > q.bottom - 3 || q.top > p.bottom - 3;
    if (!beside && !above) found.push([id, a, b]);
  }));
}
return found"""


def fits(page, name):
    """Nothing covers anything or leaves its column, and a column is one scroll box."""
    for width, height in ((1500, 900), (1366, 768)):
        device = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        page.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", device)
        page.settled()
        page.until(WIDE)
        page.picture("8_%s_%d" % (name, width))
        for found in (SIDEWAYS, SCROLLED, OUTSIDE, COVERED):
            assert page.js(found) == [], (name, width, found)


def test_what_a_search_found_comes_first_and_is_added_at_once(own_browser, tmp_path):
    truth = ground.Model.load(MODEL).with_effect("thrust_asymmetry", a=0.1)
    truth = truth.with_effect("quadratic_drag", cx=12, cy=0.030)
    bags = [tmp_path / ("r%d.bag" % seed) for seed in (1, 2, 3)]
    for seed, path in enumerate(bags, 1):
        ground.simulate(truth, "prbs", duration=20, seed=seed).save(path)
    bench = Bench(bags[:2], bags[2:], tmp_path / "out")
    page = Page(own_browser, bench.address)
    fits(page, "first")
    page.click("fit")
    page.until("document.getElementById('said').textContent.startsWith('Fitted')")
    page.click("undo")
    page.until("S.current === 1")
    assert "Fitted" not in page.text("said")
    page.js("act('select', {node: 2})")
    page.until("S.current === 2")
    page.click("search")
    page.until("S.search.state === 'done'", COMPUTED)
    fits(page, "found")
    rows = page.browser.find_elements("css selector", "#effects li")
    drag = rows[1].text
    assert "thrust_asymmetry unequal" in rows[0].text and "quadratic_drag drag" in drag
    assert "cx 12.0" in drag and "together with thrust_asymmetry" in drag and "ery certain" in drag
    assert "not significant" not in page.text("effects")
    assert "thrust_asymmetry and quadratic_drag" in page.text("answer")
    shown = "return document.querySelectorAll('[data-effect=quadratic_drag]').length"
    assert page.js(shown) == 1
    bottom = "return document.querySelectorAll('#effects li')[1].getBoundingClientRect().bottom"
    assert page.js(bottom) < 768  # one need not scroll to it

    page.click("addfound")
    page.until("S.nodes.length === 3", COMPUTED)
    page.settled()
    assert page.text("said").startswith("Added thrust_asymmetry and quadratic_drag: ")
    assert "It helps" in page.text("said")
    node = bench.state()["nodes"][-1]
    assert node["effect"] == ["thrust_asymmetry", "quadratic_drag"] and node["parent"] == 2
    assert error(bench.state()) < 0.1 * error(bench.state(), 2)
    assert "Missing" not in page.text("answer")
    assert "Added: thrust_asymmetry and quadratic_drag" in page.text("answer")
    fits(page, "added")
    page.click("open")
    page.until("S.opened === 1")
    assert page.text("said") == ""
    page.js("document.querySelector('[data-effect=momentum_drag]').click()")
    page.until("S.nodes.length === 4", COMPUTED)
    page.settled()
    assert page.text("said").startswith("Added momentum_drag")
    fits(page, "more")
    page.click("undo")
    page.until("S.current === 3")
    assert page.text("said").startswith("Now at model 3")
    page.click("brush")
    page.click("judge")
    page.until("S.judge !== null")
    assert page.text("said") == ""
    fits(page, "brushed")
    page.js("document.getElementById('others').open = true; $('nexttext').scrollIntoView()")
    fits(page, "opened")
    page.click("save")
    page.until("document.getElementById('said').textContent.startsWith('Saved')", COMPUTED)
    same_numbers(bench)
    same_by_shell(bench)
    bench.end()


# On real recordings, from the command line to the saved script


def story(bench, browser, name, whole_search=True):
    """The steps of the story on recordings of which nothing is known beforehand."""
    device = {"width": 1280, "height": 800, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", device)
    page = Page(browser, bench.address)
    page.picture(name + "_1_first")
    slider = page.browser.find_element("css selector", "#parameters input[type=range]:not(#p_m)")
    page.mouse().click_and_hold(slider).move_by_offset(40, 0).release().perform()
    page.until("S.current === 2")
    page.click("fit")
    page.until("S.nodes.some(n => n.kind === 'fit')", COMPUTED)
    page.settled()
    assert error(bench.state()) < error(bench.state(), 2)
    end = page.js("return known.measured.t.at(-1)")
    page.drag_over("wrench", 0.3 * end, 0.7 * end)
    page.until(
        "Math.abs(view.from - 0.3 * arguments[0]) < 0.05 * arguments[0]".replace("arguments[0]", str(end))
    )
    page.settled()
    page.click("whole")
    page.settled()
    page.click("open")
    page.until("S.opened === 1")
    page.picture(name + "_2_fitted")
    page.click("search")
    page.until("S.search.rows.some(row => row.prediction)", COMPUTED)
    page.picture(name + "_3_searching")
    if whole_search:
        page.until("S.search.state === 'done'", COMPUTED)
        page.settled()
        assert page.text("answer") and page.text("nexttext")
    else:
        page.click("stop")
        page.until("S.search.state === 'stopped'")
        page.settled()
    page.picture(name + "_3_searched")
    best = page.js("return S.search.rows[0].effect")
    page.js("document.querySelector(`[data-effect=${arguments[0]}]`).click()", best)
    page.until("S.nodes.some(n => n.kind === 'add')", COMPUTED)
    page.settled()
    said, node = page.text("said"), bench.state()["nodes"][-1]
    assert ("It helps" if node["helps"] else "Not shown to help") in said
    page.picture(name + "_4_added")
    page.click("undo")
    page.until("S.nodes.find(n => n.id === S.current).kind === 'fit'")
    page.js("document.getElementById('own').open = true")
    field = page.browser.find_element("id", "fY")
    field.clear()
    field.send_keys("a*abs(u)*v")
    page.until("/a in N s2.m2; error .* help/.test(document.getElementById('parsed').textContent)", COMPUTED)
    page.picture(name + "_5_formula")
    page.click("save")
    page.until("document.getElementById('said').textContent.startsWith('Saved')", COMPUTED)
    same_numbers(bench)
    lines = [line for line in browser.get_log("browser") if line["level"] == "SEVERE"]
    assert [line for line in lines if "400" not in line["message"]] == []
    bench.end()


@slow
def test_the_story_on_a_real_day(own_browser, tmp_path):
    if not SHARED.is_dir():
        pytest.skip("the real recordings of 2019 are missing beside the workspace")
    bags = []
    for pose in sorted(SHARED.glob("pose_2019-04-16*.csv")):
        bags.append(tmp_path / (pose.stem + ".bag"))
        import_csv.write_bag(str(pose).replace("pose_", "controls_"), str(pose), str(bags[-1]))
    story(Bench(bags[:-1], bags[-1:], tmp_path / "out"), own_browser, "real")


@slow
def test_the_story_on_a_free_flyer(own_browser, tmp_path):
    if not FLYER.is_dir():
        pytest.skip("the recordings of the free-flyer are missing beside the workspace")
    types = tmp_path / "ff_msgs" / "msg" / "ThrusterCommand.msg"
    types.parent.mkdir(parents=True)
    types.write_text("std_msgs/Header header\nbool[8] switches\n")
    reading = ["--mapping", str(FLYER / "mapping_bag.yaml"), "--types", str(types)]
    runs, model = sorted(FLYER.glob("bags/exp_*_short*")), FLYER / "model.yaml"
    story(Bench(runs[:-1], runs[-1:], tmp_path / "out", *reading, model=model), own_browser, "flyer", False)


@slow
def test_an_hour_and_twenty_runs_are_drawn_thinned(own_browser, tmp_path):
    """How long the browser was busy at once is printed."""
    truth = ground.Model.load(MODEL).with_effect("motor_lag", tau=LAG)
    ground.simulate(truth, "prbs", duration=3600, seed=1, rate=120.0).save(tmp_path / "hour.bag")
    for seed in range(20):
        ground.simulate(truth, "prbs", duration=20, seed=seed).save(tmp_path / ("run%d.bag" % seed))
    bench = Bench([tmp_path], [], tmp_path / "out")
    page = Page(own_browser, bench.address)
    page.js("""window.longest = [0];
    const watch = new PerformanceObserver(list => longest.push(...list.getEntries().map(e => e.duration)));
    watch.observe({entryTypes: ['longtask']})""")
    page.js("choose('hour'); zoom(0, 3600)")
    page.settled()
    points = "return ['motion', 'wrench', 'against'].flatMap(id => $(id).data.map(t => t.x.length))"
    assert page.js("return known.measured.t.at(-1)") > 3500 and max(page.js(points)) < 2500
    page.drag_over("motion", 1000, 1500)
    page.until("view.from > 900")
    page.settled()
    page.js("const s = $('p_k'); s.value = 600; s.oninput()")
    page.until("timing.drag.length && timing.all.length", COMPUTED)
    page.js("$('p_k').onchange()")
    page.until("S.current === 2")
    page.settled()
    print("longest pause %.0f ms, curves of the run %.0f ms, error of all %.0f ms" % tuple(
        page.js("return [Math.max(...longest), timing.drag[0], timing.all[0]]")))  # fmt: skip
    bench.end()


def test_physics_comes_from_the_public_functions():
    """The room imports ground, and of its other rooms what reads recordings and what all of them share."""
    folder = ROOT / "src/ground/python/ground/workshop"
    text = "".join(path.read_text() for path in folder.glob("*.py"))
    rooms = set(re.findall(r"^ *(?:from|import) ground\.(\w+)", text, re.M))
    assert rooms <= {"checks", "data", "models", "reading", "support", "workshop"}
    lines = sum(len(p.read_text().splitlines()) for p in folder.iterdir() if p.is_file())
    assert lines <= 1500


# What it refuses


@pytest.mark.parametrize(
    "status, request_of",
    [
        (403, {"headers": {"X-Token": "wrong"}}),
        (403, {"headers": {"X-Token": ""}}),
        (403, {"headers": {"Host": "evil.example:80"}}),
        (403, {"headers": {"Origin": "http://evil.example"}}),
        (403, {"headers": {"Origin": "null"}}),
        (403, {"headers": {"Sec-Fetch-Site": "cross-site"}}),
        (415, {"headers": {"Content-Type": "text/plain"}}),
        (413, {"body": b" " * 1000000}),
        (400, {"body": b"[" * 60000}),
        (400, {"body": b"[]"}),
        (400, {"body": b"\xff\xfe"}),
    ],
)
def test_foreign_requests_are_refused(bench, status, request_of):
    assert bench.ask("state", **request_of)[0] == status
    assert bench.ask("state")[0] == 200


def test_the_page_needs_the_secret_and_has_no_other_files(bench):
    assert bench.ask("", method="GET")[0] == 403
    assert bench.ask("events?token=%s" % ("a" * 32), method="GET")[0] == 403
    for path in ("../../etc/passwd", "..%2f..%2fetc/passwd", "page.html", "server.py", "work.jsonl"):
        assert bench.ask("%s?token=%s" % (path, bench.token), method="GET")[0] == 404
    assert "ssh -L %d:127.0.0.1:%d" % (bench.port, bench.port) in bench.ssh
    own = [c.laddr for c in psutil.Process(bench.process.pid).connections() if c.status == psutil.CONN_LISTEN]
    assert own == [("127.0.0.1", bench.port)]


@pytest.mark.parametrize(
    "formula",
    [
        {"Y": "a*" * 20000},
        {"Y": "__import__('os').system('touch /tmp/found')"},
        {"Y": "a*u; b"},
        {"Y": "("},
        {"Y": "u*v"},
        {"Y": "a*u + a*u*v"},
        {"Y": ""},
    ],
)
def test_what_is_not_a_formula_is_refused(bench, formula):
    assert bench.ask("check", formula=formula)[0] in (400, 413)


def test_effects_of_files_and_unknown_work_are_refused(bench):
    twice = ["yaw_bias", "yaw_bias"]
    for effect in ("/etc/passwd", "../effect.yaml", "no_such_effect", ["a"], [], twice, [twice], None):
        assert bench.ask("begin", kind="add", effect=effect)[0] == 400
    assert bench.ask("begin", kind="exec", effect=None)[0] == 400
    assert bench.ask("select", node=99)[0] == 400
    assert bench.ask("role", run="run1", role="admin")[0] == 400
    assert bench.ask("curves", run="../run1", node=1)[0] == 400


# What it survives


def test_a_cut_off_line_is_dropped_and_a_damaged_one_refused(tmp_path):
    path = tmp_path / "work.jsonl"
    file = EventFile(str(path), SCHEMA)
    file.add({"event": "begin", "schema": SCHEMA, "runs": {}})
    file.add({"event": "current", "id": 1})
    with pytest.raises(GroundError, match="another process"):
        EventFile(str(path), SCHEMA)
    del file
    whole = path.read_bytes()
    for cut in range(len(whole.splitlines(True)[0]), len(whole)):
        path.write_bytes(whole[:cut])
        assert len(EventFile(str(path), SCHEMA).events) == 1
    path.write_bytes(b"{broken}\n" + whole)
    with pytest.raises(GroundError, match="line 1 is damaged"):
        EventFile(str(path), SCHEMA)
    path.write_bytes(whole)
    with pytest.raises(GroundError, match="not a file of the schema"):
        EventFile(str(path), "ground/another/1")


def killed_again_and_again(bags, folder, times):
    """Kills the server while it works, and checks that what it has shown is there again."""
    bench = Bench(bags[:2], [], folder)
    random.seed(1)
    for i in range(times):
        before = bench.state()
        node = before["current"]
        bench.ask("set", node=node, values={"k": 0.05 + 0.001 * i})
        kept = bench.state()
        bench.ask("begin", kind=random.choice(["fit", "search"]), effect=None)
        time.sleep(random.uniform(0, 1.5))
        bench.kill()
        bench.start()
        after = bench.state()
        known = {n["id"]: n for n in after["nodes"]}
        assert all(known[n["id"]] == n for n in kept["nodes"]), i
        assert after["search"]["state"] != "running" and not after["running"]
        assert len(after["nodes"]) >= len(kept["nodes"])
    bench.end()


def test_a_killed_server_loses_nothing(bags, tmp_path):
    killed_again_and_again(bags, tmp_path / "out", 2)


def browsers_killed(bags, folder, times):
    """Kills the browser while its page works, and checks that the next one shows what was done."""
    bench, chance = Bench(bags[:2], [], folder), random.Random(2)
    for i in range(times):
        browser = started_browser()
        page, nodes = Page(browser, bench.address), bench.state()["nodes"]
        page.until("S.nodes.length >= %d" % len(nodes))  # a fit of the page before may end meanwhile
        page.js("begin(arguments[0])", chance.choice(["fit", "search"]))
        page.js("const k = $('p_k_n'); k.value = arguments[0]; k.onchange()", 0.05 + 0.001 * i)
        page.until("S.nodes.some(n => n.what === 'k %.4g')" % (0.05 + 0.001 * i))
        time.sleep(chance.uniform(0, 1.5))
        driver = psutil.Process(browser.service.process.pid)
        for process in [*driver.children(recursive=True), driver]:
            with contextlib.suppress(psutil.NoSuchProcess):  # it ended with the one before it
                process.kill()
        kept = {node["id"]: node["what"] for node in bench.state()["nodes"]}
        assert all(kept[node["id"]] for node in nodes) and "k %.4g" % (0.05 + 0.001 * i) in kept.values()
    bench.end()


def test_a_killed_browser_loses_nothing(bags, tmp_path):
    browsers_killed(bags, tmp_path / "out", 2)


@slow
def test_browsers_that_are_killed_twenty_times_lose_nothing(bags, tmp_path):
    browsers_killed(bags, tmp_path / "out", 20)


@slow
def test_a_server_that_is_killed_twenty_times_loses_nothing(bags, tmp_path):
    killed_again_and_again(bags, tmp_path / "out", 20)


def test_a_work_file_of_other_runs_is_not_taken(bags, bench, tmp_path):
    made = Bench(bags[:1], [], tmp_path / "out")
    made.end()
    with pytest.raises(GroundError, match="other runs"):
        ground.workbench(bags[1:2], MODEL, output=tmp_path / "out", begun=lambda address: 1 / 0)


def test_units_of_parameters():
    assert units.parameters({"Y": "a*u*v", "N": "-b*r*abs(r) + c"}, ["u_L"]) == {
        "a": "N s2/m2", "b": "N m s2", "c": "N m",
    }  # fmt: skip
    assert units.parameters({"X": "a*sin(b*x)"}, []) == {"a": "?", "b": "?"}
    assert units.parameters({"X": "a*(u_L - u_R)/psi"}, ["u_L", "u_R"]) == {"a": "N"}
    with pytest.raises(GroundError, match="two units"):
        units.parameters({"X": "a*u + a"}, [])


def test_speed(page, bench):
    """Medians are printed; the bounds are for an idle computer."""
    page.js("timing.drag.length = 0; const s = document.getElementById('p_k'); window.i = 0;"
            "window.d = setInterval(() => { s.value = 400 + 5 * ++i; s.dispatchEvent(new Event('input'));"
            "if (i > 30) clearInterval(d); }, 120)")  # fmt: skip
    page.until("i > 30 && timing.drag.length > 3")
    page.js("document.getElementById('p_k').dispatchEvent(new Event('change'))")
    page.until("Object.keys(draft).length === 0")
    page.settled()
    for _ in range(3):
        node = page.js("return S.current")
        page.js("begin('add', 'yaw_bias')")
        page.until("S.current !== %d && !S.running.length" % node, COMPUTED)
        page.settled()
        page.click("undo")
        page.until("S.current === %d" % node)
        page.settled()
    found = page.js("return timing")
    medians = {name: statistics.median(found[name]) for name in ("drag", "all", "add", "undo")}
    print("first view %.0f ms" % found["first"], {name: round(one) for name, one in medians.items()})


@slow
def test_7_a_whole_search_ends_with_an_answer(page, bench):
    assert bench.ask("select", node=1)[0] == 200
    state = bench.done("search")
    search = state["search"]
    assert search["state"] == "done" and "motor_lag" in json.dumps(search["answer"])
    chosen = [row["effect"] for row in search["rows"] if row["selected"]]
    assert sorted(chosen) == ["floor_tilt", "motor_lag"]
    page.until("S.search.state === 'done'")
    words = page.js("return document.getElementById('nexttext').textContent")
    assert "Nothing needed" in words or "distinguishes" in words
    page.picture("7_searched")
