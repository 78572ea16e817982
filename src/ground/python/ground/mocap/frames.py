"""What a mocap saw, whichever system it is: frames with the poses of bodies."""

import math
from dataclasses import dataclass
from typing import Callable, Dict, Iterator, List, Optional, Sequence, Tuple

MAX_NORM_ERROR = 0.05  # of the quaternion of a pose that was measured


@dataclass(frozen=True)
class Pose:
    """Pose of a body in the mocap's axes."""

    position: Tuple[float, float, float]  #: [m]
    rotation: Tuple[float, float, float, float]  #: quaternion x, y, z, w


@dataclass(frozen=True)
class Frame:
    """What the mocap saw at one instant. Fields that a system does not give are None, and the delay 0."""

    received: float  #: when the frame came, by this computer's monotonic clock [s]
    poses: Dict[str, Pose]  #: by name, of the bodies that were seen
    number: Optional[int] = None
    time: Optional[float] = None  #: of exposure, by the mocap's clock [s]
    delay: float = 0.0  #: known time from then until the frame was sent [s]


@dataclass(frozen=True)
class FrameSource:
    """A connection to a mocap."""

    frames: Iterator[Optional[Frame]]  #: as they come; None at least once a second while none comes
    told: Callable[[], str]  #: which server it is, or why nothing comes
    names: Callable[[], List[str]]  #: of the bodies that the mocap has, as far as known


def pose(position: Sequence[float], rotation: Sequence[float]) -> Optional[Pose]:
    """A measured pose from position [m] and quaternion x, y, z, w; None for what systems give for a body that
    they have lost: zeros, or numbers that are not finite."""
    x, y, z = map(float, position)
    qx, qy, qz, qw = map(float, rotation)
    if not all(map(math.isfinite, (x, y, z))) or x == y == z == 0:
        return None
    norm = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    if not abs(norm - 1) <= MAX_NORM_ERROR:
        return None
    return Pose((x, y, z), (qx, qy, qz, qw))
