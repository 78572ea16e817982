#!/usr/bin/python3
"""Hides effects in simulated crafts, diagnoses each, and compares the results with the truth.

A case is a kind and a seed: four runs of 8 s to fit to and two held out; for the kinds of hidden_conditions
three runs of 12 s, and three fresh ones that judge the answer (hidden_judge). The bench has its own craft,
disturbance and measurement (hidden_cases). Results go to a file of JSON lines; an interrupted bench
continues where it stopped.
"""

import functools
import sys
import time

import hidden_cases
import hidden_conditions
import hidden_engine
import hidden_judge
import hidden_table
import resumed
from ground.support import workers

KINDS = {**hidden_cases.KINDS, **hidden_conditions.KINDS}
COUNTS = {kind: count for kind, (_, count) in KINDS.items()}


def run_case(job):
    """Result of one job (kind, seed), a dictionary for a line of JSON."""
    kind, seed = job
    case = KINDS[kind][0](kind, seed)
    if kind in hidden_conditions.KINDS:
        return hidden_judge.judged(case)
    start = time.perf_counter()
    fitted, heldout = hidden_cases.record(case)
    made = time.perf_counter() - start
    found = hidden_engine.diagnose(fitted, heldout, hidden_cases.given_model(case))
    _add_truth(found, functools.partial(hidden_cases.true_value, case))
    result = dict(case.describe(), seconds_of_data=made, found=found)
    known = "nameless" in case.effects
    return dict(result, **hidden_cases.truth_about(case, fitted, heldout)) if known else result


def _add_truth(found, true_value):
    """Adds to each parameter its true value."""
    for parameter in found.get("parameters", []):
        parameter["true"] = true_value(parameter["name"])


def jobs_of(options):
    """Jobs that the options ask for. Kinds alternate: an interrupted bench has results of each."""
    counts = {kind: options.count or COUNTS[kind] for kind in options.kinds}
    for number in range(max(counts.values())):
        for kind, count in counts.items():
            if number < count:
                yield kind, options.seed_base + number


def bench(options):
    """Runs the jobs without a result and prints the table of all jobs."""
    team = workers.Workers(processes=True, count=options.jobs)
    found = resumed.results(
        team,
        options.results,
        list(jobs_of(options)),
        lambda job: "%s %d" % job,
        lambda result: "%(kind)s %(seed)d" % result,
        run_case,
        options.hours,
    )
    summary(found, options)


def summary(results, options):
    """Prints the table of the results; writes the table if an option asks for it."""
    judged = [r for r in results if "judged" in r]
    tables = [hidden_judge.table(judged), hidden_judge.rates(judged)] if judged else []
    print("\n\n".join(map(hidden_table.text, tables)))
    hidden_table.write(options.markdown, *tables)
    results = [r for r in results if "judged" not in r]
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
    hidden_table.write(options.markdown, *tables, table, verdicts)


def main():
    parser = resumed.parser(__doc__, "build/hidden.jsonl")
    parser.add_argument("--kinds", nargs="+", default=list(COUNTS), choices=list(COUNTS), metavar="KIND",
                        help="some of %s (all)" % ", ".join(COUNTS))  # fmt: skip
    return resumed.status(bench, parser.parse_args())


if __name__ == "__main__":
    sys.exit(main())
