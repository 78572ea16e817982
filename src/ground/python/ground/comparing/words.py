"""The first lines of a comparison: which model predicts best, by how much, and what to do next."""

from typing import List, Optional

from ground.analysis.horizon import PredictionError
from ground.reports import words
from ground.reports.words import listed, off
from ground.support import records
from ground.support.annotations import Document
from ground.support.headline import Line

SLIGHTLY = 1.1  # ratio of the errors of two models below which one is slightly better


def lines(result: Document, page: str = "") -> List[Line]:
    """All first lines; result: contents of compare.json; page: its file; empty: it is not written, and
    commands are for Python."""
    ranking, found = result["ranking"], None
    if result["prediction"]:
        found = records.read(PredictionError, result["prediction"], "prediction")
    best = next(iter(ranking["errors"]))
    head = [("Best" if len(ranking["errors"]) > 1 else "Model", _best(ranking, best, found))]
    if found:
        shown = ["%s %s" % (label, off(error)) for label, error in found.errors.items()]
        told = "%s (the mocap alone: %s)" % ("; ".join(shown), off(found.mocap))
        head.append((words.after(found.seconds), told))
    finds = "ground.diagnose(comparison.models[%r], RECORDINGS)" % best
    if page:
        file = result["models"][best]["file"] or "MODEL"
        finds = "rosrun ground identify diagnose BAGS --model %s -o diagnosis" % file
    head.append(("Next", _next(ranking, best, finds, found)))
    return head + [("Details", page)] * bool(page)


def _best(ranking: Document, best: str, found: Optional[PredictionError]) -> str:
    errors, equal = ranking["errors"], ranking["equal"]
    does = "predicts" if ranking["role"] == "held_out" else "fits"
    if equal:
        return "cannot be decided - %s are equally good within the scatter of these runs." % listed(
            [best, *equal]
        )
    others = [label for label in errors if label != best]
    if not others:
        held = "were not" if ranking["role"] == "held_out" else "were"
        return "%s - these runs %s used to fit it." % (best, held)
    second = others[0]
    if not found:
        return "%s - it %s these runs better than %s." % (best, does, listed(others))
    ratio = words.ratio(found.errors[second], found.errors[best])
    if ratio < SLIGHTLY:
        return "%s - it %s these runs slightly better than %s." % (best, does, listed(others))
    return "%s - it %s these runs %.2g times as well as %s." % (best, does, ratio, second)


def _next(ranking: Document, best: str, finds: str, found: Optional[PredictionError]) -> str:
    """What to do next; finds: the command that finds what is missing."""
    many = len(ranking["errors"]) > 1
    if ranking["role"] == "fit":
        asked = "which model predicts better" if many else "how well it predicts"
        used = listed(ranking["fitted"])
        return "record other runs to learn %s: these were used to fit %s" % (asked, used)
    if words.times_the_mocap(found, best) > words.MISSING:
        return (
            "something is missing in %s: its predictions are off by %.2g times what the mocap explains. "
            "This finds it:\n%s" % (best, words.times_the_mocap(found, best), finds)
        )
    if ranking["equal"]:
        return "record more runs to decide, or use the simplest model"
    if not found:
        return "use %s; record runs that are long enough to see how far its predictions are off" % best
    return "use %s: what the mocap cannot measure explains its errors" % best
