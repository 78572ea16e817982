"""The experiment that would tell apart effects that recorded runs do not (DESIGN 7.6)."""
import itertools

import numpy as np

from ground import _core, experiments, quality, study, windows
from ground.errors import IdentifyError

DURATION = 8.0  # of the thrust [s]
HOLD = 1.0  # of a pattern's levels [s]
CLOCKS = (2, 5, 10, 20, 40)  # of the PRBS [Hz]
LEVELS = ((0.0, 1.0), (0.0, 0.5), (0.4, 1.0))
LIFTS = (1.0, 0.6)
RATE = 120.0  # of the mocap [Hz]


def propose(models, noise, duration=DURATION):
    """Where rival models, fitted to the same runs, would part most.

    models: _core.Model by the name of its effect; noise: of positions [m] and headings [rad].
    Each rival is run through each experiment that a lab can do, and the others predict what it did. The
    disagreement is the error of DESIGN 8 of that prediction above the error that the noise leaves, in
    units of the latter; of all pairs, the one that is hardest to tell apart counts. Returns `separates`
    (names), `input` (a sentence), `arguments` (of identify simulate), `expected_disagreement`, and
    `all`: every experiment with its disagreement, best first.
    """
    found = []
    for words, arguments, schedule in _experiments(duration):
        try:
            found.append((_disagreement(models, schedule, noise), words, arguments))
        except IdentifyError:
            continue  # a rival does not move on this input, or not finitely
    if not found:
        return None
    found.sort(key=lambda f: -f[0])
    return {
        "separates": list(models),
        "input": found[0][1],
        "arguments": found[0][2],
        "expected_disagreement": found[0][0],
        "all": [{"input": w, "expected_disagreement": d} for d, w, _ in found],
    }


def schedule_of(arguments, duration=DURATION):
    """The schedule of an experiment by the arguments that `propose` gave."""
    return next(s for _, a, s in _experiments(duration) if a == arguments)


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
                        experiments.prbs(duration, clock, (low, high)), duration, lift
                    ),
                )
        for name, words, pattern in (
            ("steps", "both thrusters in steps from rest to full", experiments.steps),
            ("coast-down", "full thrust, then none: coasting down", experiments.coast_down),
            ("spin", "one thruster, then none: spinning down", experiments.spin),
            (
                "single-thruster",
                "one thruster after the other in steps",
                experiments.single_thruster,
            ),
        ):
            yield (
                words + at_lift,
                "--input %s --hold %g%s" % (name, HOLD, option),
                experiments.with_lift(pattern(duration, HOLD), duration, lift),
            )


def _disagreement(models, schedule, noise):
    worst = np.inf
    for a, b in itertools.permutations(models, 2):
        mocap = _core.MocapParams()
        mocap.rate, mocap.position_noise, mocap.heading_noise = (RATE,) + tuple(noise)
        recording = experiments.simulate(models[a], schedule, a, mocap=mocap)
        runs = [quality.Run(recording).data(models[a])]
        cut = windows.cut(runs)
        own = study.channel_errors(runs, cut, models[a]).sum()
        other = study.channel_errors(runs, cut, models[b]).sum()
        worst = min(worst, float(other / own - 1))
    return worst
