"""What the grown model leaves: differences between runs, dependence on state and on history.

Whatever acts on the craft beside the model shows in the innovations of the filter. Functions of the
*simulated* state and of the commands are held against them, each seen through the filter (a wrench that
the filter has followed no longer surprises it); a flexible ridge regression is scored on runs that it has
not seen. Features of measured velocities would contain the disturbance itself and seem to explain
everything.
"""
from dataclasses import dataclass

import numpy as np
from scipy import stats

from ground import _core
from ground.analysis import study
from ground.analysis.likelihood import CAP
from ground.recordings import windows

LEVEL = 0.01  # chance of finding what is not there
PENALTIES = (1e0, 1e1, 1e2, 1e3, 1e4)  # of the ridge regression, in squares of whitened innovations
MEMORIES = (0.05, 0.2, 0.6, 2.0)  # time constants of the commands' past [s]
BLOCK = 120  # samples of a block of the test


@dataclass(frozen=True)
class Remains:
    """One kind of what is left."""

    p_value: float
    gain: float  # log-likelihood on runs held out that a flexible function of it gains
    share: float  # of the innovations' power, on runs held out

    @property
    def found(self):
        return self.p_value < LEVEL and self.gain > 0


def of_state(likelihood, fit):
    """What a flexible function of simulated state and commands would still explain."""
    return _explained(likelihood, fit, _state_features)


def of_history(likelihood, fit):
    """What the past of commands and speeds would explain beyond the present."""
    return _explained(likelihood, fit, _history_features)


def varying(likelihood, fit):
    """What differs between runs, with its spread and the evidence: a list of dictionaries `parameter`,
    `deviation`, `unit`, `p_value`, `by_run`."""
    found = []
    sizes = np.array([trim["wrench"] for trim in fit.trims])
    doubts = np.array([trim["wrench_sigma"] for trim in fit.trims])
    kinds = [("surge force", "N"), ("side force", "N"), ("yaw moment", "N m")]
    for i, (name, unit) in enumerate(kinds):
        found.append(_varies(name, unit, sizes[:, i], doubts[:, i], fit.point.levels["trim_" + "XYN"[i]]))
    thrust = np.array([trim["thrust"] for trim in fit.trims])
    doubt = np.array([trim["thrust_sigma"] for trim in fit.trims])
    found.append(_varies("thrust", "-", thrust, doubt, fit.point.levels["thrust"]))
    return [f for f in found if f["p_value"] < LEVEL]


def _varies(name, unit, estimates, doubts, spread):
    """Of one kind: chi squared of the runs' values as the data alone tell them, without the prior."""
    gone = np.maximum(1 - (doubts / spread) ** 2, 1e-9)  # part of its prior that a run's data replace
    alone, variance = estimates / gone, doubts**2 / gone
    mean = np.average(alone, weights=1 / variance)
    square = float((((alone - mean) ** 2) / variance).sum())
    return {
        "parameter": name,
        "unit": unit,
        "deviation": float(np.std(estimates, ddof=1)) if len(estimates) > 1 else 0.0,
        "p_value": float(stats.chi2.sf(square, max(1, len(estimates) - 1))),
        "by_run": [float(e) for e in estimates],
    }


def _explained(likelihood, fit, features):
    if len(likelihood.runs) < 2:
        return Remains(1.0, 0.0, 0.0)
    designs, targets = [], []
    for i, run in enumerate(likelihood.runs):
        acting, channels = _acting(features(run, fit.model), likelihood, fit)
        found = likelihood.box.residuals(fit.point, i, cap=CAP, acting=acting, channels=channels)
        scored = np.repeat(np.array(found["scored"]), 3)
        designs.append(np.array(found["responses"])[scored])
        targets.append(np.array(found["whitened"]).reshape(-1)[scored])
    gains = _held_out_gains(designs, targets)
    if gains is None:
        return Remains(1.0, 0.0, 0.0)
    blocks = np.concatenate([_blocks(g) for g in gains])
    power = sum((t**2).sum() for t in targets)
    chance = stats.ttest_1samp(blocks, 0, alternative="greater").pvalue
    return Remains(float(chance), float(blocks.sum()), float(2 * blocks.sum() / power))


def _blocks(gains):
    count = max(1, len(gains) // (3 * BLOCK))
    return np.array([part.sum() for part in np.array_split(gains, count)])


def _held_out_gains(designs, targets):
    """Half the fall of each squared innovation by a ridge regression on the other runs, whose penalty
    is chosen by leaving runs out among those."""
    size = np.sqrt(np.mean(np.concatenate([d**2 for d in designs]), axis=0))
    used = size > 1e-12
    designs = [d[:, used] / size[used] for d in designs]
    if not used.any():
        return None
    grams = [(d.T @ d, d.T @ t) for d, t in zip(designs, targets)]
    gains = []
    for i in range(len(designs)):
        rest = [j for j in range(len(designs)) if j != i]
        falls = [sum(_fall(grams, designs, targets, [k for k in rest if k != j], j, p).sum()
                     for j in rest) if len(rest) > 1 else 0.0 for p in PENALTIES]
        best = PENALTIES[int(np.argmax(falls))] if len(rest) > 1 else PENALTIES[2]
        gains.append(_fall(grams, designs, targets, rest, i, best))
    return gains


def _fall(grams, designs, targets, fitted, tested, penalty):
    A = sum(grams[j][0] for j in fitted)
    b = sum(grams[j][1] for j in fitted)
    weights = np.linalg.solve(A + penalty * len(fitted) * np.eye(len(A)), b)
    left = targets[tested] - designs[tested] @ weights
    return 0.5 * (targets[tested] ** 2 - left**2)


def _acting(values, likelihood, fit):
    """Features (n, m), each in every channel, in parts of full thrust."""
    body = 2 * fit.model.value("k") * np.array([1.0, 1.0, fit.model.value("l")])
    count = values.shape[1]
    acting = np.hstack([values * body[c] for c in range(3)])
    return acting, np.repeat([0, 1, 2], count).tolist()


def _simulated(run, model):
    """Velocities (n, 3) simulated in windows of 1.5 s from initial ones that suit the model."""
    cut = windows.cut([run])
    nu = np.full((len(run.times), 3), np.nan)
    for window, simulated in zip(cut, windows.problem([run], cut).simulate(model)["nu"]):
        nu[window.first : window.last + 1] = simulated
    return nu


def _commands(run):
    inputs, times = np.array(run.inputs), np.array(run.times)
    at = np.searchsorted(inputs[:, 0], times, side="right") - 1
    return np.where(at[:, None] >= 0, inputs[np.maximum(at, 0), 1:4], 0.0)


def _state_features(run, model):
    nu = _simulated(run, model)
    held = _commands(run)
    inside = np.isfinite(nu).all(axis=1)
    u, v, r = np.nan_to_num(nu).T / np.array([[0.5], [0.3], [4.0]])
    left, right = held[:, 0], held[:, 1]
    both, turn = left + right, left - right
    columns = [u, v, r, abs(u) * u, abs(v) * v, abs(r) * r, abs(u), abs(v), abs(r), u * v, u * r]
    columns += [v * r, left, right, left * right, both * u, both * v, both * r, turn * u, turn * v]
    columns += [turn * r, left**2, right**2, u**2, v**2, r**2, np.ones_like(u)]
    return np.column_stack(columns) * inside[:, None]


def _history_features(run, model):
    held, times = _commands(run), np.array(run.times)
    left, right = held[:, 0], held[:, 1]
    columns = []
    for memory in MEMORIES:
        past = [_past(times, x, memory) for x in (left, right)]
        columns += [past[0] + past[1] - left - right, past[0] - past[1] - left + right]
        columns += [(p - x) * x for p, x in zip(past, (left, right))]
        columns += [(p - x) * abs(p - x) for p, x in zip(past, (left, right))]
    return np.column_stack(columns)


def _past(times, values, memory):
    """Exponentially forgotten mean of what was held (n,)."""
    result = np.empty_like(values)
    state = 0.0
    for i, value in enumerate(values):
        result[i] = state
        step = times[i + 1] - times[i] if i + 1 < len(times) else 0.0
        state = value + (state - value) * np.exp(-step / memory)
    return result
