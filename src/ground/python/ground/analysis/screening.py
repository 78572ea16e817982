"""A screen of some 1.5 million products of functions for the few that are worth an exact test.

Each is a product of two scalars (ground.analysis.scalars), such as a wave in the plane and a velocity, on
one channel. The score of all of them at once is a product of matrices: with g the response of the
innovations to a unit wrench at each sample, times the innovations, the score of p(t) q(t) along e(t) is
the sum of p q (e . g).
Its variance without an effect is the variance of the same sum for random innovations. The best products are
multiplied with a third scalar, and screened again.
"""

from typing import Dict, List, NamedTuple, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import channels, dictionary, samples, scalars, windows
from ground.analysis.channels import Channel
from ground.analysis.dictionary import Feature
from ground.analysis.distributions import LEVEL, chi_squared_above
from ground.analysis.likelihood import Likelihood
from ground.analysis.regression import Regression
from ground.analysis.samples import Samples, Scales, evaluated
from ground.analysis.scalars import ONE, Scalar, filled, product_of_units
from ground.poses import scatter
from ground.support.annotations import Array, Indices

BIN = 1 / 30  # samples that are taken together [windows]
RANDOM = 8  # draws of innovations that give the variance of a score
KEPT = 120  # products that are tested exactly
KEPT_OF_ONE = 30  # ... of them on one channel
LENGTHENED = 40  # best products of two that are multiplied with a third
REFINED = 10  # features whose constants are moved
NEARBY = 1e-3  # move of a constant for a derivative, over its reach
MAX_MOVE = 0.5  # move in one iteration, over its reach
CONSTANT = 3.0  # number of independent features for each that is tested, by a constant that is moved


class ProductScreening(NamedTuple):
    """Products of wide scalars and narrow ones, of which the first is ONE, on channels."""

    acting: Sequence[Channel]
    wide: Sequence[Scalar]
    narrow: Sequence[Scalar]
    of: int = 1  # candidates of each wide scalar, for the correction by the number of tests


# A product; its squared score over its variance, less for the number that it was chosen from; and that number
Product = Tuple[Feature, float, int]


class Screen:
    """Scores of products at the samples of all runs. sampled: of each run of a Likelihood."""

    def __init__(self, likelihood: Likelihood, model: _core.Model, sampled: Sequence[Samples]) -> None:
        self.sampled, self.every, scales = sampled, samples.together(sampled), Scales.of(sampled)
        self.edges = _bins(sampled, BIN * windows.length(likelihood.runs))
        ends = np.append(self.edges, len(self.every["t"]))
        self.middles = {name: values[self.edges + np.diff(ends) // 2] for name, values in self.every.items()}
        x, y = self.every["x"], self.every["y"]
        self.acting, motion = channels.channels(model, scales), scalars.of_motion(model, scales, self.every)
        few = scalars.few(model, scales)
        self.thirds = [ONE, *map(_renamed, few[1:])]
        self.searches = [
            ProductScreening(self.acting, [*motion, *scalars.of_place(scales, x, y)], few),
            ProductScreening(self.acting, scalars.waves(scales, x, y), [ONE, *scalars.turns()]),
            ProductScreening(channels.pulls(scales, x, y), motion, few),
        ]

    def screened(self, regression: Regression) -> Regression:
        """The Regression with the products that have the largest scores."""
        draws = np.concatenate(regression.innovations.scores(RANDOM))
        model = regression.model
        found = _sorted([p for search in self.searches for p in self._best(model, draws, search)])
        pairs = [p for p in reversed(found) if len(p[0].factors) > 1]
        best_last = {tuple(scalar.text for scalar in p[0].factors): p for p in pairs}
        begun = _sorted(list(best_last.values()))[:LENGTHENED]
        if begun:
            longer = [_product(*feature.factors) for feature, _, _ in begun]
            tried = max(tried for _, _, tried in begun) // len(longer)
            found += self._best(model, draws, ProductScreening(self.acting, longer, self.thirds, tried))
        features, _, tried_of = zip(*_sorted(found)[:KEPT])
        return regression.extended(features, tried_of)

    def _best(self, model: _core.Model, draws: Array, search: ProductScreening) -> List[Product]:
        """The KEPT_OF_ONE best products on each channel. draws: scores of innovations."""
        acting, wide, narrow, of = search
        units = [Feature(channel) for channel in acting]
        directions = np.concatenate([dictionary.wrenches(units, model, s) for s in self.sampled])
        P, Q = _values(wide, self.middles), _values(narrow, self.every)
        singles, found = len(acting) * len(wide) * of, []
        tried = np.array([singles, *[singles * (len(narrow) - 1)] * (len(narrow) - 1)])
        for channel, e in zip(acting, directions.transpose(2, 0, 1)):
            scores = np.einsum("ij,ijk->ik", e, draws)
            weighted = np.array([np.add.reduceat(q[:, None] * scores, self.edges) for q in Q.T], np.float32)
            z = _scores(P, weighted) - 2 * np.log(tried)
            for at in np.argpartition(-z.ravel(), KEPT_OF_ONE)[:KEPT_OF_ONE].tolist():
                i, j = divmod(at, len(narrow))
                factors = [scalar for scalar in (wide[i], narrow[j]) if scalar is not ONE]
                found.append((Feature(channel, factors), float(z[i, j]), int(tried[j])))
        return found


def _sorted(found: List[Product]) -> List[Product]:
    return sorted(found, key=lambda product: -product[1])


def _product(first: Scalar, second: Scalar) -> Scalar:
    text = "(%s)*(%s)" % (first.text, second.text)
    return Scalar(text, product_of_units([first.unit, second.unit]), {**first.constants, **second.constants})


def _renamed(scalar: Scalar) -> Scalar:
    """The scalar with other names for its constants, as the third of a product."""
    constants = {name + "3": c for name, c in scalar.constants.items()}
    return scalar._replace(text=scalar.text.replace("}", "3}"), constants=constants)


def _scores(P: Array, weighted: Array) -> Array:
    """Squared scores of all products of P (bins, wide) and Q over their variances. weighted: (narrow, bins,
    1 + RANDOM), sums over each bin of Q times the response of the innovations and of random ones."""
    rows = np.ascontiguousarray(weighted.transpose(2, 0, 1)).reshape(-1, len(P))  # one product of matrices
    scores = (rows @ P).reshape(1 + RANDOM, -1, P.shape[1])
    variance = np.einsum("kij,kij->ij", scores[1:], scores[1:]) / RANDOM
    kept = variance > 1e-9 * variance.max()
    return np.asarray(np.where(kept, scores[0] ** 2 / np.maximum(variance, 1e-30), 0.0)).T


def _bins(sampled: Sequence[Samples], width: float) -> Indices:
    """First samples of the bins of all runs, one after the other. width: of a bin [s]."""
    edges, before = [], 0
    for s in sampled:
        step = max(1, int(round(width / scatter.interval(s.times))))
        edges.append(before + np.arange(0, len(s.times), step))
        before += len(s.times)
    return np.concatenate(edges)


def _values(of: Sequence[Scalar], every: Dict[str, Array]) -> Array:
    """Scalars (n, k), each over its root mean square. every: values by the names in formulas."""
    found = np.empty((len(every["t"]), len(of)), np.float32)
    for k, scalar in enumerate(of):
        values = evaluated(filled(scalar.text, scalar.constants), every)
        found[:, k] = values / max(float(np.sqrt((values**2).mean())), 1e-150)  # its square is no zero
    return found


def refined(regression: Regression) -> Regression:
    """The Regression with its most significant features, and those with a factor less, at the constants that
    suit best, after five steps: at others a second factor may make up for what is wrong with the first."""
    z, tried_of, features = regression.significance(regression.alone), regression.tried, regression.features
    best = [
        j
        for j in np.argsort(2 * np.log(tried_of) - z)[:REFINED].tolist()
        if features[j].constants and chi_squared_above(float(z[j]), 1) * tried_of[j] < LEVEL
    ]
    if not best:
        return regression
    counted = {features[j].label: (features[j], tried_of[j]) for j in best}
    for j in best:
        for simpler in features[j].simpler:
            if len(counted) < 2 * REFINED and simpler.constants:
                counted.setdefault(simpler.label, (simpler, tried_of[j]))
    started, tried = zip(*counted.values())
    moved, reached = list(started), [(0.0, feature) for feature in started]
    for _ in range(5):
        nearby = [[feature, *_nearby(feature)] for feature in moved]
        D = regression.innovations.projected(regression.responses(sum(nearby, []))[1])
        for i, own in enumerate(np.split(D, np.cumsum([len(some) for some in nearby])[:-1], axis=1)):
            value = float(own[:, 0] @ regression.y) ** 2 / max(float(own[:, 0] @ own[:, 0]), 1e-300)
            if value > reached[i][0]:
                reached[i] = value, moved[i]
            moved[i] = _step(moved[i], started[i], own, regression.y)
    best_of = [feature for _, feature in reached]
    counts = [float(n) * CONSTANT ** len(f.constants) for f, n in zip(best_of, tried)]
    return regression.extended(best_of, counts)


def _nearby(feature: Feature) -> List[Feature]:
    """The feature with each of its constants moved a little."""
    return [feature.at({n: c.value + NEARBY * c.reach}) for n, c in feature.constants.items()]


def _step(feature: Feature, start: Feature, D: Array, y: Array) -> Feature:
    """The feature at the constants of a step of Gauss and Newton's method. D: responses (rows, 1 + k) to the
    feature and to those nearby."""
    A = np.column_stack([D[:, 0], D[:, 1:] - D[:, :1]])
    size = np.maximum(np.sqrt((A**2).sum(axis=0)), 1e-300)
    weights = np.linalg.lstsq(A / size, y, rcond=1e-6)[0] / size
    step = np.zeros(len(weights) - 1) if weights[0] == 0 else weights[1:] / weights[0] * NEARBY
    step = np.clip(np.nan_to_num(step), -MAX_MOVE, MAX_MOVE)
    values = {}
    for (name, c), first, move in zip(feature.constants.items(), start.constants.values(), step):
        low, high = first.value - first.reach, first.value + first.reach
        values[name] = float(np.clip(c.value + move * c.reach, low, high))
    return feature.at(values)
