"""identify add: a physical effect into a model, refitted, with the error before and after."""
import numpy as np
from ground import files
from ground.analysis import candidates, comparison, study
from ground.recordings import windows
from ground.verbs import common

NAME = "add"
SUMMARY = "adds an effect to a model, refits it, and shows the error before and after"


def configure(parser):
    parser.add_argument(
        "effect",
        metavar="EFFECT",
        help="name of an effect of the library, or a YAML file with one effect as model files have it",
    )
    common.reads_bags(parser)
    common.takes_spans(parser)
    common.tells_progress(parser)
    parser.add_argument("--model", metavar="M.yaml", required=True, help="what it is added to")
    parser.add_argument("-o", "--output", metavar="N.yaml", required=True)
    common.holds_out(parser)
    parser.add_argument("--force", action="store_true", help="overwrite the model file")


def run(arguments):
    files.refuse_existing(arguments.output, arguments.force)
    model = common.load(arguments.model)
    candidate = candidates.named(arguments.effect)
    extended = candidate.add(model)
    common.progress(arguments, "reading the recordings")
    prepared, runs = common.prepare(arguments, model)
    held = common.held_out(arguments, model, prepared)[1]

    common.progress(arguments, "fitting %s without %s, and with it" % (model.name, candidate.name))
    on_runs = study.Study(runs)
    before = on_runs.fit(model, study.free_parameters(model))
    refitted = candidates.carried_over(before.model, extended)
    after = on_runs.fit(refitted, study.free_parameters(extended), also=[extended])
    errors = {
        "fit": (before.error, after.error),
        "heldout": (before.heldout, after.heldout),
    }
    if held:
        cut = windows.cut(held)
        errors["holdout"] = tuple(
            study.channel_errors(held, cut, fit.model) for fit in (before, after)
        )
    report = {
        "model": arguments.output,
        "effect": candidate.name,
        "parameters": after.parameters,
        "error": {
            name: {"before": _numbers(a), "after": _numbers(b)} for name, (a, b) in errors.items()
        },
        "noise_floor": _numbers(study.noise_floor(runs, after.model)),
    }
    common.write_model(
        arguments,
        after.model,
        {name: e["before"]["error"] for name, e in report["error"].items()},
        {name: e["after"]["error"] for name, e in report["error"].items()},
        after.parameters,
    )
    for line in _lines(arguments, len(runs), before, after, report):
        common.say(arguments, line)
    return report


def _numbers(channels):
    return dict(zip(comparison.CHANNELS, map(float, channels)), error=float(np.sum(channels)))


def _lines(arguments, count, before, after, report):
    yield "%-28s %12s %12s   %s" % ("parameter", "without", "with", "95% interval")
    for name, p in after.parameters.items():
        was = before.parameters.get(name)
        interval = "[%.4g, %.4g] %s" % (p["ci95"] + (p["unit"],))
        yield "%-28s %12s %12.4g   %s" % (
            name,
            "" if was is None else "%.4g" % was["value"],
            p["value"],
            interval if p["identified"] else "not identifiable from these data",
        )
    parts = "each run by a fit to the others" if count > 1 else "each quarter by a fit to the rest"
    words = {
        "fit": "the runs fitted to",
        "heldout": "held out: " + parts,
        "holdout": "the runs given with --holdout",
    }
    yield ""
    yield "%-48s %8s %8s %8s %8s" % ("error over windows of 1.5 s", "u", "v", "r", "all")
    for name, pair in report["error"].items():
        yield words[name]
        for when in ("before", "after"):
            yield _row(when, pair[when])
        change = pair["after"]["error"] / pair["before"]["error"] - 1
        yield "  %-46s %35s" % ("", "%+.0f%%" % (100 * change))
    yield _row("noise of the poses alone", report["noise_floor"], "")
    yield "written to %s" % arguments.output


def _row(name, numbers, indent="  "):
    return "%-48s %8.3f %8.3f %8.3f %8.3f" % (
        (indent + name,) + tuple(numbers[c] for c in comparison.CHANNELS + ("error",))
    )
