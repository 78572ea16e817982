"""The story of a discovery: its flights, what each of them has shown, and the models that it found.

Plain values, which the journal, the page, and the topics of the node share.
"""

import dataclasses
from dataclasses import dataclass, field
from typing import Any, Dict, List, Optional, Tuple, Union, get_args, get_origin, get_type_hints

from ground.support import records

SCHEMA = "ground/discovery/1"

# Purposes of a flight
LOOK = "look"  # at everything that the library could explain
DECIDE = "decide"  # between what is still open
CONFIRM = "confirm"  # the result, by an independent test flight
TRACK = "track"  # a reference, to see whether a model makes tracking better

# States of the belief in an effect
OPEN, PRESENT, ABSENT = "open", "present", "absent"
HIDDEN = "not identifiable"  # no flight in this room shows it or distinguishes it from others
SLIGHT = "too small to matter"  # it acts, but moves the craft by less than the poses' noise

LEFT = "what is left"  # the question what no effect explains
GIVEN = "given"  # label of the model that a discovery begins with

Point = Tuple[float, float, float]  # time since the flight began [s], x, y [m], world_ned
Off = Tuple[float, float]  # root mean square error of predicted poses: position [mm], heading [deg]


@dataclass(frozen=True)
class Belief:
    """Belief in an effect after some flights."""

    effect: str
    probability: float  # that it acts on the craft and matters
    state: str  # OPEN, PRESENT, ABSENT, HIDDEN or SLIGHT
    visibility: float  # expected 2 ln L of the effect at the size that matters, in all flights so far
    # Change of the motion by the effect, as it is estimated, relative to the error without effects
    share: Optional[float]  # None: not known


@dataclass(frozen=True)
class Flight:
    """A flight that is planned."""

    number: int  # from 1
    purpose: str
    why: str  # a sentence
    duration: float  # predicted [s]
    path: List[Point] = field(default_factory=list)  # predicted with the model in use
    inputs: str = ""  # CSV file of inputs, in the folder of the story; empty when tracking
    reference: str = ""  # kind of reference when tracking
    size: float = 0.0  # the reference's [m]


@dataclass
class Flown:
    """A flight that was flown."""

    flight: Flight
    recording: str  # file in the folder of the story; empty if it was not kept
    seconds: float  # time with the lift on [s]
    controlled_by: str  # label of the model in the controller
    stopped: str = ""  # why it ended early; empty if it did not
    path: List[Point] = field(default_factory=list)  # measured
    # Errors of the models that were there before the flight, by label; None: not finite
    errors: Dict[str, Optional[Off]] = field(default_factory=dict)
    floor: Optional[Off] = None  # the error that noise of the poses leaves to a true model
    tracking_error: Optional[float] = None  # root mean square, when tracking [m]; None: not measured
    tracking_parts: List[float] = field(default_factory=list)  # the same in parts of the reference
    rest: List[float] = field(default_factory=list)  # as in Landed


@dataclass(frozen=True)
class Version:
    """A model of the story."""

    label: str  # GIVEN, or "after flight 3"
    file: str  # in the folder of the story
    effects: List[str]
    after: int  # number of the last flight that it was fitted to; 0: the given model


@dataclass(frozen=True)
class Finding:
    """What a diagnosis of all flights so far has found."""

    after: int  # number of the last flight
    verdict: str  # as of a diagnosis: complete, missing, varies, memory, unexplained, undecided or misread
    effects: List[str]
    groups: Dict[str, List[str]]  # effects that cannot be distinguished from a found one, itself first
    beliefs: List[Belief]
    label: str  # the improved model's
    sentences: List[str]  # the diagnosis in words
    open: List[str]  # questions that are still open, in words
    # What effects mean that the library does not have: those found and those proposed
    words: Dict[str, str] = field(default_factory=dict)
    # horizon.PredictionError as a dictionary, of the diagnosis; None: not known
    prediction: Optional[Dict[str, object]] = None
    # What the effects found do with their values, a clause for each of the library; journals of release 1.0.0
    # do not have it
    does: Dict[str, str] = field(default_factory=dict, metadata={records.ABSENT: {}})


@dataclass(frozen=True)
class Confirmation:
    """Prediction of the confirming flight, by the given and the final model."""

    flight: int
    given: Optional[float]  # mean |e|/s; None: not finite
    final: Optional[float]
    floor: float
    holds: bool
    sentence: str
    refitted: Optional[float]  # with the given model, fitted to the same flights; None: not finite
    most: float  # largest error of the final model that confirms it


@dataclass(frozen=True)
class TrackingCheck:
    """Tracking with the given and with the final model."""

    reference: str
    before: Optional[float]  # root mean square error [m]; None: stopped or not measured
    after: Optional[float]
    taken_back: bool  # whether the controller has the given model again
    sentence: str
    label: str  # the final model's
    decided: bool  # whether the flights show which of the models tracks better


@dataclass
class Story:
    """A discovery, from its beginning until now."""

    craft: str  # name of the given model
    room: str
    budget: float  # longest time of flight [s]
    horizon: float = 0.0  # time after which predicted poses are compared [s]; 0: no flight has shown it yet
    versions: List[Version] = field(default_factory=list)
    flights: List[Flown] = field(default_factory=list)
    findings: List[Finding] = field(default_factory=list)
    planned: Optional[Flight] = None  # the next flight
    in_use: str = GIVEN  # label of the model in the controller
    activity: str = ""  # what happens now, in words
    confirmation: Optional[Confirmation] = None
    tracking: Optional[TrackingCheck] = None
    ended: bool = False
    sure: bool = False  # whether nothing is open that a flight could show
    reason: str = ""  # why it ended
    needed: str = ""  # what would be needed to go on; empty if nothing
    flights_before: int = 0  # number of flights when it was last continued after its end

    @property
    def flown(self) -> float:
        """Time of flight so far [s]."""
        return sum(flown.seconds for flown in self.flights)

    @property
    def verdict(self) -> str:
        """The verdict of the last finding; empty before the first."""
        return self.findings[-1].verdict if self.findings else ""

    def version(self, label: str) -> Version:
        """The Version of a label."""
        return next(version for version in self.versions if version.label == label)

    def to_dict(self) -> Dict[str, object]:
        """Plain values, as journal.json has them."""
        return {"schema": SCHEMA, **dataclasses.asdict(self)}

    @staticmethod
    def from_dict(document: object) -> "Story":
        """The Story of plain values; KeyError or TypeError when they are not a story's."""
        found: Story = _read(Story, document)
        return found


def _read(kind: Any, value: Any) -> Any:
    """A value of a type, from plain values. Every field has to be there that may not be absent."""
    if dataclasses.is_dataclass(kind):
        kinds = get_type_hints(kind)
        own = [
            f.name for f in dataclasses.fields(kind) if f.name in value or records.ABSENT not in f.metadata
        ]
        return kind(**{name: _read(kinds[name], value[name]) for name in own})
    parts = get_args(kind)
    if get_origin(kind) is list:
        return [_read(parts[0], item) for item in value]
    if get_origin(kind) is Union:  # an Optional
        return None if value is None else _read(parts[0], value)
    return tuple(value) if get_origin(kind) is tuple else value
