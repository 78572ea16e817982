#!/usr/bin/python3
"""Diagnoses crafts that MuJoCo's engine moves, and compares the results with the truth and with peers.

A case follows from its seed: four runs of 8 s to fit to and two held out (mujoco_cases). Results go to a
file of JSON lines; an interrupted bench continues where it stopped.
"""
import argparse
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
import hidden_white
import mujoco_cases
import resumed
from ground import workers
from ground.errors import GroundError
from ground.recordings import windows

PEERS = ("sysid", "sindy", "ridge")
TITLES = {"ground": "ground", "sysid": "mujoco.sysid", "sindy": "PySINDy", "ridge": "ridge"}
LEAST = 0.02  # share that is learnable, from whose lower bound on something is said to be left
EXCESS = 1.5  # ratio to the truth's held-out error from which on something has to be said


def run_case(python, peers, seed):
    """Result of a seed, a dictionary for a line of JSON."""
    case, frame = mujoco_cases.make(seed)
    with tempfile.TemporaryDirectory() as folder:
        fitted, heldout, zeros = mujoco_cases.record(case, frame, python, folder)
        found = hidden_engine.diagnose(fitted, heldout, hidden_cases.given_model(case))
        result = dict(case.describe(), frame=frame, found=found)
        _hand_over(case, fitted + heldout, zeros, folder)
        result["true_error"] = mujoco_cases.peer(python, "truth", folder)["error"]
        result["peers"] = {name: mujoco_cases.peer(python, name, folder) for name in peers}
    for parameter in found.get("parameters", []):
        parameter["true"] = hidden_cases.true_value(case, parameter["name"])
    return result


def _hand_over(case, runs, zeros, folder):
    """Writes for the peers what a diagnosis knows, and the windows that it is judged on."""
    cut = windows.cut(runs)
    problem = windows.problem(runs, cut)
    judged = [w for w in cut if w.run >= hidden_cases.FITTED]
    sizes = {}
    for effect in mujoco_cases.LIBRARY:
        if effect == "skirt_friction":  # the engine's craft has one foot
            continue
        one_sided = effect in hidden_white.ONE_SIDED
        strengths = hidden_white.strengths()[effect]
        sizes[effect] = {p: [0.0, size, one_sided] for p, size in strengths.items()}
    known = {
        "fitted": hidden_cases.FITTED,
        "zero": zeros,
        "windows": [[w.run, w.first] for w in judged],
        "samples": min(w.last - w.first + 1 for w in judged),
        "scale": [list(problem.sigma(i)) for i in range(len(runs))],
        "given": {name: case.body[name] for name in ("m", "l")},
        "sizes": sizes,
    }
    model = hidden_cases.given_model(case)
    known["given"].update({name: model.value(name) for name in hidden_cases.FREE})
    with open(os.path.join(folder, "known.json"), "w") as file:
        json.dump(known, file)
    arrays = {}
    for i, run in enumerate(runs):
        arrays.update({"times %d" % i: run.times, "eta %d" % i: run.eta, "nu %d" % i: run.nu})
    np.savez(os.path.join(folder, "known.npz"), **arrays)


# --- Scores: yes, no, or None where they do not apply


def has_answered(result, tool):
    return tool == "ground" or "error" in result["peers"].get(tool, {})


def _answer(result, tool):
    """The result of a tool in the words of hidden_score: a peer declares nothing equal."""
    if tool == "ground":
        return result
    named = result["peers"][tool].get("named")
    return dict(result, found={"chosen": named, "groups": {}}) if named is not None else None


def is_right(result, tool):
    answer = _answer(result, tool)
    return score.is_right(answer) if answer and result["kind"] == "mujoco_library" else None


def has_false_effect(result, tool):
    answer = _answer(result, tool)
    return score.has_false_effect(answer) if answer else None


def false_in_null(result, tool):
    return has_false_effect(result, tool) if result["kind"] == "mujoco_null" else None


def says_left(result, tool):
    """Whether something is said to be missing that has no name."""
    if tool == "ridge":
        return result["peers"]["ridge"]["says"]
    if tool != "ground":
        return None
    found = result["found"]
    ceiling = found.get("ceiling")
    if ceiling:
        return ceiling["learnable"][1] > LEAST
    with_past = bool(set(result["effects"]) & set(mujoco_cases.WITH_STATES))
    return found["verdict"] == "unexplained" or (with_past and found["verdict"] == "memory")


def says_nameless(result, tool):
    is_left = result["kind"] == "mujoco_nameless" and ratio(result, "ground") >= EXCESS
    return says_left(result, tool) if is_left else None


def says_left_in_null(result, tool):
    if result["kind"] != "mujoco_null":
        return None
    return says_left(result, tool) if tool != "ground" else result["found"]["verdict"] != "complete"


def false_complete(result, tool):
    if tool != "ground" or ratio(result, tool) < EXCESS:
        return None
    return result["found"]["verdict"] == "complete"


def intervals_hold(result, tool):
    return score.intervals(result) if tool == "ground" and result["kind"] == "mujoco_library" else None


def ratio(result, tool):
    """The held-out error relative to that of the engine's own model without the random wrench."""
    error = result["found"]["errors"]["steps"][-1] if tool == "ground" else result["peers"][tool]["error"]
    return error / result["true_error"]


ROWS = (
    ("effects of the library: right or inseparable", is_right, (">=", 0.95)),
    ("nothing hidden: a false effect", false_in_null, ("<=", 0.02)),
    ("all: a false effect", has_false_effect, ("<=", 0.02)),
    ("nothing hidden: something said to be missing", says_left_in_null, ("<=", 0.03)),
    ("without a name, error above %g times the truth's: said" % EXCESS, says_nameless, (">=", 0.97)),
    ("error above %g times the truth's: `complete`" % EXCESS, false_complete, ("<=", 0.0)),
    ("95% intervals of the hidden effects hold", intervals_hold, ("in", 0.95)),
)


def lines(results, tools):
    """Lines of the table, each a list of strings: the question, its bound, and a column for each tool."""
    table = [["what", "bound"] + [TITLES[tool] for tool in tools]]
    for what, ask, bound in ROWS:
        table.append([what, hidden_table.bound(bound)] + [_rate(results, ask, tool) for tool in tools])
    for kind in sorted(set(mujoco_cases.KINDS)):
        of_kind = [r for r in results if r["kind"] == kind]
        if of_kind:
            line = ["median error held out / the truth's, " + kind.split("_")[1], ""]
            table.append(line + [_median(of_kind, tool) for tool in tools])
    return table


def _median(results, tool):
    ratios = [ratio(r, tool) for r in results if has_answered(r, tool)]
    return "%.2f" % np.median(ratios) if ratios else ""


def _rate(results, ask, tool):
    given = [ask(r, tool) for r in results if has_answered(r, tool)]
    given = [one for answer in given for one in (answer if isinstance(answer, list) else [answer])]
    answers = [answer for answer in given if answer is not None]
    if not answers:
        return ""
    yes, count, low, high = hidden_table.rate(answers)
    return "%d of %d (%.0f to %.0f%%)" % (yes, count, 100 * low, 100 * high)


def wrong(results):
    """A line for each case that ground got wrong."""
    for r in results:
        faults = [what for what, ask, (sense, _) in ROWS if ask(r, "ground") is (sense == "<=")]
        if faults:
            words = "seed %d: hidden %s, wrench %.1f%% in the %s; found %s, %s, error %.2f times the truth's"
            yield words % (
                r["seed"], ",".join(r["effects"]) or "nothing", 100 * r["level"], r["frame"],
                ",".join(r["found"]["chosen"]) or "nothing", r["found"]["verdict"], ratio(r, "ground"),
            )  # fmt: skip


def bench(options):
    """Runs the seeds without a result and prints the table of all."""
    peers = [peer for peer in PEERS if peer in options.peers]
    with workers.Workers(processes=True, count=options.jobs) as team:
        results = resumed.results(
            team,
            options.results,
            list(range(options.seed_base, options.seed_base + options.count)),
            lambda seed: (seed, tuple(peers)),
            lambda result: (result["seed"], tuple(result["peers"])),
            functools.partial(run_case, options.python, peers),
            options.hours,
        )
    for r in [r for r in results if "failed" in r["found"]]:
        print("failed: seed %d: %s" % (r["seed"], r["found"]["failed"]))
    results = [r for r in results if "failed" not in r["found"]]
    if results:
        table = lines(results, ["ground"] + peers)
        print("\n".join(wrong(results)))
        print("\n%s\n\n%d cases" % (hidden_table.text(table), len(results)))
        if options.markdown:
            with open(options.markdown, "w") as file:
                file.write(hidden_table.markdown(table) + "\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--python", required=True, help="interpreter that has MuJoCo (peer_python prints it)")
    parser.add_argument("--peers", nargs="*", default=[], choices=PEERS, help="peers on the same data (none)")
    parser.add_argument("--count", type=int, default=120, help="number of cases (120)")
    parser.add_argument("--seed-base", type=int, default=1, help="seed of the first case (1)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument("--hours", type=float, default=float("inf"), help="begin no case after this time")
    parser.add_argument("--results", default="build/mujoco.jsonl", help="file of JSON lines")
    parser.add_argument("--markdown", help="file for the table")
    options = parser.parse_args()
    if not options.python:
        return "MuJoCo, which moves the crafts, could not be installed from PyPI"
    try:
        bench(options)
    except (GroundError, OSError) as error:
        return str(error)


if __name__ == "__main__":
    sys.exit(main())
