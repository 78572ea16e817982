"""What becomes a recording, and what is said of it: single functions with plain numbers."""
import math
import types

import numpy as np
import pytest
from conftest import recording_of
from scipy.spatial.transform import Rotation

from ground.errors import GroundError
from ground.recordings import (
    bag_reader,
    batches,
    clocks,
    commands,
    csv_exports,
    drafts,
    fields,
    findings,
    flown,
    mapping,
    plausibility,
    poses,
    recording,
    reply,
    settings,
    suspicions,
    tables,
    tracks,
    units,
)
from ground.recordings.codecs.with_rosbags import Time
from ground.recordings.layouts import evidence, verdicts, words
from ground.recordings.layouts.hypotheses import Class, Hypothesis


def at(seconds):
    return Time(*divmod(int(round(seconds * 10**9)), 10**9))


def measured(axes="x, y, z", offset=0.0, taken=("axes", "heading_offset"), more=()):
    """Settings of a mocap; more: later ones as (since [s], axes, offset)."""
    changes = [settings.Setting(0, axes, offset)]
    changes += [settings.Setting(int(since * 1e9), *rest) for since, *rest in more]
    return settings.Settings(tuple(changes), {"axes": "a test", "heading_offset": "a test"}, taken)


# --- units


def test_speed_is_exceeded_by_one_step_of_twenty():
    times = np.arange(1000) / 100
    assert units.speed(times, np.column_stack([3 * times, 4 * times])) == pytest.approx(5)
    fast = np.where(times < 0.3, 50 * times, 15.0)  # 3% of the time
    assert units.speed(times, fast[:, None]) < 1
    fast = np.where(times < 1.0, 50 * times, 50.0)
    assert units.speed(times, fast[:, None]) == pytest.approx(50)
    order = np.random.default_rng(1).permutation(1000)
    mixed = np.column_stack([3 * times, 4 * times])[order]
    assert units.speed(times[order], mixed) == pytest.approx(5)
    assert units.speed(times[:9], mixed[:9]) == 0.0  # shorter than a step


def moved(speed, unit=1.0):
    times = np.arange(500) / 100
    return times, np.column_stack([speed * times, 0 * times]) / unit


@pytest.mark.parametrize("unit", ["mm", "cm", "in"])
def test_lengths_in_another_unit_are_known_by_speed_and_noise(unit):
    size = mapping.LENGTHS[unit]
    likely, fast = units.length_units(*moved(0.6, size), 3e-4 / size)
    assert likely[0] == unit and fast == pytest.approx(0.6 / size)
    assert units.length_units(*moved(0.6), 3e-4)[0] == ()
    close = {"cm", "in"}  # no speed tells these from each other
    assert set(likely) == ({"mm"} if unit == "mm" else close)


def test_a_fast_craft_is_in_metres_unless_nothing_is_that_fast():
    assert units.length_units(*moved(14.9))[0] == ()
    assert units.length_units(*moved(16.0))[0] != ()
    assert units.length_units(*moved(5.0), 3e-4)[0] == ()  # as quiet as in metres
    assert units.length_units(*moved(5.0), 1e-3)[0] == ()  # both by a little
    assert units.length_units(*moved(10.0), 0.1)[0] != ()
    assert units.length_units(*moved(2.9), 1.0)[0] == () != units.length_units(*moved(3.1), 1.0)[0]


def quaternion(axis, angle):
    found = np.append(math.sin(angle / 2) * np.array(axis, float), math.cos(angle / 2))
    return found / np.linalg.norm(found)


def poses_about(axis, height, count=40):
    random = np.random.default_rng(2)
    rows = []
    for angle in random.uniform(-3, 3, count):
        position = random.uniform(-1, 1, 3)
        position[int(np.argmax(np.abs(axis)))] = height
        rows.append((*position, *quaternion(axis, angle)))
    return rows


@pytest.mark.parametrize("vertical", [0, 1, 2])
@pytest.mark.parametrize("height", [0.1, -0.1])
def test_axes_are_those_about_which_the_craft_turns(vertical, height):
    axis = np.eye(3)[vertical]
    rows = poses_about(axis, height)
    axes, share = units.fitting_axes(rows)
    assert share == 1.0 and axes.split(",")[-1].strip("- ") == "xyz"[vertical]
    up, down = units.VERTICAL[vertical]
    guess, fits, why = drafts.axes_guess(np.array(rows)[:, :3], np.array(rows)[:, 3:])
    assert guess == (up if height > 0 else down) and fits == 1.0
    assert why.startswith("%s moves least, 100%% of the poses" % "xyz"[vertical])
    assert ("positive: up" if height > 0 else "negative: down") in why


def test_no_axes_fit_a_body_that_turns_about_all_of_them():
    random = np.random.default_rng(3)
    rows = [(*random.uniform(-1, 1, 3), *quaternion(random.normal(size=3), 2.0)) for _ in range(60)]
    assert units.fitting_axes(rows) is None
    half = poses_about([0, 0, 1], 0.1, 36) + [row for row in rows[:24]]
    axes, share = units.fitting_axes(half)
    assert axes.endswith("z") and 0.6 <= share < 1


# --- times


def message(**values):
    header = types.SimpleNamespace(stamp=at(12.5))
    return types.SimpleNamespace(header=header, **values)


def test_stamps_come_from_header_receipt_or_field():
    received, headless = at(99.0), types.SimpleNamespace(t=7)
    assert clocks.stamps(mapping.Clock(), "f")(message(), received) == at(12.5)
    assert clocks.stamps(mapping.Clock("header"), "f")(message(), received) == at(12.5)
    assert clocks.stamps(mapping.Clock("receipt"), "f")(message(), received) == received
    assert clocks.stamps(mapping.Clock(), "f")(headless, received) == received
    with pytest.raises(GroundError, match="f: no header; name the field that is the time"):
        clocks.stamps(mapping.Clock("header"), "f")(headless, received)
    with pytest.raises(GroundError, match="f: no time of receipt; name the field"):
        clocks.stamps(mapping.Clock("receipt"), "f")(message(), None)


@pytest.mark.parametrize("unit,size", mapping.TIMES.items())
def test_a_field_may_be_the_time(unit, size):
    value = 1_600_000_000_123_456_789 // size
    stamp = clocks.stamps(mapping.Clock("", "t", unit), "f")
    assert stamp(types.SimpleNamespace(t=value), None).to_nsec() == value * size
    part = stamp(types.SimpleNamespace(t=1.25), None)
    assert part.to_nsec() == int(1.25 * size)
    both = clocks.stamps(mapping.Clock("", "t", unit, "n"), "f")
    assert both(types.SimpleNamespace(t=3, n=17), None).to_nsec() == 3 * size + 17


@pytest.mark.parametrize("value", [-1, 2**32, float("nan"), float("inf"), "noon", None])
def test_a_field_that_is_no_time_is_named(value):
    stamp = clocks.stamps(mapping.Clock("", "t", "s"), "run.csv")
    with pytest.raises(GroundError, match="run.csv: a time is .*(not a number|between 1970 and 2106)"):
        stamp(types.SimpleNamespace(t=value), None)
    assert stamp(types.SimpleNamespace(t=2**32 - 1), None).to_sec() == 2**32 - 1
    assert stamp(types.SimpleNamespace(t=0), None).to_sec() == 0


def test_rows_are_shifted_to_the_clock_of_the_mapping():
    rows = np.column_stack([100 + np.arange(5.0), np.arange(5.0)])
    given = mapping.FieldMapping(clock_offset=-2.0, clock_drift=0.01)
    found = recording._shifted(rows, given)
    assert found[:, 0] == pytest.approx([98, 99.01, 100.02, 101.03, 102.04])
    assert np.array_equal(found[:, 1], rows[:, 1]) and rows[0, 0] == 100


# --- poses and commands of messages


def row_reader(**keys):
    keys.setdefault("time", mapping.Clock("", "t", "s"))
    given = mapping.Poses(type="", **keys)
    taken = poses.takes(poses.TABLE, given)
    return poses.PoseReader("run.csv", poses.TABLE, given, measured(given.axes or "x, y, z", 0.0, taken))


def read_one(reader, **values):
    ((stamp, pose),) = reader(fields.Row(values), None)
    return stamp.to_sec(), pose


def test_a_planar_pose_is_scaled_and_its_heading_turned():
    plain = row_reader(position=("x", "y"), heading="h")
    assert read_one(plain, t=2, x=1.0, y=-2.0, h=0.5) == (2.0, (1.0, -2.0, 0.5))
    other = row_reader(
        position=("x", "-y"), heading="h", unit="cm", scale=2.0, heading_unit="deg", heading_sign=-1
    )
    stamp, pose = read_one(other, t=2, x=100.0, y=50.0, h=90.0)
    assert pose == pytest.approx((2.0, -1.0, -math.pi / 2))
    offset = poses.PoseReader(
        "run.csv", poses.TABLE, plain.poses, measured(offset=0.3, taken=("heading_offset",))
    )
    assert read_one(offset, t=2, x=0, y=0, h=0.5)[1][2] == pytest.approx(0.2)
    assert read_one(offset, t=2, x=0, y=0, h=-3.0)[1][2] == pytest.approx(2 * math.pi - 3.3)


def test_a_quaternion_may_be_positive_the_other_way_round():
    keys = dict(position=("x", "y", "z"), orientation=("a", "b", "c", "d"))
    qx, qy, qz, qw = quaternion([0, 0, 1], 0.7)
    values = dict(t=1, x=1.0, y=2.0, z=0.1, a=qx, b=qy, c=qz, d=qw)
    assert read_one(row_reader(**keys), **values)[1] == pytest.approx((1, 2, 0.7))
    other = row_reader(heading_sign=-1, **keys)
    assert read_one(other, **values)[1] == pytest.approx((1, 2, -0.7))
    down = row_reader(axes="x, -y, -z", **keys)
    assert read_one(down, **values)[1] == pytest.approx((1, -2, -0.7))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_turns_about_an_axis_are_those_of_scipy(axis):
    for angle in (-3.0, -0.4, 0.0, 1.2, 3.1):
        expected = Rotation.from_rotvec(angle * np.eye(3)[axis]).as_quat()
        assert poses._about(axis, angle) == pytest.approx(expected)


def test_a_heading_about_given_axes_is_a_turn_about_the_vertical():
    reader = row_reader(position=("x", "y"), heading="h", axes="x, -y, -z")
    assert read_one(reader, t=1, x=1.0, y=2.0, h=0.4)[1] == pytest.approx((1, -2, -0.4))
    assert reader.raw == [pytest.approx((1, 2, 0, 0, 0, math.sin(0.2), math.cos(0.2)))]


def test_what_a_row_lacks_is_named_and_what_is_no_number_is_left_out():
    reader = row_reader(position=("x", "-y"), heading="h")
    with pytest.raises(GroundError, match="run.csv: a message has no field y; its numbers are t, x, h"):
        read_one(reader, t=1, x=1.0, h=0.0)
    assert read_one(reader, t=1, x="lost", y=0.0, h=0.0)[1] is None
    with pytest.raises(GroundError, match="columns are not known to be poses; name the fields"):
        poses.PoseReader("run.csv", poses.TABLE, mapping.Poses(), measured())


def test_a_body_is_chosen_by_its_name():
    def reader(body, where="bag: /tf"):
        kind = "geometry_msgs/TransformStamped"
        return poses.PoseReader(where, kind, mapping.Poses(body=body), measured())

    def transform(child):
        vector = types.SimpleNamespace(x=1.0, y=2.0, z=0.0)
        rotation = types.SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
        inner = types.SimpleNamespace(translation=vector, rotation=rotation)
        return message(transform=inner, child_frame_id=child)

    chosen = reader("/craft")
    assert len(list(chosen(transform("craft"), None))) == 1
    assert list(chosen(transform("wand"), None)) == []
    chosen.finish()
    absent = reader("boat")
    list(absent(transform("craft"), None))
    with pytest.raises(GroundError, match="bag: /tf: no body is named boat; there are craft"):
        absent.finish()
    named = reader("boat", "bag: /boat/pose")  # it has chosen the topic
    list(named(transform("craft"), None))
    named.finish()
    open_choice = reader("")
    list(open_choice(transform("craft"), None))
    open_choice.finish()
    list(open_choice(transform("wand"), None))
    with pytest.raises(GroundError, match="several bodies: craft, wand; choose one by --body"):
        open_choice.finish()


def test_topics_of_poses_and_commands_are_ranked():
    Topic = bag_reader.Topic
    info = {
        "/a/pose": Topic("geometry_msgs/PoseStamped", 5),
        "/b/other": Topic("geometry_msgs/PoseStamped", 5),
        "/eta": Topic("geometry_msgs/PointStamped", 5),
        "/point": Topic("geometry_msgs/PointStamped", 5),
        "/state": Topic("ground_msgs/State", 5),
        "/empty/pose": Topic("geometry_msgs/PoseStamped", 0),
        "/odom": Topic("nav_msgs/Odometry", 5),
        "/controls": Topic("geometry_msgs/PointStamped", 5),
    }
    ranks = poses.candidates(info, mapping.Poses(), ["/odom"])
    assert ranks == {"/a/pose": 0, "/eta": 1, "/state": 2, "/b/other": 3}
    stamped, bare = (
        {rank for kind, rank in poses.ANY_NAME.items() if (kind.split("/")[1] in ("Pose", "Pose2D")) == b}
        for b in (False, True)
    )
    assert len(stamped) == len(bare) == 1 and 2 < min(stamped) < min(bare)  # one kind is not preferred
    assert poses.candidates(info, mapping.Poses(body="b"), []) == {"/b/other": 3}
    assert len(poses.candidates(info, mapping.Poses(body="no"), [])) == 5
    assert commands.rank("controls", "ground_msgs/Controls") == 0
    assert commands.rank("controls", "geometry_msgs/PointStamped") == 1
    assert commands.rank("thrust", "ground_msgs/Controls") is None
    assert commands.rank("controls", "std_msgs/String") is None
    with pytest.raises(GroundError, match="/eta has geometry_msgs/PointStamped, not nav_msgs/Odometry"):
        poses.named(info, mapping.Poses("/eta", type="nav_msgs/Odometry"), "bag")
    assert poses.named(info, mapping.Poses("/state"), "bag") == "/state"


def test_commands_become_what_their_channels_mean():
    channels = (
        mapping.Channel("left", "a", 1000.0, 2000.0),
        mapping.Channel("lift", "b", 0.0, 50.0, 0.5, -1),
    )
    given = mapping.Commands(channels=channels, time=mapping.Clock("", "t"))
    reader = commands.CommandReader("run.csv", poses.TABLE, given)
    stamp, values = reader(fields.Row(t=3, a=1250, b=25), None)
    assert stamp.to_sec() == 3 and values == (1250, 25)
    rows = reader.normalised(np.array([[3.0, 1250, 25], [4.0, 2000, -50]]))
    assert np.allclose(rows, [[3, 0.25, -0.25], [4, 1, 0.5]])
    with pytest.raises(GroundError, match="run.csv: a message has no field b"):
        reader(fields.Row(t=3, a=1250), None)
    with pytest.raises(GroundError, match="which numbers are commands is not known"):
        commands.CommandReader("run.csv", poses.TABLE, mapping.Commands())


def test_commands_of_a_craft_that_lists_its_thrusters_have_its_names():
    def sent(channels, thrusters, lift=1.0):
        return message(channels=channels, thrusters=thrusters, lift=lift, left=0.1, right=0.2)

    reader = commands.CommandReader("bag: /controls", commands.OWN, mapping.Commands())
    assert reader(sent(["a", "b", "c", "fan"], [0.5, -0.5, 0.0]), None)[1] == (0.5, -0.5, 0.0, 1.0)
    assert reader.lift == "fan" and [c.name for c in reader.channels] == ["a", "b", "c", "fan"]
    assert [c.range for c in reader.channels] == [(-1, 1)] * 3 + [(0, 1)]
    reader(sent(["a", "b", "c", "fan"], [0.5, -0.5, 0.0]), None)
    for other in (sent(["a", "b", "fan"], [0.5, 0.5]), sent([], [])):
        with pytest.raises(GroundError, match="not all of one craft: some are for a, b, c, fan, others for"):
            reader(other, None)
    pair = commands.CommandReader("bag: /controls", commands.OWN, mapping.Commands())
    assert pair(sent([], []), None)[1] == (0.1, 0.2, 1.0) and pair.lift == "lift"
    with pytest.raises(GroundError, match="some are for left, right, lift, others for a, fan"):
        pair(sent(["a", "fan"], [0.5]), None)
    fresh = commands.CommandReader("bag: /controls", commands.OWN, mapping.Commands())
    with pytest.raises(GroundError, match="not all of one craft"):
        fresh(sent(["a", "fan"], [0.5, 0.5]), None)  # a name for each thruster


# --- recordings


def rows_of(count=20):
    times = 50 + np.arange(count) / 10
    return (
        np.column_stack([times, 0.1 * times, 0 * times, 0 * times]),
        np.column_stack([times, np.tile([0.0, 0.5, 1.0], (count, 1))]),
    )


def checked(pose_rows, control_rows, **more):
    return recording.checked("f/run.bag", pose_rows, control_rows, "made up", [], **more)


def test_a_recording_has_the_rows_that_it_was_given():
    pose_rows, control_rows = rows_of()
    found = checked(pose_rows, control_rows[::-1])
    assert found.name == "run" and np.array_equal(found.eta, pose_rows[:, 1:])
    assert np.array_equal(found.control_times, control_rows[:, 0])  # sorted
    assert found.duration == pytest.approx(1.9)
    assert repr(found) == "<Recording run: 1.90 s, 20 poses, 20 commands>"
    frame = found.to_frame()
    assert list(frame.columns[-3:]) == ["left", "right", "lift"]
    assert frame["t"].iloc[-1] == pytest.approx(1.9) and frame["right"].iloc[3] == 0.5
    later = checked(pose_rows, control_rows[5:])
    assert later.to_frame()["left"].isna().sum() == 5


def spoilt(table, row, column, value):
    found = table.copy()
    found[row, column] = value
    return found


@pytest.mark.parametrize(
    "change,reason",
    [
        (lambda p, c: (p[:1], c), "only 1 poses"),
        (lambda p, c: (p, c[:1]), "only 1 controls"),
        (lambda p, c: (spoilt(p, 4, 2, np.nan), c), "1 of 20 poses are not finite, the first is number 5"),
        (lambda p, c: (p, spoilt(c, 7, 1, np.inf)), "1 of 20 controls are not finite, .* number 8"),
        (lambda p, c: (p * [0, 1, 1, 1] + [3, 0, 0, 0], c), "all poses have the same stamp, 3.000 s"),
        (lambda p, c: (spoilt(p, 9, 0, 50.2), c), "stamps of the poses jump back by 0.60 s at number 10"),
        (lambda p, c: (p, spoilt(c, 3, 2, 1.1)), "controls reach from 0 to 1.1, .* to 0..1; give their"),
        (lambda p, c: (p, c * [1, 100, 100, 100]), "they seem to be in percent"),
        (lambda p, c: (p, c * [1, 1000, 1000, 1000] + [0, 1000, 1000, 1000]), "they seem to be in micro"),
        (lambda p, c: (p, c * [1, -1, -1, 1]), "range: .-1, 1., one that cannot and is off at -1"),
        (lambda p, c: (p * [1, 1, 1, 0] + [0, 0, 0, 1] * (100 * p[:, :1] - 5000), c), "degrees, but radians"),
    ],
)
def test_rows_that_are_wrong_are_refused_with_their_place(change, reason):
    with pytest.raises(GroundError, match="f/run.bag: .*" + reason):
        checked(*change(*rows_of()))


def test_small_disorder_and_given_ranges_are_accepted():
    pose_rows, control_rows = rows_of()
    checked(spoilt(pose_rows, 9, 0, 50.35), control_rows)  # 0.45 s back
    checked(pose_rows, spoilt(control_rows, 3, 1, 1 + 1e-10))
    ranges = {"left": (-1.0, 1.0)}
    reverse = spoilt(control_rows, 3, 1, -0.5)
    assert checked(pose_rows, reverse, ranges=ranges).thrust.min() == -0.5
    with pytest.raises(GroundError, match="normalised to -1..1"):
        checked(pose_rows, spoilt(control_rows, 3, 1, -1.5), ranges=ranges)
    with pytest.raises(GroundError, match="normalised to 0..1"):
        checked(pose_rows, spoilt(control_rows, 3, 2, -0.5), ranges=ranges)


def test_commands_are_taken_by_their_names():
    pose_rows, control_rows = rows_of()
    found = checked(pose_rows, control_rows, channels=("a", "b", "lift"))
    assert found.thrusters == ("a", "b") and found.thrust[0].tolist() == [0, 0.5]
    assert found.lift[0] == 1 and found.commands_of(["lift", "a"])[0].tolist() == [1, 0]
    with pytest.raises(GroundError, match="no command is named c or d, .* the commands are a, b, lift"):
        found.commands_of(["c", "a", "d"])
    without = checked(pose_rows, control_rows, channels=("a", "b", "c"))
    assert without.thrusters == ("a", "b", "c") and not without.lift.any()
    model = types.SimpleNamespace(channels=["a", "b", "c"])
    assert without.with_lift_of(model).lift[0] == 1
    assert found.with_lift_of(model) is found
    assert without.with_lift_of(types.SimpleNamespace(channels=["fan"])) is without


# --- drafts


class Source:
    """A table as a MessageSource."""

    def __init__(self, **columns):
        self.columns, self.warnings = columns, []

    def get_type_and_topic_info(self):
        count = len(next(iter(self.columns.values())))
        return bag_reader.Topics({"log.csv": bag_reader.Topic(poses.TABLE, count)})

    def read_messages(self, topics):
        for values in zip(*(np.asarray(column).tolist() for column in self.columns.values())):
            yield "log.csv", fields.Row(zip(self.columns, values)), None


def log(count=400, **more):
    times = np.arange(count) / 100
    bits = np.random.default_rng(4).integers(0, 2, (2, count // 10 + 1)).repeat(10, axis=1)[:, :count]
    columns = dict(
        time=times, x=np.cos(times), y=np.sin(times), heading=times + 1.0, motor_1=bits[0], motor_2=bits[1]
    )
    return Source(**{**columns, **more})


def test_a_draft_of_a_table_names_pose_time_and_commands():
    text = drafts.draft(log(), "log.csv", False)
    assert "#   log.csv (table), 400 messages at 100.0 Hz" in text
    assert text.count("time: {field: time, unit: s}") == 2
    assert 'position: {fields: [x, "y"], unit: m}' in text and "  file: " not in text
    assert "heading: {field: heading, unit: rad, sign: 1}  # 1 to 4.99" in text
    assert "# x -1 to 1, y -0.7502 to 1, 1 a second" in text and "others" not in text
    assert "  channels:" in text and "{field: motor_1, unit: normalised}  # 0 to 1, " in text
    assert "  file: log.csv" in drafts.draft(log(), "log", True).replace('"', "")


def test_a_draft_says_the_units_of_what_it_finds():
    times = np.arange(400) / 100
    source = log(
        x=1000 * np.cos(times), y=1000 * np.sin(times), heading=np.degrees(1.5 * times),
        motor_1=1000 + 500 * (times > 1), motor_2=50 + 50 * (times > 2) * 1.0,
    )  # fmt: skip
    text = drafts.draft(source, "log.csv", False)
    assert "unit: mm}" in text and "heading: {field: heading, unit: deg, sign: 1}" in text
    assert "{field: motor_1, unit: microseconds}  # 1000 to 1500, 1 changes" in text
    assert "{field: motor_2, unit: percent}  # 50 to 100, 1 changes" in text
    odd = drafts.draft(log(motor_1=4000.0 * (times > 1)), "log.csv", False)
    assert "{field: motor_1, off: 0, full: 4000}  # 0 to 4000, 1 changes" in odd
    back = drafts.draft(log(motor_1=np.sign(times - 2.0)), "log.csv", False)
    assert "{field: motor_1, unit: normalised, range: [-1, 1]}" in back


def test_the_time_may_be_in_two_columns_and_is_no_command():
    times = np.arange(400) / 100
    source = log(**{"stamp.secs": (times // 1).astype(int), "stamp.nsecs": (times % 1 * 1e9).astype(int)})
    text = drafts.draft(source, "log.csv", False)
    assert "time: {field: stamp.secs, unit: s, nanoseconds: stamp.nsecs}" in text
    assert "nsecs, unit" not in text.split("channels:")[1]
    (columns,) = drafts.columns_of(source)
    assert np.allclose(columns.times, times)


@pytest.mark.parametrize(
    "name,values,unit",
    [
        ("t [ms]", [0, 1], "ms"),
        ("time_us", [5, 6], "us"),
        ("t", [1.6e18, 1.6e18 + 1e7], "ns"),
        ("t", [1.6e15, 1.6e15 + 1e4], "us"),
        ("t", [1.6e12, 1.6e12 + 10], "ms"),
        ("t", [1.6e9, 1.6e9 + 1], "s"),
        ("t", [0, 0.01, 0.02], "s"),
        ("t", [0, 10, 20], "ms"),
        ("t", [0, 1e4, 2e4], "us"),
        ("t", [0, 1e7, 2e7], "ns"),
    ],
)
def test_the_unit_of_a_time_follows_from_name_size_or_steps(name, values, unit):
    assert drafts._time_unit(name, np.array(values, float)) == unit


def test_names_that_yaml_would_misread_are_quoted():
    for name in ("y", "off", "a b", "1x", 'a"b', "no"):
        assert drafts._quoted(name).startswith('"')
    assert drafts._quoted('a"b') == '"a\\"b"'
    assert drafts._quoted("a.b_1") == "a.b_1" and drafts._quoted("x") == "x"


def test_channels_are_named_by_their_fields_and_the_lift_changes_least():
    switching = np.tile([0.0, 1.0], 10)
    still = np.ones(20)
    names = drafts._names({"m[0]": switching, "m[1]": still, "m[2]": switching})
    assert names == {"m[0]": "left", "m[1]": "lift", "m[2]": "right"}
    pair = drafts._names({"cmd.left": switching, "cmd.right": still})
    assert pair == {"cmd.left": "left", "cmd.right": "right"}
    four = drafts._names({"m[%d]" % i: switching for i in range(4)} | {"m[4]": still})
    assert four == {"m[%d]" % i: "m_%d" % i for i in range(4)} | {"m[4]": "lift"}
    assert drafts._names({"thrust.x": switching}) == {"thrust.x": "thrust_x"}


def test_a_quaternion_is_one_only_if_its_length_is_1():
    times = np.arange(300) / 100
    turn = {"q.x": 0 * times, "q.y": 0 * times, "q.z": np.sin(times), "q.w": np.cos(times)}
    place = {"p.x": times, "p.y": 0 * times, "p.z": 0 * times + 0.1}

    def columns(values):
        return drafts.Columns("log", "own/Type", 300, times, values)

    assert drafts.pose_guess(columns({**turn, **place})) is None  # nothing says that p belongs to it
    named = {"q.position.x": times, "q.position.y": 0 * times, "q.position.z": 0 * times}
    found = drafts.pose_guess(columns({**turn, **named}))
    assert found.rotation == tuple(turn) and found.position == tuple(named)
    assert drafts.is_pose(columns({**turn, **named}))
    assert not drafts.is_pose(columns({**{k: 2 * v for k, v in turn.items()}, **named}))
    assert not drafts.is_pose(columns(place))


def test_a_file_without_anything_is_named():
    with pytest.raises(GroundError, match="log.csv: nothing in it has poses or numbers"):
        drafts.draft(Source(time=np.arange(50.0), note=np.zeros(50)), "log.csv", False)


# --- tables


def test_the_exports_of_bags_have_groups(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time,position,x,y,orientation,w\n0,,1,2,,0.5\n1,,3,4,,0.6\n")
    frame = tables.table(str(path))
    assert list(frame.columns) == ["time", "position.x", "position.y", "orientation.w"]
    with tables.TableReader([str(path)]) as reader:
        assert reader.get_type_and_topic_info().topics["log.csv"] == bag_reader.Topic("table", 2)
        rows = list(reader.read_messages(["log.csv", "none.csv", "log.csv"]))
    assert [(name, dict(row)["position.y"], received) for name, row, received in rows] == [
        ("log.csv", 2, None),
        ("log.csv", 4, None),
    ]
    path.write_text("a,b,c\n1,,\n2,5,\n")
    frame = tables.table(str(path))
    assert list(frame.columns) == ["a", "b"] and frame["b"].isna().tolist() == [True, False]
    for text, reason in (
        ("", "does not name columns"),
        ("a\n1\n", "does not name columns"),
        ("a,b\n", "a table without rows"),
        ('a,b\n"1,2\n', "cannot be read as a table"),
    ):
        path.write_text(text)
        with pytest.raises(GroundError, match=reason):
            tables.table(str(path))


EXPORT = "%time,field.header.stamp,field.point.x,field.point.y,field.point.z\n"


def test_spaces_after_commas_are_no_part_of_a_value(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text('t, "left", name\n0, "0.5", "a, b"\n1,  "1", c\n')
    frame = tables.table(str(path))
    assert list(frame.columns) == ["t", "left", "name"]
    assert frame["left"].tolist() == [0.5, 1.0] and frame["name"].tolist() == ["a, b", "c"]


def test_a_suspicion_takes_both_thrusters_for_mirror_images():
    left, right = suspicions.PAIR
    assert (left.name, right.name) == ("left", "right") and left.y == -right.y < 0
    assert left.x == right.x == left.direction == right.direction == 0


def test_exports_of_rostopic_are_read_and_their_mistakes_named(tmp_path):
    path = tmp_path / "pose.csv"
    path.write_text(EXPORT + "11,10,1,2,3\n,20,4,5,6\n21,20,4,5,6\n")
    stamps, received, points = csv_exports.read_csv(str(path))
    assert stamps == [10, 20, 20] and received == [11, 20, 21]
    assert points.tolist() == [[1, 2, 3], [4, 5, 6], [4, 5, 6]]
    for line, reason in (
        ("3,2000000000,1,2,", "line 3: a value is missing or not a number"),
        ("3,2000000000,1,2,nan", "line 3: a value is not finite"),
        ("0,2000000000,1,2,3", "line 3: a stamp is not a time between 1970 and 2106"),
        ("3,%d,1,2,3" % (2**32 * 10**9), "line 3: a stamp is not a time between"),
        ("3,500000000,1,2,3", "line 3: the stamp is 0.500000 s before that of the row above"),
    ):
        path.write_text(EXPORT + "1,1000000000,1,2,3\n" + line + "\n")
        with pytest.raises(GroundError, match="pose.csv, " + reason):
            csv_exports.read_csv(str(path))
    path.write_text(EXPORT + "1,1000000000,1,2,3\n")
    with pytest.raises(GroundError, match="only 1 rows"):
        csv_exports.read_csv(str(path))
    path.write_text(EXPORT.replace("point.y", "point.q"))
    with pytest.raises(GroundError, match="line 1: no column field.point.y$"):
        csv_exports.read_csv(str(path))


# --- damage


def test_only_few_single_stamps_are_damage():
    times = 1000 + np.arange(0, 40, 0.1)
    for count, mended in ((4, 4), (5, 0)):  # 1% of 400
        stamps = times.copy()
        wrong = 4 + 20 * np.arange(count)  # their nanoseconds lack the bit
        stamps[wrong] += 2.0**29 * 1e-9
        found, number, error = plausibility.mend_stamps(stamps, times + 0.01)
        assert number == mended
        assert np.allclose(found, times if mended else stamps)
        assert error == pytest.approx(2.0**29 * 1e-9 if mended else 0)
    short = plausibility.mend_stamps(times[:5], times[:5])
    assert short[1] == 0 and np.array_equal(short[0], times[:5])


# --- messages at once


def test_groups_of_a_batch_keep_the_order_of_receipt():
    def group(places, **columns):
        kinds = [(name, float) for name in columns]
        table = np.array(list(zip(*columns.values())), dtype=kinds)
        return batches.Group(np.array(places), None, table)

    received = np.array([10**9, 2 * 10**9 + 5, 3 * 10**9])
    batch = batches.Batch(received, (group([0, 2], a=[1.0, 3.0], b=[4.0, 6.0]), group([1], a=[2.0], b=[5.0])))
    assert batch.values(["b", "a"]).tolist() == [[4, 1], [5, 2], [6, 3]]
    assert batch.values(["a", "c"]) is None and batch.stamps() is None
    assert batch.received == pytest.approx([1.0, 2.000000005, 3.0])
    stamped = batches.Batch(
        received,
        (group([0, 2], **{"header.stamp/s": [7, 9], "header.stamp/ns": [1, 2]}),
         group([1], **{"header.stamp/s": [8], "header.stamp/ns": [500000000]})),
    )  # fmt: skip
    seconds, whole = stamped.stamps()
    assert seconds == pytest.approx([7.000000001, 8.5, 9.000000002])
    assert whole.tolist() == [7 * 10**9 + 1, 8 * 10**9 + 500000000, 9 * 10**9 + 2]


# --- how a run was flown


def test_recordings_are_grouped_by_the_contents_of_their_files():
    def flown_by(name, text):
        found = recording_of(np.arange(3.0), np.zeros((3, 3)), np.zeros((3, 4)))
        vars(found).update(name=name, flown_by={"model": "m.yaml"})
        if text:
            vars(found)["files"] = {"model": flown.RunFile("/x/m.yaml", text)}
        return found

    one = "a: 1\nb: {c: 2, d: [1, 2]}\nprovenance: {by: me}\n"
    same = "# a comment\nb: {d: [1, 2], c: 2}\na: 1\nprovenance: {by: you}\n"
    other = "a: 1\nb: {c: 3}\ne: [{f: 1}]\ng: 4\nh: 5\n"
    assert flown.differences([flown_by("r1", one), flown_by("r2", same), flown_by("r3", None)]) == []
    found = flown.differences([flown_by("r1", one), flown_by("r2", other), flown_by("r3", same)])
    assert found[:2] == ["model m.yaml for r1, r3", "model m.yaml for r2"]
    assert found[2].startswith("two files named m.yaml differ: b.c 2 against 3, ")
    assert found[2].endswith("and 2 more") and "b.d [1, 2] against none" in found[2]
    entries = flown.RunFile("m.yaml", other).entries()
    assert entries == {"a": 1, "b.c": 3, "e.1.f": 1, "g": 4, "h": 5}
    assert flown.RunFile("m.yaml", "a: [").entries() == {"text": "a: ["}


# --- settings


def test_the_settings_of_a_time_hold_from_it_on():
    found = measured("x, y, z", 0.1, more=[(10, "x, -y, -z", 0.2), (20, "x, z, -y", 0.3)])
    stamps = [5.0, 10.0, 10.1, 20.0, 30.0]
    offsets = [0.1, 0.1, 0.2, 0.2, 0.3]  # it applies to poses that are stamped after it
    for stamp, offset in zip(stamps, offsets):
        assert found.heading(at(stamp), 1.0) == pytest.approx(1.0 - offset)
    assert [found.vertical(at(s)) for s in stamps] == [2, 2, 2, 2, 1]
    parts = list(found.parts(np.array([int(s * 1e9) for s in stamps])))
    assert [places.tolist() for _, places in parts] == [[0, 1], [2, 3], [4]]
    assert found.values("heading_offset") == (0.1, 0.2, 0.3)
    assert measured(taken=()).values("axes") is None
    described = found.describe(8.0)
    assert described["heading_offset"] == 0.1
    assert [change["time"] for change in described["changes"]] == pytest.approx([2.0, 12.0])
    for offset in (6.3, -6.3, float("nan")):
        with pytest.raises(GroundError, match="a test: heading_offset .* is out of range"):
            measured(offset=offset)
    measured(offset=-6.28)


# --- words of info


def test_a_thruster_is_said_to_do_what_is_certain():
    def does(forward, right, turn, *errors):
        return findings._does("a", dict(forward=forward, right=right, turn=turn, errors=errors))

    assert does(1.0, 0.1, 5.0, 0.1, 0.1, 1.0) == (
        "a pushes forward (1 +- 0.1 m/s2), turns right (5 +- 1 rad/s2)"
    )
    assert does(-1.0, -0.5, -5.0, 0.1, 0.1, 1.0) == (
        "a pushes backward (1 +- 0.1 m/s2), pushes to the left (0.5 +- 0.1 m/s2), "
        "turns left (5 +- 1 rad/s2)"
    )
    assert does(0.3, 0.0, 3.0, 0.1, 0.1, 1.0) == "a does nothing that is certain"
    assert "to the right" in does(1.0, 0.4, 0, 0.1, 0.1, 1)
    assert "right" not in does(1.0, 0.29, 0, 0.01, 0.01, 1)


def test_when_a_recording_begins():
    assert findings.when({"begins": 12.345}) == "from 12.35 s on of a simulated clock"
    assert findings.when({"begins": 1577934245.0}) == "2020-01-02 03:04:05 UTC"


def info(**changes):
    poses_of = dict(
        stamps_out_of_order=0, frozen=0, bursts=0, gaps=[], duplicate_stamps=0, overtaken=0,
        heading_wraps=0, mirrored_headings=0, spikes=[], count=100,
    )  # fmt: skip
    controls = dict(changes=30, start_after_poses=0.0, end_after_poses=0.0)
    d = dict(
        poses=poses_of, controls=controls, clock_offset=0.0, suspicions=[], reply={"lag": 0.02}, rest=0.0,
        rest_at_end=0.0, without_lift=[], contacts=[], changes=[], same_inputs_as=[],
    )  # fmt: skip
    for name, value in changes.items():
        place = poses_of if name in poses_of else controls if name in controls and name != "changes" else d
        place[name] = value
    return d


@pytest.mark.parametrize(
    "changes,sentence",
    [
        (dict(stamps_out_of_order=3), "stamps out of order, sorted: 3"),
        (dict(frozen=4), "dropped: 4"),
        (dict(clock_offset=0.06), "the stamps of the poses are -0.060 s off the clock of the commands"),
        (dict(reply=None), "are poses and commands of the same run"),
        (dict(bursts=5), "5 poses came within 1 ms of the one before"),
        (dict(gaps=[dict(start=2.0, length=0.3)]), "mocap lost 1 times for more than 50 ms: 0.30 s at 2.00"),
        (dict(duplicate_stamps=2), "repeated stamps: 2"),
        (dict(heading_wraps=7), "wraps of the heading, unwrapped: 7"),
        (dict(mirrored_headings=8), "flipped to the wrong sign, undone: 8"),
        (dict(overtaken=9), "put in order: 9"),
        (dict(spikes=[1.0, 2.5]), "spikes, smoothed over: 1.00 s, 2.50 s"),
        (dict(start_after_poses=-0.02), "commands start 0.02 s before the poses"),
        (dict(start_after_poses=0.3), "poses start 0.30 s before the commands, left out"),
        (dict(end_after_poses=0.02), "poses end 0.02 s before the commands"),
        (dict(end_after_poses=-0.3), "commands end 0.30 s before the poses, left out"),
        (dict(rest=0.3), "rests for 0.30 s at the start"),
        (dict(rest_at_end=0.3), "for 0.30 s at the end"),
        (dict(without_lift=[dict(start=1.0, end=1.5)]), "no lift, left out: 1.00 to 1.50 s"),
        (dict(contacts=[dict(start=1.0, end=1.5)]), "left out: 1.00 to 1.50 s"),
        (dict(same_inputs_as=["r2"]), "the same sequence of inputs as r2"),
    ],
)
def test_each_oddity_has_its_sentence(changes, sentence):
    (said,) = findings.findings(info(**changes))
    assert sentence in said


def test_a_clock_of_frames_that_was_rebuilt_is_described():
    late = dict(median=0.0123, largest=0.0456, above_50_ms=0)
    d = info(bursts=7)
    d["poses"]["frame_clock"] = dict(rate=99.987, lost=3, lateness=late)
    (said,) = findings.findings(d)
    assert "7 of 100 poses came within 1 ms" in said
    assert "99.99 Hz, 3 frames lost, stamps late by 12.3 ms in the middle and 46 ms at most" in said
    late["above_50_ms"] = 4
    assert list(findings.findings(d))[1] == "late bursts, stamps late by more than 50 ms: 4"


def described(**changes):
    """What quality.Run.describe gives for a plain run."""
    d = dict(
        begins=12.0, source="made up", flown_by={}, files={}, duration=20.0, reply={"lag": 0.0234},
        usable=dict(duration=15.0, spans=[[1.0, 9.0], [10.0, 17.0]]), drives=dict(begin=[1.5], by="record"),
        poses=dict(count=2000, rate=99.96, noise=dict(position=3.4e-4, heading=5.6e-3)), authority={},
        controls=dict(
            count=300, rate=15.02, changes=77, thrusters=["left", "right"], levels=[0.0, 0.8], lift=[0.5, 1.0]
        ),
        settings=measured(offset=0.1, more=[(14, "x, -y, -z", 0.2)]).describe(12.0),
    )  # fmt: skip
    return dict(findings.facts({**d, **changes}))


def test_facts_of_a_run_have_their_units():
    found = described()
    assert found["usable"] == "15.00 of 20.00 s: 1.00 to 9.00, 10.00 to 17.00"
    assert found["poses"] == "2000 at 100.0 Hz, noise 0.34 mm, 5.6 mrad"
    assert found["commands"] == "300 at 15.0 Hz, 77 changes, thrusters 0 to 0.8, lift 0.5 to 1"
    assert found["drive"] == "from 1.50 s on"
    assert found["reply"] == "the craft's motion follows the commands by 23 ms"
    assert found["measured"] == (
        "axes 'x, y, z' (a test), heading_offset 0.1 rad (a test); from 2.00 s on axes 'x, -y, -z', "
        "heading_offset 0.2 rad"
    )
    assert "flown by" not in found and "thrusters" not in found
    other = described(
        reply=None,
        usable=dict(duration=0.0, spans=[]),
        drives=dict(begin=[-0.5, 3.0], by="start"),
        flown_by=dict(controller="Tracking", model="m.yaml"),
        files=dict(model=dict(title="Craft")),
        settings=measured(taken=()).describe(0.0),
        authority=dict(a=dict(forward=1.0, right=0.0, turn=0.0, errors=(0.1, 0.1, 0.1))),
    )
    assert other["usable"].endswith("nothing") and "reply" not in other
    assert other["drive"].startswith("began 0.50 s before the run, from 3.00 s on; assumed: no command")
    assert other["flown by"] == "controller Tracking, model m.yaml ('Craft', kept with the run)"
    assert other["measured"] == "as states, corrected already" and "a pushes forward" in other["thrusters"]


def test_what_is_not_odd_is_not_said():
    usual = info(
        clock_offset=0.05, start_after_poses=-0.01, end_after_poses=0.01, rest=0.2, rest_at_end=0.2
    )
    assert list(findings.findings(usual)) == []
    assert list(findings.findings(info(start_after_poses=0.2, end_after_poses=-0.2))) == []
    few = info(reply=None)
    few["controls"]["changes"] = 19
    assert list(findings.findings(few)) == []
    few["controls"]["changes"] = 20
    assert len(list(findings.findings(few))) == 1
    clock = dict(kind="clock", evidence="e", remedy="r")
    assert list(findings.findings(info(reply=None, suspicions=[clock]))) == ["e; if so: r"]


def test_many_events_are_counted():
    gaps = [dict(start=float(i), length=0.1 * (i + 1)) for i in range(7)]
    (said,) = findings.findings(info(gaps=gaps))
    assert said.startswith("mocap lost 7 times") and said.endswith("and 3 more")
    assert "0.70 s at 6.00 s, 0.60 s at 5.00 s" in said  # the longest first
    change = dict(time=1.0, node="/n", name="k", before="", after="2")
    said = list(findings.findings(info(changes=[change] * 32)))
    assert len(said) == 31 and said[0] == "changed at 1.00 s: /n: k '' -> 2"
    assert said[-1].startswith("2 more live changes")


# --- layouts


def moments(count=12, samples=50, seed=3, noise=0.3):
    """Blocks of commands and of accelerations that follow them."""
    random = np.random.default_rng(seed)
    effects = np.array([[1.0, 0.1, 2.0], [0.8, -0.2, -2.5]])
    C = random.normal(size=(count, samples, 2))
    A = C @ effects + noise * random.normal(size=(count, samples, 3))
    found = evidence.Moments(
        np.einsum("bsn,bsc->bnc", C, A), np.einsum("bsn,bsm->bnm", C, C), (A**2).sum(axis=1), count * samples
    )
    return effects, C, A, found


def test_what_effects_leave_is_that_of_each_sample():
    """Forces share a factor, moments have another one; neither is negative."""
    effects, C, A, found = moments()
    flat_C, flat_A = C.reshape(-1, 2), A.reshape(-1, 3)
    noise = ((flat_A - flat_C @ np.linalg.lstsq(flat_C, flat_A, rcond=None)[0]) ** 2).mean(axis=0)
    for tried in (effects, 3 * effects, effects * [1, 1, -1], effects[::-1], -effects):
        left = found.unexplained(tried[None])[0]
        expected = flat_C @ tried
        weights = 1 / noise
        factors = np.zeros(3)
        for some in ([0, 1], [2]):
            size = ((expected[:, some] ** 2) * weights[some]).sum()
            factors[some] = max(0.0, (expected[:, some] * flat_A[:, some] * weights[some]).sum() / size)
        rest = (flat_A - factors * expected).reshape(A.shape)
        assert np.allclose(left, (rest**2).sum(axis=1))
    whole = found.together().unexplained(effects[None])[0, 0]
    assert np.allclose(whole, found.unexplained(effects[None])[0].sum(axis=0))
    assert np.allclose(found.unexplained(0 * effects[None])[0], found.totals)


def gathered(seed=3, noise=0.3):
    effects, _, _, found = moments(seed=seed, noise=noise)
    names = ("left", "right")
    recorded = Class((Hypothesis(names, (1, 1)),), effects)
    swapped = Class((Hypothesis(names[::-1], (1, 1)),), effects[::-1])
    classes = [recorded, swapped]
    both = {False: found, True: found}
    totals = {twisted: own.totals.sum(axis=0) for twisted, own in both.items()}
    return evidence.Evidence(classes, 2, evidence._unexplained(classes, both), totals, both)


def test_the_evidence_against_a_wrong_class_is_large_and_its_error_small():
    found = gathered()
    force, turn = found.shares(0)
    left = found.unexplained[0].sum(axis=0)
    assert force == pytest.approx(1 - left[:2].sum() / found.totals[False][:2].sum())
    assert turn == pytest.approx(1 - left[2] / found.totals[False][2]) and turn > 0.9
    logs, errors = found.log_ratios(0)
    assert logs[0] == errors[0] == 0
    sums = found.unexplained.sum(axis=1)
    assert logs[1] == pytest.approx(0.5 * np.log(sums[1] / sums[0]).mean())
    assert logs[1] > 5 * errors[1] > 0
    backwards, same_errors = found.log_ratios(1)
    assert backwards[0] == pytest.approx(-logs[1]) and same_errors[0] == pytest.approx(errors[1])
    assert found.log_ratio_of(found.classes[1], 0) == pytest.approx((logs[1], errors[1]))


def test_the_error_of_a_sum_is_that_of_its_parts():
    random = np.random.default_rng(4)
    parts = random.normal(size=(400, 40))
    said = evidence._error_of_sum(parts).mean()
    assert said == pytest.approx(np.sqrt(40), rel=0.15)
    alike = parts + np.roll(parts, 1, axis=1)  # neighbours are correlated
    true = alike.sum(axis=1).std()
    assert evidence._error_of_sum(alike).mean() == pytest.approx(true, rel=0.2)
    opposed = parts - np.roll(parts, 1, axis=1)  # which makes no sum more certain
    assert np.allclose(evidence._error_of_sum(opposed), np.sqrt(40 / 39 * (opposed**2).sum(axis=1)))
    assert evidence._error_of_sum(np.array([[3.0, 0.0]])) == pytest.approx([np.sqrt(2 * 9)])


@pytest.mark.parametrize("turn", [0.0, 0.3, -1.2])
def test_the_angle_of_the_forces_is_measured(turn):
    effects, C, A, _ = moments(noise=0.1)
    c, s = math.cos(turn), math.sin(turn)
    turned = A @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    own = evidence.Moments(
        np.einsum("bsn,bsc->bnc", C, turned), np.einsum("bsn,bsm->bnm", C, C), (turned**2).sum(axis=1), 600
    )
    both = {False: own, True: own}
    group = Class((Hypothesis(("left", "right"), (1, 1)),), effects)
    found = evidence.Evidence([group], 1, evidence._unexplained([group], both), {}, both)
    angle, error = found.angle(0)
    # Forces that are measured turned to the right show a heading that is measured too far to the left.
    assert angle == pytest.approx(-turn, abs=0.02) and 0 < error < 0.02


def test_blocks_hold_all_samples_once():
    times = np.concatenate([np.arange(200) / 100, 5 + np.arange(100) / 100])
    parts = list(evidence._blocks(times, 400))
    assert [i for part in parts for i in range(part.start, part.stop)] == list(range(300))
    assert all(np.ptp(times[part]) <= 0.5 + 1e-9 for part in parts)
    assert len(list(evidence._blocks(times, 3))) <= 4
    assert list(evidence._blocks(times[:1], 4)) == []


@pytest.mark.parametrize("count,blocks", [(1, 8), (100, 4), (401, 1)])
def test_many_recordings_have_few_blocks_each(monkeypatch, count, blocks):
    """Four hundred in all, but at least one of each."""
    random = np.random.default_rng(5)
    rest = reply.Rest(np.arange(40) / 10, random.normal(size=(40, 3)), random.normal(size=(40, 2)))
    monkeypatch.setattr(reply, "rest", lambda *given: rest)
    runs = [types.SimpleNamespace(recording=None, motion=None, reply=None)] * max(count, 1)
    found = evidence._moments(runs, ("left", "right"), False)
    assert found.samples == 40 * count and abs(len(found.totals) - blocks * count) <= count
    assert np.allclose(found.totals.sum(axis=0), count * (rest.accelerations**2).sum(axis=0))
    assert np.allclose(found.sizes.sum(axis=0), count * rest.commands.T @ rest.commands)


def said(channels, signs=(1, 1), **more):
    hypothesis = Hypothesis(tuple(channels), tuple(signs), **more)
    names = sorted(channels)
    return words.kind(hypothesis, names), words.suppositions(hypothesis, names), words.remedies(
        hypothesis, names, measured(offset=0.1)
    )


def test_hypotheses_are_said_with_their_remedies():
    assert said(["a", "b"]) == ("", "channels and heading are as recorded", [])
    kind, text, remedies = said(["b", "a"])
    assert (kind, text) == ("swap", "a and b are swapped")
    assert remedies == ["exchange the fields of a and b under commands.channels in a mapping"]
    kind, text, remedies = said(["b", "c", "a"], (1, 1, 1))
    assert text == "a is driven by b, b is driven by c and c is driven by a".replace(" and", ",", 0)
    assert remedies[0] == "give a the field of b under commands.channels in a mapping"
    kind, text, remedies = said(["a", "b"], (-1, 1))
    assert (kind, text) == ("invert", "a is inverted")
    assert "exchange the values off and full of a" in remedies[0]
    assert said(["a", "b"], (-1, -1))[1] == "both thrusters are inverted"
    assert said(["a", "b", "c"], (-1, -1, -1))[1] == "all thrusters are inverted"
    assert said(["a", "b", "c"], (-1, -1, 1))[1] == "a and b are inverted"
    kind, text, remedies = said(["a", "b"], (0, 1))
    assert (kind, text) == ("dead", "a does nothing") and "the motor of a turns" in remedies[0]
    kind, text, remedies = said(["a", "b"], heading_offset=math.pi / 2)
    assert (kind, text) == ("offset", "the heading is off by a quarter turn")
    assert remedies == ["--heading-offset 1.67"]
    assert said(["a", "b"], heading_offset=math.pi)[1].endswith("half a turn")
    assert said(["a", "b"], heading_offset=0.5)[1].endswith("off by 29 degrees")
    kind, text, remedies = said(["a", "b"], heading_sign=-1)
    assert (kind, text) == ("yaw", "the heading is of the wrong sign") and "sign: -1" in remedies[0]
    kind, text, remedies = said(["a", "b"], mirrored=True)
    assert (kind, text) == ("mirror", "the positions are mirrored") and "a minus before" in remedies[0]
    kind, text, remedies = said(["a", "b"], heading_sign=-1, mirrored=True)
    assert kind == "upside_down" and "upside down" in text and remedies == ['--axes "x, -y, -z"']


def test_a_verdict_is_said_with_its_evidence():
    names = ("a", "b", "c")
    recorded, best = Hypothesis(names, (1, 1, 1)), Hypothesis(("b", "a", "c"), (1, 1, 1))
    other = verdicts.Found(Hypothesis(names, (-1, 1, 1)), 0.5, 0.6, 1.1, (0.9, 1.2))

    def verdict(**more):
        found = dict(
            recorded=verdicts.Found(recorded, 0.596, 0.746, 1.5, (1.25, 1.75)),
            best=verdicts.Found(best, 0.812, 0.934, 1.0, (1.0, 1.0)),
            same=[], undecided=[], open_share=0.01, why="a hardly changes",
        )  # fmt: skip
        return verdicts.Verdict(**{**found, **more})

    text = words.sentence(verdict())
    assert text == (
        "a and b seem to be swapped: the commands explain 81% of the forces and 93% of the turns then, 60% "
        "and 75% as they are, which leaves 1.50 times the accelerations unexplained (95%: 1.25 to 1.75)"
    )
    assert words.evidence(verdict(best=verdict().recorded)) == (
        "the commands explain 60% of the forces and 75% of the turns"
    )
    same = words.sentence(verdict(same=[Hypothesis(names, (-1, -1, -1))]))
    assert same == text + "; the same to any motion: all thrusters are inverted"
    still_open = words.sentence(verdict(undecided=[other] * 3))
    assert still_open.startswith(text + "; it cannot be decided whether a is inverted; or a is inverted; or")
    assert still_open.endswith("a is inverted, because a hardly changes")
    assert "; or another, because" in words.sentence(verdict(undecided=[other] * 4))
    many = words.sentence(verdict(undecided=[other], open_share=0.31))
    assert many.endswith("do not decide which channel drives which thruster: a hardly changes")
    assert words.alternatives([best, other.hypothesis], names) == (
        "a and b seem to be swapped, or equally a is inverted"
    )


def test_a_supposition_costs_what_it_supposes():
    names = ("a", "b", "c")
    plain = Hypothesis(names, (1, 1, 1))
    costs = [
        plain.cost(names),
        Hypothesis(names, (1, 1, 1), math.pi).cost(names),
        Hypothesis(("b", "a", "c"), (1, 1, 1)).cost(names),
        Hypothesis(("b", "c", "a"), (1, 1, 1)).cost(names),
    ]
    assert costs[0] == 0 < costs[1] < costs[2] < costs[3]
    assert Hypothesis(names, (-1, 1, 1)).cost(names) < Hypothesis(names, (-1, 0, 1)).cost(names)
    one, all_of_them = Hypothesis(names, (-1, -1, 1)), Hypothesis(names, (-1, -1, -1))
    assert all_of_them.cost(names) <= one.cost(names)  # another convention
    upside_down = Hypothesis(names, (1, 1, 1), 0.0, -1, True)
    assert upside_down.cost(names) > Hypothesis(names, (1, 1, 1), 0.0, -1).cost(names) > 0


# --- mistakes that a run looks like


def suspected(check, monkeypatch, lag=None, far=None, drift=(0.0, np.inf, 0.0), evidence_of=9.0, **more):
    """Kinds and evidence of suspicions of a run whose reply is given."""
    values = dict(scatter=None, changes=30, end=20.0, command=1.0, fast=0.5, turning=0.0, taken=())
    values.update(more)
    times = np.arange(300) / 100
    eta = np.column_stack([values["fast"] * times, 0 * times, values["turning"] * times])
    rows = np.column_stack([times[::5], np.full((60, 2), values["command"]), np.ones(60)])
    rows[0, 1:3] = 0.0
    found = recording_of(times, eta, rows)
    vars(found)["settings"] = measured(taken=values["taken"])
    motion = types.SimpleNamespace(times=times, measured=eta, noise=(3e-4, 5e-3))
    run = types.SimpleNamespace(
        recording=found, motion=motion, end=values["end"], reply=None if lag is None else {"lag": lag}
    )
    monkeypatch.setattr(reply, "changes", lambda _: range(values["changes"]))
    monkeypatch.setattr(reply, "drift", lambda *_: reply.Drift(*drift))
    monkeypatch.setattr(reply, "drift_evidence", lambda *_: evidence_of)
    monkeypatch.setattr(reply, "lag_evidence", lambda *_: evidence_of)
    monkeypatch.setattr(reply, "far_lag", lambda *_: far)
    return [(s.kind, s.evidence, s.remedy) for s in check(run)]


@pytest.mark.parametrize(
    "lag,kind,words_of",
    [
        (0.02, None, ""), (0.15, None, ""), (-0.03, None, ""),
        (0.16, "delay", "160 ms after its commands and all at once"),
        (0.3, "delay", "300 ms after"), (0.31, "clock", "310 ms after its commands: the stamps"),
        (0.8, "clock", "800 ms after"),
        (-0.04, "clock", "40 ms BEFORE its commands: the stamps"), (-0.3, "clock", "300 ms BEFORE"),
    ],
)  # fmt: skip
def test_a_late_motion_is_another_clock_or_a_delay(monkeypatch, lag, kind, words_of):
    found = suspected(suspicions.clocks, monkeypatch, lag)
    assert [one[0] for one in found] == ([kind] if kind else [])
    if kind:
        assert words_of in found[0][1] and "clock_offset: %.2f in" % -lag in found[0][2]
        far = suspected(suspicions.clocks, monkeypatch, None, lag)  # where the commands explain little
        assert far == found
        assert suspected(suspicions.clocks, monkeypatch, lag, evidence_of=2.4) == []
        assert suspected(suspicions.clocks, monkeypatch, lag, changes=19) == []
        assert suspected(suspicions.clocks, monkeypatch, lag, changes=20) == found


def test_clocks_of_different_rates_are_suspected_if_that_is_certain(monkeypatch):
    def drifting(rate, error, **more):
        drift = (rate, error, 0.0)
        found = suspected(suspicions.clocks, monkeypatch, 0.02, None, drift, **more)
        return [kind for kind, _, _ in found]

    found = suspected(suspicions.clocks, monkeypatch, 0.02, None, (0.004, 1e-4, 0.0))
    assert found[0][0] == "drift" and "4.0 ms a second (+- 0.1)" in found[0][1]
    assert found[0][2] == "clock_drift: -0.00400 in a mapping"
    assert drifting(-0.004, 1e-4) == ["drift"]
    assert drifting(0.004, 0.9e-3) == [] and drifting(0.004, 0.7e-3) == ["drift"]  # five errors
    assert drifting(0.004, 1e-4, evidence_of=2.4) == []
    assert drifting(0.0014, 1e-4) == [] and drifting(0.0016, 1e-4) == ["drift"]  # 0.03 s in 20 s
    assert drifting(0.0016, 1e-4, end=15.0) == []


def test_small_commands_are_in_another_unit(monkeypatch):
    assert suspected(suspicions.forces, monkeypatch, 0.02, command=0.1) == []
    (found,) = suspected(suspicions.forces, monkeypatch, 0.02, command=0.09)
    assert found[0] == "command" and "no command exceeds 0.09 of full thrust" in found[1]
    assert suspected(suspicions.forces, monkeypatch, None, command=0.09) == []


def test_speeds_tell_lengths_in_another_unit(monkeypatch):
    assert suspected(suspicions.lengths, monkeypatch) == []
    (fast,) = suspected(suspicions.lengths, monkeypatch, fast=600.0)
    assert fast[0] == "length" and "600 m/s" in fast[1] and "position: {unit: mm}" in fast[2]
    (slow,) = suspected(suspicions.lengths, monkeypatch, fast=4e-3, turning=0.4)
    assert slow[0] == "length" and "0.4 rad/s, but goes 0.004 m/s only" in slow[1]
    assert suspected(suspicions.lengths, monkeypatch, fast=6e-3, turning=0.4) == []
    assert suspected(suspicions.lengths, monkeypatch, fast=4e-3, turning=0.29) == []


def test_turns_tell_headings_in_degrees_unless_they_are_of_quaternions(monkeypatch):
    (found,) = suspected(suspicions.angles, monkeypatch, turning=100.0)
    assert found[0] == "angle" and "headings reach 299 and change by 100 a second" in found[1]
    assert suspected(suspicions.angles, monkeypatch, turning=100.0, taken=("axes",)) == []
    assert suspected(suspicions.angles, monkeypatch, turning=3.0) == []


# --- tracks


def test_a_track_is_compared_with_its_reference_ahead_of_it():
    times = np.arange(400) / 100
    eta = np.column_stack([times, 0.5 * times, 0 * times])
    rows = np.column_stack([times[::10], np.full((40, 3), 0.5)])
    given = recording_of(times, eta, rows)
    stamps = np.arange(1.0, 3.0001, 0.05)
    reference = np.column_stack([stamps, stamps, 0.5 * stamps + 0.2, 1 + 0 * stamps, 0.5 + 0 * stamps])
    none = np.empty((0, 3))
    drivers = [(1.5, "pilot"), (0.5, "other"), (3.5, "late")]
    found = tracks._track(given, reference, none, np.array([[0.9, 1.0], [1.2, 2.0], [9, 3]]), drivers)
    assert found.began == 1.0 and found.controller == "pilot"
    assert found.times[0] == 0 and found.times[-1] == pytest.approx(2.0)
    assert np.allclose(found.errors, 0.2)
    assert found.computing == pytest.approx(np.array([[0.2, 2.0]]))
    assert found.inputs[:, 0] == pytest.approx(np.arange(21) / 10) and (found.inputs[:, 1:] == 0.5).all()
    holes = np.delete(reference, slice(10, 15), axis=0)  # 0.3 s without a reference
    part = tracks._track(given, holes, none, np.empty((0, 2)), drivers)
    assert np.allclose(part.errors, 0.2) and len(part.times) == pytest.approx(len(found.times) - 19.5, abs=1)
    assert tracks._track(given, reference[:20], none, np.empty((0, 2)), drivers) is None  # 0.95 s
    assert tracks._track(given, reference[:21], none, np.empty((0, 2)), drivers) is not None
