"""report.html of diagnose: the verdict first, then the evidence."""

import itertools
import os
from typing import Any, List, Optional, Sequence, Tuple

from ground import _core
from ground.analysis.diagnosis import Diagnosis
from ground.analysis.verdict import Conclusion
from ground.diagnosing import answer, words
from ground.reports import appearance, figures, inspection, page, studies
from ground.reports.words import listed, number, off
from ground.support.annotations import Document

MAX_DRAWN = 8  # runs that are drawn; to infer the missing wrench along each takes seconds
NOMINAL, IMPROVED = "nominal, refitted", "improved"


def write(
    path: str,
    report: Document,
    found: Diagnosis,
    conclusion: Conclusion,
    described: Sequence[Document],
    held: Sequence[_core.RunData] = (),
    inputs: Sequence[str] = (),
    force: bool = False,
) -> None:
    """Writes the page of a diagnosis.

    report: as ground.diagnosing.document gives it; found, conclusion: Diagnosis and Conclusion;
    described: findings.describe of all runs; held: _core.RunData of runs that were held out; inputs:
    files read. At most MAX_DRAWN runs are drawn.
    """
    runs = [(run, "fit") for run in found.runs] + [(run, "held_out") for run in held]
    most = min(MAX_DRAWN, len(runs))
    drawn = [i * len(runs) // most for i in range(most)]
    inspected = _inspected(found, conclusion, [runs[i] for i in drawn])
    banded = {id(band.run): band for band in conclusion.bands}
    tested = "cross-validated: each run (or quarter of a single one), by a fit to the others"
    if words.is_held_out(report):
        tested = "held out: " + ", ".join(report["runs"]["heldout"])
    name = os.path.basename(report["model"])
    improved, nominal = report["improved"]["parameters"], report["nominal"]["parameters"]
    page.write(
        path,
        "diagnosing/diagnosis.html",
        "Diagnosis of %s" % name,
        appearance.VERDICTS[report["verdict"]],
        force,
        name=name,
        report=report,
        head=[line for line in answer.lines(report, os.curdir) if line[0] != "Details"],
        words=words,
        predictions=_predictions(report),
        drawn=most,
        count=len(runs),
        runs=studies.shown(inspected, [described[i] for i in drawn], banded),
        candidates=_candidates(report),
        chosen=[i for i, c in enumerate(report["candidates"]) if c["selected"]],
        parameters=_parameters(report),
        new=[i for i, name in enumerate(improved) if name not in nominal],
        described=studies.quality(described),
        inputs=inputs,
        tested=tested,
    )


def _inspected(
    found: Diagnosis, conclusion: Conclusion, runs: Sequence[Tuple[_core.RunData, str]]
) -> List[List[Document]]:
    """Studies of each run: the nominal model as its best refit and, where effects were added, the improved
    one."""
    models = [(conclusion.before.model, NOMINAL)]
    if found.chosen:
        models.append((conclusion.improved, IMPROVED))

    def inspected(task: Tuple[Tuple[_core.RunData, str], Any]) -> Document:
        (run, role), (model, label) = task
        return inspection.inspect(run, model, label, role)

    of_all = iter(found.pool.map(inspected, itertools.product(runs, models)))
    return [[next(of_all) for _ in models] for _ in runs]


def _predictions(report: Document) -> Optional[Document]:
    """Bars of how far predicted poses are off; None where runs are too short."""
    found, effects = report["prediction"], report["improved"]["effects"]
    if found is None:
        return None
    shown = [("given", "the given model")]
    if effects:
        shown.append(("refitted", "refitted without " + ("them" if len(effects) > 1 else "it")))
    shown.append(("improved", "refitted with " + listed(effects) if effects else "refitted"))
    if "formula" in found["errors"]:
        shown.append(("formula", "with the formula for what is left"))
    last, seconds = off(found["errors"][shown[-1][0]]), found["seconds"]
    before, floor = off(found["errors"][shown[-2][0]]), off(found["mocap"])
    title = "After %.3g s predictions are off by %s, by %s before; the mocap alone leaves %s"
    return figures.predictions(found, shown, title % (seconds, last, before, floor))


def _candidates(report: Document) -> List[List[Any]]:
    """A row for each effect that was tried."""
    return [
        [
            c["rank"],
            words.effect(report, c["effect"]),
            number(c["error"]["heldout"]),
            "%.1g" % c["p_value"],
            "%.0f" % c["delta_bic"],
            "\n".join(words.parameters(c["parameters"])),
            words.effects(report, [name for name in c["group"] if name != c["effect"]]),
        ]
        for c in report["candidates"]
    ]


def _parameters(report: Document) -> List[List[str]]:
    """A row for each parameter of the improved model."""
    nominal = report["nominal"]["parameters"]
    return [
        [
            name,
            "%.4g" % nominal[name]["value"] if name in nominal else "",
            "%.4g" % p["value"],
            "%.4g to %.4g" % tuple(p["ci95"]) if p["identified"] else "not identifiable from these data",
            p["unit"],
        ]
        for name, p in report["improved"]["parameters"].items()
    ]
