#!/usr/bin/python3
"""Changes one operator, constant or statement of the state machines at a time and asks the search over
all sequences of events which invariant breaks. Prints a table, and the changes that break none."""

import argparse
import collections
import pathlib
import sys
from concurrent.futures import ThreadPoolExecutor

sys.path.append(str(pathlib.Path(__file__).resolve().parent.parent / "bench"))

import changed
import sampling

FILES = [
    "safety/ground_link.cpp",
    "safety/controller_lifecycle.cpp",
    "safety/freshness.cpp",
    "safety/fence_guard.cpp",
]


def options():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=30, help="mutants of each file that compile")
    parser.add_argument("--seed", type=int, default=1, help="seed of the random sample")
    parser.add_argument("--files", nargs="+", default=FILES, help="files of the state machines")
    parser.add_argument("--jobs", type=int, default=2, help="mutants at once")
    parser.add_argument("--transitions", type=int, help="length of a search (default: that of make test)")
    return parser.parse_args()


def main():
    given = options()
    bench = changed.Changed()
    asked = {"GROUND_SEARCH_TRANSITIONS": str(given.transitions)} if given.transitions else {}
    survivors = 0

    def judge(mutant):
        return mutant, bench.verdict(mutant.path, mutant.text(), "ground_search_test", environment=asked)

    for name in given.files:
        by, left, found = collections.Counter(), [], 0
        drawn = iter(sampling.drawn(name, given.seed))
        with ThreadPoolExecutor(given.jobs) as pool:
            while found < given.count:
                batch = [m for m, _ in zip(drawn, range(given.count - found))]
                if not batch:
                    break
                for mutant, result in pool.map(judge, batch):
                    if result["outcome"] == "invalid":
                        continue
                    found += 1
                    if result["outcome"] == "killed":
                        by[result["by"].split(":")[0]] += 1
                    else:
                        left.append(mutant)
        survivors += len(left)
        print("%s: %d of %d mutants break an invariant" % (name, found - len(left), found))
        for what, count in by.most_common():
            print("    %3d  %s" % (count, what))
        for mutant in left:
            print(
                "  survived, line %d\n    - %s\n    + %s"
                % (mutant.line, mutant.before.strip(), mutant.after.strip())
            )
        sys.stdout.flush()
    return 1 if survivors else 0


if __name__ == "__main__":
    sys.exit(main())
