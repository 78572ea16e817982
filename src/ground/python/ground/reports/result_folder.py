"""A folder of results. A run replaces all that an older run of its kind wrote, or nothing if it fails."""

import contextlib
import fnmatch
import json
import os
import tempfile
from typing import Iterable, Iterator

from ground.support import files
from ground.support.annotations import Document, Path
from ground.support.errors import GroundError, reason, sentence

WRITING = "writing the page"  # stage


def prepare(folder: str, paths: Iterable[str], force: bool) -> None:
    """Makes a folder. GroundError when it cannot, or when one of the files in it cannot be written, as
    files.refuse_existing says."""
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError as error:
        raise GroundError("%s: cannot be made a folder (%s)" % (folder, error))
    for path in paths:
        files.refuse_existing(path, force)


@contextlib.contextmanager
def kept_if_used(folder: str) -> Iterator[None]:
    """Wraps a block that may make a folder; if the block fails, a new folder does not stay without files."""
    is_new = not os.path.isdir(folder)
    try:
        yield
    except BaseException:
        if is_new:
            with contextlib.suppress(OSError):
                os.rmdir(folder)
        raise


def is_of(path: str, schema: str) -> bool:
    """Whether an older run of the same kind has left its numbers there."""
    with contextlib.suppress(OSError, ValueError, RecursionError):
        with open(path) as file:
            found = json.load(file)
        return isinstance(found, dict) and found.get("schema") == schema
    return False


def read(folder: Path, name: str, schema: str) -> Document:
    """The numbers that a result has in its folder. GroundError when they cannot be read."""
    path = os.path.join(os.fspath(folder), name)
    try:
        with open(path) as file:
            found = json.load(file)
    except OSError as error:
        raise GroundError("%s: cannot be read (%s)" % (path, reason(error)))
    except (ValueError, RecursionError) as error:
        raise GroundError("%s: not JSON (%s)" % (path, error))
    if not isinstance(found, dict) or found.get("schema") != schema:
        raise GroundError("%s: its schema is not %s" % (path, schema))
    return found


@contextlib.contextmanager
def replaced(folder: str, stale: Iterable[str], force: bool) -> Iterator[str]:
    """Gives a temporary folder. When the block succeeds, its files become the folder's, and stale
    files that it has not written are removed; else all stays as it was. stale: patterns of their names."""
    try:
        new = tempfile.TemporaryDirectory(prefix=".ground-", dir=folder)
    except OSError as error:
        raise GroundError("%s: cannot be written to (%s)" % (folder, reason(error))) from error
    with new as temporary:
        try:
            yield temporary
        except GroundError as error:
            raise GroundError(str(error).replace(temporary, folder)) from error
        written = sorted(os.listdir(temporary))
        for name in written:
            files.refuse_existing(os.path.join(folder, name), force)
        for name in written:
            os.replace(os.path.join(temporary, name), os.path.join(folder, name))
        old = {name for pattern in stale for name in fnmatch.filter(os.listdir(folder), pattern)}
        for path in [os.path.join(folder, name) for name in old - set(written)]:
            # a folder, or an input of this command, is not of the older run
            with contextlib.suppress(FileNotFoundError, GroundError):
                files.refuse_existing(path, force=True)
                os.unlink(path)


@contextlib.contextmanager
def page(path: str, numbers: str) -> Iterator[None]:
    """Wraps a block that writes the page `path`. If it fails, GroundError says that the file `numbers`
    is kept, and how to make the page."""
    try:
        yield
    except (GroundError, OSError) as error:
        raise GroundError(
            "the page could not be written (%s); the numbers are kept in %s: make room, then repeat the "
            "command with --force to write the page %s" % (sentence(error), numbers, path)
        )
