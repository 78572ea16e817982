"""The first lines of a discovery: what is missing, how much it matters, where the model is, what to do
next."""

from typing import List, Optional

from ground import _core
from ground.analysis.horizon import PredictionError
from ground.discovery import words
from ground.discovery.story import Story
from ground.reports.words import listed, prediction, sentence
from ground.support import records
from ground.support.headline import Line


def lines(story: Story, given: Optional[_core.Model], model: str = "", page: str = "") -> List[Line]:
    """All first lines. given: the given model, which knows effects of single thrusters in words; model, page:
    files of the final model and of the page; empty: they are not written."""
    finding = story.findings[-1] if story.findings else None
    head = [("Missing" if story.ended else "Missing, so far", _answer(story, given))]
    if finding:
        best = "improved" if finding.effects else "refitted"
        beside = {"refitted": "refitted without the effects"} if finding.effects else {}
        found = finding.prediction and records.read(PredictionError, finding.prediction, "prediction")
        head += prediction(found or None, "given", best, **beside)
    if story.flights:
        head.append(("Flown", words.effort(story)))
    if model:
        count = len(finding.effects) if finding else 0
        head.append(("Model with %s" % ("it" if count == 1 else "them") if count else "Model", model))
    head.append(("Next", _next(story)))
    return head + [("Details", page)] * bool(page)


def _answer(story: Story, given: Optional[_core.Model]) -> str:
    if not story.findings:
        return "not known - no flight has been diagnosed."
    finding = story.findings[-1]
    found, rest = words.effects_of(finding, given), words.rest_of(finding)
    told = [listed(found) + "."] if found else []
    told += [sentence(finding.does[name]) for name in finding.effects if name in finding.does]
    return " ".join([*told, *([rest + "."] if rest else []), *_certainty(story)])


def _certainty(story: Story) -> List[str]:
    check = story.confirmation
    if not story.ended:
        return []
    if check is None:
        return ["Not confirmed by a test flight."]
    holds = "Confirmed" if check.holds else "Not confirmed: it does not predict"
    return ["%s by an independent test flight." % holds if check.holds else holds + " the test flight."]


def _next(story: Story) -> str:
    """What to do next."""
    if not story.ended:
        planned = "flight %d is planned" % story.planned.number if story.planned else story.activity
        return planned or "the next flight is chosen"
    if story.needed:
        return "%s; needed: %s" % (story.reason, story.needed)
    if story.sure:
        return "nothing needed - %s" % story.reason
    return "to continue, repeat the command with the same folder (it ended: %s)" % story.reason
