"""What the whitened innovations of a filter still depend on: a linear regression with white noise.

    e = D a + J t + n,  n ~ N(0, I)

e: innovations of the fitted grey-box filter. D: their responses to the wrenches of features. J:
their derivatives by the free parameters, and by a delay of all commands, which are projected out
of both. The weights a of a term, one feature or a family of them, are normal with a common size;
the ratio of marginal likelihoods with and without a term is the test of it. Its distribution
without an effect follows from the eigenvalues of the term's information.
"""

import copy
from dataclasses import dataclass
from typing import AbstractSet, Dict, Iterator, List, NamedTuple, Optional, Sequence, Set, Tuple

import numpy as np

from ground.analysis import dictionary
from ground.analysis.dictionary import Feature
from ground.analysis.distributions import LEVEL, chi_squared_above
from ground.analysis.innovations import Innovations
from ground.analysis.missing_wrench import full_scale
from ground.analysis.samples import Samples
from ground.analysis.window_error import PARTS
from ground.support.annotations import Array, Flags, Indices

SIZES = np.geomspace(1e-4, 1.0, 17) ** 2  # variances of a term's wrench, over full thrust squared
DRAWS = 2000
MIN_RATIO = 8.0  # ratio below which a family is not worth its draws
MIN_SHARE = 0.02  # least share of the samples in which a feature acts, by the fourth moment
SEEN = 0.03  # least share of a feature's information that the parameters leave
MAX_TERMS = 8  # terms
REFUSED = 3  # terms that held-out parts may refuse
AS_GOOD = 0.97  # part of the significance of a feature with which one with a factor less takes its place
SORTS = 5  # of single features, by the number that they were chosen from
KEPT_FAMILIES = 6
WIDEST = 130  # features of a family that is tested as a whole


@dataclass(frozen=True, eq=False)
class Term:
    """One feature, or several with a common size."""

    name: str
    columns: Indices
    variance: float = 0.0  # of its wrench, over full thrust squared
    ratio: float = 0.0  # of the marginal likelihoods, 2 ln
    p_value: float = 1.0


class Posterior(NamedTuple):
    """Columns of terms, covariance and mean of their weights."""

    columns: Indices
    covariance: Array
    mean: Array


class Regression:
    """The regression of innovations on features. sampled: Samples of each run; tried: number of features that
    each was chosen from."""

    def __init__(
        self, of: Innovations, features: Sequence[Feature], sampled: Sequence[Samples], tried: Sequence[float]
    ) -> None:
        self.innovations, self.sampled, self.y, self.model = of, sampled, of.y, of.fit.model
        self.full = full_scale(self.model)
        self.edges = np.cumsum([0] + [len(s.times) for s in sampled])  # of the runs, in all samples
        self.parts = self._parts()
        # orthonormal columns that span what parameters can follow
        followed = np.concatenate([dictionary.followed(self.model, s) for s in sampled]) / self.full[:, None]
        left, sizes, _ = np.linalg.svd(followed.reshape(-1, followed.shape[2]), full_matrices=False)
        self._basis = left[:, sizes > 1e-9 * sizes.max()]
        self.features: List[Feature] = []
        self.wrenches, self.scale = np.empty((self.edges[-1], 3, 0)), np.empty(0)
        self.D, self.active = np.empty((len(self.y), 0)), np.empty(0, bool)
        self.tried = np.empty(0)  # number of features that each was chosen from
        self._add(features, tried)
        self.families = self._families()

    def extended(self, features: Sequence[Feature], tried: Sequence[float]) -> "Regression":
        """The same with more features. tried: number of features that each was chosen from."""
        longer = copy.copy(self)
        longer._add(features, tried)
        return longer

    def again(self, of: Innovations, columns: Indices) -> "Regression":
        """The Regression of other innovations on some of the features."""
        return Regression(of, [self.features[j] for j in columns], self.sampled, self.tried[columns].tolist())

    # The linear system

    def _parts(self) -> List[Tuple[slice, slice]]:
        """Parts that are predicted from the others, each run or the quarters of a single run: rows of the
        regression, and samples of all runs."""
        rows, edges = self.innovations.rows, self.edges
        if len(self.sampled) == 1:
            edges = np.linspace(0, edges[-1], PARTS + 1).astype(int)
            rows = np.array([0, *self.innovations.rows_before(0, edges[1:-1]), rows[-1]])
        rows_of, spans = ([slice(a, b) for a, b in zip(ends[:-1], ends[1:])] for ends in (rows, edges))
        return list(zip(rows_of, spans))

    def _add(self, features: Sequence[Feature], tried: Sequence[float]) -> None:
        wrenches, moved, active = self.responses(features)
        # of each feature, so that its wrench has a mean square of 1
        scale = 1 / np.sqrt(np.maximum((wrenches**2).sum(axis=(0, 1)) / len(wrenches), 1e-30))
        moved *= scale
        D = self.innovations.projected(moved)
        active &= (D * D).sum(axis=0) > np.maximum(SEEN * (moved * moved).sum(axis=0), 1e-9)
        D[:, ~active] = 0.0
        self.features = [*self.features, *features]
        self.tried = np.append(self.tried, tried)
        self.wrenches = np.concatenate([self.wrenches, wrenches], axis=2)
        self.scale, self.active = np.append(self.scale, scale), np.append(self.active, active)
        self.D = np.hstack([self.D, D])
        self.b, self.information = self.D.T @ self.y, (self.D * self.D).sum(axis=0)
        self.alone = self.posterior([])

    def responses(self, features: Sequence[Feature]) -> Tuple[Array, Array, Flags]:
        """Wrenches (n, 3, k) of features, over full thrust, less what parameters can follow: their weights
        would run away with these; what they change in the innovations (rows, k), not projected; and which of
        them act in enough samples to be learned, beside the parameters."""
        acting = np.concatenate([dictionary.wrenches(features, self.model, s) for s in self.sampled])
        A = (acting / self.full[:, None]).reshape(-1, len(features))
        before = (A * A).sum(axis=0)
        A -= self._basis @ (self._basis.T @ A)
        square = A * A
        power = square.sum(axis=0)
        acts = power**2 / np.maximum((square * square).sum(axis=0), 1e-300) / len(A)
        active = (power > SEEN * before) & (before > 0) & (acts > MIN_SHARE)
        A[:, ~active] = 0.0
        wrenches = A.reshape(acting.shape)
        by_run = np.split(wrenches * self.full[:, None], self.edges[1:-1])
        return wrenches, self.innovations.responses(by_run), active

    def _families(self) -> List[Term]:
        """Families, and their parts that act on the same channels."""
        by_name: Dict[str, List[int]] = {}
        for j, feature in enumerate(self.features):
            if self.active[j] and feature.family:
                part = "%s (%s)" % (feature.family, ", ".join(feature.channel.parts))
                for name in (feature.family, part):
                    by_name.setdefault(name, []).append(j)
        once: Dict[Tuple[int, ...], str] = {}
        for name, columns in by_name.items():
            once.setdefault(tuple(columns), name)
        return [Term(name, np.array(at)) for at, name in once.items() if 1 < len(at) <= WIDEST]

    # Tests

    def _columns(self, terms: Sequence[Term]) -> Tuple[Indices, Array]:
        """Columns of terms, and the variances of their weights."""
        variance = np.zeros(len(self.features))
        for term in terms:
            variance[term.columns] += term.variance / len(term.columns)
        at = np.flatnonzero(variance)
        return at, variance[at]

    def posterior(self, terms: Sequence[Term]) -> Posterior:
        """The Posterior of terms."""
        at, variances = self._columns(terms)
        D = self.D[:, at]
        covariance = np.linalg.inv(D.T @ D + np.diag(1 / variances))
        return Posterior(at, covariance, covariance @ self.b[at])

    def significance(self, beside: Posterior) -> Array:
        """Squared score of each feature over its variance, beside chosen terms; 0 where these or the
        parameters leave too little of it."""
        cross = self.D[:, beside.columns].T @ self.D
        information = self.information - ((beside.covariance @ cross) * cross).sum(axis=0)
        seen = self.active & (information > SEEN * self.information) & (information > 0)
        return np.where(seen, (self.b - cross.T @ beside.mean) ** 2 / np.where(seen, information, 1.0), 0.0)

    def best_single(self, z: Array, but: int = 0) -> int:
        """The most significant feature, as if the number that each was chosen from were part of it, but some;
        in its plainest form. z: significance of each."""
        order = np.argsort(-np.where(z > 0, z - 2 * np.log(self.tried), -np.inf))
        return self._plainest(int(order[min(but, len(order) - 1)]), z)

    def _plainest(self, j: int, z: Array) -> int:
        """The feature that has fewer factors than j and is nearly as significant, or j."""
        for simpler in self.features[j].simpler:
            near = np.flatnonzero(z > AS_GOOD * z[j])
            alike = [k for k in near if self.features[k].dependence == simpler.dependence]
            if alike:
                return self._plainest(max(alike, key=lambda k: float(z[k])), z)
        return j

    def test(self, columns: Indices, beside: Posterior, name: str = "") -> Term:
        """The Term of some columns, beside chosen terms."""
        shares, ratios = self._ratios(columns, beside)
        best = int(np.argmax(ratios))
        ratio = max(0.0, float(ratios[best]))
        return Term(name, columns, float(SIZES[best]), ratio, _chance(ratio, shares))

    def largest(self, columns: Indices, behind: float, beside: Posterior) -> float:
        """Largest variance of columns' wrench beside terms whose log-likelihood ratio is not `behind` the
        best one; 0 if all are."""
        _, ratios = self._ratios(columns, beside)
        allowed = np.flatnonzero(ratios > max(0.0, float(ratios.max())) - behind)
        return float(SIZES[allowed[-1]]) if len(allowed) else 0.0

    def _ratios(self, columns: Indices, beside: Posterior) -> Tuple[Array, Array]:
        """Eigenvalues of the information of columns beside terms times each of SIZES, and the ratios of
        the marginal likelihoods with and without them, 2 ln."""
        D = self.D[:, columns]
        cross = self.D[:, beside.columns].T @ D
        values, vectors = np.linalg.eigh(D.T @ D - cross.T @ beside.covariance @ cross)
        kept = values > max(1e-9 * values.max(), 1e-12)
        values, score = values[kept], self.b[columns] - cross.T @ beside.mean
        z = (vectors[:, kept].T @ score) ** 2 / values
        shares = SIZES[:, None] / len(columns) * values
        return shares, (shares / (1 + shares)) @ z - np.log1p(shares).sum(axis=1)

    def choose(self) -> List[Term]:
        """Terms that are significant, each beside the others, and that raise the likelihood of
        parts which they were not fitted to."""
        terms: List[Term] = []
        refused: Set[str] = set()
        gain = 0.0
        while len(terms) < MAX_TERMS and len(refused) < REFUSED:
            best = self._best(terms, refused)
            if best is None:
                break
            longer = self._resized([*terms, best])
            reached = self._gain(longer)
            if reached > gain:
                terms, gain = longer, reached
            else:
                refused.add(best.name)
        return terms

    def _best(self, terms: Sequence[Term], refused: AbstractSet[str]) -> Optional[Term]:
        """The likeliest significant term beside others; None without one. Half of the level is for single
        features."""
        beside, found = self.posterior(terms), []
        z = self.significance(beside)
        for but in range(len(refused) + 1):
            j = self.best_single(z, but)
            name = self.features[j].label
            if name not in refused:
                if chi_squared_above(float(z[j]), 1) * self.tried[j] < LEVEL / 2 / SORTS:
                    found.append(self.test(np.array([j]), beside, name))
                break
        for family in self.families:
            if family.name not in refused:
                tested = self.test(family.columns, beside, family.name)
                if tested.p_value < LEVEL / 2 / len(self.families):
                    found.append(tested)
        return max(found, key=lambda t: t.ratio) if found else None

    def _resized(self, terms: Sequence[Term]) -> List[Term]:
        """Terms with their sizes and ratios beside the others; without those that do nothing there."""
        kept = list(terms)
        for _ in range(2):
            for term in kept:
                rest = [t for t in kept if t is not term]
                tested = self.test(term.columns, self.posterior(rest), term.name)
                stays = tested.ratio > MIN_RATIO or not rest
                kept = [tested if t is term else t for t in kept if t is not term or stays]
        return kept

    # Predictions

    def _by_part(self, terms: Sequence[Term]) -> Iterator[Tuple[slice, slice, Indices, Array]]:
        """Rows and samples of each part, the columns of terms, and their weights from all other parts."""
        at, variances = self._columns(terms)
        D = self.D[:, at]
        whole = D.T @ D + np.diag(1 / variances)
        for rows, span in self.parts:
            own = D[rows]
            yield rows, span, at, np.linalg.solve(whole - own.T @ own, self.b[at] - own.T @ self.y[rows])

    def _gain(self, terms: Sequence[Term]) -> float:
        """Log-likelihood that terms gain on each part, fitted to the others, together."""
        total = 0.0
        for rows, _, at, weights in self._by_part(terms):
            change = self.D[rows][:, at] @ weights
            total += float(change @ (self.y[rows] - change / 2))
        return total

    def predicted(self, terms: Sequence[Term]) -> List[Array]:
        """Wrench (n, 3) along each run, each part predicted from the others [N], [N m]."""
        wrenches = np.zeros(self.wrenches.shape[:2])
        for _, span, at, weights in self._by_part(terms):
            wrenches[span] = self.wrenches[span][:, :, at] @ (self.scale[at] * weights) * self.full
        return np.split(wrenches, self.edges[1:-1])

    def promising(self, most: int, terms: Sequence[Term]) -> Indices:
        """Columns of terms, of the families that may act, and the most significant others."""
        families = [self.test(t.columns, self.alone, t.name) for t in self.families]
        kept = sorted((t for t in families if t.ratio > 0), key=lambda t: -t.ratio)[:KEPT_FAMILIES]
        best = np.argsort(-self.significance(self.alone))[:most]
        return np.asarray(np.unique(np.concatenate([best, *(t.columns for t in [*kept, *terms])])))


def _chance(ratio: float, shares: Array) -> float:
    """Probability of so large a ratio without an effect."""
    if ratio <= MIN_RATIO:
        return 1.0
    drawn = np.random.default_rng(shares.shape[1]).chisquare(1, size=(DRAWS, shares.shape[1]))
    null = drawn @ (shares / (1 + shares)).T - np.log1p(shares).sum(axis=1)
    null = np.maximum(null.max(axis=1), 0.0)
    # beyond the draws, an exponential tail through the largest 5%
    start = np.quantile(null, 0.95)
    tail = null[null > start] - start
    mean = max(2.0, float(tail.mean())) if len(tail) else 2.0
    return float(0.05 * np.exp(-max(0.0, ratio - start) / mean))
