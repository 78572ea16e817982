"""Records of trials whether crafts stop by themselves: a YAML file that only grows.

It is a map from the name of the craft's model to its trials, the newest last. The sender reads it when
it is armed (ground/link/own_stop.h).
"""

import fcntl
import os
from typing import Dict, List

import yaml

from ground.support import files
from ground.support.annotations import Document
from ground.support.bounded_yaml import LOADER
from ground.support.errors import GroundError


def default_path() -> str:
    """Path of this computer's records, under $ROS_HOME or ~/.ros."""
    home = os.environ.get("ROS_HOME") or os.path.join(os.path.expanduser("~"), ".ros")
    return os.path.join(home, "ground", "own_stop.yaml")


def read(path: str) -> Dict[str, List[Document]]:
    """Name of a craft to its list of trials; empty when there is no file yet."""
    if not os.path.exists(path):
        return {}
    with open(path) as file:
        try:
            crafts = yaml.load(file, LOADER) or {}
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            raise GroundError("%s: not YAML, nothing is added to it: %s" % (path, error))
    if not isinstance(crafts, dict) or not all(isinstance(c, list) for c in crafts.values()):
        raise GroundError("%s: not a map of craft to trials, nothing is added to it" % path)
    return crafts


def append(path: str, craft: str, trial: Document) -> None:
    """Appends a trial of a craft. The folder is created if it is missing."""
    folder = os.path.dirname(os.path.abspath(path))
    os.makedirs(folder, exist_ok=True)
    lock = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX)
        crafts = read(path)
        crafts.setdefault(craft, []).append(trial)
        files.write_yaml(path, crafts, force=True)
    finally:
        os.close(lock)
