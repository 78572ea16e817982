#!/usr/bin/python3
"""How much the craft's own gyro and accelerometer add: effects hidden under a random push, with them and
without.

A case is a kind and a seed, as in hidden.py: one effect of the library at its strength times 1.1, four runs
to fit to and two held out. The same seeds give all kinds the same effects. Results go to a file of JSON
lines; an interrupted bench continues where it stopped.
"""

import sys

import numpy as np
from scipy import stats

import hidden_cases
import hidden_effects
import hidden_engine
import hidden_score
import resumed
from ground.analysis.likelihood import Likelihood
from ground.support import workers
from hidden_effects import in_turn

STRENGTH = 1.1
KINDS = {  # sigma of the push relative to full thrust, whether sensors were recorded
    "2% without": (0.02, False),
    "5% without": (0.05, False),
    "5% with": (0.05, True),
    "2% with": (0.02, True),
}


def case_of(kind, seed):
    """The hidden_cases.Case of a kind and a seed."""
    level, sensed = KINDS[kind]
    effect, _ = in_turn(seed, hidden_effects.strengths())
    case = hidden_cases.push(hidden_cases.plain("inertial", seed), level, level)
    case = hidden_cases.hide(case, [effect], STRENGTH, STRENGTH)
    case.imu = sensed
    return case


def run_case(job):
    """Result of one job (kind, seed), a dictionary for a line of JSON."""
    case = case_of(*job)
    found = hidden_engine.diagnose(*hidden_cases.record(case), hidden_cases.given_model(case))
    for parameter in found.get("parameters", []):
        parameter["true"] = hidden_cases.true_value(case, parameter["name"])
    return dict(case.describe(), kind=job[0], found=found)


def bench(options):
    """Runs the jobs without a result and prints the rates of all jobs."""
    seeds = range(options.seed_base, options.seed_base + (options.count or len(hidden_effects.strengths())))
    jobs = [(kind, seed) for seed in seeds for kind in KINDS]
    team = workers.Workers(processes=True, count=options.jobs)
    found = resumed.results(
        team,
        options.results,
        jobs,
        "%s %d".__mod__,
        lambda result: "%(kind)s %(seed)d" % result,
        run_case,
        options.hours,
    )
    for kind in KINDS:
        results = [r for r in found if r["kind"] == kind and "failed" not in r["found"]]
        questions = (("found", hidden_score.is_found), ("a false effect", hidden_score.has_false_effect))
        for what, ask in questions:
            yes = sum(map(bool, map(ask, results)))
            print("%-11s %-15s %s" % (kind, what, _share(yes, len(results))))
        inside = [one for r in results for one in hidden_score.intervals(r, False) if one is not None]
        print("%-11s %-15s %s" % (kind, "body inside 95%", _share(sum(inside), len(inside))))


def _share(yes, of):
    """A share with its 95% interval (Clopper and Pearson)."""
    low = stats.beta.ppf(0.025, yes, of - yes + 1) if yes else 0.0
    high = stats.beta.ppf(0.975, yes + 1, of - yes) if yes < of else 1.0
    return "%d of %d: %.0f%% (%.0f to %.0f%%)" % (yes, of, 100 * yes / max(1, of), 100 * low, 100 * high)


def information(effect, seed):
    """Standard deviations of an effect's parameters by the information at the truth, for each of KINDS."""
    found = []
    for kind in KINDS:
        case = case_of(kind, seed)
        runs, _ = hidden_cases.record(case)
        model = hidden_cases.given_model(case)
        like, values = Likelihood(runs, model), case.effects[effect]
        model.add_effect(effect)
        names = [*hidden_cases.FREE, *("%s.%s" % (effect, name) for name in values)]
        for name, value in zip(names, [*map(case.body.get, hidden_cases.FREE), *values.values()]):
            model.set_value(name, value)
        point = like.fit(model, []).point
        inverse = np.linalg.pinv(like.box.scores(point, names)["information"], rcond=1e-12, hermitian=True)
        found.append(np.sqrt(np.diag(inverse))[len(hidden_cases.FREE) :])
    return np.array(found)


def table(_):
    """Prints each effect's standard deviations, relative to those at 2% without sensors."""
    print("%-24s %s" % ("", "  ".join(KINDS)))
    for seed, effect in enumerate(hidden_effects.strengths(), 1):
        ratios = information(effect, seed)
        ratios = np.sqrt(np.mean((ratios / ratios[:1]) ** 2, axis=1))
        print("%-24s %s" % (effect, "  ".join("%9.2f" % one for one in ratios)), flush=True)


def main():
    parser = resumed.parser(__doc__, "build/inertial.jsonl")
    parser.add_argument("--information", action="store_true", help="print what the runs say of each effect")
    options = parser.parse_args()
    return resumed.status(table if options.information else bench, options)


if __name__ == "__main__":
    sys.exit(main())
