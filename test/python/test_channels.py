"""Recordings of crafts with other thrusters than left and right."""

import numpy as np
import pytest

from conftest import MODEL, simulate_run
from ground import _core
from ground.checks import findings
from ground.checks.quality import repaired
from ground.reading import mapping
from ground.reading.recording import checked
from ground.support.errors import GroundError

NAMES = ("lift", "back_right", "back_left", "front")


def recorded(front=0.0, **options):
    """A simulated run whose channels have other names and another order."""
    times, eta, inputs = simulate_run()
    poses = np.column_stack([1000 + times, eta])
    still = np.full(len(inputs), front)
    controls = np.column_stack([1000 + inputs[:, 0], inputs[:, [3, 2, 1]], still])
    return checked("run.bag", poses, controls, "a test", [], NAMES, **options)


def test_commands_are_found_by_the_names_of_their_channels():
    recording = recorded()
    _, _, inputs = simulate_run()
    assert recording.thrusters == ("back_right", "back_left", "front")
    assert np.array_equal(recording.lift, inputs[:, 3])
    assert np.array_equal(recording.commands_of(("back_left", "back_right")), inputs[:, 1:3])
    assert list(recording.to_frame().columns)[-len(NAMES) :] == list(NAMES)
    said = dict(findings.facts({**findings.described(repaired(recording)), "same_inputs_as": []}))
    assert "back_right, back_left, front 0 to 1, lift 1 to 1" in said["commands"]


def test_a_model_that_names_other_thrusters_is_refused():
    model = _core.load_model(str(MODEL))
    with pytest.raises(GroundError, match="no command is named left or right.* back_right, back"):
        repaired(recorded()).data(model)


def test_a_reversible_thruster_has_a_range_of_its_own():
    with pytest.raises(GroundError, match="commands must be between 0 and 1 but range from -0.5 to 1"):
        recorded(front=-0.5)
    recording = recorded(front=-0.5, ranges={"front": (-1, 1)})
    assert recording.thrust[:, 2].max() == -0.5
    assert repaired(recording).contacts == []


def test_a_lift_channel_may_have_another_name(tmp_path):
    table = _core.load_model(str(MODEL.parents[1] / "craft" / "air_table.yaml"))
    names = table.channels
    rows = np.column_stack([1000 + np.arange(20), np.zeros((20, 8)), np.arange(20) > 5])
    poses = np.column_stack([1000 + 0.1 * np.arange(190), np.zeros((190, 3))])
    recording = checked("run.bag", poses, rows, "a test", [], names)
    assert "air" in recording.thrusters and not recording.lift.any()
    known = recording.with_lift_of(table)
    assert known.thrusters == tuple(names[:-1]) and known.lift.sum() == 14
    assert repaired(known).drives == [6.0] and repaired(known).drives_by == "lift"
    assert recorded().with_lift_of(table).lift_channel == "lift"  # the model's is not there
    given = mapping.load(written(tmp_path, "lift: front"))
    assert given.commands.lift == "front"
    with pytest.raises(GroundError, match="commands.lift is fan, which is none of the channels: front"):
        mapping.load(written(tmp_path, "lift: fan"))


def written(folder, line):
    path = folder / "mapping.yaml"
    path.write_text("schema: ground/mapping/1\ncommands:\n  channels: {front: {field: f}}\n  %s\n" % line)
    return str(path)
