"""identify diagnose: which physical effect a model lacks."""
import math
import os
import shlex

import numpy as np

from ground import _core, files, origin
from ground.analysis import candidates
from ground.analysis.unfinished import Unfinished
from ground.errors import GroundError
from ground.recordings import quality
from ground.reports import report, words
from ground.verbs import common

NAME = "diagnose"
SUMMARY = "which physical effect a model lacks, with evidence, and the model with it"
ON_REQUEST = [name for name, effect in _core.effects().items() if effect["opt_in"]]


def configure(parser):
    common.reads_bags(parser)
    common.takes_spans(parser)
    common.tells_progress(parser)
    parser.add_argument("--model", metavar="M.yaml", required=True, help="the model to diagnose")
    parser.add_argument("-o", "--output", metavar="DIR", required=True, help="folder for results")
    common.holds_out(parser)
    parser.add_argument(
        "--only",
        metavar="EFFECT",
        nargs="+",
        help="effects to try, of the library and of --effects (all but %s)" % ", ".join(ON_REQUEST),
    )
    parser.add_argument(
        "--exclude", metavar="EFFECT", nargs="+", default=[], help="effects not to try"
    )
    parser.add_argument(
        "--effects",
        metavar="EFFECT",
        nargs="+",
        default=[],
        help="effects to try as well: your own, one in each FILE.yaml, as model files list them, or "
        "by name those of the library that it does not try by default (%s)" % ", ".join(ON_REQUEST),
    )
    parser.add_argument(
        "--budget",
        type=common.count,
        metavar="N",
        help="refit only the N effects that a score test finds most promising, in each step (all)",
    )
    parser.add_argument(
        "--thorough",
        action="store_true",
        help="however much data there is, look at all of it, show errors on held-out runs of all effects, "
        "plan the next experiment beside all runs and draw all of them",
    )
    parser.add_argument(
        "--room",
        metavar="ROOM.yaml",
        help="for the next experiment (that of the runs, of the first that has one; else 4 x 4 m)",
    )
    parser.add_argument("--force", action="store_true", help="overwrite results in the folder")


def run(arguments):
    paths = {
        name: os.path.join(arguments.output, name)
        for name in (
            "diagnosis.json",
            "report.html",
            "improved.yaml",
            "proposal.yaml",
            "next_experiment.csv",
        )
    }
    model = common.load(arguments.model)
    tried = _candidates(arguments, model)
    given_room = common.load_room(arguments.room) if arguments.room else None
    common.progress(arguments, "reading the recordings")
    prepared, runs = common.prepare(arguments, model)
    prepared_held, held = common.held_out(arguments, model, prepared)
    try:
        os.makedirs(arguments.output, exist_ok=True)
    except OSError as error:
        raise GroundError("%s: cannot be made a folder (%s)" % (arguments.output, error))
    for path in paths.values():
        files.refuse_existing(path, arguments.force)

    # slow to load, for the other verbs as well
    from ground.analysis import diagnosis, diagnosis_report

    flown_in = next((r.recording for r in prepared if "room" in r.recording.files), None)
    room = given_room or (flown_in and common.room_of(flown_in))
    own_files = [e for e in arguments.effects if e not in ON_REQUEST]
    kept = _kept(arguments, runs, model, tried)
    found = diagnosis.Diagnosis(
        runs,
        model,
        tried,
        arguments.budget,
        progress=lambda text: common.progress(arguments, text),
        kept=kept,
        **({"most": math.inf} if arguments.thorough else {}),
    )
    found.grow()
    if kept.taken:
        common.progress(arguments, "%d results of an interrupted diagnosis taken over" % kept.taken)
    conclusion = found.conclude(held)
    common.progress(arguments, "verdict: %s" % conclusion.verdict)
    common.progress(arguments, "errors of the best effects, and the next experiment")
    result = diagnosis_report.of(found, conclusion, arguments.model, held, arguments.thorough, room)
    arguments.output = paths["improved.yaml"]
    common.write_model(
        arguments,
        conclusion.improved,
        result["nominal"]["error"],
        result["improved"]["error"],
        {p["name"]: p for p in conclusion.parameters},
    )
    proposed = result["next_experiment"]
    if proposed:
        if room:
            file = arguments.room or flown_in.files["room"].place()
            proposed["launch"] += " room:=%s" % shlex.quote(os.path.abspath(file))
        rows = proposed.pop("rows")
        files.write_csv(paths["next_experiment.csv"], "time,left,right", rows, arguments.force)
    else:
        del paths["next_experiment.csv"]
    files.write_json(paths["diagnosis.json"], result, arguments.force)
    proposal = result["unexplained"]["proposal"]
    if proposal:
        entry = diagnosis_report.effect_entry(proposal)
        files.write_yaml(paths["proposal.yaml"], entry, arguments.force)
    else:
        del paths["proposal.yaml"]
    for line in words.diagnosis(result):
        common.say(arguments, line)
    common.progress(arguments, "drawing")
    with common.page(paths["report.html"], paths["diagnosis.json"]):
        report.diagnosis(
            paths["report.html"],
            result,
            found,
            conclusion,
            quality.describe(prepared + prepared_held),
            held,
            arguments.bags + arguments.holdout + [arguments.model] + own_files,
            arguments.force,
            arguments.thorough,
        )
    kept.done()
    common.say(arguments, "")
    for path in paths.values():
        common.say(arguments, "written to %s" % path)
    return result


def _kept(arguments, runs, model, tried):
    """What an interrupted diagnosis of the same has left in the folder."""
    neutral = [(c.name, c.add(model).format()) for c in tried]
    measured = [
        (r.name, np.array(r.times), r.eta, r.nu, r.inputs, r.drives, r.poses, r.noise)
        for r in runs
    ]
    options = arguments.budget, arguments.thorough
    identity = (measured, model.format(), neutral, options, origin.versions())
    return Unfinished(os.path.join(arguments.output, ".unfinished"), identity)


def _candidates(arguments, model):
    """Effects to try, of the library and of --effects, by --only and --exclude. Those of --effects
    are tried beside the library's of --only, unless --only names one of them, and in place of those
    of the library that have their names."""
    own = [candidates.named(effect) for effect in arguments.effects]
    names = [c.name for c in own]
    library = [c for c in candidates.library(model, arguments.only or ()) if c.name not in names]
    by_default = [c.name for c in library] + names + list(model.effects)
    known = by_default + [name for name in ON_REQUEST if name not in by_default]
    for name in (arguments.only or []) + arguments.exclude:
        if name not in known:
            raise GroundError("there is no effect %s; there are %s" % (name, ", ".join(known)))
    for path, name in zip(arguments.effects, names):
        if names.count(name) > 1:
            raise GroundError("%s: --effects has another effect %s" % (path, name))
    only = set(arguments.only or by_default)
    if not only & set(names):
        only |= set(names)
    chosen = [c for c in library + own if c.name in only and c.name not in arguments.exclude]
    if not chosen:
        raise GroundError("no effect is left to try")
    for candidate in chosen:
        candidate.add(model)  # says what does not fit the model before long work starts
    return chosen
