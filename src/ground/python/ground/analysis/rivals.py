"""Rivals of a formula: others that explain nearly as much, by other features.

Where the arguments of two formulas went together, as heading and place of a craft that flew circles,
runs do not tell which of them is true. Other flights do, unless both are the same function in other words.
"""

import re
from dataclasses import replace
from typing import Dict, List, Sequence

import numpy as np

from ground import _core
from ground.analysis import dictionary, naming, samples
from ground.analysis.ceiling import Found
from ground.analysis.dictionary import Family, Feature
from ground.analysis.formula_words import Piece
from ground.analysis.likelihood import Fit, Likelihood
from ground.analysis.naming import Formula
from ground.analysis.regression import Regression, Term
from ground.analysis.samples import Samples
from ground.support.annotations import Array

MOST = 2  # rivals
TRIED = 4  # formulas
LINEAR = 0.8  # part of the best formula's gain in the regression that is worth a fit
SAME = 0.99  # correlation of wrenches from which two formulas are the same


def rivals(likelihood: Likelihood, fit: Fit, found: Found, best: Formula, behind: float) -> List[Formula]:
    """Up to MOST Formulas, the best first, with other features in the place of a piece of the best
    formula: of other arguments, or of another dependence. behind: value from which one that is behind the
    best formula is left out."""
    regression, made = found.regression, [best]
    labels = [dictionary.dependence(f) for f in regression.features]
    sampled = [samples.of_run(likelihood, fit, i) for i in range(len(likelihood.runs))]
    tried = 0
    for piece in best.pieces:
        alike = [bool(f.family.arguments & set(piece.arguments)) for f in regression.features]
        kept = [other for other in best.pieces if other is not piece]
        beside = _best_of(regression, labels, kept)
        least = LINEAR * _gain(regression, [*beside, *_best_of(regression, labels, [piece])])
        for barred in (np.array(alike), np.array([label == piece.dependence for label in labels])):
            chosen = naming.chosen_features(regression, ~barred, beside)
            if not chosen or _gain(regression, [*beside, *chosen]) < least or tried == TRIED:
                continue
            tried += 1
            pieces = naming.new_pieces(regression, chosen, best)
            other = naming.of_pieces(likelihood, fit, [*kept, *pieces], best)
            if other is None or best.value - other.value > behind:
                continue
            if not any(_same(other, known, fit.model, sampled) for known in made):
                made.append(other)
    return sorted(made[1:], key=lambda f: -f.value)[:MOST]


def _best_of(regression: Regression, labels: Sequence[str], pieces: Sequence[Piece]) -> List[Term]:
    """The Terms of the most significant feature of the dependence of each piece."""
    terms: List[Term] = []
    for piece in pieces:
        z = np.where([label == piece.dependence for label in labels], regression.significance(terms), 0.0)
        if z.max() > 0:
            terms.append(regression.test(np.array([int(np.argmax(z))]), terms, piece.dependence))
    return terms


def _gain(regression: Regression, terms: Sequence[Term]) -> float:
    """Log-likelihood ratio of terms in the regression, 2 ln."""
    if not terms:
        return 0.0
    at, _, weights = regression.posterior(terms)
    return float(regression.b[at] @ weights)


def _same(first: Formula, second: Formula, model: _core.Model, sampled: Sequence[Samples]) -> bool:
    """Whether two formulas act alike where arguments vary independently of each other."""
    family, random = Family("formulas", frozenset(), True), np.random.default_rng(0)
    features = [Feature(_filled(f), "-", family) for f in (first, second)]
    mixed = [_mixed(s, random) for s in sampled]
    W = np.concatenate([dictionary.wrenches(features, model, s) for s in mixed]).reshape(-1, 2)
    a, b = W.T
    return bool(a @ b > SAME * np.sqrt((a @ a) * (b @ b)))


def _filled(formula: Formula) -> Dict[str, str]:
    """The formulas of each channel with the values of their parameters."""
    values = {name: p["value"] for name, p in formula.entry["parameters"].items()}
    names = re.compile(r"\b(%s)\b" % "|".join(values))
    return {
        channel: names.sub(lambda found: "(%r)" % values[found.group()], text)
        for channel, text in formula.entry["expression"].items()
    }


def _mixed(sampled: Samples, random: np.random.Generator) -> Samples:
    """Samples whose values have been mixed, each by itself."""

    def mix(values: Dict[str, Array]) -> Dict[str, Array]:
        return {name: random.permutation(v) for name, v in values.items()}

    return replace(sampled, values=mix(sampled.values), states=mix(sampled.states))
