"""An air-bearing table with eight jets, one of which is wrong: a weak jet (-20%), or one that is turned by 5
degrees. The truth is a plate in the world's frame with an integrator of its own, which shares nothing with
the project's model."""

import math

import numpy as np

from ground import _core
from ground.analysis import diagnosis
from ground.effect_library import candidates
from ground.poses import repair

RUNS, DURATION, HOLD = 4, 20.0, 0.5  # runs of a case, their length [s], how long commands last [s]
RATE, STEP = 100.0, 0.005  # rate of the poses [Hz]; step of the integration [s]
NOISE = (3e-4, 1e-3)  # standard deviations of poses [m], [rad], for markers 0.3 m apart
WEAK, TURNED = -0.2, math.radians(5)
KINDS = ("thruster_gain", "thruster_tilt")


def kind_of(seed):
    """The effect that a case hides, and the number of its jet."""
    return KINDS[seed % 2], (seed // 2) % 8


class Plate:
    """The truth: a plate with jets, one of which is wrong, by Newton's law in the world's frame."""

    def __init__(self, model, kind, jet):
        self.m, self.inertia = model.value("m"), model.value("I_z")
        self.drag = [model.value(name) for name in ("X_u", "Y_v", "N_r")]
        places = np.array([thruster["position"] for thruster in model.thrusters])
        angles = np.radians([thruster["direction"] for thruster in model.thrusters])
        force = np.full(len(angles), model.value("k"))
        if kind == "thruster_gain":
            force[jet] *= 1 + WEAK
        elif kind == "thruster_tilt":
            angles[jet] += TURNED
        x, y = force * np.cos(angles), force * np.sin(angles)
        self.wrench = np.array([x, y, places[:, 0] * y - places[:, 1] * x])

    def rate(self, state, wrench):
        """Derivatives of x, y, psi and of their derivatives, world_ned."""
        c, s = math.cos(state[2]), math.sin(state[2])
        X = wrench[0] - self.drag[0] * (c * state[3] + s * state[4])
        Y = wrench[1] - self.drag[1] * (c * state[4] - s * state[3])
        N = wrench[2] - self.drag[2] * state[5]
        along = [(c * X - s * Y) / self.m, (s * X + c * Y) / self.m, N / self.inertia]
        return np.array([*state[3:], *along])

    def poses(self, commands, start):
        """Poses (n, 3) from rest at RATE, under a row of commands for each HOLD."""
        each = round(HOLD / STEP)
        wrenches = [self.wrench @ commands[i // each] for i in range(len(commands) * each)]
        return moved(self.rate, [*start, 0.0, 0.0, 0.0], wrenches, STEP, RATE)


def moved(derivative, state, inputs, h, rate):
    """Poses (n, 3), with which a state begins, at a rate [Hz], by steps of Runge and Kutta of h [s], each
    with an input. derivative(state, input): of the state."""
    state, found, between = np.array(state), [], round(1 / rate / h)
    for i, given in enumerate(inputs):
        if i % between == 0:
            found.append(state[:3])
        a = derivative(state, given)
        b = derivative(state + h / 2 * a, given)
        c = derivative(state + h / 2 * b, given)
        d = derivative(state + h * c, given)
        state = state + h / 6 * (a + 2 * b + 2 * c + d)
    return np.array(found)


def recorded(name, edges, commands, eta, levels, random):
    """_core.RunData of poses (n, 3) at RATE that are measured with noise of some levels [m], [rad], and of
    commands (m, k) from the instants edges (m,) [s] on."""
    noise = np.array([levels[0], levels[0], levels[1]])
    poses = eta + noise * random.normal(size=eta.shape)
    times = np.arange(len(poses)) / RATE
    smoothed = repair.smooth(times, poses, levels, _core.RunScales())
    inputs = np.column_stack([edges, commands, np.ones(len(edges))])
    return _core.RunData(name, times, smoothed["eta"], smoothed["nu"], inputs, poses, noise, [0.0])


def runs_of(plate, random):
    """_core.RunData of a case: each jet off or on by chance, every HOLD anew."""
    runs = []
    for number in range(RUNS):
        edges = np.arange(0, DURATION, HOLD)
        commands = random.choice([0.0, 0.5, 1.0], (len(edges), 8))
        eta = plate.poses(commands, [0.0, 0.0, random.uniform(-math.pi, math.pi)])
        runs.append(recorded("run %d" % (number + 1), edges, commands, eta, NOISE, random))
    return runs


def diagnosed(seed, model, threads=0):
    """What a case hides, and the effects that its diagnosis finds."""
    kind, jet = kind_of(seed)
    runs = runs_of(Plate(model, kind, jet), np.random.default_rng(seed))
    found = diagnosis.StepwiseDiagnosis(runs, model, candidates.library(model), threads=threads)
    found.grow()
    hidden = "%s_%s" % (kind, model.thrusters[jet]["name"])
    name = next(iter(found.names), "")
    values = {p["name"]: p["value"] for p in found.fit.parameters}
    return {
        "seed": seed,
        "hidden": hidden,
        "found": sorted(found.names),
        "right": set(found.names) == {hidden},
        "values": {n: v for n, v in values.items() if n.split(".")[0] == name},
    }
