"""Commands that run beside timed tests, at a low priority (.ci/aside)."""

import os
import pathlib
import signal
import subprocess
import sys

import pytest
from conftest import ROOT, wait_for

ASIDE = str(ROOT / ".ci" / "aside")
AUTOGROUP = pathlib.Path("/proc/self/autogroup")


def test_the_command_and_its_session_have_a_low_priority():
    shown = subprocess.check_output([ASIDE, "cat", "/proc/self/stat"], universal_newlines=True)
    assert int(shown.rpartition(")")[2].split()[16]) >= 10  # niceness, the 19th field
    if not os.access(str(AUTOGROUP), os.W_OK):
        pytest.skip("the kernel does not divide the processors between sessions")
    groups = [AUTOGROUP.read_text()]
    for _ in range(2):
        groups.append(
            subprocess.check_output([ASIDE, "cat", str(AUTOGROUP)], universal_newlines=True)
        )
    assert [group.split()[-1] for group in groups[1:]] == ["10", "10"]
    assert len({group.split()[0] for group in groups}) == 3


def test_arguments_and_exit_status_are_those_of_the_command():
    result = subprocess.run(
        [ASIDE, "bash", "-c", 'echo "$2"; exit 7', "words", "one", "two  words"],
        stdout=subprocess.PIPE,
        universal_newlines=True,
    )
    assert (result.returncode, result.stdout) == (7, "two  words\n")


def test_the_command_can_be_interrupted():
    script = "import signal; print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)"
    command = [ASIDE, sys.executable, "-c", script]
    assert subprocess.check_output(command, universal_newlines=True) == "True\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_nothing_is_left_when_it_is_interrupted(number):
    runner = subprocess.Popen(
        [ASIDE, "bash", "-c", "sleep 600 & echo $!; wait"],
        stdout=subprocess.PIPE,
        universal_newlines=True,
    )
    with runner:
        child = pathlib.Path("/proc", runner.stdout.readline().strip())
        assert child.exists()
        runner.send_signal(number)
        runner.wait(20)
    wait_for(lambda: not child.exists(), 20, "the end of the command")
