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
from conftest import MODEL, identify, simulate_run
from containers import write_csv
from ground.recordings import repair

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
        return np.abs(repair.wrap(difference) if name == "psi" else difference).max()

    assert off(frame, "x", 0) < 0.02 and off(frame, "psi", 2) < 0.05
    assert off(raw, "x", 0) > 2 and off(raw, "psi", 2) > 0.5  # as they were measured
    world = np.gradient(frame[["x", "y"]].to_numpy(), frame.t, axis=0)
    forward = np.cos(frame.psi) * world[:, 0] + np.sin(frame.psi) * world[:, 1]
    assert np.corrcoef(forward, frame.u)[0, 1] > 0.9
    turn = np.gradient(np.unwrap(frame.psi), frame.t)
    assert np.corrcoef(turn, frame.r)[0, 1] > 0.9


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


def test_results_are_pickled(runs):
    model = ground.Model.load(MODEL)
    comparison = ground.compare(model, runs[0])
    assert pickle.loads(pickle.dumps(comparison)).to_dict() == comparison.to_dict()
    fit = ground.fit(model, runs[0], free=["k"])
    assert pickle.loads(pickle.dumps(fit)).to_dict() == fit.to_dict()


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


@pytest.mark.parametrize("place", range(len(COLUMNS) + 1))
def test_a_column_without_values_renames_none(place, tmp_path):
    wanted = read_table(csv_run(tmp_path / "run.csv"))
    columns = COLUMNS[:place] + ["battery"] + COLUMNS[place:]
    table = csv_run(
        tmp_path / "other.csv", lambda rows: [row[:place] + [""] + row[place:] for row in rows], columns
    )
    assert same_run(read_table(table), wanted)


def test_a_column_without_values_heads_those_whose_names_repeat(tmp_path):
    """As exports of bags have them."""
    columns = ["t", "position", "x", "y", "angle", "x", "y", "z", "left", "right", "lift"]

    def grouped(rows):
        return [[t, "", x, y, "", 0.0, 0.0, psi, *rest] for t, x, y, psi, *rest in rows]

    table = csv_run(tmp_path / "run.csv", grouped, columns)
    mapping = MAPPING.replace("[x, y]", "[position.x, position.y]").replace("psi", "angle.z")
    for name in ("left", "right"):  # lift is found without its heading
        mapping = mapping.replace("field: " + name, "field: angle." + name)
    assert same_run(read_table(table, mapping), read_table(csv_run(tmp_path / "plain.csv")))


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
            result = identify(*arguments)
            assert result.returncode == 0, result.stderr
    finally:
        os.umask(before)
    written = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert {".bag", ".yaml", ".json", ".html"} <= {path.suffix for path in written}
    for path in written:
        assert stat.S_IMODE(path.stat().st_mode) == 0o640, path


def test_several_processes_read_and_repair_what_one_does(tmp_path, monkeypatch):
    from conftest import write_bag
    from ground.data import measured as api
    from ground.support.progress import Work

    bags = [write_bag(tmp_path / ("%d.bag" % n), seed=n) for n in range(3)]
    alone = ground.read(bags)
    first_runs = api.repaired(alone, Work())
    monkeypatch.setattr(api, "WORTH_REPAIRING", 0)
    together = ground.read(bags)
    second_runs = api.repaired(together, Work())
    for one, other, first, second in zip(alone, together, first_runs, second_runs):
        assert same_run(one, other) and one.name == other.name and one.settings == other.settings
        assert second.recording is other
        assert np.array_equal(first.motion.nu, second.motion.nu) and first.spans == second.spans
    (tmp_path / "bad.bag").write_text("nonsense")
    with pytest.raises(ground.GroundError, match="bad.bag: not a bag"):
        ground.read(tmp_path)
