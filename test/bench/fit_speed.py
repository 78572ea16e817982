#!/usr/bin/python3
"""The same fit by ground, by scipy over vectorised numpy, and by CasADi: times and ratios.

Nine runs of 4 s (thesis 3.3.2: PRBS {0, 1} at 20 Hz, 100 samples a second, steps of 5 ms), five
parameters from 0.2 each, one free initial velocity a run, velocities divided by their standard
deviation. The others run in an environment of their own (fit_contenders.py); all must find the same.
"""
import json
import pathlib
import subprocess
import sys
import tempfile
import time

import numpy as np

from ground import _core

HERE = pathlib.Path(__file__).resolve().parent
MODEL = HERE.parents[1] / "cfg" / "hovercraft" / "tiny_whoover.yaml"
ENVIRONMENT = HERE.parents[1] / "build" / "bench-venv"
TRUTH = {"I_z": 1e-3, "X_u": 5e-2, "Y_v": 5e-2, "N_r": 1e-3, "k": 0.1}  # table 3.1
RUNS, DURATION, CLOCK, NOISE, REPEATS = 9, 4.0, 20, 0.01, 9


def make_runs(model):
    runs = []
    for seed in range(RUNS):
        bits = np.array(_core.make_prbs(9, 37 * seed + 1), float)[: int(DURATION * CLOCK)]
        edges = np.arange(len(bits)) / CLOCK
        inputs = np.column_stack([edges, bits, np.ones(len(bits))])
        times = np.linspace(0, DURATION, int(100 * DURATION) + 1)
        found = _core.simulate(model, inputs, times, np.zeros(3), np.zeros(3))
        noise = np.random.default_rng(seed).normal(size=found["nu"].shape)
        nu = found["nu"] + NOISE * found["nu"].std(axis=0) * noise
        runs.append(_core.RunData("run%d" % seed, times, found["eta"], nu, inputs))
    return runs


def timed(work):
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        result = work()
        times.append(time.perf_counter() - start)
    return {"seconds": times, "values": [float(v) for v in result]}


def contenders(runs, model):
    """Times and estimates of fit_contenders.py in its own environment, and the versions there."""
    python = ENVIRONMENT / "bin" / "python"
    if not python.exists():
        subprocess.check_call(
            [sys.executable, "-m", "venv", "--system-site-packages", str(ENVIRONMENT)]
        )
    pip = [str(python), "-m", "pip", "install", "--quiet", "casadi==3.6.7"]
    if subprocess.call(pip, stdout=subprocess.DEVNULL) != 0:
        print("CasADi cannot be installed here (is there a package index?): left out")
    with tempfile.NamedTemporaryFile(suffix=".npz") as file:
        np.savez(
            file.name,
            nu=np.array([r.nu for r in runs]),
            inputs=np.array([r.inputs[:, 1:3] for r in runs]),
            clock=CLOCK,
            body=[model.value("m"), model.value("l")],
            repeats=REPEATS,
        )
        command = [str(python), str(HERE / "fit_contenders.py"), file.name]
        return json.loads(subprocess.check_output(command, universal_newlines=True))


def main():
    model = _core.load_model(str(MODEL))
    for name, value in TRUTH.items():
        model.set_value(name, value)
    runs = make_runs(model)
    windows = [w for i, r in enumerate(runs) for w in _core.cut_windows(r, i, 0, 1e9, DURATION)]
    problem = _core.SimulationError(runs, windows)
    for name in TRUTH:
        model.set_value(name, 0.2)

    def fit(threads):
        found = problem.fit(model, list(TRUTH), threads=threads)
        return [p["value"] for p in found["parameters"]]

    results = {
        "ground, one thread": timed(lambda: fit(1)),
        "ground, all cores": timed(lambda: fit(0)),
    }
    others = contenders(runs, model)
    results.update(others["results"])
    print("nine runs of 4 s, five parameters, from 0.2 each (%s)" % others["versions"])
    print("%-34s %12s %20s %8s" % ("", "median", "least to most", "ratio"))
    best = np.median(results["ground, one thread"]["seconds"])
    reference = np.array(results["ground, one thread"]["values"])
    wrong = []
    for name, result in results.items():
        seconds = np.array(result["seconds"])
        print(
            "%-34s %9.1f ms %8.1f to %6.1f ms %8.1f"
            % (
                name,
                1e3 * np.median(seconds),
                1e3 * seconds.min(),
                1e3 * seconds.max(),
                np.median(seconds) / best,
            )
        )
        if np.abs(np.array(result["values"]) / reference - 1).max() > 2e-3:
            wrong.append(name)
    if wrong:
        sys.exit("these found other parameters: %s" % ", ".join(wrong))


if __name__ == "__main__":
    main()
