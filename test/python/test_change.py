"""Each change of the page "Where do I change what" works in a copy, and concerns two files at most."""

import glob
import os
import pathlib
import re
import shutil
import subprocess
import sys

import pytest

from conftest import MODEL, ROOT, slow
from ground import _core

DEVEL = pathlib.Path(_core.__file__).parents[4]
PAGE = ROOT / "docs" / "howto" / "change.md"
RUN = "import sys; from ground import cli; sys.exit(cli.main(sys.argv[1:]))"
FAST = """
#include <cstdio>
#include "ground/safety/controller_lifecycle.h"
using namespace ground;
struct Still : Pilot {
  Inputs update(double, double, const RigidState<double>&, double lift) override { return {0, 0, lift}; }
};
int main() {
  Still pilot;
  ControllerLifecycle life(pilot, [](const Inputs&) {}, [] {});
  LifecycleParams params;
  params.require_armed = false;
  life.setParams(params);
  life.start({0, 0});
  MeasuredState seen;
  seen.valid = true;
  seen.state.eta.setZero();
  seen.state.nu = {6, 0, 0};
  for (double t = 0; t < 1; t += 0.01) {
    seen.stamp = t;
    life.state({t, t}, seen);
  }
  std::puts(life.reason().c_str());
}
"""


def changes():
    """The differences that the page shows, by heading."""
    sections = re.split("^## (.*)\n", PAGE.read_text(), flags=re.M)[1:]
    return {
        name: "\n".join(re.findall("```diff\n(.*?)```", text, re.S))
        for name, text in zip(*[iter(sections)] * 2)
    }


@pytest.fixture
def changed(tmp_path):
    """Makes a change in a copy of the sources, and returns a function that runs the copy's command line."""

    def change(name):
        difference = changes()[name]
        files = set(re.findall(r"^\+\+\+ b/(.*)$", difference, re.M))
        assert 1 <= len(files) <= 2
        copy = tmp_path / "src" / "ground"
        shutil.copytree(str(ROOT / "src" / "ground"), str(copy), ignore=shutil.ignore_patterns("__pycache__"))
        apply = ["git", "apply", "-"]
        done = subprocess.run(
            apply, cwd=str(tmp_path), input=difference, stderr=subprocess.PIPE, universal_newlines=True
        )
        assert done.returncode == 0, done.stderr
        for core in glob.glob(os.path.join(os.path.dirname(_core.__file__), "_core*.so")):
            os.symlink(core, str(copy / "python" / "ground" / os.path.basename(core)))
        return copy

    return change


@pytest.fixture
def identify(tmp_path):
    def run(copy, *words):
        paths = [str(copy / "python"), os.environ.get("PYTHONPATH", "")]
        found = subprocess.run(
            [sys.executable, "-c", RUN, *map(str, words)],
            env=dict(os.environ, PYTHONPATH=os.pathsep.join(paths)),
            cwd=str(tmp_path),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            universal_newlines=True,
        )
        assert found.returncode == 0, found.stderr
        return found.stdout

    return run


def flown(identify, copy, seconds=3, rate=100):
    """A bag of a simulated run."""
    words = ["simulate", "--model", MODEL, "--input", "prbs", "--duration", seconds, "--rate", rate]
    path = copy / ("%d.bag" % seconds)
    identify(copy, *words, "--seed", seconds, "-o", path)
    return path


def test_a_verb(changed, identify):
    copy = changed("A verb")
    bags = [flown(identify, copy, seconds) for seconds in (3, 5)]
    assert identify(copy, "longest", *bags) == "the longest is 5\n"


def test_a_sentence(changed, identify):
    copy = changed("A sentence")
    heavier = copy / "heavier.yaml"
    text = re.sub(r"^( *m: *)[\d.]+", r"\g<1>0.08", MODEL.read_text(), flags=re.M)
    heavier.write_text(text)
    words = ["compare", flown(identify, copy, 10), "--model", MODEL, "--model", heavier, "-o", copy / "out"]
    assert "best of all" in identify(copy, *words)


def test_a_reader(changed, identify, tmp_path):
    copy = changed("A reader")
    rows = [
        '{"t": %g, "x": %g, "y": 0, "psi": 0, "left": 1, "right": 1}' % (t / 100, t / 1e4) for t in range(500)
    ]
    (tmp_path / "run.jsonl").write_text("\n".join(rows))
    identify(copy, "info", "run.jsonl", "--write-mapping", "draft.yaml")
    assert "psi" in (tmp_path / "draft.yaml").read_text()


def test_what_is_odd_in_a_recording(changed, identify):
    copy = changed("What is odd in a recording")
    assert "poses come at 10 Hz" in identify(copy, "info", flown(identify, copy, rate=10))


def compiled(library, source, *options):
    """Compiles a source in a copy as this workspace compiles a library, without optimisation."""
    commands = subprocess.check_output(
        ["ninja", "-C", str(DEVEL.parent), "-t", "commands", "ground_" + library], universal_newlines=True
    )
    line = next(one for one in commands.splitlines() if "ground_%s.dir" % library in one and " -c " in one)
    flags = re.findall(r"-I\S+|-isystem \S+|-std=\S+", line)
    own = str(ROOT / "src" / "ground")
    copied = str(next(parent for parent in source.parents if parent.name == "ground"))
    words = " ".join(flags).replace(own + "/include", copied + "/include").split()
    command = ["g++", "-O0", *words, str(source), *map(str, options)]
    found = subprocess.run(command, stderr=subprocess.PIPE, universal_newlines=True)
    assert found.returncode == 0, found.stderr


@slow
def test_a_controller(changed):
    copy = changed("A controller")
    compiled("nodelets", copy / "src" / "nodelets" / "pulse.cpp", "-fsyntax-only")
    assert 'type="ground::Pulse"' in (copy / "nodelet_plugins.xml").read_text()


@slow
def test_when_a_controller_stops(changed, tmp_path):
    copy = changed("When a controller stops")
    main = copy / "main.cpp"
    main.write_text(FAST)
    libraries = ["-lground_control", "-lground_safety", "-lground_estimation", "-lground_model"]
    where = ["-L", DEVEL / "lib", "-Wl,-rpath,%s" % (DEVEL / "lib")]
    own = copy / "src" / "safety" / "controller_lifecycle.cpp"
    compiled("safety", main, own, *where, *libraries, "-o", tmp_path / "fast")
    assert "faster than 5 m/s" in subprocess.check_output([str(tmp_path / "fast")], universal_newlines=True)


def test_every_change_is_tried():
    names = [name[5:].replace("_", " ").capitalize() for name in globals() if name.startswith("test_")]
    assert set(changes()) == set(names) - {"Every change is tried"}
