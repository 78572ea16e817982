#!/usr/bin/python3
"""Hides an effect in the simulated craft, has it diagnosed, and compares with the truth.

Each case is a truth (nominal parameters and an effect that the diagnosed model does not have), four
recorded runs of 8 s, and a seed. Results go to a file of JSON lines as they come; an interrupted bench
goes on where it stopped.
"""
import argparse
import itertools
import json
import os
import sys
import time

import numpy as np

import hidden_cases as cases
from ground import _core, workers
from ground.analysis import candidates, diagnosis, diagnosis_report, next_experiment, study
from ground.errors import IdentifyError

KINDS = ["single", "nothing", "pairs", "outside", "ambiguous"]
MANY = 10  # runs of an experiment that a lab would do at most
MODERATE = 1.3  # the nominal model's held-out error, in those of the true model refitted
NEAR = 1.005  # a rival whose refitted error is within this of the truth's cannot be told from it


def run_case(case):
    """What came of one case, a dictionary for a line of JSON."""
    if case["kind"] == "ambiguous":
        return run_ambiguous(case)
    truth = cases.truth(case["hidden"], case["factor"], case["seed"])
    runs = cases.runs(truth, case["excitation"], case["noise"], case["seed"])
    model = _core.load_model(cases.MODEL)
    start = time.perf_counter()
    try:
        found = diagnosis.Diagnosis(runs, model, candidates.library(model), threads=1)
        found.grow()
        conclusion = found.conclude()
    except IdentifyError as error:
        return dict(case, failed=str(error))
    seconds = time.perf_counter() - start
    true_fit = found.study.fit(truth, study.free_parameters(truth))
    first = found.tried[0] if found.tried else []
    floors = [study.noise_floor(runs, found.best.model, seed).sum() for seed in range(10)]
    result = dict(
        case,
        seconds=seconds,
        verdict=conclusion.verdict,
        chosen=[c.name for c in found.chosen],
        ranked=[t.name for t in first[:3]],
        group=[t.name for t in first if t.equal],
        nominal=found.nominal.heldout.sum(),
        truth=true_fit.heldout.sum(),
        improved=found.best.heldout.sum(),
        floor=conclusion.noise_floor,
        floor_spread=float(np.std(floors, ddof=1)),
        disturbed=found.evidence.disturbed,
        inside=_inside(truth, conclusion.parameters),
    )
    result["rivals"] = _rivals(found, truth, result) if len(case["hidden"]) == 1 else []
    if conclusion.verdict == "unexplained" and case["kind"] == "outside":
        result["where"] = [w["variable"] for w in diagnosis_report.where_of(found)]
    return result


def run_ambiguous(case):
    """The same of runs that cannot tell two effects apart, and of the experiment that is proposed."""
    excitation, rivals = cases.AMBIGUOUS[case["ambiguous"]]
    truth = cases.truth(case["hidden"], case["factor"], case["seed"], rivals)
    runs = cases.runs(truth, excitation, case["noise"], case["seed"], count=2)
    start = time.perf_counter()
    before, proposed = _told(runs, rivals)
    seconds = time.perf_counter() - start
    result = dict(case, before=before, seconds=seconds)
    if proposed:
        schedule = next_experiment.schedule_of(proposed["arguments"])
        new = [
            cases.run(truth, schedule, 0.0, case["noise"], 1000 * case["seed"] + i, "new %d" % i)
            for i in range(min(MANY, proposed["repeat"]))
        ]
        after, _ = _told(runs + new, rivals)
        result.update(
            separates=proposed["separates"],
            experiment=proposed["arguments"],
            repeat=proposed["repeat"],
            disagreement=proposed["expected_disagreement"],
            after=after,
        )
    return result


def _told(runs, rivals):
    """What a diagnosis by the whole library chose, and what it could not tell from the first rival;
    the experiment that it proposes."""
    model = _core.load_model(cases.MODEL)
    found = diagnosis.Diagnosis(runs, model, candidates.library(model), threads=1)
    found.grow()
    report = diagnosis_report.of(found, found.conclude(), model.name)
    group = next(c["group"] for c in report["candidates"] if c["effect"] in rivals)
    return {"chosen": report["improved"]["effects"], "group": group}, report["next_experiment"]


def _inside(truth, parameters):
    """Of each parameter of a hidden effect that was found: whether the interval holds the truth."""
    inside = []
    for p in parameters:
        if "." in p["name"] and p["name"].split(".")[0] in truth.effects and p["identified"]:
            inside.append(bool(p["ci95"][0] <= truth.value(p["name"]) <= p["ci95"][1]))
    return inside


def _rivals(found, truth, result):
    """Effects ranked before the hidden one although data can hardly tell: by their refitted error."""
    first = found.tried[0] if found.tried else []
    before = list(itertools.takewhile(lambda t: t.name not in truth.effects, first))[:3]
    found.judge_all(before)
    return [t.name for t in before if t.fit.heldout.sum() < NEAR * result["truth"]]


def list_cases(options):
    """The cases that the options ask for."""
    for seed, noise, excitation in itertools.product(
        range(1, options.seeds + 1), options.noise, options.excitation
    ):
        shared = {"seed": seed, "noise": noise, "excitation": excitation}
        for strength in options.strength:
            factor = cases.LEVELS[strength]
            more = dict(shared, strength=strength, factor=factor)
            if "single" in options.kind:
                for effect in options.effects or cases.STRENGTHS:
                    yield dict(more, kind="single", hidden=[effect])
            if "pairs" in options.kind:
                yield dict(more, kind="pairs", hidden=_pair(seed))
            if "outside" in options.kind:
                for name in cases.OUTSIDE:
                    yield dict(more, kind="outside", hidden=[name])
        if "ambiguous" in options.kind:
            yield from ambiguous_cases(shared)
        if "nothing" in options.kind:
            yield dict(shared, strength="none", factor=0, kind="nothing", hidden=[])


def ambiguous_cases(shared):
    """One case of each kind, the hidden effect by the seed."""
    for name, (_, rivals) in cases.AMBIGUOUS.items():
        hidden = [n for n in [sorted(rivals, key=str)[shared["seed"] % 2]] if n]
        more = dict(shared, strength=name, factor=1.0)
        yield dict(more, kind="ambiguous", ambiguous=name, hidden=hidden)


NEARLY_THE_SAME = [
    {"input_delay", "motor_lag"},
    {"thrust_misalignment", "heading_offset"},
    {"thrust_asymmetry", "yaw_bias"},
    {"momentum_drag", "quadratic_drag"},
    {"momentum_drag", "coulomb_friction"},
    {"quadratic_drag", "coulomb_friction"},
]


def _pair(seed):
    random = np.random.default_rng(seed)
    while True:
        pair = sorted(random.choice(sorted(cases.STRENGTHS), 2, replace=False).tolist())
        if set(pair) not in NEARLY_THE_SAME:
            return pair


def key(case):
    return json.dumps(
        [case[k] for k in ("kind", "hidden", "strength", "noise", "excitation", "seed")]
    )


def bench(options):
    wanted = list(list_cases(options))
    done = {key(r) for r in read(options.results)} if os.path.exists(options.results) else set()
    left = [c for c in wanted if key(c) not in done]
    print("%d cases, %d of them to do" % (len(wanted), len(left)), flush=True)
    with open(options.results, "a") as file, workers.Workers(
        options.scheduler, processes=True, count=options.jobs, modules=[cases.__file__]
    ) as team:
        for result in team.map(run_case, left):
            file.write(json.dumps(result) + "\n")
            file.flush()
    asked = {key(c) for c in wanted}
    summary([r for r in read(options.results) if key(r) in asked], options.picture)


def read(path):
    with open(path) as file:
        return [json.loads(line) for line in file]


def share(values):
    values = list(values)
    return (
        "%3d of %3d  %5.1f%%" % (sum(values), len(values), 100 * np.mean(values)) if values else "-"
    )


def summary(results, picture=None):
    """Prints what the results come to; the confusion matrix as a picture as well."""
    for failed in [r for r in results if "failed" in r]:
        print("failed: %s: %s" % (key(failed), failed["failed"]))
    results = [r for r in results if "failed" not in r]
    single = [r for r in results if r["kind"] == "single"]
    for cell in sorted({(r["excitation"], r["noise"], r["strength"]) for r in single}):
        rows = [r for r in single if (r["excitation"], r["noise"], r["strength"]) == cell]
        print("\nsingle effect, excitation %s, noise x%g, %s" % cell)
        _table(rows)
    moderate = [r for r in single if is_moderate(r)]
    if moderate:
        print(
            "\nall single effects whose nominal error is 30%% above the truth's: %d" % len(moderate)
        )
        right = [r for r in moderate if r["hidden"][0] in r["chosen"]]
        print("first                          " + share(_first(r) for r in moderate))
        print("first, or in a group with it   " + share(_in_group(r) for r in moderate))
        print(
            "verdict missing                " + share(r["verdict"] == "missing" for r in moderate)
        )
        print(
            "error within 1.05 of the truth's "
            + share(r["improved"] <= 1.05 * r["truth"] for r in moderate)
        )
        print(
            "error within the floor's spread  "
            + share(abs(r["improved"] - r["floor"]) < 3 * r["floor_spread"] for r in moderate)
        )
        print("parameters in their intervals  " + share(i for r in right for i in r["inside"]))
        matrix(moderate, picture)
    nothing = [r for r in results if r["kind"] == "nothing"]
    if nothing:
        print(
            "\nnothing hidden: complete       " + share(r["verdict"] == "complete" for r in nothing)
        )
        print("an effect added                " + share(bool(r["chosen"]) for r in nothing))
    pairs = [r for r in results if r["kind"] == "pairs"]
    if pairs:
        print(
            "\npairs: both found              "
            + share(set(r["hidden"]) <= set(r["chosen"]) for r in pairs)
        )
        for r in pairs:
            if not set(r["hidden"]) <= set(r["chosen"]):
                print("  %s: %s, %s" % (r["hidden"], r["chosen"], r["verdict"]))
    for name in cases.OUTSIDE:
        rows = [r for r in results if r["hidden"] == [name] and is_moderate(r)]
        if rows:
            depends = cases.OUTSIDE[name][2]
            print("\noutside the library: %s" % name)
            print(
                "verdict unexplained            "
                + share(r["verdict"] == "unexplained" for r in rows)
            )
            named = [bool(depends & set(r["where"][:2])) for r in rows if "where" in r]
            print("its variable among the first 2 " + share(named))
            print("chosen besides: %s" % sorted({n for r in rows for n in r["chosen"]}))
    for name in cases.AMBIGUOUS:
        rows = [r for r in results if r.get("ambiguous") == name]
        grouped = [r for r in rows if len(r["before"]["group"]) > 1]
        told = [r for r in rows if r not in grouped]
        if rows:
            print("\n%s: %d cases" % (name, len(rows)))
            print("told apart at once, rightly    " + share(_is_right(r, "before") for r in told))
            print("a group, and an experiment     " + share("after" in r for r in grouped))
            print("which tells apart, rightly     " + share(_is_right(r, "after") for r in grouped))
    seconds = [r["seconds"] for r in results]
    if seconds:
        print(
            "\nseconds a diagnosis on one core: median %.1f, most %.1f"
            % (np.median(seconds), max(seconds))
        )


def _is_right(r, when):
    told = r.get(when, {"chosen": None, "group": []})
    return told["chosen"] == r["hidden"] and len(told["group"]) == 1


def is_moderate(r):
    return r["nominal"] >= MODERATE * r["truth"]


def _first(r):
    return bool(r["ranked"]) and r["ranked"][0] == r["hidden"][0]


def _in_group(r):
    return _first(r) or r["hidden"][0] in r["group"] or bool(r["rivals"])


def _table(rows):
    print(
        "%-24s %9s %7s %7s %9s %9s  chosen otherwise"
        % ("hidden", "nominal/", "first", "group", "improved/", "intervals")
    )
    print("%-24s %9s %7s %7s %9s" % ("", "truth", "", "", "truth"))
    for effect in cases.STRENGTHS:
        of = [r for r in rows if r["hidden"] == [effect]]
        if not of:
            continue
        inside = [i for r in of if effect in r["chosen"] for i in r["inside"]]
        wrong = [",".join(r["chosen"]) or r["verdict"] for r in of if r["chosen"] != [effect]]
        print(
            "%-24s %9.2f %6.0f%% %6.0f%% %9.3f %8s  %s"
            % (
                effect,
                np.median([r["nominal"] / r["truth"] for r in of]),
                100 * np.mean([_first(r) for r in of]),
                100 * np.mean([_in_group(r) for r in of]),
                max(r["improved"] / r["truth"] for r in of),
                "%.0f%%" % (100 * np.mean(inside)) if inside else "-",
                "; ".join(wrong),
            )
        )


def matrix(results, picture):
    """Confusion matrix: hidden effect by the one that was ranked first."""
    names = list(cases.STRENGTHS)
    counts = np.zeros((len(names), len(names) + 1))
    for r in results:
        at = names.index(r["ranked"][0]) if r["chosen"] else len(names)
        counts[names.index(r["hidden"][0]), at] += 1
    shares = counts / np.maximum(1, counts.sum(axis=1))[:, None]
    print(
        "\nhidden (rows) by what was found first (columns, in the same order; last: nothing), percent"
    )
    for name, row in zip(names, shares):
        print("%-24s %s" % (name, " ".join("%3.0f" % (100 * x) if x else "  ." for x in row)))
    if picture:
        _draw(names, shares, picture)


def _draw(names, shares, picture):
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(9, 8))
    axis.imshow(shares, cmap="Blues", vmin=0, vmax=1)
    for i, j in zip(*np.nonzero(shares)):
        color = "white" if shares[i, j] > 0.5 else "black"
        axis.text(
            j, i, "%.0f" % (100 * shares[i, j]), ha="center", va="center", size=7, color=color
        )
    axis.set_xticks(range(len(names) + 1))
    axis.set_xticklabels(names + ["nothing"], rotation=90, fontsize=8)
    axis.set_yticks(range(len(names)))
    axis.set_yticklabels(names, fontsize=8)
    axis.set_xlabel("found first [% of cases]")
    axis.set_ylabel("hidden in the simulated craft")
    figure.tight_layout()
    figure.savefig(picture, dpi=110)


def calibrate(options):
    """Prints how strong the effects of STRENGTHS are: the nominal model's error by the truth's."""
    for effect in options.effects or list(cases.STRENGTHS) + list(cases.OUTSIDE):
        ratios = []
        for seed in range(1, options.seeds + 1):
            truth = cases.truth([effect], 1.0, seed)
            runs = cases.runs(truth, options.excitation[0], 1.0, seed)
            on_runs = study.Study(runs)
            model = _core.load_model(cases.MODEL)
            nominal = on_runs.fit(model, list(study.FIVE)).heldout.sum()
            ratios.append(nominal / on_runs.fit(truth, study.free_parameters(truth)).heldout.sum())
        ratio = float(np.median(ratios))
        factor = np.sqrt((1.5**2 - 1) / max(1e-3, ratio**2 - 1))
        print("%-24s ratio %.2f; for 1.5 multiply by %.3g" % (effect, ratio, factor), flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kind", nargs="+", default=KINDS, choices=KINDS)
    parser.add_argument("--effects", nargs="+")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--strength", nargs="+", default=["moderate"], choices=list(cases.LEVELS))
    parser.add_argument("--noise", nargs="+", type=float, default=[1.0])
    parser.add_argument("--excitation", nargs="+", default=["varied"], choices=["varied", "prbs"])
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    workers.takes_scheduler(parser)
    parser.add_argument("--results", default="build/hidden.jsonl")
    parser.add_argument("--picture")
    parser.add_argument("--calibrate", action="store_true")
    options = parser.parse_args()
    calibrate(options) if options.calibrate else bench(options)


if __name__ == "__main__":
    sys.exit(main())
