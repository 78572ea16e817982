#!/usr/bin/python3
"""Lets crafts with hidden physics find it by flying, and compares the answers with the truth.

A case is a kind and a seed (discover_cases). Its craft is the bench's own (discover_lab): neither equations
nor integrator nor disturbance nor noise are the project's. Each craft flies twice: with the experiments that
a discovery chooses, and with random ones, for the same certainty. Results go to a file of JSON lines; an
interrupted bench continues where it stopped.
"""

import os
import sys
import time

import numpy as np

import discover_cases as cases
import discover_floor
import discover_lab
import discover_table
import hidden_craft
import hidden_table
import resumed
from ground import _core
from ground.discovery import campaign, choice, flights, pieces, story, tracking
from ground.simulation import experiments
from ground.support import workers
from ground.support.errors import GroundError
from hidden_effects import MODEL

ROOM = os.path.join(os.path.dirname(MODEL), os.pardir, "room", "room_4x4.yaml")
CHECKS = (9001, 9002, 9003)  # numbers of the flights that compare the tracking


def random_bursts(state, offers, longest, seed):
    """A choice.Chooser that looks at nothing: PRBS of 15 Hz and full thrust, each with another seed."""
    model = state.questions.basis.model
    alike = [o.seconds for o in offers if "PRBS" in o.piece.words and "lift" not in o.piece.words]
    seconds = float(np.median(alike or [o.seconds for o in offers]))
    count = max(1, int(min(choice.MAX_FLIGHT, longest) / seconds))
    random = np.random.default_rng(seed)
    numbers = random.integers(1, 10**6, count).tolist()
    return choice.Chosen([prbs(model, n) for n in numbers], "Random bursts.")


def prbs(model, seed):
    """A pieces.Piece: a pseudo-random binary sequence of 15 Hz and full thrust, at full lift."""
    rows = experiments.rows("prbs", pieces.SECONDS, model, clock=15.0, seed=seed)
    rows = rows[rows[:, 0] < pieces.SECONDS - 1e-9]
    return pieces.Piece("PRBS of 15 Hz", np.column_stack([rows, np.ones(len(rows))]))


# How the experiments are chosen
CHOOSERS = {"informed": choice.informed, "random": random_bursts}


def run_case(job):
    """Result of one job (kind, seed, chooser), a dictionary for a line of JSON."""
    kind, seed, chooser = job
    case, model = cases.make(kind, seed), cases.given_model()
    place = _core.load_room(ROOM)
    start = time.perf_counter()
    lab = discover_lab.HiddenLaboratory(case, model, place)
    settings = flights.CampaignSettings(budget=cases.KINDS[kind][2], seed=seed)
    result = dict(case.describe(), chooser=chooser)
    try:
        found = campaign.FlightCampaign(model, lab, settings, choose=CHOOSERS[chooser], threads=1)
        told = found.run()
        result["seconds"] = time.perf_counter() - start
        result.update(_flights(told), found=_answer(found))
        result.update(clearance=lab.clearance, late_thrust=lab.late_thrust)
        result["confirmation"] = _confirmation(found, lab)
        if chooser == "informed":
            result["tracking"] = _tracking(case, place, model, found.models[told.in_use])
    except GroundError as error:
        result["failed"] = str(error)
    return result


def _flights(told):
    """How long a discovery flew, and its answer after each diagnosis."""
    excited, seconds = {}, 0.0  # time until the end of each flight, without tracking [s]
    for flight in told.flights:
        seconds += 0.0 if flight.flight.purpose == story.TRACK else flight.seconds
        excited[flight.flight.number] = seconds
    answers = [
        {"seconds": excited[f.after], "chosen": f.effects, "groups": f.groups, "verdict": f.verdict}
        for f in told.findings
    ]
    return {
        "answers": answers,
        "flown": told.flown,
        "excited": seconds,
        "flights": [[f.flight.purpose, f.seconds, f.stopped] for f in told.flights],
        "sure": told.sure,
        "reason": told.reason,
        "compared": told.tracking.sentence if told.tracking else "",
        "held": told.confirmation is not None and told.confirmation.holds,
    }


def _answer(found):
    """The last answer of a campaign.FlightCampaign, as hidden_score reads it."""
    last, told = found.found, found.story
    if last is None:
        return {"chosen": [], "groups": {}, "verdict": "", "where": [], "heldout": []}
    return {
        "chosen": told.findings[-1].effects,
        "groups": told.findings[-1].groups,
        "unseen": last.diagnosis.hidden_names(),
        "verdict": last.verdict,
        "where": list(last.conclusion.ceiling.arguments),
        "proposed": [c.name for c in found.analyst.own],
        "formulas": found.analyst.formulas,
        "varies": [v.parameter for v in last.conclusion.varies],
        "heldout": [float(error) for error in last.conclusion.heldout],
    }


def _confirmation(found, lab):
    """Errors along the confirming flight: of the models, and of the true motion."""
    confirmed = found.story.confirmation
    if confirmed is None:
        return None
    numbers = [f.flight.number for f in found.story.flights]
    truth = discover_floor.true_error(lab.case, lab.flown[numbers.index(confirmed.flight)], found.given)
    said = {"given": confirmed.given, "final": confirmed.final, "expected": confirmed.floor}
    return dict(said, truth=truth)


def _tracking(case, place, given, final):
    """True error [m] of a rhodonea by ModelPredictive with both models, over the same CHECKS; None where one
    was stopped. The disturbance and noise of a check are the same with both."""
    errors = []
    for model in (given, final):
        squares = [_squares(case, place, model, check) for check in CHECKS]
        stopped = any(s is None for s in squares)
        errors.append(None if stopped else float(np.sqrt(np.concatenate(squares).mean())))
    return {"before": errors[0], "after": errors[1]}


def _squares(case, place, model, number):
    """Squared distances [m^2] of a craft from a rhodonea that it tracks; None where it was stopped."""
    size = tracking.SIZE * place.clearance(place.home)
    flight = story.Flight(number, story.TRACK, "", tracking.SECONDS, reference=tracking.REFERENCE, size=size)
    lab = discover_lab.HiddenLaboratory(case, model, place)
    landed = lab.fly(flight, np.empty((0, 0)))
    if landed.stopped:
        return None
    run = lab.flown[0][0]
    references = run.references[run.references[:, 0] >= run.references[0, 0] + tracking.SETTLING]
    at = np.minimum(np.searchsorted(run.truth_times, references[:, 0]), len(run.truth_times) - 1)
    off = hidden_craft.seen(case.effects, run.truth_eta[at])[:, :2] - references[:, 1:3]
    return (off**2).sum(axis=1)


def jobs_of(options):
    """Jobs that the options ask for. Kinds alternate: an interrupted bench has results of each."""
    counts = {kind: options.count or cases.KINDS[kind][1] for kind in options.kinds}
    for number in range(max(counts.values())):
        for kind, count in counts.items():
            if number < count:
                for chooser in options.choosers:
                    yield kind, options.seed_base + number, chooser


def key_of(result):
    """The job that gave a result."""
    return result["kind"], result["seed"], result["chooser"]


def bench(options):
    """Runs the jobs without a result and prints the table of all jobs."""
    team = workers.Workers(processes=True, count=options.jobs)
    wanted = list(jobs_of(options))
    results = resumed.results(team, options.results, wanted, tuple, key_of, run_case, options.hours)
    print(discover_table.summary(results))
    results = discover_table.usable(results)
    tables = discover_table.lines(results), discover_table.verdicts(results)
    hidden_table.write(options.markdown, *tables)


def main():
    parser = resumed.parser(__doc__, "build/discover.jsonl")
    kinds = list(cases.KINDS)
    parser.add_argument("--kinds", nargs="+", default=kinds, choices=kinds, metavar="KIND",
                        help="some of %s (all)" % ", ".join(kinds))  # fmt: skip
    parser.add_argument("--choosers", nargs="+", default=list(CHOOSERS), choices=list(CHOOSERS),
                        help="how experiments are chosen (both)")  # fmt: skip
    return resumed.status(bench, parser.parse_args())


if __name__ == "__main__":
    sys.exit(main())
