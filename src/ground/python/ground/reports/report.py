"""report.html of compare and diagnose: the verdict first, then the evidence."""

import itertools
import os
from typing import Any, List, Mapping, Optional, Sequence, Tuple

from ground import _core, origin
from ground.analysis import bands as bands_of
from ground.analysis.verdict import Conclusion
from ground.analysis.diagnosis import Diagnosis
from ground.annotations import Document
from ground.recordings import findings
from ground.reports import appearance, figures, inspection, page, words, wrench_figures
from ground.reports.words import number

COLORS = {
    "complete": appearance.REFERENCE,
    "missing": appearance.MODELS[1],
    "varies": appearance.MODELS[2],
    "memory": appearance.MODELS[0],
    "unexplained": appearance.MODELS[0],
    "undecided": appearance.MODELS[0],
    "misread": appearance.WARNING,
}
NUMBERS = ["#" * (i > 1) + name for i, name in enumerate(appearance.NUMBERS)]
ZOOM = "Zoom in time, and the path shows that stretch only; a double click goes back."
MAX_DRAWN = 8  # runs that are drawn; to infer the missing wrench along each takes seconds
NOMINAL, IMPROVED = "nominal, refitted", "improved"


def diagnosis(
    path: str,
    report: Document,
    found: Diagnosis,
    conclusion: Conclusion,
    described: Sequence[Document],
    held: Sequence[_core.RunData] = (),
    inputs: Sequence[str] = (),
    force: bool = False,
    thorough: bool = False,
) -> None:
    """Writes the page of a diagnosis.

    report: as ground.analysis.diagnosis_report gives it; found, conclusion: Diagnosis and Conclusion;
    described: findings.describe of all runs; held: _core.RunData of runs that were held out; inputs:
    files read. At most MAX_DRAWN runs are drawn, unless thorough.
    """
    runs = [(run, "fit") for run in found.runs] + [(run, "held_out") for run in held]
    most = len(runs) if thorough else min(MAX_DRAWN, len(runs))
    drawn = [i * len(runs) // most for i in range(most)]
    inspected = _inspected(found, conclusion, [runs[i] for i in drawn])
    sheet = page.Page("Diagnosis of %s" % os.path.basename(report["model"]))
    _verdict(sheet, report)
    if most < len(runs):
        sheet.paragraph(
            "%d of %d runs, spread evenly, are drawn; identify diagnose --thorough draws all."
            % (most, len(runs))
        )
    banded = {id(band.run): band for band in conclusion.bands}
    _measured_against(sheet, inspected, [described[i] for i in drawn], banded)
    if report["verdict"] != "misread":
        _evidence(sheet, report)
        _open_questions(sheet, report)
    _quality(sheet, described)
    seeds = "all random numbers have fixed seeds (noise floor 0 to 4, artificial recordings 1 to 15)"
    add_origin(sheet, inputs, [_held_out(report["runs"]), seeds])
    sheet.write(path, COLORS[report["verdict"]], force)


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

    studies = iter(found.pool.map(inspected, itertools.product(runs, models)))
    return [[next(studies) for _ in models] for _ in runs]


def _verdict(sheet: page.Page, report: Document) -> None:
    """The verdict in a sentence, the parts of the error, and how it falls."""
    sheet.add("<h1>What is missing in %s?</h1>" % page.text(os.path.basename(report["model"])))
    sheet.paragraph(words.verdict(report), "verdict")
    if report["findings"]:
        sheet.points(list(words.findings(report)))
    if report["verdict"] == "misread":
        return
    sheet.paragraph(words.ceiling(report))
    bands = words.bands(report)
    if bands:
        sheet.paragraph(bands)
    fall = figures.fall(words.steps(report), report["noise_floor"], words.error_name(report))
    sheet.figure(fall)
    if words.is_held_out(report):
        sheet.paragraph(words.crossed(report))


def _open_questions(sheet: page.Page, report: Document) -> None:
    """What the runs do not show, the experiment that would, and what is left unexplained."""
    for sentence in list(words.extent(report)) + list(words.slight(report)):
        sheet.paragraph(sentence)
    apart = list(words.apart(report))
    sheet.heading("What is not distinguished, and the next experiment")
    if apart:
        sheet.points(apart)
    else:
        sheet.paragraph("These runs distinguish all effects that were tried.")
    rest = list(words.left(report)) + list(words.unexplained(report))
    if rest:
        sheet.heading("What is left")
        sheet.points(rest)


def _held_out(runs: Document) -> str:
    """Which runs were held out, in words."""
    if runs["heldout"] != runs["fit"]:
        return "held out: " + ", ".join(runs["heldout"])
    return "cross-validated: each run (or quarter of a single one), by a fit to the others"


def comparison(
    path: str,
    result: Document,
    inspected: Sequence[List[Document]],
    described: Sequence[Document],
    inputs: Sequence[str] = (),
    force: bool = False,
) -> None:
    """Writes the page of a comparison.

    result: contents of compare.json; inspected: for every run, the results of ground.reports.inspection
    for each model; described: findings.describe of all runs; inputs: files read.
    """
    sheet = page.Page("Comparison of " + ", ".join(result["models"]))
    sheet.add(
        "<h1>%s</h1>"
        % page.text(
            "Where " + " and ".join(result["models"]) + (" fails" if len(result["models"]) == 1 else " fail")
        )
    )
    ranking = result["ranking"]
    sheet.paragraph(words.comparison(ranking, result["noise_floor"]), "verdict")
    errors = [(label, ranking["errors"][label]) for label in result["pooled"]]
    runs = {"held_out": "held-out runs", "fit": "runs used for fitting"}.get(ranking["role"], "all runs")
    sheet.figure(figures.fall(errors, result["noise_floor"], "error on " + runs))
    _numbers(sheet, result["pooled"])
    _measured_against(sheet, inspected, described)
    _quality(sheet, described)
    add_origin(sheet, inputs, ["all random numbers have fixed seeds (noise floor 1)"])
    sheet.write(path, appearance.MODELS[1], force)


def _numbers(sheet: page.Page, pooled: Mapping[str, Document]) -> None:
    sheet.subheading("All runs together")
    rows = [
        appearance.numbers_row(label, role, numbers)
        for label, groups in pooled.items()
        for role, numbers in groups.items()
        if role != "all" and numbers
    ]
    sheet.table(NUMBERS, rows)
    sheet.paragraph(
        "fit: the model file says that it was fitted to this recording; held out: that it was not; unknown: "
        "the file has names of recordings only. Prediction error: initial "
        "velocities from the first 0.4 s of a window, the rest scored. (3.4): the thesis's objective.",
        "caption",
    )


def _measured_against(
    sheet: page.Page,
    inspected: Sequence[List[Document]],
    described: Sequence[Document],
    banded: Optional[Mapping[int, bands_of.Bands]] = None,
) -> None:
    """All runs against all models: over time and place.

    banded: bands.Bands by the id of their run.
    """
    sheet.heading("Measured against each model")
    if len(inspected) > 1:
        sheet.paragraph("Open a run to see it.", "caption")
    for count, (studies, about) in enumerate(zip(inspected, described)):
        run = studies[0]["run"]
        errors = ", ".join(
            "%s %s (%s)" % (s["label"], number(s["numbers"]["error"]), s["role"].replace("_", " "))
            for s in studies
        )
        sheet.fold(run.name, "%s; error: %s" % (findings.when(about), errors), count == 0)
        _run(sheet, studies, (banded or {}).get(id(run)))
        sheet.end_fold()


def _run(sheet: page.Page, studies: List[Document], bands: Optional[bands_of.Bands]) -> None:
    """One run against all models."""
    sheet.figure(figures.motion(studies, bands), ZOOM)
    sheet.table(NUMBERS, [appearance.numbers_row(s["label"], s["role"], s["numbers"]) for s in studies])
    sheet.points("%s: %s." % (s["label"], line) for s in studies for line in s["summary"])
    for heading, figure in (
        ("Missing wrench", wrench_figures.wrench_over_time(studies)),
        ("Residuals", figures.residual_correlation(studies)),
    ):
        sheet.subheading(heading)
        sheet.figure(figure)


def _evidence(sheet: page.Page, report: Document) -> None:
    sheet.heading("Evidence")
    sheet.paragraph(
        "Each effect added to the nominal model, and refitted by likelihood; without an effect its "
        "cross-validated error is then %s."
        % number(report["nominal"]["cross_validated"])
        + " p: probability of as much evidence without the "
        "effect, corrected for the number of effects tried. ΔBIC: below 0 favours the effect. "
        "Brackets: 95% intervals. Bold: chosen.",
        "caption",
    )
    head = ["#rank", "effect", "#error, cross-validated", "#p", "#ΔBIC"]
    rows = [
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
    chosen = [i for i, c in enumerate(report["candidates"]) if c["selected"]]
    sheet.table(head + ["parameters", "not distinguished from"], rows, chosen)
    sheet.subheading("Improved model")
    nominal, improved = report["nominal"]["parameters"], report["improved"]["parameters"]
    rows = [
        [
            name,
            "%.4g" % nominal[name]["value"] if name in nominal else "",
            "%.4g" % p["value"],
            ("%.4g to %.4g" % tuple(p["ci95"]) if p["identified"] else "not identifiable from these data"),
            p["unit"],
        ]
        for name, p in improved.items()
    ]
    new = [i for i, name in enumerate(improved) if name not in nominal]
    sheet.table(["parameter", "#nominal", "#improved", "95% interval", "unit"], rows, new)


def _quality(sheet: page.Page, described: Sequence[Document]) -> None:
    sheet.heading("Data quality")
    rows = []
    for d in described:
        facts = dict(findings.facts(d))
        odd = list(findings.findings(d))
        rows.append(
            [
                d["name"],
                facts["recorded"],
                facts["usable"],
                facts["poses"],
                facts["commands"],
                facts.get("reply", "-"),
                "\n".join("• " + line for line in odd) or "nothing odd",
            ]
        )
    sheet.table(
        [
            "run",
            "recorded",
            "usable",
            "poses",
            "commands",
            "reply",
            "oddities and repairs",
        ],
        rows,
    )


def add_origin(sheet: page.Page, inputs: Sequence[str], remarks: Sequence[str]) -> None:
    """Adds the command, the versions of programs, remarks, and fingerprints of the files read."""
    sheet.heading("How it was made")
    sheet.add(
        "<p><code>%s</code><br>in <code>%s</code></p>" % (page.text(origin.command()), page.text(os.getcwd()))
    )
    versions = ", ".join("%s %s" % item for item in origin.versions().items())
    sheet.points([origin.now(), versions] + list(remarks))
    sheet.table(["file", "SHA-256, first half"], [[p, origin.fingerprint(p)] for p in inputs])
