"""How well a fit predicts what it has not seen: runs, and blocks of time, left out one by one."""
import numpy as np

from ground.recordings import windows

BLOCK = 6.0  # length of blocks of time [s]


def leave_one_run_out(runs, fit, length=windows.WINDOW):
    """The fit without each run and its error on that run: [(fit's result, error)], one a run.

    `fit(windows)` fits to windows of `runs` (_core.RunData) of `length` seconds.
    """
    to_fit, to_test = windows.cut(runs, length), windows.cut(runs)
    parts = [
        ([w for w in to_fit if w.run == i], [w for w in to_test if w.run == i])
        for i in range(len(runs))
    ]
    return _leave_one_out(runs, parts, fit)


def leave_one_block_out(runs, models, fit, block=BLOCK, length=windows.WINDOW):
    """Errors on blocks of time: of models as they are, and of fits to all the other blocks.

    Returns {"models": one error a model, "heldout": error}, over the same windows; None when there
    are less than two blocks to fit to. `fit` and `length` as in leave_one_run_out.
    """
    parts = []
    for i, run in enumerate(runs):
        start, end = run.times[0], run.times[-1]
        edges = np.linspace(start, end, max(1, int(round((end - start) / block))) + 1)
        for a, b in zip(edges[:-1], edges[1:]):
            to_test = windows.cut_part(run, i, a, b)
            if to_test:
                parts.append((windows.cut_part(run, i, a, b, length), to_test))
    if sum(bool(to_fit) for to_fit, _ in parts) < 2:
        return None
    weights = [sum(w.last - w.first + 1 for w in to_test) for _, to_test in parts]
    errors = [error for _, error in _leave_one_out(runs, parts, fit)]
    every = [w for _, to_test in parts for w in to_test]
    return {
        "models": [windows.error(runs, model, every) for model in models],
        "heldout": float(np.average(errors, weights=weights)),
    }


def _leave_one_out(runs, parts, fit):
    """`parts`: windows to fit to and windows to test on, of each part."""
    results = []
    for at, (_, out) in enumerate(parts):
        result = fit([w for i, (rest, _) in enumerate(parts) if i != at for w in rest])
        results.append((result, windows.error(runs, result["model"], out)))
    return results


def disagreements(fitted, others, most=3.0):
    """Parameters whose estimate from one run and from the others differ by `most` deviations."""
    names = []
    for a, b in zip(fitted["parameters"], others["parameters"]):
        apart = abs(a["value"] - b["value"])
        if a["identified"] and b["identified"]:
            if apart > most * np.hypot(a["deviation"], b["deviation"]):
                names.append(a["name"])
    return names
