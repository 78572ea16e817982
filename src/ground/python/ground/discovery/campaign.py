"""A discovery: flights, a diagnosis after each of them, and the choice of the next one.

What comes next follows from the story and the recordings alone. An interrupted discovery repeats its
diagnoses, then the step that was interrupted, and ends as if nothing had happened. The steps:

1. a reference is tracked with the given model (if asked for),
2. flights look at all effects, then decide what is open, each followed by a diagnosis of all flights
   and, if the controllers take it, the improved model in their place,
3. when no question is open: the reference with the final model, then a confirming flight, which is neither
   chosen by what is known nor fitted to. If the final model does not predict it, it becomes data.
"""

import functools
import itertools
from typing import Callable, List, Optional

from ground import _core
from ground.analysis.horizon import as_document
from ground.analysis.verdict import MISREAD
from ground.checks.quality import repaired
from ground.discovery import analyst, choice, confirmation, tracking
from ground.discovery.analyst import FlightDiagnosis
from ground.discovery.flights import CampaignSettings, Flights
from ground.discovery.laboratory import Laboratory
from ground.discovery.story import CONFIRM, DECIDE, GIVEN, LEFT, LOOK, SLIGHT, TRACK, Finding, Story
from ground.support.progress import Work

LEAVES = ("unexplained", "memory")  # verdicts that leave something to explain
MIN_FLIGHT = 6.0  # shortest flight of an excitation [s]
RESERVED = 20.0  # kept of the budget for the confirming flight [s]
MIN_EXCITATIONS = 2  # excitations before a verdict is sure
FEWEST_VARYING = 4  # excitations that show how much something differs from flight to flight
PATIENCE = 3  # flights in a row that show nothing
LASTING = 2  # findings in a row that leave a verdict unexplained before it is sure


class FlightCampaign(Flights):
    """Finds the physics that a model of a craft in a Laboratory misses.

    folder: keeps all and is gone on from; empty: nothing is kept. told: called with the story at each
    change. threads: 0 for all cores. work: gets the progress of a diagnosis. GroundError when the folder is
    a discovery of another model.
    """

    def __init__(
        self,
        model: _core.Model,
        laboratory: Laboratory,
        settings: Optional[CampaignSettings] = None,
        folder: str = "",
        told: Optional[Callable[[Story], None]] = None,
        choose: choice.Chooser = choice.informed,
        threads: int = 0,
        work: Optional[Work] = None,
    ) -> None:
        super().__init__(model, laboratory, settings or CampaignSettings(), folder, told)
        self.found: Optional[FlightDiagnosis] = None  # by all flights up to self._diagnosed
        self._choose, self._threads, self._work = choose, threads, work
        self._diagnosed = 0
        self._stop = ""

    @functools.cached_property
    def analyst(self) -> analyst.Analyst:
        """Diagnoses the flights. Made when it is needed: its preparation takes seconds."""
        return analyst.Analyst(self.given, self.laboratory.room, self._threads)

    def stop(self, reason: str) -> None:
        """Ends the discovery after what it does now; from any thread."""
        self._stop = reason

    def run(self) -> Story:
        """Flies, diagnoses and flies again, to the end. GroundError when the laboratory cannot fly."""
        while not self.story.ended:
            self._step()
            self._tell("")
        return self.story

    # The next step

    def _step(self) -> None:
        story = self.story
        repeated = [f.after for f in story.findings if f.after > self._diagnosed]
        waiting = max(self._excitations(), default=0)
        if self._stop:
            self._end(self._stop)
        elif self._failed() >= PATIENCE:
            self._end("%d flights in a row could not be used: %s" % (
                PATIENCE, story.flights[-1].stopped or "they were too short",
            ))  # fmt: skip
        elif repeated:
            self._diagnose(repeated[0])
        elif self.settings.track and tracking.flown(story, GIVEN) is None:
            self._track(GIVEN)
        elif waiting > self._diagnosed:
            self._diagnose(waiting)
        elif story.verdict == MISREAD:
            reason = "the recordings seem to be misread: %s" % story.findings[-1].sentences[0]
            self._end(reason, needed="settings without this mistake, and a new folder")
        elif not self._sure():
            self._look()
        elif self.settings.track and tracking.is_due(story):
            self._compare_tracking()
        elif story.verdict in LEAVES:  # nothing is confirmed while something is left
            reason = "the flights show something that no effect of the library explains"
            self._end(reason, needed="an effect that %s" % self.analyst.depends)
        elif story.confirmation is None or not story.confirmation.holds:
            self._confirm()
        else:
            reason = "no flight in this room would change the result, and a test flight confirmed it"
            self._end(reason, sure=True)

    def _excitations(self) -> List[int]:
        """Numbers of the excitations that are fitted to: not the flight that confirms the result."""
        confirmed = self.story.confirmation
        kept = confirmed.flight if confirmed is not None and confirmed.holds else 0
        tracked = [f.flight.number for f in self.story.flights if f.flight.purpose == TRACK]
        return [n for n in self._recordings if n not in (kept, *tracked)]

    def _failed(self) -> int:
        """Number of flights in a row without a usable recording, since it was begun or continued after
        an end."""
        latest = reversed(self.story.flights[self.story.flights_before :])
        return len(list(itertools.takewhile(lambda f: f.flight.number not in self._recordings, latest)))

    def _sure(self) -> bool:
        """Whether no question is left that flights could decide."""
        if self.found is None or len(self._excitations()) < MIN_EXCITATIONS:
            return False
        if self.found.verdict in LEAVES:
            verdicts = [f.verdict for f in self.story.findings[-LASTING:]]
            return len(verdicts) == LASTING and len(set(verdicts)) == 1
        if self.found.conclusion.varies and len(self._excitations()) < FEWEST_VARYING:
            return False
        return not self.found.asked and not self.found.is_left_open

    # Flights

    def _look(self) -> None:
        """Flies what removes most doubt."""
        left = self._left() - RESERVED
        if left < MIN_FLIGHT:
            self._out_of_time()
            return
        self._tell("chooses the next flight")
        found, first = self.found, self.analyst
        state, offers = (first.start, first.first_offers) if found is None else (found.state, found.offers)
        seed = self._seed(len(self.story.flights))
        chosen = self._choose(state, offers, left, seed)
        if found is not None and found.is_left_open and not found.asked:
            chosen = choice.rest(self.given, seed)
        purpose = LOOK if self.found is None else DECIDE
        if self._excite(purpose, chosen.pieces, chosen.why) is None:
            self._out_of_time()

    def _seed(self, flown: int) -> int:
        """Seed of the random inputs of the next flight after some have been flown."""
        return 1000 * self.settings.seed + flown + 1

    def _out_of_time(self) -> None:
        """Ends when the budget is used up; confirms what was found, if nothing else is left and there is
        time for it."""
        found = self.found
        leaves = found is None or found.verdict in LEAVES or found.is_left_open
        if not leaves and self.story.confirmation is None and self._left() > MIN_FLIGHT:
            self._confirm()
            return
        open_still = self._open()
        needed = "a larger budget, to decide on %s" % ", ".join(open_still) if open_still else ""
        if found is not None and found.verdict in LEAVES:
            needed = "an effect that %s" % self.analyst.depends
        self._end("the budget of %g s is used up" % self.story.budget, needed=needed)

    def _open(self) -> List[str]:
        if self.found is None:
            return []
        questions = [question.words for question in self.found.state.open]
        return questions + [LEFT] * self.found.is_left_open

    def _confirm(self) -> None:
        assert self.found is not None
        flown = self._excite(
            CONFIRM,
            choice.confirming(self.given, self._seed(len(self.story.flights))),
            "An independent test flight: both models predict it in advance.",
        )
        if flown is None:
            self._end("no flight time remains for a confirming flight")
            return
        recording = self._recordings.get(flown.flight.number)
        if recording is not None:
            run, model = repaired(recording).data(self.given), self.models[self.story.findings[-1].label]
            self.story.confirmation = confirmation.of(flown, run, self.found, model)

    def _compare_tracking(self) -> None:
        """Flies the reference with the model in use, then decides whether the controllers keep it: only if
        the flights show that it tracks better."""
        story, final = self.story, self.story.in_use
        before, after = (tracking.flown(story, label) for label in (GIVEN, final))
        if after is None and self._left() >= tracking.SECONDS + RESERVED:
            self._track(final)
            if self.found is not None:
                self._judge_flights(self.found.model)
            return
        verdict = tracking.verdict(before, after)
        refused = self._load(GIVEN) if verdict <= 0 else ""
        story.tracking = tracking.check(story, final, verdict, refused)

    # Diagnoses

    def _diagnose(self, last: int) -> None:
        """Diagnoses all flights until the last one; for a finding of an earlier session again, because
        all that follow depend on it."""
        story = self.story
        is_known = any(finding.after == last for finding in story.findings)
        does = "repeats the diagnosis of" if is_known else "diagnoses"
        self._tell("%s flights 1 to %d" % (does, last))
        recordings = [self._recordings[n] for n in sorted(self._recordings) if n <= last]
        misread = self.analyst.misread(recordings)
        if not misread:
            flown = [f.seconds for f in story.flights if f.flight.number <= last]
            reachable = max(0.0, story.budget - sum(flown) - RESERVED)
            seed = self._seed(len(flown))
            self.found = self.analyst.diagnose(recordings, reachable, seed, self._work)
        self._diagnosed = last
        if is_known:
            return
        if story.confirmation is not None and story.confirmation.holds:
            story.confirmation = None  # it was another model's
        if misread:
            story.findings.append(Finding(last, MISREAD, [], {}, [], GIVEN, misread, []))
            return
        found, label = self.found, "after flight %d" % last
        assert found is not None
        self._add_version(label, found.model, last)
        steps = found.diagnosis.steps
        slight = [belief.effect for belief in found.state.beliefs if belief.state == SLIGHT]
        story.findings.append(
            Finding(
                last,
                found.verdict,
                [c.name for c in found.diagnosis.chosen if c.name not in slight],
                {step.added: list(step.group) for step in steps},
                found.state.beliefs,
                label,
                analyst.sentences(found, self.analyst.formulas),
                self._open(),
                dict(found.words),
                as_document(found.conclusion.prediction),
                analyst.does(found),
            )
        )
        self._judge_flights(found.model)
        refused = self._load(label)
        if refused:
            self._tell("the controllers keep the model %s: %s" % (story.in_use, refused))
