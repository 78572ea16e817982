"""tune: search for the gains of a controller."""

import argparse
from typing import Dict, List, Mapping, Sequence, Tuple

from ground import _core, files, workers
from ground.annotations import Document
from ground.api.models import Model
from ground.errors import GroundError
from ground.simulation import gains, tracking, tuning
from ground.verbs import common, listing
from ground.verbs.track import metres


DETAILS = """
Every candidate follows the references from several starts: with the model as it is, with mocap noise
and 20 ms of delay, and with a craft whose thrust is 15% lower, whose damping is 30% higher and whose
inertia is 15% higher than in the model. The score is the error (median and worst start) plus weighted
saturation and effort. The search starts from the gains of the thesis, among others.
The table shows starts and references that the search has not used (--holdout).

A reference is one of those below, if wanted with other parameters, as in
circle:size=1.5,rate_of_turn=0.8 or line:speed=0.5.

""" + listing.references() + "\n" + listing.controllers(tuning.SPACE)
REFERENCES = [
    "circle",
    "line",
    "sinusoid",
    "circle:size=1.2,rate_of_turn=0.9",
    "sinusoid:speed=0.3,size=0.8,rate_of_turn=0.4",
]
# Stages; unit: a drive that is simulated
STAGES = ("drives of the search", "drives of the finalists", "drives of the test")
DRIVE = 0.005  # usual time of one [s]
HELD_OUT = ["rhodonea", "circle:size=1.5,rate_of_turn=0.8"]
THESIS = {
    "TrajectoryTracking": {
        "(4.11)": dict(k_e=4.0, k_z=3e-4, k_phi_1=0.005, k_phi_2=0.005, delta_1=-0.01, delta_2=0.0),
        "(4.12)": dict(k_e=0.5, k_z=4e-4, k_phi_1=0.05, k_phi_2=0.05, delta_1=-0.01, delta_2=0.0),
    }
}


def configure(parser: argparse.ArgumentParser) -> None:
    """Adds the verb's arguments."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = DETAILS
    parser.add_argument("--controller", choices=list(tuning.SPACE), default="TrajectoryTracking")
    parser.add_argument("--model", required=True, metavar="M.yaml", help="model of the craft")
    parser.add_argument("--gains", metavar="G.yaml", help="gains to start from and to compare with")
    parser.add_argument("-o", "--output", required=True, metavar="GAINS.yaml")
    parser.add_argument(
        "--picture",
        metavar="FILE.png",
        help="candidates, and errors before and after; FILE.html: a page, which needs no Chromium",
    )
    parser.add_argument("--force", action="store_true", help="overwrite these files")
    parser.add_argument(
        "--references",
        nargs="+",
        metavar="KIND",
        default=REFERENCES,
        help="references to search on, see below (%s)" % " ".join(REFERENCES),
    )
    parser.add_argument(
        "--holdout",
        nargs="*",
        metavar="KIND",
        default=HELD_OUT,
        help="further references to test on (%s)" % " ".join(HELD_OUT),
    )
    parser.add_argument(
        "--evaluations", type=common.count, default=1200, metavar="N", help="(1200)"
    )
    parser.add_argument(
        "--starts", type=common.count, default=4, metavar="N", help="starts of a candidate (%(default)s)"
    )
    parser.add_argument(
        "--test-starts", type=common.count, default=100, metavar="N", help="fresh starts of the test (100)"
    )
    parser.add_argument("--saturation-weight", type=float, default=0.3, help="(%(default)s)")
    parser.add_argument("--effort-weight", type=float, default=0.3, help="(%(default)s)")
    parser.add_argument("--rate", type=common.positive, default=50.0, metavar="HZ", help="(50)")
    parser.add_argument("--seed", type=common.seed, default=1, help="(%(default)s)")
    workers.add_scheduler_argument(parser)


def run(arguments: argparse.Namespace) -> Document:
    """Runs the verb; returns what --json prints."""
    for path in (arguments.output, arguments.picture):
        if path:
            files.refuse_existing(path, arguments.force)
    model = Model.load(arguments.model).core
    use = tracking.effect_use(arguments.controller, model)
    if use["remark"]:
        common.say(arguments, "model: %s" % use["remark"])
    weights = tuning.Weights(arguments.saturation_weight, arguments.effort_weight)
    try:
        seen = tuning.cells({k: _task(k) for k in arguments.references}, model)
        unseen = tuning.cells({k: _task(k) for k in arguments.holdout}, model)
    except (ValueError, RuntimeError) as error:
        raise GroundError(str(error))
    before = _starting(arguments)
    with workers.Workers(arguments.scheduler) as team:
        tuned, tried, compared = _search(arguments, team, model, before, seen, unseen, weights)
    result = _result(arguments, compared, seen + unseen, tried)
    result["effects"] = {"used": use["used"], "unused": use["unused"]}
    comments = [
        "Found by tune: %d candidates on %s of %s."
        % (len(tried), ", ".join(arguments.references), model.name),
        "Median error of %d fresh starts, nominal: %s."
        % (
            arguments.test_starts,
            "; ".join(
                "%s %s" % (c.reference, metres(compared["tuned"].quantile(c.name, 0.5)))
                for c in seen + unseen
                if c.condition == "nominal"
            ),
        ),
    ]
    gains.write(arguments.output, tuned, comments, arguments.force)
    if arguments.picture:
        from ground.reports import picture, tracking_figures

        with arguments.work.stage("drawing the picture"):
            shown = tracking_figures.tuned(compared, tried, result)
            picture.write(arguments.picture, [shown], arguments.force)
    _say(arguments, result)
    return result


def _search(
    arguments: argparse.Namespace,
    team: workers.Workers,
    model: _core.Model,
    before: Mapping[str, _core.ControllerChoice],
    seen: List[tuning.Cell],
    unseen: List[tuning.Cell],
    weights: tuning.Weights,
) -> Tuple[_core.ControllerChoice, List[tuning.Candidate], Dict[str, tuning.Candidate]]:
    """The ControllerChoice found, the Candidates tried, and the Candidates to compare, by name."""
    seeds = [1000 * arguments.seed + offset for offset in (0, 300, 600)]
    counts = (arguments.starts, 5 * arguments.starts, arguments.test_starts)
    places = [tracking.starts(count, seed) for count, seed in zip(counts, seeds)]
    first, rate = list(before.values()), arguments.rate
    work, drives = arguments.work, [
        len(seen) * counts[0] * arguments.evaluations,
        len(seen) * counts[1] * tuning.FINALISTS,
        len(seen + unseen) * counts[2] * (len(first) + 1),
    ]
    for stage, units in zip(STAGES, drives):
        work.expect(stage, units, DRIVE)
    try:
        with work.stage(STAGES[0]):
            tried = tuning.search(
                team,
                first,
                model,
                seen,
                places[0],
                weights,
                arguments.evaluations,
                seeds[0],
                rate,
                work,
            )
        with work.stage(STAGES[1]):
            chosen = tuning.choose(
                team, tried, first, model, seen, places[1], weights, seeds[1], rate, work
            )
        tuned = gains.choice(arguments.controller)
        gains.put(tuned, chosen[0].gains)
        with work.stage(STAGES[2]):
            compared = tuning.evaluate(
                team, first + [tuned], model, seen + unseen, places[2], weights, seeds[2], rate, work
            )
    except ValueError as error:
        raise GroundError(str(error))
    return tuned, tried, dict(zip([*before, "tuned"], compared))


def _task(text: str) -> tracking.Task:
    """The tracking.Task of KIND:NAME=NUMBER,NAME=NUMBER."""
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


def _starting(arguments: argparse.Namespace) -> Dict[str, _core.ControllerChoice]:
    """Name to the _core.ControllerChoice to start from and to compare with."""
    found = {}
    if arguments.gains:
        found["given"] = gains.choice(arguments.controller, arguments.gains)
    for name, values in THESIS.get(arguments.controller, {}).items():
        found[name] = gains.choice(arguments.controller)
        gains.put(found[name], values)
    return found or {"default": gains.choice(arguments.controller)}


def _result(
    arguments: argparse.Namespace,
    compared: Mapping[str, tuning.Candidate],
    cells: Sequence[tuning.Cell],
    tried: Sequence[tuning.Candidate],
) -> Document:
    rows = []
    for cell in cells:
        rows.append(
            {
                "reference": cell.reference,
                "condition": cell.condition,
                "held_out": cell.reference not in arguments.references,
                "rms": {
                    name: {q: c.quantile(cell.name, share) for q, share in _SHARES.items()}
                    for name, c in compared.items()
                },
            }
        )
    return {
        "controller": arguments.controller,
        "model": arguments.model,
        "gains": compared["tuned"].gains,
        "output": arguments.output,
        "candidates": len(tried),
        "test_starts": arguments.test_starts,
        "table": rows,
        "saturated": {name: c.saturated for name, c in compared.items()},
        "effort": {name: c.effort for name, c in compared.items()},
        "trade_off": [
            {
                "gains": c.gains,
                "error": 10 ** tuning.score(c, tuning.Weights(0, 0)),
                "saturated": c.saturated,
                "effort": c.effort,
            }
            for c in tuning.trade_off(tried)
        ],
    }


_SHARES = {"p05": 0.05, "median": 0.5, "p95": 0.95}


def _say(arguments: argparse.Namespace, result: Document) -> None:
    names = list(result["saturated"])
    labels = [
        "%s%s, %s" % (row["reference"], " *" if row["held_out"] else "", row["condition"])
        for row in result["table"]
    ]
    form = "%%-%ds" % (2 + max(map(len, labels)))
    common.say(arguments, "error rms, median (95%%) of %d fresh starts" % result["test_starts"])
    common.say(arguments, form % "" + "".join("%24s" % n for n in names))
    for label, row in zip(labels, result["table"]):
        cells = [
            "%s (%s)" % (metres(row["rms"][n]["median"]), metres(row["rms"][n]["p95"]))
            for n in names
        ]
        common.say(arguments, form % label + "".join("%24s" % cell for cell in cells))
    for what, digits in (("saturated", "%.1f%%"), ("effort", "%.3f")):
        scale = 100 if what == "saturated" else 1
        cells = [digits % (scale * result[what][n]) for n in names]
        common.say(arguments, form % what + "".join("%24s" % cell for cell in cells))
    common.say(arguments, "* not used by the search")
    common.say(
        arguments,
        "%s: %s"
        % (result["output"], ", ".join("%s %.4g" % item for item in result["gains"].items())),
    )
