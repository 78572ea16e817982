"""Readers of recordings, one for each kind of file; the first one that can read a file is used.

To support another kind of file, add a Reader to READERS.
"""

import glob
import os
from typing import Iterable, List, Optional, Protocol

from ground.errors import GroundError
from ground.recordings import bag_reader
from ground.recordings.recording import Recording, read_bag


class Reader(Protocol):
    """Reads Recordings from one kind of file."""

    name: str  #: name of the kind, "bag"
    suffix: str  #: suffix of the files that are read if a folder is given, ".bag"

    def can_read(self, path: str) -> bool:
        """Whether the file at `path` is of this kind, by its first bytes or its name."""

    def read(self, path: str, axes: Optional[str], heading_offset: Optional[float]) -> Recording:
        """The Recording in a file. Mocap poses become world_ned by `axes` and `heading_offset` [rad]
        where given, else by what the file says. Raises GroundError."""


class Bag:
    """Bags of ROS 1."""

    name, suffix = "bag", ".bag"

    def can_read(self, path: str) -> bool:
        """See Reader."""
        with open(path, "rb") as file:
            return file.read(len(bag_reader.ANY_MAGIC)) == bag_reader.ANY_MAGIC

    def read(self, path: str, axes: Optional[str], heading_offset: Optional[float]) -> Recording:
        """See Reader."""
        return read_bag(path, axes, heading_offset)


READERS: List[Reader] = [Bag()]


def read(
    path: str, axes: Optional[str] = None, heading_offset: Optional[float] = None
) -> Recording:
    """The Recording in a file of any kind; axes, heading_offset: see Reader. Raises GroundError."""
    kinds = " or a ".join(reader.name for reader in READERS)
    if os.path.isdir(path):
        raise GroundError("%s: a folder, not a %s; name the files in it" % (path, kinds))
    if not os.path.isfile(path):
        raise GroundError("%s: no such file" % path)
    for reader in READERS:
        if reader.can_read(path):
            return reader.read(path, axes, heading_offset)
    raise GroundError("%s: not a %s" % (path, kinds))


def listed(paths: Iterable[str]) -> List[str]:
    """The paths with every folder replaced by the recordings in it, by name; GroundError when it has
    none."""
    found: List[str] = []
    for path in paths:
        found += _inside(path) if os.path.isdir(path) else [path]
    return found


def _inside(folder: str) -> List[str]:
    files: List[str] = []
    for reader in READERS:
        files += glob.glob(os.path.join(glob.escape(folder), "*" + reader.suffix))
    if not files:
        kinds = " or ".join(reader.name for reader in READERS)
        raise GroundError("%s: there is no %s in this folder" % (folder, kinds))
    return sorted(files)
