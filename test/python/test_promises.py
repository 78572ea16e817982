"""The promises of test/requirements.toml: each has a test, which fails when its rule is taken out of the
product, and each row of the fault table has a promise and a measured worst case."""

import collections
import re
import subprocess
import sys

import pytest

from conftest import ROOT, slow

sys.path.insert(0, str(ROOT / "test"))
import requirements

PROMISES = requirements.load()["promise"]
FAULTS = requirements.load()["fault"]


def all_tests():
    """Names of tests: of gtest programs by program, and of files of test/python."""
    found = collections.defaultdict(set)
    for path in (ROOT / "test" / "unit").glob("*/*.cpp"):
        for group, name in re.findall(r"^(?:TYPED_)?TEST(?:_F|_P)?\((\w+), (\w+)\)", path.read_text(), re.M):
            found["ground_%s_test" % path.parent.name].add("%s.%s" % (group, name))
    for path in (ROOT / "test" / "python").glob("test_*.py"):
        found[path.name] = set(re.findall(r"^def (test_\w+)", path.read_text(), re.M))
    return found


def injected():
    """Names of all faults that the fault benches inject, as they stand in their sources."""
    files = ["rostest/faults_test.py", "rostest/faults_mocap_test.py", "rostest/room_axes_test.py"]
    files += ["python/test_faults.py", "python/test_starved.py"]
    return "\n".join((ROOT / "test" / name).read_text() for name in files)


def test_numbers_and_names_are_unique():
    for what in ("number", "name"):
        values = [promise[what] for promise in PROMISES]
        assert len(values) == len(set(values))


@pytest.mark.parametrize("promise", PROMISES, ids=lambda promise: promise["name"])
def test_a_promise_has_a_test_and_a_rule(promise):
    program, tests = promise["test"]
    pattern = re.escape(tests).replace(r"\*", ".*")
    assert any(re.fullmatch(pattern, name) for name in all_tests()[program]), "%s has no %s" % (
        program,
        tests,
    )
    assert ("{limit}" in promise["sentence"]) == ("limit" in promise) == ("unit" in promise)
    requirements.changed(promise)  # its line is there once


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault["name"])
def test_a_fault_has_promises_and_a_worst_case(fault):
    numbers = {promise["number"] for promise in PROMISES}
    assert fault["promises"] and set(fault["promises"]) <= numbers
    measured, sources = requirements.measured()["faults"], injected()
    for name in fault["measured"]:
        assert name in measured, "make bench-faults measures it"
        assert name.replace("mocap: ", "") in sources, "no test injects it"


def test_tests_read_the_limits():
    sources = [*(ROOT / "test").glob("rostest/*.py"), *(ROOT / "test").glob("python/*.py")]
    read = set(
        re.findall(r'requirements\.limit\("([\w-]+)"\)', "".join(path.read_text() for path in sources))
    )
    flight = (ROOT / "test/unit/search/flight_world.cpp").read_text()
    for promise in PROMISES:
        constant = "k" + "".join(word.capitalize() for word in promise["name"].split("-"))
        assert "limit" not in promise or promise["name"] in read or constant in flight, promise["name"]


def test_every_measured_fault_is_in_the_table():
    shown = {name for fault in FAULTS for name in fault["measured"]}
    assert set(requirements.measured()["faults"]) == shown


@pytest.mark.parametrize("name", ["thrust-after-state", "thrust-after-end"])
def test_no_worst_case_is_beyond_its_limit(name):
    (promise,) = [one for one in PROMISES if one["name"] == name]
    concerned = [fault for fault in FAULTS if promise["number"] in fault["promises"]]
    worst = [
        requirements.measured()["faults"][row]["worst"] for fault in concerned for row in fault["measured"]
    ]
    late = [float(ms) for text in worst for ms in re.findall(r"thrust until +(\d+) ms", text)]
    assert late and max(late) < 1e3 * promise["limit"]


@slow
def test_tests_fail_without_the_rule():
    """Those of the search over all sequences of events; `make promises` tries all."""
    program = str(ROOT / "build" / "devel" / "lib" / "ground" / "ground_search_test")
    if subprocess.run(["test", "-x", program]).returncode:
        pytest.skip("ground_search_test is not built: cd build && ninja ground_search_test")
    command = [str(ROOT / "test" / "mutation" / "promises.py"), "--program", "ground_search_test"]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert done.returncode == 0, done.stdout
