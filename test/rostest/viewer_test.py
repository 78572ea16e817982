#!/usr/bin/python3
"""An experiment in a viewer: what comes through the websocket and into the MCAP file is what a bag has."""

import importlib.util
import math
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import unittest

import rosbag
import rospy
import rostest
from ground_msgs.msg import ControllerStatus, ModelError, SenderStatus

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "python"))
import harness

HAS_LIBRARY = importlib.util.find_spec("foxglove") is not None  # not for Python 3.8
if HAS_LIBRARY:
    import foxglove_client

DEGREE = math.pi / 180
SCENE = {"/tf", "/log", "/scene/room", "/scene/craft", "/scene/paths", "/scene/floor", "/scene/legend"}
MARGIN = 0.5  # at both ends of the bag, where not everybody listens yet [s]


def of_state(m, shown):
    return [
        (m.eta, (shown.x_m, shown.y_m, shown.heading_deg * DEGREE)),
        (m.nu, (shown.u_m_s, shown.v_m_s, shown.r_deg_s * DEGREE)),
        ((m.age, m.valid, m.status), (shown.age_ms * 1e-3, shown.valid, shown.status)),
    ]


def of_commands(m, shown):
    return [((m.left, m.right, m.lift), (shown.left, shown.right, shown.lift))]


def of_reference(m, shown):
    return [((*m.p, math.hypot(*m.p_dot)), (shown.x_m, shown.y_m, shown.speed_m_s))]


def of_prediction(m, shown):
    off = shown.off_x_mm * 1e-3, shown.off_y_mm * 1e-3, shown.off_heading_deg * DEGREE
    return [
        (m.eta, (shown.x_m, shown.y_m, shown.heading_deg * DEGREE)),
        (m.nu, (shown.u_m_s, shown.v_m_s, shown.r_deg_s * DEGREE)),
        (m.eta_error, off),
        (
            (math.hypot(*m.eta_error[:2]), m.horizon, m.model),
            (shown.off_mm * 1e-3, shown.ahead_s, shown.model),
        ),
    ]


def of_missing(m, shown):
    return [
        (m.wrench, (shown.X_mN * 1e-3, shown.Y_mN * 1e-3, shown.N_mNm * 1e-3)),
        (m.wrench_noise, (shown.X_sigma_mN * 1e-3, shown.Y_sigma_mN * 1e-3, shown.N_sigma_mNm * 1e-3)),
    ]


def of_comparison(m, shown):
    return [
        ((m.difference, m.standard_error, m.better), (shown.difference, shown.standard_error, shown.better))
    ]


CHANNELS = [  # channel, topic, and what has to be equal
    ("/state", "/state", of_state),
    ("/commands", "/controls", of_commands),
    ("/commands/wanted", "/controls/wanted", of_commands),
    ("/reference", "/reference", of_reference),
    ("/model/prediction", "/model_error", of_prediction),
    ("/model/missing", "/model_error", of_missing),
    ("/model2/prediction", "/model_error2", of_prediction),
    ("/model2/missing", "/model_error2", of_missing),
    ("/comparison", "/model_comparison", of_comparison),
]


@unittest.skipUnless(HAS_LIBRARY, "foxglove-sdk is not installed")
class ViewerTest(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.started = []

    def tearDown(self):
        for process in self.started:
            if process.poll() is None:
                process.kill()
                process.wait()
        self.folder.cleanup()

    def start(self, *command):
        self.started.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        return self.started[-1]

    def path(self, name):
        return os.path.join(self.folder.name, name)

    def test_a_viewer_shows_what_a_bag_records(self):
        errors = harness.Latest("model_error2", ModelError)
        harness.wait_for(lambda: errors.message and errors.message.window > 3, 60, "errors of both models")
        viewer = self.start("rosrun", "ground", "viewer", "--port", "0", "--mcap", self.path("live.mcap"))
        port = int(re.search(r"ws://localhost:(\d+)", viewer.stdout.readline()).group(1))
        self.assertTrue(os.path.isfile(viewer.stdout.readline().split()[-1]), "the layout that is named")
        client = foxglove_client.Client(port)
        wanted = {"/scene/floor", *(channel for channel, _, _ in CHANNELS)}
        harness.wait_for(lambda: wanted <= set(client.messages), 40, lambda: wanted - set(client.messages))
        topics = sorted({topic for _, topic, _ in CHANNELS})
        bag = self.start("rosbag", "record", "--chunksize=16", "-O", self.path("run.bag"), *topics)
        active = self.path("run.bag.active")
        harness.wait_for(lambda: os.path.isfile(active) and os.path.getsize(active) > 4e5, 60, "a bag")
        bag.send_signal(signal.SIGINT)
        bag.wait(timeout=20)
        sender = harness.Latest("sender/status", SenderStatus)
        controller = harness.Latest("controller/status", ControllerStatus)
        time.sleep(1.5)
        client.close()
        viewer.send_signal(signal.SIGINT)
        self.assertEqual(viewer.wait(timeout=20), 0)
        live, written = client.messages, foxglove_client.read_mcap(self.path("live.mcap"))
        recorded = self.recorded()
        for channel, topic, compared in CHANNELS:
            for found in (live, written):
                self.check(channel, recorded[topic], found[channel], compared)
        self.check_scene(live)
        self.check_states(live, sender.message, controller.message)

    def recorded(self):
        """Stamps and messages by topic, in their order. A stamp may come twice: a late timer catches up."""
        found = {}
        with rosbag.Bag(self.path("run.bag")) as bag:
            for topic, message, _ in bag.read_messages():
                found.setdefault(topic, []).append((message.header.stamp.to_nsec(), message))
        return found

    def check(self, channel, recorded, shown, compared):
        first, last = recorded[0][0] + MARGIN * 1e9, recorded[-1][0] - MARGIN * 1e9
        wanted = [(at, message) for at, message in recorded if first <= at <= last]
        found = [(at, message) for at, message in shown if first <= at <= last]
        self.assertEqual([at for at, _ in found], [at for at, _ in wanted], channel)
        self.assertGreater(len(found), 3, channel)
        for (_, expected), (_, message) in zip(wanted, found):
            for should, have in compared(expected, message):
                for a, b in zip(should, have):
                    if isinstance(a, str):
                        self.assertEqual(a, b, channel)
                    else:
                        self.assertLessEqual(abs(a - b), 1e-12 * max(1.0, abs(a)), channel)

    def check_scene(self, live):
        self.assertLessEqual(SCENE - {"/log"}, set(live))
        frames = {f.child_frame_id for _, m in live["/tf"] for f in m.transforms}
        self.assertEqual(frames, {"world_ned", "hovercraft", "model", "model2"})
        seconds = (live["/state"][-1][0] - live["/state"][0][0]) / 1e9
        self.assertLess(len(live["/tf"]) / seconds, 20, "pictures a second")
        _, craft = live["/scene/craft"][-1]
        self.assertEqual({e.frame_id for e in craft.entities}, {"hovercraft", "model", "model2"})
        _, room = live["/scene/room"][-1]
        self.assertEqual(len(room.entities[0].lines[0].points), 4, "corners of the room")

    def check_states(self, live, sender, controller):
        _, shown = live["/sender"][-1]
        self.assertEqual(getattr(SenderStatus, shown.state), sender.state)
        self.assertEqual(
            (shown.peer, shown.reason, shown.refused), (sender.peer, sender.reason, sender.refused)
        )
        _, shown = live["/controller"][-1]
        self.assertEqual(getattr(ControllerStatus, shown.state), controller.state)
        self.assertEqual(shown.reason, controller.reason)


if __name__ == "__main__":
    rospy.init_node("viewer_test")
    rostest.rosrun("ground", "viewer_test", ViewerTest)
