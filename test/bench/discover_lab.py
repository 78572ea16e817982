"""A laboratory whose craft is hidden_craft's: it moves by none of the project's equations."""

import math
from collections import deque

import numpy as np

import hidden_craft
import hidden_noise
from ground import _core
from ground.discovery.simulated import SimulatedLaboratory
from ground.simulation import experiments
from hidden_cases import random_of

LATENCY = 0.02  # the mocap's [s]
REST = 3.0  # time for which a craft slides to rest after a flight [s]
COLD = ("warm_up",)  # effects whose states are forgotten while the craft rests
LONGEST = 150.0  # longest disturbance of a flight [s]
GAP, GAP_RATE = 1.0, 0.04  # length [s] and rate [1/s] of the mocap's failures in crafts with faults
REACTION = 0.3  # time after a fault from which thrust counts [s]


class HiddenPlant(_core.Plant):
    """A hidden craft in a room. Its pose, velocity and the states of its effects last from flight to
    flight; its clock and its drive begin anew with each. random: of the poses' noise."""

    def __init__(self, case, pose):
        super().__init__()
        self.case = case
        craft = hidden_craft.Craft(case.body, case.effects)
        self.mover = hidden_craft.Mover(craft, pose, 0.0, hidden_craft.BRAKING)
        self.channels = hidden_craft.channels(case.effects)
        self.held = [0.0, 0.0, 0.0]
        self.begin(None, random_of("calm"))

    def begin(self, wrench, random):
        """Begins a flight at time 0. wrench: rows (n, 3) of the disturbance, one for each
        hidden_craft.GRID; None for none."""
        self.now, self.drive, self.wrench_rows, self.random = 0.0, None, wrench, random
        self.arriving = [deque() for _ in self.channels]
        self.arrived = [[(0.0, value)] for value in self.held]  # all commands of the flight
        self.states = []  # (time, state) at the ends of `advance`

    def rest(self):
        """The craft slides to rest with everything off; what is warm cools down."""
        self.now = 0.0
        for channel in self.channels:
            channel.send(0.0, 0.0)
        self.held = [self.channels[0].reached, self.channels[1].reached, 0.0]
        for _ in range(round(REST / hidden_craft.GRID)):
            self._step(hidden_craft.GRID, (0.0, 0.0, 0.0))
        for name in COLD:
            self.mover.forget(name)

    def command(self, thrusters, lift):
        """See _core.Plant."""
        inputs = [float(min(max(value, 0.0), 1.0)) for value in (*thrusters, lift)]
        for channel, queue, value in zip(self.channels, self.arriving, inputs):
            queue.append(channel.send(self.now, value))
        self._receive()

    def _receive(self):
        """Commands that have arrived act."""
        for i, queue in enumerate(self.arriving):
            while queue and queue[0][0] <= self.now + 1e-12:
                arrived = queue.popleft()
                self.held[i] = arrived[1]
                self.arrived[i].append(arrived)
        if self.drive is None and self.held[2] > 0:
            self.drive = self.now
            self.mover.begin(self.now)

    def advance(self, time):
        """See _core.Plant."""
        while self.now < time - 1e-12:
            cell = int(self.now / hidden_craft.GRID + 1e-6)
            until = min([time, (cell + 1) * hidden_craft.GRID] + [q[0][0] for q in self.arriving if q])
            if self.drive is None:
                self.mover.begin(self.now)
            self._step(until - self.now, self._push(cell))
            self.now = until
            self._receive()
        self.states.append((self.now, list(self.mover.state)))

    def _step(self, length, push):
        """Moves the craft by a length of time [s]. Without lift it sticks to the floor at speeds below which
        hidden_craft's dry friction fades."""
        before = self.mover.state[:3]
        self.mover.step(self.now, length, self.held, push)
        u, v, r = self.mover.state[3:6]
        slow = math.hypot(u, v) < hidden_craft.DRY_SPEED and abs(r) < hidden_craft.DRY_RATE
        if slow and self.held[2] == 0:
            self.mover.state[:6] = before + [0.0, 0.0, 0.0]

    def _push(self, cell):
        rows = self.wrench_rows
        return (0.0, 0.0, 0.0) if rows is None else rows[min(cell, len(rows) - 1)]

    def _acceleration(self):
        push = self._push(int(self.now / hidden_craft.GRID + 1e-6))
        return self.mover.accelerations(self.now, self.held, push)

    def state(self):
        """See _core.Plant."""
        return self.mover.state[:3], self.mover.state[3:6]

    def derivative(self):
        """See _core.Plant."""
        _, _, psi, u, v, r = self.mover.state[:6]
        c, s = math.cos(psi), math.sin(psi)
        return [c * u - s * v, s * u + c * v, r], self._acceleration()

    def measurement(self):
        """See _core.Plant."""
        eta, nu = (np.array([values]) for values in self.state())
        motion = hidden_craft.Motion(np.zeros(1), eta, nu, np.array([self._acceleration()]))
        velocity, _ = hidden_craft.seen_motion(self.case.effects, motion)
        return hidden_craft.seen(self.case.effects, eta)[0], velocity[0]

    def wrench(self):
        """See _core.Plant."""
        return self._push(int(self.now / hidden_craft.GRID + 1e-6))

    def pose_noise(self):
        """See _core.Plant."""
        return hidden_noise.NOISE * self.random.normal(size=3)


class HiddenLaboratory(SimulatedLaboratory):
    """A Laboratory with the craft of a discover_cases case, in a room. Notes how close to the walls the
    craft came and how long thrust lasted after faults."""

    def __init__(self, case, believed, room):
        mocap = _core.MocapParams()
        mocap.rate, mocap.latency = hidden_noise.RATE, LATENCY
        mocap.position_noise = mocap.heading_noise = 0.0  # HiddenPlant has its own
        if case.gaps:
            mocap.gap_rate, mocap.gap_length, mocap.gaps_vary = GAP_RATE, GAP, False
        super().__init__(believed, believed, room, mocap, seed=case.seed)
        self.case = case
        heading = random_of(case.kind, case.seed, "heading").uniform(-np.pi, np.pi)
        self.pose = np.array([*room.home, heading])
        self.plant = HiddenPlant(case, self.pose)
        self.clearance = math.inf  # least distance of the true craft from a wall [m]
        self.late_thrust = []  # time after a fault at which thrust ended [s], one for each fault
        self.flown = []  # (run, true states (n, 1 + states), arrived commands) of each flight

    def simulated(self, drive, name, number):
        """The run of a flight. Flights of one number have the same disturbance and noise."""
        case, plant = self.case, self.plant
        wrench = None
        if case.level:
            count = round(LONGEST / hidden_craft.GRID)
            random = random_of(case.kind, case.seed, "wrench", number)
            wrench = hidden_noise.wrench(random, count, hidden_craft.GRID, case.push).tolist()
        plant.begin(wrench, random_of(case.kind, case.seed, "noise", number))
        run = experiments.simulate(
            self.truth, drive, name, mocap=self.mocap, seed=1000 * self.seed + number,
            believed=self.believed, plant=plant,
        )  # fmt: skip
        states = np.array([[time, *state] for time, state in plant.states])
        arrived = [np.array(channel).T for channel in plant.arrived]
        self.flown.append((run, states, arrived))
        self.clearance = min([self.clearance] + [self.room.clearance(p) for p in run.truth_eta[:, :2]])
        self.late_thrust += late_thrust(run)
        return run

    def carry_home(self):
        """See SimulatedLaboratory."""
        self.plant.mover.state[:2] = self.room.home

    def fly(self, flight, inputs):
        """See Laboratory."""
        landed = super().fly(flight, inputs)
        self.plant.rest()
        self.pose = hidden_craft.seen(self.case.effects, np.array([self.plant.mover.state[:3]]))[0]
        return landed


def late_thrust(run):
    """For each fault (a gap of the mocap, a stop of the controller), how long after it thrust was still
    commanded, until poses came again [s]."""
    faults = [
        (before, after) for before, after in zip(run.delivered, run.delivered[1:]) if after - before > GAP / 2
    ]
    faults += [(time, math.inf) for time, state, _ in run.stages if state == "STOPPED"]
    driven = run.control_times[run.controls[:, :-1].any(axis=1)]
    found = []
    for begins, ends in faults:
        inside = driven[(driven > begins) & (driven < ends)]
        found.append(float(inside[-1] - begins) if len(inside) else 0.0)
    return found
