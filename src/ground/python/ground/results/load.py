"""load: results that were saved, models and recordings."""

import json
import os
from typing import Any, Callable, Dict

from ground.comparing.result import Comparison
from ground.control.track import SCHEMA as TRACKING
from ground.control.track import Tracking
from ground.data.read import read
from ground.diagnosing.result import Diagnosis
from ground.discovery.discover import Discovery
from ground.ledger.result import History
from ground.models import Model, Room
from ground.support.annotations import Path
from ground.support.errors import GroundError

FOLDERS: Dict[str, Callable[[str], Any]] = {
    "diagnosis.json": Diagnosis.load,
    "compare.json": Comparison.load,
    "journal.json": Discovery.load,
    "history.json": History.load,
}


def load(path: Path) -> Any:
    """Loads a result, model, room or recording from a file or folder.

    Numbers, sentences and models of a loaded result equal the saved ones. A loaded diagnosis or
    comparison has no recordings: it cannot draw runs or be saved again.

    Parameters
    ----------
    path : path
        The folder of a diagnosis, a comparison, a discovery or a history; a model file, also of a fit or an
        addition; a room file; the file of a Tracking; a recording.

    Returns
    -------
    Diagnosis, Comparison, Discovery, History, Model, Room, Tracking or Recording
        The loaded object. `fitted` of a Model tells how it was fitted.

    Raises
    ------
    GroundError
        When the path is none of these.

    Examples
    --------
    >>> ground.load(model_file)["m"]
    0.0583
    >>> ground.load(bag).name, ground.load(room_file).name
    ('run', '4 x 4 m')
    >>> ground.load("nowhere")
    Traceback (most recent call last):
    ...
    ground.support.errors.GroundError: nowhere: no such file or folder
    """
    place = os.fspath(path)
    if not os.path.exists(place):
        raise GroundError("%s: no such file or folder" % place)
    if os.path.isdir(place):
        for name, reader in FOLDERS.items():
            if os.path.isfile(os.path.join(place, name)):
                return reader(place)
    elif os.path.basename(place) in FOLDERS:
        return FOLDERS[os.path.basename(place)](os.path.dirname(place) or ".")
    elif place.endswith((".yaml", ".yml")):
        return _of_yaml(place)
    elif place.endswith(".json"):
        return _of_json(place)
    found = read(place)
    if len(found) > 1:
        raise GroundError("%s: contains %d recordings; ground.read returns all of them" % (place, len(found)))
    return found[0]


def _of_yaml(path: str) -> Any:
    """A model or a room."""
    with open(path, encoding="utf-8", errors="replace") as file:
        is_room = "ground/room/" in file.read(1000)
    return Room.load(path) if is_room else Model.load(path)


def _of_json(path: str) -> Any:
    """A Tracking."""
    try:
        with open(path) as file:
            schema = json.load(file).get("schema")
    except (OSError, ValueError, AttributeError) as error:
        raise GroundError("%s: not a result file (%s)" % (path, error))
    if schema != TRACKING:
        raise GroundError("%s: not a result file; load its folder" % path)
    return Tracking.load(path)
