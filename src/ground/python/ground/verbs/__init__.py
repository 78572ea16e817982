"""The verbs of the command line, and where each is.

A module of a verb has configure(parser) and run(arguments); run returns what --json prints. It is loaded
when its verb is used: all of them take a third of a second.
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
        return importlib.import_module("ground." + self.module)


ALL = [
    Verb("import", "data.import_csv", "converts CSV of rostopic echo -p to a bag"),
    Verb("info", "data.info", "contents and oddities of recordings, and their usable parts"),
    Verb("bench", "fitting.bench", "fits thrust, its curve and gains to forces of a bench (thesis 3.2)"),
    Verb("simulate", "simulating.simulate", "records a simulated experiment to a bag, without ROS running"),
    Verb("fit", "fitting.fit", "fits a model's parameters to recordings by simulation error"),
    Verb("compare", "comparing.compare", "models against recordings: errors, where they come from, pictures"),
    Verb("diagnose", "diagnosing.diagnose", "which physical effect a model lacks, and the model with it"),
    Verb("discover", "verbs.discover", "a simulated craft flies and finds its own physics"),
    Verb("add", "adding", "adds an effect to a model, refits it, and shows the error before and after"),
    Verb("tracking", "control.tracking", "how recorded crafts followed their reference"),
]
TRACK = Verb("track", "control.track", "drives a simulated craft along a reference, without ROS running")
TUNE = Verb("tune", "control.tune", "searches for the gains of a controller in closed loop, on all cores")
