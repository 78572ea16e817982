"""Shared by pictures and pages: colours, and names of channels and variables."""

from typing import List, Tuple

from plotly import colors

from ground.analysis import comparison, failure
from ground.annotations import Document
from ground.reports import words

MEASURED = "#222222"
MODELS = ["#d1495b", "#1f77b4", "#2a9d5c", "#8e5ea2", "#e08e0b"]
FLOOR = MODELS[2]  # colour of the noise floor
LEFT, RIGHT = "#0b9aa8", "#e08e0b"
WARNING = "#c00000"
VIRIDIS, ORANGES = (
    colors.make_colorscale(scale) for scale in (colors.sequential.Viridis, colors.sequential.Oranges)
)
CHANNELS = [(c, words.ERRORS[c], comparison.UNITS[c]) for c in comparison.CHANNELS]
WRENCH = list(failure.CHANNEL_NAMES.items())
ERROR_AGAINST = ["time", "u_L+u_R", "u_L-u_R", "speed", "r", "heading", "x", "y"]
WRENCH_AGAINST = ["u_L", "u_R", "u_L+u_R", "u_L-u_R", "u", "v", "r", "heading", "x", "y"]
NUMBERS = ["model", "runs", "error", "prediction error", "(3.4), 4 s"]  # columns of numbers_row
NUMBERS += ["fit %s [%%]" % c for c in comparison.CHANNELS] + ["off after 1 s"]


def model_color(index: int) -> str:
    """Colour of a model by its number."""
    return MODELS[index % len(MODELS)]


def transparent(color: str, opacity: float) -> str:
    """A color "#rrggbb" with an opacity (0..1)."""
    red, green, blue = (int(color[i : i + 2], 16) for i in (1, 3, 5))
    return "rgba(%d,%d,%d,%g)" % (red, green, blue, opacity)


def scaled(entry: Document) -> Tuple[float, str]:
    """Factor and unit in which the numbers of a channel of the wrench are easy to read."""
    return (1e3, "m" + entry["unit"]) if entry["full_scale"] < 1 else (1.0, entry["unit"])


def short_label(entry: Document) -> str:
    """Short name of a variable."""
    label = str(entry["label"]).split("thrust ")[-1].split("difference ")[-1]
    return label.split(" since ")[0]


def numbers_row(label: str, role: str, numbers: Document) -> List[str]:
    """Cells under NUMBERS, of comparison.numbers of a model on runs of a role."""
    cells = [label, role.replace("_", " "), words.number(numbers["error"])]
    cells += [words.number(numbers[n]) for n in ("prediction_error", "thesis_objective")]
    cells += ["%.0f" % numbers["fit_percent"][c] for c in comparison.CHANNELS]
    return cells + [words.off_after_a_second(numbers)]
