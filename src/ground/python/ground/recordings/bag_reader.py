"""Reads bags record by record from the start, without their index: also bags that are cut or damaged.

A bag of format 2.0 (wiki.ros.org/Bags/Format/2.0) is a file header, chunks of messages, each followed by
its index, and a copy of the connections (topics with their types) at the end. rosbag needs the end. This
reader does not: it reads every message that exists, checks it against redundant entries of the file, and
reports what was lost.
"""

import bz2
import enum
import mmap
import re
from collections import Counter, OrderedDict
from typing import (
    Dict,
    Iterable,
    Iterator,
    List,
    NamedTuple,
    Optional,
    Sequence,
    Set,
    Tuple,
    Type,
    Union,
)
from typing import (
    Counter as CounterType,
)

import numpy as np

from ground.annotations import Indices, Message, Time
from ground.errors import GroundError
from ground.recordings import batches, codecs, definitions

MAGIC = b"#ROSBAG V2.0\n"
ANY_MAGIC = MAGIC[:7]  # common to all formats
FILE_OP, INDEX_OP, CHUNK_OP, INFO_OP, CONNECTION_OP = 3, 4, 5, 6, 7
REQUIRED = {  # a field that every record of a kind has
    FILE_OP: b"index_pos",
    INDEX_OP: b"count",
    CHUNK_OP: b"compression",
    INFO_OP: b"chunk_pos",
    CONNECTION_OP: b"topic",
}
# The header of a message and the length of its data; the order of the fields is the writer's.
MESSAGE = re.compile(
    rb"\x26\0\0\0(?:\x09\0\0\0conn=(.{4})|\x04\0\0\0op=\x02|\x0d\0\0\0time=(.{8})){3}(.{4})", re.S
)
OP_FIELD = re.compile(rb"\x04\0\0\0op=([\x03-\x06])")  # in records outside of chunks
MAX_HEADER = 1 << 16  # size of a record's header [bytes]
MAX_BEFORE_OP = 120  # distance from the start of a record to its field op [bytes]
MAX_OPEN = 192 << 20  # size of the chunks' contents that are kept in memory [bytes]
MAX_BLOCK = 4 << 20  # size of an LZ4 block [bytes]
MAX_CHUNK_HEADER = 200  # size of a chunk's header [bytes]
BZ2_MAGIC, LZ4_MAGIC = b"BZh9", b"\x04\x22\x4d\x18"
LZ4_HEADER = 7  # length of a frame's header without the size of the contents [bytes]
LZ4_FLAGS, LZ4_HAS_SIZE, LZ4_HAS_CHECKSUM = 4, 0x08, 0x04  # place of the flags, and two of them
LZ4_SIZE = 8  # length of the size of the contents, if a frame has it [bytes]

Data = Union[bytes, mmap.mmap]


class Record(NamedTuple):
    """A record in a file or in a chunk; start, data and end are offsets there [bytes]."""

    op: Optional[int]
    fields: Dict[bytes, bytes]
    start: int
    data: int
    end: int  # may be beyond the end of a cut file


class Topic(NamedTuple):
    """What is known of a topic."""

    msg_type: str
    message_count: int


class Topics(NamedTuple):
    """Topics by name."""

    topics: Dict[str, Topic]


class Connection(NamedTuple):
    """A topic with the type of its messages."""

    topic: str
    msg_type: str
    md5sum: str
    definition: str


# Fields of a Connection in one record; None for missing ones.
Claim = Tuple[Optional[str], ...]


@enum.unique
class State(enum.Enum):
    """Reliability of the contents of a chunk."""

    PLAIN = 0  # has no checksum
    CHECKED = 1  # the checksum is right, or the chunk is cut at the end of the file
    DOUBTFUL = 2  # the checksum is wrong


class BagReader:
    """The messages of a bag. Raises GroundError when the file is not a bag of format 2.0.

    warnings: sentences on what is wrong with the bag, complete when its messages have been read.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self.warnings: List[str] = []
        self._lost: List[Tuple[int, int]] = []  # unreadable pieces: size and place [bytes]
        self._contradictions = 0  # between messages and the index of their chunk
        # number of a connection -> all its descriptions in the file
        self._claims: Dict[int, List[Claim]] = {}
        self._chunks: List[Record] = []
        # number of a chunk -> contents, of the last chunks read
        self._open: "OrderedDict[int, bytes]" = OrderedDict()
        self._open_size = 0  # [bytes]
        # number of a connection -> rows of (time [ns], chunk, offset, size)
        self._found: Dict[int, Indices] = {}
        # rows of (connection, time [ns], chunk, offset, size) as they are found
        self._rows: List[Indices] = []
        with open(path, "rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                file.seek(0)
                old = file.read(len(ANY_MAGIC)) == ANY_MAGIC
                raise GroundError(
                    "%s: %s"
                    % (path, "a bag, but not of format 2.0: see rosbag fix" if old else "not a bag")
                )
            self._data = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        self._scan()
        self._connections = {n: _agreed(claims) for n, claims in self._claims.items()}
        self._conclude()

    def __enter__(self) -> "BagReader":
        return self

    def __exit__(
        self, kind: Optional[Type[BaseException]], error: Optional[BaseException], _: object
    ) -> None:
        self._open.clear()
        self._data.close()
        if kind is GroundError and self.warnings:  # the damage may be the cause
            raise GroundError("%s; %s" % (error, "; ".join(self.warnings))) from error

    def get_type_and_topic_info(self) -> Topics:
        """Type and number of messages by topic, as rosbag.Bag gives them; several types of a topic are
        joined by " and "."""
        kinds: Dict[str, Set[str]] = {}
        counts: "CounterType[str]" = Counter()
        for number, connection in self._connections.items():
            count = len(self._found.get(number, ()))
            counts[connection.topic] += count
            if count or connection.topic not in kinds:
                kinds.setdefault(connection.topic, set()).add(connection.msg_type)
        return Topics({t: Topic(" and ".join(sorted(k)), counts[t]) for t, k in kinds.items()})

    def read_messages(self, topics: Iterable[str]) -> Iterator[Tuple[str, Message, Time]]:
        """Yields topic, message and time of receipt (the codec's Time), in the order of receipt."""
        received = codecs.installed().Time
        chosen = [n for n, c in self._connections.items() if c.topic in topics and n in self._found]
        if not chosen:
            return
        tables = [self._found[n] for n in chosen]
        numbers = np.repeat(chosen, [len(t) for t in tables])
        rows = np.column_stack([np.concatenate(tables), numbers])
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        kinds = {n: kind_of(self._connections[n]) for n in chosen}
        decode = {n: kind.decode for n, kind in kinds.items() if kind}
        unreadable = 0
        for time, chunk, offset, size, number in rows.tolist():
            try:
                message = decode[number](self._contents(chunk)[offset : offset + size])
            except Exception:  # decoders may raise anything, and some types have none
                unreadable += 1
                continue
            yield self._connections[number].topic, message, received(*divmod(time, 10**9))
        if unreadable:
            self.warnings.append(
                "the bag is damaged: messages that do not fit their type were left out (%d)"
                % unreadable
            )

    def batch(self, topic: str) -> Optional[batches.Batch]:
        """See messages.MessageSource."""
        numbers = [n for n, c in self._connections.items() if c.topic == topic and n in self._found]
        types = {self._connections[n]._replace(definition="") for n in numbers}
        kind = kind_of(self._connections[numbers[0]]) if len(types) == 1 else None
        if kind is None:
            return None
        rows = np.concatenate([self._found[n] for n in numbers])
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        data = [self._contents(chunk)[at : at + size] for chunk, at, size in rows[:, 1:].tolist()]
        return batches.gathered(types.pop().msg_type, kind, rows[:, 0], data)

    def _scan(self) -> None:
        """Finds all chunks and their messages."""
        self._size = len(self._data)
        # end of the chunks by the file header; 0: the bag was never closed
        self._index_at: Optional[int] = None
        self._ends_early = False
        records, position = [], len(MAGIC)
        while position < self._size:
            records.append(self._whole_record(position))
            position = records[-1].end
        for record in records:
            if record.op == CONNECTION_OP:
                self._take_connection(self._data, record)
            elif record.op == FILE_OP:
                if record.fields.get(b"encryptor"):
                    raise GroundError("%s: the bag is encrypted; decrypt it first" % self.path)
                self._index_at = _number(record.fields.get(b"index_pos", b""))
        self._has_end = any(record.op == INFO_OP for record in records)
        indices: Dict[int, List[Record]] = {}  # index records of each chunk
        for record in records:
            if record.op == CHUNK_OP:
                self._chunks.append(record)
            elif record.op == INDEX_OP and self._chunks:
                indices.setdefault(len(self._chunks) - 1, []).append(record)
        doubtful = []
        for number in range(len(self._chunks)):
            contents, state = self._unpacked(number)
            self._keep(number, contents)
            if state is not State.DOUBTFUL:
                # A compressed chunk has a checksum and needs no index. In a bag that is cut, the
                # index of the last chunk may be cut, too.
                last = self._ends_early and number == len(self._chunks) - 1
                needed = state is State.PLAIN and not last
                self._read_chunk(number, contents, indices.get(number, []) if needed else [])
            else:
                doubtful.append(number)
        self._doubtful = bool(doubtful) and not self._rows
        for number in doubtful:
            if self._doubtful:
                self._read_chunk(number, self._contents(number), [])
            else:
                chunk = self._chunks[number]
                self._lost.append((chunk.end - chunk.data, chunk.start))
        self._found = _by_connection(self._rows)
        self._rows.clear()

    def _whole_record(self, position: int) -> Record:
        """The record at a place of the file. An invalid one is taken for a chunk whose header is lost;
        a chunk that is cut or has a wrong length ends where the next record begins."""
        record = _record(self._data, position, self._size)
        if record is None:
            record = Record(CHUNK_OP, {}, position, position, self._size + 1)
        if record.end <= self._size and (record.op != CHUNK_OP or self._goes_on(record.end)):
            return record
        following = _next_record(self._data, max(record.data, position + 1), self._size)
        self._ends_early = self._ends_early or following is None
        end = self._size if following is None else following.start
        if record.op == CHUNK_OP:
            self._contradictions += following is not None
            return record._replace(end=end)
        # an index that is cut, or that has a wrong length
        self._contradictions += following is not None
        return record._replace(op=None, end=end)

    def _goes_on(self, position: int) -> bool:
        """Whether the file ends at a place, or a record begins there."""
        return position == self._size or _record(self._data, position, self._size) is not None

    def _contents(self, number: int) -> bytes:
        found = self._open.get(number)
        if found is None:
            found = self._unpacked(number)[0]
            self._keep(number, found)
        return found

    def _keep(self, number: int, contents: bytes) -> None:
        """Keeps the contents of a chunk in memory, in place of those that were read first."""
        self._open[number] = contents
        self._open_size += len(contents)
        while self._open_size > MAX_OPEN and len(self._open) > 1:
            self._open_size -= len(self._open.popitem(last=False)[1])

    def _unpacked(self, number: int) -> Tuple[bytes, State]:
        """The contents of a chunk, as far as they can be read, and their State."""
        record = self._chunks[number]
        packed = self._data[record.data : record.end]
        kind = record.fields.get(b"compression", b"")
        for magic, unpack in ((BZ2_MAGIC, _from_bz2), (LZ4_MAGIC, _from_lz4)):
            # the contents show the compression even if the header is lost
            at = packed.find(magic, 0, MAX_CHUNK_HEADER)
            if at >= 0 and kind != b"none":
                return unpack(packed[at:], record.end == self._size)
        return packed, State.PLAIN

    def _read_chunk(self, number: int, contents: bytes, indices: List[Record]) -> None:
        """Takes the messages of a chunk, after reconciling them with the records of its index."""
        rows, connections, times = [], [], []  # rows of (offset, start, size)
        position, last, size = 0, 0, len(contents)
        missing = _number(self._chunks[number].fields.get(b"size", b"")) - size
        if missing > 0:
            self._lost.append((missing, self._chunks[number].start))
        match, number_of = MESSAGE.match, int.from_bytes
        while position < size:
            message = match(contents, position)
            if message:
                connection, time, length = message.groups()
                start = message.end()
                end = start + number_of(length, "little")
                if end <= size and connection and time:
                    rows.append((position, start, end - start))
                    connections.append(connection)
                    times.append(time)
                    last, position = start, end
                    continue
            record = None if message else _record(contents, position, size)
            if record and record.op == CONNECTION_OP and record.end <= size:
                self._take_connection(contents, record)
                last, position = record.data, record.end
                continue
            position = last = self._skip(number, contents, position, last, size)
        seconds = np.frombuffer(b"".join(times), "<u4").astype(np.int64).reshape(-1, 2)
        # offset, connection, time [ns], start, size
        found: Indices = np.empty((len(rows), 5), np.int64)
        found[:, [0, 3, 4]] = np.array(rows, np.int64).reshape(-1, 3)
        found[:, 1] = np.frombuffer(b"".join(connections), "<u4")
        found[:, 2] = seconds @ [10**9, 1]
        if indices:
            found = self._settled(contents, found, indices)
        if len(found):
            found[:, 0] = number
            self._rows.append(found[:, [1, 2, 0, 3, 4]])

    def _skip(self, number: int, contents: bytes, position: int, last: int, size: int) -> int:
        """The place to continue at after an invalid record; the message before it may have been
        longer than it says."""
        following = MESSAGE.search(contents, min(last + 1, position + 1))
        if following and following.start() == position:
            following = MESSAGE.search(contents, position + 1)
        end = following.start() if following else size
        record = self._chunks[number]
        if following is None and record.end == self._size:
            self._ends_early = True
        if end > position:
            self._lost.append((end - position, record.start))
        else:
            self._contradictions += 1
        return end

    def _settled(self, contents: bytes, found: Indices, indices: List[Record]) -> Indices:
        """Reconciles the messages of a chunk with its index. A message with another topic in the index
        is left out, one that was swallowed by a wrong length is taken, and of two times of receipt the
        one nearer to the other messages' is taken."""
        tables = []
        for index in indices:
            count = (index.end - index.data) // 12
            entries = np.frombuffer(self._data[index.data : index.data + 12 * count], "<u4")
            entries = entries.astype(np.int64).reshape(-1, 3)
            of = Counter(found[np.isin(found[:, 0], entries[:, 2]), 1].tolist())
            indexed = of.most_common(1)[0][0] if of else -1
            times = entries[:, :2] @ [10**9, 1]
            tables.append(np.column_stack([entries[:, 2], np.full(count, indexed), times]))
        indexed = np.concatenate(tables)
        indexed = indexed[np.argsort(indexed[:, 0], kind="stable")]
        if np.array_equal(indexed, found[:, :3]):
            return found
        messages = {row[0]: row for row in found.tolist()}
        middle = int(np.median(found[:, 2])) if len(found) else 0
        for at, connection, time in indexed.tolist():
            message = messages.get(at)
            swallowed = MESSAGE.match(contents, at) if message is None else None
            if message == [at, connection, time] + (message or [])[3:]:
                continue
            self._contradictions += 1
            if swallowed and swallowed.group(1) and _number(swallowed.group(1)) == connection:
                start, size = swallowed.end(), _number(swallowed.group(3))
                if start + size <= len(contents):
                    messages[at] = [at, connection, time, start, size]
            elif message and message[1] != connection:
                del messages[at]
            elif message:
                message[2] = min(message[2], time, key=lambda t: float(abs(t - middle)))
        self._contradictions += len(set(messages) - set(indexed[:, 0].tolist()))
        return np.array(sorted(messages.values()), np.int64).reshape(-1, 5)

    def _take_connection(self, data: Data, record: Record) -> None:
        """Takes topic and type from a connection's record and from the publisher's header in it."""
        number = record.fields.get(b"conn", b"")
        said = _fields(data, record.data, record.end) or {}
        claims = self._claims.setdefault(_number(number), [])
        for fields in (record.fields, said):
            claims.append(
                tuple(
                    fields[name].decode("utf-8", "replace") if name in fields else None
                    for name in (b"topic", b"type", b"md5sum", b"message_definition")
                )
            )

    def _conclude(self) -> None:
        """Adds warnings on what is wrong with the file."""
        lost = sum(size for size, _ in self._lost)
        index_at = self._index_at
        if self._has_end and not self._ends_early and not 0 < (index_at or 0) < self._size:
            self._contradictions += 1  # the file is complete: only its header is damaged
            index_at = None
        cut = self._ends_early or index_at is not None and not 0 < index_at < self._size
        if cut:
            missing = max(0, (index_at or 0) - self._size)
            what = []
            if missing:
                what.append("%d bytes or more are missing at its end" % missing)
            if lost:
                what.append("%d bytes of messages are lost" % lost)
            self.warnings.append(
                "the bag is cut short or was not closed: read as far as it goes (%s)"
                % (", ".join(what) or "only the index is missing, no message")
            )
        elif lost:
            self.warnings.append(
                "the bag is damaged: %d bytes of messages are lost at %d places, the first at byte %d"
                % (lost, len(self._lost), self._lost[0][1])
            )
        if self._doubtful:
            self.warnings.append(
                "the bag is damaged: its only part has a wrong checksum; what can be read of it is "
                "used, and may be wrong"
            )
        if self._contradictions:
            self.warnings.append(
                "the bag is damaged: messages and index contradict each other at %d places"
                % self._contradictions
            )
        if any(len(set(c)) > 2 for c in self._claims.values()):
            self.warnings.append("the bag is damaged: its descriptions of a topic contradict each other")


def _by_connection(rows: List[Indices]) -> Dict[int, Indices]:
    """Rows that begin with the number of a connection, without it, by that number."""
    if not rows:
        return {}
    every = np.concatenate(rows)
    every = every[np.argsort(every[:, 0], kind="stable")]
    numbers, firsts = np.unique(every[:, 0], return_index=True)
    return dict(zip(numbers.tolist(), np.split(every[:, 1:], firsts[1:])))


def kind_of(connection: Connection) -> Optional[codecs.Kind]:
    """The type of a connection's messages: the installed one if it is the same, else that of the
    definition in the bag; None if neither is possible."""
    known = codecs.installed().known(connection.msg_type)
    if known and known.md5sum == connection.md5sum:
        return known
    try:
        defined = definitions.kind(connection.msg_type, connection.definition)
    except (ValueError, RecursionError):
        return None
    if known and known.md5sum == defined.md5sum:
        return known
    return defined if defined.md5sum == connection.md5sum else None


def _agreed(claims: Sequence[Claim]) -> Connection:
    """The Connection on which most of its descriptions agree."""
    fields = []
    for values in zip(*claims):
        known = Counter(v for v in values if v is not None)
        fields.append(known.most_common(1)[0][0] if known else "")
    return Connection(*fields)


def _number(text: bytes) -> int:
    """A little-endian number of up to eight bytes."""
    return int.from_bytes(text[:8], "little")


def _fields(data: Data, start: int, end: int) -> Optional[Dict[bytes, bytes]]:
    """Name to value of the fields of a header; None where they are invalid."""
    fields = {}
    while start < end:
        size = _number(data[start : start + 4])
        start += 4
        if size > end - start:
            return None
        name, equals, value = bytes(data[start : start + size]).partition(b"=")
        if not equals:
            return None
        fields[name] = value
        start += size
    return fields


def _record(data: Data, start: int, size: int) -> Optional[Record]:
    """The Record at a place; None where there is none. Its end may be beyond the size."""
    length = _number(data[start : start + 4])
    at = start + 4 + length
    if not 0 < length <= MAX_HEADER or at + 4 > size:
        return None
    fields = _fields(data, start + 4, at)
    if not fields or len(fields.get(b"op", b"")) != 1:
        return None
    op = fields[b"op"][0]
    if REQUIRED.get(op) not in fields:
        return None
    return Record(op, fields, start, at + 4, at + 4 + _number(data[at : at + 4]))


def _next_record(data: Data, start: int, size: int) -> Optional[Record]:
    """The first valid record outside of a chunk, from a place on; None without one."""
    for found in OP_FIELD.finditer(data, start):
        for at in range(found.start() - 4, max(start, found.start() - MAX_BEFORE_OP) - 1, -1):
            record = _record(data, at, size)
            if record and record.data > found.end() and record.op == found.group(1)[0]:
                if record.end <= size or record.op == CHUNK_OP:
                    return record
    return None


def _from_bz2(packed: bytes, _: bool) -> Tuple[bytes, State]:
    """Decompresses up to the end, a cut or a wrong checksum (bz2 has one for each block)."""
    unpacked, tool = bytearray(), bz2.BZ2Decompressor()
    try:
        for start in range(0, len(packed), 4096):
            unpacked += tool.decompress(packed[start : start + 4096])
            if tool.eof:
                break
    except (OSError, ValueError, EOFError):
        pass
    return bytes(unpacked), State.CHECKED


def _from_lz4(packed: bytes, is_last: bool) -> Tuple[bytes, State]:
    """The contents of an LZ4 frame, as far as they can be read, and their State."""
    flags = packed[LZ4_FLAGS] if len(packed) > LZ4_FLAGS else 0
    checksum = 4 if flags & LZ4_HAS_CHECKSUM else 0  # [bytes]
    blocks, size = [], -1
    position = LZ4_HEADER + (LZ4_SIZE if flags & LZ4_HAS_SIZE else 0)
    while size and position + 4 <= len(packed):
        size = _number(packed[position : position + 4]) & 0x7FFFFFFF
        blocks.append(position)
        position += 4 + size
    whole = size == 0 and position + checksum <= len(packed)  # the end mark and what follows it
    if whole:
        try:
            contents = codecs.installed().unpack_lz4(packed)
            return contents, State.CHECKED if checksum else State.PLAIN
        except (
            OSError,
            ValueError,
            MemoryError,
            RuntimeError,
        ):  # wrong checksum, contents, or kind of frame
            is_last = False
    unpacked = bytearray()
    for at in blocks:
        size = _number(packed[at : at + 4])
        block = packed[at + 4 : at + 4 + (size & 0x7FFFFFFF)]
        if size >> 31:
            unpacked += block  # not compressed
        elif not _unpack_block(block, unpacked):
            break
    else:
        if whole and not checksum:
            return bytes(unpacked), State.PLAIN
    return bytes(unpacked), State.CHECKED if is_last else State.DOUBTFUL


def _unpack_block(block: bytes, unpacked: bytearray) -> bool:
    """Appends the contents of an LZ4 block; returns False where it is cut or invalid."""
    position, size, most = 0, len(block), len(unpacked) + MAX_BLOCK

    def length(value: int) -> int:
        nonlocal position
        while value >= 15 and position < size:
            more = block[position]
            position += 1
            value += more
            if more < 255:
                break
        return value

    while position < size and len(unpacked) < most:
        token = block[position]
        position += 1
        literals = length(token >> 4)
        unpacked += block[position : position + literals]
        position += literals
        if position >= size:
            return position == size
        back = _number(block[position : position + 2])
        position += 2
        if not 0 < back <= len(unpacked) or position > size:
            return False
        copied = min(length(token & 15) + 4, most)
        pattern = unpacked[len(unpacked) - back : len(unpacked) - back + copied]
        unpacked += (pattern * (copied // len(pattern) + 1))[:copied]
    return True
