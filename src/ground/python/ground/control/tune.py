"""tune: search for the gains of a controller."""

import argparse
from dataclasses import dataclass
from typing import Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.control.words import metres
from ground.models import Model
from ground.simulation import gains, listing, tracking, tuning
from ground.support import command_line, files
from ground.support.command_line import count, option, seed
from ground.support.errors import GroundError, core_errors
from ground.support.headline import formatted
from ground.support.progress import Work
from ground.support.workers import Workers

DETAILS = (
    """
Every candidate follows the references from several starts: with the model as
it is, with mocap noise and 20 ms of delay, and with a craft whose thrust is
15% lower, whose damping is 30% higher and whose inertia is 15% higher than in
the model. The score is the error (median and worst start) plus weighted
saturation and effort. The search starts from the gains of the thesis, among
others.
The table shows starts and references that the search has not used (--holdout).

A reference is one of the following, optionally with other parameters, as in
circle:size=1.5,rate_of_turn=0.8 or line:speed=0.5.

"""
    + listing.references()
    + "\n"
    + listing.controllers(tuning.SPACE)
)
REFERENCES = (
    "circle",
    "line",
    "sinusoid",
    "circle:size=1.2,rate_of_turn=0.9",
    "sinusoid:speed=0.3,size=0.8,rate_of_turn=0.4",
)
HELD_OUT = ("rhodonea", "circle:size=1.5,rate_of_turn=0.8")
THESIS = {
    "TrajectoryTracking": {
        "(4.11)": dict(k_e=4.0, k_z=3e-4, k_phi_1=0.005, k_phi_2=0.005, delta_1=-0.01, delta_2=0.0),
        "(4.12)": dict(k_e=0.5, k_z=4e-4, k_phi_1=0.05, k_phi_2=0.05, delta_1=-0.01, delta_2=0.0),
    }
}


@dataclass(frozen=True)
class TuneOptions:
    """What is searched, and how long."""

    controller: str = option("TrajectoryTracking", "control law (%(default)s)", choices=list(tuning.SPACE))
    gains: Optional[str] = option(None, "gains to start from and to compare with", metavar="G.yaml")
    references: Sequence[str] = option(
        REFERENCES,
        "references to search on, see below (%s)" % " ".join(REFERENCES),
        nargs="+",
        metavar="KIND",
    )
    holdout: Sequence[str] = option(
        HELD_OUT, "further references to test on (%s)" % " ".join(HELD_OUT), nargs="*", metavar="KIND"
    )
    evaluations: int = option(1200, "candidates to try (%(default)s)", type=count, metavar="N")
    starts: int = option(4, "starts per candidate (%(default)s)", type=count, metavar="N")
    test_starts: int = option(100, "fresh starts of the test (%(default)s)", type=count, metavar="N")
    seed: int = option(1, "seed of noise and starts (%(default)s)", type=seed)


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of tune."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = DETAILS
    command_line.add_model(parser, "model of the craft")
    command_line.add_output(parser, "GAINS.yaml")
    command_line.add_options(parser, TuneOptions)
    command_line.add_details(parser)


def run(arguments: argparse.Namespace) -> Dict[str, object]:
    """Runs tune; returns what --json prints."""
    files.refuse_existing(arguments.output, arguments.force)
    options = command_line.options(arguments, TuneOptions)
    model = Model.load(arguments.model).core
    use = tracking.effect_use(options.controller, model)
    if use.remark:
        command_line.say(arguments, "model: %s" % use.remark)
    with core_errors():
        seen = tuning.cells({k: _task(k) for k in options.references}, model)
        unseen = tuning.cells({k: _task(k) for k in options.holdout}, model)
        tried, compared = _search(options, arguments.work, model, seen, unseen)
    tuned = compared["tuned"]
    result = {
        "controller": options.controller,
        "model": arguments.model,
        "gains": tuned.gains,
        "output": arguments.output,
        **_result(options, compared, seen + unseen, tried),
        "effects": {"used": use.used, "unused": use.unused},
    }
    medians = [
        "%s %s" % (c.reference, metres(float(np.median(tuned.errors[c.name]))))
        for c in seen + unseen
        if c.condition == "nominal"
    ]
    comments = [
        "Found by tune: %d candidates on %s of %s." % (len(tried), ", ".join(options.references), model.name),
        "Median error of %d fresh starts, nominal: %s." % (options.test_starts, "; ".join(medians)),
    ]
    choice = gains.choice(options.controller, tuned.gains)
    gains.write(arguments.output, choice, comments, arguments.force)
    own = [float(np.median(tuned.errors[c.name])) for c in seen + unseen if c.condition == "nominal"]
    gained = ", ".join("%s %.4g" % (name, float(value)) for name, value in tuned.gains.items())
    tested = "%s to %s rms on %d references, nominal (medians of %d fresh starts)"
    head = [
        ("Tuned", "%s: %s." % (options.controller, gained)),
        ("Distance", tested % (metres(min(own)), metres(max(own)), len(own), options.test_starts)),
        ("Gains", arguments.output),
        ("Next", "try them: rosrun ground track --gains %s" % arguments.output),
    ]
    for line in formatted(head):
        command_line.say(arguments, line)
    command_line.say_details(arguments, _lines(options, compared, seen + unseen))
    return result


def _search(
    options: TuneOptions, work: Work, model: _core.Model, seen: List[tuning.Cell], unseen: List[tuning.Cell]
) -> Tuple[List[tuning.GainTrial], Dict[str, tuning.GainTrial]]:
    """The Candidates tried, and the Candidates to compare, by name."""
    before = _starting(options)
    first, kind = list(before.values()), options.controller
    seeds = [1000 * options.seed + offset for offset in (0, 300, 600)]
    counts = (options.starts, 5 * options.starts, options.test_starts)
    places = [tracking.starts(count, seed) for count, seed in zip(counts, seeds)]
    loops = tuning.GainSearch(Workers(), model, work)
    with work.stage("drives of the search"):
        tried = loops.search(first, seen, places[0], options.evaluations, seeds[0])
    with work.stage("drives of the finalists", len(seen) * counts[1] * tuning.FINALISTS):
        chosen = loops.choose(tried, kind, seen, places[1], seeds[1])
    choices = [*first, gains.choice(kind, chosen.gains)]
    with work.stage("drives of the test", len(seen + unseen) * counts[2] * len(choices)):
        compared = loops.evaluate(choices, seen + unseen, places[2], seeds[2])
    return tried, dict(zip([*before, "tuned"], compared))


def _task(text: str) -> tracking.TrackingTask:
    """The tracking.TrackingTask of KIND:NAME=NUMBER,NAME=NUMBER."""
    kind, _, rest = text.partition(":")
    settings = {}
    for item in filter(None, rest.split(",")):
        name, _, value = item.partition("=")
        try:
            settings[name] = float(value)
        except ValueError:
            raise GroundError("%s: '%s' is not a number" % (text, value))
    try:
        return tracking.task(kind, **settings)
    except GroundError as error:
        raise GroundError("%s: %s" % (text, error))


def _starting(options: TuneOptions) -> Dict[str, _core.ControllerChoice]:
    """Name to the _core.ControllerChoice to start from and to compare with."""
    values = dict(THESIS.get(options.controller, {}))
    found = {"given": gains.choice(options.controller, options.gains)} if options.gains else {}
    found.update((name, gains.choice(options.controller, own)) for name, own in values.items())
    return found or {"default": gains.choice(options.controller)}


def _result(
    options: TuneOptions,
    compared: Mapping[str, tuning.GainTrial],
    cells: Sequence[tuning.Cell],
    tried: Sequence[tuning.GainTrial],
) -> Dict[str, object]:
    table = [
        {
            "reference": cell.reference,
            "condition": cell.condition,
            "held_out": cell.reference not in options.references,
            "rms": {name: tracking.quantiles(c.errors[cell.name]) for name, c in compared.items()},
        }
        for cell in cells
    ]
    return {
        "candidates": len(tried),
        "test_starts": options.test_starts,
        "table": table,
        "saturated": {name: c.saturated for name, c in compared.items()},
        "effort": {name: c.effort for name, c in compared.items()},
    }


def _lines(
    options: TuneOptions, compared: Mapping[str, tuning.GainTrial], cells: Sequence[tuning.Cell]
) -> Iterator[str]:
    """What tune prints."""
    labels = [
        "%s%s, %s" % (cell.reference, "" if cell.reference in options.references else " *", cell.condition)
        for cell in cells
    ]
    form = "%%-%ds" % (2 + max(map(len, labels))) + "%24s" * len(compared)
    yield "error rms, median (95%%) of %d fresh starts" % options.test_starts
    yield form % ("", *compared)
    for label, cell in zip(labels, cells):
        found = [tracking.quantiles(one.errors[cell.name]) for one in compared.values()]
        yield form % (label, *("%s (%s)" % (metres(q["median"]), metres(q["p95"])) for q in found))
    yield form % ("saturated", *("%.1f%%" % (100 * one.saturated) for one in compared.values()))
    yield form % ("effort", *("%.3f" % one.effort for one in compared.values()))
    yield "* not used by the search"
