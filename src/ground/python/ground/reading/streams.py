"""Streams of serialized messages, as bags hold them, and the reader of sound bags."""

import contextlib
import pathlib
from dataclasses import dataclass, replace
from typing import Any, Dict, Iterator, List, Sequence, Tuple

ENCODINGS = ("ros1", "cdr")  #: of messages of ROS 1 and 2

Row = Tuple[int, bytes]  #: time of receipt [ns] and content of a message


@dataclass(frozen=True)
class Stream:
    """Messages of one type on one topic."""

    key: Any  #: by which its source knows it
    topic: str
    kind: str  #: type of the messages as ROS 2 names it, "geometry_msgs/msg/PoseStamped"
    encoding: str  #: of the messages; only those in ENCODINGS are read
    form: str = ""  #: of the definition: "msg" or "idl"
    definition: str = ""  #: of the type; empty: the file has none
    digest: str = ""  #: hash of the type as ROS 2 takes it (REP 2011)
    count: int = 0  #: number of the messages


def plain(kind: str) -> str:
    """The name of a type as ROS 1 writes it."""
    return kind.replace("/msg/", "/")


class Source:
    """Where streams are read from."""

    def __init__(self) -> None:
        self.streams: List[Stream] = []
        self.warnings: List[str] = []  #: what is wrong with it, complete when the messages have been read

    def messages(self, streams: Sequence[Stream]) -> Iterator[Row]:
        """The messages of some streams. Damage may raise errors of any kind."""
        raise NotImplementedError

    def close(self) -> None:
        """Closes what is open."""


class Sound(Source):
    """A bag of ROS 1 or 2, or an MCAP file with messages of ROS 2, read by rosbags. Errors of any kind when
    it is damaged."""

    def __init__(self, path: str, is_ros1: bool) -> None:
        super().__init__()
        if is_ros1:
            from rosbags.rosbag1 import Reader
        else:
            from rosbags.rosbag2 import Reader
        self._reader: Any = Reader(pathlib.Path(path))
        self._reader.open()
        self._connections: Dict[int, Any] = dict(enumerate(self._reader.connections))
        for key, one in self._connections.items():
            text, form = one.msgdef, "msg"
            if not isinstance(text, str):  # since rosbags 0.10
                text, form = text.data, "idl" if text.format.name == "IDL" else "msg"
            encoding, digest = "ros1" if is_ros1 else "cdr", str(one.digest or "")
            self.streams.append(
                Stream(key, one.topic, one.msgtype, encoding, form, text, digest, one.msgcount)
            )

    def messages(self, streams: Sequence[Stream]) -> Iterator[Row]:
        """See Source."""
        chosen = [self._connections[stream.key] for stream in streams]
        for _, time, data in self._reader.messages(connections=chosen):
            if not isinstance(time, int) or isinstance(data, (int, float, str, type(None))):
                raise ValueError("a damaged row")  # SQLite takes any
            yield time, bytes(data)

    def close(self) -> None:
        """See Source."""
        with contextlib.suppress(Exception):
            self._reader.close()


class Pieces(Source):
    """Several sources as one: the files into which a recorder split a bag."""

    def __init__(self, sources: Sequence[Source]) -> None:
        super().__init__()
        self._sources = sources
        self.warnings = list(dict.fromkeys(text for source in sources for text in source.warnings))
        for number, source in enumerate(sources):
            self.streams += [replace(one, key=(number, one.key)) for one in source.streams]

    def messages(self, streams: Sequence[Stream]) -> Iterator[Row]:
        """See Source."""
        for number, source in enumerate(self._sources):
            wanted = [replace(one, key=one.key[1]) for one in streams if one.key[0] == number]
            yield from source.messages(wanted)

    def close(self) -> None:
        """See Source."""
        for source in self._sources:
            source.close()
