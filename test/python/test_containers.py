"""One experiment in eight containers and types, with other names, units and frames, is one experiment."""

import contextlib
import copy
import importlib.util
import itertools
import math
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import ground
from conftest import MODEL, identify, json_of, succeeds
from containers import OPTITRACK, Z_UP, Ros2, experiment, in_mocap, set_pose, write_bag, write_csv
from ground import _core
from ground.reading import commands
from ground.reading.containers import Topic

HEAD = "schema: ground/mapping/1\n"


def pose_stamped(folder):
    from geometry_msgs.msg import PoseStamped
    from ground_msgs.msg import Controls

    messages = []
    poses, commands = experiment()
    for stamp, eta in poses:
        message = PoseStamped()
        set_pose(message.pose.position, message.pose.orientation, in_mocap(eta, OPTITRACK))
        messages.append(("/vrpn_client_node/hovercraft/pose", stamp, message))
    for stamp, (left, right, lift) in commands:
        messages.append(("/controls", stamp, Controls(left=left, right=right, lift=lift)))
    return write_bag(folder / "run.bag", messages), ""


def transform_stamped(folder):
    """As vicon_bridge has them, z up; commands are microseconds in five fields of a Pose."""
    from geometry_msgs.msg import Pose, TransformStamped

    messages = []
    poses, commands = experiment()
    for stamp, eta in poses:
        message = TransformStamped()
        message.child_frame_id = "vicon/craft/craft"
        transform = message.transform
        set_pose(transform.translation, transform.rotation, in_mocap(eta, Z_UP))
        messages.append(("/vicon/craft/craft", stamp, message))
    for stamp, (left, right, lift) in commands:
        message = Pose()
        message.position.x, message.position.z = 1000 + 500 * right, 1000 + 1000 * lift
        message.orientation.y = 1900 - 900 * left
        messages.append(("/pwm", stamp, message))
    return (
        write_bag(folder / "run.bag", messages),
        """
poses: {axes: "x, -y, -z"}
commands:
  topic: /pwm
  channels:
    right: {field: position.x, off: 1000, full: 1500}
    left: {field: orientation.y, off: 1900, full: 1000}
    lift: {field: position.z, unit: microseconds}
""",
    )


def tf(folder):
    """Two bodies in one message; commands in percent."""
    from geometry_msgs.msg import TransformStamped, Vector3Stamped
    from tf2_msgs.msg import TFMessage

    messages = []
    poses, commands = experiment()
    for stamp, eta in poses:
        message = TFMessage()
        for name, shift in (("wall", 3.0), ("craft", 0.0)):
            item = TransformStamped()
            item.child_frame_id = name
            pose = in_mocap(eta + [shift, 0, 0], Z_UP)
            set_pose(item.transform.translation, item.transform.rotation, pose)
            message.transforms.append(item)
        messages.append(("/tf", stamp, message))
    for stamp, values in commands:
        message = Vector3Stamped()
        message.vector.x, message.vector.y, message.vector.z = map(float, 100 * values)
        messages.append(("/demand", stamp, message))
    return (
        write_bag(folder / "run.bag", messages),
        """
poses: {topic: /tf, body: craft, axes: "x, -y, -z"}
commands:
  topic: /demand
  channels:
    left: {field: vector.x, unit: percent}
    right: {field: vector.y, unit: percent}
    lift: {field: vector.z, unit: percent}
""",
    )


def odometry(folder):
    """Odometry of a body that was mounted backwards; commands in elements of an array."""
    from nav_msgs.msg import Odometry
    from std_msgs.msg import Float64MultiArray

    messages = []
    poses, commands = experiment()
    for stamp, eta in poses:
        message = Odometry()
        pose = in_mocap(eta + [0, 0, 2.0], Z_UP)
        set_pose(message.pose.pose.position, message.pose.pose.orientation, pose)
        messages.append(("/odom", stamp, message))
    for stamp, (left, right, lift) in commands:
        messages.append(("/motors", stamp, Float64MultiArray(data=[lift, -right, 2 * left])))
    return (
        write_bag(folder / "run.bag", messages),
        """
poses: {topic: /odom, axes: "x, -y, -z", heading_offset: 2.0}
commands:
  topic: /motors
  channels:
    left: {field: "data[2]", scale: 0.5}
    right: {field: "data[1]", sign: -1}
    lift: {field: "data[0]"}
""",
    )


def in_ros2(folder, plugin, unit):
    """PoseWithCovarianceStamped in other units, and Twist."""
    bag = Ros2(folder / "run", plugin)
    poses, commands = experiment()
    for stamp, eta in poses:
        position, orientation = in_mocap(eta, OPTITRACK)
        pose = bag.new(
            "geometry_msgs/PoseWithCovariance",
            pose=bag.pose((np.asarray(position) / unit, orientation)),
            covariance=np.zeros(36),
        )
        kind = "geometry_msgs/PoseWithCovarianceStamped"
        bag.write("/estimate", stamp, bag.new(kind, header=bag.header(stamp), pose=pose))
    for stamp, values in commands:
        linear = bag.vector("geometry_msgs/Vector3", values)
        still = bag.vector("geometry_msgs/Vector3", (0, 0, 0))
        bag.write("/cmd", stamp, bag.new("geometry_msgs/Twist", linear=linear, angular=still))
    return (
        bag.close(),
        """
poses: {position: {scale: %g}}
commands:
  topic: /cmd
  channels: {left: {field: linear.x}, right: {field: linear.y}, lift: {field: linear.z}}
"""
        % unit,
    )


def ros2_sqlite3(folder):
    return in_ros2(folder, "sqlite3", 1e-3)


def mcap(folder):
    """A single file without its folder."""
    path, mapping = in_ros2(folder, "mcap", 1e-2)
    (file,) = path.glob("*.mcap")
    return file, mapping


TABLE = """
poses:
  position: {fields: [x, y], unit: cm}
  heading: {field: heading, unit: deg}
  axes: "x, -y, -z"
  time: {field: "t [ms]", unit: ms}
commands:
  channels:
    left: {field: port, unit: percent}
    right: {field: starboard, unit: percent}
    lift: {field: fan}
  time: {field: "t [ms]", unit: ms}
"""
COLUMNS = ["t [ms]", "x", "y", "heading", "port", "starboard", "fan"]


def csv_pair(folder):
    """Poses and commands apart, as a rate of their own takes."""
    poses, commands = experiment()
    write_csv(
        folder / "poses.csv",
        COLUMNS[:4],
        [(s / 1e6, 100 * e[0], -100 * e[1], -math.degrees(e[2])) for s, e in poses],
    )
    write_csv(
        folder / "commands.csv",
        [COLUMNS[0], *COLUMNS[4:]],
        [(s / 1e6, 100 * c[0], 100 * c[1], c[2]) for s, c in commands],
    )
    mapping = TABLE.replace("poses:\n", "poses:\n  file: poses.csv\n")
    return folder, mapping.replace("commands:\n", "commands:\n  file: commands.csv\n")


def parquet(folder):
    import pandas

    path, mapping = csv_pair(folder)
    for name in ("poses", "commands"):
        pandas.read_csv(folder / (name + ".csv")).to_parquet(folder / (name + ".parquet"))
        (folder / (name + ".csv")).unlink()
    return path, mapping.replace(".csv", ".parquet")


KINDS = [transform_stamped, tf, odometry, ros2_sqlite3, mcap, csv_pair] + [parquet] * bool(
    importlib.util.find_spec("pyarrow")
)


def written(make, folder):
    """What a function writes: the file, and options that read it."""
    if make in (ros2_sqlite3, mcap) and not importlib.util.find_spec("rosbags"):
        pytest.skip("bags of ROS 2 take the Python module rosbags, which is not installed")
    folder.mkdir()
    path, mapping = make(folder)
    file = folder.parent / (folder.name + ".yaml")
    file.write_text(HEAD + mapping)
    return path, (["--mapping", file] if mapping else [])


def fitted(path, options, folder):
    out = folder / "fitted.yaml"
    found = json_of("fit", path, *options, "--model", MODEL, "-o", out, "--force")
    return {name: p["value"] for name, p in found["parameters"].items()}


@pytest.fixture(scope="module")
def wanted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wanted")
    return fitted(*written(pose_stamped, folder / "run"), folder)


@pytest.mark.parametrize("make", KINDS, ids=lambda make: make.__name__)
def test_every_container_gives_the_same_fit(make, wanted, tmp_path):
    found = fitted(*written(make, tmp_path / "run"), tmp_path)
    assert list(found) == list(wanted) and len(wanted) == 5
    for name, value in wanted.items():
        assert found[name] == pytest.approx(value, rel=1e-9), name


def test_a_body_is_chosen_and_never_guessed(tmp_path):
    path, _ = written(tf, tmp_path / "run")
    options = {"command_topic": "/demand", "axes": Z_UP}
    with pytest.raises(ground.GroundError, match="several bodies: craft, wall; choose one with --body"):
        ground.read(path, **options)
    with pytest.raises(ground.GroundError, match="no body is named car; there are craft, wall"):
        ground.read(path, body="car", **options)


class Pose(NamedTuple):
    """The pose of a frame in another one."""

    place: np.ndarray
    turn: Rotation

    def then(self, inner):
        """The pose in the other frame of what has a pose in this one."""
        return Pose(self.place + self.turn.apply(inner.place), self.turn * inner.turn)

    def inverse(self):
        return Pose(-self.turn.inv().apply(self.place), self.turn.inv())

    def fill(self, transform):
        set_pose(transform.translation, transform.rotation, (self.place, self.turn.as_quat()))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["tf", "odometry"])
def test_a_body_is_reached_by_chains_of_static_transforms(kind, seed, tmp_path):
    """Of any length and direction, with any turns, in tf_static or published again and again on tf."""
    from geometry_msgs.msg import PointStamped, TransformStamped
    from nav_msgs.msg import Odometry
    from tf2_msgs.msg import TFMessage

    random, (poses, commands) = np.random.default_rng(seed), experiment(2.0)

    def transform(parent, child, pose):
        item = TransformStamped()
        item.header.frame_id, item.child_frame_id = random.choice(["", "/"]) + parent, child
        pose.fill(item.transform)
        return item

    frames, whole, fixed = ["plate", *random.permutation(["a", "b", "base"])[: 1 + seed % 3]], None, []
    for parent, child in zip(frames, frames[1:]):
        link = Pose(random.normal(0, 0.3, 3), Rotation.random(random_state=random.integers(1000)))
        whole = link if whole is None else whole.then(link)
        is_inverse = random.random() < 0.5
        fixed.append(
            transform(child, parent, link.inverse()) if is_inverse else transform(parent, child, link)
        )
    side = Pose(random.normal(0, 1, 3), Rotation.identity())
    messages = [("/tf_static", poses[0][0], TFMessage([transform("room", "camera", side)]))]
    again = kind == "tf" and seed % 2
    for stamp in [stamp for stamp, _ in poses[::10]] if again else [poses[0][0]]:
        messages.append(("/tf" if again else "/tf_static", stamp, TFMessage(copy.deepcopy(fixed))))
    for stamp, eta in poses:
        place, turn = in_mocap(eta, Z_UP)
        plate = Pose(np.array(place), Rotation.from_quat(turn)).then(whole.inverse())
        if kind == "tf":
            messages.append(("/tf", stamp, TFMessage([transform("room", "plate", plate)])))
        else:
            message = Odometry(child_frame_id="plate")
            set_pose(
                message.pose.pose.position, message.pose.pose.orientation, (plate.place, plate.turn.as_quat())
            )
            messages.append(("/odometry", stamp, message))
    for stamp, values in commands:
        message = PointStamped()
        message.point.x, message.point.y, message.point.z = map(float, values)
        messages.append(("/controls", stamp, message))
    path = write_bag(tmp_path / "run.bag", messages)
    options = {"pose_topic": "/odometry" if kind == "odometry" else "/tf", "axes": Z_UP}
    with pytest.warns(UserWarning, match="%s is fixed to plate" % frames[-1]):
        (run,) = ground.read(path, body=frames[-1], **options)
    eta = np.array([eta for _, eta in poses])
    assert run.eta[:, :2] == pytest.approx(eta[:, :2], abs=1e-7)
    assert np.exp(1j * run.eta[:, 2]) == pytest.approx(np.exp(1j * eta[:, 2]), abs=1e-7)
    with pytest.raises(ground.GroundError, match="no body is named car; there are plate, .*fixed to plate"):
        ground.read(path, body="car", **options)
    with pytest.raises(ground.GroundError, match="no body is named camera"):
        ground.read(path, body="camera", **options)


def test_several_topics_are_named_with_the_option(tmp_path):
    from geometry_msgs.msg import PoseStamped
    from ground_msgs.msg import Controls

    messages = [("/controls", 10**9 * s, Controls()) for s in (1, 2)]
    for topic in ("/vrpn/craft/pose", "/vrpn/car/pose"):
        for second in (1, 2):
            message = PoseStamped()
            message.pose.orientation.w = 1
            messages.append((topic, 10**9 * second, message))
    path = write_bag(tmp_path / "run.bag", messages)
    with pytest.raises(ground.GroundError, match="car/pose, /vrpn/craft/pose; choose .* --pose-topic"):
        ground.read(path)
    for options in ({"body": "craft"}, {"pose_topic": "/vrpn/craft/pose"}):
        (recording,) = ground.read(path, **options)
        assert recording.source.startswith("/vrpn/craft/pose (geometry_msgs/PoseStamped)")


def test_commands_are_what_has_left_for_the_craft(tmp_path):
    import rosbag
    from ground_msgs.msg import Controls

    path, _ = pose_stamped(tmp_path)
    (asked,) = ground.read(str(path))
    _, commands = experiment()
    messages = [
        ("/sent", stamp, Controls(left=left / 2, right=right, lift=lift))
        for stamp, (left, right, lift) in commands
    ]
    with rosbag.Bag(str(path)) as bag:
        messages += [(topic, stamp.to_nsec(), message) for topic, message, stamp in bag.read_messages()]
    (sent,) = ground.read(str(write_bag(tmp_path / "both.bag", messages)))
    assert "/sent (ground_msgs/Controls)" in sent.source
    np.testing.assert_allclose(sent.controls, asked.controls * [0.5, 1, 1])
    (chosen,) = ground.read(str(tmp_path / "both.bag"), command_topic="/controls")
    np.testing.assert_allclose(chosen.controls, asked.controls)


def test_commands_of_an_unknown_type_are_not_guessed(tmp_path):
    path, _ = written(transform_stamped, tmp_path / "run")
    with pytest.raises(ground.GroundError, match="no controls in this bag; .*--command-topic"):
        ground.read(path)
    with pytest.raises(ground.GroundError, match="/pwm: .*geometry_msgs/Pose .*name the channels in a"):
        ground.read(path, command_topic="/pwm")


@pytest.mark.parametrize("make", [pose_stamped, tf, ros2_sqlite3, mcap], ids=lambda make: make.__name__)
def test_a_draft_reads_what_it_was_drafted_from(make, tmp_path):
    path, options = written(make, tmp_path / "run")
    draft = tmp_path / "draft.yaml"
    succeeds("info", path, "--write-mapping", draft)
    (found,) = ground.read(path, mapping=draft)
    (wanted,) = ground.read(path, mapping=options[1] if options else None)
    assert found.eta == pytest.approx(wanted.eta, abs=1e-12)
    assert np.array_equal(found.controls, wanted.controls)
    assert found.channels == ("left", "right", "lift")
    result = identify("info", path, "--write-mapping", draft)
    assert result.returncode == 1 and "--force" in result.stderr


def test_a_file_without_poses_or_commands_has_no_draft(tmp_path):
    path = write_csv(tmp_path / "names.csv", ["name", "place"], [("a", "b"), ("c", "d")])
    result = identify("info", path, "--write-mapping", tmp_path / "draft.yaml")
    assert result.returncode == 1 and "no row contains numbers" in result.stderr
    assert not (tmp_path / "draft.yaml").exists()


TWO = """
poses:
  position: {fields: [%s]}
  %s
  axes: "%s"
  time: {field: t}
commands:
  channels: {left: {field: left}, right: {field: right}, lift: {field: lift}}
  time: {field: t}
"""
ROTATION = {4: "orientation: [qx, qy, qz, qw]", 1: "heading: {field: angle}"}


def all_axes():
    """Every right-handed frame, as mappings write it."""
    for order in itertools.permutations("xyz"):
        for signs in itertools.product(("", "-"), repeat=3):
            axes = ", ".join(sign + axis for sign, axis in zip(signs, order))
            with contextlib.suppress(ValueError):
                _core.AxisMapping(axes)
                yield axes


def horizontal_table(folder, axes, rotation):
    """A table with the positions along the two horizontal axes of a frame; returns its mapping."""
    poses, commands = experiment(3.0)
    flat = [axis for axis in "xyz" if axis != axes[-1]]
    sign = -1 if axes.rsplit(",", 1)[1].strip().startswith("-") else 1
    rows, at = [], np.searchsorted([s for s, _ in commands], [s for s, _ in poses], "right") - 1
    for (stamp, eta), number in zip(poses, at):
        position, quaternion = in_mocap(eta, axes)
        turn = list(quaternion) if rotation == 4 else [sign * eta[2]]
        place = [position["xyz".index(axis)] for axis in flat]
        rows.append([stamp / 1e9, *place, *turn, *commands[max(0, number)][1]])
    names = ["qx", "qy", "qz", "qw"] if rotation == 4 else ["angle"]
    write_csv(folder / "run.csv", ["t", *flat, *names, "left", "right", "lift"], rows)
    return flat, np.array([eta for _, eta in poses])


@pytest.mark.parametrize("axes", all_axes())
@pytest.mark.parametrize("rotation", ROTATION)
def test_two_columns_are_the_horizontal_axes(axes, rotation, tmp_path):
    flat, eta = horizontal_table(tmp_path, axes, rotation)
    mapping = tmp_path / "mapping.yaml"
    for fields in (flat, flat[::-1]):  # as they are named, in any order
        quoted = ", ".join("'%s'" % name for name in fields)
        mapping.write_text(HEAD + TWO % (quoted, ROTATION[rotation], axes))
        (run,) = ground.read(tmp_path / "run.csv", mapping=mapping)
        off = run.eta - eta
        assert np.abs(off[:, :2]).max() < 1e-9 and np.abs(np.sin(off[:, 2] / 2)).max() < 1e-9


@pytest.mark.parametrize("names", ["x,y", "px,py", "pos_x,pos_y", "X [m],Y [m]"])
def test_axes_that_need_another_column_are_refused(names, tmp_path):
    horizontal_table(tmp_path, Z_UP, 1)
    file, mapping = tmp_path / "run.csv", tmp_path / "mapping.yaml"
    file.write_text(file.read_text().replace("t,x,y,", "t,%s," % names, 1))
    quoted = ", ".join("'%s'" % name for name in names.split(","))
    mapping.write_text(HEAD + TWO % (quoted, ROTATION[1], OPTITRACK))
    for verb in (["info"], ["fit", "--model", MODEL, "-o", tmp_path / "fitted.yaml"]):
        result = identify(verb[0], file, "--mapping", mapping, *verb[1:])
        assert result.returncode == 1 and result.stderr.count("\n") == 1
        assert "need x and z" in result.stderr


@pytest.mark.parametrize("sent, best", [(1, "/a/controls"), (700, "/a/sent")])
def test_what_was_sent_counts_where_it_is_as_long_as_what_was_commanded(sent, best):
    """A sender that found its craft just before the end has sent next to nothing."""
    topics = {"/a/sent": Topic(commands.OWN, sent), "/a/controls": Topic(commands.OWN, 2000)}
    ranks = commands.ranks(topics)
    assert min(ranks, key=ranks.get) == best
