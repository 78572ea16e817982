#!/usr/bin/python3
"""Changes one operator, constant or statement of the C++ core at a time and asks the unit tests whether they
notice. Prints a table by folder and the mutants that no test noticed. Continues an interrupted run; use
another file, or --again, when tests or sources have changed."""

import argparse
import itertools
import json
import pathlib
import queue
import sys
from concurrent.futures import ThreadPoolExecutor

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parent / "bench"))  # after this folder, which has its own commands.py

import core  # noqa: E402
import sampling  # noqa: E402

import hidden_table  # noqa: E402
import resumed  # noqa: E402


def options():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=300, help="mutants that count")
    parser.add_argument("--seed", type=int, default=1, help="seed of the random sample")
    parser.add_argument("--only", default="", metavar="TEXT", help="files whose path contains TEXT")
    parser.add_argument("--jobs", type=int, default=2, help="mutants at once")
    parser.add_argument("--hours", type=float, default=1e6, help="none is begun after this time")
    parser.add_argument("--results", help="file of results (default: in build/mutation)")
    parser.add_argument("--again", action="store_true", help="forgets survivors of earlier runs")
    given = parser.parse_args()
    default = sampling.ROOT / "build" / "mutation" / ("core_%d.jsonl" % given.seed)
    given.results = given.results or str(default)
    return given


def main():
    given = options()
    if given.again:
        kept = [result for result in resumed.read(given.results) if result["outcome"] != "survived"]
        pathlib.Path(given.results).write_text("".join(json.dumps(result) + "\n" for result in kept))
    print(report(judge_until(given, sampling.drawn(given.only, given.seed))))


def judge_until(given, drawn):
    """Results of mutants in their order, until enough count: those that compile and are not equivalent."""
    trees = queue.Queue()
    with ThreadPoolExecutor(given.jobs) as pool:
        for tree in pool.map(core.prepared, range(given.jobs)):
            trees.put(tree)

        def run(mutant):
            tree = trees.get()
            try:
                return {**vars(mutant), **tree.judge(mutant)}
            finally:
                trees.put(tree)

        asked = min(given.count, len(drawn))
        while True:
            found = resumed.results(
                pool,
                given.results,
                drawn[:asked],
                key=lambda mutant: mutant.key,
                key_of=lambda result: tuple(result[k] for k in ("path", "line", "before", "after")),
                run=run,
                hours=given.hours,
                noun="mutants",
            )
            missing = given.count - sum(counts(result) for result in found)
            if missing <= 0 or asked == len(drawn) or len(found) < asked:
                return found
            asked = min(len(drawn), asked + missing)


def counts(result):
    """Whether a result counts: the mutant compiles and is not equivalent."""
    return result["outcome"] in ("killed", "survived")


def report(found):
    """The table by folder and the list of survivors, as Markdown."""
    rows = [["folder", "mutants", "killed", "95% interval", "apart"]]
    ordered = sorted(found, key=lambda result: (result["path"], result["line"]))
    groups = itertools.groupby(ordered, lambda result: sampling.folder(result["path"]))
    for name, part in [(name, list(part)) for name, part in groups] + [("all", ordered)]:
        killed = [result["outcome"] == "killed" for result in part if counts(result)]
        if killed:
            yes, count, low, high = hidden_table.rate(killed)
            interval = "%.0f to %.0f%%" % (100 * low, 100 * high)
            share = "%d (%.0f%%)" % (yes, 100 * yes / count)
            rows.append([name, "%d" % count, share, interval, "%d" % (len(part) - count)])
    words = [hidden_table.markdown(rows), "", "Apart: they do not compile, or are equivalent."]
    for result in ordered:
        if result["outcome"] == "survived":
            place = result["path"], result["line"], result["tests"]
            words.append("\n%s:%d: %d tests do not notice" % place)
            words.append("    - %s\n    + %s" % (result["before"].strip(), result["after"].strip()))
    return "\n".join(words)


if __name__ == "__main__":
    main()
