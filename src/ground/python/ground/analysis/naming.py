"""A name for what is learnable and has none: a formula with units.

Features whose formulas mean something by themselves are chosen one after the other in the last
regression of the ceiling. Their constants (phases, wavelengths, points) become parameters, and the
likelihood fits all of them in the model. A formula is an effect as model files list it.
"""

from dataclasses import dataclass, replace
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np

from ground import _core
from ground.analysis import formula_words, samples
from ground.analysis.dictionary import Feature
from ground.analysis.distributions import LEVEL, chi_squared_above
from ground.analysis.formula_words import FormulaTerm
from ground.analysis.likelihood import Likelihood, LikelihoodFit
from ground.analysis.regression import Regression, Term
from ground.analysis.samples import Memory
from ground.effect_library import candidates
from ground.support.errors import Diverged

NAME = "proposed"  # of the effect
MIN_RATIO = 12.0  # least log-likelihood ratio 2 ln(with / without) of a feature
EXPLAINED = 0.98  # part of the terms' gain from which a formula needs no further feature
MAX_FEATURES, MAX_PIECES = 5, 6  # features that are chosen from one regression, and pieces of a formula
WIDE = 5.0  # factor by which a fit may change a constant of time


@dataclass(frozen=True)
class Formula:
    """A proposal: an effect that the library does not have."""

    entry: Mapping[str, Any]  # as model files list effects, its parameters fitted
    means: str  # in words
    fit: LikelihoodFit  # of the model with it
    ratio: float  # of the likelihoods with and without it, 2 ln
    pieces: Tuple[FormulaTerm, ...]

    def in_words(self, model: _core.Model, name: str) -> str:
        """What it means at the values of a model that has it by this name."""
        values = {n: model.value("%s.%s" % (name, n)) for piece in self.pieces for n in piece.parameters}
        return formula_words.of_pieces(self.pieces, values)


def formula(
    likelihood: Likelihood,
    fit: LikelihoodFit,
    regression: Regression,
    begun: Optional[Formula] = None,
    shows: Callable[[Formula], bool] = lambda made: True,
) -> Optional[Formula]:
    """The Formula of what a regression finds beside a LikelihoodFit; None if nothing is significant. begun: a
    formula beside which it was found, to be made longer; shows: whether one is worth its simplest form."""
    kept = begun.pieces if begun else ()
    chosen = _chosen_features(regression)[: MAX_PIECES - len(kept)]
    if not chosen:
        return None
    at, _, weights = regression.posterior(chosen)
    memory = samples.memory(regression.model, regression.sampled[0].time_scale)
    first = 1 + max([piece.number for piece in kept], default=0)
    pieces = [
        _piece(regression.features[j], size, first + i, memory)
        for i, (j, size) in enumerate(zip(at, (weights * regression.scale[at]).tolist()))
    ]
    longer = with_room_for_states(kept, pieces)
    if len(longer) == len(kept):
        return None
    made = _fitted(likelihood, fit, longer, begun.fit if begun else fit)
    if made is None or not shows(made):
        return None
    made = _shortened(likelihood, fit, made)
    return made if begun else _simplified(likelihood, fit, made)


def with_room_for_states(kept: Sequence[FormulaTerm], more: Sequence[FormulaTerm]) -> List[FormulaTerm]:
    """Pieces, and as many more, in their order, as one effect can hold with their states."""
    pieces = list(kept)
    for piece in more:
        if len({state for one in (*pieces, piece) for state in one.states}) <= _core.max_effect_states:
            pieces.append(piece)
    return pieces


def _chosen_features(regression: Regression) -> List[Term]:
    """Significant single features that mean something, each beside those before it."""
    named = np.array([feature.is_named for feature in regression.features])
    terms: List[Term] = []
    while len(terms) < MAX_FEATURES:
        beside = regression.posterior(terms)
        z = np.where(named, regression.significance(beside), 0.0)
        j = regression.best_single(z)
        if chi_squared_above(float(z[j]), 1) * regression.tried[j] > LEVEL:
            break
        term = regression.test(np.array([j]), beside)
        if term.ratio < max(MIN_RATIO, (1 - EXPLAINED) * sum(t.ratio for t in terms)):
            break
        terms.append(term)
    return terms


def _shortened(likelihood: Likelihood, fit: LikelihoodFit, made: Formula) -> Formula:
    """A Formula of the pieces that earn their place."""
    while len(made.pieces) > 1:
        worth = [_worth(made.fit, piece) for piece in made.pieces]
        if min(worth) > MIN_RATIO:
            break
        least = made.pieces[int(np.argmin(worth))]
        shorter = _fitted(likelihood, fit, [p for p in made.pieces if p is not least], made.fit)
        if shorter is None or made.ratio - shorter.ratio > MIN_RATIO:
            break
        made = shorter
    return made


def _simplified(likelihood: Likelihood, fit: LikelihoodFit, made: Formula) -> Formula:
    """A Formula of pieces with a factor less, or a variable instead of its wave, where that is as likely."""
    for i, piece in enumerate(made.pieces):
        for simpler in piece.simpler:
            pieces = [*made.pieces[:i], simpler, *made.pieces[i + 1 :]]
            other = _fitted(likelihood, fit, pieces, made.fit)
            if other is not None and made.ratio - other.ratio < MIN_RATIO:
                made = other
    return made


def _worth(fit: LikelihoodFit, piece: FormulaTerm) -> float:
    """Squared ratio of the size of a piece to its standard deviation, roughly the log-likelihood ratio to
    the formula without it."""
    size = next(p for p in fit.parameters if p["name"].split(".")[-1] == piece.size)
    return float(size["value"] / size["deviation"]) ** 2 if size["identified"] else 0.0


def _enclosed(text: str) -> str:
    """A text in one pair of parentheses."""
    depth = 0
    for i, letter in enumerate(text):
        depth += {"(": 1, ")": -1}.get(letter, 0)
        if depth == 0:
            return text if i == len(text) - 1 > 0 else "(%s)" % text
    return "(%s)" % text


def _piece(feature: Feature, size: float, number: int, memory: Memory) -> FormulaTerm:
    """The piece of a feature of a size. memory: of the model's formulas."""
    name, memory = "c%d" % number, memory.of(str(feature.template))
    own = {n: "%s_%d" % (n, number) for n in feature.constants}
    parts = {c: "%s*%s" % (name, _enclosed(text.format(**own))) for c, text in feature.template.items()}
    parameters = {name: (size, feature.weight_unit, -np.inf, np.inf)}
    for n, c in feature.constants.items():
        parameters[own[n]] = (c.value, c.unit, c.value - c.reach, c.value + c.reach)
    # Pieces with the same states share their constants of time.
    parameters.update({n: (time, unit, time / WIDE, time * WIDE) for n, (time, unit) in memory.times.items()})
    states = {s: rate.format(**{n: n for n in memory.times}) for s, rate in memory.rates.items()}
    simpler = tuple(_piece(one, size, number, memory) for one in feature.simpler)
    means = formula_words.of_feature(feature, name, own, memory)
    return FormulaTerm(number, parts, parameters, means, states, simpler)


def _fitted(
    likelihood: Likelihood, fit: LikelihoodFit, pieces: Sequence[FormulaTerm], near: LikelihoodFit
) -> Optional[Formula]:
    """The Formula of pieces, fitted in the model of a LikelihoodFit, from the levels of another one near;
    None where that fails or helps nothing."""
    entry = _entry(pieces, fit)
    values = {n: p[0] for piece in pieces for n, p in piece.parameters.items()}
    full = {n: "%s.%s" % (entry["name"], n) for n in values}
    try:
        start = candidates.from_entry(entry, "the formula", fit.model).neutral(fit.model)
        for n, value in values.items():
            start.set_value(full[n], value)
        fitted = likelihood.fit(start, (*fit.free, *full.values()), near=near)
    except Diverged:
        return None
    ratio = 2 * (fitted.log_posterior - fit.log_posterior)
    if not (np.isfinite(ratio) and ratio >= MIN_RATIO):
        return None
    values = {n: fitted.model.value(name) for n, name in full.items()}
    reached = tuple(
        replace(piece, parameters={n: (values[n], *p[1:]) for n, p in piece.parameters.items()})
        for piece in pieces
    )
    return Formula(_entry(reached, fit), formula_words.of_pieces(reached, values), fitted, ratio, reached)


def _entry(pieces: Sequence[FormulaTerm], fit: LikelihoodFit) -> Mapping[str, Any]:
    """The effect of pieces as model files list it, by a name that the model of a LikelihoodFit does not
    have."""
    expression: Dict[str, str] = {}
    parameters: Dict[str, Dict[str, Union[str, float]]] = {}
    states = {state: rate for piece in pieces for state, rate in piece.states.items()}
    for piece in pieces:
        for channel, text in piece.parts.items():
            expression[channel] = "+".join(filter(None, [expression.get(channel), text]))
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
    entry: Dict[str, object] = {"name": name, "expression": expression, "parameters": parameters}
    return {"name": name, "states": states, **entry} if states else entry
