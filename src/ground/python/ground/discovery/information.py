"""What flights tell of the questions that are open, before they are flown.

The Fisher information of a model's parameters, and of the parameters of effects that it does not have,
adds up over flights. It follows from a flight's inputs and expected motion alone. An effect of the
size that matters is expected to raise 2 ln L by

    visibility = m^2 (I_ee - I_en I_nn^-1 I_ne),

with m the size, e the effect's parameter and n the model's (the noncentrality of a likelihood ratio
test, Wald 1943). With two rivals, the one that acts takes the place of m, and the other is among n.
A test between two normal distributions whose means are sqrt(v) standard deviations apart is wrong
with a probability of at most exp(-v/8) / 2 (Bhattacharyya 1943). The sum of these bounds is the doubt
that a flight leaves; the best flight removes most doubt per second.
"""

from dataclasses import dataclass, field
from typing import Collection, Dict, List, Mapping, Sequence

import numpy as np

from ground import _core
from ground.analysis import window_error, windows
from ground.analysis.likelihood import CAP, Likelihood, call
from ground.analysis.score_tests import solve, stepped
from ground.discovery.pieces import Piece
from ground.effect_library import candidates as effects
from ground.support.annotations import Array

# Visibility at which a question counts as decided: a test at the threshold of a search (12.7 for one
# parameter) then has a power of 95%.
DECIDED = 27.0
# Size that matters: the change of the motion over windows, relative to the error by the poses' noise.
MATTERS = 1.0
PRECISE = 0.15  # standard errors of the model's own parameters that matter, relative to their scale
LITTLE = 0.01  # doubt that no further piece is flown for
WINDOWS = 24  # windows over which the change of the motion is taken
PARTS = (0.1, 1.0)  # first trial of a size, and the largest one, relative to the typical size


@dataclass(frozen=True)
class Basis:
    """A model, its free parameters, and the effects that it does not have, at their neutral values."""

    model: _core.Model
    extended: _core.Model  # with the effects
    free: List[str]
    columns: Dict[str, List[int]]  # each effect's, among all names
    names: List[str]  # the free parameters, then the effects' parameters

    @staticmethod
    def of(
        model: _core.Model, candidates: Sequence[effects.Candidate], constants: Collection[str] = ()
    ) -> "Basis":
        """The Basis of a model and the effects that may be missing. constants: parameters of the effects
        that change nothing where the effect does nothing."""
        extended, free = model, window_error.free_parameters(model)
        for candidate in candidates:
            extended = candidate.neutral(extended)
        names, columns = list(free), {}
        for candidate in candidates:
            described = [p.name for p in effects.seen_alone(extended, candidate.name)]
            described = [name for name in described if name not in constants]
            columns[candidate.name] = list(range(len(names), len(names) + len(described)))
            names += described
        return Basis(model, extended, free, columns, names)

    def parameters(self, effect: str) -> List[str]:
        """The free parameters of an effect that the model has."""
        return [name for name in self.free if name.split(".")[0] == effect]


@dataclass(frozen=True)
class Information:
    """Information of a Basis' parameters in scaled coordinates, and the scores of recorded runs."""

    matrix: Array  # (n, n)
    score: Array  # (n,)
    scale: Array  # (n,) scale of the coordinates


def of_runs(
    basis: Basis, likelihood: Likelihood, levels: Mapping[str, float], loudness: Sequence[float] = ()
) -> Information:
    """The Information of the runs of a Likelihood, under levels of disturbance and noise."""
    point = _core.GreyBoxPoint(basis.extended, {**levels, **likelihood.absent}, list(loudness))
    found = call(likelihood.box.scores, point, basis.names, cap=CAP, block=1.0, threads=likelihood.threads)
    score = np.array(found["score"]).sum(axis=0)
    return Information(np.array(found["information"]), score, np.array(found["scale"]))


def sizes_that_matter(
    basis: Basis, candidates: Sequence[effects.Candidate], run: _core.RunData, known: Information
) -> Dict[str, float]:
    """Coordinate of each effect's parameter at the size that matters, by name. The other parameters
    make up for as much of the effect as they can. run: an expected motion that all effects change."""
    count = len(basis.free)
    onto = solve(known.matrix[:count, :count], known.matrix[:count, count:])
    measure = _Change(basis.model, run)
    sizes: Dict[str, float] = {}
    for candidate in candidates:
        extended = candidate.neutral(basis.model)  # with one effect it is simulated sooner
        for at in basis.columns[candidate.name]:
            moved = -onto[:, at - count] * known.scale[:count]
            part = PARTS[0]
            for _ in range(2):  # the change is nearly proportional to the size
                steps = {basis.names[at]: float(part * known.scale[at])}
                steps.update(zip(basis.free, map(float, part * moved)))
                part = min(PARTS[1], part * MATTERS / measure.of(stepped(extended, steps)))
            sizes[basis.names[at]] = float(part * known.scale[at])
    return sizes


class _Change:
    """Change of the motion along a run from a model's motion, relative to the error by noise."""

    def __init__(self, model: _core.Model, run: _core.RunData) -> None:
        chosen = windows.spread(windows.cut([run]), WINDOWS)
        self.problem = windows.problem([run], chosen)
        self.sigma = np.array(self.problem.sigma(0))
        self.before = np.concatenate(self.problem.simulate(model)["nu"])
        self.floor = float(window_error.noise_floor([run], model).sum())

    def of(self, other: _core.Model) -> float:
        """Infinite where the other motion is not finite."""
        try:
            after = np.concatenate(self.problem.simulate(other)["nu"])
        except RuntimeError:
            return np.inf
        changed = float((np.abs(after - self.before) / self.sigma).mean(axis=0).sum())
        return max(changed / self.floor, 1e-6)


@dataclass(frozen=True)
class Question:
    """Something that flights can decide."""

    about: str  # an effect or a parameter
    rival: str = ""  # an effect that may act in its place
    doubt: float = 1.0  # 2 sqrt(p (1 - p)) of the probability p that it acts; 1: nothing is known

    @property
    def words(self) -> str:
        """The question in a few words."""
        names = [self.about, self.rival] if self.rival else [self.about]
        return " or ".join(effects.in_words(n) if n in effects.effects() else n for n in names)


@dataclass
class Questions:
    """Questions about the parameters of a Basis. sizes: of sizes_that_matter, scaled like the
    coordinates; acting: coordinates of the found effects' parameters, scaled."""

    basis: Basis
    scale: Array
    sizes: Mapping[str, float]
    acting: Mapping[str, float] = field(default_factory=dict)
    asked: List[Question] = field(default_factory=list)

    def visibility(self, matrix: Array) -> Array:
        """Visibility that an information matrix gives to each question."""
        count = len(self.basis.free)
        inside, across = matrix[:count, :count], matrix[:count, count:]
        left = np.diag(matrix)[count:] - (across * solve(inside, across)).sum(axis=0)
        spread = np.diag(np.linalg.pinv(inside + 1e-9 * np.diag(np.diag(inside)), hermitian=True))
        return np.array([self._of(q, matrix, left, spread) for q in self.asked])

    def _of(self, question: Question, matrix: Array, left: Array, spread: Array) -> float:
        basis = self.basis
        if question.rival:
            return self._apart(question, matrix)
        if question.about in basis.columns:
            at = basis.columns[question.about]
            sizes = [self.sizes[basis.names[i]] / self.scale[i] for i in at]
            seen = [s**2 * left[i - len(basis.free)] for i, s in zip(at, sizes)]
            return float(min(seen))
        own = spread[basis.free.index(question.about)]
        return float(PRECISE**2 / own * DECIDED) if own > 0 else 0.0

    def _apart(self, question: Question, matrix: Array) -> float:
        """Visibility of a found effect beside a rival that takes its place."""
        basis = self.basis
        own = [basis.free.index(n) for n in basis.parameters(question.about)]
        rest = [i for i in range(len(basis.free)) if i not in own] + basis.columns[question.rival]
        size = np.array([self.acting[basis.free[i]] / self.scale[i] for i in own])
        into = matrix[np.ix_(rest, own)]
        left = matrix[np.ix_(own, own)] - into.T @ solve(matrix[np.ix_(rest, rest)], into)
        return float(max(0.0, size @ left @ size))

    def doubt(self, matrix: Array) -> float:
        """Sum of the bounds of the probabilities of a wrong decision."""
        seen = np.maximum(0.0, self.visibility(matrix))
        return float(sum(q.doubt * np.exp(-v / 8) for q, v in zip(self.asked, seen)))


@dataclass(frozen=True, eq=False)
class Offer:
    """A piece that can be flown."""

    piece: Piece
    gain: Array  # information matrix that is expected of it
    seconds: float  # time that it takes with its returns [s]


def mean_rate(offers: Sequence[Offer]) -> Array:
    """Information matrix per second of flight, over all offers."""
    return np.asarray(sum(o.gain for o in offers) / sum(o.seconds for o in offers))


def greedy(questions: Questions, known: Array, offers: Sequence[Offer], longest: float) -> List[Offer]:
    """The offers that together remove most doubt per second, within `longest` seconds and at least
    one; fewer when no question is left."""
    chosen: List[Offer] = []
    matrix, left = known.copy(), longest
    while True:
        doubt = questions.doubt(matrix)
        rest = [o for o in offers if o not in chosen and (not chosen or o.seconds <= left)]
        rates = [(doubt - questions.doubt(matrix + o.gain)) / o.seconds for o in rest]
        if not rest or max(rates) <= 0 or (chosen and doubt < LITTLE):
            return chosen
        best = rest[int(np.argmax(rates))]
        chosen.append(best)
        matrix = matrix + best.gain
        left -= best.seconds
