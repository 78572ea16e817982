"""Simulated flights in which the craft changes, for the bench of changes in flight.

The craft is hidden_craft's: it moves by none of the project's equations. Each flight has a disturbance,
trims, a floor that is not level and a battery that sags, none of which the monitor is told.
"""

import math
import os
from dataclasses import dataclass
from typing import Optional

import numpy as np

import hidden_craft
from ground import _core
from ground.simulation import experiments, gains, tracking

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
STEP = 4e-3  # over which the disturbance is constant [s]
NOISE = 4e-4  # of positions [m]
KINDS = ("thruster", "mass", "drag")
SAG = (200.0, 1000.0)  # time constants of batteries [s]
TILT = 2e-3  # of the floor [rad]
PUSH_TIME = 0.5  # correlation time of the disturbance [s]
BRAKING = 2.0  # of the floor without lift [m/s^2]
BEFORE, AFTER = (8.0, 20.0), 11.0  # times of changes since the start, and of flight after them [s]


@dataclass
class Setting:
    """What a flight is: kind of the change or None, its time [s], and the plant's truth."""

    kind: Optional[str]
    time: float
    before: hidden_craft.Craft
    after: hidden_craft.Craft
    reference: str
    controller: str
    trim: np.ndarray  # constant wrench (3,)
    push: np.ndarray  # standard deviation of the disturbance (3,)
    seed: int
    name: str  # what the monitor should say


class ChangingPlant(_core.Plant):
    """A hidden craft that becomes another one at a time."""

    def __init__(self, setting):
        super().__init__()
        self.setting, self.now, self.changed, self.drive = setting, 0.0, False, None
        self.mover = hidden_craft.Mover(setting.before, (0.0, 0.0, 0.0), 0.0, BRAKING)
        self.held = [0.0, 0.0, 0.0]
        self.random = np.random.default_rng([setting.seed, 5])
        self.push = self.random.standard_normal(3) * setting.push
        self.next = 0.0

    def command(self, thrusters, lift):
        """See _core.Plant."""
        self.held = [float(min(max(value, 0.0), 1.0)) for value in (*thrusters, lift)]
        if self.drive is None and lift > 0:
            self.drive = self.now
            self.mover.begin(self.now)

    def advance(self, time):
        """See _core.Plant."""
        while self.now < time - 1e-12:
            if self.now >= self.next - 1e-9:
                keep = math.exp(-STEP / PUSH_TIME)
                draw = self.random.standard_normal(3) * self.setting.push
                self.push = keep * self.push + math.sqrt(1 - keep * keep) * draw
                self.next += STEP
            if not self.changed and self.setting.kind and self.now >= self.setting.time:
                self._change()
            until = min(time, self.next)
            self.mover.step(self.now, until - self.now, self.held, self._wrench())
            self.now = until

    def _change(self):
        state = self.mover.state
        self.mover = hidden_craft.Mover(self.setting.after, (0.0, 0.0, 0.0), self.drive or 0.0, BRAKING)
        self.mover.state = state
        self.changed = True

    def _wrench(self):
        return tuple(self.push + self.setting.trim) if self.held[2] > 0 else (0.0, 0.0, 0.0)

    def state(self):
        """See _core.Plant."""
        return self.mover.state[:3], self.mover.state[3:6]

    def derivative(self):
        """See _core.Plant."""
        psi, u, v, r = self.mover.state[2:6]
        c, s = math.cos(psi), math.sin(psi)
        rates = self.mover.accelerations(self.now, self.held, self._wrench())
        return [c * u - s * v, s * u + c * v, r], rates

    def measurement(self):
        """See _core.Plant."""
        return self.state()

    def wrench(self):
        """See _core.Plant."""
        return self._wrench()


def setting(model, kind, seed, share=0.02, trim=0.02, missing=None):
    """A random Setting. share, trim: of the disturbance and of constant errors, relative to full thrust;
    missing: effects that the model does not have, by name."""
    random = np.random.default_rng([seed, 1 + KINDS.index(kind) if kind else 0])
    body = {name: model.value(name) for name in ("m", "l", "I_z", "X_u", "Y_v", "N_r", "k")}
    unit = body["k"] * np.array([2.0, 2.0, body["l"]])
    scale, asymmetry = trim * random.standard_normal(2)
    angle = random.uniform(0, 2 * math.pi)
    effects = {
        "battery_sag": {"tau": math.exp(random.uniform(*np.log(SAG)))},
        "floor_tilt": {"sx": TILT * math.cos(angle), "sy": TILT * math.sin(angle)},
        "thrust_scale": {"a": scale},
        "thrust_asymmetry": {"a": asymmetry},
    }
    effects.update(missing or {})
    before = hidden_craft.Craft(body, effects)
    after, name = _changed(before, kind, random)
    return Setting(
        kind,
        random.uniform(*BEFORE),
        before,
        after,
        ["circle", "rhodonea", "prbs"][random.integers(3)],
        ["TrajectoryTracking", "ModelPredictive"][random.integers(2)],
        trim * random.standard_normal(3) * unit,
        share * unit,
        seed,
        name,
    )


def _changed(before, kind, random):
    """The craft after a change, and the name of the part."""
    body, effects = dict(before.body), dict(before.effects)
    name = kind or ""
    if kind == "thruster":
        side = random.integers(2)
        name = ["left", "right"][side] + " thruster"
        scale, asymmetry = effects["thrust_scale"]["a"], effects["thrust_asymmetry"]["a"]
        forces = (1 + scale) * np.array([1 + asymmetry, 1 - asymmetry])
        forces[side] *= 0.8
        effects["thrust_scale"] = {"a": forces.mean() - 1}
        effects["thrust_asymmetry"] = {"a": forces[0] / forces.mean() - 1}
    elif kind == "mass":
        m, load, angle = body["m"], 0.15 * body["m"], random.uniform(0, 2 * math.pi)
        at = body["l"] * np.array([math.cos(angle), math.sin(angle)])
        share = load / (m + load)
        body["m"], body["I_z"] = m + load, body["I_z"] + m * share * float(at @ at)
        effects["com_offset"] = {"xg": share * at[0], "yg": share * at[1]}
    elif kind == "drag":
        body.update((drag, 2 * body[drag]) for drag in ("X_u", "Y_v", "N_r"))
    return hidden_craft.Craft(body, effects), name


def fly(model, chosen, duration=None, adapt=False):
    """The core's log of a flight by a Setting; its clock begins with the experiment."""
    params = _core.ExcitationParams() if chosen.reference == "prbs" else _core.TrackingParams()
    if chosen.reference == "prbs":
        params.design = experiments.design_params("prbs", model, seed=chosen.seed)
        params.room = _core.load_room(os.path.join(ROOT, "cfg", "room", "room_4x4.yaml"))
    else:
        rate = {"rate_of_turn": 0.63} if chosen.reference == "circle" else {}
        params.reference = tracking.task(chosen.reference, **rate).reference
        file = (
            os.path.join(ROOT, "cfg", "gains", "tiny_whoover.yaml")
            if chosen.controller == "TrajectoryTracking"
            else None
        )
        params.controller = gains.choice(chosen.controller, file)
        params.max_error = np.inf
    params.duration = duration or chosen.time + AFTER
    params.start, params.tail = 0.0, 0.0
    params.life.rate, params.life.lift_time = 50.0, 0.5
    if adapt:
        params.adapt = True
    mocap = _core.MocapParams()
    mocap.position_noise = NOISE
    end = _core.Disturbance(), ChangingPlant(chosen)
    track = _core.excite if chosen.reference == "prbs" else _core.track_reference
    return track(model, model, params, np.zeros(3), np.zeros(3), mocap, chosen.seed, *end)


def watch(model, log, monitor=None):
    """Feeds a flight to a monitor; yields its time and the monitor whenever it has judged."""
    monitor = monitor or _core.ChangeMonitor(model)
    events = [(row[0], 0, row) for row in log["commands"]] + [(row[1], 1, row) for row in log["frames"]]
    for _, is_pose, row in sorted(events, key=lambda event: event[:2]):
        if not is_pose:
            monitor.command(row[0], row[1:-1] * model.input_max, row[-1])
        elif monitor.measure(row[0], row[2:5], np.zeros(3)):
            yield row[0], monitor
