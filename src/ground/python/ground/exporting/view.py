"""A view: takes what is known of a run in SI and writes it to the channels, live or to a file."""

import math
from typing import Any, Dict, Optional, Sequence, Tuple

from foxglove import channels as fc
from foxglove import messages as fx

from ground.exporting import shapes
from ground.exporting.channels import (
    COMMANDS,
    KINDS,
    MODELS,
    Beliefs,
    ChannelContent,
    Numbers,
    clean,
    identifiers,
)
from ground.exporting.scene import Scene
from ground.models import Model, Room

LEVELS = {"info": fx.LogLevel.Info, "warning": fx.LogLevel.Warning, "error": fx.LogLevel.Error}
ACCURACY_PERIOD = 200_000_000  # [ns]
MIN_HORIZONS = 2.0  # shortest window after which a model has settled, in horizons


class View:
    """Writes what is known to the channels of a foxglove.Context. Times are [ns]; poses are x, y [m], psi
    [rad] in world_ned, velocities u, v [m/s], r [rad/s] and wrenches X, Y [N], N [N m] in the body frame."""

    def __init__(self, context: Any) -> None:
        """context: of foxglove."""
        self._context = context
        self._numbers: Dict[str, Numbers] = {}
        self._beliefs: Optional[Beliefs] = None
        self._names: Dict[str, Tuple[str, ...]] = {}  # of the commands, by topic
        self._ahead = [0.0] * len(MODELS)  # of the newest predictions [s]
        self._accuracy = [-ACCURACY_PERIOD] * len(MODELS)  # when it was written last
        self._noise = 0.0  # what it leaves of the first model's predictions [m]; 0: not known
        self._log = fc.LogChannel("/log", context=context)
        self._scene = Scene(context)

    def furnish(self, model: Optional[Model], room: Optional[Room]) -> None:
        """Takes the model whose thrusters are drawn, and the room; both may be unknown."""
        self._scene.furnish(model, room)

    def clear(self) -> None:
        """Time began again: what was drawn is forgotten."""
        self._scene.clear()

    def pose(self, time: int, eta: Sequence[float]) -> None:
        """A pose of the mocap."""
        self._channel("/pose").log(time, eta)

    def state(
        self,
        time: int,
        eta: Sequence[float],
        nu: Sequence[float],
        age: float = 0.0,
        valid: bool = True,
        status: str = "",
    ) -> None:
        """A state; age: of its pose [s]; status: why it is not valid."""
        self._channel("/state").log(time, (*eta, *nu, age), (status,), valid)
        if valid:
            self._scene.state(time, eta)

    def commands(
        self, time: int, names: Sequence[str], values: Sequence[float], wanted: bool = False
    ) -> None:
        """Commands by channel, as sent; wanted: before they were limited."""
        topic = "/commands/wanted" if wanted else "/commands"
        if self._names.get(topic) != tuple(names):  # the first names, or another craft's
            self._names[topic] = tuple(names)
            if topic in self._numbers:
                self._numbers.pop(topic).channel.close()
            kind = ChannelContent(COMMANDS[topic], identifiers(names))
            self._numbers[topic] = Numbers(topic, kind, self._context)
        self._numbers[topic].log(time, values)
        if not wanted:
            self._scene.commands(dict(zip(names, values)))

    def reference(self, time: int, place: Sequence[float], velocity: Sequence[float]) -> None:
        """Where the craft should be, x, y [m], and the velocity there [m/s]."""
        self._channel("/reference").log(time, (*place, math.hypot(*velocity)))
        self._scene.reference(time, (place[0], place[1]))

    def prediction(
        self,
        model: int,
        time: int,
        label: str,
        ahead: float,
        eta: Sequence[float],
        nu: Sequence[float],
        off: Sequence[float],
    ) -> None:
        """What a model predicted for this time. model: 0 or 1; label: its name; ahead: how long before it
        started [s]; off: measured minus predicted pose."""
        distance = math.hypot(off[0], off[1])
        numbers = (*eta, *nu, *off, distance, ahead)
        self._channel("/%s/prediction" % MODELS[model]).log(time, numbers, (label,))
        self._scene.predicted(MODELS[model], time, eta, ahead < self._ahead[model])
        self._ahead[model] = ahead
        if model == 0 and self._noise:
            self._scene.off((eta[0] + off[0], eta[1] + off[1]), distance, self._noise)

    def accuracy(
        self,
        model: int,
        time: int,
        label: str,
        error: Tuple[float, float],
        noise: Tuple[float, float],
        horizon: float,
        excited: bool = True,
        window: float = math.inf,
    ) -> None:
        """Rms error of position [m] and heading [rad] at a horizon [s], and what noise leaves of it; excited:
        whether the craft moved enough for it to tell anything; window: that it is over [s]."""
        if model == 0:
            self._noise = noise[0] if excited and window >= MIN_HORIZONS * horizon else 0.0
        if 0 <= time - self._accuracy[model] < ACCURACY_PERIOD:
            return
        self._accuracy[model] = time
        self._channel("/%s/accuracy" % MODELS[model]).log(time, (*error, *noise, horizon), (label,), excited)
        sizes = [(1e3 * position, math.degrees(heading)) for position, heading in (error, noise)]
        told = "%.3g mm, %.2g deg after %.2g s (noise: %.2g mm, %.2g deg)"
        told = told % (*sizes[0], horizon, *sizes[1]) if excited else "no excitation, the craft hardly moves"
        self._scene.legend(MODELS[model], "%s: %s" % (label, told))

    def missing(
        self, model: int, time: int, label: str, wrench: Sequence[float], sigma: Sequence[float]
    ) -> None:
        """The missing wrench of a model, and its standard deviations."""
        self._channel("/%s/missing" % MODELS[model]).log(time, (*wrench, *sigma), (label,))
        if model == 0:
            self._scene.missing(time, wrench, sigma)

    def beliefs(
        self, time: int, effects: Sequence[str], probabilities: Sequence[float], states: Sequence[str]
    ) -> None:
        """What a discovery believes of effects."""
        self._beliefs = self._beliefs or Beliefs(self._context)
        self._beliefs.log(time, effects, probabilities, states)

    def numbers(
        self, topic: str, time: int, numbers: Sequence[float], texts: Sequence[str], *flags: bool
    ) -> None:
        """A message of another channel of KINDS."""
        self._channel(topic).log(time, numbers, texts, *flags)

    def say(self, time: int, name: str, words: str, level: str = "info") -> None:
        """A line of the log; name: who says it; level: of LEVELS."""
        stamp, told = shapes.timestamp(time), clean(words)
        self._log.log(
            fx.Log(timestamp=stamp, level=LEVELS[level], message=told, name=clean(name)), log_time=time
        )

    def change(self, time: int, node: str, name: str, before: str, after: str) -> None:
        """A parameter or a model file of a node was changed."""
        self.say(time, node, "%s: %s, was %s" % (name, after, before))

    def _channel(self, topic: str) -> Numbers:
        if topic not in self._numbers:
            self._numbers[topic] = Numbers(topic, KINDS[topic], self._context)
        return self._numbers[topic]
