"""Writes files completely or not at all, overwrites none unasked, and never an input."""

import contextlib
import errno
import glob
import json
import math
import os
import shutil
import sys
import tempfile
from typing import Any, Iterable, Iterator, List, Optional, Sequence, Set, Tuple

import yaml

from ground.support.errors import GroundError, did_you_mean, reason

BAG_SPACE = 2e8  # free space with which a recording may begin; with half of it, it ends [bytes]
NO_TEXT = b"\0"  # a byte that text does not have
_inputs: Set[Tuple[int, int]] = set()  # inside protect: files that must not be replaced, (device, inode)


@contextlib.contextmanager
def protect(paths: Iterable[str]) -> Iterator[None]:
    """Inside the block no file among `paths` can be replaced, under any name. Names without a file are
    ignored."""
    global _inputs
    before = _inputs
    _inputs = {place for place in map(_place, paths) if place} | before
    try:
        yield
    finally:
        _inputs = before


def _place(path: str) -> Optional[Tuple[int, int]]:
    """Device and inode of a file; None without one."""
    try:
        status = os.stat(path)
    except (OSError, ValueError):
        return None
    return status.st_dev, status.st_ino


def path_of(given: Any, what: str) -> str:
    """The text of a path. GroundError when something else was given; what: it stands for, "a model"."""
    try:
        return str(os.fspath(given))
    except TypeError:
        kind = type(given).__name__
        own = next((": its .%s is one" % one for one in ("improved", "model") if hasattr(given, one)), "")
        text = "%s, or the path of its file, is expected here, not %s%s"
        raise GroundError(text % (what, kind, own if what == "a model" else "")) from None


def delivered(given: Any, what: str, *kinds: str) -> str:
    """The path of a file of text that comes with ground by a name, "tiny_whoover" or "tiny_whoover.yaml";
    else what is given. what: it is, "a model"; kinds: folders of cfg with such files.

    GroundError, which lists the names that there are, for a name that is neither one of them nor a file, and
    where the file is no text."""
    name = path_of(given, what)
    title, end = os.path.splitext(name)
    if os.path.isfile(name):
        with contextlib.suppress(OSError), open(name, "rb") as file:
            if NO_TEXT in file.read(1000):
                raise GroundError("%s: it is not %s: it is not a text file" % (name, what))
    if os.path.lexists(name) or os.path.basename(name) != name or end not in ("", ".yaml"):
        return name
    known = {os.path.splitext(os.path.basename(path))[0]: path for path in reversed(_delivered(kinds))}
    if title not in known and not end:
        there = "; there are " + ", ".join(sorted(known)) if known else ""
        hint = did_you_mean(name, known)
        raise GroundError("%s: neither a file nor %s that comes with ground%s%s" % (name, what, hint, there))
    return known.get(title, name)


def _delivered(kinds: Sequence[str]) -> List[str]:
    """Paths of the files in folders of cfg that come with ground: in the workspace, or where pip put the
    wheel."""
    package = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    beside = os.path.normpath(
        os.path.join(package, *[os.pardir] * 4)
    )  # of lib/python3.x/site-packages/ground
    target = os.path.dirname(package)  # pip install --target
    roots = [*os.environ.get("CMAKE_PREFIX_PATH", "").split(os.pathsep), beside, target, sys.prefix]
    places = (os.path.join(root, "share/ground/cfg", kind, "*.yaml") for root in roots for kind in kinds)
    return [path for place in places for path in sorted(glob.glob(place))]


def refuse_existing(path: str, force: bool) -> None:
    """Raises GroundError when `path` cannot be written: it is an input of this command (also through
    a link), not a regular file, exists and `force` is not set, or is in a folder that does not exist
    or cannot be written. Call it before long work starts."""
    if os.path.lexists(path):
        if _place(path) in _inputs:
            text = "cannot write to %s: it is an input of this command; choose another output name"
            raise GroundError(text % path)
        if os.path.isdir(path):
            raise GroundError("%s is a folder; name a file" % path)
        if not os.path.isfile(path) and not os.path.islink(path):
            raise GroundError("%s is not a regular file; choose another name" % path)
        if not force:
            raise GroundError(
                "%s exists; choose another name, or --force (force=True in Python) to overwrite it" % path
            )
    folder = os.path.dirname(os.path.abspath(path))
    if not os.path.isdir(folder):
        raise GroundError("%s: there is no folder %s" % (path, folder))
    if not os.access(folder, os.W_OK | os.X_OK):
        raise GroundError("%s: the folder %s cannot be written to" % (path, folder))


def check_bag_folder(path: str) -> None:
    """Raises GroundError when bags cannot be written to a folder, which may be missing."""
    place = os.path.abspath(path)
    while not os.path.lexists(place):
        place = os.path.dirname(place)
    try:
        os.rmdir(tempfile.mkdtemp(prefix=".ground-", dir=place))
        if shutil.disk_usage(place).free < BAG_SPACE:
            raise OSError(errno.ENOSPC, "less than %d MB are free" % (BAG_SPACE / 1e6))
    except OSError as error:
        raise GroundError("cannot write to the bag folder %s: %s" % (path, reason(error)))


def temporary_file(folder: str, suffix: str) -> str:
    """Path of a new empty file, with the permissions that the user's umask leaves. Raises OSError."""
    handle, path = tempfile.mkstemp(suffix, ".ground-", folder)
    os.close(handle)
    os.unlink(path)  # only its owner may read it
    os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    return path


@contextlib.contextmanager
def new_file(path: str, force: bool = False) -> Iterator[str]:
    """Gives a temporary name beside `path`; the file becomes `path` when the block succeeds."""
    refuse_existing(path, force)
    folder, name = os.path.split(os.path.abspath(path))
    try:
        temporary = temporary_file(folder, os.path.splitext(name)[1])
    except OSError as error:
        raise GroundError("%s: cannot be written (%s)" % (path, reason(error))) from error
    try:
        yield temporary
        refuse_existing(path, force)  # may have changed since the first call, before long work
        os.replace(temporary, path)
    except OSError as error:
        if error.filename not in (None, temporary, path):
            raise  # another file's, which the block read
        raise GroundError("%s: cannot be written (%s)" % (path, reason(error))) from error
    finally:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(temporary)


def plain(value: Any) -> Any:
    """The value with None instead of infinite numbers and NaN, which JSON does not have."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_text(path: str, text: str, force: bool = False) -> None:
    """Writes a text in UTF-8; GroundError as from new_file."""
    with new_file(path, force) as temporary, open(temporary, "w", encoding="utf-8") as file:
        file.write(text)


def write_json(path: str, value: Any, force: bool = False) -> None:
    """Writes a value as JSON, None for numbers that are not finite; GroundError as from new_file."""
    write_text(path, json.dumps(plain(value), indent=1, allow_nan=False) + "\n", force)


def write_yaml(path: str, value: Any, force: bool = False) -> None:
    """Writes a value as YAML, keys in their order; GroundError as from new_file."""
    write_text(path, yaml.safe_dump(value, sort_keys=False), force)


def write_csv(path: str, header: str, rows: Iterable[Sequence[float]], force: bool = False) -> None:
    """Writes rows of numbers under a line of column names."""
    lines = [header, *(",".join("%.9g" % value for value in row) for row in rows)]
    write_text(path, "\n".join(lines) + "\n", force)
