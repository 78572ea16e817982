"""identify simulate as users run it, its bags, and excitation and tracking inside a room."""

import hashlib
import json
import math

import numpy as np
import pytest

import ground
from conftest import MODEL, ROOT, fails, identify, json_of, process, program, succeeds

POSE, TRUTH = "/vrpn_client_node/hovercraft/pose", "/simulator/truth"
DRIVE = "/drive"
SETTINGS = "/run/settings"
ROOM = ROOT / "cfg" / "room" / "room_4x4.yaml"
TIMED = "time,left,right\n0,0.2,0.8\n0.5,0.9,0\n2,0,0\n"
LIFTED = "time,left,right,lift\n0,0,0,1\n1,0.5,0.5,1\n3,0,0,0.5\n4,0,0,0\n"


def simulate(folder, kind, *options, name="run.bag", run=program):
    """Runs simulate; returns the bag and the output of --json."""
    out = folder / name
    arguments = ["--model", MODEL, "--input", kind, "-o", out, "--json", *options]
    result = run("identify", "simulate", *arguments)
    assert result.returncode == 0, result.stderr
    return out, json.loads(result.stdout)


def messages(path):
    import rosbag

    found = {}
    with rosbag.Bag(str(path)) as bag:
        for topic, message, received in bag.read_messages():
            found.setdefault(topic, []).append((received.to_sec(), message))
    return found


def commands(path):
    """Rows time since the begin of the lift, left, right, lift."""
    rows = [(t, m.left, m.right, m.lift) for t, m in messages(path)["/controls"]]
    return np.array(rows) - [1000.5, 0, 0, 0]


def driven(path):
    """Rows time, left, right of the part with thrust; the time counts from its begin."""
    rows = commands(path)
    rows[:, 0] -= 1
    return rows[(rows[:, 0] > -1e-9) & (rows[:, 3] > 0)][:, :3]


def levels_at(rows, times):
    return rows[np.searchsorted(rows[:, 0], np.array(times) + 1e-6) - 1, 1:]


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def digest_of_messages(path, but=()):
    """Digest of the messages and their times on all topics except `but`, without computing times."""
    import rosbag

    found = hashlib.sha256()
    with rosbag.Bag(str(path)) as bag:
        for topic, message, received in bag.read_messages():
            if topic in but:
                continue
            if topic == "/decision":
                message.computing = 0
            found.update(repr((topic, str(message), received)).encode())
    return found.hexdigest()


def test_the_bag_has_the_contents_of_a_recording(tmp_path):
    path, result = simulate(tmp_path, "prbs", "--duration", 4, "--latency", 0.05, "--start-pose", 1, -2, 3)
    found = messages(path)
    assert result["messages"] == {topic: len(rows) for topic, rows in found.items()}
    assert set(found) == {POSE, "/controls", TRUTH, DRIVE, "/mocap_state/settings", SETTINGS}
    kinds = {topic: rows[0][1]._type for topic, rows in found.items()}
    assert kinds[POSE] == "geometry_msgs/PoseStamped"
    assert kinds["/controls"] == "ground_msgs/Controls"
    assert kinds[TRUTH] == "ground_msgs/State"
    for received, message in found[POSE]:
        assert received - message.header.stamp.to_sec() == pytest.approx(0.05, abs=1e-6)
    for received, message in found["/controls"] + found[TRUTH] + found[DRIVE]:
        assert received == message.header.stamp.to_sec()
    everything = sorted(t for rows in found.values() for t, _ in rows)
    assert everything[0] == 1000 and everything[-1] == pytest.approx(1006, abs=0.02)
    # Rest, then lift alone, thrust, and everything off.
    rows = commands(path)
    assert (rows[rows[:, 0] < -1e-9, 1:] == 0).all()
    alone = (rows[:, 0] > -1e-9) & (rows[:, 0] < 1 - 1e-9)
    assert (rows[alone, 1:] == [0, 0, 1]).all() and alone.sum() >= 50
    assert (rows[rows[:, 0] > 5, 1:] == 0).all() and (rows[:, 0] > 5).sum() >= 20
    assert np.diff(rows[:, 0]).max() < 0.021, "commands are repeated at 50 Hz"


@pytest.fixture(scope="module")
def sagging(tmp_path_factory):
    """A model whose thrust fades, and a bag of 30 s."""
    folder = tmp_path_factory.mktemp("sagging")
    model = folder / "sagging.yaml"
    text = MODEL.read_text()
    assert "effects: []" in text
    model.write_text(text.replace("effects: []", "effects: [{name: battery_sag, tau: 25}]"))
    path = folder / "whole.bag"
    succeeds("simulate", "--model", model, "--input", "prbs", "--duration", 30, "-o", path)
    return model, path


def cut(path, out, start):
    """Writes the part of a bag from `start` [s] on, as from a recorder that is started late."""
    import rosbag

    with rosbag.Bag(str(path)) as bag, rosbag.Bag(str(out), "w") as part:
        begin = bag.get_start_time()
        for topic, message, received in bag.read_messages():
            if received.to_sec() >= begin + start:
                part.write(topic, message, received)
    return out


def fitted(model, path):
    """Fitted k and time constant of the sag, and the RepairedRun of the bag."""
    from ground import _core
    from ground.analysis import windows
    from ground.checks import quality
    from ground.reading import readers

    run = quality.repaired(readers.read(str(path)))
    guess = _core.load_model(str(model))
    data = [run.data(guess)]
    guess.set_value("battery_sag.tau", 100)
    found = windows.problem(data, windows.cut(data)).fit(guess, ["k", "battery_sag.tau"])["model"]
    return found.value("k"), found.value("battery_sag.tau"), run


@pytest.mark.parametrize("start", [0, 10])
def test_t_counts_from_the_drive_even_in_a_bag_that_begins_later(sagging, tmp_path, start):
    model, path = sagging
    k, tau, run = fitted(model, cut(path, tmp_path / "part.bag", start))
    assert k == pytest.approx(0.062, rel=0.02)  # an origin that is wrong by 10 s changes k by a third
    assert tau == pytest.approx(25, rel=0.05)
    assert (run.drives, run.drives_by) == (pytest.approx([0.5 - start], abs=0.03), "record")
    # The same holds for copies of a run.
    from ground.analysis import window_error

    np.testing.assert_allclose(run.data(_load(model)).t[-1], 30, atol=2.1)
    floor = window_error.noise_floor([run.data(_load(model))], _load(model))
    assert floor.max() < 0.1


def _load(model):
    from ground import _core

    return _core.load_model(str(model))


@pytest.mark.parametrize("kind", ["prbs", "tracking", "timed"])
def test_the_same_command_line_gives_the_same_bytes(tmp_path, kind):
    if kind == "timed":
        kind = tmp_path / "timed.csv"
        kind.write_text(TIMED)
    options = ["--duration", 3, "--loss", 0.05, "--seed", 3]
    first, _ = simulate(tmp_path, kind, *options, name="first.bag")
    again, _ = simulate(tmp_path, kind, *options, name="again.bag", run=process)
    other, _ = simulate(tmp_path, kind, *options[:-1], 4, name="other.bag")
    same = digest_of_messages if kind == "tracking" else digest
    assert same(first) == same(again)
    assert same(first) != same(other)
    succeeds("info", first, "--json")


def test_csv_of_a_recording_plays_at_its_clock_and_reports_it(tmp_path):
    from ground import _core

    rows = [row for row in _core.make_prbs(5, 1) for _ in range(3)]
    csv = tmp_path / "recorded.csv"
    csv.write_text("".join("%d,%d\n" % tuple(row) for row in rows))
    path, result = simulate(tmp_path, csv, "--clock", 10, "--duration", 3.1)
    played = levels_at(driven(path), (np.arange(31) + 0.5) / 10)
    np.testing.assert_array_equal(played, np.array(_core.make_prbs(5, 1), float))
    assert result["sequence"].startswith("93 rows, 3 rows per bit: a clock of 10 Hz")
    path, result = simulate(tmp_path, csv, "--rows-per-bit", 1, "--duration", 6, name="slow.bag")
    played = levels_at(driven(path), (np.arange(90) + 0.5) / 15)
    np.testing.assert_array_equal(played, np.array(rows, float)[:90])


@pytest.mark.parametrize(
    "text, option", [(TIMED, ("--clock", 9)), (LIFTED, ("--lift", 0.5))], ids=["timed", "lifted"]
)
def test_a_csv_of_times_takes_no_other_timing(tmp_path, text, option):
    csv = tmp_path / "rows.csv"
    csv.write_text(text)
    done = program("identify", "simulate", "--model", MODEL, "--input", csv, "-o", "x.bag", *option)
    assert done.returncode == 2
    assert "%s does not fit --input" % option[0] in done.stderr


def test_the_controller_in_the_loop(tmp_path):
    options = ["--duration", 30, "--size", 1, "--rate-of-turn", 0.8, "--origin", 0.5, 0]
    path, result = simulate(tmp_path, "tracking", *options)
    assert result["stopped"] is None
    found = messages(path)
    references = [m for _, m in found["/reference"]]
    assert len(references) == pytest.approx(1500, abs=5)
    assert np.hypot(*(np.array([m.p for m in references]) - [0.5, 0]).T) == pytest.approx(1)
    truth = {m.header.stamp.to_nsec(): m for _, m in found[TRUTH]}
    off = [np.array(truth[m.header.stamp.to_nsec()].eta[:2]) - m.p for m in references]
    rms = math.sqrt(np.mean(np.sum(np.square(off), axis=1)))
    assert result["tracking_error"] == pytest.approx(rms, rel=1e-6)
    assert rms < 0.7, "the craft follows as well as gains (4.11) allow"
    assert {m.header.stamp for m in references} == {m.state for _, m in found["/decision"]}
    assert all(0 < m.computing < 0.1 for _, m in found["/decision"])
    given = {t: (m.left, m.right) for t, m in found["/controls"] if m.header.frame_id}
    for t, m in found["/controls/wanted"]:
        assert given[t] == pytest.approx(np.clip([m.left, m.right], 0, 1), abs=1e-9), t
    # Each command of the law has the time at which its pose was delivered.
    delivered = {t for t, _ in found[POSE]}
    law = [t for t, m in found["/controls"] if m.left or m.right]
    assert set(law) <= delivered
    # All that it commands leaves at once.
    sent = [(t, m.left, m.right) for t, m in found["/sent"] if m.left or m.right]
    assert sent == [(t, m.left, m.right) for t, m in found["/controls"] if m.left or m.right]


def test_the_controller_stops_when_the_mocap_is_lost(tmp_path):
    out = tmp_path / "run.bag"
    result = succeeds(
        *["simulate", "--model", MODEL, "--input", "tracking", "-o", out, "--json"],
        *["--gap-rate", 0.3, "--gap-length", 1],
    )
    assert "the controller stopped: the state is stale" in result.stderr
    summary = json.loads(result.stdout)
    assert summary["stopped"] == "the state is stale" and summary["duration"] < 20
    found = messages(out)
    assert found["/controls"][-1][1].lift == found["/sent"][-1][1].lift == 0


@pytest.mark.parametrize(
    "options, words",
    [
        (["--input", "sine"], ["'sine' is neither one of prbs, multilevel-prbs"]),
        (["--input", "prbs", "--duration", "-3"], ["--duration", "not between"]),
        (["--input", "prbs", "--levels", "0", "1.2"], ["--levels", "1.2 is not between -1 and 1"]),
        (["--input", "prbs", "--seed", "-1"], ["--seed"]),
        (["--input", "prbs", "--loss", "1.5"], ["--loss must be between 0 and 1, not 1.5"]),
        (["--input", "prbs", "--position-noise", "-1"], ["--position-noise must be between"]),
        (["--input", "prbs", "--hold", "1"], ["--hold does not fit --input prbs"]),
        (["--input", "tracking", "--levels", "0", "1"], ["--levels does not fit"]),
        (["--input", "tracking", "--reference", "square"], ["--reference"]),
        (["--input", "tracking", "--size", "-1"], ["--size must be between 0.01 and 100 m, not -1"]),
        (["--input", "prbs", "--start-pose", "0", "0", "inf"], ["not finite"]),
        (["--input", "prbs", "--disturbance", "0.1"], ["a SHARE between 0 and 1 and a positive", "not 0.1"]),
        (["--input", "prbs", "--disturbance", "2", "0.3"], ["a SHARE between 0 and 1", "not 2 0.3"]),
        (["--input", "prbs", "--disturbance", "0.1", "0"], ["positive TIME"]),
        (["--input", "prbs", "--trim", "0.5"], ["0.5 is not between 0 and 0.3"]),
        (["--input", "prbs", "--burst", "2"], ["--burst needs --room"]),
        (["--input", "prbs", "--room", ROOM, "--burst", "nan"], ["--burst"]),
        (["--input", "tracking", "--room", ROOM, "--burst", "2"], ["--burst does not fit"]),
        ([], ["--input"]),
    ],
)
def test_bad_usage(tmp_path, options, words):
    out = tmp_path / "run.bag"
    fails(identify("simulate", "--model", MODEL, "-o", out, *options), "--help", *words, status=2)
    assert not out.exists()


def test_bad_models_and_runs(tmp_path):
    out = tmp_path / "run.bag"

    def run(model, *options):
        return identify("simulate", "--model", model, "--input", "prbs", "-o", out, *options)

    fails(run(tmp_path / "none.yaml"), "none.yaml")
    bad = tmp_path / "bad.yaml"
    bad.write_text(MODEL.read_text().replace("  k: 0.062", "  kk: 1\n  k: 0.062"))
    fails(run(bad), "bad.yaml, line", "unknown key 'kk'")
    wild = tmp_path / "wild.yaml"
    wild.write_text(MODEL.read_text().replace("8.8e-5", "1e-9").replace("4.62e-5", "1.0"))
    fails(run(wild), "not finite at")
    fails(run(MODEL, "--loss", 1), "0 of", "nothing to record")
    fails(run(MODEL, "--start-velocity", 1e200, 0, 1e200), "not finite")
    fails(identify("simulate", "--model", MODEL, "--input", "prbs", "-o", "/no/x.bag"), "no folder")
    assert not out.exists()


DISTURBANCE = """disturbance:
  sigma: {X: 0.003, Y: 0.004, N: 5.0e-5}
  time: {X: 0.3, Y: 0.2, N: 0.1}
  trim: {N: 3.0e-5}
"""


@pytest.mark.parametrize("end", ["csv", "mcap"])
def test_a_bag_is_not_written_under_the_name_of_another_format(tmp_path, end):
    options = ["--model", MODEL, "--input", "prbs", "-o", tmp_path / ("run." + end)]
    fails(identify("simulate", *options), "run.bag", *(["to_frame()"] if end == "csv" else []))
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(ground.GroundError, match="run.bag"):
        ground.simulate(MODEL, duration=1).save(tmp_path / ("run." + end))


def test_the_disturbance_of_a_model_acts_on_request(tmp_path):
    model = tmp_path / "windy.yaml"
    model.write_text(MODEL.read_text() + DISTURBANCE)

    def bag(name, *options):
        out = tmp_path / name
        result = succeeds(
            "simulate", "--model", model, "--input", "prbs", "--duration", 2, "-o", out, *options
        )
        return digest(out), result.stdout

    still, output = bag("still.bag")
    assert "with --disturbance" in " ".join(output.split())
    plain, _ = simulate(tmp_path, "prbs", "--duration", 2)
    but_model = (SETTINGS,)
    assert digest_of_messages(tmp_path / "still.bag", but_model) == digest_of_messages(plain, but_model)
    acting, output = bag("acting.bag", "--disturbance")
    assert "with --disturbance" not in " ".join(output.split())
    assert acting == bag("again.bag", "--disturbance")[0]
    assert still == bag("zero.bag", "--disturbance", 0, 1)[0]
    given = (["--disturbance", "--seed", 2], ["--disturbance", 0.02, 0.3], ["--trim", 0.03])
    others = [bag("%d.bag" % i, *options)[0] for i, options in enumerate(given)]
    assert len({still, acting, *others}) == 5
    _, report = simulate(tmp_path, "prbs", "--disturbance", 0.02, 0.3, "--trim", 0.1, name="j.bag")
    assert report["disturbance"]["time"] == [0.3] * 3
    assert report["disturbance"]["trim_thrust"] == 0.1
    assert report["disturbance"]["trim"][0] == pytest.approx(0.1 * 2 * 0.062)


# --- inside a room


def clearances(path, half=2.0):
    """Distances of the true craft from the walls of a square room in the middle [m]."""
    eta = np.array([message.eta for _, message in messages(path)[TRUTH]])
    return half - np.abs(eta[:, :2]).max(axis=1)


@pytest.fixture(scope="module")
def excited(tmp_path_factory):
    """Bag of 20 s of a PRBS in the room, and the output with --json."""
    folder = tmp_path_factory.mktemp("excited")
    return simulate(folder, "prbs", "--room", ROOM)


def test_an_excitation_stays_inside_and_one_without_a_room_does_not(excited, tmp_path):
    path, result = excited
    assert result["stopped"] is None
    near = clearances(path)
    assert near.min() > 0.2
    assert near.max() - near.min() > 0.5, "the craft moves"
    open_loop, _ = simulate(tmp_path, "prbs")
    assert clearances(open_loop).min() < 0


def test_a_fit_reads_a_bag_of_bursts(excited, tmp_path):
    path, _ = excited
    out = tmp_path / "fitted.yaml"
    fit = json_of("fit", path, "--model", MODEL, "-o", out)["parameters"]
    assert fit["k"]["value"] == pytest.approx(0.062, rel=0.03)
    assert fit["I_z"]["value"] == pytest.approx(8.8e-5, rel=0.03)


def test_a_tracking_controller_stays_inside(tmp_path):
    options = ["--room", ROOM, "--controller", "ModelPredictive", "--size", 1.5]
    path, result = simulate(tmp_path, "tracking", *options, "--duration", 10)
    assert result["stopped"] is None and result["bursts"] == 0
    assert clearances(path).min() > 0.2


def test_a_craft_that_would_leave_is_stopped_and_the_run_is_kept(tmp_path):
    out = tmp_path / "run.bag"
    result = succeeds(
        *["simulate", "--model", MODEL, "--input", "prbs", "--room", ROOM, "-o", out],
        *["--start-velocity", 3, 0, 0],
    )
    (message,) = result.stderr.strip().splitlines()
    assert message.startswith("identify simulate: the controller stopped: ")
    assert "of the room" in message
    assert out.exists()


def refused(tmp_path, *options):
    """Runs simulate, which must not write a bag; returns the result."""
    out = tmp_path / "refused.bag"
    result = identify("simulate", "--model", MODEL, "-o", out, *options)
    assert not out.exists()
    return result


def test_a_reference_too_large_for_the_room_is_refused_with_one_line(tmp_path):
    for size in (1.9, 2.5):
        result = refused(tmp_path, "--input", "tracking", "--room", ROOM, "--size", size)
        fails(result, "the reference does not fit into", "room_4x4.yaml", "m outside", status=2)
        assert ["does not fit" in line for line in result.stderr.strip().splitlines()].count(True) == 1
    shifted = ["--input", "tracking", "--room", ROOM, "--size", 1.5, "--origin", 0.6, 0]
    fails(refused(tmp_path, *shifted), "the reference does not fit into", status=2)
