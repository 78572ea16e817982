"""Search for the gains of a controller in closed loop, over references, starts and conditions.

The search is over the logarithms of the gains. A quarter of the candidates is spread over the whole range;
the rest is found by CMA-ES (Hansen, Ostermeier 2001), started from each of the best of these. The score of
a candidate combines its errors, its saturation and its effort:

    score = mean over cells of (log10 of the median + 2 log10 of the worst of the starts) / 3
            + 0.3 * (saturated share + effort)
            + 5 * mean over cells of the powers of ten by which the worst start is worse than with the
              initial gains

A cell is a reference in one of the conditions. The final choice uses starts that the search has not used.
"""

import itertools
from dataclasses import dataclass, field
from typing import Any, Dict, List, Mapping, Sequence, Tuple

import numpy as np

from ground import _core
from ground.simulation import gains, tracking
from ground.support.annotations import Array, ArrayLike, Setting
from ground.support.errors import GroundError
from ground.support.progress import Work
from ground.support.workers import Workers

# kind of controller -> gain -> sign, and range in powers of ten; other gains are not searched
SPACE = {
    "TrajectoryTracking": {
        "k_e": (1, -3, 2),
        "k_z": (1, -6, 1),
        "k_phi_1": (1, -4, 2),
        "k_phi_2": (1, -4, 2),
        "delta_1": (-1, -4, 0),
    },
    "ModelPredictive": {
        "velocity": (1, -4, 1),
        "input": (1, -7, -1),
        "turning": (1, -7, -1),
        "end_position": (1, -2, 3),
        "end_velocity": (1, -2, 3),
    },
}
# Factors on parameters for the condition "model error"
MODEL_ERROR = {"k": 0.85, "X_u": 1.3, "Y_v": 1.3, "N_r": 1.3, "I_z": 1.15}
SMALLEST, LARGEST = 1e-3, 100.0  # errors below and above which a difference does not count [m]
USE_WEIGHT = 0.3  # weight of saturation and effort
WORSE, MARGIN = 5.0, 0.1  # weight of being worse than the initial gains, margin in powers of ten
SIGMA = 0.5  # standard deviation of the first steps, in powers of ten
RESTARTS = 4
FINALISTS = 24


@dataclass
class Cell:
    """A reference in one of the conditions."""

    reference: str
    condition: str
    task: tracking.TrackingTask
    truth: _core.Model
    conditions: tracking.Conditions

    @property
    def name(self) -> str:
        """Reference and condition, in words."""
        return "%s, %s" % (self.reference, self.condition)


@dataclass
class GainTrial:
    """Gains and their results; errors: rms of every start [m], by cell."""

    gains: Dict[str, Setting]
    errors: Dict[str, List[float]]
    saturated: float
    effort: float
    score: float = np.inf  # of the search that tried it

    @property
    def error(self) -> float:
        """Error [m]: the mean over cells, on a logarithmic scale."""
        cells = np.array([[np.median(errors), max(errors), max(errors)] for errors in self.errors.values()])
        return float(10 ** _logs(cells).mean())


def cells(tasks: Mapping[str, tracking.TrackingTask], truth: _core.Model, delay: float = 0.02) -> List[Cell]:
    """Cells of {name: Task}: with the model, with mocap noise and delay, and with a wrong model."""
    wrong = tracking.perturbed(truth, MODEL_ERROR)
    conditions = [
        ("nominal", truth, tracking.Conditions()),
        ("noise", truth, tracking.Conditions(noise=True, delay=delay)),
        ("model error", wrong, tracking.Conditions()),
    ]
    return [
        Cell(name, condition, task, craft, how)
        for name, task in tasks.items()
        for condition, craft, how in conditions
    ]


def _logs(errors: ArrayLike) -> Array:
    return np.asarray(np.log10(np.minimum(errors, LARGEST) + SMALLEST))


@dataclass
class GainSearch:
    """Evaluates gains of controllers that use the model `believed`; work: told of each drive."""

    workers: Workers
    believed: _core.Model
    work: Work
    limits: Dict[str, float] = field(default_factory=dict)  # cell -> worst start with the best initial gains

    def evaluate(
        self,
        choices: Sequence[_core.ControllerChoice],
        cells: Sequence[Cell],
        starts: Sequence[tracking.Start],
        seed: int,
    ) -> List[GainTrial]:
        """A GainTrial of every _core.ControllerChoice."""

        def numbers(drive: Tuple[_core.ControllerChoice, Cell, int]) -> List[float]:
            choice, cell, i = drive
            loop = (cell.truth, self.believed, choice, cell.task, starts[i], cell.conditions, seed + i)
            # never stopped: one that loses the reference has a large error
            found = tracking.run(*loop, max_error=np.inf).numbers
            self.work.step()
            return [found["rms"], found["saturated_fraction"], found["effort"]]

        drives = itertools.product(choices, cells, range(len(starts)))
        found = list(self.workers.map(numbers, drives))
        each = len(cells) * len(starts)
        parts = [found[i : i + each] for i in range(0, len(found), each)]
        return [self._candidate(choice, cells, part) for choice, part in zip(choices, parts)]

    def _candidate(
        self, choice: _core.ControllerChoice, cells: Sequence[Cell], numbers: Sequence[Sequence[float]]
    ) -> GainTrial:
        rms, saturated, effort = np.array(numbers).T
        rows = rms.reshape(len(cells), -1).tolist()
        errors = dict(zip((c.name for c in cells), rows))
        found = GainTrial(choice.values, errors, float(saturated.mean()), float(effort.mean()))
        found.score = self._score(found)
        return found

    def _score(self, one: GainTrial) -> float:
        cells = [cell for cell in one.errors if cell in self.limits]
        worse = [_logs(max(one.errors[cell])) - _logs(self.limits[cell]) + MARGIN for cell in cells]
        return float(
            np.log10(one.error)
            + USE_WEIGHT * (one.saturated + one.effort)
            + WORSE * (np.maximum(worse, 0).mean() if cells else 0.0)
        )

    def search(
        self,
        first: Sequence[_core.ControllerChoice],
        cells: Sequence[Cell],
        starts: Sequence[tracking.Start],
        evaluations: int,
        seed: int,
    ) -> List[GainTrial]:
        """All Candidates that were tried, in order. first: _core.ControllerChoices to start from.
        GroundError when the optimiser is not installed."""
        CMA, kind = _optimizer(), first[0].kind
        bounds = np.array([limits[1:] for limits in SPACE[kind].values()], float)
        random = np.random.default_rng(seed)
        self.work.more(len(cells) * len(starts) * max(evaluations, len(first)))
        tried = self.evaluate(first, cells, starts, seed)
        self.limits = {cell.name: min(max(one.errors[cell.name]) for one in tried) for cell in cells}
        for one in tried:
            one.score = self._score(one)
        places = [_coordinates(kind, choice.values, bounds) for choice in first]

        def attempt(generation: Sequence[Array]) -> List[float]:
            choices = [_choice(first[0], place) for place in generation]
            found = self.evaluate(choices, cells, starts, seed)
            tried.extend(found)
            places.extend(generation)
            return [candidate.score for candidate in found]

        population = 4 + 2 * len(bounds)
        while len(tried) < evaluations / 4:
            shares = random.uniform(size=(population, len(bounds)))
            attempt(list(bounds[:, 0] + shares * np.ptp(bounds, axis=1)))
        explored = len(tried)
        best = np.argsort([candidate.score for candidate in tried])[:RESTARTS]
        for restart, begin in enumerate(best):
            optimizer = CMA(
                mean=places[begin],
                sigma=SIGMA,
                bounds=bounds,
                seed=seed + restart,
                population_size=population,
            )
            end = explored + (evaluations - explored) * (restart + 1) // len(best)
            while len(tried) < end and not optimizer.should_stop():
                generation = [optimizer.ask() for _ in range(population)]
                optimizer.tell(list(zip(generation, attempt(generation))))
            self.work.more(len(cells) * len(starts) * max(0, evaluations - end))
            self.work.note(
                "best of %d candidates: score %.3f" % (len(tried), min(one.score for one in tried))
            )
        return tried

    def choose(
        self,
        tried: Sequence[GainTrial],
        kind: str,
        cells: Sequence[Cell],
        starts: Sequence[tracking.Start],
        seed: int,
    ) -> GainTrial:
        """The best of the finalists on other starts than the search's."""
        finalists = sorted(tried, key=lambda c: c.score)[:FINALISTS]
        choices = [gains.choice(kind, candidate.gains) for candidate in finalists]
        return min(self.evaluate(choices, cells, starts, seed), key=lambda c: c.score)


def _coordinates(kind: str, values: Mapping[str, Setting], bounds: Array) -> Array:
    logs = [np.log10(max(1e-12, abs(float(values[name])))) for name in SPACE[kind]]
    return np.clip(logs, bounds[:, 0], bounds[:, 1])


def _choice(like: _core.ControllerChoice, place: Array) -> _core.ControllerChoice:
    values = {n: s[0] * 10.0**x for (n, s), x in zip(SPACE[like.kind].items(), place)}
    return gains.choice(like.kind, {**like.values, **values})


def _optimizer() -> Any:
    try:
        from cmaes import CMA
    except ImportError:
        raise GroundError("the optimiser is missing: install python3-cmaes (Debian) or cmaes from PyPI")
    return CMA
