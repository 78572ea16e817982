"""The first lines of a comparison: which model predicts best, by how much, and what to do next."""

import math
from dataclasses import astuple
from typing import List, Optional

from ground.analysis.horizon import PredictionError
from ground.comparing.ranking import Ranking
from ground.models import Model
from ground.reports import words
from ground.reports.words import listed, off
from ground.support.headline import Line
from ground.support.quantities import is_as_mocap

FEW = 4  # recordings that are named
MUCH = 1.3  # least ratio of the errors of models that makes one likelier, though their scatter is as large
SLIGHTLY = 1.1  # ratio of the errors of two models below which one is slightly better


def lines(ranking: Ranking, found: Optional[PredictionError], model: Model, page: str = "") -> List[Line]:
    """All first lines. found: errors of predicted poses; model: the best; page: its file; empty: none is
    written, and commands are for Python."""
    best = ranking.best
    head = [("Best" if len(ranking.errors) > 1 else "Model", _best(ranking, found))]
    if found:
        shown = ["%s %s" % (label, off(error)) for label, error in found.errors.items()]
        told = "%s (noise floor: %s%s)" % ("; ".join(shown), off(found.mocap), _pushed(best, found))
        head.append((words.after(found.seconds), told))
    fitted_to = list(model.core.provenance.bags) if ranking.role == "held_out" else []
    name, file = "comparison.models[%r]" % best, page and (model.path or "MODEL")
    finds = words.diagnosing(name, file, bool(fitted_to))
    named = " (%s)" % listed(fitted_to) if len(fitted_to) <= FEW else ""
    how = ", diagnose the runs of its fit%s with these held out" % named if fitted_to else ""
    head.append(("Next", _next(ranking, finds, how, found)))
    return head + [("Details", page)] * bool(page)


def _best(ranking: Ranking, found: Optional[PredictionError]) -> str:
    does = "predicts" if ranking.role == "held_out" else "fits"
    best, *others = ranking.errors
    if found and _is_likelier(ranking, found):
        times = words.two_digits(words.ratio(found.errors[ranking.equal[0]], found.errors[best]))
        told = "%s, but not surely - it %s these runs %s times as well as %s, within the scatter of %s."
        few = "a single run" if len(ranking.runs) == 1 else "so few runs"
        return told % (best, does, times, ranking.equal[0], few)
    if ranking.equal:
        return "cannot be decided - %s are equally good within the scatter of these runs." % listed(
            [best, *ranking.equal]
        )
    if not others:
        held = "were not" if ranking.role == "held_out" else "were"
        return "%s - these runs %s used to fit it." % (best, held)
    if not found:
        return "%s - it %s these runs better than %s." % (best, does, listed(others))
    ratio = words.ratio(found.errors[others[0]], found.errors[best])
    if ratio < 1:
        return "%s - its error over windows is the least, but it predicts no better than %s after %.3g s." % (
            best,
            others[0],
            found.seconds,
        )
    by = [b / a for a, b in zip(astuple(found.errors[best]), astuple(found.errors[others[0]])) if a > 0]
    if ratio < SLIGHTLY and min(by, default=1) < 1 < max(by, default=1):
        better, worse = ("positions", "headings") if by[0] > 1 else ("headings", "positions")
        told = (
            "%s - its error over windows is the least: it predicts %s slightly better than %s, but %s worse."
        )
        return told % (best, better, others[0], worse)
    if ratio < SLIGHTLY:
        return "%s - it %s these runs slightly better than %s." % (best, does, listed(others))
    return "%s - it %s these runs %s times as well as %s." % (best, does, words.two_digits(ratio), others[0])


def _is_likelier(ranking: Ranking, found: PredictionError) -> bool:
    """Whether the best model predicts much better than those that the scatter does not exclude, if any."""
    by = [words.ratio(found.errors[one], found.errors[ranking.best]) for one in ranking.equal]
    return min(by, default=0.0) > MUCH


def _pushed(best: str, found: PredictionError) -> str:
    """What the best model's own random disturbance leaves, behind the noise floor."""
    if found.disturbed is None or not words.is_pushed(found):
        return ""
    return "; with the random disturbance of %s: %s" % (best, off(found.disturbed))


def _next(ranking: Ranking, finds: str, how: str, found: Optional[PredictionError]) -> str:
    """What to do next; finds: the command that finds what is missing; how: which runs it takes."""
    best, more = ranking.best, words.more_acts(found, ranking.best, finds, how)
    if ranking.role == "fit":
        asked = "which model predicts better" if len(ranking.errors) > 1 else "how well it predicts"
        used = listed(ranking.fitted)
        return "record other runs to learn %s: these were used to fit %s" % (asked, used)
    explained = (
        found and found.disturbed and is_as_mocap(astuple(found.errors[best]), astuple(found.disturbed))
    )
    if more and not explained:
        return more
    if found and _is_likelier(ranking, found):
        return "use %s; record more runs to confirm it" % best
    if ranking.equal:
        return "record more runs to decide, or use the simplest model"
    if more:
        return "use %s: its errors are no larger than those that its random disturbance leaves" % best
    if not found:
        return "use %s; record longer runs to measure its prediction error" % best
    if not math.isfinite(found.mocap.position_mm):
        return "%s diverges, so its noise floor is unknown; to find what is missing:\n%s" % (best, finds)
    return "use %s: its errors are at the noise floor" % best
