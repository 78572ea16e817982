"""What the live plot draws: its diagrams, and their curves."""

import math
from dataclasses import dataclass, replace
from typing import List, Sequence, Tuple

from ground.nodes.live_feed import MODELS
from ground.reports import appearance

TRACKING = "tracking error"  # computed from state and reference
WANTED, FLOOR = "#404040", appearance.FLOOR
PALE = "50"  # opacity of samples under a smoothed line, hexadecimal


@dataclass(frozen=True)
class PlottedCurve:
    """A field of a topic, or the tracking error."""

    topic: str
    field: str
    label: str  # {model} stands for the name of the model file
    color: str
    width: float = 1.0  # of the line [pixels]
    smooth: bool = False  # a smoothed line over a pale one of the samples
    factor: float = 1.0
    fitted: bool = True  # whether the axis shows all of it


@dataclass(frozen=True)
class Panel:
    """A diagram; its curves share an axis. Later curves are drawn over earlier ones."""

    title: str
    axis: str  # quantity and unit
    curves: Sequence[PlottedCurve]
    shown: Tuple[float, float] = (0.0, 0.0)  # what the axis always shows, in its unit
    scale: float = 1.0  # from the messages' unit to the axis's
    least: float = 0.0  # smallest span of the axis, in its unit


def _by_models(field: str, *labels: str, smooth: bool = True) -> List[PlottedCurve]:
    return [
        PlottedCurve(topic, field, label, appearance.model_color(i), 2.0 if label else 1.0, smooth)
        for i, (topic, label) in enumerate(zip(MODELS, labels))
    ]


def _velocity(index: int, least: float) -> Panel:
    _, name, unit = appearance.CHANNELS[index]
    field = "nu[%d]" % index
    curves = [PlottedCurve("state", field, "measured", appearance.MEASURED, 2.0, True)]
    curves += _by_models(field, "predicted by {model}", "by {model}")
    shown = (math.inf, -math.inf)
    return Panel(name, "%s [%s]" % (name.split()[-1], unit), curves, shown, least=least)


def _off(what: str, axis: str, now: str, least: float, scale: float) -> Panel:
    """How far predictions are off, with the noise floor; in the axis's unit."""
    noise = PlottedCurve(MODELS[0], what + "_noise", "noise floor", FLOOR, 2.0)
    pale = [replace(c, color=c.color + PALE) for c in _by_models(now, "", "", smooth=False)]
    curves = [*pale, noise, *_by_models(what + "_error", "{model}", "{model}", smooth=False)]
    return Panel("prediction off in " + what, axis, curves, (0.0, least), scale)


def _input(field: str, title: str, color: str) -> Panel:
    curves = [
        PlottedCurve("controls", field, "sent", color, 3.0),
        PlottedCurve("controls/wanted", field, "wanted by the controller", WANTED, fitted=False),
    ]
    return Panel(title, "input [0..1]", curves, (0.0, 1.0))


def _missing(title: str, axis: str, least: float, **labels: str) -> Panel:
    """Components of the missing wrench between their noise; labels: by index after an underscore."""
    colors = dict(zip(labels, (appearance.MISSING, appearance.MODELS[1])))
    curves = [
        PlottedCurve("model_error", "wrench[%s]" % name[1:], label, colors[name], 2.0, True)
        for name, label in labels.items()
    ]
    field = "wrench_noise[%s]" % list(labels)[0][1:]
    ends = (("noise floor", 2.0), ("", -2.0))
    noise = [PlottedCurve("model_error", field, label, FLOOR, factor=factor) for label, factor in ends]
    return Panel(title + " missing in {model}", axis, noise + curves, (0.0, 0.0), 1e3, least)


_DISTANCE = [PlottedCurve(TRACKING, "", "", appearance.MEASURED)]
COLUMNS = [
    [
        _velocity(0, 0.1),
        _velocity(1, 0.1),
        _velocity(2, 0.5),
        _off("position", "distance [mm]", "off", 10.0, 1e3),
        _off("heading", "angle [deg]", "turned", 3.0, math.degrees(1.0)),
    ],
    [
        _input("left", "left thruster", appearance.THRUSTERS[0]),
        _input("right", "right thruster", appearance.THRUSTERS[1]),
        _missing("force", "force [mN]", 2.0, _0="ahead X", _1="to starboard Y"),
        _missing("moment", "moment [mN m]", 0.1, _2="clockwise N"),
        Panel("distance from the reference", "distance [mm]", _DISTANCE, (0.0, 5.0), 1e3),
    ],
]
