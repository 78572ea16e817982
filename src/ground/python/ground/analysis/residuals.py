"""Whether a model's residuals are white and independent of the inputs (Ljung 1999, 16.6).

Residuals of a simulation, and velocities from a smoother, are correlated by construction. The tests
therefore use innovations: each measured pose minus its prediction by a Kalman filter around the
model and a white force of the likeliest level. Innovations of a true model are white, whatever the
spacing of the stamps, and independent of the inputs.
"""

from statistics import NormalDist
from typing import Dict, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis.likelihood import ABSENT
from ground.analysis.thinning import thinned
from ground.recordings import scatter, windows
from ground.support.annotations import Array, Document, Indices

CHANNELS = ("ahead", "starboard", "heading")
LAGS = 40  # number of lags of the auto-correlation [samples]
BARTLETT_LAGS = 100  # lags over which residuals widen the band of that correlation [samples]
INPUT_LAGS = np.arange(-0.2, 0.801, 0.04)  # positive: the input precedes the residual [time scales]
BAND = 0.99
SETTLING = 10  # samples for the filter to settle at the start of a stretch
ITERATIONS = 5  # at most, in each fit of the levels: further ones change the levels little
UNITS = {"X": "N", "Y": "N", "N": "N m"}
CORRELATED = ("sigma", "trim", "thrust")  # levels of what is not white


def analyse(
    run: _core.RunData, model: _core.Model, box: _core.GreyBox, point: _core.GreyBoxPoint
) -> Document:
    """Auto-correlation and correlation with what the thrusters of a model are told to push ahead
    (`input_sum`) and to turn (`input_difference`), with 99% bands.

    box, point: the run's likelihood with a white disturbance. Pairs never span a gap. Lags of the
    auto-correlation count samples: innovations are white sample by sample.
    """
    left = box.residuals(point, 0)
    starts = np.flatnonzero(~np.array(left["scored"]))
    stretch = np.searchsorted(starts, np.arange(len(run.times)), side="right") - 1
    valid = np.arange(len(run.times)) - starts[stretch] >= SETTLING
    residual = np.array(left["whitened"])[:, :3]
    c, s = np.cos(left["states"][:, 2]), np.sin(left["states"][:, 2])
    residual[:, 0], residual[:, 1] = (
        c * residual[:, 0] + s * residual[:, 1],
        c * residual[:, 1] - s * residual[:, 0],
    )
    times = np.array(run.times)
    result: Document = {
        "of": "innovations of the pose, Kalman filter around the model with white force",
        "band": BAND,
        "samples": int(valid.sum()),
        "noise": levels(point, run, "white"),
        "channels": {},
    }
    step = scatter.interval(times)
    for channel, name in enumerate(CHANNELS):
        values = np.where(valid, residual[:, channel], np.nan)
        values = values - np.nanmean(values)
        auto = _autocorrelation(values, stretch)
        entry: Document = {"autocorrelation": dict(auto, lag_seconds=[step * k for k in auto["lag_samples"]])}
        for command in ("sum", "difference"):
            entry["input_" + command] = _with_input(values, stretch, run, times, model, command)
        result["channels"][name] = entry
    result["white"] = all(c["autocorrelation"]["accepted"] for c in result["channels"].values())
    return result


def commands(model: _core.Model) -> Dict[str, str]:
    """The commands that `analyse` correlates residuals with, in words by their keys."""
    names = ("u_L+u_R", "u_L-u_R")
    if not model.is_pair:
        names = ("the commanded thrust ahead", "the commanded moment")
    return dict(zip(("input_sum", "input_difference"), names))


def disturbance(
    run: _core.RunData, model: _core.Model, kind: str
) -> Tuple[_core.GreyBox, _core.GreyBoxPoint]:
    """The likelihood of a run's poses, and its maximum over the levels of pose noise and of a wrench in the
    body's frame: "sigma", correlated over time, or "white", which leaves everything else in the
    innovations."""
    box = _core.GreyBox([thinned(run)], model)
    start = box.start(model).levels
    fitted = ["position", "heading"] + [kind + "_" + channel for channel in UNITS]
    absent = ["thrust"] if kind == "sigma" else [name for name in start if name.startswith(CORRELATED)]
    point = _core.GreyBoxPoint(model, {**start, **{name: ABSENT * start[name] for name in absent}})
    held = [name for name in start if name not in fitted]
    # What is correlated is asked of runs without disturbances, so that no pose is far off.
    found = box.fit(point, [], held=held, warm=kind == "sigma", max_iterations=ITERATIONS)["point"]
    return _core.GreyBox([run], model), found


def levels(point: _core.GreyBoxPoint, run: _core.RunData, kind: str) -> Document:
    """Levels of the wrench of a kind ("sigma" or "white") and of the noise of poses, with their units."""
    found, per = point.levels, " sqrt(s)" if kind == "white" else ""
    scale = np.exp(point.log_scales[0])  # of the run
    entries = [(c, scale * found[kind + "_" + c], UNITS[c] + per) for c in UNITS]
    entries += [("position", found["position"] * run.noise[0], "m")]
    entries += [("heading", found["heading"] * run.noise[2], "rad")]
    return {name: {"value": float(value), "unit": unit} for name, value, unit in entries}


def held(run: _core.RunData, times: Array) -> Array:
    """Inputs of each thruster and lift that hold at `times`, (n, thrusters + 1); zero before the
    first."""
    inputs = run.inputs
    index = np.searchsorted(inputs[:, 0], times, side="right") - 1
    return np.where(index[:, None] >= 0, inputs[np.maximum(index, 0), 1:], 0.0)


def _autocorrelation(values: Array, stretch: Indices) -> Document:
    variance = np.nanmean(values**2)
    lags, found, bands = [], [], []
    for lag in range(1, min(LAGS, len(values) // 4) + 1):
        products = values[lag:] * values[:-lag]
        products = products[(stretch[lag:] == stretch[:-lag]) & np.isfinite(products)]
        if len(products) < 50:
            break
        lags.append(lag)
        found.append(float(products.mean() / variance))
        bands.append(1 / np.sqrt(len(products)))
    return dict({"lag_samples": lags}, **_judged(found, bands))


def _with_input(
    values: Array,
    stretch: Indices,
    run: _core.RunData,
    times: Array,
    model: _core.Model,
    command: str,
) -> Optional[Document]:
    """Correlation with the command at each lag; None when it never changes."""

    def told(at: Array) -> Array:
        return np.asarray(model.forces(held(run, at)[:, :-1])[:, 0 if command == "sum" else 2])

    good = np.isfinite(values)
    now = told(times)
    if not now[good].std() > 0:
        return None
    # Bartlett: residuals that are not white make the correlation less certain.
    lags = min(BARTLETT_LAGS, len(values) // 4)
    own, told_before = (
        _products(series, lags) / np.mean(series**2)
        for series in (np.where(good, values, 0.0), now - now[good].mean())
    )
    widening = 1 + 2 * float((own * told_before).sum())
    width = np.sqrt(max(1.0, widening) / good.sum())
    found, lags_tried = [], windows.time_scale([run]) * INPUT_LAGS
    for lag in lags_tried:
        before = told(times - lag)[good]
        spread = before.std() * values[good].std()
        found.append(float(np.mean((before - before.mean()) * values[good]) / spread) if spread > 0 else 0.0)
    judged = _judged(found, [width] * len(found))
    return dict({"lag_seconds": lags_tried.tolist()}, **judged)


def _products(series: Array, lags: int) -> Array:
    """Mean products of a series (n,) with itself, 1 to `lags` - 1 samples later."""
    count = len(series)
    spectrum = np.fft.rfft(series, 2 * count)  # padded, so that the end does not meet the start
    sums = np.fft.irfft(np.abs(spectrum) ** 2, 2 * count)
    lag = np.arange(1, max(1, lags))
    return np.asarray(sums[lag] / (count - lag))


def _judged(found: Sequence[float], widths: Sequence[float]) -> Document:
    """Values with bands; accepted unless one lies outside the band of their maximum."""
    values, bands = np.array(found), np.array(widths)
    quantile = NormalDist().inv_cdf(0.5 + BAND / 2)
    outside = int((np.abs(values) > quantile * bands).sum())
    furthest = NormalDist().inv_cdf(1 - 0.5 * (1 - BAND) / max(1, len(values)))
    return {
        "value": values.tolist(),
        "band99": (quantile * bands).tolist(),
        "outside": outside,
        "lags": len(values),
        "accepted": bool((np.abs(values) <= furthest * bands).all()),
    }
