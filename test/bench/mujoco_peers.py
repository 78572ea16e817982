#!/usr/bin/python3
"""Moves the crafts of the MuJoCo bench, and lets peers name what is missing. Runs in the peers' Python.

`mujoco_peers.py WHAT FOLDER` reads and writes files of mujoco_cases in FOLDER and prints a JSON object. WHAT:
  move      the engine's motion of all runs
  truth     the held-out error of the engine's own model
  sysid     mujoco.sysid with all effects free on the engine's model; names those whose interval
            (95%, corrected for their number) excludes nothing
  sindy     PySINDy with terms of the library's effects; names the largest
  ridge     a Gaussian process, as a ridge regression on random Fourier features, for the accelerations that
            the nominal terms leave; names nothing, but says whether it predicts runs that it has not seen
A held-out error is that of a diagnosis: the mean of |e| / s over windows, summed over u, v and r, each
window from the best initial velocities.
"""
import json
import os
import sys
import time
import warnings

import mujoco
import numpy as np

import mujoco_craft as engine

STEP_OF_PEER = 4e-3  # of the engine in mujoco.sysid [s]
WINDOW = 1.5  # that mujoco.sysid fits to [s]
FREE = ("I_z", "X_u", "Y_v", "N_r", "k")  # parameters of the body that are not known
# Largest size of an effect in mujoco.sysid, and least one of an effect that has one sign, relative to a
# moderate one: with a shorter lag the engine's rule of integration is unstable.
LARGEST, LEAST = 5.0, 0.3
DIVERGED = 100.0  # largest error [s of the run]
ITERATIONS = 8  # of mujoco.sysid
WAVES = 300  # random Fourier features, which stand for a Gaussian process
LENGTHS, PENALTIES = (2.0, 5.0), (1e-4, 1e-3, 1e-2, 1e-1)  # of the features, in deviations, and of the ridge
SAYS = 0.05  # share of held-out accelerations from which on the ridge says that something is missing


class Data:
    """The files of a case."""

    def __init__(self, folder):
        self.folder = folder
        with open(os.path.join(folder, "craft.json")) as file:
            self.craft = json.load(file)
        self.plans = np.load(os.path.join(folder, "plans.npz"))

    def load(self):
        """What a diagnosis knows: runs, windows, scales of errors, sizes of effects."""
        with open(os.path.join(self.folder, "known.json")) as file:
            self.known = json.load(file)
        self.series = np.load(os.path.join(self.folder, "known.npz"))
        return self

    def run(self, i, first=0, count=None):
        """times, eta, nu of a part of a measured run, and the commands left, right, lift after each time."""
        part = slice(first, None if count is None else first + count)
        times, eta, nu = (self.series["%s %d" % (name, i)][part] for name in ("times", "eta", "nu"))
        return times, eta, nu, self.held(i, np.append(times, 2 * times[-1] - times[-2]))

    def held(self, i, edges):
        """Means of the commands between times on the run's clock."""
        return engine.held(self.plans["rows %d" % i], self.known["zero"][i] + edges)

    def windows(self, runs, length):
        """Windows (run, first sample) of a length [s] without a gap."""
        found = []
        for i in runs:
            times = self.run(i)[0]
            for start in np.arange(times[0], times[-1] - length, length):
                first = int(np.searchsorted(times, start))
                part = times[first : np.searchsorted(times, start + length)]
                if len(part) > 2 and np.diff(part).max() < 0.1:
                    found.append((i, first))
        return found

    def moved(self, name, i):
        return np.load(os.path.join(self.folder, "moved.npz"))["%s %d" % (name, i)]


def move(data):
    craft = engine.Craft(data.craft["body"], data.craft["effects"], data.craft["step"])
    arrays = {}
    for i in range(data.craft["runs"]):
        push, began = data.plans["push %d" % i], float(data.plans["began %d" % i])
        times = began + data.craft["step"] * np.arange(len(push) + 1)
        inputs = engine.held(data.plans["rows %d" % i], times)
        start = craft.begin(data.plans["pose %d" % i])
        at, rates, states = craft.run(start, inputs, **{data.craft["frame"]: push})
        eta, nu = engine.seen(craft.marker, at, rates)
        named = {"times": times, "eta": eta, "nu": nu, "nu_dot": np.gradient(nu, times, axis=0)}
        arrays.update({"%s %d" % (n, i): values for n, values in {**named, "states": states}.items()})
    np.savez(os.path.join(data.folder, "moved.npz"), **arrays)
    return {}


# --- Held-out errors


def error(data, rollout):
    """The held-out error. rollout(change (windows, 3)): velocities (windows, samples, 3) if the initial
    ones, measured or true, are changed; least squares, reweighted to absolute errors, finds the change."""
    windows, count = data.known["windows"], data.known["samples"]
    wanted = np.array([data.run(i, first, count)[2] for i, first in windows])
    scale = np.array([data.known["scale"][i] for i, _ in windows])[:, None, :]
    change, steps = np.zeros((len(windows), 3)), np.diag([1e-3, 1e-3, 1e-2])
    best = np.full(len(windows), np.inf)
    for _ in range(4):
        base = rollout(change)
        off = (base - wanted) / scale
        best = np.fmin(best, np.abs(off).mean(axis=1).sum(axis=1))
        slopes = [(rollout(change + step) - base) / scale / step.sum() for step in steps]
        for w in range(len(windows)):
            J = np.stack([slope[w].ravel() for slope in slopes], axis=1)
            r = off[w].ravel()
            if np.isfinite(J).all() and np.isfinite(r).all():
                weight = 1 / np.sqrt(np.abs(r) + 0.01)
                change[w] -= np.linalg.lstsq(J * weight[:, None], r * weight, rcond=None)[0]
    return float(np.mean(best))


def truth(data):
    craft, starts = engine.Craft(data.craft["body"], data.craft["effects"], data.craft["step"]), []
    for i, first in data.known["windows"]:
        times = data.known["zero"][i] + data.run(i, first, data.known["samples"])[0]
        known = data.moved("times", i)
        begin, end = np.searchsorted(known, (times[0], times[-1])) + (-1, 1)
        grid = known[begin : end + 1]
        inputs = engine.held(data.plans["rows %d" % i], grid)
        starts.append((data.moved("states", i)[begin], inputs, times, grid))

    def rollout(change):
        found = []
        for (state, inputs, times, grid), by in zip(starts, change):
            start = craft.restore(state)
            craft.shift(start, by)
            _, nu = engine.seen(craft.marker, *craft.run(start, inputs)[:2])
            found.append(np.column_stack([np.interp(times, grid, column) for column in nu.T]))
        return np.array(found)

    return {"error": error(data, rollout)}


def by_accelerations(data, accelerations):
    """A rollout of accelerations (n, 3) given poses, velocities (n, 3) and inputs (n, 2), by Heun's rule."""
    parts = [data.run(i, first, data.known["samples"]) for i, first in data.known["windows"]]
    times, eta, nu, inputs = (np.array([part[k] for part in parts]) for k in range(4))

    def rates(state, commands):
        c, s = np.cos(state[:, 2]), np.sin(state[:, 2])
        u, v, r = state[:, 3:].T
        moves = np.column_stack([c * u - s * v, s * u + c * v, r])
        return np.hstack([moves, accelerations(state[:, :3], state[:, 3:], commands)])

    def rollout(change):
        state = np.hstack([eta[:, 0], nu[:, 0] + change])
        found = [state]
        for k in range(times.shape[1] - 1):
            h, commands = np.diff(times[:, k : k + 2], axis=1), inputs[:, k, :2]
            slope = rates(state, commands)
            state = np.clip(state + h / 2 * (slope + rates(state + h * slope, commands)), -1e3, 1e3)
            found.append(state)
        return np.stack(found, axis=1)[:, :, 3:]

    return rollout


# --- The peers


def sindy(data):
    import peer_pysindy

    runs = []
    for i in range(data.known["fitted"]):
        times, eta, nu, inputs = data.run(i)
        step = float(np.median(np.diff(times)))
        runs.append({"nu": nu, "psi": eta[:, 2], "inputs": inputs[:, :2], "dt": step})
    named, coefficients = peer_pysindy.name_effect(runs)

    def accelerations(eta, nu, inputs):
        terms = peer_pysindy.terms(nu, eta[:, 2], inputs)
        columns = [sum(c * terms[name] for name, c in equation.items()) for equation in coefficients]
        return np.column_stack(columns)

    return {"named": [] if named == "nothing" else [named],
            "error": error(data, by_accelerations(data, accelerations))}  # fmt: skip


def ridge(data):
    from scipy.signal import savgol_filter

    def nominal(nu, inputs):
        u, v, r = nu.T
        both, turn = inputs[:, 0] + inputs[:, 1], inputs[:, 0] - inputs[:, 1]
        return [np.column_stack([both, u]), v[:, None], np.column_stack([turn, r])]

    def turning(nu):
        return np.column_stack([nu[:, 1] * nu[:, 2], -nu[:, 0] * nu[:, 2], 0 * nu[:, 0]])

    def arguments(eta, nu, inputs):
        return np.column_stack([nu, np.cos(eta[:, 2]), np.sin(eta[:, 2]), eta[:, :2], inputs])

    X, y, linear, run = [], [], [[], [], []], []
    for i in range(data.known["fitted"]):
        times, eta, nu, inputs = data.run(i)
        rates = savgol_filter(nu, 15, 3, deriv=1, delta=float(np.median(np.diff(times))), axis=0)
        smooth = savgol_filter(inputs[:, :2], 15, 3, axis=0)
        X.append(arguments(eta, nu, smooth))
        y.append(rates - turning(nu))
        run.append(np.full(len(eta), i))
        for terms, found in zip(nominal(nu, smooth), linear):
            found.append(terms)
    X, y, run, linear = np.vstack(X), np.vstack(y), np.concatenate(run), [np.vstack(a) for a in linear]
    weights = [np.linalg.lstsq(a, y[:, k], rcond=None)[0] for k, a in enumerate(linear)]
    left = y - np.column_stack([a @ w for a, w in zip(linear, weights)])
    center, spread, random = X.mean(axis=0), X.std(axis=0) + 1e-9, np.random.default_rng(1)
    frequency, phase = random.normal(size=(X.shape[1], WAVES)), random.uniform(0, 2 * np.pi, WAVES)

    def waves(x, length):
        return np.cos((x - center) / spread @ frequency / length + phase)

    def solved(F, y, penalty):
        return np.linalg.solve(F.T @ F + penalty * len(F) * np.eye(WAVES), F.T @ y)

    best = [(0.0, None)] * 3  # share of what is left in runs that the fit has not seen, and a fit
    for length in LENGTHS:
        F = waves(X, length)
        for penalty in PENALTIES:
            off = np.empty_like(left)
            for i in range(data.known["fitted"]):
                off[run == i] = left[run == i] - F[run == i] @ solved(F[run != i], left[run != i], penalty)
            shares, every = 1 - np.mean(off**2, axis=0) / np.mean(left**2, axis=0), solved(F, left, penalty)
            for k in range(3):
                if shares[k] > best[k][0]:
                    best[k] = float(shares[k]), (length, every[:, k])

    def accelerations(eta, nu, inputs):
        x = arguments(eta, nu, inputs)
        more = [waves(x, fit[0]) @ fit[1] if fit else 0 * nu[:, 0] for _, fit in best]
        known = [a @ w for a, w in zip(nominal(nu, inputs), weights)]
        return np.column_stack(known) + np.column_stack(more) + turning(nu)

    shares = [share for share, _ in best]
    return {"says": max(shares) > SAYS, "shares": shares,
            "error": error(data, by_accelerations(data, accelerations))}  # fmt: skip


def sysid(data):
    import absl.logging
    from mujoco import sysid as tool

    absl.logging.set_verbosity("error")
    # sizes: {effect: {parameter: [neutral value, moderate size, whether it has one sign]}}
    sizes, given = data.known["sizes"], data.known["given"]
    names = [(effect, name) for effect, ps in sizes.items() for name in ps]
    parameters = tool.ParameterDict()
    for name in FREE:
        parameters.add(tool.Parameter(name, 1.0, 0.3, 3.0))
    for effect, name in names:
        low, start = (LEAST, 2 * LEAST) if sizes[effect][name][2] else (-LARGEST, 0.0)
        parameters.add(tool.Parameter(effect + "." + name, start, low, LARGEST))

    def parts(values):
        body = dict(given, **{name: given[name] * float(values[name].value[0]) for name in FREE})
        effects = {effect: {} for effect in sizes}
        for effect, name in names:
            neutral, size, _ = sizes[effect][name]
            effects[effect][name] = neutral + size * float(values[effect + "." + name].value[0])
        return body, effects

    windows = data.windows(range(data.known["fitted"]), WINDOW)
    start = engine.Craft(*parts(parameters), STEP_OF_PEER)
    scale = np.mean(data.known["scale"][: data.known["fitted"]], axis=0)

    def residual_of(values, _, measured, *__, state, **___):
        at, rates = state[:, 1:4], state[:, 1 + start.model.nq :][:, :3]
        nu = engine.seen(engine.marker(parts(values)[1]), at, rates)[1]
        off = np.nan_to_num((nu - measured.data[1:]) / scale, nan=DIVERGED)
        return np.clip(off, -DIVERGED, DIVERGED), measured, measured

    sequences = tool.ModelSequences(
        "craft",
        mujoco.MjSpec.from_string(engine.xml(*parts(parameters), STEP_OF_PEER)),
        ["%d" % k for k in range(len(windows))],
        *_sequences(tool, data, start, windows),
        allow_missing_sensors=True,
    )
    residual = tool.build_residual_fn(
        models_sequences=[sequences],
        build_model=lambda values, _: engine.Craft(*parts(values), STEP_OF_PEER).model,
        modify_residual=residual_of,
        resample_true=False,
        n_threads=1,
    )
    found, result = tool.optimize(parameters, residual, verbose=False, max_iters=ITERATIONS)
    left = residual(found.as_vector(), found)[0]
    _, widths = tool.calculate_intervals(left, result.jac, alpha=0.05 / len(names))
    sure = np.abs(found.as_vector() - np.maximum(0.0, parameters.get_bounds()[0])) > np.ravel(widths)
    chosen = {effect for (effect, _), is_sure in zip(names, sure[len(FREE) :]) if is_sure}
    fitted = engine.Craft(*parts(found), STEP_OF_PEER)
    return {"named": sorted(chosen), "error": error(data, by_engine(data, fitted))}


def _sequences(tool, data, craft, windows):
    """Initial states, controls and measured velocities of windows on the engine's grid."""
    states, controls, measured = [], [], []
    grid = STEP_OF_PEER * np.arange(int(WINDOW / STEP_OF_PEER))
    for i, first in windows:
        times, eta, nu, _ = data.run(i, first)
        start = craft.begin(eta[0])
        craft.shift(start, nu[0])
        state = np.empty(mujoco.mj_stateSize(craft.model, engine.STATE))
        mujoco.mj_getState(craft.model, start, state, engine.STATE)
        states.append(state)
        inputs = data.held(i, times[0] + np.append(grid, grid[-1] + STEP_OF_PEER))
        controls.append(tool.TimeSeries(grid, craft.controls(inputs)))
        on_grid = [np.interp(times[0] + grid, times, column) for column in nu.T]
        measured.append(tool.TimeSeries(grid, np.column_stack(on_grid)))
    return states, controls, measured


def by_engine(data, craft):
    """A rollout of a craft of the engine that starts as measured."""
    step = craft.model.opt.timestep
    starts = []
    for i, first in data.known["windows"]:
        times, eta, nu, _ = data.run(i, first, data.known["samples"])
        edges = np.arange(times[0], times[-1] + 2 * step, step)
        starts.append((eta[0], nu[0], data.held(i, edges), times, edges))

    def rollout(change):
        found = []
        for (pose, nu, inputs, times, edges), by in zip(starts, change):
            start = craft.begin(pose)
            craft.shift(start, nu + by)
            at, rates, _ = craft.run(start, inputs)
            velocities = engine.seen(craft.marker, at, rates)[1]
            found.append(np.column_stack([np.interp(times, edges, column) for column in velocities.T]))
        return np.array(found)

    return rollout


def main():
    what, folder = sys.argv[1:]
    warnings.filterwarnings("ignore")
    data = Data(folder)
    begin = time.perf_counter()
    try:
        answer = WHAT[what](data if what == "move" else data.load())
    except (ValueError, FloatingPointError, np.linalg.LinAlgError) as failure:
        if what not in PEERS:
            raise
        answer = {"failed": str(failure)}
    print(json.dumps(dict(answer, seconds=time.perf_counter() - begin)))


PEERS = {"sysid": sysid, "sindy": sindy, "ridge": ridge}
WHAT = {"move": move, "truth": truth, **PEERS}

if __name__ == "__main__":
    main()
