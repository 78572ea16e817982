#!/usr/bin/python3
"""Prints all benchmarks as one table and writes them as JSON with a description of the machine.

Each row is a median with its smallest and largest value; "goal" is the largest median allowed. Peers do
the same work in the same run, in their own Python environment.
"""

import argparse
import contextlib
import datetime
import json
import os
import platform
import re
import subprocess
import sys

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
GOALS = {"velocities: state": 60, "velocities: five sensitivities": 250}  # [ns]
LATENCY = re.compile(
    r"pose to packet at ([0-9.]+) Hz, \d+ poses: median ([0-9.]+) ms, 99% ([0-9.]+) ms, 99.9% "
    r"([0-9.]+) ms, most ([0-9.]+) ms"
)
GRANTED = re.compile(r"real time: ([^\x1b\n]+)")


class Table:
    """Collects the rows of the table and prints each at once."""

    def __init__(self):
        self.rows = []
        print("%-58s %10s %22s %9s  %s" % ("", "median", "least to largest", "goal", ""))

    def add(self, name, values, unit, goal=None, note=""):
        values = np.atleast_1d(np.asarray(values, float))
        row = {"name": name, "unit": unit, "median": float(np.median(values))}
        row.update(least=float(values.min()), largest=float(values.max()), goal=goal, note=note)
        self.rows.append(row)
        spread = "%.4g - %.4g" % (row["least"], row["largest"]) if len(values) > 1 else ""
        print(
            "%-58s %7.4g %-3s %21s %9s  %s"
            % (name, row["median"], unit, spread, "" if goal is None else "<= %g" % goal, note),
            flush=True,
        )
        return row["median"]


def run(*command, check=True):
    """Standard output of a command; standard error is hidden only where failure is allowed."""
    quiet = None if check else subprocess.DEVNULL
    return subprocess.run(
        command, check=check, stdout=subprocess.PIPE, stderr=quiet, universal_newlines=True
    ).stdout


def binary(name):
    return os.path.join(os.environ["CMAKE_PREFIX_PATH"].split(":")[0], "lib", "ground", name)


def google(name, *options):
    """Runs a Google Benchmark program: {name of a benchmark: its repetitions}."""
    found = json.loads(run(binary(name), "--benchmark_format=json", "--benchmark_repetitions=7", *options))
    cases = {}
    for b in found["benchmarks"]:
        if b.get("run_type") == "iteration":
            cases.setdefault(b["run_name"], []).append(b)
    return cases


def steps(table):
    for name, repetitions in google("model_step").items():
        ns = [1e9 * b["per step"] for b in repetitions]
        table.add("step, " + name, ns, "ns", GOALS.get(name))


def fit(table, peers):
    command = [os.path.join(HERE, "fit_speed.py")]
    times = json.loads(run(*command, *(["--peers", peers] if peers else [])))
    ours = np.median(times["ground"])
    for name, seconds in times.items():
        ratio = np.median(seconds) / ours
        table.add("fit, " + name, 1e3 * np.array(seconds), "ms", 8 if name == "ground" else None,
                  "" if name == "ground" else "%.1f times ground" % ratio)  # fmt: skip


def screening(table):
    """Score tests of all effects of the library on four runs of 8 s."""
    import time

    import hidden_cases
    from ground.analysis import diagnosis
    from ground.analysis.score_tests import ScoreTests
    from ground.effect_library import candidates

    case = hidden_cases.make("disturbed_single", 1)
    runs, model = hidden_cases.record(case)[0], hidden_cases.given_model(case)
    every, times = candidates.library(model), []
    whole = diagnosis.StepwiseDiagnosis(runs, model, every, threads=1)
    for _ in range(5):
        begin = time.perf_counter()
        ScoreTests(whole.likelihood, whole.fit, every)
        times.append(1e3 * (time.perf_counter() - begin))
    table.add("screening, %d effects, one thread" % len(every), times, "ms")


def waits(table):
    """What a person waits for: the first line and the page of `identify diagnose`, on all cores."""
    command = [os.path.join(HERE, "diagnose_speed.py"), "--json"]
    for name, times in json.loads(run(*command)).items():
        for what, goal in (("verdict", 4), ("page", 6)):
            seconds = [found[what] for found in times]
            table.add("%s of a diagnosis, hidden: %s" % (what, name), seconds, "s", goal)


def simulation(table):
    """Ratio of simulated time to computing time."""
    import time

    from ground import _core

    model = _core.load_model(os.path.join(HERE, "../../cfg/hovercraft/tiny_whoover.yaml"))
    rows = np.column_stack([np.arange(10000) / 10, *[np.arange(10000) % 2] * 2, np.ones(10000)])
    times, factors = np.arange(100001) / 100, []
    for _ in range(7):
        begin = time.perf_counter()
        _core.simulate(model, rows, times, np.zeros(3), np.zeros(3))
        factors.append(1000 / (time.perf_counter() - begin) / 1e3)
    table.add("simulate, thousands of times real time", factors, "")


def controllers(table):
    for name, repetitions in google("controllers").items():
        table.add("iteration, " + name, [b["real_time"] / 1e3 for b in repetitions], "us")


def plans(table, peers):
    """The optimiser of ModelPredictive and others on the same problems."""
    if not peers:
        return
    folder = os.path.join(os.path.dirname(os.path.dirname(peers)), "plans")
    for line in run(peers, os.path.join(HERE, "peer_plans.py"), "--folder", folder).splitlines():
        table.add(**json.loads(line))


def latency(table):
    """From pose to packet: idle, with a busy process a core, and with stopped subscribers, too."""
    for name, goal, hogs, options in (
        ("idle", 1, 0, []),
        ("both cores busy", 5, os.cpu_count(), []),
        ("and stopped subscribers", 5, os.cpu_count(), ["stopped:=true"]),
        ("and ordinary priority", None, os.cpu_count(), ["real_time:=false"]),
    ):
        for rate in (100, 240, 1000) if not options else (240,):
            count = max(5000, 20 * rate)  # five poses or more are slower than 99.9%
            with busy(hogs):
                out = run("roslaunch", "ground", "latency.launch", "rate:=%d" % rate,
                          "count:=%d" % count, *options, check=False)  # fmt: skip
            found, granted = LATENCY.search(out), GRANTED.search(out)
            if not found and goal is None:
                print("pose to packet at %d Hz, %s: the craft was stopped" % (rate, name))
                continue
            if not found:
                sys.exit("bench: no latency at %d Hz:\n%s" % (rate, out[-2000:]))
            _, median, most99, most999, most = (float(x) for x in found.groups())
            table.add("pose to packet at %d Hz, %s, 99.9%%" % (rate, name), most999, "ms",
                      goal if rate == 240 else None,
                      "median %g, 99%% %g, most %g ms; %s" % (median, most99, most,
                      granted.group(1) if granted else "nothing is known of priorities"))  # fmt: skip


@contextlib.contextmanager
def busy(count):
    """Keeps that many processors busy."""
    hogs = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for hog in hogs:
            hog.kill()
            hog.wait()


def machine():
    with open("/proc/cpuinfo") as info:
        names = [line.split(":")[1].strip() for line in info if line.startswith("model name")]
    return {
        "processor": names[0] if names else platform.processor(),
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "date": datetime.datetime.now().isoformat(timespec="seconds"),
        "load": os.getloadavg()[0],
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--peers", metavar="PYTHON", help="interpreter that has JAX and Crocoddyl")
    parser.add_argument("--json", metavar="FILE", required=True)
    parser.add_argument("--only", nargs="+", help="parts: " + " ".join(PARTS))
    arguments = parser.parse_args()
    on = machine()
    print("%(processor)s, %(cores)d cores, %(system)s; load %(load).2f" % on)
    table = Table()
    for name, part in PARTS.items():
        if arguments.only and name not in arguments.only:
            continue
        part(table, arguments.peers) if name in ("fit", "plans") else part(table)
    with open(arguments.json, "w") as file:
        json.dump({"machine": on, "rows": table.rows}, file, indent=1)
    missed = [r["name"] for r in table.rows if r["goal"] and r["median"] > r["goal"]]
    for name in missed:
        print("goal missed: " + name)
    return 1 if missed else 0


PARTS = {
    "steps": steps, "fit": fit, "screening": screening, "waits": waits,
    "simulation": simulation, "controllers": controllers, "plans": plans, "latency": latency,
}  # fmt: skip

if __name__ == "__main__":
    sys.exit(main())
