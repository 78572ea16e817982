"""A discovery in sentences."""

from typing import Callable, Iterator, List, Mapping, Optional, Set, Tuple

from ground import _core
from ground.analysis import candidates
from ground.discovery import story as tale
from ground.discovery.story import Finding, Flight, Flown, Story
from ground.reports.words import listed, number, sentence

PURPOSES = {
    tale.LOOK: "looks at everything that the library could explain",
    tale.DECIDE: "decides between what is still open",
    tale.CONFIRM: "confirms the result on a flight that neither fit nor choice has seen",
    tale.TRACK: "follows a reference, to see whether the model makes tracking better",
}
VERDICTS = {  # for a finding without effects
    "complete": "nothing is missing",
    "missing": "nothing is missing",  # as long as no effect is named
    "varies": "no effect is missing, but a trim or the thrust differs between flights",
    "memory": "something is missing that depends on the past",
    "unexplained": "something is missing that no effect tried explains",
    "undecided": "these flights cannot decide whether something is missing",
    "misread": "the recordings look misread, so no effect is blamed",
}
RESTS = ("varies", "memory", "unexplained", "undecided")  # verdicts that say something beside the effects


def summary(story: Story, model: Optional[_core.Model] = None) -> List[str]:
    """Sentences: the verdict, the time of flight, the confirmation, tracking, why it ended. model: the
    given one, which knows effects of single thrusters in words."""
    found = [verdict(story, model)] + [effort(story)] * bool(story.flights)
    if story.confirmation:
        found.append(story.confirmation.sentence)
    elif story.ended:
        found.append("the result was not confirmed by a flight of its own")
    if story.tracking:
        found.append(story.tracking.sentence)
    if story.ended:
        found.append(end(story))
    return [sentence(text) for text in found]


def verdict(story: Story, model: Optional[_core.Model] = None) -> str:
    """The verdict of the last finding."""
    if not story.findings:
        return "no flight has been diagnosed" + ("" if story.ended else " yet")
    return ("" if story.ended else "so far: ") + verdict_of(story.findings[-1], model)


def verdict_of(finding: Finding, model: Optional[_core.Model] = None) -> str:
    """The verdict of a finding, its effects in words with their names beside."""
    groups = [[n] + [o for o in finding.groups.get(n, []) if o != n] for n in finding.effects]
    rest, is_left = VERDICTS.get(finding.verdict, finding.verdict), tale.LEFT in finding.open
    if is_left and finding.verdict not in RESTS:
        rest = "something is left that is not shown to be chance"
    known = [name for group in groups for name in group]
    proposed = [in_words(name, finding.words) for name in finding.words if name not in known]
    if proposed:
        rest += ": it may be " + ", or ".join(proposed)
    if not finding.effects or finding.verdict == "misread":
        return rest
    named = [", or ".join(in_words(n, finding.words, model) for n in group) for group in groups]
    text = "%s %s missing" % (listed(named), "is" if len(named) == 1 else "are")
    if any(len(group) > 1 for group in groups):
        alike = [" and ".join(group) for group in groups if len(group) > 1]
        text += "; these flights do not distinguish " + ", nor ".join(alike)
    if finding.verdict in RESTS or is_left:
        text += "; beside that, " + rest
    return text


def in_words(name: str, own: Mapping[str, str], model: Optional[_core.Model] = None) -> str:
    """An effect in words, with its name beside. own: words of effects that the library does not have;
    model: the given one."""
    return "%s (%s)" % (own[name], name) if name in own else candidates.in_words(name, model)


def effort(story: Story) -> str:
    """The time of flight."""
    count = len(story.flights)
    return "this took %.0f s of flight in %d flight%s, of at most %.0f s" % (
        story.flown,
        count,
        "" if count == 1 else "s",
        story.budget,
    )


def end(story: Story) -> str:
    """Why it ended, and whether the result is sure."""
    sure = "the result is sure" if story.sure else "the result is not sure"
    return "%s: %s" % (sure, story.reason) if story.reason else sure


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
        errors = ["%s %s" % (label, error(flight.errors[label])) for label in labels]
        floor = "" if flight.floor is None else ", floor %s" % number(flight.floor)
        parts.append("error of prediction: %s%s" % (", ".join(errors), floor))
    if flight.tracking_error is not None:
        parts.append("tracking error %s" % millimetres(flight.tracking_error))
    return "; ".join(parts)


def error(value: Optional[float]) -> str:
    """An error of prediction; None: the motion is not finite."""
    return "not finite" if value is None else number(value)


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
