"""A screen of some 1.5 million products of functions for the few that are worth an exact test.

Each is a product of two scalars (ground.analysis.scalars), such as a wave in the plane and a velocity, on
one channel. The score of all of them at once is a product of matrices: with g the response of the
innovations to a unit wrench at each sample, times the innovations, the score of p(t) q(t) along e(t) is
the sum of p q (e . g).
Its variance without an effect is that of the same sum for random innovations. The best products are
multiplied with a third scalar, and screened again.
"""

from dataclasses import replace
from typing import Any, Dict, List, NamedTuple, Sequence

import numpy as np

from ground import _core
from ground.analysis import channels, dictionary, scalars
from ground.analysis.channels import Channel
from ground.analysis.dictionary import Feature, product
from ground.analysis.distributions import chi_squared_above
from ground.analysis.likelihood import Likelihood
from ground.analysis.regression import LEVEL, Regression
from ground.analysis.samples import Samples, Scales, evaluated, namespace
from ground.analysis.scalars import ONE, Scalar, product_of_units, written
from ground.recordings import scatter, windows
from ground.support.annotations import Array, Indices

BIN = 1 / 30  # samples that are taken together [windows]
RANDOM = 8  # draws of innovations that give the variance of a score
TOGETHER = 500  # products of one form that are computed together
KEPT = 120  # products that are tested exactly
KEPT_OF_ONE = 30  # ... of them on one channel
LENGTHENED = 40  # best products of two that are multiplied with a third
REFINED = 10  # features whose constants are moved
ITERATIONS = 5
NEARBY = 1e-3  # move of a constant for a derivative, over its reach
LONGEST = 0.5  # move in one iteration, over its reach
CONSTANT = 3.0  # number of independent features for each that is tested, by a constant that is moved


class Product(NamedTuple):
    """A product of scalars on a channel."""

    value: float  # squared score over its variance, less for the number that it was chosen from
    tried: int  # that number
    channel: Channel
    first: Scalar
    second: Scalar


class _Narrow(NamedTuple):
    """Scalars that all others are multiplied with, the first is ONE, and their values by bins."""

    scalars: Sequence[Scalar]
    values: Array  # (bins, narrow, longest)


class Screen:
    """Scores of products at the samples of all runs. sampled: of each run of a Likelihood."""

    def __init__(self, likelihood: Likelihood, model: _core.Model, sampled: Sequence[Samples]) -> None:
        self.sampled, scales = sampled, Scales.of(sampled)
        self.edges = _bins(sampled, BIN * windows.length(likelihood.runs))
        ends = np.append(self.edges, sum(len(s.times) for s in sampled))
        self.middles = self.edges + np.diff(ends) // 2
        few = scalars.few(model, scales)
        x, y = (np.concatenate([s.values[name] for s in sampled]) for name in "xy")
        self.acting, motion = channels.channels(model, scales), scalars.of_motion(model, scales, sampled)
        self.thirds = self._narrow([ONE, *map(_renamed, few[1:])])
        narrow, every = self._narrow(few), [*motion, *scalars.of_place(scales, x, y)]
        values, waves = self._wide(every), scalars.waves(scales, x, y)
        self.products = [
            (self.acting, every, values, narrow),
            (self.acting, waves, self._wide(waves), self._narrow([ONE, *scalars.turns()])),
            (channels.pulls(scales, x, y), motion, values[:, : len(motion)], narrow),
        ]

    def screened(self, regression: Regression, model: _core.Model) -> Regression:
        """The Regression with the products that have the largest scores."""
        draws = np.concatenate(regression.innovations.scores(RANDOM))
        found = [p for those in self.products for p in self._best(model, draws, *those)]
        found = sorted(found, key=lambda product: -product.value)
        best_last = {(p.first.text, p.second.text): p for p in reversed(found) if p.second is not ONE}
        begun = sorted(best_last.values(), key=lambda product: -product.value)[:LENGTHENED]
        if begun:
            longer = [_product(p.first, p.second) for p in begun]
            tried = max(p.tried for p in begun) // len(longer)
            found += self._best(model, draws, self.acting, longer, self._wide(longer), self.thirds, tried)
        found = sorted(found, key=lambda product: -product.value)[:KEPT]
        features = [product(p.channel, [p.first, p.second]) for p in found]
        wrenches = [dictionary.wrenches(features, model, s) for s in self.sampled]
        return regression.extended(features, wrenches, [p.tried for p in found])

    def _wide(self, wide: Sequence[Scalar]) -> Array:
        """Values (bins, wide) in the middles of the bins."""
        return _values(wide, self.sampled, self.middles)

    def _narrow(self, narrow: Sequence[Scalar]) -> _Narrow:
        every = self._binned(_values(narrow, self.sampled, slice(None)))
        return _Narrow(narrow, every.transpose(0, 2, 1))

    def _binned(self, values: Array) -> Array:
        """Values (n, k) at all samples, by bins (bins, longest, k); zero behind the end of a shorter one."""
        sizes = np.diff(np.append(self.edges, len(values)))
        inside = np.arange(len(values)) - np.repeat(self.edges, sizes)
        binned = np.zeros((len(sizes), sizes.max(), values.shape[1]), np.float32)
        binned[np.repeat(np.arange(len(sizes)), sizes), inside] = values
        return binned

    def _best(
        self,
        model: _core.Model,
        draws: Array,
        acting: Sequence[Channel],
        wide: Sequence[Scalar],
        values: Array,
        narrow: _Narrow,
        of: int = 1,
    ) -> List[Product]:
        """The KEPT_OF_ONE best products on each channel of wide scalars, with their values, and narrow ones.
        draws: scores of innovations; of: number of others that each wide scalar was chosen from."""
        units = [product(channel, []) for channel in acting]
        directions = np.concatenate([dictionary.wrenches(units, model, s) for s in self.sampled])
        singles = len(acting) * len(wide) * of
        pairs, found = singles * (len(narrow.scalars) - 1), []
        for channel, e in zip(acting, directions.transpose(2, 0, 1)):
            z = _scores(values, narrow.values @ self._binned(np.einsum("ij,ijk->ik", e, draws)))
            z[:, 0] -= 2 * np.log(singles)
            z[:, 1:] -= 2 * np.log(pairs)
            for at in np.argpartition(-z.ravel(), KEPT_OF_ONE)[:KEPT_OF_ONE].tolist():
                i, j = divmod(at, len(narrow.scalars))
                second = narrow.scalars[j]
                tried = singles if second is ONE else pairs
                found.append(Product(float(z[i, j]), tried, channel, wide[i], second))
        return found


def _product(first: Scalar, second: Scalar) -> Scalar:
    return Scalar(
        "(%s)*(%s)" % (first.text, second.text),
        product_of_units([first.unit, second.unit]),
        first.arguments | second.arguments,
        {**first.constants, **second.constants},
        first.memory + second.memory,
    )


def _renamed(scalar: Scalar) -> Scalar:
    """The scalar with other names for its constants, as the third of a product."""
    text = scalar.text
    for name in scalar.constants:
        text = text.replace("{%s}" % name, "{%s3}" % name)
    return replace(scalar, text=text, constants={n + "3": c for n, c in scalar.constants.items()})


def _scores(P: Array, weighted: Array) -> Array:
    """Squared scores of all products of P (bins, wide) and Q over their variances. weighted: (bins, narrow,
    1 + RANDOM), sums over each bin of Q times the response of the innovations and of random ones."""
    count = weighted.shape[2]
    scores = np.ascontiguousarray(weighted.transpose(2, 1, 0)).reshape(-1, len(P)) @ P
    scores = scores.reshape(count, -1, P.shape[1])
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


def _values(of: Sequence[Scalar], sampled: Sequence[Samples], at: Any) -> Array:
    """Scalars (n, k) at some samples of all runs, each over its root mean square; alike ones together."""
    spaces = [namespace(s) for s in sampled]
    known = {
        name: np.concatenate([space[name] for space in spaces])[at] if np.ndim(value) else value
        for name, value in spaces[0].items()
    }
    variables = {name: value[:, None] if np.ndim(value) else value for name, value in known.items()}
    values = np.empty((len(known["t"]), len(of)), np.float32)
    by_text: Dict[str, List[int]] = {}
    for k, scalar in enumerate(of):
        by_text.setdefault(scalar.text, []).append(k)
    for text, alike in by_text.items():
        for first in range(0, len(alike), TOGETHER):
            columns = alike[first : first + TOGETHER]
            names = {name: "constant_" + name for name in of[columns[0]].constants}
            constants = {
                own: np.array([written(of[k].constants[name]) for k in columns])
                for name, own in names.items()
            }
            found = evaluated(text.format(**names), {**variables, **constants})
            values[:, columns] = found / np.maximum(np.sqrt((found**2).mean(axis=0)), 1e-300)
    return values


def refined(regression: Regression, model: _core.Model, sampled: Sequence[Samples]) -> Regression:
    """The Regression with its most significant features, and those with a factor less, at the constants that
    suit best: at others a second factor may make up for what is wrong with the first."""
    z, tried_of = regression.significance(), regression.tried
    best = [
        j
        for j in np.argsort(2 * np.log(tried_of) - z)[:REFINED].tolist()
        if regression.features[j].constants and chi_squared_above(float(z[j]), 1) * tried_of[j] < LEVEL
    ]
    if not best:
        return regression
    counted = {_key(regression.features[j]): (regression.features[j], tried_of[j]) for j in best}
    for j in best:
        for simpler in regression.features[j].simpler:
            if len(counted) < 2 * REFINED and simpler.constants:
                counted.setdefault(_key(simpler), (simpler, tried_of[j]))
    started = [feature for feature, _ in counted.values()]
    features, values = started, [0.0] * len(started)
    moved = started
    for _ in range(ITERATIONS):
        tried = [f for feature in moved for f in [feature, *_nearby(feature)]]
        D = regression.projected([dictionary.wrenches(tried, model, s) for s in sampled])
        at, following = 0, []
        for i, (feature, start) in enumerate(zip(moved, started)):
            own = D[:, at : at + 1 + len(feature.constants)]
            at += own.shape[1]
            power = float(own[:, 0] @ own[:, 0])
            reached = float(own[:, 0] @ regression.y) ** 2 / max(power, 1e-300)
            if reached > values[i]:
                values[i], features = reached, [*features[:i], feature, *features[i + 1 :]]
            following.append(_step(feature, start, own, regression.y))
        moved = following
    counts = [float(n) * CONSTANT ** len(f.constants) for f, (_, n) in zip(features, counted.values())]
    return regression.extended(features, [dictionary.wrenches(features, model, s) for s in sampled], counts)


def _key(feature: Feature) -> str:
    return repr(sorted(feature.parts.items()))


def _nearby(feature: Feature) -> List[Feature]:
    """The feature with each of its constants moved a little."""
    return [feature.at({n: c.value + NEARBY * c.reach}) for n, c in feature.constants.items()]


def _step(feature: Feature, start: Feature, D: Array, y: Array) -> Feature:
    """The feature at the constants of a step of Gauss and Newton's method. D: responses (rows, 1 + k) to the
    feature and to those nearby."""
    reach = np.array([c.reach for c in feature.constants.values()])
    A = np.column_stack([D[:, 0], D[:, 1:] - D[:, :1]])
    size = np.maximum(np.sqrt((A**2).sum(axis=0)), 1e-300)
    weights = np.linalg.lstsq(A / size, y, rcond=1e-6)[0] / size
    step = np.zeros(len(reach)) if weights[0] == 0 else weights[1:] / weights[0] * NEARBY
    step = np.clip(np.nan_to_num(step), -LONGEST, LONGEST) * reach
    values = {}
    for (name, c), move in zip(feature.constants.items(), step):
        first = start.constants[name]
        values[name] = float(np.clip(c.value + move, first.value - first.reach, first.value + first.reach))
    return feature.at(values)
