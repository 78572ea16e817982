"""A craft independent of the project's core: separate equations of motion, effects and integrator.

The hidden-effect bench simulates its truth here, so that an error of the project's model cannot cancel
between simulation and diagnosis. Equations from Fossen (1994, 2.4). Frames are z down: pose x, y [m],
psi [rad] in world_ned, velocities u, v [m/s], r [rad/s] in the body frame; inputs are 0..1. Kutta's 3/8
rule integrates over steps that end where a command or the disturbance changes.

`simulate` moves a craft under known commands. A Mover moves it step by step and a Channel passes commands on
as they are sent, for a craft in a control loop.
"""

import math
from dataclasses import dataclass, field
from typing import Optional

import numpy as np
from scipy import signal

import hidden_grammar

GRID = 1e-3  # interval over which a disturbance is constant [s]
COARSE = 4e-3  # longest step without a disturbance [s]
GRAVITY = 9.81  # [m/s^2]
BRAKING = 2.0  # deceleration by the floor's friction while the lift is off [m/s^2]
SLEWS = 0.008  # time constant of a motor of limited rate near its command [s]
DRY_SPEED, DRY_RATE = 0.01, 0.1  # below them dry friction is proportional to speed [m/s], [rad/s]


@dataclass
class Craft:
    """Parameters in SI units: body has m, l, I_z, X_u, Y_v, N_r, k; effects {name: {parameter: value}}
    come from the library or from OUTSIDE_LIBRARY, or are a hidden_grammar effect under "nameless"."""

    body: dict
    effects: dict = field(default_factory=dict)


@dataclass
class Motion:
    """A simulated run at the ends of its steps."""

    times: np.ndarray  # (n,) [s]
    eta: np.ndarray  # (n, 3) true pose
    nu: np.ndarray  # (n, 3) true velocities
    nu_dot: np.ndarray  # (n, 3) their derivatives just after each instant
    inputs: Optional[np.ndarray] = None  # (n, 3) left, right and lift just after each instant

    def poses(self, times):
        """Poses (m, 3) at given times, by cubic Hermite interpolation."""
        c, s = np.cos(self.eta[:, 2]), np.sin(self.eta[:, 2])
        u, v, r = self.nu.T
        rates = np.column_stack([c * u - s * v, s * u + c * v, r])
        i = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        h = (self.times[i + 1] - self.times[i])[:, None]
        a = (times - self.times[i])[:, None] / h
        return (
            (1 + 2 * a) * (1 - a) ** 2 * self.eta[i]
            + a * (1 - a) ** 2 * h * rates[i]
            + a * a * (3 - 2 * a) * self.eta[i + 1]
            + a * a * (a - 1) * h * rates[i + 1]
        )


class Point:
    """Arguments of the effects: time t since the drive began [s], pose (c, s: cosine and sine of psi),
    velocities, velocities through the air (ua, va), inputs at the thrusters, their forces [N], lift;
    m, l of the body, and its centre of mass com (x, y) [m]."""

    __slots__ = "t x y psi c s u v r ua va left right force_left force_right lift m l com".split()


def _dry(at, force, moment):
    share = force / math.sqrt(at.u**2 + at.v**2 + DRY_SPEED**2)
    return -share * at.u, -share * at.v, -moment * at.r / math.sqrt(at.r**2 + DRY_RATE**2)


def _floor_tilt(p, at):
    along, across = GRAVITY * at.m * p["sx"], GRAVITY * at.m * p["sy"]
    X, Y = at.c * along + at.s * across, at.c * across - at.s * along
    return X, Y, at.com[0] * Y - at.com[1] * X  # the force acts in the centre of mass


def _floor_field(p, at):
    """A wavy floor of wavelength `length` [m] with a force of at most `force` [N] per axis."""
    wave = 2 * math.pi / p["length"]
    along = p["force"] * math.sin(wave * at.x + p["phase"])
    across = p["force"] * math.cos(wave * at.y + p["phase"])
    return at.c * along + at.s * across, at.c * across - at.s * along, 0.0


def _quadratic_drag(p, at):
    speed = math.hypot(at.ua, at.va)
    return -p["cx"] * speed * at.ua, -p["cy"] * speed * at.va, -p["cr"] * abs(at.r) * at.r


def _directional(p, at):
    return 0.0, 0.0, -p["na"] * at.r**2 / math.sqrt(at.r**2 + DRY_RATE**2)


def _sum(at):
    return at.force_left + at.force_right


def _difference(at):
    return at.force_left - at.force_right


def _misalignment(p, at):
    short = 1 - math.cos(p["angle"])
    return -short * _sum(at), math.sin(p["angle"]) * _sum(at), -short * at.l * _difference(at)


def _washboard(p, at):
    """A floor with waves of 0.3 m along x that push along x."""
    along = p["a"] * math.sin(2 * math.pi * at.x / 0.3)
    return along * at.c, -along * at.s, 0.0


def _swept(p, at):
    """A fan whose draught sweeps round its mean direction in the room."""
    toward = p["toward"] + p["sweep"] * math.sin(2 * math.pi * at.t / p["period"] + p["phase"])
    along, across = p["force"] * math.cos(toward), p["force"] * math.sin(toward)
    return at.c * along + at.s * across, at.c * across - at.s * along, 0.0


def _hum(p, at):
    """A wrench in the body frame at a fixed frequency [Hz]."""
    wave = math.sin(2 * math.pi * p["frequency"] * at.t + p["phase"])
    return p["x"] * wave, p["y"] * wave, p["n"] * wave


def _changed(p, at):
    """Drag and a yaw moment that are there from a time of the drive on."""
    if at.t < p["at"]:
        return 0.0, 0.0, 0.0
    return -p["drag"] * at.ua, -p["drag"] * at.va, p["moment"]


# Wrench (X [N], Y [N], N [N m]) in the body frame.
WRENCH = {
    "washboard floor": _washboard,
    "sweeping_fan": _swept,
    "hum": _hum,
    "later_wrench": _changed,
    "spin-surge side force": lambda p, at: (0.0, p["a"] * at.r * at.u, 0.0),
    "cubic yaw damping": lambda p, at: (0.0, 0.0, -p["a"] * at.r**3),
    "thruster cross-talk": lambda p, at: (-2 * p["a"] * at.left * at.right, 0.0, 0.0),
    "quadratic_drag": _quadratic_drag,
    "coulomb_friction": lambda p, at: _dry(at, p["f"], p["n"]),
    "skirt_friction": lambda p, at: _dry(at, (1 - at.lift) * p["f0"], (1 - at.lift) * p["n0"]),
    "momentum_drag": lambda p, at: (-at.lift * p["q"] * at.ua, -at.lift * p["q"] * at.va, 0.0),
    "floor_tilt": _floor_tilt,
    "floor_field": _floor_field,
    "yaw_bias": lambda p, at: (0.0, 0.0, p["n0"]),
    "body_force_bias": lambda p, at: (p["x0"], p["y0"], 0.0),
    "sway_yaw_damping": lambda p, at: (0.0, -p["yr"] * at.r, -p["nv"] * at.va),
    "directional_yaw_damping": _directional,
    "thrust_misalignment": _misalignment,
    "thrust_sway_moment": lambda p, at: (0.0, 0.0, p["c"] * _sum(at) * at.va),
    "differential_side_force": lambda p, at: (0.0, p["c"] * _difference(at), 0.0),
}


def _inflow(p, at):
    share = max(0.0, 1 - p["c"] * at.ua)
    return share, share


def _curve(p, at):
    return tuple(w ** (p["p"] - 1) if w > 1e-9 else 1.0 for w in (at.left, at.right))


def _fading(p, at):
    share = math.exp(-at.t / p["tau"])
    return share, share


# Factors on the forces of the left and the right thruster.
THRUST = {
    "thrust_asymmetry": lambda p, at: (1 + p["a"], 1 - p["a"]),
    "thrust_curve": _curve,
    "thrust_speed_loss": _inflow,
    "battery_sag": _fading,
    "thrust_scale": lambda p, at: (1 + p["a"], 1 + p["a"]),
    "later_thrust": lambda p, at: (p["left"], p["right"]) if at.t >= p["at"] else (1.0, 1.0),
}


def _spin(p, at, z):
    """Thrusters with different time constants for rising and falling commands."""
    return [(u - w) / (p["rise"] if u > w else p["fall"]) for u, w in zip((at.left, at.right), z)]


def _slew(p, at, z):
    """Thrusters whose inputs change by at most `rate` [1/s]; near their command, with a time constant."""
    most, near = p["rate"], p.get("near", SLEWS)
    return [min(max((u - w) / near, -most), most) for u, w in zip((at.left, at.right), z)]


def _pressure(p, at, z):
    """Pressure in a skirt that the lift fills and that loses air at speed."""
    speed = (at.u**2 + at.v**2) / p["speed"] ** 2
    return [(at.lift / (1 + speed) - z[0]) / p["time"]]


def _first_order(time, at, z):
    return [(at.left - z[0]) / time, (at.right - z[1]) / time]


def _weaker(part, at, left, right):
    return at.left * (1 - part * left), at.right * (1 - part * right)


def _cold(p, z):
    """Cold thrusters give less thrust by a share `part`, which decays with their use."""
    share = 1 - p["part"] * math.exp(-z[0] / p["use"])
    return share, share


def _leak(p, at, z):
    drag = p["drag"] * (1 - z[0])
    return -drag * at.u, -drag * at.v, 0.0


# Effects with states z, initially 0: (number of states, function that gives their rates).
STATES = {
    "motor_lag": (2, lambda p, at, z: _first_order(p["tau"], at, z)),
    "spin_up": (2, _spin),
    "thrust_droop": (2, lambda p, at, z: _first_order(p["time"], at, z)),
    "warm_up": (1, lambda p, at, z: [at.left + at.right]),
    "slew": (2, _slew),
    "supply_sag": (1, lambda p, at, z: [((at.left + at.right) / 2 - z[0]) / p["time"]]),
    "skirt_pressure": (1, _pressure),
    "supply_of_inputs": (1, lambda p, at, z: [((at.left + at.right) / 2 - z[0]) / p["time"]]),
    "droop_of_inputs": (2, lambda p, at, z: _first_order(p["time"], at, z)),
}
# Action of these effects: inputs at the thrusters, factors on their forces, a wrench.
INPUT_OF = {name: lambda p, at, z: z for name in ("motor_lag", "spin_up", "slew")}
# What weakens thrusters takes a part of their inputs in the project's library. Beside a thrust_curve that is
# another part of the force.
INPUT_OF["supply_of_inputs"] = lambda p, at, z: _weaker(p["part"], at, z[0], z[0])
INPUT_OF["droop_of_inputs"] = lambda p, at, z: _weaker(p["part"], at, *z)
THRUST_OF = {
    "thrust_droop": lambda p, z: (1 - p["part"] * z[0], 1 - p["part"] * z[1]),
    "warm_up": _cold,
    "supply_sag": lambda p, z: (1 - p["part"] * z[0], 1 - p["part"] * z[0]),
}
WRENCH_OF = {"skirt_pressure": _leak}
# Effects that the project's library does not have, or not by these names; Channel implements thrust_backlash,
# unequal_delays, dead_zone and coarse_commands, and `sway` what the mocap sees of a body that sways.
MEMORY = ["spin_up", "thrust_droop", "skirt_pressure", "thrust_backlash", "warm_up"]
OUTSIDE_LIBRARY = MEMORY + ["unequal_delays", "floor_field", "thrust_scale", "slew", "supply_sag"]
OUTSIDE_LIBRARY += ["dead_zone", "coarse_commands", "sweeping_fan", "hum", "later_wrench", "later_thrust"]
OUTSIDE_LIBRARY += ["sway"]


def acting(effects, commands):
    """Commands as they reach the craft: (times [s], values) for left, right and lift.

    commands: rows time, left, right, lift; or three pairs (times, values) that a link has delayed.
    """
    if isinstance(commands, np.ndarray):
        commands = [(commands[:, 0], commands[:, i]) for i in (1, 2, 3)]
    arrived = []
    for channel, (times, values) in zip(channels(effects), commands):
        arrived.append(np.array([channel.send(t, v) for t, v in zip(times, values)]).T)
    return [(times, values) for times, values in arrived]


def channels(effects):
    """The Channels of left, right and lift."""
    both = effects.get("input_delay", {}).get("delay", 0.0)
    unequal = effects.get("unequal_delays", {"left": 0.0, "right": 0.0})
    play = effects.get("thrust_backlash", {"width": 0.0})["width"]
    zone = effects.get("dead_zone", {"start": 0.0, "stop": 0.0})
    steps = effects.get("coarse_commands", {"steps": 0})["steps"]
    left, right = (Channel(both + unequal[side], play, **zone, steps=steps) for side in ("left", "right"))
    return [left, right, Channel(both, 0.0)]


@dataclass
class Channel:
    """Passes on the commands of one input after a delay [s], with backlash of a width, a motor that starts
    and stops above and below some inputs, and in steps (0: none)."""

    delay: float
    play: float
    start: float = 0.0
    stop: float = 0.0
    steps: int = 0
    reached: float = 0.0
    runs: bool = False

    def send(self, time, value):
        """Time [s] at which a command that is sent at `time` acts, and the value that acts then."""
        half = self.play / 2
        self.reached = min(max(self.reached, value - half), value + half)
        self.runs = self.reached >= (self.stop if self.runs else self.start)
        acts = self.reached if self.runs else 0.0
        return time + self.delay, round(acts * self.steps) / self.steps if self.steps else acts


def simulate(craft, commands, end, pose, began, wrench=None, max_step=COARSE, pilot=None):
    """The Motion from rest at `pose`, from the begin of the drive at `began` [s] to `end` [s].

    commands: from `acting`. wrench: disturbance [N, N, N m] in the body frame (n, 3), or with forces x, y in
    the room's frame appended (n, 5); one row for each GRID from `began` on. max_step: longest step without
    a disturbance [s]. pilot: called with time and pose, gives left and right instead of the commands.
    """
    step = max_step if wrench is None else GRID
    count = math.ceil((end - began) / step - 1e-9)
    grid = began + step * np.arange(count + 1)
    edges = np.concatenate([times for times, _ in commands])
    edges = edges[(edges > began) & (edges < grid[-1])]
    times = np.unique(np.concatenate([grid, edges]))
    times = times[np.append(True, np.diff(times) > 1e-12)]
    held = np.column_stack([held_at(command, times) for command in commands])
    mover = Mover(craft, pose, began)
    pushes = np.zeros((len(times), 3))
    if wrench is not None:
        cell = np.minimum(((times - began) / GRID + 1e-6).astype(int), len(wrench) - 1)
        pushes = wrench[cell]
    rows = np.empty((len(times), 9))  # pose, velocities, their derivatives
    steps = np.append(np.diff(times), 0.0).tolist()
    for i, (t, h, inputs, push) in enumerate(zip(times.tolist(), steps, held.tolist(), pushes.tolist())):
        if pilot:
            inputs[:2] = held[i, :2] = pilot(t, mover.state[:3])
        rows[i] = mover.step(t, h, inputs, push)
    return Motion(times, rows[:, :3], rows[:, 3:6], rows[:, 6:], held)


class Mover:
    """A craft in motion from rest at a pose. began: when its drive began [s]. braking: friction of the floor
    while the lift is off [m/s^2]."""

    def __init__(self, craft, pose, began, braking=0.0):
        self._rates = _Rates(craft, began, braking)
        self.state = [*map(float, pose)] + [0.0] * (3 + self._rates.count)

    def begin(self, began):
        """The drive begins at `began` [s]."""
        self._rates.began = began

    def forget(self, effect):
        """The states of an effect are 0 again."""
        for at in self._rates.spans.get(effect, ()):
            self.state[at] = 0.0

    def step(self, t, h, inputs, push):
        """Moves it from t by h [s] under inputs left, right, lift and a wrench (see `simulate`) [N, N, N m].
        Returns pose, velocities and accelerations at t."""
        first = self._rates(t, self.state, inputs, push)
        row = self.state[:6] + first[3:6]
        self.state = _kutta(self._rates, t, self.state, h, inputs, push, first)
        return row

    def accelerations(self, t, inputs, push):
        """Derivatives of the velocities at t."""
        return self._rates(t, self.state, inputs, push)[3:6]


def held_at(command, times):
    """Values (n,) of a command (times [s], values) at given times: held, and 0 before the first."""
    at = np.searchsorted(command[0], times + 1e-12, side="right") - 1
    return np.where(at >= 0, np.asarray(command[1], float)[np.maximum(at, 0)], 0.0)


def _kutta(f, t, y, h, inputs, push, a):
    """One step of Kutta's 3/8 rule; a: the rates at its start."""
    third = h / 3
    b = f(t + third, [q + third * p for q, p in zip(y, a)], inputs, push)
    at = [q + h * p2 - third * p1 for q, p1, p2 in zip(y, a, b)]
    c = f(t + 2 * third, at, inputs, push)
    at = [q + h * (p1 - p2 + p3) for q, p1, p2, p3 in zip(y, a, b, c)]
    d = f(t + h, at, inputs, push)
    return [q + h / 8 * (k1 + 3 * (k2 + k3) + k4) for q, k1, k2, k3, k4 in zip(y, a, b, c, d)]


class _Rates:
    """Right-hand side of the equations of motion of a craft whose drive began at `began` [s]."""

    def __init__(self, craft, began, braking):
        self.body, self.began, self.braking = craft.body, began, braking
        effects = craft.effects
        self.wrench = [(WRENCH[n], p) for n, p in effects.items() if n in WRENCH]
        self.thrust = [(THRUST[n], p) for n, p in effects.items() if n in THRUST]
        self.states, self.count, self.spans = [], 0, {}
        for name in sorted((n for n in effects if n in STATES), key=lambda n: n not in INPUT_OF):
            count, rate = STATES[name]
            span = slice(6 + self.count, 6 + self.count + count)
            self.spans[name] = range(span.start, span.stop)
            does = [table.get(name) for table in (INPUT_OF, THRUST_OF, WRENCH_OF)]
            self.states.append((effects[name], span, rate, *does))
            self.count += count
        self.nameless = None
        if "nameless" in effects:
            self.nameless = hidden_grammar.Nameless(effects["nameless"], math)
            self.nameless_span = slice(6 + self.count, 6 + self.count + self.nameless.count)
            self.count += self.nameless.count
        wind = effects.get("wind", {"wx": 0.0, "wy": 0.0})
        self.wind = (wind["wx"], wind["wy"])
        self._set_inertia(effects)

    def _set_inertia(self, effects):
        m, I_z = self.body["m"], self.body["I_z"]
        added = effects.get("added_mass", {"mx": 0.0, "my": 0.0})
        offset = effects.get("com_offset", {"xg": 0.0, "yg": 0.0})
        xg, yg = offset["xg"], offset["yg"]
        mass = np.diag([m + added["mx"], m + added["my"], I_z + m * (xg**2 + yg**2)])
        mass[0, 2] = mass[2, 0] = -m * yg
        mass[1, 2] = mass[2, 1] = m * xg
        self.mass, self.inverse = mass.tolist(), np.linalg.inv(mass).tolist()
        self.at = Point()
        self.at.m, self.at.l, self.at.com = m, self.body["l"], (xg, yg)

    def __call__(self, t, state, inputs, push):
        at, body = self.at, self.body
        at.t = t - self.began
        at.x, at.y, at.psi, u, v, r = state[:6]
        at.u, at.v, at.r = u, v, r
        c, s = at.c, at.s = math.cos(at.psi), math.sin(at.psi)
        wx, wy = self.wind
        at.ua, at.va = u - c * wx - s * wy, v - c * wy + s * wx
        at.left, at.right, at.lift = inputs
        rates = []
        for p, span, rate, gives, _, _ in self.states:
            z = state[span]
            rates += rate(p, at, z)
            if gives:
                at.left, at.right = gives(p, at, z)
        if self.nameless:
            rates += self.nameless.rates(at, state[self.nameless_span])
        X, Y, N = self._wrench(state, push)
        # momentum p = M nu; p' + r x p = (X, Y), and the moment of the momentum (Kirchhoff)
        mass = self.mass
        px = mass[0][0] * u + mass[0][2] * r
        py = mass[1][1] * v + mass[1][2] * r
        X += r * py - body["X_u"] * at.ua
        Y -= r * px + body["Y_v"] * at.va
        N += v * px - u * py - body["N_r"] * r
        accelerations = [row[0] * X + row[1] * Y + row[2] * N for row in self.inverse]
        return [c * u - s * v, s * u + c * v, r] + accelerations + rates

    def _wrench(self, state, push):
        """Wrench of thrusters, effects and disturbance."""
        at = self.at
        left, right = self.body["k"] * at.left, self.body["k"] * at.right
        for factors, p in self.thrust:
            a, b = factors(p, at)
            left, right = left * a, right * b
        for p, span, _, _, factors, _ in self.states:
            if factors:
                a, b = factors(p, state[span])
                left, right = left * a, right * b
        at.force_left, at.force_right = left, right
        X, Y, N = left + right + push[0], push[1], at.l * (left - right) + push[2]
        if len(push) > 3:
            X += at.c * push[3] + at.s * push[4]
            Y += at.c * push[4] - at.s * push[3]
        if self.braking and at.lift == 0:
            most = at.m * self.braking
            dX, dY, dN = _dry(at, most, most * at.l)
            X, Y, N = X + dX, Y + dY, N + dN
        for force, p in self.wrench:
            dX, dY, dN = force(p, at)
            X, Y, N = X + dX, Y + dY, N + dN
        for p, span, _, _, _, force in self.states:
            if force:
                dX, dY, dN = force(p, at, state[span])
                X, Y, N = X + dX, Y + dY, N + dN
        if self.nameless:
            dX, dY, dN = self.nameless.wrench(at, state[self.nameless_span])
            X, Y, N = X + dX, Y + dY, N + dN
        return X, Y, N


def mount(effects):
    """Pose of the motion capture's rigid body in the craft: dx, dy [m], psi0 [rad]."""
    marker = effects.get("marker_offset", {"dx": 0.0, "dy": 0.0})
    return marker["dx"], marker["dy"], effects.get("heading_offset", {"psi0": 0.0})["psi0"]


def seen(effects, eta):
    """Poses (n, 3) that a motion capture without noise measures, given the true ones."""
    dx, dy, psi0 = mount(effects)
    c, s = np.cos(eta[:, 2]), np.sin(eta[:, 2])
    return eta + np.column_stack([c * dx - s * dy, s * dx + c * dy, np.full(len(eta), psi0)])


def sway(p, motion, times):
    """Displacement (n, 2) in the room [m] of a rigid body on a craft that sways as a pendulum of `frequency`
    [Hz] and `damping` under its accelerations; lever: height of the rigid body above the axis [m]."""
    grid = np.arange(motion.times[0], motion.times[-1], GRID)
    u, v, r = motion.nu.T
    du, dv, _ = motion.nu_dot.T
    pushes = [np.interp(grid, motion.times, push) for push in (du - v * r, dv + u * r)]
    w = 2 * np.pi * p["frequency"]
    b, a = signal.bilinear([w * w], [1, 2 * p["damping"] * w, w * w], 1 / GRID)
    along, across = -p["lever"] / GRAVITY * signal.lfilter(b, a, pushes)
    psi = np.interp(grid, motion.times, motion.eta[:, 2])
    moved = np.cos(psi) * along - np.sin(psi) * across, np.sin(psi) * along + np.cos(psi) * across
    return np.column_stack([np.interp(times, grid, one, left=0.0) for one in moved])


def seen_motion(effects, motion):
    """Velocities and accelerations (n, 3) of the measured rigid body in its frame. Accelerations include
    the terms of the rotating frame: u' - v r and v' + u r."""
    dx, dy, psi0 = mount(effects)
    u, v, r = motion.nu.T
    du, dv, dr = motion.nu_dot.T
    velocity = u - r * dy, v + r * dx
    acceleration = du - v * r - dr * dy - r * r * dx, dv + u * r + dr * dx - r * r * dy
    return tuple(
        np.column_stack([np.cos(psi0) * x + np.sin(psi0) * y, np.cos(psi0) * y - np.sin(psi0) * x, turn])
        for (x, y), turn in ((velocity, r), (acceleration, dr))
    )
