"""A name for what is learnable and has none: a formula with units, or a learned wrench.

Features whose formulas mean something by themselves are chosen one after the other in the last
regression of the ceiling. Their constants (phases, wavelengths, points) become parameters, and the
likelihood fits all of them in the model. A formula is an effect as model files list it.
"""

import re
from dataclasses import dataclass, field, replace
from typing import Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import candidates, dictionary
from ground.analysis.ceiling import Found
from ground.analysis.dictionary import (
    COMMAND,
    HEADING,
    PLACE,
    TIME,
    VELOCITY,
    Family,
    Feature,
    Samples,
)
from ground.analysis.distributions import chi_squared_above
from ground.analysis.likelihood import Fit, Likelihood
from ground.analysis.regression import LEVEL, Regression, Term
from ground.analysis.unfinished import can_be_kept
from ground.annotations import Array, Document
from ground.errors import GroundError

NAME = "proposed"
LEARNED = "learned_wrench"
BELLS = 60  # most of them
SPACING = 0.8  # of neighbours, in widths
WIDTH = 0.8  # of a bell, over the standard deviation of its argument
TURN_WIDTH = 0.5  # the same of the heading [rad]
MOST = 5  # features of a formula
MIN_RATIO = 12.0  # of the likelihoods with and without a feature
EXPLAINED = 0.97  # part of the terms' gain from which a formula needs no further feature
FADES = re.compile(r"^\((.*)\)/([\d.]+)$")
SWINGS = re.compile(r"^([\d.]+)\*\((.*)\)-[\d.]+\*(\w+)$")
TURN = re.compile(r"^\(?sin\((?:(\d)\*)?psi\+\{p[01]\}\)\)?$")
# A force away from a point of the room, as the dictionary has it
PULL = {"X": "((x-{x0}))*cos(psi)+((y-{y0}))*sin(psi)", "Y": "((y-{y0}))*cos(psi)+-((x-{x0}))*sin(psi)"}


@can_be_kept
@dataclass(frozen=True)
class Formula:
    """A proposal: an effect that the library does not have."""

    entry: Document  # as model files list effects, its parameters fitted
    means: str  # in words
    fit: Fit  # of the model with it
    ratio: float  # of the likelihoods with and without it, 2 ln
    pieces: Tuple["Piece", ...] = ()


@can_be_kept
@dataclass(frozen=True)
class Piece:
    """A part of a formula, by channel, and its parameters: value, unit, lower and upper bound."""

    number: int
    parts: Dict[str, str]
    parameters: Dict[str, Tuple[float, str, float, float]]
    neutral: Dict[str, float]  # at which it does nothing
    means: str
    states: Dict[str, str] = field(default_factory=dict)


def formula(
    likelihood: Likelihood, fit: Fit, regression: Regression, begun: Optional[Formula] = None
) -> Optional[Formula]:
    """The Formula of what a regression finds beside a Fit; None if nothing is significant. begun: a formula
    beside which it was found, to be made longer."""
    chosen = _chosen(regression)
    if not chosen:
        return None
    at, _, weights = regression.posterior(chosen)
    kept = list(begun.pieces) if begun else []
    number = max([piece.number for piece in kept], default=0) + 1
    for i, (j, weight) in enumerate(zip(at, weights)):
        kept.append(_piece(regression, int(j), float(weight), number + i))
    made = _fitted(likelihood, fit, kept, begun.fit if begun else fit)
    while made is not None and len(made.pieces) > 1:
        worth = [_worth(made.fit, piece) for piece in made.pieces]
        if min(worth) > MIN_RATIO:
            break  # each piece earns its place
        least = made.pieces[int(np.argmin(worth))]
        shorter = _fitted(likelihood, fit, [p for p in made.pieces if p is not least], made.fit)
        if shorter is None or made.ratio - shorter.ratio > MIN_RATIO:
            break
        made = shorter
    return made


def _worth(fit: Fit, piece: "Piece") -> float:
    """Squared ratio of the size of a piece of a formula to its standard deviation, roughly the
    log-likelihood ratio to the formula without it."""
    size = next(p for p in fit.parameters if p["name"].endswith(".c%d" % piece.number))
    return (size["value"] / size["deviation"]) ** 2 if size["identified"] else 0.0


def _chosen(regression: Regression) -> List[Term]:
    """Significant single features that mean something, each beside those before it."""
    named = np.array([f.family.named for f in regression.features])
    terms: List[Term] = []
    while len(terms) < MOST:
        z = np.where(named, regression.significance(terms), 0.0)
        j = int(np.argmax(np.where(z > 0, z - 2 * np.log(regression.tried), -np.inf)))
        if chi_squared_above(float(z[j]), 1) * regression.tried[j] > LEVEL:
            break
        term = regression.test(np.array([j]), terms, "feature %d" % j)
        if term.ratio < max(MIN_RATIO, (1 - EXPLAINED) * sum(t.ratio for t in terms)):
            break
        terms.append(term)
    return terms


# Pieces


def _piece(regression: Regression, j: int, weight: float, number: int) -> Piece:
    """The piece of a weighted feature; weight: of the feature at its scale in the regression."""
    feature, name = regression.features[j], "c%d" % number
    size = weight * float(regression.scale[j])
    own = {n: "%s_%d" % (n, number) for n in feature.constants}
    parts = {c: "%s*(%s)" % (name, text.format(**own)) for c, text in feature.template.items()}
    states, times, past = _timed(feature.states, number)
    parameters: _Parameters = {name: (size, feature.weight_unit, -np.inf, np.inf), **times}
    for n, c in feature.constants.items():
        parameters[own[n]] = (c.value, c.unit, c.value - c.reach, c.value + c.reach)
    neutral = {**{n: value for n, (value, _, _, _) in parameters.items()}, name: 0.0}
    means = _in_words(feature, name, own) + past
    return Piece(number, parts, parameters, neutral, means, dict(states))


def _in_words(feature: Feature, size: str, own: Mapping[str, str]) -> str:
    """What a feature does, with names in braces for values that are fitted."""
    arguments, template = feature.family.arguments, feature.template
    what = _what(feature)
    turn = TURN.match(" ".join(template.values()))
    if turn and len(template) == 1:
        times = turn.group(1) or "1"
        often = "once" if times == "1" else "%s times" % times
        return "%s of up to {%s} that depends on the heading, %s a turn" % (what, size, often)
    if template == PULL:
        point = ", ".join("{%s}" % own[name] for name in ("x0", "y0"))
        return "a force {away:%s} the point (%s), {%s} of distance" % (size, point, size)
    text = "; ".join(
        "%s = {%s} %s" % (c, size, t.format(**{n: "{%s}" % o for n, o in own.items()}))
        for c, t in template.items()
    )
    return "%s that depends on %s (%s)" % (what, in_words(sorted(arguments)), text)


_Parameters = Dict[str, Tuple[float, str, float, float]]


def _timed(states: Mapping[str, str], number: int) -> Tuple[Mapping[str, str], _Parameters, str]:
    """Rates of states with their constant of time as a parameter, and what it means in words."""
    faded = {s: FADES.match(rate) for s, rate in states.items()}
    times = {float(found.group(2)) for found in faded.values() if found}
    if states and all(faded.values()) and len(times) == 1:
        ((time,), name) = (times, "tau%d" % number)
        rates = {s: "(%s)/%s" % (found.group(1), name) for s, found in faded.items() if found}
        return rates, {name: (time, "s", time / 5, 5 * time)}, " of the last {%s}" % name
    swung = {s: SWINGS.match(rate) for s, rate in states.items()}
    squares = {float(found.group(1)) for found in swung.values() if found}
    if len(squares) == 1:
        name, rate = "w%d" % number, float(np.sqrt(squares.pop()))
        fading = "g%d" % number
        rates = {
            s: "{0}^2*({2})-{1}*{3}".format(name, fading, *found.groups()[1:]) if found else states[s]
            for s, found in swung.items()
        }
        parameters = {
            name: (rate, "rad/s", rate / 2, 2 * rate),
            fading: (0.2 * rate, "1/s", 1e-3 * rate, 4 * rate),
        }
        return rates, parameters, ", as of a load that swings at {%s}" % name
    return states, {}, ""


def _what(feature: Feature) -> str:
    """What a feature acts as, in words."""
    parts = set(feature.parts)
    if parts == {"N"}:
        return "a moment"
    if all(p.startswith("thrust_") for p in parts):
        if len(parts) > 1:
            return "thrust"
        return "thrust of %s" % next(iter(parts))[len("thrust_") :]
    if parts == {"X"}:
        return "a force ahead"
    if parts == {"Y"}:
        return "a force to the side"
    return "a force in the room" if PLACE in feature.family.arguments else "a force"


WORDS = {
    "heading": "the heading",
    "place": "the place",
    "velocity": "the velocity",
    "command": "the commands",
    "past": "the past",
    "time": "the time since the drive began",
}


def in_words(arguments: Sequence[str]) -> str:
    """Arguments of a dependence, in words."""
    words = [WORDS[name] for name in arguments]
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


# A learned wrench


def learned(likelihood: Likelihood, fit: Fit, found: Found) -> Optional[Formula]:
    """A smooth function of what was found to matter, by bells on the arguments that the craft
    visited; None where it depends on the past or does not help."""
    variables = _variables(found, fit)
    if not variables:
        return None
    sampled = [dictionary.samples(likelihood, fit, i) for i in range(len(likelihood.runs))]
    values = np.concatenate([np.column_stack([s.values[v] for v in variables]) for s in sampled])
    widths = WIDTH * values.std(axis=0)
    widths[[v == "psi" for v in variables]] = TURN_WIDTH
    if not (widths > 0).all():
        return None
    centres = _spread(values, widths, variables)
    is_world = "x" in variables or "y" in variables
    acting = [_bells(s, variables, widths, centres, is_world, fit) for s in sampled]
    family = Family("bells", frozenset([PLACE]), False)
    features = [Feature({c: "bell"}, "-", family) for _ in centres for c in "XYN"]
    followed = [dictionary.followed(fit.model, s) for s in sampled]
    basis = found.regression
    regression = Regression(basis.likelihood, basis.fit, features, acting, followed)
    columns = np.flatnonzero(regression.active)
    if not len(columns):
        return None
    term = regression.test(columns, name="bells")
    if term.variance <= 0 or term.ratio < MIN_RATIO:
        return None
    at, _, mean = regression.posterior([term])
    weights = np.zeros(len(features))
    weights[at] = mean * regression.scale[at]
    by_channel = weights.reshape(-1, 3)
    entry: Document = {
        "name": LEARNED,
        "scale": 1.0,
        "terms": [
            {
                "arguments": variables,
                "widths": [float(w) for w in widths],
                "frame": "world" if is_world else "body",
                "centres": centres.tolist(),
                "weights": {
                    c: [float("%.5g" % w) for w in by_channel[:, i]] for i, c in enumerate("XYN")
                },
            }
        ],
    }
    try:
        start = candidates.from_entry(entry, "the learned wrench", fit.model).add(fit.model)
        fitted = likelihood.fit(start, fit.free + (LEARNED + ".scale",), near=fit)
    except GroundError:
        return None
    ratio = 2 * (fitted.log_posterior - fit.log_posterior)
    if ratio < MIN_RATIO:
        return None
    entry["scale"] = fitted.model.value(LEARNED + ".scale")
    means = "a wrench learned from data, zero outside them, that depends on %s" % in_words(
        [name for name in found.arguments if name in WORDS and found.arguments[name] > 0.1] or ["place"]
    )
    return Formula(entry, means, fitted, ratio)


def _variables(found: Found, fit: Fit) -> List[str]:
    """Up to three variables that most of what was found depends on; none if it is the past."""
    regression = found.regression
    total: Dict[str, float] = {}
    for term in found.terms:
        for j in term.columns[:1].tolist():
            feature = regression.features[j]
            if feature.states:
                return []
            text = " ".join(feature.parts.values())
            names = ["x", "y"] if PLACE in feature.family.arguments else []
            if HEADING in feature.family.arguments:
                names.append("psi")
            if VELOCITY in feature.family.arguments:
                names += [v for v in "uvr" if re.search(r"\b%s\b" % v, text)]
            if COMMAND in feature.family.arguments:
                names += [v for v in dictionary.inputs(fit.model) if re.search(r"\b%s\b" % v, text)]
            if TIME in feature.family.arguments:
                names.append("t")
            for name in names:
                total[name] = total.get(name, 0.0) + term.ratio
    return sorted(total, key=lambda name: -total[name])[:3]


def _distance(values: Array, centre: Array, widths: Array, variables: Sequence[str]) -> Array:
    away = values - centre
    if "psi" in variables:
        at = list(variables).index("psi")
        away[:, at] = 2 * np.sin(away[:, at] / 2)
    return np.asarray(((away / widths) ** 2).sum(axis=1))


def _spread(values: Array, widths: Array, variables: Sequence[str]) -> Array:
    """Centres that are spread over the values, the farthest first, until all are near one."""
    centres = [values[len(values) // 2]]
    nearest = _distance(values, centres[0], widths, variables)
    while len(centres) < BELLS and nearest.max() > SPACING**2:
        centres.append(values[int(np.argmax(nearest))])
        nearest = np.minimum(nearest, _distance(values, centres[-1], widths, variables))
    return np.array(centres)


def _bells(
    sampled: Samples,
    variables: Sequence[str],
    widths: Array,
    centres: Array,
    is_world: bool,
    fit: Fit,
) -> Array:
    """Wrenches (n, 3, 3 centres) of a bell on each channel; X and Y along the room's axes if is_world."""
    values = np.column_stack([sampled.values[v] for v in variables])
    psi = sampled.values["psi"]
    c, s = (np.cos(psi), np.sin(psi)) if is_world else (np.ones_like(psi), np.zeros_like(psi))
    turn = np.zeros((len(psi), 3, 3))  # body wrench by channel
    turn[:, 0, 0], turn[:, 1, 0], turn[:, 0, 1], turn[:, 1, 1], turn[:, 2, 2] = c, -s, s, c, 1.0
    bells = np.array(_core.bells(list(variables), list(widths), centres, values, fit.model))
    return np.concatenate([turn * bell[:, None, None] for bell in bells.T], axis=2)


# The formula in the model


def _fitted(
    likelihood: Likelihood, fit: Fit, pieces: Sequence[Piece], near: Fit
) -> Optional[Formula]:
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
    for name in values:
        values[name] = fitted.model.value("%s.%s" % (entry["name"], name))
        entry["parameters"][name]["value"] = float(values[name])
    means = "; ".join(_told(piece, values) for piece in pieces)
    reached = tuple(_moved(piece, values) for piece in pieces)
    return Formula(entry, means, fitted, ratio, reached)


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
                "value": value, "neutral": piece.neutral[name], "scale": scale,
                "lower": lower, "upper": upper,
            }  # fmt: skip
            parameters[name] = {"unit": unit, **{key: float(n) for key, n in numbers.items()}}
    name = NAME
    while name in fit.model.effects:
        name += "_"
    entry: Document = {"name": name, "expression": expression, "parameters": parameters}
    return {"name": name, "states": states, **entry} if states else entry


def _told(piece: Piece, values: Mapping[str, float]) -> str:
    """A piece in words, with its values."""
    def put(found: "re.Match[str]") -> str:
        name = found.group(1)
        if name.startswith("away:"):
            return "away from" if values[name[len("away:") :]] > 0 else "towards"
        unit = piece.parameters[name][1]
        if name[0] == "c":
            return quantity(abs(values[name]) if "= {%s}" % name not in piece.means else values[name], unit)
        return "%.3g" % values[name] if "= {c" in piece.means else quantity(values[name], unit)

    return re.sub(r"\{([\w:]+)\}", put, piece.means)


def quantity(value: float, unit: str) -> str:
    """A number with its unit, in mN and mN m where that is shorter."""
    if unit.startswith("N") and abs(value) < 0.1:
        return "%.3g m%s" % (1e3 * value, unit)
    return "%.3g %s" % (value, unit)
