"""The live plot: what its window shows of messages, and its end."""

import contextlib
import math
import os
import re
import subprocess
import sys

import genpy
import numpy as np
import pytest

from conftest import SCRIPTS, free_port, script, wait_for

os.environ["QT_QPA_PLATFORM"] = "offscreen"  # before Qt is loaded

from ground_msgs.msg import ControllerStatus, Controls, ModelError, Reference, SenderStatus, State

from ground.nodes import live_feed, live_plot
from ground.support.errors import GroundError

DURATION = 20.0


@pytest.fixture(scope="module")
def application():
    yield live_plot.QtWidgets.QApplication.instance() or live_plot.QtWidgets.QApplication(["test"])


@pytest.fixture
def window(application):
    """A visible window whose feed has no messages yet."""
    feed = live_feed.Feed(DURATION)
    window = live_plot.LivePlot(feed)
    window.feed = feed
    window.show()
    application.processEvents()
    window.redraw()
    yield window
    window.close()


def drive(
    feed, start, seconds, topics=("state", "model_error", "controls"), valid=True, rate=100.0, excited=True
):
    """Feeds messages of a turning craft, 30 mm beside its reference."""
    for i in range(int(rate * seconds)):
        t = start + i / rate
        x, y = math.cos(t), math.sin(t)
        error = ModelError(
            model="tiny_whoover",
            horizon=0.5,
            nu=[0.45, -0.5, x],
            eta_error=[0.03, 0.04, -0.1],
            position_error=0.056,
            heading_error=math.radians(16),
            position_noise=0.003,
            heading_noise=math.radians(1),
            excited=excited,
        )
        messages = {
            "state": State(eta=[x, y, t], nu=[0.4, -0.5, 0.6 + y], valid=valid, status="no pose & more"),
            "controls": Controls(left=0.2, right=0.5, lift=1.0),
            "controls/wanted": Controls(left=-0.4, right=0.5, lift=1.0),
            "reference": Reference(p=[x + 0.03, y]),
            "model_error": error,
            "model_error2": ModelError(model="improved_model_<2>", nu=[0.3, -0.4, y], excited=excited),
        }
        for topic in topics:
            messages[topic].header.stamp = genpy.Time.from_sec(t)
            feed.take(messages[topic], topic)


def curves(window, title):
    """(times, values) of the curves of a diagram that have samples."""
    lines = [item.getOriginalDataset() for item in diagram(window, title).plot.listDataItems()]
    return [(x, y) for x, y in lines if x is not None and len(x)]


def diagram(window, title):
    (found,) = [one for one in window.diagrams if one.panel.title.startswith(title)]
    return found


def of_size(values, size):
    """Whether all values but those at the ends are of a size."""
    return np.allclose(np.abs(values[20:-20]), size, rtol=1e-3)


def told(window):
    return [re.sub("<[^>]*>", "", line.text()) for line in window.lines]


@pytest.mark.parametrize("rate", [5.0, 100.0, 1000.0])
def test_curves_show_the_last_seconds_at_any_rate(window, rate):
    drive(window.feed, 1000, 1.2 * DURATION, ["state"], rate=rate)
    window.redraw()
    (times, values), (_, smooth) = curves(window, "yaw rate")
    assert times[-1] == 0 and times[0] == pytest.approx(-DURATION, abs=2 / rate)
    assert len(times) == pytest.approx(DURATION * rate, abs=2)
    stamps = 1000 + 1.2 * DURATION - 1 / rate + times
    np.testing.assert_allclose(values, 0.6 + np.sin(stamps), atol=1e-6)
    np.testing.assert_allclose(smooth, values, atol=0.1)


def test_predictions_are_off_in_millimetres_and_degrees_beside_the_noise(window):
    drive(window.feed, 1000, 10)
    window.redraw()
    for title, sizes in (
        ("prediction off in position", (50, 3, 56)),
        ("prediction off in heading", (5.73, 1, 16)),
    ):
        found = [values for _, values in curves(window, title)]
        assert len(found) == 3
        for values, size in zip(found, sizes):
            assert of_size(values, size)
    assert told(window)[2] == "tiny_whoover: 56 mm, 16 deg after 0.5 s (noise floor: 3.0 mm, 1.0 deg)"
    drive(window.feed, 1010, 1, excited=False)
    window.redraw()
    assert "no excitation" in told(window)[2]


def test_a_pause_keeps_the_curves_and_the_cursor_shows_their_values(window):
    drive(window.feed, 1000, 10)
    window.redraw()
    kept = curves(window, "prediction off in position")
    QTest = pytest.importorskip("PyQt5.QtTest").QTest
    QTest.keyClick(window, live_plot.QtCore.Qt.Key_Space)
    drive(window.feed, 1010, 1)
    window.redraw()
    assert told(window)[3].startswith("Paused")
    np.testing.assert_array_equal(curves(window, "prediction off in position")[0], kept[0])
    under = diagram(window, "yaw rate").plot.vb
    window._point(under.mapViewToScene(live_plot.QtCore.QPointF(-5.0, 0.6)))
    title = re.sub("<[^>]*>", "", diagram(window, "prediction off in position").title)
    assert "noise floor 3 " in title and title.endswith("tiny_whoover 56")
    QTest.keyClick(window, live_plot.QtCore.Qt.Key_Space)
    assert curves(window, "prediction off in position")[0][0][0] < kept[0][0][0]


def test_no_line_is_drawn_across_a_gap_or_an_invalid_state(window):
    drive(window.feed, 1000, 1)
    drive(window.feed, 1002, 1)
    drive(window.feed, 1003, 1, valid=False)
    window.redraw()
    times, values = curves(window, "yaw rate")[0]
    missing = times[np.isnan(values)]
    assert ((missing > -2.99) & (missing < -1.99)).sum() == 1, "the gap"
    assert (missing > -1).sum() == 100, "the invalid state"
    assert told(window)[3] == "The state is invalid: no pose &amp; more"


def test_a_restarted_bag_clears_the_curves(window):
    drive(window.feed, 1000, 10, list(live_feed.TOPICS))
    drive(window.feed, 1009.8, 0.01, ["controls"])
    window.redraw()
    assert len(curves(window, "surge")) == 6, "a message in wrong order clears nothing"
    drive(window.feed, 900, 0.5, ["controls"])
    window.redraw()
    assert told(window)[3] == "Waiting for messages on state, model_error."
    assert not curves(window, "surge") and len(curves(window, "right thruster")) == 1


def test_statuses_are_shown_until_a_node_falls_silent(window, monkeypatch):
    running = ControllerStatus(state=ControllerStatus.RUNNING, reason="driving <on>")
    window.feed.take_status(running, "controller/status")
    fault = SenderStatus(state=SenderStatus.FAULT, reason="stale command")
    window.feed.take_status(fault, "sender/status")
    drive(window.feed, 1000, 1)
    window.redraw()
    assert told(window)[:2] == ["controller RUNNING driving &lt;on&gt;", "sender FAULT stale command"]
    assert told(window)[3].startswith("Newest message: 1001 s. Predictions are 0.5 s ahead.")
    later = live_plot.time.monotonic() + 7
    monkeypatch.setattr(live_plot.time, "monotonic", lambda: later)
    window.redraw()
    assert told(window)[1].endswith("(no message for 7 s)")
    assert told(window)[3] == "No new message for 7 s; the newest has stamp 1001 s."


def test_a_picture_is_saved_and_not_overwritten(window, tmp_path):
    drive(window.feed, 1000, 10, list(live_feed.TOPICS))
    path = tmp_path / "plot.png"
    window.save(str(path))
    with pytest.raises(GroundError, match="plot.png exists"):
        window.save(str(path))
    window.save(str(path), force=True)


def plot(*arguments, **environment):
    """Starts the program as a process."""
    command = [sys.executable, str(SCRIPTS / "plot")]
    env = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    return subprocess.Popen(
        command + [str(a) for a in arguments],
        env=dict(env, **environment),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


MISTAKES = [
    ({"QT_QPA_PLATFORM": "xcb"}, [], 1, "plot: DISPLAY is not set: start it on a desktop"),
    ({"ROS_MASTER_URI": "http://localhost:9"}, [], 1, "plot: no ROS master answers at http://loc"),
    ({}, ["--picture", "/nowhere/plot.png"], 1, "plot: /nowhere/plot.png: there is no folder"),
    ({}, ["--after=nan"], 2, "plot: error: --after has to be positive and at most 600 s"),
]


@pytest.mark.parametrize("environment, arguments, status, reason", MISTAKES)
def test_a_plot_that_cannot_start_prints_one_line(
    environment, arguments, status, reason, monkeypatch, capsys
):
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    assert script(monkeypatch, "plot", *arguments) == status
    shown = capsys.readouterr()
    assert shown.out == "" and shown.err.splitlines()[-1].startswith(reason)


@contextlib.contextmanager
def master(port):
    command = ["rosmaster", "--core", "-p", str(port)]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def answers(uri):
    """Whether a master answers there."""
    import rosgraph

    return rosgraph.Master("/test", uri).is_online()


def test_the_plot_ends_after_its_picture(tmp_path):
    port = free_port()
    uri = "http://localhost:%d" % port
    with master(port):
        wait_for(lambda: answers(uri), 30, "a master")
        program = plot(
            *["--picture", tmp_path / "plot.png", "--after", 1], ROS_MASTER_URI=uri, XDG_RUNTIME_DIR=""
        )
        out, err = program.communicate(timeout=60)
    assert program.returncode == 0 and "Traceback" not in err
    assert str(tmp_path / "plot.png") in out and len(out.splitlines()) == 1
    assert "Qt" not in err and "plugin" not in err
    assert (tmp_path / "plot.png").stat().st_size > 5000
