"""The belief in each effect, from a diagnosis of all flights so far.

An effect acts with probability PRIOR; its parameters are then normally distributed about the neutral
values, with a few times the size that matters as standard deviation. With scores s and information A
in these units, the fitted parameters projected out, the flights raise the odds by the Bayes factor

    |I + A|^(-1/2) exp(s' (I + A)^-1 s / 2)

(the likelihood ratio of two normal models). For an effect that was fitted, the exponent is half of
its log-likelihood ratio. Flights that do not show an effect leave the belief as it was.

The result is the probability that an effect acts and matters: of its parameters' distribution after the
flights, normal with mean (I + A)^-1 s and covariance (I + A)^-1, the part beyond the size that matters.
"""

from dataclasses import dataclass
from typing import Collection, Dict, List, Mapping, NamedTuple

import numpy as np

from ground.analysis.diagnosis import StepwiseDiagnosis
from ground.analysis.score_tests import solve
from ground.discovery.information import DECIDED, Basis, Information, Question, Questions
from ground.discovery.story import ABSENT, HIDDEN, OPEN, PRESENT, SLIGHT, Belief
from ground.effect_library.parameters import described
from ground.support.annotations import Array

PRIOR = 0.05  # probability that an effect acts, before the first flight
SPREAD = 2.0  # standard deviation of parameters, in sizes that matter
LARGEST = 30.0  # largest log odds
# Belief above which an effect that was not found is still open, and probability that a found one matters
# below which it is too small.
DOUBTFUL = 0.2
# Visibility, relative to DECIDED, from which an effect that was not found is too small to matter
# even where the belief in it is large.
GLARING = 4.0
LIKELY = 0.5  # probability above which something is taken for true in the state of an effect
DRAWS = 2000  # number of random parameters that give the probability that an effect matters
PARTLY = 0.3  # doubt about a parameter's value, which is worth less than one about an effect


@dataclass(frozen=True)
class State:
    """What is known after some flights."""

    questions: Questions
    information: Information  # that all flights so far give
    beliefs: List[Belief]
    open: List[Question]  # the questions that more flights can decide


class Test(NamedTuple):
    """What flights tell of an effect that a model does not have."""

    acts: float  # probability that it acts
    matters: float  # probability that it matters, if it acts
    size: float  # estimate, in sizes that matter


@dataclass(frozen=True)
class Group:
    """An effect that was found, and those that the flights do not distinguish from it."""

    values: Mapping[str, float]  # of each as the one that acts, 2 ln of likelihoods; the found one first
    ratio: float  # of the likelihoods with and without the found one, 2 ln


def found_by(found: StepwiseDiagnosis) -> Dict[str, Group]:
    """The Groups of a StepwiseDiagnosis, by the effects that it found."""
    search, groups = found.search, {}
    for step in found.steps:
        sets = {name: (found.names - {step.added}) | {name} for name in step.group}
        values = {name: search.value(s) if s in search.fits else -np.inf for name, s in sets.items()}
        ratio = search.ratio(found.names, search.without(found.names, step.added))
        groups[step.added] = Group(values, float(ratio))
    return groups


def before(basis: Basis, information: Information, sizes: Mapping[str, float]) -> State:
    """The State before the first flight; information: without any."""
    asked = [Question(name, doubt=_doubt(PRIOR)) for name in basis.columns]
    asked += [Question(name, doubt=PARTLY) for name in basis.free]
    questions = Questions(basis, information.scale, sizes, {}, asked)
    tests = _Known(basis, information, sizes, {}).tests()
    beliefs = [Belief(name, PRIOR * test.matters, OPEN, 0.0, None) for name, test in tests.items()]
    return State(questions, information, beliefs, asked)


def after(
    groups: Mapping[str, Group],
    small: Collection[str],
    basis: Basis,
    information: Information,
    sizes: Mapping[str, float],
    reachable: Array,
    noise: float,
) -> State:
    """The State after a diagnosis of all flights. groups: by the effects that were found; small: effects
    that are too small to matter or were refused; basis: of the grown model and the effects that it does
    not have; information: of all flights, at the grown model; reachable: information matrix of the
    flights that may still come; noise: error that the poses' noise leaves, relative to the error of the
    model without effects."""
    known = _Known(basis, information, sizes, groups)
    tests = known.tests()
    probability = known.probabilities(tests)
    questions = known.questions(probability)
    now = questions.visibility(information.matrix)
    later = questions.visibility(information.matrix + reachable)
    rivals = {q.rival for q in questions.asked}
    beliefs: List[Belief] = []
    still_open: List[Question] = []
    for question, seen, could in zip(questions.asked, now, later):
        name, is_effect = question.about, not question.rival and question.about in basis.columns
        if is_effect and name in rivals:
            continue  # the question which of the two acts covers it
        decided = seen >= DECIDED
        if is_effect:
            doubtful = probability[name] > DOUBTFUL and name not in small
            decided &= not doubtful or seen >= GLARING * DECIDED
            test = tests[name]
            state = OPEN if could >= DECIDED else HIDDEN
            if decided:
                state = _decided_state(test)
            matters, share = probability[name] * test.matters, min(1.0, noise * test.size)
            beliefs.append(Belief(name, matters, state, float(seen), share))
        if not decided and could >= DECIDED:
            still_open.append(question)
    for name, group in groups.items():
        undecided = any(q.about == name and q.rival for q in still_open)
        size = known.size(name)
        state = OPEN if undecided else HIDDEN if len(group.values) > 1 else PRESENT
        state = SLIGHT if known.matters(name) < DOUBTFUL else state
        share = min(1.0, noise * size)
        beliefs += [Belief(m, probability[m], state, group.ratio, share) for m in group.values]
    return State(questions, information, sorted(beliefs, key=lambda b: -b.probability), still_open)


def _decided_state(test: Test) -> str:
    """State of an effect that the flights so far would show, and that the diagnosis did not choose."""
    if test.acts <= LIKELY:
        return ABSENT
    return SLIGHT if test.matters <= LIKELY else HIDDEN  # something else explains as much


@dataclass(frozen=True)
class _Known:
    """What flights tell of the effects of a Basis. See `after`."""

    basis: Basis
    information: Information
    sizes: Mapping[str, float]
    groups: Mapping[str, Group]

    def tests(self) -> Dict[str, Test]:
        """The Test of each effect that the model does not have."""
        basis, count = self.basis, len(self.basis.free)
        A, s = self.information.matrix, self.information.score
        onto = solve(A[:count, :count], A[:count, count:])
        left = A[count:, count:] - A[count:, :count] @ onto
        score = s[count:] - s[:count] @ onto
        found = {}
        for name, columns in basis.columns.items():
            at = np.array(columns) - count
            sizes = np.array([self.sizes[basis.names[i]] for i in columns])
            unit = SPREAD * sizes / self.information.scale[columns]
            a = np.eye(len(at)) + left[np.ix_(at, at)] * np.outer(unit, unit)
            b = score[at] * unit
            mean, covariance = np.linalg.solve(a, b), np.linalg.inv(a)
            gain = 0.5 * b @ mean - 0.5 * np.linalg.slogdet(a)[1]
            acts = _probability(float(np.log(PRIOR / (1 - PRIOR)) + gain))
            drawn = np.random.default_rng(0).multivariate_normal(mean, covariance, DRAWS)
            matters = float(np.mean(SPREAD * np.linalg.norm(drawn, axis=1) >= 1))
            found[name] = Test(acts, matters, float(SPREAD * np.linalg.norm(mean)))
        return found

    def probabilities(self, tests: Mapping[str, Test]) -> Dict[str, float]:
        """Probability that each effect acts. Members of a group share the probability of the found one."""
        probability = {name: test.acts for name, test in tests.items()}
        for name, group in self.groups.items():
            one_of_them = _probability(self._found_odds(group.ratio, name))
            best = max(group.values.values())
            weights = {member: np.exp(0.5 * (v - best)) for member, v in group.values.items()}
            for member, weight in weights.items():
                probability[member] = float(weight / sum(weights.values()) * one_of_them)
        return probability

    def questions(self, probability: Mapping[str, float]) -> Questions:
        """Everything that may still be asked. probability: that each effect acts."""
        basis = self.basis
        asked = [Question(name, doubt=_doubt(probability[name])) for name in basis.columns]
        for name, group in self.groups.items():
            asked += [Question(name, m) for m in group.values if m != name and m in basis.columns]
        asked += [Question(name, doubt=PARTLY) for name in basis.free if "." not in name]
        acting = {n: self._coordinate(n) for name in self.groups for n in basis.parameters(name)}
        return Questions(basis, self.information.scale, self.sizes, acting, asked)

    def size(self, name: str) -> float:
        """Size of a found effect, in sizes that matter; very large where these are not known."""
        own = self.basis.parameters(name)
        sizes = [self._coordinate(n) / self.sizes.get(n, 1e-9) for n in own]
        return float(np.linalg.norm(sizes))

    def matters(self, name: str) -> float:
        """Probability that a found effect matters; 1 where it is not known what matters."""
        own = self.basis.parameters(name)
        if not all(n in self.sizes for n in own):
            return 1.0
        mean = [self._coordinate(n) / self.sizes[n] for n in own]
        covariance = SPREAD**2 * np.linalg.inv(np.eye(len(own)) + self._left(name))
        drawn = np.random.default_rng(0).multivariate_normal(mean, covariance, DRAWS)
        return float(np.mean(np.linalg.norm(drawn, axis=1) >= 1))

    def _found_odds(self, ratio: float, name: str) -> float:
        """Log odds of an effect of the grown model. ratio: of likelihoods with and without it, 2 ln."""
        left = self._left(name)
        cost = np.linalg.slogdet(np.eye(len(left)) + left)[1]
        return float(np.log(PRIOR / (1 - PRIOR)) + 0.5 * (ratio - cost))

    def _left(self, name: str) -> Array:
        """Information about a found effect's parameters, in SPREAD sizes that matter, that is left when
        the other parameters are fitted, too."""
        own = [self.basis.free.index(n) for n in self.basis.parameters(name)]
        rest = [i for i in range(len(self.basis.free)) if i not in own]
        A = self.information.matrix
        into = A[np.ix_(rest, own)]
        left = A[np.ix_(own, own)] - into.T @ solve(A[np.ix_(rest, rest)], into)
        scale = self.information.scale[own]
        sizes = [self.sizes.get(self.basis.free[i], s) for i, s in zip(own, scale)]
        unit = SPREAD * np.array(sizes) / scale
        return np.asarray(left * np.outer(unit, unit))

    def _coordinate(self, name: str) -> float:
        """Distance of a parameter's coordinate from where it does nothing."""
        model = self.basis.model
        value, neutral = model.value(name), described(model)[name].neutral
        return float(1 / value if np.isinf(neutral) else value - neutral)


def _probability(log_odds: float) -> float:
    return float(1 / (1 + np.exp(-np.clip(log_odds, -LARGEST, LARGEST))))


def _doubt(probability: float) -> float:
    return float(2 * np.sqrt(probability * (1 - probability)))
