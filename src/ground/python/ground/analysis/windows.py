"""Windows: stretches of runs that are simulated, each from its own initial state, and their error."""

from typing import Dict, List, Optional, Sequence

from ground import _core
from ground.poses.time_scales import WINDOW
from ground.support.errors import GroundError, core_errors


def length(runs: Sequence[_core.RunData]) -> float:
    """Length of the windows over which the error of runs (_core.RunData) is taken [s]."""
    return float(runs[0].scales.window)


def time_scale(runs: Sequence[_core.RunData]) -> float:
    """Time scale of the craft of runs (_core.RunData), two thirds of a window [s]: 1 s for a palm-sized
    hovercraft."""
    return length(runs) / WINDOW


def cut(runs: Sequence[_core.RunData], seconds: Optional[float] = None) -> List[_core.Window]:
    """Windows of some seconds (default: length(runs)) over all runs; GroundError when one has none."""
    windows, seconds = [], seconds or length(runs)
    for index, run in enumerate(runs):
        found = cut_part(run, index, run.times[0], run.times[-1], seconds)
        if not found:
            raise GroundError(
                "%s: too short for a window of %.3g s without a gap; choose a shorter window"
                % (run.name, seconds)
            )
        windows += found
    return windows


def cut_part(
    run: _core.RunData, index: int, start: float, end: float, seconds: Optional[float] = None
) -> List[_core.Window]:
    """Windows of some seconds (default: length([run])) of a run from `start` to `end` [s]; index: the run's
    number in the problem."""
    return _core.cut_windows(run, index, start, end, seconds or length([run]))


def spread(windows: List[_core.Window], most: float) -> List[_core.Window]:
    """At most about `most` windows, spread evenly over each run; every run keeps one."""
    if len(windows) <= most:
        return windows
    of_run: Dict[int, List[_core.Window]] = {}
    for window in windows:
        of_run.setdefault(window.run, []).append(window)
    chosen = []
    for found in of_run.values():
        count = max(1, round(most * len(found) / len(windows)))
        chosen += [found[i * len(found) // count] for i in range(count)]
    return chosen


def problem(
    runs: Sequence[_core.RunData],
    windows: Sequence[_core.Window],
    target: _core.Target = _core.Target.velocities,
) -> _core.SimulationError:
    """The _core.SimulationError over windows; GroundError when the runs do not allow it."""
    with core_errors():
        return _core.SimulationError(runs, windows, target)


def error(
    runs: Sequence[_core.RunData], model: _core.Model, windows: Optional[Sequence[_core.Window]] = None
) -> float:
    """Mean of |e_u|/s_u + |e_v|/s_v + |e_r|/s_r, over windows of all runs if none are given.

    Initial velocities are the best for the model. Raises GroundError when the
    model cannot be simulated.
    """
    chosen = problem(runs, windows or cut(runs))
    with core_errors():
        return float(chosen.simulate(model)["objective"])
