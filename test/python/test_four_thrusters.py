"""The real recordings of the second craft: raw files as they are, with one mapping file."""

import json

import numpy as np
import pytest
from conftest import ROOT, SHARED, identify

import ground

RAW = SHARED.parent / "epfl_2019_12"
MAPPING = ROOT / "cfg" / "mapping" / "four_thrusters.yaml"
# name, duration [s], poses that overtook each other
RUNS = [("data_1_spec_2", 63.5, 13), ("data_2_spec_4", 50.1, 0), ("data_4_spec_3", 40.3, 0)]


@pytest.fixture(scope="module")
def described():
    if not RAW.is_dir():
        pytest.skip("the real recordings of December 2019 are not beside the workspace")
    result = identify("info", RAW, "--mapping", MAPPING, "--json")
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)


def test_the_folder_holds_three_runs(described):
    assert [d["name"] for d in described] == [name for name, _, _ in RUNS]
    for d, (_, duration, _) in zip(described, RUNS):
        assert d["duration"] == pytest.approx(duration, abs=0.1)
        assert d["controls"]["channels"][:2] == ["back_left", "back_right"]
        assert d["controls"]["levels"] == pytest.approx([0, 0.28], abs=0.01)


def test_bursts_are_put_right(described):
    for d, (name, _, overtaken) in zip(described, RUNS):
        poses = d["poses"]
        clock = poses["frame_clock"]
        assert clock["rate"] == pytest.approx(50.001, abs=1e-3), name
        assert clock["lateness"]["median"] < 1e-3
        assert poses["overtaken"] == overtaken
        assert len(poses["spikes"]) <= 8 and d["contacts"] == []
        assert poses["noise"]["position"] < 2e-4
        controls = d["controls"]
        driven = controls["count"] / controls["rate"]
        assert d["usable"]["duration"] > 0.98 * driven
    assert described[0]["poses"]["frame_clock"]["lateness"]["largest"] > 0.18


def test_motion_has_no_jumps_of_a_late_pose(described):
    for recording in ground.read(RAW, mapping=MAPPING):
        motion = recording.repaired.motion
        assert not motion.jumps.any()
        assert np.abs(motion.nu[:, :2]).max() < 1.0


def test_what_each_thruster_does_is_told(described):
    """The craft's rigid body looks backwards, and the firmware's left is on the right."""
    told = described[1]["authority"]
    assert list(told) == ["back_left", "back_right", "front_left", "front_right"]
    pushes = [1 if one["forward"] > 0 else -1 for one in told.values()]
    turns = [1 if one["turn"] > 0 else -1 for one in told.values()]
    assert pushes == [-1, -1, 1, 1] and turns == [-1, 1, 1, -1]
    for one in told.values():
        assert abs(one["forward"]) > 5 * one["errors"][0]
        assert abs(one["turn"]) > 3 * one["errors"][2]
        assert abs(one["right"]) < 0.3 * abs(one["forward"])
