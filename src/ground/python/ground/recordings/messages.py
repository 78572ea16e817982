"""Messages of one type in a bag, whatever their topic."""

from typing import Iterator, List

from ground.annotations import Message
from ground.recordings.bag_reader import BagReader


def topics_of(bag: BagReader, kind: str) -> List[str]:
    """Topics of message type `kind` with messages in a BagReader, by name."""
    topics = bag.get_type_and_topic_info().topics
    return sorted(t for t, e in topics.items() if e.msg_type == kind and e.message_count > 0)


def announced(bag: BagReader, kind: str) -> bool:
    """Whether the bag has or had messages of type `kind`, which may be lost."""
    return any(e.msg_type == kind for e in bag.get_type_and_topic_info().topics.values())


def of_type(bag: BagReader, kind: str) -> Iterator[Message]:
    """Yields all messages of type `kind`, in the order of receipt."""
    for _, message, _ in bag.read_messages(topics_of(bag, kind)):
        yield message
