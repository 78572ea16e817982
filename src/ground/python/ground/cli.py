"""The identification tool's command line: rosrun ground identify VERB."""
import argparse
import datetime
import json
import os
import shlex
import sys

import numpy as np

from ground import _core, comparison, files, quality
from ground import recording as recordings
from ground.errors import IdentifyError

FREE = ["I_z", "X_u", "Y_v", "N_r", "k"]


def main(argv=None):
    """Runs one verb; exit status 0 done, 1 could not, 2 bad usage."""
    arguments = _parser().parse_args(argv)
    try:
        result = arguments.run(arguments)
    except IdentifyError as error:
        print("identify %s: %s" % (arguments.verb, error), file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("identify %s: interrupted" % arguments.verb, file=sys.stderr)
        return 1
    if arguments.json:
        json.dump(files.plain(result), sys.stdout, indent=1, allow_nan=False)
        print()
    return 0


def _parser():
    parser = argparse.ArgumentParser(
        prog="identify", description="Identifies the hovercraft from recordings."
    )
    verbs = parser.add_subparsers(dest="verb", metavar="VERB")
    verbs.required = True

    def verb(name, run, summary):
        sub = verbs.add_parser(name, help=summary, description=summary)
        sub.set_defaults(run=run)
        sub.add_argument("--json", action="store_true", help="print the result as JSON")
        return sub

    def reads_bags(sub):
        sub.add_argument("bags", metavar="BAG", nargs="+", help="recorded run")
        sub.add_argument(
            "--axes", default="x, z, -y", help="world_ned x, y, z in the mocap's axes (%(default)s)"
        )

    def spans(sub):
        sub.add_argument(
            "--from", dest="start", type=_seconds, default=0.0, help="start in the usable span [s]"
        )
        sub.add_argument("--to", dest="end", type=_seconds, help="end in the usable span [s]")

    sub = verb(
        "import", _import, "CSV written by rostopic echo -p, to a bag that the other verbs read"
    )
    sub.add_argument(
        "controls", metavar="CONTROLS.csv", help="left, right, lift as field.point.x, y, z"
    )
    sub.add_argument("pose", metavar="POSE.csv", help="x, y [m], psi [rad] as field.point.x, y, z")
    sub.add_argument("-o", "--output", metavar="RUN.bag", required=True)
    sub.add_argument("--force", action="store_true", help="overwrite the bag")

    sub = verb("info", _info, "what is in recordings, and what is odd about it")
    reads_bags(sub)

    sub = verb("fit", _fit, "fits a model's parameters to recordings by simulation error")
    reads_bags(sub)
    spans(sub)
    sub.add_argument(
        "--model", metavar="M.yaml", required=True, help="model, with the start values"
    )
    sub.add_argument("-o", "--output", metavar="FITTED.yaml", required=True)
    sub.add_argument(
        "--free", metavar="NAME", nargs="+", default=FREE, help="free parameters (%(default)s)"
    )
    sub.add_argument(
        "--objective",
        choices=["least-squares", "thesis"],
        default="least-squares",
        help="robust weighted least squares, or mean absolute error (3.4)",
    )
    sub.add_argument(
        "--window",
        type=_positive,
        default=comparison.WINDOW,
        help="length of windows [s] (%(default)s)",
    )
    sub.add_argument(
        "--starts",
        type=_count,
        default=1,
        metavar="N",
        help="descend from the model's values and N - 1 others, keep the best (%(default)s)",
    )
    sub.add_argument("--each", action="store_true", help="also fit every run by itself")
    sub.add_argument("--force", action="store_true", help="overwrite the model file")

    sub = verb("compare", _compare, "models against recordings: errors and pictures")
    reads_bags(sub)
    spans(sub)
    sub.add_argument(
        "--model", metavar="M.yaml", action="append", required=True, help="once for each model"
    )
    sub.add_argument("-o", "--output", metavar="DIR", required=True, help="folder for results")
    sub.add_argument("--force", action="store_true", help="overwrite results in the folder")
    return parser


def _positive(text):
    value = float(text)
    if not value > 0 or not np.isfinite(value):
        raise argparse.ArgumentTypeError("%s is not positive" % text)
    return value


def _count(text):
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError("%s is not positive" % text)
    return value


def _seconds(text):
    value = float(text)
    if not np.isfinite(value) or value < 0:
        raise argparse.ArgumentTypeError("%s is not a time since the start [s]" % text)
    return value


def _say(arguments, text=""):
    if not arguments.json:
        print(text)


def _read(arguments):
    found = []
    for path in arguments.bags:
        try:
            found.append(recordings.read_bag(path, arguments.axes))
        except ValueError as error:
            raise IdentifyError("--axes: %s" % error)
        for warning in found[-1].warnings:
            print("%s: %s" % (path, warning), file=sys.stderr)
    names = [r.name for r in found]
    for recording, path in zip(found, arguments.bags):
        if names.count(recording.name) > 1:
            recording.name = os.path.splitext(path)[0].strip("./").replace(os.sep, "_")
    if len({r.name for r in found}) < len(found):
        raise IdentifyError("the same bag is given twice")
    return found


def _load(path):
    try:
        return _core.load_model(path)
    except RuntimeError as error:
        raise IdentifyError(str(error))


def _import(arguments):
    counts = recordings.import_csv(
        arguments.controls, arguments.pose, arguments.output, arguments.force
    )
    _say(
        arguments,
        "%s: %d poses, %d commands" % (arguments.output, counts["pose"], counts["controls"]),
    )
    return {"bag": arguments.output, "messages": counts}


def _info(arguments):
    described = [quality.describe(r) for r in _read(arguments)]
    for d in described:
        poses, controls = d["poses"], d["controls"]
        rows = [
            ("source", d["source"]),
            ("duration", "%.2f s, usable %.2f s" % (d["duration"], d["usable"]["duration"])),
            ("poses", "%d at %.1f Hz" % (poses["count"], poses["rate"])),
            (
                "commands",
                "%d at %.1f Hz, %d changes, inputs %g to %g"
                % (controls["count"], controls["rate"], controls["changes"], *controls["levels"]),
            ),
            ("commands start", _lag(controls["after_poses"], "the poses")),
            ("poses end", _lag(-controls["poses_end_early"], "the commands")),
        ]
        if poses["rest"] is not None:
            rows.append(("rest at the start", "%.2f s" % poses["rest"]))
        longest = max((g["length"] for g in poses["gaps"]), default=0)
        findings = [
            (len(poses["gaps"]), "gaps above 50 ms, the longest %.2f s" % longest),
            (poses["duplicate_stamps"], "repeated stamps"),
            (poses["late_stamps"], "stamps out of order"),
            (
                poses["bursts"],
                "poses within 1 ms of the one before: a poll that re-stamps a faster mocap"
                if poses["polled"]
                else "poses within 1 ms of the one before",
            ),
            (poses["heading_wraps"], "jumps of the heading by 2 pi or by a flip"),
            (poses["heading_flips"], "single frames with the heading's sign flipped, undone"),
        ]
        print_rows = [("", "%d %s" % f) for f in findings if f[0]]
        _say(arguments, d["name"])
        for name, value in rows + print_rows:
            _say(arguments, "  %-18s %s" % (name, value))
    return described


def _lag(seconds, what):
    return "%.3f s %s %s" % (abs(seconds), "after" if seconds >= 0 else "before", what)


def _runs(arguments, found, model):
    if not model.input_max > 0:
        raise IdentifyError("the model's input_max is not positive")
    return [quality.make_run(r, model, arguments.start, arguments.end) for r in found]


def _solve(runs, model, arguments):
    objective = getattr(_core.Objective, arguments.objective.replace("-", "_"))
    try:
        problem = comparison.problem(runs, arguments.window)[0]
        return problem.fit(model, arguments.free, objective, arguments.starts)
    except (ValueError, RuntimeError) as error:
        raise IdentifyError(str(error))


def _fit(arguments):
    files.refuse_existing(arguments.output, arguments.force)
    model = _load(arguments.model)
    runs = _runs(arguments, _read(arguments), model)
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

    _say(arguments, "%-18s %12s %12s   %s" % ("parameter", "start", "estimate", "95% interval"))
    for p in result["parameters"]:
        note = "  at its bound" if p["at_bound"] else ""
        note += "" if p["identified"] else "  these data do not tell"
        _say(
            arguments,
            "%-18s %12.4g %12.4g   [%.4g, %.4g] %s%s"
            % (p["name"], p["start"], p["value"], p["ci95"][0], p["ci95"][1], p["unit"], note),
        )
    _say(arguments, "error over windows of 1.5 s: %.4f before, %.4f after" % (before, after))
    if None not in thesis:
        _say(arguments, "(3.4) over the first 4 s: %.4f before, %.4f after" % tuple(thesis))
    if arguments.objective == "thesis":
        _say(
            arguments,
            "(3.4) as fitted: %.4f before, %.4f after"
            % (result["objective_before"], result["objective_after"]),
        )
    if arguments.starts > 1:
        _say(
            arguments,
            "%d of %d starts came to this end" % (result["starts_at_best"], arguments.starts),
        )
    if not result["converged"]:
        print("identify fit: not converged: %s" % result["message"], file=sys.stderr)
    for first, second, value in _entangled(result):
        _say(
            arguments,
            "%s and %s are hard to tell apart here (correlation %.2f)" % (first, second, value),
        )
    each = _fit_each(runs, model, arguments) if arguments.each else []
    _say(arguments, "written to %s" % arguments.output)
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
    _say(arguments)
    _say(
        arguments,
        "%-*s " % (width, "run")
        + "".join("%12s" % n for n in arguments.free)
        + "%12s" % "objective",
    )
    for row in rows:
        values = [row["parameters"][n] for n in arguments.free] + [row["objective"]]
        _say(arguments, "%-*s " % (width, row["run"]) + "".join("%12.4g" % v for v in values))
    table = np.array([[r["parameters"][n] for n in arguments.free] for r in rows])
    for name, values in (
        ("mean", table.mean(axis=0)),
        ("spread", table.std(axis=0, ddof=1) if len(rows) > 1 else 0 * table[0]),
    ):
        _say(arguments, "%-*s " % (width, name) + "".join("%12.4g" % v for v in values))
    return rows


def _label(path, others):
    """A model's name in tables: its file's, with the folder where two files share it."""
    name = os.path.splitext(os.path.basename(path))[0]
    shared = sum(os.path.splitext(os.path.basename(o))[0] == name for o in others) > 1
    return os.path.splitext(path)[0] if shared else name


def _compare(arguments):
    from ground import plots

    models = [(_label(p, arguments.model), _load(p)) for p in arguments.model]
    if len({label for label, _ in models}) < len(models):
        raise IdentifyError("the same model is given twice")
    found = _read(arguments)
    try:
        os.makedirs(arguments.output, exist_ok=True)
    except OSError as error:
        raise IdentifyError("%s: cannot be made a folder (%s)" % (arguments.output, error))
    report = os.path.join(arguments.output, "compare.json")
    pictures = {r.name: os.path.join(arguments.output, r.name + ".png") for r in found}
    for path in [report] + list(pictures.values()):
        files.refuse_existing(path, arguments.force)

    result = {
        "schema": "ground/compare/1",
        "models": dict(zip((m for m, _ in models), arguments.model)),
        "runs": [],
    }
    width = max(len(label) for label, _ in models)
    for recording in found:
        drawn, numbers_of = [], {}
        for label, model in models:
            run = _runs(arguments, [recording], model)[0]
            try:
                numbers, pieces = comparison.compare_run(run, model)
            except (ValueError, RuntimeError) as error:
                raise IdentifyError("%s with %s: %s" % (recording.name, label, error))
            drawn.append((label, numbers, pieces))
            numbers_of[label] = numbers
        start = quality.usable_span(recording, quality.clean(recording))[0]
        inputs = np.column_stack([recording.control_times - start, recording.controls])
        plots.comparison(pictures[recording.name], run, inputs, drawn, arguments.force)
        result["runs"].append(
            {"name": recording.name, "models": numbers_of, "picture": pictures[recording.name]}
        )
        _say(arguments, recording.name)
        _say(
            arguments,
            "  %-*s %8s %10s %22s" % (width, "model", "error", "(3.4) 4 s", "fit u, v, r [%]"),
        )
        for label, n, _ in drawn:
            thesis = "-" if n["thesis_objective"] is None else "%.3f" % n["thesis_objective"]
            fits = ", ".join("%.0f" % n["fit_percent"][c] for c in comparison.CHANNELS)
            _say(arguments, "  %-*s %8.3f %10s %22s" % (width, label, n["error"], thesis, fits))
        _say(arguments, "  picture: %s" % pictures[recording.name])
    files.write_json(report, result, arguments.force)
    _say(arguments, "numbers: %s" % report)
    return result
