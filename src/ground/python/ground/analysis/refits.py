"""Fits of a set of effects that is extended by others: pieces of work that any worker can do."""

from dataclasses import dataclass
from typing import FrozenSet, Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis.candidates import Candidate
from ground.analysis.window_error import free_parameters
from ground.analysis.likelihood import Fit, Likelihood
from ground.analysis.score_tests import ScoreTests, stepped
from ground.errors import GroundError
from ground.recordings import windows

STEPS = (1.0, 0.3, 0.1)  # parts of the score test's step that refits start from
SIZES = (0.5, 0.2, -0.2)  # start values of an effect that score tests cannot see, over its typical size
WINDOWS = 40  # on which far starts are tried by simulation error
MAX_FAR_ERROR = 0.98  # largest error from a far start, relative to the neutral one, for a fit


@dataclass(frozen=True)
class Fitting:
    """What all fits of sets of effects need: a model, and the effects by name."""

    likelihood: Likelihood
    given: _core.Model
    candidates: Mapping[str, Candidate]

    def has_starts(self, name: str) -> bool:
        """Whether an effect has minima far from its neutral parameters."""
        return len(list(self.candidates[name].starts(self.given))) > 1

    def is_far_off(self, base: Fit) -> bool:
        """Whether a fit leaves more to the disturbance than fits start with."""
        start = self.likelihood.box.start(self.likelihood.craft).levels
        return any(base.levels[name] > start[name] for name in ("sigma_X", "sigma_Y"))

    def from_start(self, start: _core.Model, near: Optional[Fit]) -> List[Fit]:
        """The fit from a start, as a list; an empty one where it cannot be simulated."""
        try:
            return [self.likelihood.fit(start, free_parameters(start), near)]
        except GroundError:
            return []


@dataclass(frozen=True)
class Extension:
    """Fits a fitted set of effects with others added."""

    fitting: Fitting
    current: FrozenSet[str]
    base: Fit  # fit of the set
    tests: ScoreTests  # tests of all other effects beside it

    def __call__(self, added: Tuple[str, ...]) -> Optional[Fit]:
        """The likeliest fit with added effects, from the steps of the score tests and the effects' own
        starts."""
        extended = self.base.model
        for name in added:
            extended = self.fitting.candidates[name].neutral(extended)
        found: List[Fit] = []
        for start in self._steps(extended, added):
            found += self.fitting.from_start(start, self.base)
            if found and found[-1].log_posterior > self.base.log_posterior + 1:
                break
        for start, near in self._unseen_starts(extended, added):
            found += self.fitting.from_start(start, near)
        return max(found, key=lambda fit: fit.log_posterior) if found else None

    def _steps(self, extended: _core.Model, added: Sequence[str]) -> Iterator[_core.Model]:
        """Models to start from: parts of the score test's step. Where the test sees no more than what
        the fitted parameters do as well, all parts are the same."""
        _, step = self.tests.test(added)
        all_the_same = not step or any(self.tests.hidden(name) for name in added)
        for part in STEPS[:1] if all_the_same else STEPS:
            yield stepped(extended, step, part)

    def _unseen_starts(
        self, extended: _core.Model, added: Sequence[str]
    ) -> Iterator[Tuple[_core.Model, Optional[Fit]]]:
        """Models to start from where score tests do not point to, and Fits whose levels are near."""
        for name in added:
            if self.tests.hidden(name):
                for part in SIZES:
                    yield stepped(extended, self.tests.in_place(name, part)), self.base
        far = [name for name in added if self.fitting.has_starts(name)]
        if far and self.fitting.is_far_off(self.base):
            for name in far:
                for other in self._far_starts(name, added):
                    yield other, None

    def _far_starts(self, name: str, added: Sequence[str]) -> List[_core.Model]:
        """Models with an effect far from neutral from which a fit should start. The other
        parameters may be far from the right ones, too; a quick fit by simulation error finds
        them."""
        fitting = self.fitting
        begun = self.base.model if self.current else fitting.given
        for other in added:
            begun = begun if other == name else fitting.candidates[other].neutral(begun)
        neutral, *others = fitting.candidates[name].starts(begun)
        if not others:
            return []
        runs = fitting.likelihood.runs
        chosen = windows.spread(windows.cut(runs), WINDOWS)
        problem = windows.problem(runs, chosen)

        def fitted(model: _core.Model) -> Tuple[float, _core.Model]:
            """The error and the fit from a start; infinite where it cannot be simulated."""
            try:
                found = problem.fit(model, free_parameters(model), threads=1)
            except (RuntimeError, ValueError):
                return np.inf, model
            return found["objective"], found["model"]

        least, near = fitted(neutral)
        better = [
            model for error, model in (fitted(other) for other in others) if error < MAX_FAR_ERROR * least
        ]
        # The fit from neutral may have found its way, where the likelihood would not.
        return better or [near]


@dataclass(frozen=True)
class Reduction:
    """Fits a fitted set of effects without one of them."""

    fitting: Fitting
    current: FrozenSet[str]
    base: Fit  # fit of the set
    nominal: Fit  # fit of the model without any of the effects

    def __call__(self, name: str) -> Fit:
        """The fit without the named effect."""
        model = self.base.model.copy()
        model.remove_effect(name)
        found = self.fitting.from_start(model, self.base)
        if found:
            return found[0]
        neutral = self.nominal.model  # the others are unstable without it
        for other in sorted(self.current - {name}):
            neutral = self.fitting.candidates[other].neutral(neutral)
        return self.fitting.likelihood.fit(neutral, free_parameters(neutral), self.nominal)
