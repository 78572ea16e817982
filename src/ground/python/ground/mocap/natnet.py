"""NatNet, in which OptiTrack's Motive streams: packets, as NaturalPoint's SDK publishes their layout.

All numbers are little-endian. A packet is a message, a length and a payload. Versions 2.0 to 4.x are read;
what a client of poses does not need (markers, skeletons, devices) is skipped.
"""

import math
import re
import struct
from dataclasses import dataclass
from typing import Any, Callable, Dict, List, Optional, Tuple

Version = Tuple[int, int]

# Messages
CONNECT, SERVER, REQUEST, RESPONSE, REQUEST_MODELS, MODELS, FRAME, KEEP_ALIVE = 0, 1, 2, 3, 4, 5, 7, 10
COMMAND_PORT, DATA_PORT, MULTICAST = 1510, 1511, "239.255.42.99"
NEWEST: Version = (4, 1)  # that is asked for
MAX_REST = 64  # most bytes behind the times of a frame
MAX_DELAY = 1.0  # longest time from exposure to transmission that is believed [s]
VALID = 1  # bit of a body's parameters: it was seen in this frame


class PacketError(ValueError):
    """A packet that is not what its version says."""


@dataclass(frozen=True)
class RigidBody:
    """A rigid body in a frame."""

    number: int  #: its streaming ID
    position: Tuple[float, float, float]  #: [m], in the mocap's axes
    rotation: Tuple[float, float, float, float]  #: quaternion x, y, z, w
    valid: bool  #: whether it was seen; the pose is the last one or zeros if not


@dataclass(frozen=True)
class NatNetFrame:
    """What all cameras saw at one instant."""

    number: int
    time: float  #: of exposure, by the mocap's clock [s]
    delay: float  #: from then until the frame was sent [s]; 0 where the server does not say it
    bodies: List[RigidBody]


@dataclass(frozen=True)
class MotiveServer:
    """What the server says of itself."""

    name: str  #: of the program, with its version
    version: Version  #: of NatNet, in which it streams
    data_port: int
    multicast: str  #: group that frames are sent to; empty: to each client
    ticks: int  #: of its clock in a second; 0: not said


def packet(message: int, payload: bytes = b"") -> bytes:
    """A packet to send."""
    return struct.pack("<HH", message, len(payload)) + payload


def connect() -> bytes:
    """The packet that asks a server who it is."""
    return packet(CONNECT, b"Ping".ljust(265, b"\0") + bytes([*NEWEST, 0, 0]) + b"\0\0")


def ask_version() -> bytes:
    """The packet that asks a server for the version in which it streams, which may be older than its own."""
    return packet(REQUEST, b"Bitstream\0")


def opened(data: bytes) -> Tuple[int, bytes]:
    """Message and payload of a packet. PacketError when it is cut off."""
    reader = _Reader(data)
    message, length = reader.take("<HH")
    if length > len(data) - 4:
        raise PacketError("a packet of %d bytes says that it has %d" % (len(data) - 4, length))
    return int(message), data[4 : 4 + length]


def server(payload: bytes) -> MotiveServer:
    """The MotiveServer in a payload."""
    reader = _Reader(payload)
    name = reader.take("256s")[0].split(b"\0")[0].decode("utf-8", "replace")
    release = "%d.%d.%d" % reader.take("4B")[:3]
    major, minor, _, _ = reader.take("4B")
    ticks, port, group = 0, DATA_PORT, MULTICAST
    if (major, minor) >= (3, 0) and reader.left >= 15:
        ticks, port, is_multicast, *address = reader.take("<QHB4B")
        group = ".".join(map(str, address)) if is_multicast else ""
    return MotiveServer("%s %s" % (name, release), (int(major), int(minor)), int(port), group, int(ticks))


def streamed_version(payload: bytes) -> Optional[Version]:
    """The version in an answer to `ask_version`; None if it is another answer."""
    found = re.match(rb"Bitstream,\s*(\d+)\.(\d+)", payload)
    return (int(found.group(1)), int(found.group(2))) if found else None


def models(payload: bytes, version: Version) -> Dict[int, str]:
    """Names of rigid bodies by number."""
    reader, found = _Reader(payload), {}
    for _ in range(reader.count()):
        kind = reader.integer()
        end = reader.at + 4 + reader.peek() if version >= (4, 1) else None
        if end is not None:
            reader.skip(4)
        if kind == 0:  # a set of markers
            reader.text()
            for _ in range(reader.count()):
                reader.text()
        elif kind == 1:
            name = reader.text()
            found[reader.integer()] = name
            _rest_of_body(reader, version)
        elif kind == 2:  # a skeleton: its bones are bodies, too
            reader.text()
            reader.skip(4)
            for _ in range(reader.count()):
                reader.text()
                reader.skip(4)
                _rest_of_body(reader, version)
        elif end is None:
            break  # force plates, devices and cameras come last
        if end is not None:
            reader.go_to(end)
    return found


def _rest_of_body(reader: "_Reader", version: Version) -> None:
    """Skips what follows the number of a body that is described."""
    reader.skip(4 + 12)  # parent, offset
    if version >= (3, 0) and version < (4, 1):  # from then on its length is known
        count = reader.count()
        reader.skip(16 * count)
        if version >= (4, 0):
            for _ in range(count):
                reader.text()


def frame(payload: bytes, version: Version, ticks: int = 0) -> NatNetFrame:
    """The NatNetFrame in a payload of a version. ticks: of the server's clock in a second, 0 if it does not
    say it. PacketError when the payload does not fit the version."""
    reader = _Reader(payload)
    sized = version >= (4, 1)
    number = reader.integer()
    _each(reader, sized, lambda: _set_of_markers(reader))
    _each(reader, sized, lambda: reader.skip(12))  # markers without a label
    count = reader.count()
    reader.skip(4 * sized)
    bodies = [_body(reader, version) for _ in range(count)]
    if version >= (2, 1):
        _each(reader, sized, lambda: _skeleton(reader, version))
    if sized:
        _each(reader, sized, lambda: None)  # assets
    if version >= (2, 3):
        label = 20 + 2 * (version >= (2, 6)) + 4 * (version >= (3, 0))
        _each(reader, sized, lambda: reader.skip(label))
    for since in ((2, 9), (2, 11)):  # force plates, devices
        if version >= since:
            _each(reader, sized, lambda: _channels(reader))
    reader.skip(8)  # time code
    (time,) = reader.take("<d" if version >= (2, 7) else "<f")
    delay = 0.0
    if version >= (3, 0) and ticks:
        exposed, _, sent = reader.take("<3Q")
        if exposed and 0 <= sent - exposed <= MAX_DELAY * ticks:  # some cameras do not say it
            time, delay = exposed / ticks, (sent - exposed) / ticks
    if not math.isfinite(time):
        raise PacketError("a packet has the time %s" % time)
    if reader.left > MAX_REST:
        raise PacketError("a packet has %d bytes too many for NatNet %d.%d" % (reader.left, *version))
    return NatNetFrame(number, float(time), delay, bodies)


def _each(reader: "_Reader", sized: bool, skip: Callable[[], object]) -> None:
    """Skips a section: by its length if it has one, else thing by thing."""
    count = reader.count()
    if sized:
        reader.skip(reader.integer())
        return
    for _ in range(count):
        skip()


def _body(reader: "_Reader", version: Version) -> RigidBody:
    number, *pose = reader.take("<i7f")
    if version < (3, 0):
        count = reader.count()
        reader.skip(20 * count)  # positions, numbers and sizes of its markers
    reader.skip(4)  # mean error
    valid = True
    if version >= (2, 6):
        valid = bool(reader.take("<h")[0] & VALID)
    x, y, z, qx, qy, qz, qw = map(float, pose)
    return RigidBody(int(number), (x, y, z), (qx, qy, qz, qw), valid)


def _set_of_markers(reader: "_Reader") -> None:
    reader.text()
    reader.skip(12 * reader.count())


def _skeleton(reader: "_Reader", version: Version) -> None:
    reader.skip(4)
    for _ in range(reader.count()):
        _body(reader, version)


def _channels(reader: "_Reader") -> None:
    reader.skip(4)
    for _ in range(reader.count()):
        reader.skip(4 * reader.count())


class _Reader:
    """A payload, read from its start."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    @property
    def left(self) -> int:
        """Bytes that are left."""
        return len(self.data) - self.at

    def take(self, form: str) -> Tuple[Any, ...]:
        """Values of a format of struct."""
        size = struct.calcsize(form)
        self.skip(size)
        return struct.unpack_from(form, self.data, self.at - size)

    def skip(self, size: int) -> None:
        """Moves on. PacketError at the end of the data."""
        self.go_to(self.at + size)

    def go_to(self, at: int) -> None:
        """Moves on to a byte. PacketError before this one, or behind the end of the data."""
        if not self.at <= at <= len(self.data):
            raise PacketError("a packet ends after %d bytes, in the middle of its contents" % len(self.data))
        self.at = at

    def integer(self) -> int:
        """A whole number."""
        return int(self.take("<i")[0])

    def peek(self) -> int:
        """The whole number that comes next, which stays."""
        value = self.integer()
        self.at -= 4
        return value

    def count(self) -> int:
        """A number of things. PacketError when it cannot be one."""
        found = self.integer()
        if not 0 <= found <= len(self.data):
            raise PacketError("a packet claims %d items of a kind" % found)
        return found

    def text(self) -> str:
        """A text that ends with a zero."""
        end = self.data.find(b"\0", self.at)
        if end < 0:
            raise PacketError("a packet has an unterminated string")
        found = self.data[self.at : end]
        self.at = end + 1
        return found.decode("utf-8", "replace")
