"""The package as others use it: builds and runs test/downstream/ground_example."""

import functools
import os
import pathlib
import re
import shutil
import subprocess

import pytest

from conftest import MODEL, ROOT, free_port, slow

pytestmark = slow
EXAMPLE = ROOT / "test" / "downstream" / "ground_example"
ASIDE = ROOT / ".ci" / "aside"  # at a low priority
EFFECTS = "libground_example_effects.so"
VARIABLES = """
cmake_minimum_required(VERSION 3.16)
project(variables)
set(CMAKE_CXX_STANDARD 17)
find_package(catkin REQUIRED COMPONENTS ground)
include_directories(${catkin_INCLUDE_DIRS})
add_executable(variables main.cpp)
target_link_libraries(variables ${catkin_LIBRARIES})
"""
MAIN = """
#include <ground_msgs/State.h>
#include "ground/model/effect_registry.h"
int main() { return ground::effectNames().empty(); }
"""


def devel_space():
    """The devel space of ground among the sourced workspaces."""
    for prefix in os.environ["CMAKE_PREFIX_PATH"].split(":"):
        if pathlib.Path(prefix, "share", "ground", "cmake").is_dir():
            return pathlib.Path(prefix)
    raise AssertionError("ground is not in CMAKE_PREFIX_PATH: source devel/setup.bash first")


@functools.lru_cache(maxsize=None)
def install_space():
    build = devel_space().parent
    cache = build / "CMakeCache.txt"
    if not cache.is_file():
        pytest.skip("the workspace was not built as one CMake project")
    prefix = pathlib.Path(re.search("^CMAKE_INSTALL_PREFIX:.*=(.*)$", cache.read_text(), re.M).group(1))
    assert build in prefix.parents, "installs outside the build folder: remove %s" % cache
    check(ASIDE, "cmake", "--install", build)
    return prefix


def run(*command, space=None, **variables):
    """Runs a command; with `space`, in a clean shell that sources only this space."""
    if space:
        shell = ["env", "-i", "HOME=" + os.environ["HOME"], "PATH=/usr/bin:/bin"]
        shell += ["%s=%s" % item for item in variables.items()]
        shell += ["bash", "-c", 'source "$0"/setup.bash && exec "$@"', space]
        command = (*shell, *command)
    return subprocess.run(
        [str(part) for part in command],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=300,
    )


def check(*command, **options):
    result = run(*command, **options)
    assert result.returncode == 0, result.stdout
    return result.stdout


def build(source, folder, space):
    check(ASIDE, "cmake", "-S", source, "-B", folder, space=space)
    check(ASIDE, "cmake", "--build", folder, space=space)


in_both_spaces = pytest.mark.parametrize("space", [devel_space, install_space])


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """Builds the example on top of ground's devel or install space; returns its devel space."""

    @functools.lru_cache(maxsize=None)
    def built(space):
        folder = tmp_path_factory.mktemp("example")
        build(EXAMPLE, folder, space())
        return folder / "devel"

    return built


@pytest.fixture
def model(tmp_path):
    """A model file with the effect of the example."""
    path = tmp_path / "spinning.yaml"
    effect = "effects: [{name: thrust_yaw_loss, c: 0.02}]"
    path.write_text(re.sub("^effects: .*", effect, MODEL.read_text(), flags=re.M))
    return path


def simulate(model, space, **variables):
    arguments = ["--model", model, "--input", "prbs", "--duration", 2, "--force"]
    command = ["rosrun", "ground", "identify", "simulate", *arguments]
    return run(*command, "-o", model.with_suffix(".bag"), space=space, **variables)


def test_controller_drives_a_simulated_craft_with_the_effect(example, model):
    arguments = ["truth:=%s" % model, "port:=%d" % free_port()]
    test = EXAMPLE / "test" / "go_to.test"
    output = check("rostest", test, *arguments, space=example(install_space))
    assert "SUCCESS" in output, output


@in_both_spaces
def test_tool_takes_the_effect(example, model, space):
    simulated = simulate(model, example(space))
    assert simulated.returncode == 0, simulated.stdout


@in_both_spaces
def test_catkin_variables_suffice(space, tmp_path):
    (tmp_path / "CMakeLists.txt").write_text(VARIABLES)
    (tmp_path / "main.cpp").write_text(MAIN)
    build(tmp_path, tmp_path / "build", space())
    check(tmp_path / "build" / "variables", space=space())


def test_effect_libraries_that_cannot_be_used(example, model):
    """The effect's library is not listed, is missing, or is listed twice: one line each."""
    known = simulate(model, devel_space())
    assert "unknown effect 'thrust_yaw_loss'" in known.stdout
    assert "GROUND_EFFECT_LIBRARIES" in known.stdout
    missing = simulate(model, example(devel_space), GROUND_EFFECT_LIBRARIES="libnowhere.so")
    assert "GROUND_EFFECT_LIBRARIES: libnowhere.so: cannot open" in missing.stdout
    copy = shutil.copy(str(example(devel_space) / "lib" / EFFECTS), str(model.parent / "copy.so"))
    twice = simulate(model, example(devel_space), GROUND_EFFECT_LIBRARIES=copy)
    assert "two effects are named thrust_yaw_loss" in twice.stdout
    for result in (known, missing, twice):
        assert result.returncode == 1
        assert len(result.stdout.splitlines()) == 1, result.stdout


def compiled(*options):
    eigen = check("pkg-config", "--cflags-only-I", "eigen3").split()
    include = ["-I", ROOT / "src" / "ground" / "include", *eigen]
    source = ROOT / "test" / "downstream" / "wrong_hooks.cpp"
    return run("g++", "-std=c++17", "-fsyntax-only", *include, *options, source)


def test_hook_with_a_wrong_signature_does_not_compile():
    wrong = compiled()
    assert wrong.returncode != 0
    refused = re.findall("error: static assertion failed: the effect's ([a-z]+)", wrong.stdout)
    assert set(refused) == {"wrench", "thrust", "air", "inertia", "measure", "delay"}
    assert "error: static assertion failed: the effect acts nowhere" in wrong.stdout
    assert len(re.findall(" error: ", wrong.stdout)) == len(refused) + 1, wrong.stdout
    assert compiled("-DRIGHT").returncode == 0
