#!/usr/bin/python3
"""A discovery through the whole chain: the hidden effect is found and confirmed inside the room."""

import math
import shutil

import harness
import rospy
import rostest
from discovery_case import DiscoveryCase, thrust
from ground_msgs.msg import ControllerStatus, ModelError, SenderStatus
from nav_msgs.msg import Path
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

ENDS = 1200  # longest discovery, wall time [s]


def points(rows):
    """Points of a path that can be compared."""
    return tuple((round(x, 6), round(y, 6)) for x, y in rows)


class DiscoverTest(DiscoveryCase):
    def test_the_craft_finds_its_own_physics(self):
        planned = harness.Latest("discovery/planned", Path, keep=True)
        markers = harness.Latest("discovery/markers", MarkerArray)
        newest = harness.Latest("model_error2", ModelError)
        tracker = harness.Latest("tracker/status", ControllerStatus, keep=True)
        self.wait_until_it_says("arm by hand: rosservice call /sender/arm true")
        self.assertEqual(self.sender.message.state, SenderStatus.DISARMED)
        self.assertEqual([m for _, m in self.controls.all if thrust(m) > 0 or m.lift > 0], [])
        self.addCleanup(shutil.rmtree, self.discovery.message.folder)
        self.arm()
        self.wait_until_it_ends(ENDS)

        self.check_found("motor_lag")
        self.check_room()
        self.check_rest()
        journal = self.check_folder()
        self.assertTrue(journal["confirmation"]["holds"], journal["confirmation"]["sentence"])
        before = journal["tracking"]["before"]  # None: the room's fence stopped the given model
        self.assertLess(journal["tracking"]["after"], math.inf if before is None else 0.5 * before)
        self.assertEqual(self.discovery.message.flown, sum(f["seconds"] for f in journal["flights"]))
        self.assertLess(self.discovery.message.flown, self.discovery.message.budget)
        self.assertIn(ControllerStatus.DONE, [m.state for _, m in tracker.all])

        # Each flight was announced by its path.
        shown = [
            points([(pose.pose.position.x, pose.pose.position.y) for pose in path.poses])
            for _, path in planned.all
        ]
        for flown in journal["flights"]:
            self.assertIn(points([row[1:] for row in flown["flight"]["path"]]), shown)
        self.assertEqual(newest.message.model.split("_")[0], "after")
        texts = [m.text for m in markers.message.markers]
        for effect in self.discovery.message.effects:
            self.assertTrue(any(text.endswith(" " + effect) for text in texts), texts)
        answer = rospy.ServiceProxy("discovery/stop", Trigger)()
        self.assertIn("ended already", answer.message)


if __name__ == "__main__":
    rospy.init_node("discover_test")
    rostest.rosrun("ground", "discover_test", DiscoverTest)
