"""Drafts of mapping files and their loader: each choice beside the numbers at which it turns."""

import re

import numpy as np
import pytest
import yaml

from ground import _core
from ground.errors import GroundError
from ground.recordings import bag_reader, drafts, fields, mapping, poses, units

COUNT = 400
TIMES = np.arange(COUNT) / 100


class Stamp:
    """As codecs give times."""

    def __init__(self, seconds):
        self.seconds = seconds

    def to_sec(self):
        return self.seconds


class Source:
    """Topics as a MessageSource: by name, their type and columns of numbers with dots for fields."""

    def __init__(self, **topics):
        self.topics, self.warnings, self.read = topics, [], 0

    def get_type_and_topic_info(self):
        return bag_reader.Topics(
            {
                topic: bag_reader.Topic(kind, len(next(iter(columns.values()))))
                for topic, (kind, columns) in self.topics.items()
            }
        )

    def read_messages(self, topics):
        for topic in topics:
            kind, columns = self.topics[topic]
            for i in range(len(next(iter(columns.values())))):
                self.read += 1
                row = {path: np.asarray(values)[i] for path, values in columns.items()}
                if kind == poses.TABLE:
                    yield topic, fields.Row(row.items()), None
                else:
                    yield topic, nested(row), Stamp(i / 50)


def nested(row):
    """An object with slots, as messages have."""
    inner = {}
    for path, value in row.items():
        first, _, rest = path.partition(".")
        inner.setdefault(first, {})[rest] = value
    names = tuple(inner)
    found = type("Message", (), {"__slots__": names})()
    for name, part in inner.items():
        setattr(found, name, float(part[""]) if "" in part else nested(part))
    return found


def switching(seed=1, levels=(0.0, 1.0), held=10):
    random = np.random.default_rng(seed)
    return random.choice(levels, COUNT // held + 1).repeat(held)[:COUNT]


def pose(name="", size=1.0, height=0.1):
    """Columns of a pose that turns about z on a circle."""
    zero = 0 * TIMES
    place = {"x": size * np.cos(TIMES), "y": size * np.sin(TIMES), "z": zero + height * size}
    turn = {"x": zero, "y": zero, "z": np.sin(TIMES / 2), "w": np.cos(TIMES / 2)}
    return {name + "position." + k: v for k, v in place.items()} | {
        name + "orientation." + k: v for k, v in turn.items()
    }


def drafted(source, name="a.bag", in_folder=False):
    """The text of a draft, and its contents as YAML has them."""
    text = drafts.draft(source, name, in_folder)
    content = yaml.safe_load(text)
    assert content.pop("schema") == mapping.SCHEMA
    return text, content


# --- topics


def test_a_draft_of_topics_names_types_and_what_else_there_is():
    source = Source(
        **{
            "/far": ("own/Pose", pose("p.", 0.2)),
            "/near": ("own/Pose", pose("p.")),
            "/cmd": ("own/Command", {"m.a": switching(), "m.b": switching(2), "m.c": np.ones(COUNT)}),
            "/lamp": ("own/Lamp", {"on": switching(3)}),
            "/text": ("own/Count", {"seq": np.arange(COUNT) * 1.0}),
        }
    )
    text, content = drafted(source)
    found = content["poses"]
    assert (found["topic"], found["type"]) == ("/near", "own/Pose")  # it moves most
    assert found["position"] == {
        "fields": ["p.position.x", "p.position.y", "p.position.z"], "unit": "m",
    }  # fmt: skip
    assert found["orientation"] == ["p.orientation." + axis for axis in "xyzw"]
    assert found["axes"] == "x, y, z" or found["axes"] == "x, -y, -z"
    assert "body" not in found and "file" not in found and "time" not in found
    assert "  # others: /far (own/Pose)\n" in text
    commands = content["commands"]
    assert (commands["topic"], commands["type"]) == ("/cmd", "own/Command")
    assert {name: one["field"] for name, one in commands["channels"].items()} == {
        "left": "m.a", "right": "m.b", "lift": "m.c",
    }  # fmt: skip
    assert "  # time: receipt  # in place of the header's stamp" in text
    assert "  # others: /lamp (own/Lamp)" in text  # counters are no commands
    for topic in ("/far", "/near", "/cmd", "/lamp", "/text"):
        assert "#   %s (own/" % topic in text
    assert text.count("400 messages at 50.0 Hz") == 5  # by their receipt


def test_only_the_first_messages_are_read():
    long = Source(log=(poses.TABLE, {"t": np.arange(20005.0), "motor": np.arange(20005) % 2}))
    (columns,) = drafts.columns_of(long)
    assert len(columns.times) == 20000 and columns.count == 20005 and long.read == 20001


def test_columns_that_some_messages_lack_are_left_out():
    rows = [(0.5 * i, {"a": 1.0 * i, "b": 2.0} if i else {"a": 0.0, "c": 1.0}) for i in range(3)]
    found = drafts._columns("/x", bag_reader.Topic("own/T", 3), "craft", rows)
    assert list(found.values) == ["a"] and found.values["a"].tolist() == [0, 1, 2]
    assert found.times.tolist() == [0, 0.5, 1.0] and (found.body, found.clock) == ("craft", "")


def test_a_rate_needs_two_different_times():
    def rate(*times):
        return drafts._rate(drafts.Columns("/x", "own/T", len(times), np.array(times), {}))

    assert rate() == rate(3.0) == rate(2.0, 2.0) == ""
    assert rate(2.0, 2.5) == " at 2.0 Hz" and rate(0.0, 0.1, 0.2, 0.3) == " at 10.0 Hz"


def test_where_nothing_is_a_pose_or_a_command_it_is_said():
    text, content = drafted(Source(**{"/cmd": ("own/Command", {"a": switching()})}))
    assert content["poses"] == {"topic": ""} and "nothing in the file seems to have poses" in text
    text, content = drafted(Source(**{"/p": ("own/Pose", pose("p."))}))
    assert content["commands"] == {"topic": ""}
    assert "nothing in the file seems to have commands" in text and content["poses"]["topic"] == "/p"


def test_poses_of_other_lengths_have_their_unit_and_axes():
    for height, axes in ((0.1, 0), (-0.1, 1)):
        text, content = drafted(Source(**{"/p": ("own/Pose", pose("p.", 1000.0, height))}))
        assert content["poses"]["position"]["unit"] == "mm"
        assert content["poses"]["axes"] == units.VERTICAL[2][axes]
        assert "z moves least, 100% of the poses are upright by it" in text
        assert ("positive: up" if height > 0 else "negative: down") in text
        assert "# x -1000 to 1000, y -750.2 to 1000, z %g to %g, " % ((1000 * height,) * 2) in text


def test_a_planar_pose_needs_a_heading_and_two_coordinates():
    zero = 0 * TIMES

    def guess(**values):
        return drafts.pose_guess(drafts.Columns("/x", "own/T", COUNT, TIMES, values))

    assert guess(x=TIMES, y=zero, yaw=zero) == drafts.PoseGuess(("x", "y"), ("yaw",))
    for name in ("heading", "psi", "my_theta", "Yaw"):
        assert guess(**{"x": TIMES, "y": zero, name: zero}).rotation == (name,)
    assert guess(**{"p.x": TIMES, "p.y": zero, "p.yaw": zero}).position == ("p.x", "p.y")
    assert guess(**{"x [m]": TIMES, "y_m": zero, "psi": zero}).position == ("x [m]", "y_m")
    assert guess(x=TIMES, y=zero) is None and guess(x=TIMES, yaw=zero) is None
    assert guess(x=TIMES, y=zero, yawning=zero) is None
    assert guess(**{"x": TIMES, "y": zero, "a.x": zero, "yaw": zero}) is None  # which of them?


def test_headings_in_degrees_are_known_by_name_or_size():
    def unit(name, values):
        columns = {"time": TIMES, "x": np.cos(TIMES), "y": np.sin(TIMES), name: values}
        text, content = drafted(Source(log=(poses.TABLE, columns)), "log.csv")
        heading = content["poses"]["heading"]
        (axes,) = re.findall('# axes: "(.*)"  # where z points up', text)
        _core.AxisMapping(axes, 0.0)  # that a user may take: a frame
        assert heading["field"] == name and heading["sign"] == 1
        return heading["unit"]

    assert unit("heading", np.sin(TIMES)) == "rad" and unit("yaw", 100 * np.sin(TIMES)) == "deg"
    assert unit("heading [deg]", np.sin(TIMES)) == "deg" and unit("yaw (°)", np.sin(TIMES)) == "deg"


# --- columns that are the time


def clock(**values):
    columns = drafts.Columns("log", poses.TABLE, COUNT, TIMES, values)
    drafts._find_clock(columns)
    return columns


def test_the_time_is_a_column_that_rises():
    falls = TIMES.copy()
    falls[10:20] -= 1.0
    assert clock(a=-TIMES, b=TIMES).clock_fields == ("b",)
    assert clock(a=falls, time=TIMES).clock_fields == ("time",)
    assert clock(a=TIMES, time=falls).clock_fields == ("time",)  # one step in a hundred may be back
    noisy = TIMES - 0.5 * (np.arange(COUNT) % 16 == 15)
    assert clock(time=noisy, b=TIMES).clock_fields == ("b",)
    assert clock(time=np.full(COUNT, 3.0), b=TIMES).clock_fields == ("b",)
    assert clock(time=np.where(TIMES > 1, np.nan, TIMES), b=TIMES).clock_fields == ("b",)
    assert clock(a=TIMES / 10).clock_fields == ("a",)  # also of less than a second
    none = clock(a=-TIMES)
    assert none.clock_fields == () and none.clock == "" and none.times is TIMES
    of_three = clock(a=TIMES, stamp=1000 * TIMES, time_s=TIMES)
    assert of_three.clock_fields == ("stamp",) and "unit: ms" in of_three.clock
    assert of_three.times == pytest.approx(TIMES)


def test_seconds_need_their_nanoseconds():
    whole, rest = TIMES // 1, (TIMES % 1) * 1e9
    found = clock(**{"h.secs": whole, "h.nsecs": rest})
    assert found.clock_fields == ("h.secs", "h.nsecs") and found.times == pytest.approx(TIMES)
    assert found.clock == "{field: h.secs, unit: s, nanoseconds: h.nsecs}"
    assert clock(**{"h.secs": whole, "g.nsecs": rest}).clock_fields == ("h.secs",)


@pytest.mark.parametrize(
    "unit,below,since", [("ns", "us", 1e17), ("us", "ms", 1e14), ("ms", "s", 1e11), ("s", "ns", 1e8)]
)
def test_times_since_1970_are_known_by_their_size(unit, below, since):
    """Each unit is that of times from 1973 on: 1e8 s. Below them all, steps say it: here nanoseconds."""
    for factor, expected in ((1.01, unit), (0.99, below)):
        assert drafts._time_unit("t", factor * since + np.arange(3) * 2e6) == expected


@pytest.mark.parametrize(
    "step,unit", [(0.99, "s"), (1.0, "ms"), (999.0, "ms"), (1000.0, "us"), (9.9e5, "us"), (1e6, "ns")]
)
def test_times_from_zero_are_known_by_their_steps(step, unit):
    """Faster than 1 kHz, or slower than 1 Hz, is nobody."""
    assert drafts._time_unit("t", np.arange(5) * step) == unit
    assert drafts._time_unit("x", 7.0 + np.array([0, 1, 2, 3, 90]) * step) == unit  # one pause


# --- commands


def score(topic="/x", **values):
    return drafts._command_score(drafts.Columns(topic, "own/T", COUNT, TIMES, values))


def test_commands_switch_change_and_have_likely_names():
    smooth = np.linspace(0, 1, COUNT)
    assert score(a=0 * TIMES) == score(a=1e4 * smooth) == score(seq=switching()) == 0
    assert score(a=np.ones(COUNT)) == 1 and score(a=smooth) == 1
    assert score(a=switching()) == 2 and score("/cmd_vel", a=switching()) == 4
    assert score(a=switching(), b=smooth) == 1.5 and score(pwm_1=switching()) == 4
    assert score(a=np.ones(COUNT), b=switching()) == 2  # one of them changes
    assert score("/motors", a=1e4 * switching()) == 4  # in no known unit
    assert score(a=np.linspace(1000, 2000, COUNT)) == 2  # no other numbers are like these


def test_forty_levels_still_switch():
    for count, switches in ((40, True), (41, False)):
        levels = np.linspace(0, 1, count)
        values = np.append(levels, switching(levels=levels, held=1)[count:])
        assert score(a=values) == 1 + switches


def test_time_pose_and_endless_values_are_no_commands():
    table = {"time": TIMES, "x": np.cos(TIMES), "y": np.sin(TIMES), "yaw": switching(), "b": switching(2)}
    table["c"] = np.where(TIMES > 1, np.inf, 1.0)
    _, content = drafted(Source(log=(poses.TABLE, table)), "log.csv")
    assert [one["field"] for one in content["commands"]["channels"].values()] == ["b"]
    text, content = drafted(Source(log=(poses.TABLE, table)), "logs", True)
    assert content["poses"]["file"] == content["commands"]["file"] == "log"
    assert "# time: receipt" not in text and content["commands"]["time"]["field"] == "time"


def test_a_constant_number_is_drafted_where_nothing_else_is():
    _, content = drafted(Source(**{"/x": ("own/T", {"a": np.full(COUNT, 0.5)})}))
    assert content["commands"]["channels"]["a"]["field"] == "a"


def test_a_channel_is_described_by_its_unit_range_and_changes():
    def line(*values):
        return drafts._channel("a", "m.a", np.array(values, float))

    assert line(0, 1, 1, 0) == "a: {field: m.a, unit: normalised}  # 0 to 1, 2 changes"
    assert line(-1, 0.5) == "a: {field: m.a, unit: normalised, range: [-1, 1]}  # -1 to 0.5, 1 changes"
    assert line(0, 100) == "a: {field: m.a, unit: percent}  # 0 to 100, 1 changes"
    assert line(-50, 50) == "a: {field: m.a, unit: percent, range: [-1, 1]}  # -50 to 50, 1 changes"
    assert line(1000, 1900, 1000) == "a: {field: m.a, unit: microseconds}  # 1000 to 1900, 2 changes"
    assert line(3, 250) == "a: {field: m.a, off: 3, full: 250}  # 3 to 250, 1 changes"


def test_lift_is_the_channel_that_changes_least_and_two_others_are_a_pair():
    still, often, seldom = np.ones(COUNT), switching(), switching(2, held=50)
    assert drafts._names({"a": often, "b": seldom}) == {"a": "a", "b": "lift"}
    assert drafts._names({"c": still, "b": often, "a": seldom}) == {
        "c": "lift", "b": "left", "a": "right",
    }  # fmt: skip
    assert drafts._names({"x.left": often, "x.right": still, "x.fan": seldom}) == {
        "x.left": "left", "x.right": "right", "x.fan": "fan",
    }  # fmt: skip


def test_units_of_commands_are_known_by_their_range():
    cases = {
        "microseconds": [(800, 2200), (1000, 1000), (1500, 1600)],
        "percent": [(0, 100), (-100, 100), (0, 10.5), (-100, 11)],
        "normalised": [(0, 1), (-1, 1), (0, 0), (-0.5, 0.5)],
        None: [(799, 2200), (800, 2201), (0, 101), (-101, 50), (0, 10), (0, 1.01), (-1.01, 0), (2, 3)],
    }
    for unit, ranges in cases.items():
        for low, high in ranges:
            assert units.command_unit(np.array([low, high], float)) == unit, (low, high)


# --- the loader


def load(tmp_path, **content):
    path = tmp_path / "M.yaml"
    path.write_text(yaml.safe_dump({"schema": mapping.SCHEMA, **content}))
    return mapping.load(str(path))


def channels(**more):
    return {"channels": {"left": {"field": "a", **more}}}


def refused(tmp_path, match, **content):
    with pytest.raises(GroundError, match=match):
        load(tmp_path, **content)


def test_units_of_channels_say_what_off_and_full_are(tmp_path):
    for unit, off, full in (("normalised", 0, 1), ("percent", 0, 100), ("microseconds", 1000, 2000)):
        (found,) = load(tmp_path, commands=channels(unit=unit)).commands.channels
        assert found.commands(np.array([off, full, (off + full) / 2])).tolist() == [0, 1, 0.5]
    (found,) = load(tmp_path, commands=channels()).commands.channels
    assert (found.off, found.full, found.scale, found.sign, found.range) == (0, 1, 1, 1, (0, 1))
    (found,) = load(tmp_path, commands=channels(off=10, full=20, scale=2, sign=-1)).commands.channels
    assert found.commands(np.array([10.0, 20, 15])).tolist() == [0, -2, -1]
    refused(tmp_path, "commands.channels.left.colour is unknown", commands=channels(colour="red"))
    for more in ({"off": 1}, {"full": 0}, {"off": 5, "full": 5}):
        refused(tmp_path, "channels.left.full is the same as off", commands=channels(**more))
    for more in ({"off": 0.5}, {"full": 9}):
        refused(
            tmp_path, "left.unit and off or full are both", commands=channels(unit="percent", **more)
        )


def test_times_have_the_units_of_si(tmp_path):
    assert mapping.TIMES == {"s": 10**9, "ms": 10**6, "us": 1000, "ns": 1}
    assert mapping.LENGTHS == {"m": 1, "cm": 0.01, "mm": 0.001, "in": 0.0254}
    assert mapping.ANGLES["deg"] == pytest.approx(np.radians(1)) and mapping.ANGLES["rad"] == 1
    found = load(tmp_path, poses={"time": {"field": "t"}}, commands={"time": {"field": "t", "unit": "us"}})
    assert (found.poses.time.unit, found.commands.time.unit) == ("s", "us") and found.of_tables
    assert not load(tmp_path, poses={"time": {"field": "t"}}).of_tables
    assert not load(tmp_path, commands={"time": {"field": "t"}}).of_tables


def test_names_of_channels_are_words(tmp_path):
    for name in ("a.b", "a[0]", "a-b", "a b", ""):
        refused(tmp_path, "the channel '.*' is not a name: use letters", commands={"channels": {name: {}}})
    refused(tmp_path, "the channel '3' is not a name", commands={"channels": {3: {"field": "a"}}})


def test_eight_thrusters_and_a_fan_are_the_most(tmp_path):
    def many(count):
        return {"channels": {"c%d" % i: {"field": "a"} for i in range(count)}}

    assert len(load(tmp_path, commands=many(9)).commands.channels) == 9
    refused(tmp_path, "commands.channels are 10, but there may be at most 9", commands=many(10))


def test_the_fan_is_one_of_the_channels(tmp_path):
    assert load(tmp_path, commands={**channels(), "lift": "left"}).commands.lift == "left"
    assert load(tmp_path, commands=channels()).commands.lift == "lift"
    refused(tmp_path, "commands.lift is fan, which is none of the channels: left$",
            commands={**channels(), "lift": "fan"})  # fmt: skip


def test_ranges_are_within_one_and_ascend(tmp_path):
    for good in ([-1, 1], [0, 0.5], [-0.5, -0.25]):
        (found,) = load(tmp_path, commands=channels(range=good)).commands.channels
        assert list(found.range) == good
    for bad in ([0, 0], [0, 1.01], [-1.01, 1], [0], [0, 0.5, 1], [False, 1], ["0", 1], 1, [0.5, 0]):
        refused(tmp_path, "left.range is .*, but must be two numbers within -1", commands=channels(range=bad))


def test_drifts_are_below_a_tenth(tmp_path):
    assert load(tmp_path, clock_drift=-0.0999).clock_drift == -0.0999
    assert load(tmp_path).clock_drift == load(tmp_path).clock_offset == 0
    for drift in (0.1, -0.1, 0.5):
        refused(tmp_path, "clock_drift is .*, but must be within -0.1 and 0.1", clock_drift=drift)


def test_what_excludes_each_other_is_not_given_together(tmp_path):
    place = {"fields": ["x", "y"]}
    load(tmp_path, poses={"position": place, "heading": {"field": "h"}})
    load(tmp_path, poses={"heading": {"field": "h", "unit": "deg", "sign": -1}})
    refused(tmp_path, "poses.file and topic are both given", poses={"topic": "/a", "file": "b"})
    refused(tmp_path, "poses.heading and orientation are both given",
            poses={"heading": {"field": "h"}, "orientation": list("abcd")})  # fmt: skip
    refused(tmp_path, "position has fields, but neither orientation", poses={"position": place})
    refused(tmp_path, "position.fields has 4 fields, but needs 2 or 3",
            poses={"position": {"fields": list("abcd")}})  # fmt: skip
    for bad in ("x", [1, 2], ["x", ""]):
        refused(tmp_path, "position.fields must be a list of fields", poses={"position": {"fields": bad}})
    refused(tmp_path, "poses.position.scale is 0$", poses={"position": {"scale": 0}})
    refused(tmp_path, "left.scale is 0$", commands=channels(scale=0))


def test_a_source_of_every_key_is_kept(tmp_path):
    plain = load(tmp_path)
    assert plain.poses == mapping.DEFAULT.poses == mapping.Poses(scale=1.0, heading_sign=1)
    assert plain.sources == {} and plain.poses.axes is None and plain.poses.heading_offset is None
    given = load(tmp_path, poses={"heading_offset": 0, "axes": "x, y, z"})
    assert given.poses.heading_offset == 0 and set(given.sources) == {"axes", "heading_offset"}
    assert given.sources["axes"] == given.file
    changed = given.with_options(heading_offset=0.5)
    assert changed.sources == {"axes": given.file, "heading_offset": "--heading-offset"}
    assert given.with_options() == given


def test_axes_are_guessed_by_uprightness_before_spread():
    random = np.random.default_rng(1)
    level = random.normal(0, 1, (60, 3)) * [1, 0.5, 0.2]
    turned = np.column_stack([0 * TIMES, np.sin(TIMES / 2), 0 * TIMES, np.cos(TIMES / 2)])[::7][:58]
    axes, share, why = drafts.axes_guess(level[:58] + [0, 0.9, 0], turned)
    assert axes == units.VERTICAL[1][0] and share > 0.9 and why.startswith("y moves least")
    still = np.tile([0.0, 0, 0, 1], (60, 1))  # upright about each
    assert drafts.axes_guess(level, still)[2].startswith("z moves least, 100%")
