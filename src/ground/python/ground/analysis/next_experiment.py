"""The experiment that would tell apart effects that recorded runs do not."""
import dataclasses
import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ground import _core
from ground.analysis.likelihood import Likelihood
from ground.errors import IdentifyError
from ground.simulation import experiments

DURATION = 8.0  # of the thrust [s]
HOLD = 1.0  # of a pattern's levels [s]
CLOCKS = (2, 5, 10, 20, 40)  # of the PRBS [Hz]
LEVELS = ((0.0, 1.0), (0.0, 0.5), (0.4, 1.0))
LIFTS = (1.0, 0.6)
RATE = 120.0  # of the mocap [Hz]
REFITTED, TOGETHER = 12, 4  # experiments at most, and at a time
LEAST = 1.0  # standard deviations between rivals that make an experiment worth while
SURE = 6.0  # standard deviations that tell rivals apart in nearly all cases


@dataclass
class Rival:
    """A model that does on the recorded runs what another one does."""

    name: str
    fit: Any  # likelihood.Fit to the recorded runs


def propose(rivals, runs, each=map):
    """Where Rivals, which the same runs were explained with, would part most.

    runs: _core.RunData that the rivals were fitted to. Each rival is run through each experiment
    that a lab can do, and the others explain what it did: in the promising ones again when refitted
    to the old runs and the new one together. They are sqrt(2 (L1 - L0)) standard deviations apart,
    L the log-likelihood of the poses under the rivals' own disturbance
    (ground.analysis.likelihood); of all pairs, the one that is hardest to tell apart counts. each:
    maps over experiments, in parallel if it can.

    Returns `separates` (names), `input` (a sentence), `arguments` (of identify simulate),
    `repeat`, the number of such runs that make sure, `expected_disagreement` of one of them
    [standard deviations], and `all`: every experiment with its disagreement before the refit,
    best first. None when no experiment tells the rivals apart.
    """

    known = {rival.name: _cost(rival, runs, True) for rival in rivals}
    choice = list(_experiments(DURATION))
    before = list(each(lambda experiment: _disagreement(rivals, experiment[2], runs), choice))
    found = sorted((p for p in zip(before, choice) if p[0]), key=lambda pair: -pair[0])
    best, proposed = 0.0, None
    for at in range(0, min(REFITTED, len(found)), TOGETHER):
        if found[at][0] <= best:
            break  # to refit rivals brings them nearer to each other
        some = [experiment for _, experiment in found[at : at + TOGETHER]]
        after = each(lambda experiment: _disagreement(rivals, experiment[2], runs, known), some)
        for disagreement, experiment in zip(after, some):
            if disagreement and disagreement > best:
                best, proposed = disagreement, experiment
    if best < LEAST:
        return None
    return {
        "separates": [rival.name for rival in rivals],
        "input": proposed[0],
        "arguments": proposed[1],
        "repeat": math.ceil((SURE / best) ** 2),
        "expected_disagreement": best,
        "all": [{"input": e[0], "expected_disagreement": d} for d, e in found],
    }


def schedule_of(arguments):
    """The schedule of an experiment by the arguments that `propose` gave."""
    return next(s for _, a, s in _experiments(DURATION) if a == arguments)


def _experiments(duration):
    """Sentence, arguments of identify simulate, and Schedule of all experiments."""
    for lift in LIFTS:
        at_lift = "" if lift == 1.0 else ", lift at %g" % lift
        option = "" if lift == 1.0 else " --lift %g" % lift
        for clock in CLOCKS:
            for low, high in LEVELS:
                yield (
                    "PRBS of %g Hz between %g and %g of full thrust%s"
                    % (clock, low, high, at_lift),
                    "--input prbs --clock %g --levels %g %g%s" % (clock, low, high, option),
                    experiments.with_lift(
                        experiments.rows("prbs", duration, clock=clock, levels=[low, high]),
                        duration,
                        lift,
                    ),
                )
        for name, words in (
            ("steps", "both thrusters in steps from rest to full"),
            ("coast-down", "full thrust, then none: coasting down"),
            ("spin", "one thruster, then none: spinning down"),
            ("single-thruster", "one thruster after the other in steps"),
        ):
            yield (
                words + at_lift,
                "--input %s --hold %g%s" % (name, HOLD, option),
                experiments.with_lift(experiments.rows(name, duration, hold=HOLD), duration, lift),
            )


def _disagreement(rivals, schedule, runs, known=None):
    """Of the pair that it is smallest of: what a new run adds to the difference of their costs.
    `known`: the costs of the runs, when rivals are refitted to them and the new run. None when
    one does not move on this input, or not finitely."""
    worst = np.inf
    try:
        for true, other in itertools.permutations(rivals, 2):
            new = [_run(true.fit.model, schedule, runs[0].noise)]
            if known is None:
                apart = _cost(other, new, False) - _cost(true, new, False)
            else:
                apart = _cost(other, runs + new, True) - known[other.name]
                apart -= _cost(true, runs + new, True) - known[true.name]
            worst = min(worst, float(np.sqrt(2 * max(0.0, apart))))
    except IdentifyError:
        return None
    return worst


def _run(model, schedule, noise):
    """What a model does on a schedule, from rest, as _core.RunData: without noise, for it is the
    mean disagreement that is wanted; `noise` says how exact it is."""
    inputs = schedule.rows.copy()
    off = inputs[inputs[:, 3] > 0, 0].max() < inputs[:, 0]  # of what comes after, nothing is usable
    end = inputs[off, 0].min() if off.any() else schedule.end
    times = np.arange(experiments.LEAD, end, 1 / RATE)
    inputs[:, 1:3] *= model.input_max
    found = _core.simulate(model, inputs, times, np.zeros(3), np.zeros(3))
    if not np.isfinite(found["eta"]).all():
        raise IdentifyError("the motion is not finite")
    return _core.RunData("new", times, found["eta"], found["nu"], inputs, found["eta"], noise)


def _cost(rival, runs, refitted):
    """Of poses under a rival, as it is or refitted, the levels of the disturbance kept."""
    on = Likelihood(runs, rival.fit.model)
    near = dataclasses.replace(rival.fit, loudness=())
    if refitted:
        return -on.fit(near.model, near.free, near=near, levels=False).log_posterior
    return -float(sum(blocks.sum() for blocks in on.blocks(near)))
