#!/usr/bin/python3
"""The identification node during an experiment: tasks on live topics and bags, progress."""

import json
import os
import shutil
import threading
import unittest

import harness
import rospy
import rostest
from ground_msgs.msg import IdentificationStatus
from ground_msgs.srv import Identify
from std_msgs.msg import String
from std_srvs.srv import Trigger

from ground.reading import readers

S = IdentificationStatus
NODE = "identification/"


def service(name, kind):
    rospy.wait_for_service(name, 20)
    return rospy.ServiceProxy(name, kind)


class IdentificationTest(unittest.TestCase):
    def setUp(self):
        self.status = harness.Latest(NODE + "status", S, keep=True)
        self.model = harness.Latest(NODE + "model", String)
        self.diagnose = service(NODE + "diagnose", Identify)
        self.fit = service(NODE + "fit", Identify)

    def test_the_missing_effect_is_found_during_the_experiment(self):
        output = rospy.get_param(NODE + "output")
        shutil.rmtree(output, True)
        self.addCleanup(shutil.rmtree, output, True)
        harness.wait_for(lambda: self.status.message and self.model.message, 20, "the latched topics")
        self.assertEqual(self.status.message.state, S.IDLE)
        self.assert_first_model()
        self.refuse_bad_requests(output)
        self.cancel_a_task()
        answer = self.find_the_slope()
        answer = self.fit(bags=[answer.folder], model=answer.model)  # a folder of bags
        self.assertTrue(answer.success, answer.message)
        self.assertIn("Prediction after 1 s", answer.message)
        self.assertTrue(os.path.isfile(os.path.join(answer.folder, "fit.json")))

    def assert_first_model(self):
        self.assertTrue(self.model.message.data.endswith("tiny_whoover.yaml"))

    def refuse_bad_requests(self, output):
        """Impossible requests get a reason and change nothing."""
        for request, reason in (
            ({"last": 1e4}, "only the last 120 s are kept"),
            ({"bags": ["/nowhere.bag"]}, "no bag of this name"),
            ({"last": 5.0, "model": "/nowhere.yaml"}, "no model of this name"),
            ({"last": 5.0, "bags": ["x.bag"]}, "not both"),
            ({"last": -5.0}, "must be positive"),
            ({"bags": [output]}, "contains no bag, ROS 2 bag or table"),
        ):
            answer = self.diagnose(**request)
            self.assertFalse(answer.success)
            self.assertIn(reason, answer.message)
            harness.wait_for(lambda: self.status.message.state == S.FAILED, 5, "the failure")
        self.assertEqual(os.listdir(output), [])
        answer = service(NODE + "add", Identify)(last=5.0)
        self.assertIn("effect is empty", answer.message)
        self.assert_first_model()

    def cancel_a_task(self):
        """A running task refuses others, publishes its progress and can be cancelled."""
        covered = rospy.Time.now().to_sec() + 12
        harness.wait_for(lambda: rospy.Time.now().to_sec() > covered, 30, "12 s of data")
        answers, before = [], len(self.status.all)
        thread = threading.Thread(target=lambda: answers.append(self.diagnose(last=10.0)))
        thread.start()
        texts = lambda: [m.message for _, m in self.status.all[before:]]  # noqa: E731
        harness.wait_for(
            lambda: (
                self.status.message.state == S.RUNNING
                and any("fitting the model" in text for text in texts())
            ),
            60,
            lambda: "progress; %s %s" % (texts(), answers),
        )
        self.assert_progress(lambda: [m for _, m in self.status.all[before:]])
        self.assertIn("busy", self.fit(last=10.0).message)
        self.assertTrue(service(NODE + "cancel", Trigger)().success)
        thread.join(20)
        self.assertEqual([a.success for a in answers], [False])
        self.assertEqual(answers[0].message, "cancelled")
        self.assert_first_model()

    def assert_progress(self, messages):
        """What is done, of how much."""
        running = [m for m in messages() if m.state == S.RUNNING and m.what]
        self.assertTrue(all(m.done <= m.of for m in running))
        self.assertTrue(any(m.message.startswith(m.what) for m in running))

    def find_the_slope(self):
        """Diagnoses the last 10 s, which must find the floor's slope; returns the answer."""
        result = harness.Latest(NODE + "result", String)
        answer = self.diagnose(last=10.0)
        self.assertTrue(answer.success, answer.message)
        self.assertIn("floor_tilt", answer.message)
        harness.wait_for(lambda: result.message, 5, "the result")
        report = json.loads(result.message.data)
        self.assertEqual(report["improved"]["effects"][:1], ["floor_tilt"])
        harness.wait_for(lambda: self.model.message.data == answer.model, 5, "the new model")
        harness.wait_for(lambda: self.status.message.state == S.DONE, 5, "the end in the status")
        for name in ("live.bag", "report.html", "diagnosis.json", "improved.yaml"):
            self.assertTrue(os.path.isfile(os.path.join(answer.folder, name)), name)
        settings = readers.settings_in(os.path.join(answer.folder, "live.bag"))
        self.assertEqual(settings.sources["heading_offset"], "recorded in the bag")
        return answer


if __name__ == "__main__":
    rospy.init_node("identification_test")
    rostest.rosrun("ground", "identification_test", IdentificationTest)
