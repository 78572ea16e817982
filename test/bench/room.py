#!/usr/bin/python3
"""Excites and tracks inside a simulated room, and counts crafts that leave it and runs that are stopped.

Each seed has four experiments: an excitation of the model's craft and of a different one, and a circle by
ModelPredictive and by TrajectoryTracking. The mocap fails for 0.3 s now and then. Two fits compare the
excitation inside the room with an unbounded PRBS of the same length. Results go to a file of JSON lines;
an interrupted bench continues where it stopped.
"""

import argparse
import collections
import functools
import os
import sys
import time

import numpy as np

import resumed
from ground import _core, workers
from ground.analysis import study
from ground.errors import GroundError
from ground.recordings import quality, windows
from ground.simulation import experiments, gains

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
MODEL = os.path.join(ROOT, "cfg", "hovercraft", "tiny_whoover.yaml")
ROOM = os.path.join(ROOT, "cfg", "room", "room_4x4.yaml")
GAINS = os.path.join(ROOT, "cfg", "gains", "tiny_whoover.yaml")
WRONG = ("m", "I_z", "X_u", "Y_v", "N_r", "k", "l")  # parameters in which a wrong craft differs
FACTORS = (0.8, 1.2)
GAP_RATE, GAP_LENGTH = 0.1, 0.3  # rate and length of the mocap's failures [1/s], [s]
RADIUS = 1.5  # radius of the circle [m]
CONTROLLERS = ("ModelPredictive", "TrajectoryTracking")
EXCITATIONS = ("true", "wrong")
CRAFTS = {"true": "excitation, craft true", "wrong": "excitation, craft wrong by 20%"}
Z95 = 1.96


def mocap():
    found = _core.MocapParams()
    found.gap_rate, found.gap_length, found.gaps_vary = GAP_RATE, GAP_LENGTH, False
    return found


def wrong_craft(model, seed):
    """The model with each parameter of WRONG times one of FACTORS, chosen at random."""
    craft = model.copy()
    for name, factor in zip(WRONG, np.random.default_rng(seed).choice(FACTORS, len(WRONG))):
        craft.set_value(name, craft.value(name) * factor)
    return craft


def start_pose(room, seed):
    return room.home[0], room.home[1], np.random.default_rng([seed, 1]).uniform(-np.pi, np.pi)


def excitation(room, seed, duration):
    params = _core.ExcitationParams()
    params.design = experiments.design_params("prbs", seed=seed)
    params.duration, params.room = duration, room
    return params


def tracking(room, controller, duration):
    params = _core.TrackingParams()
    params.controller = gains.choice(controller, GAINS if "Tracking" in controller else None)
    params.reference.size = RADIUS
    params.reference.x, params.reference.y = room.home
    params.duration, params.room, params.max_error = duration, room, np.inf
    return params


def described(run, room):
    """Numbers that describe where a run went and how it ended."""
    positions = run.truth_eta[:, :2]
    times = [mark[0] for mark in run.marks] + [run.control_times[run.controls[:, 2] > 0][-1]]
    bursts = [b - a for a, b, mark in zip(times, times[1:], run.marks) if mark[2]]
    return {
        "stopped": run.stopped,
        "clearance": min(room.clearance(p) for p in positions),
        "farthest": np.abs(positions).max(axis=0).tolist(),
        "bursts": len(bursts),
        "burst_share": sum(bursts) / (times[-1] - times[0]) if bursts else 0.0,
        "median_burst": float(np.median(bursts)) if bursts else 0.0,
    }


def fitted(run, model):
    """Estimates and standard deviations by name, as from `identify fit`."""
    data = [quality.repaired(run).data(model)]
    result = windows.problem(data, windows.cut(data)).fit(model, list(study.NOMINAL))
    return {
        p["name"]: {"value": p["value"], "deviation": (p["ci95"][1] - p["ci95"][0]) / (2 * Z95)}
        for p in result["parameters"]
        if p["name"] in study.NOMINAL
    }


def run_seed(duration, seed):
    """Results of one seed, a dictionary for a line of JSON."""
    begin = time.perf_counter()
    model, room = _core.load_model(MODEL), _core.load_room(ROOM)
    pose = start_pose(room, seed)
    simulate = functools.partial(
        experiments.simulate, pose=pose, mocap=mocap(), seed=seed, believed=model
    )
    found = {"seed": seed, "duration": duration}
    bounded = simulate(model, excitation(room, seed, duration))
    wrong = simulate(wrong_craft(model, seed), excitation(room, seed, duration))
    found["true"], found["wrong"] = described(bounded, room), described(wrong, room)
    for controller in CONTROLLERS:
        run = simulate(model, tracking(room, controller, duration))
        found[controller] = described(run, room)
        if run.stopped:
            free = tracking(room, controller, duration)
            free.room = None
            found[controller]["free"] = described(simulate(model, free), room)
    rows = experiments.rows("prbs", duration, seed=seed)
    unbounded = simulate(model, experiments.with_lift(rows, duration))
    found["fits"] = {"bounded": None, "unbounded": None}
    for name, run in (("bounded", bounded), ("unbounded", unbounded)):
        try:
            found["fits"][name] = fitted(run, model)
        except GroundError as error:
            print("seed %d, fit of the %s run: %s" % (seed, name, error), file=sys.stderr)
    found["seconds"] = time.perf_counter() - begin
    return found


def wilson(count, of):
    """Wilson's 95% interval of a share."""
    share, z2 = count / of, Z95**2
    centre = (share + z2 / (2 * of)) / (1 + z2 / of)
    half = Z95 * np.sqrt(share * (1 - share) / of + z2 / (4 * of**2)) / (1 + z2 / of)
    return max(0.0, centre - half), min(1.0, centre + half)


def share(count, of):
    low, high = wilson(count, of)
    return "%d of %d: %.1f%% (%.1f..%.1f)" % (count, of, 100 * count / of, 100 * low, 100 * high)


def kind_of(reason):
    """The reason of a stop without its numbers."""
    words = " ".join(word for word in reason.split() if not any(c.isdigit() for c in word))
    return words.replace(" m ", " ").replace(" if it were stopped later", "")


def reasons(runs):
    counts = collections.Counter(kind_of(run["stopped"]) for run in runs if run["stopped"])
    return "; ".join("%d x %s" % (n, reason) for reason, n in counts.most_common()) or "-"


def stopped_falsely(run, least):
    """Whether a run was stopped that, without limits, stays farther than `least` [m] from the walls."""
    return bool(run["stopped"]) and run["free"]["clearance"] > least


def rows_of(results):
    """Rows (label, value) of the table."""
    for kind in EXCITATIONS:
        runs = [r[kind] for r in results]
        early = [run for run in runs if run["stopped"]]
        yield CRAFTS[kind] + ": left the room", share(sum(_left(r) for r in runs), len(runs))
        yield "  stopped early", share(len(early), len(runs))
        yield "  reasons", reasons(runs)
        yield "  largest |x|, |y| [m]", "%.2f, %.2f" % tuple(
            np.max([run["farthest"] for run in runs], axis=0)
        )
        yield "  least distance from a wall [m]", _spread([run["clearance"] for run in runs])
        yield "  bursts; share of the time in them", "%s; %s" % (
            _spread([run["bursts"] for run in runs], "%.0f"),
            _spread([run["burst_share"] for run in runs]),
        )
        yield "  median burst [s]", _spread([run["median_burst"] for run in runs])
    for controller in CONTROLLERS:
        runs = [r[controller] for r in results]
        margin = _core.load_room(ROOM).margin
        falsely = sum(stopped_falsely(run, margin) for run in runs)
        yield "circle by %s: stopped falsely" % controller, share(falsely, len(runs))
        inside = sum(stopped_falsely(run, 0) for run in runs)
        yield "  stopped, would have stayed in the room", share(inside, len(runs))
        yield "  stopped", share(sum(bool(run["stopped"]) for run in runs), len(runs))
        yield "  reasons", reasons(runs)
        yield "  left the room", share(sum(_left(run) for run in runs), len(runs))
    yield from _fit_rows([r["fits"] for r in results])


def _left(run):
    return run["clearance"] < 0


def _spread(values, number="%.2f"):
    """Median and range."""
    return "%s (%s..%s)" % tuple(
        number % value for value in (np.median(values), min(values), max(values))
    )


def _fit_rows(fits):
    model = _core.load_model(MODEL)
    pairs = [(f["bounded"], f["unbounded"]) for f in fits if f["bounded"] and f["unbounded"]]
    failed = {name: sum(not f[name] for f in fits) for name in ("bounded", "unbounded")}
    yield "fits that failed, bounded; unbounded", "%(bounded)d; %(unbounded)d" % failed
    for name in study.NOMINAL if pairs else ():
        sizes = np.array([[fit[name]["deviation"] for fit in pair] for pair in pairs])
        errors = np.array(
            [[fit[name]["value"] - model.value(name) for fit in pair] for pair in pairs]
        )
        medians, each = np.median(sizes, axis=0), sizes[:, 0] / sizes[:, 1]
        low, high = np.quantile(each, [0.05, 0.95])
        yield "%s: standard deviation, bounded to unbounded" % name, (
            "%.2f (5..95%% of seeds %.2f..%.2f)" % (medians[0] / medians[1], low, high)
        )
        yield "  median in % of the value", "%.2f to %.2f" % tuple(
            100 * medians / model.value(name)
        )
        yield "  rms error in % of the value", "%.2f to %.2f" % tuple(
            100 * np.sqrt((errors**2).mean(axis=0)) / model.value(name)
        )


def _run(job):
    seed, duration = job
    return run_seed(duration, seed)


def bench(options):
    """Runs the seeds without a result and prints the table of all seeds."""
    wanted = range(options.seed_base, options.seed_base + options.count)

    with workers.Workers(processes=True, count=options.jobs) as team:
        results = resumed.results(
            team,
            options.results,
            [(seed, options.duration) for seed in wanted],
            tuple,
            lambda result: (result["seed"], result["duration"]),
            _run,
            noun="seeds",
        )
    table = list(rows_of(results))
    width = max(len(label) for label, _ in table)
    for label, value in table:
        print("%-*s  %s" % (width, label, value))
    seconds = [r["seconds"] for r in results]
    print("\n%d seeds of %g s; seconds a seed on one core: %s" % (
        len(results), options.duration, _spread(seconds, "%.1f"),
    ))  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200, help="number of seeds (%(default)s)")
    parser.add_argument("--seed-base", type=int, default=1, help="the first seed (%(default)s)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument(
        "--duration", type=float, default=60.0, help="length of an experiment [s] (%(default)g)"
    )
    parser.add_argument("--results", default="build/room.jsonl", help="file of JSON lines")
    options = parser.parse_args()
    if options.count < 1 or options.jobs < 1:
        parser.error("--count and --jobs must be positive")
    try:
        bench(options)
    except (GroundError, OSError) as error:
        return str(error)


if __name__ == "__main__":
    sys.exit(main())
