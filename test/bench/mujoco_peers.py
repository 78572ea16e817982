#!/usr/bin/python3
"""Moves the crafts of the MuJoCo bench by the engine, in the Python that has it.

`mujoco_peers.py WHAT FOLDER` reads and writes files of mujoco_cases in FOLDER and prints a JSON object. WHAT:
  move      the engine's motion of all runs
  truth     the held-out error of the engine's own model
A held-out error is that of a diagnosis: the mean of |e| / s over windows, summed over u, v and r, each
window from the best initial velocities.
"""

import json
import os
import sys
import time

import numpy as np

import mujoco_craft as engine


class Data:
    """The files of a case."""

    def __init__(self, folder):
        self.folder = folder
        with open(os.path.join(folder, "craft.json")) as file:
            self.craft = json.load(file)
        self.plans = np.load(os.path.join(folder, "plans.npz"))

    def load(self):
        """What a diagnosis knows: runs, windows, scales of errors."""
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


def main():
    what, folder = sys.argv[1:]
    data = Data(folder)
    begin = time.perf_counter()
    answer = WHAT[what](data if what == "move" else data.load())
    print(json.dumps(dict(answer, seconds=time.perf_counter() - begin)))


WHAT = {"move": move, "truth": truth}

if __name__ == "__main__":
    main()
