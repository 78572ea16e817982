#!/usr/bin/python3
"""Hides effects in simulated crafts, diagnoses each, and compares the results with the truth.

A case is a kind and a seed: four runs of 8 s to fit to and two held out. The bench has its own craft,
disturbance and measurement (hidden_cases); kinds that begin with white_ use the project's simulator.
Results go to a file of JSON lines; an interrupted bench continues where it stopped.
"""

import functools
import json
import sys
import time

import hidden_cases
import hidden_engine
import hidden_table
import hidden_white as white
import resumed
from ground.analysis import next_experiment, window_error

from ground import _core, workers

COUNTS = {**{kind: count for kind, (_, count) in hidden_cases.KINDS.items()}, **white.KINDS}


def run_case(job):
    """Result of one job (kind, seed, options of white cases), a dictionary for a line of JSON."""
    kind, seed, cell = job
    if kind == "white_ambiguous":
        return run_ambiguous(white.make(kind, seed, **cell))
    if kind in white.KINDS:
        return run_white(white.make(kind, seed, **cell))
    case = hidden_cases.make(kind, seed)
    start = time.perf_counter()
    fitted, heldout = hidden_cases.record(case)
    made = time.perf_counter() - start
    thorough = "nameless" in case.effects
    found = hidden_engine.diagnose(fitted, heldout, hidden_cases.given_model(case), thorough)
    _add_truth(found, functools.partial(hidden_cases.true_value, case))
    result = dict(case.describe(), seconds_of_data=made, found=found)
    return dict(result, **hidden_cases.truth_about(case, fitted, heldout)) if thorough else result


def run_white(case):
    """Result of a case in white noise, with the held-out error of the refitted true model unless the
    effect is outside the library."""
    truth, runs = white.recorded(case)
    outside = case["kind"] == "white_outside"
    found = hidden_engine.diagnose(runs, (), _core.load_model(white.MODEL), thorough=outside)
    known = {p["name"]: truth.value(p["name"]) for p in truth.parameters()}
    _add_truth(found, lambda name: known[name] if name in known else white.neutral(name))
    if outside:  # a fit of its formula takes long
        return dict(case, found=found)
    fitter, free = window_error.WindowFitter(runs, threads=1), window_error.free_parameters(truth)
    error = fitter.fit(truth, free).heldout.sum()
    return dict(case, true_error=float(error), found=found)


def run_ambiguous(case):
    """Result of runs that cannot distinguish two effects, before and after the proposed experiment."""
    truth, runs = white.recorded(case)
    found = _thorough(runs)
    result = dict(case, found=found)
    if "failed" in found:
        return result
    result["before"] = _choice(found, case)
    proposed = found["next_experiment"]
    if proposed:
        schedule = next_experiment.schedule_of(proposed["arguments"], truth)
        runs = runs + white.more_runs(case, truth, schedule, proposed["repeat"])
        result["after"] = _choice(_thorough(runs), case)
    return result


def _thorough(runs):
    return hidden_engine.diagnose(runs, (), _core.load_model(white.MODEL), thorough=True)


def _choice(found, case):
    """The chosen effects, and the group that cannot be distinguished from the first rival."""
    rivals = white.AMBIGUOUS[case["ambiguous"]][1]
    group = next(group for name, group in found["alike"].items() if name in rivals)
    return {"chosen": found["chosen"], "group": group}


def _add_truth(found, true_value):
    """Adds to each parameter its true value."""
    for parameter in found.get("parameters", []):
        parameter["true"] = true_value(parameter["name"])


def jobs_of(options):
    """Jobs that the options ask for. Kinds alternate: an interrupted bench has results of each."""
    cell = {name: getattr(options, name) for name in ("strength", "noise", "excitation")}
    counts = {kind: options.count or COUNTS[kind] for kind in kinds_of(options.kinds)}
    for number in range(max(counts.values())):
        for kind, count in counts.items():
            if number < count:
                yield kind, options.seed_base + number, cell if kind in white.KINDS else {}


def kinds_of(names):
    """Kinds by their names; `white` and `new` stand for several."""
    sorts = {"white": list(white.KINDS), "new": list(hidden_cases.KINDS)}
    return [kind for name in names for kind in sorts.get(name, [name])]


def key(kind, seed, cell):
    return json.dumps([kind, seed] + [cell[name] for name in sorted(cell)])


def key_of(result):
    """The key of the job that gave a result."""
    cell = ("strength", "noise", "excitation") if result["kind"] in white.KINDS else ()
    return key(result["kind"], result["seed"], {name: result[name] for name in cell})


def bench(options):
    """Runs the jobs without a result and prints the table of all jobs."""
    with workers.Workers(processes=True, count=options.jobs) as team:
        found = resumed.results(
            team,
            options.results,
            list(jobs_of(options)),
            lambda job: key(*job),
            key_of,
            run_case,
            options.hours,
        )
    summary(found, options)


def summary(results, options):
    """Prints the table of the results; writes the table if an option asks for it."""
    for r in [r for r in results if "failed" in r["found"]]:
        print("failed: %s %d: %s" % (r["kind"], r["seed"], r["found"]["failed"]))
    results = [r for r in results if "failed" not in r["found"]]
    if not results:
        return
    print("\n".join(hidden_table.wrong(results)))
    table = hidden_table.lines(results)
    verdicts = hidden_table.verdicts(results)
    print("\n%s\n\n%s" % (hidden_table.text(table), hidden_table.text(verdicts)))
    seconds = sorted(r["found"]["seconds"] for r in results)
    words = "\n%d cases; seconds a diagnosis on one core: median %.1f, most %.1f"
    print(words % (len(results), seconds[len(seconds) // 2], seconds[-1]))
    hidden_table.write(options.markdown, table, verdicts)


def main():
    parser = resumed.parser(__doc__, "build/hidden.jsonl")
    kinds = ["new", "white"] + list(COUNTS)
    parser.add_argument("--kinds", nargs="+", default=kinds[:2], choices=kinds, metavar="KIND",
                        help="some of %s; white: all that begin with white_; new: all others (both)"
                        % ", ".join(kinds[2:]))  # fmt: skip
    parser.add_argument("--strength", default="moderate", choices=list(white.LEVELS),
                        help="strength of effects in white cases")  # fmt: skip
    parser.add_argument("--noise", type=float, default=1.0, help="factor on the noise in white cases")
    parser.add_argument("--excitation", default="varied", choices=["varied", "prbs"],
                        help="excitation in white cases")  # fmt: skip
    return resumed.status(bench, parser.parse_args())


if __name__ == "__main__":
    sys.exit(main())
