"""A cache of what was read and repaired, in a folder beside the recordings.

An entry is a file of arrays without pickles (.npz). Its name ends with a digest of all that it follows
from: the content of the files that were read, the options, this package and its compiled core. So an entry
is never out of date; it can only be useless, and is then removed. Whatever fails here only costs time: an
entry that is missing, damaged or from elsewhere is computed anew, and where none can be written, none is.
"""

import contextlib
import functools
import hashlib
import io
import os
import re
import time
from typing import Dict, Iterable, Iterator, List, Optional, Tuple, Union

import numpy as np

from ground import _core, files
from ground.recordings.columns import Columns
from ground.recordings.digest import add, of_file

FOLDER = ".ground_cache"
OFF = "GROUND_NO_CACHE"  # environment variable; any value but the empty one switches the cache off
FORMAT = 1  # version of the entries; another one makes all of them useless
KEPT = 4  # newest entries that are kept of a recording and stage
ABANDONED = 3600.0  # age of a temporary file whose writer is gone [s]
READING, REPAIR = "reading", "repair"  # stages
ENTRY = re.compile(r"(.+)\.(%s|%s)\.[0-9a-f]{32}\.npz" % (READING, REPAIR))
TEMPORARY = ".tmp-"
# What tools for backups and versions look for in folders that they leave out.
MARKS = {
    "CACHEDIR.TAG": "Signature: 8a477f597d28d172789f06886806bc55\n"
    "# Recordings as identify has read and repaired them; this folder may be deleted at any time.\n",
    ".gitignore": "*\n",
}


def folder_of(path: str) -> str:
    """The folder of the cache for a recording; empty where the cache is switched off."""
    if os.environ.get(OFF):
        return ""
    return os.path.join(os.path.dirname(os.path.abspath(path)), FOLDER)


def key_of_files(paths: Iterable[str], *facts: str) -> str:
    """The key of what follows from files and facts. Raises OSError when a file cannot be read."""
    digest = _begin(*facts)
    for path in paths:
        add(digest, os.path.basename(path).encode())
        add(digest, of_file(path))
    return digest.hexdigest()


def key_of_columns(columns: Columns) -> str:
    """The key of what follows from Columns."""
    digest = _begin(columns.facts)
    for name, array in sorted(columns.arrays.items()):
        add(digest, ("%s %s %s" % (name, array.dtype.str, array.shape)).encode())
        add(digest, array.tobytes())
    return digest.hexdigest()


def load(folder: str, path: str, stage: str, key: str) -> Optional[Columns]:
    """The entry of a recording's stage; None without a sound one."""
    name = _entry(folder, path, stage, key)
    try:
        with np.load(name, allow_pickle=False) as file:
            arrays = {column: file[column] for column in file.files}
        facts, kept = (arrays.pop(column).item() for column in ("facts", "key"))
        os.utime(name)
    except Exception:  # a damaged file raises errors of many kinds
        return None
    return Columns(facts, arrays) if kept == key and isinstance(facts, str) else None


def save(folder: str, path: str, stage: str, key: str, columns: Columns) -> None:
    """Keeps an entry where that is possible. Several processes may write the same one."""
    content = io.BytesIO()  # NumPy complains later when a file is full
    np.savez(content, facts=np.array(columns.facts), key=np.array(key), **columns.arrays)
    try:
        if not os.stat(os.path.dirname(folder)).st_mode & 0o222:
            return  # read-only, even for an administrator
        os.makedirs(folder, exist_ok=True)
    except OSError:
        return
    try:
        _write(_entry(folder, path, stage, key), content.getbuffer())
        for name, text in MARKS.items():
            if not os.path.exists(os.path.join(folder, name)):
                _write(os.path.join(folder, name), text.encode())
    except OSError:
        with contextlib.suppress(OSError):
            os.rmdir(folder)  # unless anything is in it


def _write(path: str, content: Union[bytes, memoryview]) -> None:
    """Writes a file completely, or not at all and raises OSError."""
    temporary = files.temporary_file(os.path.dirname(path), prefix=TEMPORARY)
    try:
        with open(temporary, "wb") as file:
            file.write(content)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


def tidy(folder: str) -> None:
    """Removes entries of recordings that are gone, old ones of those that have more than KEPT, and files of
    writers that were stopped."""
    found: Dict[Tuple[str, str], List[Tuple[float, str]]] = {}
    useless: List[str] = []
    with contextlib.suppress(OSError):
        for entry in os.scandir(folder):
            match = ENTRY.fullmatch(entry.name)
            changed = entry.stat().st_mtime
            if match:
                name, stage = match.groups()
                found.setdefault((name, stage), []).append((changed, entry.path))
            elif entry.name.startswith(TEMPORARY) and time.time() - changed > ABANDONED:
                useless.append(entry.path)
    for (name, _), entries in found.items():
        there = os.path.exists(os.path.join(os.path.dirname(folder), name))
        useless += [path for _, path in sorted(entries, reverse=True)[KEPT if there else 0 :]]
    for path in useless:
        with contextlib.suppress(OSError):
            os.unlink(path)


def _entry(folder: str, path: str, stage: str, key: str) -> str:
    name = os.path.basename(os.path.abspath(path))
    return os.path.join(folder, "%s.%s.%s.npz" % (name, stage, key))


def _begin(*facts: str) -> "hashlib._Hash":
    digest = hashlib.blake2b(digest_size=16)
    for fact in (str(FORMAT), _code(), *facts):
        add(digest, fact.encode("utf-8", "surrogateescape"))
    return digest


@functools.lru_cache(maxsize=None)
def _code() -> str:
    """A digest of the modules that read and repair; compiled libraries by size and time."""
    digest = hashlib.blake2b(np.__version__.encode(), digest_size=16)
    here = os.path.dirname(os.path.abspath(__file__))
    for folder, _, names in sorted(os.walk(here)):
        for name in sorted(names):
            if name.endswith(".py"):
                with open(os.path.join(folder, name), "rb") as file:
                    digest.update(file.read())
    for path in sorted(set(_libraries())):
        status = os.stat(path)
        digest.update(("%s %d %d" % (path, status.st_size, status.st_mtime_ns)).encode())
    return digest.hexdigest()


def _libraries() -> Iterator[str]:
    """Paths of the compiled core and of the libraries of this package that are loaded."""
    yield _core.__file__
    with contextlib.suppress(OSError), open("/proc/self/maps") as maps:  # on Linux
        for line in maps:
            path = line.split(None, 5)[-1].rstrip("\n")
            if os.path.basename(path).startswith("libground") and os.path.isfile(path):
                yield path
