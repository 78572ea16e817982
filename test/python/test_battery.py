"""The voltage of a craft's battery: recorded, read, and found to be why its thrust changes."""

import dataclasses
import os

import numpy as np
import pytest

import ground
from conftest import identify
from ground.checks import findings, quality
from ground.simulation import gains, tracking
from ground.support.errors import GroundError, OptionError

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
MODEL = os.path.join(ROOT, "cfg", "hovercraft", "tiny_whoover.yaml")
POWER, NOMINAL = 1.5, 7.4  # of the true craft; voltage at which its k holds [V]
TRIED = ["battery_sag", "battery_voltage", "quadratic_drag", "thrust_asymmetry"]


@pytest.fixture(scope="module")
def craft():
    """The true craft."""
    model = ground.Model.load(MODEL)
    text = model.format().replace("input_max:", "volts: %g\n  input_max:" % NOMINAL)
    return ground.Model.parse(text).with_effect("battery_voltage", p=POWER)


@pytest.fixture(scope="module")
def runs(craft):
    """Flights with batteries that are charged differently, so that the time does not say their voltage."""
    charges = (1.0, 0.35, 0.7, 0.15)
    return [
        ground.simulate(
            craft, "prbs", duration=8, seed=i + 1, battery=120.0, charge=charge, name="run_%d" % i
        )
        for i, charge in enumerate(charges)
    ]


def test_a_bag_keeps_the_voltage(runs, tmp_path):
    path = str(tmp_path / "run.bag")
    runs[0].save(path)
    (read,) = ground.read(path)
    assert read.voltage.source == "/sender/telemetry (ground_msgs/Telemetry)"
    assert np.allclose(read.voltage.times, runs[0].voltage.times, atol=1e-6)
    assert np.allclose(read.voltage.volts, runs[0].voltage.volts, atol=1e-5)
    assert read.voltage.volts[0] == pytest.approx(8.4, rel=0.01)
    assert read.inertial is None  # telemetry without a gyro


def test_info_says_how_the_voltage_goes(runs, tmp_path):
    path = str(tmp_path / "run.bag")
    runs[0].save(path)
    found = identify("info", path)
    (line,) = [line for line in found.stdout.splitlines() if line.strip().startswith("battery")]
    assert "8.4" in line.split("V at the start")[0] and "at 100 Hz" in line, line


def test_a_diagnosis_finds_that_the_voltage_is_why(craft, runs):
    known = ground.Model.load(MODEL)
    found = ground.diagnose(known, runs[:3], only=[*TRIED], holdout=runs[3:])
    assert found.effects == ("battery_voltage",), found.effects
    low, high = found.parameters["battery_voltage.p"].ci95
    assert low < POWER < high and high - low < 1, (low, high)
    # k is that at the median voltage, which the file says.
    volts = found.improved.core.volts
    assert 6.5 < volts < 8.4 and "volts: %g" % volts in found.improved.format()
    assert found.improved["k"] == pytest.approx(craft["k"] * (volts / NOMINAL) ** POWER, rel=0.03)
    again = ground.Model.parse(found.improved.format())
    assert ground.compare({"found": again, "known": known}, runs[3:]).best == "found"


def test_a_plan_knows_the_voltage(craft):
    """A battery that sags from full to empty costs a predictive controller at most a tenth of its error: its
    plans, like the observer, have the voltage that the craft reports."""
    task = tracking.task("rhodonea", settled=10.0, until=45.0)
    full = tracking.Conditions(noise=True, delay=0.02, battery=(1e9, 0.5))
    sagging = dataclasses.replace(full, battery=(24.0, 1.0))
    at_start = tracking.starts(1, 3)[0]

    def rms(conditions):
        controller = gains.choice("ModelPredictive")
        found = tracking.run(craft.core, craft.core, controller, task, at_start, conditions, seed=4)
        return found.numbers["rms"]

    assert rms(sagging) < 1.1 * rms(full)


def test_it_is_not_tried_without_a_voltage(runs):
    bare = [dataclasses.replace(run, voltage=None) for run in runs[:2]]
    with pytest.raises(GroundError, match="needs the voltage of the battery, which no recording has"):
        ground.diagnose(MODEL, bare, only=["battery_voltage"])


def test_a_fit_warns_of_runs_without_the_voltage(craft, runs):
    bare = dataclasses.replace(runs[1], voltage=None, name="bare")
    with pytest.warns(UserWarning, match="bare: no voltage is recorded.* thrust is as at 7.4 V"):
        ground.fit(craft, [runs[0], bare], free=["k"])


def test_columns_of_a_table_are_named_in_a_mapping(runs, tmp_path):
    run, table = runs[0], tmp_path / "run.csv"
    held = run.held(run.controls, run.pose_times)
    millivolts = 1e3 * np.interp(run.pose_times, run.voltage.times, run.voltage.volts)
    millivolts[5], millivolts[50] = np.nan, 0
    rows = np.column_stack([run.pose_times, run.eta, held, millivolts])
    np.savetxt(table, rows, fmt="%.9g", delimiter=",", header="t,x,y,psi,l,r,lift,vbat", comments="")
    mapping = tmp_path / "m.yaml"
    mapping.write_text(
        "schema: ground/mapping/1\n"
        "poses: {position: {fields: [x, y]}, heading: {field: psi}, axes: 'x, y, z', time: {field: t}}\n"
        "commands:\n  time: {field: t}\n"
        "  channels: {left: {field: l}, right: {field: r}, lift: {field: lift}}\n"
        "battery: {voltage: vbat, unit: mV}\n"
    )
    (read,) = ground.read(str(table), mapping=str(mapping))
    assert read.voltage.unusable == 2
    assert np.allclose(read.voltage.volts, np.delete(millivolts, [5, 50]) / 1e3, rtol=1e-6)
    described = findings.described(quality.repaired(read))["battery"]
    assert described["first"] > described["last"] and described["unusable"] == 2
    mapping.write_text(mapping.read_text().replace("vbat", "volts"))
    with pytest.raises(GroundError, match="contain a field volts, which .* names as battery.voltage"):
        ground.read(str(table), mapping=str(mapping))


def test_a_battery_needs_the_voltage_at_which_thrust_holds(craft):
    with pytest.raises(OptionError, match="give body the key volts"):
        ground.simulate(MODEL, "prbs", duration=2, battery=100.0)
    with pytest.raises(OptionError, match="charge needs battery"):
        ground.simulate(craft, "prbs", duration=2, charge=0.5)


def test_a_formula_may_use_the_voltage(craft, runs):
    plain = ground.Model.load(MODEL)
    text = plain.format().replace("input_max:", "volts: 7.4\n  input_max:")
    effect = {
        "name": "by_voltage",
        "expression": {"X": "k1 * (volt/7.4 - 1) * (u_L + u_R)"},
        "parameters": {"k1": {"value": 0.05, "unit": "N", "neutral": 0}},
    }
    found = ground.fit(ground.Model.parse(text).with_effect(effect), runs[:2], free=["k", "by_voltage.k1"])
    assert found.parameters["by_voltage.k1"].ci95[0] > 0.03
