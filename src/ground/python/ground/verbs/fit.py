"""identify fit: a model's parameters from recordings."""
import sys

import numpy as np

from ground import _core, files
from ground.analysis import comparison, identifiability, study, validation
from ground.errors import GroundError
from ground.recordings import quality, windows
from ground.verbs import common

NAME = "fit"
SUMMARY = "fits a model's parameters to recordings by simulation error"
FREE = list(study.FIVE)


def configure(parser):
    common.reads_bags(parser)
    common.takes_spans(parser)
    common.tells_progress(parser)
    parser.add_argument(
        "--model", metavar="M.yaml", required=True, help="model, with the start values"
    )
    parser.add_argument("-o", "--output", metavar="FITTED.yaml", required=True)
    common.holds_out(parser)
    parser.add_argument(
        "--free",
        metavar="NAME",
        nargs="+",
        default=FREE,
        help="free parameters (%s)" % " ".join(FREE),
    )
    parser.add_argument(
        "--objective",
        choices=["least-squares", "thesis"],
        default="least-squares",
        help="robust weighted least squares (default), or mean absolute error (3.4)",
    )
    parser.add_argument(
        "--target",
        choices=["velocities", "poses"],
        default="velocities",
        help="what is simulated and measured: smoothed velocities (default), or raw poses, which is "
        "sharper where the model is right",
    )
    parser.add_argument(
        "--window",
        type=common.positive,
        default=windows.WINDOW,
        help="length of windows [s] (%(default)s)",
    )
    parser.add_argument(
        "--starts",
        type=common.count,
        default=1,
        metavar="N",
        help="descend from the model's values and N - 1 others, keep the best (%(default)s)",
    )
    parser.add_argument(
        "--block",
        type=common.positive,
        default=validation.BLOCK,
        help="length of the blocks of time that are held out, in %d parts at most [s] (%%(default)s)"
        % validation.FOLDS,
    )
    parser.add_argument("--force", action="store_true", help="overwrite the model file")


def run(arguments):
    files.refuse_existing(arguments.output, arguments.force)
    model = common.load(arguments.model)
    common.progress(arguments, "reading the recordings")
    prepared, runs = common.prepare(arguments, model)
    held = common.held_out(arguments, model, prepared)[1]

    common.progress(arguments, "fitting %s" % model.name)
    cut = windows.cut(runs, arguments.window)
    result = _fit(arguments, runs, model, cut, arguments.starts)
    fitted = result["model"]

    def refit(part, initial):
        # From near by, and with the same outliers: so a refit costs a few steps.
        width = result["width"] if np.isfinite(result["width"]) else 0.0
        return _fit(arguments, runs, fitted, part, near=True, width=width, initial=initial)

    def say(text):
        common.progress(arguments, text)

    say("holding out blocks of time")
    errors = {
        "before": windows.error(runs, model),
        "after": windows.error(runs, fitted),
        "heldout_runs": None,
        "blocks": _blocks(
            validation.leave_blocks_out(
                runs, (model, fitted), refit, arguments.block, arguments.window, say=say
            )
        ),
        "holdout": None,
    }
    if held:
        errors["holdout"] = {
            "before": windows.error(held, model),
            "after": windows.error(held, fitted),
        }
    each = []
    if len(runs) > 1:
        say("holding out runs")
        each = _each(arguments, runs, result, refit, say)
        samples = [len(r.times) for r in runs]
        errors["heldout_runs"] = float(
            np.average([e["heldout_error"] for e in each], weights=samples)
        )
    report = {
        "model": arguments.output,
        "parameters": {
            p["name"]: {k: v for k, v in p.items() if k != "name"} for p in result["parameters"]
        },
        "error": errors,
        "thesis_objective": {
            "before": comparison.mean_thesis_objective(runs, model),
            "after": comparison.mean_thesis_objective(runs, fitted),
        },
        "objective": result["objective"],
        "starts": {"tried": arguments.starts, "at_best": result["starts_at_best"]},
        "condition": result["condition"],
        "weak": identifiability.weak_directions(result),
        "converged": result["converged"],
        "runs": each,
        "same_inputs": quality.same_inputs(prepared),
    }
    _write(arguments, fitted, report)
    if not result["converged"]:
        print("identify fit: not converged: %s" % result["message"], file=sys.stderr)
    for line in _lines(arguments, runs, result, report):
        common.say(arguments, line)
    return report


def _fit(arguments, runs, model, cut, starts=1, **options):
    objective = getattr(_core.Objective, arguments.objective.replace("-", "_"))
    target = getattr(_core.Target, arguments.target)
    try:
        problem = windows.problem(runs, cut, target)
        return problem.fit(model, arguments.free, objective, starts, **options)
    except (ValueError, RuntimeError) as error:
        raise GroundError(str(error))


def _each(arguments, runs, result, refit, say):
    """Each run fitted by itself, and held out of a fit to others (the thesis's table 3.2)."""
    rows = []
    held_out = validation.leave_runs_out(runs, refit, result, arguments.window, say=say)
    for i, (others, error) in enumerate(held_out):
        run = [runs[i]]
        alone = _fit(arguments, run, result["model"], windows.cut(run, arguments.window))
        rows.append(
            {
                "run": runs[i].name,
                "parameters": {p["name"]: p["value"] for p in alone["parameters"]},
                "ci95": {p["name"]: p["ci95"] for p in alone["parameters"]},
                "error": windows.error([runs[i]], alone["model"]),
                "heldout_error": error,
                "disagrees_in": validation.disagreements(alone, others),
            }
        )
    return rows


def _write(arguments, fitted, report):
    errors = report["error"]
    before, after = {"fit": errors["before"]}, {"fit": errors["after"]}
    if errors["blocks"]:
        before["blocks"], after["blocks"] = errors["blocks"]["before"], errors["blocks"]["heldout"]
    if errors["holdout"]:
        before["heldout"], after["heldout"] = (errors["holdout"][k] for k in ("before", "after"))
    common.write_model(arguments, fitted, before, after, report["parameters"])


def _lines(arguments, runs, result, report):
    """What is printed: parameters, errors, runs one by one, and what is not identifiable."""
    yield "%-18s %12s %12s   %s" % ("parameter", "start", "estimate", "95% interval")
    for p in result["parameters"]:
        interval = "[%.4g, %.4g]" % p["ci95"] if p["identified"] else "not identifiable from these data"
        yield "%-18s %12.4g %12.4g   %s %s" % (
            p["name"],
            p["start"],
            p["value"],
            interval,
            p["unit"] if p["identified"] else "",
        )
    yield ""
    yield "%-50s %8s %8s %9s" % ("error over windows of 1.5 s", "start", "fitted", "held out")
    for words, values in _errors(arguments, report):
        yield "  %-48s %8s %8s %9s" % (
            (words,) + tuple("" if v is None else "%.3f" % v for v in values)
        )
    if report["runs"]:
        yield ""
        yield from _table(arguments.free, report["runs"])
    same = sorted({name for pair in report["same_inputs"] for name in pair})
    if same:
        yield "the same inputs drove %s: as a test of each other they are kind" % ", ".join(same)
    yield from identifiability.sentences(result)
    if arguments.starts > 1:
        yield "%d of %d starts came to this end" % (report["starts"]["at_best"], arguments.starts)
    yield "written to %s" % arguments.output


def _errors(arguments, report):
    """What the error is of, and the error of the start values, of the fit, and held out."""
    errors, thesis = report["error"], report["thesis_objective"]
    several = "all runs; held out: each by a fit to the others"
    if len(report["runs"]) > validation.RUN_FOLDS:
        several = "all runs; held out: in %d parts" % validation.RUN_FOLDS
    yield several if report["runs"] else "the run", (
        errors["before"],
        errors["after"],
        errors["heldout_runs"],
    )
    if errors["blocks"]:
        blocks = errors["blocks"]
        how = ", each by a fit to the rest"
        if blocks["folds"] < blocks["count"]:
            how = " in %d parts, by fits to the rest" % blocks["folds"]
        yield "blocks of %g s%s" % (arguments.block, how), (
            blocks["before"],
            blocks["after"],
            blocks["heldout"],
        )
    if errors["holdout"]:
        before, after = errors["holdout"].values()
        yield "the runs given with --holdout", (before, None, after)
    if thesis["after"] is not None:
        yield "(3.4) over the first 4 s", (thesis["before"], thesis["after"], None)


def _blocks(found):
    if found is None:
        return None
    before, after = found["models"]
    return {
        "before": before,
        "after": after,
        "heldout": found["heldout"],
        "count": found["blocks"],
        "folds": found["folds"],
    }


def _table(names, rows):
    """One row a run, then mean and spread, as in the thesis's table 3.2."""
    width = max(len(r["run"]) for r in rows + [{"run": "spread"}])
    head = "".join("%11s" % n.split(".")[-1] for n in names)
    yield "%-*s %s%9s%10s" % (width, "run", head, "error", "held out")
    for row in rows:
        values = "".join("%11.4g" % row["parameters"][n] for n in names)
        yield "%-*s %s%9.3f%10.3f" % (
            width,
            row["run"],
            values,
            row["error"],
            row["heldout_error"],
        )
    table = np.array([[r["parameters"][n] for n in names] for r in rows])
    for name, values in (("mean", table.mean(axis=0)), ("spread", table.std(axis=0, ddof=1))):
        yield "%-*s %s" % (width, name, "".join("%11.4g" % v for v in values))
    for row in rows:
        if row["disagrees_in"]:
            yield "%s disagrees with the others in %s: look at it before pooling them" % (
                row["run"],
                ", ".join(row["disagrees_in"]),
            )
