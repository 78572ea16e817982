"""A discovery: flights, a diagnosis after each of them, and the choice of the next one.

What comes next follows from the story and the recordings alone. An interrupted discovery repeats its
diagnoses, then the step that was interrupted, and ends as if nothing had happened. The steps:

1. a reference is tracked with the given model (if asked for),
2. flights look at all effects, then decide what is open, each followed by a diagnosis of all flights
   and, if the controllers take it, the improved model in their place,
3. when no question is open: the reference with the final model, and with both in turn until it shows
   which tracks better or PAIRS are flown; then a confirming flight, which is neither chosen
   by what is known nor fitted to. If the final model does not predict it, it becomes data.
"""

import functools
import itertools
from dataclasses import dataclass, replace
from typing import Callable, Dict, List, Mapping, Optional, Sequence

import numpy as np

from ground import _core
from ground.analysis import study
from ground.analysis.conclusion import MISREAD
from ground.annotations import Array
from ground.discovery import analyst, choice, pieces, tracking
from ground.discovery.analyst import Found
from ground.discovery.journal import FIRST, Journal
from ground.discovery.laboratory import Laboratory
from ground.discovery.story import (
    CONFIRM,
    DECIDE,
    GIVEN,
    LEFT,
    LOOK,
    TRACK,
    Confirmation,
    Finding,
    Flight,
    Flown,
    Point,
    Story,
    TrackingCheck,
    Version,
)
from ground.errors import GroundError
from ground.recordings import readers, windows
from ground.recordings.quality import repaired
from ground.recordings.recording import Recording

LIFT_TIME = 0.5  # lift alone before the first thrust [s]
LEAVES = ("unexplained", "memory")  # verdicts that leave something to explain
REFERENCE, SIZE, TRACKING = "rhodonea", 0.6, 15.0  # size: share of the clearance of home; length [s]
PAIRS = 3  # most flights along the reference with each of two models that are compared
SHORTEST = 6.0  # shortest flight of an excitation [s]
RESERVED = 20.0  # kept of the budget for the confirming flight [s]
RETURNS = 2.5  # length of a flight, in lengths of its inputs, where it cannot be predicted
FEWEST = 2  # excitations before a verdict is sure
FEWEST_VARYING = 4  # excitations that show how much something differs from flight to flight
FEWEST_WINDOWS = 2  # windows of a flight that can be used
PATIENCE = 3  # flights in a row that show nothing
LASTING = 2  # findings in a row that leave a verdict unexplained before it is sure
TOLERANCE = 1.1  # largest ratio of a final model's error to those that are expected of it
PATH_STEP = 0.1  # between points of a path [s]
REFUSED = "the controllers refuse the model %s: %s"


@dataclass(frozen=True)
class Settings:
    """How a discovery goes on."""

    budget: float = 180.0  # longest time of flight: none begins that is expected to exceed it [s]
    track: bool = True  # whether a reference is tracked with the given and with the final model
    seed: int = 1  # for random inputs


def _ignore(_: Story) -> None:
    pass


class Discovery:
    """Finds the physics that a model of a craft in a Laboratory misses.

    folder: keeps all and is gone on from; empty: nothing is kept. told: called with the story at each
    change. threads: 0 for all cores. GroundError when the folder is that of another model.
    """

    def __init__(
        self,
        model: _core.Model,
        laboratory: Laboratory,
        settings: Optional[Settings] = None,
        folder: str = "",
        told: Callable[[Story], None] = _ignore,
        chooser: Optional[choice.Chooser] = None,
        threads: int = 0,
    ) -> None:
        self.laboratory, self.settings = laboratory, settings or Settings()
        self.chooser = chooser or choice.Informed()
        self.told, self.given = told, model
        self.journal = Journal(folder)
        self._threads = threads
        self.models: Dict[str, _core.Model] = {GIVEN: model}
        self.found: Optional[Found] = None  # by all flights up to self._diagnosed
        self._diagnosed = 0
        self._stop = ""
        self._recordings: Dict[int, Recording] = {}  # by number of the flight
        self.story = self._continued() or self._begun()

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
        waiting = max(self._excitations(), default=0)
        known = story.findings[-1].after if story.findings else 0
        if self._stop:
            self._end(self._stop)
        elif self._failed() >= PATIENCE:
            self._end("%d flights in a row could not be used: %s" % (
                PATIENCE, story.flights[-1].stopped or "they were too short",
            ))  # fmt: skip
        elif known > self._diagnosed:
            self._repeat_diagnosis()
        elif self.settings.track and not self._tracked(GIVEN):
            self._track(GIVEN)
        elif waiting > self._diagnosed:
            self._diagnose(waiting)
        elif story.verdict == MISREAD:
            self._end("the recordings look misread: %s" % story.findings[-1].sentences[0])
        elif not self._sure():
            self._look()
        elif self._contender():
            self._check_tracking(self._contender())
        elif self.story.verdict in LEAVES:
            self._conclude()  # nothing is confirmed while something is left
        elif story.confirmation is None or not story.confirmation.holds:
            self._confirm()
        else:
            self._conclude()

    def _left(self) -> float:
        return self.story.budget - self.story.flown

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
        return len(
            list(itertools.takewhile(lambda f: f.flight.number not in self._recordings, latest))
        )

    def _tracked(self, label: str) -> int:
        """Number of flights along the reference with a model."""
        flights = self.story.flights
        return sum(f.flight.purpose == TRACK and f.controlled_by == label for f in flights)

    def _contender(self) -> str:
        """Label of a model whose tracking has to be compared with the given one's; empty: none."""
        compared = {GIVEN} if self.story.tracking is None else {GIVEN, self.story.tracking.label}
        tracked = [f.controlled_by for f in self.story.flights if f.flight.purpose == TRACK]
        if self.story.in_use != GIVEN:
            label = self.story.in_use
        else:  # the given model may be in use for a flight of the comparison
            label = next((other for other in reversed(tracked) if other != GIVEN), GIVEN)
        return label if self.settings.track and label not in compared else ""

    def _sure(self) -> bool:
        """Whether no question is left that flights could decide."""
        if self.found is None or len(self._excitations()) < FEWEST:
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
        if left < SHORTEST:
            self._out_of_time()
            return
        self._tell("chooses the next flight")
        found, first = self.found, self.analyst
        state, offers = (
            (first.start, first.first_offers) if found is None else (found.state, found.offers)
        )
        seed = self._seed(len(self.story.flights))
        chosen = self.chooser.choose(state, offers, left, seed)
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
        if not leaves and self.story.confirmation is None and self._left() > SHORTEST:
            self._confirm()
            return
        open_still = self._open()
        needed = "more flight, to decide on %s" % ", ".join(open_still) if open_still else ""
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
            "Neither fit nor choice has seen it: both models predict it beforehand.",
        )
        if flown is None:
            self._end("no time of flight is left for a confirming flight")
            return
        recording = self._recordings.get(flown.flight.number)
        if recording is not None:
            self.story.confirmation = self._confirmed(flown, recording)

    def _confirmed(self, flown: Flown, recording: Recording) -> Confirmation:
        assert self.found is not None
        run = repaired(recording).data(self.given)
        fit = self.found.diagnosis.fit
        varies = bool(self.found.conclusion.varies)
        expected = analyst.expected_errors(run, fit, trimmed=varies)
        flown.floor = float(np.mean(expected))
        given, refitted = flown.errors.get(GIVEN), self._refitted_error(run)
        model = self.models[self.story.findings[-1].label]
        final = analyst.error(run, model)
        known = [error for error in (given, refitted) if error is not None]
        most = TOLERANCE * min([max(expected), *known])
        holds = final is not None and final <= most
        noise = float(study.noise_floor([run], model).sum())
        sentence = (
            "The final model %s: its error is %s, and at most %.3f confirms it; the noise of the poses alone "
            "leaves %.3f. The given model's is %s, refitted to the same flights %s."
            % (
                "predicts the flight" if holds else "does not predict the flight",
                _number(final), most, noise, _number(given), _number(refitted),
            )
        )  # fmt: skip
        return Confirmation(
            flown.flight.number, given, final, flown.floor, holds, sentence, refitted, most
        )

    def _refitted_error(self, run: _core.RunData) -> Optional[float]:
        """Error on a run of the given model, fitted to the flights that the final one is fitted to: the
        smaller of a fit by simulation error and one by likelihood."""
        assert self.found is not None
        errors = [analyst.error(run, refit.model) for refit in self.found.conclusion.refits]
        return min((error for error in errors if error is not None), default=None)

    def _check_tracking(self, final: str) -> None:
        """Flies the reference once more, or decides whether the controllers keep a final model."""
        flown = {label: self._tracks(label) for label in (GIVEN, final)}
        counts = [self._tracked(label) for label in flown]
        verdict = 0.0
        if min(counts) == max(counts):
            verdict = _better(flown[GIVEN], flown[final])
        reserved = RESERVED if min(counts) and self.story.confirmation is None else 0.0
        to_fly = 2 if min(counts) == max(counts) else max(counts) - min(counts)
        left = self._left() - reserved >= to_fly * TRACKING
        if verdict or min(counts) >= PAIRS or not left:
            self._compare(final, flown, verdict)
        elif min(counts) == max(counts):
            self._track(self.story.in_use)  # what is in use need not be loaded
        else:
            self._track(min(flown, key=self._tracked))

    def _tracks(self, label: str) -> List[Flown]:
        """Flights along the reference with a model that show how well it tracks."""
        flights = [f for f in self.story.flights if f.flight.purpose == TRACK]
        known = [f for f in flights if f.tracking_parts or f.stopped]
        return [f for f in known if f.controlled_by == label]

    def _track(self, label: str) -> None:
        """Flies the reference with a model."""
        if self._left() < TRACKING:
            self._end("no time of flight is left to track a reference")
            return
        refused = self._load(label) if label != self.story.in_use else ""
        if refused:
            raise GroundError(REFUSED % (label, refused))
        number = len(self.story.flights) + 1
        size = SIZE * self.laboratory.room.clearance(self.laboratory.room.home)
        which = "given" if label == GIVEN else "final"
        flight = Flight(
            number,
            TRACK,
            "How well does the %s model track a %s?" % (which, REFERENCE),
            TRACKING,
            self._reference(size),
            reference=REFERENCE,
            size=size,
        )
        self._fly(flight, np.empty((0, 0)))
        if self.found is not None:
            self._judge_flights(self.found)

    def _reference(self, size: float) -> List[Point]:
        params = _core.ReferenceParams()
        params.kind, params.size = REFERENCE, size
        params.x, params.y = self.laboratory.room.home
        times = np.arange(0, TRACKING, PATH_STEP)
        return [(float(t), float(x), float(y)) for t, (x, y) in zip(times, params.sample(times))]

    def _compare(self, final: str, flown: Mapping[str, List[Flown]], verdict: float) -> None:
        """Decides which model the controllers keep: the final one only if the flights show that it tracks
        better. verdict: as _better has it."""
        old, new = (_tracking_error(flown[label]) for label in (GIVEN, final))
        kept = final if verdict > 0 else GIVEN
        refused = self._load(kept) if kept != self.story.in_use else ""
        sentence = "Tracking error of the %s: %s with the given model, %s with the final one." % (
            REFERENCE, self._tracking_in_words(GIVEN, old), self._tracking_in_words(final, new),
        )  # fmt: skip
        if not verdict:
            sentence += " It cannot be decided which of them tracks better: %s." % (
                "the difference is not clear beside its spread along %d flights with each"
                % len(flown[final])
                if flown[final] and flown[GIVEN]
                else "a tracking error could not be measured"
                if self._tracked(final) and self._tracked(GIVEN)
                else "no time of flight is left"
            )
        if verdict <= 0:
            sentence += " The controllers have the given model%s." % (
                " again (refused: %s)" % refused if refused else " again"
            )
        self.story.tracking = TrackingCheck(
            REFERENCE, old, new, verdict <= 0, sentence, final, bool(verdict)
        )

    def _tracking_in_words(self, label: str, error: Optional[float]) -> str:
        if error is not None:
            return "%.1f mm" % (1e3 * error)
        if self._tracks(label):
            return "stopped"
        return "not measured" if self._tracked(label) else "not flown"

    def _excite(self, purpose: str, chosen: List[pieces.Piece], why: str) -> Optional[Flown]:
        """Flies as many of the pieces as the budget has time for; None if there is no time for one."""
        number = len(self.story.flights) + 1
        while True:
            rows = pieces.joined(chosen, LIFT_TIME)
            path = self._predicted(rows)
            seconds = path[-1][0] if path else RETURNS * float(rows[-1, 0])
            if seconds <= self._left():
                break
            chosen = chosen[:-1]
            if not chosen:
                return None
        inputs = "flight-%02d.csv" % number
        self.journal.keep_inputs(inputs, list(self.given.channels), rows)
        words = "; ".join(piece.words for piece in chosen)
        why = "%s Inputs: %s." % (why, words)
        flight = Flight(number, purpose, why, seconds, path, inputs)
        return self._fly(flight, rows)

    def _predicted(self, rows: Array) -> List[Point]:
        """Path that the model in use expects; empty where it cannot be simulated."""
        model = self.models[self.story.in_use]
        try:
            return self.laboratory.expected(rows, model)
        except GroundError:
            return []

    def _fly(self, flight: Flight, inputs: Array) -> Flown:
        story = self.story
        story.planned = flight
        self._tell("flies: %s" % flight.why)
        landed = self.laboratory.fly(flight, inputs)
        flown = Flown(flight, landed.file, landed.seconds, story.in_use, landed.stopped)
        flown.rest = list(landed.rest)
        flown.tracking_parts = list(landed.tracking_parts)
        flown.tracking_error = tracking.overall([flown.tracking_parts])
        if landed.recording is not None and self._take(flown, landed.recording):
            run = repaired(self._recordings[flight.number]).data(self.given)
            flown.errors = {label: analyst.error(run, m) for label, m in self.models.items()}
        story.flights.append(flown)
        story.planned = None
        return flown

    def _take(self, flown: Flown, recording: Recording) -> bool:
        """Keeps a recording if it can be used; returns whether it can."""
        recording = replace(recording, name="flight-%02d" % flown.flight.number)
        flown.path = flown.path or _path(recording)
        try:
            run = repaired(recording).data(self.given)
            if len(windows.cut([run])) < FEWEST_WINDOWS:
                raise GroundError("too short: %.1f s are usable" % repaired(recording).usable())
        except GroundError as error:
            if flown.flight.purpose != TRACK:  # its error is unknown: only what stopped it counts
                flown.stopped = flown.stopped or str(error)
            return False
        self._recordings[flown.flight.number] = recording
        return True

    # Diagnoses

    def _diagnose(self, last: int) -> None:
        """Diagnoses all flights until the last one."""
        self._tell("diagnoses flights 1 to %d" % last)
        if self.story.confirmation is not None and self.story.confirmation.holds:
            self.story.confirmation = None  # it was another model's
        misread = self.analyst.misread(self._until(last))
        if misread:
            self._diagnosed = last
            nothing = Finding(self._diagnosed, MISREAD, [], {}, [], GIVEN, misread, [])
            self.story.findings.append(nothing)
            return
        found = self._analysed(last)
        label = "after flight %d" % last
        self._add_version(label, found.model)
        self.story.findings.append(self._finding(found, label))
        self._judge_flights(found)
        refused = self._load(label)
        if refused:
            self._tell("the controllers keep the model %s: %s" % (self.story.in_use, refused))

    def _repeat_diagnosis(self) -> None:
        """Repeats the next diagnosis of an earlier session: all that follow depend on it."""
        finding = next(f for f in self.story.findings if f.after > self._diagnosed)
        if finding.verdict == MISREAD:
            self._diagnosed = finding.after
            return
        self._tell("repeats the diagnosis of flights 1 to %d" % finding.after)
        self._analysed(finding.after)

    def _until(self, last: int) -> List[Recording]:
        """Usable recordings of flights 1 to the last one."""
        return [self._recordings[n] for n in sorted(self._recordings) if n <= last]

    def _analysed(self, last: int) -> Found:
        flown = [f.seconds for f in self.story.flights if f.flight.number <= last]
        reachable = max(0.0, self.story.budget - sum(flown) - RESERVED)
        self.found = found = self.analyst.diagnose(
            self._until(last), reachable, self._seed(len(flown))
        )
        self._diagnosed = last
        return found

    def _judge_flights(self, found: Found) -> None:
        """Sets the floors of flights, which follow from the newest levels of noise and disturbance."""
        for flown in self.story.flights:
            recording = self._recordings.get(flown.flight.number)
            if recording is not None and flown.flight.purpose != CONFIRM:
                run = repaired(recording).data(self.given)
                expected = analyst.expected_errors(run, found.diagnosis.fit, 3)
                flown.floor = float(np.mean(expected))

    def _finding(self, found: Found, label: str) -> Finding:
        return Finding(
            self._diagnosed,
            found.verdict,
            [c.name for c in found.diagnosis.chosen],
            {step.added: list(step.group) for step in found.diagnosis.steps},
            found.state.beliefs,
            label,
            _sentences(found, self.analyst.formulas),
            self._open(),
            dict(found.words),
        )

    def _load(self, label: str) -> str:
        """Gives the controllers a model; returns why they refused it."""
        refused = self.laboratory.load(self.models[label], label)
        if not refused:
            self.story.in_use = label
        return refused

    def _add_version(self, label: str, model: _core.Model) -> None:
        self.models[label] = model
        file = "model-%02d.yaml" % len(self.story.versions)
        self.journal.keep_model(file, model)
        self.story.versions.append(Version(label, file, list(model.effects), self._diagnosed))

    # The story

    def _begun(self) -> Story:
        self.story = Story(self.given.name, self.laboratory.room.name, self.settings.budget)
        self.journal.begin(self.given)
        self.story.versions.append(Version(GIVEN, FIRST, list(self.given.effects), 0))
        self.journal.keep(self.story)
        return self.story

    def _continued(self) -> Optional[Story]:
        """The story of the folder; reads its recordings and models. GroundError when the controllers
        refuse the model that was in use."""
        story = self.journal.story()
        if story is None:
            return None
        self.story = story
        for version in story.versions:
            self.models[version.label] = self.journal.model(version.file)
        if self.models[GIVEN].format() != self.given.format():
            raise GroundError(
                "%s is the discovery of another model: name a new folder" % self.journal.folder
            )
        if story.sure:
            return story
        story.budget = max(story.budget, self.settings.budget)
        for flown in story.flights:
            if flown.recording:
                self._take(flown, readers.read(self.journal.path(flown.recording)))
        if story.ended:  # stopped, or out of time
            story.flights_before = len(story.flights)
        story.ended, story.reason, story.needed, story.planned = False, "", "", None
        if story.flights:
            self.laboratory.resume(story.flights[-1].rest)
        if len(self.models) > 1:  # the last one that was loaded may not be in the story
            refused = self._load(story.in_use)
            if refused and story.in_use != GIVEN:
                raise GroundError(REFUSED % (story.in_use, refused))
        return story

    def _tell(self, activity: str) -> None:
        self.story.activity = activity
        self.journal.keep(self.story)
        self.told(self.story)

    def _end(self, reason: str, sure: bool = False, needed: str = "") -> None:
        self.story.reason, self.story.sure, self.story.needed = reason, sure, needed
        self.story.planned, self.story.ended = None, True

    def _conclude(self) -> None:
        """Ends with a verdict that no flight is expected to change; not sure while something is left."""
        if self.story.verdict in LEAVES:
            reason = "flights go on to show something that no effect of the library explains"
            self._end(reason, needed="an effect that %s" % self.analyst.depends)
        else:
            self._end(
                "no question is open that a flight in this room could decide, and a flight has "
                "confirmed it",
                sure=True,
            )


def _sentences(found: Found, formulas: Mapping[str, Mapping[str, str]]) -> List[str]:
    """What a diagnosis says, in a few sentences. formulas: of effects that the library does not have."""
    chosen = [c.name for c in found.diagnosis.chosen]
    errors = found.conclusion.heldout
    said = []
    for name in found.words:
        parts = ["%s = %s" % part for part in sorted(formulas[name].items())]
        said.append("The library does not have %s: %s." % (name, ", ".join(parts)))
    if found.conclusion.memory is not None:
        said.append("Memory: %s." % found.conclusion.memory.means)
    if found.conclusion.varies:
        names = [str(v["parameter"]) for v in found.conclusion.varies]
        said.append("Differs from flight to flight: %s." % ", ".join(names))
    if chosen:
        said.append(
            "The error on held-out flights is %.3f with what was found, and %.3f with the given model, "
            "refitted." % (errors[-1], errors[0])
        )
    return said


def _path(recording: Recording) -> List[Point]:
    times = recording.pose_times - recording.pose_times[0]
    at = np.searchsorted(times, np.arange(0, times[-1], PATH_STEP))
    at = np.minimum(at, len(times) - 1)
    return [(float(times[i]), float(recording.eta[i, 0]), float(recording.eta[i, 1])) for i in at]


def _number(value: Optional[float]) -> str:
    return "not finite" if value is None else "%.3f" % value


def _better(given: Sequence[Flown], final: Sequence[Flown]) -> float:
    """1 if flights show that the final model tracks better than the given one, -1 if worse, 0 if they do
    not show it. A flight that was stopped decides."""
    if not given or not final:
        return 0.0
    if any(f.stopped for f in final):
        return -1.0
    if any(f.stopped for f in given):
        return 1.0
    clear = tracking.evidence(
        [f.tracking_parts for f in given], [f.tracking_parts for f in final]
    )
    return float(np.sign(clear)) if abs(clear) > tracking.CLEAR else 0.0


def _tracking_error(flights: Sequence[Flown]) -> Optional[float]:
    """Root mean square error of flights along the reference [m]; None where one was stopped, or
    nothing was measured."""
    if any(f.stopped for f in flights):
        return None
    return tracking.overall([f.tracking_parts for f in flights])
