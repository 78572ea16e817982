"""A NatNet server on loopback, as OptiTrack's Motive is one, by the layout that NaturalPoint publishes.

It knows nothing of the client's code. `FakeMotive.spoil` puts faults on the wire.
"""

import contextlib
import select
import socket
import struct
import threading
import time

GROUP = "239.255.42.99"
TICKS = 10_000_000  # of the server's clock in a second


def text(value):
    return value.encode() + b"\0"


def message(number, payload):
    return struct.pack("<HH", number, len(payload)) + payload


def section(version, things):
    """A list of packed things, with its size since 4.1."""
    content = b"".join(things)
    size = struct.pack("<i", len(content)) if version >= (4, 1) else b""
    return struct.pack("<i", len(things)) + size + content


def rigid_body(version, number, position, rotation, seen):
    packed = struct.pack("<i7f", number, *position, *rotation)
    if version < (3, 0):  # three markers: places, numbers, sizes
        packed += struct.pack("<i", 3) + struct.pack("<9f3i3f", *range(9), 1, 2, 3, 0.01, 0.01, 0.01)
    packed += struct.pack("<f", 0.0004)
    return packed + (struct.pack("<h", int(seen)) if version >= (2, 6) else b"")


def labeled_marker(version):
    packed = struct.pack("<i4f", 65537, 0.1, 0.2, 0.3, 0.014)
    packed += struct.pack("<h", 10) if version >= (2, 6) else b""
    return packed + (struct.pack("<f", 0.0002) if version >= (3, 0) else b"")


def channels(number):
    """A force plate or device of two channels with 1 and 3 values."""
    return struct.pack("<iiifi3f", number, 2, 1, 0.5, 3, 1.0, 2.0, 3.0)


def frame(version, number, seconds, bodies, exposed=0, sent=0):
    """A frame of data. bodies: (number, position, quaternion x, y, z, w, whether it is seen)."""
    marks = text("all") + struct.pack("<i6f", 2, *range(6))
    parts = [
        struct.pack("<i", number),
        section(version, [marks]),
        section(version, [struct.pack("<3f", 1, 2, 3)]),
    ]
    parts.append(section(version, [rigid_body(version, *body) for body in bodies]))
    if version >= (2, 1):
        bone = rigid_body(version, 1, (9, 9, 9), (0, 0, 0, 1), True)
        parts.append(section(version, [struct.pack("<ii", 1, 1) + bone]))
    if version >= (4, 1):
        parts.append(section(version, []))  # assets
    if version >= (2, 3):
        parts.append(section(version, [labeled_marker(version)] * 2))
    if version >= (2, 9):
        parts.append(section(version, [channels(1)]))
    if version >= (2, 11):
        parts.append(section(version, [channels(2)]))
    parts.append(struct.pack("<II", 0, 0))
    parts.append(struct.pack("<d" if version >= (2, 7) else "<f", seconds))
    if version >= (3, 0):
        parts.append(struct.pack("<3Q", exposed, exposed, sent))
    if version >= (4, 1):
        parts.append(struct.pack("<II", 0, 0))
    parts.append(struct.pack("<hi", 0, 0))
    return message(7, b"".join(parts))


def described_body(version, number, name):
    packed = text(name) + struct.pack("<ii3f", number, -1, 0, 0, 0)
    if version >= (4, 2):
        packed += struct.pack("<4f", 0, 0, 0, 1)
    if version >= (3, 0):
        packed += struct.pack("<i6f2i", 2, *range(6), 0, 0)
        packed += text("Marker 1") + text("Marker 2") if version >= (4, 0) else b""
    return packed


def models(version, names):
    """Descriptions of a set of markers, of bodies and of a skeleton."""
    marks = (0, text("all") + struct.pack("<i", 1) + text("Marker 1"))
    bodies = [(1, described_body(version, number, name)) for number, name in names.items()]
    bones = text("somebody") + struct.pack("<ii", 1, 1) + described_body(version, 1, "hip")
    packed = []
    for kind, content in [marks, (2, bones), *bodies]:
        size = struct.pack("<i", len(content)) if version >= (4, 1) else b""
        packed.append(struct.pack("<i", kind) + size + content)
    return message(5, struct.pack("<i", len(packed)) + b"".join(packed))


class FakeMotive:
    """names: {number: name} of its bodies. spoil(packet): the packets that are sent in place of one."""

    def __init__(self, version=(4, 1), multicast=True, names=None, host="127.0.0.1", ports=(1510, 1511)):
        self.version, self.multicast, self.host, self.ports = version, multicast, host, ports
        self.names = dict(names or {1: "hovercraft"})
        self.spoil, self.answers = None, True
        self.streams = version  # where it streams in another version than its own
        self.clients, self.asked = set(), []
        self.restart()
        self._commands = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._commands.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._commands.bind((host, ports[0]))
        self._data = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._data.bind((host, 0))
        self._data.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(host))
        self._alive = True
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def restart(self, version=None):
        """Numbers and clock begin again, and clients are forgotten."""
        self.number, self.origin = 0, time.monotonic() - 1.0
        self.version = self.streams = version or self.version
        self.clients.clear()

    def now(self):
        """Its clock [s]."""
        return time.monotonic() - self.origin

    def send(self, bodies, age=0.0, copies=1):
        """Sends a frame that was exposed `age` before [s]."""
        self.number += 1
        now = self.now()
        exposed = int((now - age) * TICKS)
        packet = frame(self.streams, self.number, now - age, bodies, exposed, int(now * TICKS))
        spoil = self.spoil
        for one in [packet] * copies if spoil is None else spoil(packet):
            self.transmit(one)

    def transmit(self, packet):
        """Sends a packet as it is."""
        for to in [(GROUP, self.ports[1])] if self.multicast else list(self.clients):
            with contextlib.suppress(OSError):
                (self._data if self.multicast else self._commands).sendto(packet, to)

    def close(self):
        """Ends it."""
        self._alive = False
        self._thread.join()
        self._commands.close()
        self._data.close()

    def _serve(self):
        while self._alive:
            if not select.select([self._commands], [], [], 0.1)[0]:
                continue
            data, client = self._commands.recvfrom(65507)
            self.asked.append(data)
            if self.answers and len(data) >= 4:
                with contextlib.suppress(OSError):
                    for answer in self._answers(struct.unpack_from("<H", data)[0], data[4:], client):
                        self._commands.sendto(answer, client)

    def _answers(self, asked, payload, client):
        if asked == 0:
            self.clients.add(client)
            if not self.multicast and self.version >= (4, 0):  # streams in the client's version
                self.streams = min(self.version, tuple(payload[265:267]))
            own = bytes([*self.version, 0, 0])
            info = b"Motive".ljust(256, b"\0") + bytes([3, 1, 0, 1]) + own
            if self.version >= (3, 0):
                group = socket.inet_aton(GROUP) if self.multicast else bytes(4)
                info += struct.pack("<QHB", TICKS, self.ports[1], self.multicast) + group
            yield message(1, info)
        elif asked == 4:
            yield models(self.streams, self.names)
        elif asked == 2 and payload.startswith(b"Bitstream") and self.version >= (4, 0):
            yield message(3, text("Bitstream,%d.%d" % self.streams))
        elif asked == 2:
            yield message(100, b"")
