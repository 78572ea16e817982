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
