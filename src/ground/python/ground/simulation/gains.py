"""Gains of a controller in a YAML file: names and numbers as dynamic_reconfigure has them, so that
rosparam load and dynparam load read them, too."""
import math
import os

import yaml

from ground import _core, files
from ground.errors import IdentifyError

# kind of controller -> place of its gains in _core.ControllerChoice, names
PLACES = {
    "TrajectoryTracking": (
        lambda choice: choice.gains,
        ["k_e", "k_z", "k_phi_1", "k_phi_2", "delta_1", "delta_2"],
    ),
    "ModelPredictive": (
        lambda choice: choice.predictive.weights,
        ["velocity", "input", "turning", "end_position", "end_velocity"],
    ),
    "OpenLoopPRBS": (lambda choice: choice.prbs, ["clock"]),
}


def get(choice):
    """Name to value of the gains of a _core.ControllerChoice."""
    place, names = PLACES[choice.kind]
    return {name: getattr(place(choice), name) for name in names}


def put(choice, values):
    """Sets gains by their names; IdentifyError on unknown ones."""
    place, names = PLACES[choice.kind]
    for name, value in values.items():
        if name not in names:
            raise IdentifyError(
                "%s has no gain '%s'; it has %s" % (choice.kind, name, ", ".join(names))
            )
        setattr(place(choice), name, value)


def choice(kind, path=None):
    """The _core.ControllerChoice of a kind with the gains in a file, or its own."""
    made = _core.ControllerChoice()
    made.kind = kind
    if path:
        put(made, read(path))
    return made


def read(path):
    """Name to number; IdentifyError that says what is wrong with the file."""
    try:
        with open(path) as file:
            values = yaml.safe_load(file)
    except OSError as error:
        raise IdentifyError("%s: cannot be read (%s)" % (path, error))
    except (ValueError, RecursionError, yaml.YAMLError) as error:
        raise IdentifyError("%s: is no YAML (%s)" % (path, error))
    if not isinstance(values, dict):
        raise IdentifyError("%s: it has to be lines of NAME: NUMBER" % path)
    for name, value in values.items():
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not number or not math.isfinite(value):
            raise IdentifyError("%s: %s is %r, not a finite number" % (path, name, value))
    return {str(name): float(value) for name, value in values.items()}


def write(path, choice, comments, force=False):
    """Writes the gains of a _core.ControllerChoice; comments: lines that say where they come from."""
    with files.new_file(path, force) as temporary:
        with open(temporary, "w") as file:
            file.write("# Gains of %s.\n" % choice.kind)
            for line in comments:
                file.write("# %s\n" % line)
            for name, value in get(choice).items():
                file.write("%s: %s\n" % (name, _plain(value)))
    return os.path.abspath(path)


def _plain(value):
    """A number as YAML 1.1 reads it back: with a point."""
    text = "%.6g" % value
    return text if "." in text or "e" not in text else text.replace("e", ".0e")
