"""report.html of diagnose: the verdict first, then the evidence."""

import os
from typing import Any, List, Optional

from ground.diagnosing import answer, words
from ground.diagnosing.drawn import Drawn
from ground.diagnosing.report import DiagnosisReport
from ground.reports import appearance, figures, page, studies
from ground.reports.words import number, off
from ground.support.annotations import Plotly

MAX_DRAWN = 8  # runs that are drawn; to infer the missing wrench along each takes seconds


def write(path: str, report: DiagnosisReport, found: Drawn, force: bool = False) -> None:
    """Writes the page of a diagnosis."""
    described, count = found.described, len(found.described)
    most = min(MAX_DRAWN, count)
    drawn = [i * count // most for i in range(most)]
    inspected, banded = found.inspected(drawn), {id(one.run): one for one in found.bands}
    tested = "cross-validated: each run (or quarter of a single one), by a fit to the others"
    if report.runs.is_held_out:
        tested = "held out: " + ", ".join(report.runs.heldout)
    name = os.path.basename(report.model)
    improved, nominal = report.improved.parameters, report.nominal.parameters
    page.write(
        path,
        "diagnosing/diagnosis.html",
        "Diagnosis of %s" % name,
        appearance.VERDICTS[report.verdict],
        force,
        name=name,
        report=report,
        head=[line for line in answer.lines(report, os.curdir) if line[0] != "Details"],
        words=words,
        predictions=predictions(report),
        drawn=len(inspected),
        count=count,
        runs=studies.shown(inspected, [described[i] for i in drawn], banded),
        candidates=_candidates(report),
        chosen=[i for i, c in enumerate(report.candidates) if c.selected],
        columns=_columns(report),
        parameters=_parameters(report),
        new=[i for i, name in enumerate(improved) if name not in nominal],
        described=studies.quality(described),
        inputs=found.inputs,
        tested=tested,
    )


def predictions(report: DiagnosisReport) -> Optional[Plotly]:
    """Bars of how far predicted poses are off; None where runs are too short."""
    found, effects = report.prediction, report.improved.effects
    if found is None:
        return None
    shown = [("given", "given"), ("improved", "refitted")]
    if effects:
        shown[1:] = [("refitted", "refitted"), ("improved", "improved")]
    if "formula" in found.errors:
        shown.append(("formula", "with the proposed formula"))
    before, last = (off(found.errors[name]) for name in (shown[min(1, len(shown) - 2)][0], shown[-1][0]))
    title = "After %.3g s predictions are off by %s, by %s before; the noise floor is %s"
    told = found.seconds, last, before, off(found.mocap)
    data = "that the refits did not use; the given model is as it was"
    return figures.predictions(found, shown, title % told, data)


def _candidates(report: DiagnosisReport) -> List[List[Any]]:
    """A row for each effect that was tried."""
    return [
        [
            c.rank,
            words.effect(report, c.effect),
            number(c.error.heldout),
            "%.1g" % c.p_corrected,
            "%.0f" % c.delta_bic,
            "\n".join(words.parameters(c.parameters)),
            words.effects(report, c.others),
        ]
        for c in report.candidates
    ]


def _columns(report: DiagnosisReport) -> List[str]:
    """The heads of the table of parameters, which names models as the figures do."""
    models = ["#given", "#refitted", *["#improved"] * bool(report.improved.effects)]
    return ["parameter", *models, "95% interval", "unit"]


def _parameters(report: DiagnosisReport) -> List[List[str]]:
    """A row for each parameter of the improved model: before and after."""
    nominal, found = report.nominal.parameters, bool(report.improved.effects)
    rows = []
    for name, p in report.improved.parameters.items():
        before = nominal.get(name)
        start, refitted = (before.start, before.value) if before else (None, None)
        own = p.named(name)
        rows.append([name, _short(start), *[_short(refitted)] * found, own.number, own.interval, p.unit])
    return rows


def _short(value: Optional[float]) -> str:
    """A number in four digits; empty without one."""
    return "" if value is None else "%.4g" % value
