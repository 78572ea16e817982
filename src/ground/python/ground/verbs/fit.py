"""identify fit: a model's parameters from recordings."""

import argparse
import sys
from typing import Iterator, Optional, Sequence, Tuple

import numpy as np

from ground import files
from ground.analysis import folds, window_error
from ground.annotations import Document
from ground.api import fitting
from ground.recordings import windows
from ground.verbs import common

FREE = list(window_error.NOMINAL)


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the verb's arguments."""
    common.add_bag_arguments(parser)
    common.add_span_arguments(parser)
    parser.add_argument(
        "--model", metavar="M.yaml", required=True, help="model, with the start values"
    )
    parser.add_argument("-o", "--output", metavar="FITTED.yaml", required=True)
    common.add_holdout_argument(parser)
    parser.add_argument(
        "--free",
        metavar="NAME",
        nargs="+",
        default=FREE,
        help="free parameters (%s)" % " ".join(FREE),
    )
    parser.add_argument(
        "--objective",
        choices=fitting.OBJECTIVES,
        default="least-squares",
        help="robust weighted least squares (default), or mean absolute error (3.4)",
    )
    parser.add_argument(
        "--target",
        choices=fitting.TARGETS,
        default="velocities",
        help="what is simulated and measured: smoothed velocities (default), or raw poses, which are "
        "more precise if the model is right",
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
        help="fit from the model's values and N - 1 others, and keep the best (%(default)s)",
    )
    parser.add_argument(
        "--block",
        type=common.positive,
        default=folds.BLOCK,
        help="length of the blocks of time that are held out, in %d parts at most [s] (%%(default)s)"
        % folds.BLOCK_FOLDS,
    )
    parser.add_argument("--force", action="store_true", help="overwrite the model file")


def run(arguments: argparse.Namespace) -> Document:
    """Runs the verb; returns what --json prints."""
    files.refuse_existing(arguments.output, arguments.force)
    found = fitting.fit(
        arguments.model,
        common.reading(arguments, arguments.bags),
        holdout=common.reading(arguments, arguments.holdout),
        free=arguments.free,
        objective=arguments.objective,
        target=arguments.target,
        window=arguments.window,
        starts=arguments.starts,
        block=arguments.block,
        start=arguments.start,
        end=arguments.end,
        everything=arguments.all,
        progress=arguments.work,
    )
    found.save(arguments.output, arguments.force)
    if not found.converged:
        print("identify fit: not converged: %s" % found.message, file=sys.stderr)
    for line in _lines(arguments, found):
        common.say(arguments, line)
    return {"model": arguments.output, **found.to_dict()}


def _lines(arguments: argparse.Namespace, found: fitting.Fit) -> Iterator[str]:
    """Lines to print: parameters, errors, each run, and what is not identifiable."""
    yield "%-18s %12s %12s   %s" % ("parameter", "start", "estimate", "95% interval")
    for p in found.parameters.values():
        unit = p.unit if p.identified else ""
        yield "%-18s %12.4g %12.4g   %s %s" % (p.name, p.start, p.value, p.interval, unit)
    yield ""
    yield "%-50s %8s %8s %9s" % ("error over windows of 1.5 s", "start", "fitted", "held out")
    for words, values in _errors(arguments, found):
        yield "  %-48s %8s %8s %9s" % (
            (words,) + tuple("" if v is None else "%.3f" % v for v in values)
        )
    if found.runs:
        yield ""
        yield from _table(arguments.free, found.runs)
    same = sorted({name for pair in found.same_inputs for name in pair})
    if same:
        yield "the same inputs drove %s: validating one on the other is optimistic" % ", ".join(same)
    yield from found.remarks
    if arguments.starts > 1:
        yield "%d of %d starts reached this optimum" % (found.starts["at_best"], arguments.starts)
    yield "written to %s" % arguments.output


def _errors(
    arguments: argparse.Namespace, found: fitting.Fit
) -> Iterator[Tuple[str, Tuple[Optional[float], ...]]]:
    """Data, and the error there of the start values, of the fit, and held out."""
    errors, thesis = found.error, found.thesis_objective
    several = "all runs; held out: each by a fit to the others"
    if len(found.runs) > folds.RUN_FOLDS:
        several = "all runs; held out: in %d parts" % folds.RUN_FOLDS
    words = several if found.runs else "the run"
    yield words, (errors.before, errors.after, errors.heldout_runs)
    if errors.blocks:
        blocks = errors.blocks
        how = ", each by a fit to the rest"
        if blocks.folds < blocks.count:
            how = " in %d parts, by fits to the rest" % blocks.folds
        words = "blocks of %g s%s" % (arguments.block, how)
        yield words, (blocks.before, blocks.after, blocks.heldout)
    if errors.holdout:
        words = "the runs given with --holdout"
        yield words, (errors.holdout.before, None, errors.holdout.after)
    if thesis.after is not None:
        yield "(3.4) over the first 4 s", (thesis.before, thesis.after, None)


def _table(names: Sequence[str], rows: Sequence[fitting.RunFit]) -> Iterator[str]:
    """One row per run, then mean and spread, as in the thesis's table 3.2."""
    width = max(map(len, [row.run for row in rows] + ["spread"]))
    head = "".join("%11s" % n.split(".")[-1] for n in names)
    yield "%-*s %s%9s%10s" % (width, "run", head, "error", "held out")
    for row in rows:
        estimates = "".join("%11.4g" % row.parameters[n] for n in names)
        errors = "%9.3f%10.3f" % (row.error, row.heldout_error)
        yield "%s %s%s" % (row.run.ljust(width), estimates, errors)
    table = np.array([[row.parameters[n] for n in names] for row in rows])
    for name, values in (("mean", table.mean(axis=0)), ("spread", table.std(axis=0, ddof=1))):
        yield "%s %s" % (name.ljust(width), "".join("%11.4g" % v for v in values))
    for row in rows:
        if row.disagrees_in:
            yield "%s disagrees with the others in %s: inspect it before pooling the runs" % (
                row.run,
                ", ".join(row.disagrees_in),
            )
