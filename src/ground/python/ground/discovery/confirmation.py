"""Whether the final model predicts a test flight, which neither fit nor choice of flights has used."""

from typing import Optional

import numpy as np

from ground import _core
from ground.analysis import window_error
from ground.discovery import analyst
from ground.discovery.analyst import FlightDiagnosis
from ground.discovery.story import Confirmation, Flown
from ground.reports.words import number

TOLERANCE = 1.1  # largest ratio of a final model's error to those that are expected of it


def of(flown: Flown, run: _core.RunData, found: FlightDiagnosis, model: _core.Model) -> Confirmation:
    """The Confirmation by a flight. run: its recording; found: the diagnosis of all flights before it;
    model: the final one."""
    varies = bool(found.conclusion.varies)
    expected = analyst.expected_errors(run, found.diagnosis.fit, trimmed=varies)
    refitted = analyst.error(
        run, found.conclusion.before.model
    )  # the given model, fitted to the same flights
    given, final = analyst.error(run, found.diagnosis.given), analyst.error(run, model)
    most = TOLERANCE * min(e for e in (max(expected), given, refitted) if e is not None)
    holds = final is not None and final <= most
    noise = float(window_error.noise_floor([run], model).sum())
    sentence = (
        "The final model %s the test flight: its error is %s, where at most %.3f was allowed and a perfect "
        "model would reach %s because of measurement noise. The given model's error is %s, refitted to "
        "the same flights %s."
        % (
            "predicts" if holds else "does not predict",
            _number(final), most, number(noise), _number(given), _number(refitted),
        )
    )  # fmt: skip
    floor = float(np.mean(expected))
    return Confirmation(flown.flight.number, given, final, floor, holds, sentence, refitted, most)


def _number(value: Optional[float]) -> str:
    return "not finite" if value is None else "%.3f" % value
