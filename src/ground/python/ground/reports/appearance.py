"""Shared by pictures and pages: colours, and names of channels and variables."""

import textwrap
from typing import List, Tuple

from ground import _core
from ground.analysis import comparison, missing_wrench
from ground.analysis.horizon import PoseError
from ground.reading.recording import unit
from ground.reports.words import number, off
from ground.support.annotations import Document, Style

MEASURED = _core.palette["measured"]
MODELS = _core.palette["models"]
FLOOR = REFERENCE = _core.palette["reference"]  # the noise floor, and what is to be followed
THRUSTERS = _core.palette["thrusters"]
MISSING = _core.palette["missing"]
# Texts, whose words say the same, and greys.
WARNING, GOOD, BUSY = "#a00000", "#00694d", "#8a5f00"
TEXT, LESS, LINES, FAINT = "#222222", "#555555", "#dddddd", "#f2f2f0"
CHOSEN = "#fff3d6"  # background of what was chosen
VERDICTS = {  # of a diagnosis or a discovery
    "complete": REFERENCE,
    "missing": MODELS[1],
    "varies": MODELS[2],
    "memory": MODELS[0],
    "unexplained": MODELS[0],
    "undecided": MODELS[0],
    "misread": WARNING,
}
# Not by colour alone: each model has its own dashes and marks.
DASHES = ["solid", "dash", "dot", "dashdot"]
MARKS = ["circle", "square", "diamond", "triangle-up"]
CHANNEL_NAMES = {"u": "surge u", "v": "sway v", "r": "yaw rate r"}
CHANNELS = [(c, name, unit(c)) for c, name in CHANNEL_NAMES.items()]
WRENCH = list(missing_wrench.CHANNEL_NAMES.items())
# Columns of numbers_row
NUMBERS = ["model", "runs", "error [-]", "prediction error [-]", "thesis (3.4), 4 s [-]"]
NUMBERS += ["fit %s [%%]" % c for c in CHANNEL_NAMES] + ["off after"]


def model_color(index: int) -> str:
    """Colour of a model by its number."""
    return str(MODELS[index % len(MODELS)])


def model_line(index: int, width: float) -> Style:
    """Line of a model by its number: colour, dashes, width [pixels]."""
    dash = DASHES[(index + index // len(MODELS)) % len(DASHES)]
    return {"color": model_color(index), "dash": dash, "width": width}


def model_mark(index: int) -> Style:
    """Mark of a model by its number."""
    return {"symbol": MARKS[index % len(MARKS)], "color": model_color(index), "size": 5}


def thruster_line(index: int, width: float) -> Style:
    """Line of a thruster by its place in the model, constant between the changes of its command."""
    dash = DASHES[index // len(THRUSTERS) % len(DASHES)]
    color = THRUSTERS[index % len(THRUSTERS)]
    return {"color": color, "dash": dash, "width": width, "shape": "hv"}


def transparent(color: str, opacity: float) -> str:
    """A color "#rrggbb" with an opacity (0..1)."""
    red, green, blue = (int(color[i : i + 2], 16) for i in (1, 3, 5))
    return "rgba(%d,%d,%d,%g)" % (red, green, blue, opacity)


def scaled(channel: missing_wrench.WrenchChannel) -> Tuple[float, str]:
    """Factor and unit in which the numbers of a channel of the wrench are easy to read."""
    return (1e3, "m" + channel.unit) if channel.full_scale < 1 else (1.0, channel.unit)


def wrapped(text: str, width: int) -> str:
    """A text in lines of at most so many characters; long names are broken."""
    return "<br>".join(textwrap.wrap(text, width))


def numbers_row(label: str, role: str, numbers: Document) -> List[str]:
    """Cells under NUMBERS, of comparison.numbers of a model on runs of a role."""
    cells = [label, role.replace("_", " "), number(numbers["error"])]
    cells += [number(numbers[n]) for n in ("prediction_error", "thesis_objective")]
    cells += ["%.0f" % numbers["fit_percent"][c] for c in CHANNEL_NAMES]
    return cells + [off_after(numbers)]


def off_after(numbers: Document) -> str:
    """Horizon and error of a prediction over two thirds of a window; "-" where no run is that long."""
    after = numbers["horizons"][comparison.HORIZONS.index(1.0)]
    if not after["starts"]:
        return "-"
    return "%g s: %s" % (after["seconds"], off(PoseError(after["position_mm"], after["heading_deg"])))
