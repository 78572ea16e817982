"""Provenance of a result: what is needed to reproduce it."""

import datetime
import functools
import hashlib
import os
import platform
import shlex
import sys
from importlib import metadata
from typing import Iterable, List, Tuple

BLOCK = 1 << 20  # bytes that are hashed at a time


def command() -> str:
    """The command line of this process."""
    name = os.path.basename(sys.argv[0])
    return " ".join([name] + [shlex.quote(a) for a in sys.argv[1:]])


def now() -> str:
    """The time in UTC, ISO 8601, to the second."""
    return datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds")


def versions() -> str:
    """Versions of the programs used."""
    from ground import _core

    found = {"ground": _core.version, "Eigen": _core.eigen_version}
    libraries = ("numpy", "scipy", "plotly")
    found.update((name, metadata.version(name)) for name in libraries)
    found["Python"] = platform.python_version()
    return ", ".join("%s %s" % item for item in found.items())


def digests(paths: Iterable[str]) -> List[Tuple[str, str]]:
    """Files or folders, each with the digest of what it contains."""
    return [(path, digest_of_files(_files(path))) for path in paths]


def digest_of_files(paths: Iterable[str]) -> str:
    """A digest of what files contain, whatever their names and order. Raises OSError when a file cannot
    be read."""
    found = []
    for path in paths:
        one = hashlib.blake2b(digest_size=32)
        with open(path, "rb") as file:
            for block in iter(functools.partial(file.read, BLOCK), b""):
                one.update(block)
        found.append(one.digest())
    return digest(sorted(found))


def digest(parts: Iterable[bytes]) -> str:
    """A digest of parts in their order, and of their lengths, so that parts cannot be mistaken for
    others."""
    digest = hashlib.blake2b(digest_size=16)
    for part in parts:
        digest.update(b"%d:" % len(part) + part)
    return digest.hexdigest()


def _files(path: str) -> List[str]:
    """The file itself, or all files in a folder, in order of their names."""
    if not os.path.isdir(path):
        return [path]
    return sorted(os.path.join(folder, name) for folder, _, names in os.walk(path) for name in names)
