"""Fits of a set of effects that is extended by others, or reduced by one."""

from dataclasses import dataclass
from typing import Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis.candidates import Candidate
from ground.analysis.likelihood import LEAST_GAIN, Fit, Likelihood
from ground.analysis.score_tests import ScoreTests, stepped
from ground.analysis.window_error import free_parameters
from ground.recordings import windows
from ground.support.errors import GroundError

STEPS = (1.0, 0.3, 0.1)  # parts of the score test's step that refits start from
SIZES = (0.5, 0.2, -0.2)  # start values of an effect that score tests cannot see, over its typical size
COARSE = 0.2  # least gain (LEAST_GAIN) of fits of which the best is continued
WINDOWS = 40  # on which far starts are tried by simulation error


@dataclass(frozen=True)
class Fitting:
    """What all fits of sets of effects need: a model, and the effects by name."""

    likelihood: Likelihood
    given: _core.Model
    candidates: Mapping[str, Candidate]

    def extended(self, base: Fit, tests: ScoreTests, added: Sequence[str]) -> Optional[Fit]:
        """The likeliest fit of a fitted set with added effects, from the steps of the score tests beside it
        and the effects' own starts. It ends early: see refined."""
        model = base.model
        for name in added:
            model = self.candidates[name].neutral(model)
        found: List[Fit] = []
        for start in self._steps(model, tests, added):
            found += self._from_start(start, base, COARSE)
            if found and found[-1].log_posterior > base.log_posterior + 1:
                break
        for start, near in self._unseen_starts(model, base, tests, added):
            found += self._from_start(start, near, COARSE)
        if not found:
            return None
        return max(found, key=lambda fit: fit.log_posterior)

    def refined(self, fit: Fit) -> Fit:
        """A fit that ended early, continued."""
        return max([fit, *self._from_start(fit.model, fit)], key=lambda fit: fit.log_posterior)

    def reduced(self, base: Fit, nominal: Fit, name: str) -> Fit:
        """The fit of a fitted set without one of its effects. nominal: without any of them."""
        model = base.model.copy()
        model.remove_effect(name)
        found = self._from_start(model, base)
        if found:
            return found[0]
        neutral = nominal.model  # the others are unstable without it
        for other in sorted(set(model.effects) & set(self.candidates)):
            neutral = self.candidates[other].neutral(neutral)
        return self.likelihood.fit(neutral, free_parameters(neutral), nominal)

    def has_far_starts(self, name: str, base: Fit) -> bool:
        """Whether an effect has minima far from its neutral parameters, and a fit leaves more to the
        disturbance than fits start with."""
        start = self.likelihood.box.start(self.likelihood.craft).levels
        is_far = any(base.levels[level] > start[level] for level in ("sigma_X", "sigma_Y"))
        return is_far and len(list(self.candidates[name].starts(self.given))) > 1

    def _from_start(
        self, start: _core.Model, near: Optional[Fit], least_gain: float = LEAST_GAIN
    ) -> List[Fit]:
        """The fit from a start, as a list; an empty one where it cannot be simulated."""
        try:
            return [self.likelihood.fit(start, free_parameters(start), near, least_gain=least_gain)]
        except GroundError:
            return []

    def _steps(self, extended: _core.Model, tests: ScoreTests, added: Sequence[str]) -> Iterator[_core.Model]:
        """Models to start from: parts of the score test's step. Where the test sees no more than what
        the fitted parameters do as well, all parts are the same."""
        _, step = tests.test(added)
        all_the_same = not step or any(tests.hidden(name) for name in added)
        for part in STEPS[:1] if all_the_same else STEPS:
            yield stepped(extended, step, part)

    def _unseen_starts(
        self, extended: _core.Model, base: Fit, tests: ScoreTests, added: Sequence[str]
    ) -> Iterator[Tuple[_core.Model, Optional[Fit]]]:
        """Models to start from where score tests do not point to, and Fits whose levels are near."""
        for name in added:
            if tests.hidden(name):
                for part in SIZES:
                    yield stepped(extended, tests.in_place(name, part)), base
            if self.has_far_starts(name, base):
                yield self._far_start(name, base, added), None

    def _far_start(self, name: str, base: Fit, added: Sequence[str]) -> _core.Model:
        """The model with an effect far from neutral from which a fit should start. The other parameters
        may be far from the right ones, too; a quick fit by simulation error finds them."""
        begun = base.model if set(base.model.effects) & set(self.candidates) else self.given
        for other in added:
            begun = begun if other == name else self.candidates[other].neutral(begun)
        chosen = windows.spread(windows.cut(self.likelihood.runs), WINDOWS)
        problem = windows.problem(self.likelihood.runs, chosen)

        def fitted(model: _core.Model) -> Tuple[float, _core.Model]:
            """The error and the fit from a start; infinite where it cannot be simulated."""
            try:
                found = problem.fit(model, free_parameters(model), threads=1)
            except (RuntimeError, ValueError):
                return np.inf, model
            return found["objective"], found["model"]

        return min(map(fitted, self.candidates[name].starts(begun)), key=lambda pair: pair[0])[1]
