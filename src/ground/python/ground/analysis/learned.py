"""A learned wrench: a smooth function for what is learnable where no formula says enough."""

import re
from typing import Dict, List, Optional, Sequence

import numpy as np

from ground import _core
from ground.analysis import candidates, dictionary
from ground.analysis.ceiling import Found
from ground.analysis.dictionary import COMMAND, HEADING, PLACE, TIME, VELOCITY, Family, Feature, Samples
from ground.analysis.likelihood import Fit, Likelihood
from ground.analysis.naming import WORDS, Formula, in_words
from ground.analysis.regression import Regression
from ground.analysis.selection import MIN_RATIO
from ground.annotations import Array, Document
from ground.errors import GroundError

LEARNED = "learned_wrench"
BELLS = 60  # most of them
SPACING = 0.8  # of neighbours, in widths
WIDTH = 0.8  # of a bell, over the standard deviation of its argument
TURN_WIDTH = 0.5  # the same of the heading [rad]


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
    def squared(points: Array, to: Array) -> Array:
        return _distance(points, to, widths, variables)

    centres = dictionary.spread(values, SPACING, BELLS, squared)
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
