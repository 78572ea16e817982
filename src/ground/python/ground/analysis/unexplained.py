"""The missing wrench that no effect of the library explains: what it depends on, and a term for it.

The missing wrench of a model (ground.analysis.failure) is regressed on formulas of everything
that a wrench may depend on. The smoother that infers the wrench attenuates fast changes; each
formula is therefore passed through the same smoother. Orthogonal matching pursuit (Pati et al.
1993) chooses a few terms: the fewest that predict held-out stretches of time within one standard
error of the best.
"""

import itertools
import re
from typing import Any, Dict, List, Mapping, Optional, Sequence, Set, Tuple

import numpy as np

from ground import _core
from ground.analysis import failure, residuals, study
from ground.annotations import Array, Document, Indices
from ground.recordings import repair

CHANNELS = failure.CHANNELS
PROPOSED = "proposed"  # name of an effect that the library does not have
STRETCH = 2.0  # length of a stretch of time that is held out together [s]
FOLDS = 6
MAX_TERMS = 4  # terms of a proposal
MIN_NEW = 0.05  # least part of a term that the model's own parameters cannot imitate
TINY = 1e-6  # part of full thrust below which a thruster does not push in a direction
STEP = 1e-3  # relative step of a parameter, for its finite difference
MIN_SHARE = (
    0.02  # share of the wrench's variance on held-out stretches that a proposal has to explain
)
NAMES = ("u", "v", "r", "x", "y", "psi", "lift", "t")
# Formulas of the body's frame without commands, and the units of their values.
BODY = {
    "1": "-",
    "u": "m/s",
    "v": "m/s",
    "r": "rad/s",
    "abs(u)*u": "m^2/s^2",
    "abs(v)*v": "m^2/s^2",
    "abs(r)*r": "rad^2/s^2",
    "u^2": "m^2/s^2",
    "v^2": "m^2/s^2",
    "r^2": "rad^2/s^2",
    "u^3": "m^3/s^3",
    "v^3": "m^3/s^3",
    "r^3": "rad^3/s^3",
    "u*v": "m^2/s^2",
    "u*r": "m/s^2",
    "v*r": "m/s^2",
    "abs(r)*u": "m/s^2",
    "abs(r)*v": "m/s^2",
    "abs(u)*r": "m/s^2",
    "abs(v)*r": "m/s^2",
    "t": "s",
}
# Formulas of forces along world x and world y.
WAVELENGTHS = (0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5)  # [m]
WORLD = {"1": "-", "x": "m", "y": "m"}
WORLD.update(
    {
        "%s(2*pi*%s/%g)" % (f, axis, w): "-"
        for axis in "xy"
        for w in WAVELENGTHS
        for f in ("sin", "cos")
    }
)


class Term:
    """A formula in one channel of the wrench, or a force along a world axis."""

    def __init__(self, formula: str, unit: str, parts: Mapping[str, str]) -> None:
        self.formula, self.unit = formula, unit
        self.parts = parts  # formula by channel

    @property
    def variables(self) -> Set[str]:
        """Names that the term's value depends on, without the heading that rotates a world force."""
        return set(re.findall(r"\b(?:%s|u_\w+)\b" % "|".join(NAMES), self.formula))

    @property
    def weight_unit(self) -> str:
        """Unit of the factor that makes the term a force or a moment."""
        unit = "N m" if list(self.parts) == ["N"] else "N"
        return unit if self.unit == "-" else "%s/(%s)" % (unit, self.unit)


def _inputs(model: _core.Model) -> List[str]:
    """Names of the inputs of a model's thrusters in formulas."""
    if model.is_pair:
        return ["u_L", "u_R"]
    return ["u_" + thruster["name"] for thruster in model.thrusters]


def _together(model: _core.Model) -> List[str]:
    """Commands of several thrusters in one formula: those that push the craft ahead, to a side and
    around, with their signs, and all of them."""
    names = _inputs(model)
    full = np.diag([thruster["range"][1] for thruster in model.thrusters])
    pushes = np.where(np.abs(model.forces(full)) > TINY, np.sign(model.forces(full)), 0.0)
    found = []
    for signs in [*pushes.T, np.ones(len(names))]:
        parts = ["%s%s" % ("-" if sign < 0 else "+", n) for sign, n in zip(signs, names) if sign]
        if len(parts) > 1:
            found.append("(%s)" % "".join(parts).lstrip("+"))
    return list(dict.fromkeys(found))


def _commanded(model: _core.Model) -> Dict[str, str]:
    """Formulas of the commands, alone and with a velocity, and the units of their values."""
    single, together = _inputs(model), _together(model)
    products = [*itertools.combinations(single, 2), *itertools.combinations(together, 2)]
    found = {formula: "-" for name in single for formula in (name, name + "^2")}
    found.update({"*".join(pair): "-" for pair in products})
    for velocity in "uvr":
        found.update({"%s*%s" % (f, velocity): BODY[velocity] for f in single + together})
    return found


def dictionary(model: _core.Model) -> List[Term]:
    """All Terms that are tried for a model's craft."""
    body = {**BODY, **_commanded(model)}
    terms = [Term(f, unit, {c: f}) for c in CHANNELS for f, unit in body.items()]
    for f, unit in WORLD.items():
        terms.append(Term(f, unit, {"X": "(%s)*cos(psi)" % f, "Y": "-(%s)*sin(psi)" % f}))
        terms.append(Term(f, unit, {"X": "(%s)*sin(psi)" % f, "Y": "(%s)*cos(psi)" % f}))
    return terms


def explain(
    runs: Sequence[_core.RunData], model: _core.Model
) -> Tuple[List[Document], Optional[Document]]:
    """What the missing wrench of a model depends on, and a proposal for it.

    Returns `where`, what the wrench depends on, strongest first: dictionaries of `variable` and
    `share`, the part of the variance on held-out stretches that is lost without the terms that
    contain it, or that bins of it explain; and `proposal`, an effect as a model file lists it
    with its `share`, or None.
    """
    terms = dictionary(model)
    designs, own, wrenches, shares = [], [], [], []
    groups: List[Indices] = []
    scale = failure.full_scale(model)
    for run in runs:
        part = _prepare(run, model, terms, scale)
        designs.append(part[0])
        own.append(part[1])
        wrenches.append(part[2])
        groups.append(part[3] + 1000 * len(groups))
        shares.append(part[4])
    group = np.concatenate(groups)
    whole = np.sqrt((np.vstack(designs) ** 2).mean(axis=0))
    design, wrench = _beside(np.vstack(own), np.vstack(designs), np.concatenate(wrenches))
    size = np.sqrt((design**2).mean(axis=0))
    usable = np.flatnonzero((whole > 1e-9 * whole.max()) & (size > MIN_NEW * whole))
    columns = design[:, usable] / size[usable]
    chosen = _choose(columns, wrench, group)
    kept = [terms[usable[i]] for i in chosen]
    share = _cross_validated(columns[:, chosen], wrench, group).mean() if chosen else 0.0
    where = _where(kept, columns[:, chosen], wrench, group, share, shares)
    if not chosen or share < MIN_SHARE:
        return where, None
    weights = np.linalg.lstsq(columns[:, chosen], wrench, rcond=None)[0] / size[usable[chosen]]
    return where, _proposal(kept, weights, share)


def _prepare(
    run: _core.RunData, model: _core.Model, terms: Sequence[Term], scale: Array
) -> Tuple[Array, Array, Array, Indices, Dict[str, float]]:
    """Responses to the terms (3 n, terms) and to the model's own parameters (3 n, parameters),
    wrench (3 n,) in parts of full thrust, stretches, binned shares."""
    calm = failure.undisturbed(model, run)
    run, noise = calm.run, calm.noise
    found = failure.variables(run, model)
    bins = [v.indicators() for v in found.values()]
    sampled = values(run, model)
    columns, channels, owner = [], [], []
    for at, term in enumerate(terms):
        for channel, formula in term.parts.items():
            columns.append(evaluate(formula, sampled))
            channels.append(CHANNELS.index(channel))
            owner.append(at)
    acting = np.column_stack(columns + bins * 3)
    count = sum(b.shape[1] for b in bins)
    channels = channels + np.repeat([0, 1, 2], count).tolist()
    smoothed = calm.filter.smooth(noise, acting, channels)
    every = slice(None, None, failure.stride_of(np.array(run.times)))
    wrench = smoothed["wrench"][every]
    sigma = np.median(smoothed["sigma"], axis=0) / scale
    own = _own_responses(run, model, noise, smoothed["wrench"])[every]
    responses = smoothed["responses"][every]  # one of each column, in the channel that it acts on
    design = np.zeros((len(wrench), 3, len(terms)))
    for column, (acts_on, at) in enumerate(zip(channels, owner)):
        design[:, acts_on, at] += responses[:, column]
    shares: Dict[str, float] = {}
    for axis in range(3):
        at = len(owner) + axis * count
        for name, indicator in zip(found, bins):
            part = responses[:, at : at + indicator.shape[1]]
            share = failure.share_explained(part, wrench[:, axis])["share"]
            shares[name] = max(shares.get(name, 0.0), share)
            at += indicator.shape[1]
    weight = 1 / scale / np.hypot(0.01, sigma)  # less for channels that are inferred less well
    stretch = (np.array(run.times)[every] / STRETCH).astype(int)
    return (
        (design * weight[:, None]).reshape(-1, len(terms)),
        (own * weight[:, None]).reshape(-1, own.shape[2]),
        (wrench * weight).reshape(-1),
        np.repeat(stretch, 3),
        shares,
    )


def _own_responses(
    run: _core.RunData, model: _core.Model, noise: _core.WrenchNoise, wrench: Array
) -> Array:
    """Change of the inferred wrench by each free parameter of the model, (n, 3, parameters)."""
    by_name = {p["name"]: p for p in model.parameters()}
    changes = []
    for name in study.free_parameters(model):
        value, upper = model.value(name), by_name[name]["upper"]
        if not np.isfinite(value):
            continue
        step = STEP * (abs(value) or by_name[name]["scale"])
        moved = model.copy()
        moved.set_value(name, value + step if value + step <= upper else value - step)
        found = _core.WrenchFilter(moved, run, repair.MAX_GAP).smooth(noise)["wrench"]
        changes.append((found - wrench) / step)
    return np.stack(changes, axis=2)


def _beside(own: Array, design: Array, wrench: Array) -> Tuple[Array, Array]:
    """Projects the model's own parameters out of design and wrench: these were fitted, and took over
    as much of the missing term as they could (Frisch and Waugh 1933)."""
    size = np.sqrt((own**2).mean(axis=0))
    own = own[:, size > 0] / size[size > 0]

    def rest(columns: Array) -> Array:
        return columns - own @ np.linalg.lstsq(own, columns, rcond=1e-6)[0]

    return rest(design), rest(wrench)


def values(run: _core.RunData, model: _core.Model) -> Dict[str, Any]:
    """Samples (n,) of what formulas may depend on, by name."""
    times, eta, nu = np.array(run.times), np.array(run.eta), np.array(run.nu)
    held = residuals.held(run, times)
    return {
        "u": nu[:, 0],
        "v": nu[:, 1],
        "r": nu[:, 2],
        "x": eta[:, 0],
        "y": eta[:, 1],
        "psi": repair.wrap(eta[:, 2]),
        **dict(zip(_inputs(model), held.T)),
        "lift": held[:, -1],
        "t": np.array(run.t),
        "pi": np.pi,
        "abs": np.abs,
        "sin": np.sin,
        "cos": np.cos,
    }


def evaluate(formula: str, sampled: Mapping[str, Any]) -> Array:
    """A formula of the dictionary, in muparser's syntax, over all samples."""
    result = eval(formula.replace("^", "**"), {"__builtins__": {}}, sampled)
    return np.broadcast_to(np.asarray(result, float), sampled["u"].shape)


def _fit(columns: Array, wrench: Array) -> Array:
    return np.linalg.lstsq(columns, wrench, rcond=None)[0]


def _scores(prediction: Array, wrench: Array, groups: Indices) -> Array:
    """Share of the mean square that a prediction explains in each fold (FOLDS,)."""
    total = (wrench**2).mean()
    return np.array(
        [1 - ((wrench[g] - prediction[g]) ** 2).mean() / total for g in _folds(wrench, groups)]
    )


def _folds(wrench: Array, groups: Indices) -> List[Indices]:
    from sklearn.model_selection import GroupKFold  # slow to load

    count = min(FOLDS, len(np.unique(groups)))
    return [test for _, test in GroupKFold(count).split(wrench, groups=groups)]


def _cross_validated(columns: Array, wrench: Array, groups: Indices) -> Array:
    """Share of each fold that least squares on the other folds explain (FOLDS,)."""
    prediction = np.zeros(len(wrench))
    for fold in _folds(wrench, groups):
        rest = np.setdiff1d(np.arange(len(wrench)), fold)
        prediction[fold] = columns[fold] @ _fit(columns[rest], wrench[rest])
    return _scores(prediction, wrench, groups)


def _choose(columns: Array, wrench: Array, groups: Indices) -> List[int]:
    """Columns of the sparsest regression that is within a standard error of the best one."""
    from sklearn.linear_model import OrthogonalMatchingPursuit  # slow to load

    scores = [np.zeros(len(_folds(wrench, groups)))]
    predictions = np.zeros((MAX_TERMS + 1, len(wrench)))
    for fold in _folds(wrench, groups):
        rest = np.setdiff1d(np.arange(len(wrench)), fold)
        for count in range(1, MAX_TERMS + 1):
            pursuit = OrthogonalMatchingPursuit(n_nonzero_coefs=count, fit_intercept=False)
            pursuit.fit(columns[rest], wrench[rest])
            predictions[count, fold] = pursuit.predict(columns[fold])
    scores += [_scores(p, wrench, groups) for p in predictions[1:]]
    means = np.array([s.mean() for s in scores])
    best = int(means.argmax())
    error = np.array(
        [
            (scores[best] - s).std(ddof=1) / np.sqrt(len(s)) if i != best else 0
            for i, s in enumerate(scores)
        ]
    )
    count = int(np.flatnonzero(means >= means[best] - error)[0])
    if count == 0:
        return []
    pursuit = OrthogonalMatchingPursuit(n_nonzero_coefs=count, fit_intercept=False)
    return list(np.flatnonzero(pursuit.fit(columns, wrench).coef_).tolist())


def _where(
    kept: Sequence[Term],
    columns: Array,
    wrench: Array,
    groups: Indices,
    share: float,
    shares: Sequence[Mapping[str, float]],
) -> List[Document]:
    """Variables by the share that is lost without their terms, then by what their bins explain."""
    lost = {}
    for name in {name for term in kept for name in term.variables}:
        others = [i for i, term in enumerate(kept) if name not in term.variables]
        without = _cross_validated(columns[:, others], wrench, groups).mean() if others else 0.0
        lost[name] = float(max(0.0, share - max(0.0, without)))
    binned = {name: float(np.mean([s.get(name, 0.0) for s in shares])) for name in shares[0]}
    ranked = sorted(lost, key=lambda n: (-lost[n], -binned.get(n, 0.0), n))
    rest = sorted((n for n in binned if n not in lost), key=lambda n: -binned[n])
    return [{"variable": n, "share": lost[n], "by": "terms"} for n in ranked] + [
        {"variable": n, "share": binned[n], "by": "bins"} for n in rest
    ]


def _proposal(kept: Sequence[Term], weights: Array, share: float) -> Document:
    expression: Dict[str, List[str]] = {}
    parameters: Document = {}
    for number, (term, weight) in enumerate(zip(kept, weights), 1):
        name = "c%d" % number
        for channel, formula in term.parts.items():
            expression.setdefault(channel, []).append("%s*(%s)" % (name, formula))
        parameters[name] = {
            "value": float("%.6g" % weight),
            "unit": term.weight_unit,
            "neutral": 0.0,
            "lower": -100 * abs(float("%.3g" % weight)),
            "upper": 100 * abs(float("%.3g" % weight)),
        }
    return {
        "name": PROPOSED,
        "expression": {channel: " + ".join(parts) for channel, parts in expression.items()},
        "parameters": parameters,
        "share": float(share),
    }
