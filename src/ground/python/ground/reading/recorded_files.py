"""Files of recordings: which there are in a folder, and which belong together."""

import contextlib
import glob
import os
import re
from dataclasses import replace
from typing import Dict, Iterable, List, Optional, Sequence, Tuple

from ground.reading.containers import FURTHER, SUFFIXES
from ground.reading.mapping import DEFAULT, FieldMapping
from ground.support.errors import GroundError

METADATA = "metadata.yaml"  #: description of a bag of ROS 2, in its folder
ROS1, MCAP, SQLITE = b"#ROSBAG V", b"\x89MCAP", b"SQLite format 3"  #: first bytes of files
ULOG = b"ULog\x01\x12\x35"  #: the same of logs of PX4
MAGICS = (ROS1, MCAP, SQLITE, ULOG)
BAGS = (".mcap", ".db3")  #: of files of ROS 2
BESIDE = ("-wal", "-journal")  #: what SQLite keeps beside a file that is not closed
NO_RECORDING = "neither a bag nor a table"
FOREIGN = {  # files that other programs export as tables
    **dict.fromkeys((".xlsx", ".xls", ".ods"), "the sheet"), ".mat": "its variables",
    **dict.fromkeys((".h5", ".hdf5", ".pkl"), "its data"),
    **dict.fromkeys((".bin", ".tlog"), "its messages, by mavlogdump.py for example,"),
    **dict.fromkeys((".c3d", ".tak"), "the take"), ".qtm": "the measurement as 6D TSV, or it",
    **dict.fromkeys((".json", ".jsonl", ".feather"), "its rows, by pandas for example,"),
    **dict.fromkeys((".npz", ".npy"), "its arrays"), ".zip": "its content",
}  # fmt: skip
MOST_COMMENT = 10000  #: of a file, before its schema [bytes]
# what other files of ground are, by their schema, and the option that names them
GIVEN_BY = {b"model": ("a model", "--model"), b"mapping": ("a mapping", "--mapping")}
LEVELS = 3  #: of folders below one without recordings that are searched
Files = Tuple[str, ...]  #: the file of the poses, and a file for each place of commands


def tables(folder: str) -> List[str]:
    """The tables in a folder; tables of plain text only if there are no others."""
    names = sorted(os.listdir(folder))
    found = [[name for name in names if name.lower().endswith(ends)] for ends in (SUFFIXES, FURTHER)]
    return [os.path.join(folder, name) for name in found[0] or found[1]]


def files_of(path: str, mapping: FieldMapping) -> Files:
    """The files of the recording at `path`, a folder or a table. GroundError when it is not clear which."""
    is_folder = os.path.isdir(path)
    patterns = _patterns(mapping)
    if not named(mapping) and not is_folder:
        return (path,) * len(patterns)
    every = within(path if is_folder else os.path.dirname(path) or ".", mapping)
    if not is_folder:
        name = os.path.basename(path)
        every = [files for files in every if name in [os.path.basename(file) for file in files]]
    if len(every) != 1:
        written = " and ".join("'%s'" % (pattern or "*") for pattern in patterns)
        raise GroundError(
            "%s: the mapping %s names the files %s (poses.file, and commands.file or the channels' file), "
            "which match %d times here instead of once" % (path, mapping.file, written, len(every))
        )
    return every[0]


def named(mapping: FieldMapping) -> bool:
    """Whether a mapping says which tables of a folder have what."""
    return any(_patterns(mapping))


def within(folder: str, mapping: FieldMapping) -> List[Files]:
    """Files that belong together: the only ones, or those whose names have the same instead of * in the
    patterns."""
    found = [_matching(folder, pattern) for pattern in _patterns(mapping)]
    if all(len(files) == 1 for files in found):
        return [tuple(next(iter(files.values())) for files in found)]
    return [tuple(files[key] for files in found) for key in found[0] if all(key in one for one in found)]


def chosen(mapping: FieldMapping, files: Files) -> FieldMapping:
    """A mapping whose topics are the names of the files of a recording."""
    names = [os.path.basename(file) for file in files]
    commands = mapping.commands
    by_channel = {
        channel.name: name for part, name in zip(commands.parts(), names[1:]) for channel in part.channels
    }
    channels = tuple(replace(one, topic=by_channel[one.name]) for one in commands.channels)
    return replace(
        mapping,
        poses=replace(mapping.poses, topic=names[0]),
        commands=replace(commands, topic=names[1], channels=channels),
    )


def _patterns(mapping: FieldMapping) -> Sequence[str]:
    """Patterns of the names of a recording's files."""
    return [mapping.poses.file, *(part.file for part in mapping.commands.parts())]


def _matching(folder: str, pattern: str) -> Dict[Tuple[str, ...], str]:
    """Tables whose names match a pattern, by what stands for each *."""
    parts = [re.escape(part) for part in (pattern or "*").split("*")]
    form = re.compile("(.*)".join(parts))
    every = tables(folder) if not pattern else sorted(entry.path for entry in os.scandir(folder))
    names = {path: form.fullmatch(os.path.basename(path)) for path in every}
    return {found.groups(): path for path, found in names.items() if found}


def begins(path: str) -> bytes:
    """The magic bytes with which a bag begins; empty for other files."""
    if not os.path.isfile(path):
        return b""
    with open(path, "rb") as file:
        start = file.read(max(map(len, MAGICS)))
    return next((magic for magic in MAGICS if start.startswith(magic)), b"")


def is_bag(path: str) -> bool:
    """Whether a file or folder is a bag, whole or in pieces."""
    if os.path.isdir(path):
        return os.path.isfile(os.path.join(path, METADATA)) or bool(pieces(path))
    return path.endswith(BAGS) or bool(begins(path))


def pieces(folder: str) -> List[str]:
    """The files of ROS 2 in a folder that are pieces of one bag: their names differ by their numbers, which
    count from 0; in order. Empty where they are none."""
    found: Dict[int, str] = {}
    stems = set()
    for entry in os.scandir(folder):
        parts = re.fullmatch(r"(.*)_(\d+)(\.db3|\.mcap)", entry.name)
        if entry.is_file() and entry.name.endswith(BAGS):
            stems.add(parts.group(1, 3) if parts else entry.name)
            found[int(parts.group(2)) if parts else -1] = entry.path
    whole = len(stems) == 1 and len(found) > 1 and sorted(found) == list(range(len(found)))
    return [found[number] for number in sorted(found)] if whole else []


def is_table(path: str) -> bool:
    """Whether a file or folder is read as a table; GroundError where it is neither that nor a bag."""
    if not os.path.exists(path):
        raise GroundError("%s: no such file" % path)
    if is_bag(path):
        return False
    is_folder = os.path.isdir(path)
    if path.lower().endswith((*SUFFIXES, *FURTHER)) or (is_folder and tables(path)):
        return True
    if is_folder:
        raise GroundError("%s: a folder, %s; name the files in it" % (path, NO_RECORDING))
    if os.path.basename(path) == METADATA:
        raise GroundError("%s: part of a ROS 2 bag: give its folder" % path)
    own = _own_kind(path)
    if own:
        raise GroundError("%s: %s, not a recording: give it with %s" % (path, *own))
    what = next((what for end, what in FOREIGN.items() if path.lower().endswith(end)), "")
    raise GroundError("%s: %s%s" % (path, NO_RECORDING, "; export %s as CSV" % what if what else ""))


def _own_kind(path: str) -> Optional[Tuple[str, str]]:
    """What a file of ground is that is no recording, and the option that names it; None for others."""
    if not path.lower().endswith((".yaml", ".yml")):
        return None
    with open(path, "rb") as file:
        kind = re.search(rb"^schema:\s*[\"']?ground/(\w+)/", file.read(MOST_COMMENT), re.MULTILINE)
    return GIVEN_BY.get(kind.group(1)) if kind else None


def contents(path: str, mapping: FieldMapping) -> List[str]:
    """The files that a recording is read from."""
    if is_table(path):
        return list(dict.fromkeys(files_of(path, mapping)))
    if os.path.isdir(path):
        return sorted(entry.path for entry in os.scandir(path) if entry.is_file())
    return [path] + [path + end for end in BESIDE if os.path.isfile(path + end)]


def size(path: str) -> int:
    """Size of a file, or of the files in a folder [bytes]; 0 where there is none."""
    if os.path.isdir(path):
        return sum(entry.stat().st_size for entry in os.scandir(path) if entry.is_file())
    return os.path.getsize(path) if os.path.exists(path) else 0


def listed(paths: Iterable[str], mapping: FieldMapping = DEFAULT, levels: int = LEVELS) -> List[str]:
    """The paths with every folder replaced by the recordings in it, by name; GroundError when it has
    none. Where neither bags nor tables are in a folder itself, the bags of its folders count, some levels
    deep. A folder that contains only tables stays as it is unless the mapping pairs them."""
    found: List[str] = []
    for path in paths:
        found += _inside(path, mapping, levels) if os.path.isdir(path) else [path]
    return found


def _inside(folder: str, mapping: FieldMapping, levels: int) -> List[str]:
    if is_bag(folder):
        return [folder]
    found: List[str] = []
    for suffix in (".bag", ".ulg", *BAGS):
        found += glob.glob(os.path.join(glob.escape(folder), "*" + suffix))
    for path in glob.glob(os.path.join(glob.escape(folder), "*.bag.active")):  # left by a killed recorder
        found += [path] if path[: -len(".active")] not in found else []
    below = sorted(entry.path for entry in os.scandir(folder) if entry.is_dir() and entry.name[0] != ".")
    found += [path for path in below if is_bag(path)]
    if levels and not found and not mapping.of_tables and not tables(folder):
        for path in below:
            with contextlib.suppress(GroundError, OSError):  # it has none, or others may not read it
                inside = _inside(path, mapping, levels - 1)
                found += [one for one in inside if is_bag(one) or not os.path.isdir(one)]
    if not found and not mapping.of_tables:
        found = [folder] if any(tables(path) for path in [folder, *below]) else []
    elif not found and named(mapping):
        for place in [folder, *below]:
            runs = within(place, mapping)
            found += [place] if len(runs) == 1 else [of_poses for of_poses, *_ in runs]
    elif not found:
        found = tables(folder)
    if not found:
        raise GroundError("%s: this folder contains no bag, ROS 2 bag or table" % folder)
    return sorted(found)


def to_draft(path: str) -> str:
    """The recording of which a mapping is drafted: a folder, or the first one in it that has tables."""
    if os.path.isdir(path) and len(tables(path)) < 2:  # the runs may be folders in it
        inside = sorted(entry.path for entry in os.scandir(path) if entry.is_dir())
        return next((found for found in inside if tables(found)), path)
    return path
