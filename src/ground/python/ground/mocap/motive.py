"""Frames of a NatNet server, OptiTrack's Motive, as they arrive."""

import contextlib
import socket
import struct
import time
from dataclasses import dataclass
from typing import Dict, Iterator, Optional, Tuple

from ground.mocap import natnet
from ground.support.errors import GroundError

ASK = 1.0  # time between questions that were not answered, and between signs of life [s]
LARGEST = 65507  # datagram [bytes]


@dataclass(frozen=True)
class Seen:
    """A body in a frame."""

    name: str
    number: int  #: of the frame
    time: float  #: of the mocap's clock [s]
    received: float  #: when the frame came, by this computer's monotonic clock [s]
    body: natnet.Body


class Motive:
    """A connection to a server. Use it in a with statement.

    host: of the server; ports: of its commands, and of the multicast group if it has one; address: of this
    computer's network in which frames come, where there are several. GroundError when a socket cannot be opened.
    """

    def __init__(self, host: str, command_port: int = natnet.COMMAND_PORT, address: str = "") -> None:
        self.host, self.address = host, address
        self.server: Optional[natnet.Server] = None
        self.names: Dict[int, str] = {}
        self.unreadable = 0  #: packets that could not be read
        self._asked = -ASK
        try:
            self._to = (socket.gethostbyname(host), command_port)
            self._commands = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._commands.bind((address, 0))
        except OSError as error:
            raise GroundError("%s: %s" % (host, error.strerror or error)) from error
        self._data: Optional[socket.socket] = None

    def __enter__(self) -> "Motive":
        return self

    def __exit__(self, *_: object) -> None:
        for one in (self._commands, self._data):
            if one:
                one.close()

    def frames(self, patience: float) -> Iterator[Optional[Tuple[natnet.Frame, float]]]:
        """Yields frames with the time of their arrival; None after each time of `patience` [s] without one."""
        while True:
            self._ask()
            found = self._next(min(patience, ASK))
            yield found

    def seen(self, patience: float) -> Iterator[Optional[Seen]]:
        """Yields the bodies that were seen in each frame; None after each time of `patience` [s] without a
        frame. A body that was lost is not there."""
        for found in self.frames(patience):
            if found is None:
                yield None
                continue
            frame, received = found
            for body in frame.bodies:
                if body.number not in self.names:
                    self._asked = min(self._asked, time.monotonic() - ASK)  # a body was added
                elif body.valid:
                    yield Seen(self.names[body.number], frame.number, frame.time, received, body)

    def _ask(self) -> None:
        """Asks who the server is and what its bodies are called, until it has said so, and shows that somebody
        listens."""
        now = time.monotonic()
        if now - self._asked < ASK:
            return
        self._asked = now
        with contextlib.suppress(OSError):  # the network is down: asked again
            if self.server is None:
                self._commands.sendto(natnet.connect(), self._to)
            else:
                self._commands.sendto(natnet.packet(natnet.REQUEST_MODELS), self._to)
                self._commands.sendto(natnet.packet(natnet.KEEP_ALIVE), self._to)

    def _next(self, patience: float) -> Optional[Tuple[natnet.Frame, float]]:
        """The next frame; None when none comes in time."""
        import select

        end = time.monotonic() + patience
        while True:
            sockets = [one for one in (self._data, self._commands) if one]
            ready, _, _ = select.select(sockets, [], [], max(0.0, end - time.monotonic()))
            if not ready:
                return None
            try:
                data = ready[0].recv(LARGEST)
            except OSError:  # nothing listens at the server's port
                continue
            received = time.monotonic()
            try:
                frame = self._take(data)
            except (natnet.PacketError, struct.error):
                self.unreadable += 1
                continue
            if frame:
                return frame, received

    def _take(self, data: bytes) -> Optional[natnet.Frame]:
        """Takes a packet; a frame if it is one."""
        message, payload = natnet.opened(data)
        if message == natnet.SERVER:
            found = natnet.server(payload)
            if self.server != found:
                self.server = found
                self._asked = -ASK
                self._listen(found)
        elif message == natnet.MODELS and self.server:
            self.names = natnet.models(payload, self.server.version)
        elif message == natnet.FRAME and self.server:
            return natnet.frame(payload, self.server.version)
        return None

    def _listen(self, server: natnet.Server) -> None:
        """Joins the server's multicast group; with none, frames come to the socket of the commands."""
        if self._data:
            self._data.close()
        self._data = None
        if not server.multicast:
            return
        joined = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        joined.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        joined.bind((server.multicast, server.data_port))
        group = socket.inet_aton(server.multicast) + socket.inet_aton(self.address or "0.0.0.0")
        joined.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
        self._data = joined
