"""Readers of recordings, one for each kind of file; the first one that can read a file is used.

To support another kind of file, add a Reader to READERS.
"""

import glob
import os
import re
from dataclasses import replace
from typing import ContextManager, Dict, Iterable, List, Optional, Protocol, Tuple

from ground.errors import GroundError
from ground.recordings import bag_reader, digest, drafts, run_parameters
from ground.recordings.bag_reader import BagReader
from ground.recordings.mapping import DEFAULT, FieldMapping
from ground.recordings.messages import MessageSource, Tell, Told
from ground.recordings.recording import Recording, read_source
from ground.recordings.ros2_reader import Ros2Reader
from ground.recordings.tables import SUFFIXES, TableReader

METADATA = "metadata.yaml"  # description of a bag of ROS 2, in its folder


class Reader(Protocol):
    """Reads Recordings from one kind of file."""

    name: str  #: name of the kind, "bag"
    suffix: str  #: suffix of the files that are read if a folder is given, ".bag"

    def can_read(self, path: str) -> bool:
        """Whether the file or folder at `path` is of this kind, by its first bytes or its name."""

    def read(self, path: str, mapping: FieldMapping) -> Recording:
        """The Recording in a file, by what the mapping says. Raises GroundError."""


class OfMessages:
    """A reader of files that hold messages."""

    name, suffix = "", ""

    def open(self, path: str, mapping: FieldMapping) -> ContextManager[MessageSource]:
        """The messages in a file. Raises GroundError."""
        raise NotImplementedError

    def everything(self, path: str) -> ContextManager[MessageSource]:
        """All that is in a file, of which a mapping may choose. Raises GroundError."""
        return self.open(path, DEFAULT)

    def files(self, path: str, mapping: FieldMapping) -> List[str]:
        """The files that a recording is read from."""
        if not os.path.isdir(path):
            return [path]
        return sorted(entry.path for entry in os.scandir(path) if entry.is_file())

    def read(self, path: str, mapping: FieldMapping, tell: Optional[Tell] = None) -> Recording:
        """See Reader; tell: called with the share that has been read."""
        with self.open(path, mapping) as source:
            return read_source(Told(source, tell) if tell else source, path, mapping)


class Bag(OfMessages):
    """Bags of ROS 1."""

    name, suffix = "bag", ".bag"

    def can_read(self, path: str) -> bool:
        """See Reader."""
        if os.path.isdir(path):
            return False
        with open(path, "rb") as file:
            return file.read(len(bag_reader.ANY_MAGIC)) == bag_reader.ANY_MAGIC

    def open(self, path: str, mapping: FieldMapping) -> ContextManager[MessageSource]:
        """See OfMessages."""
        return BagReader(path)


class Ros2Bag(OfMessages):
    """Bags of ROS 2, as folders or as their single files."""

    name, suffix = "bag of ROS 2", ".mcap"

    def can_read(self, path: str) -> bool:
        """See Reader."""
        if os.path.isdir(path):
            return os.path.isfile(os.path.join(path, METADATA))
        return path.endswith((".mcap", ".db3"))

    def open(self, path: str, mapping: FieldMapping) -> ContextManager[MessageSource]:
        """See OfMessages."""
        return Ros2Reader(path)

    def files(self, path: str, mapping: FieldMapping) -> List[str]:
        """See OfMessages; SQLite may have what was written last in a file of its own."""
        log = path + "-wal"
        return super().files(path, mapping) + ([log] if os.path.isfile(log) else [])


class Table(OfMessages):
    """CSV and Parquet files; a folder where poses and commands are files of their own."""

    name, suffix = "table", SUFFIXES[0]

    def can_read(self, path: str) -> bool:
        """See Reader."""
        return path.lower().endswith(SUFFIXES) or (os.path.isdir(path) and bool(_tables(path)))

    def open(self, path: str, mapping: FieldMapping) -> ContextManager[MessageSource]:
        """See OfMessages."""
        return TableReader(self.files(path, mapping))

    def files(self, path: str, mapping: FieldMapping) -> List[str]:
        """See OfMessages."""
        return list(dict.fromkeys(_pair(path, mapping)))

    def everything(self, path: str) -> ContextManager[MessageSource]:
        """See OfMessages."""
        return TableReader(_tables(path) if os.path.isdir(path) else [path])

    def read(self, path: str, mapping: FieldMapping, tell: Optional[Tell] = None) -> Recording:
        """See OfMessages."""
        if not mapping.of_tables:
            raise GroundError(
                "%s: which columns are times, poses and commands is not known; identify info %s "
                "--write-mapping M.yaml drafts a mapping, and --mapping M.yaml takes it"
                % (path, path)
            )
        poses, commands = _pair(path, mapping)
        with self.open(path, mapping) as source:
            named = mapping.with_options(os.path.basename(poses), os.path.basename(commands))
            return read_source(Told(source, tell) if tell else source, path, named)


READERS: List[Reader] = [Bag(), Ros2Bag(), Table()]


def reader_of(path: str) -> Reader:
    """The first reader that can read a file or folder. GroundError when there is none."""
    kinds = " or a ".join(reader.name for reader in READERS)
    if not os.path.exists(path):
        raise GroundError("%s: no such file" % path)
    for reader in READERS:
        if reader.can_read(path):
            return reader
    if os.path.isdir(path):
        raise GroundError("%s: a folder, not a %s; name the files in it" % (path, kinds))
    raise GroundError("%s: not a %s" % (path, kinds))


def read(path: str, mapping: FieldMapping = DEFAULT, tell: Optional[Tell] = None) -> Recording:
    """The Recording in a file of any kind, by what the mapping says; tell: called with the share of it
    that has been read, 0..1. Raises GroundError."""
    reader = reader_of(path)
    if isinstance(reader, OfMessages):
        found, read_from = reader.read(path, mapping, tell), reader.files(path, mapping)
    else:
        found, read_from = reader.read(path, mapping), [path] if os.path.isfile(path) else []
    # The description of a folder is not part of a run: the same run may be given without it.
    measured = [name for name in read_from if os.path.basename(name) != METADATA]
    return replace(found, digest=digest.of_files(measured) if measured else "")


def files(path: str, mapping: FieldMapping = DEFAULT) -> List[str]:
    """The files that a recording is read from, with those beside it; empty where that is not known. Raises
    GroundError."""
    reader = reader_of(path)
    if not isinstance(reader, OfMessages):
        return []
    return [*reader.files(path, mapping), *run_parameters.paths_beside(path)]


def size(path: str) -> int:
    """Size of a file, or of the files in a folder [bytes]; 0 where there is none."""
    if os.path.isdir(path):
        return sum(entry.stat().st_size for entry in os.scandir(path) if entry.is_file())
    return os.path.getsize(path) if os.path.exists(path) else 0


def drafted(path: str) -> str:
    """The text of a mapping for a file or folder, with the evidence of what it guesses. Raises
    GroundError."""
    if os.path.isdir(path) and len(_tables(path)) < 2:  # the runs may be folders in it
        inside = sorted(entry.path for entry in os.scandir(path) if entry.is_dir())
        path = next((found for found in inside if _tables(found)), path)
    reader = reader_of(path)
    if not isinstance(reader, OfMessages):
        raise GroundError("%s: a %s takes no mapping" % (path, reader.name))
    with reader.everything(path) as source:
        return drafts.draft(source, path, os.path.isdir(path))


def listed(paths: Iterable[str], mapping: FieldMapping = DEFAULT) -> List[str]:
    """The paths with every folder replaced by the recordings in it, by name; GroundError when it has
    none. A folder with tables only stays what it is unless the mapping says how to pair them."""
    found: List[str] = []
    for path in paths:
        found += _inside(path, mapping) if os.path.isdir(path) else [path]
    return found


def _inside(folder: str, mapping: FieldMapping) -> List[str]:
    if os.path.isfile(os.path.join(folder, METADATA)):
        return [folder]
    files: List[str] = []
    for reader in READERS:
        if not isinstance(reader, Table):
            files += glob.glob(os.path.join(glob.escape(folder), "*" + reader.suffix))
    below = sorted(entry.path for entry in os.scandir(folder) if entry.is_dir())
    files += [path for path in below if os.path.isfile(os.path.join(path, METADATA))]
    if files:
        return sorted(files)
    if not mapping.of_tables:
        if any(_tables(path) for path in [folder, *below]):
            return [folder]
    elif mapping.poses.file or mapping.commands.file:
        files = [path for place in [folder, *below] for path in _paired(place, mapping)]
    else:
        files = _tables(folder)
    if files:
        return sorted(files)
    kinds = " or ".join(reader.name for reader in READERS)
    raise GroundError("%s: there is no %s in this folder" % (folder, kinds))


def _tables(folder: str) -> List[str]:
    names = sorted(os.listdir(folder))
    return [os.path.join(folder, name) for name in names if name.lower().endswith(SUFFIXES)]


def _paired(folder: str, mapping: FieldMapping) -> List[str]:
    """The recordings of tables in a folder: the folder itself when there is one, else the files of the
    poses."""
    pairs = _pairs(folder, mapping)
    return [folder] if len(pairs) == 1 else [poses for poses, _ in pairs]


def _pairs(folder: str, mapping: FieldMapping) -> List[Tuple[str, str]]:
    """Files of poses and of commands that belong together: the only ones, or those whose names have
    the same in place of * in the patterns."""
    of_poses = _matching(folder, mapping.poses.file)
    of_commands = _matching(folder, mapping.commands.file)
    if len(of_poses) == len(of_commands) == 1:
        return list(zip(of_poses.values(), of_commands.values()))
    return [(path, of_commands[key]) for key, path in of_poses.items() if key in of_commands]


def _matching(folder: str, pattern: str) -> Dict[Tuple[str, ...], str]:
    """Tables whose names match a pattern, by what stands for each *."""
    parts = [re.escape(part) for part in (pattern or "*").split("*")]
    form = re.compile("(.*)".join(parts))
    names = {path: form.fullmatch(os.path.basename(path)) for path in _tables(folder)}
    return {found.groups(): path for path, found in names.items() if found}


def _pair(path: str, mapping: FieldMapping) -> Tuple[str, str]:
    """Files of the poses and of the commands of the recording at `path`."""
    if not (mapping.poses.file or mapping.commands.file) and not os.path.isdir(path):
        return path, path
    folder = path if os.path.isdir(path) else os.path.dirname(path) or "."
    pairs = _pairs(folder, mapping)
    if not os.path.isdir(path):
        name = os.path.basename(path)
        pairs = [pair for pair in pairs if name in [os.path.basename(file) for file in pair]]
    if len(pairs) != 1:
        raise GroundError(
            "%s: the mapping %s names poses.file '%s' and commands.file '%s', which fit %d pairs of "
            "tables here, but one is needed"
            % (path, mapping.file, mapping.poses.file, mapping.commands.file, len(pairs))
        )
    return pairs[0]
