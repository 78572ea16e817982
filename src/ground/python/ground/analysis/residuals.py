"""Whether a model's residuals are white and independent of the inputs (Ljung 1999, 16.6).

Residuals of a simulation, and velocities from a smoother, are correlated by construction. The tests
therefore use innovations: each measured pose minus its prediction by a Kalman filter around the
model and a white force of the likeliest level. Innovations of a true model are white, whatever the
spacing of the stamps, and independent of the inputs.
"""

from dataclasses import dataclass, field
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import windows
from ground.analysis.distributions import normal_limit
from ground.analysis.likelihood import ABSENT
from ground.analysis.thinning import thinned
from ground.poses import scatter
from ground.support import records
from ground.support.annotations import Array, Indices

LAGS = 40  # number of lags of the auto-correlation [samples]
BARTLETT_LAGS = 100  # lags over which residuals widen the band of that correlation [samples]
INPUT_LAGS = np.arange(-0.2, 0.801, 0.04)  # positive: the input precedes the residual [time scales]
BAND = 0.99
SETTLING = 10  # samples for the filter to settle at the start of a stretch
ITERATIONS = 5  # at most, in each fit of the levels: further ones change the levels little
UNITS = {"X": "N", "Y": "N", "N": "N m"}


@dataclass(frozen=True)
class NoiseLevel:
    """A fitted level."""

    value: float
    unit: str


@dataclass(frozen=True)
class Correlation:
    """Correlation of residuals at some lags, with its band."""

    lag_samples: Optional[List[int]] = field(metadata={records.ABSENT: None})  # of the auto-correlation
    value: List[float]
    band99: List[float]  # half width
    outside: int  # lags whose value is outside
    lags: int  # number of them
    accepted: bool  # whether a true model's residuals may be so
    lag_seconds: List[float]


@dataclass(frozen=True)
class ChannelCorrelations:
    """Correlations of the residuals of a channel; None: the command never changes."""

    autocorrelation: Correlation
    input_sum: Optional[Correlation]
    input_difference: Optional[Correlation]


@dataclass(frozen=True)
class ResidualTests:
    """Whether residuals are white and independent of the inputs."""

    of: str  # what the residuals are
    band: float  # probability that a value of a true model is inside
    samples: int
    noise: Dict[str, NoiseLevel]
    channels: Dict[str, ChannelCorrelations]
    white: bool  # whether a true model's residuals may be so: they follow neither themselves nor a command


def analyse(
    run: _core.RunData, model: _core.Model, box: _core.GreyBox, point: _core.GreyBoxPoint
) -> ResidualTests:
    """Auto-correlation and correlation with the commanded push of a model's thrusters ahead
    (`input_sum`) and to turn (`input_difference`), with 99% bands.

    box, point: the run's likelihood with a white disturbance. Pairs never span a gap. Lags of the
    auto-correlation count samples: innovations are white sample by sample.
    """
    left = box.residuals(point, 0)
    starts = np.flatnonzero(~np.array(left["scored"]))
    stretch = np.searchsorted(starts, np.arange(len(run.times)), side="right") - 1
    valid = np.arange(len(run.times)) - starts[stretch] >= SETTLING
    x, y, heading = np.array(left["whitened"])[:, :3].T
    c, s = np.cos(left["states"][:, 2]), np.sin(left["states"][:, 2])
    times, lags = np.array(run.times), windows.time_scale([run]) * INPUT_LAGS
    pushed = [model.forces(held(run, times - lag)) for lag in (0.0, *lags)]
    channels = {}
    for channel, values in (("ahead", c * x + s * y), ("starboard", c * y - s * x), ("heading", heading)):
        values = np.where(valid, values, np.nan)
        values = values - np.nanmean(values)
        channels[channel] = ChannelCorrelations(
            _autocorrelation(values, stretch, scatter.interval(times)),
            _with_input(values, [forces[:, 0] for forces in pushed], lags),
            _with_input(values, [forces[:, 2] for forces in pushed], lags),
        )
    return ResidualTests(
        of="innovations of the pose, Kalman filter around the model with white force",
        band=BAND,
        samples=int(valid.sum()),
        noise=levels(point, run, "white"),
        channels=channels,
        white=all(one is None or one.accepted for c in channels.values() for one in vars(c).values()),
    )


def commands(model: _core.Model) -> Dict[str, str]:
    """The commands that `analyse` correlates residuals with, in words by their keys."""
    if model.is_pair:
        return {"input_sum": "u_L+u_R", "input_difference": "u_L-u_R"}
    return {"input_sum": "the commanded thrust ahead", "input_difference": "the commanded moment"}


def disturbance(
    run: _core.RunData, model: _core.Model, kind: str
) -> Tuple[_core.GreyBox, _core.GreyBoxPoint]:
    """The likelihood of a run's poses, and its maximum over the levels of pose noise and of a wrench in the
    body frame: "sigma", correlated over time, or "white", which leaves everything else in the
    innovations."""
    box = _core.GreyBox([thinned(run)], model)
    start = box.start(model).levels
    fitted = ["position", "heading"] + [kind + "_" + channel for channel in UNITS]
    off = ("thrust",) if kind == "sigma" else ("sigma", "trim", "thrust")  # what is not white
    absent = {name: ABSENT * value for name, value in start.items() if name.startswith(off)}
    point = _core.GreyBoxPoint(model, {**start, **absent})
    held = [name for name in start if name not in fitted]
    # What is correlated is asked of runs without disturbances, so that no pose is far off.
    found = box.fit(point, [], held=held, warm=kind == "sigma", max_iterations=ITERATIONS)["point"]
    return _core.GreyBox([run], model), found


def levels(point: _core.GreyBoxPoint, run: _core.RunData, kind: str) -> Dict[str, NoiseLevel]:
    """Levels of the wrench of a kind ("sigma" or "white") and of the noise of poses, with their units."""
    found, per = point.levels, " sqrt(s)" if kind == "white" else ""
    scale = np.exp(point.log_scales[0])  # of the run
    entries = [(c, scale * found[kind + "_" + c], UNITS[c] + per) for c in UNITS]
    entries += [("position", found["position"] * run.noise[0], "m")]
    entries += [("heading", found["heading"] * run.noise[2], "rad")]
    return {name: NoiseLevel(float(value), unit) for name, value, unit in entries}


def held(run: _core.RunData, times: Array) -> Array:
    """Inputs of the thrusters that hold at `times`, (n, thrusters); zero before the first."""
    inputs = np.array(run.inputs)
    given = np.vstack([np.zeros(inputs.shape[1] - 2), inputs[:, 1:-1]])
    return given[np.searchsorted(inputs[:, 0], times, side="right")]


def _autocorrelation(values: Array, stretch: Indices, step: float) -> Correlation:
    variance = np.nanmean(values**2)
    found, bands = [], []
    for lag in range(1, min(LAGS, len(values) // 4) + 1):
        products = values[lag:] * values[:-lag]
        products = products[(stretch[lag:] == stretch[:-lag]) & np.isfinite(products)]
        if len(products) < 50:
            break
        found.append(float(products.mean() / variance))
        bands.append(1 / np.sqrt(len(products)))
    lags = list(range(1, len(found) + 1))
    return _judged(found, bands, [step * k for k in lags], lags)


def _with_input(values: Array, pushed: Sequence[Array], lags: Array) -> Optional[Correlation]:
    """Correlation with a command; None when it never changes. pushed: the command at the samples, and then
    each lag [s] before."""
    good = np.isfinite(values)
    now, *earlier = pushed
    if not now[good].std() > 0:
        return None
    # Bartlett: residuals that are not white make the correlation less certain.
    correlations = [
        [series[k:] @ series[:-k] / (len(series) - k) / np.mean(series**2) for k in range(1, most)]
        for series in (np.where(good, values, 0.0), now - now[good].mean())
        for most in [min(BARTLETT_LAGS, len(series) // 4)]
    ]
    width = np.sqrt(max(1.0, 1 + 2 * float(np.prod(correlations, axis=0).sum())) / good.sum())
    found = []
    for before in (some[good] for some in earlier):
        spread = before.std() * values[good].std()
        found.append(float(np.mean((before - before.mean()) * values[good]) / spread) if spread > 0 else 0.0)
    return _judged(found, [width] * len(found), lags.tolist())


def _judged(
    found: Sequence[float],
    widths: Sequence[float],
    lags: List[float],
    lag_samples: Optional[List[int]] = None,
) -> Correlation:
    """Values with bands; accepted unless one lies outside the band of their maximum."""
    values, bands = np.array(found), np.array(widths)
    band = normal_limit(0.5 * (1 - BAND)) * bands
    furthest = normal_limit(0.5 * (1 - BAND) / max(1, len(values)))
    return Correlation(
        lag_samples=lag_samples,
        value=values.tolist(),
        band99=band.tolist(),
        outside=int((np.abs(values) > band).sum()),
        lags=len(values),
        accepted=bool((np.abs(values) <= furthest * bands).all()),
        lag_seconds=lags,
    )
