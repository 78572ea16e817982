#!/usr/bin/python3
"""The default experiment in its room, through the whole chain."""

import os
import unittest

import harness
import numpy as np
import rospy
import rostest
from ground_msgs.msg import Burst, ControllerStatus, Controls, Decision, State
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from ground import _core

MODEL = os.path.join(os.path.dirname(os.path.abspath(__file__)), "../../cfg/hovercraft/tiny_whoover.yaml")
HALF_WIDTH = 2.0  # half the width of the square room [m]
BIT = 1 / 15.0  # length of a bit [s]


STATES = ["IDLE", "WAITING", "LIFTING", "RUNNING", "DONE", "STOPPED", "RECOVERING"]


def changes(stages):
    """Times since the begin of LIFTING [s] and names of the states; RECOVERING counts as RUNNING."""
    names = [n.replace("RECOVERING", "RUNNING") for _, n in stages]
    first = names.index("LIFTING")
    found = [i for i in range(first, len(names)) if names[i] != names[i - 1]]
    return [stages[i][0] - stages[first][0] for i in found], [names[i] for i in found]


def simulated():
    """Stages (time [s], name) of the same experiment without ROS."""
    params = _core.ExcitationParams()
    params.room = _core.RoomPlan()
    model = _core.load_model(MODEL)
    zeros = np.zeros(3)
    log = _core.excite(model, model, params, zeros, zeros, _core.MocapParams(), 4)
    return [(time, name) for time, name, _ in log["stages"]]


class RoomTest(unittest.TestCase):
    def test_the_default_experiment_stays_inside(self):
        truth = harness.Latest("simulator/truth", State, keep=True)
        status = harness.Latest("controller/status", ControllerStatus, keep=True)
        bursts = harness.Latest("bursts", Burst, keep=True)
        controls = harness.Latest("controls", Controls, keep=True)
        decisions = harness.Latest("decision", Decision, keep=True)
        room, legend = harness.Latest("room", MarkerArray), harness.Latest("legend", MarkerArray)
        heard = (truth, status, bursts, controls, decisions)
        harness.wait_for(
            lambda: status.message and all(topic.connections() for topic in heard), 30, "the nodes"
        )
        start = rospy.ServiceProxy("controller/start", Trigger)()
        self.assertTrue(start.success, start.message)
        ended = (ControllerStatus.DONE, ControllerStatus.STOPPED)
        harness.wait_for(lambda: status.message and status.message.state in ended, 60, "the end")
        self.assertEqual(status.message.state, ControllerStatus.DONE, status.message.reason)

        farthest = max(max(abs(m.eta[0]), abs(m.eta[1])) for _, m in truth.all)
        print("farthest %.2f m, %d bursts" % (farthest, bursts.message.number))
        self.assertLess(farthest, HALF_WIDTH)
        self.assertGreater(farthest, 0.5)
        marks = [(m.header.stamp.to_sec(), m.number, m.burst) for _, m in bursts.all]
        self.assertGreater(len(marks), 4)
        self.assertEqual([m[2] for m in marks], [(i % 2 == 0) == marks[0][2] for i in range(len(marks))])
        self.assertTrue(all(m.reason for _, m in bursts.all))
        # Only during returns home the controller decides by the state.
        decided = [m.header.stamp.to_sec() for _, m in decisions.all]
        spans = [(a, b) for (a, _, burst), (b, _, _) in zip(marks, marks[1:]) if burst]
        self.assertGreater(len(decided), 50)
        self.assertEqual([t for t in decided for a, b in spans if a + 0.02 < t < b - 0.02], [])

        self.check_states(status)
        self.check_edges(marks, controls)

        walls = next(m for m in room.message.markers if m.id == 0)
        self.assertEqual(len(walls.points), 8)
        self.assertEqual(max(p.x for p in walls.points), HALF_WIDTH)
        self.check_legend(legend.message.markers[1:])

    def check_legend(self, lines):
        """Each patch is at the left edge, which the view shows; each text ends before the wall."""
        texts = [line for line in lines if line.type == Marker.TEXT_VIEW_FACING]
        self.assertGreater(len(texts), 3)
        aside = rospy.get_param("visualizer/legend_aside")
        for patch in (line for line in lines if line.type == Marker.CUBE):
            self.assertAlmostEqual(patch.pose.position.y - 0.5 * patch.scale.y, aside, places=6)
        for line in texts:
            half = 0.5 * line.scale.z * _core.text_width(line.text)
            self.assertGreater(line.pose.position.y - half, aside + line.scale.z, line.text)
            self.assertLess(line.pose.position.y + half, -HALF_WIDTH, line.text)

    def check_states(self, status):
        """The experiment without ROS has the same states at the same times."""
        names = {getattr(ControllerStatus, n): n for n in STATES}
        lived = [(m.header.stamp.to_sec(), names[m.state]) for _, m in status.all]
        self.assertEqual(changes(lived)[1], changes(simulated())[1])
        np.testing.assert_allclose(changes(lived)[0], changes(simulated())[0], atol=0.05)

    def check_edges(self, marks, controls):
        """Edges of the commands are at multiples of a bit from the begin of their burst."""
        late = []
        for (begin, _, burst), (end, _, _) in zip(marks, marks[1:]):
            if not burst:
                continue
            inside = [
                (m.header.stamp.to_sec(), m.left, m.right)
                for _, m in controls.all
                if begin - 1e-3 <= m.header.stamp.to_sec() < end
            ]
            for before, after in zip(inside, inside[1:]):
                if before[1:] != after[1:]:
                    bits = (after[0] - begin) / BIT
                    late.append(abs(bits - round(bits)) * BIT)
        late.sort()
        self.assertGreater(len(late), 20)
        print("edges off by %.2f ms (median) of simulated time" % (1e3 * late[len(late) // 2]))
        self.assertLess(late[len(late) // 2], 0.005)


if __name__ == "__main__":
    rospy.init_node("room_test")
    rostest.rosrun("ground", "room_test", RoomTest)
