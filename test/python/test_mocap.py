"""The mocap's client without ROS: what it makes of packets of a server on loopback, and of their times."""

import contextlib
import math
import random
import socket
import struct
import sys
import threading
import time

import pytest

from conftest import ROOT, free_port
from ground import GroundError
from ground.mocap import clock, frames, library, motive, natnet

sys.path.insert(0, str(ROOT / "test" / "rostest"))
import fake_motive
import fake_vrpn
from fake_motive import FakeMotive

VERSIONS = [(2, 5), (2, 7), (2, 10), (3, 0), (3, 1), (4, 0), (4, 1), (4, 3)]
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def ports(version=(4, 1)):
    """Free ports for a server; that of data is fixed where a server cannot say it."""
    return free_port(socket.SOCK_DGRAM), free_port(socket.SOCK_DGRAM) if version >= (3, 0) else 1511


@pytest.fixture
def stream():
    """Opens a source at a server that streams 200 frames a second; gives both."""
    closing = []

    def start(bodies=lambda n: [(1, (n, 0.04, 0.5), UPRIGHT, True)], **options):
        server = FakeMotive(ports=ports(options.get("version", (4, 1))), **options)
        alive = threading.Event()

        def send():
            while not alive.wait(0.005):
                server.send(bodies(server.number), age=0.004)

        thread = threading.Thread(target=send, daemon=True)
        thread.start()
        context = motive.opened("127.0.0.1", server.ports[0])
        source = context.__enter__()
        closing.extend([lambda: context.__exit__(None, None, None), server.close, thread.join, alive.set])
        return server, source

    yield start
    for close in reversed(closing):
        close()


def until(source, condition, seconds=8.0):
    """The first frame that meets a condition."""
    end = time.monotonic() + seconds
    for frame in source.frames:
        if frame and condition(frame):
            return frame
        assert time.monotonic() < end, source.told()


@pytest.mark.parametrize("multicast", [True, False])
@pytest.mark.parametrize("version", VERSIONS)
def test_poses_come_from_a_server_of_any_version(stream, version, multicast):
    if version < (3, 0) and not multicast:
        pytest.skip("such a server does not say where it sends")
    options = {"version": version, "multicast": multicast}
    _, source = stream(
        lambda n: [(1, (0.5, 0.04, -1.5), (0, 0.6, 0, 0.8), True), (2, (1, 1, 1), UPRIGHT, True)], **options
    )
    frame = until(source, lambda found: found.poses)
    assert set(frame.poses) == {"hovercraft"}, "bodies without a name are unknown"
    assert frame.poses["hovercraft"].position == pytest.approx((0.5, 0.04, -1.5))
    assert frame.poses["hovercraft"].rotation == pytest.approx((0, 0.6, 0, 0.8))
    after = until(source, lambda found: True)
    assert after.number > frame.number and 0 < after.time - frame.time < 1
    assert "Motive 3.1" in source.told() and source.names() == ["hovercraft"]
    if version >= (3, 0):
        assert frame.delay == pytest.approx(0.004, abs=1e-4)


def test_what_a_server_does_not_say_is_said(stream):
    server, source = stream()
    until(source, lambda found: found.poses)
    server.spoil = lambda packet: []
    while next(source.frames):
        pass
    assert "sends no frames to the group" in source.told()
    server.spoil = lambda packet: [packet[:2] + struct.pack("<H", 30) + packet[4:34]]
    assert next(source.frames) is None and "in the middle" in source.told()


def test_without_a_server_nothing_comes_and_a_name_that_is_none_is_refused():
    with motive.opened("127.0.0.1", free_port(socket.SOCK_DGRAM)) as source:
        assert next(source.frames) is None
        assert "no NatNet server answers at 127.0.0.1" in source.told()
    with pytest.raises(GroundError, match="^no_such_host.invalid: "), motive.opened("no_such_host.invalid"):
        pass


def test_bodies_of_a_server_that_began_again_are_not_those_of_before(stream):
    """The number of the craft is that of another body now."""
    server, source = stream(lambda n: [(1, (n, 0.04, 0.5), UPRIGHT, True)])
    until(source, lambda found: found.time > 2.5)
    assert source.names() == ["hovercraft"]
    server.names = {1: "teapot"}
    server.restart()
    again = until(source, lambda found: found.time < 2)
    while not again.poses:
        again = next(source.frames)
    assert set(again.poses) == {"teapot"}


def test_a_stranger_in_the_same_group_is_not_the_mocap(stream):
    server, source = stream()
    other = FakeMotive(host="127.0.0.9", ports=(free_port(socket.SOCK_DGRAM), server.ports[1]))
    try:
        until(source, lambda found: found.poses)
        for _ in range(50):
            other.send([(1, (-7.0, 0.04, 0.0), UPRIGHT, True)])
            assert all(p.position[0] != -7.0 for p in next(source.frames).poses.values())
        server.spoil = lambda packet: []
        for _ in range(20):
            other.send([(1, (-7.0, 0.04, 0.0), UPRIGHT, True)])
        while next(source.frames):
            pass
        assert "mocap_host:=127.0.0.9" in source.told()
    finally:
        other.close()


@pytest.mark.parametrize("version", VERSIONS)
def test_packets_that_are_damaged_are_refused_or_give_numbers(version):
    """Whatever is cut off or changed: PacketError, or bodies of numbers."""
    chance = random.Random(7)
    whole = fake_motive.frame(version, 5, 1.5, [(1, (1, 2, 3), UPRIGHT, True)], 10, 20)
    described = fake_motive.models(version, {1: "hovercraft"})
    for _ in range(2000):
        packet = bytearray(chance.choice([whole, described])[4:])
        for _ in range(chance.randrange(4)):
            packet[chance.randrange(len(packet))] = chance.choice(
                [0, 1, 127, 128, 255, chance.randrange(256)]
            )
        if chance.random() < 0.5:
            del packet[chance.randrange(len(packet)) :]
        with contextlib.suppress(natnet.PacketError):
            found = natnet.frame(bytes(packet), version, 100)
            assert math.isfinite(found.time) and found.delay >= 0
        with contextlib.suppress(natnet.PacketError):
            natnet.models(bytes(packet), version)
    for end in range(len(whole) - 4 - 40):
        with pytest.raises(natnet.PacketError):
            natnet.frame(whole[4 : 4 + end], version)


@pytest.mark.parametrize("position, rotation", [
    ((0, 0, 0), UPRIGHT),
    ((1, 2, math.nan), UPRIGHT),
    ((1, math.inf, 2), UPRIGHT),
    ((1, 2, 3), (0, 0, 0, 0)),
    ((1, 2, 3), (0, math.nan, 0, 1)),
    ((1, 2, 3), (0, 0, 1, 1)),
])  # fmt: skip
def test_what_systems_give_for_a_lost_body_is_no_pose(position, rotation):
    assert frames.pose(position, rotation) is None
    assert frames.pose((1, 2, 3), UPRIGHT) == frames.Pose((1, 2, 3), UPRIGHT)


def taken(follower, number, moment, arrival, delay=0.0):
    """What a follower makes of a frame of a body."""
    pose = frames.Pose((number, 0, 0), UPRIGHT)
    return follower.take(frames.Frame(arrival, {"craft": pose}, number, moment, delay))


@pytest.mark.parametrize("drift", [0.0, 1e-4, -1e-4])
def test_stamps_are_right_under_delays_and_drift(drift):
    """The mocap's clock began at another time and drifts; frames are delayed by 0.2 ms or more."""
    chance, follower, errors = random.Random(3), clock.Follower("craft"), []
    for number in range(6000):
        exposed = 1000 + number / 240
        arrival = exposed + 0.004 + 0.0002 + chance.expovariate(1000) + 0.05 * (chance.random() < 0.02)
        found = taken(follower, number, (exposed - 1000) * (1 + drift) + 77, arrival, 0.004)
        if found and exposed > 1001:
            errors.append(found.captured - exposed)
    assert max(map(abs, errors)) < 0.0002 + 10 * abs(drift) + 0.0005


def test_late_and_repeated_frames_are_left_out_and_missing_ones_counted():
    follower = clock.Follower("craft")
    order = [1, 2, 2, 5, 4, 3, 6, 6, 9]
    found = [taken(follower, n, n / 100, 50 + i / 100) for i, n in enumerate(order)]
    assert [f.frame.number for f in found if f] == [1, 2, 5, 6, 9]
    assert [f.missed for f in found if f] == [0, 0, 2, 0, 2]
    assert [f.late for f in found if f] == [0, 0, 1, 2, 1]


@pytest.mark.parametrize("seconds", [-500.0, -2.0, -0.3, 0.3, 2.0, 500.0])
@pytest.mark.parametrize("restarts", [False, True])
def test_a_clock_that_is_set_is_followed_at_once(seconds, restarts):
    """The mocap's clock jumps, and its numbers begin again if it restarts, which takes two seconds."""
    follower = clock.Follower("craft")
    for i in range(400):
        taken(follower, 5000 + i, 600 + i / 100, 9000 + i / 100)
    jumps = []
    for i in range(400, 800):
        real = i / 100 + 2 * restarts
        found = taken(follower, i - 399 if restarts else 5000 + i, 600 + real + seconds, 9000 + real)
        assert found and found.captured == pytest.approx(9000 + real, abs=1e-6)
        jumps.append(follower.offset.jump)
    assert jumps[0] == pytest.approx(-seconds) and not any(jumps[1:])


def test_frames_without_times_and_numbers_have_the_time_of_arrival():
    follower = clock.Follower("craft")
    for arrival in (3.0, 3.1, 3.3):
        found = follower.take(frames.Frame(arrival, {}))
        assert found.captured == arrival and found.pose is None and math.isnan(found.offset)


def test_a_library_that_is_missing_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "motioncapture", None)
    with pytest.raises(GroundError, match="pip install motioncapture"), library.opened("vicon", "127.0.0.1"):
        pass


@pytest.mark.parametrize("system", ["vicon", "qualisys"])
def test_a_server_of_the_library_that_does_not_answer_is_named(system):
    pytest.importorskip("motioncapture")
    with library.opened(system, "127.0.0.1") as source:
        assert next(source.frames) is None
        assert "%s does not answer at 127.0.0.1, port " % system in source.told()


def test_poses_of_the_library_are_those_that_changed():
    """A body that it lost stays where it was last, or has no numbers."""

    class Body:
        def __init__(self, x):
            self.position, self.rotation = (x, 0.1, 0.2), self
            self.x = self.y = self.z = 0.0
            self.w = 1.0

    seen = [{"craft": Body(x)} for x in (1.0, 1.5, 1.5, math.nan, 1.6)] + [{}]

    class Library:
        rigidBodies = None

        def waitForNextFrame(self):
            self.rigidBodies = seen.pop(0)

    found = library._frames(Library())
    poses = [[p.position[0] for p in next(found).poses.values()] for _ in range(5)]
    assert poses == [[1.0], [1.5], [], [], [1.6]]
    assert next(found) is None


def test_poses_of_trackers_come_by_vrpn():
    pytest.importorskip("motioncapture")
    server = fake_vrpn.FakeVrpn(["craft 1", "craft 2"])
    ends = threading.Event()

    def send():
        while not ends.wait(0.01):
            moment = time.monotonic()
            server.send("craft 1", (1.0, 0.04, moment), (0.0, 0.6, 0.0, 0.8))

    thread = threading.Thread(target=send, daemon=True)
    thread.start()
    try:
        with library.opened("vrpn", "127.0.0.1") as source:
            found = until(source, lambda frame: frame.poses)
            pose = found.poses["craft 1"]
            assert pose.position[:2] == pytest.approx((1.0, 0.04)) and found.time is None
            assert pose.rotation == pytest.approx((0.0, 0.6, 0.0, 0.8))
            late = [
                f.received - f.poses["craft 1"].position[2] for f in (next(source.frames) for _ in range(50))
            ]
            assert source.names() == ["craft 1"] and max(late) < 0.1
            ends.set()
            while next(source.frames):
                pass
            assert source.told() == "vrpn at 127.0.0.1 sends nothing"
    finally:
        ends.set()
        thread.join()
        server.close()
