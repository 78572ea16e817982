"""Which of two models tracks a reference better, by a flight along it with each.

Noise and disturbance differ from flight to flight, so that the smaller of two errors says little where both
are small. Errors are therefore compared part by part of the reference: the spread of their ratio shows what
chance does. With log ratios, a part with large errors counts no more than others.
"""

from typing import List, Optional, Sequence

import numpy as np

from ground import _core
from ground.discovery.story import GIVEN, TRACK, Flight, Flown, Story, TrackingCheck
from ground.support.annotations import Array

REFERENCE, SIZE, SECONDS = "rhodonea", 0.6, 15.0  # size: share of the clearance of home; length [s]
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


def flown(story: Story, label: str) -> Optional[Flown]:
    """The last flight along the reference with the model of a label."""
    found = [f for f in story.flights if f.flight.purpose == TRACK and f.controlled_by == label]
    return found[-1] if found else None


def is_due(story: Story) -> bool:
    """Whether the tracking of the model in use has to be compared with the given one's."""
    judged = GIVEN if story.tracking is None else story.tracking.label
    return story.in_use not in (GIVEN, judged)


def verdict(before: Optional[Flown], after: Optional[Flown]) -> int:
    """1 if flights show that the final model tracks better than the given one, -1 if worse, 0 if they do
    not show it. A flight that was stopped decides; one whose errors are not known says nothing."""
    if before is None or after is None:
        return 0
    if before.stopped or after.stopped:
        return -1 if after.stopped else 1
    if not before.tracking_parts or not after.tracking_parts:
        return 0
    clear = evidence(before.tracking_parts, after.tracking_parts)
    return int(np.sign(clear)) if abs(clear) > CLEAR else 0


def check(story: Story, final: str, verdict: int, refused: str) -> TrackingCheck:
    """The outcome of a comparison. verdict: as `verdict` has it; refused: why the controllers did not
    take the given model back."""
    pair = [flown(story, label) for label in (GIVEN, final)]
    sentence = "Tracking error of the %s: %s with the given model, %s with the final one." % (
        REFERENCE, *map(_in_words, pair),
    )  # fmt: skip
    if not verdict:
        sentence += " It cannot be decided which of them tracks better."
    if verdict <= 0:
        sentence += " The controllers have the given model again"
        sentence += " (refused: %s)." % refused if refused else "."
    old, new = (f.tracking_error if f and not f.stopped else None for f in pair)
    return TrackingCheck(REFERENCE, old, new, verdict <= 0, sentence, final, bool(verdict))


def _in_words(tracked: Optional[Flown]) -> str:
    if tracked is None:
        return "not flown"
    if tracked.stopped or tracked.tracking_error is None:
        return "stopped" if tracked.stopped else "not measured"
    return "%.1f mm" % (1e3 * tracked.tracking_error)


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


def overall(parts: Sequence[float]) -> Optional[float]:
    """Root mean square error of a flight [m], by its errors in parts; None without a part."""
    return float(np.sqrt(np.square(parts).mean())) if len(parts) else None


def evidence(before: Sequence[float], after: Sequence[float]) -> float:
    """By how many standard errors the errors of a flight are smaller after a change than before; errors in
    PARTS parts of each flight [m]."""
    gains = np.log(np.divide(before, after))
    return float(gains.mean() / max(gains.std(ddof=1) / np.sqrt(PARTS), 1e-12))
