"""A proxy on the link between sender and craft that records packets and adds faults."""

import random
import select
import socket
import threading

from fake_craft import SO_TIMESTAMPNS, Packet, decode_motors, receive, varint

COUNT, BOOT = 13, 15  # fields of a DroneState


def to_varint(value):
    """The bytes of a number."""
    data = b""
    while value > 0x7F:
        data += bytes([value & 0x7F | 0x80])
        value >>= 7
    return data + bytes([value])


def changed(telemetry, fields):
    """A DroneState with other integers. fields: by their number, functions of the value that give the new
    one, or None to leave the field out."""
    at, kept = 0, b""
    while at < len(telemetry):
        start = at
        key, at = varint(telemetry, at)
        value, at = (None, at + 4) if key & 7 == 5 else varint(telemetry, at)
        change = fields.get(key >> 3)
        if change is None:
            kept += telemetry[start:at]
        elif change(value) is not None:
            kept += bytes([key]) + to_varint(change(value))
    return kept


class WireProxy:
    """Passes datagrams between a sender and a craft; the craft uses the proxy as its sender.

    drop, twice, swap: shares of packets that are lost, duplicated, or swapped with the next. deaf: no
    packet reaches the craft; silent: no telemetry comes from it; counts, boots: whether telemetry has the
    number of taken commands and the boot id. packets: all packets of the sender, recorded before faults
    are added.
    """

    def __init__(self, sender_port, port, seed=1):
        self.packets = []
        self.drop = self.twice = self.swap = 0.0
        self._random = random.Random(seed)
        self._to_craft = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._to_craft.bind(("127.0.0.1", port))
        self.silent = self.deaf = False
        self.counts = self.boots = True
        self._count, self._earlier, self._boot = 0, 0, 1  # count, that before its start; boot id
        self.move()
        self._sender, self._craft = ("127.0.0.1", sender_port), None
        self._held = None
        self._alive = True
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def move(self):
        """Moves the craft to another port."""
        self._to_sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._to_sender.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self._to_sender.bind(("127.0.0.1", 0))

    def restart(self):
        """The craft counts from 0 again, with another boot id."""
        self._earlier, self._boot = self._count, self._boot + 1

    def _telemetry(self, data):
        def count(value):
            self._count = value
            return max(0, value - self._earlier) if self.counts else None

        return changed(data, {COUNT: count, BOOT: lambda _: self._boot if self.boots else None})

    def _run(self):
        while self._alive:
            for ready in select.select([self._to_craft, self._to_sender], [], [], 0.1)[0]:
                data, source, arrival = receive(ready)
                if ready is self._to_craft:
                    self._craft = source
                    if not self.silent:
                        self._to_sender.sendto(self._telemetry(data), self._sender)
                else:
                    lift, _, right, left = [(v - 1000) / 1000 for v in decode_motors(data)]
                    self.packets.append(Packet(arrival, left, right, lift))
                    self._spoil(data)

    def _spoil(self, data):
        if self._craft is None or self.deaf or self._random.random() < self.drop:
            return
        if self._held is None and self._random.random() < self.swap:
            self._held = data
            return
        copies = 2 if self._random.random() < self.twice else 1
        for each in [data] * copies + ([self._held] if self._held else []):
            self._to_craft.sendto(each, self._craft)
        self._held = None

    def thrust_between(self, start, end):
        """Times of packets with thrust [s, time.time()]."""
        return [p.time for p in self.packets if start < p.time <= end and (p.left or p.right)]

    def close(self):
        self._alive = False
        self._thread.join()
        self._to_craft.close()
        self._to_sender.close()
