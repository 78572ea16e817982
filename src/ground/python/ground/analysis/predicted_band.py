"""Bands of predictions by a fitted model: how far it may be off, by what it misses of runs held out.

A model that was fitted to some runs predicts others by two uncertain things: its parameters, and what
it lacks. Fits without each part of the runs differ by both (the delete-one-group jackknife: Efron and Stein
1981). By how much they differ, sample by sample, is the shape of the band: wide where a manoeuvre asks for
what the runs do not identify. Of what was known before the fit, models that are shifted by its deviations add
to it, for the runs do not identify that. Its size is calibrated: so that bands about the predictions of
held-out runs hold the wanted share of them."""

from dataclasses import dataclass
from typing import Callable, List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.poses import angles
from ground.support.annotations import Array
from ground.support.errors import GroundError

MAX_SPEED_RATIO = 1.2  # ratio of speeds from which a prediction goes beyond the runs fitted to
#: predicted samples (n, 6) of a run by a model, and the measured ones
Course = Tuple[Array, Array]
#: simulates a run; None: it is too short. GroundError when the motion is not finite
Courses = Callable[[_core.RunData, _core.Model], Optional[Course]]


@dataclass(frozen=True)
class FitWithout:
    """A model fitted without some runs, and these; without any: a model as it would be if something that
    was known before the fit were a standard deviation more."""

    model: _core.Model
    runs: Sequence[_core.RunData] = ()


def half_width(parts: Sequence[FitWithout], level: float, course: Courses, run: _core.RunData) -> Array:
    """Half the width (n, 6) of the band about the predicted samples of a run not fitted to.

    parts: of its fit, held out; level: share of the samples that the band is to hold, of each of x, y, psi,
    u, v, r; course: simulates a run. GroundError when there are fewer than two parts, or level is not between
    0 and 1.
    """
    if not 0 < level < 1:
        raise GroundError("a band holds a share between 0 and 1, not %g" % level)
    if sum(bool(part.runs) for part in parts) < 2:
        raise GroundError("a band needs a fit to two runs or more, of which each is held out")
    ratios: List[Array] = []
    for part in parts:
        for held in part.runs:
            seen = course(held, part.model)
            if seen:
                ratios.append(np.abs(_apart(seen[1], seen[0])) / _deviation(parts, held, course))
    if not ratios:
        raise GroundError("no run that the model was fitted to is long enough for the horizon of the band")
    return np.asarray(_factor(ratios, level) * _deviation(parts, run, course))


def beyond(parts: Sequence[FitWithout], predicted: Array) -> List[int]:
    """Indices of the velocities u, v, r of a prediction (n, 6) that exceed all velocities of the runs."""
    seen = np.vstack([np.array(run.nu) for part in parts for run in part.runs])
    size, most = np.abs(predicted[:, 3:]).max(axis=0), np.abs(seen).max(axis=0)
    return [int(i) for i in np.flatnonzero(size > MAX_SPEED_RATIO * most)]


def _deviation(parts: Sequence[FitWithout], run: _core.RunData, course: Courses) -> Array:
    """By how much predictions differ by chance (n, 6): the jackknife's deviation, about the mean of the fits
    without a part (two of these are further apart than each is from a fit to all), and noise."""
    predicted = [(part, seen[0]) for part in parts for seen in [course(run, part.model)] if seen]
    first = predicted[0][1]
    mean = first + np.mean([_apart(one, first) for part, one in predicted if part.runs], axis=0)
    count = sum(bool(part.runs) for part in parts)
    weights = [(count - 1) / count if part.runs else 1.0 for part, _ in predicted]
    squares = sum(w * np.square(_apart(one, mean)) for w, (_, one) in zip(weights, predicted))
    pose = np.asarray(run.noise)
    noise = np.concatenate([pose, pose / float(run.scales.window)])  # of velocities: over a window
    return np.asarray(np.sqrt(squares + np.square(noise)))


def _apart(a: Array, b: Array) -> Array:
    off = a - b
    off[:, 2] = angles.wrap(off[:, 2])
    return off


def _factor(ratios: Sequence[Array], level: float) -> Array:
    """Scale factors (6,) of the deviation, so that the band contains a share `level` of the samples of a new
    run in about the same share of runs. Runs are counted, because samples of a run depend on each other. Each
    run is predicted without itself, but the deviations are of fits to it, too, as in the jackknife+ (Barber
    et al. 2021), which guarantees 0.8 for a share of 0.9 and usually reaches 0.9. With too few runs (nine for
    0.9) it is the largest factor."""
    scores = np.sort([np.quantile(some, level, axis=0) for some in ratios], axis=0)
    return np.asarray(scores[min(int(np.ceil((len(scores) + 1) * level)), len(scores)) - 1])
