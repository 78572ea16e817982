"""How well a fit predicts runs and blocks of time that are held out of it."""

from typing import Callable, Dict, List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.annotations import Array, Document
from ground.progress import Work
from ground.recordings import windows

BLOCK = 6.0  # length of blocks of time [s]
FOLDS = 10  # largest number of folds of blocks, whatever the length of the runs
# Fits to windows, from the windows' initial states if any are given.
Refit = Callable[[Sequence[_core.Window], Sequence[Array]], Document]
RUN_FOLDS = 20  # largest number of folds of runs
BLOCKS, RUNS = "holding out blocks of time", "holding out runs"  # stages


def leave_runs_out(
    runs: Sequence[_core.RunData],
    fit: Refit,
    whole: Document,
    length: float = windows.WINDOW,
    most: int = RUN_FOLDS,
    work: Optional[Work] = None,
) -> List[Tuple[Document, float]]:
    """Fits without some of the runs, and their errors on those: [(fit's result, error)], one per run.

    Each run is held out once: alone, or, with more than `most` runs, together with every `most`-th
    other one. `fit(windows, initial)` fits to windows of `length` seconds of `runs` (_core.RunData)
    from initial states of the windows; `whole` is its result over windows.cut(runs, length).
    work: told of each fit.
    """
    cut = windows.cut(runs, length)
    folds = [w.run % most for w in cut]
    results = _refits(cut, folds, fit, whole["initial"], work or Work())
    return [
        (results[i % most], windows.error([run], results[i % most]["model"]))
        for i, run in enumerate(runs)
    ]


def leave_blocks_out(
    runs: Sequence[_core.RunData],
    models: Sequence[_core.Model],
    fit: Refit,
    block: float = BLOCK,
    length: float = windows.WINDOW,
    most: int = FOLDS,
    work: Optional[Work] = None,
) -> Optional[Document]:
    """Errors on blocks of time: of models as they are, and of fits without the blocks.

    Up to `most` blocks are held out one by one; of more blocks, every `most`-th one together. `fit`,
    `length` and `work` as in leave_runs_out; without initial states fits begin at measured ones.
    Returns {"models": one error per model, "heldout": error, "blocks", "folds": how many}, all
    errors over the same windows; None when a fit without some fold would have no data.
    """
    blocks = _blocks(runs, block, length)
    folds = [number % most for number in range(len(blocks))]
    to_fit = [w for fitted, _ in blocks for w in fitted]
    of_fit = [fold for fold, (fitted, _) in zip(folds, blocks) for _ in fitted]
    if len(set(of_fit)) < 2:
        return None
    whole = fit(to_fit, ())
    results = _refits(to_fit, of_fit, fit, whole["initial"], work or Work())
    errors, samples = [], []
    for fold in sorted(set(folds)):
        tested = [w for f, (_, test) in zip(folds, blocks) if f == fold for w in test]
        errors.append(windows.error(runs, results.get(fold, whole)["model"], tested))
        samples.append(sum(w.last - w.first + 1 for w in tested))
    every = [w for _, tested in blocks for w in tested]
    return {
        "models": [windows.error(runs, model, every) for model in models],
        "heldout": float(np.average(errors, weights=samples)),
        "blocks": len(blocks),
        "folds": len(errors),
    }


def _blocks(
    runs: Sequence[_core.RunData], duration: float, length: float
) -> List[Tuple[List[_core.Window], List[_core.Window]]]:
    """Windows to fit to and windows to test on, of each block that has windows to test on."""
    blocks = []
    for i, run in enumerate(runs):
        start, end = run.times[0], run.times[-1]
        edges = np.linspace(start, end, max(1, int(round((end - start) / duration))) + 1)
        for a, b in zip(edges[:-1], edges[1:]):
            tested = windows.cut_part(run, i, a, b)
            if tested:
                blocks.append((windows.cut_part(run, i, a, b, length), tested))
    return blocks


def _refits(
    cut: Sequence[_core.Window],
    folds: Sequence[int],
    fit: Refit,
    initial: Sequence[Array],
    work: Work,
) -> Dict[int, Document]:
    """Results of fits without each fold, by fold; folds, initial: fold and state of each window."""
    results: Dict[int, Document] = {}
    work.more(len(set(folds)))
    for fold in work.each(sorted(set(folds))):
        rest = [k for k, f in enumerate(folds) if f != fold]
        results[fold] = fit([cut[k] for k in rest], [initial[k] for k in rest])
    return results


def disagreements(fitted: Document, others: Document, most: float = 3.0) -> List[str]:
    """Parameters whose estimate from one run and from the others differ by `most` deviations."""
    names = []
    for a, b in zip(fitted["parameters"], others["parameters"]):
        apart = abs(a["value"] - b["value"])
        if a["identified"] and b["identified"]:
            if apart > most * np.hypot(a["deviation"], b["deviation"]):
                names.append(a["name"])
    return names
