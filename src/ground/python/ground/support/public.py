"""Public names of the package. The rooms below call verbs of those above by them, as `run.plot()` does, and
import no room above: `ground/__init__.py`, which is above all, says where each is, and a room is loaded when
one of its names is used."""

import importlib
from typing import Any, Dict

HOMES: Dict[str, str] = {}  # module by public name


def public(name: str) -> Any:
    """What has a public name; AttributeError where nothing has."""
    if name not in HOMES:
        raise AttributeError("module 'ground' has no attribute '%s'" % name)
    return getattr(importlib.import_module(HOMES[name]), name)
