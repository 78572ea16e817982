"""Commands of one craft that stand in several tables or topics, such as one for each thruster."""

import numpy as np
import pytest
import yaml

import containers
import ground
from conftest import ROOT, identify, simulate_run, succeeds

START = 1700000000


@pytest.fixture(scope="module")
def run():
    return simulate_run(duration=4.0)


def stamp(time, padded=True):
    seconds, nanoseconds = divmod(int(round(1e9 * time)), 10**9)
    return ("2023/11/14 22:13:%02d.%09d" if padded else "2023/11/14 22:13:%02d.%d") % (
        20 + seconds,
        nanoseconds,
    )


def table(path, names, rows, padded=True):
    lines = ["%s,%s" % (stamp(row[0], padded), ",".join("%.9g" % v for v in row[1:])) for row in rows]
    path.write_text("\n".join(["time," + ",".join(names), *lines]) + "\n")


def folder(path, run, padded=True, shift=2e-4, angle=60.0):
    """A folder of a run with a table for each thruster, whose stamps differ by `shift` [s]."""
    times, eta, inputs = run
    path.mkdir()
    table(path / "pose.csv", ["x", "y", "psi"], np.column_stack([times, eta]), padded)
    turned = angle * np.sin(7 * inputs[:, 0])
    for number in (1, 2):
        rows = np.column_stack(
            [inputs[:, 0] + (number - 1) * shift, 400 * inputs[:, number], number * turned]
        )
        table(
            path / ("actuator_ref_%d.csv" % number), ["throttle_reference", "angle_reference"], rows, padded
        )
    return path


@pytest.mark.parametrize("padded", [True, False], ids=["", "unpadded stamps"])
def test_a_draft_takes_the_tables_of_all_thrusters(run, tmp_path, padded):
    path, draft = folder(tmp_path / "run", run, padded), tmp_path / "M.yaml"
    succeeds("info", path, "--write-mapping", draft)
    channels = yaml.safe_load(draft.read_text())["commands"]["channels"]
    assert list(channels) == [
        "throttle_reference_1", "angle_reference_1", "throttle_reference_2", "angle_reference_2",
    ]  # fmt: skip
    assert [one["file"] for one in channels.values()] == 2 * ["actuator_ref_1.csv"] + 2 * [
        "actuator_ref_2.csv"
    ]
    assert all(one["full"] == 180 and one["range"] == [-1, 1] for one in list(channels.values())[1::2])

    (found,) = ground.read(path, mapping=draft)
    _, _, inputs = run
    assert found.channels == tuple(channels)
    held = found.held(found.controls, START + inputs[:, 0] + 0.001)
    turned = 60 * np.sin(7 * inputs[:, 0]) / 180
    wanted = np.column_stack([inputs[:, 1], turned, inputs[:, 2], 2 * turned])
    full = inputs[:, 1:3].max()  # of thrusters that are alike
    assert held == pytest.approx(wanted / [full, 1, full, 1], abs=1e-4)
    assert len(found.controls) == len(inputs)  # what comes together is one command

    result = succeeds("info", path, "--mapping", draft)
    text = result.stdout + result.stderr
    assert "actuator_ref_1.csv (table), actuator_ref_2.csv (table)" in text
    assert "commands of 2 sources were put together: actuator_ref_1.csv, actuator_ref_2.csv" in text


def test_stamps_without_leading_zeros_are_mended_in_all_tables_by_the_option(run, tmp_path):
    path = folder(tmp_path / "run", run, padded=False)
    mapping = written(tmp_path)
    result = identify("info", path, "--mapping", mapping)
    assert result.returncode == 1 and "unpadded" in result.stderr
    succeeds("info", path, "--mapping", mapping, "--stamps", "unpadded")


def written(folder, patterns=("pose.csv", "actuator_ref_1.csv", "actuator_ref_2.csv"), more="{}"):
    pose, first, second = patterns
    path = folder / "own.yaml"
    path.write_text(
        """
schema: ground/mapping/1
poses:
  file: "%s"
  position: {fields: [x, y]}
  heading: {field: psi}
  time: {field: time}
commands:
  file: "%s"
  time: {field: time}
  channels:
    right: {file: "%s", field: throttle_reference, full: 400, off: 0}
    left: {field: throttle_reference, full: 400, off: 0}
""" % (pose, first, second)
    )  # fmt: skip
    return path


def test_a_channel_takes_the_file_and_clock_of_the_section_where_it_has_none(run, tmp_path):
    (found,) = ground.read(folder(tmp_path / "run", run), mapping=written(tmp_path))
    assert found.channels == ("right", "left")  # as the mapping has them
    held = found.held(found.controls, START + run[2][:, 0] + 0.001)
    assert held == pytest.approx(run[2][:, [2, 1]], abs=1e-6)


def test_tables_of_many_runs_belong_together_by_what_differs_in_their_names(run, tmp_path):
    for number in (1, 2):
        folder(tmp_path / "one", run)
        for file in list((tmp_path / "one").iterdir()):
            file.rename(tmp_path / ("run%d_%s" % (number, file.name)))
        (tmp_path / "one").rmdir()
    pose = tmp_path / "run2_pose.csv"
    pose.write_text("\n".join(pose.read_text().splitlines()[:-9]) + "\n")
    mapping = written(tmp_path, ("run*_pose.csv", "run*_actuator_ref_1.csv", "run*_actuator_ref_2.csv"))
    found = ground.read(tmp_path, mapping=mapping)
    assert [one.name for one in found] == ["run1_pose", "run2_pose"]
    (tmp_path / "run2_actuator_ref_2.csv").unlink()
    result = identify("info", tmp_path / "run2_pose.csv", "--mapping", mapping)
    assert result.returncode == 1 and "run*_actuator_ref_2.csv" in result.stderr


def test_runs_that_have_no_time_in_common_are_not_put_together(run, tmp_path):
    path = folder(tmp_path / "run", run, shift=30.0)
    result = identify("info", path, "--mapping", written(tmp_path))
    assert result.returncode == 1 and "the commands have no time in common" in result.stderr


def test_a_table_that_ends_before_the_others_is_said(run, tmp_path):
    path = folder(tmp_path / "run", run)
    rows = (path / "actuator_ref_2.csv").read_text().splitlines()
    (path / "actuator_ref_2.csv").write_text("\n".join(rows[: len(rows) // 2]) + "\n")
    result = identify("info", path, "--mapping", written(tmp_path))
    assert "actuator_ref_2.csv ends" in result.stdout + result.stderr


@pytest.mark.parametrize("names", ["/thruster_%d/command", "/actuators/%s/cmd"])
def test_a_bag_with_a_topic_for_each_thruster_is_drafted_and_read(run, tmp_path, names):
    pytest.importorskip("rosbags")
    times, eta, inputs = run
    bag, draft = containers.Ros2(tmp_path / "bag", "sqlite3"), tmp_path / "M.yaml"
    for time, pose in zip(times, eta):
        at = START * 10**9 + int(1e9 * time)
        message = bag.new(
            "geometry_msgs/PoseStamped",
            header=bag.header(at),
            pose=bag.pose(containers.in_mocap(pose, containers.Z_UP)),
        )
        bag.write("/mocap/pose", at, message)
    marks = (1, 2) if "%d" in names else ("port", "starboard")
    for row in inputs:
        for mark, value in zip(marks, row[1:3]):
            at = START * 10**9 + int(1e9 * row[0])
            bag.write(names % mark, at, bag.new("std_msgs/Float64", data=float(value)))
    bag.close()
    succeeds("info", tmp_path / "bag", "--write-mapping", draft)
    (found,) = ground.read(tmp_path / "bag", mapping=draft)
    assert found.channels == (("thruster_1", "thruster_2") if "%d" in names else ("left", "right"))
    held = found.held(found.controls, START + inputs[:, 0] + 0.001)
    assert held == pytest.approx(inputs[:, 1:3], abs=1e-6)


def test_the_log_of_a_ferry_with_four_turning_thrusters(tmp_path):
    folder = ROOT.parent / "shared" / "data" / "others" / "milliampere1" / "maneuvering1"
    if not folder.is_dir():
        pytest.skip("takes the recordings in %s" % folder)
    draft = tmp_path / "M.yaml"
    succeeds("info", folder, "--write-mapping", draft)
    result = succeeds("info", folder, "--mapping", draft)
    assert all("angle_reference_%d" % number in result.stdout for number in (1, 2, 3, 4))
    assert "changes with angle_reference_1" in " ".join(result.stdout.split())


def test_the_commands_of_several_crafts_are_not_those_of_one(run, tmp_path):
    times, eta, inputs = run
    for number in (1, 2):
        table(tmp_path / ("pose_%d.csv" % number), ["x", "y", "psi"], np.column_stack([times, eta]))
        table(tmp_path / ("cmd_%d.csv" % number), ["left", "right"], inputs[:, :3])
    draft = tmp_path / "M.yaml"
    succeeds("info", tmp_path, "--write-mapping", draft)
    commands = yaml.safe_load(draft.read_text())["commands"]
    assert commands["file"] == "cmd_1.csv" and list(commands["channels"]) == ["left", "right"]
