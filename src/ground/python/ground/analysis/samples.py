"""What formulas of a missing wrench depend on along a run, all of it known beforehand.

The pose is the measured one; velocities are simulated for RESTART from the filter's state, because
filtered ones contain the disturbance; the past is filtered causally from commands that reach the thrusters
and from these velocities. Nothing looks ahead.
"""

from dataclasses import dataclass
from typing import Any, Dict, List, Mapping, Sequence, Tuple

import numpy as np

from ground import _core
from ground.analysis.likelihood import Fit, Likelihood, call
from ground.recordings import headings, scatter, windows
from ground.support.annotations import Array

RESTART = 0.25  # time that velocities are simulated from a filtered state [time scales]
HOPS = 3  # restarts in that time
MEMORIES = (0.05, 0.15, 0.5, 1.5, 4.0)  # time constants of the past [time scales]
SPENT = (1.0, 3.0, 10.0)  # full input over such times is used until something is spent [time scales]
SWINGS = (0.5, 0.8, 1.3, 2.0)  # frequencies of what may swing on the craft [1 / time scale]


@dataclass(frozen=True)
class Samples:
    """What the formulas of a run depend on: arrays (n,) by name."""

    values: Dict[str, Array]
    times: Array
    states: Dict[str, Array]  # values of the states of formulas
    time_scale: float  # of the craft [s]


@dataclass(frozen=True)
class Scales:
    """How far and fast the craft moved in all runs."""

    centre: Tuple[float, float]  # of its places [m]
    extent: float  # half of the larger side of the box around them [m]
    speed: float  # root mean square of u and v [m/s]
    turn: float  # of r [rad/s]
    duration: float  # [s]
    time_scale: float  # of the craft [s]

    @property
    def memories(self) -> List[float]:
        """Time constants of the past [s]."""
        return [memory * self.time_scale for memory in MEMORIES]

    @property
    def spent(self) -> List[float]:
        """What may be used of full input until something is spent [s]."""
        return [time * self.time_scale for time in SPENT]

    @property
    def swings(self) -> List[float]:
        """Frequencies of what may swing on the craft [Hz]."""
        return [frequency / self.time_scale for frequency in SWINGS]

    @staticmethod
    def of(sampled: Sequence[Samples]) -> "Scales":
        """The Scales of all runs."""

        def every(name: str) -> Array:
            return np.concatenate([s.values[name] for s in sampled])

        x, y = every("x"), every("y")
        lows, highs = (x.min(), y.min()), (x.max(), y.max())
        speed = np.sqrt((every("u") ** 2 + every("v") ** 2).mean() / 2)
        return Scales(
            (float(lows[0] + highs[0]) / 2, float(lows[1] + highs[1]) / 2),
            float(max(highs[0] - lows[0], highs[1] - lows[1], 1e-6)) / 2,
            float(max(speed, 1e-9)),
            float(max(np.sqrt((every("r") ** 2).mean()), 1e-9)),
            float(max(every("t").max(), 1e-3)),
            sampled[0].time_scale,
        )


def of_run(likelihood: Likelihood, fit: Fit, run: int) -> Samples:
    """The Samples of a run under a fitted model."""
    data, model = likelihood.runs[run], fit.model
    times = np.array(data.times)
    poses = np.array(data.poses) if len(data.poses) else np.array(data.eta)
    nu = _velocities(likelihood, fit, run)
    commands = _reaching(data, model, times)
    values = {
        "x": poses[:, 0],
        "y": poses[:, 1],
        "psi": np.array(headings.wrap(poses[:, 2])),
        "u": nu[:, 0],
        "v": nu[:, 1],
        "r": nu[:, 2],
        **dict(zip(inputs(model), commands.T)),
        "lift": commands[:, -1],
        "t": np.array(data.t),
        "volt": _voltage(data, model, times),
    }
    return samples_of(model, values, times, windows.time_scale([data]))


def samples_of(model: _core.Model, values: Dict[str, Array], times: Array, time_scale: float) -> Samples:
    """Samples with the values of the states of formulas; time_scale: of the craft [s]."""
    return Samples(values, times, _states(model, values, times, time_scale), time_scale)


def _voltage(run: _core.RunData, model: _core.Model, times: Array) -> Array:
    """Voltage of the battery (n,); that at which k holds where none is recorded."""
    if run.battery is None:
        return np.full(len(times), model.volts)
    return np.interp(times, *np.array(run.battery).T)


def _velocities(likelihood: Likelihood, fit: Fit, run: int) -> Array:
    """Velocities (n, 3), each simulated without correction for at least (HOPS - 1) / HOPS of RESTART."""
    data = likelihood.runs[run]
    left = likelihood.residuals(fit.point, run)
    states, constants, times = left["states"], left["constants"], np.array(data.times)
    known = np.array(data.wrench) if len(data.wrench) else np.zeros((len(times), 3))
    nu, step = np.array(states[:, 3:]), scatter.interval(times)
    reach = max(2, int(round(RESTART * windows.time_scale([data]) / step)))
    hop = max(1, reach // HOPS)
    for first in range(0, len(times) - reach, hop):
        last = min(len(times) - 1, first + reach)
        if times[last] - times[first] > 2 * reach * step:
            continue  # there is a gap
        span = slice(first, last + 1)
        wrench = known[span] + constants[first, :3]
        try:
            motion = _core.simulate(
                fit.model, data.inputs, times[span], states[first, :3], states[first, 3:], data.drives,
                wrench, payload=data.payload, battery=data.battery,
            )  # fmt: skip
        except RuntimeError:
            continue
        nu[last - hop + 1 : last + 1] = motion["nu"][-hop:]
    return nu


def _reaching(run: _core.RunData, model: _core.Model, times: Array) -> Array:
    """Mean inputs of the thrusters and lift, as they reach the craft, from each sample to the next
    (n, inputs + 1)."""
    edges = np.append(times, times[-1] + scatter.interval(times))
    return np.array(call(_core.mean_inputs, model, np.array(run.inputs), edges))


def past(times: Array, values: Array, memory: float) -> Array:
    """Mean of the values (n, k) before each sample, with weights that decay over `memory` [s]."""
    result, state = np.empty_like(values), np.zeros(values.shape[1])
    keep = np.exp(-np.diff(times, append=times[-1]) / max(memory, 1e-6))
    for i, value in enumerate(values):
        result[i] = state
        state = value + (state - value) * keep[i]
    return result


def swinging(times: Array, values: Array, frequency: float) -> Tuple[Array, Array]:
    """Deflection and its rate, both (n, k), of a lightly damped pendulum that follows the values (n, k)."""
    omega, decay = 2 * np.pi * frequency, 0.2 * np.pi * frequency
    swing = np.sqrt(omega**2 - decay**2)
    steps = np.diff(times, append=times[-1:])
    fades = np.exp(-decay * steps)
    sines, cosines = fades * np.sin(swing * steps) / swing, fades * np.cos(swing * steps)
    deflection, rate = np.zeros_like(values), np.zeros_like(values)
    d, w = np.zeros(values.shape[1]), np.zeros(values.shape[1])
    for i, value in enumerate(values):  # exact while the value is held
        deflection[i], rate[i] = d, w
        off = d - value
        d = value + cosines[i] * off + sines[i] * (w + decay * off)
        w = cosines[i] * w - sines[i] * (omega**2 * off + decay * w)
    return deflection, rate


def inputs(model: _core.Model) -> List[str]:
    """Names of the inputs of a model's thrusters in formulas."""
    if model.is_pair:
        return ["u_L", "u_R"]
    return ["u_" + thruster["name"] for thruster in model.thrusters]


def namespace(sampled: Samples) -> Mapping[str, Any]:
    """What formulas may name, at a run's samples."""
    known: Dict[str, Any] = {**sampled.values, **sampled.states}
    known.update(sin=np.sin, cos=np.cos, abs=np.abs, sqrt=np.sqrt, exp=np.exp)
    return known


def evaluated(formula: str, known: Mapping[str, Any]) -> Array:
    """Values (n,) of a formula of the dictionary, never of a user's."""
    value = np.asarray(eval(formula.replace("^", "**"), {"__builtins__": {}}, known), float)
    return value if value.ndim else np.full(known["t"].shape, value)


def _states(model: _core.Model, v: Mapping[str, Array], times: Array, time_scale: float) -> Dict[str, Array]:
    """Values of the states of formulas, by name."""
    names = inputs(model)
    commands = np.column_stack([v[name] for name in names])
    total = commands.sum(axis=1)
    speeds = np.column_stack([v["u"], v["v"], v["r"], v["u"] ** 2 + v["v"] ** 2])
    found: Dict[str, Array] = {}
    for i, memory in enumerate(MEMORIES):
        columns = np.column_stack([commands, total, v["lift"], speeds])
        means = past(times, columns, memory * time_scale).T
        labels = ["p%d_%s" % (i, name[2:]) for name in names] + ["q%d" % i, "l%d" % i]
        labels += ["w%d_%s" % (i, name) for name in "uvr"] + ["s%d" % i]
        found.update(zip(labels, means))
    c, s = np.cos(v["psi"]), np.sin(v["psi"])
    room = np.column_stack([c * v["u"] - s * v["v"], s * v["u"] + c * v["v"]])
    for i, frequency in enumerate(SWINGS):
        for kind, values in zip("ab", swinging(times, room, frequency / time_scale)):
            found.update({"%s%d%s" % (kind, i, axis): values[:, j] for j, axis in enumerate("xy")})
    steps = np.diff(times, prepend=times[0])
    found["used"] = np.cumsum(total * steps)
    return found
