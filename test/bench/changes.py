#!/usr/bin/python3
"""Changes of a craft in flight: how soon, how rightly and how falsely they are named, and what a controller
that takes them gains. Run in the workspace: /usr/bin/python3 test/bench/changes.py --flights 100 --hours 10

A flight follows a circle or a rhodonea, or plays a binary sequence between returns. At a random time one
thruster loses 20%, a load of 15% of the mass appears at the distance of a thruster in a random direction, or
all damping doubles. changes_craft.py says by what else the truth differs from the model.
"""

import argparse
import json
import math
import multiprocessing
import os
import sys

import numpy as np
from scipy import stats

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import changes_craft as flights
import hidden_effects
from ground import _core
from shares import share

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
MODEL = os.path.join(ROOT, "cfg", "hovercraft", "tiny_whoover.yaml")
SIZES = {"thruster": -0.2, "mass": 0.15, "drag": 1.0}
NAMED = 3.0  # time in which a change should be named [s]
RECOVERY = 5.0  # time after which the error should be as before [s]
LONG = 300.0  # a flight without change [s]
WRONG = 40.0  # a flight by a model that misses an effect [s]
MISSED = 3.0  # sizes of its effect, relative to those that benches hide
ROOM = {"battery_sag", "floor_tilt", "wind", "marker_offset"}  # that are not missing, or not of the craft
KNOWN = 0.95  # probability at which a change counts as known
# States of the monitor's filter (ChangeFilter): those that a load changes; others, with deviations of a jump
LOAD = [16, 17, 18, 19]
OTHERS = {
    "the left thruster": ([14], [0.3]),
    "the right thruster": ([15], [0.3]),
    "drag": ([20], [1.0]),
    "a push": ([6, 7, 8], [0.64, 0.64, 6.9]),
    "a bias": ([9, 10, 11], [0.11, 0.11, 1.1]),
}


def named(job):
    """What the monitor said of a flight with a change."""
    kind, seed, share = job
    model = _core.load_model(MODEL)
    chosen = flights.setting(model, kind, seed, share)
    log = flights.fly(model, chosen)
    found = dict(kind=kind, seed=seed, named=None, early=False, at_bound="", alternatives="", right=None)
    monitor = None
    for time, monitor in flights.watch(model, log):
        changes = monitor.changes
        if not changes:
            continue
        if changes[-1]["what"] != chosen.name:
            found["right"] = None
        elif found["right"] is None:
            found["right"] = float(time - chosen.time)
        if found["named"] is None:
            found["named"] = float(time - chosen.time)
            found["early"] = bool(time < chosen.time)
        if time <= chosen.time + NAMED:
            found["at_bound"], found["alternatives"] = changes[-1]["what"], changes[-1]["alternatives"]
    last = monitor.changes if monitor else []
    found["truth"] = chosen.name
    found["last"] = last[-1]["what"] if last else ""
    found["count"] = len(last)
    found["size"] = [last[-1][k] for k in ("lower", "size", "upper")] if last else None
    return found


def separable(job):
    """How well the innovations since a load appeared could tell it from other parts, by Fisher's information:
    the probability after NAMED seconds that the likelihood of the true load, known exactly, is above that of
    the part; and the time at which it is KNOWN for all of them, None if that is later."""
    seed, share = job
    model = _core.load_model(MODEL)
    chosen = flights.setting(model, "mass", seed, share)
    before, after = chosen.before.body, chosen.after.body
    offset = chosen.after.effects["com_offset"]
    load = after["m"] / before["m"] - 1, after["I_z"] / before["I_z"] - 1, offset["xg"], offset["yg"]
    found, known = {}, None
    for time, monitor in flights.watch(model, flights.fly(model, chosen, chosen.time + NAMED + 0.5)):
        since = time - chosen.time
        if since > NAMED:
            break
        information = monitor.information(chosen.time)
        if since <= 0 or not len(information):
            continue
        told = {part: _told(information, load, *others) for part, others in OTHERS.items()}
        if min(told.values()) >= min(found.values(), default=0):
            found = told
        if known is None and min(told.values()) > KNOWN:
            known = float(since)
    return dict(seed=seed, separable=found, known=known)


def _told(information, load, states, deviations):
    """The probability that a load is likelier than a jump of other states, by innovations of some
    information."""
    jump = np.zeros(len(information))
    jump[LOAD] = load
    root = np.zeros((len(jump), len(states)))
    root[states, range(len(states))] = deviations
    A = np.eye(len(states)) + root.T @ information @ root
    z = np.linalg.solve(A, root.T @ information @ jump)
    rest = jump - root @ z
    distance = math.sqrt(max(0.0, rest @ information @ rest + z @ z))
    return 0.5 * (1 + math.erf(distance / 2 / math.sqrt(2)))


def tell_separable(rows, changes):
    found = [row["separable"] for row in rows if row["separable"]]
    for part in OTHERS:
        print("a load could be told from %s in %.0f%%" % (part, 100 * np.mean([row[part] for row in found])))
    worst = np.mean([min(row.values()) for row in found])
    print("and from the likest of them in %.0f%% of %d flights" % (100 * worst, len(found)))
    named = {row["seed"]: row["right"] for row in changes if row["kind"] == "mass"}
    for label, times in (
        ("could be known at %.0f%% at the earliest" % (100 * KNOWN), [row["known"] for row in rows]),
        ("was named for good", [named[row["seed"]] for row in rows]),
    ):
        times = np.array([np.inf if time is None else time for time in times])
        print(
            "a load %s after (10, 50, 90%% of flights) %s s; within %.0f s in %s"
            % (
                label,
                ", ".join("%.1f" % q for q in np.quantile(times, (0.1, 0.5, 0.9), method="lower")),
                NAMED,
                share(int((times <= NAMED).sum()), len(times)),
            )
        )


def misled(job):
    """What the monitor said of a craft that does not change, by a model that misses an effect."""
    effect, sizes, seed, share = job
    model = _core.load_model(MODEL)
    log = flights.fly(model, flights.setting(model, None, seed, share, missing={effect: sizes}), WRONG)
    texts, doubted = [], None
    for time, monitor in flights.watch(model, log):
        if monitor.changes and not texts:
            texts.append(monitor.text)
        if monitor.doubt and doubted is None:
            doubted = float(time)
    return dict(effect=effect, seed=seed, texts=texts, doubted=doubted)


def missing_effects():
    """Effects that models miss, at MISSED times the sizes that benches hide, and motors with much lag."""
    names = set(hidden_effects.strengths()) - ROOM
    all_sizes = {
        name: {key: MISSED * value for key, value in hidden_effects.STRENGTHS[name].items()}
        for name in sorted(names)
    }
    return {**all_sizes, "motor_lag": {"tau": 0.1}}


def tell_misled(rows):
    texts = [(row["effect"], row["seed"], text) for row in rows for text in row["texts"]]
    doubted = [row["doubted"] for row in rows if row["doubted"] is not None]
    print(
        "models that miss an effect: a change was named in %s %s; the model was doubted in %d, after %s s at "
        "the median" % (share(len(texts), len(rows)), texts, len(doubted), np.median(doubted or [np.nan]))
    )


def falsely(job):
    """Duration [s] and false names of a long flight without a change."""
    seed, share = job
    model = _core.load_model(MODEL)
    log = flights.fly(model, flights.setting(model, None, seed, share), LONG)
    texts, doubt, largest, monitor = [], "", 0.0, None
    for _, monitor in flights.watch(model, log):
        ratios = monitor.log_ratios()
        parts = [value for part, value in ratios.items() if part != "an unknown force"]
        largest = max([largest, *parts])
        doubt = doubt or monitor.doubt
        if len(monitor.changes) > len(texts):
            texts.append(monitor.text)
    return dict(seed=seed, duration=float(log["frames"][-1, 0]), texts=texts, doubt=doubt, largest=largest)


def recovered(job):
    """RMS errors [m] after a change, with and without adapting, and of the same flight without the change."""
    kind, seed, share = job
    model = _core.load_model(MODEL)
    chosen = flights.setting(model, kind, seed, share)
    chosen.controller, chosen.reference = "ModelPredictive", ["circle", "rhodonea"][seed % 2]
    found = dict(kind=kind, seed=seed)
    for label, adapt in (("unchanged", False), ("kept", False), ("adapted", True)):
        chosen.kind = None if label == "unchanged" else kind
        log = flights.fly(model, chosen, chosen.time + flights.AFTER, adapt=adapt)
        references, truth = log["references"], log["truth"]
        times = references[:, 0] - chosen.time
        off = [np.interp(references[:, 0], truth[:, 0], truth[:, i]) - references[:, i] for i in (1, 2)]
        squares = np.square(off).sum(axis=0)
        found[label] = [
            math.sqrt(squares[(times > a) & (times < b)].mean())
            for a, b in ((0, RECOVERY), (RECOVERY, flights.AFTER))
        ]
        found[label + "_stopped"] = log["stopped"]
    return found


def tell_named(rows):
    for kind in flights.KINDS:
        found = [row for row in rows if row["kind"] == kind]
        right = [row["at_bound"] == row["truth"] for row in found]
        beside = [row["truth"] in (row["at_bound"], *row["alternatives"].split(" or ")) for row in found]
        sized = [row["size"] for row in found if row["last"] == row["truth"]]
        holds = [low <= SIZES[kind] <= high for low, _, high in sized]
        print(
            "%-8s named in %.0f s: %s; as best or beside: %s; said before it: %d; right in the end: %s; "
            "interval holds: %s"
            % (
                kind,
                NAMED,
                share(sum(right), len(found)),
                share(sum(beside), len(found)),
                sum(row["early"] for row in found),
                share(len(sized), len(found)),
                share(sum(holds), len(sized)),
            )
        )


def tell_false(rows):
    hours = sum(row["duration"] for row in rows) / 3600
    texts = [(row["seed"], text) for row in rows for text in row["texts"]]
    largest = np.sort([row["largest"] for row in rows])[::-1][:5]
    doubted = sum(bool(row["doubt"]) for row in rows)
    # Bounds of the mean of a Poisson number, from quantiles of chi-squared.
    least, most = stats.chi2.ppf([0.025, 0.975], [2 * len(texts), 2 * len(texts) + 2]) / 2
    print(
        "false: %d in %.2f h, %.2g to %.2g in 10 h at 95%%, %s; the model was doubted in %d of %d flights; "
        "largest log-likelihood ratios %s"
        % (
            len(texts),
            hours,
            10 * np.nan_to_num(least) / hours,
            10 * most / hours,
            texts,
            doubted,
            len(rows),
            largest,
        )
    )


def tell_recovered(rows):
    for kind in flights.KINDS:
        found = [row for row in rows if row["kind"] == kind]
        if not found:
            continue

        def pooled(label, part, found=found):
            return math.sqrt(np.mean([row[label][part] ** 2 for row in found]))

        base = pooled("unchanged", 1)
        within = sum(row["adapted"][1] <= 1.3 * row["unchanged"][1] for row in found)
        print(
            "%-8s error from %.0f s on, over that without a change: %.2f adapted, %.2f kept; in the first "
            "%.0f s %.2f and %.2f; single flights within 1.3: %s; stopped: %d"
            % (
                kind,
                RECOVERY,
                pooled("adapted", 1) / base,
                pooled("kept", 1) / base,
                RECOVERY,
                pooled("adapted", 0) / pooled("unchanged", 0),
                pooled("kept", 0) / pooled("unchanged", 0),
                share(within, len(found)),
                sum(bool(row["adapted_stopped"]) for row in found),
            )
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--flights", type=int, default=100, help="flights of each kind of change")
    parser.add_argument("--hours", type=float, default=10.0, help="flight without changes [h]")
    parser.add_argument("--recoveries", type=int, default=30, help="flights of each kind with the controller")
    parser.add_argument("--share", type=float, default=0.02, help="pushes, relative to full thrust")
    parser.add_argument("--seed", type=int, default=2000)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--bound", action="store_true", help="also: what any detector could tell of a load")
    parser.add_argument("--wrong", type=int, default=3, help="flights by each model that misses an effect")
    parser.add_argument("--json", help="file for all flights")
    options = parser.parse_args()
    seeds = range(options.seed, options.seed + options.flights)
    with multiprocessing.Pool(options.jobs) as pool:
        jobs = [(kind, seed, options.share) for kind in flights.KINDS for seed in seeds]
        changes = pool.map(named, jobs, chunksize=1)
        tell_named(changes)
        jobs = [(kind, seed, options.share) for kind in flights.KINDS for seed in seeds[: options.recoveries]]
        recoveries = pool.map(recovered, jobs, chunksize=1)
        tell_recovered(recoveries)
        long = range(options.seed, options.seed + math.ceil(options.hours * 3600 / LONG))
        if options.bound:
            bound = [(seed, options.share) for seed in seeds]
            tell_separable(pool.map(separable, bound, chunksize=1), changes)
        jobs = [
            (effect, sizes, seed, options.share)
            for effect, sizes in missing_effects().items()
            for seed in seeds[: options.wrong]
        ]
        wrong = pool.map(misled, jobs, chunksize=1)
        if wrong:
            tell_misled(wrong)
        silent = pool.map(falsely, [(seed, options.share) for seed in long], chunksize=1)
        tell_false(silent)
    if options.json:
        with open(options.json, "w") as file:
            json.dump(dict(changes=changes, recoveries=recoveries, wrong=wrong, silent=silent), file)


if __name__ == "__main__":
    main()
