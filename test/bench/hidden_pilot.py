"""Pilots: steer a craft from goal to goal by what they saw a moment ago."""

import numpy as np

TICK = 0.02  # interval of the commands [s]


class Pilot:
    """Gives left and right inputs from `start` to `stop` [s], and 0 before and after.

    It turns towards a goal, slows down near it, and chooses the next one when it arrives or loses patience.
    `rows` (time, left, right) collects its commands.
    """

    def __init__(self, random, start, stop):
        self.random, self.start, self.stop = random, start, stop
        self.rows, self.seen, self.held = [], [], np.zeros(2)
        self.late = int(random.uniform(0.15, 0.25) / TICK)  # reaction time in ticks
        self.calm = TICK / random.uniform(0.06, 0.15)  # share of a change that the hand makes in a tick
        self.turn, self.brake = random.uniform(0.12, 0.2), random.uniform(0.06, 0.12)
        self.push, self.tremor = random.uniform(0.3, 0.8), random.uniform(0.01, 0.05)
        self.reach = random.uniform(0.6, 1.6)
        self.home, self.goal, self.patience = None, None, 0.0

    def __call__(self, time, pose):
        if self.home is None:
            self.home = np.array(pose[:2])
        if not self.start - 1e-9 <= time < self.stop - 1e-9:
            return 0.0, 0.0
        if time >= self.start + TICK * len(self.rows) - 1e-9:
            self.seen.append(pose)
            wanted = self._wanted(time)
            self.held = np.clip(self.held + self.calm * (wanted - self.held), 0, 1)
            self.rows.append([time, *np.round(self.held, 3)])
        return tuple(self.rows[-1][1:])

    def _wanted(self, time):
        """Inputs that it would like, from the pose and its change that it saw some time ago."""
        at = max(0, len(self.seen) - 1 - self.late)
        now, before = np.array(self.seen[at]), np.array(self.seen[max(0, at - 5)])
        rates = (now - before) / (5 * TICK)
        self._choose(time, now)
        way = self.goal - now[:2] - 0.7 * rates[:2]  # brakes by aiming against its drift
        off = np.angle(np.exp(1j * (np.arctan2(way[1], way[0]) - now[2])))
        half = self.push * min(1.0, np.hypot(*way)) * max(0.15, np.cos(off))
        turn = self.turn * off - self.brake * rates[2] + self.tremor * self.random.normal()
        return np.array([half + turn, half - turn])

    def _choose(self, time, now):
        """Chooses a goal, given the pose that it saw."""
        if self.goal is None or time > self.patience or np.hypot(*(self.goal - now[:2])) < 0.3:
            self.goal = self.home + self.reach * self.random.normal(size=2)
            self.patience = time + self.random.uniform(1.5, 4.0)


class Autopilot(Pilot):
    """A program that holds a place, or follows a circle if `circles`, and reacts in less than 0.1 s."""

    def __init__(self, random, start, stop, circles):
        super().__init__(random, start, stop)
        self.late = int(random.uniform(0.02, 0.08) / TICK)
        self.calm, self.tremor = random.uniform(0.3, 1.0), random.uniform(0.0, 0.01)
        self.radius = random.uniform(0.3, 1.0) if circles else 0.0
        self.rate = random.choice([-1, 1]) * random.uniform(0.4, 1.2)  # of its way round [rad/s]

    def _choose(self, time, now):
        angle = self.rate * (time - self.start)
        self.goal = self.home + self.radius * np.array([np.cos(angle) - 1, np.sin(angle)])
