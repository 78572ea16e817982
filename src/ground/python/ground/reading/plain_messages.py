"""Messages of MCAP files in JSON and protobuf as columns."""

import json
from typing import Any, Callable, Dict, Iterator, List, Sequence, Tuple, Union

import numpy as np

from ground.reading.containers import Column, Columns
from ground.reading.decoding import LONGEST, MOST_FIELDS
from ground.reading.streams import Stream
from ground.support.annotations import Indices
from ground.support.errors import GroundError

ENCODINGS = ("json", "protobuf")  #: of messages
Plain = Union[int, float, str]
NANOSECONDS = ("nsec", "nanosec", "nsecs", "nanos", "nanoseconds")  # names of a part of a time
SECONDS = ("sec", "secs", "seconds")
LATEST = 2**33  # largest number of seconds of a time


def columns(stream: Stream, messages: Sequence[bytes]) -> Tuple[List[Tuple[Indices, Columns]], int]:
    """Columns of messages with their numbers, and how many messages cannot be read."""
    read: Callable[[bytes], Any] = json.loads
    if stream.encoding == "protobuf":
        read = _protobuf(stream)
    rows: List[Dict[str, Plain]] = []
    chosen: List[int] = []
    for number, message in enumerate(messages):
        try:
            rows.append(dict(_flat("", read(message))))
            chosen.append(number)
        except (ValueError, RecursionError):  # also what protobuf raises
            continue
    lost = len(messages) - len(rows)
    if not rows:
        return [], lost
    names = dict.fromkeys(name for row in rows for name in row)
    return [(np.array(chosen), {name: _column([row.get(name) for row in rows]) for name in names})], lost


def _flat(path: str, value: Any) -> Iterator[Tuple[str, Plain]]:
    """The numbers, texts and times [ns] in a message, by path. ValueError for too many."""
    if isinstance(value, dict):
        time = _time(value)
        if time is not None:
            yield path, time
            return
        for name, inner in value.items():
            yield from _flat("%s.%s" % (path, name) if path else str(name), inner)
    elif isinstance(value, list):
        if len(value) > MOST_FIELDS:
            raise ValueError("too many fields")
        for number, inner in enumerate(value[:LONGEST]):
            yield from _flat("%s[%d]" % (path, number), inner)
    elif isinstance(value, (bool, int, float, str)):
        yield path, int(value) if isinstance(value, bool) else value


def _time(value: Dict[str, Any]) -> Union[int, None]:
    """A time or duration [ns]; None for other fields."""
    seconds = [value[n] for n in SECONDS if isinstance(value.get(n), int)]
    rest = [value[n] for n in NANOSECONDS if isinstance(value.get(n), int)]
    if len(value) != 2 or not (seconds and rest) or abs(seconds[0]) > LATEST:
        return None
    return int(seconds[0]) * 10**9 + int(rest[0])


def _column(values: Sequence[Any]) -> Column:
    kinds = {type(value) for value in values}
    if kinds == {int} and all(abs(value) < 2**63 for value in values):
        return np.array(values, np.int64)
    if str in kinds:
        return np.array(["" if value is None else str(value) for value in values], object)
    return np.array([np.nan if value is None else float(value) for value in values])


def _protobuf(stream: Stream) -> Callable[[bytes], Any]:
    """Reads messages of a stream. GroundError where protobuf is missing or the definition is damaged."""
    try:
        from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    except ImportError:
        raise GroundError(
            "%s: protobuf takes the Python module protobuf: pip install protobuf" % stream.topic
        )
    try:
        pool = descriptor_pool.DescriptorPool()
        for file in descriptor_pb2.FileDescriptorSet.FromString(stream.definition).file:
            pool.Add(file)
        described = pool.FindMessageTypeByName(stream.kind)
        if hasattr(message_factory, "GetMessageClass"):
            kind = message_factory.GetMessageClass(described)
        else:
            kind = message_factory.MessageFactory(pool).GetPrototype(described)
    except Exception as error:  # protobuf raises errors of its own
        raise GroundError(
            "%s: the definition of %s in the file is damaged (%s)" % (stream.topic, stream.kind, error)
        )

    def read(data: bytes) -> Any:
        try:
            return _fields(kind.FromString(data))
        except Exception as error:  # protobuf raises errors of its own
            raise ValueError(error)

    return read


def _fields(message: Any) -> Dict[str, Any]:
    """The fields of a message of protobuf, with those that have their default."""
    found: Dict[str, Any] = {}
    for field in message.DESCRIPTOR.fields:
        value = getattr(message, field.name)
        if field.label == field.LABEL_REPEATED:
            if field.type == field.TYPE_MESSAGE and field.message_type.GetOptions().map_entry:
                continue
            items = list(value)
            found[field.name] = [_fields(one) for one in items] if field.type == field.TYPE_MESSAGE else items
        elif field.type == field.TYPE_MESSAGE:
            found[field.name] = _fields(value) if message.HasField(field.name) else None
        else:
            found[field.name] = value
    return found
