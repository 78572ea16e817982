#!/usr/bin/python3
"""How long a person waits for each verb of identify, on recordings of 30 s to 1 h and on 1 to 1000 bags.

Each command runs as a process of its own. Prints wall time, processor time, peak memory (of its
largest process) and the time of the first line that it shows, and writes the same as JSON.
Recordings are simulated into a folder, once; results go to a file of JSON lines, so that an interrupted
bench continues where it stopped.
"""

import argparse
import functools
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
import types

import numpy as np

import ground
import resumed
from ground.support import workers

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
MODEL = os.path.join(ROOT, "cfg", "hovercraft", "tiny_whoover.yaml")
EXTRA = 2.0  # rest, lift alone and rest around the input of a simulated run [s]
# size: number of bags, length of each [s]
SIZES = {"30s": (1, 30), "5min": (1, 300), "1h": (1, 3600), "1bag": (1, 10), "10bags": (10, 10)}
SIZES.update({"100bags": (100, 10), "1000bags": (1000, 10)})
# Largest wall time [s] and memory [MB]
GOALS = {("fit", "1h"): (10, 1000), ("fit", "1000bags"): (60, 4000)}
FIRST_LINE = 1.5  # largest time of the first line [s]
ROW = "%-9s %-9s %9s %9s %8s %9s  %s"
LAUNCH = ("import sys; from ground import cli; sys.exit(cli.main(sys.argv[1:]))",)


def commands(size, folder):
    """Arguments of each verb on recordings of a size, by verb."""
    data, out = os.path.join(folder, size), os.path.join(folder, "out")
    count, seconds = SIZES[size]
    bags, model = os.path.join(data, "bags"), ("--model", MODEL)
    found = {
        "info": ["info", bags],
        "fit": ["fit", bags, *model, "-o", out + ".yaml", "--force"],
        "compare": ["compare", bags, *model, "-o", out, "--force"],
        "diagnose": ["diagnose", bags, *model, "-o", out, "--force"],
        "add": ["add", "motor_lag", bags, *model, "-o", out + ".yaml", "--force"],
        "bench": ["bench", os.path.join(folder, "bench.csv"), *model, "-o", out + ".yaml", "--force"],
    }
    found["bench"] += ["--runs", bags]
    if count == 1:
        table = [os.path.join(data, name + ".csv") for name in ("controls", "pose")]
        found["import"] = ["import", *table, "-o", out + ".bag", "--force"]
        found["tracking"] = ["tracking", os.path.join(data, "tracking.bag")]
        found["simulate"] = ["simulate", *model, "--input", "prbs", "-o", out + ".bag", "--force"]
        found["simulate"] += ["--duration", "%g" % (seconds - EXTRA)]
    if size == "30s":
        found["discover"] = ["discover", *model, "--truth", os.path.join(folder, "truth.yaml")]
        found["discover"] += ["-o", out + ".discovery", "--budget", "30"]
    return found


VERBS = ("info", "fit", "compare", "diagnose", "add", "bench", "import", "tracking", "simulate", "discover")


def make(size, folder):
    """Makes the recordings of a size, those that are missing."""
    count, seconds = SIZES[size]
    bags = os.path.join(folder, size, "bags")
    os.makedirs(bags, exist_ok=True)
    missing = [(os.path.join(bags, "run%04d.bag" % number), seconds, number) for number in range(count)]
    pool = workers.Workers(processes=True)
    list(pool.map(_make_run, [run for run in missing if not os.path.exists(run[0])]))
    tracking = os.path.join(folder, size, "tracking.bag")
    if count == 1 and not os.path.exists(tracking):
        ground.simulate(MODEL, "tracking", duration=seconds - EXTRA, seed=1).save(tracking)
    tables = [os.path.join(folder, size, name + ".csv") for name in ("controls", "pose")]
    if count == 1 and not all(map(os.path.exists, tables)):
        (run,) = ground.read(os.path.join(bags, "run0000.bag"))
        for path, times, rows in zip(tables, (run.control_times, run.pose_times), (run.controls, run.eta)):
            _export(path, times, rows)
    levels = np.linspace(0, 1, 11)
    with open(os.path.join(folder, "bench.csv"), "w") as file:
        file.write("input,left,right\n")
        file.writelines("%g,%g,%g\n" % (w, 0.061 * w, 0.062 * w) for w in levels)
    with open(MODEL) as file, open(os.path.join(folder, "truth.yaml"), "w") as truth:
        truth.write(file.read().replace("effects: []", "effects: [{name: motor_lag, tau: 0.05}]"))


def _make_run(run):
    path, seconds, seed = run
    ground.simulate(MODEL, "prbs", duration=seconds - EXTRA, seed=seed).save(path)


def _export(path, times, rows):
    """Writes rows as rostopic echo -p does."""
    stamps = np.round(1e9 * times).astype(np.int64)
    with open(path, "w") as file:
        file.write("%time,field.header.stamp,field.point.x,field.point.y,field.point.z\n")
        file.writelines("%d,%d,%.9g,%.9g,%.9g\n" % (t, t, *row) for t, row in zip(stamps, rows))


def forget(folder):
    """Removes what commands have written."""
    shutil.rmtree(os.path.join(folder, "out.discovery"), ignore_errors=True)


def measure(arguments, limit):
    """Runs identify with arguments. Times [s] of its end and first line, processor time [s], memory [MB]
    and exit status, None if it was stopped at the limit [s]."""
    begin = time.monotonic()
    process = subprocess.Popen(
        [sys.executable, "-c", *LAUNCH, *arguments, "--progress", "lines"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
    lines, timer = [], threading.Timer(limit, os.killpg, (process.pid, signal.SIGKILL))
    timer.start()
    for line in process.stdout:
        lines.append((time.monotonic() - begin, line.decode(errors="replace")))
    _, status, usage = os.wait4(process.pid, 0)
    ended = time.monotonic() - begin
    timer.cancel()
    killed = os.WIFSIGNALED(status)
    process.returncode = 0  # it was waited for here
    return {
        "seconds": None if killed else ended,
        "processor": usage.ru_utime + usage.ru_stime,
        "MB": usage.ru_maxrss / 1e3,
        "first_line": lines[0][0] if lines else None,
        "status": None if killed else os.WEXITSTATUS(status),
        "last": lines[-1][1].strip() if lines else "",
    }


def run(folder, limit, job):
    """Result of a job, (size, verb)."""
    size, verb = job
    make(size, folder)
    forget(folder)
    arguments = commands(size, folder)[verb]
    result = {"size": size, "verb": verb, "found": measure(arguments, limit), "limit": limit}
    print(line(result), flush=True)
    return result


def line(result):
    """A row of the table."""
    found = result["found"]
    goal = GOALS.get((result["verb"], result["size"]))
    remarks = []
    if goal:
        remarks.append("goal %g s, %g MB%s" % (*goal, "" if _meets(result) else ": MISSED"))
    if found["first_line"] is not None and found["first_line"] > FIRST_LINE:
        remarks.append("first line late")
    if found["status"]:
        remarks.append("failed: " + found["last"])
    ended, shown = (_seconds(found[name], result["limit"]) for name in ("seconds", "first_line"))
    numbers = ended, "%.1f" % found["processor"], "%.0f" % found["MB"], shown
    return ROW % (result["verb"], result["size"], *numbers, "; ".join(remarks))


def _seconds(value, limit):
    return "> %g" % limit if value is None else "%.2f" % value


def _meets(result):
    """Whether a result is within its goal, if it has one, and the command has not failed."""
    found, goal = result["found"], GOALS.get((result["verb"], result["size"]))
    if found["status"]:
        return False
    if goal is None:
        return True
    return found["seconds"] is not None and found["seconds"] <= goal[0] and found["MB"] <= goal[1]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", choices=VERBS, default=VERBS, metavar="VERB")
    parser.add_argument("--sizes", nargs="+", choices=SIZES, default=list(SIZES), metavar="SIZE")
    parser.add_argument("--limit", type=float, default=300, help="a command is stopped after this [s]")
    parser.add_argument("--folder", default="build/commands", help="recordings, kept for the next time")
    parser.add_argument("--results", help="file of JSON lines (FOLDER/results.jsonl)")
    parser.add_argument("--json", default="build/commands.json", help="table as JSON")
    arguments = parser.parse_args()
    folder = os.path.abspath(arguments.folder)
    os.makedirs(folder, exist_ok=True)
    jobs = [
        (size, verb) for size in arguments.sizes for verb in arguments.only if verb in commands(size, folder)
    ]
    print(ROW % ("verb", "size", "s", "cpu s", "MB", "first s", ""))
    found = resumed.results(
        types.SimpleNamespace(map=map),  # one after another, where workers.Workers does them side by side
        arguments.results or os.path.join(folder, "results.jsonl"),
        jobs,
        tuple,
        lambda result: (result["size"], result["verb"]),
        functools.partial(run, folder, arguments.limit),
        noun="commands",
    )
    with open(arguments.json, "w") as file:
        json.dump({"cores": len(os.sched_getaffinity(0)), "rows": found}, file, indent=1)
    missed = [result for result in found if not _meets(result)]
    for result in missed:
        print("missed: " + line(result))
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
