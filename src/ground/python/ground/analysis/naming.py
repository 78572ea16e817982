"""A name for what is learnable and has none: a formula with units, or a learned wrench.

Features whose formulas mean something by themselves are chosen one after the other in the last
regression of the ceiling. Their constants (phases, wavelengths, points) become parameters, and the
likelihood fits all of them in the model. A formula is an effect as model files list it.
"""

import re
from dataclasses import dataclass, field
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
MOST = 3  # features of a formula
TRIED = 12  # most significant features that are compared in each step
MIN_RATIO = 12.0  # of the likelihoods with and without a feature
EXPLAINED = 0.97  # part of the terms' gain from which a formula needs no further feature
WAVE = re.compile(r"^(sin|cos)\(([-\d.e+]+)\*([xy])\)$")
FADES = re.compile(r"^\((.*)\)/([\d.]+)$")
SWINGS = re.compile(r"^([\d.]+)\*\((.*)\)-[\d.]+\*(\w+)$")
TURN = re.compile(r"^(sin|cos)\((?:(\d)\*)?psi\)$")


@can_be_kept
@dataclass(frozen=True)
class Formula:
    """A proposal: an effect that the library does not have."""

    entry: Document  # as model files list effects, its parameters fitted
    means: str  # in words
    fit: Fit  # of the model with it
    ratio: float  # of the likelihoods with and without it, 2 ln


@dataclass
class _Piece:
    """A part of a formula, by channel, and its parameters: value, unit, lower and upper bound."""

    key: Tuple[str, ...]  # features with the same key are one piece
    parts: Dict[str, str]
    parameters: Dict[str, Tuple[float, str, float, float]]
    neutral: Dict[str, float]  # at which it does nothing
    means: str
    states: Mapping[str, str] = field(default_factory=dict)


def formula(likelihood: Likelihood, fit: Fit, found: Found) -> Optional[Formula]:
    """The Formula of what was found beside a Fit; None if none is significant."""
    regression = found.regression
    chosen = _chosen(regression)
    if not chosen:
        return None
    at, _, weights = regression.posterior(chosen)
    pieces: Dict[Tuple[str, ...], _Piece] = {}
    for j, weight in zip(at, weights):
        piece = _piece(regression, int(j), float(weight), len(pieces) + 1)
        pieces.setdefault(piece.key, piece)
    kept = list(pieces.values())
    made = _fitted(likelihood, fit, kept)
    while kept[1:]:
        shorter = [
            (other, kept[:i] + kept[i + 1 :])
            for i in range(len(kept))
            for other in [_fitted(likelihood, fit, kept[:i] + kept[i + 1 :])]
            if other is not None
        ]
        if not shorter:
            break
        best, rest = max(shorter, key=lambda tried: tried[0].ratio)
        if made is not None and made.ratio - best.ratio > MIN_RATIO:
            break  # each piece earns its place
        made, kept = best, rest
    return made


def _chosen(regression: Regression) -> List[Term]:
    """Significant single features that mean something, likeliest first."""
    named = np.array([f.family.named for f in regression.features]) & regression.active
    terms: List[Term] = []
    while len(terms) < MOST:
        information, score = regression.single(terms)
        seen = named & (information > 1e-3 * regression.information) & (information > 0)
        z = np.where(seen, score**2 / np.where(seen, information, 1.0), 0.0)
        best = np.argsort(-z)[:TRIED]
        tried = [regression.test(np.array([j]), terms, "feature %d" % j) for j in best if z[j] > 0]
        tried = [
            t
            for t in tried
            if t.ratio > MIN_RATIO
            and chi_squared_above(float(z[t.columns[0]]), 1) * named.sum() < LEVEL
        ]
        if not tried:
            break
        likeliest = max(tried, key=lambda t: t.ratio)
        if terms and likeliest.ratio < (1 - EXPLAINED) * sum(t.ratio for t in terms):
            break
        terms.append(likeliest)
    return terms


# Pieces


def _piece(regression: Regression, j: int, weight: float, number: int) -> _Piece:
    """The piece of a weighted feature; weight: of the feature at its scale in the regression."""
    feature = regression.features[j]
    size = weight * float(regression.scale[j])
    for special in (_turning, _waving, _pulling):
        piece = special(regression, feature, j, size, number)
        if piece is not None:
            return piece
    name = "c%d" % number
    states, parameters, means = _timed(feature.states, number)
    about = "%s that depends on %s" % (_what(feature), in_words(sorted(feature.family.arguments)))
    return _Piece(
        ("feature", *sorted(feature.parts.items())[0]),
        {c: "%s*(%s)" % (name, f) for c, f in feature.parts.items()},
        {name: (size, feature.weight_unit, -np.inf, np.inf), **parameters},
        {name: 0.0, **{p: value for p, (value, _, _, _) in parameters.items()}},
        about + means,
        states,
    )


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


def _partner(regression: Regression, feature: Feature, formula: str, other: str) -> Optional[int]:
    """The feature that has `other` where a feature has `formula`."""
    wanted = {c: f.replace(formula, other) for c, f in feature.parts.items()}
    for j, candidate in enumerate(regression.features):
        if candidate.parts == wanted and regression.active[j]:
            return j
    return None


def _two(
    regression: Regression, j: int, other: Optional[int], is_sine: bool
) -> Tuple[float, float]:
    """Amplitude and phase of a*sin(w+p) from the sine and cosine features together."""
    columns = np.array([j] if other is None else [j, other])
    D = regression.D[:, columns]
    A = D.T @ D + 1e-9 * np.eye(len(columns))
    weights = np.linalg.solve(A, D.T @ regression.y) * regression.scale[columns]
    first, second = float(weights[0]), float(weights[1]) if len(columns) > 1 else 0.0
    sine, cosine = (first, second) if is_sine else (second, first)
    return float(np.hypot(sine, cosine)), float(np.arctan2(cosine, sine))


def _turning(
    regression: Regression, feature: Feature, j: int, size: float, number: int
) -> Optional[_Piece]:
    """a*sin(n*psi+p) on one channel."""
    if feature.family.arguments != {HEADING} or len(feature.parts) != 1:
        return None
    ((channel, text),) = feature.parts.items()
    found = TURN.match(text)
    if not found:
        return None
    kind, times = found.group(1), found.group(2) or "1"
    other = text.replace(kind, "cos" if kind == "sin" else "sin")
    a, p = _two(regression, j, _partner(regression, feature, text, other), kind == "sin")
    unit = "N m" if channel == "N" else "N"
    name, phase = "a%d" % number, "p%d" % number
    turns = "once" if times == "1" else "%s times" % times
    return _Piece(
        ("turn", channel, times),
        {channel: "%s*sin(%s*psi+%s)" % (name, times, phase)},
        {name: (a, unit, -np.inf, np.inf), phase: (p, "rad", p - np.pi, p + np.pi)},
        {name: 0.0, phase: p},
        "%s of up to {%s} that depends on the heading, %s a turn" % (_what(feature), name, turns),
    )


def _waving(
    regression: Regression, feature: Feature, j: int, size: float, number: int
) -> Optional[_Piece]:
    """A force that repeats along an axis of the room."""
    if feature.family.name != "waves of force":
        return None
    found = re.search(r"\((sin|cos)\(([-\d.e+]+)\*([xy])\)\)", feature.parts["X"])
    if not found:
        return None
    kind, number_of_waves, axis = found.group(1), float(found.group(2)), found.group(3)
    text = found.group(0)
    other = text.replace(kind, "cos" if kind == "sin" else "sin")
    a, p = _two(regression, j, _partner(regression, feature, text, other), kind == "sin")
    name, phase, length = "a%d" % number, "p%d" % number, "w%d" % number
    new = "(%s*sin(2*pi*%s/%s+%s))" % (name, axis, length, phase)
    along = "x" if "%s*cos(psi)" % text in feature.parts["X"] else "y"
    wave = 2 * np.pi / number_of_waves
    return _Piece(
        ("wave", axis, along, "%.2f" % np.log(wave)),
        {c: f.replace(text, new) for c, f in feature.parts.items()},
        {
            name: (a, "N", -np.inf, np.inf),
            phase: (p, "rad", p - 2 * np.pi, p + 2 * np.pi),
            length: (wave, "m", wave / 1.3, wave * 1.3),
        },
        {name: 0.0, phase: p, length: wave},
        "a force along the room's %s that repeats every {%s} along %s, up to {%s}"
        % (along, length, axis, name),
    )


def _pulling(
    regression: Regression, feature: Feature, j: int, size: float, number: int
) -> Optional[_Piece]:
    """A force towards or away from a point of the room that grows with the distance."""
    if feature.family.name != "force by place" or feature.unit != "m" or set(feature.parts) != {"X", "Y"}:
        return None
    found = re.findall(r"\(([xy])-\(([-\d.e+]+)\)\)", feature.parts["X"])
    if [axis for axis, _ in found] != ["x", "y"] or "-(y" in feature.parts["X"][:3]:
        return None
    if not feature.parts["X"].startswith("((x-"):
        return None
    k, x0, y0 = "k%d" % number, "x%d" % number, "y%d" % number
    (_, cx), (_, cy) = found
    X = "%s*((%s-x)*cos(psi)+(%s-y)*sin(psi))" % (k, x0, y0)
    Y = "%s*((%s-y)*cos(psi)-(%s-x)*sin(psi))" % (k, y0, x0)
    far = 100.0 * (abs(float(cx)) + abs(float(cy)) + 1.0)
    return _Piece(
        ("pull",),
        {"X": X, "Y": Y},
        {
            k: (-size, "N/m", -np.inf, np.inf),
            x0: (float(cx), "m", -far, far),
            y0: (float(cy), "m", -far, far),
        },
        {k: 0.0, x0: float(cx), y0: float(cy)},
        "a force {towards:%s} the point ({%s}, {%s}), {%s} of distance" % (k, x0, y0, k),
    )


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


def _fitted(likelihood: Likelihood, fit: Fit, pieces: Sequence[_Piece]) -> Optional[Formula]:
    """The Formula of pieces, fitted in the model; None where that fails or helps nothing."""
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
        fitted = likelihood.fit(start, fit.free + free, near=fit)
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
    return Formula(entry, means, fitted, ratio)


def _entry(pieces: Sequence[_Piece], fit: Fit) -> Document:
    expression: Dict[str, str] = {}
    states: Dict[str, str] = {}
    parameters: Document = {}
    for piece in pieces:
        for channel, text in piece.parts.items():
            expression[channel] = "+".join(filter(None, [expression.get(channel), text]))
        states.update(piece.states)
        for name, (value, unit, lower, upper) in piece.parameters.items():
            scale = max(abs(value), 1e-12)
            if not np.isfinite(lower):
                lower, upper = -1e3 * scale, 1e3 * scale
            numbers = {
                "value": value, "neutral": piece.neutral[name], "scale": 0.3 * scale,
                "lower": lower, "upper": upper,
            }  # fmt: skip
            parameters[name] = {"unit": unit, **{key: float(n) for key, n in numbers.items()}}
    name = NAME
    while name in fit.model.effects:
        name += "_"
    entry: Document = {"name": name, "expression": expression, "parameters": parameters}
    return {"name": name, "states": states, **entry} if states else entry


def _told(piece: _Piece, values: Mapping[str, float]) -> str:
    """A piece in words, with its values."""
    def put(found: "re.Match[str]") -> str:
        name = found.group(1)
        if name.startswith("towards:"):
            return "towards" if values[name[len("towards:") :]] > 0 else "away from"
        return quantity(abs(values[name]) if name[0] in "akwt" else values[name], piece.parameters[name][1])

    text = re.sub(r"\{([\w:]+)\}", put, piece.means)
    if text != piece.means and not any(name.startswith("c") for name in piece.parameters):
        return text
    name, unit = next((n, p[1]) for n, p in piece.parameters.items() if n.startswith("c"))
    formula = "; ".join("%s = %s" % part for part in piece.parts.items())
    return "%s (%s, with %s = %s)" % (text, formula, name, quantity(values[name], unit))


def quantity(value: float, unit: str) -> str:
    """A number with its unit, in mN and mN m where that is shorter."""
    if unit.startswith("N") and abs(value) < 0.1:
        return "%.3g m%s" % (1e3 * value, unit)
    return "%.3g %s" % (value, unit)
