"""Which of two models tracks a reference better, by flights along it.

Noise and disturbance differ from flight to flight, so that the smaller of two errors says little where both
are small. Errors are therefore compared part by part of the reference: the spread of their ratio shows what
chance does. With log ratios, a part with large errors counts no more than others.
"""

from typing import List, Optional, Sequence

import numpy as np

from ground import _core
from ground.annotations import Array
from ground.discovery.story import GIVEN, TRACK, Flight, Flown, Story, TrackingCheck

REFERENCE, SIZE, SECONDS = "rhodonea", 0.6, 15.0  # size: share of the clearance of home; length [s]
PAIRS = 3  # most flights with each of two models that are compared
SETTLING = 6.0  # time after which errors count [s]
PARTS = 9  # parts of the reference, long enough to be nearly independent
CLEAR = 2.5  # least mean of the log ratio by which a model is better, in its standard errors
PATH_STEP = 0.1  # between points of a path [s]


def planned(number: int, label: str, room: _core.RoomPlan) -> Flight:
    """The flight of this number along the reference with a model. label: the model's."""
    params = _core.ReferenceParams()
    params.kind, params.size = REFERENCE, SIZE * room.clearance(room.home)
    params.x, params.y = room.home
    times = np.arange(0, SECONDS, PATH_STEP)
    path = [(float(t), float(x), float(y)) for t, (x, y) in zip(times, params.sample(times))]
    which = "given" if label == GIVEN else "final"
    why = "How well does the %s model track a %s?" % (which, REFERENCE)
    return Flight(number, TRACK, why, SECONDS, path, reference=REFERENCE, size=params.size)


def flights(story: Story, label: str = "") -> List[Flown]:
    """The flights along the reference, with any model or that of a label."""
    tracked = [flown for flown in story.flights if flown.flight.purpose == TRACK]
    return [flown for flown in tracked if label in ("", flown.controlled_by)]


def contender(story: Story) -> str:
    """Label of a model whose tracking has to be compared with the given one's; empty: none."""
    label = story.in_use
    if label == GIVEN:  # it may be in use for a flight of the comparison
        others = [f.controlled_by for f in flights(story) if f.controlled_by != GIVEN]
        label = others[-1] if others else ""
    return "" if story.tracking is not None and story.tracking.label == label else label


def verdict(story: Story, final: str) -> int:
    """1 if flights show that a final model tracks better than the given one, -1 if worse, 0 if they do
    not show it. A flight that was stopped decides; one whose errors are not known says nothing."""
    given, later = flights(story, GIVEN), flights(story, final)
    for tracked, found in ((later, -1), (given, 1)):
        if later and given and any(f.stopped for f in tracked):
            return found
    before, after = ([f.tracking_parts for f in tracked if f.tracking_parts] for tracked in (given, later))
    if not before or not after:
        return 0
    clear = evidence(before, after)
    return int(np.sign(clear)) if abs(clear) > CLEAR else 0


def check(story: Story, final: str, verdict: int, refused: str) -> TrackingCheck:
    """The outcome of a comparison. verdict: as `verdict` has it; refused: why the controllers did not
    take the given model back."""
    old, new = (_error(flights(story, label)) for label in (GIVEN, final))
    sentence = "Tracking error of the %s: %s with the given model, %s with the final one." % (
        REFERENCE, _in_words(flights(story, GIVEN), old), _in_words(flights(story, final), new)
    )  # fmt: skip
    if not verdict:
        count = len(flights(story, final))
        why = "%d flight%s with each do not show it" % (count, "s" * (count > 1))
        why = why if old is not None and new is not None else "a tracking error is not known"
        sentence += " It cannot be decided which of them tracks better: %s." % why
    if verdict <= 0:
        sentence += " The controllers have the given model again"
        sentence += " (refused: %s)." % refused if refused else "."
    return TrackingCheck(REFERENCE, old, new, verdict <= 0, sentence, final, bool(verdict))


def _error(flown: Sequence[Flown]) -> Optional[float]:
    """Root mean square error of flights [m]; None where one was stopped, or nothing was measured."""
    return None if any(f.stopped for f in flown) else overall([f.tracking_parts for f in flown])


def _in_words(flown: Sequence[Flown], error: Optional[float]) -> str:
    if error is not None:
        return "%.1f mm" % (1e3 * error)
    stopped = any(f.stopped for f in flown)
    return "stopped" if stopped else "not measured" if flown else "not flown"


def in_parts(times: Array, distances: Array) -> List[float]:
    """Root mean square distances from a reference in PARTS parts of equal time [m]; empty where a part has
    none. times: (n,) since the reference began [s]; distances: (n,) [m]."""
    if not len(times) or times[-1] <= SETTLING:
        return []
    edges = np.linspace(SETTLING, times[-1], PARTS + 1)
    part = np.minimum(np.searchsorted(edges, times, side="right") - 1, PARTS - 1)
    counts = [np.count_nonzero(part == i) for i in range(PARTS)]
    if not all(counts):
        return []
    return [float(np.sqrt((distances[part == i] ** 2).mean())) for i in range(PARTS)]


def overall(flights: Sequence[Sequence[float]]) -> Optional[float]:
    """Root mean square error of some flights [m], by their errors in parts; None without a part."""
    squares = np.square([error for parts in flights for error in parts])
    return float(np.sqrt(squares.mean())) if len(squares) else None


def evidence(before: Sequence[Sequence[float]], after: Sequence[Sequence[float]]) -> float:
    """By how many standard errors the errors of flights are smaller after a change than before; errors in
    parts of each flight (flights, PARTS) [m]."""
    squares = [np.square(flights).mean(axis=0) for flights in (before, after)]
    gains = 0.5 * np.log(squares[0] / squares[1])
    error = gains.std(ddof=1) / np.sqrt(PARTS)
    return float(gains.mean() / max(error, 1e-12))
