"""What formulas of a missing wrench depend on along a run, all of it known beforehand.

The pose is the measured one; velocities are simulated for RESTART from the filter's state, because
filtered ones contain the disturbance; the past is filtered causally from commands that reach the thrusters
and from these velocities. Nothing looks ahead.
"""

import re
from dataclasses import dataclass
from typing import Dict, List, Mapping, NamedTuple, Sequence, Tuple

import numpy as np
from scipy import linalg

from ground import _core
from ground.analysis import windows
from ground.analysis.likelihood import Likelihood, LikelihoodFit, call
from ground.poses import angles, scatter
from ground.support.annotations import Array

RESTART = 0.25  # time that velocities are simulated from a filtered state [time scales]
MEMORIES = (0.05, 0.15, 0.5, 1.5, 4.0)  # time constants of the past [time scales]
SHARP = 0.15  # width of a step or of a change of sign, in standard deviations of its variable
SWINGS = (0.5, 0.8, 1.3, 2.0)  # frequencies of what may swing on the craft [1 / time scale]
FUNCTIONS = {"sin": np.sin, "cos": np.cos, "abs": np.abs, "sqrt": np.sqrt, "exp": np.exp}
IN_ROOM = {"x": "(u*cos(psi)-v*sin(psi))", "y": "(u*sin(psi)+v*cos(psi))"}  # velocity along its axes


@dataclass(frozen=True)
class Samples:
    """What the formulas of a run depend on, the states of formulas included: arrays (n,) by name."""

    values: Dict[str, Array]
    times: Array
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
    def slow(self) -> float:
        """Speed below which a direction of motion fades [m/s]."""
        return SHARP * self.speed

    @property
    def far(self) -> float:
        """Largest distance of a point that a force may depend on [m]."""
        return 100 * self.extent

    @property
    def crossed(self) -> float:
        """Time in which the craft crosses the shortest wavelength [s]."""
        return self.time_scale / 4

    @staticmethod
    def of(sampled: Sequence[Samples]) -> "Scales":
        """The Scales of all runs."""
        every = together(sampled)
        places = np.column_stack([every["x"], every["y"]])
        low, high = places.min(axis=0), places.max(axis=0)
        cx, cy = ((low + high) / 2).tolist()
        return Scales(
            (cx, cy),
            float(max((high - low).max(), 1e-6)) / 2,
            float(max(np.sqrt((every["u"] ** 2 + every["v"] ** 2).mean() / 2), 1e-9)),
            float(max(np.sqrt((every["r"] ** 2).mean()), 1e-9)),
            float(max(every["t"].max(), 1e-3)),
            sampled[0].time_scale,
        )


def together(sampled: Sequence[Samples]) -> Dict[str, Array]:
    """The values of runs, one run after the other."""
    return {name: np.concatenate([s.values[name] for s in sampled]) for name in sampled[0].values}


class Memory(NamedTuple):
    """States of formulas: formulas of their rates, with names in braces for times, and these: value, unit."""

    rates: Mapping[str, str]
    times: Mapping[str, Tuple[float, str]]

    def of(self, text: str) -> "Memory":
        """The states that a formula depends on."""
        rates: Dict[str, str] = {}
        for _ in range(2):  # a state's rate may depend on another state
            words = re.findall(r"\w+", re.sub(r"\{\w+\}", "", " ".join([text, *rates.values()])))
            rates = {name: rate for name, rate in self.rates.items() if name in words}
        used = " ".join(rates.values())
        return Memory(rates, {name: time for name, time in self.times.items() if "{%s}" % name in used})


def _means(model: _core.Model) -> Dict[str, str]:
    """What states are means of: a formula by the name of the state, with %d for the number of its memory."""
    names = inputs(model)
    means = {"p%d_" + name[2:]: name for name in names}
    return {**means, "q%d": total(model), "l%d": "lift", **{"w%d_" + c: c for c in "uvr"}, "s%d": "u^2+v^2"}


def memory(model: _core.Model, time_scale: float) -> Memory:
    """The Memory of a model's formulas; time_scale: of its craft [s]."""
    rates, times = {"used": total(model)}, {}
    for name, text in _means(model).items():
        for i, seconds in enumerate(MEMORIES):
            state, time = name % i, "tau_%s%d" % (name[0], i)
            rates[state] = "((%s)-%s)/{%s}" % (text, state, time)
            times[time] = (seconds * time_scale, "s")
    for i, frequency in enumerate(SWINGS):
        omega = 2 * np.pi * frequency / time_scale
        times.update({"w_a%d" % i: (omega, "rad/s"), "g_a%d" % i: (0.2 * omega, "1/s")})
        for axis, speed in IN_ROOM.items():
            a, b = "a%d%s" % (i, axis), "b%d%s" % (i, axis)
            rates.update({a: b, b: "{w_a%d}^2*(%s-%s)-{g_a%d}*%s" % (i, speed, a, i, b)})
    return Memory(rates, times)


def of_run(likelihood: Likelihood, fit: LikelihoodFit, run: int) -> Samples:
    """The Samples of a run under a fitted model."""
    data, model = likelihood.runs[run], fit.model
    times = np.array(data.times)
    x, y, psi = (np.array(data.poses) if len(data.poses) else np.array(data.eta)).T
    values = dict(zip("uvr", _velocities(likelihood, fit, run).T), x=x, y=y, t=np.array(data.t))
    # mean inputs of the thrusters and lift, as they reach the craft, from each sample to the next
    edges = np.append(times, times[-1] + scatter.interval(times))
    reaching = np.array(call(_core.mean_inputs, model, np.array(data.inputs), edges))
    values.update(zip([*inputs(model), "lift"], reaching.T), psi=np.array(angles.wrap(psi)))
    return samples_of(model, values, times, windows.time_scale([data]))


def samples_of(model: _core.Model, values: Mapping[str, Array], times: Array, time_scale: float) -> Samples:
    """Samples with the values of the states of formulas; time_scale: of the craft [s]."""
    means, kinds = (
        _means(model),
        [(i, kind, axis) for i in range(len(SWINGS)) for kind in "ab" for axis in "xy"],
    )
    columns = np.column_stack([evaluated(text, values) for text in means.values()])
    rates = -1 / np.array(MEMORIES) / time_scale
    past = _follows(times, columns, np.diag(rates), np.ones(len(rates)))
    omegas = 2 * np.pi * np.array(SWINGS) / time_scale
    turning = linalg.block_diag(*[[[0, 1], [-(omega**2), -0.2 * omega]] for omega in omegas])
    room = np.column_stack([evaluated(speed, values) for speed in IN_ROOM.values()])
    swinging = _follows(times, room, turning, np.tile([1.0, 0.0], len(omegas)))
    states = dict(zip([name % i for i in range(len(rates)) for name in means], past.T))
    states.update(zip(["%s%d%s" % (kind, i, axis) for i, kind, axis in kinds], swinging.T))
    states["used"] = np.cumsum(evaluated(total(model), values) * np.diff(times, prepend=times[0]))
    return Samples({**values, **states}, times, time_scale)


def _velocities(likelihood: Likelihood, fit: LikelihoodFit, run: int) -> Array:
    """Velocities (n, 3), each simulated without correction for at least two thirds of RESTART."""
    data = likelihood.runs[run]
    left = likelihood.residuals(fit.point, run)
    states, constants, times = left["states"], left["constants"], np.array(data.times)
    known = np.array(data.wrench) if len(data.wrench) else np.zeros((len(times), 3))
    nu, step = np.array(states[:, 3:]), scatter.interval(times)
    reach = max(2, int(round(RESTART * windows.time_scale([data]) / step)))
    hop = max(1, reach // 3)
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


def _follows(times: Array, values: Array, A: Array, rest: Array) -> Array:
    """States z (n, s k), zero at first, of dz/dt = A (z - rest w), exact where w is held from sample to
    sample. values: w (n, k); A: (s, s); rest: (s,)."""
    rates, vectors = np.linalg.eig(A)
    grown = np.exp(np.multiply.outer(np.diff(times, append=times[-1:]), rates))
    moves = ((vectors * grown[:, None]) @ np.linalg.inv(vectors)).real
    state, found = np.zeros((len(A), values.shape[1])), []
    for move, towards in zip(moves, values[:, None] * rest[:, None]):
        found.append(state)
        state = towards + move @ (state - towards)
    return np.array(found).reshape(len(times), -1)


def inputs(model: _core.Model) -> List[str]:
    """Names of the inputs of a model's thrusters in formulas."""
    if model.is_pair:
        return ["u_L", "u_R"]
    return ["u_" + thruster["name"] for thruster in model.thrusters]


def total(model: _core.Model) -> str:
    """Formula of the sum of the inputs of thrusters."""
    return "(%s)" % "+".join(inputs(model))


def evaluated(formula: str, known: Mapping[str, Array]) -> Array:
    """Values (n,) of a formula of the dictionary, never of a user's."""
    value = np.asarray(eval(formula.replace("^", "**"), {"__builtins__": {}, **FUNCTIONS}, known), float)
    return value if value.ndim else np.full(known["t"].shape, value)
