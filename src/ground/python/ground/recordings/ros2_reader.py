"""Reads bags of ROS 2 (folders with metadata.yaml, sqlite3 or MCAP) and MCAP files, through rosbags."""

import importlib.util
import pathlib
from typing import Any, Dict, Iterable, Iterator, List, Optional, Tuple

from ground.annotations import Message, Time
from ground.errors import GroundError
from ground.recordings import codecs, definitions
from ground.recordings.bag_reader import Topic, Topics
from ground.recordings.batches import Batch
from ground.recordings.codecs.with_rosbags import Time as PlainTime
from ground.recordings.codecs.with_rosbags import type_name

NEEDED = "bags of ROS 2 and MCAP files take the Python module rosbags: pip install rosbags"


class Ros2Reader:
    """The messages of a bag of ROS 2. Raises GroundError when it cannot be read."""

    def __init__(self, path: str) -> None:
        if importlib.util.find_spec("rosbags") is None:
            raise GroundError("%s: %s" % (path, NEEDED))
        from rosbags.rosbag2 import Reader

        self.path = path
        self.warnings: List[str] = []
        try:
            self._reader = Reader(pathlib.Path(path))
            self._reader.open()
        except Exception as error:  # rosbags, SQLite and their parsers raise many kinds
            raise self._unreadable(error)

    def _unreadable(self, error: Exception) -> GroundError:
        return GroundError(
            "%s: cannot be read as a bag of ROS 2 (%s)"
            % (self.path, " ".join(str(error).split()) or type(error).__name__)
        )

    def __enter__(self) -> "Ros2Reader":
        return self

    def __exit__(self, *failure: Any) -> None:
        self._reader.close()

    def get_type_and_topic_info(self) -> Topics:
        """Type and number of messages by topic."""
        kinds: Dict[str, List[str]] = {}
        counts: Dict[str, int] = {}
        for connection in self._reader.connections:
            kind = _name(connection.msgtype)
            if kind not in kinds.setdefault(connection.topic, []):
                kinds[connection.topic].append(kind)
            counts[connection.topic] = counts.get(connection.topic, 0) + connection.msgcount
        return Topics({t: Topic(" and ".join(sorted(k)), counts[t]) for t, k in kinds.items()})

    def batch(self, topic: str) -> Optional[Batch]:
        """See MessageSource."""
        return None

    def read_messages(
        self, topics: Iterable[str]
    ) -> Iterator[Tuple[str, Message, Optional[Time]]]:
        """Yields topic, message and time of receipt, in the order of receipt; what cannot be read is
        left out and counted in the warnings."""
        wanted = set(topics)
        chosen = [c for c in self._reader.connections if c.topic in wanted]
        if not chosen:
            return
        decode = {c.msgtype: d for c in chosen for d in [_decoder(c)] if d}
        unreadable = 0
        messages = self._reader.messages(connections=chosen)
        while True:
            try:
                connection, received, data = next(messages)
            except StopIteration:
                break
            except Exception as error:  # the file ends early, or a chunk is damaged
                self.warnings.append(
                    "the bag is damaged: read as far as it goes (%s)" % " ".join(str(error).split())
                )
                break
            try:
                message = decode[connection.msgtype](data)
            except Exception:  # decoders may raise anything, and some types have none
                unreadable += 1
                continue
            yield connection.topic, message, PlainTime(*divmod(received, 10**9))
        if unreadable:
            self.warnings.append(
                "the bag is damaged: messages that do not fit their type were left out (%d)"
                % unreadable
            )


def decoder(kind: str, definition: str, is_idl: bool = False) -> codecs.Decode:
    """Decodes the messages of a type by a definition, and by those of ROS 2 where it is empty. May raise
    anything when the definition is wrong."""
    from rosbags.typesys.stores import ros2_humble

    types = {**ros2_humble.FIELDDEFS, **_parsed(kind, definition, is_idl)}
    named = {_name(name): of for name, (_, of) in types.items()}
    return definitions.ros2_decoder(
        _name(kind),
        lambda inner: [(n, type_name(*of)) for n, of in named[inner]] if inner in named else None,
    )


def _decoder(connection: Any) -> Optional[codecs.Decode]:
    """Decodes the messages of a connection; None where that is not possible."""
    text = connection.msgdef
    is_idl = False
    if not isinstance(text, str):  # since rosbags 0.10
        text, is_idl = text.data, text.format.name == "IDL"
    try:
        return decoder(connection.msgtype, text, is_idl)
    except Exception:  # rosbags' parsers raise many kinds
        return None


def _parsed(kind: str, definition: str, is_idl: bool) -> Dict[str, Any]:
    """The types in a definition, as rosbags' grammars parse them."""
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    found: Dict[str, Any] = {}
    line = definitions.SEPARATOR + "\n"
    if definition.startswith(line + "IDL: "):
        for part in definition.split(line)[1:]:
            found.update(get_types_from_idl(part.split("\n", 1)[1]))
    elif is_idl:
        found.update(get_types_from_idl(definition))
    elif definition:
        found.update(get_types_from_msg(definition, kind))
    return found


def _name(kind: str) -> str:
    """The name of a type as ROS 1 has it."""
    return kind.replace("/msg/", "/")
