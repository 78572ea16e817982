"""Tables as people have them: each is read with the values that were written, or refused with what helps."""

import datetime
import gzip
import math

import numpy as np
import pytest

import ground
from conftest import identify, simulate_run, succeeds

START = 1700000000.0


class Run:
    """A short simulated run: times [s], poses in world_ned and commands, a row for each pose."""

    def __init__(self, duration=3.0):
        times, eta, inputs = simulate_run(duration=duration)
        at = np.searchsorted(inputs[:, 0], times, side="right") - 1
        self.times, self.eta, self.commands = START + times, eta, inputs[at, 1:].copy()
        self.commands[:5] = 0
        self.x, self.y, self.psi = eta.T
        self.left, self.right, self.lift = self.commands.T


@pytest.fixture(scope="module")
def run():
    return Run()


def numbers(values, form="%.9f"):
    return [form % value for value in np.asarray(values)]


def written(folder, columns, separator=",", name="log.csv", above=(), encoding="utf-8", end="\n", names=True):
    """A text table of columns of texts or numbers, by name; the path of it."""
    cells = [list(c) if isinstance(c[0], str) else numbers(c) for c in columns.values()]
    lines = [*above, *([separator.join(columns)] if names else [])]
    lines += [separator.join(row) for row in zip(*cells)]
    path = folder / name
    data = (end.join(lines) + end).encode(encoding)
    path.write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
    return path


def plain(run, **changed):
    """The columns of a plain table, of which some are others; None: it is not there."""
    columns = {"t": run.times, "x": run.x, "y": run.y, "psi": run.psi}
    columns.update(left=run.left, right=run.right, lift=run.lift)
    columns.update(changed)
    return {name: column for name, column in columns.items() if column is not None}


def renamed(run, names):
    """The columns of a plain table under other names."""
    return dict(zip(names.split("|"), plain(run).values()))


def drafted(path, folder):
    """The Recording of a table by the mapping that is drafted from it."""
    draft = folder / "draft.yaml"
    succeeds("info", path, "--write-mapping", draft, "--force")
    (found,) = ground.read(path, mapping=draft)
    return found


def same(found, run, places=1e-6, angles=1e-6, channels=("left", "right", "lift"), times=2e-6):
    """Whether a Recording has the values of a run."""
    assert found.channels == channels
    assert found.pose_times - found.pose_times[0] == pytest.approx(run.times - run.times[0], abs=times)
    moved = run.eta[:, :2] - (run.eta[0, :2] - found.eta[0, :2] if places > 1e-5 else 0)
    assert found.eta[:, :2] == pytest.approx(moved, abs=places)
    assert np.abs(np.angle(np.exp(1j * (found.eta[:, 2] - run.psi)))).max() < angles
    held = found.held(found.controls, found.pose_times)
    assert held == pytest.approx(run.commands[:, : len(channels)], abs=1e-6)


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_table_of_one_row_is_refused_without_warnings(tmp_path):
    path = tmp_path / "small.csv"
    path.write_text("a,b\n1,2\n")
    with pytest.raises(ground.GroundError, match="small.csv"):
        ground.read(path)


def test_a_table_whose_times_begin_at_0_is_not_called_simulated(run, tmp_path):
    path, draft = written(tmp_path, plain(run, t=run.times - run.times[0])), tmp_path / "draft.yaml"
    succeeds("info", path, "--write-mapping", draft)
    printed = succeeds("info", path, "--mapping", draft).stdout
    assert "simulated" not in printed and "times begin at 0 s" in printed


# --- separators, encodings, heads


def comma(column):
    return [cell.replace(".", ",") for cell in numbers(column)]


def quoted(columns):
    return {'"%s"' % name: ['"%s"' % cell for cell in numbers(c)] for name, c in columns.items()}


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
    "commas": lambda f, r: written(f, plain(r)),
    "blanks after commas": lambda f, r: written(f, plain(r), ", "),
    "semicolons": lambda f, r: written(f, plain(r), ";"),
    "decimal commas": lambda f, r: written(f, {n: comma(c) for n, c in plain(r).items()}, ";"),
    "decimal commas, tabs": lambda f, r: written(
        f, {n: comma(c) for n, c in plain(r).items()}, "\t", "log.txt"
    ),
    "quoted decimal commas": lambda f, r: written(
        f, {n: ['"%s"' % cell for cell in comma(c)] for n, c in plain(r).items()}
    ),
    "tabs": lambda f, r: written(f, plain(r), "\t", "log.tsv"),
    "bars": lambda f, r: written(f, plain(r), "|"),
    "blanks": lambda f, r: written(f, plain(r), " ", "log.txt"),
    "columns of blanks": lambda f, r: written(f, plain(r), "    ", "log.dat"),
    "marked names": lambda f, r: written(f, renamed(r, "# t|x|y|psi|left|right|lift"), " ", "log.txt"),
    "marked names, other separator": lambda f, r: written(
        f, plain(r), " ", "log.txt", ["% made by a logger", "% t, x, y, psi, left, right, lift"], names=False
    ),
    "byte order mark": lambda f, r: written(f, plain(r), encoding="utf-8-sig"),
    "utf-16": lambda f, r: written(f, plain(r), "\t", "log.txt", encoding="utf-16"),
    "utf-16 without mark": lambda f, r: written(f, plain(r), encoding="utf-16-le"),
    "latin-1": lambda f, r: written(
        f, renamed(r, "t [s]|x [m]|y [m]|Gierwinkel psi [rad]|left|right|lift"), above=["Größe: 3 µm"],
        encoding="latin-1",
    ),
    "a line for Excel": lambda f, r: written(f, plain(r), ";", above=["sep=;"]),
    "ends of Windows": lambda f, r: written(f, plain(r), end="\r\n"),
    "ends of old Macs": lambda f, r: written(f, plain(r), end="\r"),
    "quotes": lambda f, r: written(f, quoted(plain(r))),
    "separator at the end": lambda f, r: written(f, {**plain(r), "": [""] * len(r.x)}),
    "packed": lambda f, r: written(f, plain(r), name="log.csv.gz"),
    "a long head": lambda f, r: written(f, plain(r), above=["parameter %d" % i for i in range(5000)]),
    "a head of pairs": lambda f, r: written(f, plain(r), above=["Date,2023-11-14", "Operator,N. N.", ""]),
    "a row of units": lambda f, r: written(
        f, {n: [u, *numbers(c)] for (n, c), u in zip(plain(r).items(), ["s", "m", "m", "rad", "-", "-", "-"])}
    ),
    "a row of other units": lambda f, r: written(
        f,
        {
            n: [u, *numbers(k * c)]
            for (n, c), u, k in zip(
                plain(r).items(),
                ["[ms]", "[mm]", "[mm]", "[deg]", "", "", ""],
                [1e3, 1e3, 1e3, 180 / math.pi, 1, 1, 1],
            )
        },
    ),
    "a row of types": lambda f, r: written(f, {n: ["float", *numbers(c)] for n, c in plain(r).items()}),
    "comments between": lambda f, r: written(
        f, {n: [*numbers(c[:9]), "# a" if n == "t" else "", *numbers(c[9:])] for n, c in plain(r).items()}
    ),
    "names again": lambda f, r: written(
        f, {n: [*numbers(c[:9]), n, *numbers(c[9:])] for n, c in plain(r).items()}
    ),
    "groups": lambda f, r: written(
        f,
        {"t": r.times, "x": r.x, "y": r.y, "yaw": r.psi, "left": r.left, "right": r.right, "lift": r.lift},
        above=[",mocap,,,fans,,"],
    ),
    "an index without a name": lambda f, r: written(f, {"": numbers(np.arange(len(r.x)), "%d"), **plain(r)}),
    "a column without values": lambda f, r: written(f, {"t": r.times, "note": [""] * len(r.x), **plain(r)}),
    "other columns": lambda f, r: written(
        f,
        {**plain(r), "CONTROL_DT": r.times * 0 + 0.01, "battery_voltage": 11.9 - 1e-3 * (r.times - START),
         "Status": ["OPTIMAL"] * len(r.x), "solve_time": r.left * 0.001, "temperature": r.times * 0 + 21.5},
    ),
    "exponents of Fortran": lambda f, r: written(
        f, plain(r, x=[("%.9e" % x).replace("e", "D") for x in r.x])
    ),
    "a vector by numbers": lambda f, r: written(f, vector(r)),
    "north and east of an aircraft": lambda f, r: written(f, aircraft(r)),
    "milliseconds that begin again": lambda f, r: written(f, wrapped(r)),
    "days of Excel": lambda f, r: written(f, plain(r, t=numbers(25569 + r.times / 86400, "%.12f"))),
    "days of Matlab": lambda f, r: written(f, plain(r, t=numbers(719529 + r.times / 86400, "%.12f"))),
}  # fmt: skip


@pytest.mark.parametrize("kind", TABLES)
def test_a_table_of_any_form_is_drafted_and_read(kind, run, tmp_path):
    times = 1e-4 if kind.startswith("days") else 2e-6
    same(drafted(TABLES[kind](tmp_path, run), tmp_path), run, times=times)


# --- names and units

DEG = 180 / math.pi
NAMES = {
    "pos_x": "time_s|pos_x|pos_y|heading|left|right|lift",
    "brackets": "Time (s)|X [m]|Y [m]|Yaw [rad]|Left Thruster|Right Thruster|Lift Fan",
    "PlotJuggler": "__time|/a/pose/position/x|/a/pose/position/y|/a/pose/yaw|/cmd/left|/cmd/right|/cmd/lift",
    "rosbag to csv": "stamp|pose.position.x|pose.position.y|pose.theta|cmd.left|cmd.right|cmd.lift",
    "camels": "timestamp|positionX|positionY|yawAngle|thrusterLeft|thrusterRight|liftFan",
    "port and starboard": "t|x_m|y_m|psi_hat [rad]|port_motor|starboard_motor|lift_motor",
    "ned": "t|x_ned|y_ned|yaw|thr_left|thr_right|thr_lift",
    "x north": "t [s]|x_n [m]|y_e [m]|psi [rad]|tau_port|tau_stbd|lift",
    "German": "Zeit [s]|x [m]|y [m]|Winkel [rad]|links|rechts|Auftrieb",
    "German, umlauts": "Zeit [s]|x [m]|y [m]|Winkel [rad]|Lüfter links|Lüfter rechts|Lüfter Auftrieb",
    "French": "temps [s]|x [m]|y [m]|cap [rad]|gauche|droite|sustentation",
    "north and east": "utc|north|east|course_psi|u_left|u_right|u_lift",
}


@pytest.mark.parametrize("kind", NAMES)
def test_usual_names_are_drafted(kind, run, tmp_path):
    same(drafted(written(tmp_path, renamed(run, NAMES[kind])), tmp_path), run)


def turned(psi):
    """Components of the quaternion of a turn about z by psi (n,), x, y, z, w."""
    return [0 * psi, 0 * psi, np.sin(psi / 2), np.cos(psi / 2)]


QUATERNIONS = {
    "qx qy qz qw": ("x|y|z|qx|qy|qz|qw", (0, 1, 2, 3)),
    "w first": ("x|y|z|qw|qx|qy|qz", (3, 0, 1, 2)),
    "pose_orientation": (
        "pose_position_x|pose_position_y|pose_position_z|pose_orientation_x|pose_orientation_y|"
        "pose_orientation_z|pose_orientation_w",
        (0, 1, 2, 3),
    ),
    "q0 to q3": ("px|py|pz|q0|q1|q2|q3", (3, 0, 1, 2)),
    "PX4": ("x|y|z|q[0]|q[1]|q[2]|q[3]", (3, 0, 1, 2)),
    "EuRoC": ("p_RS_R_x [m]|p_RS_R_y [m]|p_RS_R_z [m]|q_RS_w []|q_RS_x []|q_RS_y []|q_RS_z []", (3, 0, 1, 2)),
    "TUM": ("tx|ty|tz|qx|qy|qz|qw", (0, 1, 2, 3)),
}


@pytest.mark.parametrize("kind", QUATERNIONS)
def test_quaternions_of_any_order_and_name_are_drafted(kind, run, tmp_path):
    names, order = QUATERNIONS[kind]
    parts = turned(-run.psi)  # z up
    values = [run.x, -run.y, 0.04 + 0 * run.x, *(parts[i] for i in order)]
    columns = {"t": run.times, **dict(zip(names.split("|"), values)), "left": run.left, "right": run.right}
    same(drafted(written(tmp_path, columns), tmp_path), run, channels=("left", "right"))


def test_a_trajectory_without_names_is_that_of_tum(run, tmp_path):
    parts = turned(-run.psi)
    columns = [run.times, run.x, -run.y, 0.04 + 0 * run.x, *parts]
    written(tmp_path, dict(zip("abcdefgh", columns)), " ", "pose.csv", names=False)
    written(
        tmp_path, {"t": run.times, "left": run.left, "right": run.right, "lift": run.lift}, name="cmd.csv"
    )
    draft = tmp_path.parent / "tum.yaml"
    succeeds("info", tmp_path, "--write-mapping", draft, "--force")
    with pytest.warns(ground.GroundWarning, match="no row names the columns: as in a TUM trajectory"):
        (found,) = ground.read(tmp_path, mapping=draft)
    same(found, run)


MAPPING = """schema: ground/mapping/1
poses:
  position: {fields: [x, y]}
  heading: {field: psi}
  time: {field: t}
commands:
  time: {field: t}
  channels: {left: {field: left}, right: {field: right}, lift: {field: lift}}
"""


def mapped(path, text=MAPPING, **options):
    """The Recording of a table by a mapping."""
    file = path.parent / "m.yaml"
    file.write_text(text)
    (found,) = ground.read(path, mapping=file, **options)
    return found


FRAMED = MAPPING.replace("{field: psi}", '{field: psi, unit: rad}\n  axes: "x, -y, -z"')
OFFSET = MAPPING.replace("{field: psi}", "{field: psi, sign: -1}\n  heading_offset: 0.5")


def turned_to(folder, heading, rate=100.0, form="%.4f"):
    """A table of a craft with headings (n,) in any unit, at a rate [Hz]."""
    times, zeros = np.arange(len(heading)) / rate, np.zeros(len(heading))
    columns = {"t": times, "x": np.sin(times), "y": np.cos(times), "psi": numbers(heading, form)}
    return written(folder, {**columns, "left": zeros + 0.5, "right": zeros, "lift": zeros + 1})


def swung(yaw_rate=3.0, duration=20.0, rate=100.0):
    """Headings of a craft that turns both ways, with noise [rad]."""
    times = np.arange(0, duration, 1 / rate)
    psi = yaw_rate * (times + 3 * np.sin(times))
    return psi + np.random.default_rng(1).normal(0, 4e-3, len(times))


DEGREES = {
    "within half a turn": lambda psi: DEG * np.angle(np.exp(1j * psi)),
    "within a turn": lambda psi: DEG * psi % 360,
    "unwrapped": lambda psi: DEG * psi,
}


@pytest.mark.parametrize("mapping", [MAPPING, FRAMED, OFFSET], ids=["planar", "axes", "offset"])
@pytest.mark.parametrize("rate", [100.0, 5.0])
@pytest.mark.parametrize("way", DEGREES)
def test_degrees_read_as_radians_are_refused(way, rate, mapping, tmp_path):
    """Whatever the mapping does to the heading later."""
    path = turned_to(tmp_path, DEGREES[way](swung(rate=rate)), rate)
    with pytest.raises(ground.GroundError, match=r"log.csv.*degrees.*heading: \{field: psi, unit: deg\}"):
        mapped(path, mapping)
    mended = mapping.replace(", unit: rad", "").replace("field: psi", "field: psi, unit: deg")
    assert len(mapped(path, mended).eta)


def near_north():
    """Headings that step by a turn most of the time."""
    return np.random.default_rng(1).normal(0, 0.05, 2000)


RADIANS = {
    "within half a turn": (np.angle(np.exp(1j * swung())), 100.0),
    "within a turn": (swung() % math.tau, 100.0),
    "north, within a turn": (near_north() % math.tau, 100.0),
    "north, within another turn": (0.8 + (near_north() - 0.8) % math.tau, 100.0),
    "unwrapped over 421 turns": (np.arange(0, 421 * math.tau, 0.2), 100.0),
    "fast, within half a turn": (np.angle(np.exp(0.2j * np.arange(2000))), 100.0),
    "rare, within half a turn": (np.angle(np.exp(1j * swung(rate=5.0))), 5.0),
    "rare, within a turn": (swung(rate=5.0) % math.tau, 5.0),
    "rare, unwrapped and fast": (np.arange(0, 600, 4.0), 5.0),
    "rare, fast, within a turn": (np.arange(0, 600, 4.0) % math.tau, 5.0),
}


@pytest.mark.parametrize("mapping", [MAPPING, FRAMED], ids=["planar", "axes"])
@pytest.mark.parametrize("way", RADIANS)
def test_radians_are_not_taken_for_degrees(way, mapping, tmp_path):
    psi, rate = RADIANS[way]
    assert len(mapped(turned_to(tmp_path, psi, rate), mapping).eta) == len(psi)


def test_units_of_names_and_cells_are_taken_where_the_mapping_has_none(run, tmp_path):
    columns = {"t_ms": 1e3 * run.times, "x_mm": 1e3 * run.x, "y_mm": 1e3 * run.y, "psi_deg": DEG * run.psi}
    columns["left [%]"] = 100 * run.left
    columns["right"] = ["%d us" % (1000 + 1000 * v) for v in run.right]
    columns["lift"] = ["on" if v else "off" for v in run.lift]
    path = written(tmp_path, columns)
    text = MAPPING
    for old, new in (
        ("x, y", "x_mm, y_mm"),
        ("psi", "psi_deg"),
        (": t}", ": t_ms}"),
        (": left}", ': "left [%]"}'),
    ):
        text = text.replace(old, new)
    with pytest.warns(ground.GroundWarning) as said:
        same(mapped(path, text), run)
    for what in (
        "positions are in mm",
        "headings are in deg",
        "left is in percent",
        "right is in microseconds",
    ):
        assert any(what in str(one.message) for one in said), what
    same(drafted(path, tmp_path), run)


# --- cells


def test_cells_without_values_are_left_out_and_counted(run, tmp_path):
    x = numbers(run.x)
    for at, cell in zip((20, 40, 60, 80, 100, 120), ("NaN", "", "--", "null", "-9999", "inf")):
        x[at] = cell
    with pytest.warns(ground.GroundWarning) as said:
        found = mapped(written(tmp_path, plain(run, x=x)))
    assert len(found.eta) == len(run.x) - 6 and np.isfinite(found.eta).all()
    text = " ".join(str(one.message) for one in said)
    assert "-9999" in text and "infinite" in text and "6" in text


def test_poses_are_the_rows_with_a_pose_and_commands_those_with_a_command(run, tmp_path):
    at, to = run.times[::2], run.times[::4] + 1e-3
    order = np.argsort(np.concatenate([at, to]))
    empty = np.full(len(to), "")
    columns = {"t": np.concatenate([at, to])[order]}
    for name in ("x", "y", "psi"):
        columns[name] = np.concatenate([numbers(getattr(run, name)[::2]), empty])[order]
    for name in ("left", "right", "lift"):
        columns[name] = np.concatenate([np.full(len(at), ""), numbers(getattr(run, name)[::4])])[order]
    path = written(tmp_path, {n: [str(v) for v in c] if n != "t" else c for n, c in columns.items()})
    for found in (mapped(path), drafted(path, tmp_path)):
        assert found.eta == pytest.approx(run.eta[::2], abs=1e-8)
        assert found.controls == pytest.approx(run.commands[::4], abs=1e-8)


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_headings_in_rows_of_their_own_are_interpolated(unit, run, tmp_path):
    """As where messages of a receiver and of a compass are written by turns."""
    x, y, psi = (["%.9f" % value for value in column] for column in run.eta.T)
    turned = np.angle(np.exp(1j * run.psi)) if unit == "rad" else np.degrees(run.psi) % 360
    psi = ["%.9f" % value for value in turned]
    for i in range(len(x)):
        if i % 2:
            psi[i] = ""
        else:
            x[i] = y[i] = ""
    path = written(
        tmp_path,
        {
            "t": run.times,
            "x": x,
            "y": y,
            "yaw_" + unit: psi,
            "left": run.left,
            "right": run.right,
            "lift": run.lift,
        },
    )
    with pytest.warns(UserWarning, match="headings are in separate rows: .* at 149 of 150 positions"):
        found = drafted(path, tmp_path)
    assert len(found.pose_times) == 149
    true = np.column_stack([run.x, run.y, run.psi])[1:-1:2]
    off = found.eta - true
    off[:, 2] = np.angle(np.exp(1j * off[:, 2]))
    assert np.abs(off[:, :2]).max() < 1e-6
    assert np.abs(off[:, 2]).max() < 0.03 and np.sqrt((off[:, 2] ** 2).mean()) < 0.008  # noise of 0.005 rad


@pytest.mark.parametrize("rows", [2, 3])
def test_a_pose_whose_parts_never_meet_is_none(rows, tmp_path):
    (tmp_path / "log.csv").write_text("t,x,y,psi,left,right\n" + "0.0,,,,1,1\n" * rows + "9.0,1,2,,1,0\n")
    result = identify("info", tmp_path / "log.csv", "--write-mapping", tmp_path / "draft.yaml")
    assert "unexpected" not in result.stderr and "Traceback" not in result.stderr


def test_an_empty_command_is_held_or_off_as_the_mapping_says(run, tmp_path):
    left = [cell if value else "" for cell, value in zip(numbers(run.left), run.left)]
    path = written(tmp_path, plain(run, left=left))
    off = MAPPING.replace("commands:\n", "commands:\n  empty: off\n")
    with pytest.warns(ground.GroundWarning, match="missing values of commands are read as off: left"):
        same(mapped(path, off), run)
    with pytest.warns(ground.GroundWarning, match="left is missing in .* held .*empty: off"):
        held = mapped(path)
    first = int(np.flatnonzero(run.left)[0])
    assert len(held.controls) == len(run.left) - first and held.controls[:, 0].min() == 1


def test_lists_and_words_in_cells_are_commands(run, tmp_path):
    fans = ["[%d, %d]" % pair for pair in zip(run.left, run.right)]
    for cells in (['"%s"' % one for one in fans], fans, [one.replace(",", "") for one in fans]):
        columns = plain(run, left=None, right=None, lift=["true" if v else "False" for v in run.lift])
        path = written(tmp_path, {**columns, "switches": cells})
        text = MAPPING.replace("field: left", 'field: "switches[0]"').replace(
            "field: right", 'field: "switches[1]"'
        )
        same(mapped(path, text), run)
    with pytest.raises(ground.GroundError, match=r"switches .*it is a list: write switches\[0\]"):
        mapped(path, text.replace('"switches[0]"', "switches"))
    found = drafted(path, tmp_path)
    assert found.channels == ("lift", "switches_0", "switches_1")


def test_commands_that_overshoot_are_clipped_and_refused_from_a_fifth(run, tmp_path):
    with pytest.warns(ground.GroundWarning, match="left ranges from 0 to 1.02: .* were clipped"):
        same(mapped(written(tmp_path, plain(run, left=1.02 * run.left))), run)
    with pytest.raises(ground.GroundError, match="must be between 0 and 1"):
        mapped(written(tmp_path, plain(run, left=1.25 * run.left)))


def test_a_name_that_stands_twice_is_named_by_its_number(run, tmp_path):
    columns = {**plain(run), "x ": run.x * 0 + 0.1}
    path = written(tmp_path, columns)
    same(mapped(path, MAPPING.replace("[x, y]", '["x#1", y]')), run)
    with pytest.raises(ground.GroundError, match="2 columns have this name: write x#1 or x#2"):
        mapped(path)
    same(drafted(path, tmp_path), run)
    same(mapped(written(tmp_path, {**plain(run), "x ": run.x})), run)  # both are the same


def test_a_cut_file_is_read_to_its_last_whole_line(run, tmp_path):
    path = written(tmp_path, plain(run))
    path.write_bytes(path.read_bytes()[:-40] + b"\0" * 100)
    with pytest.warns(ground.GroundWarning, match="last line is truncated"):
        found = mapped(path)
    assert (
        found.eta == pytest.approx(run.eta[: len(found.eta)], abs=1e-8) and len(found.eta) == len(run.eta) - 1
    )


# --- stamps


def texts(run, form, digits=6):
    stamps = [datetime.datetime.utcfromtimestamp(round(t, digits)) for t in run.times]
    return [one.strftime(form) for one in stamps]


STAMPS = {
    "ISO 8601": lambda r: {"t": texts(r, "%Y-%m-%dT%H:%M:%S.%fZ")},
    "a zone": lambda r: {"t": texts(r, "%Y-%m-%d %H:%M:%S.%f+01:00")},
    "German": lambda r: {"t": texts(r, "%d.%m.%Y %H:%M:%S.%f")},
    "American": lambda r: {"t": texts(r, "%m/%d/%Y %I:%M:%S.%f %p")},
    "slashes": lambda r: {"t": texts(r, "%Y/%m/%d %H:%M:%S.%f")},
    "month by name": lambda r: {"t": texts(r, "%d-%b-%Y %H:%M:%S.%f")},
    "date and time": lambda r: {"Date": texts(r, "%Y-%m-%d"), "Time": texts(r, "%H:%M:%S.%f")},
    "date without signs": lambda r: {"date": texts(r, "%Y%m%d"), "time": texts(r, "%H:%M:%S.%f")},
    "time of day": lambda r: {"time": texts(r, "%H:%M:%S.%f")},
    "milliseconds": lambda r: {"t": numbers(1e3 * r.times, "%.3f")},
    "microseconds": lambda r: {"t": numbers(np.rint(1e6 * r.times), "%d")},
    "nanoseconds": lambda r: {"t": ["%d" % n for n in np.rint(1e6 * r.times).astype(np.int64) * 1000]},
    "two columns": lambda r: {
        "sec": numbers(r.times // 1, "%d"),
        "nanosec": numbers(np.rint(1e6 * (r.times % 1)) * 1000, "%d"),
    },
    "from 0": lambda r: {"Time": numbers(r.times - START)},
    "milliseconds from 0": lambda r: {"millis": numbers(np.rint(1e3 * (r.times - START)), "%d")},
}


@pytest.mark.parametrize("kind", STAMPS)
def test_stamps_of_any_form_are_drafted_and_read(kind, run, tmp_path):
    columns = {**STAMPS[kind](run), **plain(run, t=None)}
    same(drafted(written(tmp_path, columns), tmp_path), run)


def test_a_date_that_does_not_begin_with_the_year_needs_a_format(run, tmp_path):
    form = "%d.%m.%Y %H:%M:%S.%f"
    path = written(tmp_path, plain(run, t=texts(run, form)))
    with pytest.raises(ground.GroundError, match="format: '%s'" % form):
        mapped(path)
    same(mapped(path, MAPPING.replace("field: t}", 'field: t, format: "%s"}' % form)), run)


def test_times_of_day_pass_midnight(run, tmp_path):
    times = [(86399.0 + t - START) % 86400 for t in run.times]
    clock = ["%02d:%02d:%09.6f" % (t // 3600, t // 60 % 60, t % 60) for t in times]
    with pytest.warns(ground.GroundWarning, match="pass midnight"):
        same(mapped(written(tmp_path, plain(run, t=clock))), run)


@pytest.mark.parametrize("unused", ["", ",note,operator"], ids=["", "names of columns that no row has"])
def test_nanoseconds_without_zeros_are_named_and_mended(unused, run, tmp_path):
    glued = [
        "%d.%d" % divmod(n, 10**9) for n in (np.rint(1e6 * (run.times + 0.027)).astype(np.int64) * 1000 + 7)
    ]
    path = written(tmp_path, plain(run, t=glued))
    path.write_text(path.read_text().replace("\n", unused + "\n", 1))
    with pytest.raises(ground.GroundError, match="without leading zeros; stamps: unpadded in the mapping"):
        mapped(path)
    same(mapped(path, MAPPING + "stamps: unpadded\n"), run)
    same(mapped(path, stamps="unpadded"), run)
    same(drafted(path, tmp_path), run)
    dated = [
        datetime.datetime.utcfromtimestamp(int(one[:10])).strftime("%Y/%m/%d %H:%M:%S") + one[10:]
        for one in glued
    ]
    path = written(tmp_path, plain(run, t=dated))
    with pytest.raises(ground.GroundError, match="stamps: unpadded in the mapping"):
        mapped(path)
    same(drafted(path, tmp_path), run)


def test_lost_digits_are_named_and_a_rate_takes_their_place(run, tmp_path):
    path = written(tmp_path, plain(run, t=numbers(run.times, "%g")))
    with pytest.raises(ground.GroundError, match=r"last digits were lost .*time: \{rate: HZ\}"):
        mapped(path)
    same(mapped(path, MAPPING.replace("field: t}", "rate: 100}")), run)
    draft = tmp_path / "draft.yaml"
    identify("info", path, "--write-mapping", draft)
    assert "lost their last digits" in draft.read_text()


def test_frames_are_times_by_their_rate(run, tmp_path):
    frames = numbers(np.arange(len(run.x)) + 100, "%d")
    columns = {"frame": frames, **plain(run, t=None)}
    path = written(tmp_path, columns)
    same(mapped(path, MAPPING.replace("field: t}", "field: frame, rate: 100}")), run)
    with pytest.raises(ground.GroundError, match="poses.time.rate has no value"):
        mapped(path, MAPPING.replace("field: t}", "field: frame, rate: }"))
    with pytest.warns(ground.GroundWarning, match="frame numbers at the 100 Hz"):
        same(drafted(written(tmp_path, columns, above=["# Capture rate: 100 Hz"]), tmp_path), run)


def test_a_clock_that_starts_anew_is_named_with_the_rows_of_each_run(run, tmp_path):
    columns = {n: [*numbers(c), *numbers(c)] for n, c in plain(run).items()}
    path = written(tmp_path, columns)
    with pytest.raises(ground.GroundError, match=r"rows: \[1, 300\] or rows: \[301, 600\]"):
        mapped(path)
    second = mapped(path, MAPPING + "rows: [301, 600]\n")
    same(second, run)
    columns = {n: [*numbers(c), *numbers(0.5 * c)] for n, c in plain(run).items()}
    first, second = (
        mapped(written(tmp_path, columns), MAPPING + "rows: %s\n" % r) for r in ([1, 300], [302, 600])
    )
    assert first.identity != second.identity


def test_the_latest_rows_may_come_first(run, tmp_path):
    path = written(tmp_path, {name: column[::-1] for name, column in plain(run).items()})
    with pytest.warns(ground.GroundWarning, match="the latest poses come first"):
        same(mapped(path), run)


def test_a_clock_of_32_bits_that_begins_again_goes_on(run, tmp_path):
    counts = (np.rint(1e6 * (run.times - START)).astype(np.int64) + 2**32 - 1000000) % 2**32
    path = written(tmp_path, plain(run, t=["%d" % count for count in counts]))
    with pytest.warns(ground.GroundWarning, match="32 bits starts again"):
        same(mapped(path, MAPPING.replace("field: t}", "field: t, unit: us}")), run)


def test_poses_and_commands_have_clocks_of_their_own_in_one_table(run, tmp_path):
    few = np.arange(0, len(run.x), 4)
    rest = [""] * (len(run.x) - len(few))
    columns = plain(run, left=None, right=None, lift=None)
    columns["t_cmd"] = numbers(run.times[few]) + rest
    columns.update({n: numbers(getattr(run, n)[few]) + rest for n in ("left", "right", "lift")})
    text = MAPPING.replace("commands:\n  time: {field: t}", "commands:\n  time: {field: t_cmd}")
    found = mapped(written(tmp_path, columns), text)
    assert found.eta == pytest.approx(run.eta, abs=1e-8)
    assert found.controls == pytest.approx(run.commands[few], abs=1e-8)


def test_rows_of_several_bodies_are_told_apart_by_their_name(run, tmp_path):
    columns = {n: np.repeat(numbers(c), 2).tolist() for n, c in plain(run).items()}
    columns["x"][1::2] = ["7"] * len(run.x)
    path = written(tmp_path, {"body": ["craft", "wand"] * len(run.x), **columns})
    with pytest.raises(ground.GroundError, match="several bodies: craft, wand; choose one with --body"):
        mapped(path)
    found = mapped(path, body="craft")
    assert found.eta == pytest.approx(run.eta, abs=1e-8)
    assert drafted(path, tmp_path).eta == pytest.approx(run.eta, abs=1e-8)


def test_files_of_other_programs_are_refused_with_what_to_export(tmp_path):
    (tmp_path / "log.xlsx").write_bytes(b"PK")
    with pytest.raises(ground.GroundError, match="export the sheet as CSV"):
        ground.read(tmp_path / "log.xlsx")


def test_a_format_is_given_where_it_cannot_be_guessed(run, tmp_path):
    odd = texts(run, "%S.%f past %M of %H on day %j of %Y")
    path = written(tmp_path, plain(run, t=odd))
    with pytest.raises(ground.GroundError, match="known format.*format: "):
        mapped(path)
    text = MAPPING.replace("field: t}", 'field: t, format: "%S.%f past %M of %H on day %j of %Y"}')
    same(mapped(path, text), run)


# --- places


def test_coordinates_of_maps_count_from_the_first_pose(run, tmp_path):
    columns = plain(run, x=7034000 + run.x, y=569000 + run.y)
    path = written(tmp_path, columns)
    with pytest.warns(ground.GroundWarning, match="far from the origin.* is subtracted"):
        same(mapped(path), run, places=1e-4)
    names = {"t": run.times, "easting": columns["y"], "northing": columns["x"], "heading": run.psi}
    path = written(tmp_path, {**names, "left": run.left, "right": run.right, "lift": run.lift})
    same(drafted(path, tmp_path), run, places=1e-4)


def test_latitude_and_longitude_are_distances_from_the_first_fix(run, tmp_path):
    latitude = 46.5 + run.x / 111166.0
    longitude = 6.6 + run.y / (111320.0 * math.cos(math.radians(46.5)) * 1.00176)
    fixes = {
        "time": run.times,
        "latitude": numbers(latitude, "%.10f"),
        "longitude": numbers(longitude, "%.10f"),
    }
    rest = {"heading_deg": DEG * run.psi % 360, "left": run.left, "right": run.right, "lift": run.lift}
    path = written(tmp_path, {**fixes, **rest})
    same(drafted(path, tmp_path), run, places=5e-3)
    path = written(tmp_path, plain(run, x=fixes["latitude"], y=fixes["longitude"]))
    with pytest.raises(ground.GroundError, match="look like latitude and longitude.*unit: deg"):
        mapped(path)
    same(mapped(path, MAPPING.replace("[x, y]", "[x, y], unit: deg")), run, places=5e-3)


@pytest.fixture(scope="module")
def boat():
    """A run of a craft that goes where it points, over east and north."""
    run = Run()
    angle = np.cumsum(0.02 * np.sin(0.05 * np.arange(len(run.x)) + 1)) + 1.0
    run.psi = np.angle(np.exp(1j * angle))
    run.x, run.y = np.cumsum([0.01 * np.cos(angle), 0.01 * np.sin(angle)], axis=1)
    run.eta = np.column_stack([run.x, run.y, run.psi])
    return run


def test_compass_and_map_headings_are_told_apart_by_the_motion(boat, tmp_path):
    rest = {"left": boat.left, "right": boat.right, "lift": boat.lift}
    compass = {"t": boat.times, "x": boat.y, "y": boat.x, "heading": DEG * boat.psi % 360, **rest}
    same(drafted(written(tmp_path, compass), tmp_path), boat)
    east = {"t": boat.times, "E": 5e5 + boat.y, "N": 5e6 + boat.x, "yaw_deg": 90 - DEG * boat.psi, **rest}
    same(drafted(written(tmp_path, east), tmp_path), boat, places=1e-4)


# --- exports of motion capture programs


def folder_of(tmp_path, run, lines, name="mocap.csv"):
    """A folder with an export and a table of commands."""
    (tmp_path / name).write_text("\n".join(lines) + "\n")
    written(
        tmp_path,
        {"t": run.times - START, "left": run.left, "right": run.right, "lift": run.lift},
        name="cmd.csv",
    )
    return tmp_path


def motive(run, euler, unit="Millimeters"):
    """An export of Motive, y up, with two bodies and markers."""
    kind = "XYZ" if euler else "Quaternion"
    parts = ["X", "Y", "Z"] if euler else ["X", "Y", "Z", "W"]
    one = ["Rotation"] * len(parts) + ["Position"] * 3 + ["Mean Marker Error"]
    axes = [*parts, "X", "Y", "Z", ""]
    bodies = ["craft"] * len(one) + ["wand"] * len(one) + ["craft:Marker1"] * 3
    head = "Format Version,1.23,Take Name,T,Capture Frame Rate,100,Rotation Type,%s,Length Units,%s"
    lines = [head % (kind, unit), ""]
    lines.append(",Type," + ",".join(["Rigid Body"] * 2 * len(one) + ["Rigid Body Marker"] * 3))
    lines += [",Name," + ",".join(bodies), ",ID," + ",".join('"12"' for _ in bodies)]
    lines.append(",," + ",".join(one * 2 + ["Position"] * 3))
    lines.append("Frame,Time (Seconds)," + ",".join(axes * 2 + ["X", "Y", "Z"]))
    still = ["0"] * len(parts[:-1]) + ["0" if euler else "1"] + ["5", "50", "5", "0.1"]
    for i, (x, y, psi) in enumerate(run.eta):
        turn = -psi  # about y up
        angles = [0, math.degrees(turn), 0]
        if euler and abs(angles[1]) > 90:
            angles = [180, math.degrees(math.pi - turn), 180]
        rotation = angles if euler else [0, math.sin(turn / 2), 0, math.cos(turn / 2)]
        values = [*rotation, 1000 * x, 40, 1000 * y, 0.2]
        cells = ["%.7f" % v for v in values] if i % 50 != 20 else [""] * len(values)
        lines.append("%d,%.6f," % (i, i / 100) + ",".join([*cells, *still, "1", "2", "3"]))
    return lines


@pytest.mark.parametrize("euler", [False, True])
def test_an_export_of_motive_is_read_from_its_head(euler, run, tmp_path):
    found = drafted(folder_of(tmp_path, run, motive(run, euler)), tmp_path.parent)
    kept = np.arange(len(run.x)) % 50 != 20
    assert found.eta[:, :2] == pytest.approx(run.eta[kept, :2], abs=1e-6)
    assert np.abs(np.angle(np.exp(1j * (found.eta[:, 2] - run.psi[kept])))).max() < 1e-5
    assert any("its bodies are craft, wand" in warning for warning in found.warnings)


def test_an_export_of_qualisys_is_read_from_its_head(run, tmp_path):
    lines = ["NO_OF_FRAMES\t%d" % len(run.x), "NO_OF_CAMERAS\t4", "NO_OF_BODIES\t2", "FREQUENCY\t100"]
    lines += ["DESCRIPTION\t--", "DATA_INCLUDED\t6D", "BODY_NAMES\tcraft\twand"]
    one = ["X", "Y", "Z", "Roll", "Pitch", "Yaw", "Residual", *("Rot[%d]" % i for i in range(9))]
    apart = [[body, *one] for body in ("craft", "wand")]
    first = [["%s X" % body, *one[1:]] for body in ("craft", "wand")]
    each = [["%s %s" % (body, name) for name in one] for body in ("craft", "wand")]
    for heads in (apart, first, each):
        named = [cell for head in heads for cell in head]
        head = "\t".join(["Frame", "Time", *named])
        rows = []
        for i, (x, y, psi) in enumerate(run.eta):
            c, s = math.cos(-psi), math.sin(-psi)
            values = [1000 * x, -1000 * y, 40, 0, 0, -DEG * psi, 0.3, c, s, 0, -s, c, 0, 0, 0, 1]
            values = values if i % 50 != 20 else [0] * 16
            rows.append(
                "\t".join(["%d" % (i + 1), "%.5f" % (i / 100), *map("{:.7f}".format, values + [0] * 16)])
            )
        found = drafted(folder_of(tmp_path, run, [*lines, head, *rows], "mocap.tsv"), tmp_path.parent)
        kept = np.arange(len(run.x)) % 50 != 20
        assert found.eta[:, :2] == pytest.approx(run.eta[kept, :2], abs=1e-6)
        assert np.abs(np.angle(np.exp(1j * (found.eta[:, 2] - run.psi[kept])))).max() < 1e-5


def test_an_export_of_vicon_is_read_from_its_head(run, tmp_path):
    lines = ["Objects", "100", ",,Global Angle craft:craft,,,,,", "Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ"]
    lines.append(",,rad,rad,rad,mm,mm,mm")
    for i, (x, y, psi) in enumerate(run.eta):
        lines.append("%d,0,0,0,%.8f,%.6f,%.6f,40" % (i, -psi, 1000 * x, -1000 * y))
    found = drafted(folder_of(tmp_path, run, lines), tmp_path.parent)
    assert found.eta == pytest.approx(run.eta, abs=1e-6)


# --- commands


def test_what_commands_mean_is_drafted_from_their_values(run, tmp_path):
    pulses = 1511 + 389 * np.where(run.left > 0, 1, np.where(run.right > 0, -1, 0))
    columns = {"t": run.times, "x": run.x, "y": run.y, "psi": run.psi, "thr_pwm": numbers(pulses, "%d")}
    columns.update({"delta_rudder [deg]": 35 * (run.left - run.right), "n_prop [rps]": 8 * run.right})
    columns.update(
        {"valve_0": run.lift, "throttle": numbers(255 * run.left, "%d"), "motor_pct": 100 * run.right}
    )
    path = written(tmp_path, columns)
    found = drafted(path, tmp_path)
    assert found.channels == ("thr_pwm", "delta_rudder", "n_prop", "valve_0", "throttle", "motor")
    wanted = [(pulses - 1511) / 389, run.left - run.right, run.right, run.lift, run.left, run.right]
    assert found.controls == pytest.approx(np.column_stack(wanted), abs=1e-4)
    text = (tmp_path / "draft.yaml").read_text()
    assert "off: 1511" in text and "an angle in deg" in text and "unit: percent" in text


@pytest.mark.parametrize(
    "names", [("lab1.csv", "lab2.csv"), ("left.csv", "right.csv"), ("day.csv", "night.csv")]
)
def test_tables_that_are_runs_are_no_thrusters_of_one_run(run, tmp_path, names):
    folder = tmp_path / "runs"
    folder.mkdir()
    for number, name in enumerate(names):
        written(folder, plain(run, x=run.x + number), name=name)
    succeeds("info", folder, "--write-mapping", tmp_path / "m.yaml")
    same(ground.read(folder, mapping=tmp_path / "m.yaml")[0], run)


def test_a_draft_looks_at_the_commands_of_all_rows_and_runs(run, tmp_path):
    strong = plain(run, left=200 * run.left, right=200 * run.right)
    weak = {name: np.asarray(column) for name, column in plain(run, left=50 * run.left).items()}
    weak["right"] = 50 * run.right
    folder = tmp_path / "runs"
    folder.mkdir()
    written(folder, weak, name="a.csv")
    written(folder, strong, name="b.csv")
    many = 1 + 21000 // len(run.times)
    length = run.times[-1] - START + 0.01
    long = {name: np.tile(column, many) for name, column in weak.items()}
    long["t"] = np.concatenate([run.times + i * length for i in range(many)])
    for name in ("left", "right"):
        long[name] = np.append(long[name][: -len(run.times)], strong[name])
    for path in (folder, written(tmp_path, long, name="long.csv")):
        draft = tmp_path / "draft.yaml"
        succeeds("info", path, "--write-mapping", draft, "--force")
        assert draft.read_text().count("full: 200}") == 2, draft.read_text()


def test_a_table_whose_columns_have_no_names_is_listed_for_who_completes_the_draft(run, tmp_path):
    path = written(
        tmp_path, plain(run), " ", "log.dat", above=[" A basin", " Time series of motions"], names=False
    )
    draft = tmp_path / "draft.yaml"
    result = identify("info", path, "--write-mapping", draft)
    assert result.returncode == 0 and "column_2: " in draft.read_text()
    text = MAPPING
    for number, name in enumerate(("t", "x", "y", "psi", "left", "right", "lift"), 1):
        text = text.replace("field: %s}" % name, "field: column_%d}" % number)
    same(mapped(path, text.replace("[x, y]", "[column_2, column_3]")), run)


@pytest.mark.parametrize(
    "content, reason",
    [
        ("", "no rows"),
        ("name,place\na,b\nc,d\n", "no row .* numbers"),
        ("t,x,y\n", "no row .* numbers"),
        ("3.5\n4.5\n5.5\n", "two values or more"),
    ],
)
def test_what_is_no_table_is_refused_in_a_sentence(content, reason, tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(content)
    with pytest.raises(ground.GroundError, match=reason):
        mapped(path)


# --- further forms


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
    assert "signal names the signal, value holds its value" in result.stdout + result.stderr


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
