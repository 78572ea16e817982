"""report.html of compare: the verdict first, then the evidence."""

from typing import Sequence

from ground.comparing import words
from ground.reports import appearance, figures, page, studies
from ground.support.annotations import Document


def write(
    path: str,
    result: Document,
    inspected: Sequence[Sequence[Document]],
    described: Sequence[Document],
    inputs: Sequence[str] = (),
    force: bool = False,
) -> None:
    """Writes the page of a comparison.

    result: contents of compare.json; inspected: for every run, the results of ground.reports.inspection
    for each model; described: findings.describe of all runs; inputs: files read.
    """
    ranking, pooled = result["ranking"], result["pooled"]
    errors = [(label, ranking["errors"][label]) for label in pooled]
    runs = {"held_out": "held-out runs", "fit": "runs used for fitting"}.get(ranking["role"], "all runs")
    page.write(
        path,
        "comparing/comparison.html",
        "Comparison of " + ", ".join(result["models"]),
        appearance.MODELS[1],
        force,
        result=result,
        verdict=words.comparison(ranking, result["noise_floor"]),
        fall=figures.fall(errors, result["noise_floor"], "error on " + runs),
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
