"""report.html of history: what changed first, a figure for each parameter, then the evidence."""

from typing import Iterator, Sequence

from ground.ledger import figures, words
from ground.ledger.contents import HistoryContents, RunEntry
from ground.reports import appearance, page


def write(path: str, found: HistoryContents, inputs: Sequence[str] = (), force: bool = False) -> None:
    """Writes the page of a history. inputs: files read."""
    color = appearance.MODELS[1] if found.changes or found.odd else appearance.REFERENCE
    page.write(
        path,
        "ledger/history.html",
        "History of " + ", ".join(found.folders),
        color,
        force,
        head=[line for line in words.lines(found, path) if line[0] != "Details"],
        drawn=list(figures.all_of(found)),
        changes=[
            [one.craft, one.parameter, one.kind, words.change(found, one), "%.1g" % one.p_value]
            for one in found.changes
        ],
        crafts=list(_crafts(found)),
        runs=[_run(run) for run in found.runs],
        left_out=[[one.path, one.why] for one in found.left_out],
        verdicts=[words.verdict(one) for one in found.verdicts],
        inputs=inputs,
    )


def _crafts(found: HistoryContents) -> Iterator[Sequence[str]]:
    """Each parameter of each craft as it is now, and its scatter."""
    for kind in found.types:
        for craft in found.crafts_of(kind):
            for name, parameter in kind.parameters.items():
                now = words.told(craft.now[name])
                yield [craft.name, name, now, parameter.unit, words.scatter(parameter)]


def _run(run: RunEntry) -> Sequence[str]:
    values = ["%s %s" % (name, words.told(value)) for name, value in run.parameters.items() if value]
    return [run.recorded, run.name, run.craft, run.time_from, "; ".join(values)]
