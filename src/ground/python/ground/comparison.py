"""Model against measurement: the error numbers of DESIGN 8 and the thesis."""
import numpy as np

from ground import _core, repair
from ground.errors import IdentifyError

WINDOW = 1.5  # of the error [s]
THESIS_SPAN = 4.0  # of the thesis's objective [s]
CHANNELS = ("u", "v", "r")


def problem(runs, length):
    """Windows of `length` seconds over all runs; raises IdentifyError when none fits."""
    windows = []
    for index, run in enumerate(runs):
        found = _core.cut_windows(run, index, run.times[0], run.times[-1], length, repair.MAX_GAP)
        if not found:
            raise IdentifyError(
                "%s: too short for a window of %.1f s without a gap" % (run.name, length)
            )
        windows += found
    try:
        return _core.SimulationError(runs, windows), windows
    except ValueError as error:
        raise IdentifyError(str(error))


def error(runs, model):
    """Mean of |e_u|/s_u + |e_v|/s_v + |e_r|/s_r over windows of 1.5 s."""
    return problem(runs, WINDOW)[0].simulate(model)["objective"]


def thesis_objective(run, model):
    """(3.4) over one window, the first 4 s of the run; None when the run is shorter."""
    start = run.times[0]
    # One simulation, also through a gap: only the measurement is missing there.
    windows = _core.cut_windows(run, 0, start, start + THESIS_SPAN, THESIS_SPAN, THESIS_SPAN)
    if not windows or run.times[windows[0].last] - start < 0.9 * THESIS_SPAN:
        return None
    problem = _core.SimulationError([run], windows[:1])
    return problem.simulate(model, _core.Objective.thesis)["objective"]


def mean_thesis_objective(runs, model):
    """The mean over runs that are long enough; None when none is."""
    values = [thesis_objective(run, model) for run in runs]
    values = [v for v in values if v is not None]
    return float(np.mean(values)) if values else None


def compare_run(run, model):
    """Numbers and simulated windows of one run with one model."""
    windowed, windows = problem([run], WINDOW)
    simulation = windowed.simulate(model)
    times, nu = np.array(run.times), np.array(run.nu)
    pieces = []
    for window, eta, simulated in zip(windows, simulation["eta"], simulation["nu"]):
        span = slice(window.first, window.last + 1)
        pieces.append({"times": times[span], "measured": nu[span], "nu": simulated, "eta": eta})
    measured = np.vstack([p["measured"] for p in pieces])
    residual = measured - np.vstack([p["nu"] for p in pieces])
    spread = np.linalg.norm(measured - measured.mean(axis=0), axis=0)
    numbers = {
        "error": simulation["objective"],
        "thesis_objective": thesis_objective(run, model),
        "fit_percent": dict(
            zip(CHANNELS, map(float, 100 * (1 - np.linalg.norm(residual, axis=0) / spread)))
        ),
        "rms": dict(zip(CHANNELS, map(float, np.sqrt(np.mean(residual**2, axis=0))))),
    }
    return numbers, pieces
