"""Gains of a controller in a YAML file: names and numbers of dynamic_reconfigure, so that rosparam
load and dynparam load can read them, too."""

import math
import os
from typing import Dict, Iterable, Mapping, Union

import yaml

from ground import _core
from ground.support import files
from ground.support.annotations import Path, Setting
from ground.support.bounded_yaml import LOADER
from ground.support.errors import GroundError, core_errors

CONTROLLERS = {info.name: info for info in _core.controller_table()}
Gains = Union[Path, Mapping[str, Setting]]


def choice(kind: object, gains: Union[None, Gains] = None) -> _core.ControllerChoice:
    """The _core.ControllerChoice of a kind with gains by name or in a file; default ones for the rest.
    GroundError on unknown names."""
    if kind not in CONTROLLERS:
        text = "controller: %r is not one of %s; ground.track also takes a function"
        raise GroundError(text % (kind, ", ".join(CONTROLLERS)))
    made = _core.ControllerChoice()
    made.kind = str(kind)
    with core_errors():
        made.values = dict(gains) if isinstance(gains, Mapping) else read(gains) if gains else {}
    return made


def read(given: Path) -> Dict[str, float]:
    """Name to number, of a file or of gains that come with ground by their name; GroundError that says what
    is wrong with it."""
    path = files.delivered(given, "a file of gains", "gains")
    try:
        with open(path) as file:
            values = yaml.load(file, LOADER)
    except OSError as error:
        raise GroundError("%s: cannot be read (%s)" % (path, error))
    except (ValueError, RecursionError, yaml.YAMLError) as error:
        raise GroundError("%s: not YAML (%s)" % (path, error))
    if not isinstance(values, dict):
        raise GroundError("%s: it must be lines of NAME: NUMBER" % path)
    for name, value in values.items():
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not number or not math.isfinite(value):
            raise GroundError("%s: %s is %r, not a finite number" % (path, name, value))
    return {str(name): float(value) for name, value in values.items()}


def write(path: str, choice: _core.ControllerChoice, comments: Iterable[str], force: bool = False) -> str:
    """Writes the gains of a _core.ControllerChoice; comments: lines on their origin."""
    values = {name: float("%.6g" % float(value)) for name, value in choice.values.items()}
    head = "".join("# %s\n" % line for line in ("Gains of %s." % choice.kind, *comments))
    files.write_text(path, head + str(yaml.safe_dump(values, sort_keys=False)), force)
    return os.path.abspath(path)
