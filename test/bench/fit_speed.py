#!/usr/bin/python3
"""Times [s] of a fit by ground, scipy over vectorised numpy, and JAX, on the same artificial data, as JSON.

Nine runs of 4 s, PRBS {0, 1} at 20 Hz, 100 Hz samples, RK4 with h = 0.005 s, five parameters from
0.2 each and nine initial velocities. Each contender runs on one core, in the interpreter that has it;
data and results are exchanged by .npz files.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time

import numpy as np

from ground import _core

HERE = os.path.dirname(os.path.abspath(__file__))
NAMES = ["I_z", "X_u", "Y_v", "N_r", "k"]
TRUTH = [1e-3, 5e-2, 5e-2, 1e-3, 0.1]  # thesis, table 3.1
START = [0.2] * 5
MAX_DIFFERENCE = 1e-3  # relative, of the parameters that two contenders find
RUNS, DURATION, SAMPLES_PER_SECOND, STEPS_PER_SECOND, CLOCK, NOISE = 9, 4, 100, 200, 20, 0.1


def make_model(path, values):
    model = _core.load_model(path)
    for name, value in zip(NAMES, values):
        model.set_value(name, value)
    return model


def make_runs(model):
    """RunData and inputs of the artificial runs; NOISE is relative to each velocity's deviation."""
    times = np.arange(DURATION * SAMPLES_PER_SECOND + 1) / SAMPLES_PER_SECOND
    random = np.random.RandomState(1)
    runs, inputs = [], []
    for seed in range(RUNS):
        bits = np.array(_core.make_prbs(9, 37 * seed), float)[: DURATION * CLOCK]
        rows = np.column_stack([np.arange(len(bits)) / CLOCK, bits, np.ones(len(bits))])
        motion = _core.simulate(model, rows, times, np.zeros(3), np.zeros(3))
        nu = motion["nu"] + NOISE * motion["nu"].std(axis=0) * random.randn(len(times), 3)
        runs.append(_core.RunData("run %d" % (seed + 1), times, motion["eta"], nu, rows))
        inputs.append(np.repeat(bits, STEPS_PER_SECOND // CLOCK, axis=0))
    return runs, np.array(inputs)


def fit_core(runs, model):
    """Times [s] and parameters of our fit."""
    windows = [w for i, r in enumerate(runs) for w in _core.cut_windows(r, i, 0, 1e9, DURATION)]
    times = []
    for _ in range(8):
        begin = time.perf_counter()
        result = _core.SimulationError(runs, windows).fit(model, NAMES)
        times.append(time.perf_counter() - begin)
    return times[1:], [p["value"] for p in result["parameters"]]


def fit_elsewhere(python, script, data, folder):
    """Times [s] and parameters of a contender. Raises CalledProcessError if it fails."""
    result = os.path.join(folder, "result.npz")
    environment = dict(os.environ, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
    environment.pop("PYTHONPATH", None)  # holds ROS modules for the system's Python
    command = [python, os.path.join(HERE, script), data, result]
    subprocess.run(command, check=True, env=environment, cwd=folder)
    with np.load(result) as found:
        return found["times"], found["theta"]


def save(path, runs, inputs, start):
    np.savez(
        path,
        nu=[r.nu for r in runs],
        inputs=inputs,
        h=1 / STEPS_PER_SECOND,
        stride=STEPS_PER_SECOND // SAMPLES_PER_SECOND,
        mass=start.value("m"),
        lever=start.value("l"),
        start=START,
    )


def contest(peers):
    """Rows (name, times [s], parameters) of the contenders."""
    model = os.path.join(HERE, "../../cfg/hovercraft/tiny_whoover.yaml")
    start = make_model(model, START)
    runs, inputs = make_runs(make_model(model, TRUTH))
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(cores)})
    rows = [("ground", *fit_core(runs, start))]
    with tempfile.TemporaryDirectory() as folder:
        data = os.path.join(folder, "data.npz")
        save(data, runs, inputs, start)
        rows.append(("scipy over numpy", *fit_elsewhere("/usr/bin/python3", "fit_scipy.py", data, folder)))
        if peers:
            python = os.path.abspath(peers)
            rows.append(("JAX, jitted", *fit_elsewhere(python, "fit_jax.py", data, folder)))
    os.sched_setaffinity(0, cores)
    if len(cores) > 1:
        rows.append(("ground, %d cores" % len(cores), *fit_core(runs, start)))
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--peers", metavar="PYTHON", help="interpreter of JAX, if any")
    rows = contest(parser.parse_args().peers)
    print(json.dumps({name: list(map(float, times)) for name, times, _ in rows}))
    return agreement(rows)


def agreement(rows):
    """Exit status: 0 if all contenders found the same parameters."""
    status = 0
    for name, _, theta in rows[1:]:
        difference = np.max(np.abs(np.array(theta) / rows[0][2] - 1))
        if not difference < MAX_DIFFERENCE:
            status = 1
            message = "fit_speed: %s found parameters that differ by %.1e" % (name, difference)
            print(message, file=sys.stderr)
    return status


if __name__ == "__main__":
    sys.exit(main())
