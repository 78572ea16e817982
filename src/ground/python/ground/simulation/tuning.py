"""Search for the gains of a controller in closed loop, over references, starts and conditions.

The search is over the logarithms of the gains. A quarter of the candidates is spread over the whole
range; the rest is found by CMA-ES (Hansen, Ostermeier 2001), started from the best of these that are
far apart. The score of a candidate combines its errors, its saturation and its effort:

    score = mean over cells of (log10 of the median + 2 log10 of the worst of the starts) / 3
            + saturation_weight * saturated share + effort_weight * effort
            + worse_weight * mean over cells of the powers of ten by which the worst start is worse
              than with the initial gains

A cell is a reference in one of the conditions. The final choice uses starts that the search has not
used.
"""

import itertools
from dataclasses import dataclass, field
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.annotations import Array, Document, Setting
from ground.errors import GroundError
from ground.progress import Work
from ground.simulation import gains, tracking
from ground.workers import Workers

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
SMALLEST = 1e-3  # error below which a smaller one does not count [m]
SIGMA = 0.5  # standard deviation of the first steps, in powers of ten
RESTARTS = 4
FINALISTS = 24
BATCH = 4  # runs of about 10 ms in a piece of work
MARGIN = 0.1  # margin below the limits, in powers of ten


@dataclass
class Cell:
    """A reference in one of the conditions."""

    reference: str
    condition: str
    task: tracking.Task
    truth: _core.Model
    conditions: tracking.Conditions

    @property
    def name(self) -> str:
        """Reference and condition, in words."""
        return "%s, %s" % (self.reference, self.condition)


@dataclass
class Candidate:
    """Gains and their results; errors: rms of every start [m], by cell."""

    gains: Dict[str, Setting]
    errors: Dict[str, List[float]] = field(default_factory=dict)
    saturated: float = np.nan
    effort: float = np.nan
    score: float = np.inf

    def quantile(self, cell: str, share: float) -> float:
        """Error in a cell [m] that a share (0..1) of the starts stays below."""
        return tracking.quantile(self.errors[cell], share)


@dataclass
class Weights:
    """Costs of a share of saturation, of a unit of effort and of being worse somewhere than the initial
    gains, in powers of ten of error."""

    saturation: float = 0.3
    effort: float = 0.3
    worse: float = 5.0
    # cell -> worst start with the best initial gains
    limits: Dict[str, float] = field(default_factory=dict)


def cells(tasks: Mapping[str, tracking.Task], truth: _core.Model, delay: float = 0.02) -> List[Cell]:
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


def _numbers(runs: Sequence[Tuple[Any, ...]]) -> List[Document]:
    """Numbers of runs; each is given by the arguments of tracking.run."""
    return [tracking.run(*run).numbers for run in runs]


def evaluate(
    workers: Workers,
    choices: Sequence[_core.ControllerChoice],
    believed: _core.Model,
    cells: Sequence[Cell],
    starts: Sequence[tracking.Start],
    weights: Weights,
    seed: int,
    rate: float = 50.0,
    work: Optional[Work] = None,
) -> List[Candidate]:
    """A Candidate of every _core.ControllerChoice; workers: ground.workers.Workers; work: told of each
    drive that is simulated."""
    told = work or Work()
    plan = list(itertools.product(range(len(choices)), cells, range(len(starts))))
    runs = [
        (
            cell.truth,
            believed,
            choices[count],
            cell.task,
            starts[start],
            cell.conditions,
            seed + start,
            rate,
            np.inf,  # never stop: one that loses the reference has a large error
        )
        for count, cell, start in plan
    ]
    parts = [runs[i : i + BATCH] for i in range(0, len(runs), BATCH)]
    numbers: List[Document] = []
    for found_in_part in workers.map(_numbers, parts):
        numbers += found_in_part
        told.step(len(found_in_part))
    found = [Candidate(gains.get(choice)) for choice in choices]
    for (count, cell, _), result in zip(plan, numbers):
        found[count].errors.setdefault(cell.name, []).append(result["rms"])
    for count, candidate in enumerate(found):
        own = [n for (c, _, _), n in zip(plan, numbers) if c == count]
        candidate.saturated = float(np.mean([n["saturated_fraction"] for n in own]))
        candidate.effort = float(np.mean([n["effort"] for n in own]))
        candidate.score = score(candidate, weights)
    return found


def score(candidate: Candidate, weights: Weights) -> float:
    """Score of a candidate, the lower the better; see the module."""
    logs = [
        (_log(float(np.median(errors))) + 2 * _log(max(errors))) / 3 for errors in candidate.errors.values()
    ]
    worse = [
        max(0.0, _log(max(candidate.errors[cell])) - _log(limit) + MARGIN)
        for cell, limit in weights.limits.items()
        if cell in candidate.errors
    ]
    return float(
        np.mean(logs)
        + weights.worse * (float(np.mean(worse)) if worse else 0.0)
        + weights.saturation * candidate.saturated
        + weights.effort * candidate.effort
    )


def _log(error: float) -> float:
    return float(np.log10(min(error, 100.0) + SMALLEST))


def search(
    workers: Workers,
    first: Sequence[_core.ControllerChoice],
    believed: _core.Model,
    cells: Sequence[Cell],
    starts: Sequence[tracking.Start],
    weights: Weights,
    evaluations: int,
    seed: int,
    rate: float = 50.0,
    work: Optional[Work] = None,
) -> List[Candidate]:
    """All Candidates that were tried, in order. first: _core.ControllerChoices to start from.

    work: told of each drive that is simulated, and of the best candidates. Raises GroundError
    when the optimiser is not installed.
    """
    CMA = _optimizer()
    kind = first[0].kind
    names = list(SPACE[kind])
    bounds = _bounds(kind)
    random = np.random.default_rng(seed)
    told, drives = work or Work(), len(cells) * len(starts)
    told.more(drives * max(evaluations, len(first)))
    tried = evaluate(workers, first, believed, cells, starts, weights, seed, rate, told)
    weights.limits = {
        cell.name: min(max(candidate.errors[cell.name]) for candidate in tried) for cell in cells
    }
    for candidate in tried:
        candidate.score = score(candidate, weights)
    places = [_coordinates(kind, gains.get(choice), bounds) for choice in first]

    def attempt(generation: Sequence[Array]) -> List[float]:
        choices = [_choice(first[0], kind, place) for place in generation]
        found = evaluate(workers, choices, believed, cells, starts, weights, seed, rate, told)
        tried.extend(found)
        places.extend(generation)
        return [candidate.score for candidate in found]

    population = 4 + 2 * len(names)
    while len(tried) < evaluations / 4:
        shares = random.uniform(size=(population, len(names)))
        attempt(list(bounds[:, 0] + shares * np.ptp(bounds, axis=1)))
    begins = [places[i] for i in _apart(places, tried, RESTARTS, 1.0)]
    explored = len(tried)
    for restart, place in enumerate(begins):
        optimizer = CMA(
            mean=place, sigma=SIGMA, bounds=bounds, seed=seed + restart, population_size=population
        )
        end = explored + (evaluations - explored) * (restart + 1) // len(begins)
        while len(tried) < end and not optimizer.should_stop():
            generation = [optimizer.ask() for _ in range(population)]
            optimizer.tell(list(zip(generation, attempt(generation))))
        told.more(drives * max(0, evaluations - end))
        best = min(tried, key=lambda c: c.score)
        told.note(
            "best of %d candidates: score %.3f, saturated %.0f%%, effort %.3f"
            % (len(tried), best.score, 100 * best.saturated, best.effort)
        )
    return tried


def _apart(places: Sequence[Array], tried: Sequence[Candidate], most: int, distance: float) -> List[int]:
    """Indices of the best Candidates that differ from each other by `distance` in some gain."""
    chosen: List[int] = []
    for count in np.argsort([c.score for c in tried]):
        if all(np.max(np.abs(places[count] - places[other])) > distance for other in chosen):
            chosen.append(int(count))
        if len(chosen) == most:
            break
    return chosen


def choose(
    workers: Workers,
    tried: Sequence[Candidate],
    first: Sequence[_core.ControllerChoice],
    believed: _core.Model,
    cells: Sequence[Cell],
    starts: Sequence[tracking.Start],
    weights: Weights,
    seed: int,
    rate: float = 50.0,
    work: Optional[Work] = None,
) -> List[Candidate]:
    """The finalists as Candidates on other starts than the search's, best first; work: told of each
    drive."""
    kind = first[0].kind
    bounds = _bounds(kind)
    places = [_coordinates(kind, c.gains, bounds) for c in tried]
    choices = [_with(first[0], tried[i].gains) for i in _apart(places, tried, FINALISTS, 0.1)]
    return sorted(
        evaluate(workers, choices, believed, cells, starts, weights, seed, rate, work),
        key=lambda c: c.score,
    )


def trade_off(tried: Sequence[Candidate]) -> List[Candidate]:
    """Candidates that no other beats in score of error, saturation and effort at once."""
    points = np.array([[score(c, Weights(0, 0)), c.saturated, c.effort] for c in tried])
    return [
        c
        for c, p in zip(tried, points)
        if np.isfinite(p).all() and not ((points <= p).all(axis=1) & (points < p).any(axis=1)).any()
    ]


def _bounds(kind: str) -> Array:
    return np.array([limits[1:] for limits in SPACE[kind].values()], float)


def _coordinates(kind: str, values: Mapping[str, Setting], bounds: Array) -> Array:
    logs = [np.log10(max(1e-12, abs(float(values[name])))) for name in SPACE[kind]]
    return np.clip(logs, bounds[:, 0], bounds[:, 1])


def _choice(like: _core.ControllerChoice, kind: str, place: Array) -> _core.ControllerChoice:
    values = {n: s[0] * 10.0**x for (n, s), x in zip(SPACE[kind].items(), place)}
    return _with(like, {**gains.get(like), **values})


def _with(like: _core.ControllerChoice, values: Dict[str, Setting]) -> _core.ControllerChoice:
    choice = gains.choice(like.kind)
    gains.put(choice, values)
    return choice


def _optimizer() -> Any:
    try:
        from cmaes import CMA
    except ImportError:
        raise GroundError("the optimiser is missing: install python3-cmaes (Debian) or cmaes from PyPI")
    return CMA
