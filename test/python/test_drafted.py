"""Recordings without a mapping are read by a draft if nothing of it is left to decide, and else refused."""

import re

import numpy as np
import pytest

import ground
from conftest import MODEL, identify
from test_any_table import Run, numbers, plain, same, written

NAMES = "t [s]|x [m]|y [m]|psi [rad]|left|right|lift"


@pytest.fixture(scope="module")
def run():
    return Run(duration=12.0)


def told(run, names=NAMES, **changed):
    """The columns of a table whose names say their units."""
    return dict(zip(names.split("|"), plain(run, **changed).values()))


def read_again(path, found, folder):
    """The Recording of the same file by the mapping that was drafted."""
    mapping = folder / "again.yaml"
    mapping.write_text(found.mapping)
    (again,) = ground.read(path, mapping=mapping)
    return again


def identical(one, other):
    return all(
        np.array_equal(getattr(one, name), getattr(other, name))
        for name in ("eta", "pose_times", "controls", "control_times")
    )


def refusal(path):
    with pytest.raises(ground.GroundError) as error:
        ground.read(path)
    return str(error.value)


@pytest.mark.parametrize("up", [False, True])
def test_a_table_that_says_its_units_is_read_by_its_draft(run, tmp_path, up):
    """Which way is up, left and right say, as they turn the craft."""
    sign = -1 if up else 1
    path = written(tmp_path, told(run, y=sign * run.y, psi=sign * run.psi))
    with pytest.warns(ground.GroundWarning, match="no mapping is given; the draft leaves nothing to decide"):
        (found,) = ground.read(path)
    same(found, run)
    assert ('axes: "x, -y, -z"' if up else 'axes: "x, y, z"') in found.mapping
    assert "undecided" not in found.mapping
    assert identical(found, read_again(path, found, tmp_path))
    assert found.source.count(path.name) == 1


def test_columns_that_a_draft_does_not_use_are_listed(run, tmp_path):
    columns = {
        **told(run),
        "battery [V]": 7.4 - 0.01 * (run.times - run.times[0]),
        "gyro_z [rad/s]": np.cos(run.times),
    }
    with pytest.warns(ground.GroundWarning, match="the draft leaves nothing to decide"):
        (found,) = ground.read(written(tmp_path, columns))
    listed = found.mapping.splitlines()[-1]
    assert listed.startswith("#") and "battery [V], gyro_z [rad/s]" in listed
    assert not any(name in listed for name in NAMES.split("|"))


@pytest.mark.parametrize(
    "line, names, changed",
    [
        ("position: .*undecided: no unit is given", NAMES.replace("x [m]|y [m]", "x|y"), {}),
        ("heading: .*undecided: no unit is given", NAMES.replace("psi [rad]", "psi"), {"psi": 0.1}),
        ("left: .*undecided: 0 to 0.5", NAMES, {"left": 0.5}),
        ("axes: .*undecided", NAMES, {"left": 0.0}),
    ],
)
def test_what_the_file_leaves_open_is_refused_with_the_line_to_decide(run, tmp_path, line, names, changed):
    columns = {name: factor * getattr(run, name) for name, factor in changed.items()}
    text = refusal(written(tmp_path, told(run, names, **columns)))
    assert "--write-mapping M.yaml drafts a mapping" in text
    assert re.search(r"to decide in it:\n(.*\n)*  - .*" + line, text), text


@pytest.mark.parametrize("further", ["clock", "mocap_x [m]"])
def test_two_candidates_are_refused(run, tmp_path, further):
    columns = told(run)
    if further == "clock":
        columns["time [s]"] = numbers(run.times + 0.3)
    else:
        columns.update({"mocap_x [m]": run.x + 1, "mocap_y [m]": run.y, "mocap_yaw [rad]": run.psi})
    assert "undecided: other" in refusal(written(tmp_path, columns))


def drifted(run):
    return run.psi + 0.03 * (run.times - run.times[0])


def ticks(run):
    """Times in counts of 0.1 ms."""
    return {"t": numbers(1e4 * (run.times - run.times[0]), "%.0f")}


@pytest.mark.parametrize(
    "line, names, changed",
    [
        ("left: .*undecided: .* it never rests at 0", NAMES, lambda r: {"left": 2 * r.left - 1}),
        ("left: .*undecided: 5 to 10", NAMES.replace("left", "left [%]"), lambda r: {"left": 5 + 5 * r.left}),
        ("time: .*undecided: no unit", NAMES.replace("t [s]", "time"), ticks),
        (
            "heading: .*undecided: taken to count as the frame",
            "t [s]|x_ned [m]|y_ned [m]|yaw [rad]|motor_a|motor_b",
            lambda r: {"psi": -r.psi},
        ),
        (
            "time: .*unit: ms.*undecided",
            NAMES.replace("t [s]", "t [ms]"),
            lambda r: {"t": r.times % 1e4},
        ),
        ("heading: .*undecided: it steps", NAMES, lambda r: {"psi": np.degrees(r.psi)}),
        ("heading: .*undecided: it steps", NAMES.replace("[rad]", "[deg]"), lambda r: {}),
        ("position: .*undecided: no unit", NAMES.replace("y [m]", "y [mm]"), lambda r: {"y": 1e3 * r.y}),
        ("valid: lost  # undecided", NAMES + "|lost", lambda r: {"lost": 1.0 * (np.arange(1200) % 100 > 96)}),
        ("time: .*unit: s.*undecided", NAMES, lambda r: {"t": 1e3 * (r.times - r.times[0])}),
        ("other headings: heading .rad.", NAMES + "|heading [rad]", lambda r: {"heading": drifted(r)}),
        (
            "other positions: x_map .m., y_map .m.",
            NAMES.replace("x [m]|y [m]", "x_odom [m]|y_odom [m]") + "|x_map [m]|y_map [m]",
            lambda r: {"x_map": r.x + 0.1 * np.sin(r.times), "y_map": r.y},
        ),
        ("others that could be it: stamp", NAMES + "|stamp [s]", lambda r: {"s": np.repeat(r.times[::4], 4)}),
        ("could be commands: m1", NAMES.replace("left", "left_stick") + "|m1", lambda r: {"m1": r.left}),
    ],
)
def test_what_may_be_read_wrong_is_refused_with_the_line_to_decide(run, tmp_path, line, names, changed):
    columns = {name: column[: len(run.times)] for name, column in changed(run).items()}
    text = refusal(written(tmp_path, told(run, names, **columns)))
    assert re.search(r"to decide in it:\n(.*\n)*  - .*" + line, text), text


@pytest.mark.parametrize("named", ["x_enu [m]|y_enu [m]", "x_east [m]|y_north [m]", ""])
def test_left_and_right_that_contradict_the_frame_are_refused(run, tmp_path, named):
    """Names say that z is up, or a height above the floor does."""
    names = NAMES.replace("x [m]|y [m]", named) if named else NAMES + "|z [m]"
    high = {} if named else {"z": 0.05 + 1e-4 * np.sin(run.times)}
    up = {"y": -run.y, "psi": -run.psi, **high}
    assert len(ground.read(written(tmp_path, told(run, names, **up), name="sound.csv"))) == 1
    swapped = told(run, names, left=run.right, right=run.left, **up)
    assert re.search(
        "swapped" if named else "to decide in it:\n  - axes", refusal(written(tmp_path, swapped))
    )


def test_names_that_the_motion_refutes_are_refused(run, tmp_path):
    names = NAMES.replace("x [m]|y [m]", "x_ned [m]|y_ned [m]")
    sound = ground.read(written(tmp_path, told(run, names), name="sound.csv"))
    assert len(sound) == 1
    swapped = told(run, names, left=run.right, right=run.left)
    assert "swapped" in refusal(written(tmp_path, swapped))


@pytest.mark.parametrize("flag", ["", "mocap_valid"], ids=["zeros", "a flag"])
@pytest.mark.parametrize("lost", [slice(0, 90), slice(400, 460), slice(900, None)])
def test_poses_of_a_body_that_is_lost_are_left_out(run, tmp_path, flag, lost):
    """They are zeros, or a flag says that they are none."""
    is_lost = np.zeros(len(run.x), bool)
    is_lost[lost] = True
    columns = {
        name: np.where(is_lost, 0.7 * bool(flag), getattr(run, name) + 0.5) for name in ("x", "y", "psi")
    }
    further = {flag: 1.0 - is_lost} if flag else {}
    found = ground.read(written(tmp_path, {**told(run, **columns), **further}))[0]
    assert found.pose_times == pytest.approx(run.times[~is_lost], abs=2e-6)
    assert found.eta[:, 0] == pytest.approx(run.x[~is_lost] + 0.5, abs=1e-6)


def test_a_craft_that_rests_at_zero_is_not_lost(run, tmp_path):
    """As of a simulation without noise."""
    still = np.arange(len(run.x)) < 50
    columns = {name: np.where(still, 0.0, getattr(run, name)) for name in ("x", "y", "psi")}
    (found,) = ground.read(written(tmp_path, told(run, **columns)))
    assert len(found.eta) == len(run.x)


def test_a_flag_that_may_be_of_something_else_is_to_decide(run, tmp_path):
    columns = {**told(run), "lidar_valid": 1.0 * (np.arange(len(run.x)) % 100 > 3)}
    assert re.search(
        "to decide in it:\n  - .*valid: lidar_valid  # undecided", refusal(written(tmp_path, columns))
    )


def test_clocks_that_drift_apart_are_refused_with_the_key_that_corrects_them(tmp_path):
    run = Run(duration=25.0)
    poses = ("t [s]", "x [m]", "y [m]", "psi [rad]")
    columns = told(run, t=run.times[0] + 1.03 * (run.times - run.times[0]))
    written(tmp_path, {name: columns[name] for name in poses}, name="pose.csv")
    commands = {name: column for name, column in told(run).items() if name not in poses[1:]}
    written(tmp_path, commands, name="cmd.csv")
    assert re.search(r"to decide in it:\n(.*\n)*  - .*clock_drift: -0\.0(28|29|30)", refusal(tmp_path))


def test_a_mapping_that_is_given_is_not_drafted(run, tmp_path):
    path = written(tmp_path, told(run))
    given = tmp_path / "given.yaml"
    given.write_text("schema: ground/mapping/1\n")
    with pytest.raises(ground.GroundError, match="given.yaml does not say which column is the time"):
        ground.read(path, mapping=given)


def test_verbs_store_the_mapping_beside_their_result(run, tmp_path):
    path = written(tmp_path, told(run))
    shown = identify("info", path)
    assert "no mapping is given" in shown.stderr and "  | schema: ground/mapping/1" in shown.stdout
    folder = tmp_path / "compared"
    result = identify("compare", path, "--model", MODEL, "-o", folder, "--numbers")
    stored = folder / "log.mapping.yaml"
    assert result.returncode == 0 and "see %s" % stored in result.stderr
    (found,) = ground.read(path)
    (again,) = ground.read(path, mapping=stored)
    assert identical(found, again) and stored.read_text() == found.mapping


def remarks(given):
    return [one for one in given if "undecided: " in one]


def test_a_mapping_with_lines_to_decide_warns_until_they_are_decided(run, tmp_path):
    paths = [
        written(tmp_path, told(run, NAMES.replace("x [m]|y [m]", "x|y"), x=run.x + i), name="%d.csv" % i)
        for i in range(2)
    ]
    mapping, fitted = tmp_path / "M.yaml", tmp_path / "fitted.yaml"
    assert identify("info", paths[0], "--write-mapping", mapping).returncode == 0
    lines = mapping.read_text().splitlines()
    guesses = [i for i, line in enumerate(lines, 1) if "undecided: " in line]
    assert guesses
    with pytest.warns(ground.GroundWarning, match="M.yaml, line %d .*no unit is given" % guesses[0]):
        runs = ground.read(paths, mapping=mapping)
    for one in runs:
        assert len(remarks(one.warnings)) == len(guesses)
    for verb in (["info"], ["fit", "--model", MODEL, "-o", fitted]):
        result = identify(*verb, *paths, "--mapping", mapping)
        assert len(remarks(result.stderr.splitlines())) == len(guesses), result.stderr
        assert "nothing to correct" not in result.stdout
    mapping.write_text("\n".join(line.split("  # ")[0] for line in lines))
    assert [remarks(one.warnings) for one in ground.read(paths, mapping=mapping)] == [[], []]


@pytest.mark.filterwarnings("ignore::ground.support.errors.GroundWarning")
@pytest.mark.parametrize("up", [False, True])
def test_a_draft_that_the_motion_decides_leaves_no_such_warning(run, tmp_path, up):
    sign = -1 if up else 1
    (found,) = ground.read(written(tmp_path, told(run, y=sign * run.y, psi=sign * run.psi)))
    assert found.mapping and found.warnings == []
