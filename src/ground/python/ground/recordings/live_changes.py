"""Changes during a recording: live parameters and model files of nodes."""

from dataclasses import dataclass
from typing import List

from ground.annotations import Document
from ground.recordings import messages
from ground.recordings.messages import MessageSource

TYPE = "ground_msgs/LiveChange"


@dataclass(frozen=True)
class LiveChange:
    """A change that a node accepted while it ran."""

    time: float  # stamp [s]
    node: str
    name: str  # parameter's name; model or model2 for a model file
    before: str
    after: str

    def describe(self, zero: float) -> Document:
        """The change as plain values; its time counts from `zero` [s]."""
        return dict(vars(self), time=self.time - zero)


def changes_of(bag: MessageSource) -> List[LiveChange]:
    """The LiveChanges in a MessageSource, in order of time."""
    found = [
        LiveChange(m.header.stamp.to_sec(), m.node, m.name, m.before, m.after)
        for m in messages.of_type(bag, TYPE)
    ]
    return sorted(found, key=lambda change: change.time)
