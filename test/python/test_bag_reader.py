"""Cut or damaged bags are read as far as possible, with a warning that says what is lost."""

import bz2
import io

import numpy as np
import pytest
from conftest import MODEL, write_bag

import rosbag
from ground import cli
from ground.errors import GroundError
from ground.recordings import bag_reader, codecs, recording, topics

KINDS = {
    "plain": dict(),
    "bz2": dict(compression="bz2"),
    "lz4": dict(compression="lz4"),
    "small": dict(compression="lz4", chunk_threshold=topics.CHUNK),
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A folder with one run in bags of every kind, messages in the order of receipt. All kinds except
    `small` have a single chunk."""
    folder = tmp_path_factory.mktemp("whole")
    source = write_bag(folder / "source.bag", duration=7, seed=2)
    with rosbag.Bag(str(source)) as bag:
        messages = list(bag.read_messages())
    for name, options in KINDS.items():
        with rosbag.Bag(str(folder / (name + ".bag")), "w", **options) as bag:
            for topic, message, time in messages:
                bag.write(topic, message, time)
    return folder


def read(path):
    """Topic, serialized contents and time of all messages, and the warnings."""
    with bag_reader.BagReader(str(path)) as bag:
        topics = list(bag.get_type_and_topic_info().topics)
        return listed(bag.read_messages(topics)), bag.warnings


def listed(messages):
    found = []
    for topic, message, time in messages:
        buffer = io.BytesIO()
        message.serialize(buffer)
        found.append((topic, buffer.getvalue(), time.to_nsec()))
    return found


def chunk_span(path):
    """Offsets in the file at which the chunks begin and end."""
    with rosbag.Bag(path) as bag:
        return min(bag._chunk_headers), bag._index_data_pos


@pytest.mark.parametrize("kind", list(KINDS))
def test_a_sound_bag_reads_as_with_rosbag(whole, kind):
    path = whole / (kind + ".bag")
    with rosbag.Bag(str(path)) as bag:
        wanted = listed(bag.read_messages())
    found, warnings = read(path)
    assert found == wanted and not warnings


@pytest.mark.parametrize("kind", ["plain", "lz4", "small"])
@pytest.mark.parametrize("share", [0.15, 0.4, 0.65, 0.9])
def test_a_bag_cut_anywhere_gives_what_is_before_the_cut(tmp_path, whole, kind, share):
    path = whole / (kind + ".bag")
    data = path.read_bytes()
    begin, end = chunk_span(str(path))
    cut = tmp_path / "cut.bag"
    cut.write_bytes(data[: int(begin + share * (end - begin))])
    wanted = read(path)[0]
    found, warnings = read(cut)
    assert found == wanted[: len(found)]
    # The cut loses at most the last chunk.
    assert (share - 0.2) * len(wanted) < len(found) <= len(wanted)
    assert "as far as it goes" in warnings[0] and "bytes" in warnings[0]
    recording.read_bag(str(cut))


@pytest.mark.parametrize("kind", list(KINDS))
def test_a_bag_cut_inside_its_index_has_all_its_messages(tmp_path, whole, kind):
    path = whole / (kind + ".bag")
    data = path.read_bytes()
    end = chunk_span(str(path))[1]
    cut = tmp_path / "cut.bag"
    for keep in (end, (end + len(data)) // 2, len(data) - 1):
        cut.write_bytes(data[:keep])
        found, warnings = read(cut)
        assert found == read(path)[0]
        assert "no message" in warnings[0] and len(warnings) == 1


def test_a_bag_whose_recorder_was_killed_is_read(tmp_path, whole):
    """Its last chunk has no length, and its header has no offset of the index."""
    path, active = whole / "plain.bag", tmp_path / "run.bag.active"
    bag = rosbag.Bag(str(active), "w", chunk_threshold=20000)
    with rosbag.Bag(str(path)) as source:
        for topic, message, time in source.read_messages():
            bag.write(topic, message, time)
    bag._file.flush()
    found, warnings = read(active)
    assert found == read(path)[0] and "was not closed" in warnings[0]


@pytest.mark.parametrize("kind", list(KINDS))
def test_a_damaged_bag_is_read_except_for_the_damaged_part(tmp_path, whole, kind):
    path = whole / (kind + ".bag")
    data = bytearray(path.read_bytes())
    wanted = set(read(path)[0])
    random = np.random.default_rng(5)
    begin, end = chunk_span(str(path))
    damaged = tmp_path / "damaged.bag"
    for _ in range(6):
        at = int(random.integers(begin, end))
        flipped = bytearray(data)
        flipped[at : at + 20] = bytes(20)
        damaged.write_bytes(flipped)
        found, warnings = read(damaged)
        if kind == "small":
            assert len(wanted - set(found)) < 0.2 * len(wanted)
            assert set(found) <= wanted, set(found) - wanted
        if kind == "plain":
            assert len(wanted - set(found)) <= 2
        assert warnings or set(found) == wanted or kind == "plain"


def test_a_flipped_bit_in_a_header_is_noticed(tmp_path, whole):
    """Flips every seventh bit of the first message's header in turn."""
    path = whole / "plain.bag"
    data = path.read_bytes()
    wanted = read(path)[0]
    message = bag_reader.MESSAGE.search(data)
    damaged = tmp_path / "damaged.bag"
    for bit in range(0, 8 * (message.end() - message.start()), 7):
        flipped = bytearray(data)
        flipped[message.start() + bit // 8] ^= 1 << bit % 8
        damaged.write_bytes(flipped)
        found, warnings = read(damaged)
        assert warnings and len(set(wanted) - set(found)) <= 1, bit


def test_two_types_on_one_topic_are_named(tmp_path, whole, capsys):
    from std_msgs.msg import Float64

    path = tmp_path / "two.bag"
    with rosbag.Bag(str(whole / "plain.bag")) as source, rosbag.Bag(str(path), "w") as bag:
        for topic, message, time in source.read_messages():
            bag.write(topic, message, time)
        bag.write("contro1s", Float64(1.0), time)
    path.write_bytes(path.read_bytes().replace(b"contro1s", b"controls"))
    assert cli.main(["info", str(path)]) == 1
    stderr = capsys.readouterr().err
    assert stderr.count("\n") == 1 and "geometry_msgs/PointStamped and std_msgs/Float64" in stderr


def test_simulate_writes_small_chunks_of_which_a_cut_takes_little(tmp_path):
    path, cut = tmp_path / "run.bag", tmp_path / "cut.bag"
    arguments = ["simulate", "--model", str(MODEL), "--input", "prbs", "--duration", "5"]
    assert cli.main(arguments + ["-o", str(path)]) == 0
    with rosbag.Bag(str(path)) as bag:
        sizes = [h.uncompressed_size for h in bag._chunk_headers.values()]
    assert max(sizes) < 10000
    cut.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert 0.3 < len(read(cut)[0]) / len(read(path)[0]) < 0.6


def test_a_block_of_lz4_is_unpacked_as_far_as_it_goes():
    unpacked = bytearray()
    # 4 literal bytes, then 8 bytes copied from 4 bytes back, then 3 literal bytes
    block = bytes([0x44]) + b"abcd" + bytes([4, 0, 0x30]) + b"xyz"
    assert bag_reader._unpack_block(block, unpacked) and unpacked == b"abcdabcdabcdxyz"
    for size in range(len(block)):
        partly = bytearray()
        bag_reader._unpack_block(block[:size], partly)
        assert unpacked.startswith(bytes(partly))
    assert bag_reader._from_bz2(bz2.compress(b"a" * 100), True)[0] == b"a" * 100


def test_a_type_that_is_not_installed_is_read_by_its_definition(tmp_path):
    import genpy.dynamic

    definition = "# an old type\nint32 MOST = 5 # a constant\nstring NAME=a'b\n"
    definition += "float64 x\nuint8[] rest\nstd_msgs/Header header\n" + 80 * "=" + "\n"
    definition += "MSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
    kind = genpy.dynamic.generate_dynamic("former_msgs/Pose", definition)["former_msgs/Pose"]
    path = tmp_path / "former.bag"
    with rosbag.Bag(str(path), "w") as bag:
        bag.write("pose", kind(x=0.5, rest=b"ab"), genpy.Time(7))
    with bag_reader.BagReader(str(path)) as bag:
        ((topic, message, time),) = bag.read_messages(["pose"])
    assert (topic, message.x, bytes(message.rest), time.secs) == ("pose", 0.5, b"ab", 7)


def test_lz4_without_a_checksum_is_read_as_far_as_it_goes():
    """Frames of rosbags contain the size of their contents, unknown to ROS, and have no checksum."""
    contents = bytes(range(200))
    header = b"\x04\x22\x4d\x18\x68\x40" + len(contents).to_bytes(8, "little") + b"\x00"
    block = (len(contents) | 1 << 31).to_bytes(4, "little") + contents  # not compressed
    frame = header + block + bytes(4)
    assert bag_reader._from_lz4(frame, False) == (contents, bag_reader.State.PLAIN)
    assert bag_reader._from_lz4(frame[:100], True) == (contents[:81], bag_reader.State.CHECKED)
    assert bag_reader._from_lz4(frame[:100], False)[1] is bag_reader.State.DOUBTFUL


def test_bags_need_a_codec():
    with pytest.raises(GroundError, match="pip install rosbags"):
        codecs.installed(())
