#!/usr/bin/python3
"""The sender's peer, its handling of datagrams, and its live parameters."""

import math
import os
import sys
import time

import dynamic_reconfigure.client
import rospy
import rostest
from fake_craft import STATE, encode_state, is_zero
from ground_msgs.msg import Controls, SenderStatus, Telemetry
from sender_rig import DRIVE, ZERO, SenderTest, refusal, wait_for

SHARE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
ROOM = os.path.join(SHARE, "cfg", "room", "room_4x4.yaml")
MODEL = os.path.join(SHARE, "cfg", "hovercraft", "tiny_whoover.yaml")


def inputs(message):
    return message.left, message.right, message.lift


class SenderLink(SenderTest):
    def test_telemetry_and_malformed_datagrams(self):
        self.start()
        heard = []
        rospy.Subscriber("sender/telemetry", Telemetry, heard.append)
        craft = self.craft(hello=False)
        craft.send(b"hello")
        craft.wait_packets(2)
        self.wait_status(lambda s: s.peer == "127.0.0.1:%d" % craft.port, "peer")
        self.assertEqual(self.status.received, 0)

        self.arm_and_drive(craft)
        malformed = [b"", b"hello", bytes(range(256)) * 8, STATE[:-1], STATE[:3], STATE * 9]
        for datagram in malformed:
            craft.send(datagram)
        self.wait_status(lambda s: s.malformed == len(malformed) + 1, "malformed")
        self.wait_driving(craft)
        self.assertEqual(self.status.state, SenderStatus.ARMED)
        self.assertEqual(self.status.received, 0)

        wait_for(lambda: craft.send() or heard, "telemetry")
        first = heard[0]
        self.assertEqual((first.roll, first.pitch, first.yaw), (1.5, -2.25, 30.0))
        raw = (1, 2, 300, 4, 5, 6, 7, 8, 9000)
        self.assertEqual((*first.acc, *first.gyro, *first.mag), raw)
        self.wait_status(lambda s: s.received >= len(heard), "received")

    def test_packets_of_a_second_craft_are_ignored(self):
        self.start()
        craft = self.craft()
        intruder = self.craft(hello=False)
        for armed in (False, True):
            if armed:
                self.arm_and_drive(craft)
            foreign = self.status.foreign
            for _ in range(50):
                intruder.send()
                intruder.send(b"garbage")
                intruder.send(encode_state((0, 0, 0), [0] * 9))
            self.wait_status(lambda s, foreign=foreign: s.foreign == foreign + 150, "foreign")
            craft.wait_packets(10)
            self.assertEqual(craft.packets[-1][1:], DRIVE if armed else ZERO)
            self.assertEqual(intruder.count(), 0)
            self.assertEqual(self.status.peer, "127.0.0.1:%d" % craft.port)

    def test_a_craft_that_would_leave_the_room_is_stopped(self):
        self.start(room=ROOM)
        craft = self.craft()
        # Walls are at 2 m. At 1 m/s it stops after 1 m/s * 0.1 s + (1 m/s)^2 / (2 * 1.5 m/s^2) = 0.43 m.
        self.arm_and_drive(craft)
        self.feed.set(eta=(1.5, 0.0, 0.0), nu=(1.0, 0.0, 0.0))
        time.sleep(0.2)
        self.assertEqual(self.status.state, SenderStatus.ARMED)
        start = time.time()
        self.feed.set(eta=(1.6, 0.0, 0.0))  # pushed by somebody
        self.assert_zero_within_limit(craft, start, "a craft that would hit the wall")
        self.assert_fault("outside of the room if it were stopped later")
        self.feed.set(command=ZERO, eta=(2.2, 0.0, 0.0), nu=(0.0, 0.0, 0.0))
        self.assertTrue(self.arm(False).success)
        time.sleep(0.1)
        self.assertIn("0.20 m outside of the room", self.arm().message)
        self.feed.set(eta=(1.9, 0.0, 0.0))
        wait_for(lambda: self.arm().success, "arming inside")

    def test_the_fence_counts_the_thrust_that_its_model_gives(self):
        """Full thrust takes a craft that stands 2 cm from a wall into it, or away from it."""
        full = (1.0, 1.0, 1.0)
        self.start(room=ROOM, model=MODEL, obedience_timeout=0)
        craft = self.craft()
        self.feed.set(eta=(1.98, 0.0, math.pi))
        self.arm_and_drive(craft, full)
        time.sleep(0.2)
        self.assertEqual(self.status.state, SenderStatus.ARMED)
        start = time.time()
        self.feed.set(eta=(1.98, 0.0, 0.0))
        self.assert_zero_within_limit(craft, start, "thrust into a wall")
        self.assert_fault("outside of the room if it were stopped later")

    def test_what_leaves_for_the_craft_is_published(self):
        """A command that is not obeyed does not appear on `sent`, however often it comes."""
        sent = []
        rospy.Subscriber("sent", Controls, sent.append, queue_size=100, tcp_nodelay=True)
        self.start(recovery_time=1.0)
        craft = self.craft()
        self.feed.set(command=DRIVE)
        wait_for(lambda: len(sent) > 20, "commands of a sender that is not armed")
        self.assertEqual({inputs(message) for message in sent}, {ZERO})
        self.arm_and_drive(craft)
        wait_for(lambda: inputs(sent[-1]) == DRIVE, "a command that is obeyed")
        self.feed.set(valid=False)
        wait_for(lambda: inputs(sent[-1]) == (0.0, 0.0, 1.0), "the lift alone while the state is lost")
        self.feed.set(valid=True)
        wait_for(lambda: inputs(sent[-1]) == DRIVE, "thrust with the state")
        self.assertTrue(self.arm(False).success)
        count = len(sent)
        wait_for(lambda: len(sent) > count + 20, "commands after disarming")
        self.assertEqual({inputs(message) for message in sent[count + 2 :]}, {ZERO})
        stamps = [message.header.stamp.to_sec() for message in sent]
        self.assertEqual(stamps, sorted(stamps))
        self.assertLess(max(b - a for a, b in zip(stamps, stamps[1:])), 0.1)

    def test_a_craft_that_glides_unseen_is_stopped_in_the_room(self):
        """While the state is lost the lift stays on, the thrust does not, and the room still counts."""
        self.start(room=ROOM, recovery_time=2.0, require_lift=True)
        craft = self.craft()
        self.feed.set(eta=(1.0, 0.0, 0.0), nu=(1.0, 0.0, 0.0))
        self.arm_and_drive(craft)
        lost = time.time()
        self.feed.set(valid=False)
        glides = craft.wait(
            lambda packets: [p for p in packets if p.time > lost and p.left == p.right == 0 and p.lift == 1],
            "lift without thrust",
        )
        self.assertLess(glides[0].time - lost, 0.25)
        self.wait_status(lambda s: s.state == SenderStatus.FAULT, "FAULT")
        fault = craft.wait(lambda packets: [p for p in packets if p.time > lost and is_zero(p)], "zeros")[0]
        # At 1 m/s, 1 m from the wall, it would be there after 1 s, before recovery_time.
        self.assertLess(fault.time - lost, 1.0)
        self.assertGreater(fault.time - glides[0].time, 0.2)
        unseen = [p for p in craft.since(glides[0].time) if p.left or p.right]
        self.assertEqual(unseen, [])
        self.assert_fault("the room")

    def test_a_craft_that_nobody_sees_is_stopped_before_its_state_is_stale(self):
        """States stop while it flies at a wall: the fence does not wait for state_timeout."""
        self.start(room=ROOM, state_timeout=1.0, recovery_time=1.0)
        craft = self.craft()
        self.arm_and_drive(craft)
        self.feed.set(eta=(1.2, 0.0, 0.0), nu=(1.0, 0.0, 0.0))
        time.sleep(0.2)
        self.assertEqual(self.status.state, SenderStatus.ARMED)
        self.feed.set(valid=None)
        last = self.feed.last_state
        zero = craft.wait(lambda packets: [p for p in packets if p.time > last and is_zero(p)], "zeros")[0]
        # At 1 m/s it is at the wall 0.8 s after its last state.
        self.assertLess(zero.time - last, 0.8)
        self.assert_fault("the room")

    def test_thrust_comes_back_with_the_state_and_with_the_lift(self):
        self.start(recovery_time=1.0)
        craft = self.craft()
        self.arm_and_drive(craft)
        begun = time.time()
        for _ in range(3):
            self.feed.set(valid=False)
            craft.wait(lambda packets: packets[-1].left == packets[-1].right == 0, "no thrust")
            self.feed.set(valid=True)
            self.wait_driving(craft)
        self.assertEqual([p for p in craft.since(begun) if p.lift != 1], [], "the skirt stays full")

    def test_reconfigure(self):
        self.start()
        craft = self.craft()
        self.arm_and_drive(craft)
        client = dynamic_reconfigure.client.Client("sender", timeout=10)

        changed = client.update_configuration({"keepalive_rate": 200.0, "command_timeout": 0.5})
        self.assertEqual((changed["keepalive_rate"], changed["command_timeout"]), (200.0, 0.5))
        with self.feed.lock:
            self.feed.command = None
            start = self.feed.last_command
        craft.wait_packets(60)  # 0.3 s: no fault at the old 0.2 s
        self.assertEqual(craft.packets[-1][1:], DRIVE)
        packets = craft.since(start)
        rate = (len(packets) - 1) / (packets[-1].time - packets[0].time)
        print("keepalive at %.1f packets/s, 200 wanted" % rate)
        self.assertGreater(rate, 150)
        self.assertLess(rate, 220)
        self.assert_fault("commands are stale")
        self.feed.set(command=ZERO)

        before = client.get_configuration(timeout=10)
        for bad in (
            {"keepalive_rate": 0.0},
            {"keepalive_rate": 1e4},
            {"command_timeout": -1.0},
            {"state_timeout": math.nan},
            {"keepalive_rate": 100.0, "state_timeout": 30.0},
        ):
            after = client.update_configuration(bad)
            self.assertEqual({k: after[k] for k in bad}, {k: before[k] for k in bad})
        self.assertEqual(rospy.get_param("sender/keepalive_rate"), 200.0)

        client.close()

    def test_auto_arm_once(self):
        self.start(auto_arm=True)
        craft = self.craft()
        self.wait_status(lambda s: s.state == SenderStatus.ARMED, "ARMED")
        self.feed.set(command=DRIVE)
        self.wait_driving(craft)
        self.feed.set(valid=False)
        self.assert_fault("invalid")
        craft.wait_packets(20)
        self.assertEqual(self.status.state, SenderStatus.DISARMED)

    def test_bad_parameters_and_a_taken_port(self):
        self.start()
        for name, value, complaint in (
            ("port", self.port, "Address already in use"),
            ("port", -1, "port must be between 0 and 65535"),
            ("port", "fast", "port has the wrong type"),
            ("peer", "127.0.0.1:x", "is not HOST or HOST:PORT"),
            ("peer", "0.0.0.0", "is not the address of a craft"),
            ("command_timeout", 9.0, "command_timeout must be between 0.02 and 1 s, not 9"),
        ):
            self.assertIn(complaint, refusal("Sender", {"port": 0, name: value}))


if __name__ == "__main__":
    rospy.init_node("sender_link", disable_signals=True)
    rostest.rosrun("ground", "sender_link", SenderLink, sys.argv)
