"""Where a discovery flies: a simulated craft, or the real one in its room."""

from dataclasses import dataclass
from typing import List, Optional, Protocol, Sequence

import numpy as np

from ground import _core
from ground.discovery.story import Flight, Point
from ground.reading.recording import Recording
from ground.support.annotations import Array


@dataclass(frozen=True)
class Landed:
    """A flight that has ended."""

    recording: Optional[Recording]  # None when nothing could be recorded
    file: str  # where it is kept; empty if it is not
    seconds: float  # time with the lift on [s]
    stopped: str  # why it ended early; empty if it did not
    # root mean square errors in parts of the reference [m]; empty unless it tracked to the end
    tracking_parts: Sequence[float] = ()
    # x, y [m], psi [rad] at which a simulated craft rests; empty for a real one
    rest: Sequence[float] = ()


def lifted(recording: Recording) -> float:
    """Time with the lift on [s]: from each command with lift to the next command."""
    steps: Array = np.diff(recording.control_times)
    return float(steps[recording.lift[:-1] > 0].sum())


class Laboratory(Protocol):
    """A craft in its room. A laboratory keeps all limits of controllers, room and sender: whatever a
    discovery asks for, the craft is not driven beyond them."""

    room: _core.RoomPlan

    def fly(self, flight: Flight, inputs: Array) -> Landed:
        """Flies and returns when the craft rests again. inputs: (n, 2 + thrusters) time [s], inputs of
        the thrusters (of full scale), lift, played in bursts between returns home; empty when a
        reference is tracked. Raises GroundError when it cannot be flown at all."""

    def resume(self, rest: Sequence[float]) -> None:
        """Continues after flights of an earlier session. rest: of the last one's Landed."""

    def load(self, model: _core.Model, label: str) -> str:
        """Gives the controllers another model. Returns why it was refused; empty if it was not."""

    def expected(self, inputs: Array, model: _core.Model) -> List[Point]:
        """The path that a model expects of `fly` with these inputs, from where the craft is. Raises
        GroundError when the model cannot be simulated."""
