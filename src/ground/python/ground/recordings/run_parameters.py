"""Parameters of a run, by node, and the contents of the model and room files that they name.

record.launch writes them beside a bag, as RUN.yaml; the bag of a simulated run has the same text in a
message (ground_msgs/RunSettings). The files' contents are under run_files, path: text.
"""

import contextlib
import os
import re
from typing import Any, Dict, Iterator, List, Mapping, Tuple

import yaml

from ground.annotations import Document
from ground.recordings import messages
from ground.recordings.messages import MessageSource

TYPE = "ground_msgs/RunSettings"
FILES = "run_files"
NAMES = ("model", "room")  # parameters whose files' contents are recorded
LARGEST = 10**6  # size of the largest file that is recorded [bytes]
PART = re.compile(r"(_\d+)?\.bag(\.active)?$")  # end of the name of a part of a recording
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Dumper(yaml.SafeDumper):  # type: ignore[misc]  # PyYAML has no types
    """Writes strings of several lines as blocks."""


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    style = "|" if "\n" in text else None
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


_Dumper.add_representer(str, _text)


def contents(parameters: Mapping[str, Any]) -> str:
    """YAML text with the contents of the model and room files that `parameters` (a dict by node) name;
    files that cannot be read are left out."""
    found = {}
    for path in sorted(set(_paths(parameters))):
        try:
            if os.path.isfile(path) and os.path.getsize(path) <= LARGEST:
                with open(path, encoding="utf-8") as file:
                    found[path] = file.read()
        except (OSError, ValueError):
            continue
    return str(yaml.dump({FILES: found}, Dumper=_Dumper) if found else "")


def document(parameters: Dict[str, Any]) -> str:
    """YAML text of parameters by node, with the contents of their files."""
    return str(yaml.dump(parameters, Dumper=_Dumper) + contents(parameters))


def _paths(parameters: Mapping[str, Any]) -> Iterator[str]:
    for key, value in parameters.items():
        if isinstance(value, dict):
            yield from _paths(value)
        elif key in NAMES and isinstance(value, str):
            yield value


def in_bag(bag: MessageSource) -> Iterator[Any]:
    """Parameters by node in a MessageSource of a simulated run; damaged ones are left out."""
    for message in messages.of_type(bag, TYPE):
        with contextlib.suppress(ValueError, yaml.YAMLError, RecursionError):
            yield yaml.load(message.yaml, LOADER)


def paths_beside(path: str) -> List[str]:
    """Paths of the parameter files beside a bag."""
    names = PART.sub("", path) + ".yaml", os.path.splitext(path)[0] + ".yaml"
    return [name for name in dict.fromkeys(names) if os.path.isfile(name)]


def beside(path: str, warnings: List[str]) -> Iterator[Tuple[str, Any]]:
    """Name and content of the readable parameter files beside a bag."""
    for name in paths_beside(path):
        try:
            with open(name) as file:
                yield name, yaml.load(file, LOADER)
        except (OSError, ValueError, yaml.YAMLError, RecursionError) as error:
            warnings.append(
                "%s: cannot be read, so that axes and heading_offset are the defaults (%s)"
                % (os.path.basename(name), str(error).splitlines()[0])
            )


def nodes(parameters: Any, name: str) -> Iterator[Document]:
    """Parameters of nodes of that name, in any namespace."""
    if not isinstance(parameters, dict):
        return
    for key, value in parameters.items():
        if key == name and isinstance(value, dict):
            yield value
        else:
            yield from nodes(value, name)
