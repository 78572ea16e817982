#!/usr/bin/python3
"""Injects faults while a craft tracks a circle. Each must end as its row states, and no thrust may be
sent long after the last plausible pose. The third argument chooses the faults: those of the
poses, or the others."""

import copy
import math
import os
import sys
import time

import dynamic_reconfigure.client
import rospy
import rostest
from geometry_msgs.msg import PoseStamped, Quaternion
from ground_msgs.msg import ControllerStatus, Controls, Reference, SenderStatus, State
from std_srvs.srv import Trigger

sys.path.insert(1, os.path.dirname(sys.path[0]))
import harness
import requirements
from faults_case import FAULTS, GOES_ON, RUNNING, STOPPED, STOPS, FaultsCase, add_tests
from wire_proxy import WireProxy

LIMIT = requirements.limit("thrust-after-state")  # longest thrust after the last plausible pose [s]
JUMP = 2  # length of a jump [frames]
MAX_ERROR = 0.05  # largest error of a craft that tracks [m]


class MocapFault:
    """Passes the simulator's poses on; `spoil(pose)` gives the pose to publish, or None."""

    def __init__(self):
        self.spoil = None
        self.last_good = time.time()
        self._publisher = rospy.Publisher(
            "vrpn_client_node/hovercraft/pose", PoseStamped, queue_size=1, tcp_nodelay=True
        )
        self._subscriber = rospy.Subscriber("unspoilt_pose", PoseStamped, self._pass, tcp_nodelay=True)

    def _pass(self, pose):
        spoil = self.spoil
        if spoil is None:
            self.last_good = time.time()
            self._publisher.publish(pose)
            return
        changed = spoil(copy.deepcopy(pose))
        if getattr(spoil, "deceives", False):
            self.last_good = time.time()
        if changed is not None:
            self._publisher.publish(changed)


def lose(pose):
    return None


def frozen():
    first = []

    def spoil(pose):
        first.append(pose)
        changed = copy.deepcopy(first[0])
        changed.header.stamp = pose.header.stamp
        return changed

    return spoil


def jump():
    frames = []

    def spoil(pose):
        frames.append(pose)
        if len(frames) <= JUMP:
            pose.pose.position.x += 1.0
        return pose

    return spoil


def carried(pose):
    pose.pose.position.x += 1.0
    return pose


def on_its_side(pose):
    pose.pose.orientation = Quaternion(0, 0, math.sqrt(0.5), math.sqrt(0.5))


def leaning_then_elsewhere():
    since = []

    def spoil(pose):
        since.append(time.monotonic())
        if since[-1] - since[0] < 0.45:  # shorter than the controller's patience
            on_its_side(pose)
        else:
            pose.pose.position.x += 0.5
        return pose

    return spoil


class Swapped:
    """Swaps two axes. If the craft is near the line on which they are equal and looks along the third
    axis, its poses stay plausible (`deceives`) until it seems to tilt more than on a floor.
    """

    MAX_DISTANCE, MAX_TILT = 0.3, math.radians(30)  # from the line [m], on the floor [rad]

    def __init__(self):
        self.deceives = None

    def __call__(self, pose):
        p, o = pose.pose.position, pose.pose.orientation
        turned = 2 * math.atan2(abs(o.y), abs(o.w))
        if self.deceives is None:
            self.deceives = abs(p.z - p.y) < self.MAX_DISTANCE
        self.deceives = self.deceives and turned < self.MAX_TILT
        p.y, p.z = p.z, p.y
        o.y, o.z = o.z, o.y
        return pose


def not_finite(pose):
    pose.pose.position.x = math.nan
    return pose


def endless(pose):
    pose.pose.orientation.w = math.inf
    return pose


# (fault, maker of the function that spoils poses, duration [s], end)
MOCAP = [
    ("mocap lost for 0.1 s", lambda: lose, 0.1, GOES_ON),
    ("mocap lost for 0.5 s", lambda: lose, 0.5, GOES_ON),
    ("mocap lost for 5 s", lambda: lose, 5.0, FAULTS),
    ("pose frozen for 2 s", frozen, 2.0, FAULTS),
    ("poses not finite for 2 s", lambda: not_finite, 2.0, FAULTS),
    ("orientations infinite for 2 s", lambda: endless, 2.0, FAULTS),
    ("pose 1 m off for two frames", jump, 0.1, GOES_ON),
    ("pose 1 m off from now on", lambda: carried, 2.0, STOPS),
    ("leaning, then upright and 0.5 m off", leaning_then_elsewhere, 2.0, STOPS),
    ("axes swapped, looking across", Swapped, 2.0, STOPS),
    ("axes swapped, looking between", Swapped, 2.0, STOPS),
    ("axes swapped, looking along", Swapped, 5.0, STOPS),
]
HEADING = {  # heading at which a fault begins [rad]
    "axes swapped, looking across": math.pi / 2,
    "axes swapped, looking between": math.pi / 4,
    "axes swapped, looking along": 0.0,
}
# (fault, topic, maker of the message that is published for 2 s, end)
MESSAGES = [
    ("second controller, nameless", "controls", lambda: thrust(1.0, ""), GOES_ON),
    ("second controller with a name", "controls", lambda: thrust(1.0, "/other"), STOPS),
    ("second controller of NaN", "controls", lambda: thrust(math.nan, ""), GOES_ON),
    ("states of NaN", "state", lambda: state(math.nan), STOPS),
    ("states of infinite size", "state", lambda: state(math.inf), STOPS),
]
# (fault, settings of WireProxy for 3 s)
WIRE = [
    ("30% of the packets lost", {"drop": 0.3}),
    ("packets twice and in disorder", {"twice": 0.3, "swap": 0.3}),
]
# (fault, controller, whether the craft counts the commands that it takes)
ONE_WAY = [
    ("craft hears nothing, and says so", "controller", True),
    ("craft hears nothing, tracking", "controller", False),
    ("craft hears nothing, PRBS", "prbs", False),
]
# (fault, controller)
NO_WAY = [("nothing passes either way, tracking", "controller"), ("nothing passes either way, PRBS", "prbs")]
HEARING_LIMIT = requirements.limit("hearing")  # longest thrust sent to a craft that receives nothing [s]
# (fault, change of /clock and all stamps [s])
CLOCKS = [("clock and stamps set back by 2 s", -2.0), ("clock and stamps set ahead by 2 s", 2.0)]
# (fault, whether the craft returns on another port)
RESTARTS = [("craft restarts", False), ("craft comes back elsewhere", True)]
# (fault, how long the craft is off [s], whether it counts commands, whether it has a boot id)
QUICK_RESTARTS = [
    ("quick restart, seen by the boot id", 0.5, False, True),
    ("quick restart, seen by the count", 0.5, True, False),
]
RESTART_LIMIT = requirements.limit("restart-noticed")  # longest thrust to a restarted craft [s]


def thrust(value, driver):
    message = Controls(left=value, right=value, lift=1.0)
    message.header.stamp = rospy.Time.now()
    message.header.frame_id = driver
    return message


def sits_down(truth):
    """Whether the floor brakes the craft, which has no lift then."""
    (u, v), (u_dot, v_dot) = truth.nu[:2], truth.nu_dot[:2]
    return u * u_dot + v * v_dot < -1.8 * math.hypot(u, v)


def state(value):
    message = State(valid=True, eta=[value] * 3, nu=[value] * 3)
    message.header.stamp = rospy.Time.now()
    return message


class FaultsTest(FaultsCase):
    @classmethod
    def setUpClass(cls):
        cls.wire = WireProxy(int(sys.argv[1]), int(sys.argv[2]))
        cls.mocap = MocapFault()
        cls.truth = harness.Latest("simulator/truth", State)
        cls.reference = harness.Latest("reference", Reference)
        super().setUpClass()
        harness.wait_for(
            lambda: (
                cls.status.message and cls.truth.message and cls.sender.message and cls.sender.message.peer
            ),
            30,
            "craft and controller",
        )

    @classmethod
    def tearDownClass(cls):
        cls.wire.close()

    def error(self):
        """Distance from the reference [m], extrapolated to the time of the truth (one may be late)."""
        t, r = self.truth.message, self.reference.message
        ahead = max(-0.3, min((t.header.stamp - r.header.stamp).to_sec(), 0.3))
        return math.hypot(*(t.eta[i] - r.p[i] - r.p_dot[i] * ahead for i in range(2)))

    def drive(self):
        """Arms and starts if necessary, and waits until the craft tracks."""
        self.run_again()
        harness.wait_for(lambda: self.reference.message, 10, "a reference")
        since = []

        def settled():
            since.append(self.error())
            return len(since) > 300 and max(since[-300:]) < MAX_ERROR

        harness.wait_for(settled, 30, "a craft that tracks")

    def mocap_fails(self, name, spoil, seconds, ending):
        self.drive()
        if name in HEADING:
            harness.wait_for(lambda: self.looks_along(HEADING[name]), 60, "the heading")
        begun = time.monotonic()
        self.mocap.spoil = spoil()
        time.sleep(seconds)
        last, end = self.mocap.last_good, time.time()
        self.mocap.spoil = None
        late = [t - last for t in self.wire.thrust_between(last, end)]
        worst = max(late, default=0.0)
        self.print(name, ending, "thrust until %3.0f ms after it" % (1e3 * worst))
        self.assertLess(worst, LIMIT)
        if ending == GOES_ON:
            self.drive()
        else:
            self.expect(STOPPED)
            time.sleep(0.3)  # no thrust when the mocap is back
            self.assertEqual(self.wire.thrust_between(end, time.time()), [])
        self.ended(ending, begun)

    def looks_along(self, heading):
        return math.cos(self.truth.message.eta[2] - heading) > math.cos(0.05)

    def wire_fails(self, name, how):
        self.drive()
        begun, errors = time.monotonic(), []
        for what, share in how.items():
            setattr(self.wire, what, share)
        while time.monotonic() < begun + 3:
            errors.append(self.error())
            time.sleep(0.01)
        self.wire.drop = self.wire.twice = self.wire.swap = 0.0
        self.print(name, GOES_ON, "error at most %.0f mm" % (1e3 * max(errors)))
        self.assertLess(max(errors), 2 * MAX_ERROR)
        self.ended(GOES_ON, begun)

    def topic_brings_nonsense(self, name, topic, make, ending):
        self.drive()
        publisher = rospy.Publisher(topic, type(make()), queue_size=1, tcp_nodelay=True)
        harness.wait_for(publisher.get_num_connections, 5, "a listener")
        begun, start = time.monotonic(), time.time()
        intruder = harness.Repeater(100, lambda: publisher.publish(make()))
        time.sleep(2)
        late = [t - start for t in self.wire.thrust_between(start, time.time())]
        foreign = [p for p in self.wire.packets if p.time > start and p.left == p.right == 1]
        intruder.stop()
        publisher.unregister()
        if ending == GOES_ON:
            self.print(name, ending, "%d of its commands obeyed" % len(foreign))
            self.assertEqual(foreign, [])
        else:
            worst = max(late, default=0.0)
            self.print(name, ending, "thrust until %3.0f ms after its first" % (1e3 * worst))
            self.assertLess(worst, LIMIT)
        self.ended(ending, begun)

    def craft_restarts(self, name, moves):
        """A restarted craft gets no thrust before it is armed again."""
        self.drive()
        begun = time.monotonic()
        self.wire.silent = True
        time.sleep(3)
        if moves:
            self.wire.move()
        self.wire.silent = False
        back = time.time()
        self.expect(STOPPED)
        time.sleep(0.5)
        thrust = self.wire.thrust_between(back, time.time())
        self.print(name, FAULTS, "%d packets with thrust when it is back" % len(thrust))
        self.assertEqual(thrust, [])
        self.ended(FAULTS, begun)
        self.drive()  # the new port is used

    def craft_restarts_quickly(self, name, seconds, counts, boots):
        """A brown-out in mid-room that is shorter than craft_timeout and obedience_timeout."""
        self.drive()
        self.wire.counts, self.wire.boots = counts, boots
        time.sleep(0.1)
        begun = time.monotonic()
        self.wire.deaf = self.wire.silent = True
        time.sleep(seconds)
        self.assertEqual(self.sender.message.state, SenderStatus.ARMED, self.sender.message.reason)
        self.wire.restart()
        self.wire.deaf = self.wire.silent = False
        back = time.time()
        self.expect(STOPPED)
        self.wire.counts = self.wire.boots = True  # seen before it is armed again
        time.sleep(0.5)
        worst = max((t - back for t in self.wire.thrust_between(back, time.time())), default=0.0)
        self.print(name, FAULTS, "thrust until %3.0f ms after it is back" % (1e3 * worst))
        self.assertLess(worst, RESTART_LIMIT)
        self.assertIn("the craft has restarted", [m.reason for at, m in self.sender.all if at > begun])
        self.ended(FAULTS, begun)
        self.drive()

    def drive_by(self, driver):
        """Makes a controller drive; returns its status."""
        status = harness.Latest(driver + "/status", ControllerStatus, keep=True)
        harness.wait_for(lambda: status.message, 5, "the status of " + driver)
        if driver != "controller":
            self.assertTrue(rospy.ServiceProxy(driver + "/start", Trigger)().success)
            harness.wait_for_state(status, RUNNING, 5)
            time.sleep(1)
        return status

    def nothing_passes(self, name, driver):
        """The craft's own watchdog ends its thrust and the sender goes to FAULT. When packets pass again
        there is no thrust."""
        self.drive()
        status = self.drive_by(driver)
        truth = harness.Latest("simulator/truth", State, keep=True)
        harness.wait_for(lambda: len(truth.all) > 10, 5, "the truth")
        begun = time.monotonic()
        lost = truth.all[-1][1].header.stamp
        self.wire.deaf = self.wire.silent = True
        time.sleep(3)
        back = time.time()
        self.wire.deaf = self.wire.silent = False
        time.sleep(0.5)
        sits = [m.header.stamp for _, m in truth.all if m.header.stamp > lost and sits_down(m)]
        self.assertTrue(sits, "the craft never sat down")
        until = (sits[0] - lost).to_sec()
        self.print(name, FAULTS, "thrust at the craft until %3.0f ms after it" % (1e3 * until))
        self.assertGreater(until, 0.2, "the watchdog ends the thrust after 0.25 s")
        self.assertLess(until, requirements.limit("own-watchdog"))
        self.assertEqual(self.wire.thrust_between(back, time.time()), [])
        reasons = [m.reason for at, m in self.sender.all if at > begun]
        self.assertTrue(
            [r for r in reasons if "does not follow its commands" in r or "has fallen silent" in r], reasons
        )
        self.assertIn(STOPPED, {m.state for at, m in status.all if at > begun})
        self.assertIn(SenderStatus.FAULT, {m.state for at, m in self.sender.all if at > begun})
        self.drive()

    def craft_hears_nothing(self, name, driver, counts):
        """Telemetry still comes. When the craft receives again there is no thrust."""
        self.drive()
        self.wire.counts = counts
        status = self.drive_by(driver)
        begun, start = time.monotonic(), time.time()
        self.wire.deaf = True
        time.sleep(2)
        self.wire.deaf = False
        time.sleep(0.5)
        self.wire.counts = True
        worst = max((t - start for t in self.wire.thrust_between(start, time.time())), default=0.0)
        self.print(name, FAULTS, "thrust until %4.0f ms after it" % (1e3 * worst))
        self.assertLess(worst, HEARING_LIMIT)
        self.assertIn("does not follow its commands", self.sender.message.reason)
        self.assertIn(STOPPED, {m.state for at, m in status.all if at > begun})
        self.drive()

    def clock_is_set(self, name, seconds):
        """Poses and clock jump together, as if the clock of the only computer is set."""
        self.drive()
        simulator = dynamic_reconfigure.client.Client("simulator", timeout=10)
        offset = simulator.get_configuration()["clock_offset"]
        begun, start = time.monotonic(), time.time()
        simulator.update_configuration({"clock_offset": offset + seconds})
        time.sleep(3)
        simulator.close()
        worst = max((t - start for t in self.wire.thrust_between(start, time.time())), default=0.0)
        self.print(name, FAULTS, "thrust until %3.0f ms after it" % (1e3 * worst))
        self.assertLess(worst, LIMIT)
        self.ended(FAULTS, begun)
        what = "time jumped %s by 2.0 s" % ("back" if seconds < 0 else "ahead")
        self.assertIn(what, [m.reason for at, m in self.sender.all if at > begun])
        self.drive()  # it can be driven again

    def started_while_disarmed(self):
        self.stop()
        self.arm(False)
        harness.wait_for_state(self.sender, SenderStatus.DISARMED, 5)
        begun = time.time()
        self.start()
        time.sleep(1)
        thrust = self.wire.thrust_between(begun, time.time())
        self.print("start while disarmed", "waits", "%d packets with thrust" % len(thrust))
        self.assertEqual(thrust, [])
        self.assertEqual(self.status.message.state, ControllerStatus.WAITING)
        self.stop()


if __name__ == "__main__":
    if sys.argv[3] == "poses":
        add_tests(FaultsTest, FaultsTest.mocap_fails, MOCAP)
    else:
        FaultsTest.test_started_while_disarmed = FaultsTest.started_while_disarmed
        add_tests(FaultsTest, FaultsTest.wire_fails, WIRE)
        add_tests(FaultsTest, FaultsTest.topic_brings_nonsense, MESSAGES)
        add_tests(FaultsTest, FaultsTest.craft_hears_nothing, ONE_WAY)
        add_tests(FaultsTest, FaultsTest.nothing_passes, NO_WAY)
        add_tests(FaultsTest, FaultsTest.clock_is_set, CLOCKS)
        add_tests(FaultsTest, FaultsTest.craft_restarts, RESTARTS)
        add_tests(FaultsTest, FaultsTest.craft_restarts_quickly, QUICK_RESTARTS)
    rospy.init_node("faults_test")
    rostest.rosrun("ground", "faults_%s_test" % sys.argv[3], FaultsTest)
