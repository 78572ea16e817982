#!/usr/bin/python3
"""Diagnoses crafts that MuJoCo's engine moves, and compares the results with the truth.

A case follows from its seed: four runs of 8 s to fit to and two held out (mujoco_cases). Results go to a
file of JSON lines; an interrupted bench continues where it stopped.
"""

import functools
import json
import os
import sys
import tempfile

import numpy as np

import hidden_cases
import hidden_engine
import hidden_score as score
import hidden_table
import mujoco_cases
import resumed
from ground.analysis import windows
from ground.support import workers
from hidden_table import Row

LEAST = 0.02  # share that is learnable, from whose lower bound on something is said to be left
EXCESS = 1.5  # ratio to the truth's held-out error from which on something has to be said


def run_case(python, seed):
    """Result of a seed, a dictionary for a line of JSON."""
    case, frame = mujoco_cases.make(seed)
    with tempfile.TemporaryDirectory() as folder:
        fitted, heldout, zeros = mujoco_cases.record(case, frame, python, folder)
        found = hidden_engine.diagnose(fitted, heldout, hidden_cases.given_model(case))
        result = dict(case.describe(), frame=frame, found=found)
        _hand_over(case, fitted + heldout, zeros, folder)
        result["true_error"] = mujoco_cases.peer(python, "truth", folder)["error"]
    for parameter in found.get("parameters", []):
        parameter["true"] = hidden_cases.true_value(case, parameter["name"])
    return result


def _hand_over(case, runs, zeros, folder):
    """Writes what a diagnosis knows, and the windows that it is judged on."""
    cut = windows.cut(runs)
    problem = windows.problem(runs, cut)
    judged = [w for w in cut if w.run >= hidden_cases.FITTED]
    known = {
        "fitted": hidden_cases.FITTED,
        "zero": zeros,
        "windows": [[w.run, w.first] for w in judged],
        "samples": min(w.last - w.first + 1 for w in judged),
        "scale": [list(problem.sigma(i)) for i in range(len(runs))],
    }
    with open(os.path.join(folder, "known.json"), "w") as file:
        json.dump(known, file)
    arrays = {}
    for i, run in enumerate(runs):
        arrays.update({"times %d" % i: run.times, "eta %d" % i: run.eta, "nu %d" % i: run.nu})
    np.savez(os.path.join(folder, "known.npz"), **arrays)


# --- Scores: yes, no, or None where they do not apply


def is_right(result):
    return score.is_right(result) if result["kind"] == "mujoco_library" else None


def false_in_null(result):
    return score.has_false_effect(result) if result["kind"] == "mujoco_null" else None


def says_left(result):
    """Whether something is said to be missing that has no name."""
    found = result["found"]
    ceiling = found.get("ceiling")
    if ceiling:
        return ceiling["learnable"][1] > LEAST
    with_past = bool(set(result["effects"]) & set(mujoco_cases.WITH_STATES))
    return found["verdict"] == "unexplained" or (with_past and found["verdict"] == "memory")


def says_nameless(result):
    is_left = result["kind"] == "mujoco_nameless" and ratio(result) >= EXCESS
    return says_left(result) if is_left else None


def says_left_in_null(result):
    return result["found"]["verdict"] != "complete" if result["kind"] == "mujoco_null" else None


def false_complete(result):
    return result["found"]["verdict"] == "complete" if ratio(result) >= EXCESS else None


def intervals_hold(result):
    return score.intervals(result) if result["kind"] == "mujoco_library" else None


def ratio(result):
    """The held-out error relative to that of the engine's own model without the random wrench."""
    return result["found"]["errors"]["steps"][-1] / result["true_error"]


ROWS = (
    Row("effects of the library: right or inseparable", (), is_right, (">=", 0.95)),
    Row("nothing hidden: a false effect", (), false_in_null, ("<=", 0.02)),
    Row("all: a false effect", (), score.has_false_effect, ("<=", 0.02)),
    Row("nothing hidden: something said to be missing", (), says_left_in_null, ("<=", 0.03)),
    Row("without a name, error above %g times the truth's: said" % EXCESS, (), says_nameless, (">=", 0.97)),
    Row("error above %g times the truth's: `complete`" % EXCESS, (), false_complete, ("<=", 0.0)),
    Row("95% intervals of the hidden effects hold", (), intervals_hold, ("in", 0.95)),
)


def lines(results):
    """Lines of the table, each a list of strings, as hidden_table.lines has them."""
    table = hidden_table.lines(results, ROWS)
    for kind in sorted(set(mujoco_cases.KINDS)):
        ratios = [ratio(r) for r in results if r["kind"] == kind]
        if ratios:
            what = "median error held out / the truth's, " + kind.split("_")[1]
            table.append([what, "%.2f" % np.median(ratios), "%d" % len(ratios), "", "", ""])
    return table


def wrong(results):
    """A line for each case that ground got wrong."""
    for r in results:
        faults = [row.what for row in ROWS if row.ask(r) is (row.bound[0] == "<=")]
        if faults:
            words = "seed %d: hidden %s, wrench %.1f%% in the %s; found %s, %s, error %.2f times the truth's"
            yield words % (
                r["seed"], ",".join(r["effects"]) or "nothing", 100 * r["level"], r["frame"],
                ",".join(r["found"]["chosen"]) or "nothing", r["found"]["verdict"], ratio(r),
            )  # fmt: skip


def bench(options):
    """Runs the seeds without a result and prints the table of all."""
    team = workers.Workers(processes=True, count=options.jobs)
    results = resumed.results(
        team,
        options.results,
        list(range(options.seed_base, options.seed_base + options.count)),
        lambda seed: seed,
        lambda result: result["seed"],
        functools.partial(run_case, options.python),
        options.hours,
    )
    for r in [r for r in results if "failed" in r["found"]]:
        print("failed: seed %d: %s" % (r["seed"], r["found"]["failed"]))
    results = [r for r in results if "failed" not in r["found"]]
    if results:
        print("\n".join(wrong(results)))
        print("\n%s\n\n%d cases" % (hidden_table.text(lines(results)), len(results)))
        hidden_table.write(options.markdown, lines(results))


def main():
    parser = resumed.parser(__doc__, "build/mujoco.jsonl")
    parser.add_argument("--python", required=True, help="interpreter that has MuJoCo (peer_python prints it)")
    options = parser.parse_args()
    options.count = options.count or 120
    if not options.python:
        return "MuJoCo, which moves the crafts, could not be installed from PyPI"
    return resumed.status(bench, options)


if __name__ == "__main__":
    sys.exit(main())
