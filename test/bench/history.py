#!/usr/bin/env python3
"""How often `identify history` is right: test/bench/history.py [--histories 100] [--runs 300] [--whole 10].

Runs are flown by hidden_craft, whose equations are not those of the estimator, with the scatter of a
laboratory: a disturbance of 0.5 to 2% of full thrust, wrenches that differ from run to run by 3%, thrust by
the state of the battery (anywhere in 3.5% at each run, and 2% lower at the end of a day) and by day (0.3%),
drives of all kinds.

pool     each run is estimated once, from its poses. A history is 30 of these runs, 3 a day, with thrust
         that falls by 5% from the first to the last, or does not. The fall acts on the estimate of k.
whole    histories that fly anew with the true thrust of each run, and go through files and the verb.
speed    the verb on 200 runs, without a cache and again.

Prints a line for each, with 95% intervals (Clopper and Pearson 1934). Cases follow from their seeds.
"""

import argparse
import csv
import dataclasses
import json
import os
import resource
import subprocess
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import yaml

import ground
import hidden_cases
import hidden_craft
import hidden_effects
import hidden_noise
from ground.checks import quality
from ground.ledger import analysed, estimates
from ground.models import Model
from ground.reading.recording import Recording
from ground.simulation import experiments
from shares import share

RUNS, A_DAY, FALL = 30, 3, 0.05  # of a history
CHARGE, FADE, DAY = 0.035, 0.02, 0.003  # of thrust: range by charge; fall over a day; deviation between days
TOLERANCE = 0.1
CRAFT = hidden_cases.plain("history bench", 0).body
MAPPING = {
    "schema": "ground/mapping/1",
    "poses": {
        "file": "*.poses.csv",
        "position": {"fields": ["x", "y"]},
        "heading": {"field": "psi", "unit": "rad"},
        "time": {"field": "t", "unit": "s"},
    },
    "commands": {
        "file": "*.commands.csv",
        "time": {"field": "t", "unit": "s"},
        "channels": {name: {"field": name} for name in ("left", "right", "lift")},
    },
}


def flown(number, thrust=1.0):
    """A ground Recording of the craft with a factor on its thrust."""
    case = hidden_cases.plain("history bench", number)
    case.body = dict(CRAFT)
    random = hidden_cases.random_of("history bench", number, "circumstances")
    hidden_cases.push(case, 0.005, 0.02, hidden_cases.FRAMES[random.integers(3)])
    run = case.runs[random.integers(len(case.runs))]
    run["push"]["trim"] = (
        hidden_cases.TRIM * random.normal(size=3) * hidden_cases.full_wrench(case)
    ).tolist()
    case.runs, case.body["k"] = [run], CRAFT["k"] * thrust
    noise = hidden_cases.random_of("history bench", number, "noise")
    plan, motion = hidden_cases.flight(case, 0, noise)
    taken, stamps = hidden_noise.frames(noise, plan.end, case.mocap)
    poses = motion.poses(np.maximum(taken, motion.times[0]))
    eta = hidden_noise.measured(noise, hidden_craft.seen(case.effects, poses), case.mocap)
    times = experiments.START + stamps, experiments.START + plan.rows[:, 0]
    return Recording("run %d" % number, times[0], eta, times[1], plan.rows[:, 1:], "hidden_craft")


def followed():
    return estimates.followed(Model.load(hidden_effects.MODEL))


def estimated(number):
    """The estimate of a run with the usual thrust."""
    model, free = followed()
    return estimates.estimate(quality.repaired(flown(number)).data(model.core), model.core, free)


def thrusts(random, fall):
    """Factors on k of the runs of a history."""
    charge = CHARGE * (random.uniform(size=RUNS) - 0.5) + np.repeat(
        DAY * random.normal(size=RUNS // A_DAY), A_DAY
    )
    fade = np.tile(np.linspace(0, -FADE, A_DAY), RUNS // A_DAY)
    return (1 + charge + fade) * np.linspace(1, 1 - fall, RUNS)


def found_in(pool, seed, fall):
    """The changes of a history from the pool, as (parameter, kind, whether it falls)."""
    random = hidden_cases.random_of("history", seed, fall)
    model, free = followed()
    at = free.index("k")
    runs = []
    for i, factor in zip(random.choice(len(pool), RUNS, replace=False), thrusts(random, fall)):
        moved = list(pool[i].coordinates)
        moved[at] *= factor
        runs.append(dataclasses.replace(pool[i], coordinates=moved))
    days = ["day %02d" % (i // A_DAY) for i in range(RUNS)]
    made = analysed.analyse(model, runs, ["craft"] * RUNS, days, TOLERANCE)
    return [
        (free[i], one.kind, one.size < 0, one.low, one.high)
        for (_, i), o in made.changes.items()
        for one in o
    ]


def whole(team, folder, seed, fall):
    """The changes of a history that went through files."""
    factors = thrusts(hidden_cases.random_of("whole", seed, fall), fall)
    write(team, folder, [1000 * (seed + 1) + i for i in range(RUNS)], factors)
    made = ground.history(folder, model=hidden_effects.MODEL, mapping=os.path.join(folder, "mapping.yaml"))
    return [(c["parameter"], c["kind"], c["after"] < c["before"], c["after_ci95"]) for c in made.changes]


def write(team, folder, numbers, factors):
    """Runs as CSV files, A_DAY a day, and the mapping."""
    with open(os.path.join(folder, "mapping.yaml"), "w") as file:
        yaml.safe_dump(MAPPING, file)
    for i, run in enumerate(team.map(flown, numbers, factors)):
        date = np.datetime64("2025-03-01T10:00") + np.timedelta64(
            24 * 60 * (i // A_DAY) + 9 * (i % A_DAY), "m"
        )
        stem = str(date).replace(":", "-").replace("T", "-")
        table(folder, stem + ".poses.csv", "t x y psi", np.column_stack([run.pose_times, run.eta]))
        commands = np.column_stack([run.control_times, run.controls])
        table(folder, stem + ".commands.csv", "t left right lift", commands)


def table(folder, name, columns, rows):
    with open(os.path.join(folder, name), "w", newline="") as file:
        csv.writer(file).writerows([columns.split(), *np.round(rows, 7).tolist()])


def falls(changes):
    return any(change[:3] == ("k", "drift", True) for change in changes)


def changed_down(changes):
    return any(change[0] == "k" and change[2] for change in changes)


def report(name, falling, flat):
    count = len(falling)
    print("%s: 5%% fall of k found as a drift: %s" % (name, share(sum(map(falls, falling)), count)))
    print(
        "%s: 5%% fall of k found as a drift or a jump: %s"
        % (name, share(sum(map(changed_down, falling)), count))
    )
    others = sum(any(change[0] != "k" for change in changes) for changes in falling)
    print("%s: another parameter said to change beside it: %s" % (name, share(others, count)))
    print("%s: any change said of flat ones: %s" % (name, share(sum(map(bool, flat)), len(flat))))


def speed(team, folder, count):
    """Seconds of the verb on runs, without a cache and again."""
    write(team, folder, range(5000, 5000 + count), np.ones(count))
    mapping = os.path.join(folder, "mapping.yaml")
    command = ["rosrun", "ground", "identify", "history", folder, "--mapping", mapping]
    command += ["--model", str(hidden_effects.MODEL), "--force", "-o", os.path.join(folder, "out")]
    for name in ("without a cache", "again"):
        begun, used = time.monotonic(), processor_time()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        seconds = time.monotonic() - begun, processor_time() - used
        print("speed: %d runs %s: %.1f s, %.1f s of processors" % (count, name, *seconds))


def processor_time():
    """Of programs that have ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _pool(team, given):
    """The estimates of the pool, from its file where it is there."""
    if given.pool and os.path.exists(given.pool):
        with open(given.pool) as file:
            return [estimates.RunEstimate(**one) for one in json.load(file)]
    pool = list(team.map(estimated, range(given.runs)))
    if given.pool:
        with open(given.pool, "w") as file:
            json.dump([dataclasses.asdict(one) for one in pool], file)
    return pool


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--histories", type=int, default=100)
    parser.add_argument("--runs", type=int, default=300, help="in the pool")
    parser.add_argument("--pool", metavar="FILE.json", help="keeps the pool's estimates")
    parser.add_argument("--whole", type=int, default=10, help="histories of each kind through files")
    parser.add_argument("--speed", type=int, default=200, help="runs")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as cache, ProcessPoolExecutor() as team:
        os.environ["XDG_CACHE_HOME"] = cache
        if given.histories:
            pool = _pool(team, given)
            every = [[found_in(pool, seed, fall) for seed in range(given.histories)] for fall in (FALL, 0.0)]
            report("pool", *every)
        if given.whole:
            every = []
            for fall in (FALL, 0.0):
                every.append([])
                for seed in range(given.whole):
                    with tempfile.TemporaryDirectory() as folder:
                        every[-1].append(whole(team, folder, seed, fall))
            report("whole", *every)
        if given.speed:
            with tempfile.TemporaryDirectory() as folder:
                speed(team, folder, given.speed)


if __name__ == "__main__":
    main()
