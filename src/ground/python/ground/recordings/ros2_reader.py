"""Reads bags of ROS 2 (folders with metadata.yaml, sqlite3 or MCAP) and MCAP files, through rosbags."""

import importlib.util
import pathlib
from typing import Any, Dict, Iterable, Iterator, List, Optional, Tuple

from ground.annotations import Message, Time
from ground.errors import GroundError
from ground.recordings.bag_reader import Topic, Topics
from ground.recordings.batches import Batch
from ground.recordings.codecs.with_rosbags import TIME
from ground.recordings.codecs.with_rosbags import Time as PlainTime

NEEDED = "bags of ROS 2 and MCAP files take the Python module rosbags: pip install rosbags"


class Ros2Reader:
    """The messages of a bag of ROS 2. Raises GroundError when it cannot be read."""

    def __init__(self, path: str) -> None:
        if importlib.util.find_spec("rosbags") is None:
            raise GroundError("%s: %s" % (path, NEEDED))
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        self.path = path
        self.warnings: List[str] = []
        try:
            store = get_typestore(Stores.ROS2_HUMBLE)
            self._reader = AnyReader([pathlib.Path(path)], default_typestore=store)
            self._reader.open()
        except Exception as error:  # rosbags, SQLite and their parsers raise many kinds
            raise self._unreadable(error)
        types = self._reader.typestore.types
        if TIME in types:
            types[TIME] = PlainTime

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
            kind = connection.msgtype.replace("/msg/", "/")
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
                message = self._reader.deserialize(data, connection.msgtype)
            except Exception:  # decoders raise whatever their parsing meets
                unreadable += 1
                continue
            yield connection.topic, message, PlainTime(*divmod(received, 10**9))
        if unreadable:
            self.warnings.append(
                "the bag is damaged: messages that do not fit their type were left out (%d)"
                % unreadable
            )
