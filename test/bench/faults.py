#!/usr/bin/python3
"""Injects every fault several times and prints one table: how each fault ends, and its worst case.

Runs faults_*.test and room_axes.test of test/rostest, test/python/test_faults.py and test_starved.py.
Fails if any of these programs fails in any round. Otherwise writes test/faults.json, of which the fault table
of docs/experiment.md is made, unless rows were chosen by the environment variable FAULTS.
"""

import argparse
import datetime
import json
import os
import re
import subprocess
import sys

ROOT = os.path.realpath(os.path.join(os.path.dirname(os.path.abspath(__file__)), "../.."))
ROW = re.compile(r"fault: (.{38}) (.{12}) (.*)")
NUMBER = re.compile(r"[0-9.]+")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3)
    rounds = parser.parse_args().rounds
    package = os.path.join(ROOT, "src", "ground")
    rostest = ["rostest", "--text", "--pkgdir=" + package, "--package=ground"]
    commands = [
        rostest + [os.path.join(ROOT, "test", "rostest", name + ".test")]
        for name in ("faults_poses", "faults_others", "faults_mocap", "room_axes")
    ]
    commands += [
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-s", "-q"]
        + [os.path.join(ROOT, "test", "python", name) for name in ("test_faults.py", "test_starved.py")]
    ]
    table, failed = {}, 0
    for number in range(rounds):
        for command in commands:
            result = subprocess.run(
                command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True
            )
            for name, ending, what in ROW.findall(result.stdout):
                table.setdefault((name.strip(), ending.strip()), []).append(what.strip())
            if result.returncode != 0:
                failed += 1
                print("round %d failed:\n%s" % (number + 1, result.stdout[-4000:]), file=sys.stderr)
    print("| fault | ends | worst of %d |" % rounds)
    print("|---|---|---|")
    kept = {}
    for (name, ending), seen in table.items():
        most = "most" if "recorded" not in seen[0] else "least"
        worst = (max if most == "most" else min)(seen, key=lambda w: float((NUMBER.findall(w) or ["0"])[0]))
        missing = "" if len(seen) == rounds else " (%d of %d)" % (len(seen), rounds)
        print("| %s | %s%s | %s |" % (name, ending, missing, worst))
        kept[name] = {"ends": ending, "worst": " ".join(worst.split())}
    print("%d of %d programs failed" % (failed, rounds * len(commands)))
    if failed or os.environ.get("FAULTS"):
        return 1 if failed else 0
    measured = {"date": datetime.date.today().isoformat(), "rounds": rounds, "faults": kept}
    with open(os.path.join(ROOT, "test", "faults.json"), "w", encoding="utf-8") as file:
        file.write(json.dumps(measured, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
