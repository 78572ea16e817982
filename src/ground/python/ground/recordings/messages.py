"""What gives messages: a bag of ROS 1 or 2, an MCAP file, tables; and its messages of one type."""

from typing import Callable, Iterable, Iterator, List, Optional, Protocol, Tuple

from ground.annotations import Message, Time
from ground.recordings.bag_reader import Topics
from ground.recordings.batches import Batch

Tell = Callable[[float], None]
TOLD = 1000  # messages between calls of a Tell
MANY = 5000  # messages whose reading takes so long that it is worth telling


class MessageSource(Protocol):
    """Topics and their messages. Types are named as in ROS 1, "geometry_msgs/PoseStamped"."""

    warnings: List[str]  #: what is wrong with the file, complete when its messages have been read

    def get_type_and_topic_info(self) -> Topics:
        """Type and number of messages by topic."""

    def read_messages(self, topics: Iterable[str]) -> Iterator[Tuple[str, Message, Time]]:
        """Yields topic, message and time of receipt (None where it is unknown), in their order."""

    def batch(self, topic: str) -> Optional[Batch]:
        """The messages of a topic at once; None where they have to be read one by one."""


def topics_of(bag: MessageSource, kind: str) -> List[str]:
    """Topics of message type `kind` with messages in a MessageSource, by name."""
    topics = bag.get_type_and_topic_info().topics
    return sorted(t for t, e in topics.items() if e.msg_type == kind and e.message_count > 0)


def announced(bag: MessageSource, kind: str) -> bool:
    """Whether the bag has or had messages of type `kind`, which may be lost."""
    return any(e.msg_type == kind for e in bag.get_type_and_topic_info().topics.values())


def of_type(bag: MessageSource, kind: str) -> Iterator[Message]:
    """Yields all messages of type `kind`, in the order of receipt."""
    for _, message, _ in bag.read_messages(topics_of(bag, kind)):
        yield message


class Told:
    """A MessageSource that tells which share of its messages has been read, 0..1."""

    def __init__(self, source: MessageSource, tell: Tell) -> None:
        self._source = source
        self._tell = tell
        self.warnings = source.warnings

    def get_type_and_topic_info(self) -> Topics:
        """See MessageSource."""
        return self._source.get_type_and_topic_info()

    def read_messages(self, topics: Iterable[str]) -> Iterator[Tuple[str, Message, Time]]:
        """See MessageSource."""
        info, wanted = self.get_type_and_topic_info().topics, set(topics)
        total = sum(entry.message_count for topic, entry in info.items() if topic in wanted)
        for count, row in enumerate(self._source.read_messages(wanted)):
            if count % TOLD == 0 and total > MANY:
                self._tell(min(1.0, count / total))
            yield row

    def batch(self, topic: str) -> Optional[Batch]:
        """See MessageSource."""
        return self._source.batch(topic)
