#!/usr/bin/python3
"""Looks for the flight that leaves the room: CMA-ES chooses what goes wrong in short simulated flights.

The controller, its life cycle and the fence are those of the nodelets; the controller follows a line that
leads through a wall. CMA-ES chooses start, line, push, loss of poses, loss of packets, error of the model,
asymmetry, delay and losses of the mocap, for the smallest distance from a wall. A flight within the bound
that the controllers print for this room and craft must not leave the room; others are counted, too.
"""

import argparse
import contextlib
import functools
import itertools
import json
import os
import sys
import time

import numpy as np
from cmaes import CMA

from ground import _core
from ground.simulation import gains
from ground.support import workers

ROOT = os.path.realpath(os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", ".."))
UPSETS = {  # push [share of full thrust], time without poses [s], error of the thrust [share]
    "nothing": (0.0, 0.0, 0.0),
    "usual": (0.05, 0.1, 0.1),
    "much": (0.12, 0.25, 0.2),
}
NAMES = (
    "where", "how_near", "heading", "line", "line_speed", "line_end", "push", "push_way", "push_from",
    "push_for", "blind_from", "blind_for", "deaf_from", "deaf_for", "thrust", "damping", "asymmetry", "delay",
    "loss", "seed",
)  # fmt: skip
PREDICTIVE = 100  # one generation of so many is flown by ModelPredictive, which takes a hundred times as long
TOO_FAST = 2.0  # what a speed above the bound costs [m per m/s]
GENERATIONS, POPULATION = 40, 16


class Place:
    """A craft and a room, and their scales."""

    def __init__(self, model_file, room_file):
        self.model, self.room = _core.load_model(model_file), _core.load_room(room_file)
        self.fence = self.room  # that the controller keeps
        self.full = _core.full_acceleration(self.model)
        self.corners = np.array(self.room.corners)
        self.width = float(np.ptp(self.corners, axis=0).max())
        self.crossing = float(
            np.sqrt(2 * self.width / self.full)
        )  # time to cross the room at full thrust [s]
        self.speeds = {
            name: _core.largest_safe_speed(self.room, self.model, *u) for name, u in UPSETS.items()
        }

    def start(self, direction, share):
        """A point at a share of the way from home to the margin of a wall, in a direction [rad]."""
        way = np.array([np.cos(direction), np.sin(direction)])
        reach = np.arange(0, 2 * self.width, 0.02)
        inside = self.clearances(self.room.home + reach[:, None] * way) > self.room.margin + 0.05
        return np.array(self.room.home) + share * reach[max(0, np.argmin(inside) - 1)] * way

    def clearances(self, points):
        """Distances of points (n, 2) from the nearest wall [m], negative outside."""
        walls, x, y = np.roll(self.corners, -1, axis=0) - self.corners, points[:, :1], points[:, 1:]
        from_corner = points[:, None] - self.corners
        share = np.clip((from_corner * walls).sum(axis=2) / (walls**2).sum(axis=1), 0, 1)
        nearest = np.linalg.norm(from_corner - share[..., None] * walls, axis=2).min(axis=1)
        first, last = self.corners[:, 1], self.corners[:, 1] + walls[:, 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            crosses = x < self.corners[:, 0] + walls[:, 0] * (y - first) / walls[:, 1]
        inside = (((first > y) != (last > y)) & crosses).sum(axis=1) % 2 == 1
        return np.where(inside, nearest, -nearest)


def flight(place, upset, x, kind="TrajectoryTracking", axes=None):
    """Flies x, shares 0..1 of NAMES; returns the smallest clearance [m], the largest speed [m/s] and why it
    stopped. axes: a wrong setting of mocap_state."""
    at = dict(zip(NAMES, np.clip(x, 0, 1)))
    push, blind, error = UPSETS[upset]
    turn, span, room = 2 * np.pi, 2 * place.crossing, place.room
    craft = place.model.copy()
    craft.set_value("k", craft.value("k") * (1 + error * (2 * at["thrust"] - 1)))
    for name in ("X_u", "Y_v", "N_r"):
        craft.set_value(name, craft.value(name) * 4.0 ** (at["damping"] - 0.5))
    if error and "thrust_asymmetry" not in craft.effects:
        craft.add_effect("thrust_asymmetry")
        craft.set_value("thrust_asymmetry.a", error * (at["asymmetry"] - 0.5))
    tracking = _core.TrackingParams()
    tracking.room, tracking.duration = place.fence, span
    tracking.tail, tracking.start = place.crossing, 0.2
    tracking.life.lift_time, tracking.max_error = 0.3, np.inf
    tracking.controller = CHOICES[kind]
    end = place.room.home + place.width * (0.3 + at["line_end"]) * way(turn * at["line"])
    line = tracking.reference = _core.ReferenceParams()
    line.kind, line.smooth, line.end_x, line.end_y = "line", False, float(end[0]), float(end[1])
    line.speed = min(place.speeds[upset], place.full * place.crossing) * (0.1 + 1.5 * at["line_speed"])
    hazards, mocap = _core.Hazards(), _core.MocapParams()
    hazards.push = push * at["push"] * craft_force(place) * way(turn * at["push_way"])
    hazards.pushed = (span * at["push_from"], span * at["push_for"])
    hazards.unseen = (0.5 + span * at["blind_from"], blind * at["blind_for"])
    deaf_from = hazards.unseen[0] + 0.5 * at["deaf_from"]  # a stop follows a loss of poses
    hazards.unheard = (deaf_from, 0.8 * room.latency * at["deaf_for"])
    hazards.braking = room.braking
    if axes:
        hazards.axes = axes
    mocap.latency, mocap.loss = 0.02 * at["delay"], 0.3 * at["loss"] * (blind > 0)
    start = place.start(turn * at["where"], at["how_near"])
    pose = np.array([*start, turn * at["heading"]])
    log = _core.track_reference(
        craft, place.model, tracking, pose, np.zeros(3), mocap, int(1000 * at["seed"]) + 1, hazards=hazards
    )
    truth = log["truth"]
    return (
        float(place.clearances(truth[:, 1:3]).min()),
        float(np.hypot(truth[:, 4], truth[:, 5]).max()),
        log["stopped"],
    )


def way(angle):
    """Unit vector of an angle [rad]."""
    return np.array([np.cos(angle), np.sin(angle)])


def craft_force(place):
    """Full thrust of the craft [N]."""
    return place.full * place.model.value("m")


CHOICES = {
    "TrajectoryTracking": gains.choice(
        "TrajectoryTracking", os.path.join(ROOT, "cfg/gains/tiny_whoover.yaml")
    ),
    "ModelPredictive": gains.choice("ModelPredictive"),
}


def turned_axes():
    """All right-handed settings of mocap_state but the right one."""
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1, -1), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            text = ", ".join("%s%s" % ("-" if s < 0 else "", "xyz"[i]) for i, s in zip(order, signs))
            if np.linalg.det(matrix) > 0 and text != "x, z, -y":
                yield text


class Found:
    """What the flights of one upset came to."""

    def __init__(self, speed):
        self.speed = speed  # largest of the bound [m/s]
        self.flights = self.inside_bound = self.left_outside_bound = 0
        self.worst = self.worst_outside = (np.inf, 0.0, "", None)
        self.left = []  # within the bound

    def add(self, x, clearance, speed, stopped):
        """Counts a flight; returns its score."""
        self.flights += 1
        one = (clearance, speed, stopped, list(map(float, x)))
        if speed <= self.speed:
            self.inside_bound += 1
            self.worst = min(self.worst, one, key=lambda o: o[0])
            if clearance < 0:
                self.left.append(one)
        else:
            self.left_outside_bound += clearance < 0
            self.worst_outside = min(self.worst_outside, one, key=lambda o: o[0])
        return clearance + TOO_FAST * max(0.0, speed - self.speed)


def search(place, flights, seed, axes=(None,), generations=GENERATIONS):
    """Found by upset; for each restart CMA-ES begins anywhere with the next upset and axes. Ctrl-C ends it
    with what was found so far."""
    found = {name: Found(speed if axes == (None,) else np.inf) for name, speed in place.speeds.items()}
    upsets, settings = itertools.cycle(UPSETS), itertools.cycle(axes)
    random, flown, tried = np.random.default_rng(seed), 0, 0
    bounds = np.tile([0.0, 1.0], (len(NAMES), 1))
    team = workers.Workers()
    with contextlib.suppress(KeyboardInterrupt):
        while flown < flights:
            upset, axis = next(upsets), next(settings)
            optimizer = CMA(
                mean=random.uniform(size=len(NAMES)), sigma=0.3, bounds=bounds,
                seed=int(random.integers(2**31)), population_size=POPULATION,
            )  # fmt: skip
            for _ in range(generations):
                tried += 1
                kind = "TrajectoryTracking" if tried % PREDICTIVE else "ModelPredictive"
                asked = [optimizer.ask() for _ in range(POPULATION)]
                fly = functools.partial(flight, place, upset, kind=kind, axes=axis)
                optimizer.tell(
                    [(x, found[upset].add(x, *one)) for x, one in zip(asked, team.map(fly, asked))]
                )
                flown += POPULATION
                if flown >= flights or optimizer.should_stop():
                    break
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=100000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--model", default=os.path.join(ROOT, "cfg/hovercraft/tiny_whoover.yaml"))
    parser.add_argument("--room", default=os.path.join(ROOT, "cfg/room/room_4x4.yaml"))
    parser.add_argument("--bound", action="store_true", help="only prints the bound, as the controllers do")
    parser.add_argument(
        "--axes", action="store_true", help="with wrong axes of the mocap, which no bound covers"
    )
    parser.add_argument("--json", help="file for the results")
    options = parser.parse_args()
    place = Place(options.model, options.room)
    print(_core.fence_bound(place.room, place.model))
    if options.bound:
        return 0
    began = time.perf_counter()
    found = search(place, options.flights, options.seed, tuple(turned_axes()) if options.axes else (None,))
    seconds = time.perf_counter() - began
    flown = sum(one.flights for one in found.values())
    print("%d flights, %.0f a second" % (flown, flown / seconds))
    print("| what goes wrong | bound | within it | nearest wall | left | beyond it | left |")
    print("|---|---|---|---|---|---|---|")
    for name, one in found.items():
        beyond = one.flights - one.inside_bound
        row = (name, one.speed, one.inside_bound, one.worst[0], len(one.left), beyond, one.left_outside_bound)
        print("| %s | %.2f m/s | %d | %.3f m | %d | %d | %d |" % row)
    if options.json:
        with open(options.json, "w") as file:
            json.dump({name: vars(one) for name, one in found.items()}, file, indent=1)
    return 1 if any(one.left for one in found.values()) and not options.axes else 0


if __name__ == "__main__":
    sys.exit(main())
