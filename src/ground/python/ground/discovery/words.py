"""A discovery in sentences."""

import math
from typing import Callable, Iterator, List, Mapping, Optional, Set, Tuple

from ground import _core
from ground.analysis.horizon import PoseError
from ground.discovery import story as tale
from ground.discovery.story import Finding, Flight, Flown, Story
from ground.effect_library import candidates
from ground.reports import words
from ground.reports.words import listed, number, sentence

PURPOSES = {
    tale.LOOK: "looks for every effect of the library",
    tale.DECIDE: "decides between the open explanations",
    tale.CONFIRM: "tests the result in an independent flight",
    tale.TRACK: "follows a reference, to see whether the model makes tracking better",
}
VERDICTS = {  # for a finding without effects
    "complete": "nothing is missing",
    "missing": "nothing is missing",  # as long as no effect is named
    "varies": "no effect is missing, but a trim or the thrust differs between flights",
    "memory": "something unnamed is missing, which depends on the past",
    "unexplained": "something unnamed is missing, which none of the effects tried explains",
    "undecided": "these flights cannot decide whether something is missing",
    "misread": "these recordings seem to be read with wrong units, axes, channels or clocks, so that no "
    "effect was searched for",
}
RESTS = ("varies", "memory", "unexplained", "undecided")  # verdicts that say something beside the effects


def details(story: Story) -> List[str]:
    """Sentences on the confirmation and on tracking."""
    return [sentence(check.sentence) for check in (story.confirmation, story.tracking) if check]


def verdict_of(finding: Finding, model: Optional[_core.Model] = None) -> str:
    """The verdict of a finding, its effects in words with their names beside."""
    named, rest = effects_of(finding, model), rest_of(finding)
    if not named:
        return rest
    text = "%s %s missing" % (listed(named), "is" if len(named) == 1 else "are")
    return text + ("; besides, " + rest if rest else "")


def effects_of(finding: Finding, model: Optional[_core.Model] = None) -> List[str]:
    """The effects that were found, each with those that the flights do not distinguish from it."""
    if finding.verdict == "misread":
        return []
    groups = [[n] + [o for o in finding.groups.get(n, []) if o != n] for n in finding.effects]
    return [", or ".join(in_words(n, finding.words, model) for n in group) for group in groups]


def rest_of(finding: Finding) -> str:
    """Sentences beside the effects that were found; empty without any."""
    is_left = tale.LEFT in finding.open
    if finding.effects and finding.verdict not in (*RESTS, "misread") and not is_left:
        return ""
    rest = VERDICTS.get(finding.verdict, finding.verdict)
    if is_left and finding.verdict not in RESTS:
        rest = "part of the remaining error may not be random"
    known = [*finding.effects, *(o for n in finding.effects for o in finding.groups.get(n, []))]
    proposed = [in_words(name, finding.words) for name in finding.words if name not in known]
    return rest + (": it may be " + ", or ".join(proposed) if proposed else "")


def in_words(name: str, own: Mapping[str, str], model: Optional[_core.Model] = None) -> str:
    """An effect in words, with its name beside. own: words of effects that the library does not have;
    model: the given one."""
    return "%s (%s)" % (own[name], name) if name in own else candidates.in_words(name, model)


def effort(story: Story) -> str:
    """The time of flight."""
    count = len(story.flights)
    return "%d flight%s, %.0f of at most %.0f s" % (
        count,
        "" if count == 1 else "s",
        story.flown,
        story.budget,
    )


def planned(flight: Flight) -> str:
    """A flight that is planned, and why."""
    return "flight %d (%s, %.0f s): %s" % (
        flight.number,
        flight.purpose,
        flight.duration,
        flight.why or PURPOSES.get(flight.purpose, ""),
    )


def outcome(flight: Flown) -> str:
    """What a flight has measured, and the errors of the first and the newest model."""
    parts = ["flown %.1f s" % flight.seconds]
    if flight.stopped:
        parts.append("stopped: %s" % flight.stopped)
    if flight.errors:
        labels = list(dict.fromkeys([*flight.errors][:1] + [*flight.errors][-1:]))
        errors = ["%s %s" % (label, off(flight.errors[label])) for label in labels]
        parts.append("predictions are off by: %s%s" % ("; ".join(errors), floor(flight)))
    if flight.tracking_error is not None:
        parts.append("tracking error %s" % millimetres(flight.tracking_error))
    return "; ".join(parts)


def error(value: Optional[float]) -> str:
    """An error of prediction; None: the motion is not finite."""
    return "not finite" if value is None else number(value)


def off(found: Optional[tale.Off]) -> str:
    """How far predicted poses are off: "56 mm, 16 deg"; None: the motion is not finite."""
    return words.off(PoseError(*found) if found else PoseError(math.inf, math.inf))


def floor(flight: Flown) -> str:
    """What noise leaves on a flight, in parentheses; empty if it is not known."""
    return " (noise floor: %s)" % off(flight.floor) if flight.floor else ""


def millimetres(metres: Optional[float]) -> str:
    """A tracking error [m]; None: not known."""
    return "-" if metres is None else "%.1f mm" % (1e3 * metres)


class Teller:
    """Tells a story sentence by sentence while it happens: what is new in each call, once. What has
    happened before the first call is summed up."""

    def __init__(self, say: Callable[[str], None], model: Optional[_core.Model] = None) -> None:
        """say: gets each sentence; model: the given one."""
        self._say = say
        self._model = model
        self._told: Optional[Set[str]] = None

    def __call__(self, story: Story) -> None:
        """Tells what has happened since the last call."""
        happened = dict(self._lines(story))
        told, self._told = self._told, {*(self._told or ()), *happened}
        if told is None and story.flights:
            text = "%d flights and %.0f s of flight are known already"
            self._say(sentence(text % (len(story.flights), story.flown)))
        for what, line in happened.items():
            if told is not None and what not in told:
                self._say(line)

    def _lines(self, story: Story) -> Iterator[Tuple[str, str]]:
        """All that has happened: what it is, and the line that tells it."""
        findings = {finding.after: finding for finding in story.findings}
        for flown in story.flights:
            number = flown.flight.number
            yield "planned %d" % number, sentence(planned(flown.flight))
            yield "flown %d" % number, "   " + sentence(outcome(flown))
            if number in findings:
                found = findings[number]
                yield "found %d" % number, "   " + sentence(verdict_of(found, self._model))
                if found.open:
                    yield "open %d" % number, "   Open: " + sentence(", ".join(found.open))
        for check in (story.confirmation, story.tracking):
            if check is not None:
                yield check.sentence, "   " + sentence(check.sentence)
        if story.planned:
            yield "planned %d" % story.planned.number, sentence(planned(story.planned))
