#!/usr/bin/python3
"""Measures controllers in closed loop: nominal, with noise and delay, and with a wrong model; then with
each effect hidden in the craft, before and after diagnose improves the model."""

import argparse
import json
import os
import subprocess
import sys
import tempfile

import numpy as np

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import hidden_effects  # noqa: E402
from ground import _core  # noqa: E402
from ground.simulation import gains, tracking, tuning  # noqa: E402

REFERENCES = {"circle": dict(rate_of_turn=0.63), "sinusoid": {}, "rhodonea": {}, "line": {}}
CONTROLLERS = [
    ("backstepping (4.11)", "TrajectoryTracking", "thesis_4_11.yaml"),
    ("backstepping (4.12)", "TrajectoryTracking", "thesis_4_12.yaml"),
    ("backstepping tuned", "TrajectoryTracking", "tiny_whoover.yaml"),
    ("predictive", "ModelPredictive", None),
]


def choices():
    for label, kind, file in CONTROLLERS:
        yield label, gains.choice(kind, file and os.path.join(ROOT, "cfg", "gains", file))


def tables(model, starts, seed):
    """Dictionaries with controller, reference, condition, and the numbers of tracking.pooled."""
    tasks = {kind: tracking.task(kind, **settings) for kind, settings in REFERENCES.items()}
    for cell in tuning.cells(tasks, model):
        for label, choice in choices():
            runs = tracking.many(
                cell.truth,
                model,
                choice,
                cell.task,
                tracking.starts(starts, seed),
                cell.conditions,
                seed,
                max_error=np.inf,
            )
            yield dict(
                tracking.pooled(runs), controller=label, reference=cell.reference, condition=cell.condition
            )


def anywhere(model, count, seed):
    """Share of random starts at rest (within 3 m, any heading) from which the craft reaches the circle."""
    task = tracking.task("circle", rate_of_turn=0.63, settled=20.0, until=22.0)
    places = np.random.default_rng(seed).uniform(-1, 1, (count, 3)) * [3.0, 3.0, np.pi]
    starts = [(place, np.zeros(3)) for place in places]
    runs = tracking.many(model, model, gains.choice("ModelPredictive"), task, starts)
    return sum(run.numbers["rms"] < 5e-3 for run in runs) / count


def identify(*arguments):
    result = subprocess.run(
        ["rosrun", "ground", "identify"] + [str(a) for a in arguments] + ["--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        universal_newlines=True,
    )
    if result.returncode != 0:
        sys.exit("identify %s: %s" % (arguments[0], result.stderr))
    return json.loads(result.stdout)


def hidden(model_path, effect, values, folder):
    """The effects that diagnose finds in a craft with an effect, and rms errors of the predictive controller
    [m] by reference on this craft: with the fitted nominal model and with the model of diagnose."""
    truth = _core.load_model(model_path)
    truth.add_effect(effect)
    for name, value in values.items():
        truth.set_value("%s.%s" % (effect, name), value)
    sealed = os.path.join(folder, effect + ".yaml")
    with open(sealed, "w") as file:
        file.write(truth.format())
    bags = []
    for seed in (1, 2, 3):
        bags.append(os.path.join(folder, "%s_%d.bag" % (effect, seed)))
        drive = ["--input", "prbs", "--duration", 10, "--seed", seed, "--start-pose", 0, 0, seed]
        identify("simulate", "--model", sealed, "-o", bags[-1], *drive)
    fitted = os.path.join(folder, effect + "_fitted.yaml")
    identify("fit", *bags, "--model", model_path, "-o", fitted)
    diagnosis = os.path.join(folder, effect)
    report = identify("diagnose", *bags, "--model", fitted, "-o", diagnosis)
    improved = os.path.join(diagnosis, "improved.yaml")
    errors = {}
    for name, believed in (("before", fitted), ("after", improved)):
        for kind in ("circle", "rhodonea", "sinusoid"):
            task = tracking.task(kind)
            run = tracking.run(truth, _core.load_model(believed), gains.choice("ModelPredictive"), task)
            errors.setdefault(kind, {})[name] = run.numbers["rms"]
    return report["improved"]["effects"], errors


ROW = "%-22s%-11s%-13s%30s%11s%11s%8s%18s%18s"


def print_tables(model, starts, seed):
    """Prints the table of controllers and references row by row."""
    head = "controller", "reference", "condition", "rms 5/50/95% [mm]", "max [mm]", "sat. [%]", "effort"
    print(ROW % (*head, "ms, 50/99.9%", "after a stop [mm]"))
    for row in tables(model, starts, seed):
        q, ms = row["rms_quantiles"], row["compute_ms"]
        numbers = (
            "%.2f" % (1e3 * row["max"]),
            "%.1f" % (100 * row["saturated_fraction"]),
            "%.3f" % row["effort"],
        )
        rms = "%.2f / %.2f / %.2f" % tuple(1e3 * q[k] for k in ("p05", "median", "p95"))
        after = "%.2f" % (1e3 * row["after_stop_max"]) if row["reference"] == "line" else ""
        ends = "%.3f / %.3f" % (ms["median"], ms["p999"]), after
        names = row["controller"], row["reference"], row["condition"]
        print(ROW % (*names, rms, *numbers, *ends), flush=True)
    share = 100 * anywhere(model, 200, seed)
    print("predictive, from rest within 3 m at any heading: reaches the circle in %.1f%% of 200" % share)


def print_effects(model, effects, strength):
    """Prints the errors with hidden effects before and after a diagnosis."""
    with tempfile.TemporaryDirectory() as folder:
        for effect in effects:
            sizes = hidden_effects.STRENGTHS[effect].items()
            values = {n: hidden_effects.scaled(effect, n, s, strength) for n, s in sizes}
            found, errors = hidden(model, effect, values, folder)
            said = "%s %.3f -> %.3f mm"
            each = [said % (kind, 1e3 * e["before"], 1e3 * e["after"]) for kind, e in errors.items()]
            print("%-24s found %-44s" % (effect, ", ".join(found) or "-") + "; ".join(each), flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", default=os.path.join(ROOT, "cfg", "hovercraft", "tiny_whoover_4_1.yaml"))
    parser.add_argument("--starts", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--effects", nargs="*", help="effects to hide (all); none if empty")
    parser.add_argument("--only-effects", action="store_true")
    parser.add_argument("--strength", type=float, default=5.0,
                        help="strength of the effects relative to bench-hidden (5)")  # fmt: skip
    arguments = parser.parse_args()
    if not arguments.only_effects:
        print_tables(_core.load_model(arguments.model), arguments.starts, arguments.seed)
    effects = hidden_effects.strengths() if arguments.effects is None else arguments.effects
    print_effects(arguments.model, effects, arguments.strength)


if __name__ == "__main__":
    main()
