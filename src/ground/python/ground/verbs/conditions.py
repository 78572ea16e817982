"""Options for the conditions in which a craft is simulated: disturbance, trim, motion capture."""

import argparse
from typing import Callable, Iterable, List, Optional, Union

from ground import _core
from ground.annotations import Document
from ground.api import simulating
from ground.verbs import common

# parameter of the mocap, metavar, help
MOCAP = [
    ("rate", "HZ", "frames per second"),
    ("position_noise", "M", "noise of x and y, 1 sigma"),
    ("heading_noise", "RAD", "noise of the heading, 1 sigma"),
    ("latency", "S", "time from capture to delivery"),
    ("loss", "SHARE", "share of single frames lost, 0..1"),
    ("gap_rate", "1/S", "losses of tracking per second"),
    ("gap_length", "S", "mean duration of a loss of tracking"),
]


def add_disturbance_arguments(group: argparse._ArgumentGroup) -> None:
    """Adds --disturbance and --trim."""
    group.add_argument(
        "--disturbance",
        type=common.number,
        nargs="*",
        metavar="SHARE TIME",
        help="apply a random wrench: its standard deviation as a share of full thrust (X, Y) and of the "
        "moment of one thruster (N), and its correlation time [s]; without numbers, the disturbance "
        "of the model file",
    )
    group.add_argument(
        "--trim",
        type=between("trim"),
        metavar="SHARE",
        help="differences from run to run, 1 sigma: a constant wrench, in the same shares, and a "
        "factor on the thrust",
    )


def add_mocap_arguments(group: argparse._ArgumentGroup) -> None:
    """Adds noise, latency and losses of the motion capture."""
    defaults = _core.MocapParams()
    for name, metavar, text in MOCAP:
        add_number(group, name, metavar, text, getattr(defaults, name))


def add_number(
    group: argparse._ArgumentGroup, name: str, metavar: str, text: str, default: float
) -> None:
    """Adds an option that takes a number; default: said in its help, which is `text`."""
    option = "--" + name.replace("_", "-")
    text = "%s (%g)" % (text, default)
    group.add_argument(option, type=common.number, metavar=metavar, help=text)


def disturbance(given: Optional[List[float]]) -> Union[bool, List[float]]:
    """Argument of the API: whether the model's disturbance acts, or a share and a time."""
    return given is not None if not given else given


def given(arguments: argparse.Namespace, names: Iterable[str]) -> Document:
    """The options that were given, by name."""
    values = {name: getattr(arguments, name) for name in names}
    return {name: value for name, value in values.items() if value is not None}


def between(name: str) -> Callable[[str], float]:
    """The type of an option whose values have the range of that name in the API."""
    low, high = simulating.RANGES[name]

    def parse(text: str) -> float:
        value = float(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError("%s is not between %g and %g" % (text, low, high))
        return value

    parse.__name__ = "number"
    return parse
