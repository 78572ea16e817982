#!/usr/bin/env python3
"""How often what is published is wrong: p-values where nothing is there, and intervals. Prints a table.

A draw is recordings, or numbers as recordings give them, whose truth is known. Draws are numbered by seeds,
so that a rate can be had again. A rate contradicts its claim if a binomial test does at a level of 1% for all
rates together. Draws that say several things, such as five intervals, count as many as their scatter says.
"""

import argparse
import json
import multiprocessing
import os
import tempfile
from collections import defaultdict
from dataclasses import dataclass

import numpy as np

import ground
from ground import _core
from ground.analysis import agreement, bands, between_runs, distributions, likelihood, window_error, windows
from ground.comparing.ranking import equally_good
from ground.fitting import bench_forces, fit, priors, thrust_bench
from ground.fitting.bench_logs import BenchFormat
from ground.fitting.identifiability import WindowEstimates
from ground.models import Parameter
from ground.poses import repair
from shares import interval

LEVEL = 0.01  # of all rates together
NOISE = np.array([3e-4, 3e-4, 5e-3])  # of poses [m], [m], [rad]
ABOUT, MOST, LEAST = "", "at most ", "at least "


@dataclass(frozen=True)
class Claim:
    """What is claimed of a rate."""

    what: str
    rate: float
    sense: str = ABOUT


CLAIMS = {
    "ranking of 2": Claim("compare: two equally good models are distinguished", 0.05, MOST),
    "ranking of 5": Claim("compare: any of five equally good models is distinguished", 0.05, MOST),
    "ranking": Claim("compare: two mirrored models are distinguished, recordings", 0.05, MOST),
    "change": Claim("add: the interval contains the error change, four runs", 0.95),
    "change of one": Claim("add: the same, one run whose windows are alike", 0.95),
    "helps": Claim("add: an absent effect is reported to help, recordings", 0.025, MOST),
    "disagree of 20": Claim("fit: any of 20 clean runs is reported to disagree", 0.01, MOST),
    "disagree": Claim("fit: any of four clean runs is reported to disagree, recordings", 0.01, MOST),
    "intervals": Claim("fit: coverage of 95% intervals, recordings", 0.95),
    "known": Claim("fit --prior: any of five right priors is reported as contradicted", 0.01, MOST),
    "prior": Claim("fit --prior: a right prior of two is contradicted, recordings", 0.01, MOST),
    "band": Claim("fit: a band of 80% holds 80% of the samples of a new run, recordings", 0.8, LEAST),
    "gains": Claim("bench: p below 5% where thrusters are equal", 0.05),
    "thrust": Claim("bench: coverage of k's 95% interval", 0.95, LEAST),
    "same": Claim("diagnose: any of five parameters is reported to differ between equal runs", 0.01, MOST),
    "mean, equal": Claim("diagnose: coverage of the mean of five equal runs", 0.95, LEAST),
    "mean, alike": Claim("diagnose: the same, runs differ as much as each is uncertain", 0.95),
    "mean, apart": Claim("diagnose: the same, runs differ three times as much", 0.95),
    "mean of two": Claim("diagnose: the same, two runs", 0.95),
    "extreme": Claim("diagnose: agreement is denied, heavy-tailed numbers", 0.01, MOST),
    "agreement": Claim("diagnose: agreement is denied, recordings", 0.01, MOST),
    "likelihood": Claim("diagnose: coverage of 95% intervals, recordings", 0.95, LEAST),
    "differ": Claim("diagnose: any parameter differs between equal runs, recordings", 0.01, MOST),
    "prediction": Claim("diagnose: a band of 90% holds a pose of a run held out, recordings", 0.9),
}  # fmt: skip


def alike(random, shape, memory):
    """Numbers (..., n) with mean 0 and variance 1 of which neighbours correlate by `memory`."""
    found = random.normal(size=shape)
    for i in range(1, shape[-1]):
        found[..., i] = memory * found[..., i - 1] + np.sqrt(1 - memory**2) * found[..., i]
    return found


def ranking(random):
    """Errors of models in 60 windows of three runs, which have much in common."""
    for count in (2, 5):
        common = random.gamma(4.0, 0.25, 60)
        by_window = {str(i): common + random.gamma(1.0, 0.3, 60) for i in range(count)}
        order = sorted(by_window, key=lambda label: by_window[label].mean())
        equal = equally_good(order, by_window, np.repeat(range(3), 20))
        yield "ranking of %d" % count, [len(equal) < count - 1]


def change(random):
    """Errors of windows without an effect and with it, which lowers them by 10%, more in some runs."""
    for name, runs, count, memory in (("change", 4, 12, 0.0), ("change of one", 1, 48, 0.3)):
        before = np.exp(0.4 * alike(random, (runs, count), memory))
        after = 0.9 * before * np.exp(0.1 * alike(random, (runs, count), memory) - 0.005)
        part_of = np.repeat(np.arange(runs), count)
        sizes = random.integers(50, 150, runs * count)
        low, high = distributions.ratio_of_means(after.ravel(), before.ravel(), sizes, part_of)
        yield name, [low < 0.9 < high]


def disagreement(random, runs=20, blocks=12):
    """Estimates of five parameters by runs, and by all others."""
    found = []
    for _ in range(runs):
        pair = []
        for freedom, size in ((blocks - 5, 1.0), (blocks * (runs - 1) - 5, 1 / np.sqrt(runs - 1))):
            seen = size * np.sqrt(random.chisquare(freedom, 5) / freedom)
            values = size * random.normal(size=5)
            parameters = {
                str(i): Parameter(str(i), "", v, v, (v - 2 * d, v + 2 * d), d, False, True)
                for i, (v, d) in enumerate(zip(values, seen))
            }
            pair.append(WindowEstimates(None, parameters, np.eye(5), freedom))
        found += fit.disagreements(*pair, fit.LEVEL / runs)
    yield "disagree of %d" % runs, [bool(found)]


def known(random):
    """What is known of five parameters, and estimates by data that are from far less to far more precise."""
    truth, size = random.normal(size=5), 10 ** random.uniform(-1, 1, 5)
    seen = truth + size * random.normal(size=5)
    value, after = seen / (1 + size**2), size / np.sqrt(1 + size**2)
    chances = [priors.contradiction(v, 1.0, a) for v, a in zip(value, after)]
    yield "known", [5 * min(chances) < priors.LEVEL]


def thrust(random):
    """A bench of two equal thrusters, three repetitions at ten inputs."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "bench.csv")
        with open(path, "w") as file:
            file.write("input,left_1,left_2,left_3,right_1,right_2,right_3\n")
            for level in np.linspace(0.1, 1, 10):
                forces = 0.1 * level**1.5 + 1e-3 * random.normal(size=6)
                file.write(",".join("%.9g" % value for value in (level, *forces)) + "\n")
        found = thrust_bench.fit(bench_forces.read([path], BenchFormat(["left", "right"])), ["left", "right"])
    low, high = found.intervals["k"]
    yield "gains", [found.p_value < 0.05]
    yield "thrust", [low < 0.1 < high]


def between(random):
    """Values of runs, whose variances differ by a factor of up to 4."""
    own = 2 ** random.uniform(-1, 1, (5, 4))
    chances = [between_runs.chance(np.sqrt(v) * random.normal(size=4), v) for v in own]
    yield "same", [5 * min(chances) < distributions.LEVEL]
    for name, runs, apart in (("equal", 5, 0), ("alike", 5, 1), ("apart", 5, 3), ("of two", 2, 3)):
        own = 2 ** random.uniform(-1, 1, runs)
        steps = np.sqrt(own + apart**2) * random.normal(size=runs)
        mean, half, _ = between_runs.mean_of(steps, own)
        common = np.sum(steps / own) / np.sum(
            1 / own
        )  # what the likelihood says, to which the page adds the mean
        reach = 1.96 / np.sqrt(np.sum(1 / own))
        low, high = min(mean - half, common - reach), max(mean + half, common + reach)
        yield "mean of two" if runs == 2 else "mean, %s" % name, [low < 0 < high]


def extreme(random):
    """Four numbers each of real and of artificial recordings, correlated and skewed."""
    values = np.exp(
        random.normal(size=(1 + agreement.DRAWS, 4)) + random.normal(size=(1 + agreement.DRAWS, 1))
    )
    yield "extreme", [agreement.share_as_extreme(values) <= 1 / (1 + agreement.DRAWS)]


def craft():
    """The bench's craft, with its true parameters."""
    return ground.Model.load(
        os.path.join(os.path.dirname(__file__), "../../cfg/hovercraft/tiny_whoover.yaml")
    )


def moved(model, random, seconds=8.0, push=0.004):
    """Times (n,), poses (n, 3) and commands (k, 4) of a craft under a random wrench [N]."""
    bits = random.integers(0, 2, (int(15 * seconds), 2))
    commands = np.column_stack([np.arange(len(bits)) / 15, bits, np.ones(len(bits))])
    times = np.arange(int(100 * seconds)) / 100
    wrench = push * alike(random, (3, len(times)), np.exp(-0.01 / 0.3)).T * [1, 1, 0.03]
    start = np.zeros(3)
    poses = _core.simulate(model.core, commands, times, start, start, [0.0], wrench)["eta"]
    return times, poses + NOISE * random.normal(size=poses.shape), commands


def recorded(model, random, name, **options):
    """A ground.Recording of a moved craft."""
    times, poses, commands = moved(model, random, **options)
    channels = ("left", "right", "lift")
    return ground.Recording.from_arrays(
        times[20:], poses[20:], commands[:, 1:], commands[:, 0], channels=channels, name=name
    )


def data(model, random, name, **options):
    """_core.RunData of a moved craft."""
    times, poses, commands = moved(model, random, **options)
    found = repair.smooth(times, poses, (NOISE[0], NOISE[2]), _core.RunScales())
    return _core.RunData(name, times, found["eta"], found["nu"], commands, poses, NOISE)


def fitted(random):
    """Fits to runs of a craft of which X_u and Y_v are known beforehand to 20%."""
    given = craft()
    known = {name: given[name] * (1 + 0.2 * np.clip(random.normal(), -4, 4)) for name in ("X_u", "Y_v")}
    true = given.with_values(known)
    runs = [recorded(true, random, "run%d" % i) for i in range(5)]
    found = ground.fit(given, runs[:4])
    ends = [(true[name], *p.ci95) for name, p in found.parameters.items()]
    yield "intervals", [low < value < high for value, low, high in ends]
    yield "disagree", [any(run.disagrees_in for run in found.runs)]
    band = found.predict(runs[4], horizon=2.0, band=0.8)
    held = ((band.measured >= band.low) & (band.measured <= band.high)).mean(axis=0)
    yield "band", (held >= 0.8).tolist()
    found = ground.fit(given, runs[:1], prior={"X_u": "20%", "Y_v": "20%"})
    yield "prior", [any("contradict" in remark for remark in found.remarks)]


def added(random):
    """An effect that is not there, and models that turn to either side as much."""
    given = craft()
    runs = [recorded(given, random, "run%d" % i) for i in range(4)]
    yield "helps", [ground.add(given, "yaw_bias", runs).verdict.helps]
    sides = {str(side): given.with_effect("yaw_bias", n0=3e-6 * side) for side in (-1, 1)}
    yield "ranking", [not ground.compare(sides, runs).ranking.equal]


def likely(random):
    """Fits by likelihood to runs, and what they say of another one."""
    given = craft()
    runs = [data(given, random, "run%d" % i) for i in range(4)]
    like = likelihood.Likelihood(runs[:3], given.core, (), threads=1)
    found = like.fit(given.core, window_error.NOMINAL)
    parameters = between_runs.widened(like, found, like.intervals(found))
    yield "likelihood", [p["ci95"][0] < given[p["name"]] < p["ci95"][1] for p in parameters]
    yield "differ", [any("runs" in p for p in parameters)]
    yield "agreement", [not agreement.agreement(runs[:3], windows.cut(runs[:3]), like, found, 1.0).holds]
    held = []
    for prediction in bands.of_others(runs[3:], found, int(random.integers(1000)))[0].predictions:
        inside = (prediction.measured >= prediction.low) & (prediction.measured <= prediction.high)
        held += inside[-1].tolist()
    yield "prediction", held


CHEAP, COSTLY = (ranking, change, disagreement, known, thrust, between, extreme), (fitted, added, likely)


def drawn(task):
    """What a draw says, by claim."""
    draw, seed = task
    return [(name, list(said)) for name, said in draw(np.random.default_rng(seed))]


def rates(draws, count, seed, each=map):
    """What draws say, [draw][of it], by claim."""
    found = defaultdict(list)
    for draw in draws:
        for said in each(drawn, [(draw, seed + i) for i in range(count)]):
            for name, values in said:
                found[name].append(values)
    return dict(found)


def summary(said):
    """Rate, independent draws that are worth as much, and the 95% interval (Clopper and Pearson)."""
    every = np.concatenate(said).astype(float)
    rate, count = float(every.mean()), float(len(every))
    scatter = np.var([np.sum(one) - rate * len(one) for one in said]) / np.mean([len(one) for one in said])
    if scatter > rate * (1 - rate) > 0:
        count *= rate * (1 - rate) / scatter
    return rate, count, interval(rate * count, count)


def contradicted(claim, rate, count, among):
    """Whether a rate contradicts its claim, which is one of some."""
    low, high = interval(rate * count, count, LEVEL / among)
    return (claim.sense != LEAST and low > claim.rate) or (claim.sense != MOST and high < claim.rate)


def rows(found):
    """The rows of the table, for --json."""
    for name, claim in CLAIMS.items():
        if name in found:
            rate, count, (low, high) = summary(found[name])
            wrong = bool(contradicted(claim, rate, count, len(found)))
            row = {"what": claim.what, "claimed": claim.sense + "%.3g%%" % (100 * claim.rate), "rate": rate}
            yield dict(row, low=low, high=high, draws=len(found[name]), contradicted=wrong)


def table(found):
    """The lines of the table."""
    yield "| what | claimed | measured | of | 95% interval |"
    yield "| --- | --- | --- | --- | --- |"
    for row in rows(found):
        mark = " (contradicts the claim)" if row["contradicted"] else ""
        numbers = 100 * row["rate"], mark, row["draws"], 100 * row["low"], 100 * row["high"]
        said = "| %.3g%%%s | %d | %.2g to %.3g%% |" % numbers
        yield "| %s | %s %s" % (row["what"], row["claimed"], said)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cheap", type=int, default=1000, help="draws of numbers (%(default)s)")
    parser.add_argument("--costly", type=int, default=300, help="draws of recordings (%(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="of the first draw (%(default)s)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (%(default)s)")
    parser.add_argument("--only", nargs="+", choices=[d.__name__ for d in CHEAP + COSTLY], help="draws")
    parser.add_argument("--json", metavar="FILE", help="file for the rows")
    arguments = parser.parse_args()
    found = {}
    with multiprocessing.Pool(arguments.jobs) as pool:
        for draws, count in ((CHEAP, arguments.cheap), (COSTLY, arguments.costly)):
            chosen = [d for d in draws if not arguments.only or d.__name__ in arguments.only]
            found.update(rates(chosen, count, arguments.seed, pool.imap))
    print("\n".join(table(found)))
    if arguments.json:
        with open(arguments.json, "w") as file:
            json.dump(list(rows(found)), file, indent=1)


if __name__ == "__main__":
    main()
