"""identify fit: a model's parameters from recordings."""
import datetime
import os
import shlex
import sys

import numpy as np

from ground import _core, comparison, files
from ground.errors import IdentifyError
from ground.verbs import common

NAME = "fit"
SUMMARY = "fits a model's parameters to recordings by simulation error"
FREE = ["I_z", "X_u", "Y_v", "N_r", "k"]


def configure(parser):
    common.reads_bags(parser)
    common.takes_spans(parser)
    parser.add_argument(
        "--model", metavar="M.yaml", required=True, help="model, with the start values"
    )
    parser.add_argument("-o", "--output", metavar="FITTED.yaml", required=True)
    parser.add_argument(
        "--free", metavar="NAME", nargs="+", default=FREE, help="free parameters (%(default)s)"
    )
    parser.add_argument(
        "--objective",
        choices=["least-squares", "thesis"],
        default="least-squares",
        help="robust weighted least squares, or mean absolute error (3.4)",
    )
    parser.add_argument(
        "--window",
        type=common.positive,
        default=comparison.WINDOW,
        help="length of windows [s] (%(default)s)",
    )
    parser.add_argument(
        "--starts",
        type=common.count,
        default=1,
        metavar="N",
        help="descend from the model's values and N - 1 others, keep the best (%(default)s)",
    )
    parser.add_argument("--each", action="store_true", help="also fit every run by itself")
    parser.add_argument("--force", action="store_true", help="overwrite the model file")


def run(arguments):
    files.refuse_existing(arguments.output, arguments.force)
    model = common.load(arguments.model)
    runs = common.prepare(arguments, model)[1]
    result = _solve(runs, model, arguments)
    fitted = result["model"]
    try:
        before, after = comparison.error(runs, model), comparison.error(runs, fitted)
        thesis = [comparison.mean_thesis_objective(runs, m) for m in (model, fitted)]
    except RuntimeError as error:
        raise IdentifyError(str(error))

    fitted.provenance.date = datetime.datetime.now(datetime.timezone.utc).isoformat(
        timespec="seconds"
    )
    fitted.provenance.command = "identify " + " ".join(map(shlex.quote, sys.argv[1:]))
    fitted.provenance.bags = [os.path.basename(b) for b in arguments.bags]
    fitted.provenance.error_before = {"fit": before}
    fitted.provenance.error_after = {"fit": after}
    fitted.provenance.confidence_95 = {p["name"]: p["ci95"] for p in result["parameters"]}
    try:
        _core.save_model(fitted, arguments.output, arguments.force)
    except RuntimeError as error:
        raise IdentifyError(str(error))

    common.say(
        arguments, "%-18s %12s %12s   %s" % ("parameter", "start", "estimate", "95% interval")
    )
    for p in result["parameters"]:
        note = "  at its bound" if p["at_bound"] else ""
        note += "" if p["identified"] else "  these data do not tell"
        common.say(
            arguments,
            "%-18s %12.4g %12.4g   [%.4g, %.4g] %s%s"
            % (p["name"], p["start"], p["value"], p["ci95"][0], p["ci95"][1], p["unit"], note),
        )
    common.say(arguments, "error over windows of 1.5 s: %.4f before, %.4f after" % (before, after))
    if None not in thesis:
        common.say(arguments, "(3.4) over the first 4 s: %.4f before, %.4f after" % tuple(thesis))
    if arguments.objective == "thesis":
        common.say(
            arguments,
            "(3.4) as fitted: %.4f before, %.4f after"
            % (result["objective_before"], result["objective_after"]),
        )
    if arguments.starts > 1:
        common.say(
            arguments,
            "%d of %d starts came to this end" % (result["starts_at_best"], arguments.starts),
        )
    if not result["converged"]:
        print("identify fit: not converged: %s" % result["message"], file=sys.stderr)
    for first, second, value in _entangled(result):
        common.say(
            arguments,
            "%s and %s are hard to tell apart here (correlation %.2f)" % (first, second, value),
        )
    each = _fit_each(runs, model, arguments) if arguments.each else []
    common.say(arguments, "written to %s" % arguments.output)
    return {
        "model": arguments.output,
        "parameters": {
            p["name"]: {k: v for k, v in p.items() if k != "name"} for p in result["parameters"]
        },
        "error": {"before": before, "after": after},
        "thesis_objective": {"before": thesis[0], "after": thesis[1]},
        "objective": {"before": result["objective_before"], "after": result["objective_after"]},
        "starts": {"tried": arguments.starts, "at_best": result["starts_at_best"]},
        "condition": result["condition"],
        "converged": result["converged"],
        "runs": each,
    }


def _solve(runs, model, arguments):
    objective = getattr(_core.Objective, arguments.objective.replace("-", "_"))
    try:
        problem = comparison.problem(runs, arguments.window)[0]
        return problem.fit(model, arguments.free, objective, arguments.starts)
    except (ValueError, RuntimeError) as error:
        raise IdentifyError(str(error))


def _entangled(result):
    names = [p["name"] for p in result["parameters"]]
    correlation = np.array(result["correlation"])
    for i in range(len(names)):
        for j in range(i):
            if abs(correlation[i, j]) > 0.95:
                yield names[j], names[i], correlation[i, j]


def _fit_each(runs, model, arguments):
    """One row a run, then mean and spread, as in the thesis's table 3.2."""
    rows = []
    for run in runs:
        result = _solve([run], model, arguments)
        values = {p["name"]: p["value"] for p in result["parameters"]}
        rows.append({"run": run.name, "parameters": values, "objective": result["objective_after"]})
    width = max(len(r["run"]) for r in rows)
    common.say(arguments)
    common.say(
        arguments,
        "%-*s " % (width, "run")
        + "".join("%12s" % n for n in arguments.free)
        + "%12s" % "objective",
    )
    for row in rows:
        values = [row["parameters"][n] for n in arguments.free] + [row["objective"]]
        common.say(arguments, "%-*s " % (width, row["run"]) + "".join("%12.4g" % v for v in values))
    table = np.array([[r["parameters"][n] for n in arguments.free] for r in rows])
    for name, values in (
        ("mean", table.mean(axis=0)),
        ("spread", table.std(axis=0, ddof=1) if len(rows) > 1 else 0 * table[0]),
    ):
        common.say(arguments, "%-*s " % (width, name) + "".join("%12.4g" % v for v in values))
    return rows
