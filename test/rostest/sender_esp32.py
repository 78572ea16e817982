#!/usr/bin/python3
"""The sketch for the ESP32 in docs/howto/esp32_craft, compiled for this computer, obeys the sender, and stops
by itself when it hears nothing or cannot send."""

import random
import socket
import sys
import tempfile
import time

import rospy
import rostest
from fake_craft import decode_motors, free_port, varint
from ground_msgs.msg import SenderStatus
from ground_msgs.srv import Silence
from sender_rig import DRIVE, ZERO, SenderTest, kill, wait_for
from sketch_craft import CHECKS, SketchCraft, compiled

STATED = 0.25  # the craft's watchdog, as docs/reference/protocol.md states it [s]
SLACK = 0.1  # of a computer that has other work [s]
FULL = bytes.fromhex("08d00f10d00f18d00f20d00f")
OFF = bytes.fromhex("08e80710e80718e80720e807")
HALF = bytes.fromhex("08dc0b10dc0b18dc0b20dc0b")


class Ground:
    """A ground station that sends any datagram."""

    def __init__(self):
        self.radio = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.radio.bind(("127.0.0.1", 0))
        self.radio.settimeout(10)
        self.port = self.radio.getsockname()[1]

    def count(self):
        """The newest count of commands that the craft states."""
        newest = self.radio.recv(4096)
        self.radio.setblocking(False)
        try:
            while True:
                newest = self.radio.recv(4096)
        except BlockingIOError:
            pass
        self.radio.settimeout(10)
        key, at = varint(newest, 0)
        assert key == 13 << 3, newest
        return varint(newest, at)[0]


def takes(datagram):
    """Whether a craft should take a datagram as a command: exactly the four fields, in 12 bytes."""
    try:
        decode_motors(datagram)
    except ValueError:
        return False
    return len(datagram) == 12 and datagram[::3] == FULL[::3]


def garbage(random):
    """Any datagram: noise, or commands that are cut, lengthened, altered or put together."""
    data = bytearray(random.choice((FULL, HALF)))
    kind = random.randrange(6)
    if kind == 0:
        return bytes(random.randrange(256) for _ in range(random.choice((1, 11, 12, 13, 16, 17, 128, 1400))))
    if kind == 1:
        return bytes(data[: random.randrange(1, 12)])
    if kind == 2:
        return bytes(data) * random.randrange(2, 100)
    for _ in range(random.randrange(1, 4)):
        data[random.randrange(12)] ^= 1 << random.randrange(8)
    return bytes(data)


class SenderESP32(SenderTest):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.folder = tempfile.TemporaryDirectory()
        cls.programs = [program for program in (compiled(cls.folder.name, c) for c in CHECKS) if program]

    def setUp(self):
        super().setUp()
        self.own_port = free_port()
        self.sketches = []

    def tearDown(self):
        found = "".join(sketch.close() for sketch in self.sketches)
        super().tearDown()
        self.assertEqual(found, "")

    def sketch(self, ground_port=None, program=0):
        made = SketchCraft(self.programs[program], ground_port or self.port, self.own_port)
        self.sketches.append(made)
        return made

    def wait_connected_craft(self):
        """Waits until sender and craft have exchanged packets for some time."""
        received = self.status.received
        self.wait_status(lambda s: s.received > received + 10, "telemetry of the craft")

    def arm_and_fly(self, sketch):
        """Arms when it is possible, and drives. Nothing moves before."""
        self.feed.set(command=ZERO, valid=True)
        self.wait_connected_craft()
        wait_for(lambda: self.arm(False).success and self.arm().success, "arming")
        self.assertTrue(sketch.off())
        self.feed.set(command=DRIVE)
        wait_for(lambda: sketch.drives(*DRIVE), "driving")

    def assert_stops(self, sketch, since, limit=STATED):
        """The motors stop within the limit after a time, and stay off."""
        wait_for(sketch.off, "the end of all motors")
        last = sketch.changes[-1][0]
        self.assertLess(last - since, limit + SLACK)

    def test_arms_drives_and_disarms(self):
        self.start()
        sketch = self.sketch()
        self.feed.set(command=DRIVE)
        self.wait_status(lambda s: s.received > 5, "telemetry")
        self.assertTrue(sketch.off())
        self.arm_and_fly(sketch)
        since = time.time()
        self.assertTrue(self.arm(False).success)
        self.assert_stops(sketch, since, 0)

    def test_stops_by_itself_in_a_silence(self):
        self.start()
        sketch = self.sketch()
        self.arm_and_fly(sketch)
        answer = rospy.ServiceProxy("sender/silence", Silence)(1.0)
        self.assertTrue(answer.success, answer.message)
        self.assert_stops(sketch, answer.last_packet.to_sec())
        self.wait_status(lambda s: s.state == SenderStatus.DISARMED, "DISARMED")
        self.assertLess(sketch.changes[-1][0], answer.last_packet.to_sec() + 1.0)  # before the zeros

    def test_stops_while_sending_blocks(self):
        sender = self.start()
        sketch = self.sketch()
        self.arm_and_fly(sketch)
        since = sketch.block(1.5)
        self.assert_stops(sketch, since)
        self.assertTrue(sketch.off())
        # When it can send again, it obeys again: the commands are new.
        wait_for(lambda: sketch.drives(*DRIVE), "driving again")
        self.assertGreater(sketch.changes[-1][0], since + 1.5)

        # Commands that waited while it could not send are old.
        since = sketch.block(1.0)
        time.sleep(0.3)
        kill(sender)
        self.assert_stops(sketch, since)
        time.sleep(1.2)
        self.assertLess(sketch.changes[-1][0], since + STATED + SLACK)

    def test_a_craft_that_restarts_moves_only_when_it_is_armed_again(self):
        self.start()
        sketch = self.sketch()
        for pause, reason in ((0.0, "the craft has restarted"), (3.0, "the craft has fallen silent")):
            self.arm_and_fly(sketch)
            sketch.kill()
            time.sleep(pause)
            sketch = self.sketch()
            self.wait_connected_craft()
            self.assertEqual([change for change in sketch.changes if change[2] != 0], [])
            self.assert_fault(reason)
        self.arm_and_fly(sketch)

    def test_nothing_but_commands_of_the_ground_station_moves_it(self):
        for program in range(len(self.programs)):
            self.shower(program)

    def shower(self, program):
        """Sends a sketch random datagrams, and commands of its ground station and of another computer."""
        ground, drawn = Ground(), random.Random(program)
        craft = ("127.0.0.1", self.own_port)
        sketch = self.sketch(ground.port, program)
        # The ground station sends thrust when the craft starts: it does not move before a zero command.
        for count in range(6):
            wait_for(lambda count=count: ground.count() == count, "a command taken")
            ground.radio.sendto(HALF if count < 5 else OFF, craft)
        self.assertTrue(sketch.off())
        taken = [6]
        stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        stranger.bind(("127.0.0.9", 0))
        for _ in range(60):
            for datagram in [b"", *(garbage(drawn) for _ in range(50)), HALF]:
                ground.radio.sendto(datagram, craft)
                taken[0] += takes(datagram)
                stranger.sendto(FULL, craft)
            wait_for(lambda: ground.count() == taken[0], "%d commands taken" % taken[0])
        wait_for(lambda: sketch.drives(0.5, 0.5, 0.5), "the last command")
        self.assert_stops(sketch, time.time())
        self.assertEqual(sketch.close(), "")
        stranger.close()
        ground.radio.close()


if __name__ == "__main__":
    rospy.init_node("sender_esp32", disable_signals=True)
    rostest.rosrun("ground", "sender_esp32", SenderESP32, sys.argv)
