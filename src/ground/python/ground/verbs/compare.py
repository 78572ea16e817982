"""identify compare: models against recordings, and where they fail.

compare.json, schema ground/compare/1 (SI units; null for a value that is not a number or does not exist):

models    by label: file, effects, fitted_to (names of bags, from its provenance)
runs      name, bag, models: by label
  role              fit or held_out, by the digests of recordings in the model's provenance; unknown where
                    its file has names only
  error             mean of |e_u|/s_u + |e_v|/s_v + |e_r|/s_r, windows of 1.5 s; error_by_channel
  prediction_error  the same with initial velocities from the first 0.4 s, of the rest
  thesis_objective  (3.4) over the first 4 s
  fit_percent, rms  per channel, of the windows
  horizons          seconds (first: one sample), starts, median and rms of the errors of u, v, r
                    [sigma], position [mm] and heading [deg], each started at the measured state
  where             per variable: centres of its bins, samples, mean |e|/s per channel, and share of
                    its variance explained (raw; share: beyond chance; p: of so much by chance)
  residuals         kind; noise levels; per channel autocorrelation, input_sum, input_difference:
                    lags, value, band99, how many are outside, accepted; white
  wrench            noise levels; disturbances left out [s]; per channel X, Y, N: mean, rms, std,
                    sigma (median standard deviation of the estimate), full_scale (what full thrust
                    gives), against: per variable mean and standard_error in its bins, and share;
                    accounted (of the first of several models): share of its mean square that the
                    last model accounts for, mean of that in the bins;
                    thrust: direction in the model's body axes and size of the force that follows
                    the command, by model and as measured; body_axes_differ. Over time in the CSV.
  files, summary    series of the wrench; the sentences of the terminal
pooled    by label: the numbers over all, fit, held_out and unknown runs
ranking   errors by label, the least first, over runs: those that no model was fitted to (role held_out),
          or all where there are none (role fit or unknown; fitted: by which models)
noise_floor  error that the noise of the poses alone would leave there, if the best model were true
"""

import argparse
from typing import Mapping

from ground import workers
from ground.analysis import comparison
from ground.annotations import Document
from ground.api import comparing
from ground.api.recordings import Part
from ground.reports import comparison_files, words
from ground.verbs import common


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the verb's arguments."""
    common.add_bag_arguments(parser)
    common.add_span_arguments(parser)
    workers.add_scheduler_argument(parser)
    parser.add_argument(
        "--model", metavar="M.yaml", action="append", required=True, help="model; once for each model"
    )
    parser.add_argument("-o", "--output", metavar="DIR", required=True, help="folder for results")
    parser.add_argument("--numbers", action="store_true", help="compare.json and CSV only: no page")
    parser.add_argument("--force", action="store_true", help="overwrite results in the folder")


def run(arguments: argparse.Namespace) -> Document:
    """Runs the verb; returns what --json prints."""
    models = comparing.labelled(arguments.model)
    arguments.work.expect(comparing.COMPARING, None)
    recordings = common.read(arguments)
    folder = comparison_files.Folder(
        arguments.output, list(models), not arguments.numbers, arguments.force
    )
    folder.prepare([recording.name for recording in recordings])
    part = Part(arguments.start, arguments.end, arguments.all)
    if not arguments.numbers:
        arguments.work.expect(common.PAGE, 1, 2.0)
    runs = []
    with folder.replaced():
        for compared in comparing.each_run(
            models, recordings, part, arguments.scheduler, arguments.work
        ):
            folder.write_run(compared)
            _say_run(arguments, compared)
            runs.append(compared)
        found = comparing.conclude(models, runs)
        if len(runs) > 1:
            _say_pooled(arguments, found.pooled)
        result = folder.write_numbers(found)
    common.say(arguments, found.sentence)
    if arguments.numbers:
        common.say(arguments, "written to %s" % folder.numbers)
        return result
    with arguments.work.stage(common.PAGE), common.page(folder.page, folder.numbers):
        folder.write_page(found, result)
    common.say(arguments, "to look at: %s; numbers beside it" % folder.page)
    return result


COLUMNS = "%9s %7s %10s %9s %14s %15s"


def _say_header(arguments: argparse.Namespace, width: int) -> None:
    common.say(
        arguments,
        "  %-*s " % (width, "model")
        + COLUMNS % ("runs", "error", "prediction", "(3.4) 4 s", "fit u,v,r [%]", "off after 1 s"),
    )


def _say_row(arguments: argparse.Namespace, width: int, label: str, role: str, n: Document) -> None:
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


def _say_run(arguments: argparse.Namespace, compared: comparing.RunComparison) -> None:
    studies = compared.studies
    width = max(len(s["label"]) for s in studies)
    common.say(arguments, compared.name)
    _say_header(arguments, width)
    for study in studies:
        _say_row(arguments, width, study["label"], study["role"], study["numbers"])
    for study in studies:
        for sentence in study["summary"]:
            common.say(arguments, "  %s: %s" % (study["label"], sentence))


def _say_pooled(arguments: argparse.Namespace, pooled: Mapping[str, Document]) -> None:
    width = max(map(len, pooled))
    common.say(arguments, "all runs")
    _say_header(arguments, width)
    for label, groups in pooled.items():
        for role in comparing.ROLES:
            if groups[role]:
                _say_row(arguments, width, label, role, groups[role])
