#!/usr/bin/python3
"""Changes one operator, constant or statement of a source file at a time and asks the tests whether they
notice: the unit tests for the C++ core, the tests in Python for ground.recordings and ground.analysis.
Prints a table by folder and the mutants that no test noticed. Continues an interrupted run; use another
file, or --again, when tests or sources have changed."""
import argparse
import itertools
import json
import pathlib
import queue
import sys
from concurrent.futures import ThreadPoolExecutor

import yaml
from scipy import stats

HERE = pathlib.Path(__file__).resolve().parent
sys.path.append(str(HERE.parent / "bench"))  # after this folder, which has its own commands.py

import hidden_table  # noqa: E402
import resumed  # noqa: E402
import sampling  # noqa: E402

HARMLESS = HERE / "harmless.yaml"


class Known:
    """Mutants that tests need not notice, with the reasons."""

    def __init__(self, path):
        self._entries = yaml.safe_load(path.read_text())
        for entry in self._entries:
            lines = (sampling.ROOT / entry["path"]).read_text().splitlines()
            if entry["line"] not in [line.strip() for line in lines]:
                raise SystemExit("%s: %s has no line %r" % (path, entry["path"], entry["line"]))

    def entry(self, mutant):
        """The entry of a mutant, None if it has none."""
        for entry in self._entries:
            same = (entry["path"], entry["line"]) == (mutant.path, mutant.before.strip())
            if same and entry.get("mutant", mutant.after.strip()) == mutant.after.strip():
                return entry
        return None


def options():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--of", choices=("core", "python"), default="core", help="what is mutated")
    parser.add_argument("--count", type=int, default=300, help="mutants that count")
    parser.add_argument("--seed", type=int, default=1, help="seed of the random sample")
    parser.add_argument("--only", default="", metavar="TEXT", help="files whose path contains TEXT")
    parser.add_argument("--jobs", type=int, default=2, help="mutants at once")
    parser.add_argument("--hours", type=float, default=1e6, help="none is begun after this time")
    parser.add_argument("--results", help="file of results (default: in build/mutation)")
    parser.add_argument("--markdown", help="file for table and survivors")
    parser.add_argument("--again", action="store_true", help="forgets survivors of earlier runs")
    return parser.parse_args()


def main():
    given = options()
    given.results = given.results or str(
        sampling.ROOT / "build" / "mutation" / ("%s_%d.jsonl" % (given.of, given.seed))
    )
    if given.of == "core":
        import core as side

        files = sampling.core_files()
    else:
        import package as side

        files = sampling.analysis_files()
    drawn = sampling.drawn([f for f in files if given.only in str(f)], given.seed)
    if given.again:
        forget_survivors(given.results)
    known = Known(HARMLESS)
    judged = judge_until(given, drawn, known, side)
    words = report(judged)
    print(words)
    if given.markdown:
        pathlib.Path(given.markdown).write_text(words)


def judge_until(given, drawn, known, side):
    """Judges mutants in their order until enough count: those that compile and are not equivalent."""
    trees = queue.Queue()
    with ThreadPoolExecutor(given.jobs) as pool:
        for tree in pool.map(side.prepared, range(given.jobs)):
            trees.put(tree)

        def run(mutant):
            entry = known.entry(mutant)
            if entry and entry["kind"] == "equivalent":
                return {**vars(mutant), "outcome": "equivalent", "why": entry["why"]}
            tree = trees.get()
            try:
                result = tree.judge(mutant)
            finally:
                trees.put(tree)
            return {**vars(mutant), **result}

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
                return [(sampling.Mutant(**_mutant(result)), result, known) for result in found]
            asked = min(len(drawn), asked + missing)


def _mutant(result):
    return {key: result[key] for key in ("path", "line", "before", "after")}


def counts(result):
    """Whether a result counts: the mutant compiles and is not known to be equivalent."""
    return result["outcome"] in ("killed", "survived")


def forget_survivors(path):
    """Removes survivors from a file of results, so that the tests are asked again."""
    kept = [result for result in resumed.read(path) if result["outcome"] != "survived"]
    if kept:
        pathlib.Path(path).write_text("".join(json.dumps(result) + "\n" for result in kept))


def report(judged):
    """The table by folder and the list of survivors, as Markdown."""
    rows = [["folder", "mutants", "killed", "of them by time", "95% interval", "harmless", "apart"]]
    ordered = sorted(judged, key=lambda one: one[0].folder)
    groups = [(name, list(part)) for name, part in itertools.groupby(ordered, lambda o: o[0].folder)]
    for name, part in groups + [("all", ordered)]:
        rows.append([name] + _row(part))
    words = [hidden_table.markdown(rows), ""]
    words.append("Apart: they do not compile, or are equivalent. Harmless: survivors in harmless.yaml.")
    for mutant, result, known in sorted(judged, key=lambda one: one[0].key):
        if result["outcome"] == "survived":
            entry = known.entry(mutant)
            note = "harmless: " + entry["why"] if entry else _note(result)
            words.append("\n%s:%d: %s" % (mutant.path, mutant.line, note))
            words.append("    - %s\n    + %s" % (mutant.before.strip(), mutant.after.strip()))
    return "\n".join(words) + "\n"


def _note(result):
    return "no test executes it" if not result["tests"] else "%d tests do not notice" % result["tests"]


def _row(part):
    outcomes = [result["outcome"] for _, result, _ in part]
    killed, counted = outcomes.count("killed"), sum(counts(result) for _, result, _ in part)
    low, high = wilson(killed, counted)
    harmless = [m for m, r, known in part if r["outcome"] == "survived" and known.entry(m)]
    return [
        "%d" % counted,
        "%d (%.0f%%)" % (killed, 100 * killed / max(1, counted)),
        "%d" % sum(bool(result.get("timeout")) for _, result, _ in part),
        "%.0f to %.0f%%" % (100 * low, 100 * high),
        "%d" % len(harmless),
        "%d" % (len(part) - counted),
    ]


def wilson(yes, count):
    """The share's 95% interval (Wilson 1927)."""
    if not count:
        return 0.0, 1.0
    interval = stats.binomtest(yes, count).proportion_ci(0.95, method="wilson")
    return interval.low, interval.high


if __name__ == "__main__":
    main()
