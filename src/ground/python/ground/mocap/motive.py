"""Frames of a NatNet server, OptiTrack's Motive, as they arrive."""

import contextlib
import select
import socket
import time
from typing import Dict, Iterator, Optional

from ground.mocap import natnet
from ground.mocap.frames import Frame, FrameSource, pose
from ground.support.errors import GroundError

ASK = 1.0  # time between questions to the server, which also show it that somebody listens [s]
BACK = 1.0  # a server whose clock is set back by more than this began again [s]
AGAIN = 0.2  # shortest time between questions to a server that seems to be another one [s]
LARGEST = 65507  # datagram [bytes]


@contextlib.contextmanager
def opened(host: str, command_port: int = natnet.COMMAND_PORT) -> Iterator[FrameSource]:
    """A source at a host. GroundError when there is no way to it."""
    motive = Motive(host, command_port)
    try:
        yield FrameSource(motive.frames(), motive.told, lambda: sorted(motive.names.values()))
    finally:
        motive.close()


class Motive:
    """A connection to the server at a host, which may begin, end and begin again at any time."""

    def __init__(self, host: str, command_port: int = natnet.COMMAND_PORT) -> None:
        """command_port: of the server. GroundError when there is no way to the host."""
        self.host = host
        self.server: Optional[natnet.MotiveServer] = None
        self.names: Dict[int, str] = {}
        self._version = natnet.NEWEST
        self._problem = ""  # why frames that come cannot be used
        self._asked = -ASK
        self._newest = -ASK  # when the last frame came
        self._time = 0.0  # of the last frame, by the server's clock [s]
        self._commands = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._to = (socket.gethostbyname(host), command_port)
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as way:
                way.connect(self._to)
                self._address = way.getsockname()[0]  # of this computer in the network of the server
            self._commands.bind((self._address, 0))
        except (OSError, UnicodeError) as error:
            self._commands.close()
            raise GroundError("%s: %s" % (host, getattr(error, "strerror", None) or error)) from error
        self._data: Optional[socket.socket] = None

    def close(self) -> None:
        """Closes the connection."""
        for one in (self._commands, self._data):
            if one:
                one.close()

    def frames(self) -> Iterator[Optional[Frame]]:
        """Yields frames; None after each second without one."""
        while True:
            self._ask(ASK)
            found = self._next(ASK)
            if found:
                self._newest, self._problem = found.received, ""
            yield found

    def told(self) -> str:
        """Which server it is, or why nothing comes from it."""
        why = self._problem and ": " + self._problem
        if self.server is None:
            asked = "is Motive's streaming on, at the address of this network?"
            return "no NatNet server answers at %s%s" % (self.host, why or ": " + asked)
        who = "%s (NatNet %d.%d) at %s" % (self.server.name, *self._version, self.host)
        to = "to the group %s" % self.server.multicast if self.server.multicast else "to this computer"
        if time.monotonic() - self._newest < ASK:
            return "%s, %s" % (who, to)
        return "%s sends no frames %s%s" % (who, to, why)

    def _ask(self, interval: float) -> None:
        """Asks who the server is and what its bodies are called, which may change while frames come."""
        now = time.monotonic()
        if now - self._asked < interval:
            return
        self._asked = now
        questions = []
        if self.server:
            questions = [natnet.packet(natnet.REQUEST_MODELS), natnet.packet(natnet.KEEP_ALIVE)]
        if self.server is None or self._problem or now - self._newest > ASK:  # it may be another one
            questions += [natnet.connect(), natnet.ask_version()]
        with contextlib.suppress(OSError):  # the network is down: asked again
            for question in questions:
                self._commands.sendto(question, self._to)

    def _next(self, patience: float) -> Optional[Frame]:
        """The next frame; None when none comes in time [s]."""
        end = time.monotonic() + patience
        while True:
            sockets = [one for one in (self._data, self._commands) if one]
            ready, _, _ = select.select(sockets, [], [], max(0.0, end - time.monotonic()))
            if not ready:
                return None
            try:
                data, (address, _) = ready[0].recvfrom(LARGEST)
            except OSError:  # nothing listens at the server's port
                continue
            received = time.monotonic()
            if address != self._to[0]:
                self._problem = "packets come from {0}; if it is the mocap, give mocap_host:={0}".format(
                    address
                )
            else:
                try:
                    found = self._take(data, received)
                except natnet.PacketError as error:
                    self._problem = str(error)
                    found = None
                    self._ask(AGAIN)  # it may have begun again with another version
                if found:
                    return found
            if received > end:
                return None

    def _take(self, data: bytes, received: float) -> Optional[Frame]:
        """Takes a packet; a frame if it is one."""
        message, payload = natnet.opened(data)
        if message == natnet.SERVER:
            found = natnet.server(payload)
            if self.server != found:
                self._version = found.version
                self._listen(found)
                self.server = found
                self._asked = -ASK
        elif message == natnet.RESPONSE:
            self._version = natnet.streamed_version(payload) or self._version
        elif message == natnet.MODELS and self.server:
            self.names = natnet.models(payload, self._version)
        elif message == natnet.FRAME and self.server:
            return self._frame(natnet.frame(payload, self._version, self.server.ticks), received)
        return None

    def _frame(self, frame: natnet.NatNetFrame, received: float) -> Frame:
        """What the mocap saw. Bodies that it lost are not there."""
        if frame.time < self._time - BACK:  # bodies may have other numbers now
            self.names, self._asked = {}, -ASK
        self._time = frame.time
        poses = {}
        for body in frame.bodies:
            name = self.names.get(body.number)
            measured = pose(body.position, body.rotation) if body.valid and name else None
            if name is None:
                self._asked = min(self._asked, received - ASK + AGAIN)  # a body was added
            elif measured:
                poses[name] = measured
        return Frame(received, poses, frame.number, frame.time, frame.delay)

    def _listen(self, server: natnet.MotiveServer) -> None:
        """Listens where the server sends frames: to its multicast group; with none, to its port of data at
        this computer, or to the socket of the commands."""
        if self._data:
            self._data.close()
        self._data = None
        listening = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listening.bind((server.multicast or self._address, server.data_port))
            if server.multicast:
                group = socket.inet_aton(server.multicast) + socket.inet_aton(self._address)
                listening.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
        except OSError as error:
            listening.close()
            if server.multicast:
                raise natnet.PacketError("this computer cannot join the multicast group: %s" % error.strerror)
            return
        self._data = listening
