"""The voltage of the battery: at which one a model's k holds, and which runs have it."""

from dataclasses import replace
from typing import List, Sequence

import numpy as np

from ground.effect_library import candidates
from ground.models import Model
from ground.reading.recording import Recording
from ground.support.errors import GroundError, GroundNote, warn

EFFECT = "battery_voltage"  # name in the library of effects


def at_recorded(model: Model, recordings: Sequence[Recording]) -> Model:
    """The model with the voltage at which its k holds: its own, else the median of the recordings'."""
    recorded = [one.voltage.volts for one in recordings if one.voltage is not None]
    if model.core.volts or not recorded:
        return model
    core = model.core.copy()
    core.volts = round(float(np.median(np.concatenate(recorded))), 3)
    warn("k holds at %g V, the median voltage of the recordings" % core.volts, GroundNote)
    return replace(model, core=core)


def note_missing(model: Model, recordings: Sequence[Recording]) -> None:
    """Warns of runs without the voltage on which the thrust of the model depends."""
    if EFFECT not in model.effects:
        return
    without = [one.name for one in recordings if one.voltage is None]
    if without:
        warn(
            "%s: no voltage is recorded, so %s has no effect there; thrust is as at %g V"
            % (", ".join(without), EFFECT, model.core.volts)
        )


def tried(
    effects: List[candidates.Candidate],
    model: Model,
    recordings: Sequence[Recording],
    only: Sequence[str],
    exclude: Sequence[str],
) -> List[candidates.Candidate]:
    """Effects to try, with the voltage's where one is recorded. GroundError when it is wanted and no
    recording has one."""
    has_voltage = any(one.voltage is not None for one in recordings)
    if any(one.name == EFFECT for one in effects):
        if not has_voltage:
            raise GroundError("%s needs the voltage of the battery, which no recording has" % EFFECT)
        return effects
    if only or EFFECT in (*exclude, *model.effects) or not has_voltage:
        return effects
    return [*effects, candidates.of_library(EFFECT)]
