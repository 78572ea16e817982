#!/usr/bin/python3
"""Finds the missing effect by ground's diagnosis and by PySINDy, on the same recordings.

Each effect of EFFECTS, which are terms of an acceleration, is hidden in the simulated craft at moderate
strength; four runs of 8 s, mocap noise 0.3 mm and 0.005 rad. Prints a table, or JSON with --json.
"""
import argparse
import json
import os
import subprocess
import sys
import tempfile

import numpy as np

import hidden_engine
import hidden_white as cases
from ground import _core

EFFECTS = [
    "quadratic_drag", "coulomb_friction", "sway_yaw_damping", "yaw_bias", "body_force_bias",
    "floor_tilt", "thrust_asymmetry", "thrust_misalignment", "differential_side_force",
    "thrust_sway_moment", "thrust_speed_loss",
]  # fmt: skip


def as_arrays(run):
    """A run for PySINDy: smoothed velocities, headings, held inputs, and the mean sample interval."""
    times, rows = np.asarray(run.times), np.asarray(run.inputs)
    held = np.clip(np.searchsorted(rows[:, 0], times, side="right") - 1, 0, None)
    return {
        "nu": np.asarray(run.nu),
        "psi": np.asarray(run.eta)[:, 2],
        "inputs": rows[held, 1:3],
        "dt": float(np.mean(np.diff(times))),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--peers", metavar="PYTHON", help="interpreter that has PySINDy, if any")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    rows, recordings = [], []
    for effect in EFFECTS:
        truth = cases.truth([effect], 1.0, arguments.seed)
        runs = cases.runs(truth, "varied", 1.0, arguments.seed)
        found = hidden_engine.diagnose(runs, (), _core.load_model(cases.MODEL))
        chosen = (found.get("chosen") or ["nothing"])[0]
        same = effect == chosen or effect in found.get("groups", {}).get(chosen, [])
        rows.append({"hidden": effect, "ours": chosen, "told": same, "seconds": found["seconds"]})
        recordings.append([as_arrays(run) for run in runs])
    if arguments.peers:
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "cases.json")
            with open(path, "w") as file:
                json.dump(recordings, file, default=np.ndarray.tolist)
            script = os.path.join(os.path.dirname(os.path.abspath(__file__)), "peer_pysindy.py")
            environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
            result = subprocess.run(
                [os.path.abspath(arguments.peers), script, path],
                check=True, env=environment, stdout=subprocess.PIPE,
            )  # fmt: skip
        for row, line in zip(rows, result.stdout.splitlines()):
            named = json.loads(line)
            row.update(pysindy=named["named"], pysindy_seconds=named["seconds"])
    if arguments.json:
        print(json.dumps(rows))
        return 0
    print("%-24s %-24s %7s   %-24s %7s" % ("hidden", "ground", "s", "PySINDy", "s"))
    for row in rows:
        print(
            "%-24s %-24s %7.2f   %-24s %7.2f"
            % (
                row["hidden"],
                row["ours"],
                row["seconds"],
                row.get("pysindy", "-"),
                row.get("pysindy_seconds", 0.0),
            )
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
