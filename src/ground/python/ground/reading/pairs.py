"""Tables of a folder that belong together: those of the poses and of the commands of a run."""

import os
import re
from dataclasses import replace
from typing import Dict, List, Sequence, Tuple

from ground.reading.containers import FURTHER, SUFFIXES
from ground.reading.mapping import FieldMapping
from ground.support.errors import GroundError

Files = Tuple[str, ...]  #: that of the poses, and one for each place of commands


def tables(folder: str) -> List[str]:
    """The tables in a folder; those of plain text only where there are no others."""
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
            "%s: the mapping %s names the files %s (poses.file, and commands.file or those of the channels), "
            "which fit %d times here, but once is needed" % (path, mapping.file, written, len(every))
        )
    return every[0]


def named(mapping: FieldMapping) -> bool:
    """Whether a mapping says which tables of a folder have what."""
    return any(_patterns(mapping))


def within(folder: str, mapping: FieldMapping) -> List[Files]:
    """Files that belong together: the only ones, or those whose names have the same in place of * in the
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
