"""Bags: every compression and layout reads the same, damage is said, and nothing of a file becomes code."""

import io

import numpy as np
import pytest
import rosbag

from conftest import identify, write_bag
from ground.reading import bags, containers, messages, readers

KINDS = {
    "plain": dict(),
    "bz2": dict(compression="bz2"),
    "lz4": dict(compression="lz4", chunk_threshold=messages.CHUNK),
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A folder with one run in bags of every kind."""
    folder = tmp_path_factory.mktemp("whole")
    source = write_bag(folder / "source.bag", duration=7, seed=2)
    with rosbag.Bag(str(source)) as bag:
        every = list(bag.read_messages())
    for name, options in KINDS.items():
        with rosbag.Bag(str(folder / (name + ".bag")), "w", **options) as bag:
            for row in every:
                bag.write(*row)
    return folder


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_reads_to_the_bit_as_with_rosbag(whole, kind):
    with rosbag.Bag(str(whole / "plain.bag")) as bag:
        stamps, rows = zip(
            *(
                (m.header.stamp.to_sec(), (m.point.x, m.point.y, m.point.z))
                for _, m, _ in bag.read_messages(["pose"])
            )
        )
    found = readers.read(str(whole / (kind + ".bag")))
    assert found.pose_times.tolist() == list(stamps) and found.eta.tolist() == list(map(list, rows))
    assert found.warnings == []


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [0.5, 0.9, 0.9999])
def test_a_cut_bag_is_read_as_far_as_it_goes(tmp_path, whole, kind, share):
    if kind == "bz2" and share < 0.99:
        pytest.skip("a block of bz2 that is cut cannot be unpacked")
    data = (whole / (kind + ".bag")).read_bytes()
    cut = tmp_path / "cut.bag"
    cut.write_bytes(data[: int(share * len(data))])
    found, wanted = readers.read(str(cut)), readers.read(str(whole / (kind + ".bag")))
    count = len(found.eta)
    assert (share - 0.25) * len(wanted.eta) < count <= len(wanted.eta)
    assert np.array_equal(found.eta, wanted.eta[:count])
    assert "damaged or was not closed" in found.warnings[0]


def test_a_bag_whose_recorder_was_killed_is_read(tmp_path, whole):
    active = tmp_path / "run.bag.active"
    bag = rosbag.Bag(str(active), "w", chunk_threshold=5000)
    with rosbag.Bag(str(whole / "plain.bag")) as source:
        for row in source.read_messages():
            bag.write(*row)
    bag._file.flush()
    assert len(readers.read(str(active)).eta) > 600


@pytest.mark.parametrize("kind", ["lz4", "bz2"])
def test_a_damaged_chunk_is_left_out_and_counted(tmp_path, whole, kind):
    """Whether ROS is installed or not."""
    path, chunks = tmp_path / "run.bag", []
    with rosbag.Bag(str(path), "w", compression=kind, chunk_threshold=messages.CHUNK // 8) as bag:
        with rosbag.Bag(str(whole / "plain.bag")) as source:
            for row in source.read_messages():
                bag.write(*row)
        chunks = [info.pos for info in bag._chunks]
    data = bytearray(path.read_bytes())
    middle = (chunks[len(chunks) // 2] + chunks[len(chunks) // 2 + 1]) // 2
    data[middle : middle + 4] = b"\xff\x00\xff\x00"
    path.write_bytes(data)
    found, wanted = readers.read(str(path)), readers.read(str(whole / "plain.bag"))
    assert 0.9 * len(wanted.eta) < len(found.eta) < len(wanted.eta)
    assert set(found.pose_times) < set(wanted.pose_times)
    assert found.warnings == ["the bag is damaged: chunks that cannot be unpacked were left out (1)"]


EVIL = 'string A=x"""; import os; os.system("touch %s"); #\nfloat64 x\n# end \\'


def test_a_definition_is_never_code(tmp_path):
    """genpy would write this definition into the text of a module."""
    planted = tmp_path / "planted"
    path = tmp_path / "evil.bag"
    from geometry_msgs.msg import PoseStamped

    class Evil(PoseStamped):
        _full_text = EVIL % planted

    with rosbag.Bag(str(path), "w") as bag:
        for _ in range(3):
            bag.write("/craft/pose", Evil())
    result = identify("info", path)
    assert result.returncode == 1 and "Traceback" not in result.stderr
    assert not planted.exists()


def test_a_type_of_its_own_is_read_by_its_definition(tmp_path):
    import genpy.dynamic

    definition = "# an old type\nint32 MOST = 5 # a constant\nstring NAME=a'b\n"
    definition += "float64 x\nuint8[] rest\nduration[2] wait\nstd_msgs/Header header\n" + 80 * "=" + "\n"
    definition += "MSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
    kind = genpy.dynamic.generate_dynamic("former_msgs/Pose", definition)["former_msgs/Pose"]
    path = tmp_path / "former.bag"
    with rosbag.Bag(str(path), "w") as bag:
        for number, rest in enumerate((b"ab", b"", b"c")):
            waits = [genpy.Duration(-1, 5), genpy.Duration(2)]
            message = kind(x=0.5 + number, rest=rest, wait=waits)
            message.header.frame_id = "map" * number
            bag.write("pose", message, genpy.Time(7 - number))
    with bags.Bag(str(path)) as bag:
        assert bag.topics == {"pose": containers.Topic("former_msgs/Pose", 3)}
        found = bag.table("pose")
    assert found["x"].tolist() == [2.5, 1.5, 0.5]  # in the order of receipt
    assert found["received"].tolist() == [5 * 10**9, 6 * 10**9, 7 * 10**9]
    assert found["rest[0]"][[0, 2]].tolist() == [ord("c"), ord("a")] and np.isnan(found["rest[0]"][1])
    assert found["header.frame_id"].tolist() == ["mapmap", "map", ""]
    assert found["wait[1]"].tolist() == [2 * 10**9] * 3


def test_a_pose_that_is_no_number_is_left_out_and_counted(tmp_path):
    def spoil(times, eta, inputs):
        eta[50, 0] = np.nan
        return times, eta, inputs

    found = readers.read(str(write_bag(tmp_path / "nan.bag", change=spoil)))
    assert len(found.eta) == 799 and "1 poses are invalid and were left out" in found.warnings


def test_messages_that_are_written_are_those_of_ros(tmp_path):
    """What rosbags writes is what genpy serializes, and rosbag reads it."""
    from ground_msgs.msg import Controls

    path = tmp_path / "run.bag"
    message = messages.new("ground_msgs/Controls", thrusters=np.array([0.5, -1]), channels=["a", "b"])
    message.header.stamp = messages.time(12 * 10**9 + 5)
    with messages.bag_writer(str(path)) as bag:
        bag.write("/controls", message, 13 * 10**9)
    wanted = Controls(thrusters=[0.5, -1], channels=["a", "b"])
    wanted.header.stamp.secs, wanted.header.stamp.nsecs = 12, 5
    with rosbag.Bag(str(path)) as bag:
        ((topic, found, time),) = bag.read_messages()
    buffers = io.BytesIO(), io.BytesIO()
    found.serialize(buffers[0]), wanted.serialize(buffers[1])
    assert buffers[0].getvalue() == buffers[1].getvalue() and (topic, time.secs) == ("/controls", 13)
