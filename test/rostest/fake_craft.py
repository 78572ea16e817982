"""A craft on loopback that only records the packets that it receives.

Its own decoder and encoder check the link's protocol independently."""

import collections
import socket
import struct
import threading
import time

SO_TIMESTAMPNS = 35  # Linux: the kernel's time of arrival, which the machine's load does not change

Packet = collections.namedtuple("Packet", "time left right lift")
Packet.__doc__ = "Motors message: arrival [s, time.time()] and inputs, 0..1."


def free_port():
    """An unused UDP port of loopback."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def varint(data, at):
    """The number that starts at a byte, and the offset after it."""
    value = shift = 0
    while True:
        value |= (data[at] & 0x7F) << shift
        shift += 7
        at += 1
        if data[at - 1] < 0x80:
            return value, at


def decode_motors(data):
    """DL, DR, R, L of a Motors datagram; raises ValueError for any other datagram."""
    values = {}
    at = 0
    try:
        while at < len(data):
            key, at = varint(data, at)
            if key & 7 or not 1 <= key >> 3 <= 4 or key >> 3 in values:
                raise ValueError("unexpected key %d" % key)
            values[key >> 3], at = varint(data, at)
    except IndexError:
        raise ValueError("cut short")
    if len(values) != 4 or not all(1000 <= v <= 2000 for v in values.values()):
        raise ValueError("values %s" % values)
    return [values[i] for i in range(1, 5)]


def encode_state(angles, raw):
    """DroneState datagram of roll, pitch, yaw and nine non-negative integers."""
    data = b"".join(bytes([8 * i + 13]) + struct.pack("<f", a) for i, a in enumerate(angles))
    for i, value in enumerate(raw):
        data += bytes([8 * (i + 4)])
        while value > 0x7F:
            data += bytes([value & 0x7F | 0x80])
            value >>= 7
        data += bytes([value])
    return data


STATE = encode_state((1.5, -2.25, 30.0), (1, 2, 300, 4, 5, 6, 7, 8, 9000))


def receive(stamping):
    """Receives from a socket with SO_TIMESTAMPNS: datagram, sender, and arrival [s, time.time()]."""
    data, ancillary, _, sender = stamping.recvmsg(4096, 256)
    arrival = time.time()
    for _, kind, content in ancillary:
        if kind == SO_TIMESTAMPNS:
            seconds, nanoseconds = struct.unpack("@ll", content[: struct.calcsize("@ll")])
            arrival = seconds + 1e-9 * nanoseconds
    return data, sender, arrival


class FakeCraft:
    """Craft whose thread collects packets."""

    def __init__(self, ground_port, port=0):
        self.ground = ("127.0.0.1", ground_port)
        self.packets = []
        self.garbled = []  # datagrams that are not Motors
        self._changed = threading.Condition()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self._socket.bind(("127.0.0.1", port))
        self.port = self._socket.getsockname()[1]
        self._alive = True
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def send(self, data=STATE):
        self._socket.sendto(data, self.ground)

    def close(self):
        self._alive = False
        self._socket.sendto(b"", ("127.0.0.1", self.port))  # wakes the thread
        self._thread.join()
        self._socket.close()

    def count(self):
        with self._changed:
            return len(self.packets)

    def since(self, start):
        """Packets that arrived after time `start`."""
        with self._changed:
            return [p for p in self.packets if p.time > start]

    def wait(self, condition, what, timeout=10.0):
        """Waits until condition(packets) is true and returns its value."""
        deadline = time.monotonic() + timeout
        with self._changed:
            while True:
                result = condition(self.packets)
                if result:
                    return result
                left = deadline - time.monotonic()
                if left <= 0:
                    raise AssertionError(
                        "%s did not happen; %d packets, last %s"
                        % (what, len(self.packets), self.packets[-3:])
                    )
                self._changed.wait(left)

    def wait_packets(self, number):
        """Waits for `number` more packets."""
        goal = self.count() + number
        self.wait(lambda packets: len(packets) >= goal, "%d packets" % number)

    def _run(self):
        while True:
            data, sender, arrival = receive(self._socket)
            if not self._alive:
                return
            with self._changed:
                try:
                    lift, lift_right, right, left = ((v - 1000) / 1000 for v in decode_motors(data))
                    if lift != lift_right or sender != self.ground:
                        raise ValueError("lift %g and %g from %s" % (lift, lift_right, sender))
                    self.packets.append(Packet(arrival, left, right, lift))
                except ValueError:
                    self.garbled.append(data)
                self._changed.notify_all()


def is_zero(packet):
    return packet.left == packet.right == packet.lift == 0
