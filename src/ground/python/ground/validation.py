"""How well a fit predicts what it has not seen: runs, and blocks of time, left out one by one."""
import numpy as np

from ground import windows

BLOCK = 6.0  # length of blocks of time [s]


def leave_one_run_out(runs, fit):
    """The fit without each run and its error on that run: [(fit's result, error)], one a run.

    `fit(windows)` fits to windows of `runs` (_core.RunData), as ground.windows cuts them.
    """
    every = windows.cut(runs)
    return _leave_one_out(runs, [[w for w in every if w.run == i] for i in range(len(runs))], fit)


def leave_one_block_out(runs, fit, length=BLOCK):
    """The error on blocks of time, each with a fit without it; None when there are less than two."""
    blocks = []
    for i, run in enumerate(runs):
        start, end = run.times[0], run.times[-1]
        edges = np.linspace(start, end, max(1, int(round((end - start) / length))) + 1)
        parts = [windows.cut_part(run, i, a, b) for a, b in zip(edges[:-1], edges[1:])]
        blocks += [part for part in parts if part]
    if len(blocks) < 2:
        return None
    weights = [sum(w.last - w.first + 1 for w in block) for block in blocks]
    return float(np.average([e for _, e in _leave_one_out(runs, blocks, fit)], weights=weights))


def _leave_one_out(runs, parts, fit):
    results = []
    for at, out in enumerate(parts):
        result = fit([w for i, part in enumerate(parts) if i != at for w in part])
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
