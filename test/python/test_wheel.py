"""The wheel, installed without ROS into a virtual environment, gives the same results as with ROS.

To save minutes, the wheel contains the libraries that the workspace has built (GROUND_BUILT); its Python
module and all other files are built here.
"""

import json
import os
import shutil
import subprocess
import sys

import pytest
import rosbag

from conftest import MODEL, ROOT, SHARED, identify, program, slow, succeeds
from test_downstream import devel_space

PRINT = ROOT / "test" / "python" / "print_recording.py"
STAMP = "2019-04-16-11-28-36"  # name of a real recording
pytestmark = slow
ROS = ("ROS", "CATKIN", "PYTHONPATH", "LD_LIBRARY_PATH", "CMAKE_PREFIX_PATH", "PKG_CONFIG_PATH")


def run(*command):
    """Runs a command without the environment of ROS; returns its standard output."""
    bare = {name: value for name, value in os.environ.items() if not name.startswith(ROS)}
    if shutil.which("ccache"):
        bare["CMAKE_CXX_COMPILER_LAUNCHER"] = "ccache"
    result = subprocess.run(
        list(map(str, command)),
        capture_output=True,
        text=True,
        timeout=580,
        env={**bare, "PATH": "/usr/bin:/bin"},
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    """Folder of programs of a virtual environment with the wheel and its dependencies."""
    folder = tmp_path_factory.mktemp("wheel")
    programs = folder / "bare" / "bin"
    run("/usr/bin/python3", "-m", "venv", folder / "bare")
    pip = (programs / "python", "-m", "pip", "--disable-pip-version-check", "--quiet")
    try:
        fetch = ("download", "--retries", 1, "--timeout", 20, "--no-deps", "--dest", folder)
        run(*pip, *fetch, "rosbags")
    except AssertionError as error:
        pytest.skip("PyPI cannot be reached: %s" % str(error).strip().splitlines()[-1])
    settings = ("--config-settings", "cmake.define.GROUND_BUILT=%s" % devel_space())
    run(*pip, "wheel", "--no-deps", "--wheel-dir", folder, *settings, ROOT)
    (wheel,) = folder.glob("ground_hovercraft-*.whl")
    run(*pip, "install", "--no-compile", wheel)
    return programs


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Bags written with ROS: a simulated one and, if available, a real one."""
    folder = tmp_path_factory.mktemp("bags")
    simulated, real = folder / "simulated.bag", folder / "real.bag"
    options = ("--model", MODEL, "--input", "prbs", "--duration", 8, "--seed", 3)
    succeeds("simulate", *options, "-o", simulated)
    if not SHARED.is_dir():
        return [simulated]
    succeeds("import", *exported(), "-o", real)
    return [simulated, real]


def exported():
    return [SHARED / (kind + "_" + STAMP + ".csv") for kind in ("controls", "pose")]


def test_recordings_are_the_same_bit_for_bit(bare, bags):
    with_ros = subprocess.check_output([sys.executable, str(PRINT), *map(str, bags)], text=True).splitlines()
    without = run(bare / "python", PRINT, *bags).splitlines()
    assert len(without) == len(bags)
    for path, wanted, found in zip(bags, with_ros, without):
        assert len(found) > 1e5 and found == wanted, path.name


def test_fit_finds_the_same_parameters(bare, bags, tmp_path):
    options = ("--model", MODEL, "--json", "-o")
    for path in bags:
        with_ros = json.loads(identify("fit", path, *options, tmp_path / "ros.yaml").stdout)
        found = run(bare / "identify", "fit", path, *options, tmp_path / (path.stem + ".yaml"))
        parameters, wanted = json.loads(found)["parameters"], with_ros["parameters"]
        assert list(parameters) == list(wanted)
        for name, parameter in wanted.items():
            assert parameters[name]["value"] == pytest.approx(parameter["value"], rel=1e-6)
        (tmp_path / "ros.yaml").unlink()


def contents(path):
    with rosbag.Bag(str(path)) as bag:
        return list(bag.read_messages())


def test_bags_written_without_ros_equal_those_with_ros(bare, bags, tmp_path):
    if len(bags) > 1:
        run(bare / "identify", "import", *exported(), "-o", tmp_path / "real.bag")
        pairs = zip(contents(tmp_path / "real.bag"), contents(bags[1]))
        assert not [pair for pair in pairs if pair[0] != pair[1]][:1]
    options = ("--model", MODEL, "--input", "prbs", "--duration", 8, "--seed", 3)
    run(bare / "identify", "simulate", *options, "-o", tmp_path / "simulated.bag")
    found, wanted = contents(tmp_path / "simulated.bag"), contents(bags[0])
    assert len(found) == len(wanted)
    assert all(a[0] == b[0] and a[2] == b[2] for a, b in zip(found, wanted))
    # Commands do not depend on the core, whose rounding depends on the processor.
    commands = [(a, b) for a, b in zip(found, wanted) if a.topic == "/controls"]
    assert commands and all(a == b for a, b in commands)


def test_controllers_run(bare):
    options = ("--controller", "ModelPredictive", "--reference", "circle", "--end-time", 3, "--json")
    found = json.loads(run(bare / "track", "--model", MODEL.stem, *options))  # one of the wheel
    wanted = json.loads(program("track", "--model", MODEL, *options).stdout)
    assert found["final"] == pytest.approx(wanted["final"], rel=1e-3)
    assert "--evaluations" in run(bare / "tune", "--help")


def test_models_of_the_wheel_are_loaded_by_name(bare):
    code = "import ground; print(ground.Model.load('tiny_whoover').path); ground.Model.load('free_flyer')"
    path = run(bare / "python", "-c", code).strip()
    assert path == str(bare.parent / "share" / "ground" / "cfg" / "hovercraft" / MODEL.name)


def test_the_whole_wheel_configures_without_catkin(tmp_path):
    """The build of the core does not need any variable that catkin sets."""
    build = tmp_path / "build"
    options = ["-DSKBUILD_PROJECT_VERSION=1.0", "-DSKBUILD_DATA_DIR=%s" % tmp_path]
    source = ROOT / "src" / "ground" / "python"
    run("cmake", "-S", source, "-B", build, "-G", "Ninja", *options)
    names = run("cmake", "--build", build, "--target", "help")
    libraries = ("model", "estimation", "safety", "control", "simulation", "identification", "core")
    assert all("ground_%s: phony" % library in names for library in libraries)
    assert "ground_link" not in names and "ground_nodelets" not in names
