"""Work on all cores: results in order, errors passed on, and what is said when a process is killed."""

import os
import signal
import subprocess
import sys

import pytest

from ground.support import workers
from ground.support.errors import GroundError

SCRIPT = """
import multiprocessing
multiprocessing.set_start_method("spawn")  # as on macOS and Windows
from ground.support.workers import Workers
team = Workers(processes=True)
print(list(team.map(abs, [-1, 2])))
"""


def square(x):
    if x < 0:
        os.kill(os.getpid(), signal.SIGKILL)
    if x == 13:
        raise ValueError("no square of 13")
    return x * x


@pytest.mark.parametrize("processes", [False, True])
def test_results_come_in_order_and_errors_are_passed_on(processes):
    team = workers.Workers(processes)
    assert list(team.map(square, range(10))) == [x * x for x in range(10)]
    with pytest.raises(ValueError, match="no square of 13"):
        list(team.map(square, [13]))


def test_a_killed_process_is_told():
    team = workers.Workers(processes=True)
    with pytest.raises(GroundError, match="ended from outside"):
        list(team.map(square, [-1]))


def test_a_script_that_is_not_guarded_runs_where_processes_are_not_forked(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    assert subprocess.check_output([sys.executable, str(script)], universal_newlines=True) == "[1, 2]\n"
