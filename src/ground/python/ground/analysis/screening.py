"""A screen of some 100 000 functions of two arguments for the few that are worth an exact test.

Each is a product of two scalars, such as a wave in the plane and a velocity, on one channel. The score of
all of them at once is a product of matrices: with g the response of the innovations to a unit wrench
at each sample, times the innovations, the score of p(t) q(t) along e(t) is the sum of p q (e . g).
Its variance without an effect is that of the same sum for random innovations.
"""

import itertools
from dataclasses import dataclass, field
from typing import Any, FrozenSet, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import dictionary
from ground.analysis.dictionary import (
    COMMAND,
    CROSSED,
    FAR,
    HEADING,
    MEMORIES,
    PAST,
    PHASES,
    PLACE,
    TIME,
    VELOCITY,
    Constant,
    Family,
    Feature,
    Samples,
    Scales,
    filled,
    product_of_units,
)
from ground.analysis.distributions import chi_squared_above
from ground.analysis.regression import LEVEL, Regression
from ground.annotations import Array, Indices

BIN = 0.05  # samples that are taken together [s]
RANDOM = 8  # draws of innovations that give the variance of a score
KEPT = 120  # products that are tested exactly
KEPT_OF_ONE = 30  # ... of them on one channel
REFINED = 10  # features whose constants are moved
ITERATIONS = 5
NEARBY = 1e-3  # move of a constant for a derivative, over its reach
LONGEST = 0.5  # move in one iteration, over its reach
CONSTANT = 3.0  # number of independent features for each that is tested, by a constant that is moved
WAVES = 6000  # wave vectors
BELLS = 150  # centres of bells of one size
STEPS = (0.1, 0.25, 0.5, 0.75, 0.9)  # quantiles of a variable at which a step may be
SHARP = 0.15  # width of a step, in standard deviations of its variable
REACH = 2.0  # longest part of the extent, or of the time, that a bell covers: 1 / REACH


@dataclass(frozen=True)
class Scalar:
    """A function of what was recorded. text: a formula, with names in braces for its constants."""

    text: str
    unit: str
    arguments: FrozenSet[str]
    constants: Mapping[str, Constant] = field(default_factory=dict)
    states: Mapping[str, str] = field(default_factory=dict)


class Channel(NamedTuple):
    """Where a function acts: a formula for each channel, with %s for the function."""

    parts: Mapping[str, str]
    unit: str
    arguments: FrozenSet[str]


def screened(
    regression: Regression, model: _core.Model, sampled: Sequence[Samples]
) -> Regression:
    """The Regression with the products that have the largest scores. sampled: of each run."""
    scales = Scales.of(sampled)
    few, channels = _few(model, scales), _channels(model, scales)
    x, y = (np.concatenate([s.values[name] for s in sampled]) for name in "xy")
    waves = _waves(scales, x, y)
    products = [(_wide(model, scales, sampled), few), (waves, [ONE, *_turns()])]
    E = np.concatenate(
        [dictionary.wrenches([_feature(c, ONE, ONE) for c in channels], model, s) for s in sampled]
    )
    draws, edges = np.concatenate(regression.scores(RANDOM)), _bins(sampled)
    found: List[Tuple[float, int, Feature]] = []
    for wide, narrow in products:
        singles = len(channels) * len(wide)
        pairs = singles * (len(narrow) - 1)
        P = _values(wide, sampled, edges + np.diff(np.append(edges, len(E))) // 2)
        Q = _values(narrow, sampled, slice(None))
        for channel, e in zip(channels, E.transpose(2, 0, 1)):
            z = _scores(P.astype(np.float32), Q, np.einsum("ij,ijk->ik", e, draws), edges)
            z[:, 0] -= 2 * np.log(singles)
            z[:, 1:] -= 2 * np.log(pairs)
            for at in np.argpartition(-z.ravel(), KEPT_OF_ONE)[:KEPT_OF_ONE].tolist():
                i, j = divmod(at, len(narrow))
                tried = singles if narrow[j] is ONE else pairs
                found.append((float(z[i, j]), tried, _feature(channel, wide[i], narrow[j])))
    found = sorted(found, key=lambda item: -item[0])[:KEPT]
    features = [feature for _, _, feature in found]
    acting = [dictionary.wrenches(features, model, s) for s in sampled]
    return regression.extended(features, acting, [tried for _, tried, _ in found])


def _scores(P: Array, Q: Array, g: Array, edges: Indices) -> Array:
    """Squared scores of all products of P and Q over their variances. g: (n, 1 + RANDOM)."""
    weighted = np.add.reduceat(Q[:, :, None] * g[:, None, :], edges).astype(np.float32)
    scores = np.ascontiguousarray(weighted.transpose(2, 1, 0)).reshape(-1, len(P)) @ P
    scores = scores.reshape(g.shape[1], -1, P.shape[1])
    variance = np.einsum("kij,kij->ij", scores[1:], scores[1:]) / RANDOM
    kept = variance > 1e-9 * variance.max()
    return np.asarray(np.where(kept, scores[0] ** 2 / np.maximum(variance, 1e-30), 0.0)).T


def _bins(sampled: Sequence[Samples]) -> Indices:
    """First samples of the bins of all runs, one after the other."""
    edges, before = [], 0
    for s in sampled:
        step = max(1, int(round(BIN / np.median(np.diff(s.times)))))
        edges.append(before + np.arange(0, len(s.times), step))
        before += len(s.times)
    return np.concatenate(edges)


def _values(scalars: Sequence[Scalar], sampled: Sequence[Samples], at: Any) -> Array:
    """Scalars (n, k) at some samples of all runs, over their root mean squares."""
    spaces = [dictionary.namespace(s) for s in sampled]
    known = {
        name: np.concatenate([space[name] for space in spaces])[at] if np.ndim(value) else value
        for name, value in spaces[0].items()
    }
    values = np.empty((len(known["t"]), len(scalars)))
    for k, scalar in enumerate(scalars):
        values[:, k] = dictionary.evaluated(filled(scalar.text, scalar.constants), known)
    return np.asarray(values / np.maximum(np.sqrt((values**2).mean(axis=0)), 1e-300))


def _feature(channel: Channel, first: Scalar, second: Scalar) -> Feature:
    """The product of two scalars on a channel."""
    texts = ["(%s)" % s.text for s in (first, second) if s is not ONE] or ["1"]
    arguments = first.arguments | second.arguments | channel.arguments
    if PAST in arguments:
        arguments = frozenset([PAST])
    return Feature.of(
        {name: part % "*".join(texts) for name, part in channel.parts.items()},
        product_of_units([first.unit, second.unit, channel.unit]),
        Family("products", arguments or frozenset([HEADING]), True, False),
        {**first.states, **second.states},
        {**first.constants, **second.constants},
    )


def refined(regression: Regression, model: _core.Model, sampled: Sequence[Samples]) -> Regression:
    """The Regression with its most significant features at the constants that suit best."""
    z, tried_of = regression.significance(), regression.tried
    best = [
        j
        for j in np.argsort(2 * np.log(tried_of) - z)[:REFINED].tolist()
        if regression.features[j].constants and chi_squared_above(float(z[j]), 1) * tried_of[j] < LEVEL
    ]
    if not best:
        return regression
    started = [regression.features[j] for j in best]
    features, values = started, [0.0] * len(best)
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
    counts = [float(tried_of[j]) * CONSTANT ** len(f.constants) for j, f in zip(best, features)]
    return regression.extended(features, [dictionary.wrenches(features, model, s) for s in sampled], counts)


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


# What is multiplied


def _of(
    arguments: Sequence[str],
    scalars: Sequence[Tuple[str, str]],
    constants: Optional[Mapping[str, Constant]] = None,
) -> List[Scalar]:
    made = []
    for text, unit in scalars:
        own = {n: c for n, c in (constants or {}).items() if "{%s}" % n in text}
        made.append(Scalar(text, unit, frozenset(arguments), own))
    return made


ONE = Scalar("1", "-", frozenset())


def _turns() -> List[Scalar]:
    return _of([HEADING], [(text, "-") for text in dictionary.turns_of_heading()], PHASES)


def _few(model: _core.Model, scales: Scales) -> List[Scalar]:
    """Scalars that all others are multiplied with."""
    names = dictionary.inputs(model)
    speeds = [("u", "m/s"), ("v", "m/s"), ("r", "rad/s"), ("abs(r)", "rad/s"), ("sqrt(u^2+v^2)", "m/s")]
    commands = [(name, "-") for name in names] + [("lift", "-"), ("(%s)" % "+".join(names), "-")]
    (cx, cy), far = scales.centre, FAR * scales.extent
    middle = {"x1": Constant(cx, "m", far), "y1": Constant(cy, "m", far)}
    return [
        ONE,
        *_turns(),
        *_of([VELOCITY], speeds + dictionary.signs(scales)[2:]),
        *_of([COMMAND], commands),
        *_of([TIME], [("t", "s"), ("t^2", "s^2")]),
        *_of([PLACE], [("(x-{x1})", "m"), ("(y-{y1})", "m")], middle),
        *_past_commands(model),
    ]


def _past_commands(model: _core.Model) -> List[Scalar]:
    total = "+".join(dictionary.inputs(model))
    return [
        Scalar("q%d" % i, "-", frozenset([PAST]), {}, {"q%d" % i: "((%s)-q%d)/%g" % (total, i, memory)})
        for i, memory in enumerate(MEMORIES)
    ]


def _wide(model: _core.Model, scales: Scales, sampled: Sequence[Samples]) -> List[Scalar]:
    """All scalars that are multiplied with a few."""
    names = ("x", "y", "u", "v", "r", "t")
    every = {name: np.concatenate([s.values[name] for s in sampled]) for name in names}
    commands = [(formula, "-") for formula in dictionary.command_formulas(model)]
    fades = [("cos(%.4g*t)" % (k * np.pi / scales.duration), "-") for k in range(1, 9)]
    return [
        ONE,
        *_turns(),
        *_of([VELOCITY], dictionary.of_velocity() + dictionary.signs(scales)),
        *_steps(every),
        *_of([COMMAND], commands),
        *_of([TIME], [("t", "s"), ("t^2", "s^2"), *fades]),
        *_past_commands(model),
        *_past_velocity(),
        *_bells_of_time(scales),
        *_bells_of_place(scales, every["x"], every["y"]),
    ]


def _past_velocity() -> List[Scalar]:
    return [
        Scalar(name, unit, frozenset([PAST]), {}, {name: "(%s-%s)/%g" % (n, name, memory)})
        for i, memory in enumerate(MEMORIES)
        for n, unit in (("u", "m/s"), ("v", "m/s"), ("r", "rad/s"))
        for name in ["w%d_%s" % (i, n)]
    ]


def _steps(every: Mapping[str, Array]) -> List[Scalar]:
    """Steps from 0 to 1 where a velocity exceeds a limit."""
    speed = np.hypot(every["u"], every["v"])
    slow = 0.15 * float(np.sqrt((speed**2).mean()))
    slip = "v/sqrt(u^2+v^2+%.3g)" % slow**2
    variables = {
        "u": (every["u"], "m/s"), "v": (every["v"], "m/s"), "r": (every["r"], "rad/s"),
        "abs(u)": (abs(every["u"]), "m/s"), "abs(v)": (abs(every["v"]), "m/s"),
        "abs(r)": (abs(every["r"]), "rad/s"), "sqrt(u^2+v^2)": (speed, "m/s"),
        "abs(%s)" % slip: (abs(every["v"]) / np.hypot(speed, slow), "-"),
    }  # fmt: skip
    found = []
    for text, (values, unit) in variables.items():
        width = SHARP * float(values.std())
        for limit in np.quantile(values, STEPS):
            away = "(%s-{s0})" % text
            constants = {"s0": Constant(float(limit), unit, 2 * width / SHARP)}
            step = "(1+%s/sqrt(%s^2+%.3g))/2" % (away, away, width**2)
            found.append(Scalar(step, "-", frozenset([VELOCITY]), constants))
    return found


def _bells_of_time(scales: Scales) -> List[Scalar]:
    found, width = [], CROSSED
    while width < scales.duration / REACH:
        for centre in np.arange(0, scales.duration, width):
            constants = {"t0": Constant(float(centre), "s", width), "t1": Constant(width, "s", 0.7 * width)}
            found.append(Scalar("exp(-((t-{t0})/{t1})^2)", "-", frozenset([TIME]), constants))
        width *= 2
    return found


def _bells_of_place(scales: Scales, x: Array, y: Array) -> List[Scalar]:
    found, places, width = [], np.column_stack([x, y]), CROSSED * scales.speed
    while width < scales.extent / REACH:
        for cx, cy in dictionary.spread(places, width, BELLS):
            constants = {
                "x0": Constant(float(cx), "m", width),
                "y0": Constant(float(cy), "m", width),
                "w0": Constant(float(width), "m", 0.7 * width),
            }
            found.append(Scalar("exp(-((x-{x0})^2+(y-{y0})^2)/{w0}^2)", "-", frozenset([PLACE]), constants))
        width *= 2
    return found


def _waves(scales: Scales, x: Array, y: Array) -> List[Scalar]:
    """Waves in the plane: so many that each other one is near one of them, the longest first."""
    cell = 1.2 / max(float(np.hypot(x.std(), y.std())), 1e-6)  # waves that are nearer look alike [rad/m]
    most = 2 * np.pi / (CROSSED * scales.speed)
    side = np.arange(-int(most / cell), int(most / cell) + 1)
    grid = [(i * cell, j * cell) for i, j in itertools.product(side, side) if (i, j) > (0, 0)]
    grid = sorted((k for k in grid if np.hypot(*k) <= most), key=lambda k: float(np.hypot(*k)))[:WAVES]
    return [
        Scalar("sin({kx}*x+{ky}*y+{p2})", "-", frozenset([PLACE]), {
            "kx": Constant(kx, "rad/m", cell), "ky": Constant(ky, "rad/m", cell), "p2": phase,
        })
        for kx, ky in grid
        for phase in PHASES.values()
    ]  # fmt: skip


def _channels(model: _core.Model, scales: Scales) -> List[Channel]:
    """Channels of the body, axes of the room, along and across the velocity, and thrust."""
    none: FrozenSet[str] = frozenset()
    moving = frozenset([VELOCITY])
    direction = "/sqrt(u^2+v^2+%.3g)" % (0.15 * scales.speed) ** 2
    thrusts = {"thrust_" + name[2:]: name + "*%s" for name in dictionary.inputs(model)}
    channels = [Channel({c: "%s"}, "-", none) for c in dictionary.CHANNELS]
    channels += [
        Channel({"X": "%s*cos(psi)", "Y": "-%s*sin(psi)"}, "-", none),
        Channel({"X": "%s*sin(psi)", "Y": "%s*cos(psi)"}, "-", none),
        Channel({"X": "%s*u", "Y": "%s*v"}, "m/s", moving),
        Channel({"X": "%s*v", "Y": "-%s*u"}, "m/s", moving),
        Channel({"X": "%s*u" + direction, "Y": "%s*v" + direction}, "-", moving),
        Channel({"X": "%s*v" + direction, "Y": "-%s*u" + direction}, "-", moving),
        Channel(thrusts, "-", frozenset([COMMAND])),
    ]
    return channels + [Channel({c: f}, "-", frozenset([COMMAND])) for c, f in thrusts.items()]
