"""Work on all cores: results in order, errors passed on, and what is said when a process is killed."""

import os
import signal

import pytest

from ground.support import workers
from ground.support.errors import GroundError


def square(x):
    if x < 0:
        os.kill(os.getpid(), signal.SIGKILL)
    if x == 13:
        raise ValueError("no square of 13")
    return x * x


@pytest.mark.parametrize("processes", [False, True])
def test_results_come_in_order_and_errors_are_passed_on(processes):
    with workers.Workers(processes) as team:
        assert list(team.map(square, range(10))) == [x * x for x in range(10)]
        with pytest.raises(ValueError, match="no square of 13"):
            list(team.map(square, [13]))


def test_a_killed_process_is_told():
    with workers.Workers(processes=True) as team:
        with pytest.raises(GroundError, match="ended from outside"):
            list(team.map(square, [-1]))
