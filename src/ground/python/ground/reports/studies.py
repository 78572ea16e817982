"""What pages show of recordings: one run against some models, and the quality of all runs."""

from dataclasses import dataclass
from typing import List, Mapping, Sequence

from ground.analysis import bands as bands_of
from ground.checks import findings
from ground.reports import appearance, figures, wrench_figures
from ground.reports.inspection import Inspection
from ground.reports.words import number
from ground.support.annotations import Document, Plotly


@dataclass(frozen=True)
class RunSection:
    """A run against all models, as parts.html shows it."""

    name: str
    beside: str  # its time and the errors of the models
    motion: Plotly
    rows: List[List[str]]  # of the table of numbers
    points: List[str]  # what was left out
    wrench: Plotly
    residuals: Plotly


def shown(
    inspected: Sequence[Sequence[Inspection]],
    described: Sequence[Document],
    banded: Mapping[int, bands_of.Bands] = {},
) -> List[RunSection]:
    """Every run against all models. inspected: for every run, the Inspection of each model; described:
    findings.describe of the runs; banded: bands.Bands by the id of their run."""
    return [_run(studies, about, banded) for studies, about in zip(inspected, described)]


def _run(studies: Sequence[Inspection], about: Document, banded: Mapping[int, bands_of.Bands]) -> RunSection:
    run = studies[0].run
    errors = ", ".join(
        "%s %s (%s)" % (s.label, number(s.numbers["error"]), s.role.replace("_", " ")) for s in studies
    )
    return RunSection(
        run.name,
        "%s; error: %s" % (findings.when(about["begins"]), errors),
        figures.motion(studies, banded.get(id(run))),
        [appearance.numbers_row(s.label, s.role, s.numbers) for s in studies],
        ["%s: %s." % (s.label, s.left_out) for s in studies if s.left_out],
        wrench_figures.wrench_over_time(studies),
        figures.residual_correlation(studies),
    )


def quality(described: Sequence[Document]) -> List[List[str]]:
    """Rows of the table of the quality of all runs."""
    rows = []
    for about in described:
        facts = dict(findings.facts(about))
        odd = "\n".join("• " + line for line in findings.findings(about)) or "nothing odd"
        parts = [facts.get(key, "-") for key in ("recorded", "usable", "poses", "commands", "reply")]
        rows.append([about["name"], *parts, odd])
    return rows
