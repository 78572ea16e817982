#!/usr/bin/python3
"""Runs info, fit and compare on bags that are cut or have a bit flipped, at random.

The bags hold one short run as the recorder writes it, as rosbag writes it with lz4 in one chunk, and
without compression. Counts tracebacks, slow runs, and fits that move by more than 3 standard errors
without a warning. Exit status 1 if there is any of these.
"""

import argparse
import collections
import contextlib
import io
import json
import multiprocessing
import os
import pathlib
import sys
import tempfile
import time

import numpy as np

import rosbag
from ground import cli
from ground.recordings import topics

MODEL = pathlib.Path(__file__).resolve().parents[2] / "cfg" / "hovercraft" / "tiny_whoover.yaml"
KINDS = {
    "recorder": dict(compression="lz4", chunk_threshold=topics.CHUNK),
    "lz4": dict(compression="lz4"),
    "plain": dict(),
}
MAX_RUN_TIME = 20.0  # a run that takes longer counts as slow [s]
TIMEOUT = 120.0  # wait for the next result [s]
MAX_CHANGE = 3.0  # a larger change of a parameter must be announced [standard errors]
FAILURES = ("traceback", "many lines", "slow", "hung", "changed silently")
Run = collections.namedtuple("Run", "status seconds out err")
Case = collections.namedtuple("Case", "kind damage number")


def run(*arguments):
    """Runs a verb in this process; status is None if it raised an exception."""
    out, err, start = io.StringIO(), io.StringIO(), time.monotonic()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            status = cli.main([str(a) for a in arguments])
        except BaseException as error:  # any exception is a defect to report
            status = None
            err.write("raised %r" % error)
    return Run(status, time.monotonic() - start, out.getvalue(), err.getvalue())


def run_verbs(bag, folder):
    """Runs info, fit and compare on a bag."""
    fitted = os.path.join(folder, "fitted.yaml")
    return [
        run("info", bag, "--json"),
        run("fit", bag, "--model", MODEL, "-o", fitted, "--force", "--json"),
        run("compare", bag, "--model", MODEL, "-o", folder, "--numbers", "--force", "--json"),
    ]


def parameters(fit):
    """Value and 95% interval (None: infinite) of the fitted parameters by name."""
    found = json.loads(fit.out)["parameters"].items()
    return {name: (p["value"], p["ci95"]) for name, p in found}


def standard_errors(now, wanted):
    """Largest difference of a parameter between two fits, in standard errors of the undamaged one."""
    return max(abs(now[n][0] - v) / ((high - low) / 3.92) for n, (v, (low, high)) in wanted.items())


def damaged(data, case):
    random = np.random.default_rng([case.number, case.damage == "cut"])
    if case.damage == "cut":
        return data[: int(random.integers(1, len(data)))]
    flipped = bytearray(data)
    flipped[int(random.integers(len(data)))] ^= 1 << int(random.integers(8))
    return bytes(flipped)


def examine(task):
    """Runs the verbs on a damaged bag: the case, the findings (a set of words), the largest change of a
    parameter [standard errors], the message, and the time of the slowest run [s]."""
    case, source, wanted = task
    with tempfile.TemporaryDirectory() as folder:
        bag = os.path.join(folder, os.path.basename(source))
        with open(source, "rb") as file, open(bag, "wb") as out:
            out.write(damaged(file.read(), case))
        runs = run_verbs(bag, folder)
    found, message, moved = set(), "", 0.0
    for one in runs:
        if one.status not in (0, 1) or "Traceback" in one.err or "unexpected" in one.err:
            found.add("traceback")
            message = one.err
        if one.status == 1 and one.err.strip().count("\n") > 4:
            found.add("many lines")
            message = one.err
        if one.seconds > MAX_RUN_TIME:
            found.add("slow")
    fit = runs[1]
    if fit.status == 0:
        moved = standard_errors(parameters(fit), wanted)
        found.add("warned" if fit.err else "read without a warning")
        if moved > MAX_CHANGE:
            found.add("changed" if fit.err else "changed silently")
    else:
        found.add("refused")
        message = message or fit.err
    return case, found, moved, message.strip(), max(one.seconds for one in runs)


def write(folder):
    """Writes a bag of every kind of one run: {kind: path}."""
    source = os.path.join(folder, "source.bag")
    options = ["--input", "prbs", "--duration", "6", "--rate", "60", "-o", source]
    assert run("simulate", "--model", MODEL, *options).status == 0
    paths = {}
    for kind, options in KINDS.items():
        paths[kind] = os.path.join(folder, kind + ".bag")
        with rosbag.Bag(source) as bag, rosbag.Bag(paths[kind], "w", **options) as out:
            for topic, message, at in bag.read_messages():
                if topic in (topics.POSE, topics.CONTROLS):
                    out.write(topic, message, at)
    return paths


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cuts", type=int, default=500)
    parser.add_argument("--flips", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--kinds", nargs="+", choices=list(KINDS), default=list(KINDS))
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--show", action="store_true", help="show the result of every bag")
    return parser.parse_args()


def make_tasks(arguments, folder):
    """Arguments of examine for all cases, in random order so that early counts are representative."""
    paths, wanted = write(folder), {}
    for kind in arguments.kinds:
        wanted[kind] = parameters(run_verbs(paths[kind], folder)[1])
    tasks = []
    for damage, count in (("cut", arguments.cuts), ("flip", arguments.flips)):
        for number in range(arguments.first, arguments.first + count):
            kind = arguments.kinds[number % len(arguments.kinds)]
            tasks.append((Case(kind, damage, number), paths[kind], wanted[kind]))
    np.random.default_rng(0).shuffle(tasks)
    return tasks


def examine_all(tasks, jobs, show_all):
    """Counts of findings by (kind, damage), and the time of the slowest run [s]; prints failures."""
    counts = collections.defaultdict(collections.Counter)
    longest = 0.0
    with multiprocessing.Pool(jobs) as pool:
        results = pool.imap_unordered(examine, tasks)
        for done in range(1, len(tasks) + 1):
            try:
                case, found, moved, message, seconds = results.next(TIMEOUT)
            except multiprocessing.TimeoutError:
                counts["any", "damage"]["hung"] += 1
                break
            longest = max(longest, seconds)
            for name in found:
                counts[case.kind, case.damage][name] += 1
            if found & set(FAILURES) or show_all:
                print("%s: %s, %.1f SE; %s" % (case, sorted(found), moved, message), flush=True)
            if done % 100 == 0:
                print("... %d of %d" % (done, len(tasks)), file=sys.stderr, flush=True)
    return counts, longest


def main():
    arguments = parse_arguments()
    with tempfile.TemporaryDirectory() as folder:
        tasks = make_tasks(arguments, folder)
        counts, longest = examine_all(tasks, arguments.jobs, arguments.show)
    rows = ["refused", "warned", "read without a warning", "changed"] + list(FAILURES)
    columns = sorted(counts)
    print("%-22s" % "" + "".join("%16s" % " ".join(c) for c in columns) + "%9s" % "all")
    for name in rows:
        each = [counts[c][name] for c in columns]
        print("%-22s" % name + "".join("%16d" % n for n in each) + "%9d" % sum(each))
    print("%d cuts, %d flips; longest run %.1f s" % (arguments.cuts, arguments.flips, longest))
    return 1 if any(counts[c][name] for c in columns for name in FAILURES) else 0


if __name__ == "__main__":
    sys.exit(main())
