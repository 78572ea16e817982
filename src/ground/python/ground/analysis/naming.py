"""A name for what is learnable and has none: a formula with units.

Features whose formulas mean something by themselves are chosen one after the other in the last
regression of the ceiling. Their constants (phases, wavelengths, points) become parameters, and the
likelihood fits all of them in the model. A formula is an effect as model files list it.
"""

from dataclasses import dataclass, replace
from typing import Callable, Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import candidates, formula_words
from ground.analysis.dictionary import Feature, dependence
from ground.analysis.distributions import chi_squared_above
from ground.analysis.formula_words import Piece
from ground.analysis.likelihood import Fit, Likelihood
from ground.analysis.regression import LEVEL, Regression, Term
from ground.support.annotations import Document
from ground.support.errors import GroundError

NAME = "proposed"
MOST = 5  # features that are chosen from one regression
MIN_RATIO = 12.0  # least log-likelihood ratio 2 ln(with / without) of a feature
EXPLAINED = 0.98  # part of the terms' gain from which a formula needs no further feature
LONGEST = 6  # pieces of a formula
WIDE = 5.0  # factor by which a fit may change a constant of time


@dataclass(frozen=True)
class Formula:
    """A proposal: an effect that the library does not have."""

    entry: Document  # as model files list effects, its parameters fitted
    means: str  # in words
    fit: Fit  # of the model with it
    ratio: float  # of the likelihoods with and without it, 2 ln
    pieces: Tuple[Piece, ...] = ()

    def in_words(self, model: _core.Model, name: str) -> str:
        """What it means at the values of a model that has it by this name."""
        values = {n: model.value("%s.%s" % (name, n)) for piece in self.pieces for n in piece.parameters}
        return formula_words.of_pieces(self.pieces, values)


def formula(
    likelihood: Likelihood,
    fit: Fit,
    regression: Regression,
    begun: Optional[Formula] = None,
    shows: Callable[[Formula], bool] = lambda made: True,
) -> Optional[Formula]:
    """The Formula of what a regression finds beside a Fit; None if nothing is significant. begun: a formula
    beside which it was found, to be made longer; shows: whether one is worth its simplest form."""
    kept = begun.pieces if begun else ()
    pieces = _new_pieces(regression, _chosen_features(regression)[: LONGEST - len(kept)], begun)
    return _of_pieces(likelihood, fit, [*kept, *pieces], begun, shows) if pieces else None


def _chosen_features(regression: Regression) -> List[Term]:
    """Significant single features that mean something, each beside those before it."""
    allowed = np.array([f.family.named for f in regression.features])
    terms: List[Term] = []
    while len(terms) < MOST:
        z = np.where(allowed, regression.significance(terms), 0.0)
        j = regression.plainest(int(np.argmax(np.where(z > 0, z - 2 * np.log(regression.tried), -np.inf))), z)
        if chi_squared_above(float(z[j]), 1) * regression.tried[j] > LEVEL:
            break
        term = regression.test(np.array([j]), terms, "feature %d" % j)
        if term.ratio < max(MIN_RATIO, (1 - EXPLAINED) * sum(t.ratio for t in terms)):
            break
        terms.append(term)
    return terms


def _new_pieces(regression: Regression, chosen: Sequence[Term], begun: Optional[Formula]) -> List[Piece]:
    """The pieces of chosen features, numbered on from those of a formula."""
    if not chosen:
        return []
    at, _, weights = regression.posterior(chosen)
    first = 1 + max([piece.number for piece in (begun.pieces if begun else ())], default=0)
    return [
        _piece(regression.features[j], float(weight * regression.scale[j]), first + i)
        for i, (j, weight) in enumerate(zip(at, weights))
    ]


def _of_pieces(
    likelihood: Likelihood,
    fit: Fit,
    pieces: Sequence[Piece],
    begun: Optional[Formula],
    shows: Callable[[Formula], bool],
) -> Optional[Formula]:
    """The Formula of those pieces that earn their place, in their simplest form that is as likely; begun: a
    shorter one, whose form is kept."""
    made = _fitted(likelihood, fit, pieces, begun.fit if begun else fit)
    if made is not None and not shows(made):
        return None
    while made is not None and len(made.pieces) > 1:
        worth = [_worth(made.fit, piece) for piece in made.pieces]
        if min(worth) > MIN_RATIO:
            break
        least = made.pieces[int(np.argmin(worth))]
        shorter = _fitted(likelihood, fit, [p for p in made.pieces if p is not least], made.fit)
        if shorter is None or made.ratio - shorter.ratio > MIN_RATIO:
            break
        made = shorter
    if made is None or begun:
        return made
    for i, piece in enumerate(made.pieces):
        for simpler in piece.simpler:
            pieces = [*made.pieces[:i], simpler, *made.pieces[i + 1 :]]
            other = _fitted(likelihood, fit, pieces, made.fit)
            if other is not None and made.ratio - other.ratio < MIN_RATIO:
                made = other
    return made


def _worth(fit: Fit, piece: Piece) -> float:
    """Squared ratio of the size of a piece to its standard deviation, roughly the log-likelihood ratio to
    the formula without it."""
    size = next(p for p in fit.parameters if p["name"].split(".")[-1] == piece.size)
    return float(size["value"] / size["deviation"]) ** 2 if size["identified"] else 0.0


# Pieces


def _enclosed(text: str) -> str:
    """A text in one pair of parentheses."""
    depth = 0
    for i, letter in enumerate(text):
        depth += {"(": 1, ")": -1}.get(letter, 0)
        if depth == 0:
            return text if i == len(text) - 1 > 0 else "(%s)" % text
    return "(%s)" % text


def _piece(feature: Feature, size: float, number: int) -> Piece:
    """The piece of a feature of a size."""
    name = "c%d" % number
    own = {n: "%s_%d" % (n, number) for n in feature.constants}
    parts = {c: "%s*%s" % (name, _enclosed(text.format(**own))) for c, text in feature.template.items()}
    parameters = {name: (size, feature.weight_unit, -np.inf, np.inf)}
    for n, c in feature.constants.items():
        parameters[own[n]] = (c.value, c.unit, c.value - c.reach, c.value + c.reach)
    # Pieces with the same states share their constants of time.
    times = {
        n: c for n, c in feature.memory.times.items() if any(n in r for r in feature.memory.rates.values())
    }
    parameters.update({n: (c.value, c.unit, c.value / WIDE, c.value * WIDE) for n, c in times.items()})
    states = {s: rate.format(**{n: n for n in times}) for s, rate in feature.memory.rates.items()}
    means = formula_words.of_feature(feature, name, own)
    arguments = tuple(sorted(feature.family.arguments))
    simpler = tuple(_piece(one, size, number) for one in feature.simpler)
    return Piece(number, parts, parameters, means, arguments, dependence(feature), states, simpler)


# The formula in the model


def _fitted(likelihood: Likelihood, fit: Fit, pieces: Sequence[Piece], near: Fit) -> Optional[Formula]:
    """The Formula of pieces, fitted in the model of a Fit, from the levels of another one near; None where
    that fails or helps nothing."""
    values: Dict[str, float] = {}
    entry = _entry(pieces, fit)
    model = fit.model
    try:
        start = candidates.from_entry(entry, "the formula", model).neutral(model)
        for piece in pieces:
            for name, (value, _, _, _) in piece.parameters.items():
                values[name] = value
                start.set_value("%s.%s" % (entry["name"], name), value)
        free = tuple("%s.%s" % (entry["name"], name) for name in values)
        fitted = likelihood.fit(start, fit.free + free, near=near)
        if not np.isfinite(fitted.log_posterior):
            return None
    except GroundError:
        return None
    ratio = 2 * (fitted.log_posterior - fit.log_posterior)
    if ratio < MIN_RATIO:
        return None
    values = {name: fitted.model.value("%s.%s" % (entry["name"], name)) for name in values}
    reached = tuple(_moved(piece, values) for piece in pieces)
    return Formula(_entry(reached, fit), formula_words.of_pieces(reached, values), fitted, ratio, reached)


def _moved(piece: Piece, values: Mapping[str, float]) -> Piece:
    """A piece at fitted values."""
    parameters = {name: (values[name], *p[1:]) for name, p in piece.parameters.items()}
    return replace(piece, parameters=parameters)


def _entry(pieces: Sequence[Piece], fit: Fit) -> Document:
    expression: Dict[str, str] = {}
    states: Dict[str, str] = {}
    parameters: Document = {}
    for piece in pieces:
        for channel, text in piece.parts.items():
            expression[channel] = "+".join(filter(None, [expression.get(channel), text]))
        states.update(piece.states)
        for name, (value, unit, lower, upper) in piece.parameters.items():
            scale = 0.3 * max(abs(value), 1e-12)
            if np.isfinite(lower):
                scale = max(scale, 0.005 * (upper - lower))
            else:
                lower, upper = -3e3 * scale, 3e3 * scale
            numbers = {
                "value": value, "neutral": 0.0 if name == piece.size else value, "scale": scale,
                "lower": lower, "upper": upper,
            }  # fmt: skip
            parameters[name] = {"unit": unit, **{key: float(n) for key, n in numbers.items()}}
    name = NAME
    while name in fit.model.effects:
        name += "_"
    entry: Document = {"name": name, "expression": expression, "parameters": parameters}
    return {"name": name, "states": states, **entry} if states else entry
