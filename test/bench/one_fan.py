"""A craft with one fan and a rudder in its stream, in the world's frame and with an integrator of its own: it
shares nothing with the project's model."""

import math

import numpy as np

from jets import RATE, moved, recorded

RUNS, DURATION, HOLD = 4, 20.0, 0.5  # runs of a case, their length [s], how long commands last [s]
STEP = 0.0025  # of the integration [s]
NOISE = (3e-4, 2e-3)  # standard deviations of poses [m], [rad]


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
        count = round(len(commands) * HOLD / STEP)
        held = [math.floor((i * STEP - self.delay) / HOLD + 1e-9) for i in range(count)]
        inputs = [commands[at] if at >= 0 else np.zeros(2) for at in held]
        return moved(self.rate, [*start, 0.0, 0.0, 0.0, 0.0, 0.0], inputs, STEP, RATE)


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
