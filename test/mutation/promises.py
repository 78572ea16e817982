#!/usr/bin/python3
"""Takes the rule of each promise of test/requirements.toml out of the product, and sees its test fail. The
test programs have to be built."""

import argparse
import os
import pathlib
import sys
from concurrent.futures import ThreadPoolExecutor

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import changed  # noqa: E402
import requirements  # noqa: E402


def judged(promises, jobs):
    """Pairs of a promise and what its test says without its rule, as Changed.verdict."""
    bench = changed.Changed()
    unchanged = {tuple(promise["test"]): promise["without"][0] for promise in promises}
    for (program, tests), path in unchanged.items():
        text = (changed.ROOT / path).read_text()
        if (
            bench.verdict(path, text, program, tests, {"GROUND_SEARCH_TRANSITIONS": "20000"})["outcome"]
            != "survived"
        ):
            raise SystemExit("%s %s fails with all rules in place" % (program, tests))

    def judge(promise):
        program, tests = promise["test"]
        return promise, bench.verdict(*requirements.changed(promise), program, tests)

    with ThreadPoolExecutor(jobs) as pool:
        yield from pool.map(judge, promises)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", type=int, default=[], metavar="NUMBER", help="these promises")
    parser.add_argument("--program", default="", help="promises that this test program keeps")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="promises at once")
    given = parser.parse_args()
    chosen = [
        promise
        for promise in requirements.load()["promise"]
        if (not given.only or promise["number"] in given.only) and given.program in promise["test"][0]
    ]
    unproven = 0
    for promise, result in judged(chosen, given.jobs):
        proven = result["outcome"] == "killed"
        unproven += not proven
        said = (
            "without its rule: " + result["by"]
            if proven
            else "UNPROVEN: without its rule the test "
            + ("passes" if result["outcome"] == "survived" else "does not compile")
        )
        print("%3d %-20s %s" % (promise["number"], promise["name"], said), flush=True)
    print("%d of %d promises are proven" % (len(chosen) - unproven, len(chosen)))
    return 1 if unproven else 0


if __name__ == "__main__":
    sys.exit(main())
