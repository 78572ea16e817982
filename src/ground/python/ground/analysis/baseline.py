"""How well a model predicts without the effects that were found: what their gain is measured against.

A diagnosis fits by likelihood. Where an effect is missing, a fit by simulation error may predict
much better. Their gain is therefore measured against the better of both.
"""

import dataclasses
from dataclasses import dataclass
from typing import Iterator, List, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import study
from ground.analysis.diagnosis import Diagnosis
from ground.analysis.likelihood import Fit, Likelihood
from ground.annotations import Array, Document
from ground.errors import GroundError
from ground.recordings import windows

LIKELIHOOD, SIMULATION = "likelihood", "simulation"  # what a refit minimises or maximises


@dataclass(frozen=True)
class Refit:
    """A model refitted without further effects."""

    by: str  # LIKELIHOOD or SIMULATION
    model: _core.Model
    parameters: Sequence[Document]
    error: float  # on the runs fitted to
    heldout: float  # on runs held out


def refits(found: Diagnosis, heldout: Sequence[_core.RunData] = ()) -> Tuple[Refit, ...]:
    """The model as it is, refitted by likelihood and, where it can be simulated, by simulation error.
    Errors are over the windows and folds of a Diagnosis, or on the runs of `heldout`."""
    judged, fit = found.nominal, found.search.nominal()
    without = errors_on(found, heldout, [fit])[0] if heldout else float(judged.heldout.sum())
    known = tuple(judged.parameters.values())
    by_likelihood = Refit(LIKELIHOOD, judged.model, known, float(judged.error.sum()), without)
    try:
        return by_likelihood, _by_simulation(found, fit, heldout)
    except GroundError:  # the simulation diverges
        return (by_likelihood,)


def _by_simulation(found: Diagnosis, near: Fit, heldout: Sequence[_core.RunData]) -> Refit:
    given = found.given
    fitted = found.study.fit(given, study.free_parameters(given), also=[near.model])
    errors = list(_simulated(found, fitted, near, heldout))
    parameters = tuple(fitted.parameters.values())
    return Refit(SIMULATION, fitted.model, parameters, float(fitted.error.sum()), min(errors))


def _simulated(
    found: Diagnosis, fitted: study.Fit, near: Fit, heldout: Sequence[_core.RunData]
) -> Iterator[float]:
    """Errors of a fit by simulation error, as it is and, where runs differ, with the differences
    estimated as for all other models."""
    near = dataclasses.replace(near, loudness=())

    def known(likelihood: Likelihood, model: _core.Model) -> Fit:
        return likelihood.fit(model, [], near=near)

    if heldout:
        cut = windows.cut(heldout)
        yield float(study.channel_errors(heldout, cut, fitted.model).sum())
        if found.likelihood.varying:
            yield from errors_on(found, heldout, [known(found.likelihood, fitted.model)])
        return
    yield float(fitted.heldout.sum())
    if found.likelihood.varying:
        models = [fitted.by_part.get(i, fitted.model) for i in range(found.folds.count)]
        fits = list(found.pool.map(known, found.folds.fitted, models))
        yield float(found.folds.error(fits).sum())


def errors_on(
    found: Diagnosis, heldout: Sequence[_core.RunData], fits: Sequence[Fit]
) -> List[float]:
    """Errors of Fits on runs that the user held out. Differences between runs are estimated from the
    poses before each window, as in the folds."""
    cut = windows.cut(heldout)
    likelihood = Likelihood(heldout, found.given, found.likelihood.varying)
    samples = [w.last - w.first + 1 for w in cut]

    def error(fit: Fit) -> Array:
        each = study.calibrated_errors(heldout, cut, likelihood, fit)
        return np.asarray(np.average(each, axis=0, weights=samples))

    return [float(error(fit).sum()) for fit in fits]
