"""Further forms of tables that programs write: each is read with the values that were written."""

import numpy as np
import pytest

import ground
from conftest import identify, succeeds
from test_any_table import START, Run, drafted, numbers, plain, same, written


@pytest.fixture(scope="module")
def run():
    return Run()


def vector(run):
    times = numbers(run.times - START, "%.6f sec")
    named = plain(run, t=None, x=None, y=None, psi=None)
    return {"Time": times, "pos_1": run.x, "pos_2": run.y, "pos_3": 0 * run.x, "yaw": run.psi, **named}


def aircraft(run):
    return {"time_us": numbers(1e6 * (run.times - START), "%.0f"), "pn": run.x, "pe": run.y, "pd": 0 * run.x,
            "phi": 0 * run.x, "theta": 0 * run.x, "psi": run.psi,
            "motor_left": run.left, "motor_right": run.right, "motor_lift": run.lift}  # fmt: skip


def wrapped(run):
    """Of a microcontroller whose milliseconds have 32 bits."""
    counts = (np.round(1e3 * (run.times - START)).astype(np.int64) + 2**32 - 1500) % 2**32
    return {"millis": [str(c) for c in counts], **plain(run, t=None)}


TABLES = {
    "a vector by numbers": lambda f, r: written(f, vector(r)),
    "north and east of an aircraft": lambda f, r: written(f, aircraft(r)),
    "milliseconds that begin again": lambda f, r: written(f, wrapped(r)),
    "days of Excel": lambda f, r: written(f, plain(r, t=numbers(25569 + r.times / 86400, "%.12f"))),
    "days of Matlab": lambda f, r: written(f, plain(r, t=numbers(719529 + r.times / 86400, "%.12f"))),
}


@pytest.mark.parametrize("form", TABLES)
def test_a_table_is_read_by_its_draft(run, tmp_path, form):
    days = 1e-4 if form.startswith("days") else 2e-6
    same(drafted(TABLES[form](tmp_path, run), tmp_path), run, times=days)


def test_a_row_for_each_value_becomes_a_column_for_each_signal(run, tmp_path):
    columns = plain(run)
    stamps = numbers(columns.pop("t"), "%.6f")
    rows = [
        "%s,%s,%.9f" % (time, name, values[i])
        for i, time in enumerate(stamps)
        for name, values in columns.items()
    ]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["time,signal,value", *rows]) + "\n")
    same(drafted(path, tmp_path), run)
    result = identify("info", path, "--mapping", tmp_path / "draft.yaml")
    assert "signal names the signals, and value has their values" in result.stdout + result.stderr


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("is_list", [False, True])
def test_numbers_of_one_sample_in_rows_of_their_own_are_one_pose(is_list, seed, tmp_path):
    """In any order, microseconds apart, at any rate; beside texts and switches, as robots log them."""
    random, run = np.random.default_rng(seed), Run(4.0)
    every = 1 + seed % 3
    run.times, run.eta, run.commands = run.times[::every], run.eta[::every], run.commands[::every]
    psi = np.angle(np.exp(1j * run.psi[::every]))
    turned = {"Pose/yaw": psi}
    if seed % 2:
        turned = {"Pose/q" + one: values for one, values in zip("xyzw", np.zeros((4, len(psi))))}
        turned.update({"Pose/qz": np.sin(psi / 2), "Pose/qw": np.cos(psi / 2)})
    placed = {"Pose/x": run.eta[:, 0], "Pose/y": run.eta[:, 1]}
    given = {**placed, **turned, "Drive/left": run.commands[:, 0], "Drive/right": run.commands[:, 1]}
    names = [str(name) for name in random.permutation([*given])]
    rows = [(run.times[0] + 0.011, "DS/enabled", "true"), (run.times[0] + 0.013, "FMS/name", "test")]
    for i, time in enumerate(run.times):
        late = np.cumsum(random.integers(1, 20, len(names))) * 1e-6
        rows += [(time + after, name, "%.9f" % given[name][i]) for after, name in zip(late, names)]
    if is_list:
        lines = ["Timestamp,Key,Value", *("%.6f,%s,%s" % row for row in rows)]
    else:
        columns = dict.fromkeys(name for _, name, _ in rows)
        cells = [[text if name == one else "" for one in columns] for _, name, text in rows]
        lines = [",".join(["Timestamp", *columns])]
        lines += [",".join(["%.6f" % row[0], *filled]) for row, filled in zip(rows, cells)]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines) + "\n")
    identify("info", path, "--write-mapping", tmp_path / "draft.yaml")
    (found,) = ground.read(path, mapping=tmp_path / "draft.yaml", axes="x, y, z" if seed % 2 else None)
    assert len(found.eta) == len(run.eta)
    assert found.pose_times == pytest.approx(run.times, abs=2e-4)
    assert found.eta[:, :2] == pytest.approx(run.eta[:, :2], abs=1e-8)
    assert np.exp(1j * found.eta[:, 2]) == pytest.approx(np.exp(1j * psi), abs=1e-7)


LABVIEW = """LabVIEW Measurement\t
Writer_Version\t2
Separator\tTab
Decimal_Separator\t.
X_Columns\tOne
Date\t2023/11/14
***End_of_Header***\t

Channels\t6\t\t\t\t\t\t
Samples\t{0}\t{0}\t{0}\t{0}\t{0}\t{0}\t
Date\t2023/11/14\t2023/11/14\t2023/11/14\t2023/11/14\t2023/11/14\t2023/11/14\t
X_Dimension\tTime\tTime\tTime\tTime\tTime\tTime\t
X0\t0\t0\t0\t0\t0\t0\t
Delta_X\t0.01\t0.01\t0.01\t0.01\t0.01\t0.01\t
***End_of_Header***\t\t\t\t\t\t\t
X_Value\tx\ty\tpsi\tleft\tright\tlift\tComment
"""


def test_a_file_of_labview_is_read_below_its_heads(run, tmp_path):
    path = tmp_path / "log.lvm"
    rows = ["\t".join(cells) for cells in zip(*map(numbers, plain(run, t=run.times - START).values()))]
    path.write_text(LABVIEW.format(len(rows)) + "\n".join(rows) + "\n")
    same(drafted(path, tmp_path), run)


def test_an_export_of_qualisys_may_name_the_body_in_each_column(run, tmp_path):
    names = ["X", "Y", "Z", "Roll", "Pitch", "Yaw", "Residual"]
    head = ["NO_OF_FRAMES\t%d" % len(run.x), "FREQUENCY\t100", "DATA_INCLUDED\t6D", "BODY_NAMES\thover"]
    head.append("\t".join(["Frame", "Time", *("hover " + name for name in names)]))
    rows = [
        "%d\t%.5f\t%.5f\t%.5f\t40\t0\t0\t%.7f\t0.3" % (i + 1, t - START, 1e3 * x, -1e3 * y, -np.degrees(psi))
        for i, (t, x, y, psi) in enumerate(zip(run.times, run.x, run.y, run.psi))
    ]
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run_6D.tsv").write_text("\n".join([*head, *rows]) + "\n")
    commands = {"t": run.times - START - 1e-4, "left": run.left, "right": run.right, "lift": run.lift}
    written(tmp_path / "run", commands, name="cmd.csv")
    same(drafted(tmp_path / "run", tmp_path), run, places=1e-4, angles=1e-5, times=1e-4)


def test_clocks_that_differ_are_told_with_what_to_write(run, tmp_path):
    folder = tmp_path / "run"
    folder.mkdir()
    written(folder, {"t": run.times - START, "x": run.x, "y": run.y, "psi": run.psi}, name="pose.csv")
    commands = {"t": run.times, "left": run.left, "right": run.right, "lift": run.lift}
    written(folder, commands, name="cmd.csv")
    draft = tmp_path / "draft.yaml"
    succeeds("info", folder, "--write-mapping", draft)
    result = identify("info", folder, "--mapping", draft)
    assert result.returncode == 1 and "clock_offset" in result.stderr and "1700000000.000" in result.stderr
    draft.write_text(draft.read_text() + "clock_offset: 1700000000\n")
    succeeds("info", folder, "--mapping", draft)


@pytest.mark.parametrize(
    "name, content, wanted",
    [
        ("log.hdf5", "", "export its data as CSV"),
        ("log.bin", "", "mavlogdump.py"),
        ("metadata.yaml", "rosbag2_bagfile_information: {}", "give its folder"),
        (
            "log.csv",
            "version https://git-lfs.github.com/spec/v1\noid sha256:abc\nsize 12345\n",
            "git lfs pull",
        ),
    ],
)
def test_what_is_no_table_is_refused_with_what_to_do(tmp_path, name, content, wanted):
    (tmp_path / name).write_text(content)
    result = identify("info", tmp_path / name, "--write-mapping", tmp_path / "M.yaml")
    assert result.returncode == 1 and wanted in result.stderr and result.stderr.count("\n") == 1


def test_tables_of_a_folder_that_are_alike_are_runs(run, tmp_path):
    for name, table in (("one", plain(run)), ("two", plain(run, x=run.x + 5))):
        written(tmp_path, table, name=name + ".csv")
    written(tmp_path, {"input": np.linspace(0, 1, 9), "left": np.linspace(0, 1, 9)}, name="bench.csv")
    identify("info", tmp_path, "--write-mapping", tmp_path / "m.yaml")
    (tmp_path / "bench.csv").unlink()
    first, second = ground.read(tmp_path, mapping=tmp_path / "m.yaml")
    same(first, run)
    assert np.allclose(second.eta[:, 0] - first.eta[:, 0], 5)


def test_commands_of_a_folder_are_of_the_time_of_the_poses(run, tmp_path):
    written(tmp_path, plain(run))
    levels = np.linspace(0, 1, 9)
    bench = {"input": levels, **{name: levels for name in ("left", "right", "lift")}}
    written(tmp_path, bench, name="bench.csv")
    identify("info", tmp_path, "--write-mapping", tmp_path / "m.yaml")
    [found] = ground.read(tmp_path, mapping=tmp_path / "m.yaml")
    same(found, run)
