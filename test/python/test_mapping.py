"""Mapping files: what they say is taken, and what is wrong is named."""

import numpy as np
import pytest

from ground.reading import mapping
from ground.support.errors import GroundError

WHOLE = """
schema: ground/mapping/1
poses:
  topic: /mocap
  type: geometry_msgs/msg/PoseStamped
  body: craft
  position: {fields: [a.x, a.y, "b[0]"], unit: mm, scale: 2}
  orientation: [q.x, q.y, q.z, q.w]
  axes: "x, -y, -z"
  heading_offset: 0.5
  time: {field: secs, unit: s, nanoseconds: nsecs}
commands:
  topic: /cmd
  time: receipt
  channels:
    back_left: {field: position.x, off: 1000, full: 1800, range: [-1, 1]}
    front: {field: "data[2]", unit: percent, sign: -1, scale: 0.5}
clock_offset: -0.25
"""


def load(tmp_path, text):
    path = tmp_path / "M.yaml"
    path.write_text(text)
    return mapping.load(str(path))


def test_all_keys_are_taken(tmp_path):
    found = load(tmp_path, WHOLE)
    poses, commands = found.poses, found.commands
    assert (poses.topic, poses.type, poses.body) == ("/mocap", "geometry_msgs/PoseStamped", "craft")
    assert poses.position == ("a.x", "a.y", "b[0]") and poses.unit == "mm" and poses.scale == 2
    assert poses.orientation == ("q.x", "q.y", "q.z", "q.w")
    assert poses.axes == "x, -y, -z" and poses.heading_offset == 0.5
    assert poses.time == mapping.Clock("", "secs", "s", "nsecs")
    assert commands.time == mapping.Clock("receipt")
    back, front = commands.channels
    assert (back.name, back.field, back.range) == ("back_left", "position.x", (-1, 1))
    assert back.commands(np.array([1000.0, 1800, 1400, 600])).tolist() == [0, 1, 0.5, -0.5]
    assert front.commands(np.array([0.0, 100])).tolist() == [0, -0.5]
    assert found.clock_offset == -0.25
    assert set(found.sources) == {"axes", "heading_offset"}


def test_options_come_before_the_file(tmp_path):
    found = load(tmp_path, WHOLE).with_options("/pose", "/thrust", "car", "x, z, -y", 0.1)
    assert (found.poses.topic, found.poses.body, found.commands.topic) == ("/pose", "car", "/thrust")
    assert (found.poses.axes, found.poses.heading_offset) == ("x, z, -y", 0.1)
    assert found.poses.scale == 2
    assert found.sources == {"axes": "--axes", "heading_offset": "--heading-offset"}


WRONG = [
    ("schema: ground/mapping/1", "schema: ground/model/1", "its schema is ground/model/1"),
    ("schema: ground/mapping/1", "", "not a mapping: write schema: ground/mapping/1"),
    ("unit: mm", "unit: inch", "poses.position.unit: 'inch' is not one of .*'m', 'cm', 'mm'"),
    ("scale: 2", "scale: fast", "poses.position.scale: must be a number"),
    ("scale: 2", "scale: 0", "poses.position.scale: must be a number, but not 0"),
    ("scale: 2", "scale: true", "poses.position.scale: must be a number"),
    ("q.z, q.w]", "q.z]", "poses.orientation: .* too short"),
    ("  orientation", "  orientatoin", "poses: .*orientatoin .did you mean orientation"),
    ("body: craft", "bodies: craft", "poses: .*bodies.*allowed are topic, .*body"),
    ('"x, -y, -z"', '"x, y, -z"', "poses.axes is not a frame: .*right-handed"),
    ("sign: -1", "sign: 2", "commands.channels.front.sign: 2 is not one of"),
    ("[-1, 1]", "[1, 0]", "commands.channels.back_left.range is .* must be two numbers"),
    ("[-1, 1]", "[-2, 1]", "commands.channels.back_left.range.0: -2 is less than"),
    ("full: 1800", "full: 1000", "commands.channels.back_left.full is the same as off, 1000"),
    ("off: 1000", "unit: percent", "back_left.unit and off or full are both given"),
    ("field: position.x, ", "", "commands.channels.back_left: 'field' is a required property"),
    ("    front:", "    front left:", "commands.channels: names of channels have letters"),
    ("field: secs, ", "", "poses.time: .*field"),
    ("time: receipt", "time: yesterday", "commands.time: must be header, receipt, or a field"),
    ("clock_offset: -0.25", "clock_offset: .nan", "nan is not a finite number"),
    ("clock_offset: -0.25", "clock_drift: 0.2", "clock_drift: 0.2 is greater than"),
    ("clock_offset: -0.25", "offset: 1", "unknown key offset"),
    ("clock_offset: -0.25", "rows: [5, 2]", r"rows is \[5, 2\], but must be the first and the last row"),
    ("clock_offset: -0.25", "inertial: {yaw_rate: r}", "inertial has yaw_rate or acceleration; name the"),
    ("topic: /cmd", "topic: /cmd\n  file: a.csv", "commands.file and topic are both given; keep one"),
    ("  axes", "  heading: {field: psi}\n  axes", "poses.heading and orientation are both given; keep one"),
    ("  orientation: [q.x, q.y, q.z, q.w]", "", "poses.position has fields, but neither orientation"),
    ("  orientation: [q.x, q.y, q.z, q.w]", "  heading: {unit: deg}", "poses.heading: 'field' is a required"),
]


@pytest.mark.parametrize("text, wrong, reason", WRONG, ids=[w[1] or w[2] for w in WRONG])
def test_what_is_wrong_is_named(text, wrong, reason, tmp_path):
    assert WHOLE.count(text) == 1
    with pytest.raises(GroundError, match=reason):
        load(tmp_path, WHOLE.replace(text, wrong))


@pytest.mark.parametrize("text", ["[1, 2", "- a\n- b\n", "poses: 3\nschema: ground/mapping/1\n"])
def test_nonsense_is_refused(text, tmp_path):
    with pytest.raises(GroundError, match="M.yaml: .*(not YAML|not a mapping|not of type)"):
        load(tmp_path, text)


def test_lines_that_are_left_to_decide_are_named(tmp_path):
    unit, axes, other = "no unit is given", "where z points", "other columns: m1"
    text = WHOLE.replace("unit: mm, scale: 2}", "unit: mm}  # undecided: %s" % unit)
    text = text.replace("  axes:", "  # axes:").replace('-z"', '-z"  # 0 to 1, undecided: %s' % axes)
    text += "# undecided: %s\n" % other
    numbers = [i for i, line in enumerate(text.splitlines(), 1) if "undecided: " in line]
    found = load(tmp_path, text).undecided
    assert len(found) == len(numbers) == 3
    for warning, number, what in zip(found, numbers, (unit, axes, other)):
        assert "M.yaml, line %d " % number in warning and what in warning
    assert load(tmp_path, WHOLE.replace("/mocap", '"undecided: "')).undecided == ()
