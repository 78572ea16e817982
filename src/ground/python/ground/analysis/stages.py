"""Stages of a diagnosis, and how many units of each are to be expected."""

from dataclasses import dataclass, field

from ground.analysis.next_experiment import CHOOSING, MAX_REFITTED, REFITTING, choices
from ground.progress import Work

FITTING = "fitting the model as it is"
SEARCHING = "searching for missing effects"  # unit: a set of effects that is refitted
TESTING = "testing effects on held-out data"  # unit: an effect
REMEMBERING = "testing whether the motion depends on the past"
ORDERING = "ordering the effects"  # unit: an effect
RIVALS = "looking for effects that could replace them"  # unit: an effect
LEAVING = "testing what the model leaves"
ERRORS = "errors of the best effects"
REPEATING = "repeating the search without each part of the data"

# Usual costs of a unit [s]: of SAMPLES poses in three runs with eight missing effects, on two processors
COSTS = {
    FITTING: 1.2,
    SEARCHING: 0.35,
    TESTING: 0.5,
    REMEMBERING: 3.0,
    ORDERING: 0.15,
    RIVALS: 0.35,
    LEAVING: 1.4,
    ERRORS: 2.0,
    CHOOSING: 0.06,
    REFITTING: 0.8,
}
SAMPLES = 7000
ROUND = 7  # sets of effects that a round of the search usually refits
SWAPPED = 1.5  # sets that are refitted for each effect found, in its place
REPEATED = 1.0  # time of the repeated search in all parts, over that of the search


@dataclass
class Plan:
    """What is expected of a diagnosis; it grows more certain as the search goes on."""

    work: Work = field(default_factory=Work)
    samples: int = SAMPLES  # poses that are diagnosed

    def _expect(self, what: str, units: int, at_most: bool = False) -> None:
        self.work.expect(what, units, COSTS[what] * self.samples / SAMPLES, at_most)

    def begin(self) -> None:
        """Plans all stages before anything is known."""
        self._expect(FITTING, 1)
        self._expect(SEARCHING, 3 * ROUND, at_most=True)
        self._expect(LEAVING, 1)
        self._expect(ERRORS, 1)
        self._effects(2, at_most=True)

    def round(self, sets: int, coming: int, found: int) -> None:
        """A round of the search begins. sets: number of sets to refit in it; coming: effects that are
        expected to be found in this and later rounds; found: effects found so far."""
        effects = coming + found
        self.work.more(sets + coming * max(1, sets) + round(SWAPPED * effects), at_most=True)
        self._effects(effects, at_most=True)

    def swaps(self, found: int) -> None:
        """The search tries others in the place of the effects found."""
        self.work.more(round(SWAPPED * found), at_most=True)

    def found(self, count: int) -> None:
        """The search has ended with so many effects."""
        self._effects(count, at_most=False)
        seconds = REPEATED * self.work.spent(SEARCHING) if count else 0.0
        self.work.expect(REPEATING, 1, seconds, scaled=False)

    def tested(self, left: int, refused: int) -> None:
        """All of `left` effects have been tested; each pass leaves out one of those refused."""
        passes = range(left - refused, left) if refused else ()
        self.work.more(sum(passes))

    def planned(self) -> None:
        """The next experiment is planned, or there is nothing to plan it for."""
        for what in (CHOOSING, REFITTING):
            self.work.expect(what, 0)

    def _effects(self, count: int, at_most: bool) -> None:
        """Plans what depends on the number of effects."""
        units = {
            TESTING: 2 * count,
            REMEMBERING: 1,
            ORDERING: count,
            RIVALS: count,
            CHOOSING: len(list(choices())) if count else 0,
            REFITTING: MAX_REFITTED if count else 0,
        }
        for what, number in units.items():
            self._expect(what, number, at_most)
        searched = COSTS[SEARCHING] * self.samples / SAMPLES * ROUND * (count + 1)
        self.work.expect(REPEATING, min(1, count), REPEATED * searched, at_most)
