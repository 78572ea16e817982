"""Runs for Foxglove and other viewers: MCAP files are read back, and a live view meets strange messages."""

import json
import math
import os
import re
import subprocess
import time
import xml.etree.ElementTree

import numpy as np
import pytest

import ground
from conftest import MODEL, ROOT, free_port, identify, json_of, located
from ground.analysis import missing_wrench
from ground.exporting import channels, viewers
from ground.poses import angles, repair

pytest.importorskip("foxglove", reason="foxglove-sdk needs Python 3.10")
import foxglove

import foxglove_client

LAYOUTS = ROOT / "cfg" / "foxglove" / "ground.json", ROOT / "cfg" / "plotjuggler" / "ground.xml"
ROOM = ROOT / "cfg" / "room" / "room_4x4.yaml"
EXACT = 1e-12  # relative
HOSTILE = 'a<b>\x1b[31m\x00 "\\\u202e\ud800\n<script>alert(1)</script>'


@pytest.fixture(scope="module")
def truth():
    return ground.Model.load(MODEL).with_effect("yaw_bias", n0=6e-5)


@pytest.fixture(scope="module")
def run(truth, tmp_path_factory):
    """Bag of a run of the true craft in a room."""
    path = tmp_path_factory.mktemp("run") / "run.bag"
    ground.simulate(truth, "multilevel-prbs", room=ROOM, duration=20, seed=4).save(path)
    return path


@pytest.fixture(scope="module")
def diagnosis(run, tmp_path_factory):
    """Folder of its diagnosis."""
    folder = tmp_path_factory.mktemp("diagnosis") / "d"
    ground.diagnose(MODEL, run, only=["yaw_bias"]).save(folder)
    return folder


@pytest.fixture(scope="module")
def exported(run, diagnosis, tmp_path_factory):
    """What the command line says, and the messages of its file."""
    path = tmp_path_factory.mktemp("mcap") / "run.mcap"
    return json_of("export", run, diagnosis, "--mcap", path), foxglove_client.read_mcap(path)


def numbers(messages, *fields):
    """Times [s] of messages, and their fields as columns, in SI."""
    factors = [channels.factor(field) for field in fields]
    rows = [[getattr(m, f) / by for f, by in zip(fields, factors)] for _, m in messages]
    return np.array([at for at, _ in messages]) / 1e9, np.array(rows)


def assert_same(found, times, values):
    assert np.allclose(found[0], times, rtol=0, atol=1e-6)
    assert np.allclose(found[1], values, rtol=EXACT, atol=EXACT)


def test_an_exported_run_has_what_was_measured(run, exported):
    (recording,) = ground.read(run)
    said, messages = exported
    stamps = np.sort(repair.on_commands_clock(recording.pose_times, recording.clock_offset))
    raw = recording.to_frame(raw=True)
    assert_same(numbers(messages["/pose"], *channels.POSE), stamps, raw[["x", "y", "psi"]])
    frame, motion = recording.to_frame(), recording.motion
    state = numbers(messages["/state"], *channels.MOTION)
    state[1][:, 2] = angles.wrap(state[1][:, 2])
    assert_same(state, motion.times, frame[["x", "y", "psi", "u", "v", "r"]])
    sent = numbers(messages["/commands"], "left", "right", "lift")
    assert_same(sent, recording.control_times, recording.controls)
    counted = {topic: len(messages[topic]) for topic in said["counts"]}
    assert said["counts"] == counted


def test_an_exported_run_has_what_both_models_of_a_diagnosis_predict(run, diagnosis, exported):
    (recording,) = ground.read(run)
    given, improved = ground.Model.load(MODEL), ground.load(diagnosis).improved
    said, messages = exported
    assert said["models"] == [given.label, improved.label]
    errors = []
    for topic, model in (("/model", given), ("/model2", improved)):
        made = model.predict(recording)
        shown, times = messages[topic + "/prediction"], made.times + made.zero
        assert_same(numbers(shown, *channels.MOTION, "ahead_s"), times, np.c_[made.predicted, made.ahead])
        off = numbers(shown, "off_x_mm", "off_y_mm", "off_heading_deg", "off_mm")
        distance = np.hypot(*made.residuals[:, :2].T)
        assert_same(off, times, np.c_[made.residuals[:, :3], distance])
        core = model.core
        lacks = missing_wrench.of_wrench(missing_wrench.undisturbed(core, made.run), core)
        fields = "X_mN", "Y_mN", "N_mNm", "X_sigma_mN", "Y_sigma_mN", "N_sigma_mNm"
        wrench = numbers(messages[topic + "/missing"], *fields)
        assert_same(wrench, lacks.times + made.zero, np.c_[lacks.wrench, lacks.sigma])
        _, found = messages[topic + "/accuracy"][0]
        assert math.isclose(found.position_mm, made.position_mm, rel_tol=EXACT)
        assert math.isclose(found.heading_noise_deg, made.noise_deg, rel_tol=EXACT)
        errors.append(found.heading_deg)
    assert errors[1] < 0.3 * errors[0]


def test_an_exported_run_is_drawn(run, exported):
    _, messages = exported
    (room,) = {m.SerializeToString() for _, m in messages["/scene/room"] for m in m.entities[0].lines[:1]}
    corners = [(p.x, p.y) for p in messages["/scene/room"][0][1].entities[0].lines[0].points]
    assert np.allclose(corners, ground.Room.load(ROOM).corners)
    times, places = numbers(messages["/state"], "x_m", "y_m", "heading_deg")
    for at, message in messages["/tf"][:: len(messages["/tf"]) // 20]:
        frames = {f.child_frame_id: f for f in message.transforms}
        craft = frames["hovercraft"]
        x, y, psi = places[np.argmin(abs(times - at / 1e9))]
        half = np.array([craft.rotation.w, craft.rotation.z])
        assert np.allclose([craft.translation.x, craft.translation.y], [x, y])
        assert abs(half @ [math.cos(psi / 2), math.sin(psi / 2)]) == pytest.approx(1)
        # z of world_ned points down
        assert (frames["world_ned"].parent_frame_id, frames["world_ned"].rotation.x) == ("world", 1.0)
    arrows = [a for _, m in messages["/scene/craft"] for e in m.entities for a in e.arrows]
    assert arrows and all(a.shaft_length > 0 for a in arrows)


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["RUN"], "--mcap FILE"),
        (["RUN", "-o", "x.py", "--mcap", "x.mcap"], "--mcap FILE"),
        (["MODEL", "DIAGNOSIS", "-o", "x.py"], "--mcap"),
        (["RUN", "MODEL", "MODEL", "MODEL", "--mcap", "x.mcap"], "at most 2 models"),
        (["RUN", "MODEL", "--mcap", "x.mcap", "--horizon", "1000"], "long enough"),
        (["RUN", "EMPTY", "--mcap", "x.mcap"], "EMPTY"),
        (["RUN", "--mcap", "RUN", "--force"], "input of this command"),
        (["RUN", "--mcap", "nowhere/x.mcap"], "nowhere"),
    ],
)
def test_what_cannot_be_exported_is_said(run, diagnosis, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "EMPTY").mkdir()
    names = {"RUN": run, "MODEL": MODEL, "DIAGNOSIS": diagnosis}
    said = identify("export", *[names.get(word, word) for word in arguments])
    assert said.returncode in (1, 2) and words in said.stderr and "Traceback" not in said.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"EMPTY"} and run.stat().st_size > 1e5


def test_an_mcap_file_is_replaced_only_by_force(run, tmp_path):
    path = tmp_path / "run.mcap"
    first = ground.to_mcap(run, path)
    assert sorted(first.counts) == ["/commands", "/log", "/pose", "/state"] and not first.models
    with pytest.raises(ground.GroundError, match="exists"):
        ground.to_mcap(run, path)
    assert ground.to_mcap(run, path, [MODEL], force=True).models == ["tiny_whoover"]
    assert [p.name for p in tmp_path.iterdir()] == ["run.mcap"]


def test_layouts_show_only_channels_that_there_are():
    known = {topic + "." + f for topic, kind in channels.KINDS.items() for f in (*kind.numbers, *kind.texts)}
    known |= {"%s.%s" % (topic, name) for topic in channels.COMMANDS for name in ("left", "right", "lift")}
    text, tree = LAYOUTS[0].read_text(), xml.etree.ElementTree.parse(str(LAYOUTS[1])).getroot()
    layout = json.loads(text)
    panels = layout["configById"]
    paths = {p["value"] for panel in panels.values() for p in panel.get("paths", [])}
    curves = {c.get("name") for c in tree.iter("curve")} - {s.get("name") for s in tree.iter("snippet")}
    curves |= {e.text for s in tree.iter("snippet") for e in s.iter() if (e.text or "").startswith("/")}
    assert len(paths) > 10 and len(curves) > 10
    assert paths <= known and {re.sub("/([^/]*)$", r".\1", name) for name in curves} <= known
    shown = {topic for panel in panels.values() for topic in panel.get("topics", {})}
    assert shown and shown <= set(channels.SCENES)
    placed = set(re.findall(r'"((?:first|second|layout)": "|)([A-Za-z0-9]+![a-z]+)"', text))
    assert {name for _, name in placed} == set(panels), "every panel has a place"


class Shown:
    """A live view, with its server and a client."""

    def __init__(self, name="test"):
        self.context = viewers.context()
        self.server = viewers.served(self.context, name, "127.0.0.1", 0)

    def __enter__(self):
        from ground.exporting.view import View

        self.view, opened = View(self.context), self.server.__enter__()
        self.port = opened.port
        self.client = foxglove_client.Client(opened.port)
        return self

    def __exit__(self, *_):
        self.client.close()
        self.server.__exit__(None, None, None)

    def messages(self, topic, count=1):
        """Messages of a channel, when there are so many."""
        deadline = time.monotonic() + 20
        while len(self.client.messages.get(topic, [])) < count:
            assert time.monotonic() < deadline, "no message on %s" % topic
            time.sleep(0.01)
        return [message for _, message in self.client.messages[topic]]

    def subscribed(self, *topics):
        """Waits until the client has subscribed: what was sent before, it does not get."""
        deadline = time.monotonic() + 20
        while not set(topics) <= set(self.client.channels):
            assert time.monotonic() < deadline
            time.sleep(0.01)
        time.sleep(0.3)


def ros_messages():
    return pytest.importorskip("ground_msgs.msg", reason="needs the messages of ROS")


def stamped(kind, seconds, **values):
    from genpy import Time

    message = kind(**values)
    message.header.stamp = Time.from_sec(seconds)
    return message


def test_texts_of_any_kind_are_shown_as_texts():
    msgs = ros_messages()
    from ground.nodes.live_viewer import LiveViewer

    with Shown() as shown:
        viewer = LiveViewer(shown.view, lambda: None)
        status = stamped(msgs.SenderStatus, 3, state=2, reason=HOSTILE, peer=HOSTILE)
        belief = {"belief_effects": [HOSTILE], "beliefs": [0.5], "belief_states": ["open"]}
        controls = {"channels": ["7<b>", "ö", "7<b>"], "thrusters": [0.1, 0.2, 0.3], "lift": 1.0}
        error = {"model": HOSTILE, "failure": HOSTILE, "horizon": 1.0, "excited": True}
        sent = [
            ("sender/status", status),
            ("discovery/status", stamped(msgs.DiscoveryStatus, 3, activity=HOSTILE, **belief)),
            ("controls", stamped(msgs.Controls, 3, **controls)),
            ("model_error", stamped(msgs.ModelError, 3, **error)),
            ("state", stamped(msgs.State, 3, status=HOSTILE)),
        ]
        for _ in range(2):  # the first ones make the channels
            for topic, message in sent:
                viewer.take(topic, message)
            shown.subscribed("/sender", "/beliefs", "/model/prediction")
        status.reason += "!"
        viewer.take("sender/status", status)
        texts = [m.message for m in shown.messages("/log")]
        texts += [m.reason for m in shown.messages("/sender")] + [
            m.model for m in shown.messages("/model/prediction")
        ]
        texts += [row.effect for m in shown.messages("/beliefs") for row in m.beliefs]
        assert all("<script>alert(1)</script>" in text for text in texts)
        assert not any(c in text for text in texts for c in "\x1b\x00\u202e\ud800")
        commands = shown.messages("/commands")[-1]
        values = [getattr(commands, name) for name in commands.DESCRIPTOR.fields_by_name]
        assert sorted(values) == [0.1, 0.2, 0.3, 1.0]


def test_numbers_that_are_not_finite_reach_the_viewer_and_stop_nothing():
    msgs = ros_messages()
    from ground.nodes.live_viewer import LiveViewer

    with Shown() as shown:
        viewer = LiveViewer(shown.view, lambda: None)
        nan = [math.nan] * 3
        for i in range(60):
            valid = i % 2 == 0
            state = stamped(
                msgs.State, 5 + 0.1 * i, eta=nan if valid else [0, 0, math.inf], nu=nan, valid=valid
            )
            error = stamped(
                msgs.ModelError, 5 + 0.1 * i, eta=nan, eta_error=nan, wrench=nan, window=9, excited=True
            )
            viewer.take("model_error", error)
            viewer.take("state", state)
            if i == 30:
                shown.subscribed("/state", "/scene/craft", "/tf")
        viewer.take("state", stamped(msgs.State, 20, eta=[0.5, 0, 0], nu=nan, valid=True))
        assert all(math.isnan(m.u_m_s) for m in shown.messages("/state", 20))
        (frame,) = [f for f in shown.messages("/tf")[-1].transforms if f.child_frame_id == "hovercraft"]
        assert frame.translation.x == 0.5 and shown.messages("/scene/craft")


def test_time_that_jumps_back_begins_a_new_view():
    msgs = ros_messages()
    from ground.nodes.live_viewer import LiveViewer

    began = []
    with Shown() as shown:
        viewer = LiveViewer(shown.view, lambda: began.append(True))
        for start, x in ((100.0, 1.0), (50.0, -1.0)):
            for i in range(100):
                viewer.take("state", stamped(msgs.State, start + 0.01 * i, eta=[x, 0, 0], valid=True))
            shown.subscribed("/scene/paths")
        for i in range(100, 150):
            viewer.take("state", stamped(msgs.State, 50 + 0.01 * i, eta=[-1, 0, 0], valid=True))
        paths = shown.messages("/scene/paths", 2)[-1]
    assert len(began) == 1
    assert {p.x for e in paths.entities for line in e.lines for p in line.points} == {-1.0}


def test_the_server_says_when_a_port_is_taken_and_listens_to_this_computer_only():
    with Shown() as shown:
        with pytest.raises(ground.GroundError, match="port %d" % shown.port):
            with viewers.served(foxglove.Context(), "test", "127.0.0.1", shown.port):
                pass
        listening = {line.split()[1] for line in open("/proc/net/tcp") if line.split()[3] == "0A"}
        assert {a.split(":")[0] for a in listening if int(a.split(":")[1], 16) == shown.port} == {"0100007F"}


def viewer(*arguments, **environment):
    ros_messages()
    command = [located("viewer"), *map(str, arguments)]
    env = {**os.environ, "ROS_MASTER_URI": "http://localhost:%d" % free_port(), **environment}
    return subprocess.run(command, capture_output=True, text=True, timeout=60, env=env)


def test_the_program_names_its_layout_and_what_is_missing():
    named = viewer("--layout")
    assert named.returncode == 0 and json.loads(open(named.stdout.strip()).read())["configById"]
    alone = viewer()
    assert alone.returncode == 1 and re.match("viewer: no ROS master answers.*\n$", alone.stderr)
    assert viewer("--port", "99999").returncode == 2
