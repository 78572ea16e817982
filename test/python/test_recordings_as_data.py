"""Recordings as data of a user's script: frames of pandas, copies in other processes, files of others."""

import os
import pickle
import stat
from concurrent import futures

import genpy
import numpy as np
import pytest
import rosbag
from geometry_msgs.msg import PointStamped

import ground
from conftest import MODEL, identify, simulate_run, succeeds, write_bag
from containers import write_csv
from ground.checks import quality
from ground.data import measured
from ground.data import read as reading
from ground.poses import angles
from ground.support.progress import Work

START, EARLY = 1000.0, 2.0  # the mocap's clock is behind by EARLY [s]
MAPPING = """schema: ground/mapping/1
poses:
  position: {fields: [x, y]}
  heading: {field: psi}
  time: {field: t}
commands:
  channels: {left: {field: left}, right: {field: right}, lift: {field: lift}}
  time: {field: t}
"""
COLUMNS = ["t", "x", "y", "psi", "left", "right", "lift"]


def truth(duration=10.0):
    return simulate_run(duration=duration, noise=0.1)


@pytest.fixture(scope="module")
def two_clocks(tmp_path_factory):
    """A bag whose poses have stamps of another clock; some headings are mirrored, one pose is far off."""
    times, eta, inputs = truth()
    eta[300:303, 2] = 1.0 - eta[300:303, 2]
    eta[[500, 650], 2] = 1.0 - eta[[500, 650], 2]
    eta[400, 0] += 3.0
    path = tmp_path_factory.mktemp("clocks") / "run.bag"
    rows = [("pose", t, t - EARLY, row) for t, row in zip(times, eta)]
    rows += [("controls", row[0], row[0], row[1:]) for row in inputs]
    with rosbag.Bag(str(path), "w") as bag:
        for topic, received, stamp, values in sorted(rows, key=lambda row: row[1]):
            message = PointStamped()
            message.header.stamp = genpy.Time.from_sec(START + stamp)
            message.point.x, message.point.y, message.point.z = map(float, values)
            bag.write(topic, message, genpy.Time.from_sec(START + received))
    return path


def held(frame, inputs):
    """The commands that acted at the times of a frame, whose first pose is at 0."""
    at = np.searchsorted(inputs[:, 0], frame.t.to_numpy() + 1e-6, side="right") - 1
    return inputs[at, 1:]


@pytest.mark.parametrize("raw", [False, True])
def test_poses_and_commands_of_a_frame_are_on_one_clock(two_clocks, raw):
    _, _, inputs = truth()
    (run,) = ground.read(two_clocks)
    frame = run.to_frame(raw=raw)
    commands = frame[["left", "right", "lift"]].to_numpy()
    assert frame.t[0] == 0 and len(frame) > 900
    same = (commands == held(frame, inputs)).all(axis=1)
    assert same.mean() > 0.97  # a command changes between two poses, at either of them


def test_a_frame_has_the_repaired_motion_and_its_velocities(two_clocks):
    times, eta, _ = truth()
    (run,) = ground.read(two_clocks)
    frame, raw = run.to_frame(), run.to_frame(raw=True)
    assert list(frame.columns) == ["t", "x", "y", "psi", "u", "v", "r", "left", "right", "lift"]
    assert list(raw.columns) == ["t", "x", "y", "psi", "left", "right", "lift"]

    def off(found, name, column):
        wanted = np.interp(found.t, times, np.unwrap(eta[:, 2]) if name == "psi" else eta[:, column])
        difference = found[name] - wanted
        return np.abs(angles.wrap(difference) if name == "psi" else difference).max()

    assert off(frame, "x", 0) < 0.02 and off(frame, "psi", 2) < 0.05
    assert off(raw, "x", 0) > 2 and off(raw, "psi", 2) > 0.5  # as they were measured
    world = np.gradient(frame[["x", "y"]].to_numpy(), frame.t, axis=0)
    forward = np.cos(frame.psi) * world[:, 0] + np.sin(frame.psi) * world[:, 1]
    assert np.corrcoef(forward, frame.u)[0, 1] > 0.9
    turn = np.gradient(np.unwrap(frame.psi), frame.t)
    assert np.corrcoef(turn, frame.r)[0, 1] > 0.9


# --- recordings of arrays and tables


def arrays(duration=8.0):
    """Times, poses, times of commands and commands of a simulated run."""
    times, eta, inputs = truth(duration)
    return times, eta, inputs[:, 0], inputs[:, 1:]


def test_a_recording_of_arrays_is_fitted_like_that_of_a_bag(tmp_path):
    times, eta, sent, commands = arrays()
    run = ground.Recording.from_arrays(times, eta, commands, sent, name="mine")
    assert run.name == "mine" and run.duration == pytest.approx(times[-1])
    found = ground.fit(ground.Model.load(MODEL).with_values({"k": 0.08}), run, free=["k"])
    low, high = found.parameters["k"].ci95
    assert low < 0.062 < high
    held = commands[np.searchsorted(sent, times, side="right") - 1]
    on_one_clock = ground.Recording.from_arrays(times, eta, held)
    assert ground.fit(MODEL, on_one_clock, free=["k"]).model["k"] == pytest.approx(0.062, rel=0.01)


def test_recordings_of_several_reads_need_no_flattening(tmp_path):
    bags = [write_bag(tmp_path / ("%s.bag" % name), duration=4, seed=i) for i, name in enumerate("ab")]
    read = [ground.read(bag) for bag in bags]
    assert [one.name for one in reading.taken([read, []])] == ["a", "b"]
    assert reading.taken(read) == reading.taken([*read[0], *read[1]])
    with pytest.raises(ground.GroundError, match="given twice"):
        reading.taken([read, read[0]])
    with pytest.raises(ground.GroundError, match="path of its file"):
        reading.taken([read, 3])


def test_a_recording_of_a_frame_has_what_the_frame_has():
    run = ground.simulate(MODEL, "prbs", duration=6, seed=4)
    frame = run.to_frame()
    again = ground.Recording.from_frame(frame, "again")
    assert again.channels == run.channels and again.name == "again"
    other = again.to_frame()
    for column in ("x", "y", "left", "right", "lift"):
        assert np.allclose(other[column], frame[column], atol=2e-3, equal_nan=True)
    predicted = run.to_frame(model=MODEL)
    assert ground.Recording.from_frame(predicted).channels == run.channels
    with pytest.raises(ground.GroundError, match="no column psi"):
        ground.Recording.from_frame(frame.drop(columns="psi"))


def test_a_table_is_read_by_the_names_and_types_of_its_columns():
    import pandas

    read, run = ground.Recording.from_frame, ground.simulate(MODEL, "prbs", duration=6, seed=4)
    frame = run.to_frame()
    strength = ground.fit(MODEL, read(frame), free=["k"]).params["k"]
    moved = frame[["lift", "right", "left", "psi", "y", "x", "t"]]
    dates = pandas.Timestamp("2026-03-05", tz="UTC") + pandas.to_timedelta(frame["t"], unit="s")
    for same in (moved, frame.drop(columns="lift"), frame.assign(t=dates)):
        assert ground.fit(MODEL, read(same), free=["k"]).params["k"] == pytest.approx(strength, rel=0.01)
    with pytest.warns(ground.GroundWarning, match="load"):
        assert read(frame.assign(load=5.0)).channels == run.channels
    assert read(frame.assign(load=0.5), channels=["load", "lift"]).channels == ("load", "lift")
    with pytest.warns(ground.GroundWarning, match="seconds"):
        read(frame.assign(t=1e3 * frame["t"]))
    with pytest.raises(ground.GroundError, match="seconds"):
        read(frame.assign(t=1e6 * frame["t"]))


@pytest.mark.parametrize(
    "change,words",
    [
        (dict(poses=np.zeros((3, 2))), "poses have the shape"),
        (dict(commands=np.zeros((3, 3))), "commands have the shape"),
        (dict(times=["a"] * 800), "poses: not numbers"),
        (dict(times=[]), "poses have the shape"),
        (dict(commands=50.0), "commands of left range"),
        (dict(poses=np.nan), "not finite"),
        (dict(poses=1e5), "degrees"),
        (dict(channels=("a", "b")), "commands have the shape"),
    ],
)
def test_wrong_arrays_are_named(change, words):
    times, eta, sent, commands = arrays()
    given = dict(times=times, poses=eta, commands=commands, command_times=sent)
    for name, value in change.items():
        given[name] = given[name] * value if isinstance(value, float) else value
    with pytest.raises(ground.GroundError, match=words):
        ground.Recording.from_arrays(**given)


def test_runs_are_renamed_found_by_patterns_and_told_apart(tmp_path):
    for seed in (1, 2):
        ground.simulate(MODEL, "prbs", duration=6, seed=seed).save(tmp_path / ("run%d.bag" % seed))
    runs = ground.read(tmp_path / "run*.bag")
    assert [run.name for run in runs] == ["run1", "run2"]
    assert ground.read(str(tmp_path / "*[2].bag"))[0].rename("second").name == "second"
    same = [run.rename("run") for run in runs]
    names = [run.run for run in ground.fit(MODEL, same, free=["k"]).runs]
    assert len(set(names)) == 2
    with pytest.raises(ground.GroundError, match="no file matches"):
        ground.read(tmp_path / "flight*.bag")


def test_a_frame_has_units_and_what_a_model_predicts():
    craft = ground.Model.load(MODEL)
    run = ground.simulate(craft.with_effect("yaw_bias", n0=2e-5), duration=10, seed=5)
    frame = run.to_frame(model=craft, horizon=1.0)
    units = frame.attrs["units"]
    assert set(units) == set(frame.columns)
    assert (units["v"], units["psi_predicted"], units["r_residual"]) == ("m/s", "rad", "rad/s")
    known = frame.dropna()
    assert len(known) > 0.6 * len(frame)
    assert np.allclose(known.u, known.u_predicted + known.u_residual)
    right = run.to_frame(model=craft.with_effect("yaw_bias", n0=2e-5), horizon=1.0).dropna()
    assert right.psi_residual.abs().mean() < 0.5 * known.psi_residual.abs().mean()


# --- copies in other processes


def csv_run(path, change=lambda rows: rows, columns=COLUMNS, duration=6.0):
    """A table of a run, a row for each pose."""
    times, eta, inputs = truth(duration)
    at = np.searchsorted(inputs[:, 0], times, side="right") - 1
    rows = np.column_stack([START + times, eta, inputs[at, 1:]]).tolist()
    return write_csv(path, columns, change(rows))


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """The same run, read from a bag and from a table, with the default mapping and another one."""
    folder = tmp_path_factory.mktemp("runs")
    ground.simulate(MODEL, "prbs", duration=6, seed=2).save(folder / "run.bag")
    csv_run(folder / "table.csv")
    (folder / "mapping.yaml").write_text(MAPPING)
    (bag,) = ground.read(folder / "run.bag")
    (table,) = ground.read(folder / "table.csv", mapping=folder / "mapping.yaml")
    return bag, table


def sum_of(run):
    return run.name, float(run.motion.eta.sum()), run.settings.describe(0.0)


def test_a_pool_works_on_recordings(runs):
    with futures.ProcessPoolExecutor(2) as pool:
        assert list(pool.map(sum_of, runs)) == list(map(sum_of, runs))


@pytest.mark.parametrize("poses", [0, np.inf], ids=["in processes", "in this one"])
def test_a_recording_that_was_used_is_what_was_read(runs, poses, monkeypatch):
    monkeypatch.setattr(measured, "WORTH_REPAIRING", poses)
    read = [run.rename(run.name + " again") for run in runs]
    before = [pickle.dumps(run) for run in read]
    ground.fit(MODEL, read, free=["k"])
    assert [pickle.dumps(run) for run in read] == before
    assert all(quality.repaired(run).recording is run for run in read)
    unused = [run.rename(run.name + " unused") for run in runs]
    assert [run.motion.eta.sum() for run in read] == [run.motion.eta.sum() for run in unused]


# --- columns of tables


def read_table(path, mapping=MAPPING):
    file = path.parent / "mapping.yaml"
    file.write_text(mapping)
    (run,) = ground.read(path, mapping=file)
    return run


def same_run(one, other):
    return np.array_equal(one.eta, other.eta) and np.array_equal(one.controls, other.controls)


@pytest.mark.parametrize(
    "change",
    [
        lambda line: line + ",",  # in each row but the header
        lambda line: line + ",,",
        lambda line: line + ", ",
    ],
)
def test_a_comma_at_the_end_of_rows_shifts_nothing(change, tmp_path):
    table = csv_run(tmp_path / "run.csv")
    wanted = read_table(table)
    header, *rows = table.read_text().splitlines()
    table.write_text("\n".join([header, *map(change, rows)]) + "\n")
    assert same_run(read_table(table), wanted)
    table.write_text("\n".join(map(change, [header, *rows])) + "\n")
    assert same_run(read_table(table), wanted)


def test_rows_that_have_more_values_than_columns_are_refused(tmp_path):
    table = csv_run(tmp_path / "run.csv")
    header, *rows = table.read_text().splitlines()
    table.write_text("\n".join([header, *("7," + row for row in rows)]) + "\n")
    (tmp_path / "mapping.yaml").write_text(MAPPING)
    result = identify("info", table, "--mapping", tmp_path / "mapping.yaml")
    assert result.returncode == 1 and result.stderr.count("\n") == 1
    assert "more values than" in result.stderr


# --- permissions of files


def test_files_have_the_permissions_that_the_umask_leaves(tmp_path):
    before = os.umask(0o027)
    try:
        bag = tmp_path / "run.bag"
        for arguments in (
            ["simulate", "--model", MODEL, "--input", "prbs", "--duration", "6", "-o", bag],
            ["fit", bag, "--model", MODEL, "-o", tmp_path / "fitted.yaml"],
            ["fit", bag, "--model", MODEL, "-o", tmp_path / "fitted.yaml", "--force"],
            ["add", "yaw_bias", bag, "--model", MODEL, "-o", tmp_path / "added.yaml"],
            ["compare", bag, "--model", MODEL, "-o", tmp_path / "compared"],
        ):
            succeeds(*arguments)
    finally:
        os.umask(before)
    written = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert {".bag", ".yaml", ".json", ".html"} <= {path.suffix for path in written}
    for path in written:
        assert stat.S_IMODE(path.stat().st_mode) == 0o640, path


def test_several_processes_read_and_repair_what_one_does(tmp_path, monkeypatch):
    from conftest import write_bag

    bags = [write_bag(tmp_path / ("%d.bag" % n), seed=n) for n in range(3)]
    alone = ground.read(bags)
    first_runs = measured.repaired(alone, Work())
    monkeypatch.setattr(measured, "WORTH_REPAIRING", 0)
    together = ground.read(bags)
    second_runs = measured.repaired(together, Work())
    for one, other, first, second in zip(alone, together, first_runs, second_runs):
        assert same_run(one, other) and one.name == other.name and one.settings == other.settings
        assert second.recording is other
        assert np.array_equal(first.motion.nu, second.motion.nu) and first.spans == second.spans
    (tmp_path / "bad.bag").write_text("nonsense")
    with pytest.raises(ground.GroundError, match="bad.bag: "):
        ground.read(tmp_path)
