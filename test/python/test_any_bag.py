"""Bags of other people: own types, other encodings, killed recorders, files that are cut."""

import math
import shutil
import sqlite3
import struct
import warnings

import numpy as np
import pytest

import ground
from conftest import identify, succeeds
from containers import Z_UP, Ros2, experiment, in_mocap, write_bag
from ground.reading import bags, definitions, streams

pytest.importorskip("rosbags")

HEAD = "schema: ground/mapping/1\n"
VALVES = HEAD + (
    'poses: {topic: /mocap/pose, axes: "x, -y, -z"}\n'
    "commands:\n  topic: /robot/valves\n"
    'channels:\n    a: {field: "switches[0]"}\n    b: {field: "switches[1]"}\n'
).replace("channels", "  channels")
VECTOR = HEAD + (
    'poses: {topic: /mocap/pose, axes: "x, -y, -z"}\n'
    "commands:\n  topic: /cmd\n"
    "  channels: {left: {field: vector.x}, right: {field: vector.y}, lift: {field: vector.z}}\n"
)
DEFINITION = "# valves that are open\nstd_msgs/Header header\nbool[8] switches\n"


def poses_in(bag, duration=8.0):
    """Writes the poses of an experiment to a bag of ROS 2; returns its commands."""
    poses, commands = experiment(duration)
    for stamp, eta in poses:
        message = bag.new(
            "geometry_msgs/PoseStamped", header=bag.header(stamp), pose=bag.pose(in_mocap(eta, Z_UP))
        )
        bag.write("/mocap/pose", stamp, message)
    return commands


def vectors_in(bag, commands):
    for stamp, values in commands:
        vector = bag.vector("geometry_msgs/Vector3", values)
        kind = "geometry_msgs/Vector3Stamped"
        bag.write("/cmd", stamp, bag.new(kind, header=bag.header(stamp), vector=vector))


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """A bag of ROS 2, and its recording."""
    folder = tmp_path_factory.mktemp("sound")
    bag = Ros2(folder / "run", "sqlite3")
    vectors_in(bag, poses_in(bag))
    (folder / "m.yaml").write_text(VECTOR)
    (run,) = ground.read(bag.close(), mapping=folder / "m.yaml")
    return folder / "run", folder / "m.yaml", run


def valves(path, metadata=True):
    """A bag of ROS 2 before Iron: it holds no definitions. Every command opens other valves of eight."""
    bag = Ros2(path, "sqlite3")
    commands = poses_in(bag)
    bag.close()
    (file,) = path.glob("*.db3")
    with sqlite3.connect(str(file)) as data:
        data.execute("DELETE FROM message_definitions")
        topic = "INSERT INTO topics VALUES(9, '/robot/valves', 'ff_msgs/msg/Valves', 'cdr', '', '')"
        data.execute(topic)
        for number, (stamp, _) in enumerate(commands):
            switches = [number >> i & 1 for i in range(8)]
            content = struct.pack("<4xiII1sxxx", *divmod(stamp, 10**9), 1, b"\0")[:17] + bytes(switches)
            data.execute(
                "INSERT INTO messages(topic_id, timestamp, data) VALUES(9, ?, ?)",
                (stamp + 10**6, b"\0\1" + content[2:] + bytes(-len(content) % 4)),
            )
    data.close()
    (path / "metadata.yaml").unlink()
    return file, commands


@pytest.fixture(scope="module")
def own_type(tmp_path_factory):
    folder = tmp_path_factory.mktemp("own_type")
    file, commands = valves(folder / "run")
    (folder / "m.yaml").write_text(VALVES)
    package = folder / "src" / "ff_msgs" / "msg"
    package.mkdir(parents=True)
    (package / "Valves.msg").write_text(DEFINITION)
    return folder, file, commands


def test_a_type_without_a_definition_is_named_with_what_helps(own_type, tmp_path):
    folder, file, _ = own_type
    refused = identify("info", file, "--mapping", folder / "m.yaml")
    assert refused.returncode == 1 and refused.stderr.count("\n") == 1
    for word in ("/robot/valves", "ff_msgs/Valves", "--types", "types in a mapping"):
        assert word in refused.stderr
    assert "definition is not in the file: give it by --types" in identify("info", file).stderr
    draft = tmp_path / "draft.yaml"
    succeeds("info", file, "--write-mapping", draft)
    assert "/robot/valves (ff_msgs/Valves)" in draft.read_text()


@pytest.mark.parametrize("given", ["src", "src/ff_msgs/msg", "src/ff_msgs/msg/Valves.msg"])
def test_definitions_of_types_are_files_or_folders(own_type, given):
    folder, file, commands = own_type
    (run,) = ground.read(file, mapping=folder / "m.yaml", types=folder / given)
    assert run.control_times == pytest.approx([stamp / 1e9 for stamp, _ in commands], abs=1e-9)
    numbers = np.arange(len(commands))
    assert np.array_equal(run.controls[:, :2], np.column_stack([numbers & 1, numbers >> 1 & 1]))


def test_a_draft_names_the_definitions_for_later(own_type, tmp_path):
    folder, file, commands = own_type
    draft = folder / "draft.yaml"
    succeeds("info", file, "--types", folder / "src", "--write-mapping", draft, "--force")
    assert "switches[6]" in draft.read_text()
    (run,) = ground.read(file, mapping=draft)
    assert len(run.controls) == len(commands)


@pytest.mark.parametrize("is_late, clock", [(True, ""), (False, ""), (True, "receipt")])
def test_commands_that_came_late_are_said(own_type, tmp_path, is_late, clock):
    folder, file, commands = own_type
    shutil.copy(file, tmp_path / "run.db3")
    if is_late:  # one command is 0.3 s under way
        with sqlite3.connect(str(tmp_path / "run.db3")) as data:
            late = "UPDATE messages SET timestamp = timestamp + 300000000 WHERE topic_id = 9 "
            late += "AND timestamp = ?"
            data.execute(late, (commands[20][0] + 10**6,))
        data.close()
    mapping = VALVES + ("  time: receipt\n" if clock else "")
    (tmp_path / "m.yaml").write_text(mapping)
    (run,) = ground.read(tmp_path / "run.db3", mapping=tmp_path / "m.yaml", types=folder / "src")
    said = [w for w in run.warnings if "came late, by up to 0.3 s" in w and "time: receipt" in w]
    assert len(said) == (is_late and not clock)


WRONG = [
    "std_msgs/Header header\nfloat32[2] switches",
    "std_msgs/Header header\nint32[2] switches",
    "std_msgs/Header header\nbool[6] switches",
    "std_msgs/Header header\nbool[] switches",
    "std_msgs/Header header\nfloat64[8] switches",
    "bool[8] switches\nstd_msgs/Header header",
    "bool[8] switches",
    "std_msgs/Header header\nstring switches",
]


@pytest.mark.parametrize("text", WRONG)
def test_a_wrong_definition_is_noticed(own_type, tmp_path, text):
    folder, file, _ = own_type
    (tmp_path / "Valves.msg").write_text(text + "\n")
    with pytest.raises(ground.GroundError, match="/robot/valves: .*Valves.msg"):
        ground.read(file, mapping=folder / "m.yaml", types=tmp_path)


@pytest.mark.parametrize(
    "text, message",
    [
        ("std_msgs/Header header\nWheel[2] wheels\n", "needs ff_msgs/Wheel"),
        ("std_msgs/Header header\nbool[8\n", "Valves.msg: not a type definition"),
    ],
)
def test_a_definition_that_lacks_something_is_named(own_type, tmp_path, text, message):
    folder, file, _ = own_type
    (tmp_path / "Valves.msg").write_text(text)
    with pytest.raises(ground.GroundError, match=message):
        ground.read(file, mapping=folder / "m.yaml", types=tmp_path)
    with pytest.raises(ground.GroundError, match="no such file"):
        ground.read(file, mapping=folder / "m.yaml", types=tmp_path / "none")


def test_a_hash_of_another_definition_is_noticed(tmp_path):
    """Bags since Iron have hashes of their types; here the order of two fields has changed."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg("float64 x\nfloat64 y\n", "own_msgs/msg/Two"))
    stream = streams.Stream(
        0, "/two", "own_msgs/msg/Two", "cdr", digest=store.hash_rihs01("own_msgs/msg/Two")
    )
    for text in ("float64 x\nfloat64 y\n", "float64 y\nfloat64 x\n"):
        (tmp_path / "Two.msg").write_text(text)
        given = definitions.Definitions([str(tmp_path)])
        types = definitions.types_of(stream, given)
        if text.startswith("float64 x"):
            definitions.check_digest(stream, types, "Two.msg")
        else:
            with pytest.raises(ground.GroundError, match="hash of another definition"):
                definitions.check_digest(stream, types, "Two.msg")


def same(found, wanted, share=1.0):
    """Whether a recording is the beginning of another one, of at least a share."""
    count = len(found.eta)
    assert share * len(wanted.eta) <= count <= len(wanted.eta)
    assert found.eta == pytest.approx(wanted.eta[:count], abs=1e-12)
    assert np.array_equal(found.controls, wanted.controls[: len(found.controls)])


def mcap_file(path, profile="ros2", compression=None, channel=lambda topic, kind: ("ros2msg", "", "cdr")):
    """An MCAP writer with chunks of 20 kB, and a function that writes a message."""
    from mcap.writer import CompressionType, Writer

    kind = getattr(CompressionType, (compression or "none").upper())
    file = open(path, "wb")
    writer = Writer(file, chunk_size=20000, compression=kind)
    writer.start(profile, "test")
    known = {}

    def write(topic, kind, stamp, data):
        if topic not in known:
            form, text, encoding = channel(topic, kind)
            schema = writer.register_schema(kind, form, text if isinstance(text, bytes) else text.encode())
            known[topic] = writer.register_channel(topic, encoding, schema)
        writer.add_message(known[topic], stamp, data, stamp)

    def close():
        writer.finish()
        file.close()

    return write, close


def cdr_in(path, compression=None, form="ros2msg", profile="ros2", received=lambda stamp: stamp):
    """The experiment in an MCAP file of ROS 2. received: the time of receipt of a stamp [ns]."""
    bag = Ros2(path.parent / "unused", "mcap")
    vectors_in(bag, poses_in(bag))

    def definition(topic, kind):
        text = bag.store.generate_msgdef(kind, ros_version=2)[0]
        return form, text, "cdr"

    write, close = mcap_file(path, profile, compression, definition)
    for stamp, topic, message in sorted(bag.rows, key=lambda row: row[0]):
        kind = message.__msgtype__
        write(topic, kind, received(stamp), bytes(bag.store.serialize_cdr(message, kind)))
    close()
    return path


@pytest.mark.parametrize("compression", [None, "zstd", "lz4"])
@pytest.mark.parametrize("share", [1.0, 0.9, 0.5, 0.2])
def test_a_cut_mcap_is_read_as_far_as_it_goes(sound, tmp_path, compression, share):
    pytest.importorskip("mcap")
    _, mapping, wanted = sound
    file = cdr_in(tmp_path / "run.mcap", compression)
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    (found,) = ground.read(file, mapping=mapping)
    same(found, wanted, share - 0.2)
    is_whole = len(found.eta) == len(wanted.eta)
    assert is_whole or "not closed" in " ".join(found.warnings)


def test_a_chunk_of_mcap_with_a_wrong_checksum_is_left_out(sound, tmp_path):
    pytest.importorskip("mcap")
    _, mapping, wanted = sound
    file = cdr_in(tmp_path / "run.mcap")
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data[:-8])  # not closed, so that its chunks are scanned
    (found,) = ground.read(file, mapping=mapping)
    assert set(found.pose_times) < set(wanted.pose_times)
    assert "chunks that cannot be unpacked were left out (1)" in " ".join(found.warnings)


def test_messages_whose_time_of_receipt_is_damaged_are_left_out(sound, tmp_path):
    pytest.importorskip("mcap")
    _, mapping, wanted = sound
    damaged = experiment()[0][40][0]
    file = cdr_in(tmp_path / "run.mcap", received=lambda stamp: 2**63 if stamp == damaged else stamp)
    (found,) = ground.read(file, mapping=mapping)
    assert 0 < len(wanted.pose_times) - len(found.pose_times) < 3
    assert "received after the year 2262 were left out (1)" in " ".join(found.warnings)


def test_messages_of_ros1_in_mcap(sound, tmp_path):
    pytest.importorskip("mcap")
    import io

    import rosbag
    from geometry_msgs.msg import PoseStamped, Vector3Stamped

    _, mapping, wanted = sound
    poses, commands = experiment()
    rows = []
    for stamp, eta in poses:
        message = PoseStamped()
        position, turn = in_mocap(eta, Z_UP)
        message.pose.position.x, message.pose.position.y, message.pose.position.z = position
        for name, value in zip("xyzw", turn):
            setattr(message.pose.orientation, name, value)
        rows.append(("/mocap/pose", stamp, message))
    for stamp, values in commands:
        message = Vector3Stamped()
        message.vector.x, message.vector.y, message.vector.z = map(float, values)
        rows.append(("/cmd", stamp, message))
    write_bag(tmp_path / "run.bag", rows)
    texts = {m._type: m._full_text for m in (PoseStamped, Vector3Stamped)}
    write, close = mcap_file(
        tmp_path / "run.mcap", "ros1", "lz4", lambda _, kind: ("ros1msg", texts[kind], "ros1")
    )
    with rosbag.Bag(str(tmp_path / "run.bag")) as bag:
        for topic, message, time in bag.read_messages():
            buffer = io.BytesIO()
            message.serialize(buffer)
            write(topic, message._type, time.to_nsec(), buffer.getvalue())
    close()
    (found,) = ground.read(tmp_path / "run.mcap", mapping=mapping)
    same(found, wanted)
    assert found.warnings == []


@pytest.mark.parametrize("form, encoding", [("jsonschema", "json"), ("protobuf", "protobuf")])
def test_an_encoding_that_is_not_read_is_named(tmp_path, form, encoding):
    pytest.importorskip("mcap")
    write, close = mcap_file(tmp_path / "run.mcap", "", None, lambda *_: (form, b"\1", encoding))
    write("/p", "own.Planar", 1, b"abc")
    close()
    with bags.Bag(str(tmp_path / "run.mcap")) as bag:
        with pytest.raises(ground.GroundError, match="'%s' .* mcap cat .* --topics /p --json" % encoding):
            bag.table("/p")


def test_a_file_without_its_description_is_read_with_a_warning(sound, tmp_path):
    source, mapping, wanted = sound
    (tmp_path / "run_0.db3").write_bytes(next(source.glob("*.db3")).read_bytes())
    for path in (tmp_path, tmp_path / "run_0.db3"):
        (found,) = ground.read(path, mapping=mapping)
        same(found, wanted)
        assert "no metadata.yaml" in found.warnings[0]


@pytest.mark.parametrize("metadata", ["", "rosbag2_bagfile_information:\n  version: 5\n  storage_id"])
def test_pieces_of_a_bag_without_a_sound_description_are_one(sound, tmp_path, metadata):
    source, mapping, wanted = sound
    data = next(source.glob("*.db3")).read_bytes()
    middle = int(1e9 * wanted.pose_times[400])
    for number, sign in enumerate(("<", ">=")):
        file = tmp_path / ("run_%d.db3" % number)
        file.write_bytes(data)
        with sqlite3.connect(str(file)) as piece:
            piece.execute("DELETE FROM messages WHERE NOT timestamp %s ?" % sign, [middle])
        piece.close()
    if metadata:
        (tmp_path / "metadata.yaml").write_text(metadata)
    (found,) = ground.read(tmp_path, mapping=mapping)
    same(found, wanted)
    assert "run_0.db3, run_1.db3 as one bag" in found.warnings[0]


def test_a_cut_file_of_sqlite_is_refused_with_what_saves_it(sound, tmp_path):
    source, mapping, _ = sound
    file = tmp_path / "run_0.db3"
    data = next(source.glob("*.db3")).read_bytes()
    file.write_bytes(data[: len(data) // 2])
    with pytest.raises(ground.GroundError, match="sqlite3 %s .recover" % file):
        ground.read(file, mapping=mapping)


def test_what_sqlite_keeps_beside_a_file_is_read(sound, tmp_path):
    """The recorder was killed: its last messages are in the log."""
    source, mapping, wanted = sound
    recorded = tmp_path / "live.db3"
    recorded.write_bytes(next(source.glob("*.db3")).read_bytes())
    last = int(1e9 * wanted.pose_times[600])
    live = sqlite3.connect(str(recorded))
    live.execute("PRAGMA journal_mode=WAL")
    rows = live.execute(
        "SELECT topic_id, timestamp, data FROM messages WHERE timestamp >= ?", [last]
    ).fetchall()
    live.execute("DELETE FROM messages WHERE timestamp >= ?", [last])
    live.commit()
    live.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    live.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", rows)
    live.commit()
    (tmp_path / "killed").mkdir()
    for end in ("", "-wal"):
        (tmp_path / "killed" / ("run_0.db3" + end)).write_bytes((tmp_path / ("live.db3" + end)).read_bytes())
    live.close()
    (found,) = ground.read(tmp_path / "killed", mapping=mapping)
    same(found, wanted)
    assert "not closed" in found.warnings[0]


def test_topics_without_messages_are_listed_and_do_no_harm(sound, tmp_path):
    source, mapping, wanted = sound
    file = tmp_path / "run_0.db3"
    file.write_bytes(next(source.glob("*.db3")).read_bytes())
    with sqlite3.connect(str(file)) as data:
        data.execute(
            "INSERT INTO topics VALUES(9, '/other/pose', 'geometry_msgs/msg/PoseStamped', 'cdr', '', '')"
        )
        data.execute("INSERT INTO topics VALUES(10, '/odd', 'own_msgs/msg/Odd', 'cdr', '', '')")
    data.close()
    (found,) = ground.read(file, mapping=mapping)
    same(found, wanted)
    draft = tmp_path / "draft.yaml"
    succeeds("info", file, "--write-mapping", draft)
    assert "/odd (own_msgs/Odd), without messages" in draft.read_text()


def test_a_bag_of_a_killed_recorder_is_found_in_its_folder(tmp_path):
    from conftest import write_bag as write_ros1

    write_ros1(tmp_path / "run.bag", duration=3)
    (tmp_path / "run.bag").rename(tmp_path / "run.bag.active")
    (run,) = ground.read(tmp_path)
    assert len(run.eta) > 200


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["mcap", "db3", "bag"])
def test_damage_anywhere_is_read_or_refused_in_a_sentence(sound, tmp_path, kind, seed):
    source, mapping, _ = sound
    path = tmp_path / ("run." + kind)
    if kind == "mcap":
        cdr_in(path, [None, "zstd", "lz4"][seed % 3])
    elif kind == "db3":
        path.write_bytes(next(source.glob("*.db3")).read_bytes())
    else:
        from conftest import write_bag as write_ros1

        write_ros1(path, duration=2)
    random = np.random.default_rng(seed)
    data = bytearray(path.read_bytes())
    for at in random.integers(0, len(data), 1 + seed // 3):
        size = int(random.integers(1, 100))
        data[at : at + size] = random.bytes(size)
    path.write_bytes(data)
    try:
        ground.read(path, mapping=None if kind == "bag" else mapping)
    except ground.GroundError as error:
        assert str(path) in str(error)


@pytest.mark.parametrize("name", ["run.mcap", "run_0.db3", "run.bag"])
@pytest.mark.parametrize(
    "content", [b"", b"x" * 1000, b"\x89MCAP0\r\n", b"#ROSBAG V2.0\n", b"SQLite format 3\0" + bytes(2000)]
)
def test_a_file_that_is_no_bag_is_refused_in_a_sentence(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    refused = identify("info", tmp_path / name)
    assert refused.returncode == 1 and refused.stderr.count("\n") == 1
    assert "unexpected" not in refused.stderr and name in refused.stderr


def ulog(path, formats, rows):
    """A log of PX4. formats: fields by message; rows: stamp [ns], number of the message, further content."""
    parts = [(b"F", b"%s:%s" % (name.encode(), fields.encode())) for name, fields in formats.items()]
    parts += [(b"A", struct.pack("<BH", 0, i) + name.encode()) for i, name in enumerate(formats)]
    for stamp, number, data in sorted(rows, key=lambda row: row[0]):
        parts.append((b"D", struct.pack("<HQ", number, stamp // 1000) + data))
    content = b"".join(struct.pack("<H", len(data)) + kind + data for kind, data in parts)
    path.write_bytes(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + content)
    return path


def test_a_log_of_px4_is_read(tmp_path):
    pytest.importorskip("pyulog")
    poses, commands = experiment()
    formats = {
        "vehicle_local_position": "uint64_t timestamp;float x;float y;float heading;bool xy_valid;",
        "actuator_outputs": "uint64_t timestamp;float[4] output;",
    }
    rows = [(stamp, 0, struct.pack("<3f?", *eta, True)) for stamp, eta in poses]
    rows += [(stamp, 1, struct.pack("<4f", *(1000 + 1000 * values), 0)) for stamp, values in commands]
    log = ulog(tmp_path / "flight.ulg", formats, rows)
    draft = tmp_path / "draft.yaml"
    succeeds("info", tmp_path, "--write-mapping", draft)
    (run,) = ground.read(log, mapping=draft)
    eta = np.array([eta for _, eta in poses])
    assert run.eta[:, :2] == pytest.approx(eta[:, :2], abs=1e-5)
    assert run.pose_times == pytest.approx([stamp / 1e9 for stamp, _ in poses], abs=1e-6)
    assert run.controls[:, :3] == pytest.approx(np.array([values for _, values in commands]), abs=1e-5)
    (tmp_path / "cut.ulg").write_bytes(log.read_bytes()[:30])
    refused = identify("info", tmp_path / "cut.ulg")
    assert refused.returncode == 1 and "unexpected" not in refused.stderr


RESETS = """
schema: ground/mapping/1
poses: {topic: vehicle_local_position, position: {fields: [x, y]}, heading: {field: heading}}
commands: {topic: motors, channels: {left: {field: "u[0]"}, right: {field: "u[1]"}, lift: {field: "u[2]"}}}
"""


@pytest.mark.parametrize("seed", range(3))
def test_resets_of_the_estimator_are_undone_by_their_counters(seed, tmp_path):
    """Of positions and headings, at any times and of any size, by counters of 8 bits that begin anywhere."""
    pytest.importorskip("pyulog")
    random, (poses, commands) = np.random.default_rng(seed), experiment()
    turns, moves = (np.sort(random.choice(np.arange(1, len(poses)), n)) for n in random.integers(0, 5, 2))
    counts = random.integers(0, 256, 2)
    delta, shift, rows = np.zeros(3), np.zeros(3), []
    for i, (stamp, eta) in enumerate(poses):
        for at, part in ((moves, slice(0, 2)), (turns, slice(2, 3))):
            if i in at:
                delta[part] = random.normal(0, 1, delta[part].shape)
                shift[part] += delta[part]
                counts[part.start // 2] += 1
        told = [eta[0] + shift[0], eta[1] + shift[1], math.remainder(eta[2] + shift[2], 2 * math.pi)]
        rows.append((stamp, 0, struct.pack("<6f2B", *told, *delta, *(counts % 256))))
    rows += [(stamp, 1, struct.pack("<3f", *values)) for stamp, values in commands]
    formats = {
        "vehicle_local_position": "uint64_t timestamp;float x;float y;float heading;float[2] delta_xy;"
        "float delta_heading;uint8_t xy_reset_counter;uint8_t heading_reset_counter;",
        "motors": "uint64_t timestamp;float[3] u;",
    }
    log = ulog(tmp_path / "flight.ulg", formats, rows)
    (tmp_path / "m.yaml").write_text(RESETS)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        (run,) = ground.read(log, mapping=tmp_path / "m.yaml")
    eta = np.array([eta for _, eta in poses])
    assert run.eta[:, :2] == pytest.approx(eta[:, :2], abs=1e-5)
    assert np.exp(1j * run.eta[:, 2]) == pytest.approx(np.exp(1j * eta[:, 2]), abs=1e-5)
    text = " ".join(str(one.message) for one in caught)
    for at, name in ((moves, "xy_reset_counter"), (turns, "heading_reset_counter")):
        assert (name in text) == bool(len(at))
        for i in at[:1]:
            assert "%.2f s" % (1e-9 * poses[i][0]) in text


IDL = """module own_msgs { module msg {
  typedef boolean boolean__8[8];
  struct Valves { std_msgs::msg::Header header; boolean__8 switches; sequence<double> rest; };
}; };
"""


@pytest.mark.parametrize("is_cut", [False, True])
def test_definitions_in_idl_are_read(tmp_path, is_cut):
    pytest.importorskip("mcap")
    text = "=" * 80 + "\nIDL: own_msgs/msg/Valves\n" + IDL
    write, close = mcap_file(tmp_path / "run.mcap", "ros2", "lz4", lambda *_: ("ros2idl", text, "cdr"))
    for i in range(3):
        content = struct.pack("<IIi2s2x8B", i, 5, 2, b"m\0", *(j == i for j in range(8)))
        content = content[:14] + content[16:]  # flags follow the text at once
        content += bytes(-len(content) % 4) + struct.pack("<I", 1)
        content += bytes(-len(content) % 8) + struct.pack("<d", 0.5 * i)
        write("/valves", "own_msgs/msg/Valves", 10**9 + i, b"\0\1\0\0" + content)
    close()
    file = tmp_path / "run.mcap"
    file.write_bytes(file.read_bytes()[: -30 if is_cut else None])
    with bags.Bag(str(file)) as bag:
        found = bag.table("/valves")
    assert [found["switches[%d]" % i].tolist() for i in range(3)] == np.eye(3).tolist()
    assert found["rest[0]"].tolist() == [0, 0.5, 1.0]
    assert found["header.stamp"].tolist() == [5, 10**9 + 5, 2 * 10**9 + 5]
