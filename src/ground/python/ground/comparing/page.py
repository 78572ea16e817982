"""report.html of compare: the verdict first, then the evidence."""

from typing import Optional, Sequence

from ground.analysis.horizon import PredictionError
from ground.comparing import words
from ground.reports import appearance, figures, page, studies
from ground.reports.inspection import Inspection
from ground.reports.words import off
from ground.support import records
from ground.support.annotations import Document, Plotly


def write(
    path: str,
    result: Document,
    inspected: Sequence[Sequence[Inspection]],
    described: Sequence[Document],
    inputs: Sequence[str] = (),
    force: bool = False,
) -> None:
    """Writes the page of a comparison.

    result: contents of compare.json; inspected: for every run, the Inspection of each model;
    described: findings.describe of all runs; inputs: files read.
    """
    pooled = result["pooled"]
    page.write(
        path,
        "comparing/comparison.html",
        "Comparison of " + ", ".join(result["models"]),
        appearance.MODELS[1],
        force,
        result=result,
        head=[line for line in words.lines(result, path) if line[0] != "Details"],
        predictions=predictions(result),
        pooled=[
            appearance.numbers_row(label, role, numbers)
            for label, groups in pooled.items()
            for role, numbers in groups.items()
            if role != "all" and numbers
        ],
        runs=studies.shown(inspected, described),
        described=studies.quality(described),
        inputs=inputs,
    )


def predictions(result: Document) -> Optional[Plotly]:
    """Bars of how far predicted poses are off, the best model last; None where runs are too short."""
    if result["prediction"] is None:
        return None
    found = records.read(PredictionError, result["prediction"], "prediction")
    labels = list(reversed(result["ranking"]["errors"]))
    told = off(found.errors[labels[-1]]), labels[-1], off(found.mocap)
    title = "Predictions are off by %s with %s; the mocap alone leaves %s" % told
    return figures.predictions(found, list(zip(labels, labels)), title, result["ranking"]["fitted"])
