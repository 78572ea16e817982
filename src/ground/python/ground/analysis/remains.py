"""What the grown model leaves: dependence on state and on history.

Whatever acts on the craft beside the model shows in the innovations of the filter. They are
regressed on functions of the *simulated* state and of the commands. Each function is passed
through the filter, because the filter follows a slow wrench, which then causes no innovation. The
regression is scored on held-out runs. Functions of measured velocities would contain the
disturbance itself and seem to explain everything.
"""

from dataclasses import dataclass
from typing import Callable, List, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import residuals
from ground.analysis.distributions import chi_squared_limit, mean_not_above_zero
from ground.analysis.likelihood import Fit, Likelihood, call
from ground.analysis.unfinished import can_be_kept
from ground.annotations import Array, Flags
from ground.recordings import windows

LEVEL = 0.01  # probability of finding a dependence where there is none
PENALTIES = (1e0, 1e1, 1e2, 1e3, 1e4)  # ridge penalties, in squares of whitened innovations
MEMORIES = (0.05, 0.2, 0.6, 2.0)  # time constants of the commands' past [s]
WAVELENGTHS = (0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5)  # over the floor [m]
MAX_FEATURES = 3  # features of the sparse regression
BLOCK = 120  # samples in a block of the test


Gram = Tuple[Array, Array]  # D' D and D' t of a design D and targets t
# Returns weights of features; takes Grams, designs, targets, and the indices of the runs to fit to.
Weigh = Callable[[Sequence[Gram], Sequence[Array], Sequence[Array], Sequence[int]], Array]


@can_be_kept
@dataclass(frozen=True)
class Remains:
    """What one kind of dependence still explains."""

    p_value: float
    gain: float  # log-likelihood that a flexible function gains on held-out runs
    share: float  # part of the innovations' power that it explains there

    @property
    def found(self) -> bool:
        """Whether it gains more than chance would."""
        return bool(self.p_value < LEVEL and self.gain > 0)


def of_state(likelihood: Likelihood, fit: Fit) -> Remains:
    """What a flexible function of simulated state and commands would still explain."""
    return _explained(likelihood, fit, _state_features)


def of_history(likelihood: Likelihood, fit: Fit) -> Remains:
    """What the past of the commands would explain beyond the present."""
    return _explained(likelihood, fit, _history_features)


def _explained(
    likelihood: Likelihood, fit: Fit, features: Callable[[_core.RunData, _core.Model], Array]
) -> Remains:
    """The better of two regressions: on all features, and on a few of them."""
    designs, targets = [], []
    for i, run in enumerate(likelihood.runs):
        acting, channels, owner = _acting(features(run, fit.model), fit)
        left = likelihood.residuals(fit.point, i, acting=acting, channels=channels)
        scored = np.repeat(np.array(left["scored"]), 3)
        designs.append(np.array(left["responses"])[scored] @ owner)
        targets.append(np.array(left["whitened"]).reshape(-1)[scored])
    if len(designs) == 1:  # a single run: quarters of its time
        designs, targets = np.array_split(designs[0], 4), np.array_split(targets[0], 4)
    designs = _scaled(designs)
    power = sum((t**2).sum() for t in targets)
    found = []
    for weigh in (_ridge, _sparse):
        gains = _held_out_gains(designs, targets, weigh)
        blocks = np.concatenate([_blocks(g) for g in gains])
        chance = 2 * mean_not_above_zero(blocks)
        found.append(
            Remains(float(min(1.0, chance)), float(blocks.sum()), float(2 * blocks.sum() / power))
        )
    return min(found, key=lambda f: float(f.p_value))


def _scaled(designs: Sequence[Array]) -> List[Array]:
    size = np.sqrt(np.mean(np.concatenate([d**2 for d in designs]), axis=0))
    used = size > 1e-12
    return [d[:, used] / size[used] for d in designs]


def _blocks(gains: Array) -> Array:
    count = max(1, len(gains) // (3 * BLOCK))
    return np.array([part.sum() for part in np.array_split(gains, count)])


def _held_out_gains(
    designs: Sequence[Array], targets: Sequence[Array], weigh: Weigh
) -> List[Array]:
    """Half the fall of each squared innovation by a regression on the other runs."""
    grams = [(d.T @ d, d.T @ t) for d, t in zip(designs, targets)]
    gains = []
    for i in range(len(designs)):
        rest = [j for j in range(len(designs)) if j != i]
        gains.append(_fall(designs[i], targets[i], weigh(grams, designs, targets, rest)))
    return gains


def _fall(design: Array, target: Array, weights: Array) -> Array:
    return 0.5 * (target**2 - (target - design @ weights) ** 2)


def _together(grams: Sequence[Gram], parts: Sequence[int]) -> Gram:
    """The sum of some of the Grams."""
    A, b = (np.sum([grams[j][k] for j in parts], axis=0) for k in (0, 1))
    return A, b


def _ridge(
    grams: Sequence[Gram], designs: Sequence[Array], targets: Sequence[Array], fitted: Sequence[int]
) -> Array:
    """Weights of all features; leaving out each fitted run in turn chooses the penalty."""

    def weights(parts: Sequence[int], penalty: float) -> Array:
        A, b = _together(grams, parts)
        return np.linalg.solve(A + penalty * len(parts) * np.eye(len(A)), b)

    def gain(penalty: float) -> float:
        falls = [
            _fall(designs[j], targets[j], weights([k for k in fitted if k != j], penalty)).sum()
            for j in fitted
        ]
        return float(sum(falls))

    best = max(PENALTIES, key=gain) if len(fitted) > 1 else PENALTIES[2]
    return weights(fitted, best)


def _sparse(
    grams: Sequence[Gram], designs: Sequence[Array], targets: Sequence[Array], fitted: Sequence[int]
) -> Array:
    """Weights of at most MAX_FEATURES features, each the one that gains most beside those before."""
    A, b = _together(grams, fitted)
    weights = np.zeros(len(b))
    chosen: List[int] = []
    for _ in range(min(MAX_FEATURES, len(b))):
        slope = b - A @ weights
        gain = slope**2 / np.maximum(np.diag(A), 1e-300)
        gain[chosen] = 0
        best = int(np.argmax(gain))
        if gain[best] < chi_squared_limit(LEVEL / len(b), 1):
            break
        chosen.append(best)
        weights = np.zeros(len(b))
        weights[chosen] = np.linalg.lstsq(A[np.ix_(chosen, chosen)], b[chosen], rcond=1e-9)[0]
    return weights


def _acting(wrenches: Array, fit: Fit) -> Tuple[Array, List[int], Array]:
    """Splits wrenches of features (n, 3, m), relative to full thrust, into columns of one channel
    each. Returns the columns, their channels, and which feature a column belongs to (columns, m)."""
    full = 2 * fit.model.value("k") * np.array([1.0, 1.0, fit.model.value("l")])
    used = np.argwhere(np.abs(wrenches).max(axis=0) > 0)
    acting = np.column_stack([wrenches[:, c, j] * full[c] for c, j in used])
    owner = np.zeros((len(used), wrenches.shape[2]))
    owner[np.arange(len(used)), used[:, 1]] = 1.0
    return acting, used[:, 0].tolist(), owner


def _simulated(run: _core.RunData, model: _core.Model) -> Tuple[Array, Array, Flags]:
    """Poses and velocities (n, 3) simulated in windows of 1.5 s from initial velocities that
    suit the model, and which samples are in a window (n,)."""
    cut = windows.cut([run])
    eta, nu = np.zeros((len(run.times), 3)), np.zeros((len(run.times), 3))
    inside = np.zeros(len(run.times), bool)
    found = call(windows.problem([run], cut).simulate, model)
    for i, window in enumerate(cut):
        span = slice(window.first, window.last + 1)
        eta[span], nu[span], inside[span] = found["eta"][i], found["nu"][i], True
    return eta, nu, inside


def _in_every_channel(columns: Sequence[Array]) -> Array:
    """Scalars (n,) as wrenches (n, 3, 3 m), each in each channel."""
    values = np.column_stack(columns)
    return np.asarray(np.einsum("nj,ck->nckj", values, np.eye(3)).reshape(len(values), 3, -1))


def _over_the_floor(x: Array, y: Array, psi: Array) -> Array:
    """Forces along world x and world y that vary over the floor (n, 3, m)."""
    columns = []
    for place in (x, y):
        columns.append(place)
        for length in WAVELENGTHS:
            columns += [np.sin(2 * np.pi * place / length), np.cos(2 * np.pi * place / length)]
    values = np.column_stack(columns)
    c, s = np.cos(psi)[:, None], np.sin(psi)[:, None]
    none = np.zeros_like(values)
    along_x, along_y = np.stack([c * values, -s * values, none], 1), np.stack(
        [s * values, c * values, none], 1
    )
    return np.concatenate([along_x, along_y], axis=2)


def _inputs(run: _core.RunData) -> Array:
    """Inputs of the thrusters (n, thrusters) that hold at the run's instants."""
    return residuals.held(run, np.array(run.times))[:, :-1]


def _demands(model: _core.Model, inputs: Array) -> Array:
    """Thrust ahead, to starboard where the craft has such thrusters, and moment of inputs (n,
    thrusters): a row each (2 or 3, n), over k and k l."""
    forces = model.forces(inputs)
    return np.asarray(forces.T[[0, 2]] if model.is_pair else forces.T)


def _state_features(run: _core.RunData, model: _core.Model) -> Array:
    eta, nu, inside = _simulated(run, model)
    inputs = _inputs(run)
    u, v, r = nu.T / np.array([[0.5], [0.3], [4.0]])
    columns = [u, v, r, abs(u) * u, abs(v) * v, abs(r) * r, abs(u), abs(v), abs(r), u * v, u * r]
    columns += [v * r, *inputs.T]
    if model.is_pair:
        columns.append(inputs[:, 0] * inputs[:, 1])
    columns += [demand * x for demand in _demands(model, inputs) for x in (u, v, r)]
    columns += [*(inputs.T**2), u**2, v**2, r**2, np.ones_like(u)]
    wrenches = np.concatenate([_in_every_channel(columns), _over_the_floor(*eta.T)], axis=2)
    return np.asarray(wrenches * inside[:, None, None])


def _history_features(run: _core.RunData, model: _core.Model) -> Array:
    inputs, times = _inputs(run), np.array(run.times)
    columns = []
    for memory in MEMORIES:
        past = np.column_stack([_past(times, x, memory) for x in inputs.T])
        columns += [*(_demands(model, past) - _demands(model, inputs))]
        columns += [*((past - inputs) * inputs).T]
        columns += [*((past - inputs) * abs(past - inputs)).T]
    return _in_every_channel(columns)


def _past(times: Array, values: Array, memory: float) -> Array:
    """Mean of the held values before each sample, with exponentially decaying weights (n,)."""
    result = np.empty_like(values)
    state = 0.0
    for i, value in enumerate(values):
        result[i] = state
        step = times[i + 1] - times[i] if i + 1 < len(times) else 0.0
        state = value + (state - value) * np.exp(-step / memory)
    return result
