"""What a craft carried in each run, as a mapping says."""

import fnmatch
from dataclasses import dataclass
from typing import Iterable, Sequence, Tuple

from ground import _core
from ground.support.errors import GroundError


@dataclass(frozen=True)
class Load:
    """A load that the craft carried in some runs."""

    mass: float  #: [kg]
    place: Tuple[float, float] = (0.0, 0.0)  #: of its centre of mass: forward, to starboard [m]
    inertia: float = 0.0  #: about its own centre of mass [kg m^2]
    runs: str = "*"  #: pattern of their names

    @property
    def payload(self) -> _core.Payload:
        """What the core takes."""
        return _core.Payload(self.mass, self.place, self.inertia)


def payload_of(run: str, loads: Iterable[Load]) -> _core.Payload:
    """What the craft carried in a run of this name; an empty one where no load names it. GroundError when
    several do."""
    found = [load for load in loads if fnmatch.fnmatchcase(run, load.runs)]
    if len(found) > 1:
        patterns = " and ".join(load.runs for load in found)
        raise GroundError("%s: the mapping gives it several payloads (%s); keep one" % (run, patterns))
    return found[0].payload if found else _core.Payload()


def differ(runs: Sequence[_core.RunData]) -> bool:
    """Whether the craft had different masses in some runs, so that its own mass is identifiable."""
    return len({run.payload.mass for run in runs}) > 1


def in_words(payload: _core.Payload) -> str:
    """A payload, as "0.5 kg at (0.1, 0) m"."""
    if payload.empty():
        return "no payload"
    return "%g kg at (%g, %g) m" % (payload.mass, *payload.place)
