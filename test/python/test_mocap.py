"""The mocap's client without ROS: what it makes of packets of a server on loopback, and of their times."""

import math
import os
import random
import struct
import sys
import threading
import time

import pytest

from conftest import ROOT, free_port

sys.path.insert(0, str(ROOT / "test" / "rostest"))
import fake_motive
from fake_motive import FakeMotive
from ground import GroundError
from ground.mocap import clock, frames, library, motive, natnet
import socket

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
    _, source = stream(lambda n: [(1, (0.5, 0.04, -1.5), (0, 0.6, 0, 0.8), True), (2, (1, 1, 1), UPRIGHT, True)], **options)
    frame = until(source, lambda found: found.poses)
    assert set(frame.poses) == {"hovercraft"}, "bodies without a name are unknown"
    assert frame.poses["hovercraft"].position == pytest.approx((0.5, 0.04, -1.5))
    assert frame.poses["hovercraft"].rotation == pytest.approx((0, 0.6, 0, 0.8))
    after = until(source, lambda found: True)
    assert after.number > frame.number and 0 < after.time - frame.time < 1
    assert "Motive 3.1" in source.told() and source.names() == ["hovercraft"]
    if version >= (3, 0):
        assert frame.delay == pytest.approx(0.004, abs=1e-4)
