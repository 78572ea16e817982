"""The packages: dependencies, licence, optional libraries, and names of targets."""

import re
import subprocess
import xml.etree.ElementTree

import pytest

from conftest import ROOT, slow
from ground import _core

PACKAGES = [ROOT / "src" / name / "package.xml" for name in ("ground", "ground_msgs")]
CHANGES = ROOT / "CHANGELOG.md"


def dependencies(end="depend"):
    found = set()
    for path in PACKAGES:
        for element in xml.etree.ElementTree.parse(str(path)).getroot():
            if element.tag.endswith(end):
                found.add(element.text)
    return found


def _public_links():
    """Libraries of the workspace that each library gives to its users, from its CMake files."""
    files = [ROOT / "src/ground" / name for name in ("CMakeLists.txt", "cmake/core.cmake")]
    text = "".join(path.read_text() for path in files)
    direct = {}
    for library, links in re.findall(r"target_link_libraries\(ground_(\w+)([^)]*)\)", text):
        public = links.split("PUBLIC")[-1].split("PRIVATE")[0] if "PUBLIC" in links else ""
        direct[library] = set(re.findall(r"\bground_(\w+)", public))

    def closed(library):
        return {library}.union(*(closed(other) for other in direct.get(library, ())))

    return {library: closed(library) for library in direct}


def test_a_library_gives_its_users_all_that_its_headers_need():
    """Who links one library of the package finds every function that its headers use."""
    folder, given = ROOT / "src/ground/include/ground", _public_links()
    assert len(given) >= 6
    for header in sorted(folder.glob("*/*.h")):
        needed = set(re.findall(r'#include "ground/(\w+)/', header.read_text())) - {"parameters"}
        missing = needed - given.get(header.parent.name, {header.parent.name})
        assert not missing, "%s needs %s" % (header.relative_to(folder), ", ".join(sorted(missing)))


def test_no_file_includes_a_private_header_of_another_library():
    files = [path for path in (ROOT / "src/ground").rglob("*") if path.suffix in (".h", ".cpp")]
    assert len(files) > 100
    assert not [path for path in files if re.search(r'#include "[^"]*\.\./', path.read_text())]


def test_core_nodelets_and_bindings_are_compiled_for_one_processor():
    """Classes that depend on the processor (Derivatives) are the same in all of them."""
    path = ROOT / "build" / "build.ninja"
    if not path.exists():
        pytest.skip("there is no build by Ninja in build/")
    compiled = r"(?ms)^build src/ground/CMakeFiles/(ground_\w+)\.dir/\S+: CXX_COMPILER.*?^  FLAGS = (.*?)$"
    processors = {}
    for target, flags in re.findall(compiled, path.read_text()):
        if not re.search("_test$|_bench_|_fuzz_|throwing", target):
            processors.setdefault(tuple(re.findall(r"-march=\S+", flags)), set()).add(target)
    assert len(processors) == 1, processors


def test_the_version_is_that_of_the_newest_release_in_the_change_log():
    versions = {xml.etree.ElementTree.parse(str(path)).getroot().findtext("version") for path in PACKAGES}
    newest, *older = re.findall(r"^## \[(.+)\]( - \d{4}-\d\d-\d\d)?$", CHANGES.read_text(), re.M)
    assert newest == ("Unreleased", "") and all(date for _, date in older)
    assert versions == {older[0][0]} == {_core.version}


@slow
def test_a_build_does_not_need_the_benchmark_library(tmp_path):
    configure = ["cmake", "-S", str(ROOT), "-B", str(tmp_path), "-DCATKIN_ENABLE_TESTING=OFF"]
    configure += ["-DCMAKE_DISABLE_FIND_PACKAGE_benchmark=ON"]
    result = run(*configure)
    assert result.returncode == 0, result.stdout
    result = run("cmake", "--build", str(tmp_path), "--target", "ground_benchmarks")
    assert result.returncode != 0
    assert "install libbenchmark-dev" in result.stdout


WORKSPACE = """
cmake_minimum_required(VERSION 3.16)
project(another_workspace LANGUAGES CXX)
find_package(catkin REQUIRED)
catkin_workspace()
"""
NEIGHBOUR = """
cmake_minimum_required(VERSION 3.16)
project(neighbour)
find_package(catkin REQUIRED)
catkin_package()
foreach(name %s)
  add_custom_target(${name})
endforeach()
"""
NEIGHBOUR_XML = """
<package format="2">
  <name>neighbour</name> <version>0.0.0</version> <description>none</description>
  <maintainer email="nobody@example.org">nobody</maintainer> <license>MIT</license>
  <buildtool_depend>catkin</buildtool_depend>
</package>
"""


@slow
def test_targets_do_not_collide_in_another_workspace(tmp_path):
    """Configures beside a package whose targets have the names of folders and files of this one."""
    places = ["src/ground/src/*", "test/*"]
    places += ["test/%s/*.cpp" % folder for folder in ("unit", "bench", "fuzz")]
    names = {path.stem for place in places for path in ROOT.glob(place)} - {"test"}
    names |= {"unit_tests", "benchmarks", "fuzzers", "core", "python_tests"}
    neighbour = tmp_path / "src" / "neighbour"
    neighbour.mkdir(parents=True)
    (tmp_path / "src" / "CMakeLists.txt").write_text(WORKSPACE)
    (tmp_path / "src" / "ground_workspace").symlink_to(ROOT)
    (neighbour / "CMakeLists.txt").write_text(NEIGHBOUR % " ".join(sorted(names)))
    (neighbour / "package.xml").write_text(NEIGHBOUR_XML)
    result = run("cmake", "-S", str(tmp_path / "src"), "-B", str(tmp_path / "build"))
    assert result.returncode == 0, result.stdout
    for package in ("ground", "ground_msgs", "neighbour"):
        assert "processing catkin package: '%s'" % package in result.stdout
    assert "ground_example" not in result.stdout


def run(*command):
    return subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True)


def test_the_wheel_and_the_package_require_only_what_they_import():
    sources = [path.read_text() for path in (ROOT / "src" / "ground").rglob("*") if is_python(path)]
    imported = set(re.findall(r"^\s*(?:import|from) (\w+)", "\n".join(sources), re.M))
    project = (ROOT / "pyproject.toml").read_text()
    wheel = re.findall(r'^  "([\w-]+)"', project.partition("\ndependencies = [")[2].partition("]")[0], re.M)
    packages = [key[len("python3-") :] for key in dependencies("exec_depend") if key.startswith("python3-")]
    modules = {"protobuf": "google", "pyyaml": "yaml"}
    assert len(wheel) > 5 and len(packages) > 5
    for name in (one.lower() for one in [*wheel, *packages]):
        assert modules.get(name, name) in {one.lower() for one in imported}, name


def is_python(path):
    return path.is_file() and (path.suffix == ".py" or path.parent.name == "scripts")
