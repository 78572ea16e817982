"""Where a model fails: its error and the missing wrench, against everything that was measured."""

from dataclasses import dataclass
from typing import Any, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis import comparison, residuals
from ground.annotations import Array, Document, Indices
from ground.recordings import repair

RATE = 25.0  # sampling rate of wrench and error, which are smoother than that [Hz]
BINS = 10
SHIFTS = 300
MIN_SHARE = 0.1  # share of the variance that a variable must explain to be named
MAX_CHANCE = 0.01  # largest probability of such a share by chance
BLOCKS = 20  # blocks of a run, left out in turn for standard errors
MAX_WRENCH = 3.0  # largest missing wrench, in multiples of full thrust; a larger one is a disturbance
MAX_OUTLIER = 8.0  # the same in robust standard deviations
EVENT_MARGIN = 0.3  # time cut on both sides of a disturbance [s]
COMMAND_LAGS = (0.0, 0.05, 0.1, 0.2, 0.3)  # possible lags of thrust behind its command [s]
RIDGE = 3e-3  # penalty of the regression on bins
MIN_WRENCH = 0.01  # share of full thrust below which a wrench counts as zero
MAP_CELLS = 5  # cells along each side of the map
MIN_AXES_ANGLE = 30.0  # angle from which the body axes are taken to be wrong [deg]

Span = Tuple[float, float]  # start, end [s]

CHANNELS = ("X", "Y", "N")
CHANNEL_NAMES = {"X": "surge force X", "Y": "side force Y", "N": "yaw moment N"}
CHANNEL_UNITS = {"X": "N", "Y": "N", "N": "N m"}


@dataclass
class Variable:
    """Something measured that a failure may depend on, sorted into bins."""

    name: str
    label: str
    unit: str
    centres: List[Any]  # middles of the bins; pairs x, y for the map
    index: Indices  # (n,) bin of each sample, -1 for none

    def indicators(self) -> Array:
        """(n, bins): 1 where a sample is in a bin, else 0."""
        return np.asarray((self.index[:, None] == np.arange(len(self.centres))).astype(float))


def variables(run: _core.RunData, model: _core.Model) -> Dict[str, Variable]:
    """All variables of a run of a model's craft, by name; inputs as shares of the largest."""
    times, eta, nu = np.array(run.times), np.array(run.eta), np.array(run.nu)
    heading = np.degrees(repair.wrap(eta[:, 2]))
    found = [
        _binned("time", "time since the drive began", "s", np.array(run.t)),
        *_commands(residuals.held(run, times)[:, :-1] / model.input_max, model),
        _binned("speed", "speed", "m/s", np.hypot(nu[:, 0], nu[:, 1])),
        _binned("u", "surge u", "m/s", nu[:, 0]),
        _binned("v", "sway v", "m/s", nu[:, 1]),
        _binned("r", "yaw rate r", "rad/s", nu[:, 2]),
        _binned("heading", "heading", "deg", heading, np.arange(-180.0, 181.0, 30.0)),
        _binned("x", "world x", "m", eta[:, 0]),
        _binned("y", "world y", "m", eta[:, 1]),
        _map(eta),
    ]
    return {v.name: v for v in found}


def _commands(inputs: Array, model: _core.Model) -> Iterator[Variable]:
    """The inputs (n, thrusters), and what they do together."""
    if model.is_pair:
        left, right = inputs.T
        yield _binned("u_L", "input u_L", "-", left)
        yield _binned("u_R", "input u_R", "-", right)
        yield _binned("u_L+u_R", "total thrust u_L+u_R", "-", left + right)
        yield _binned("u_L-u_R", "thrust difference u_L-u_R", "-", left - right)
        return
    for thruster, values in zip(model.thrusters, inputs.T):
        name = "u_" + thruster["name"]
        yield _binned(name, "input " + name, "-", values)
    ahead, starboard, turn = model.forces(inputs).T
    yield _binned("thrust ahead", "thrust ahead, over k", "-", ahead)
    yield _binned("thrust to starboard", "thrust to starboard, over k", "-", starboard)
    yield _binned("moment", "moment of the thrusters, over k l", "-", turn)


def _binned(
    name: str, label: str, unit: str, values: Array, edges: Optional[Array] = None
) -> Variable:
    levels = np.unique(np.round(values, 6))
    if edges is None and len(levels) <= BINS:
        index = np.argmin(np.abs(values[:, None] - levels), axis=1)
        return Variable(name, label, unit, levels.tolist(), index)
    if edges is None:
        edges = np.unique(np.quantile(values, np.linspace(0, 1, BINS + 1)))
    index = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    index = _without_rare(index)
    present = [i for i in range(len(edges) - 1) if (index == i).any()]
    centres = [float(np.median(values[index == i])) for i in present]
    return Variable(name, label, unit, centres, _renumbered(index, present))


def _map(eta: Array) -> Variable:
    sides = []
    for values in eta[:, :2].T:
        edges = np.linspace(values.min(), values.max(), MAP_CELLS + 1)
        cell = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, MAP_CELLS - 1)
        sides.append((cell, (edges[1:] + edges[:-1]) / 2))
    (i, x), (j, y) = sides
    index = _without_rare(i * MAP_CELLS + j)
    present = [c for c in range(MAP_CELLS**2) if (index == c).any()]
    centres = [(float(x[c // MAP_CELLS]), float(y[c % MAP_CELLS])) for c in present]
    return Variable("position", "place (x, y)", "m", centres, _renumbered(index, present))


def _without_rare(index: Indices) -> Indices:
    """Bins with less than 1% of the samples say nothing."""
    share = np.bincount(index) / len(index)
    return np.where(share[index] < 0.01, -1, index)


def _renumbered(index: Indices, present: Sequence[int]) -> Indices:
    table = np.full(max(present, default=0) + 2, -1)
    table[present] = np.arange(len(present))
    return table[index]


def share_explained(design: Array, values: Array) -> Dict[str, float]:
    """Share of the variance of a series that the columns of `design` explain.

    Both drift slowly, so that part of the share is chance. Circular shifts of the series by 5 to
    95% of the run estimate that part. The corrected share is zero at the mean of the shifts and one
    for all of the variance; `p` is the proportion of shifts that explain as much.
    """
    values = values - values.mean()
    total = (values**2).sum()
    if not total > 0:
        return {"raw": 0.0, "share": 0.0, "p": 1.0}
    left, sizes, _ = np.linalg.svd(design - design.mean(axis=0), full_matrices=False)
    left = left[:, sizes > 1e-6 * max(sizes.max(), 1e-300)]
    raw = float(((left.T @ values) ** 2).sum() / total)
    offsets = (np.linspace(0.05, 0.95, SHIFTS) * len(values)).astype(int)
    chance = (_shifted_products(left, values)[:, offsets] ** 2).sum(axis=0) / total
    corrected = (raw - chance.mean()) / max(1e-9, 1 - chance.mean())
    return {
        "raw": raw,
        "share": float(np.clip(corrected, 0, 1)),
        "p": float((1 + (chance >= raw).sum()) / (1 + SHIFTS)),
    }


def _shifted_products(columns: Array, values: Array) -> Array:
    """Products (columns, n) of columns (n, columns) with a series, shifted circularly by each number
    of samples, by Fourier transforms."""
    spectrum = np.fft.rfft(columns.T) * np.conj(np.fft.rfft(values))
    return np.asarray(np.fft.irfft(spectrum, len(values)))


def regress(design: Array, values: Array, ridge: float = 0.0) -> Tuple[Array, Array, Array]:
    """Least squares coefficients, their standard errors and the coefficients without each block.

    Standard errors by jackknife over blocks of time. `ridge`, as a share of the mean square of the
    columns, keeps combinations at zero that the data do not determine.
    """
    blocks = np.array_split(np.arange(len(values)), BLOCKS)
    normal = np.array([design[b].T @ design[b] for b in blocks])
    right = np.array([design[b].T @ values[b] for b in blocks])
    together, prior = normal.sum(axis=0), _prior(normal.sum(axis=0), ridge)
    whole = _solved(together + prior, right.sum(axis=0))
    others = np.array(
        [
            _solved(together - a + prior, right.sum(axis=0) - b)
            for a, b in zip(normal, right)
        ]
    )
    spread = np.sqrt((BLOCKS - 1) / BLOCKS * ((others - others.mean(axis=0)) ** 2).sum(axis=0))
    return whole, spread, others


def _means(design: Array, values: Array, ridge: float) -> Array:
    """The coefficients of `regress` alone."""
    normal = design.T @ design
    return _solved(normal + _prior(normal, ridge), design.T @ values)


def _prior(normal: Array, ridge: float) -> Array:
    return np.asarray(ridge * np.trace(normal) / len(normal) * np.eye(len(normal)))


def _solved(normal: Array, right: Array) -> Array:
    return np.asarray(np.linalg.lstsq(normal, right, rcond=None)[0])


def stride_of(times: Array) -> int:
    """Step in samples that leaves about RATE samples per second; times: (n,) [s]."""
    return max(1, int(round(1 / RATE / max(1e-6, np.median(np.diff(times))))))


def of_error(evaluation: comparison.Evaluation, found: Mapping[str, Variable]) -> Document:
    """Error per channel against each variable, and the share of it that each explains."""
    size = np.abs(evaluation.residual) / evaluation.sigma
    index = evaluation.index
    every = slice(None, None, stride_of(np.concatenate([p["times"] for p in evaluation.pieces])))
    result = {}
    for name, variable in found.items():
        design = variable.indicators()[index]
        count = design.sum(axis=0)
        mean = design.T @ size / np.maximum(count, 1)[:, None]
        result[name] = {
            "label": variable.label,
            "unit": variable.unit,
            "centres": variable.centres,
            "samples": count.astype(int).tolist(),
            "error": {c: mean[:, i].tolist() for i, c in enumerate("uvr")},
            "share": {
                c: share_explained(design[every], size[every, i]) for i, c in enumerate("uvr")
            },
            "share_of_sum": share_explained(design[every], size[every].sum(axis=1)),
        }
    return result


def full_scale(model: _core.Model) -> Array:
    """What full thrust gives: X, Y [N], N [N m]."""
    force = 2 * model.value("k") * model.input_max
    return np.array([force, force, force * model.value("l")])


@dataclass(frozen=True)
class Undisturbed:
    """A run without its disturbances."""

    run: _core.RunData
    filter: _core.WrenchFilter  # along it
    noise: _core.WrenchNoise  # likeliest levels of a random walk
    events: List[Span]  # the disturbances


def undisturbed(model: _core.Model, run: _core.RunData) -> Undisturbed:
    """Leaves out the disturbances of a run.

    Walls, hands and wrong poses need wrenches far larger than those of a missing effect. A few of
    them would dominate the noise levels and hide everything else.
    """
    whole = _core.WrenchFilter(model, run, repair.MAX_GAP)
    noise = whole.likeliest_noise(_core.WrenchNature.random_walk)
    size = np.abs(whole.smooth(noise)["wrench"])
    usual = 1.4826 * np.median(size, axis=0)
    disturbed = (size > np.maximum(MAX_WRENCH * full_scale(model), MAX_OUTLIER * usual)).any(axis=1)
    times = np.array(run.times)
    found: List[List[float]] = []
    for time in times[disturbed]:
        if found and time - EVENT_MARGIN <= found[-1][1]:
            found[-1][1] = time + EVENT_MARGIN
        else:
            found.append([time - EVENT_MARGIN, time + EVENT_MARGIN])
    keep = np.ones(len(times), bool)
    for start, end in found:
        keep &= (times < start) | (times > end)
    if not found or keep.mean() < 0.5:
        return Undisturbed(run, whole, noise, [])
    rest = _core.RunData(
        run.name,
        times[keep],
        np.array(run.eta)[keep],
        np.array(run.nu)[keep],
        run.inputs,
        np.array(run.poses)[keep],
        run.noise,
        run.drives,
    )
    events = [(max(a, times[0]), min(b, times[-1])) for a, b in found]
    without = _core.WrenchFilter(model, rest, repair.MAX_GAP)
    noise = without.likeliest_noise(_core.WrenchNature.random_walk)
    return Undisturbed(rest, without, noise, events)


@dataclass
class Missing:
    """The missing wrench of a model along a run."""

    times: Array  # (n,) [s]
    wrench: Array  # (n, 3) X, Y [N], N [N m], body
    sigma: Array  # (n, 3) standard deviations of its estimate
    heading: Array  # (n,) [rad]
    position: Array  # (n, 2) [m]
    numbers: Document


def of_wrench(
    calm: Undisturbed, model: _core.Model, other: Optional[_core.Model] = None
) -> Missing:
    """Infers the missing wrench along an undisturbed run, and what it depends on.

    The smoother attenuates fast wrenches. Each regressor is therefore passed through the same
    smoother, so that coefficients are those of the wrench itself.

    other: a second model, perhaps better; `accounted` then says how much of the wrench it accounts
    for, inferred by the same smoother from the same poses.
    """
    run, noise = calm.run, calm.noise
    times, eta, nu = np.array(run.times), np.array(run.eta), np.array(run.nu)
    found = variables(run, model)
    totals = np.column_stack(
        [
            model.forces(residuals.held(run, times - lag)[:, :-1])[:, 0]
            for lag in COMMAND_LAGS
        ]
    )
    columns = [v.indicators() for v in found.values()] + [totals]
    acting = np.hstack(columns)
    channels = np.repeat([0, 1, 2], acting.shape[1])
    smoothed = calm.filter.smooth(noise, np.hstack([acting] * 3), channels.tolist())
    wrench, sigma = smoothed["wrench"], smoothed["sigma"]
    accounted = None
    if other is not None:
        still = _core.WrenchFilter(other, run, repair.MAX_GAP).smooth(noise)["wrench"]
        accounted = wrench - still
    every = slice(None, None, stride_of(times))
    responses = smoothed["responses"][every].reshape(-1, 3, acting.shape[1])
    result: Document = {
        "disturbances": [{"start": float(a), "end": float(b)} for a, b in calm.events],
        "noise": residuals.noise_levels(noise, "N/sqrt(s)", "N m/sqrt(s)"),
        "channels": {},
        "thrust": thrust_direction(
            wrench[every],
            responses[:, :, -len(COMMAND_LAGS) :],
            calm.filter.model_thrust[every],
            totals[every],
            nu[every],
        ),
    }
    for i, (channel, scale) in enumerate(zip(CHANNELS, full_scale(model))):
        values = wrench[every, i]
        result["channels"][channel] = {
            "unit": CHANNEL_UNITS[channel],
            "mean": float(values.mean()),
            "rms": float(np.sqrt((values**2).mean())),
            "std": float(values.std()),
            "sigma": float(np.median(sigma[:, i])),
            "full_scale": float(scale),
            "against": _against(values, responses[:, i], found),
        }
        if accounted is not None:
            result["channels"][channel]["accounted"] = _accounted(
                values, accounted[every, i], responses[:, i], found
            )
    return Missing(times, wrench, sigma, eta[:, 2], eta[:, :2], result)


def _against(values: Array, responses: Array, found: Mapping[str, Variable]) -> Document:
    """Means of a channel of the wrench in the bins of each variable, and its share of variance."""
    result = {}
    for name, variable, design in _designs(responses, found):
        means, errors, _ = regress(design, values, RIDGE)
        result[name] = {
            "label": variable.label,
            "unit": variable.unit,
            "centres": variable.centres,
            "mean": means.tolist(),
            "standard_error": errors.tolist(),
            "share": share_explained(design, values),
        }
    return result


def _designs(
    responses: Array, found: Mapping[str, Variable]
) -> Iterator[Tuple[str, Variable, Array]]:
    """Name, variable, and the smoother's responses to each of its bins (n, bins)."""
    at = 0
    for name, variable in found.items():
        yield name, variable, responses[:, at : at + len(variable.centres)]
        at += len(variable.centres)


def _accounted(
    values: Array, accounted: Array, responses: Array, found: Mapping[str, Variable]
) -> Document:
    """Share of a channel's mean square that another model accounts for, and its means in the bins."""
    total = (values**2).sum()
    rest = ((values - accounted) ** 2).sum()
    means = {
        name: _means(design, accounted, RIDGE).tolist()
        for name, _, design in _designs(responses, found)
    }
    return {"share": float(1 - rest / total) if total > 0 else 0.0, "mean": means}


def thrust_direction(
    wrench: Array, responses: Array, model_thrust: Array, totals: Array, nu: Array
) -> Optional[Document]:
    """Direction and size of the force that follows the thrust command, by model and in truth.

    The model's and the missing force are both regressed on the command u_L+u_R at COMMAND_LAGS,
    and on u and v, for damping that is wrong. The sum of both, over all lags, is the force that
    a constant command produces. `responses`: the smoother's responses to the command at each
    lag, (n, 3, lags). None when the command never changes.
    """
    if not totals[:, 0].std() > 0:
        return None
    constant = np.ones(len(wrench))
    lags = len(COMMAND_LAGS)
    by_model, missing, jackknife = [], [], []
    for i in (0, 1):
        coefficients = regress(np.column_stack([totals, constant]), model_thrust[:, i])[0]
        by_model.append(coefficients[:lags].sum())
        columns = np.column_stack([responses[:, i], constant, nu[:, 0], nu[:, 1]])
        scale = np.sqrt((columns**2).mean(axis=0))
        coefficients, _, others = regress(columns / scale, wrench[:, i])
        missing.append((coefficients / scale)[:lags].sum())
        jackknife.append((others / scale)[:, :lags].sum(axis=1))
    own = np.array(by_model)
    measured = own + missing
    others = own[:, None] + np.array(jackknife)
    angle = np.degrees(np.arctan2(measured[1], measured[0]))
    spread = np.degrees(
        np.angle(np.exp(1j * (np.arctan2(others[1], others[0]) - np.radians(angle))))
    )
    own_size, size = np.hypot(*own), np.hypot(*measured)
    own_angle = np.degrees(np.arctan2(own[1], own[0])) if own_size > 0 else 0.0
    off = float(np.degrees(repair.wrap(np.radians(angle - own_angle))))
    angle_error = float(np.sqrt((BLOCKS - 1) / BLOCKS * (spread**2).sum()))
    return {
        "model": {"angle_deg": float(own_angle), "force_per_unit_input": float(own_size)},
        "measured": {
            "angle_deg": float(angle),
            "angle_standard_error_deg": angle_error,
            "force_per_unit_input": float(size),
        },
        "off_deg": off,
        "body_axes_differ": bool(abs(off) > MIN_AXES_ANGLE and angle_error < MIN_AXES_ANGLE / 2),
    }


def is_named(share: Mapping[str, float]) -> bool:
    """Whether a share is large enough, and too large for chance, to be named."""
    return share["share"] >= MIN_SHARE and share["p"] <= MAX_CHANCE


def is_negligible(channel: Document) -> bool:
    """Whether a channel of the missing wrench is smaller than its uncertainty or MIN_WRENCH."""
    return bool(channel["rms"] < max(channel["sigma"], MIN_WRENCH * channel["full_scale"]))


def best_variable(against: Document, what: str = "share") -> Tuple[str, Document]:
    """The variable that explains most, with its corrected share."""
    name = max(against, key=lambda n: float(against[n][what]["share"]))
    return name, against[name][what]
