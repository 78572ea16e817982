#!/usr/bin/python3
"""Measures how a sweep over gains and a diagnosis scale with threads and with a Dask cluster on this
computer, and predicts the time of sweeps on up to 1000 workers.

The prediction is a simulation. Tasks, whose lengths are drawn from the measured ones with replacement, go
in order to the next free worker. The scheduler submits one task after the other; its overhead per task is
measured with empty tasks.
"""
import contextlib
import heapq
import os
import socket
import subprocess
import sys
import tempfile
import time

import numpy as np

import diagnose_speed
import hidden
import hidden_white
from ground import _core, workers
from ground.simulation import gains, tracking, tuning

HERE = os.path.dirname(os.path.abspath(__file__))
MODEL = os.path.join(HERE, "../../cfg/hovercraft/tiny_whoover.yaml")
CANDIDATES, STARTS = 40, 4
WORKERS = [1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1000]
SWEEP = 100000  # tasks in the predicted sweep


def empty_task(_):
    return None


@contextlib.contextmanager
def cluster(count):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        address = "tcp://127.0.0.1:%d" % probe.getsockname()[1]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    run = [sys.executable, "-m"]
    processes = [
        subprocess.Popen(
            run + ["distributed.cli.dask_scheduler", "--host", address, "--no-dashboard"], **quiet
        )
    ]
    for _ in range(count):
        command = ["distributed.cli.dask_worker", address, "--nthreads", "1", "--no-dashboard"]
        processes.append(subprocess.Popen(run + command, **quiet))
    try:
        from distributed import Client

        with Client(address, timeout=60, set_as_default=False) as client:
            client.wait_for_workers(count, timeout=60)
        yield address
    finally:
        for process in processes:
            process.terminate()
            process.wait()


def sweep(team, cells, model):
    """Time for the evaluation of all candidates [s]."""
    choices = [gains.choice("TrajectoryTracking") for _ in range(CANDIDATES)]
    places = tracking.starts(STARTS, 1)
    begin = time.perf_counter()
    tuning.evaluate(team, choices, model, cells, places, tuning.Weights(), 1)
    return time.perf_counter() - begin


def task_times(cells, model):
    """Times of single tasks [s]."""
    choice, place = gains.choice("TrajectoryTracking"), tracking.starts(1, 1)[0]
    lengths = []
    for cell in cells:
        for seed in range(3):
            run = (cell.truth, model, choice, cell.task, place, cell.conditions, seed, 50.0)
            begin = time.perf_counter()
            tuning._numbers([run] * tuning.BATCH)
            lengths.append(time.perf_counter() - begin)
    return np.array(lengths)


def diagnoses():
    """Times of some cases of make bench-hidden on one core [s]."""
    names, lengths = list(hidden_white.strengths()), []
    for effect in ("motor_lag", "floor_tilt", "quadratic_drag"):
        begin = time.perf_counter()
        hidden.run_case(("white_single", names.index(effect) + 1, {}))
        lengths.append(time.perf_counter() - begin)
    return np.array(lengths)


def diagnosis_waits():
    """Time to the verdict on four runs with three hidden effects [s], by who works."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        effects = list(diagnose_speed.HIDDEN.values())[-1]
        bags = diagnose_speed.record(folder, "three", effects, 4, 8)
        allowed = os.sched_getaffinity(0)
        for count in sorted({1, len(allowed)}):
            os.sched_setaffinity(0, sorted(allowed)[:count])
            found["%d threads" % count] = diagnose_speed.diagnose(bags)["verdict"]
        os.sched_setaffinity(0, allowed)
        for count in (1, 2, 4):
            with cluster(count) as address:
                waits = diagnose_speed.diagnose(bags, "--scheduler", address)
                found["%d Dask workers" % count] = waits["verdict"]
    return found


def print_speedups(times):
    """Times by who works, and how many times as fast as one thread they are."""
    for name, seconds in times.items():
        faster = times["1 threads"] / seconds
        print("%-16s %6.1f s  %.2f times as fast as one thread" % (name, seconds, faster))


def predicted(lengths, overhead, count):
    """Predicted time of the sweep on `count` workers [s]."""
    random = np.random.default_rng(1)
    free, handed, end = [0.0] * count, 0.0, 0.0
    for length in random.choice(lengths, SWEEP):
        handed += overhead
        begin = max(handed, heapq.heappop(free))
        end = max(end, begin + length)
        heapq.heappush(free, begin + length)
    return end


def main():
    model = _core.load_model(MODEL)
    cells = tuning.cells({k: tracking.task(k) for k in ("circle", "line", "sinusoid")}, model)
    lengths = task_times(cells, model)
    print(
        "%d tasks; one takes a median of %.0f ms, %.0f to %.0f ms"
        % (
            CANDIDATES * len(cells) * STARTS / tuning.BATCH,
            *1e3 * np.quantile(lengths, [0.5, 0, 1]),
        )
    )
    cores = len(os.sched_getaffinity(0))
    times = {}
    for count in (1, cores):
        with workers.Workers(count=count) as team:
            times["%d threads" % count] = sweep(team, cells, model)
    for count in (1, cores):
        with cluster(count) as address, workers.Workers(address) as team:
            list(team.map(empty_task, range(100)))
            times["%d Dask workers" % count] = sweep(team, cells, model)
            begin = time.perf_counter()
            list(team.map(empty_task, range(2000)))
            overhead = (time.perf_counter() - begin) / 2000
    print_speedups(times)
    print("the verdict on four runs with three hidden effects:")
    print_speedups(diagnosis_waits())
    print("the scheduler takes %.2f ms a task; predicted for %d tasks:" % (1e3 * overhead, SWEEP))
    kinds = {
        "gains, %d runs a task" % tuning.BATCH: lengths,
        "diagnoses of hidden effects": diagnoses(),
    }
    print("%8s" % "workers" + "".join("%32s" % name for name in kinds))
    for count in WORKERS:
        row = "%8d" % count
        for each in kinds.values():
            seconds = predicted(each, overhead, count)
            faster = predicted(each, overhead, 1) / seconds
            row += "%12.0f s, %5.1f x, %3.0f%%" % (seconds, faster, 100 * faster / count)
        print(row)
    return 0


if __name__ == "__main__":
    sys.exit(main())
