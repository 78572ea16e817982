"""Files of recordings: codecs, records of bags, and which files belong together."""
import os
import re
import struct

import numpy as np
import pytest
import yaml
from conftest import write_bag

from ground.errors import GroundError
from ground.recordings import (
    bag_reader,
    batches,
    codecs,
    commands,
    flown,
    mapping,
    messages,
    poses,
    readers,
    recording,
    run_parameters,
    settings,
)
from ground.recordings.bag_reader import BagReader, Connection

ros = codecs.installed(("with_ros",))
plain = codecs.installed(("with_rosbags",))
KINDS = [
    "geometry_msgs/PointStamped",
    "geometry_msgs/PoseStamped",
    "geometry_msgs/PoseWithCovarianceStamped",
    "nav_msgs/Odometry",
    "std_msgs/Float64MultiArray",
    "std_msgs/String",
    "std_msgs/Header",
    "std_msgs/Bool",
    "nav_msgs/Path",
]


def serialized(message):
    import io

    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


def values_of(message):
    """All values in a message of either codec, in the order of its definition."""
    if hasattr(message, "to_nsec"):
        return message.to_nsec()
    if isinstance(message, (list, tuple, np.ndarray)):
        return [values_of(inner) for inner in message]
    names = getattr(message, "__dataclass_fields__", None) or getattr(message, "__slots__", None)
    if names:
        return [values_of(getattr(message, n)) for n in names if not n.startswith("_")]
    return message


# --- codecs


@pytest.mark.parametrize("kind", KINDS)
def test_both_codecs_know_the_same_types(kind):
    assert plain.known(kind).md5sum == ros.known(kind).md5sum
    assert list(plain.fields(kind)) == list(ros.fields(kind))
    empty = ros.new(kind)
    assert values_of(ros.known(kind).decode(serialized(empty))) == values_of(empty)
    if kind != "std_msgs/Header":  # rosbags' one has no counter; ROS fills it in
        assert values_of(plain.known(kind).decode(serialized(empty))) == values_of(plain.new(kind))


def test_both_codecs_decode_the_same_values():
    pose = ros.new("geometry_msgs/PoseStamped")
    pose.header.stamp, pose.header.frame_id, pose.header.seq = ros.Time(7, 250), "world", 3
    pose.pose.position.x, pose.pose.orientation.w = 1.5, -0.5
    found = plain.known("geometry_msgs/PoseStamped").decode(serialized(pose))
    assert found.header.frame_id == "world" and found.header.stamp.to_nsec() == 7 * 10**9 + 250
    assert found.header.stamp.to_sec() == pose.header.stamp.to_sec()
    assert (found.pose.position.x, found.pose.orientation.w) == (1.5, -0.5)
    many_numbers = ros.new("std_msgs/Float64MultiArray", data=[1.0, 2.5, -3.0])
    decoded = plain.known("std_msgs/Float64MultiArray").decode(serialized(many_numbers))
    assert list(decoded.data) == [1.0, 2.5, -3.0]
    for codec in (ros, plain):
        assert codec.known("own_msgs/Unknown") is None and codec.fields("own_msgs/Unknown") is None


def test_bags_of_both_codecs_have_the_same_messages(tmp_path):
    read = {}
    for name, codec in (("ros", ros), ("plain", plain)):
        path = str(tmp_path / (name + ".bag"))
        for _ in range(2):  # an older file is replaced
            with codec.bag_writer(path) as bag:
                for i in range(200):
                    vector = codec.new("geometry_msgs/Vector3Stamped")
                    vector.header.stamp, vector.vector.x = codec.Time(100 + i, 7), 0.5 * i
                    bag.write("/a", vector, codec.Time(100 + i, 8))
                    bag.write("/b", codec.new("std_msgs/String", data="%d" % i), codec.Time(100 + i, 9))
        with BagReader(path) as bag:
            rows = [
                (topic, serialized(message), received.to_nsec())
                for topic, message, received in bag.read_messages(["/a", "/b"])
            ]
            assert not bag.warnings
        read[name] = rows
    assert len(read["ros"]) == 400
    strip = [(topic, data if topic == "/b" else data[4:], t) for topic, data, t in read["ros"]]
    other = [(topic, data if topic == "/b" else data[4:], t) for topic, data, t in read["plain"]]
    assert strip == other  # but for the counter of the headers


def test_the_first_codec_whose_modules_are_installed_is_taken(monkeypatch):
    assert codecs.installed() is ros
    monkeypatch.setattr(ros, "NEEDS", ("a_module_that_is_not_there",))
    codecs.installed.cache_clear()
    try:
        assert codecs.installed() is plain
        monkeypatch.setattr(plain, "NEEDS", ("a_module_that_is_not_there",))
        codecs.installed.cache_clear()
        with pytest.raises(GroundError, match="pip install rosbags"):
            codecs.installed()
    finally:
        codecs.installed.cache_clear()


# --- records of bags


def record(op, data=b"", **more):
    fields = b""
    for name, value in {"op": bytes([op]), **more}.items():
        entry = name.encode() + b"=" + value
        fields += struct.pack("<I", len(entry)) + entry
    return struct.pack("<I", len(fields)) + fields + struct.pack("<I", len(data)) + data


def test_a_record_is_read_with_its_fields_and_its_end():
    data = b"junk" + record(7, b"payload", topic=b"/a=b", conn=struct.pack("<I", 5)) + b"rest"
    found = bag_reader._record(data, 4, len(data))
    assert (found.op, found.start, found.end) == (7, 4, len(data) - 4)
    assert found.fields[b"topic"] == b"/a=b" and data[found.data : found.end] == b"payload"
    assert bag_reader._number(found.fields[b"conn"]) == 5
    assert bag_reader._record(data, 3, len(data)) is None
    assert bag_reader._record(data, 4, found.data - 1) is None  # its header is cut
    cut = bag_reader._record(data, 4, found.data)  # only its data are
    assert cut.end == found.end
    assert bag_reader._record(record(7, b"x"), 0, 999) is None  # a connection has a topic
    wrong = struct.pack("<I", bag_reader.MAX_HEADER + 1) + bytes(70000)
    assert bag_reader._record(wrong, 0, len(wrong)) is None


@pytest.mark.parametrize("before", [0, 1, 50, 3000])
def test_the_next_record_is_found_behind_anything(before):
    junk = np.random.default_rng(1).integers(0, 256, before, np.uint8).tobytes()
    whole = junk + record(5, b"data", compression=b"none", size=struct.pack("<I", 4))
    found = bag_reader._next_record(whole, 0, len(whole))
    assert (found.start, found.op) == (before, 5)
    assert bag_reader._next_record(whole, before + 1, len(whole)) is None
    index = junk + record(4, b"x" * 12, count=b"\1\0\0\0", ver=b"\1\0\0\0", conn=b"\0\0\0\0")
    assert bag_reader._next_record(index, 0, len(index)).op == 4
    assert bag_reader._next_record(index, 0, len(index) - 1) is None  # its data are cut


def test_numbers_are_little_endian():
    for value in (0, 1, 255, 256, 2**32 - 1, 2**40):
        assert bag_reader._number(value.to_bytes(8, "little")) == value
    assert bag_reader._number(b"") == 0 and bag_reader._number(bytes(8) + b"\1") == 0


def test_descriptions_of_a_topic_are_decided_by_most():
    claims = [("/a", "t/T", "m", "d"), ("/a", "t/X", None, "d"), ("/b", "t/T", None, None)]
    assert bag_reader._agreed(claims) == Connection("/a", "t/T", "m", "d")
    assert bag_reader._agreed([(None, None, None, None)]) == Connection("", "", "", "")


def test_rows_are_grouped_by_their_connection_in_their_order():
    rows = [np.array([[2, 10, 0], [1, 11, 0]]), np.array([[2, 5, 1], [7, 1, 1]])]
    found = bag_reader._by_connection(rows)
    assert {n: r.tolist() for n, r in found.items()} == {
        1: [[11, 0]], 2: [[10, 0], [5, 1]], 7: [[1, 1]],
    }  # fmt: skip
    assert bag_reader._by_connection([]) == {}


@pytest.mark.parametrize("seed", range(4))
def test_blocks_of_lz4_are_unpacked_as_by_the_library(seed):
    block = pytest.importorskip("lz4.block")
    random = np.random.default_rng(seed)
    parts = [random.integers(0, 256, n, np.uint8).tobytes() for n in (3, 40, 400)]
    text = b"".join(parts[i] * n for i, n in zip((0, 1, 2, 0, 1), (300, 5, 2, 1, 30)))
    packed = block.compress(text, store_size=False)
    unpacked = bytearray()
    assert bag_reader._unpack_block(packed, unpacked) and bytes(unpacked) == text
    for end in random.integers(1, len(packed), 20):
        part = bytearray()
        bag_reader._unpack_block(packed[:end], part)
        assert text.startswith(bytes(part))
    behind = bytearray(b"before")
    assert bag_reader._unpack_block(packed, behind) and bytes(behind) == b"before" + text
    assert not bag_reader._unpack_block(b"\x10a\x09\x00", bytearray())  # from before the begin


def message_record(connection, time, data):
    conn = struct.pack("<I", connection)
    stamp = struct.pack("<II", *divmod(time, 10**9))
    fields = b"".join(
        struct.pack("<I", len(entry)) + entry
        for entry in (b"op=\x02", b"conn=" + conn, b"time=" + stamp)
    )
    return struct.pack("<I", len(fields)) + fields + struct.pack("<I", len(data)) + data


def settled(found, index, change=lambda contents: contents):
    """What is left of messages (connection, time) of a chunk, by its index (connection, place, time)."""
    parts = [message_record(c, t, b"abc") for c, t in found]
    places = np.cumsum([0] + [len(p) for p in parts])[:-1]
    contents = change(b"".join(parts))
    reader = BagReader.__new__(BagReader)
    reader._contradictions, reader._data, records = 0, b"", []
    for connection in sorted({c for c, *_ in index}):
        data = b"".join(
            struct.pack("<III", *divmod(t, 10**9), places[at]) for c, at, t in index if c == connection
        )
        begin = len(reader._data)
        reader._data += data
        records.append(bag_reader.Record(4, {}, begin, begin, begin + len(data)))
    rows = []
    for match in bag_reader.MESSAGE.finditer(contents):
        connection, stamp, _ = match.groups()
        seconds, rest = struct.unpack("<II", stamp)
        time = seconds * 10**9 + rest
        rows.append([match.start(), struct.unpack("<I", connection)[0], time, match.end(), 3])
    left = reader._settled(contents, np.array(rows), records)
    return [(row[1], row[2]) for row in left.tolist()], reader._contradictions


SOUND = [(1, 10), (2, 20), (1, 30), (2, 40), (1, 50)]


def test_messages_and_their_index_are_reconciled():
    index = [(c, at, t) for at, (c, t) in enumerate(SOUND)]
    assert settled(SOUND, index) == (SOUND, 0)
    # A time that is wrong, in the message or in the index: the one nearer to the others is right.
    late = SOUND[:3] + [(2, 10**12)] + SOUND[4:]
    assert settled(late, index) == (SOUND, 1)
    assert settled(SOUND, [*index[:3], (2, 3, 10**12), index[4]]) == (SOUND, 1)
    # A message that the index has under another topic is left out, one that it does not have is kept.
    other = SOUND[:3] + [(1, 40)] + SOUND[4:]
    assert settled(other, index) == (SOUND[:3] + SOUND[4:], 1)
    assert settled(SOUND, index[:4]) == (SOUND, 1)


def test_a_cut_bag_says_what_is_missing_and_what_is_lost(tmp_path):
    import rosbag

    path = tmp_path / "run.bag"
    with rosbag.Bag(str(path), "w") as bag:  # one chunk
        for i in range(50):
            bag.write("/a", ros.new("std_msgs/String", data="%03d" % i * 20), ros.Time(10 + i, 0))
    whole = path.read_bytes()
    end = whole.index(b"025" * 20) + 30
    path.write_bytes(whole[:end])
    with BagReader(str(path)) as bag:
        found = [message.data[:3] for _, message, _ in bag.read_messages(["/a"])]
        (warning,) = bag.warnings
    assert found == ["%03d" % i for i in range(25)]
    assert re.search(r"\(\d+ bytes or more are missing at its end, \d+ bytes of messages", warning)


def test_bags_of_other_formats_are_refused(tmp_path):
    path = tmp_path / "x.bag"
    path.write_bytes(b"#ROSBAG V1.2\n" + bytes(50))
    with pytest.raises(GroundError, match="x.bag: a bag, but not of format 2.0: see rosbag fix"):
        BagReader(str(path))
    path.write_bytes(b"something else")
    with pytest.raises(GroundError, match="x.bag: not a bag$"):
        BagReader(str(path))


# --- messages of a topic at once


def points(count=6, kind="geometry_msgs/PointStamped"):
    found = []
    for i in range(count):
        message = ros.new(kind)
        message.header.stamp, message.header.frame_id = ros.Time(10 + i, 5), "ab"
        message.point.x, message.point.y, message.point.z = i, -i, 0.5
        found.append(serialized(message))
    return found


def batch_of(data, kind="geometry_msgs/PointStamped"):
    received = 10**9 * np.arange(1, 1 + len(data))
    return batches.gathered(kind, ros.known(kind), received, data)


def test_messages_become_rows_of_their_numbers():
    found = batch_of(points())
    values = found.values(["point.y", "point.x", "header.seq"])
    assert values.tolist() == [[-i, i, 0] for i in range(6)]
    assert found.stamps()[1].tolist() == [(10 + i) * 10**9 + 5 for i in range(6)]
    assert found.received.tolist() == [1, 2, 3, 4, 5, 6] and found.values(["point.q"]) is None
    one = batch_of(points(1))
    assert one.values(["point.z"]).tolist() == [[0.5]]


def test_messages_of_different_lengths_are_groups_of_their_own():
    data = points(5)
    other = ros.new("geometry_msgs/PointStamped")
    other.header.frame_id, other.point.x = "longer", 9.0
    found = batch_of(data[:2] + [serialized(other)] + data[2:])
    assert [group.at.tolist() for group in found.groups] == [[0, 1, 3, 4, 5], [2]]
    assert found.values(["point.x"])[:, 0].tolist() == [0, 1, 9, 2, 3, 4]


def test_unusual_messages_are_no_batch():
    data = points(5)
    changed = bytearray(data[3])
    changed[changed.index(b"ab")] = ord("x")  # another frame of the same length
    assert batch_of(data[:3] + [bytes(changed)]) is None
    assert batch_of([]) is None
    assert batch_of([d + b"\0" for d in data]) is None  # longer than their type
    assert batch_of([d[:-1] for d in data]) is None
    strings = [serialized(ros.new("std_msgs/String", data="a" * (i + 1))) for i in range(17)]
    assert batch_of(strings[:16], "std_msgs/String") is not None
    assert batch_of(strings, "std_msgs/String") is None  # too many layouts
    for length, is_laid_out in ((64, True), (65, False)):
        arrays = [serialized(ros.new("std_msgs/Float64MultiArray", data=[float(i)] * length)) for i in (1, 2)]
        found = batch_of(arrays, "std_msgs/Float64MultiArray")
        assert (found is not None) == is_laid_out
    assert batch_of(arrays[:1], "std_msgs/Float64MultiArray") is None


def pose_messages(count=30):
    random = np.random.default_rng(3)
    found = []
    for i, angle in enumerate(random.uniform(-3, 3, count)):
        message = ros.new("geometry_msgs/PoseStamped")
        message.header.stamp = ros.Time(10 + i, 7)
        position, turn = message.pose.position, message.pose.orientation
        position.x, position.y, position.z = random.normal(size=3)
        turn.z, turn.w = np.sin(angle / 2), np.cos(angle / 2)
        if i == 4:  # it lies on its side
            turn.x, turn.z = turn.z, 0.0
        found.append(message)
    return found


PLANAR = dict(position=("pose.position.x", "-pose.position.y"), heading="pose.orientation.z")


@pytest.mark.parametrize(
    "keys",
    [
        {},
        dict(heading_sign=-1),
        dict(unit="mm", scale=2.0),
        dict(heading_sign=-1, position=tuple("pose.position." + a for a in "xyz"),
             orientation=tuple("pose.orientation." + a for a in "xyzw")),
        dict(PLANAR, heading_unit="deg", heading_sign=-1, unit="cm"),
        dict(PLANAR, axes="x, -y, -z"),
        dict(PLANAR, heading_offset=0.3),
        dict(time=mapping.Clock("receipt")),
        dict(time=mapping.Clock("", "pose.position.z")),
    ],
)  # fmt: skip
@pytest.mark.parametrize("changes", [0, 1])
def test_poses_are_the_same_at_once_and_one_by_one(keys, changes):
    given, kind = mapping.Poses(**keys), "geometry_msgs/PoseStamped"
    taken = poses.takes(kind, given)
    every = [settings.Setting(0, "x, y, z", given.heading_offset or 0.0)]
    every += [settings.Setting(20 * 10**9, "x, -y, -z", 0.1)] * changes
    measured = settings.Settings(tuple(every), {"axes": "", "heading_offset": ""}, taken)
    sent = pose_messages()
    if keys.get("time") and keys["time"].field:
        for message in sent:
            message.pose.position.z = abs(message.pose.position.z)
    batch = batch_of([serialized(message) for message in sent], kind)
    together, alone = (poses.PoseReader("bag", kind, given, measured) for _ in range(2))
    found = together.of_batch(batch)
    rows = [pair for m, t in zip(sent, batch.received_ns) for pair in alone(m, ros.Time(0, 0) + Duration(t))]
    if found is None:  # some are converted one by one only
        assert given.time.field or given.heading and (changes or "axes" in keys or "heading_offset" in keys)
        assert len(rows) == len(sent)
        return
    table, valid = found
    assert valid.tolist() == [pose is not None for _, pose in rows]
    assert valid.all() == bool(given.heading)
    for row, (stamp, pose) in zip(table, rows):
        assert row[0] == stamp.to_sec()
        assert pose is None or np.allclose(row[1:], pose)
    assert np.allclose(together.raw, alone.raw)


def Duration(nanoseconds):
    import genpy

    return genpy.Duration(0, int(nanoseconds))


def test_commands_are_the_same_at_once_and_one_by_one():
    channels = (mapping.Channel("a", "point.y"), mapping.Channel("lift", "point.x"))
    for given in (mapping.Commands(), mapping.Commands(channels=channels)):
        readers_of = [
            commands.CommandReader("bag", "geometry_msgs/PointStamped", given) for _ in range(2)
        ]
        decode = ros.known("geometry_msgs/PointStamped").decode
        table = readers_of[0].of_batch(batch_of(points()))
        for row, data in zip(table, points()):
            stamp, values = readers_of[1](decode(data), None)
            assert row.tolist() == [stamp.to_sec(), *values]


# --- which files belong together


def touched(folder, *names):
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("a,b\n1,2\n")
    return str(folder)


def tables(poses="", commands=""):
    clock = mapping.Clock("", "t")
    return mapping.FieldMapping(
        mapping.Poses(file=poses, time=clock), mapping.Commands(file=commands, time=clock), file="M.yaml"
    )


def names(paths):
    return [os.path.basename(path) for path in paths]


def test_a_folder_is_the_recordings_in_it(tmp_path):
    folder = touched(tmp_path / "bags", "b.bag", "a.bag", "c.txt", "d.mcap", "e.csv", "ros2/metadata.yaml")
    assert names(readers.listed([folder, "x.bag"])) == ["a.bag", "b.bag", "d.mcap", "ros2", "x.bag"]
    assert readers.listed([folder + "/ros2"]) == [folder + "/ros2"]
    logs = touched(tmp_path / "logs", "1.csv", "2.csv", "3.parquet")
    assert readers.listed([logs]) == [logs]  # nothing says how to pair them
    assert names(readers.listed([logs], tables())) == ["1.csv", "2.csv", "3.parquet"]
    below = touched(tmp_path / "below", "run/1.csv")
    assert readers.listed([below]) == [below]
    with pytest.raises(GroundError, match="empty: there is no bag or bag of ROS 2 or table in this"):
        readers.listed([touched(tmp_path / "empty", "x.txt")])


def test_tables_are_paired_by_their_names(tmp_path):
    folder = touched(tmp_path / "runs", "pose_1.csv", "pose_2.csv", "cmd_1.csv", "cmd_2.csv", "cmd_3.csv")
    given = tables("pose_*", "cmd_*")
    assert names(readers.listed([folder], given)) == ["pose_1.csv", "pose_2.csv"]
    for name in ("pose_2.csv", "cmd_2.csv"):
        assert names(readers._pair(folder + "/" + name, given)) == ["pose_2.csv", "cmd_2.csv"]
    reader = readers.Table()
    assert names(reader.files(folder + "/pose_1.csv", given)) == ["pose_1.csv", "cmd_1.csv"]
    assert names(reader.files(folder + "/cmd_3.csv", tables())) == ["cmd_3.csv"]
    with pytest.raises(GroundError, match="names poses.file 'pose_.' and commands.file 'cmd_.', which fit 0"):
        readers._pair(folder + "/cmd_3.csv", given)
    single = touched(tmp_path / "single", "optitrack.csv", "log.csv")
    assert names(readers._pair(single, tables("opti*", "log*"))) == ["optitrack.csv", "log.csv"]
    assert readers.listed([single], tables("opti*", "log*")) == [single]
    parent = touched(tmp_path / "parent", "r1/p.csv", "r1/c.csv", "r2/p.csv", "r2/c.csv")
    assert names(readers.listed([parent], tables("p*", "c*"))) == ["r1", "r2"]


def test_files_that_no_reader_takes_are_named(tmp_path):
    folder = touched(tmp_path, "x.txt", "sub/y.txt")
    with pytest.raises(GroundError, match="none.bag: no such file"):
        readers.reader_of(folder + "/none.bag")
    with pytest.raises(GroundError, match="x.txt: not a bag or a bag of ROS 2 or a table$"):
        readers.reader_of(folder + "/x.txt")
    with pytest.raises(GroundError, match="sub: a folder, not a bag or a .* table; name the files in it"):
        readers.reader_of(folder + "/sub")
    with pytest.raises(GroundError, match="none.bag: no such file"):
        recording.read_settings(folder + "/none.bag")
    with pytest.raises(GroundError, match="none.bag: no such file"):
        recording.read_files(folder + "/none.bag")
    assert readers.size(folder) == os.path.getsize(folder + "/x.txt")
    assert readers.size(folder + "/none") == 0 and readers.size(folder + "/x.txt") == 8
    with pytest.raises(GroundError, match="--write-mapping M.yaml drafts a mapping"):
        readers.read(touched(tmp_path / "t", "a.csv") + "/a.csv")


def test_settings_and_files_of_a_bag_can_be_read_alone(tmp_path):
    path = str(write_bag(tmp_path / "run.bag", duration=3))
    assert recording.read_settings(path).changes[0].heading_offset == 0
    assert recording.read_files(path) == {}
    (tmp_path / "run.yaml").write_text(
        "ns: {mocap_state: {axes: 'x, -y, -z', heading_offset: 0.25}}\n"
        "controller: {model: /x/craft.yaml, kind: Tracking}\nrun_files: {/x/craft.yaml: 'a: 1'}\n"
    )
    found = recording.read_settings(path)
    assert (found.changes[0].axes, found.changes[0].heading_offset) == ("x, -y, -z", 0.25)
    assert found.sources["axes"] == "recorded in run.yaml"
    assert recording.read_files(path)["model"].entries() == {"a": 1}
    assert names(readers.files(path)) == ["run.bag", "run.yaml"]
    for part in ("run_0.bag", "run_12.bag.active"):
        assert names(run_parameters.paths_beside(str(tmp_path / part))) == ["run.yaml"]
    (tmp_path / "run.yaml").write_text("a: [")
    warnings = []
    assert list(run_parameters.beside(path, warnings)) == []
    assert "run.yaml: cannot be read, so that axes and heading_offset are the" in warnings[0]


def test_the_share_that_has_been_read_is_told():
    class Source:
        warnings = []

        def get_type_and_topic_info(self):
            return bag_reader.Topics({"/a": bag_reader.Topic("t", 6000), "/b": bag_reader.Topic("t", 9)})

        def read_messages(self, topics):
            for i in range(6000 if "/a" in topics else 9):
                yield "/a", i, None

        def batch(self, topic):
            return topic

    told = []
    source = messages.Told(Source(), told.append)
    assert [m for _, m, _ in source.read_messages(["/a"])] == list(range(6000))
    assert told == pytest.approx([0, 1 / 6, 2 / 6, 3 / 6, 4 / 6, 5 / 6])
    told.clear()
    assert len(list(source.read_messages(["/b"]))) == 9 and told == []  # quickly read
    assert source.batch("/a") == "/a" and messages.topics_of(source, "t") == ["/a", "/b"]
    assert messages.announced(source, "t") and not messages.announced(source, "u")


# --- the cache


def test_files_of_a_run_are_kept_and_placed(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_HOME", str(tmp_path / "home"))
    craft, room = tmp_path / "craft.yaml", tmp_path / "room.yaml"
    craft.write_text("a: 1\nb: 2\n")
    room.write_text("x" * (run_parameters.LARGEST + 1))
    given = {"ns": {"controller": {"model": str(craft), "room": str(room)}, "n": {"model": "/none.yaml"}}}
    loaded = yaml.safe_load(run_parameters.document(given))
    assert loaded == {**given, "run_files": {str(craft): "a: 1\nb: 2\n"}}  # without what is too large
    assert run_parameters.contents({"controller": {"model": 3}}) == ""
    assert list(run_parameters.nodes(given, "controller")) == [given["ns"]["controller"]]
    file = flown.RunFile(str(craft), "a: 1\nb: 2\n")
    assert file.place() == str(craft) and file.describe()["title"] == "craft.yaml"
    craft.write_text("a: 3\n")  # it has changed since the run
    copy = file.place()
    assert copy != str(craft) and copy.startswith(str(tmp_path / "home")) and open(copy).read() == file.text
    assert file.place() == copy
    assert flown.RunFile(str(craft), "name: Small\n").describe()["title"] == "Small"
