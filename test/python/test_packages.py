"""The packages: dependencies, licence, optional libraries, and names of targets."""

import re
import xml.etree.ElementTree

from conftest import ROOT
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


def test_the_version_is_that_of_the_newest_release_in_the_change_log():
    versions = {xml.etree.ElementTree.parse(str(path)).getroot().findtext("version") for path in PACKAGES}
    newest, *older = re.findall(r"^## \[(.+)\]( - \d{4}-\d\d-\d\d)?$", CHANGES.read_text(), re.M)
    assert newest == ("Unreleased", "") and all(date for _, date in older)
    assert versions == {older[0][0]} == {_core.version}


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
