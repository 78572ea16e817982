"""Settings of the measurement (axes, heading_offset) and files are recorded with a run and used."""

import hashlib
import json
import shutil

import numpy as np
import pytest
import yaml

from conftest import MODEL, ROOT, simulate_run, write_bag
from ground import _core, cli
from ground.models import Room
from ground.reading import readers, run_settings
from ground.reading.mapping import DEFAULT
from ground.support.errors import GroundError

TURNED = "y, -x, z"  # axes of a mocap whose z is down
OFFSET = 0.5


@pytest.fixture
def verb(capsys):
    """Runs a verb of identify in this process; gives its output (parsed with --json) and its stderr."""

    def run(*arguments, status=0):
        found = cli.main([str(a) for a in arguments])
        out, err = capsys.readouterr()
        assert found == status, err
        return (json.loads(out) if "--json" in arguments else out), err

    return run


def mocap_bag(path, settings=(), offset=0.0, axes="x, z, -y", seed=1, turned_at=np.inf, **options):
    """Writes a bag of mocap poses of a rigid body that is turned by `offset` [rad], and from `turned_at`
    [s] on by twice that. settings: rows (since [s], axes, heading_offset) of mocap_state."""
    import genpy
    import rosbag
    from geometry_msgs.msg import PoseStamped
    from ground_msgs.msg import Controls

    times, eta, inputs = simulate_run(seed=seed, **options)
    with rosbag.Bag(str(path), "w") as bag:
        start = genpy.Time.from_sec(1000)
        for since, *how in settings:
            from ground_msgs.msg import MocapSettings

            message = MocapSettings(None, *how)
            message.header.stamp = genpy.Time.from_sec(1000 + since)
            bag.write("/mocap_state/settings", message, max(start, message.header.stamp))
        for t, row in zip(times, eta):
            mapping = _core.AxisMapping(axes, offset * (1 if t < turned_at else 2))
            position, orientation = mapping.to_mocap(row, 0.04)
            pose = PoseStamped()
            pose.header.stamp = genpy.Time.from_sec(1000 + t)
            p, q = pose.pose.position, pose.pose.orientation
            p.x, p.y, p.z = position
            q.x, q.y, q.z, q.w = orientation
            bag.write("/vrpn_client_node/hovercraft/pose", pose, pose.header.stamp)
        for t, left, right, lift in inputs:
            controls = Controls(left=left, right=right, lift=lift)
            controls.header.stamp = genpy.Time.from_sec(1000 + t)
            bag.write("/controls", controls, controls.header.stamp)
    return str(path)


def parameters_beside(bag, **mocap_state):
    """Writes the file of parameters that record writes beside `DATE_EXPERIMENT_0.bag`."""
    path = bag[: -len("_0.bag")] + ".yaml"
    with open(path, "w") as file:
        yaml.safe_dump({"controller": {"rate": 50.0}, "mocap_state": mocap_state}, file)
    return path


def test_axes_of_the_parameter_file_beside_a_bag_are_used_by_every_verb(tmp_path, verb):
    bag = mocap_bag(tmp_path / "run_0.bag", axes=TURNED, offset=OFFSET)
    parameters_beside(bag, axes=TURNED, heading_offset=OFFSET)
    model = ["--model", MODEL, "--json"]
    fitted = verb("fit", bag, *model, "-o", tmp_path / "fit.yaml")[0]
    assert fitted["parameters"]["k"]["value"] == pytest.approx(0.062, rel=0.03)
    compared = verb("compare", bag, "--numbers", *model, "-o", tmp_path / "compared")[0]
    assert compared["pooled"]["tiny_whoover"]["all"]["error"] < 0.2
    added = verb("add", "heading_offset", bag, *model, "-o", tmp_path / "added.yaml")[0]
    left = added["parameters"]["heading_offset.psi0"]["value"]
    assert abs(left) < 0.02, "the recorded offset must be corrected, only once"
    found = verb("diagnose", bag, *model, "-o", tmp_path / "found", "--only", "heading_offset", "motor_lag")[
        0
    ]
    assert found["verdict"] == "complete"
    described = verb("info", bag, "--json")[0][0]["settings"]
    assert (described["axes"], described["heading_offset"]) == (TURNED, OFFSET)
    assert set(described["sources"].values()) == {"recorded in run.yaml"}


def test_settings_in_the_bag_take_precedence_over_those_beside_it(tmp_path):
    bag = mocap_bag(tmp_path / "run_0.bag", [(-5, "x, z, -y", OFFSET)], OFFSET)
    parameters_beside(bag, axes=TURNED, heading_offset=0.1)
    read = readers.read(bag)
    assert read.settings.values("heading_offset") == (OFFSET,)
    assert set(read.settings.sources.values()) == {"recorded in the bag"}
    assert read.eta[0, 2] == pytest.approx(0, abs=0.03)


def test_a_change_of_heading_offset_during_the_run_is_used(tmp_path, verb):
    settings = [(-5, "x, z, -y", OFFSET), (3.999, "x, z, -y", 2 * OFFSET)]
    bag = mocap_bag(tmp_path / "run.bag", settings, OFFSET, turned_at=4.0)
    times, eta, _ = simulate_run()
    read = readers.read(bag)
    off = np.angle(np.exp(1j * (read.eta[:, 2] - eta[:, 2])))
    assert np.abs(off).max() < 1e-6
    text = verb("info", bag)[0]
    assert "heading_offset 0.5 rad (recorded in the bag)" in text
    assert "from 4.00 s on axes 'x, z, -y', heading_offset 1 rad" in text


def test_a_later_part_of_a_recording_has_the_earlier_settings(tmp_path):
    # rosbag record repeats latched messages, with old stamps, in every part of a recording.
    bag = mocap_bag(tmp_path / "run_1.bag", [(-600, "x, z, -y", OFFSET)] * 2, OFFSET)
    read = readers.read(bag)
    assert len(read.settings.changes) == 1
    assert read.eta[0, 2] == pytest.approx(0, abs=0.03)


def test_the_command_line_takes_precedence_over_recorded_settings(tmp_path, verb):
    bag = mocap_bag(tmp_path / "run_0.bag", [(-5, TURNED, 0.1)], OFFSET)
    out = verb("info", bag, "--axes", "x, z, -y", "--heading-offset", OFFSET)[0]
    assert "axes 'x, z, -y' (--axes), heading_offset 0.5 rad (--heading-offset)" in out
    given = DEFAULT.with_options(axes="x, z, -y", heading_offset=OFFSET)
    assert readers.read(bag, given).eta[0, 2] == pytest.approx(0, abs=0.03)
    err = verb("info", bag, "--heading-offset", 30, status=1)[1]
    assert err.count("\n") == 1 and "--heading-offset" in err and "radians" in err
    err = verb("info", bag, "--axes", "x, y, y", status=1)[1]
    assert err.count("\n") == 1 and "--axes" in err and "right-handed" in err


def test_bags_without_settings_are_read_with_defaults(tmp_path, verb):
    bag = mocap_bag(tmp_path / "run_0.bag")
    assert "axes 'x, z, -y' (default), heading_offset 0 rad (default)" in verb("info", bag)[0]
    (tmp_path / "run.yaml").write_text("mocap_state: [")
    err = verb("info", bag)[1]
    assert err.count("\n") == 1 and "run.yaml" in err
    planar = write_bag(tmp_path / "planar.bag")
    text, err = verb("info", planar, "--axes", TURNED)
    assert "measured    heading_offset 0 rad (default)" in text
    assert "--axes changes nothing: the bag contains planar poses" in err


def test_runs_with_different_settings_are_named(tmp_path, verb):
    bags = [
        mocap_bag(tmp_path / ("%s.bag" % name), [(-5, "x, z, -y", offset)], offset, seed=seed)
        for name, offset, seed in (("a", 0.0, 1), ("b", 0.0, 2), ("c", OFFSET, 3))
    ]
    err = verb("info", *bags)[1]
    assert "heading_offset 0.0 for a, b; heading_offset 0.5 for c" in err and err.count("\n") == 1
    assert "different settings" not in verb("info", *bags[:2])[1]
    fit = ["fit", *bags[:2], "--model", MODEL, "-o", tmp_path / "fit.yaml"]
    assert verb(*fit, "--holdout", bags[2])[1].count("different settings") == 1


def test_the_controller_of_a_run_is_read_from_beside_it_and_differences_are_named(tmp_path, verb):
    bags = [mocap_bag(tmp_path / ("%s_0.bag" % name), seed=seed) for seed, name in enumerate("abc")]
    for name, model in (("a", "one.yaml"), ("b", "two.yaml")):
        controller = {"kind": "Excitation", "design": "spin", "model": "/x/" + model, "file": ""}
        (tmp_path / (name + ".yaml")).write_text(yaml.safe_dump({"controller": controller}))
    out, err = verb("info", *bags)
    assert "flown by    controller Excitation, design spin, model one.yaml\n" in out
    assert out.count("flown by") == 2
    assert "model one.yaml for a_0; model two.yaml for b_0" in err and "c_0" not in err
    assert verb("info", *bags[1:])[1] == ""


@pytest.fixture
def lab(tmp_path):
    """A folder with a model and a room."""
    folder = tmp_path / "lab"
    folder.mkdir()
    shutil.copy(str(MODEL), str(folder / "craft.yaml"))
    shutil.copy(str(ROOT / "cfg/room/room_4x4.yaml"), str(folder / "room.yaml"))
    return folder


def tracking_bag(verb, lab, bag, *options):
    """Simulates a tracking run in the lab's room; returns its bag."""
    tracking = ["--input", "tracking", "--controller", "ModelPredictive", "--size", 1]
    tracking += ["--duration", 3, "--room", lab / "room.yaml", "--model", lab / "craft.yaml"]
    verb("simulate", *tracking, "-o", bag, *options)
    return bag


def test_a_simulated_bag_contains_model_and_room(tmp_path, verb, lab):
    kept = {name: (lab / name).read_text() for name in ("craft.yaml", "room.yaml")}
    bag = tracking_bag(verb, lab, tmp_path / "run.bag")
    shutil.rmtree(str(lab))
    files = readers.read(str(bag)).files
    assert files["model"].text == kept["craft.yaml"] and files["room"].text == kept["room.yaml"]
    (described,) = verb("info", bag, "--json")[0]
    digest = hashlib.sha256(kept["room.yaml"].encode()).hexdigest()
    assert described["files"]["room"]["sha256"] == digest
    assert (
        "controller ModelPredictive, reference circle, model craft.yaml ('Tiny Whoover', kept with the "
        "run), room room.yaml ('4 x 4 m', kept with the run)\n"
    ) in verb("info", bag)[0]
    assert readers.files_in(str(bag)) == files


def test_model_and_room_are_kept_beside_a_recorded_run(tmp_path, lab):
    nowhere = str(lab / "nowhere.yaml")
    parameters = {"controller": {"kind": "Excitation"}, "sender": {"room": nowhere}}
    for name, file in (("model", "craft.yaml"), ("room", "room.yaml")):
        parameters["controller"][name] = str(lab / file)
    bag = mocap_bag(tmp_path / "run_0.bag")
    room = (lab / "room.yaml").read_text()
    (tmp_path / "run.yaml").write_text(run_settings.document(parameters))
    (lab / "room.yaml").write_text("something else")
    read = readers.read(bag)
    assert read.files["room"].text == room and not read.warnings
    assert Room.of_recording(read).margin == 0.2


def test_files_differ_by_their_contents(tmp_path, verb, lab):
    bags = [tracking_bag(verb, lab, tmp_path / "a.bag")]
    room, model = lab / "room.yaml", lab / "craft.yaml"
    room.write_text("# a comment\n" + room.read_text())
    model.write_text(model.read_text() + 'provenance: {date: "2026-11-23"}\n')
    bags.append(tracking_bag(verb, lab, tmp_path / "b.bag", "--seed", 2))
    assert verb("info", *bags)[1] == "", "comments and provenance do not matter"
    room.rename(lab / "other.yaml")
    other = ["--room", lab / "other.yaml", "--seed", 3]
    bags.append(tracking_bag(verb, lab, tmp_path / "c.bag", *other))
    assert verb("info", *bags)[1] == "", "names of files do not matter"
    named = mocap_bag(tmp_path / "e_0.bag")
    controller = {"model": "/x/craft.yaml", "room": "/x/room.yaml"}
    (tmp_path / "e.yaml").write_text(yaml.safe_dump({"controller": controller}))
    assert verb("info", bags[0], named)[1] == "", "a run without contents has the same names"
    room.write_text((lab / "other.yaml").read_text().replace("margin: 0.2", "margin: 0.3"))
    model.write_text(model.read_text().replace("m: 0.0583", "m: 0.0601"))
    bags.append(tracking_bag(verb, lab, tmp_path / "d.bag", "--seed", 4))
    said = verb("info", *bags)[1]
    for file in ("model craft.yaml", "room room.yaml"):
        assert "%s for a, b, c; %s for d" % (file, file) in said


def test_invalid_axes_in_a_bag_are_refused(tmp_path):
    bag = mocap_bag(tmp_path / "run.bag", [(-5, "x, z, w", 0.0)])
    with pytest.raises(GroundError, match="recorded in the bag"):
        readers.read(bag)
