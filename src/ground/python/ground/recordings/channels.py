"""Which commands of a recording go to which thruster of a model."""

from typing import List, Optional, Sequence, Tuple

from ground import _core
from ground.errors import GroundError


def columns(
    channels: Sequence[str], model: _core.Model, recording: str
) -> Tuple[List[int], Optional[int]]:
    """Columns of commands for each thruster of a model, in its order, and that of its lift, None
    where it was not recorded.

    channels: names of the columns. GroundError names the recording, the model and the channels that
    do not match.
    """
    known = list(channels)
    *thrusters, lift = model.channels
    missing = [name for name in thrusters if name not in known]
    if missing:
        raise GroundError(
            "%s: no command is named %s, which the model %s expects of its thrusters; the commands are "
            "%s: name them in a mapping as the model's channels, or the other way round"
            % (recording, " or ".join(dict.fromkeys(missing)), model.name, ", ".join(known))
        )
    return [known.index(name) for name in thrusters], known.index(lift) if lift in known else None
