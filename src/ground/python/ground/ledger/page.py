"""report.html of history: what changed first, a figure for each parameter, then the evidence."""

from typing import Sequence

from ground.ledger import figures, words
from ground.reports import appearance, page
from ground.support.annotations import Document


def write(path: str, report: Document, inputs: Sequence[str] = (), force: bool = False) -> None:
    """Writes the page of a history. report: contents of history.json; inputs: files read."""
    color = appearance.MODELS[1] if report["changes"] or report["odd"] else appearance.REFERENCE
    page.write(
        path,
        "ledger/history.html",
        "History of " + ", ".join(report["folders"]),
        color,
        force,
        report=report,
        head=[line for line in words.lines(report, path) if line[0] != "Details"],
        words=words,
        drawn=list(figures.all_of(report)),
        changes=[
            [one["craft"], one["parameter"], one["kind"], words.change(report, one), "%.1g" % one["p_value"]]
            for one in report["changes"]
        ],
        crafts=list(_crafts(report)),
        runs=[_run(report, run) for run in report["runs"]],
        left_out=[[one["path"], one["why"]] for one in report["left_out"]],
        verdicts=[words.verdict(one) for one in report["verdicts"]],
        inputs=inputs,
    )


def _crafts(report: Document) -> Sequence[Sequence[str]]:
    """Each parameter of each craft as it is now, and its scatter."""
    rows = []
    for kind in report["types"]:
        for craft in (c for c in report["crafts"] if c["type"] == kind["name"]):
            for name, parameter in kind["parameters"].items():
                now = words.told(craft["now"][name])
                rows.append([craft["name"], name, now, parameter["unit"], words.scatter(parameter)])
    return rows


def _run(report: Document, run: Document) -> Sequence[str]:
    values = ["%s %s" % (name, words.told(value)) for name, value in run["parameters"].items() if value]
    return [run["recorded"], run["name"], run["craft"], run["time_from"], "; ".join(values)]
