#!/usr/bin/python3
"""How time and memory of a fit grow with the number of bags, free effects, and the windows' length.

Each case runs in its own process. Prints one JSON object per case.
"""
import json
import os
import resource
import subprocess
import sys
import time

HERE = os.path.dirname(os.path.abspath(__file__))
MODEL = os.path.join(HERE, "../../cfg/hovercraft/tiny_whoover.yaml")
BODY = ["I_z", "X_u", "Y_v", "N_r", "k"]
EFFECTS = ["motor_lag", "quadratic_drag", "com_offset", "thrust_asymmetry", "floor_tilt", "wind"]
# (what grows, cases); a case: number of bags of 10 s, of effects, length of windows [s]
CASES = [("bags", [(n, 0, 1.0) for n in (1, 10, 50, 200)])]
CASES += [("effects", [(10, n, 1.0) for n in (0, 1, 3, 6)])]
CASES += [("window", [(10, 1, s) for s in (0.25, 0.5, 1.0, 2.0, 4.0)])]


def measure(bags, effects, window):
    """Time and memory of one fit, and whether it converged."""
    import numpy as np

    from ground import _core

    truth, model = _core.load_model(MODEL), _core.load_model(MODEL)
    times = np.arange(1001) / 100
    random = np.random.RandomState(1)
    runs, windows = [], []
    for seed in range(bags):
        bits = np.array(_core.make_prbs(9, 37 * seed), float)[:100]
        rows = np.column_stack([np.arange(100) / 10, bits, np.ones(100)])
        motion = _core.simulate(truth, rows, times, np.zeros(3), np.zeros(3))
        nu = motion["nu"] + 0.05 * motion["nu"].std(axis=0) * random.randn(len(times), 3)
        runs.append(_core.RunData("run %d" % seed, times, motion["eta"], nu, rows))
        windows += _core.cut_windows(runs[-1], seed, 0, 1e9, window)
    free = list(BODY)
    for name in EFFECTS[:effects]:
        model.add_effect(name)
    free += [p["name"] for p in model.parameters() if "." in p["name"]]
    for name in BODY:
        model.set_value(name, 1.3 * truth.value(name))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begin = time.perf_counter()
    result = _core.SimulationError(runs, windows).fit(model, free)
    seconds = time.perf_counter() - begin
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {"seconds": seconds, "MB": (after - before) / 1e3, "converged": result["converged"]}


def main():
    if len(sys.argv) > 1:
        print(json.dumps(measure(int(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3]))))
        return
    for what, cases in CASES:
        for case in cases:
            command = [sys.executable, os.path.abspath(__file__)] + [str(c) for c in case]
            found = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
            found.update(what=what, bags=case[0], effects=case[1], window=case[2])
            print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
