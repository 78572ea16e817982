"""Inputs that a lab can play: what the next experiment, and the flights of a discovery, are chosen from."""

import itertools
from dataclasses import dataclass
from typing import Any, Dict, Iterator, Optional

from ground import _core
from ground.simulation import experiments
from ground.support.annotations import Array

LIFTS = (1.0, 0.6)
CLOCKS = (5.0, 10.0, 20.0)  # bits of the PRBS per second [Hz]
LEVELS = ((0.0, 1.0), (0.0, 0.5), (0.4, 1.0))
HOLDS = (0.25, 1.0)  # how long a pattern holds a level [s]
PATTERNS = {
    "multilevel-prbs": "random levels",
    "steps": "all thrusters in steps",
    "coast-down": "full thrust, then coasting down",
    "spin": "one side, then spinning down",
    "single-thruster": "one thruster after the other",
}


@dataclass(frozen=True)
class Design:
    """Inputs of any length."""

    words: str
    kind: str  # its name (_core.design_table)
    options: Dict[str, Any]  # members of _core.DesignParams
    lift: float

    def rows(self, seconds: float, model: Optional[_core.Model] = None, seed: int = 1) -> Array:
        """Rows time [s], inputs of the thrusters of a model (default: left and right). ValueError where these
        cannot play it."""
        return experiments.rows(self.kind, seconds, model, seed=seed, **self.options)


def designs() -> Iterator[Design]:
    """All Designs to choose from."""
    for lift in LIFTS:
        at_lift = "" if lift == 1.0 else ", lift at %g" % lift
        for clock, (low, high) in itertools.product(CLOCKS, LEVELS):
            words = "PRBS of %g Hz between %g and %g of full thrust" % (clock, low, high)
            yield Design(words + at_lift, "prbs", {"clock": clock, "levels": [low, high]}, lift)
        for hold, (kind, words) in itertools.product(HOLDS, PATTERNS.items()):
            options = {"clock": 1 / hold} if "prbs" in kind else {"hold": hold}
            yield Design("%s, %g s each%s" % (words, hold, at_lift), kind, options, lift)
