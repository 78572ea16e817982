"""An overloaded computer while a craft tracks, in a file of its own because it disturbs timed tests."""

import os
import signal
import subprocess
import sys
import time

from test_faults import LIMIT, report, stack  # noqa: F401, a fixture


def test_a_starved_computer_still_stops_it(stack):  # noqa: F811
    """Four busy processes per core run when the states stop coming."""
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(4 * os.cpu_count())]
    try:
        time.sleep(2)
        late = stack.thrust_after(stack.kill("mocap_state", signal.SIGSTOP), 2)
        stack.kill("mocap_state", signal.SIGCONT)
        again = stack.thrust_after(time.time(), 1)
    finally:
        for process in busy:
            process.kill()
            process.wait()
    report("CPU starved, states stop", "stops", "thrust until %3.0f ms after it" % (1e3 * late))
    assert late < LIMIT
    assert again == 0
