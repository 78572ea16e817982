#!/usr/bin/python3
"""Crafts with one fan and a rudder in its stream, each with a hidden effect: an offset or a dead band of the
rudder, a delay of the commands, or a fan whose gain is another than the model says. The truth is a craft in
the world's frame with an integrator of its own, which shares nothing with the project's model.

A fan's gain is no effect: it is the parameter k, which a diagnosis fits first. It counts as named if no
effect is chosen and the interval of k has the truth, and not the value of the model.
"""

import argparse
import math
import os

import numpy as np

from ground import _core
from ground.analysis import candidates, diagnosis
from jets import RATE, recorded
from shares import share

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
MODEL = os.path.join(ROOT, "cfg", "craft", "one_fan_rudder.yaml")
RUNS, DURATION, HOLD = 4, 20.0, 0.5  # runs of a case, their length [s], how long commands last [s]
STEP = 0.0025  # of the integration [s]
NOISE = (3e-4, 2e-3)  # standard deviations of poses [m], [rad]
KINDS = ("offset", "delay", "dead_band", "gain")
NAMES = {
    "offset": "angle_offset_rudder",
    "delay": "input_delay",
    "dead_band": "dead_band_rudder",
    "gain": "k",
}


class OneFan:
    """The truth: Newton's law in the world's frame, with motors and a servo of first order."""

    def __init__(self, model, offset=0.0, delay=0.0, dead_band=0.0, gain=0.0):
        self.m, self.inertia = model.value("m"), model.value("I_z")
        self.drag = [model.value(name) for name in ("X_u", "Y_v", "N_r")]
        self.k = model.value("k") * (1 + gain)
        self.taus = model.value("motor_lag.tau"), model.value("angle_lag_rudder.tau")
        self.offset, self.delay, self.dead_band = offset, delay, dead_band
        # of the file: place, degrees at input 1, force and jet
        self.x, self.angle, self.force, self.jet = -0.2, math.radians(30), 0.0047, 212.0

    def forces(self, u, v, r, fan, angle):
        """X, Y [N], N [N m] of fan and rudder, body."""
        thrust = self.k * fan
        across = v + r * self.x
        stream = math.sqrt(max(u * abs(u) + self.jet * max(thrust, 0.0), 0.0))
        attack = angle + math.atan2(across, stream)
        normal = self.force * (stream**2 + across**2) * math.sin(attack)
        side = -normal * math.cos(angle)
        return thrust - normal * math.sin(angle), side, self.x * side

    def rate(self, state, command):
        """Derivatives of x, y, psi, their derivatives, fan's input and rudder's input."""
        psi, fan, rudder = state[2], state[6], state[7]
        c, s = math.cos(psi), math.sin(psi)
        u, v, r = c * state[3] + s * state[4], c * state[4] - s * state[3], state[5]
        X, Y, N = self.forces(u, v, r, fan, self.angle * rudder + self.offset)
        X, Y, N = X - self.drag[0] * u, Y - self.drag[1] * v, N - self.drag[2] * r
        size = max(abs(command[1]) - self.dead_band, 0.0)
        wanted = math.copysign(size, command[1])
        return np.array(
            [
                *state[3:6],
                (c * X - s * Y) / self.m,
                (s * X + c * Y) / self.m,
                N / self.inertia,
                (command[0] - fan) / self.taus[0],
                (wanted - rudder) / self.taus[1],
            ]
        )

    def poses(self, commands, start):
        """Poses (n, 3) from rest at RATE, under a row of commands for each HOLD."""
        state, found = np.array([*start, 0.0, 0.0, 0.0, 0.0, 0.0]), []
        between, h = round(1 / RATE / STEP), STEP
        for i in range(round(len(commands) * HOLD / STEP)):
            if i % between == 0:
                found.append(state[:3])
            at = math.floor((i * STEP - self.delay) / HOLD + 1e-9)
            command = commands[at] if at >= 0 else np.zeros(2)
            a = self.rate(state, command)
            b = self.rate(state + h / 2 * a, command)
            c = self.rate(state + h / 2 * b, command)
            d = self.rate(state + h * c, command)
            state = state + h / 6 * (a + 2 * b + 2 * c + d)
        return np.array(found)


def truth_of(seed):
    """The kind of a case, and the truth that it hides: angle [rad], delay [s], width, relative gain."""
    random = np.random.default_rng(1000 + seed)
    kind, sign = KINDS[seed % len(KINDS)], random.choice([-1, 1])
    if kind == "offset":
        return kind, sign * math.radians(random.uniform(2, 8))
    if kind == "delay":
        return kind, round(random.uniform(0.04, 0.15) / STEP) * STEP
    if kind == "dead_band":
        return kind, random.uniform(0.08, 0.25)
    return kind, sign * random.uniform(0.1, 0.3)


def runs_of(craft, random, count=RUNS, duration=DURATION):
    """_core.RunData of a case: levels of the fan and angles by chance, every HOLD anew."""
    runs = []
    for number in range(count):
        edges = np.arange(0, duration, HOLD)
        fan = random.choice([0.0, 0.4, 0.7, 1.0], len(edges))
        commands = np.column_stack([fan, random.uniform(-1, 1, len(edges))])
        eta = craft.poses(commands, [0.0, 0.0, random.uniform(-math.pi, math.pi)])
        runs.append(recorded("run %d" % (number + 1), edges, commands, eta, NOISE, random))
    return runs


def diagnosed(seed, model, threads=0):
    """What a case hides, what its diagnosis names, and the values of that."""
    kind, value = truth_of(seed)
    runs = runs_of(OneFan(model, **{kind: value}), np.random.default_rng(seed))
    found = diagnosis.Diagnosis(runs, model, candidates.library(model), threads=threads)
    found.grow()
    named = sorted(found.names)
    k = next(p for p in found.fit.parameters if p["name"] == "k")
    low, high = k["ci95"]
    if not named and not low <= model.value("k") <= high:
        named = ["k"]
    hidden = NAMES[kind]
    holds = kind != "gain" or low <= (1 + value) * model.value("k") <= high
    values = {p["name"]: p["value"] for p in found.fit.parameters}
    return {
        "seed": seed,
        "hidden": hidden,
        "truth": value,
        "found": named,
        "right": named == [hidden] and holds,
        "values": values,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=40, help="number of crafts")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    options = parser.parse_args()
    model, right = _core.load_model(MODEL), 0
    for i, seed in enumerate(range(options.first, options.first + options.count), 1):
        found = diagnosed(seed, model, threads=1)
        right += found["right"]
        words = seed, found["hidden"], found["truth"], ", ".join(found["found"]) or "nothing", right, i
        print("%3d  %-20s %8.4f  %s   (%d of %d)" % words, flush=True)
    print("named: " + share(right, i))


if __name__ == "__main__":
    main()
