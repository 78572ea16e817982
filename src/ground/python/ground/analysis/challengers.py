"""Formulas outside the library that may act in the place of effects that were found.

Two effects of the library can imitate one that it does not have: friction and quadratic drag, for
example, a cubic damping. Each formula in the body's frame of ground.analysis.unexplained therefore
challenges each effect and each pair of effects of a grown model: score tests of the model without
them choose the formulas to refit, and the refits decide.
"""

import itertools
from dataclasses import dataclass
from typing import Dict, FrozenSet, Iterator, List, Mapping, Optional, Sequence, Set, Tuple

import numpy as np

from ground.analysis import candidates, failure, unexplained
from ground.analysis.diagnosis import Diagnosis
from ground.analysis.distributions import chi_squared_limit
from ground.analysis.score_tests import ScoreTests, in_parts, solve, stepped
from ground.annotations import Document
from ground.errors import GroundError

REPLACED = 2  # largest number of effects that one formula replaces
TESTED = 6  # formulas that are compared with the library's effects
REFITTED = 2  # formulas that are refitted in the place of the same effects
# Effects that oppose the motion, whose forms resemble each other's and those of formulas of VELOCITY
DAMPING = frozenset(
    ["quadratic_drag", "coulomb_friction", "momentum_drag", "sway_yaw_damping"]
    + ["directional_yaw_damping", "skirt_friction"]
)
VELOCITY = frozenset(["u", "v", "r"])
SIZE = 0.01  # typical size of a term, relative to full thrust
OWN = 0.005  # least share of a formula's information that no effect of the library has as well


@dataclass(frozen=True)
class Challenger:
    """A formula that may act in the place of effects."""

    entry: Document  # the effect as model files list it
    replaced: Tuple[str, ...]  # effects of the grown model
    lead: float  # of its set's value over the grown model's, see Search.value


@dataclass(frozen=True)
class _Formula:
    candidate: candidates.Candidate
    entry: Document


def challengers(found: Diagnosis, only_damping: bool = False) -> List[Challenger]:
    """Formulas whose likelihood does not exclude them in the place of effects of the library that a
    grown Diagnosis has chosen, best first. only_damping: only the effects of DAMPING are challenged, by
    formulas of the velocity; other effects act in ways that a formula seldom imitates."""
    challenged = found.names & frozenset(candidates.effects(found.given))
    if only_damping:
        challenged &= DAMPING
    formulas = _formulas(found, only_damping) if challenged else {}
    parts = list(_parts(challenged))
    rests = [_without(found, replaced) for replaced in parts]

    def tested(part: Tuple[Tuple[str, ...], FrozenSet[str]]) -> List[Tuple[str, Challenger]]:
        replaced, rest = part
        leads = [
            (name, _lead(found, formulas[name], step, rest, len(formulas)))
            for name, step in _promising(found, formulas, rest, replaced)
        ]
        return [
            (name, Challenger(formulas[name].entry, replaced, lead))
            for name, lead in leads
            if lead is not None
        ]

    tried: Dict[str, Challenger] = {}
    for part in found.pool.map(tested, zip(parts, rests)):
        for name, challenger in part:
            if name not in tried or challenger.lead > tried[name].lead:
                tried[name] = challenger
    kept = [c for c in tried.values() if c.lead > -found.search.criteria.exclusion]
    return sorted(kept, key=lambda c: -c.lead)


def _without(found: Diagnosis, replaced: Sequence[str]) -> FrozenSet[str]:
    """The grown model's set without some effects, fitted, and tested before threads need it."""
    rest = found.names
    for name in replaced:
        rest = found.search.without(rest, name)
    found.search.test_beside(rest)
    return rest


def _parts(names: FrozenSet[str]) -> Iterator[Tuple[str, ...]]:
    """All sets of effects that one formula may replace."""
    for size in range(1, REPLACED + 1):
        yield from itertools.combinations(sorted(names), size)


def _formulas(found: Diagnosis, only_damping: bool) -> Dict[str, _Formula]:
    """Formulas with one weight, in one channel of the wrench each, by name; only_damping: those of the
    velocity."""
    model = found.given
    full = dict(zip(unexplained.CHANNELS, failure.full_scale(model)))
    sampled = [unexplained.values(run, model) for run in found.runs]
    made: Dict[str, _Formula] = {}
    for term in unexplained.dictionary(model):
        if len(term.parts) != 1:
            continue  # along an axis of the world: no effect of the body imitates it
        if only_damping and not (term.variables and term.variables <= VELOCITY):
            continue
        ((channel, text),) = term.parts.items()
        size = float(np.sqrt(np.mean([np.mean(unexplained.evaluate(text, s) ** 2) for s in sampled])))
        if not size > 0:
            continue
        scale = float("%.3g" % (SIZE * full[channel] / size))
        weight = {"value": 0.0, "unit": term.weight_unit, "neutral": 0.0, "scale": scale}
        weight.update(lower=-1e3 * scale, upper=1e3 * scale)
        entry = {
            "name": "formula_%d" % len(made),
            "expression": {channel: "c1*(%s)" % text},
            "parameters": {"c1": weight},
        }
        formula = _Formula(candidates.from_entry(entry, text, model), entry)
        made[formula.candidate.name] = formula
    return made


def _promising(
    found: Diagnosis,
    formulas: Mapping[str, _Formula],
    rest: FrozenSet[str],
    replaced: Sequence[str],
) -> List[Tuple[str, Mapping[str, float]]]:
    """Names of the formulas that by score tests may replace effects, beside the rest of a set, and the
    steps of their weights."""
    fit, criteria = found.search.fits[rest], found.search.criteria
    library = found.search.test_beside(rest)
    least = max(criteria.min_rival_gain * library.test(replaced)[0], criteria.min_gain)
    gains: Dict[str, Tuple[float, Mapping[str, float]]] = {}
    for tests in in_parts(found.likelihood, fit, [f.candidate for f in formulas.values()]):
        gains.update((name, tests.test([name])) for name in tests.columns)
    best = sorted(gains, key=lambda name: -gains[name][0])[:TESTED]
    best = [name for name in best if gains[name][0] > least]
    others = [found.search.candidates[name] for name in library.columns]
    own = _own(found, rest, [formulas[name].candidate for name in best], others)
    return [(name, gains[name][1]) for name in best if name in own][:REFITTED]


def _own(
    found: Diagnosis,
    rest: FrozenSet[str],
    formulas: Sequence[candidates.Candidate],
    others: Sequence[candidates.Candidate],
) -> Set[str]:
    """Names of the formulas that do what no single effect of the library does."""
    own = {formula.name for formula in formulas}
    if formulas:
        for tests in in_parts(found.likelihood, found.search.fits[rest], others, formulas):
            own -= {f.name for f in formulas for o in others if _is_in(tests, f.name, o.name)}
    return own


def _is_in(tests: ScoreTests, formula: str, effect: str) -> bool:
    """Whether an effect, if it is among those tested, does all that a formula does."""
    if effect not in tests.columns:
        return False
    A, (at,), columns = tests.information, tests.columns[formula], tests.columns[effect]
    shared = A[at, columns] @ solve(A[np.ix_(columns, columns)], A[columns, at])
    return bool(A[at, at] - shared < OWN * A[at, at])


def _lead(
    found: Diagnosis,
    formula: _Formula,
    step: Mapping[str, float],
    rest: FrozenSet[str],
    count: int,
) -> Optional[float]:
    """Value of a set with a formula over the grown model's; None where it cannot be fitted. count:
    number of formulas."""
    search, name = found.search, formula.candidate.name
    base = search.fits[rest]
    start = stepped(formula.candidate.neutral(base.model), step)
    try:
        fit = found.likelihood.fit(start, base.free + (name + ".c1",), base)
    except GroundError:
        return None
    ratio = 2 * (fit.log_posterior - base.log_posterior)
    threshold = chi_squared_limit(search.criteria.level / count, 1)
    return search.value(rest) + ratio - threshold - search.value(found.names)
