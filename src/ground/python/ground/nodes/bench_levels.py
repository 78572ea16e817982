"""Levels that a controller holds on a thruster bench, for the person who reads the force."""

from dataclasses import dataclass
from typing import List, Optional

SETTLING_TIME = 0.5  # how long a level is held before the force is read [s]


@dataclass(frozen=True)
class Level:
    """Inputs of the thrusters that are held constant."""

    since: float  # [s]
    left: float  # 0..1
    right: float  # 0..1

    def text(self, start: float) -> str:
        """Sentence for the person at the scale; start: start of the run, on the clock of since [s]."""
        on = self.left > 0 or self.right > 0
        return "left %.3g, right %.3g since %.1f s of the run; read the scale%s" % (
            self.left,
            self.right,
            self.since - start,
            "" if on else "'s zero",
        )


class Levels:
    """Levels of one run, from its commands."""

    def __init__(self) -> None:
        self.start: Optional[float] = None  # time of the first command [s]; None before
        self.held: List[Level] = []  # Level, in order of time
        self._level: Optional[Level] = None

    def command(self, time: float, left: float, right: float) -> Optional[Level]:
        """Takes a command given at time [s], inputs 0..1. Returns its Level once, when it has been
        held for SETTLING_TIME, otherwise None."""
        if self.start is None:
            self.start = time
        if self._level is None or (left, right) != (self._level.left, self._level.right):
            self._level = Level(time, left, right)
        if time - self._level.since < SETTLING_TIME or self.held[-1:] == [self._level]:
            return None
        self.held.append(self._level)
        return self._level
