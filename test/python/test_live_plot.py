"""The live plot: its buffers, its window and messages, and its end."""

import contextlib
import math
import os
import re
import signal
import subprocess
import sys
import xml.etree.ElementTree

import genpy
import numpy as np
import pytest
from conftest import ROOT, free_port, wait_for

os.environ["QT_QPA_PLATFORM"] = "offscreen"  # before Qt is loaded

from ground_msgs.msg import (
    Controls,
    ControllerStatus,
    DiscoveryStatus,
    ModelError,
    Reference,
    SenderStatus,
    State,
)

from ground.errors import GroundError
from ground.nodes import discovery_panel, live_buffers, live_plot

DURATION = 20.0
LAYOUT = ROOT / "cfg" / "plotjuggler" / "ground.xml"


def filled(rate, seconds, start=1000.0):
    """A history of DURATION with samples (t, -t) from t = start on."""
    history = live_buffers.History(2, DURATION)
    for i in range(int(rate * seconds)):
        t = start + i / rate
        history.add(t, (t, -t))
    return history


@pytest.mark.parametrize("rate", [5.0, 100.0, 1000.0])
def test_a_history_keeps_the_last_seconds_at_any_rate(rate):
    history = filled(rate, 3 * DURATION)
    kept = history.samples(-math.inf)
    assert kept.times[-1] == history.newest == pytest.approx(1000 + 3 * DURATION - 1 / rate)
    assert kept.times[-1] - kept.times[0] == pytest.approx(DURATION, abs=2 / rate)
    assert len(kept.times) == pytest.approx(DURATION * rate, abs=2)
    np.testing.assert_array_equal(kept.values, [kept.times, -kept.times])


def test_returned_samples_do_not_change():
    history = filled(100.0, 3 * DURATION)
    before = history.samples(1050.0)
    stamps = before.times.copy()
    assert stamps[0] == 1050.0
    for i in range(10000):
        history.add(1060 + i / 100, (0.0, 0.0))
    np.testing.assert_array_equal(before.times, stamps)
    np.testing.assert_array_equal(before.values[0], stamps)


def test_no_line_is_drawn_across_a_gap():
    history = filled(100.0, 1.0)
    history.add(1002.0, (1.0, 1.0))
    values = history.samples(-math.inf).values[0]
    assert np.isnan(values[-2]) and np.isfinite(np.delete(values, -2)).all()


def test_a_jump_back_on_one_topic_clears_all_topics():
    buffers = live_buffers.LiveBuffers({"a": 1, "b": 1}, DURATION)
    for i in range(100):
        buffers.add("a", 1000 + i / 10, [1.0])
        buffers.add("b", 1000 + i / 10, [2.0])
    buffers.add("a", 1009.8, [9.0])
    assert len(buffers.snapshot()[1]["a"].times) == 100, "a message in wrong order is ignored"
    buffers.add("a", 1005.0, [3.0])
    now, samples = buffers.snapshot()
    assert now == 1005.0
    assert samples["a"].values.tolist() == [[3.0]]
    assert buffers.silent(["a", "b"]) == ["b"]


def test_all_topics_share_one_time_axis():
    buffers = live_buffers.LiveBuffers({"a": 1, "b": 1}, DURATION)
    buffers.add("a", 0.0, [1.0])
    assert buffers.snapshot()[0] is None, "a message without a stamp"
    buffers.add("a", 1000.0, [1.0])
    buffers.add("b", 1000.0 + 2 * DURATION, [math.inf])
    now, samples = buffers.snapshot()
    assert now == 1000 + 2 * DURATION
    assert len(samples["a"].times) == 0, "more than DURATION older than another topic"
    assert np.isnan(samples["b"].values).all()


def test_the_tracking_error_is_taken_at_the_references_stamps():
    t = np.arange(1000, 1010, 0.01)
    state = live_buffers.Samples(t, np.array([t - 1000, 0 * t, t]))
    state.values[:, (t > 1004) & (t < 1005)] = math.nan
    stamps = np.array([999.0, 1002.005, 1003.0, 1004.5, 1008.0, 1011.0])
    reference = live_buffers.Samples(stamps, np.array([stamps - 1000 + 0.03, 0 * stamps - 0.04]))
    error = live_buffers.tracking_error(state, reference)
    assert error.times.tolist() == stamps[:-1].tolist(), "no state at 1011 s yet"
    expected = [math.nan, 0.05, 0.05, math.nan, 0.05]
    np.testing.assert_allclose(error.values[0], expected, rtol=1e-6)
    nothing = live_buffers.Samples(np.empty(0), np.empty((3, 0)))
    assert len(live_buffers.tracking_error(nothing, reference).times) == 0


def test_a_thinned_curve_keeps_its_extremes_and_its_ends():
    times = np.arange(10007.0)
    values = np.sin(times / 500)
    values[1234], values[4321] = 5.0, -5.0
    thin_times, thin = live_buffers.thinned(times, values, 500)
    assert len(thin) < 600
    assert (thin.min(), thin.max()) == (-5.0, 5.0)
    assert (thin_times[0], thin_times[-1]) == (0.0, 10006.0)
    assert (np.diff(thin_times) >= 0).all()
    assert live_buffers.thinned(times[:900], values[:900], 1000)[1] is not thin
    np.testing.assert_array_equal(live_buffers.thinned(times[:900], values, 1000)[0], times[:900])


def test_an_axis_stays_while_it_fits():
    shown = live_buffers.axis_range(-1.0, 1.0, (0.0, 0.0), 0.0)
    assert shown[0] < -1 and shown[1] > 1
    assert live_buffers.axis_range(-1.1, 1.1, shown, 0.0) == shown
    assert live_buffers.axis_range(-0.7, 0.7, shown, 0.0) == shown
    wider = live_buffers.axis_range(-2.0, 1.0, shown, 0.0)
    assert wider[0] < -2 and wider[1] > 1
    narrower = live_buffers.axis_range(-0.1, 0.1, shown, 0.0)
    assert narrower[1] < 0.2
    least = live_buffers.axis_range(0.5, 0.5, (0.0, 0.0), 0.2)
    assert least[1] - least[0] >= 0.2 and sum(least) / 2 == pytest.approx(0.5)


def test_extent_ignores_nan():
    assert live_buffers.extent(np.array([math.nan, 2.0, -1.0])) == (-1.0, 2.0)
    assert live_buffers.extent(np.array([math.nan])) == ()
    assert live_buffers.extent(np.empty(0)) == ()


@pytest.mark.parametrize("low, high", [(-20.5, 0.5), (-0.63, -0.51), (0.0, 3e-4), (-7.0, 7000.0)])
def test_ticks_are_round_and_inside(low, high):
    found = live_buffers.ticks(low, high, 6)
    assert 2 <= len(found) <= 6
    assert low <= found[0] and found[-1] <= high
    assert all(len("%g" % value) <= 6 for value in found)


@pytest.fixture(scope="module")
def application():
    yield live_plot.QtWidgets.QApplication.instance() or live_plot.QtWidgets.QApplication(["test"])


@pytest.fixture
def window(application):
    """A visible window whose feed has no messages yet."""
    feed = live_plot.Feed(DURATION)
    window = live_plot.LivePlot(feed)
    window.feed = feed
    window.show()
    application.processEvents()
    window.redraw()
    yield window
    window.close()


def stamped(message, t):
    message.header.stamp = genpy.Time.from_sec(t)
    return message


def drive(feed, start, seconds, topics=("state", "model_error", "controls")):
    """Feeds messages of a turning craft on `topics`, every 10 ms."""
    for i in range(int(100 * seconds)):
        t = start + i / 100
        x, y = math.cos(t), math.sin(t)
        messages = {
            "state": State(eta=[x, y, t], nu=[0.4, -0.5 + 0.1 * x, 0.6 + y], valid=True),
            "controls": Controls(left=0.2, right=0.5, lift=1.0),
            "controls/wanted": Controls(left=-0.4, right=0.5, lift=1.0),
            "reference": Reference(p=[x + 0.03, y]),
        }
        for topic, name in (
            ("model_error", "tiny_whoover"),
            ("model_error2", "improved_model_<2>"),
        ):
            messages[topic] = ModelError(
                model=name,
                horizon=0.5,
                nu=[0.45, -0.5, 0.6 + x],
                error=2 + y,
                wrench=[0.01, 0, 1e-4],
            )
        for topic in topics:
            feed.take(stamped(messages[topic], t), topic)


def colors(window, row, column):
    """Number of pixels by colour "#rrggbb" in a diagram."""
    strip = window.diagrams[5 * column + row].strip
    image = strip.grab().toImage()
    found = {}
    for y in range(image.height()):
        for x in range(image.width()):
            name = image.pixelColor(x, y).name()
            found[name] = found.get(name, 0) + 1
    return found


def titles(window):
    return [re.sub("<[^>]*>|&[^;]*;", " ", d.title.text()) for d in window.diagrams]


def status_lines(window):
    return [re.sub("<[^>]*>", "", line.text()) for line in window.lines]


def test_the_window_says_which_topics_it_waits_for(window):
    assert status_lines(window) == [
        "controller no message yet on controller/status",
        "sender no message yet on sender/status",
        "Waiting for messages on state, model_error, controls.",
    ]
    notes = [diagram.strip.note for diagram in window.diagrams]
    assert notes[0] == "no message yet on state and model_error"
    assert notes[4] == "no message yet on reference"
    assert notes[7] == "no message yet on controls"
    assert colors(window, 4, 0).get(live_plot.NOTE, 0) > 20, "the note is visible"
    drive(window.feed, 1000, 1, ["state"])
    window.redraw()
    assert status_lines(window)[2] == "Waiting for messages on model_error, controls."
    assert window.diagrams[0].strip.note == ""


def test_curves_have_their_colors_and_titles_name_the_models(window, application):
    drive(window.feed, 1000, 10)
    window.redraw()
    measured, first, second = live_plot.appearance.MEASURED, *live_plot.appearance.MODELS[:2]
    for row in range(3):
        seen = colors(window, row, 0)
        assert seen.get(measured, 0) > 100 and seen.get(first, 0) > 100 and second not in seen
    assert "tiny_whoover" in titles(window)[0] and "by improved" not in titles(window)[0]
    drive(window.feed, 1010, 5, list(live_plot.TOPICS))
    window.redraw()
    assert colors(window, 2, 0).get(second, 0) > 100
    assert "improved_model_…" in titles(window)[0], "a long name is shortened"
    assert colors(window, 4, 0).get(measured, 0) > 100, "the tracking error"
    assert colors(window, 0, 1).get(live_plot.WANTED, 0) > 100, "inputs that the controller wanted"
    assert titles(window)[8].split()[:4] == ["force", "missing", "in", "tiny_whoover"]


def test_an_axis_covers_all_values_and_has_a_unit(window):
    drive(window.feed, 1000, 5, list(live_plot.TOPICS))
    window.redraw()
    tracking, left = window.diagrams[4], window.diagrams[5]
    assert left.item.vb.viewRange()[1][0] < -0.4, "a wanted input outside of 0..1"
    assert left.item.vb.viewRange()[1][1] > 1
    low, high = tracking.item.vb.viewRange()[1]
    assert high > 30, "30 mm from the reference"
    rows = np.nonzero(dark(tracking.strip)[:, -100:-20].all(axis=1))[0]
    height = tracking.strip.height()
    assert high - rows.mean() / height * (high - low) == pytest.approx(30, abs=1)
    assert tracking.item.getAxis("left").labelText == "distance [mm]"
    assert all(
        re.search(r"\[.+\]|spread", d.item.getAxis("left").labelText) for d in window.diagrams
    )


def dark(strip):
    """Mask (height, width) of the pixels where a strip shows curves."""
    image = strip.grab().toImage()
    gray = [
        [live_plot.QtGui.qGray(image.pixel(x, y)) for x in range(image.width())]
        for y in range(image.height())
    ]
    return np.array(gray) < live_plot.QtGui.QColor(live_plot.GRID).lightness() - 10


def test_scrolled_curves_look_like_curves_drawn_at_once(window):
    drive(window.feed, 1000, 30, list(live_plot.TOPICS))
    window.redraw()
    for i in range(90):
        drive(window.feed, 1030 + i / 30, 1 / 30, list(live_plot.TOPICS))
        window.redraw()
    strips = [diagram.strip for diagram in window.diagrams]
    moved = [dark(strip) for strip in strips]
    window._placed = False
    for strip in strips:
        strip._drawn = None
    window.redraw()
    for strip, before in zip(strips, moved):
        after = dark(strip)
        right = int(strip._x(window.feed.buffers.snapshot()[0]))
        assert after[:, 30 : right - 1].any(axis=0).mean() > 0.98
        assert not after[:, right + 2 :].any()
        # A curve drawn at once is thinned, and may therefore differ by a pixel.
        for one, other in ((before, after), (after, before)):
            near = other.copy()
            for axis in (0, 1):
                near |= np.roll(near, 1, axis) | np.roll(near, -1, axis)
            off = one[:, 30:] & ~near[:, 30:]  # the oldest end disappears gradually
            assert off.sum() < 0.02 * one[:, 30:].sum()


def test_a_restarted_bag_clears_the_curves(window):
    drive(window.feed, 1000, 10, list(live_plot.TOPICS))
    window.redraw()
    assert "predicted by" in titles(window)[0]
    drive(window.feed, 900, 0.5, ["controls"])
    window.redraw()
    assert status_lines(window)[2] == "Waiting for messages on state, model_error."
    assert live_plot.appearance.MEASURED not in colors(window, 0, 0)
    assert "predicted by" not in titles(window)[0]
    assert colors(window, 1, 1).get(live_plot.appearance.THRUSTERS[1], 0) > 5


def test_an_invalid_state_is_reported_and_not_drawn(window):
    drive(window.feed, 1000, 5)
    for i in range(100):
        lost = State(eta=[9.0] * 3, nu=[9.0] * 3, valid=False, status="no pose for 0.5 s & more")
        window.feed.take(stamped(lost, 1005 + i / 100), "state")
    window.redraw()
    assert status_lines(window)[2] == "The state is invalid: no pose for 0.5 s &amp; more"
    assert window.diagrams[0].item.vb.viewRange()[1][1] < 1
    drive(window.feed, 1006, 1)
    window.redraw()
    assert status_lines(window)[2] == "Newest message: 1007 s. Predictions are 0.5 s ahead."


def test_statuses_are_shown_until_a_node_falls_silent(window, monkeypatch):
    running = ControllerStatus(state=ControllerStatus.RUNNING, reason="driving <on>")
    window.feed.take_status(running, "controller/status")
    fault = SenderStatus(state=SenderStatus.FAULT, reason="stale command")
    window.feed.take_status(fault, "sender/status")
    window.redraw()
    assert status_lines(window)[:2] == [
        "controller RUNNING driving &lt;on&gt;",
        "sender FAULT stale command",
    ]
    assert live_plot.GOOD in window.lines[0].text() and live_plot.BAD in window.lines[1].text()
    drive(window.feed, 1000, 1)
    later = live_plot.time.monotonic() + 7
    monkeypatch.setattr(live_plot.time, "monotonic", lambda: later)
    window.redraw()
    assert status_lines(window)[1].endswith("(7 s ago; silent since)")
    assert status_lines(window)[2] == "No new message for 7 s; the newest has stamp 1001 s."


NAN = math.nan
DISCOVERY = dict(
    activity="flies: what <decides>",
    flight=3,
    purpose="decide",
    flown=34.5,
    budget=180.0,
    verdict="missing",
    effects=["motor_lag", "wind"],
    belief_effects=["yaw_bias", "input_delay", "wind", "motor_lag"],
    beliefs=[0.01, 0.3, 0.97, 0.999],
    belief_states=["absent", "open", "present", "present"],
    models=["given", "after flight 1", "after flight 2"],
    flights=3,
    errors=[1.9, 2.1, 1.8, NAN, 0.6, 0.55, NAN, NAN, 0.22],
    floors=[0.2, 0.2, NAN],
)


def test_a_discovery_has_a_panel_below_the_curves(window, application):
    assert window.panel is None
    height = window.height()
    drive(window.feed, 1000, 5)
    window.feed.take_discovery(DiscoveryStatus(**DISCOVERY))
    window.redraw()
    application.processEvents()
    panel = window.panel
    assert window.height() == height + discovery_panel.HEIGHT and panel.isVisible()
    assert re.sub("<[^>]*>", "", panel.line.text()) == (
        "discovery, flight 3 (decide): 34 of 180 s flown. Verdict: missing motor_lag, wind. "
        "Now: flies: what &lt;decides&gt;"
    )
    named = re.sub("<[^>]*>|&[^;]*;", " ", panel.legend.text()).split()
    assert " ".join(named).endswith("given after flight 1 after flight 2 floor")
    lines = [item.getOriginalDataset() for item in panel.chart.listDataItems()]
    assert [list(x) for x, _ in lines[:4]] == [[1, 2, 3], [1, 2, 3], [2, 3], [3]]
    newest = [1.9, 0.6, 0.22]
    assert [list(y) for _, y in lines[:4]] == [newest, [1.9, 2.1, 1.8], [0.6, 0.55], [0.22]]
    assert len(lines) == 6, "floors of two flights"


def test_a_belief_has_a_bar_as_long_as_it_is_probable(window, application):
    window.feed.take_discovery(DiscoveryStatus(**DISCOVERY))
    window.redraw()
    application.processEvents()
    beliefs = window.panel.beliefs
    image = beliefs.grab().toImage()
    whole = image.width() - discovery_panel.NAME - discovery_panel.VALUE
    ordered = [(0.999, "present"), (0.97, "present"), (0.3, "open"), (0.01, "absent")]
    for row, (probability, state) in enumerate(ordered):
        y = row * discovery_panel.BAR + discovery_panel.BAR // 2
        color = discovery_panel.COLORS[state]
        bar = [image.pixelColor(x, y).name() == color for x in range(image.width())]
        assert sum(bar) == pytest.approx(probability * whole, abs=2), ordered[row]


def test_many_beliefs_are_summed_up(window, application):
    many = dict(DISCOVERY, belief_effects=["effect %d" % i for i in range(60)])
    many.update(beliefs=[0.02] * 60, belief_states=["absent"] * 60)
    window.feed.take_discovery(DiscoveryStatus(**many))
    window.redraw()
    application.processEvents()
    image = window.panel.beliefs.grab().toImage()
    bottom = range(image.height() - discovery_panel.BAR, image.height())
    ink = sum(image.pixelColor(x, y).name() != "#ffffff" for y in bottom for x in range(300))
    assert ink > 20, "how many are not drawn"


@pytest.mark.parametrize(
    "status",
    [
        DiscoveryStatus(),
        DiscoveryStatus(models=["given"], flights=2, errors=[NAN, NAN], floors=[NAN, NAN]),
        DiscoveryStatus(models=["given"], flights=2, ended=True, reason="no battery", sure=False),
    ],
    ids=["empty", "nothing known", "ended"],
)
def test_the_panel_shows_a_discovery_at_any_time(window, application, status):
    window.feed.take_discovery(DiscoveryStatus(**DISCOVERY))
    window.redraw()
    window.feed.take_discovery(status)
    window.redraw()
    application.processEvents()
    assert window.panel.chart.listDataItems() == []
    assert window.panel.line.text().startswith("<b>discovery</b>")
    assert ("Ended, not sure: no battery" in window.panel.line.text()) == status.ended


def test_a_picture_is_saved_and_not_overwritten(window, tmp_path):
    from PIL import Image

    drive(window.feed, 1000, 10, list(live_plot.TOPICS))
    path = tmp_path / "plot.png"
    window.save(str(path))
    picture = Image.open(str(path)).convert("RGB")
    assert picture.size == live_plot.SIZE
    assert len(picture.getcolors(1 << 20)) > 20
    with pytest.raises(GroundError, match="plot.png exists"):
        window.save(str(path))
    window.save(str(path), force=True)
    with pytest.raises(GroundError, match="there is no folder"):
        window.save(str(tmp_path / "nowhere" / "plot.png"))


def test_closing_the_window_ends_the_plot(application, monkeypatch):
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    live_plot.QtCore.QTimer.singleShot(200, application.closeAllWindows)
    live_plot.show(live_plot.Feed(DURATION))


def test_a_failure_while_drawing_ends_the_plot_with_the_reason(application, monkeypatch):
    def fail(_):
        raise GroundError("no more ink")

    monkeypatch.setattr(signal, "signal", lambda *_: None)
    monkeypatch.setattr(live_plot.LivePlot, "redraw", fail)
    with pytest.raises(GroundError, match="no more ink"):
        live_plot.show(live_plot.Feed(DURATION))


def plot(*arguments, **environment):
    """Starts the program as a process."""
    command = [sys.executable, str(ROOT / "src" / "ground" / "scripts" / "plot")]
    env = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    return subprocess.Popen(
        command + [str(a) for a in arguments],
        env=dict(env, **environment),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        universal_newlines=True,
    )


MISTAKES = [
    ({"QT_QPA_PLATFORM": "xcb"}, [], 1, "plot: DISPLAY is not set: start it on a desktop"),
    ({"QT_QPA_PLATFORM": "xcb", "DISPLAY": ":987"}, [], 1, "plot: display :987 cannot be opened"),
    ({"ROS_MASTER_URI": "http://localhost:9"}, [], 1, "plot: no ROS master answers at http://loc"),
    ({}, ["--picture", "/nowhere/plot.png"], 1, "plot: /nowhere/plot.png: there is no folder"),
]


@pytest.mark.parametrize("environment, arguments, status, reason", MISTAKES)
def test_a_plot_that_cannot_start_prints_one_line(environment, arguments, status, reason):
    program = plot(*arguments, **environment)
    out, err = program.communicate(timeout=60)
    assert program.returncode == status
    assert out == ""
    lines = [line for line in err.splitlines() if not line.startswith("QStandardPaths")]
    assert len(lines) == 1 and lines[0].startswith(reason), err


@pytest.mark.parametrize("arguments", ["--duration=0", "--duration=1e4", "--after=nan"])
def test_impossible_times_are_refused(arguments):
    program = plot(arguments)
    status_lines = program.communicate(timeout=60)[1].splitlines()[-1]
    assert status_lines == "plot: error: %s has to be positive and at most 600 s" % arguments.split("=")[0]
    assert program.returncode == 2


@contextlib.contextmanager
def master(port):
    command = ["rosmaster", "--core", "-p", str(port)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def subscribed(uri):
    """Whether /sender/status, the last topic to which the plot subscribes, has a subscriber."""
    import rosgraph

    with contextlib.suppress(OSError, rosgraph.MasterException):
        listened = rosgraph.Master("/test", uri).getSystemState()[1]
        return "/sender/status" in dict(listened)


def ended(program):
    """Waits for the end; checks that nothing was printed to stderr and returns the status."""
    err = program.communicate(timeout=30)[1]
    lines = [
        line for line in err.splitlines() if not line.startswith(("QStandardPaths", "This pl"))
    ]
    assert lines == []
    return program.returncode


def test_the_plot_finds_a_new_master_and_ends_without_messages():
    port = free_port()
    uri = "http://localhost:%d" % port
    with master(port):
        wait_for(lambda: subscribed(uri) is False, 30, "a master")
        program = plot(ROS_MASTER_URI=uri)
        try:
            wait_for(lambda: subscribed(uri), 30, "the window")
        except AssertionError:
            program.kill()
            raise
    try:
        with master(port):
            wait_for(lambda: subscribed(uri), 30, "the window at the new master")
            program.send_signal(signal.SIGINT)
            assert ended(program) == 0
    finally:
        program.kill()


def test_the_plot_ends_after_its_picture(tmp_path):
    port = free_port()
    uri = "http://localhost:%d" % port
    with master(port):
        wait_for(lambda: subscribed(uri) is False, 30, "a master")
        program = plot("--picture", tmp_path / "plot.png", "--after", 1, ROS_MASTER_URI=uri)
        try:
            assert ended(program) == 0
        finally:
            program.kill()
    assert (tmp_path / "plot.png").stat().st_size > 5000


def layout_curves():
    """Curves of the layout for PlotJuggler, and its computed curves with their sources."""
    root = xml.etree.ElementTree.parse(str(LAYOUT)).getroot()
    drawn = {curve.get("name") for curve in root.iter("curve")}
    computed = {
        snippet.get("name"): [snippet.findtext("linked_source")]
        + [source.text for source in snippet.find("additional_sources")]
        for snippet in root.iter("snippet")
    }
    return drawn, computed


def test_plotjuggler_draws_the_same_curves():
    drawn, computed = layout_curves()
    wanted = {
        "/%s/%s" % (curve.topic, curve.field)
        for panels in live_plot.COLUMNS
        for panel in panels
        for curve in panel.curves
        if curve.topic != live_plot.TRACKING
    }
    assert drawn - set(computed) == wanted
    assert list(computed) == ["tracking error [m]"] and set(computed) <= drawn
    assert sorted(computed["tracking error [m]"]) == [
        "/reference/p[0]",
        "/reference/p[1]",
        "/state/eta[0]",
        "/state/eta[1]",
    ]


def test_the_fields_that_plotjuggler_draws_are_in_the_messages():
    drawn, computed = layout_curves()
    names = (drawn - set(computed)).union(*computed.values())
    assert names
    for name in names:
        topic, _, field = name[1:].rpartition("/")
        kind = live_plot.TOPICS[topic].kind
        bare, _, index = field.rstrip("]").partition("[")
        types = dict(zip(kind.__slots__, kind._slot_types))
        assert bare in types, name
        length = re.search(r"\[(\d+)\]", types[bare])
        assert bool(length) == bool(index), name
        assert not length or int(index) < int(length.group(1)), name


def test_plotjuggler_listens_to_the_topics():
    root = xml.etree.ElementTree.parse(str(LAYOUT)).getroot()
    assert root.find("previouslyLoaded_Streamer").get("name") == "ROS Topic Subscriber"
    for plugin in root.find("Plugins"):
        selected = plugin.find("selected_topics").get("value").split(";")
        assert sorted(selected) == sorted("/" + topic for topic in live_plot.TOPICS)
        assert plugin.find("use_header_stamp").get("value") == "true"
