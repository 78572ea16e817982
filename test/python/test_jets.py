"""Crafts that list their thrusters: an air-bearing table with eight jets."""

import os

import numpy as np
import pytest

import conftest
import ground
import jets
from ground import _core
from ground.analysis import window_error
from ground.checks import quality
from ground.effect_library import candidates
from ground.reading import commands, mapping, readers, recording
from ground.support.errors import GroundError

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))

TABLE = os.path.join(ROOT, "cfg", "craft", "air_table.yaml")
PAIR = os.path.join(ROOT, "cfg", "hovercraft", "tiny_whoover.yaml")


@pytest.fixture(scope="module")
def table():
    return _core.load_model(TABLE)


def test_the_core_moves_the_table_as_the_truth_of_the_bench(table):
    plate = jets.Plate(table, "thruster_tilt", 3)
    model = table.copy()
    model.add_effect("thruster_tilt_front_left_right")
    model.set_value("thruster_tilt_front_left_right.angle", jets.TURNED)
    edges = np.arange(0, 5, jets.HOLD)
    commands = np.random.default_rng(1).uniform(0, 1, (len(edges), 8))
    inputs = np.column_stack([edges, commands, np.ones(len(edges))])
    start = [0.0, 0.0, 0.4]
    truth = plate.poses(commands, start)
    times = np.arange(len(truth)) / jets.RATE
    eta = _core.simulate(model, inputs, times, start, np.zeros(3))["eta"]
    assert np.abs(eta - truth).max() < 1e-9
    straight = _core.simulate(table, inputs, times, start, np.zeros(3))["eta"]
    assert np.abs(straight - truth).max() > 1e-3


def test_a_simulated_bag_of_the_table_is_read_by_its_channels(table, tmp_path):
    path = str(tmp_path / "table.bag")
    run = ground.simulate(TABLE, "prbs", duration=5, seed=2)
    run.save(path)
    read = readers.read(path)
    assert list(read.channels) == table.channels and read.lift_channel == "air"
    assert list(read.thrusters) == table.channels[:-1]
    assert read.controls == pytest.approx(run.controls) and read.controls.shape[1] == 9
    assert read.lift.max() == 1 and np.ptp(read.thrust, axis=0).min() == 1
    assert quality.repaired(read).inputs(table).shape[1] == 10


def test_commands_of_two_crafts_in_one_bag_are_an_error():
    old = {"left": np.array([0.5]), "right": np.array([0.25]), "lift": np.ones(1)}
    channels, lift = commands.channels_of(old, commands.OWN, mapping.Commands(), "a.bag")
    values, given = commands.read(old, channels, "a.bag", "held", np.ones(1, bool), False, [])
    assert values.tolist() == [[0.5, 0.25, 1.0]] and given.all() and lift == "lift"
    two = {name: np.append(values, 0) for name, values in old.items()}
    two.update({"channels[0]": np.array(["", "bow"]), "channels[1]": np.array(["", "air"])})
    two["thrusters[0]"] = np.array([np.nan, 0.5])
    with pytest.raises(GroundError, match="not all of one craft: .*bow, air"):
        commands.channels_of(two, commands.OWN, mapping.Commands(), "a.bag")


def test_a_fit_finds_the_parameters_of_the_table(table):
    runs = jets.runs_of(jets.Plate(table, "", 0), np.random.default_rng(3))[:2]
    start = table.copy()
    start.set_value("k", 0.35)
    start.set_value("I_z", 0.15)
    fitted = window_error.WindowFitter(runs).fit(start, ["I_z", "X_u", "Y_v", "N_r", "k"]).model
    assert fitted.value("k") == pytest.approx(0.5, rel=0.01)
    assert fitted.value("I_z") == pytest.approx(0.08, rel=0.01)


def test_effects_of_each_jet_are_tried(table):
    names = [c.name for c in candidates.library(table)]
    assert "thruster_gain_back_left_forward" in names
    assert sum(name.startswith("thruster_tilt_") for name in names) == 8
    assert not any(name.startswith("thruster_") for name in _core.effects())
    pair = _core.load_model(PAIR)
    assert not any(c.name.startswith("thruster_") for c in candidates.library(pair))


def recorded(channels):
    """A Run at rest; each channel's command is its column over 10."""
    times = np.arange(200) * 0.02
    poses = np.column_stack([times, 1e-4 * np.sin(7e3 * times), 0 * times, 0 * times])
    commands = np.column_stack([times, np.tile(np.arange(len(channels)) / 10, (200, 1))])
    return quality.repaired(recording.checked("run 1", poses, commands, "", [], channels))


def test_columns_are_in_the_order_of_the_model(table):
    *thrusters, air = table.channels
    shuffled = [air, *reversed(thrusters)]
    inputs = recorded(shuffled).inputs(table)
    assert inputs[0, 1:].tolist() == [shuffled.index(name) / 10 for name in table.channels]
    assert (recorded(thrusters).inputs(table)[:, -1] == 0).all()
    with pytest.raises(GroundError) as error:
        recorded(["left", "right", "lift"]).inputs(table)
    for part in ("run 1", "front_right_back", "left, right, lift"):
        assert part in str(error.value)


def test_a_recording_of_another_craft_is_refused_in_a_sentence(tmp_path):
    bag = tmp_path / "run.bag"
    made = conftest.identify("simulate", "--model", PAIR, "--input", "prbs", "--duration", 3, "-o", bag)
    assert made.returncode == 0, made.stderr
    for verb in (["fit", bag, "-o", tmp_path / "m.yaml"], ["diagnose", bag, "-o", tmp_path / "d"]):
        refused = conftest.identify(*verb, "--model", TABLE)
        assert refused.returncode == 1 and "Traceback" not in refused.stderr
        assert "no command is named front_right_back" in refused.stderr
    table = tmp_path / "table.bag"
    play = ["simulate", "--input", "prbs", "--duration", 3, "-o", table]
    made = conftest.identify(*play, "--model", TABLE)
    assert made.returncode == 0, made.stderr
    refused = conftest.identify("fit", table, "-o", tmp_path / "m.yaml", "--model", PAIR)
    assert refused.returncode == 1 and "no command is named left or right" in refused.stderr


@conftest.slow
@pytest.mark.parametrize("seed", [0, 7])
def test_a_diagnosis_names_the_effect_and_the_jet(table, seed):
    result = jets.diagnosed(seed, table)
    assert result["found"] == [result["hidden"]], result
    ((name, value),) = result["values"].items()
    expected = jets.WEAK if name.startswith("thruster_gain") else jets.TURNED
    assert value == pytest.approx(expected, rel=0.1)
