"""What gives messages: a bag of ROS 1 or 2, an MCAP file, tables; and its messages of one type."""

from typing import Iterable, Iterator, List, Protocol, Tuple

from ground.annotations import Message, Time
from ground.recordings.bag_reader import Topics


class MessageSource(Protocol):
    """Topics and their messages. Types are named as in ROS 1, "geometry_msgs/PoseStamped"."""

    warnings: List[str]  #: what is wrong with the file, complete when its messages have been read

    def get_type_and_topic_info(self) -> Topics:
        """Type and number of messages by topic."""

    def read_messages(self, topics: Iterable[str]) -> Iterator[Tuple[str, Message, Time]]:
        """Yields topic, message and time of receipt (None where it is unknown), in their order."""


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
