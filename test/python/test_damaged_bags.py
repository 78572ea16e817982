"""Bags that are written here byte by byte, sound or with one damage, and what their reader says of it."""
import bz2
import struct

import numpy as np
import pytest

from ground.errors import GroundError
from ground.recordings import bag_reader
from ground.recordings.bag_reader import BagReader

MD5 = b"992ce8a1687cec8c8bd883ec73ca41d1"  # std_msgs/String
KIND = {"topic": b"/a", "type": b"std_msgs/String", "md5sum": MD5, "message_definition": b"string data\n"}


def number(value, size=4):
    return int(value).to_bytes(size, "little")


def header(fields):
    entries = [name.encode() + b"=" + value for name, value in fields.items()]
    return b"".join(number(len(entry)) + entry for entry in entries)


def record(op, data=b"", **fields):
    packed = header({"op": bytes([op]), **fields})
    return number(len(packed)) + packed + number(len(data)) + data


def connection(at=0, **other):
    said = {**KIND, **other}
    return record(7, header(said), conn=number(at), topic=said["topic"])


def stamp(nanoseconds):
    return struct.pack("<II", *divmod(nanoseconds, 10**9))


def message(text, time, at=0, longer=0, short=0):
    """A record of a string; longer: bytes by which its length is too large."""
    data = number(len(text)) + text.encode()
    data = data[: len(data) - short]
    packed = header({"conn": number(at), "op": b"\2", "time": stamp(time)})
    return number(len(packed)) + packed + number(len(data) + longer) + data


CONNECTION = connection()


class Bag:
    """A bag in parts: chunks of records of messages, each with its index."""

    def __init__(self):
        self.body, self.chunks = b"", []

    def chunk(self, records, size=None, compression=b"none", pack=bytes, spoil=None, index=None):
        """records: of connections, bytes, or (message's record, time, connection). size: that the header
        says; spoil: changes the packed contents; index: (connection, place, time) in place of the true."""
        contents, entries = b"", []
        for one in records:
            if isinstance(one, tuple):
                entries.append((one[2], len(contents), one[1]))
                one = one[0]
            contents += one
        packed = pack(contents)
        packed = spoil(packed) if spoil else packed
        self.chunks.append(len(bag_reader.MAGIC) + 4096 + len(self.body))
        size = len(contents) if size is None else size
        self.body += record(5, packed, compression=compression, size=number(size))
        for at in sorted({at for at, *_ in entries}):
            rows = [(a, p, t) for a, p, t in (entries if index is None else index) if a == at]
            data = b"".join(stamp(t) + number(p) for _, p, t in rows)
            self.body += record(4, data, ver=number(1), conn=number(at), count=number(len(rows)))
        return self

    def write(self, path, connections=(CONNECTION,), index_at=None, end=None, keep=None, **more):
        """Writes it; index_at: what its header says; end: False leaves its end out; keep: bytes."""
        place = len(bag_reader.MAGIC) + 4096 + len(self.body)
        given = place if index_at is None else index_at
        head = record(3, b"", index_pos=number(given, 8), conn_count=number(1),
                      chunk_count=number(len(self.chunks)), **more)  # fmt: skip
        head = head[:-4] + number(4096 - len(head)) + b" " * (4096 - len(head))
        tail = b"".join(connections) + b"".join(
            record(6, b"", ver=number(1), chunk_pos=number(at, 8), start_time=stamp(0), end_time=stamp(0))
            for at in self.chunks
        )
        data = bag_reader.MAGIC + head + self.body + (b"" if end is False else tail)
        path.write_bytes(data if keep is None else data[:keep])
        return place

    @property
    def size(self):
        return len(bag_reader.MAGIC) + 4096 + len(self.body)


def row(text, time, at=0, **more):
    return message(text, time, at, **more), time, at


def read(path, topics=("/a",)):
    """The strings of a bag with their times, and its warnings."""
    with BagReader(str(path)) as bag:
        found = [(m.data, t.to_nsec()) for _, m, t in bag.read_messages(topics)]
        return found, bag.warnings


ROWS = [row("one", 10**9), row("three", 3 * 10**9), row("four", 4 * 10**9)]
TEXTS = [("one", 10**9), ("three", 3 * 10**9), ("four", 4 * 10**9)]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.bag"


def test_messages_of_all_chunks_come_in_the_order_of_receipt(path):
    later = [row("two", 2 * 10**9 + 5), row("five", 2**32 * 10**9 - 1)]
    Bag().chunk([connection(), *ROWS]).chunk(later).write(path)
    found, warnings = read(path)
    assert warnings == []
    assert found == [TEXTS[0], ("two", 2 * 10**9 + 5), *TEXTS[1:], ("five", 2**32 * 10**9 - 1)]
    assert read(path, ["/b"]) == ([], [])


def test_topics_are_listed_with_types_and_counts(path):
    other = connection(3, type=b"own/Type", md5sum=b"0" * 32)
    bag = Bag().chunk([connection(), connection(1, topic=b"/b"), *ROWS, row("x", 5, 3), other])
    bag.write(path, [connection(), connection(1, topic=b"/b"), other, connection(2, type=b"own/None")])
    with BagReader(str(path)) as found:
        topics = found.get_type_and_topic_info().topics
        assert topics == {"/a": ("own/Type and std_msgs/String", 4), "/b": ("std_msgs/String", 0)}
        assert found.batch("/a") is None  # its messages have two types
        assert [m.data for _, m, _ in found.read_messages(["/a"])] == [text for text, _ in TEXTS]
        # Its definition is not that of its checksum.
        assert found.warnings == ["the bag is damaged: messages that do not fit their type were left out (1)"]


def test_messages_that_do_not_fit_their_type_are_counted(path):
    Bag().chunk([connection(), *ROWS, row("cut", 5, short=4), row("short", 6, short=8)]).write(path)
    found, warnings = read(path)
    assert found == TEXTS
    assert warnings == ["the bag is damaged: messages that do not fit their type were left out (2)"]


def test_few_chunks_are_kept_in_memory(path, monkeypatch):
    bag = Bag()
    for i in range(6):
        bag.chunk([connection(), row("%d" % i * 50, i + 1)])
    bag.write(path)
    size = len(connection() + message("0" * 50, 1))
    for most, kept in ((2 * size, 2), (3 * size - 1, 2), (6 * size, 6), (1, 1)):
        monkeypatch.setattr(bag_reader, "MAX_OPEN", most)
        with BagReader(str(path)) as reader:
            found = [m.data for _, m, _ in reader.read_messages(["/a"])]
            assert found == ["%d" % i * 50 for i in range(6)]
            assert len(reader._open) == kept and 5 in reader._open  # the last ones
            assert reader._open_size == sum(map(len, reader._open.values())) == kept * size
        assert not reader._open


def test_an_encrypted_bag_is_refused(path):
    Bag().chunk([connection(), *ROWS]).write(path, encryptor=b"rosbag/AesCbcEncryptor")
    with pytest.raises(GroundError, match="run.bag: the bag is encrypted; decrypt it first"):
        read(path)
    Bag().chunk([connection(), *ROWS]).write(path, encryptor=b"")
    assert read(path) == (TEXTS, [])


# --- bags without their end


def test_a_bag_without_its_end_lacks_its_index_only(path):
    bag = Bag().chunk([connection(), *ROWS])
    for index_at in (0, None):
        bag.write(path, index_at=index_at, end=False)
        found, (warning,) = read(path)
        assert found == TEXTS and warning == (
            "the bag is cut short or was not closed: read as far as it goes (only the index is missing, "
            "no message)"
        )


def test_the_bytes_that_a_cut_takes_are_counted(path):
    bag = Bag().chunk([connection(), *ROWS])
    begin = bag.size - len(bag.body)
    contents = begin + bag.body.index(connection())
    second = contents + len(connection()) + len(ROWS[0][0])
    whole = sum(map(len, (connection(), *(r[0] for r in ROWS))))
    for cut, count in ((second, 1), (second + 7, 1), (contents + 3, 0), (contents + whole - 1, 2)):
        bag.write(path, keep=cut)
        found, (warning,) = read(path)
        assert found == TEXTS[:count]
        missing, inside = bag.size - cut, contents + whole - cut
        rest = 0 if cut == second else 7 if count == 1 else 3 if not count else len(ROWS[2][0]) - 1
        assert warning == (
            "the bag is cut short or was not closed: read as far as it goes (%d bytes or more are missing "
            "at its end, %d bytes of messages are lost)" % (missing, inside + rest)
        )


def test_a_header_that_alone_is_wrong_contradicts_the_file(path):
    bag = Bag().chunk([connection(), *ROWS])
    for index_at in (0, 10**9):
        bag.write(path, index_at=index_at)
        assert read(path) == (TEXTS, [contradict(1)])
    bag.write(path, index_at=1)  # within the file: nothing shows it
    assert read(path) == (TEXTS, [])


def contradict(count):
    return "the bag is damaged: messages and index contradict each other at %d places" % count


def test_an_index_of_a_wrong_length_contradicts_its_messages(path):
    good = Bag().chunk([connection(), *ROWS])
    at = good.size - 36 - 4  # where the length of the three entries is written
    good.write(path)
    data = bytearray(path.read_bytes())
    for length in (35, 37, 10**6):
        data[at : at + 4] = number(length)
        path.write_bytes(bytes(data))
        found, warnings = read(path)
        assert found == TEXTS and "messages and index contradict each other" in warnings[-1], length
    assert warnings == [contradict(1)]  # all else is whole


# --- damaged messages


def test_bytes_between_messages_are_lost(path):
    for junk in (b"?", b"junk of some bytes", bytes(50)):
        bag = Bag()
        bag.chunk([connection(), ROWS[0], junk, *ROWS[1:]]).chunk([row("six", 6), junk, row("seven", 7)])
        bag.write(path)
        found, (warning,) = read(path)
        assert found == [("six", 6), ("seven", 7), *TEXTS]
        assert warning == (
            "the bag is damaged: %d bytes of messages are lost at 2 places, the first at byte %d"
            % (2 * len(junk), bag.chunks[0])
        )


def test_a_chunk_that_is_shorter_than_it_says_has_lost_the_rest(path):
    for more, lost in ((0, 0), (1, 1), (500, 500), (-1, 0)):
        bag = Bag()
        records = [connection(), *ROWS]
        size = len(connection()) + sum(len(r[0]) for r in ROWS)
        bag.chunk(records, size + more, b"bz2", bz2.compress).write(path)
        found, warnings = read(path)
        assert found == TEXTS and bool(warnings) == bool(lost)
        if lost:
            assert warnings == [
                "the bag is damaged: %d bytes of messages are lost at 1 places, the first at byte %d"
                % (lost, bag.chunks[0])
            ]


def test_a_message_that_swallowed_the_next_is_found_by_the_index(path):
    swallowed = row("three", 3 * 10**9)
    for longer in (1, 20, len(swallowed[0])):
        wrong = row("one", 10**9, longer=longer)
        Bag().chunk([connection(), wrong, swallowed, ROWS[2]]).write(path)
        found, warnings = read(path)
        assert found == TEXTS and warnings[-1] == contradict(1), longer


def test_an_index_of_another_connection_takes_no_message(path):
    """Entries whose message is of another topic are left out; those without a message are counted."""
    two = [connection(), connection(1, topic=b"/b"), *ROWS, row("b", 5 * 10**9, 1), row("c", 6 * 10**9, 1)]
    places = np.cumsum([0] + [len(one if isinstance(one, bytes) else one[0]) for one in two]).tolist()
    true = [(r[2], p, r[1]) for r, p in zip(two[2:], places[2:])]
    connections = [connection(), connection(1, topic=b"/b")]
    Bag().chunk(two, index=true).write(path, connections)
    assert read(path, ["/a", "/b"])[1] == []
    moved = [true[0], (1, *true[1][1:]), *true[2:]]
    Bag().chunk(two, index=moved).write(path, connections)
    found, warnings = read(path, ["/a", "/b"])
    assert [text for text, _ in found] == ["one", "four", "b", "c"] and warnings == [contradict(1)]
    Bag().chunk(two, index=[true[0], true[2], *true[3:]]).write(path, connections)
    found, warnings = read(path, ["/a", "/b"])
    assert [text for text, _ in found] == ["one", "three", "four", "b", "c"]
    assert warnings == [contradict(1)]
    Bag().chunk(two, index=[*true, (0, true[1][1] + 3, 10**9)]).write(path, connections)
    assert read(path, ["/a", "/b"])[1] == [contradict(1)]


def test_an_index_that_points_to_no_header_takes_no_message(path):
    """The bytes there are nearly the header of a message, but name no connection."""
    op, time = header({"op": b"\2"}), header({"time": stamp(10**9)})
    for parts in (op + op + time, time * 3, op * 3):
        text = (number(38) + parts + number(4) + b"text").decode("latin-1")
        holder = row(text, 2 * 10**9)
        assert len(holder[0]) < 200 and text.isascii()
        records = [connection(), ROWS[0], holder, ROWS[1]]
        places = np.cumsum([0] + [len(r if isinstance(r, bytes) else r[0]) for r in records]).tolist()
        true = [(0, place, one[1]) for place, one in zip(places[1:], records[1:])]
        inside = places[3] - len(text)
        Bag().chunk(records, index=[*true, (0, inside, 2 * 10**9)]).write(path)
        found, warnings = read(path)
        assert [t for t, _ in found] == ["one", text, "three"] and warnings == [contradict(1)]


def test_of_two_times_the_one_near_the_others_is_right(path):
    records = [connection(), *ROWS]
    places = [len(connection()) + sum(len(r[0]) for r in ROWS[:i]) for i in range(3)]
    for wrong, expected in ((10**15, TEXTS[1][1]), (3 * 10**9 + 1, TEXTS[1][1]), (0, TEXTS[1][1])):
        index = [(0, p, wrong if i == 1 else r[1]) for i, (p, r) in enumerate(zip(places, ROWS))]
        Bag().chunk(records, index=index).write(path)
        found, warnings = read(path)
        assert found[1] == ("three", expected) and warnings == [contradict(1)]
    odd = [ROWS[0], (message("three", 10**15), 3 * 10**9, 0), ROWS[2]]
    Bag().chunk([connection(), *odd]).write(path)
    assert read(path) == (TEXTS, [contradict(1)])


def test_descriptions_that_contradict_each_other_are_named(path):
    Bag().chunk([connection(), *ROWS]).chunk([connection(), row("x", 9)]).write(path)
    assert read(path)[1] == []
    Bag().chunk([connection(), *ROWS]).chunk([connection(topic=b"/z"), row("x", 9)]).write(path)
    found, warnings = read(path)
    assert len(found) == 4  # most say /a
    assert warnings == ["the bag is damaged: its descriptions of a topic contradict each other"]


def test_a_type_of_which_one_description_differs_is_named(path):
    odd = connection(message_definition=b"string text\n")
    Bag().chunk([connection(), *ROWS]).write(path, [odd, connection()])
    assert read(path) == (TEXTS, [
        "the bag is damaged: its descriptions of a topic contradict each other"
    ])  # fmt: skip


def test_topics_may_be_described_at_the_end_alone(path):
    Bag().chunk(ROWS).write(path)
    assert read(path) == (TEXTS, [])
    Bag().chunk(ROWS).write(path, [])
    assert read(path) == ([], [])


def test_the_index_of_the_last_part_may_be_cut(path):
    bag = Bag().chunk([connection(), *ROWS]).chunk([row("a", 5), row("b", 6)])
    for cut in (1, 5, 13, 24):
        bag.write(path, keep=bag.size - cut)
        found, warnings = read(path)
        assert found == [("a", 5), ("b", 6), *TEXTS] and len(warnings) == 1
        assert "(%d bytes or more are missing at its end)" % cut in warnings[0]


def test_records_are_found_whatever_the_order_of_their_fields():
    for first in (b"1", b"12", b"x" * 80):
        packed = header({"x": first, "op": b"\4", "count": number(0)})
        data = b"junk" + number(len(packed)) + packed + number(0)
        found = bag_reader._next_record(data, 0, len(data))
        assert (found.op, found.start) == (4, 4), first


def test_lengths_have_four_bytes():
    good = record(7, b"data", topic=b"/a")
    assert bag_reader._record(good, 0, len(good)).end == len(good)
    for at in range(4):
        for byte in (1, 128):
            wrong = bytearray(good)
            wrong[at] ^= byte
            assert bag_reader._record(bytes(wrong), 0, len(wrong)) is None, at
    huge = good[:-8] + b"data"[:0] + number(2**31 + 5) + b"data"
    assert bag_reader._record(huge, 0, len(huge)).end == len(huge) - 4 + 2**31 + 5
    assert bag_reader._number(number(2**63 + 1, 8)) == 2**63 + 1


def test_headers_have_64_kib_at_most():
    for size, read_ in ((2**16, True), (2**16 + 1, False)):
        filler = size - len(header({"op": b"\7", "topic": b"/a", "x": b""}))
        data = record(7, b"data", topic=b"/a", x=b"-" * filler)
        assert (bag_reader._record(data, 0, len(data)) is not None) == read_


def test_numbers_of_a_known_type_are_read_at_once(tmp_path):
    import rosbag
    from geometry_msgs.msg import PointStamped

    with rosbag.Bag(str(tmp_path / "p.bag"), "w") as bag:
        for i in range(7):
            point = PointStamped()
            point.point.x = i
            bag.write("/p", point)
    with BagReader(str(tmp_path / "p.bag")) as bag:
        assert bag.batch("/p") is not None and bag.batch("/q") is None


# --- compressed chunks


def lz4_frame(contents, checksum=True, sized=False):
    frame = pytest.importorskip("lz4.frame")
    return frame.compress(
        contents, content_checksum=checksum, store_size=sized, block_linked=False
    )


def flipped(at):
    def spoil(packed):
        data = bytearray(packed)
        data[at] ^= 1
        return bytes(data)

    return spoil


@pytest.mark.parametrize("checksum", [True, False])
@pytest.mark.parametrize("sized", [True, False])
def test_frames_of_lz4_are_read_with_or_without_checksum_and_size(path, checksum, sized):
    def pack(contents):
        return lz4_frame(contents, checksum, sized)

    bag = Bag().chunk([connection(), *ROWS], compression=b"lz4", pack=pack)
    bag.chunk([row("x" * 3000, 9)], compression=b"lz4", pack=pack).write(path)
    found, warnings = read(path)
    assert found == [("x" * 3000, 9), *TEXTS]
    assert warnings == [] or checksum and sized  # which not all libraries can check


def test_a_part_with_a_wrong_checksum_is_used_if_it_is_the_only_one(path):
    bag = Bag().chunk([connection(), *ROWS], compression=b"lz4", pack=lz4_frame, spoil=flipped(-1))
    bag.write(path)
    assert read(path) == (TEXTS, [
        "the bag is damaged: its only part has a wrong checksum; what can be read of it is used, and may be "
        "wrong"
    ])  # fmt: skip
    bag.chunk([connection(), row("good", 7)], compression=b"lz4", pack=lz4_frame).write(path)
    lost = len(lz4_frame(connection() + b"".join(r[0] for r in ROWS)))
    assert read(path) == ([("good", 7)], [
        "the bag is damaged: %d bytes of messages are lost at 1 places, the first at byte %d"
        % (lost, bag.chunks[0])
    ])  # fmt: skip


def test_a_part_whose_header_is_lost_shows_its_compression(path):
    for compression, pack in ((b"bz2", bz2.compress), (b"lz4", lz4_frame)):
        bag = Bag().chunk([connection(), row("good", 7)])
        bag.chunk([connection(), *ROWS], compression=compression, pack=pack).write(path)
        data = bytearray(path.read_bytes())
        at = bag.chunks[1]
        data[at : at + 4] = bytes(4)
        path.write_bytes(bytes(data))
        found, warnings = read(path)
        assert found == [("good", 7), *TEXTS], compression
        assert warnings == [contradict(1)]


def test_errors_of_a_damaged_bag_name_the_damage(path):
    Bag().chunk([connection(), ROWS[0], b"junk"]).write(path)
    with pytest.raises(GroundError, match="no poses; the bag is damaged: 4 bytes of messages are lost"):
        with BagReader(str(path)):
            raise GroundError("no poses")
    Bag().chunk([connection(), *ROWS]).write(path)
    with pytest.raises(GroundError, match="^no poses$"):
        with BagReader(str(path)):
            raise GroundError("no poses")
    with pytest.raises(ValueError, match="^other$"):
        with BagReader(str(path)):
            raise ValueError("other")


def test_blocks_that_are_stored_or_repeat_are_unpacked():
    block = bag_reader._unpack_block
    for packed, expected in (
        (b"\x30abc", b"abc"),  # literals alone
        (b"\x31abc\x01\0\x00", b"abccccccc"[:8]),  # the last one five times
        (b"\xf0\x00" + b"a" * 15, b"a" * 15),
        (b"\xf0\xff\x01" + b"a" * 271, b"a" * 271),
        (b"\x1fa\x01\0\x00\x10b", b"a" * 20 + b"b"),
        (b"\x1fa\x01\0\xff\x02\x10b", b"a" * (1 + 15 + 255 + 2 + 4) + b"b"),
    ):
        found = bytearray()
        assert block(packed, found) and bytes(found) == expected, packed
    for cut in (b"\x30ab", b"\x11a\x00\0", b"\x11a\x02\0", b"\x11a\x01"):
        assert not block(cut, bytearray()), cut
