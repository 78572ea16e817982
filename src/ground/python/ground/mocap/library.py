"""Frames of the systems that the library `motioncapture` reads: VRPN, Vicon, Qualisys.

It gives poses by name, and neither times nor numbers of frames.
"""

import contextlib
import importlib
import queue
import socket
import threading
import time
from typing import Any, Dict, Iterator, Optional, Set, Tuple

from ground.mocap.frames import Frame, FrameSource, Pose, pose
from ground.support.errors import GroundError

SYSTEMS = ("vrpn", "vicon", "qualisys")
PORTS = {"vicon": 801, "qualisys": 22222}  # at which a server answers; the library would wait without end
PATIENCE = 1.0  # longest wait for an answer or a frame [s]
MISSING = (
    "the Python module motioncapture, which reads %s, is not installed: python3 -m pip install motioncapture "
    "(Python 3.9 or later)%s"
)
ON_OLDER = ", or on Ubuntu 20.04 install ros-noetic-vrpn-client-ros"


@contextlib.contextmanager
def opened(system: str, host: str) -> Iterator[FrameSource]:
    """A source at a host. GroundError if the library is not installed."""
    try:
        library = importlib.import_module("motioncapture")
    except ImportError:
        raise GroundError(MISSING % (system, ON_OLDER if system == "vrpn" else ""))
    seen = "%s at %s" % (system, host)
    silent = seen + " sends nothing"
    told = [silent]
    names: Set[str] = set()
    arrivals: "queue.Queue[Frame]" = queue.Queue(maxsize=100)
    ends = threading.Event()

    def listen() -> None:
        """Reads frames until the end; the library cannot be interrupted while it waits for one."""
        while not ends.is_set():
            told[0] = _unreachable(system, host) or silent
            if told[0] != silent:
                ends.wait(PATIENCE)
                continue
            try:
                for frame in _frames(library.connect(system, {"hostname": host})):
                    if ends.is_set():
                        break
                    if frame:
                        told[0] = seen
                        names.update(frame.poses)
                        with contextlib.suppress(queue.Full):
                            arrivals.put_nowait(frame)
            except (RuntimeError, ValueError) as error:  # of the library
                told[0] = "%s: %s" % (seen, error)
                ends.wait(PATIENCE)

    def frames() -> Iterator[Optional[Frame]]:
        while True:
            try:
                yield arrivals.get(timeout=PATIENCE)
            except queue.Empty:
                told[0] = silent if told[0] == seen else told[0]
                yield None

    thread = threading.Thread(target=listen, daemon=True)
    thread.start()
    try:
        yield FrameSource(frames(), lambda: told[0], lambda: sorted(names))
    finally:
        ends.set()
        thread.join(PATIENCE)


def _unreachable(system: str, host: str) -> str:
    """Why no server answers; empty if one does, or if this cannot be known."""
    if system not in PORTS:
        return ""
    try:
        socket.create_connection((host, PORTS[system]), PATIENCE).close()
    except OSError as error:
        return "%s does not answer at %s, port %d: %s" % (system, host, PORTS[system], error)
    return ""


def _frames(connection: Any) -> Iterator[Optional[Frame]]:
    """Frames as the library gives them; None while nothing comes. It may give a body that is lost where it
    was last: a pose of the same bits is not a new one, because measured poses have noise."""
    before: Dict[str, Optional[Tuple[float, ...]]] = {}
    while True:
        connection.waitForNextFrame()
        received = time.monotonic()
        bodies = connection.rigidBodies
        if not bodies:  # of VRPN: nothing came since the last look
            yield None
            continue
        poses: Dict[str, Pose] = {}
        for name, body in bodies.items():
            q = body.rotation
            now = pose(body.position, (q.x, q.y, q.z, q.w))
            bits = now.position + now.rotation if now else None
            if now and bits != before.get(name):
                poses[name] = now
            before[name] = bits
        yield Frame(received, poses)
