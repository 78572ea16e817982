"""The flights of a discovery, and the folder that keeps them."""

import contextlib
from dataclasses import dataclass, replace
from typing import Callable, Dict, List, Optional

import numpy as np

from ground import _core
from ground.analysis import horizon, windows
from ground.checks.quality import repaired
from ground.discovery import analyst, pieces, tracking
from ground.discovery.journal import FIRST, Journal
from ground.discovery.laboratory import Laboratory
from ground.discovery.story import CONFIRM, GIVEN, TRACK, Flight, Flown, Off, Point, Story, Version
from ground.reading import readers
from ground.reading.recording import Recording
from ground.support.annotations import Array
from ground.support.errors import GroundError

LIFT_TIME = 0.5  # lift alone before the first thrust [s]
RETURNS = 2.5  # length of a flight, in lengths of its inputs, where it cannot be predicted
FEWEST_WINDOWS = 2  # windows of a flight that can be used
REFUSED = "the controllers refuse the model %s: %s"


@dataclass(frozen=True)
class CampaignSettings:
    """How a discovery goes on."""

    budget: float = 180.0  # longest time of flight: none begins that is expected to exceed it [s]
    track: bool = True  # whether a reference is tracked with the given and with the final model
    seed: int = 1  # for random inputs


class Flights:
    """Flies for a story, and keeps what was flown, so that it can be gone on with. See Discovery."""

    def __init__(
        self,
        model: _core.Model,
        laboratory: Laboratory,
        settings: CampaignSettings,
        folder: str,
        told: Optional[Callable[[Story], None]],
    ) -> None:
        self.laboratory, self.settings = laboratory, settings
        self.told, self.given = told, model
        self.journal = Journal(folder)
        self.models: Dict[str, _core.Model] = {GIVEN: model}
        self._recordings: Dict[int, Recording] = {}  # by number of the flight
        self.story = self._continued() or self._begun()

    def _left(self) -> float:
        return self.story.budget - self.story.flown

    def _track(self, label: str) -> None:
        """Flies the reference with a model."""
        if self._left() < tracking.SECONDS:
            self._end("no flight time remains to track a reference")
            return
        refused = self._load(label) if label != self.story.in_use else ""
        if refused:
            raise GroundError(REFUSED % (label, refused))
        number = len(self.story.flights) + 1
        self._fly(tracking.planned(number, label, self.laboratory.room), np.empty((0, 0)))

    def _excite(self, purpose: str, chosen: List[pieces.Piece], why: str) -> Optional[Flown]:
        """Flies as many of the pieces as the budget has time for; None if there is no time for one."""
        number = len(self.story.flights) + 1
        while True:
            rows = pieces.joined(chosen, LIFT_TIME)
            path: List[Point] = []
            with contextlib.suppress(GroundError):  # it cannot be simulated
                path = self.laboratory.expected(rows, self.models[self.story.in_use])
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

    def _fly(self, flight: Flight, inputs: Array) -> Flown:
        story = self.story
        story.planned = flight
        self._tell("flies: %s" % flight.why)
        landed = self.laboratory.fly(flight, inputs)
        flown = Flown(flight, landed.file, landed.seconds, story.in_use, landed.stopped)
        flown.rest = list(landed.rest)
        flown.tracking_parts = list(landed.tracking_parts)
        flown.tracking_error = tracking.overall(flown.tracking_parts)
        if landed.recording is not None and self._take(flown, landed.recording):
            run = repaired(self._recordings[flight.number]).data(self.given)
            story.horizon = story.horizon or horizon.horizon([run], self.given)
            flown.errors = {label: self._off(run, m) for label, m in self.models.items()}
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

    def _judge_flights(self, model: _core.Model) -> None:
        """Sets the floors of flights, by the newest model."""
        for flown in self.story.flights:
            recording = self._recordings.get(flown.flight.number)
            if recording is not None and flown.flight.purpose != CONFIRM:
                run = repaired(recording).data(self.given)
                with contextlib.suppress(GroundError):  # too short, or a motion is not finite
                    flown.floor = analyst.expected_off(run, model, self.story.horizon)

    def _off(self, run: _core.RunData, model: _core.Model) -> Optional[Off]:
        """How far the poses are off that a model predicts along a run."""
        with contextlib.suppress(GroundError):  # the run is too short
            return analyst.off(run, model, self.story.horizon)
        return None

    def _load(self, label: str) -> str:
        """Gives the controllers a model; returns why they refused it."""
        refused = self.laboratory.load(self.models[label], label)
        if not refused:
            self.story.in_use = label
        return refused

    def _add_version(self, label: str, model: _core.Model, after: int) -> None:
        self.models[label] = model
        file = "model-%02d.yaml" % len(self.story.versions)
        self.journal.keep_model(file, model)
        self.story.versions.append(Version(label, file, list(model.effects), after))

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
                "%s contains the discovery of another model: name a new folder" % self.journal.folder
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
        if self.told:
            self.told(self.story)

    def _end(self, reason: str, sure: bool = False, needed: str = "") -> None:
        self.story.reason, self.story.sure, self.story.needed = reason, sure, needed
        self.story.planned, self.story.ended = None, True


def _path(recording: Recording) -> List[Point]:
    times = recording.pose_times - recording.pose_times[0]
    at = np.searchsorted(times, np.arange(0, times[-1], tracking.PATH_STEP))
    at = np.minimum(at, len(times) - 1)
    return [(float(times[i]), float(recording.eta[i, 0]), float(recording.eta[i, 1])) for i in at]
