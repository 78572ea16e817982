"""identify compare: models against recordings."""
import os

from ground import comparison, files, quality
from ground.errors import IdentifyError
from ground.verbs import common

NAME = "compare"
SUMMARY = "models against recordings: errors and pictures"


def configure(parser):
    common.reads_bags(parser)
    common.takes_spans(parser)
    parser.add_argument(
        "--model", metavar="M.yaml", action="append", required=True, help="once for each model"
    )
    parser.add_argument("-o", "--output", metavar="DIR", required=True, help="folder for results")
    parser.add_argument("--force", action="store_true", help="overwrite results in the folder")


def run(arguments):
    from ground import plots

    models = [(_label(p, arguments.model), common.load(p)) for p in arguments.model]
    if len({label for label, _ in models}) < len(models):
        raise IdentifyError("the same model is given twice")
    found = common.read(arguments)
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
        prepared = quality.Run(recording)
        for label, model in models:
            run = common.data(arguments, prepared, model)
            try:
                numbers, pieces = comparison.compare_run(run, model)
            except (ValueError, RuntimeError) as error:
                raise IdentifyError("%s with %s: %s" % (recording.name, label, error))
            drawn.append((label, numbers, pieces))
            numbers_of[label] = numbers
        plots.comparison(pictures[recording.name], run, prepared.inputs(), drawn, arguments.force)
        result["runs"].append(
            {"name": recording.name, "models": numbers_of, "picture": pictures[recording.name]}
        )
        common.say(arguments, recording.name)
        common.say(
            arguments,
            "  %-*s %8s %10s %22s" % (width, "model", "error", "(3.4) 4 s", "fit u, v, r [%]"),
        )
        for label, n, _ in drawn:
            thesis = "-" if n["thesis_objective"] is None else "%.3f" % n["thesis_objective"]
            fits = ", ".join("%.0f" % n["fit_percent"][c] for c in comparison.CHANNELS)
            common.say(
                arguments, "  %-*s %8.3f %10s %22s" % (width, label, n["error"], thesis, fits)
            )
        common.say(arguments, "  picture: %s" % pictures[recording.name])
    files.write_json(report, result, arguments.force)
    common.say(arguments, "numbers: %s" % report)
    return result


def _label(path, others):
    """A model's name in tables: its file's, with the folder where two files share it."""
    name = os.path.splitext(os.path.basename(path))[0]
    shared = sum(os.path.splitext(os.path.basename(o))[0] == name for o in others) > 1
    return os.path.splitext(path)[0] if shared else name
