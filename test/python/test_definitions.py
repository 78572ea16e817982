"""Definitions of messages in files: they are data, and never run."""

import importlib
import io
import sqlite3
import struct
from random import Random

import numpy as np
import pytest
from conftest import identify
from containers import Ros2

import genpy
import genpy.dynamic
import ground
import rosbag
import roslib.message
from ground.recordings import bag_reader, definitions, ros2_reader
from ground_msgs.msg import Controls

SEPARATOR = "\n" + 80 * "=" + "\n"
HEADER = SEPARATOR + "MSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"

# Definitions whose text would write the file FILE if it became code.
INJECTIONS = {
    "end of a comment": 'string A=x"""; RUN; #\nfloat64 x\n# end \\',
    "apostrophes": "string A=x'''; RUN; #\nfloat64 x\n# end \\",
    "quotes in a comment": '# """\n# RUN\n# """\nfloat64 x',
    "name of a constant": "int32 RUN;A=5\nfloat64 x",
    "value of a constant": "bool A=RUN\nfloat64 x",
    "text of a constant": "string A='+str(RUN)+'\nfloat64 x",
    "escaped text": "string A=\\'); RUN #\nfloat64 x",
    "name of a field": "float64 x;RUN",
    "name on the next line": "float64 x\n    RUN",
    "name of a type": "RUN x",
    "name of an inner type": "own_msgs/Inner x" + SEPARATOR + 'MSG: own_msgs/Inner"""\nRUN\n"""',
    "inner type": "own_msgs/Inner i" + SEPARATOR + 'MSG: own_msgs/Inner\nstring A="""; RUN #\\\nint8 a',
    "default": 'float64 x 1.0\nstring s "+str(RUN)+"',
    "default list": "float64[] x [RUN]",
    "size": "float64[RUN] x",
    "bound": "float64[<=RUN] x",
    "bound of a string": "string<=RUN x",
    "line separator": "# x\u2028RUN\u2028\nfloat64 x",
    "next line": "# x\x85RUN\x85\nfloat64 x",
    "form feed": "# x\x0cRUN\x0c\nfloat64 x",
    "vertical tab": "string A=x\x0bRUN\x0b\nfloat64 x",
    "carriage return": "# x\rRUN\r\nfloat64 x",
    "escaped end of line": "string A=x\\nRUN\nfloat64 x",
    "braces": "string A={RUN}%(RUN)s\nfloat64 x",
    "dunder": "float64 __class__\nfloat64 __init__",
    "zero byte": "string A=\0RUN\0\nfloat64 x",
}
# In IDL, by the place of the code.
IDL = {
    "name of a member": "double x; double RUN;",
    "annotation": '@verbatim (language="comment", text="""RUN""") double x;',
    "annotation's text": "@default (value=RUN) double x;",
    "size of an array": "double x[RUN];",
    "bound of a sequence": "sequence<double, RUN> x;",
    "comment": 'double x; // \\""" RUN\n',
}
IDL_FILE = "module own_msgs { module msg { struct Pose { %s }; }; };"
IDL_CONSTANT = 'module own_msgs { module msg { module Pose_Constants { const string A = "%s"; };'
TYPES = ["own_msgs/Pose'+str(RUN)+'", 'own_msgs/"""\nRUN\n"""', "own_msgs/Pose\nRUN", "RUN", "a/b;RUN"]


@pytest.fixture
def planted(tmp_path):
    """A file that only code from a bag would write, and the code."""
    path = tmp_path / "planted"
    return path, 'open("%s","w").close()' % path


def ros1_bag(path, definition, kind, md5sum="0" * 32, data=bytes(8)):
    shown = {"_type": kind, "_md5sum": md5sum, "_full_text": definition}
    with rosbag.Bag(str(path), "w") as bag:
        for second in range(1, 4):
            raw = (kind, data, md5sum, 0, type("Pose", (), shown))
            bag.write("/pose", raw, genpy.Time(second), raw=True)
            bag.write("/controls", Controls(left=0.5), genpy.Time(second))
    return path


def ros2_bag(folder, plugin, definition, kind="own_msgs/msg/Pose", idl=False, data=bytes(12)):
    bag = Ros2(folder, plugin)
    with bag.writer as writer:
        digest = "RIHS01_" + "0" * 64
        connection = writer.add_connection("/pose", kind, msgdef=definition, rihs01=digest)
        for second in range(1, 4):
            writer.write(connection, second * 10**9, b"\0\1\0\0" + data)
    (file,) = folder.glob("*.db3" if plugin == "sqlite3" else "*.mcap")
    if idl and plugin == "mcap":
        content = file.read_bytes()
        assert b"ros2msg" in content
        file.write_bytes(content.replace(b"ros2msg", b"ros2idl"))
    elif idl:
        with sqlite3.connect(str(file)) as base:
            base.execute("UPDATE message_definitions SET encoding = 'ros2idl'")
    return file if plugin == "mcap" else folder


def is_harmless(path, planted):
    """Whether every way in reads a file or says in a line why not, and nothing runs."""
    mapping = path.parent / "drafted.yaml"
    for options in ([], ["--pose-topic", "/pose"], ["--write-mapping", mapping]):
        result = identify("info", path, *options)
        assert result.returncode in (0, 1), result.stderr
        assert "Traceback" not in result.stderr and "unexpected" not in result.stderr
        assert result.returncode == 0 or result.stderr.count("\n") == 1, result.stderr
        assert not planted.exists()
    with pytest.raises(ground.GroundError):
        ground.read(path, pose_topic="/pose")
    return not planted.exists()


@pytest.mark.parametrize("kind", ["geometry_msgs/PoseStamped", "own_msgs/Pose"])
@pytest.mark.parametrize("definition", INJECTIONS.values(), ids=INJECTIONS)
def test_a_definition_in_a_bag_runs_no_code(kind, definition, planted, tmp_path):
    path, code = planted
    bag = ros1_bag(tmp_path / "run.bag", definition.replace("RUN", code), kind)
    assert is_harmless(bag, path)


@pytest.mark.parametrize("plugin", ["sqlite3", "mcap"])
@pytest.mark.parametrize("definition", INJECTIONS.values(), ids=INJECTIONS)
def test_a_definition_in_a_bag_of_ros2_runs_no_code(plugin, definition, planted, tmp_path):
    path, code = planted
    bag = ros2_bag(tmp_path / "run", plugin, definition.replace("RUN", code))
    assert is_harmless(bag, path)


@pytest.mark.parametrize("plugin", ["sqlite3", "mcap"])
@pytest.mark.parametrize("member", IDL.values(), ids=IDL)
def test_a_definition_in_idl_runs_no_code(plugin, member, planted, tmp_path):
    path, code = planted
    definition = IDL_FILE % member.replace("RUN", code)
    assert is_harmless(ros2_bag(tmp_path / "run", plugin, definition, idl=True), path)


@pytest.mark.parametrize("kind", TYPES)
def test_the_name_of_a_type_runs_no_code(kind, planted, tmp_path):
    path, code = planted
    kind = kind.replace("RUN", code)
    assert is_harmless(ros1_bag(tmp_path / "run.bag", "float64 x", kind), path)
    for plugin in ("sqlite3", "mcap"):
        assert is_harmless(ros2_bag(tmp_path / plugin, plugin, "float64 x", kind), path)


HUGE = {
    "array": "float64[4000000000] x",
    "texts": "string[400000000] x",
    "messages": "I[400000000] x" + SEPARATOR + "MSG: own_msgs/I\nint8 a",
    "nothing": "I[400000000] x" + SEPARATOR + "MSG: own_msgs/I\n",
    "itself": "own_msgs/Pose x",
    "doubling": "A0 x"
    + "".join(SEPARATOR + "MSG: own_msgs/A%d\nA%d a\nA%d b" % (i, i + 1, i + 1) for i in range(60))
    + SEPARATOR
    + "MSG: own_msgs/A60\n",
}


@pytest.mark.parametrize("definition", HUGE.values(), ids=HUGE)
def test_a_definition_of_a_huge_message_costs_nothing(definition, planted, tmp_path):
    assert is_harmless(ros1_bag(tmp_path / "run.bag", definition, "own_msgs/Pose"), planted[0])
    for plugin in ("sqlite3", "mcap"):
        assert is_harmless(ros2_bag(tmp_path / plugin, plugin, definition), planted[0])


# --- what definitions say


def random_message(kind, random, depth=0):
    """A message of genpy with other than empty fields."""
    message = kind()
    for name, of in zip(kind.__slots__, kind._slot_types):
        setattr(message, name, random_value(of, random, depth))
    return message


def random_value(of, random, depth):
    if of.endswith("]"):
        inner, count = of[:-1].split("[")
        values = [random_value(inner, random, depth) for _ in range(int(count or 3 - depth))]
        return bytes(values) if inner in ("uint8", "char") else values
    if of == "string":
        return "".join(random.choices("ab \n\u00e9\u4e16", k=random.randrange(5)))
    if of == "time":
        return genpy.Time(random.randrange(2**32), random.randrange(10**9))
    if of == "duration":
        return genpy.Duration(random.randrange(-(2**31), 2**31), random.randrange(10**9))
    if of in ("float32", "float64"):
        return random.randrange(-100, 100) / 4
    if "/" in of:
        return random_message(roslib.message.get_message_class(of), random, depth + 1)
    return bool(random.randrange(2)) if of == "bool" else random.randrange(100)


def plain(value):
    """Numbers, texts and lists in a message, however it was decoded."""
    if hasattr(value, "to_nsec"):
        return value.to_nsec()
    if hasattr(value, "nanosec"):
        return value.sec * 10**9 + value.nanosec
    if isinstance(value, (bytes, list, tuple, np.ndarray)):
        return [plain(inner) for inner in value]
    if isinstance(value, (bool, int, float, str, np.generic)):
        return value
    names = getattr(value, "__slots__", None) or getattr(value, "__dict__", {})
    return {n: plain(getattr(value, n)) for n in names if n[0] != "_" and not n.isupper()}


def installed_types():
    """All messages of the packages whose definitions are common."""
    for package in ("std_msgs", "geometry_msgs", "nav_msgs", "visualization_msgs", "tf2_msgs",
                    "rosgraph_msgs", "dynamic_reconfigure", "ground_msgs"):  # fmt: skip
        module = importlib.import_module(package + ".msg")
        for name in sorted(dir(module)):
            kind = getattr(module, name)
            if isinstance(kind, type) and issubclass(kind, genpy.Message):
                yield kind


@pytest.mark.parametrize("kind", installed_types(), ids=lambda kind: kind._type)
def test_messages_are_decoded_as_ros_does_it(kind):
    """genpy generates its decoder from the same definition."""
    found = definitions.kind(kind._type, kind._full_text)
    assert found.md5sum == kind._md5sum
    random = Random(1)
    for _ in range(3):
        message, buffer = random_message(kind, random), io.BytesIO()
        message.serialize(buffer)
        decoded = found.decode(buffer.getvalue())
        assert plain(decoded) == plain(kind().deserialize(buffer.getvalue()))
        for cut in range(0, len(buffer.getvalue()), 7):
            with pytest.raises((ValueError, struct.error)):
                found.decode(buffer.getvalue()[:cut])


def foreign(constants="uint8 ON=01 # on\nfloat32 HALF = 5e-1\nstring NAME=a # 'b' \"\nint8 low=-1\n"):
    """The definition of a type that is not installed, and a message of it."""
    inner = SEPARATOR + "MSG: Own/Inner\nfloat32[2] pair\nfloat64 angle # \\\n"
    definition = "# poses\n" + constants + "Header header\nInner[] inner\nbool valid" + HEADER + inner
    data = struct.pack("<III", 0, 7, 8) + struct.pack("<I", 2) + b"ab" + struct.pack("<I", 1)
    return definition, data + struct.pack("<ffd", 0.5, 1.5, 2.5) + b"\1"


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_a_foreign_type_with_constants_is_read(ending, tmp_path):
    definition, data = foreign()
    md5sum = genpy.dynamic.generate_dynamic("Own/Pose", definition)["Own/Pose"]._md5sum
    definition = definition.replace("\n", ending)
    bag = ros1_bag(tmp_path / "run.bag", definition, "Own/Pose", md5sum, data)
    result = identify("info", bag, "--pose-topic", "/pose")
    assert "Own/Pose" in result.stderr and "damaged" not in result.stderr
    with bag_reader.BagReader(str(bag)) as source:
        messages = [message for _, message, _ in source.read_messages(["/pose"])]
        batch = source.batch("/pose")
        assert not source.warnings
    assert [list(m.inner[0].pair) + [m.inner[0].angle, m.valid] for m in messages] == 3 * [
        [0.5, 1.5, 2.5, True]
    ]
    assert batch.values(["inner[0].angle", "inner[0].pair[1]"]).tolist() == 3 * [[2.5, 1.5]]
    assert messages[0].header.stamp.to_nsec() == 7 * 10**9 + 8 and messages[0].header.frame_id == "ab"


def test_a_definition_that_is_not_that_of_the_messages_is_noticed(tmp_path):
    definition, data = foreign()
    bag = ros1_bag(tmp_path / "run.bag", definition, "Own/Pose", "0" * 32, data)
    with bag_reader.BagReader(str(bag)) as source:
        assert not list(source.read_messages(["/pose"])) and "(3)" in source.warnings[0]


def ros2_value(of, random, store):
    from rosbags.interfaces import Nodetype

    node, inner = of
    if node == Nodetype.NAME:
        return ros2_message(inner, random, store)
    if node == Nodetype.BASE:
        if inner[0] == "string":
            return "".join(random.choices("abc\u00e9", k=random.randrange(4)))
        if inner[0] == "bool":
            return bool(random.randrange(2))
        return random.randrange(100) / 4 if "float" in inner[0] else random.randrange(100)
    (kind, what), count = inner
    values = [ros2_value((kind, what), random, store) for _ in range(count or 3)]
    if node == Nodetype.SEQUENCE:
        values = values[: random.randrange(4)]
    if kind == Nodetype.BASE and what[0] != "string":
        return np.array(values, {"byte": "uint8", "char": "uint8"}.get(what[0], what[0]))
    return values


def ros2_message(name, random, store):
    kind = store.types[name]
    values = {n: ros2_value(of, random, store) for n, of in store.fielddefs[name][1]}
    return kind(**values)


@pytest.mark.parametrize("little", [True, False])
def test_messages_of_ros2_are_decoded_as_rosbags_does_it(little):
    """rosbags generates its decoders from the same definitions."""
    from rosbags.typesys import Stores, get_typestore

    store, random = get_typestore(Stores.ROS2_HUMBLE), Random(2)
    packages = ("std_msgs", "geometry_msgs", "nav_msgs", "sensor_msgs", "tf2_msgs", "diagnostic_msgs")
    names = [name for name in store.fielddefs if name.split("/")[0] in packages]
    assert len(names) > 80
    for name in names:
        message = ros2_message(name, random, store)
        data = bytes(store.serialize_cdr(message, name, little_endian=little))
        definition = store.generate_msgdef(name, ros_version=2)[0]
        decode = ros2_reader.decoder(name, definition)
        assert plain(decode(data)) == plain(message), name
