"""Commands that run beside timed tests, at a low priority (.ci/aside)."""

import os
import pathlib
import signal
import subprocess

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
        groups.append(subprocess.check_output([ASIDE, "cat", str(AUTOGROUP)], universal_newlines=True))
    assert [group.split()[-1] for group in groups[1:]] == ["10", "10"]
    assert len({group.split()[0] for group in groups}) == 3


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
