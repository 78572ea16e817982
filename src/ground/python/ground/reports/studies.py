"""What pages show of recordings: one run against some models, and the quality of all runs."""

from typing import List, Mapping, Sequence

from ground.analysis import bands as bands_of
from ground.checks import findings
from ground.reports import appearance, figures, wrench_figures
from ground.reports.words import number
from ground.support.annotations import Document


def shown(
    inspected: Sequence[Sequence[Document]],
    described: Sequence[Document],
    banded: Mapping[int, bands_of.Bands] = {},
) -> List[Document]:
    """Every run against all models, as parts.html shows it. inspected: for every run, the results of
    ground.reports.inspection for each model; described: findings.describe of the runs; banded: bands.Bands
    by the id of their run."""
    return [_run(studies, about, banded) for studies, about in zip(inspected, described)]


def _run(studies: Sequence[Document], about: Document, banded: Mapping[int, bands_of.Bands]) -> Document:
    run = studies[0]["run"]
    errors = ", ".join(
        "%s %s (%s)" % (s["label"], number(s["numbers"]["error"]), s["role"].replace("_", " "))
        for s in studies
    )
    return {
        "name": run.name,
        "beside": "%s; error: %s" % (findings.when(about["begins"]), errors),
        "motion": figures.motion(studies, banded.get(id(run))),
        "rows": [appearance.numbers_row(s["label"], s["role"], s["numbers"]) for s in studies],
        "points": ["%s: %s." % (s["label"], s["left_out"]) for s in studies if s["left_out"]],
        "wrench": wrench_figures.wrench_over_time(studies),
        "residuals": figures.residual_correlation(studies),
    }


def quality(described: Sequence[Document]) -> List[List[str]]:
    """Rows of the table of the quality of all runs."""
    rows = []
    for about in described:
        facts = dict(findings.facts(about))
        odd = "\n".join("• " + line for line in findings.findings(about)) or "nothing odd"
        parts = [facts.get(key, "-") for key in ("recorded", "usable", "poses", "commands", "reply")]
        rows.append([about["name"], *parts, odd])
    return rows
