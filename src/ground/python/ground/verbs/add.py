"""identify add: a physical effect into a model, refitted, with the error before and after."""
import os

import numpy as np
import yaml

from ground import _core, comparison, files, study, windows
from ground.errors import IdentifyError
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
    parser.add_argument("--model", metavar="M.yaml", required=True, help="what it is added to")
    parser.add_argument("-o", "--output", metavar="N.yaml", required=True)
    parser.add_argument(
        "--holdout", metavar="BAG", nargs="+", default=[], help="runs to test on, not fitted to"
    )
    parser.add_argument("--force", action="store_true", help="overwrite the model file")


def run(arguments):
    files.refuse_existing(arguments.output, arguments.force)
    model = common.load(arguments.model)
    extended, effect = _extend(model, arguments.effect)
    runs = common.prepare(arguments, model)[1]
    held = common.prepare(arguments, model, arguments.holdout)[1] if arguments.holdout else []
    common.refuse_twice(runs + held)

    on_runs = study.Study(runs)
    before = on_runs.fit(model, study.free_parameters(model))
    refitted = _carried_over(before.model, extended)
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
        "effect": effect,
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


def _extend(model, effect):
    """The model with the effect at its neutral or given values, and the effect's name."""
    if os.path.splitext(effect)[1] in (".yaml", ".yml"):
        return _extend_by_file(model, effect)
    extended = model.copy()
    try:
        extended.add_effect(effect)
    except (ValueError, RuntimeError) as error:
        raise IdentifyError(str(error))
    return extended, effect


def _extend_by_file(model, path):
    try:
        with open(path) as file:
            entry = yaml.safe_load(file)
        text = yaml.safe_load(model.format())
    except (OSError, yaml.YAMLError) as error:
        raise IdentifyError("%s: cannot be read (%s)" % (path, error))
    if isinstance(entry, list) and len(entry) == 1:
        entry = entry[0]
    if not isinstance(entry, dict) or "name" not in entry:
        raise IdentifyError("%s: not one effect with a name, as model files list them" % path)
    text["effects"] = (text["effects"] or []) + [entry]
    try:
        return _core.parse_model(yaml.safe_dump(text, sort_keys=False), path), entry["name"]
    except RuntimeError as error:
        raise IdentifyError(str(error))


def _carried_over(fitted, extended):
    """The extended model with the values that were fitted without the effect."""
    model = extended.copy()
    for parameter in fitted.parameters():
        model.set_value(parameter["name"], fitted.value(parameter["name"]))
    return model


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
            interval if p["identified"] else "these data do not tell it",
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
