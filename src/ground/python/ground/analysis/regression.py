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
from typing import AbstractSet, Dict, List, Optional, Sequence, Set, Tuple

import numpy as np

from ground.analysis.dictionary import Feature, dependence
from ground.analysis.distributions import chi_squared_above
from ground.analysis.innovations import Innovations
from ground.analysis.likelihood import Fit, Likelihood
from ground.analysis.missing_wrench import full_scale
from ground.support.annotations import Array, Flags, Indices

LEVEL = 0.01  # probability that a term is chosen where nothing is missing
SIZES = np.geomspace(1e-4, 1.0, 17) ** 2  # variances of a term's wrench, over full thrust squared
DRAWS = 2000
LEAST = 8.0  # ratio below which a family is not worth its draws
FEWEST = 0.02  # least share of the samples in which a feature acts, by the fourth moment
SEEN = 0.03  # least share of a feature's information that the parameters leave
MOST = 8  # terms
REFUSED = 3  # terms that held-out parts may refuse
PARTS = 4  # of a single run
AS_GOOD = 0.97  # part of the significance of a feature with which one with a factor less takes its place
SORTS = 5  # of single features, by the number that they were chosen from
KEPT_FAMILIES = 6
WIDEST = 130  # features of a family that is tested as a whole


@dataclass(frozen=True)
class Term:
    """One feature, or several with a common size."""

    name: str
    columns: Indices
    variance: float = 0.0  # of its wrench, over full thrust squared
    ratio: float = 0.0  # of the marginal likelihoods, 2 ln
    p_value: float = 1.0


@dataclass(frozen=True)
class Part:
    """A part of the runs that is predicted from the others."""

    run: int
    rows: Indices  # of the regression
    span: slice  # samples of the run


class Regression:
    """The regression of a Fit's innovations on features. acting: their wrenches (n, 3, features)
    along each run; followed: wrenches (n, 3, k) that the model's parameters can follow; tried: number
    of features that each was chosen from, by default all."""

    def __init__(
        self,
        likelihood: Likelihood,
        fit: Fit,
        features: Sequence[Feature],
        acting: Sequence[Array],
        followed: Sequence[Array],
        tried: Sequence[float] = (),
    ) -> None:
        self.likelihood, self.fit = likelihood, fit
        self.full = full_scale(fit.model)
        self._own = followed
        self._basis = _basis([w / self.full[:, None] for w in followed])
        self.innovations = Innovations(likelihood, fit)
        self.y = self.innovations.y
        self.features: List[Feature] = []
        self.wrenches = [np.empty((len(run.times), 3, 0)) for run in likelihood.runs]
        self.D, self.scale = np.empty((len(self.y), 0)), np.empty(0)
        self.products, self.b = np.empty((0, 0)), np.empty(0)
        self.active: Flags = np.empty(0, bool)
        self.tried = np.empty(0)  # number of features that each was chosen from
        self._acting = [np.empty((len(run.times), 3, 0)) for run in likelihood.runs]
        self._add(features, acting, tried if len(tried) else [len(features)] * len(features))
        self.terms = self._families()

    def extended(
        self, features: Sequence[Feature], acting: Sequence[Array], tried: Sequence[float]
    ) -> "Regression":
        """The same with more features. tried: number of features that each was chosen from."""
        longer = copy.copy(self)
        longer._add(features, acting, tried)
        return longer

    # The linear system

    def _add(self, features: Sequence[Feature], acting: Sequence[Array], tried: Sequence[float]) -> None:
        wrenches, kept = self._left_of(acting)
        power = sum(np.einsum("ijk,ijk->k", w, w) for w in wrenches) / sum(len(w) for w in wrenches)
        # of each feature, so that its wrench has a mean square of 1
        scale = 1 / np.sqrt(np.maximum(power, 1e-30))
        D = self.innovations.responses([w * (self.full[:, None] * scale) for w in wrenches])
        raw = np.einsum("ij,ij->j", D, D)
        D = self.innovations.projected(D)
        kept &= np.einsum("ij,ij->j", D, D) > np.maximum(SEEN * raw, 1e-9)
        D[:, ~kept] = 0.0
        across, own = self.D.T @ D, D.T @ D
        self.features = [*self.features, *features]
        self.tried = np.concatenate([self.tried, tried])
        self._acting = [np.concatenate(pair, axis=2) for pair in zip(self._acting, acting)]
        self.wrenches = [np.concatenate(pair, axis=2) for pair in zip(self.wrenches, wrenches)]
        self.scale = np.concatenate([self.scale, scale])
        self.active = np.concatenate([self.active, kept])
        self.D = np.hstack([self.D, D])
        self.products = np.block([[self.products, across], [across.T, own]])
        self.information = np.diag(self.products).copy()
        self.b = np.concatenate([self.b, D.T @ self.y])
        self._last: Optional[Tuple[Sequence[Term], Tuple[Indices, Array, Array]]] = None

    def _left_of(self, acting: Sequence[Array]) -> Tuple[List[Array], Flags]:
        return _without([w / self.full[:, None] for w in acting], self._basis)

    def projected(self, acting: Sequence[Array]) -> Array:
        """Responses (rows, k) to wrenches (n, 3, k) along each run, without what parameters can follow."""
        wrenches, _ = self._left_of(acting)
        return self.innovations.projected(
            self.innovations.responses([w * self.full[:, None] for w in wrenches])
        )

    def _families(self) -> List[Term]:
        """Families, and their parts that act on the same channels."""
        by_family: Dict[str, List[int]] = {}
        for j, feature in enumerate(self.features):
            if self.active[j] and feature.family.whole:
                by_family.setdefault(feature.family.name, []).append(j)
        found = []
        for name, columns in by_family.items():
            by_channels: Dict[Tuple[str, ...], List[int]] = {}
            for j in columns:
                by_channels.setdefault(tuple(self.features[j].parts), []).append(j)
            parts = [(name, columns)] + [
                ("%s (%s)" % (name, ", ".join(c)), part)
                for c, part in by_channels.items()
                if len(part) < len(columns)
            ]
            found += [Term(label, np.array(part)) for label, part in parts if 1 < len(part) <= WIDEST]
        return found

    # Tests

    def _cross(self, first: Indices, second: Optional[Indices] = None) -> Array:
        """Products of some columns of D with others, or with all."""
        return np.asarray(self.products[first] if second is None else self.products[np.ix_(first, second)])

    def _columns(self, terms: Sequence[Term]) -> Tuple[Indices, Array]:
        """Columns of terms, and the variances of their weights."""
        variance: Dict[int, float] = {}
        for term in terms:
            for j in term.columns.tolist():
                variance[j] = variance.get(j, 0.0) + term.variance / len(term.columns)
        at = np.array(sorted(variance))
        return at, np.array([variance[j] for j in at])

    def posterior(self, terms: Sequence[Term]) -> Tuple[Indices, Array, Array]:
        """Columns of terms, covariance and mean of their weights. Many are tested beside the same terms."""
        last = self._last
        if last is None or list(map(id, last[0])) != list(map(id, terms)):
            at, variances = self._columns(terms)
            inverse = np.linalg.inv(self._cross(at, at) + np.diag(1 / variances))
            last = self._last = list(terms), (at, inverse, inverse @ self.b[at])
        return last[1]

    def single(self, beside: Sequence[Term] = ()) -> Tuple[Array, Array]:
        """Information and score of each feature beside chosen terms."""
        if not beside:
            return self.information, self.b
        at, inverse, mean = self.posterior(beside)
        cross = self._cross(at)
        return self.information - ((inverse @ cross) * cross).sum(axis=0), self.b - cross.T @ mean

    def significance(self, beside: Sequence[Term] = ()) -> Array:
        """Squared score of each feature over its variance, beside chosen terms; 0 where these or the
        parameters leave too little of it."""
        information, score = self.single(beside)
        seen = self.active & (information > SEEN * self.information) & (information > 0)
        return np.where(seen, score**2 / np.where(seen, information, 1.0), 0.0)

    def test(self, columns: Indices, beside: Sequence[Term] = (), name: str = "") -> Term:
        """The Term of some columns, beside chosen terms."""
        shares, ratios = self._ratios(columns, beside)
        best = int(np.argmax(ratios))
        ratio = max(0.0, float(ratios[best]))
        return Term(name, columns, float(SIZES[best]), ratio, _chance(ratio, shares))

    def largest(self, columns: Indices, behind: float, beside: Sequence[Term] = ()) -> float:
        """Largest variance of columns' wrench beside terms whose log-likelihood ratio is not `behind` the
        best one; 0 if all are."""
        _, ratios = self._ratios(columns, beside)
        allowed = np.flatnonzero(ratios > max(0.0, float(ratios.max())) - behind)
        return float(SIZES[allowed[-1]]) if len(allowed) else 0.0

    def _ratios(self, columns: Indices, beside: Sequence[Term]) -> Tuple[Array, Array]:
        """Eigenvalues of the information of columns beside terms times each of SIZES, and the ratios of
        the marginal likelihoods with and without them, 2 ln."""
        G, b = self._cross(columns, columns), self.b[columns]
        if beside:
            at, inverse, mean = self.posterior(beside)
            cross = self._cross(at, columns)
            G, b = G - cross.T @ inverse @ cross, b - cross.T @ mean
        values, vectors = np.linalg.eigh(G)
        kept = values > max(1e-9 * values.max(), 1e-12)
        values, z = values[kept], (vectors[:, kept].T @ b) ** 2 / values[kept]
        shares = SIZES[:, None] / len(columns) * values
        return shares, (shares / (1 + shares)) @ z - np.log1p(shares).sum(axis=1)

    def choose(self, parts: Sequence["Part"]) -> List[Term]:
        """Terms that are significant, each beside the others, and that raise the likelihood of
        parts which they were not fitted to."""
        terms: List[Term] = []
        refused: Set[str] = set()
        gain = 0.0
        while len(terms) < MOST and len(refused) < REFUSED:
            best = self._best(terms, refused)
            if best is None:
                break
            longer = self._resized([*terms, best])
            reached = self.gain(longer, parts)
            if reached > gain:
                terms, gain = longer, reached
            else:
                refused.add(best.name)
        return terms

    def _best(self, terms: Sequence[Term], refused: AbstractSet[str]) -> Optional[Term]:
        """The likeliest significant term beside others; None without one. Half of the level is for single
        features, which are compared as if the number that each was chosen from were part of it."""
        z = self.significance(terms)
        worth = np.where(z > 0, z - 2 * np.log(self.tried), -np.inf)
        found = []
        for j in np.argsort(-worth)[: len(refused) + 1].tolist():
            j = self.plainest(j, z)
            if self.label(j) not in refused:
                if chi_squared_above(float(z[j]), 1) * self.tried[j] < LEVEL / 2 / SORTS:
                    found.append(self.test(np.array([j]), terms, self.label(j)))
                break
        for family in self.terms:
            if family.name not in refused:
                tested = self.test(family.columns, terms, family.name)
                if tested.ratio > LEAST and tested.p_value < LEVEL / 2 / len(self.terms):
                    found.append(tested)
        return max(found, key=lambda t: t.ratio) if found else None

    def plainest(self, j: int, z: Array) -> int:
        """The feature that has fewer factors than j and is nearly as significant, or j; z: significance of
        each."""
        for simpler in self.features[j].simpler:
            wanted = dependence(simpler)
            alike = [k for k in np.flatnonzero(z > AS_GOOD * z[j]) if dependence(self.features[k]) == wanted]
            if alike:
                return self.plainest(max(alike, key=lambda k: float(z[k])), z)
        return j

    def _resized(self, terms: Sequence[Term]) -> List[Term]:
        """Terms with their sizes and ratios beside the others; without those that do nothing there."""
        kept = list(terms)
        for _ in range(2):
            for term in list(kept):
                rest = [t for t in kept if t is not term]
                tested = self.test(term.columns, rest, term.name)
                at = kept.index(term)
                if tested.ratio > LEAST or len(kept) == 1:
                    kept[at] = tested
                else:
                    kept.pop(at)
        return kept

    # Predictions

    def _of_part(self, part: "Part", terms: Sequence[Term]) -> Tuple[Indices, Array, Array, Array]:
        """Columns of terms, their weights from all other parts, and the part's own products."""
        at, variances = self._columns(terms)
        D, y = self.D[np.ix_(part.rows, at)], self.y[part.rows]
        own, b = D.T @ D, D.T @ y
        rest = self._cross(at, at) - own + np.diag(1 / variances)
        return at, np.linalg.solve(rest, self.b[at] - b), own, b

    def gain(self, terms: Sequence[Term], parts: Sequence["Part"]) -> float:
        """Log-likelihood that terms gain on each part, fitted to the others, together."""
        total = 0.0
        for part in parts:
            _, weights, own, b = self._of_part(part, terms)
            total += float(weights @ b - 0.5 * weights @ own @ weights)
        return total

    def predicted(self, terms: Sequence[Term], parts: Sequence["Part"]) -> List[Array]:
        """Wrench (n, 3) along each run, each part predicted from the others [N], [N m]."""
        wrenches = [np.zeros((len(w), 3)) for w in self.wrenches]
        for part in parts:
            at, weights, _, _ = self._of_part(part, terms)
            wrenches[part.run][part.span] = self.wrench(part.run, at, weights)[part.span]
        return wrenches

    def parts(self) -> List["Part"]:
        """Each run, or the quarters of a single run."""
        if len(self.wrenches) > 1:
            rows = [np.arange(a, b) for a, b in zip(self.innovations.rows[:-1], self.innovations.rows[1:])]
            return [Part(i, r, slice(None)) for i, r in enumerate(rows)]
        edges = np.linspace(0, len(self.wrenches[0]), PARTS + 1).astype(int)
        rows = np.split(np.arange(len(self.y)), self.innovations.rows_before(0, edges[1:-1]))
        return [Part(0, r, slice(a, b)) for r, a, b in zip(rows, edges[:-1], edges[1:])]

    def wrench(self, i: int, at: Indices, weights: Array) -> Array:
        """Wrench (n, 3) of weighted features along a run [N], [N m]."""
        return np.asarray((self.wrenches[i][:, :, at] * self.scale[at]) @ weights * self.full)

    def again(self, likelihood: Likelihood, fit: Fit, columns: Indices) -> "Regression":
        """The Regression of another fit's innovations on some of the features."""
        return Regression(
            likelihood, fit, [self.features[j] for j in columns],
            [wrench[:, :, columns] for wrench in self._acting], self._own, self.tried[columns].tolist(),
        )  # fmt: skip

    def promising(self, most: int, terms: Sequence[Term]) -> Indices:
        """Columns of terms, of the families that may act, and the most significant others."""
        families = [self.test(t.columns, (), t.name) for t in self.terms]
        kept = sorted((t for t in families if t.ratio > 0), key=lambda t: -t.ratio)[:KEPT_FAMILIES]
        whole = {j for term in [*kept, *terms] for j in term.columns.tolist()}
        best = np.argsort(-self.significance())[:most]
        return np.array(sorted(whole | set(best.tolist())))

    def arguments(self, term: Term) -> AbstractSet[str]:
        """What a term depends on."""
        return self.features[int(term.columns[0])].family.arguments

    def label(self, j: int) -> str:
        """A feature in words of its formulas."""
        return ", ".join("%s: %s" % part for part in self.features[j].parts.items())


def _basis(followed: Sequence[Array]) -> Array:
    """Orthonormal columns (3 n of all runs, k) that span what parameters can follow."""
    W = np.concatenate([w.reshape(-1, w.shape[2]) for w in followed])
    left, sizes, _ = np.linalg.svd(W, full_matrices=False)
    return np.asarray(left[:, sizes > 1e-9 * sizes.max()])


def _without(acting: Sequence[Array], followed: Array) -> Tuple[List[Array], Flags]:
    """Features (n, 3, m) of each run without what is followed (_basis), and which of them are left. Their
    weights would run away with the parameters."""
    A = np.concatenate([a.reshape(-1, a.shape[2]) for a in acting])
    before = np.einsum("ij,ij->j", A, A)
    A -= followed @ (followed.T @ A)
    square = A * A
    power = square.sum(axis=0)
    # what acts in a few samples alone cannot be learned
    acts = power**2 / np.maximum(np.einsum("ij,ij->j", square, square), 1e-300) / len(A)
    kept = (power > SEEN * before) & (before > 0) & (acts > FEWEST)
    A[:, ~kept] = 0.0
    edges = np.cumsum([0] + [3 * len(a) for a in acting])
    return [A[i:j].reshape(-1, 3, A.shape[1]) for i, j in zip(edges[:-1], edges[1:])], kept


def _chance(ratio: float, shares: Array) -> float:
    """Probability of so large a ratio without an effect."""
    if ratio <= LEAST:
        return 1.0
    drawn = np.random.default_rng(shares.shape[1]).chisquare(1, size=(DRAWS, shares.shape[1]))
    null = drawn @ (shares / (1 + shares)).T - np.log1p(shares).sum(axis=1)
    null = np.maximum(null.max(axis=1), 0.0)
    above = int((null >= ratio).sum())
    if above > 20:
        return above / DRAWS
    # beyond the draws, an exponential tail through the largest 5%
    start = np.quantile(null, 0.95)
    tail = null[null > start] - start
    mean = max(2.0, float(tail.mean())) if len(tail) else 2.0
    return float(0.05 * np.exp(-max(0.0, ratio - start) / mean))
