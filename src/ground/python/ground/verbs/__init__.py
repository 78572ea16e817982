"""The verbs of the command line, one module each.

A module has configure(parser) and run(arguments); run returns what --json prints. It is loaded when its
verb is used: all of them take a third of a second.
"""

import importlib
from types import ModuleType
from typing import NamedTuple


class Verb(NamedTuple):
    """A verb of identify, or a program of one verb."""

    name: str
    module: str
    summary: str

    def load(self) -> ModuleType:
        """Its module."""
        return importlib.import_module("ground.verbs." + self.module)


ALL = [
    Verb(
        "import",
        "import_csv",
        "converts CSV written by rostopic echo -p to a bag that the other verbs read",
    ),
    Verb("info", "info", "contents and oddities of recordings, and their usable parts"),
    Verb(
        "bench",
        "bench",
        "fits thrust, its curve and gains to forces measured on a bench (thesis 3.2)",
    ),
    Verb(
        "simulate",
        "simulate",
        "records a simulated experiment to a bag, without ROS running and faster than real time",
    ),
    Verb("fit", "fit", "fits a model's parameters to recordings by simulation error"),
    Verb(
        "compare",
        "compare",
        "models against recordings: errors, where they come from, and pictures",
    ),
    Verb(
        "diagnose",
        "diagnose",
        "which physical effect is missing in a model, with evidence, and the model with it",
    ),
    Verb(
        "discover",
        "discover",
        "a simulated craft finds its own physics: it flies, is diagnosed, and flies again",
    ),
    Verb("add", "add", "adds an effect to a model, refits it, and shows the error before and after"),
    Verb(
        "tracking",
        "tracking",
        "how recorded crafts followed their reference: path, error, saturation, computing time",
    ),
]
TRACK = Verb(
    "track",
    "track",
    "drives a simulated craft along a reference, without ROS running and faster than real time",
)
TUNE = Verb("tune", "tune", "searches for the gains of a controller in closed loop, on all cores")
