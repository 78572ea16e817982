"""identify compare: models against recordings, and where they fail.

compare.json, schema ground/compare/1 (SI units; null for what is not a number or does not exist):

models    by label: file, effects, fitted_to (names of bags, from its provenance)
runs      name, bag, picture (motion), pictures (where, residuals; null if not drawn), models: by label
  role              fit or held_out, by the bag's file name in the model's provenance
  error             mean of |e_u|/s_u + |e_v|/s_v + |e_r|/s_r, windows of 1.5 s; error_by_channel
  prediction_error  the same with initial velocities from the first 0.4 s, of the rest
  thesis_objective  (3.4) over the first 4 s
  fit_percent, rms  per channel, of the windows
  horizons          seconds (first: one sample), starts, median and rms of the errors of u, v, r
                    [sigma], position [mm] and heading [deg], each started at the measured state
  where             per variable: centres of its bins, samples, mean |e|/s per channel, and share of
                    its variance explained (raw; share: beyond chance; p: of so much by chance)
  residuals         of what; noise levels; per channel autocorrelation, input_sum, input_difference:
                    lags, value, band99, how many are outside, accepted; white
  wrench            noise levels; disturbances left out [s]; per channel X, Y, N: mean, rms, std,
                    sigma (median standard deviation of the estimate), full_scale (what full thrust
                    gives), against: per variable mean and standard_error in its bins, and share;
                    accounted (of the first of several models): share of its mean square that the
                    last model accounts for, mean of that in the bins;
                    thrust: direction in the model's body axes and size of the force that follows
                    the command, by model and as measured; body_axes_differ. Over time in the CSV.
  files, summary    picture and series of the wrench; the sentences of the terminal
pooled    by label: the numbers over all, fit and held_out runs
noise_floor  error that the noise of the poses alone would leave, were the best model the truth
"""
import os

import numpy as np

from ground import files, workers
from ground.analysis import comparison
from ground.analysis.study import noise_floor
from ground.errors import GroundError
from ground.recordings import quality
from ground.reports import inspection, report, words
from ground.verbs import common

NAME = "compare"
SUMMARY = "models against recordings: errors, where they come from, and pictures"


def configure(parser):
    common.reads_bags(parser)
    common.takes_spans(parser)
    common.tells_progress(parser)
    workers.takes_scheduler(parser)
    parser.add_argument(
        "--model", metavar="M.yaml", action="append", required=True, help="once for each model"
    )
    parser.add_argument("-o", "--output", metavar="DIR", required=True, help="folder for results")
    parser.add_argument(
        "--format", choices=["png", "svg"], default="png", help="of pictures (%(default)s)"
    )
    parser.add_argument(
        "--numbers", action="store_true", help="compare.json and CSV only: no pictures, no report"
    )
    parser.add_argument("--force", action="store_true", help="overwrite results in the folder")


def run(arguments):
    models = [(_label(p, arguments.model), common.load(p)) for p in arguments.model]
    labels = [label for label, _ in models]
    if len(set(labels)) < len(models):
        raise GroundError("the same model is given twice")
    found = common.read(arguments)
    bags = [os.path.basename(b) for b in arguments.bags]
    try:
        os.makedirs(arguments.output, exist_ok=True)
    except OSError as error:
        raise GroundError("%s: cannot be made a folder (%s)" % (arguments.output, error))
    outputs = [_outputs(arguments, recording.name, labels) for recording in found]
    numbers, page = (os.path.join(arguments.output, n) for n in ("compare.json", "report.html"))
    pages = [] if arguments.numbers else [page]
    for path in [numbers] + pages + [p for o in outputs for p in o["paths"]]:
        files.refuse_existing(path, arguments.force)

    result = {
        "schema": "ground/compare/1",
        "models": {
            label: {"file": path, "effects": model.effects, "fitted_to": model.provenance.bags}
            for (label, model), path in zip(models, arguments.model)
        },
        "runs": [],
    }
    evaluations = {label: {"fit": [], "held_out": []} for label in labels}
    prepared, inspected = [quality.Run(recording) for recording in found], []
    for _, model in models:
        common.note_heading_offset(model, prepared)
    found_out = _inspect_all(arguments, models, prepared, bags)
    for recording, bag, output, studies in zip(prepared, bags, outputs, found_out):
        for one in studies:
            one["files"] = output["models"][one["label"]]
            evaluations[one["label"]][one["role"]].append(one["evaluation"])
        _write_wrenches(studies, arguments.force)
        if not arguments.numbers:
            _draw(studies, output, arguments.force)
        name = recording.recording.name
        _say_run(arguments, name, studies)
        inspected.append(studies)
        result["runs"].append(
            {
                "name": name,
                "bag": bag,
                "picture": output["comparison"],
                "pictures": {k: output[k] for k in ("where", "residuals")},
                "models": {s["label"]: _plain(s) for s in studies},
            }
        )
    result["pooled"] = {
        label: {
            "all": comparison.numbers(groups["fit"] + groups["held_out"]),
            "fit": comparison.numbers(groups["fit"]) if groups["fit"] else None,
            "held_out": comparison.numbers(groups["held_out"]) if groups["held_out"] else None,
        }
        for label, groups in evaluations.items()
    }
    if len(found) > 1:
        _say_pooled(arguments, result["pooled"])
    best = min(labels, key=lambda label: result["pooled"][label]["all"]["error"])
    runs = [one["run"] for studies in inspected for one in studies if one["label"] == best]
    result["noise_floor"] = float(noise_floor(runs, dict(models)[best]).sum())
    files.write_json(numbers, result, arguments.force)
    common.say(arguments, words.comparison(result))
    if arguments.numbers:
        common.say(arguments, "written to %s" % numbers)
        return result
    described = quality.describe(prepared)
    with common.page(page, numbers):
        report.comparison(
            page, result, inspected, described, arguments.bags + arguments.model, arguments.force
        )
    common.say(arguments, "to look at: %s; pictures and numbers beside it" % page)
    return result


def _inspect_all(arguments, models, prepared, bags):
    """What is found out about all models on each run, in their order; the last model is asked how much
    it accounts for of what the first one lacks."""
    tasks = []
    for recording, bag in zip(prepared, bags):
        task = []
        for count, (label, model) in enumerate(models):
            run = common.data(arguments, recording, model)
            role = "fit" if bag in model.provenance.bags else "held_out"
            other = models[-1][1] if count == 0 and len(models) > 1 else None
            task.append((run, model, label, role, other))
        tasks.append(task)
    with workers.Workers(arguments.scheduler) as team:
        for recording, studies in zip(prepared, team.map(_inspect, tasks)):
            common.progress(arguments, "compared on %s" % recording.recording.name)
            yield studies


def _inspect(task):
    return [inspection.inspect(*one) for one in task]


def _label(path, others):
    """A model's name in tables: its file's, with the folder where two files share it."""
    name = os.path.splitext(os.path.basename(path))[0]
    shared = sum(os.path.splitext(os.path.basename(o))[0] == name for o in others) > 1
    return os.path.splitext(path)[0] if shared else name


def _outputs(arguments, run, labels):
    """Names of all files of one run; None for pictures that are not drawn."""

    def path(name):
        return os.path.join(arguments.output, name)

    def picture(stem):
        return None if arguments.numbers else path("%s.%s" % (stem, arguments.format))

    output = {
        "comparison": picture(run),
        "where": picture(run + ".where"),
        "residuals": picture(run + ".residuals"),
        "models": {},
    }
    paths = [output[k] for k in ("comparison", "where", "residuals")]
    for label in labels:
        stem = "%s.wrench.%s" % (run, label.strip("./").replace(os.sep, "_"))
        output["models"][label] = {
            "wrench_picture": picture(stem),
            "wrench_csv": path("%s.csv" % stem),
        }
        paths += output["models"][label].values()
    output["paths"] = [p for p in paths if p]
    return output


def _plain(study):
    """What goes into compare.json of one model on one run."""
    return dict(
        study["numbers"],
        role=study["role"],
        where=study["where"],
        residuals=study["residuals"],
        wrench=study["missing"].numbers,
        files=study["files"],
        summary=study["summary"],
    )


def _draw(studies, output, force):
    from ground.reports import plots

    plots.comparison(output["comparison"], studies, force)
    plots.where(output["where"], studies, force)
    plots.residuals(output["residuals"], studies, force)
    for study in studies:
        plots.wrench(study["files"]["wrench_picture"], study, force)


def _write_wrenches(studies, force):
    for study in studies:
        missing = study["missing"]
        with files.new_file(study["files"]["wrench_csv"], force) as temporary:
            np.savetxt(
                temporary,
                np.column_stack([missing.times, missing.wrench, missing.sigma]),
                fmt="%.6g",
                delimiter=",",
                header="t [s],X [N],Y [N],N [N m],sigma X [N],sigma Y [N],sigma N [N m]",
                comments="",
            )


COLUMNS = "%9s %7s %10s %9s %14s %15s"


def _say_header(arguments, width):
    common.say(
        arguments,
        "  %-*s " % (width, "model")
        + COLUMNS % ("runs", "error", "prediction", "(3.4) 4 s", "fit u,v,r [%]", "off after 1 s"),
    )


def _say_row(arguments, width, label, role, n):
    fits = ", ".join("%.0f" % n["fit_percent"][c] for c in comparison.CHANNELS)
    common.say(
        arguments,
        "  %-*s " % (width, label)
        + COLUMNS
        % (
            role.replace("_", " "),
            "%.3f" % n["error"],
            words.number(n["prediction_error"]),
            words.number(n["thesis_objective"]),
            fits,
            words.off_after_a_second(n),
        ),
    )


def _say_run(arguments, name, studies):
    width = max(len(s["label"]) for s in studies)
    common.say(arguments, name)
    _say_header(arguments, width)
    for study in studies:
        _say_row(arguments, width, study["label"], study["role"], study["numbers"])
    for study in studies:
        for sentence in study["summary"]:
            common.say(arguments, "  %s: %s" % (study["label"], sentence))


def _say_pooled(arguments, pooled):
    width = max(map(len, pooled))
    common.say(arguments, "all runs")
    _say_header(arguments, width)
    for label, groups in pooled.items():
        for role in ("fit", "held_out"):
            if groups[role]:
                _say_row(arguments, width, label, role, groups[role])
