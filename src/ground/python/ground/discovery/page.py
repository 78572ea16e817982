"""report.html of a discovery: its result first, then the story flight by flight.

It is made from the Story and the files of its folder, at any time of a discovery.
"""

import os
from dataclasses import dataclass, field
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.discovery import answer, figures, words
from ground.discovery.story import (
    ABSENT,
    CONFIRM,
    HIDDEN,
    OPEN,
    PRESENT,
    SLIGHT,
    TRACK,
    Belief,
    Finding,
    Flight,
    Flown,
    Story,
)
from ground.effect_library.parameters import described
from ground.reports import appearance, page
from ground.reports.words import sentence
from ground.support.annotations import Array

NAME = "report.html"  # in the folder of a discovery
MAX_OPEN = 8  # flights that are all shown at once
MAX_DIAGNOSES = 5  # latest ones, for which a table has room beside each other
STATES = [PRESENT, OPEN, HIDDEN, SLIGHT, ABSENT]  # from the top


def write(story: Story, folder: str, room: Optional[_core.RoomPlan] = None) -> str:
    """Writes the page into the folder of a discovery, instead of an earlier one; returns its path.

    room: whose walls are drawn. Files of the folder that are missing or damaged are left out.
    GroundError when the page cannot be written.
    """
    path = os.path.join(folder, NAME)
    named = [v.file for v in story.versions] + [f.recording for f in story.flights]
    kept = [place for place in (_place(folder, name) for name in named) if place]
    final = next((_place(folder, v.file) for v in story.versions if v.label == story.in_use), "")
    models = [_model(_place(folder, v.file)) for v in story.versions]
    given, newest = (models[0], models[-1]) if models else (None, None)
    old = _values(given)
    page.write(
        path,
        "discovery/discovery.html",
        "Discovery of %s" % story.craft,
        appearance.VERDICTS.get(story.verdict, appearance.LESS),
        force=True,
        story=story,
        head=answer.lines(story, given, os.path.basename(final)),
        words=words,
        given=given,
        errors=figures.errors(story),
        **_beliefs(story, given),
        flights=_flights(story, folder, given, room),
        versions=_versions(story),
        in_use=[i for i, v in enumerate(story.versions) if v.label == story.in_use],
        final=os.path.abspath(final) if final else "",
        parameters=[
            [name, old.get(name, ""), value, described(newest)[name].unit]
            for name, value in _values(newest).items()
        ]
        if newest and old and newest is not given
        else [],
        new=[i for i, name in enumerate(_values(newest)) if name not in old],
        inputs=kept,
    )
    return path


def _place(folder: str, file: str) -> str:
    """Path of a file of the folder; empty if there is none."""
    path = os.path.join(folder, file)
    return path if file and os.path.exists(path) else ""


def _model(path: str) -> Optional[_core.Model]:
    """The model in a file; None if it cannot be read."""
    try:
        return _core.load_model(path) if path else None
    except RuntimeError:
        return None


def _values(model: Optional[_core.Model]) -> Dict[str, str]:
    """The parameters of a model as text, by name."""
    return {name: "%.4g" % model.value(name) for name in described(model)} if model else {}


def _beliefs(story: Story, given: Optional[_core.Model]) -> Dict[str, object]:
    """The table of the belief in each effect after each of the latest diagnoses, the likeliest first."""
    findings = [finding for finding in story.findings if finding.beliefs][-MAX_DIAGNOSES:]
    after = [{belief.effect: belief for belief in finding.beliefs} for finding in findings]
    last = {b.effect: b for finding in story.findings for b in finding.beliefs}
    ranked = sorted(last.values(), key=lambda b: (STATES.index(b.state), -b.probability))
    own = {name: means for finding in story.findings for name, means in finding.words.items()}
    rows = [
        [
            words.in_words(b.effect, own, given),
            b.state,
            *(_percent(known.get(b.effect)) for known in after),
            "" if b.share is None or b.state not in (PRESENT, SLIGHT) else "%.2g%%" % (100 * b.share),
            "%.0f" % b.visibility,
        ]
        for b in ranked
    ]
    heads = ["effect", "=state", *("#after %d" % finding.after for finding in findings)]
    found = story.findings[-1].effects if story.findings else []
    chosen = [i for i, b in enumerate(ranked) if b.effect in found]
    heads += ["#share of the error", "#visibility"]
    return {"belief_heads": heads, "belief_rows": rows, "found": chosen}


def _percent(belief: Optional[Belief]) -> str:
    """The probability of a belief; empty where it is not known, or the effect is too small to matter."""
    return "" if belief is None or belief.state == SLIGHT else "%.1f%%" % (100 * belief.probability)


@dataclass
class ShownFlight:
    """What is shown of a flight."""

    name: str
    beside: str
    lines: List[str] = field(default_factory=list)
    finding: Optional[Finding] = None
    shut: bool = False
    why: str = ""
    drawn: Any = None  # figure


def _flights(
    story: Story, folder: str, given: Optional[_core.Model], room: Optional[_core.RoomPlan]
) -> List[ShownFlight]:
    """What is shown of each flight, and of the one that is planned."""
    findings = {finding.after: finding for finding in story.findings}
    shown: List[Tuple[Flight, Optional[Flown]]] = [(flown.flight, flown) for flown in story.flights]
    found = [_flight(story, flown, findings.get(flown.flight.number)) for flown in story.flights]
    if story.planned and not story.ended:
        plan = story.planned
        beside = "%s; planned, %.0f s" % (plan.purpose, plan.duration)
        shown.append((plan, None))
        found.append(ShownFlight("Next: flight %d" % plan.number, beside))
    thrusters = [str(t["name"]).replace("_", " ") for t in given.thrusters] if given else []
    for (plan, flown), one in zip(shown, found):
        one.why = sentence(plan.why or "it %s" % words.PURPOSES.get(plan.purpose, plan.purpose))
        if plan.reference:
            one.why += " Reference: %s of %.2g m." % (plan.reference, plan.size)
        inputs = _inputs(_place(folder, plan.inputs), len(thrusters))
        one.drawn = figures.flight(plan, flown, inputs, thrusters, room)
    return found


def _flight(story: Story, flown: Flown, finding: Optional[Finding]) -> ShownFlight:
    """The texts of a flight that was flown."""
    plan, lines = flown.flight, []
    beside = "%s; %.1f s" % (plan.purpose, flown.seconds)
    if flown.tracking_error is not None:
        beside += "; tracking error %s" % words.millimetres(flown.tracking_error)
    if flown.controlled_by:
        lines.append("Controlled by the model %s." % flown.controlled_by)
    if flown.stopped:
        lines.append(sentence("stopped early: %s" % flown.stopped))
    before = [v.label for v in story.versions if v.label in flown.errors and v.after < plan.number]
    if before:
        error, floor = words.off(flown.errors[before[-1]]), words.floor(flown)
        told = "The newest model (%s) predicted it; after %.3g s it was off by %s%s."
        lines.append(told % (before[-1], story.horizon, error, floor))
    if not flown.recording:
        lines.append("It was not recorded.")
    known = [other.effects for other in story.findings if other.after < plan.number]
    # If there are many flights, only those that changed what is known, or tested it, are open.
    is_news = finding is not None and finding.effects != (known[-1] if known else [])
    shut = len(story.flights) > MAX_OPEN and plan.purpose not in (CONFIRM, TRACK) and not is_news
    return ShownFlight("Flight %d" % plan.number, beside, lines, finding, shut)


def _inputs(path: str, thrusters: int) -> Optional[Array]:
    """Rows of time, inputs, lift of a flight; None where there are none."""
    try:
        rows = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2) if path else np.empty((0, 0))
    except (OSError, ValueError):
        return None
    return rows if len(rows) and rows.shape[1] == 2 + thrusters else None


def _versions(story: Story) -> Sequence[Sequence[Any]]:
    """The table of the models."""
    return [
        [
            v.label + " (in the controller)" * (v.label == story.in_use),
            ", ".join(v.effects) or "-",
            "flights 1 to %d" % v.after if v.after > 1 else "flight 1" if v.after else "-",
            v.file,
        ]
        for v in story.versions
    ]
