"""report.html of compare: the verdict first, then the evidence."""

from typing import Optional, Sequence

from ground.analysis.horizon import PredictionError
from ground.comparing.ranking import Ranking
from ground.reports import appearance, figures, page, studies
from ground.reports.inspection import Inspection
from ground.reports.words import listed, off
from ground.support.annotations import Document, Plotly
from ground.support.headline import Line


def write(
    path: str,
    head: Sequence[Line],
    predictions: Optional[Plotly],
    labels: Sequence[str],
    pooled: Sequence[Sequence[str]],
    inspected: Sequence[Sequence[Inspection]],
    described: Sequence[Document],
    inputs: Sequence[str] = (),
    force: bool = False,
) -> None:
    """Writes the page of a comparison.

    predictions: their figure; labels: of the models; pooled: rows of their errors over all runs; inspected:
    for every run, the Inspection of each model; described: findings.describe of all runs; inputs: files read.
    """
    page.write(
        path,
        "comparing/comparison.html",
        "Comparison of " + ", ".join(labels),
        appearance.MODELS[1],
        force,
        models=labels,
        head=[line for line in head if line[0] != "Details"],
        predictions=predictions,
        pooled=pooled,
        runs=studies.shown(inspected, described),
        described=studies.quality(described),
        inputs=inputs,
    )


def predictions(ranking: Ranking, found: Optional[PredictionError]) -> Optional[Plotly]:
    """Bars of how far predicted poses are off, the best model last; None where runs are too short."""
    if found is None:
        return None
    labels = list(reversed(list(ranking.errors)))
    told = off(found.errors[ranking.best]), ranking.best, off(found.mocap)
    title = "Predictions are off by %s with %s; the noise floor is %s" % told
    seen = listed(ranking.fitted) + " was" if ranking.fitted else "no model was"
    return figures.predictions(found, list(zip(labels, labels)), title, "that %s fitted to" % seen)
