"""A VRPN server on loopback: what a tracker sends, by the messages of VRPN 7."""

import select
import socket
import struct
import threading
import time

PORT = 3883
COOKIE = b"vrpn: ver. 07.38  0".ljust(24, b"\0")
SENDER, TYPE = -1, -2  # messages that give names of numbers
POSE = 0  # number of the type of poses


def message(sender, kind, payload):
    """A message: its length, time, sender, type and number, then the payload in full eights."""
    now = time.time()
    header = struct.pack(">6i", 24 + len(payload), int(now), int(now % 1 * 1e6), sender, kind, 0)
    return header + payload + bytes(-len(payload) % 8)


def name(text):
    return struct.pack(">i", len(text) + 1) + text.encode() + b"\0"


class FakeVrpn:
    """names: of its trackers."""

    def __init__(self, names, host="127.0.0.1"):
        self.names, self._clients, self._alive = names, [], True
        self._door = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._door.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._door.bind((host, PORT))
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def send(self, tracker, position, rotation):
        """Sends a pose of a tracker: position, and quaternion x, y, z, w."""
        packed = struct.pack(">2i7d", 0, 0, *position, *rotation)
        for client in self._clients:
            client.sendall(message(self.names.index(tracker), POSE, packed))

    def close(self):
        """Ends it."""
        self._alive = False
        self._thread.join()
        for one in [self._door, *self._clients]:
            one.close()

    def _serve(self):
        """A client says where it listens; the server connects to there."""
        known = set()
        while self._alive:
            for ready in select.select([self._door, *self._clients], [], [], 0.1)[0]:
                if ready is not self._door:
                    ready.recv(65536)
                    continue
                where = self._door.recv(1000).split(b"\0")[0].decode().split()
                if tuple(where) in known:
                    continue
                known.add(tuple(where))
                client = socket.create_connection((where[0], int(where[1])), 2)
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                client.sendall(COOKIE)
                for number, tracker in enumerate(self.names):
                    client.sendall(message(number, SENDER, name(tracker)))
                client.sendall(message(POSE, TYPE, name("vrpn_Tracker Pos_Quat")))
                self._clients.append(client)
