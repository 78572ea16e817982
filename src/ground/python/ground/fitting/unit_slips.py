"""Units in which values of a model were typed by mistake, as a fit shows them.

Motion determines ratios of the parameters. A mass that is 1000 times too large makes all fitted forces and
moments 1000 times too large; a moment of inertia in another unit is fitted back by that unit's factor.
"""

import math
from typing import Dict, Iterator, Mapping, Optional, Tuple

from ground import _core

LEAST = 0.9  # decades by which a unit changes a value
OFF = 0.35  # decades by which fitted values may differ from what a unit explains
# Fitted parameters that follow a given one: its factor makes all of them smaller.
FOLLOW = {"m": ("k", "X_u", "Y_v", "I_z", "N_r"), "l": ("I_z", "N_r")}


def found(model: _core.Model, fitted: Mapping[str, float]) -> Optional[Tuple[str, str, float]]:
    """The parameter, the unit that it was typed in, and that unit's factor to SI; None without one.

    model: with the values as typed; fitted: values of its free parameters.
    """
    moved = {
        name: math.log10(value / model.value(name))
        for name, value in fitted.items()
        if "." not in name and value > 0 and model.value(name) > 0
    }

    def misfit(unit: Tuple[str, str, float]) -> float:
        """Largest difference in decades; infinite where a parameter that would move is not free."""
        expected = _expected(unit[0], unit[2])
        if not set(expected) <= set(moved):
            return math.inf
        return max(abs(decades - expected.get(name, 0.0)) for name, decades in moved.items())

    units = [unit for unit in _core.mistaken_units() if abs(math.log10(unit[2])) > LEAST]
    best = min(units, key=misfit, default=None)
    return best if best is not None and misfit(best) < OFF else None


def _expected(key: str, factor: float) -> Dict[str, float]:
    """Decades by which a fit moves parameters if one was typed in a unit of that factor."""
    decades = math.log10(factor)
    return {name: -decades for name in FOLLOW[key]} if key in FOLLOW else {key: decades}


def sentences(model: _core.Model, fitted: Mapping[str, float]) -> Iterator[str]:
    """What a fit shows of a wrong unit, and what to write instead."""
    slip = found(model, fitted)
    if slip is None:
        return
    key, unit, factor = slip
    units = {p["name"]: p["unit"] for p in model.parameters()}
    moved = ", ".join("%s %.2g" % (n, fitted[n] / model.value(n)) for n in _expected(key, factor))
    yield (
        "fitted values are multiples of the model's (%s), as they are if its %s is in %s: write %s: %.4g%s "
        "in the model" % (moved, key, unit, key, factor * model.value(key), "  # " + units.get(key, ""))
    )
